//! Converting a stored result into a format while it is sent, and sending files as they lie.
//!
//! A blocking thread writes the format into a window (the byte range asked for), and the window
//! hands blocks to the response through a short channel. A reader that is slow makes the thread
//! wait; one that is gone, or that takes nothing for a minute, ends it. So a result of any length
//! costs a few blocks of memory. As many threads convert at once as there are cores: those whose readers are slow do
//! not count.

use std::io::{self, Read, Write};
use std::ops::Range;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use flate2::Compression;
use flate2::write::GzEncoder;
use packstone_engine::export::tables::{self, Format};
use tokio::sync::mpsc;

use super::conversions;
use super::read::StoredResult;
use crate::fair_places::Place;
use crate::tasks;

const BLOCK_BYTES: usize = 1 << 17;
const BLOCKS_WAITING: usize = 2;
/// A reader that takes no block for so long is gone.
const STALLED: Duration = Duration::from_mins(1);

/// Starts to convert; the receiver yields the bytes of `range`, compressed where `gzip` says so. `permit` is held until
/// the end.
pub(crate) fn start(
    result: StoredResult,
    format: Format,
    range: Range<u64>,
    gzip: bool,
    permit: Place,
) -> mpsc::Receiver<io::Result<Bytes>> {
    let write = move |out: &mut dyn Write| tables::write(format, result.head(), &result, out);
    start_writing(Box::new(write), format.name(), range, gzip, permit)
}

/// Writes a file from its beginning; the same bytes each time.
pub(crate) type WriteFile = Box<dyn FnOnce(&mut dyn Write) -> io::Result<()> + Send>;

/// The same of what a function writes.
pub(crate) fn start_writing(
    write: WriteFile,
    format: &'static str,
    range: Range<u64>,
    gzip: bool,
    permit: Place,
) -> mpsc::Receiver<io::Result<Bytes>> {
    let (sender, receiver) = mpsc::channel(BLOCKS_WAITING);
    tasks::blocking(move || {
        let blocks = Blocks { sender: sender.clone(), converting: Some(conversions::begin()) };
        let sink: Box<dyn Sink> = if gzip { Box::new(Gzipped::new(blocks)) } else { Box::new(blocks) };
        let mut window = Window::new(range, sink);
        let written = write(&mut window);
        if let Err(error) = window.finish(written) {
            tracing::warn!(%error, format, "a result was not sent to its end");
            break_off(&sender, error);
        }
        drop(permit);
    });
    receiver
}

/// Starts to send so many bytes as they lie.
pub(crate) fn start_file(
    mut bytes: Box<dyn Read + Send>,
    length: u64,
    permit: Place,
) -> mpsc::Receiver<io::Result<Bytes>> {
    let (sender, receiver) = mpsc::channel(BLOCKS_WAITING);
    tasks::blocking(move || {
        let mut blocks = Blocks { sender: sender.clone(), converting: None };
        let sent = send_bytes(&mut *bytes, length, &mut blocks).or_else(reader_left);
        if let Err(error) = sent {
            tracing::warn!(%error, "a file was not sent to its end");
            break_off(&sender, error);
        }
        drop(permit);
    });
    receiver
}

/// Ends an answer so that its reader notices: one of no stated length would else seem to be whole.
fn break_off(sender: &mpsc::Sender<io::Result<Bytes>>, error: io::Error) {
    // A reader that takes nothing for so long is gone, and gets no end either.
    let _ = tasks::wait_for(sender.send(Err(error)), STALLED);
}

fn send_bytes(bytes: &mut dyn Read, length: u64, blocks: &mut impl Sink) -> io::Result<()> {
    let mut left = length;
    while left > 0 {
        let mut block = BytesMut::zeroed(left.min(BLOCK_BYTES as u64) as usize);
        bytes.read_exact(&mut block)?;
        left -= block.len() as u64;
        blocks.send(block.freeze())?;
    }
    Ok(())
}

/// Where blocks go.
trait Sink {
    fn send(&mut self, block: Bytes) -> io::Result<()>;

