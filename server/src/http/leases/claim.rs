//! A worker asks for jobs.

use std::time::Duration;

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use http_body_util::BodyExt as _;
use hyper::body::Body as _;
use tokio::sync::oneshot;
use tokio::time::{Instant, sleep_until};

use super::read;
use crate::accounts::Caller;
use crate::gmsh;
use crate::http::app::{App, SMALL_BODY_BYTES};
use crate::http::body::RequestBody;
use crate::http::conditional::Wait;
use crate::http::params::{NoParameters, Query};
use crate::http::response::{json, set};
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::jobs::store::{Claim, Claimed, ClaimedExport, LEAST_TIME, Store, StoreError, WakeUp, WorkUntil};
use crate::metrics::LeaseEvent;
use crate::problem::{Kind, Problem};
use crate::storage::Bound;
use crate::tasks;
use crate::workers::documents::{BUILD, LeaseDocument, LeaseRequest, LeasesDocument};
use crate::workers::leased_export::ExportLeaseDocument;

/// Longest body: a few short names and numbers.
const MAX_BODY_BYTES: u64 = 16 << 10;

/// Lease jobs, or an export
///
/// For `packstone worker` of the same build, with a key of the role `worker`. With `Prefer: wait=N` the answer is held
/// back until a job waits, or an export that takes as long and that the request of a job asked for: of these one at a
/// time is leased, before jobs, first of all one of a job that the process has packed, and one that needs Gmsh where
/// the process states the same `mesher` as the server has, or the server has none. A lease ends by its result, by
/// `/end`, or when it was not renewed for `lease_s`. With no
/// `slots` the answer has only jobs that an earlier request of the same `claim` has leased, whose answer was not read,
/// and is not held back.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/leases", tag = "workers", operation_id = "lease_jobs",
    params(("Prefer" = Option<String>, Header, description = "`wait=N` holds the answer back for up to N seconds")),
    request_body = LeaseRequest,
    responses(
        (status = 200, description = "The jobs, or the export", body = LeasesDocument),
        (status = 204, description = "Neither waits"),
        crate::http::problems::sets::LeaseProblems
    )
))]
pub(crate) async fn lease(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let request: LeaseRequest = read(body.json(&app, MAX_BODY_BYTES).await?)?;
    // The answer may be held back.
    drop(body);
    check_build(&app, &request).await?;
    let can_mesh = can_mesh(request.mesher.as_deref()).await;
    let name = (caller.by.key.clone(), request.worker.clone());
    let _asking = app.shared.heard.asking(name, can_mesh, app.shared.store.lease());
    let asked = Instant::now();
    let remaining = request.remaining_s.map(Duration::from_secs_f64);
    let (worker, id, slots) = (request.worker, request.claim, request.slots);
    let claim = || {
        let remaining = remaining.map(|remaining| remaining.saturating_sub(asked.elapsed()));
        let (worker, id) = (worker.clone(), id.clone());
        Claim { worker, key: caller.by.key.clone(), id, slots, remaining, can_mesh }
    };
    let wait = Wait::of(&headers);
    let until = asked + wait.map(Wait::duration).unwrap_or_default();
    let work_until = remaining.map_or(WorkUntil::Unlimited, |remaining| WorkUntil::Moment(asked + remaining));
    let store = &app.shared.store;
    let mut mark = store.queue_mark();
    let mut claimed = claim_heard(&app, claim()).await?;
    // Who takes no other job does not wait for one: a wake-up would be lost on it.
    while claimed.is_empty() && slots > 0 && Instant::now() < until {
        let wake_up = tokio::select! {
            wake_up = store.queue_notified(mark, work_until) => Some(wake_up),
            () = sleep_until(until) => None,
            () = app.shared.shutdown.cancelled() => break,
        };
        mark = store.queue_mark();
        // The wake-up of a worker that is blocked meanwhile, or has hung up, passes to the next.
        claimed = claim_heard(&app, claim()).await?;
        wake_up.into_iter().for_each(WakeUp::end);
    }
    let mut response = if claimed.is_empty() {
        StatusCode::NO_CONTENT.into_response()
    } else {
        store.wake_next_worker();
        let is_long =
            claimed.claimed.iter().map(|claimed| claimed.request.len()).sum::<usize>() > SMALL_BODY_BYTES;
        let leases = documents(&app, &claimed.claimed).await?;
        let exports = match &claimed.export {
            Some(export) => vec![export_document(&app, export).await],
            None => Vec::new(),
        };
        let document = LeasesDocument { leases, exports };
        claimed.until_taken(json(&app, StatusCode::OK, document, is_long).await)
    };
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}

