//! Why queued jobs wait that no worker may start now.

use std::collections::HashMap;

use serde::Serialize;

use crate::http::app::App;
use crate::http::response::time;
use crate::jobs::store::StoreError;
use crate::jobs::waiting::WaitsFor;
use crate::jobs::{JobRecord, State, WaitReason};

/// Why a queued job waits, beside for a free worker.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = JobWait))]
pub(crate) struct WaitView {
    /// What the job waits for.
    #[serde(rename = "for")]
    waits_for: WaitsFor,
    /// One sentence for a person.
    detail: String,
    /// When it is tried again at the latest; `null` where that is not known.
    #[cfg_attr(test, schema(format = DateTime, required))]
    until: Option<String>,
}

/// Why each of the jobs waits; `None` for those that no bound keeps from being started.
///
/// # Errors
/// The database's.
pub(crate) async fn waits_of(app: &App, jobs: &[JobRecord]) -> Result<Vec<Option<WaitView>>, StoreError> {
    let now_us = jiff::Timestamp::now().as_microsecond();
    let mut quotas: HashMap<&str, Option<WaitReason>> = HashMap::new();
    let mut waits = Vec::with_capacity(jobs.len());
    for job in jobs {
        if job.state != State::Queued {
            waits.push(None);
            continue;
        }
        let paused = job.not_before.filter(|until| *until > now_us).zip(job.waits_for.as_ref());
        if let Some((until, why)) = paused {
            waits.push(Some(WaitView::of(why, Some(time(until)))));
            continue;
        }
        if !quotas.contains_key(job.owner.as_str()) {
            quotas.insert(&job.owner, running_quota(app, &job.owner).await?);
        }
        let reached = quotas.get(job.owner.as_str()).and_then(Option::as_ref);
        waits.push(reached.map(|why| WaitView::of(why, None)));
    }
    Ok(waits)
}

/// The bound of an owner's running jobs, where it is reached.
async fn running_quota(app: &App, owner: &str) -> Result<Option<WaitReason>, StoreError> {
    let Some(most) = app.shared.accounts.quotas(owner).running else { return Ok(None) };
    let running = app.shared.store.usage_of(owner).await?.running;
    Ok((running >= most).then(|| WaitReason::running_quota(running, most)))
}

impl WaitView {
    fn of(why: &WaitReason, until: Option<String>) -> Self {
        Self { waits_for: why.waits_for, detail: why.detail.clone(), until }
    }
}
