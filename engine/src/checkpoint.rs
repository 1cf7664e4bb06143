//! Checkpoints: the state of a run between two compression cycles, written so that the run can go on from it after the
//! process was killed.
//!
//! This is the envelope; what is inside (the body) belongs to the method that runs. The envelope makes sure that a
//! state is only ever continued by the same engine on the same request, and that one cut off or damaged is refused.
//! Writers and readers are handed in: the caller decides when, where and under which name checkpoints are kept.
//!
//! Layout, all little-endian: magic `PACKSTCK`, `u32` revision of this layout, the engine's version and the request
//! (each as `u64` length and bytes, the request as its JSON without materials, or what an export is made of), the body
//! in frames of `u32` length and bytes, of which one of length 0 is the last, and the CRC-32 of all that came before.

use std::io::{self, Read, Write};

use crate::VERSION;
use crate::request::PackingRequest;
use crate::summed::{Summed, ends_with_sum};

/// First bytes of a checkpoint.
pub const MAGIC: [u8; 8] = *b"PACKSTCK";
/// Counts the changes of the layout.
pub const REVISION: u32 = 1;

/// Longest frame of the body.
const FRAME_BYTES: usize = 1 << 16;
/// Longest text that can be the version of an engine; a longer one is damage.
const MAX_VERSION_BYTES: u64 = 256;

/// State of a run between two compression cycles, lent to [`crate::Control::keep_checkpoint`].
pub struct Checkpoint<'a> {
    of: Of<'a>,
    write_body: &'a dyn Fn(&mut dyn Write) -> io::Result<()>,
}

/// What a checkpoint belongs to.
#[derive(Debug)]
enum Of<'a> {
    Packing(&'a PackingRequest),
    /// Options of an export and what it is made of.
    Export(&'a [u8]),
}

impl<'a> Checkpoint<'a> {
    /// A checkpoint of an export with this identity, whose state `write_body` writes.
    pub(crate) fn of_export(
        identity: &'a [u8],
        write_body: &'a dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) -> Self {
        Self { of: Of::Export(identity), write_body }
    }

    /// A checkpoint of a run for `request`, whose state `write_body` writes.
    pub fn new(
        request: &'a PackingRequest,
        write_body: &'a dyn Fn(&mut dyn Write) -> io::Result<()>,
    ) -> Self {
        Self { of: Of::Packing(request), write_body }
    }

    /// Writes the state alone.
    ///
    /// # Errors
    /// Those of the writer.
    pub(crate) fn write_body(&self, out: &mut dyn Write) -> io::Result<()> {
        (self.write_body)(out)
    }

    /// Writes the checkpoint, in blocks of a size that needs no further buffer.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_to(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut out = Summed::new(out);
        let mut head = Vec::from(MAGIC);
        head.extend(REVISION.to_le_bytes());
        let of = match self.of {
            Of::Packing(request) => serde_json::to_vec(&request.without_materials())?,
            Of::Export(identity) => identity.to_vec(),
        };
        for part in [VERSION.as_bytes(), &of] {
            head.extend((part.len() as u64).to_le_bytes());
            head.extend(part);
        }
        out.write_all(&head)?;
        let mut frames = Frames { out: &mut out, frame: Vec::with_capacity(FRAME_BYTES) };
        (self.write_body)(&mut frames)?;
        frames.write_frame()?;
        out.write_all(&0_u32.to_le_bytes())?;
        out.flush()?;
        out.finish()
    }
}

impl std::fmt::Debug for Checkpoint<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Checkpoint").field("of", &self.of).finish_non_exhaustive()
    }
}

/// Cuts the body into frames, for its length is not known before it is written.
struct Frames<'a, 'b> {
    out: &'a mut Summed<'b>,
    frame: Vec<u8>,
}

impl Frames<'_, '_> {
    fn write_frame(&mut self) -> io::Result<()> {
        if !self.frame.is_empty() {
            self.out.write_all(&(self.frame.len() as u32).to_le_bytes())?;
            self.out.write_all(&self.frame)?;
            self.frame.clear();
        }
        Ok(())
    }
}

impl Write for Frames<'_, '_> {
    fn write(&mut self, block: &[u8]) -> io::Result<usize> {
        let taken = block.len().min(FRAME_BYTES - self.frame.len());
        self.frame.extend_from_slice(&block[..taken]);
        if self.frame.len() == FRAME_BYTES {
            self.write_frame()?;
        }
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Why a checkpoint cannot be gone on from.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The reader failed.
    #[error("the checkpoint cannot be read: {0}")]
    Io(#[from] io::Error),
    /// It is something else.
    #[error("this is no checkpoint")]
    NotACheckpoint,
    /// Another version of the engine wrote it, and would have gone on differently.
    #[error("the checkpoint is of engine {found}, and this is {VERSION}")]
    OtherVersion {
        /// Version of the engine that wrote it, or of the layout.
        found: String,
    },
    /// It belongs to another request.
    #[error("the checkpoint belongs to another request")]
    OtherRequest,
    /// It was cut off or damaged.
    #[error("the checkpoint is damaged")]
    Corrupt,
}

/// A checkpoint read back, to go on from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Resume {
    pub(crate) body: Vec<u8>,
}

impl Resume {
    /// Reads a checkpoint of the export with this identity ([`crate::export::ExportRequest::checkpoint_identity`]).
    ///
    /// # Errors
    /// When it is not whole, or not this engine's of this export.
    pub fn of_export(input: &mut dyn Read, identity: &[u8]) -> Result<Self, CheckpointError> {
        let stored = Stored::read(input)?;
        if stored.request != identity {
            return Err(CheckpointError::OtherRequest);
        }
        Ok(Self { body: stored.body })
    }

