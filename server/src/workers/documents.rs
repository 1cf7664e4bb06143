//! The messages between a worker and its server, as both sides read and write them.
//!
//! A server leases to its own build only, so that both sides are always of one version.

use packstone_engine::request::decode::{MAX_FAULTS, pointer_segment};
use packstone_engine::{FieldError, Limits};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::failure::Failure;
use crate::ids::{JobId, TaskId};
use crate::jobs::store::{Claimed, Held, Renewal};
use crate::jobs::{JobProgress, StopRequests};
use crate::storage::Bound;
use crate::studies::Facts;
use crate::workers::here::run_limit_s;
use crate::workers::leased_export::ExportLeaseDocument;

/// Most slots of a process.
pub(crate) const MAX_SLOTS: u32 = 1024;
/// Most leases that are renewed by one request: a slot packs the next job while it stores a result.
const MAX_RENEWALS: usize = 2 * MAX_SLOTS as usize;
/// Most time that a process may say it has left, in s.
pub(crate) const MAX_REMAINING_S: f64 = 1e9;
/// Longest name of a worker, in characters.
pub(crate) const MAX_NAME_CHARS: usize = 100;
/// Longest name of what progress counts, in characters.
const MAX_UNIT_CHARS: usize = 32;
/// Longest message of progress, in characters.
const MAX_MESSAGE_CHARS: usize = 300;
/// Longest ID of a claim, in characters.
const MAX_CLAIM_CHARS: usize = 64;

/// What this process was built from. A server leases to its own build only.
pub(crate) const BUILD: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("PACKSTONE_COMMIT"), ")");

/// A document that this module's reader has checked.
pub(crate) trait Checked: DeserializeOwned {
    /// What is out of its bounds.
    fn faults(&self) -> Vec<FieldError>;

    /// Reads a document.
    ///
    /// # Errors
    /// Each field that is unknown, missing, of the wrong type or out of its bounds.
    fn read(value: Value) -> Result<Self, Vec<FieldError>> {
        let read: Self = serde_path_to_error::deserialize(value).map_err(|error| {
            let pointer = pointer_of(error.path());
            vec![FieldError::new(pointer, error.into_inner().to_string())]
        })?;
        let faults = read.faults();
        if faults.is_empty() { Ok(read) } else { Err(faults) }
    }
}

fn pointer_of(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    path.iter()
        .filter_map(|segment| match segment {
            Segment::Seq { index } => Some(format!("/{index}")),
            Segment::Map { key } => Some(format!("/{}", pointer_segment(key))),
            Segment::Enum { .. } | Segment::Unknown => None,
        })
        .collect()
}

/// A line of text for people.
fn line(faults: &mut Vec<FieldError>, pointer: &str, text: &str, most: usize) {
    bounded(faults, pointer, text, most);
    if text.chars().any(char::is_control) {
        faults.push(FieldError::new(pointer, "has a control character: must be one line of text"));
    }
}

fn bounded(faults: &mut Vec<FieldError>, pointer: &str, text: &str, most: usize) {
    let length = text.chars().count();
    if length == 0 || length > most {
        faults.push(FieldError::new(pointer, format!("has {length} characters: must have from 1 to {most}")));
    }
}

/// A process asks for jobs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct LeaseRequest {
    /// An ID of this request. A repeated request with the same ID gets the same jobs again, as long as they run.
    #[cfg_attr(test, schema(min_length = 1, max_length = 64))]
    pub(crate) claim: String,
    /// Name of the process, for people.
    #[cfg_attr(test, schema(min_length = 1, max_length = 100))]
    pub(crate) worker: String,
    /// Most jobs that it takes; 0 for those alone that an earlier request of the same claim has leased.
    #[cfg_attr(test, schema(maximum = 1024))]
    pub(crate) slots: u32,
    /// Time that it has left for jobs, in s, where that is limited. It gets jobs that are forecast to take no longer,
    /// and, with 30 s and more, those whose method keeps checkpoints.
    #[cfg_attr(test, schema(value_type = Option<f64>, minimum = 0, maximum = 1_000_000_000, required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) remaining_s: Option<f64>,
    /// The program that makes meshes on its machine, with its version, as `Gmsh 4.15.2`; absent where there is none.
    #[cfg_attr(test, schema(value_type = Option<String>, min_length = 1, max_length = 100, required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) mesher: Option<String>,
    /// Version and commit of the process.
    pub(crate) build: String,
    /// SHA-256 of two packings that every build packs alike, in hexadecimal.
    pub(crate) bits: String,
}