/// Refuses a worker that could compute other bits or write other forms.
async fn check_build(app: &App, request: &LeaseRequest) -> Result<(), Problem> {
    let refused = |detail: String| {
        app.shared.metrics.worker_refused();
        Err(Problem::new(Kind::WorkerRefused, detail))
    };
    if request.build != BUILD {
        let found: String = request.build.chars().take(100).collect();
        return refused(format!("the worker is packstone {found}: must be {BUILD}, as the server is"));
    }
    let bits = app.bits().await.ok_or_else(Problem::internal)?;
    if request.bits != bits {
        let found: String = request.bits.chars().take(64).collect();
        return refused(format!("the worker packs other bits ({found:?}) than the server ({bits:?})"));
    }
    Ok(())
}

/// Whether a worker with that Gmsh makes exports that need it: where this server has the same, whose version decides
/// the key of an export, or none.
async fn can_mesh(of_worker: Option<&str>) -> bool {
    let Some(of_worker) = of_worker else { return false };
    gmsh::is_elsewhere();
    let own = tasks::blocking(gmsh::version).await.unwrap_or_default();
    own.is_none_or(|own| own == of_worker)
}

/// Jobs, or an export, that are leased to a worker which has not got the answer. Dropped, they return to the queue at
/// once.
struct Unanswered {
    store: Store,
    claimed: Vec<Claimed>,
    export: Option<ClaimedExport>,
}

impl Unanswered {
    fn is_empty(&self) -> bool {
        self.claimed.is_empty() && self.export.is_none()
    }

    /// The answer with these jobs. They return to the queue where the connection closes before the answer is taken from
    /// here.
    fn until_taken(self, answer: Response) -> Response {
        if !answer.status().is_success() {
            return answer;
        }
        let (mut head, body) = answer.into_parts();
        if let Some(length) = body.size_hint().exact() {
            head.headers.insert(header::CONTENT_LENGTH, length.into());
        }
        let mut unanswered = self;
        let body = body.map_frame(move |frame| {
            unanswered.claimed.clear();
            unanswered.export = None;
            frame
        });
        Response::from_parts(head, Body::new(body))
    }
}

impl Drop for Unanswered {
    fn drop(&mut self) {
        let (claimed, export) = (std::mem::take(&mut self.claimed), self.export.take());
        if claimed.is_empty() && export.is_none() {
            return;
        }
        let store = self.store.clone();
        tasks::spawn(async move {
            if let Some(ClaimedExport { export, .. }) = export {
                match store.export_requeued(&export).await {
                    Ok(()) => {
                        tracing::info!(export_id = %export.id, "a worker hung up before it got the export: requeued");
                    }
                    Err(StoreError::LeaseLost) => {}
                    Err(error) => {
                        tracing::warn!(%error, export_id = %export.id, "a lease that nobody has will run out");
                    }
                }
            }
            for Claimed { lease, .. } in claimed {
                match store.give_back(lease).await {
                    Ok(()) => {
                        tracing::info!(job_id = %lease.id, "a worker hung up before it got the job: requeued");
                    }
                    Err(StoreError::LeaseLost) => {}
                    Err(error) => {
                        tracing::warn!(%error, job_id = %lease.id, "a lease that nobody has will run out");
                    }
                }
            }
        });
    }
}

/// Leases an export or jobs, and gives them back where the client has hung up meanwhile.
async fn claim_heard(app: &App, claim: Claim) -> Result<Unanswered, Problem> {
    let store = app.shared.store.clone();
    let (sender, receiver) = oneshot::channel();
    tasks::spawn(async move {
        let claimed = claim_any(&store, claim).await;
        // Where nobody receives them, they are dropped.
        let _ = sender.send(claimed.map(|(claimed, export)| Unanswered { store, claimed, export }));
    });
    match receiver.await {
        Ok(claimed) => Ok(claimed?),
        Err(_) => Err(Problem::internal()),
    }
}

/// Leases an export for the slots of packings, else jobs.
async fn claim_any(store: &Store, claim: Claim) -> Result<(Vec<Claimed>, Option<ClaimedExport>), StoreError> {
    // An export that a process cannot end in its time begins anew elsewhere.
    if claim.remaining.is_none_or(|remaining| remaining >= LEAST_TIME)
        && let Some(export) = store.claim_export_for(claim.clone()).await?
    {
        return Ok((Vec::new(), Some(export)));
    }
    Ok((store.claim_for(claim).await?, None))
}

