//! The message by which a server tells a worker of an export that it has leased.

use packstone_engine::Limits;
use packstone_engine::export::ExportType;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::ids::{ExportId, JobId};
use crate::jobs::store::ClaimedExport;
use crate::storage::Bound;

/// An export that a process has leased.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ExportLeaseDocument {
    /// ID of the export.
    #[cfg_attr(test, schema(value_type = String, format = "uuid"))]
    pub(crate) export: ExportId,
    /// ID of the job of whose result it is made.
    #[cfg_attr(test, schema(value_type = String, format = "uuid"))]
    pub(crate) job: JobId,
    /// Number of the attempt. Export and attempt name the lease.
    #[cfg_attr(test, schema(minimum = 1))]
    pub(crate) attempt: i64,
    /// Time for which the lease lasts without a renewal, in s.
    pub(crate) lease_s: f64,
    /// Faults of machines that earlier attempts have met.
    #[cfg_attr(test, schema(minimum = 0))]
    pub(crate) faults: i64,
    /// Most threads, as the request of the job has it.
    #[cfg_attr(test, schema(required, minimum = 1, maximum = 64))]
    pub(crate) threads: Option<u32>,
    /// Jobs that wait. An export of a job without `threads` leaves them the slots that they could have.
    pub(crate) queued: u64,
    /// Most memory of the export, in bytes.
    pub(crate) max_model_bytes: u64,
    /// Bytes that its file may have.
    pub(crate) room_bytes: u64,
    /// Its type.
    pub(crate) r#type: ExportType,
    /// The export, with its `type` and with defaults filled in.
    #[cfg_attr(test, schema(value_type = packstone_engine::export::ExportRequest))]
    pub(crate) options: Value,
    /// Length of the result that it is made from.
    pub(crate) result_bytes: u64,
    /// SHA-256 of that result, in hexadecimal.
    pub(crate) result_sha256: String,
}

impl ExportLeaseDocument {
    /// What a process gets of an export that it has leased.
    pub(crate) fn of(
        claimed: &ClaimedExport,
        lease_s: f64,
        limits: &Limits,
        room: (u64, Bound),
        queued: u64,
    ) -> Self {
        let ClaimedExport { export, result, faults, threads } = claimed;
        Self {
            export: export.id,
            job: export.job,
            attempt: export.attempt,
            lease_s,
            faults: *faults,
            threads: *threads,
            queued,
            max_model_bytes: limits.max_model_bytes,
            room_bytes: room.0,
            r#type: export.kind,
            options: export.options.clone(),
            result_bytes: result.bytes,
            result_sha256: result.sha256.clone(),
        }
    }
}
