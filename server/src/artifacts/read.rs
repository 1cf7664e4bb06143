//! Opening a stored result, and making sure that it is the one that was stored.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek as _};
use std::sync::Arc;

use packstone_engine::Unattended;
use packstone_engine::export::tables::{Column, GrainSource, Head, stored, stored::Layout};
use packstone_engine::shape::Polyhedron;
use sha2::{Digest, Sha256};

use super::{Artifacts, blob, write};
use crate::blobs::blocks::{BlockSummer, BlockSums, CheckedFile};
use crate::disk::is_passing;
use crate::hex;
use crate::jobs::ArtifactRecord;

const BLOCK_BYTES: usize = 1 << 16;
/// On the stack of the thread that converts.
const COLUMN_BLOCK_BYTES: usize = 1 << 13;
/// Files up to this length are verified as a whole each time they are opened, so that an answer with a damaged one is
/// refused before its first byte.
const SMALL_BYTES: u64 = 4 << 20;
/// How often a file is read that does not agree with its digest: a copy of an object may be damaged, not the object.
const TRIES: usize = 2;

/// An open result. It stays readable when the file is removed meanwhile.
#[derive(Debug)]
pub(crate) struct StoredResult {
    layout: Layout,
    file: CheckedFile,
}

impl Artifacts {
    /// Opens a result. The digest of the file is compared the first time since the start of the server, and each block
    /// that is read each time: disks and people do change files.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where the file is not what was stored.
    pub(crate) fn read(&self, record: &ArtifactRecord) -> io::Result<StoredResult> {
        let (file, sums) = self.open_checked(&record.path, record.bytes, &record.sha256)?;
        StoredResult::of(CheckedFile::new(file, record.path.clone(), sums, self.on_damage(&record.path)))
    }

    /// Whether a result is missing or not what was stored; its digest is compared in any case.
    pub(crate) fn is_damaged(&self, record: &ArtifactRecord) -> bool {
        self.forget(&record.path);
        self.read(record).is_err_and(|error| !is_passing(&error))
    }

    /// The length of a file and its SHA-256, as it lies. Blocks the thread.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn digest(&self, path: &str) -> io::Result<(u64, String)> {
        let opened = self.blobs.open(&blob(path))?;
        let bytes = opened.length()?;
        let (sha256, _) = digest(&mut *opened.read(0..bytes)?)?;
        Ok((bytes, sha256))
    }

    /// Opens a file that is as long as it was stored, and tells the sums of its blocks. Its digest is compared where
    /// these are not known; a small file is verified as a whole.
    pub(super) fn open_checked(
        &self,
        path: &str,
        bytes: u64,
        sha256: &str,
    ) -> io::Result<(File, Arc<BlockSums>)> {
        let mut tried = 1;
        loop {
            let opened = self.try_open_checked(path, bytes, sha256);
            match opened {
                Err(error) if error.kind() == io::ErrorKind::InvalidData && tried < TRIES => {
                    tracing::warn!(%error, path, "a stored file is not what was stored; it is read again");
                    self.forget(path);
                    tried += 1;
                }
                opened => return opened,
            }
        }
    }

    fn try_open_checked(&self, path: &str, bytes: u64, sha256: &str) -> io::Result<(File, Arc<BlockSums>)> {
        let file = self.blobs.fetch(&blob(path))?;
        check_length(path, file.metadata()?.len(), bytes)?;
        if let Some(sums) = self.known_sums(path, bytes) {
            if bytes <= SMALL_BYTES
                && let Some(block) = sums.first_damaged(&file)?
            {
                return Err(invalid(format!("the block {block} of {path} is damaged")));
            }
            return Ok((file, sums));
        }
        let sums = self.compare(&mut file.try_clone()?, path, sha256)?;
        // The reader begins at the start.
        (&file).rewind()?;
        Ok((file, sums))
    }

    /// The sums of the blocks of a file of that length, where they are known.
    pub(super) fn known_sums(&self, path: &str, bytes: u64) -> Option<Arc<BlockSums>> {
        self.known.get(path).filter(|sums| sums.bytes() == bytes)
    }

    /// Reads a whole file, compares its digest, and keeps the sums of its blocks.
    pub(super) fn compare(
        &self,
        from: &mut dyn Read,
        path: &str,
        sha256: &str,
    ) -> io::Result<Arc<BlockSums>> {
        let (found, sums) = digest(from)?;
        if found != sha256 {
            return Err(invalid(format!("{path} has the sha256 {found} instead of {sha256}")));
        }
        let sums = Arc::new(sums);
        self.known.keep(path, &sums);
        Ok(sums)
    }
}

/// The SHA-256 of what is left of a file, and the sums of its blocks.
fn digest(from: &mut dyn Read) -> io::Result<(String, BlockSums)> {
    let (mut digest, mut sums, mut block) = (Sha256::new(), BlockSummer::default(), vec![0; BLOCK_BYTES]);
    loop {
        let read = match from.read(&mut block) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            read => read?,
        };
        if read == 0 {
            return Ok((hex::encode(&digest.finalize()), sums.finish()));
        }
        digest.update(&block[..read]);
        sums.update(&block[..read]);
    }
}

impl StoredResult {
    /// The result in a file.
    pub(super) fn of(file: CheckedFile) -> io::Result<Self> {
        let layout = Layout::read(&mut BufReader::with_capacity(BLOCK_BYTES, file.reader()))?;
        if layout.file_length() != file.length() {
            return Err(invalid("the file holds other columns than it says".into()));
        }
        let file = file.with_readers(layout.columns.len());
        Ok(Self { layout, file })
    }

    /// Makes sure that the file ends with the sum of its bytes: it is the one that its program has written.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where it does not.
    pub(super) fn check_sum(&self) -> io::Result<()> {
        stored::verify(&mut self.file.reader())
    }

    /// All but the grains.
    pub(crate) fn head(&self) -> &Head {
        &self.layout.head
    }

    /// Length in bytes of each format, by name.
    pub(crate) fn count_lengths(&self) -> io::Result<BTreeMap<String, u64>> {
        write::count_lengths(self.head(), self, &Unattended)
    }
}

impl GrainSource for StoredResult {
    fn len(&self) -> usize {
        self.layout.rows as usize
    }

    fn columns(&self) -> &'static [Column] {
        self.layout.columns
    }

    fn templates(&self) -> &[Polyhedron] {
        &self.layout.templates
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        let mut offset = self.layout.offset(column, start as u64)?;
        let mut bytes = [0; COLUMN_BLOCK_BYTES];
        for part in block.chunks_mut(COLUMN_BLOCK_BYTES / 8) {
            let bytes = &mut bytes[..8 * part.len()];
            self.file.read_exact_at(bytes, offset)?;
            for (value, eight) in part.iter_mut().zip(bytes.chunks_exact(8)) {
                let mut le = [0; 8];
                le.copy_from_slice(eight);
                *value = f64::from_le_bytes(le);
            }
            offset += bytes.len() as u64;
        }
        Ok(())
    }
}

/// Makes sure that a file is as long as it was stored.
pub(super) fn check_length(path: &str, found: u64, bytes: u64) -> io::Result<()> {
    if found != bytes {
        return Err(invalid(format!("{path} has {found} bytes instead of {bytes}")));
    }
    Ok(())
}

fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}
