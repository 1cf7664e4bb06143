//! A study as clients see it.

use std::collections::BTreeMap;

use axum::http::{StatusCode, header};
use axum::response::Response;
use serde::Serialize;
use serde_json::Value;

use crate::accounts::Caller;
use crate::base_path;
use crate::http::app::App;
use crate::http::response::{SHORT_LIST, is_long, json, named, set, time};
use crate::http::waiting::Changing;
use crate::http::webhooks::WebhookView;
use crate::ids::StudyId;
use crate::jobs::store::{StoreError, StudyCounts, StudyRecord, StudyState, StudyWarning};
use crate::plots::study::StudyPlot;
use crate::studies::StopWhen;

/// Different lists of warnings of the points of a study that are shown.
const MAX_WARNINGS: u32 = 100;

/// A study without its request, as listings show it.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StudySummary {
    /// ID of the study (UUIDv7).
    #[cfg_attr(test, schema(format = "uuid"))]
    id: String,
    /// A name for people.
    #[cfg_attr(test, schema(required))]
    name: Option<String>,
    /// Keys and values to find the study by.
    labels: BTreeMap<String, String>,
    /// Whose the study is: the owner of the API key that submitted it; `null` where the server asks for none.
    #[cfg_attr(test, schema(required))]
    owner: Option<String>,
    /// Name of the API key that submitted the study; `null` where the server asks for none.
    #[cfg_attr(test, schema(required))]
    submitted_by: Option<String>,
    /// Whether other users of the server may read the study with its jobs.
    shared: bool,
    /// What the seeds of its jobs derive from.
    #[cfg_attr(test, schema(minimum = 0, maximum = 9_007_199_254_740_991_u64))]
    seed: i64,
    /// When the study was accepted (RFC 3339, UTC).
    #[cfg_attr(test, schema(format = DateTime))]
    created_at: String,
    /// When its last job ended; `null` while any is left to run.
    #[cfg_attr(test, schema(format = DateTime, required))]
    finished_at: Option<String>,
    /// When one of its jobs last moved.
    #[cfg_attr(test, schema(format = DateTime))]
    updated_at: String,
    /// Past this, the finished study is removed with its jobs: the latest `expires_at` of these, if all have one.
    #[cfg_attr(test, schema(format = DateTime, required))]
    expires_at: Option<String>,
    /// Mixes and methods.
    #[cfg_attr(test, schema(minimum = 1))]
    points: u32,
    /// Jobs of every point.
    #[cfg_attr(test, schema(minimum = 1))]
    replicates: u32,
    /// Jobs in all: `points` times `replicates`.
    #[cfg_attr(test, schema(minimum = 1, maximum = 10_000))]
    jobs: u64,
    /// How many jobs are in each state. A job that is deleted stays counted.
    counts: CountsView,
    /// How far the study is.
    progress: StudyProgress,
    /// When a point needs no more runs.
    stop_when: StopWhen,
    /// JSON pointers into the job that distinguish the points; empty for a list.
    columns: Vec<String>,
    /// Where to go from here.
    links: Links,
}

/// A study.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Study {
    #[serde(flatten)]
    summary: StudySummary,
    /// The request as submitted, with its seed; in the answer to a submission, and where `include=request` asks for it.
    #[cfg_attr(test, schema(value_type = crate::studies::Study, required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    request: Option<Value>,
    /// The message that is sent when the study is finished, for its owner; absent where the study has no `webhook_url`.
    #[cfg_attr(test, schema(required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    webhook: Option<WebhookView>,
    /// What is likely to go wrong, by the plans of its points: each text once, by the first point that it is about.
    /// Points whose plans have the same warnings are counted together; at most 100 such sets of points are looked at.
    warnings: Vec<StudyWarning>,
}

/// Jobs by state.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = StudyCounts))]
pub(crate) struct CountsView {
    queued: u64,
    /// Up to two for each worker: while it stores the result of one job, it packs the next.
    running: u64,
    succeeded: u64,
    failed: u64,
    cancelled: u64,
}

