//! A worker renews its leases.

use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse as _, Response};
use futures_util::future::select_all;
use tokio::time::{interval, sleep};

use super::read;
use crate::accounts::Caller;
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::conditional::Wait;
use crate::http::jobs::polled::RECENT;
use crate::http::params::{NoParameters, Query};
use crate::http::response::set;
use crate::http::waiting::PREFERENCE_APPLIED;
use crate::ids::{ExportId, JobId, TaskId};
use crate::jobs::notifications::Subscription;
use crate::jobs::store::{Held, Renewal};
use crate::metrics::LeaseEvent;
use crate::problem::Problem;
use crate::workers::documents::{LeaseState, RenewalRequest, RenewalsDocument, RenewedDocument};

/// Time between two reports where a client watches one of the jobs, and between two looks whether one does.
const WATCHED_EVERY_S: f64 = 0.5;
/// Time between two reports where a client has asked for the state of one of the jobs lately.
const POLLED_EVERY_S: f64 = 1.0;

/// Longest body: 2048 renewals with the progress of their runs.
const MAX_BODY_BYTES: u64 = 4 << 20;

/// Renew leases
///
/// All leases of a process in one request, with the progress of the runs. With `Prefer: wait=N` the leases are renewed
/// at once, and the answer is held back until one of the jobs or exports changes, by a request to cancel for example,
/// or a client begins to watch one of them or asks for its state.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/leases/renewals", tag = "workers", operation_id = "renew_leases",
    params(("Prefer" = Option<String>, Header, description = "`wait=N` holds the answer back for up to N seconds")),
    request_body = RenewalRequest,
    responses(
        (status = 200, description = "What became of the leases", body = RenewalsDocument),
        crate::http::problems::sets::LeaseProblems
    )
))]
pub(crate) async fn renew(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let request: RenewalRequest = read(body.json(&app, MAX_BODY_BYTES).await?)?;
    // The answer may be held back.
    drop(body);
    let renewals: Vec<Renewal> = request.renewals.into_iter().map(Renewal::from).collect();
    let wait = Wait::of(&headers);
    let mut answer = renewed(&app, &caller, renewals.clone()).await?;
    let is_quiet = answer.leases.iter().all(|lease| lease.state == LeaseState::Running);
    if let Some(wait) =
        wait.filter(|_| is_quiet && answer.report_every_s > POLLED_EVERY_S && !renewals.is_empty())
    {
        let mut following: Vec<_> =
            renewals.iter().map(|renewal| app.shared.store.subscribe_task(renewal.id)).collect();
        // What changed between the renewal and the subscription is seen here.
        answer = look(&app, &caller, &renewals).await?;
        if answer.leases.iter().all(|lease| lease.state == LeaseState::Running) {
            let watched = async {
                let mut look_again = interval(Duration::from_secs_f64(WATCHED_EVERY_S));
                // One listener of each is this request.
                let is_unwatched = |id: TaskId| {
                    app.shared.store.watchers(id) <= 1 && !app.shared.polled.is_recent(id.job(), RECENT)
                };
                while renewals.iter().all(|renewal| is_unwatched(renewal.id)) {
                    look_again.tick().await;
                }
            };
            tokio::select! {
                () = watched => {}
                _ = select_all(following.iter_mut().map(|changes| Box::pin(changed(changes)))) => {}
                // Not so long that the next renewal would be late.
                () = sleep(wait.duration().min(app.shared.store.renew_every())) => {}
                () = app.shared.shutdown.cancelled() => {}
            }
            drop(following);
            answer = look(&app, &caller, &renewals).await?;
        }
    }
    let mut response = axum::Json(answer).into_response();
    if let Some(wait) = wait {
        set(&mut response, PREFERENCE_APPLIED, &wait.applied());
    }
    Ok(response)
}

/// Waits for a change of a job or an export.
async fn changed((job, export): &mut (Subscription<JobId>, Subscription<ExportId>)) {
    tokio::select! {
        () = job.changed() => {}
        () = export.changed() => {}
    }
}

async fn renewed(app: &App, caller: &Caller, renewals: Vec<Renewal>) -> Result<RenewalsDocument, Problem> {
    let leases: Vec<_> = renewals.iter().map(|renewal| (renewal.id, renewal.attempt)).collect();
    let held = app.shared.store.renew(caller.by.key.clone(), renewals).await?;
    for (held, (task, attempt)) in held.iter().zip(&leases) {
        if *held != Held::Lost {
            app.shared.metrics.lease(LeaseEvent::Renewed, 1);
        } else if app.shared.store.held(&caller.by.key, *task, *attempt).await? == Held::Lost {
            // Not a renewal that met the end of its own attempt.
            app.shared.metrics.lease(LeaseEvent::Refused, 1);
        }
    }
    let states = held.into_iter().map(LeaseState::from);
    let leases = leases.into_iter().zip(states).map(|((task, attempt), state)| RenewedDocument {
        task,
        attempt,
        state,
    });
    Ok(document(app, leases.collect()))
}

/// What has become of the leases, without a renewal.
async fn look(app: &App, caller: &Caller, renewals: &[Renewal]) -> Result<RenewalsDocument, Problem> {
    let mut leases = Vec::with_capacity(renewals.len());
    for Renewal { id, attempt, .. } in renewals {
        let state = app.shared.store.held(&caller.by.key, *id, *attempt).await?.into();
        leases.push(RenewedDocument { task: *id, attempt: *attempt, state });
    }
    Ok(document(app, leases))
}

fn document(app: &App, leases: Vec<RenewedDocument>) -> RenewalsDocument {
    let is_watched = leases.iter().any(|lease| app.shared.store.watchers(lease.task) > 0);
    let is_polled = || leases.iter().any(|lease| app.shared.polled.is_recent(lease.task.job(), RECENT));
    let unwatched_s = app.shared.store.renew_every().as_secs_f64();
    let report_every_s = if is_watched {
        WATCHED_EVERY_S.min(unwatched_s)
    } else if is_polled() {
        POLLED_EVERY_S.min(unwatched_s)
    } else {
        unwatched_s
    };
    RenewalsDocument { leases, report_every_s }
}