impl Checked for LeaseRequest {
    fn faults(&self) -> Vec<FieldError> {
        let mut faults = Vec::new();
        bounded(&mut faults, "/claim", &self.claim, MAX_CLAIM_CHARS);
        line(&mut faults, "/worker", &self.worker, MAX_NAME_CHARS);
        if let Some(mesher) = &self.mesher {
            line(&mut faults, "/mesher", mesher, MAX_NAME_CHARS);
        }
        if self.slots > MAX_SLOTS {
            let detail = format!("{} is out of range: must be from 0 to {MAX_SLOTS}", self.slots);
            faults.push(FieldError::new("/slots", detail));
        }
        if let Some(remaining_s) = self.remaining_s.filter(|s| !(0.0..=MAX_REMAINING_S).contains(s)) {
            let detail = format!("{remaining_s} is out of range: must be from 0 to {MAX_REMAINING_S}");
            faults.push(FieldError::new("/remaining_s", detail));
        }
        faults
    }
}

/// The jobs and exports that a process has leased.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct LeasesDocument {
    pub(crate) leases: Vec<LeaseDocument>,
    pub(crate) exports: Vec<ExportLeaseDocument>,
}

/// A job that a process has leased.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct LeaseDocument {
    /// ID of the job.
    #[cfg_attr(test, schema(value_type = String, format = "uuid"))]
    pub(crate) job: JobId,
    /// Number of the attempt. Job and attempt name the lease.
    #[cfg_attr(test, schema(minimum = 1))]
    pub(crate) attempt: i64,
    /// Time for which the lease lasts without a renewal, in s.
    pub(crate) lease_s: f64,
    /// Longest time of the attempt, in s.
    #[cfg_attr(test, schema(required))]
    pub(crate) timeout_s: Option<f64>,
    /// Faults of machines that earlier attempts have met.
    #[cfg_attr(test, schema(minimum = 0))]
    pub(crate) faults: i64,
    /// Most threads that may compute the packing, as the request has it.
    #[cfg_attr(test, schema(required, minimum = 1, maximum = 64))]
    pub(crate) threads: Option<u32>,
    /// Most threads that it has work for.
    #[cfg_attr(test, schema(minimum = 1, maximum = 64))]
    pub(crate) most_threads: u32,
    /// Jobs that wait. A job without `threads` leaves them the slots that they could have.
    pub(crate) queued: u64,
    /// Most grains of the packing.
    pub(crate) max_grains: u64,
    /// Most memory of the packing, in bytes.
    pub(crate) max_memory_bytes: u64,
    /// Bytes that the result may have.
    pub(crate) room_bytes: u64,
    /// An earlier attempt has left a checkpoint with the server.
    pub(crate) has_checkpoint: bool,
    /// The request of the job.
    pub(crate) request: Value,
}

impl LeaseDocument {
    /// What a process gets of a job that it has leased.
    ///
    /// # Errors
    /// The stored request is unreadable.
    pub(crate) fn of(
        claimed: &Claimed,
        (lease_s, max_run_s): (f64, Option<f64>),
        limits: &Limits,
        room: (u64, Bound),
        queued: u64,
        has_checkpoint: bool,
    ) -> Result<Self, serde_json::Error> {
        Ok(Self {
            job: claimed.lease.id,
            attempt: claimed.lease.attempt,
            lease_s,
            timeout_s: run_limit_s(claimed.job.timeout_s, max_run_s),
            faults: claimed.job.faults,
            threads: claimed.job.threads,
            most_threads: claimed.job.most_threads,
            queued,
            max_grains: limits.max_grains,
            max_memory_bytes: limits.max_memory_bytes,
            room_bytes: room.0,
            has_checkpoint,
            request: serde_json::from_str(&claimed.request)?,
        })
    }
}

/// A process renews its leases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct RenewalRequest {
    /// One for each job or export that it runs.
    #[cfg_attr(test, schema(max_items = 2048))]
    pub(crate) renewals: Vec<RenewalDocument>,
}

/// The renewal of a lease.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct RenewalDocument {
    /// ID of the job or the export.
    #[cfg_attr(test, schema(value_type = String, format = "uuid"))]
    pub(crate) task: TaskId,
    /// Number of the attempt.
    #[cfg_attr(test, schema(minimum = 1))]
    pub(crate) attempt: i64,
    /// How far the run is, where that is news; as `progress` of a job shows it.
    #[cfg_attr(test, schema(value_type = Option<Object>, required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) progress: Option<JobProgress>,
}

