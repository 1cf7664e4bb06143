//! Files of what is made of results: written as results are, and handed out as they lie.

use std::io::{self, Write};
use std::time::Duration;

use packstone_engine::Control;
use packstone_engine::export::{ExportError, ExportReport};

use super::read::check_length;
use super::{Artifacts, InFlight, blob};
use crate::blobs::{Blob, Shown};
use crate::exports::StoredFile;

impl Artifacts {
    /// Writes a file of what `make` makes, of at most so many bytes.
    ///
    /// # Errors
    /// Those of `make` and of the disk, with [`io::ErrorKind::ConnectionAborted`] for a stop by `control` and
    /// [`io::ErrorKind::QuotaExceeded`] for a file of more bytes. Nothing is left behind.
    pub(crate) fn write_export(
        &self,
        place: &InFlight,
        most_bytes: u64,
        control: &dyn Control,
        make: impl FnOnce(&mut dyn Write) -> Result<ExportReport, ExportError>,
    ) -> Result<(StoredFile, ExportReport), ExportError> {
        let (report, bytes, sha256) = self.write_whole(place, most_bytes, control, make, |_, _| Ok(()))?;
        Ok((StoredFile { path: place.path.clone(), bytes, sha256 }, report))
    }

    /// Opens a file that was made of a result, to be sent as it lies. In a folder its digest is checked the first time
    /// since the start of the server; of an object in a bucket, which the storage itself checks, the length is. Blocks
    /// the thread.
    ///
    /// # Errors
    /// Those of the storage; [`io::ErrorKind::InvalidData`] where the file is not what was stored.
    pub(crate) fn open_export(&self, stored: &StoredFile) -> io::Result<Box<dyn Blob>> {
        if self.blobs.checks_bytes() {
            let opened = self.blobs.open(&blob(&stored.path))?;
            check_length(&stored.path, opened.length()?, stored.bytes)?;
            return Ok(opened);
        }
        Ok(Box::new(self.open_checked(&stored.path, stored.bytes, &stored.sha256)?))
    }

    /// A URL of the storage at which a file that was made of a result can be had for so long. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn url_of_export(
        &self,
        stored: &StoredFile,
        shown: &Shown<'_>,
        valid: Duration,
    ) -> io::Result<Option<String>> {
        self.blobs.url(&blob(&stored.path), shown, valid)
    }
}
