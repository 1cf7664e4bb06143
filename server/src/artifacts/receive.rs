//! Taking in results that a worker has made in another process.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::sync::Arc;

use bytes::Bytes;
use packstone_engine::export::tables::{self, GrainSource as _};
use packstone_engine::{Report, Unattended};
use serde_json::{Map, Value};

use super::read::StoredResult;
use super::{Artifacts, InFlight, blob};
use crate::blobs::blocks::{BlockSums, CheckedFile};
use crate::jobs::ArtifactRecord;

/// What a result must be.
#[derive(Clone, Debug)]
pub(crate) struct Expected {
    /// ID of its job.
    pub(crate) job: String,
    /// The request of the job.
    pub(crate) request: Value,
    /// SHA-256 of the file, in hexadecimal.
    pub(crate) sha256: String,
    /// Most bytes of the file.
    pub(crate) most_bytes: u64,
}

/// A result that was taken in.
#[derive(Debug)]
pub(crate) struct Received {
    pub(crate) artifact: ArtifactRecord,
    pub(crate) report: Report,
    pub(crate) grains: u64,
}

/// Why a result was not taken in.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReceiveError {
    /// It did not come to its end.
    #[error("the file ended early")]
    Broken,
    /// It is not what its sender says it is.
    #[error("{0}")]
    Unexpected(String),
    /// It cannot be written or read.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl Artifacts {
    /// Opens the file of a result of this process, to be sent to a server.
    ///
    /// # Errors
    /// Those of the storage.
    pub(crate) fn open_result(&self, record: &ArtifactRecord) -> io::Result<File> {
        self.blobs.fetch(&blob(&record.path))
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
        let Some((report, grains, format_lengths)) = examined else { return Err(ReceiveError::Broken) };
        let shown = match serde_json::to_value(&report).map_err(io::Error::from)? {
            Value::Object(shown) => shown,
            _ => Map::new(),
        };
        let artifact = ArtifactRecord {
            path: place.path.clone(),
            bytes,
            sha256,
            report: shown,
            format_revision: tables::REVISION,
            format_lengths,
        };
        Ok(Received { artifact, report, grains })
    }
}

/// Makes sure that a file is the result of a job; its report, the number of its grains, and the lengths of its formats.
fn examine(
    file: CheckedFile,
    expected: &Expected,
    sha256: &str,
) -> Result<(Report, u64, BTreeMap<String, u64>), ReceiveError> {
    if sha256 != expected.sha256 {
        let text = format!("the file has the sha256 {sha256}: must be {}", expected.sha256);
        return Err(ReceiveError::Unexpected(text));
    }
    let stored = StoredResult::of(file).map_err(|error| match error.kind() {
        io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
            ReceiveError::Unexpected(format!("the file is no result: {error}"))
        }
        _ => ReceiveError::Io(error),
    })?;
    let head = stored.head();
    if head.job_id.as_deref() != Some(expected.job.as_str()) || head.request != expected.request {
        return Err(ReceiveError::Unexpected("the file is the result of another request".into()));
    }
    Ok((head.report.clone(), stored.len() as u64, stored.count_lengths()?))
}