    /// Reads a checkpoint of `request`, or of one with other materials.
    ///
    /// # Errors
    /// When it is not whole, or not this engine's on this request.
    pub fn read_from(input: &mut dyn Read, request: &PackingRequest) -> Result<Self, CheckpointError> {
        let stored = Stored::read(input)?;
        if stored.request != serde_json::to_vec(&request.without_materials()).map_err(io::Error::from)? {
            return Err(CheckpointError::OtherRequest);
        }
        Ok(Self { body: stored.body })
    }

    /// Reads a checkpoint of `request` or of one that has other limits: `method.stop`, `on_limit` and the
    /// materials may differ.
    ///
    /// # Errors
    /// As [`Self::read_from`].
    pub fn read_with_limits(input: &mut dyn Read, request: &PackingRequest) -> Result<Self, CheckpointError> {
        let stored = Stored::read(input)?;
        if stored.request()?.without_limits() != request.without_limits() {
            return Err(CheckpointError::OtherRequest);
        }
        Ok(Self { body: stored.body })
    }
}

/// Makes sure that a checkpoint is whole, of whatever engine and request, without keeping it in memory.
///
/// # Errors
/// When it is not.
pub fn verify(input: &mut dyn Read) -> Result<(), CheckpointError> {
    let mut magic = [0; MAGIC.len()];
    let read = input.take(magic.len() as u64).read(&mut magic)?;
    if read != magic.len() || magic != MAGIC {
        return Err(CheckpointError::NotACheckpoint);
    }
    if ends_with_sum(&mut magic.as_slice().chain(input))? { Ok(()) } else { Err(CheckpointError::Corrupt) }
}

/// The request that a checkpoint belongs to, with its seed.
///
/// # Errors
/// When the checkpoint is not whole, or not this engine's.
pub fn read_request(input: &mut dyn Read) -> Result<PackingRequest, CheckpointError> {
    Stored::read(input)?.request()
}

/// The parts of a whole checkpoint of this engine.
struct Stored {
    request: Vec<u8>,
    body: Vec<u8>,
}

impl Stored {
    fn request(&self) -> Result<PackingRequest, CheckpointError> {
        let value = serde_json::from_slice(&self.request).map_err(|_| CheckpointError::Corrupt)?;
        PackingRequest::from_json(&value, 0).map_err(|_| CheckpointError::Corrupt)
    }

    fn read(input: &mut dyn Read) -> Result<Self, CheckpointError> {
        let mut input = Source { input, sum: crc32fast::Hasher::new() };
        let magic: [u8; 8] = input.array().map_err(|error| match error {
            CheckpointError::Corrupt => CheckpointError::NotACheckpoint,
            other => other,
        })?;
        if magic != MAGIC {
            return Err(CheckpointError::NotACheckpoint);
        }
        // Whatever follows in a layout of another revision, its sum included, cannot be known.
        let revision = u32::from_le_bytes(input.array()?);
        if revision != REVISION {
            return Err(CheckpointError::OtherVersion { found: format!("layout {revision}") });
        }
        let version_length = u64::from_le_bytes(input.array()?);
        if version_length > MAX_VERSION_BYTES {
            return Err(CheckpointError::Corrupt);
        }
        let version = input.bytes(version_length)?;
        let request_length = u64::from_le_bytes(input.array()?);
        let request = input.bytes(request_length)?;
        let mut body = Vec::new();
        loop {
            match u32::from_le_bytes(input.array()?) {
                0 => break,
                length if length as usize > FRAME_BYTES => return Err(CheckpointError::Corrupt),
                length => body.append(&mut input.bytes(u64::from(length))?),
            }
        }
        // The sum is judged before the rest: damage must not pass for another version or request.
        let sum = input.sum.clone().finalize();
        if u32::from_le_bytes(input.array()?) != sum || input.input.read(&mut [0])? != 0 {
            return Err(CheckpointError::Corrupt);
        }
        if version != VERSION.as_bytes() {
            let found = String::from_utf8_lossy(&version).into_owned();
            return Err(CheckpointError::OtherVersion { found });
        }
        Ok(Self { request, body })
    }
}

/// Reads and sums; an early end is damage.
struct Source<'a> {
    input: &'a mut dyn Read,
    sum: crc32fast::Hasher,
}

