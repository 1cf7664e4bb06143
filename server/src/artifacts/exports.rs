//! Files of what is made of results: written as results are, and handed out as they lie.

use std::fs::File;
use std::io::{self, Write};

use packstone_engine::Control;
use packstone_engine::export::{ExportError, ExportReport};

use super::{Artifacts, InFlight};
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
        let (report, bytes, sha256) = self.write_whole(place, most_bytes, control, make, || Ok(()))?;
        Ok((StoredFile { path: place.path.clone(), bytes, sha256 }, report))
    }

    /// Opens a file that was made of a result. Its digest is checked the first time since the start of the server.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where the file is not what was stored.
    pub(crate) fn open_export(&self, stored: &StoredFile) -> io::Result<File> {
        self.open_checked(&stored.path, stored.bytes, &stored.sha256)
    }
}
