//! Writing results and exports, with their digests; only then may the store refer to them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::sync::Arc;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use packstone_engine::Control;
use packstone_engine::export::tables::{self, Format, GrainSource, Head, stored};
use serde_json::Map;
use sha2::{Digest, Sha256};

use super::{Artifacts, InFlight, blob};
use crate::blobs::blocks::{BlockSummer, BlockSums};
use crate::hex;
use crate::jobs::ArtifactRecord;

const BUFFER_BYTES: usize = 1 << 18;

impl Artifacts {
    /// Writes a result and counts the length of each of its formats.
    ///
    /// # Errors
    /// Those of the disk; [`io::ErrorKind::Interrupted`] has no place here, so a stop by `control` is
    /// [`io::ErrorKind::ConnectionAborted`]. Nothing is left behind.
    pub(crate) fn write(
        &self,
        place: &InFlight,
        head: &Head,
        grains: &dyn GrainSource,
        control: &dyn Control,
    ) -> io::Result<ArtifactRecord> {
        let mut format_lengths = BTreeMap::new();
        let ((), bytes, sha256) = self.write_whole(
            place,
            u64::MAX,
            control,
            |out| stored::write(head, grains, out),
            |_, _, _| count_lengths(head, grains, control).map(|lengths| format_lengths = lengths),
        )?;
        let report = match serde_json::to_value(&head.report)? {
            serde_json::Value::Object(report) => report,
            _ => Map::new(),
        };
        Ok(ArtifactRecord {
            path: place.path.clone(),
            bytes,
            sha256,
            report,
            format_revision: tables::REVISION,
            format_lengths,
        })
    }

    /// Writes a file by `write`; `check`, which gets it with its SHA-256 and the sums of its blocks, is the last that
    /// can keep it from its name. Nothing is left behind where anything fails.
    ///
    /// Returns what `write` returned, the file's length and its SHA-256.
    pub(super) fn write_whole<T, E: From<io::Error>>(
        &self,
        place: &InFlight,
        most_bytes: u64,
        control: &dyn Control,
        write: impl FnOnce(&mut dyn Write) -> Result<T, E>,
        check: impl FnOnce(&File, &str, &Arc<BlockSums>) -> Result<(), E>,
    ) -> Result<(T, u64, String), E> {
        let name = blob(&place.path);
        let staged = self.blobs.stage(&name)?;
        let inner = staged.file();
        let (digest, blocks) = (Sha256::new(), BlockSummer::default());
        let mut digested = Digested { inner, digest, blocks, bytes: 0, most_bytes, control };
        let mut buffered = BufWriter::with_capacity(BUFFER_BYTES, &mut digested);
        let value = write(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        let (bytes, sha256) = (digested.bytes, hex::encode(&digested.digest.finalize()));
        let sums = Arc::new(digested.blocks.finish());
        check(inner, &sha256, &sums)?;
        match self.blobs.publish(staged, &name, &|| control.should_stop()) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                self.settle_twice_written(&place.path, bytes, &sha256)?;
            }
            published => published?,
        }
        // What was written is what its readers are to get.
        self.known.keep(&place.path, &sums);
        Ok((value, bytes, sha256))
    }
}

impl Artifacts {
    /// The same attempt has written before, and what followed was lost: the answer of a bucket, or the lease by a power
    /// cut of the machine of server and database, and the attempt was begun once more. The same bytes are what is
    /// wanted. Others, which differ in the times that they tell, are moved out of the way: no two runs that may record
    /// a result have the same attempt (see `Store::give_back`), so the database knows none of them.
    ///
    /// # Errors
    /// Those of the storage; a passing one where the file was moved, after which the same is written again.
    fn settle_twice_written(&self, path: &str, bytes: u64, sha256: &str) -> io::Result<()> {
        // What is known of this name is known of the other bytes.
        self.forget(path);
        match self.open_checked(path, bytes, sha256) {
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                let today = Timestamp::now().to_zoned(TimeZone::UTC).date();
                let to = self.quarantine(path, today)?;
                tracing::warn!(path, to, "moved a file of the same attempt that was never recorded");
                Err(io::Error::other("a file of the same attempt was in the way and has been moved"))
            }
            opened => opened.map(drop),
        }
    }
}

/// Length in bytes of each format, by name.
pub(super) fn count_lengths(
    head: &Head,
    grains: &dyn GrainSource,
    control: &dyn Control,
) -> io::Result<BTreeMap<String, u64>> {
    Format::ALL
        .into_iter()
        .map(|format| {
            check(control)?;
            Ok((format.name().to_owned(), tables::length(format, head, grains)?))
        })
        .collect()
}

fn check(control: &dyn Control) -> io::Result<()> {
    if control.should_stop() {
        return Err(io::Error::new(io::ErrorKind::ConnectionAborted, "the run was asked to stop"));
    }
    Ok(())
}

/// A file that digests what is written to it, and refuses once the run is to stop.
struct Digested<'a> {
    inner: &'a File,
    digest: Sha256,
    blocks: BlockSummer,
    bytes: u64,
    most_bytes: u64,
    control: &'a dyn Control,
}

impl Write for Digested<'_> {
    fn write(&mut self, block: &[u8]) -> io::Result<usize> {
        check(self.control)?;
        if self.bytes + block.len() as u64 > self.most_bytes {
            return Err(io::ErrorKind::QuotaExceeded.into());
        }
        let written = self.inner.write(block)?;
        self.digest.update(&block[..written]);
        self.blocks.update(&block[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
