//! Files of what is made of results: written as results are, and handed out as they lie.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use packstone_engine::Control;
use packstone_engine::export::{ExportError, ExportReport};

use super::read::check_length;
use super::{Artifacts, InFlight, blob};
use crate::blobs::blocks::{BlockSums, CheckedBlob};
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
        let (report, bytes, sha256) = self.write_whole(place, most_bytes, control, make, |_, _, _| Ok(()))?;
        Ok((StoredFile { path: place.path.clone(), bytes, sha256 }, report))
    }

    /// Opens a file that was made of a result, to be sent as it lies. Its digest is compared the first time since the
    /// start of the server, and each block that is read each time. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage; [`io::ErrorKind::InvalidData`] where the file is not what was stored.
    pub(crate) fn open_export(&self, stored: &StoredFile) -> io::Result<Box<dyn Blob>> {
        let StoredFile { path, bytes, sha256 } = stored;
        let (opened, sums): (Box<dyn Blob>, _) = if self.blobs.is_remote() {
            self.open_remote(path, *bytes, sha256)?
        } else {
            let (file, sums) = self.open_checked(path, *bytes, sha256)?;
            (Box::new(file), sums)
        };
        Ok(Box::new(CheckedBlob::new(opened, path.clone(), sums, self.on_damage(path))))
    }

    /// Opens a file where it lies. Where the sums of its blocks are not known, all of it is read once before.
    fn open_remote(
        &self,
        path: &str,
        bytes: u64,
        sha256: &str,
    ) -> io::Result<(Box<dyn Blob>, Arc<BlockSums>)> {
        let opened = self.blobs.open(&blob(path))?;
        check_length(path, opened.length()?, bytes)?;
        if let Some(sums) = self.known_sums(path, bytes) {
            return Ok((opened, sums));
        }
        let sums = self.compare(&mut *opened.read(0..bytes)?, path, sha256)?;
        Ok((self.blobs.open(&blob(path))?, sums))
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
