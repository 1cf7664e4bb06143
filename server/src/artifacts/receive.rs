//! Taking in results that a worker has made in another process.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
use std::sync::PoisonError;

use bytes::Bytes;
use packstone_engine::export::tables::{self, GrainSource as _};
use packstone_engine::{Report, Unattended};
use serde_json::{Map, Value};

use super::{Artifacts, InFlight};
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
    /// The file of a result.
    pub(crate) fn path_of(&self, record: &ArtifactRecord) -> PathBuf {
        self.locate(&record.path)
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
        let written: Result<_, ReceiveError> =
            self.write_whole(place, expected.most_bytes, &Unattended, write, || Ok(()));
        let ((), bytes, sha256) = written?;
        let received = self.examine(place, expected, bytes, sha256);
        if received.is_err()
            && let Err(error) = self.remove(&place.path)
        {
            tracing::warn!(%error, "a result that was refused is left to the sweeper");
        }
        received
    }

    fn examine(
        &self,
        place: &InFlight,
        expected: &Expected,
        bytes: u64,
        sha256: String,
    ) -> Result<Received, ReceiveError> {
        if sha256 != expected.sha256 {
            let text = format!("the file has the sha256 {sha256}: must be {}", expected.sha256);
            return Err(ReceiveError::Unexpected(text));
        }
        self.verified.lock().unwrap_or_else(PoisonError::into_inner).insert(place.path.clone());
        let mut artifact = ArtifactRecord {
            path: place.path.clone(),
            bytes,
            sha256,
            report: Map::new(),
            format_revision: tables::REVISION,
            format_lengths: BTreeMap::new(),
        };
        let stored = self.read(&artifact).map_err(|error| match error.kind() {
            io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
                ReceiveError::Unexpected(format!("the file is no result: {error}"))
            }
            _ => ReceiveError::Io(error),
        })?;
        let head = stored.head();
        if head.job_id.as_deref() != Some(expected.job.as_str()) || head.request != expected.request {
            return Err(ReceiveError::Unexpected("the file is the result of another request".into()));
        }
        artifact.format_lengths = stored.count_lengths()?;
        if let Value::Object(report) = serde_json::to_value(&head.report).map_err(io::Error::from)? {
            artifact.report = report;
        }
        Ok(Received { artifact, report: head.report.clone(), grains: stored.len() as u64 })
    }
}
