//! Leases of workers in other processes: `packstone worker` asks for jobs, renews its leases, and sends what came out.
//!
//! These routes are for workers of the same build and for nobody else. Job and attempt name a lease; every request may
//! be repeated.

pub(crate) mod checkpoint;
pub(crate) mod claim;
pub(crate) mod end;
pub(crate) mod export;
pub(crate) mod renew;
pub(crate) mod result;
mod upload;

use std::time::Duration;

use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use jiff::Timestamp;
use serde::Serialize;
use serde_json::Value;
#[cfg(test)]
use utoipa::IntoParams;
#[cfg(test)]
use utoipa::openapi::path::{Parameter, ParameterIn};

use crate::exports::ExportLease;
use crate::failure::Failure;
use crate::http::app::App;
#[cfg(test)]
use crate::http::params::described::{path_parameter, uuid_schema};
use crate::http::params::paths::segments;
use crate::ids::TaskId;
use crate::jobs::Lease;
use crate::jobs::store::{Held, StoreError};
use crate::metrics::LeaseEvent;
use crate::problem::{Kind, Problem};
use crate::tasks;
use crate::workers::documents::Checked;

/// The lease that a path names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LeasePath {
    pub(crate) id: TaskId,
    pub(crate) attempt: i64,
}

impl<S: Send + Sync> FromRequestParts<S> for LeasePath {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let found: Option<(String, String)> = segments(parts, state).await;
        let read = found.and_then(|(task, attempt)| {
            Some(Self { id: TaskId::parse(&task)?, attempt: attempt.parse().ok()? })
        });
        read.ok_or_else(|| {
            Problem::new(Kind::NotFound, "a lease is named by the ID of a job or an export and an attempt")
        })
    }
}

#[cfg(test)]
impl IntoParams for LeasePath {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        use utoipa::openapi::schema::{Object, ObjectBuilder, Type};
        let attempt: Object = ObjectBuilder::new().schema_type(Type::Integer).minimum(Some(1)).build();
        vec![
            path_parameter("task", uuid_schema(), "ID of the job or the export"),
            path_parameter("attempt", attempt, "Number of the attempt"),
        ]
    }
}

/// That the end of an attempt is recorded.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct LeaseEnded {
    /// Always `recorded`.
    state: &'static str,
}

/// The answer to the end of an attempt, repeated or not.
pub(super) fn recorded() -> axum::Json<LeaseEnded> {
    axum::Json(LeaseEnded { state: "recorded" })
}

/// The lease of a key on a job, if its attempt runs; `None` where the attempt has ended already.
///
/// # Errors
/// `lease-lost`, also where it is one on an export, or the store's.
pub(super) async fn running(app: &App, key: &str, path: LeasePath) -> Result<Option<Lease>, Problem> {
    match app.shared.store.held(key, path.id, path.attempt).await? {
        Held::Running { lease, .. } => Ok(Some(lease)),
        Held::Ended => Ok(None),
        Held::RunningExport(_) | Held::Lost => Err(refused(app, StoreError::LeaseLost)),
    }
}

/// The same of an export.
///
/// # Errors
/// `lease-lost`, also where it is one on a job, or the store's.
pub(super) async fn making(app: &App, key: &str, path: LeasePath) -> Result<Option<ExportLease>, Problem> {
    match app.shared.store.held(key, path.id, path.attempt).await? {
        Held::RunningExport(lease) => Ok(Some(lease)),
        Held::Ended => Ok(None),
        Held::Running { .. } | Held::Lost => Err(refused(app, StoreError::LeaseLost)),
    }
}

/// Makes sure that an attempt of a job or an export runs, and is the key's.
///
/// # Errors
/// `lease-lost`, or the store's.
pub(super) async fn holds(app: &App, key: &str, path: LeasePath) -> Result<(), Problem> {
    match app.shared.store.held(key, path.id, path.attempt).await? {
        Held::Running { .. } | Held::RunningExport(_) => Ok(()),
        Held::Ended => Err(lost()),
        Held::Lost => Err(refused(app, StoreError::LeaseLost)),
    }
}

/// The lease is not that of the key any more.
pub(super) fn lost() -> Problem {
    Problem::new(Kind::LeaseLost, "the lease was lost: the job or the export is another attempt's, or gone")
}

/// What the store says of a lease.
pub(super) fn refused(app: &App, error: StoreError) -> Problem {
    match error {
        StoreError::LeaseLost => {
            app.shared.metrics.lease(LeaseEvent::Refused, 1);
            lost()
        }
        other => other.into(),
    }
}

/// Reads a document of a worker.
///
/// # Errors
/// `malformed-json` or `validation-error`.
pub(crate) fn read<T: Checked>(value: Value) -> Result<T, Problem> {
    Ok(T::read(value).map_err(Failure::invalid)?)
}

/// Tells log and metrics of the end of an attempt that started at a time in microseconds since the Unix epoch.
pub(super) fn note_end(app: &App, path: LeasePath, outcome: &'static str, started_at: Option<i64>) {
    let now = Timestamp::now().as_microsecond();
    let took = Duration::from_micros(started_at.map_or(0, |at| (now - at).max(0)).unsigned_abs());
    let (LeasePath { id, attempt }, took_s) = (path, took.as_secs_f64());
    tracing::info!(job_id = %id, attempt, outcome, took_s, "a lease ended");
    app.shared.metrics.job_ended(outcome, took);
}

/// Removes the checkpoints of a job or an export that has ended, behind the answer's back.
pub(super) fn remove_checkpoints(app: &App, path: LeasePath) {
    let checkpoints = app.shared.checkpoints.clone();
    tasks::blocking(move || checkpoints.remove(&path.id.to_string(), path.attempt));
}
