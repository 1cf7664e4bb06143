//! A CRC-32 of each block of a file, by which every read of the file is verified.
//!
//! The sums are made of bytes that are known to be right: of those that this process wrote, or of a file whose SHA-256
//! was compared with that of the database in the same pass. They are kept in memory. A reader gets only bytes of blocks
//! that agree with their sums at that moment, so that a file that changes after its SHA-256 was compared is found at
//! its next read.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;
use std::os::unix::fs::FileExt as _;
use std::sync::{Arc, Mutex, PoisonError};

use super::Blob;

/// Length of a block in bytes. The last one of a file may be shorter.
const BLOCK_BYTES: usize = 1 << 15;
/// Bytes of a file that are read and verified before the first of them is sent.
const AHEAD_BYTES: usize = 1 << 18;

/// The sums of the blocks of a file.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct BlockSums {
    bytes: u64,
    sums: Vec<u32>,
}

impl BlockSums {
    /// Length of the file in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Number of blocks.
    pub(crate) fn len(&self) -> usize {
        self.sums.len()
    }

    /// The bytes of a block, as a range of the file.
    fn range(&self, block: usize) -> Range<u64> {
        let start = (block * BLOCK_BYTES) as u64;
        start..self.bytes.min(start + BLOCK_BYTES as u64)
    }

    fn is_right(&self, block: usize, bytes: &[u8]) -> bool {
        self.sums.get(block) == Some(&crc32fast::hash(bytes))
    }

    /// The first block of a file that does not agree with its sum; `None` where all do.
    ///
    /// # Errors
    /// Those of the file.
    pub(crate) fn first_damaged(&self, file: &File) -> io::Result<Option<usize>> {
        let mut bytes = vec![0; BLOCK_BYTES];
        for block in 0..self.len() {
            let range = self.range(block);
            let bytes = &mut bytes[..(range.end - range.start) as usize];
            file.read_exact_at(bytes, range.start)?;
            if !self.is_right(block, bytes) {
                return Ok(Some(block));
            }
        }
        Ok(None)
    }
}

/// Sums the blocks of what passes.
#[derive(Debug, Default)]
pub(crate) struct BlockSummer {
    sums: Vec<u32>,
    block: crc32fast::Hasher,
    in_block: usize,
    bytes: u64,
}

impl BlockSummer {
    /// Adds the next bytes.
    pub(crate) fn update(&mut self, mut bytes: &[u8]) {
        self.bytes += bytes.len() as u64;
        while !bytes.is_empty() {
            let (now, later) = bytes.split_at(bytes.len().min(BLOCK_BYTES - self.in_block));
            self.block.update(now);
            self.in_block += now.len();
            if self.in_block == BLOCK_BYTES {
                self.end_block();
            }
            bytes = later;
        }
    }

    /// The sums of all that passed.
    pub(crate) fn finish(mut self) -> BlockSums {
        if self.in_block > 0 {
            self.end_block();
        }
        BlockSums { bytes: self.bytes, sums: self.sums }
    }

    fn end_block(&mut self) {
        self.sums.push(std::mem::take(&mut self.block).finalize());
        self.in_block = 0;
    }
}

/// What is called once a block is damaged: so that the next reader does not believe what was known of the file.
pub(crate) type OnDamage = Arc<dyn Fn() + Send + Sync>;

/// What is known of a file that is read.
#[derive(Clone)]
struct Expected {
    name: String,
    sums: Arc<BlockSums>,
    on_damage: OnDamage,
}

impl Expected {
    /// Makes sure that a block is what it was.
    fn check(&self, block: usize, bytes: &[u8]) -> io::Result<()> {
        if self.sums.is_right(block, bytes) {
            return Ok(());
        }
        (self.on_damage)();
        let Range { start, end } = self.sums.range(block);
        let name = &self.name;
        tracing::error!(name, start, end, "a stored file is damaged: a block is not what was stored");
        Err(io::Error::new(
            io::ErrorKind::InvalidData,
            format!("{name} is damaged: its bytes {start} to {end} are not what was stored"),
        ))
    }
}

