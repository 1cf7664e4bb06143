//! Zip archives whose files are deflated in pieces on several threads.
//!
//! Each piece is a deflate stream of its own that ends at a whole byte without being the last, so that all of a file
//! one behind the other are one stream: the bytes depend on the content and its pieces, never on the threads.

use std::io::{self, Write};
use std::num::NonZeroUsize;

use crc32fast::Hasher;
use flate2::{Compress, Compression, FlushCompress};
use rawzip::time::UtcDateTime;
use rawzip::{CompressionMethod, DataDescriptorOutput, ErrorKind, ZipArchiveWriter};

use super::ExportError;
use super::pieces::{SLOTS_PER_THREAD, in_order};
use crate::memory::{OutOfMemory, make_room, probe, reserved};

/// Fast: what is written here compresses little better whatever is spent on it.
const LEVEL: u32 = 1;
/// What the pieces of a file should have at most, where its parts are not larger.
pub(super) const PIECE_BYTES: usize = 1 << 20;
/// A last block of deflate that holds nothing.
const END: [u8; 2] = [3, 0];
/// What the state of deflate takes, rounded up.
const DEFLATE_BYTES: usize = 1 << 19;

/// Content of a file under way, in pieces.
pub(super) struct Content<W, T> {
    /// Number of pieces.
    pub(super) pieces: usize,
    /// Most bytes of each.
    pub(super) most_bytes: usize,
    /// Appends a piece, by its number.
    pub(super) write: W,
    /// Told of every piece that is in the archive.
    pub(super) taken: T,
}

/// An archive under way.
pub(super) struct Archive<'a> {
    zip: ZipArchiveWriter<&'a mut dyn Write>,
    slots: Vec<Piece>,
}

impl<'a> Archive<'a> {
    /// An archive that is written on so many threads, each of which takes about 3 MB.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn new(out: &'a mut dyn Write, threads: NonZeroUsize) -> Result<Self, OutOfMemory> {
        let slots = SLOTS_PER_THREAD * threads.get();
        let mut archive = Self { zip: ZipArchiveWriter::new(out), slots: reserved(slots)? };
        archive.slots.resize_with(slots, Piece::default);
        Ok(archive)
    }

    /// Adds a file.
    ///
    /// # Errors
    /// [`ExportError::Write`], [`ExportError::OutOfMemory`], and those of the content.
    pub(super) fn add<W, T>(&mut self, name: &str, content: Content<W, T>) -> Result<(), ExportError>
    where
        W: Fn(usize, &mut Vec<u8>) -> Result<(), ExportError> + Sync,
        T: FnMut(usize),
    {
        let Content { pieces, most_bytes, write, mut taken } = content;
        let (mut entry, _) = self
            .zip
            .new_file(name)
            .compression_method(CompressionMethod::DEFLATE)
            .last_modified(UtcDateTime::from_unix(EPOCH_OF_ZIP_S))
            .unix_permissions(0o644)
            .start()
            .map_err(failed)?;
        let (mut sum, mut length) = (Hasher::new(), 0);
        in_order(
            &mut self.slots,
            pieces,
            |piece, slot| slot.make(most_bytes, |text| write(piece, text)),
            |piece, slot| {
                entry.write_all(&slot.deflated)?;
                sum.combine(&slot.sum);
                length += slot.content.len() as u64;
                taken(piece);
                Ok(())
            },
        )?;
        entry.write_all(&END)?;
        entry.finish(DataDescriptorOutput::new(sum.finalize(), length)).map_err(failed)?;
        Ok(())
    }

    /// Adds a file that is written from its beginning to its end, and deflated on the thread that writes it.
    ///
    /// # Errors
    /// [`ExportError::Write`], and those of `write`.
    pub(super) fn stream<T>(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> Result<T, ExportError>,
    ) -> Result<T, ExportError> {
        let (mut entry, _) = self
            .zip
            .new_file(name)
            .compression_method(CompressionMethod::DEFLATE)
            .last_modified(UtcDateTime::from_unix(EPOCH_OF_ZIP_S))
            .unix_permissions(0o644)
            .start()
            .map_err(failed)?;
        let mut file = Streamed { out: &mut entry, piece: Piece::default(), sum: Hasher::new(), length: 0 };
        let written = write(&mut file)?;
        file.end_piece()?;
        let (sum, length) = (file.sum, file.length);
        entry.write_all(&END)?;
        entry.finish(DataDescriptorOutput::new(sum.finalize(), length)).map_err(failed)?;
        Ok(written)
    }

    /// Writes the directory of the archive.
    ///
    /// # Errors
    /// [`ExportError::Write`].
    pub(super) fn finish(self) -> Result<(), ExportError> {
        self.zip.finish().map_err(failed)?;
        Ok(())
    }
}