async fn export_document(app: &App, claimed: &ClaimedExport) -> ExportLeaseDocument {
    let shared = &app.shared;
    // A store that cannot tell may have as many as there are slots.
    let queued = shared.store.queued().await.unwrap_or(u64::MAX);
    let export = &claimed.export;
    let room = shared.storage.room(&export.owner).await.unwrap_or((u64::MAX, Bound::Disk));
    shared.metrics.lease(LeaseEvent::Taken, 1);
    tracing::info!(export_id = %export.id, attempt = export.attempt, worker = export.worker, "leased");
    ExportLeaseDocument::of(claimed, shared.store.lease().as_secs_f64(), &shared.limits, room, queued)
}

/// Whether an attempt before has left a checkpoint.
async fn has_checkpoint(app: &App, id: String) -> bool {
    let checkpoints = app.shared.checkpoints.clone();
    tasks::blocking(move || checkpoints.newest(&id).is_some()).await.unwrap_or(false)
}

async fn documents(app: &App, claimed: &[Claimed]) -> Result<Vec<LeaseDocument>, Problem> {
    let mut documents = Vec::with_capacity(claimed.len());
    // A store that cannot tell may have as many as there are slots.
    let queued = app.shared.store.queued().await.unwrap_or(u64::MAX);
    for claimed in claimed {
        let room = app.shared.storage.room(&claimed.job.owner).await.unwrap_or((u64::MAX, Bound::Disk));
        let id = claimed.lease.id.to_string();
        let has_checkpoint = claimed.lease.attempt > 1 && has_checkpoint(app, id.clone()).await;
        let times = (app.shared.store.lease().as_secs_f64(), app.shared.max_run_s);
        let limits = app.shared.limits;
        let document = if claimed.request.len() > SMALL_BODY_BYTES {
            let claimed = claimed.clone();
            let read = move |_: &_| LeaseDocument::of(&claimed, times, &limits, room, queued, has_checkpoint);
            app.shared.documents.run(read).await?
        } else {
            LeaseDocument::of(claimed, times, &limits, room, queued, has_checkpoint)
        };
        documents.push(document.map_err(|error| {
            tracing::error!(%error, job_id = id, "the stored request is unreadable");
            Problem::internal()
        })?);
        app.shared.metrics.lease(LeaseEvent::Taken, 1);
        tracing::info!(job_id = id, attempt = claimed.lease.attempt, worker = claimed.job.worker, "leased");
    }
    Ok(documents)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::accounts::Submitter;
    use crate::jobs::store::{NewJob, StoreLimits, Submitted};
    use crate::jobs::{JobId, JobRequest, State};

    /// A store with a job that a worker has leased.
    async fn leased(folder: &std::path::Path) -> (Store, JobId, Unanswered) {
        let limits = StoreLimits { max_queued: 10, lease: Duration::from_mins(1) };
        let database = folder.join("packstone.sqlite").as_path().into();
        let store = Store::open(&database, folder, limits, std::sync::Arc::default()).await.unwrap();
        let request = json!({
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        });
        let new = NewJob {
            request: JobRequest::read(&request, 1, None).unwrap(),
            warnings: Vec::new(),
            forecast_s: 1.0,
            keeps_checkpoints: true,
            most_threads: 1,
            by: Submitter::default(),
            idempotency_key: None,
        };
        let Submitted::Created(job) = store.submit(new).await.unwrap() else { panic!("a job without a key") };
        let (worker, key, id) = ("w".to_owned(), String::new(), "c".to_owned());
        let claim = Claim { worker, key, id, slots: 1, remaining: None, can_mesh: false };
        let claimed = store.claim_for(claim).await.unwrap();
        assert_eq!(claimed[0].job.id, job.id);
        (store.clone(), job.id, Unanswered { store, claimed, export: None })
    }

    async fn state(store: &Store, id: JobId) -> State {
        store.get(id).await.unwrap().unwrap().state
    }

    #[tokio::test]
    async fn a_job_whose_answer_nobody_takes_returns_to_the_queue() {
        let folder = tempfile::tempdir().unwrap();
        let (store, id, unanswered) = leased(folder.path()).await;
        let mut changes = store.subscribe(id);
        let answer = unanswered.until_taken("the leases".into_response());
        assert_eq!(state(&store, id).await, State::Running);
        drop(answer);
        changes.changed().await;
        assert_eq!(state(&store, id).await, State::Queued);
    }

    #[tokio::test]
    async fn a_job_whose_answer_was_taken_stays_with_its_worker() {
        let folder = tempfile::tempdir().unwrap();
        let (store, id, unanswered) = leased(folder.path()).await;
        let answer = unanswered.until_taken("the leases".into_response());
        let bytes = answer.into_body().collect().await.unwrap().to_bytes();
        assert_eq!(&bytes[..], b"the leases");
        // Whatever the drop of the body has begun is before this in the queue of the writer.
        store.works().await.unwrap();
        assert_eq!(state(&store, id).await, State::Running);
    }
}