/// A file that is read at any place.
pub(crate) struct CheckedFile {
    file: File,
    expected: Expected,
    /// Blocks that agreed with their sums, the one used last first.
    kept: Mutex<VecDeque<Block>>,
    /// Blocks that are kept.
    most_kept: usize,
}

impl fmt::Debug for CheckedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CheckedFile").field("name", &self.expected.name).finish_non_exhaustive()
    }
}

impl CheckedFile {
    /// A file with these sums, whose name is for the log.
    pub(crate) fn new(file: File, name: String, sums: Arc<BlockSums>, on_damage: OnDamage) -> Self {
        let expected = Expected { name, sums, on_damage };
        Self { file, expected, kept: Mutex::default(), most_kept: 2 }
    }

    /// The same file, which so many readers read in turn, each from its first byte to its last.
    pub(crate) fn with_readers(self, readers: usize) -> Self {
        Self { most_kept: readers + 1, ..self }
    }

    /// Its length in bytes.
    pub(crate) fn length(&self) -> u64 {
        self.expected.sums.bytes
    }

    /// Reads bytes from `offset` on.
    ///
    /// # Errors
    /// Those of the file; [`io::ErrorKind::InvalidData`] where a block is damaged, and
    /// [`io::ErrorKind::UnexpectedEof`] beyond the end.
    pub(crate) fn read_exact_at(&self, mut into: &mut [u8], mut offset: u64) -> io::Result<()> {
        if self.length().checked_sub(offset).is_none_or(|left| left < into.len() as u64) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        while !into.is_empty() {
            let block = (offset / BLOCK_BYTES as u64) as usize;
            let bytes = self.block(&mut kept, block)?;
            let from = (offset - self.expected.sums.range(block).start) as usize;
            let taken = into.len().min(bytes.len() - from);
            let (now, later) = std::mem::take(&mut into).split_at_mut(taken);
            now.copy_from_slice(&bytes[from..from + taken]);
            into = later;
            offset += taken as u64;
        }
        Ok(())
    }

    /// Reads from the start.
    pub(crate) fn reader(&self) -> impl Read + '_ {
        FromStart { file: self, offset: 0 }
    }

    fn block<'a>(&self, kept: &'a mut VecDeque<Block>, number: usize) -> io::Result<&'a [u8]> {
        let found = kept.iter().position(|block| block.number == number);
        if let Some(found) = found.and_then(|found| kept.remove(found)) {
            kept.push_front(found);
        } else {
            let reused = if kept.len() >= self.most_kept { kept.pop_back() } else { None };
            let mut block = reused.unwrap_or_else(Block::empty);
            let Range { start, end } = self.expected.sums.range(number);
            (block.number, block.length) = (number, (end - start) as usize);
            self.file.read_exact_at(&mut block.bytes[..block.length], start)?;
            self.expected.check(number, block.content())?;
            kept.push_front(block);
        }
        Ok(kept.front().map_or(&[], Block::content))
    }
}

/// The bytes of a block.
struct Block {
    number: usize,
    length: usize,
    bytes: Vec<u8>,
}

impl Block {
    fn empty() -> Self {
        Self { number: 0, length: 0, bytes: vec![0; BLOCK_BYTES] }
    }

    fn content(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

struct FromStart<'a> {
    file: &'a CheckedFile,
    offset: u64,
}

impl Read for FromStart<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.file.length() - self.offset;
        let taken = left.min(into.len() as u64) as usize;
        self.file.read_exact_at(&mut into[..taken], self.offset)?;
        self.offset += taken as u64;
        Ok(taken)
    }
}

/// A blob that is sent as it lies, wherever it lies.
pub(crate) struct CheckedBlob {
    inner: Box<dyn Blob>,
    expected: Expected,
}

impl fmt::Debug for CheckedBlob {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CheckedBlob").field("inner", &self.inner).finish_non_exhaustive()
    }
}