/// A file that is deflated piece by piece while it is written.
struct Streamed<'a, W> {
    out: &'a mut W,
    piece: Piece,
    sum: Hasher,
    length: u64,
}

impl<W: Write> Streamed<'_, W> {
    fn end_piece(&mut self) -> io::Result<()> {
        self.piece.deflate().map_err(|error| match error {
            ExportError::Write(error) => error,
            ExportError::OutOfMemory { .. } => io::ErrorKind::OutOfMemory.into(),
            other => io::Error::other(other.to_string()),
        })?;
        self.out.write_all(&self.piece.deflated)?;
        self.sum.update(&self.piece.content);
        self.length += self.piece.content.len() as u64;
        self.piece.content.clear();
        Ok(())
    }
}

impl<W: Write> Write for Streamed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(PIECE_BYTES - self.piece.content.len());
        self.piece.content.extend_from_slice(&bytes[..taken]);
        if self.piece.content.len() == PIECE_BYTES {
            self.end_piece()?;
        }
        Ok(taken)
    }

    /// Nothing: pieces end where they are full.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// 1980-01-01 00:00, the first time that a zip can name: the same content is the same bytes whenever it is written.
const EPOCH_OF_ZIP_S: i64 = 315_532_800;

/// A piece under way. Its memory serves many pieces.
#[derive(Default)]
struct Piece {
    content: Vec<u8>,
    deflated: Vec<u8>,
    sum: Hasher,
    deflate: Option<Compress>,
}

impl Piece {
    fn make(
        &mut self,
        most_bytes: usize,
        write: impl FnOnce(&mut Vec<u8>) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        self.content.clear();
        make_room(&mut self.content, most_bytes)?;
        write(&mut self.content)?;
        self.sum.reset();
        self.sum.update(&self.content);
        self.deflate()
    }

    fn deflate(&mut self) -> Result<(), ExportError> {
        if self.deflate.is_none() {
            // It panics where it is refused memory.
            probe(DEFLATE_BYTES)?;
        }
        let deflate = self.deflate.get_or_insert_with(|| Compress::new(Compression::new(LEVEL), false));
        // Worst by far is nine bits for eight. The bytes of a stream that meets a full buffer depend on where it did:
        // such a stream is made again.
        let mut room = self.content.len() / 8 * 9 + 1024;
        loop {
            deflate.reset();
            self.deflated.clear();
            make_room(&mut self.deflated, room)?;
            deflate
                .compress_vec(&self.content, &mut self.deflated, FlushCompress::Sync)
                .map_err(io::Error::from)?;
            if self.deflated.len() < self.deflated.capacity() {
                return Ok(());
            }
            room *= 2;
        }
    }
}

