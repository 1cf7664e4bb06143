//! What is made of finished packings: meshes, voxels, cuts, lattice models.
//!
//! `queued -> running -> succeeded | failed`. Whoever asks, by a format of a result, by a request of its own or
//! beforehand in a job, asks the store; [`making`] makes what waits there, each thing once. What was asked for
//! by a format only is a cache. What is made, and how, is the engine's secret; nothing here knows HTTP.

pub(crate) mod estimates;
pub(crate) mod making;

use packstone_engine::checked_as;
use packstone_engine::export::tables::Head;
use packstone_engine::export::{ExportRequest, ExportType, REVISION};
use packstone_engine::request::{Distance, Specimen};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::failure::Failure;
use crate::gmsh;
use crate::hex;
use crate::ids::{ExportId, JobId};
use crate::jobs::JobRequest;

/// Most that one job may ask for beforehand.
pub(crate) const MAX_POSTPROCESS: usize = 8;
/// Most that is kept of one job.
pub(crate) const MAX_KEPT: u64 = 100;
/// Most that may wait because clients asked for it; what jobs asked for beforehand is bounded by the jobs.
pub(crate) const MAX_WAITING: u64 = 1000;

/// The gaps that the grains of a result keep: the rule of its request, with the distance that was reached where the
/// largest was requested. None where this version does not read the request.
pub(crate) fn distance_kept(head: &Head) -> Distance {
    let none = Distance::None { wall_gap_mm: None };
    JobRequest::read(&head.request, 0, None)
        .ok()
        .and_then(|request| checked_as(&request.packing(), &head.report.summary).ok())
        .map_or(none, |(checked, _)| checked.distance)
}

/// The state of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum ExportState {
    /// Waits to be made.
    Queued,
    /// It is being made.
    Running,
    /// Its file is stored.
    Succeeded,
    /// It could not be made; `error` says why.
    Failed,
}

impl ExportState {
    const ALL: [Self; 4] = [Self::Queued, Self::Running, Self::Succeeded, Self::Failed];

    /// Name in the interface and in the store.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
        }
    }

    /// The state of that name.
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }

    /// Whether it goes no further by itself.
    pub(crate) fn is_finished(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed)
    }
}

/// A stored file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredFile {
    /// Place below the artifacts' folder.
    pub(crate) path: String,
    pub(crate) bytes: u64,
    /// SHA-256 in hexadecimal.
    pub(crate) sha256: String,
}

/// Something export as the store keeps it. Times are microseconds since the Unix epoch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ExportRecord {
    pub(crate) seq: i64,
    pub(crate) id: ExportId,
    pub(crate) job: JobId,
    pub(crate) job_seq: i64,
    pub(crate) key: String,
    pub(crate) kind: ExportType,
    /// With its `type`, and defaults filled in.
    pub(crate) options: Value,
    /// Stays with its job.
    pub(crate) kept: bool,
    pub(crate) state: ExportState,
    pub(crate) attempt: i64,
    pub(crate) version: i64,
    pub(crate) progress: Option<Value>,
    pub(crate) file: Option<StoredFile>,
    pub(crate) report: Option<Value>,
    pub(crate) error: Option<Failure>,
    pub(crate) created_at: i64,
    pub(crate) started_at: Option<i64>,
    pub(crate) finished_at: Option<i64>,
    pub(crate) updated_at: i64,
    /// Name of the API key that submitted the job; empty where the server asked for none.
    pub(crate) owner: String,
    /// Made in the slots of packings.
    pub(crate) heavy: bool,
    /// Name of the worker process that makes or made it; empty for the server itself.
    pub(crate) worker: String,
}

/// The right to write about one attempt of one export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ExportLease {
    /// Number of the export in the store; 0 in a process without one.
    pub(crate) seq: i64,
    pub(crate) id: ExportId,
    pub(crate) job: JobId,
    pub(crate) attempt: i64,
}

impl From<&ExportRecord> for ExportLease {
    fn from(of: &ExportRecord) -> Self {
        Self { seq: of.seq, id: of.id, job: of.job, attempt: of.attempt }
    }
}

impl ExportRecord {
    /// What is, or was, to be made. Options of an earlier version may mean nothing any more.
    pub(crate) fn export(&self) -> Option<ExportRequest> {
        ExportRequest::from_json(&self.options).ok()
    }
}

/// Something to derive, as the store takes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NewExport {
    /// Names all that decides the bytes: the result, what is made of it, and how this build makes it.
    pub(crate) key: String,
    pub(crate) kind: ExportType,
    /// JSON with its `type`, and defaults filled in.
    pub(crate) options: String,
    /// Made in a moment: need not wait behind what takes long.
    pub(crate) quick: bool,
    /// Takes as long as a packing and is made in the slots of packings.
    pub(crate) heavy: bool,
    /// Needs Gmsh.
    pub(crate) needs_mesher: bool,
}

impl NewExport {
    /// What makes this of the result with that digest.
    pub(crate) fn new(export: &ExportRequest, result_sha256: &str) -> Self {
        // A value of plain fields always has a JSON form; its fields stand in one order.
        let options = serde_json::to_string(export).unwrap_or_default();
        let mut parts = format!("{result_sha256}\n{options}\n{REVISION}");
        if let Some(mesher) = gmsh::key_of(export) {
            parts.push('\n');
            parts.push_str(&mesher);
        }
        let key = hex::sha256(parts.as_bytes());
        let (kind, needs_mesher) = (export.export_type(), export.needs_mesher());
        Self { key, kind, options, quick: export.is_quick(), heavy: false, needs_mesher }
    }

    /// The same of a job that asks for it in its request, and packs such a specimen. What takes long is made in the
    /// slots of packings, so that the machine is not used twice; what clients ask for later is made beside them.
    pub(crate) fn beforehand(export: &ExportRequest, specimen: &Specimen, result_sha256: &str) -> Self {
        let new = Self::new(export, result_sha256);
        let heavy = !new.quick && export.is_heavy(specimen);
        Self { heavy, ..new }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    fn export(options: &Value, result: &str) -> NewExport {
        NewExport::new(&ExportRequest::from_json(options).unwrap(), result)
    }

    #[test]
    fn a_key_depends_on_result_and_options_and_not_on_how_they_are_written() {
        let first = export(&json!({"type": "slice", "axis": "z", "format": "json"}), "aa");
        assert_eq!(first, export(&json!({"format": "json", "axis": "z", "type": "slice"}), "aa"));
        assert_eq!(
            first,
            export(&json!({"type": "slice", "format": "json"}), "aa"),
            "defaults are filled in"
        );
        assert_ne!(first.key, export(&json!({"type": "slice", "format": "svg"}), "aa").key);
        assert_ne!(first.key, export(&json!({"type": "slice", "format": "json"}), "ab").key);
        let read_back = ExportRequest::from_json(&serde_json::from_str(&first.options).unwrap()).unwrap();
        assert_eq!(NewExport::new(&read_back, "aa"), first);
    }
}