impl Checked for RenewalRequest {
    fn faults(&self) -> Vec<FieldError> {
        let found = self.renewals.len();
        if found > MAX_RENEWALS {
            let detail = format!("has {found} entries: must have at most {MAX_RENEWALS}");
            return vec![FieldError::new("/renewals", detail)];
        }
        let mut faults = Vec::new();
        for (index, renewal) in self.renewals.iter().enumerate() {
            let mut fault = |member: &str, detail: String| {
                if faults.len() < MAX_FAULTS {
                    faults.push(FieldError::new(format!("/renewals/{index}/{member}"), detail));
                }
            };
            if renewal.attempt < 1 {
                fault("attempt", format!("{} is out of range: must be at least 1", renewal.attempt));
            }
            let Some(progress) = &renewal.progress else { continue };
            if !(0.0..=1.0).contains(&progress.fraction) {
                let detail = format!("{} is out of range: must be from 0 to 1", progress.fraction);
                fault("progress/fraction", detail);
            }
            for (member, text, most) in
                [("unit", &progress.unit, MAX_UNIT_CHARS), ("message", &progress.message, MAX_MESSAGE_CHARS)]
            {
                let length = text.chars().count();
                if length > most || text.chars().any(char::is_control) {
                    let detail = format!("has {length} characters: must be one line of at most {most}");
                    fault(&format!("progress/{member}"), detail);
                }
            }
            let growth = progress.growth;
            for (member, found) in [
                ("eta_s", progress.eta_s),
                ("growth/volume_fraction", growth.map(|growth| growth.volume_fraction)),
                ("growth/distance_mm", growth.and_then(|growth| growth.distance_mm)),
                ("growth/events_per_s", growth.map(|growth| growth.events_per_s)),
                ("growth/reduced_pressure", growth.and_then(|growth| growth.reduced_pressure)),
            ] {
                if let Some(found) = found.filter(|found| !(0.0..=f64::MAX).contains(found)) {
                    fault(
                        &format!("progress/{member}"),
                        format!("{found} is out of range: must be at least 0"),
                    );
                }
            }
            let events = growth.map_or(0, |growth| growth.events);
            for (member, count) in
                [("done", progress.done), ("total", progress.total), ("growth/events", events)]
            {
                if i64::try_from(count).is_err() {
                    let detail = format!("{count} is out of range: must be at most {}", i64::MAX);
                    fault(&format!("progress/{member}"), detail);
                }
            }
        }
        faults
    }
}

impl From<RenewalDocument> for Renewal {
    fn from(document: RenewalDocument) -> Self {
        let RenewalDocument { task, attempt, progress } = document;
        Self { id: task, attempt, progress }
    }
}

/// What became of the leases of a process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct RenewalsDocument {
    pub(crate) leases: Vec<RenewedDocument>,
    /// Time after which the next renewal is expected, in s: short where a client watches one of the jobs.
    pub(crate) report_every_s: f64,
}

/// What became of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct RenewedDocument {
    /// ID of the job or the export.
    #[cfg_attr(test, schema(value_type = String, format = "uuid"))]
    pub(crate) task: TaskId,
    /// Number of the attempt.
    #[cfg_attr(test, schema(minimum = 1))]
    pub(crate) attempt: i64,
    pub(crate) state: LeaseState,
}

/// The state of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum LeaseState {
    /// It is renewed.
    Running,
    /// It is renewed, and a client wants the run to end with the packing that it has reached.
    FinishRequested,
    /// It is renewed, and a client wants the job to end without a result.
    CancelRequested,
    /// The job or the export is another attempt's, has ended, or is gone.
    Lost,
}

impl From<Held> for LeaseState {
    fn from(held: Held) -> Self {
        match held {
            Held::Running { requests: StopRequests { cancel: true, .. }, .. } => Self::CancelRequested,
            Held::Running { requests: StopRequests { finish: true, .. }, .. } => Self::FinishRequested,
            Held::Running { .. } | Held::RunningExport(_) => Self::Running,
            Held::Ended | Held::Lost => Self::Lost,
        }
    }
}

/// The end of an attempt without a result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct EndRequest {
    pub(crate) outcome: EndOutcome,
    /// Why the job failed, with `failed`; with `faulted` what ended the attempt, where that is known.
    #[cfg_attr(test, schema(value_type = Option<Object>, required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) failure: Option<Failure>,
    /// What a study keeps of the run, with `failed`.
    #[cfg_attr(test, schema(value_type = Option<Object>, required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) facts: Option<Facts>,
    /// Bytes for which the server has no room, with `faulted`: the job goes on as soon as there are so many.
    #[cfg_attr(test, schema(value_type = Option<u64>, maximum = 9_223_372_036_854_775_807_u64, required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) needed_bytes: Option<u64>,
}

/// How an attempt ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum EndOutcome {
    /// The job has failed.
    Failed,
    /// The run ended because a client had cancelled the job.
    Cancelled,
    /// The process stops: the job goes back to the queue. The attempt does not count.
    Released,
    /// A fault of the machine: the job goes back to the queue, after a pause. The attempt does not count.
    Faulted,
}

