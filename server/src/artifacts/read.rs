//! Opening a stored result, and making sure that it is the one that was stored.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader};
use std::os::unix::fs::FileExt as _;
use std::sync::PoisonError;

use packstone_engine::Unattended;
use packstone_engine::export::tables::{Column, GrainSource, Head, stored::Layout};
use packstone_engine::shape::Polyhedron;
use sha2::{Digest, Sha256};

use super::{Artifacts, blob, write};
use crate::disk::is_passing;
use crate::hex;
use crate::jobs::ArtifactRecord;

/// Digests checked since the start that are remembered; beyond, they are checked again.
const VERIFIED_KEPT: usize = 100_000;
const BLOCK_BYTES: usize = 1 << 16;
/// On the stack of the thread that converts.
const COLUMN_BLOCK_BYTES: usize = 1 << 13;

/// An open result. It stays readable when the file is removed meanwhile.
#[derive(Debug)]
pub(crate) struct StoredResult {
    layout: Layout,
    file: File,
}

impl Artifacts {
    /// Opens a result. Its digest is checked the first time since the start of the server: disks
    /// and people do change files.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::InvalidData`] where the file is not what was stored.
    pub(crate) fn read(&self, record: &ArtifactRecord) -> io::Result<StoredResult> {
        let file = self.open_checked(&record.path, record.bytes, &record.sha256)?;
        StoredResult::of(file)
    }

    /// Whether a result is missing or not what was stored; its digest is checked in any case.
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
        let mut rest = opened.read(0..bytes)?;
        let (mut digest, mut block) = (Sha256::new(), vec![0; BLOCK_BYTES]);
        loop {
            let read = rest.read(&mut block)?;
            if read == 0 {
                return Ok((bytes, hex::encode(&digest.finalize())));
            }
            digest.update(&block[..read]);
        }
    }

    /// Opens a file that is as long as it was stored, and has the digest that it had.
    pub(super) fn open_checked(&self, path: &str, bytes: u64, sha256: &str) -> io::Result<File> {
        let file = self.blobs.fetch(&blob(path))?;
        check_length(path, file.metadata()?.len(), bytes)?;
        self.verify(&file, path, bytes, sha256)?;
        Ok(file)
    }

    fn verify(&self, file: &File, path: &str, bytes: u64, sha256: &str) -> io::Result<()> {
        let known = |set: &std::collections::HashSet<String>| set.contains(path);
        if known(&self.verified.lock().unwrap_or_else(PoisonError::into_inner)) {
            return Ok(());
        }
        let mut digest = Sha256::new();
        let mut block = vec![0; BLOCK_BYTES];
        let mut offset = 0;
        while offset < bytes {
            let read = file.read_at(&mut block, offset)?;
            if read == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            digest.update(&block[..read]);
            offset += read as u64;
        }
        let found = hex::encode(&digest.finalize());
        if found != sha256 {
            return Err(invalid(format!("{path} has the sha256 {found} instead of {sha256}")));
        }
        let mut verified = self.verified.lock().unwrap_or_else(PoisonError::into_inner);
        if verified.len() >= VERIFIED_KEPT {
            verified.clear();
        }
        verified.insert(path.to_owned());
        Ok(())
    }
}

impl StoredResult {
    /// The result in a file that is at its start.
    pub(super) fn of(file: File) -> io::Result<Self> {
        let layout = Layout::read(&mut BufReader::with_capacity(BLOCK_BYTES, &file))?;
        if layout.file_length() != file.metadata()?.len() {
            return Err(invalid("the file holds other columns than it says".into()));
        }
        Ok(Self { layout, file })
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