impl Source<'_> {
    fn array<const N: usize>(&mut self) -> Result<[u8; N], CheckpointError> {
        let mut array = [0; N];
        self.input.read_exact(&mut array).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => CheckpointError::Corrupt,
            _ => CheckpointError::Io(error),
        })?;
        self.sum.update(&array);
        Ok(array)
    }

    /// As many bytes as there are said to be; memory grows with what is there, not with what is said.
    fn bytes(&mut self, length: u64) -> Result<Vec<u8>, CheckpointError> {
        let mut bytes = Vec::new();
        (&mut *self.input).take(length).read_to_end(&mut bytes)?;
        if bytes.len() as u64 != length {
            return Err(CheckpointError::Corrupt);
        }
        self.sum.update(&bytes);
        Ok(bytes)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::properties::properties;
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    fn request(seed: u64) -> PackingRequest {
        let value = json!({
            "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.535},
            "distance": {"type": "constant", "gap_mm": 0.1},
            "method": {"type": "edmd", "growth_rate": 0.3},
        });
        PackingRequest::from_json(&value, seed).unwrap()
    }

    fn written(body: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        // In pieces that no frame is a multiple of.
        let write = |out: &mut dyn Write| body.chunks(1000).try_for_each(|piece| out.write_all(piece));
        Checkpoint::new(&request(7), &write).write_to(&mut bytes).unwrap();
        bytes
    }

    fn read(bytes: &[u8], seed: u64) -> Result<Resume, CheckpointError> {
        Resume::read_from(&mut &bytes[..], &request(seed))
    }

    #[test]
    fn bodies_of_every_length_come_back() {
        for length in [0, 1, FRAME_BYTES - 1, FRAME_BYTES, FRAME_BYTES + 1, 3 * FRAME_BYTES] {
            let body: Vec<u8> = (0..length).map(|i| (i % 251) as u8).collect();
            assert_eq!(read(&written(&body), 7).unwrap().body, body, "{length} bytes");
            verify(&mut &written(&body)[..]).unwrap();
        }
    }

    #[test]
    fn the_request_is_told_with_its_seed() {
        assert_eq!(read_request(&mut &written(b"state")[..]).unwrap(), request(7));
    }

    #[test]
    fn what_belongs_to_another_run_is_refused() {
        assert!(matches!(read(&written(b"state"), 8), Err(CheckpointError::OtherRequest)));
        assert!(matches!(read(b"", 7), Err(CheckpointError::NotACheckpoint)));
        assert!(matches!(read(b"PACKSTN1 and more", 7), Err(CheckpointError::NotACheckpoint)));
        let mut later = written(b"state");
        later[8] = 9;
        assert!(
            matches!(read(&later, 7), Err(CheckpointError::OtherVersion { found }) if found == "layout 9")
        );
    }

    #[test]
    fn another_engine_s_state_is_refused_by_name() {
        let mut other = written(b"state");
        assert_eq!(&other[20..20 + VERSION.len()], VERSION.as_bytes());
        other[20] = b'9';
        let end = other.len() - 4;
        let sum = crc32fast::hash(&other[..end]);
        other[end..].copy_from_slice(&sum.to_le_bytes());
        let found = format!("9{}", &VERSION[1..]);
        assert!(matches!(read(&other, 7), Err(CheckpointError::OtherVersion { found: f }) if f == found));
    }

    #[test]
    fn a_writer_that_fails_is_told_of() {
        struct Full(usize);
        impl Write for Full {
            fn write(&mut self, block: &[u8]) -> io::Result<usize> {
                self.0 = self.0.checked_sub(block.len()).ok_or(io::ErrorKind::StorageFull)?;
                Ok(block.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let body = vec![1; 2 * FRAME_BYTES];
        let write = |out: &mut dyn Write| out.write_all(&body);
        let request = request(7);
        let error = Checkpoint::new(&request, &write).write_to(&mut Full(FRAME_BYTES)).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    }

    properties! {
        #[test]
        fn damage_is_never_taken_for_a_state(at in any::<prop::sample::Index>(), flip in 1_u8..=255, cut in any::<bool>()) {
            let whole = written(&[5; 3000]);
            let at = at.index(whole.len());
            let mut bytes = whole;
            if cut { bytes.truncate(at); } else { bytes[at] ^= flip; }
            prop_assert!(read(&bytes, 7).is_err());
            prop_assert!(read_request(&mut &bytes[..]).is_err());
            prop_assert!(verify(&mut &bytes[..]).is_err());
        }

        #[test]
        fn anything_at_all_is_read_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut marked = MAGIC.to_vec();
            marked.extend(REVISION.to_le_bytes());
            marked.extend(&bytes);
            prop_assert!(read(&marked, 7).is_err());
            prop_assert!(read(&bytes, 7).is_err());
        }
    }
}
