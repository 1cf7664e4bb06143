//! Taking in results that a worker has made in another process.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::sync::Arc;

use bytes::Bytes;
use packstone_engine::export::ExportReport;
use packstone_engine::export::tables::{EngineInfo, GrainSource as _, stored};
use packstone_engine::{Report, Unattended};
use serde_json::{Map, Value};

use super::read::StoredResult;
use super::{Artifacts, InFlight, blob};
use crate::blobs::Staged;
use crate::blobs::blocks::{BlockSums, CheckedFile};
use crate::exports::StoredFile;
use crate::jobs::ArtifactRecord;

/// Most bytes of a report with the templates of polyhedra: more than any has.
const MOST_REPORT_BYTES: u64 = 16 << 20;
/// Most bytes of a grain: 14 columns.
const MOST_BYTES_OF_GRAIN: u64 = 112;

/// What a result must be.
#[derive(Clone, Debug)]
pub(crate) struct Expected {
    /// ID of its job.
    pub(crate) job: String,
    /// The request of the job, as JSON text.
    pub(crate) request: String,
    /// SHA-256 of the file, in hexadecimal.
    pub(crate) sha256: String,
    /// Most bytes of the file.
    pub(crate) most_bytes: u64,
}

/// What an export must be.
#[derive(Clone, Debug)]
pub(crate) struct ExpectedExport {
    /// SHA-256 of the file, in hexadecimal.
    pub(crate) sha256: String,
    /// Bytes of the report before it.
    pub(crate) report_bytes: usize,
    /// Most bytes of the file.
    pub(crate) most_bytes: u64,
}

/// A file that is being fetched from a server.
#[derive(Debug)]
pub(crate) struct Fetching<'a> {
    staged: Staged,
    artifacts: &'a Artifacts,
    name: String,
}

impl Fetching<'_> {
    /// Writes the next piece.
    ///
    /// # Errors
    /// The disk's.
    pub(crate) fn write(&mut self, piece: &[u8]) -> io::Result<()> {
        io::Write::write_all(&mut self.staged.file(), piece)
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn finish(self) -> io::Result<()> {
        self.artifacts.blobs.publish(self.staged, &self.name, &|| false)
    }
}

/// A result that was taken in.
#[derive(Debug)]
pub(crate) struct Received {
    pub(crate) artifact: ArtifactRecord,
    pub(crate) grains: u64,
}

/// Why a result was not taken in.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReceiveError {
    /// It did not come to its end.
    #[error("the file ended early")]
    Broken,
    /// It is not the file that its sender says it is; it may have been damaged on its way.
    #[error("{0}")]
    Damaged(String),
    /// It is no result of the job.
    #[error("{0}")]
    Unexpected(String),
    /// It cannot be written or read.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl Artifacts {
    /// Opens a result or an export of this process, to be sent to a server.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn open_file(&self, path: &str) -> io::Result<File> {
        self.blobs.fetch(&blob(path))
    }

    /// Begins the file of a result that a server sends. Its readers compare its digest.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn fetching(&self, path: &str) -> io::Result<Fetching<'_>> {
        let name = blob(path);
        Ok(Fetching { staged: self.blobs.stage(&name)?, artifacts: self, name })
    }

    /// Writes a result from its pieces, and makes sure that it is one of this job. Nothing is left behind where it is
    /// not.
    ///
    /// # Errors
    /// See [`ReceiveError`].
    pub(crate) fn receive(
        &self,
        place: &InFlight,
        expected: &Expected,
        mut next: impl FnMut() -> Option<Result<Bytes, ReceiveError>>,
    ) -> Result<Received, ReceiveError> {
        let write = |out: &mut dyn io::Write| {
            while let Some(piece) = next() {
                out.write_all(&piece?)?;
            }
            Ok(())
        };
        let mut examined = None;
        let check = |file: &File, sha256: &str, sums: &Arc<BlockSums>| {
            let file =
                CheckedFile::new(file.try_clone()?, place.path.clone(), Arc::clone(sums), Arc::new(|| {}));
            examine(file, expected, sha256).map(|found| examined = Some(found))
        };
        let ((), bytes, sha256) = self.write_whole(place, expected.most_bytes, &Unattended, write, check)?;
        let Some((report, grains)) = examined else { return Err(ReceiveError::Broken) };
        let shown = match serde_json::to_value(&report).map_err(io::Error::from)? {
            Value::Object(shown) => shown,
            _ => Map::new(),
        };
        let artifact = ArtifactRecord {
            path: place.path.clone(),
            bytes,
            sha256,
            report: shown,
            // Counted when the result is checked.
            format_revision: 0,
            format_lengths: BTreeMap::new(),
        };
        Ok(Received { artifact, grains })
    }

    /// Writes an export from its pieces, and makes sure that it is the file that its sender says: a report of so many
    /// bytes, and what follows it. `check_report` gets the report and the length of the file. Nothing is left behind
    /// where it refuses them.
    ///
    /// # Errors
    /// See [`ReceiveError`].
    pub(crate) fn receive_export(
        &self,
        place: &InFlight,
        expected: &ExpectedExport,
        mut next: impl FnMut() -> Option<Result<Bytes, ReceiveError>>,
        check_report: impl FnOnce(&ExportReport, u64) -> Result<(), ReceiveError>,
    ) -> Result<(StoredFile, ExportReport), ReceiveError> {
        let head = RefCell::new(Vec::new());
        let write = |out: &mut dyn io::Write| {
            while let Some(piece) = next() {
                let piece = piece?;
                let missing = expected.report_bytes - head.borrow().len();
                let (of_head, rest) = piece.split_at(piece.len().min(missing));
                head.borrow_mut().extend_from_slice(of_head);
                out.write_all(rest)?;
            }
            Ok(())
        };
        let mut checked = None;
        let check = |file: &File, sha256: &str, _: &Arc<BlockSums>| {
            if sha256 != expected.sha256 {
                let text = format!("the file has the sha256 {sha256}: must be {}", expected.sha256);
                return Err(ReceiveError::Damaged(text));
            }
            let report = serde_json::from_slice::<ExportReport>(&head.borrow())
                .map_err(|error| ReceiveError::Unexpected(format!("the report is none: {error}")))?;
            check_report(&report, file.metadata()?.len())?;
            checked = Some(report);
            Ok(())
        };
        let ((), bytes, sha256) = self.write_whole(place, expected.most_bytes, &Unattended, write, check)?;
        let report = checked.ok_or(ReceiveError::Broken)?;
        Ok((StoredFile { path: place.path.clone(), bytes, sha256 }, report))
    }
}