impl Checked for EndRequest {
    fn faults(&self) -> Vec<FieldError> {
        let mut faults = Vec::new();
        match (self.outcome, &self.failure) {
            (EndOutcome::Failed, None) => {
                faults.push(FieldError::new("/failure", "is missing: a failed job must have one"));
            }
            (EndOutcome::Failed | EndOutcome::Faulted, Some(_)) | (_, None) => {}
            (_, Some(_)) => {
                let detail = "is of no use: must be absent unless the outcome is `failed` or `faulted`";
                faults.push(FieldError::new("/failure", detail));
            }
        }
        if let Some(bytes) = self.needed_bytes {
            if self.outcome != EndOutcome::Faulted {
                let detail = "is of no use: must be absent unless the outcome is `faulted`";
                faults.push(FieldError::new("/needed_bytes", detail));
            } else if i64::try_from(bytes).is_err() {
                let detail = format!("{bytes} is out of range: must be at most {}", i64::MAX);
                faults.push(FieldError::new("/needed_bytes", detail));
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn documents_are_read_strictly() {
        let request = json!({"claim": "c", "worker": "w", "slots": 2, "build": BUILD, "bits": "ab"});
        assert!(LeaseRequest::read(request.clone()).is_ok());
        for (member, value, pointer) in [
            ("slots", json!(1025), "/slots"),
            ("slots", json!("two"), "/slots"),
            ("worker", json!(""), "/worker"),
            ("worker", json!("one\ntwo"), "/worker"),
            ("claim", json!("x".repeat(65)), "/claim"),
            ("remaining_s", json!(-1), "/remaining_s"),
            ("remaining_s", json!(1e10), "/remaining_s"),
            ("remaining_s", json!("1 h"), "/remaining_s"),
            ("more", json!(1), "/more"),
        ] {
            let mut request = request.clone();
            request[member] = value;
            let faults = LeaseRequest::read(request).expect_err("a faulty request");
            assert_eq!(faults[0].pointer, pointer, "{faults:?}");
        }
        let renewal = |attempt: Value| json!({"renewals": [{"task": JobId::new(), "attempt": attempt}]});
        assert!(RenewalRequest::read(renewal(json!(1))).is_ok());
        let faults = RenewalRequest::read(renewal(json!("1"))).expect_err("a faulty renewal");
        assert_eq!(faults[0].pointer, "/renewals/0/attempt");
        let progress = |member: &str, value: Value| {
            let mut progress = json!({
                "fraction": 0.5, "step": "edmd", "done": 1, "total": 2, "unit": "events", "message": "",
                "eta_s": null,
            });
            progress[member] = value;
            json!({"renewals": [{"task": JobId::new(), "attempt": 1, "progress": progress}]})
        };
        let growth = |member: &str, value: Value| {
            let mut growth = json!({
                "volume_fraction": 0.5, "distance_mm": 0.1, "events": 1, "events_per_s": 1.0, "reduced_pressure": null,
                "predictable": true,
            });
            growth[member] = value;
            progress("growth", growth)
        };
        assert!(RenewalRequest::read(progress("done", json!(2))).is_ok());
        assert!(RenewalRequest::read(growth("events", json!(2))).is_ok());
        for (request, pointer) in [
            (renewal(json!(0)), "/renewals/0/attempt"),
            (progress("fraction", json!(1.5)), "/renewals/0/progress/fraction"),
            (progress("total", json!(1_u64 << 63)), "/renewals/0/progress/total"),
            (progress("unit", json!("x".repeat(33))), "/renewals/0/progress/unit"),
            (progress("message", json!("x".repeat(301))), "/renewals/0/progress/message"),
            (progress("message", json!("two\nlines")), "/renewals/0/progress/message"),
            (progress("eta_s", json!(-1)), "/renewals/0/progress/eta_s"),
            (growth("distance_mm", json!(-0.5)), "/renewals/0/progress/growth/distance_mm"),
            (growth("events_per_s", json!(-1e300)), "/renewals/0/progress/growth/events_per_s"),
        ] {
            let faults = RenewalRequest::read(request).expect_err("a value out of its bounds");
            assert_eq!(faults[0].pointer, pointer, "{faults:?}");
        }
        for (end, is_read) in [
            (json!({"outcome": "released"}), true),
            (json!({"outcome": "failed"}), false),
            (json!({"outcome": "failed", "failure": {"code": "timed-out", "detail": "x"}}), true),
            (json!({"outcome": "cancelled", "failure": {"code": "timed-out", "detail": "x"}}), false),
            (json!({"outcome": "ended"}), false),
            (json!({"outcome": "faulted", "needed_bytes": 336_383}), true),
            (json!({"outcome": "faulted", "needed_bytes": 1_u64 << 63}), false),
            (json!({"outcome": "released", "needed_bytes": 1}), false),
        ] {
            assert_eq!(EndRequest::read(end.clone()).is_ok(), is_read, "{end}");
        }
    }
}