/// How far a study is.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StudyProgress {
    /// Share of the jobs that are finished, in whatever way.
    #[cfg_attr(test, schema(minimum = 0, maximum = 1))]
    fraction: f64,
    /// Finished jobs.
    done: u64,
    /// All jobs.
    total: u64,
    /// Seconds that the rest is likely to take if the study has all workers for itself, as of `updated_at`: as long
    /// as the runs so far took on average. `null` while nothing can be said.
    #[cfg_attr(test, schema(required))]
    eta_s: Option<f64>,
}

/// Addresses of what belongs to a study.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = StudyLinks))]
pub(crate) struct Links {
    /// The study itself.
    #[serde(rename = "self")]
    this: String,
    /// Its jobs.
    jobs: String,
    /// What its runs came to.
    table: String,
    /// Plots of that, by kind.
    plots: BTreeMap<&'static str, String>,
    /// Where to cancel it.
    cancel: String,
    /// Where to retry what failed.
    retry: String,
}

impl StudySummary {
    pub(crate) fn of(app: &App, study: &StudyRecord) -> Self {
        let this = path(study.id);
        let StudyCounts { queued, running, succeeded, failed, cancelled } = study.counts;
        Self {
            id: study.id.to_string(),
            name: study.name.clone(),
            labels: study.labels.clone(),
            owner: named(&study.owner),
            submitted_by: named(&study.submitted_by),
            shared: study.shared,
            seed: study.seed,
            created_at: time(study.created_at),
            finished_at: study.finished_at.map(time),
            updated_at: time(study.updated_at),
            expires_at: study.expires_at.map(time),
            points: study.points,
            replicates: study.replicates,
            jobs: study.jobs(),
            counts: CountsView { queued, running, succeeded, failed, cancelled },
            progress: StudyProgress::of(study, app.shared.workers),
            stop_when: study.stop_when,
            columns: study.columns.clone(),
            links: Links {
                jobs: format!("{this}/jobs"),
                table: format!("{this}/table"),
                plots: StudyPlot::ALL
                    .iter()
                    .map(|kind| (kind.name(), format!("{this}/plots/{}", kind.name())))
                    .collect(),
                cancel: format!("{this}/cancel"),
                retry: format!("{this}/retry"),
                this,
            },
        }
    }
}

impl StudyProgress {
    fn of(study: &StudyRecord, workers: usize) -> Self {
        let (done, total) = (study.counts.finished(), study.jobs());
        let open = total.saturating_sub(done);
        let eta_s = match (open, study.runs, workers) {
            (0, _, _) => Some(0.0),
            (_, 0, _) | (_, _, 0) => None,
            // The last jobs do not share all workers.
            (open, runs, workers) => {
                Some(study.runs_time_s / runs as f64 * open as f64 / (workers as f64).min(open as f64))
            }
        };
        Self { fraction: done as f64 / total.max(1) as f64, done, total, eta_s }
    }
}

/// The study as a caller sees it, as a response with its tag, and a hint when to come back while it is not finished.
/// The store keeps the request apart: it is read where it is wanted.
pub(crate) async fn response(
    app: &App,
    caller: &Caller,
    status: StatusCode,
    record: &StudyRecord,
    with_request: bool,
) -> Result<Response, StoreError> {
    let store = &app.shared.store;
    let request = if with_request { Some(store.study_request(record.seq).await?) } else { None };
    let warnings = store.study_warnings(record.seq, MAX_WARNINGS).await?;
    let webhook = WebhookView::of_study(app, caller, record).await?;
    let study = Study { summary: StudySummary::of(app, record), request, webhook, warnings };
    let is_long = study.request.as_ref().is_some_and(is_long) || study.warnings.len() > SHORT_LIST;
    let mut response = json(app, status, study, is_long).await;
    set(&mut response, header::ETAG, &record.etag());
    if record.state() == StudyState::Open {
        set(&mut response, header::RETRY_AFTER, "1");
    }
    Ok(response)
}

impl Changing for StudyRecord {
    /// It changes with everything that clients see.
    fn etag(&self) -> String {
        format!("\"{}\"", self.version)
    }

    fn is_finished(&self) -> bool {
        self.state() == StudyState::Finished
    }
}

/// The path of a study.
pub(crate) fn path(id: StudyId) -> String {
    base_path::absolute(&format!("/v1/studies/{id}"))
}