    /// Sends what is left of them, after the last.
    fn end(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for Box<dyn Sink> {
    fn send(&mut self, block: Bytes) -> io::Result<()> {
        (**self).send(block)
    }

    fn end(&mut self) -> io::Result<()> {
        (**self).end()
    }
}

struct Blocks {
    sender: mpsc::Sender<io::Result<Bytes>>,
    /// The place of a conversion, which a file that is sent as it lies does not need.
    converting: Option<conversions::Place>,
}

impl Sink for Blocks {
    fn send(&mut self, block: Bytes) -> io::Result<()> {
        // Others convert while this reader takes its time.
        let converts = self.converting.take().is_some();
        let sent = tasks::wait_for(self.sender.send(Ok(block)), STALLED);
        self.converting = converts.then(conversions::begin);
        match sent {
            Some(Ok(())) => Ok(()),
            Some(Err(_)) => Err(io::ErrorKind::BrokenPipe.into()),
            None => Err(io::ErrorKind::TimedOut.into()),
        }
    }
}

/// Compresses blocks on their way.
struct Gzipped<S> {
    encoder: GzEncoder<Vec<u8>>,
    sink: S,
}

impl<S: Sink> Gzipped<S> {
    fn new(sink: S) -> Self {
        Self { encoder: GzEncoder::new(Vec::new(), Compression::fast()), sink }
    }

    fn pass_on(&mut self) -> io::Result<()> {
        let compressed = std::mem::take(self.encoder.get_mut());
        if compressed.is_empty() { Ok(()) } else { self.sink.send(compressed.into()) }
    }
}

impl<S: Sink> Sink for Gzipped<S> {
    fn send(&mut self, block: Bytes) -> io::Result<()> {
        self.encoder.write_all(&block)?;
        self.pass_on()
    }

    fn end(&mut self) -> io::Result<()> {
        self.encoder.try_finish()?;
        self.pass_on()?;
        self.sink.end()
    }
}

/// A writer that passes on only the bytes of a range, in blocks.
struct Window<S> {
    skip: u64,
    left: u64,
    block: BytesMut,
    sink: S,
}

impl<S: Sink> Window<S> {
    fn new(range: Range<u64>, sink: S) -> Self {
        Self {
            skip: range.start,
            left: range.end - range.start,
            block: BytesMut::with_capacity(BLOCK_BYTES),
            sink,
        }
    }

    fn send_block(&mut self) -> io::Result<()> {
        let block = std::mem::replace(&mut self.block, BytesMut::with_capacity(BLOCK_BYTES));
        self.sink.send(block.freeze())
    }

    /// Sends what is left, and tells a writer that was stopped at the end of the range, or whose
    /// reader left, from one that failed.
    fn finish(mut self, written: io::Result<()>) -> io::Result<()> {
        match written {
            _ if self.left == 0 => self.send_block().and_then(|()| self.sink.end()).or_else(reader_left),
            Ok(()) => Err(io::Error::new(
                io::ErrorKind::UnexpectedEof,
                format!("the format ended {} bytes early", self.left),
            )),
            Err(error) => reader_left(error),
        }
    }
}

fn reader_left(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::BrokenPipe { Ok(()) } else { Err(error) }
}

impl<S: Sink> Write for Window<S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.skip > 0 {
            let skipped = self.skip.min(bytes.len() as u64);
            self.skip -= skipped;
            return Ok(skipped as usize);
        }
        if self.left == 0 {
            // The rest is not wanted: this ends the conversion.
            return if bytes.is_empty() { Ok(0) } else { Err(io::ErrorKind::WriteZero.into()) };
        }
        let room = (BLOCK_BYTES - self.block.len()) as u64;
        let taken = room.min(self.left).min(bytes.len() as u64);
        self.block.extend_from_slice(&bytes[..taken as usize]);
        self.left -= taken;
        if self.block.len() == BLOCK_BYTES {
            self.send_block()?;
        }
        Ok(taken as usize)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use flate2::read::GzDecoder;

    use super::*;
    use crate::fair_places::{Client, FairPlaces};

    impl Sink for &mut Vec<u8> {
        fn send(&mut self, block: Bytes) -> io::Result<()> {
            self.extend_from_slice(&block);
            Ok(())
        }
    }

    fn through(range: Range<u64>, piece: usize) -> io::Result<Vec<u8>> {
        let all: Vec<u8> = (0..3 * BLOCK_BYTES).map(|i| (i % 251) as u8).collect();
        let mut out = Vec::new();
        let mut window = Window::new(range, &mut out);
        let written = all.chunks(piece).try_for_each(|part| window.write_all(part));
        window.finish(written)?;
        Ok(out)
    }

    #[test]
    fn a_window_passes_exactly_its_range() {
        let end = 3 * BLOCK_BYTES as u64;
        for range in [0..end, 0..1, 0..0, 5..9, end - 1..end, 1..BLOCK_BYTES as u64 + 2] {
            for piece in [7, BLOCK_BYTES + 3] {
                let expected: Vec<u8> = range.clone().map(|i| (i % 251) as u8).collect();
                assert!(through(range.clone(), piece).unwrap() == expected, "{range:?} by {piece}");
            }
        }
    }

    #[test]
    fn what_is_compressed_reads_back() {
        let all: Vec<u8> = (0..5 * BLOCK_BYTES + 17).map(|i| (i % 251) as u8).collect();
        for length in [0, 1, all.len()] {
            let mut out = Vec::new();
            let mut window = Window::new(0..length as u64, Gzipped::new(&mut out));
            let written = window.write_all(&all[..length]);
            window.finish(written).unwrap();
            let mut read = Vec::new();
            GzDecoder::new(&out[..]).read_to_end(&mut read).unwrap();
            assert!(read == all[..length] && out.len() < length / 10 + 100, "{length}");
        }
    }

    #[tokio::test]
    async fn a_reader_that_is_slow_is_told_of_a_file_that_cannot_be_read_to_its_end() {
        struct Short(usize);
        impl Read for Short {
            fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
                if self.0 == 0 {
                    return Err(io::ErrorKind::InvalidData.into());
                }
                let taken = self.0.min(into.len());
                self.0 -= taken;
                Ok(taken)
            }
        }
        let permit = FairPlaces::new(1, 1).wait(&Client::default()).await;
        let length = BLOCKS_WAITING * BLOCK_BYTES;
        let mut blocks = start_file(Box::new(Short(length)), 2 * length as u64, permit);
        // Until all blocks that there is room for wait.
        while blocks.len() < BLOCKS_WAITING {
            tokio::task::yield_now().await;
        }
        for _ in 0..BLOCKS_WAITING {
            assert_eq!(blocks.recv().await.unwrap().unwrap().len(), BLOCK_BYTES);
        }
        assert_eq!(blocks.recv().await.unwrap().unwrap_err().kind(), io::ErrorKind::InvalidData);
    }

    #[test]
    fn a_format_that_ends_early_is_an_error() {
        let error = through(0..3 * BLOCK_BYTES as u64 + 1, 100).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }
}