impl CheckedBlob {
    /// A blob with these sums, whose name is for the log.
    pub(crate) fn new(inner: Box<dyn Blob>, name: String, sums: Arc<BlockSums>, on_damage: OnDamage) -> Self {
        Self { inner, expected: Expected { name, sums, on_damage } }
    }
}

impl Blob for CheckedBlob {
    fn length(&self) -> io::Result<u64> {
        Ok(self.expected.sums.bytes)
    }

    /// The first blocks are verified before this returns.
    fn read(self: Box<Self>, range: Range<u64>) -> io::Result<Box<dyn Read + Send>> {
        if range.is_empty() {
            return Ok(Box::new(io::empty()));
        }
        let Self { inner, expected } = *self;
        let block = (range.start / BLOCK_BYTES as u64) as usize;
        let start = expected.sums.range(block).start;
        let last = ((range.end - 1) / BLOCK_BYTES as u64) as usize;
        let end = expected.sums.range(last).end;
        let wanted = (end - start).min(AHEAD_BYTES as u64) as usize;
        let mut reading = Reading {
            inner: inner.read(start..end)?,
            expected,
            block,
            bytes: vec![0; wanted.max(BLOCK_BYTES)],
            verified: 0,
            at: 0,
            left: range.end - range.start,
        };
        while reading.verified < wanted {
            reading.verify_next()?;
        }
        reading.at = (range.start - start) as usize;
        Ok(Box::new(reading))
    }
}

/// Reads whole blocks, and hands on what is wanted of them.
struct Reading {
    inner: Box<dyn Read + Send>,
    expected: Expected,
    /// The next one to read.
    block: usize,
    bytes: Vec<u8>,
    /// Up to here the bytes were verified.
    verified: usize,
    /// Up to here they were handed on.
    at: usize,
    /// Bytes that are wanted yet.
    left: u64,
}

impl Reading {
    /// Adds the next block to those that were verified.
    fn verify_next(&mut self) -> io::Result<()> {
        let Range { start, end } = self.expected.sums.range(self.block);
        let bytes = &mut self.bytes[self.verified..self.verified + (end - start) as usize];
        self.inner.read_exact(bytes)?;
        self.expected.check(self.block, bytes)?;
        self.verified += bytes.len();
        self.block += 1;
        Ok(())
    }
}

impl Read for Reading {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if self.left == 0 {
            return Ok(0);
        }
        if self.at == self.verified {
            (self.at, self.verified) = (0, 0);
            // What was read ahead is not needed again.
            self.bytes.truncate(BLOCK_BYTES);
            self.bytes.shrink_to_fit();
            self.verify_next()?;
        }
        let rest = &self.bytes[self.at..self.verified];
        let taken = rest.len().min(into.len()).min(usize::try_from(self.left).unwrap_or(usize::MAX));
        into[..taken].copy_from_slice(&rest[..taken]);
        self.at += taken;
        self.left -= taken as u64;
        Ok(taken)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    const BYTES: usize = 20 * BLOCK_BYTES + 77;

    struct Stored {
        file: tempfile::NamedTempFile,
        bytes: Vec<u8>,
        sums: Arc<BlockSums>,
        damaged: Arc<AtomicUsize>,
    }