/// Makes sure that a file is the result of a job; its report and the number of its grains.
fn examine(file: CheckedFile, expected: &Expected, sha256: &str) -> Result<(Report, u64), ReceiveError> {
    if sha256 != expected.sha256 {
        let text = format!("the file has the sha256 {sha256}: must be {}", expected.sha256);
        return Err(ReceiveError::Damaged(text));
    }
    check_head(&file, expected)?;
    let whole = StoredResult::of(file).and_then(|result| result.check_sum().map(|()| result));
    let result = whole.map_err(|error| match error.kind() {
        io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
            ReceiveError::Unexpected(format!("the file is no result: {error}"))
        }
        _ => ReceiveError::Io(error),
    })?;
    let head = result.head();
    let request: Value = serde_json::from_str(&expected.request).map_err(io::Error::from)?;
    if head.job_id.as_deref() != Some(expected.job.as_str()) || head.request != request {
        return Err(ReceiveError::Unexpected("the file is the result of another request".into()));
    }
    if head.engine != EngineInfo::current() {
        return Err(ReceiveError::Unexpected("the file is the result of another engine".into()));
    }
    Ok((head.report.clone(), result.len() as u64))
}

/// Most bytes of a result of so many grains, whose request has so many bytes as JSON.
pub(crate) fn most_bytes_of_result(grains: u64, request_bytes: u64) -> u64 {
    most_head_bytes(request_bytes).saturating_add(grains.saturating_mul(MOST_BYTES_OF_GRAIN))
}

/// Most bytes of the head of a result: the request, the templates and the report.
fn most_head_bytes(request_bytes: u64) -> u64 {
    MOST_REPORT_BYTES.saturating_add(request_bytes.saturating_mul(2))
}

/// Refuses a head that is longer than that of any result, before it is read into memory, and a number of grains for
/// which the file is too short.
fn check_head(file: &CheckedFile, expected: &Expected) -> Result<(), ReceiveError> {
    let mut lengths = [0; 16];
    match file.read_exact_at(&mut lengths, stored::MAGIC_BYTES as u64) {
        // The layout refuses it.
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
        read => read?,
    }
    let number =
        |at: usize| lengths[at..at + 8].iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte));
    let (head, grains) = (number(0), number(8));
    let most = most_head_bytes(expected.request.len() as u64);
    if head > most {
        let text = format!("the head of the file has {head} bytes: must have at most {most}");
        return Err(ReceiveError::Unexpected(text));
    }
    let most = file.length() / 8;
    if grains > most {
        let text =
            format!("the file is no result: it names {grains} grains and has bytes for {most} numbers");
        return Err(ReceiveError::Unexpected(text));
    }
    Ok(())
}