fn failed(error: rawzip::Error) -> ExportError {
    ExportError::Write(match error.into_kind() {
        ErrorKind::IO(error) => error,
        other => io::Error::other(other.to_string()),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::{Cursor, Read};
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// Bytes that deflate shortens little, a great deal, and not at all; and none.
    fn piece(file: usize, piece: usize) -> Vec<u8> {
        let mut state = (file * 1000 + piece) as u64 + 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state
        };
        let length = [50_000, 1, 0, 7_777][piece % 4];
        match file {
            0 => (0..length).map(|_| b'0' + (next() % 10) as u8).collect(),
            1 => vec![b'7'; length],
            _ => (0..length).map(|_| next() as u8).collect(),
        }
    }

    const FILES: [(&str, usize); 5] =
        [("digits", 40), ("equal", 9), ("noise", 13), ("nothing", 3), ("no pieces", 0)];

    /// Parts of more than a piece of a file that is written from its beginning to its end.
    const STREAMED: [usize; 24] = [0; 24];

    fn written(threads: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut archive = Archive::new(&mut bytes, NonZeroUsize::new(threads).unwrap()).unwrap();
        for (file, (name, pieces)) in FILES.into_iter().enumerate() {
            let mut taken = Vec::new();
            let content = Content {
                pieces,
                most_bytes: 50_000,
                write: |i, content: &mut Vec<u8>| {
                    content.extend(if name == "nothing" { Vec::new() } else { piece(file, i) });
                    Ok(())
                },
                taken: |i| taken.push(i),
            };
            archive.add(name, content).unwrap();
            assert_eq!(taken, (0..pieces).collect::<Vec<_>>());
        }
        let stream = |out: &mut dyn Write| {
            STREAMED.iter().try_for_each(|part| out.write_all(&piece(2, *part)))?;
            Ok(STREAMED.len())
        };
        assert_eq!(archive.stream("streamed", stream).unwrap(), STREAMED.len());
        archive.finish().unwrap();
        bytes
    }

    #[test]
    fn archives_read_back_and_do_not_depend_on_the_threads() {
        let bytes = written(1);
        for threads in [2, 3, 8] {
            assert!(written(threads) == bytes, "{threads} threads");
        }
        let mut archive = zip::ZipArchive::new(Cursor::new(&bytes)).unwrap();
        for (file, (name, pieces)) in FILES.into_iter().enumerate() {
            let expected: Vec<u8> =
                (0..if name == "nothing" { 0 } else { pieces }).flat_map(|i| piece(file, i)).collect();
            let mut read = Vec::new();
            archive.by_name(name).unwrap().read_to_end(&mut read).unwrap();
            assert!(read == expected, "{name}");
            if name == "equal" {
                assert!(archive.by_name(name).unwrap().compressed_size() < expected.len() as u64 / 50);
            }
        }
        let expected: Vec<u8> = STREAMED.iter().flat_map(|part| piece(2, *part)).collect();
        let mut read = Vec::new();
        archive.by_name("streamed").unwrap().read_to_end(&mut read).unwrap();
        assert!(read == expected && read.len() > PIECE_BYTES);
        assert_eq!(archive.len(), FILES.len() + 1);
    }

    #[test]
    fn a_stop_ends_the_writing_of_a_file() {
        for threads in [1, 2, 8] {
            let (mut bytes, made) = (Vec::new(), AtomicUsize::new(0));
            let mut archive = Archive::new(&mut bytes, NonZeroUsize::new(threads).unwrap()).unwrap();
            let content = Content {
                pieces: 1_000_000,
                most_bytes: 10,
                write: |i, content: &mut Vec<u8>| {
                    made.fetch_add(1, Ordering::Relaxed);
                    content.extend(b"0123456789");
                    if i < 100 { Ok(()) } else { Err(ExportError::Stopped) }
                },
                taken: |_| {},
            };
            assert!(matches!(archive.add("file", content), Err(ExportError::Stopped)));
            let most = 101 + SLOTS_PER_THREAD * threads;
            assert!(made.load(Ordering::Relaxed) <= most);
        }
    }

    #[test]
    fn memory_that_is_refused_ends_the_writing() {
        let mut bytes = Vec::new();
        let mut archive = Archive::new(&mut bytes, NonZeroUsize::new(2).unwrap()).unwrap();
        let most_bytes = isize::MAX as usize / 2;
        let content = Content { pieces: 3, most_bytes, write: |_, _: &mut Vec<u8>| Ok(()), taken: |_| {} };
        let refused = archive.add("file", content).unwrap_err();
        assert!(matches!(refused, ExportError::OutOfMemory { bytes } if bytes == most_bytes as u64));
    }
}
