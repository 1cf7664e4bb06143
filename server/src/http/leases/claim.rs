//! A worker asks for jobs.

use std::time::Duration;

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};
use tokio::sync::oneshot;
use tokio::time::{Instant, sleep_until};

use super::read;
use crate::accounts::Caller;
use crate::http::app::{App, SMALL_BODY_BYTES};
use crate::http::body;
use crate::http::conditional::Wait;
use crate::http::params::{NoParameters, Query};
use crate::http::response::{json, set};
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::jobs::store::{Claim, Claimed};
use crate::metrics::LeaseEvent;
use crate::problem::{Kind, Problem};
use crate::storage::Bound;
use crate::tasks;
use crate::workers::documents::{BUILD, LeaseDocument, LeaseRequest, LeasesDocument};

/// Lease jobs
///
/// For `packstone worker` of the same build, with a key of the role `worker`. With `Prefer: wait=N` the answer is held
/// back until a job waits. A lease ends by its result, by `/end`, or when it was not renewed for `lease_s`.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/leases", tag = "workers", operation_id = "lease_jobs",
    params(("Prefer" = Option<String>, Header, description = "`wait=N` holds the answer back for up to N seconds")),
    request_body = LeaseRequest,
    responses(
        (status = 200, description = "The jobs", body = LeasesDocument),
        (status = 204, description = "No job waits"),
        crate::http::problems::sets::LeaseProblems
    )
))]
pub(crate) async fn lease(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let request: LeaseRequest = read(&body::json_bytes(&app, &headers, body).await?)?;
    check_build(&app, &request).await?;
    let name = (caller.by.key.clone(), request.worker.clone());
    let _asking = app.shared.heard.asking(name, app.shared.store.lease());
    let asked = Instant::now();
    let remaining = request.remaining_s.map(Duration::from_secs_f64);
    let (worker, id, slots) = (request.worker, request.claim, request.slots);
    let claim = || {
        let remaining = remaining.map(|remaining| remaining.saturating_sub(asked.elapsed()));
        let (worker, id) = (worker.clone(), id.clone());
        Claim { worker, key: caller.by.key.clone(), id, slots, remaining }
    };
    let wait = Wait::of(&headers);
    let until = asked + wait.map(Wait::duration).unwrap_or_default();
    let mut claimed = claim_heard(&app, claim()).await?;
    while claimed.is_empty() && Instant::now() < until {
        tokio::select! {
            () = app.shared.store.queue_notified() => {}
            () = sleep_until(until) => {}
            () = app.shared.shutdown.cancelled() => break,
        }
        claimed = claim_heard(&app, claim()).await?;
    }
    let mut response = if claimed.is_empty() {
        StatusCode::NO_CONTENT.into_response()
    } else {
        app.shared.store.wake_next_worker();
        let is_long = claimed.iter().map(|claimed| claimed.request.len()).sum::<usize>() > SMALL_BODY_BYTES;
        let document = LeasesDocument { leases: documents(&app, &claimed).await? };
        json(&app, StatusCode::OK, document, is_long).await
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

/// Leases jobs, and gives them back where the client has hung up meanwhile.
async fn claim_heard(app: &App, claim: Claim) -> Result<Vec<Claimed>, Problem> {
    let store = app.shared.store.clone();
    let (sender, receiver) = oneshot::channel();
    tasks::spawn(async move {
        let Err(Ok(unheard)) = sender.send(store.claim_for(claim).await) else { return };
        for claimed in unheard {
            if let Err(error) = store.give_back(claimed.lease).await {
                tracing::warn!(%error, job_id = %claimed.lease.id, "a lease that nobody has will run out");
            }
        }
    });
    match receiver.await {
        Ok(claimed) => Ok(claimed?),
        Err(_) => Err(Problem::internal()),
    }
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
        let lease_s = app.shared.store.lease().as_secs_f64();
        let limits = app.shared.limits;
        let document = if claimed.request.len() > SMALL_BODY_BYTES {
            let claimed = claimed.clone();
            let read =
                move |_: &_| LeaseDocument::of(&claimed, lease_s, &limits, room, queued, has_checkpoint);
            app.shared.documents.run(read).await?
        } else {
            LeaseDocument::of(claimed, lease_s, &limits, room, queued, has_checkpoint)
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
