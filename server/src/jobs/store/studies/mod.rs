//! Studies in the store.
//!
//! A study's counts, its end and the runs that ended without a word follow its jobs by trigger, so that no
//! move of a job can forget them; what a run found out is recorded in the transaction that ends it
//! ([`runs`]). Jobs of a study are jobs as any other, but that they leave with it.

mod actions;
#[cfg(test)]
mod actions_tests;
pub(super) mod properties;
mod query;
pub(super) mod runs;
mod submit;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use serde::Serialize;

use super::db::Row;
use super::{StoreError, rows};
use crate::ids::StudyId;
use crate::studies::StopWhen;

pub(crate) use query::StudyFilter;
pub(crate) use submit::{NewStudy, SubmittedStudy};

/// Whether any job of a study is left to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StudyState {
    Open,
    Finished,
}

impl StudyState {
    /// All states.
    pub(crate) const ALL: [Self; 2] = [Self::Open, Self::Finished];

    /// Name in the interface.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Finished => "finished",
        }
    }
}

/// How many jobs of a study are in each state, those that were deleted included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct StudyCounts {
    pub(crate) queued: u64,
    pub(crate) running: u64,
    pub(crate) succeeded: u64,
    pub(crate) failed: u64,
    pub(crate) cancelled: u64,
}

impl StudyCounts {
    /// Jobs that nothing but a client will move on.
    pub(crate) fn finished(&self) -> u64 {
        self.succeeded + self.failed + self.cancelled
    }
}

/// A study as the store keeps it, but for its request and points. Times are microseconds since the Unix epoch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StudyRecord {
    pub(crate) seq: i64,
    pub(crate) id: StudyId,
    pub(crate) name: Option<String>,
    pub(crate) labels: BTreeMap<String, String>,
    pub(crate) seed: i64,
    pub(crate) columns: Vec<String>,
    /// Names of the first columns of its table.
    pub(crate) key_columns: Vec<String>,
    pub(crate) points: u32,
    pub(crate) replicates: u32,
    pub(crate) stop_when: StopWhen,
    pub(crate) counts: StudyCounts,
    /// Runs that say something about their mix, and the time they took.
    pub(crate) runs: u64,
    pub(crate) runs_time_s: f64,
    pub(crate) version: i64,
    pub(crate) created_at: i64,
    pub(crate) finished_at: Option<i64>,
    pub(crate) updated_at: i64,
    pub(crate) expires_at: Option<i64>,
    /// Whose it is; empty where the server asked for no key.
    pub(crate) owner: String,
    /// Name of the API key that submitted it; empty where the server asked for none.
    pub(crate) submitted_by: String,
    /// Whether other owners may read it with its jobs.
    pub(crate) shared: bool,
}

/// A warning of the plans of a study.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StudyWarning {
    /// The warning, as `POST /v1/plans` gives it.
    pub(crate) detail: String,
    /// Number of points that it is about.
    pub(crate) points: u64,
    /// The first of these points, counted from 0 in the order of the request.
    pub(crate) point: u64,
}

impl StudyRecord {
    /// How many jobs there are, or were.
    pub(crate) fn jobs(&self) -> u64 {
        u64::from(self.points) * u64::from(self.replicates)
    }

    /// Whether any job is left to run.
    pub(crate) fn state(&self) -> StudyState {
        if self.finished_at.is_none() { StudyState::Open } else { StudyState::Finished }
    }

    pub(super) fn read(row: &Row) -> Result<Self, StoreError> {
        rows::check_whole(row, "is_whole")?;
        let count = |column| row.try_get::<i64>(column).map(|count| count as u64);
        Ok(Self {
            seq: row.try_get("seq")?,
            id: rows::study_id(row.text("id")?)?,
            name: row.try_get("name")?,
            labels: rows::json(row.text("labels")?)?,
            seed: row.try_get("seed")?,
            columns: rows::json(row.text("columns")?)?,
            key_columns: rows::json(row.text("key_columns")?)?,
            points: row.try_get("points")?,
            replicates: row.try_get("replicates")?,
            stop_when: rows::json(row.text("stop_when")?)?,
            counts: StudyCounts {
                queued: count("queued")?,
                running: count("running")?,
                succeeded: count("succeeded")?,
                failed: count("failed")?,
                cancelled: count("cancelled")?,
            },
            runs: count("runs")?,
            runs_time_s: row.try_get("runs_time_s")?,
            version: row.try_get("version")?,
            created_at: row.try_get("created_at")?,
            finished_at: row.try_get("finished_at")?,
            updated_at: row.try_get("updated_at")?,
            expires_at: row.try_get("expires_at")?,
            owner: row.try_get("owner")?,
            submitted_by: row.try_get("submitted_by")?,
            shared: row.try_get("shared")?,
        })
    }
}