    impl Stored {
        fn new(length: usize) -> Self {
            let bytes: Vec<u8> = (0..length).map(|i| (i % 251) as u8).collect();
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), &bytes).unwrap();
            let mut summer = BlockSummer::default();
            // In pieces that no block is a multiple of.
            bytes.chunks(1000).for_each(|piece| summer.update(piece));
            Self { file, bytes, sums: Arc::new(summer.finish()), damaged: Arc::default() }
        }

        fn on_damage(&self) -> OnDamage {
            let damaged = Arc::clone(&self.damaged);
            Arc::new(move || {
                damaged.fetch_add(1, Ordering::Relaxed);
            })
        }

        fn file(&self) -> CheckedFile {
            let file = File::open(self.file.path()).unwrap();
            CheckedFile::new(file, "x".into(), Arc::clone(&self.sums), self.on_damage())
        }

        fn blob(&self) -> CheckedBlob {
            let file = Box::new(File::open(self.file.path()).unwrap());
            CheckedBlob::new(file, "x".into(), Arc::clone(&self.sums), self.on_damage())
        }

        fn flip(&self, at: usize) {
            let mut bytes = self.bytes.clone();
            bytes[at] ^= 1;
            std::fs::write(self.file.path(), bytes).unwrap();
        }
    }

    fn ranges() -> Vec<Range<usize>> {
        let block = BLOCK_BYTES;
        vec![0..BYTES, 0..1, block - 1..block + 1, block..2 * block, 5..BYTES - 5, BYTES - 1..BYTES, 9..9]
    }

    #[test]
    fn every_range_is_read_as_it_was_stored() {
        let stored = Stored::new(BYTES);
        for range in ranges() {
            let mut found = Vec::new();
            let part = range.start as u64..range.end as u64;
            Box::new(stored.blob()).read(part).unwrap().read_to_end(&mut found).unwrap();
            assert!(found == stored.bytes[range.clone()], "{range:?}");
            let mut found = vec![0; range.len()];
            stored.file().read_exact_at(&mut found, range.start as u64).unwrap();
            assert!(found == stored.bytes[range.clone()], "{range:?}");
        }
        let mut found = Vec::new();
        stored.file().reader().read_to_end(&mut found).unwrap();
        assert!(found == stored.bytes);
        let beyond = stored.file().read_exact_at(&mut [0; 2], BYTES as u64 - 1).unwrap_err();
        assert_eq!(beyond.kind(), io::ErrorKind::UnexpectedEof);
        let empty = Stored::new(0);
        assert_eq!((empty.sums.len(), empty.file().reader().read(&mut [0]).unwrap()), (0, 0));
    }

    #[test]
    fn a_flipped_bit_in_any_block_is_found_before_a_byte_of_the_block_is_read() {
        let stored = Stored::new(BYTES);
        for block in 0..stored.sums.len() {
            let range = stored.sums.range(block);
            stored.flip((range.start + (range.end - range.start) / 2) as usize);
            assert_eq!(stored.sums.first_damaged(stored.file.as_file()).unwrap(), Some(block));
            let before = stored.damaged.load(Ordering::Relaxed);
            let mut found = Vec::new();
            let error = match Box::new(stored.blob()).read(0..BYTES as u64) {
                // Found before the first byte.
                Err(error) => error,
                Ok(mut reading) => reading.read_to_end(&mut found).unwrap_err(),
            };
            assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{block}: {error}");
            assert!(
                error.to_string().contains(&format!("bytes {} to {}", range.start, range.end)),
                "{error}"
            );
            assert_eq!(found.len(), if block * BLOCK_BYTES < AHEAD_BYTES { 0 } else { block * BLOCK_BYTES });
            let error = stored.file().read_exact_at(&mut [0], range.end - 1).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::InvalidData, "{block}: {error}");
            assert_eq!(stored.damaged.load(Ordering::Relaxed), before + 2);
            // The other blocks are read.
            let other = (block + 1) % stored.sums.len();
            stored.file().read_exact_at(&mut [0], (other * BLOCK_BYTES) as u64).unwrap();
        }
    }

    #[test]
    fn readers_that_take_turns_read_each_block_once() {
        let stored = Stored::new(BYTES);
        let file = stored.file().with_readers(4);
        let column = BYTES / 4;
        for at in (0..column - 8).step_by(8) {
            for reader in 0..4 {
                let mut eight = [0; 8];
                file.read_exact_at(&mut eight, (reader * column + at) as u64).unwrap();
                assert!(eight == stored.bytes[reader * column + at..reader * column + at + 8]);
            }
            assert!(file.kept.lock().unwrap().len() <= 5);
        }
    }
}
