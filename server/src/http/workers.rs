//! Worker processes that have sent wrong results, and their return to work.

use axum::extract::State;
use axum::response::{IntoResponse as _, Response};
use packstone_engine::FieldError;
use serde::{Deserialize, Serialize};

use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::leases::read;
use crate::http::params::{NoParameters, Query};
use crate::http::response::{named, time};
use crate::jobs::store::FaultyWorker;
use crate::problem::{Kind, Problem};
use crate::workers::documents::Checked;

/// Longest body of a request that allows a worker again: two names.
const MAX_BODY_BYTES: u64 = 4 << 10;

/// The worker processes that have sent wrong results.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct FaultyWorkers {
    /// The latest first. One is forgotten when an administrator allows it again.
    items: Vec<FaultyWorkerView>,
}

/// A worker process that has sent wrong results.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct FaultyWorkerView {
    /// Name of its API key; `null` where the server asks for none.
    #[cfg_attr(test, schema(required))]
    key: Option<String>,
    /// Name of the process, the field `worker` of its jobs.
    worker: String,
    /// Wrong results since it was last allowed.
    #[cfg_attr(test, schema(minimum = 1))]
    wrong_results: i64,
    /// It gets no job: it has sent three wrong results.
    blocked: bool,
    /// When the last wrong result came.
    #[cfg_attr(test, schema(format = DateTime))]
    last_at: String,
    /// ID of the job of the last wrong result.
    #[cfg_attr(test, schema(format = "uuid"))]
    last_job: String,
    /// What was wrong with it.
    last_fault: String,
}

impl FaultyWorkerView {
    fn of(worker: FaultyWorker) -> Self {
        Self {
            blocked: worker.is_blocked(),
            key: named(&worker.key),
            worker: worker.worker,
            wrong_results: worker.wrong_results,
            last_at: time(worker.last_at),
            last_job: worker.last_job,
            last_fault: worker.last_fault,
        }
    }
}

/// A worker process that may work again.
#[derive(Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct AllowRequest {
    /// Name of its API key; `null` or absent where the server asks for none.
    #[cfg_attr(test, schema(required = false))]
    #[serde(default)]
    key: Option<String>,
    /// Name of the process.
    worker: String,
}

impl Checked for AllowRequest {
    fn faults(&self) -> Vec<FieldError> {
        Vec::new()
    }
}

/// List worker processes that have sent wrong results
///
/// The server checks what worker processes send. After three wrong results it gives a process no job until an
/// administrator allows it again.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/workers", tag = "workers", operation_id = "list_faulty_workers",
    responses(
        (status = 200, description = "The worker processes", body = FaultyWorkers),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn list(State(app): State<App>, _: Query<NoParameters>) -> Result<Response, Problem> {
    let faulty = app.shared.store.faulty_workers().await?;
    let items = faulty.into_iter().map(FaultyWorkerView::of).collect();
    Ok(axum::Json(FaultyWorkers { items }).into_response())
}

/// Allow a worker process to work again
///
/// Its wrong results are forgotten, and it gets jobs again.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/workers/allow", tag = "workers", operation_id = "allow_worker",
    request_body = AllowRequest,
    responses(
        (status = 200, description = "The worker processes that are left", body = FaultyWorkers),
        crate::http::problems::sets::AllowProblems
    )
))]
pub(crate) async fn allow(
    State(app): State<App>,
    query: Query<NoParameters>,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let request: AllowRequest = read(body.json(&app, MAX_BODY_BYTES).await?)?;
    let AllowRequest { key, worker } = request;
    let forgotten = app.shared.store.allow_worker(key.unwrap_or_default(), worker.clone()).await?;
    if forgotten == 0 {
        let shown: String = worker.chars().take(100).collect();
        let detail = format!("no worker {shown:?} of this key has sent wrong results");
        return Err(Problem::new(Kind::NotFound, detail));
    }
    tracing::warn!(worker, wrong_results = forgotten, "an administrator has allowed a worker again");
    list(State(app), query).await
}
