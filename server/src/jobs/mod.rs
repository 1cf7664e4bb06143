//! Jobs: what they are, the states they pass through, and who may move them.
//!
//! `queued -> running -> succeeded | failed | cancelled`. A running job is leased: only the holder of
//! the current ([`JobId`], attempt) may write its progress or its end. A client may cancel, retry or
//! delete; the [`store`] decides in one transaction whether the state allows it. Workers lease jobs
//! and run them, [`sweeper`] clears up behind them. Nothing here knows HTTP.

pub(crate) mod journal;
pub(crate) mod moments;
pub(crate) mod notifications;
pub(crate) mod overview;
pub(crate) mod request;
#[cfg(test)]
pub(crate) mod schema;
pub(crate) mod store;
pub(crate) mod sweeper;
pub(crate) mod waiting;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::failure::Failure;
use crate::ids::StudyId;

pub(crate) use crate::ids::JobId;
pub(crate) use overview::Overview;
pub(crate) use request::JobRequest;
pub(crate) use waiting::WaitReason;

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    /// Waits for a worker.
    Queued,
    /// A worker packs it or stores its result. A worker holds up to two leases: it packs the next job while it stores
    /// a result.
    Running,
    /// Its result is stored.
    Succeeded,
    /// It ended without a result; `error` says why.
    Failed,
    /// A client cancelled it.
    Cancelled,
}

impl State {
    /// All states.
    pub(crate) const ALL: [Self; 5] =
        [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// Name in the interface and in the store.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// The state of that name.
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// Whether nothing but a client will move the job on.
    pub(crate) fn is_finished(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// Whether a client may send the job back to the queue.
    pub(crate) fn may_retry(self) -> bool {
        matches!(self, Self::Failed | Self::Cancelled)
    }
}

/// How far a running job is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct JobProgress {
    /// Share of the whole work done; never falls within an attempt.
    #[cfg_attr(test, schema(minimum = 0, maximum = 1))]
    pub(crate) fraction: f64,
    /// What the run is doing.
    pub(crate) step: packstone_engine::Step,
    /// Units done in this step.
    pub(crate) done: u64,
    /// Units in this step.
    pub(crate) total: u64,
    /// What `done` and `total` count.
    pub(crate) unit: String,
    /// One line for a person; may be empty.
    pub(crate) message: String,
    /// Seconds that the rest is likely to take, as of `updated_at`; `null` while nothing can be said.
    #[cfg_attr(test, schema(required))]
    pub(crate) eta_s: Option<f64>,
    /// How far the grains have grown; absent in other steps than `edmd`.
    #[cfg_attr(test, schema(required = false))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) growth: Option<packstone_engine::Growth>,
}

/// A stored result.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ArtifactRecord {
    /// Place below the artifacts' folder.
    pub(crate) path: String,
    /// Length of the stored file.
    pub(crate) bytes: u64,
    /// SHA-256 of the stored file, in hexadecimal.
    pub(crate) sha256: String,
    /// The engine's report, as JSON.
    pub(crate) report: Map<String, Value>,
    /// Revision of the formats that `format_lengths` counts.
    pub(crate) format_revision: u32,
    /// Length in bytes by name of the format.
    pub(crate) format_lengths: BTreeMap<String, u64>,
}

/// A job as the store keeps it, but for its request. Times are microseconds since the Unix epoch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct JobRecord {
    pub(crate) seq: i64,
    pub(crate) id: JobId,
    pub(crate) state: State,
    pub(crate) name: Option<String>,
    pub(crate) labels: BTreeMap<String, String>,
    pub(crate) priority: i64,
    /// Most threads that may compute the packing, as the request has it.
    pub(crate) threads: Option<u32>,
    /// Most threads that it has work for, by its plan.
    pub(crate) most_threads: u32,
    pub(crate) seed: i64,
    pub(crate) timeout_s: Option<f64>,
    pub(crate) attempt: i64,
    pub(crate) max_attempts: i64,
    pub(crate) cancel_requested: bool,
    pub(crate) finish_requested: bool,
    pub(crate) version: i64,
    pub(crate) created_at: i64,
    pub(crate) started_at: Option<i64>,
    pub(crate) finished_at: Option<i64>,
    pub(crate) updated_at: i64,
    pub(crate) expires_at: Option<i64>,
    pub(crate) engine: Value,
    /// What the plan of the request warns of.
    pub(crate) plan_warnings: Vec<String>,
    /// What its request packs, in a few words.
    pub(crate) overview: Option<Overview>,
    pub(crate) progress: Option<Value>,
    pub(crate) error: Option<Failure>,
    pub(crate) artifact: Option<ArtifactRecord>,
    /// Its place in a study, if it is part of one.
    pub(crate) study: Option<StudyPlace>,
    /// A job that waits is not started before this.
    pub(crate) not_before: Option<i64>,
    /// Why it is not started before that.
    pub(crate) waits_for: Option<WaitReason>,
    /// Whose it is; empty where the server asked for no key.
    pub(crate) owner: String,
    /// Name of the API key that submitted it; empty where the server asked for none.
    pub(crate) submitted_by: String,
    /// Whether other owners may read it.
    pub(crate) shared: bool,
    /// Name of the process that runs it or ran it last; empty for the server itself.
    pub(crate) worker: String,
    /// How often it was requeued after faults of machines.
    pub(crate) faults: i64,
}

impl JobRecord {
    /// Whether the job has a result, or may still get one.
    pub(crate) fn has_or_may_have_result(&self) -> bool {
        !matches!(self.state, State::Failed | State::Cancelled) && !self.cancel_requested
    }

    /// Why there is no packing that the run could end with; `None` where there is one, or may be one.
    pub(crate) fn reached_nothing(&self) -> Option<&'static str> {
        let step = self.progress.as_ref().and_then(|progress| progress["step"].as_str());
        match self.state {
            State::Queued => Some("it waits and has no grains yet: cancel it, or ask again when it runs"),
            State::Running if self.cancel_requested => Some("it is being cancelled"),
            State::Running if step == Some("sampling") => {
                Some("it draws its grains and has placed none yet: ask again in a moment")
            }
            State::Running => None,
            State::Succeeded => Some("it has ended and has its result"),
            State::Failed | State::Cancelled => Some("it has ended, and nothing was kept"),
        }
    }

    /// What a user should know about the packing: what the result says, or the plan until there is a result.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let of_result =
            self.artifact.as_ref().and_then(|artifact| artifact.report.get("warnings")?.as_array());
        match of_result {
            Some(list) => list.iter().filter_map(Value::as_str).map(str::to_owned).collect(),
            None => self.plan_warnings.clone(),
        }
    }
}

/// Where a job stands in its study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StudyPlace {
    pub(crate) id: StudyId,
    /// Index of the point.
    pub(crate) point: u32,
    /// Index within the point.
    pub(crate) replicate: u32,
}

/// What clients want of a job that runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct StopRequests {
    /// The job is to end without a result.
    pub(crate) cancel: bool,
    /// The run is to end with the packing that it has reached.
    pub(crate) finish: bool,
}

/// The right to write about one attempt of one job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Lease {
    /// Number of the job in the store; 0 in a process without one.
    pub(crate) seq: i64,
    pub(crate) id: JobId,
    pub(crate) attempt: i64,
    /// Who else is told of what becomes of the job.
    pub(crate) study: Option<StudyId>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_states_read_back() {
        for state in State::ALL {
            assert_eq!(State::from_name(state.name()), Some(state));
            assert_eq!(serde_json::json!(state), state.name());
        }
        assert_eq!(State::from_name("Queued"), None);
    }
}
