//! A job as clients see it.

use std::collections::BTreeMap;

use axum::http::{StatusCode, header};
use axum::response::Response;
use serde::Serialize;
use serde_json::Value;

use crate::accounts::Caller;
use crate::base_path;
use crate::formats::ResultFormat;
use crate::http::app::App;
use crate::http::exports::view::ExportLink;
use crate::http::jobs::waits::{WaitView, waits_of};
use crate::http::response::{is_long, json, named, set, time};
use crate::http::waiting::Changing;
use crate::http::webhooks::WebhookView;
use crate::jobs::store::StoreError;
use crate::jobs::{ArtifactRecord, JobRecord, Overview, State};
use crate::plots::job::JobPlot;
use crate::problem::FailureDocument;

/// A job without its request, as listings show it.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct JobSummary {
    /// ID of the job (UUIDv7).
    #[cfg_attr(test, schema(format = "uuid"))]
    id: String,
    /// A name for people.
    #[cfg_attr(test, schema(required))]
    name: Option<String>,
    /// Keys and values to find the job by.
    labels: BTreeMap<String, String>,
    /// Where the job stands.
    state: State,
    /// A client wants the job to end.
    cancel_requested: bool,
    /// A client wants the run to end with the packing that it has reached.
    finish_requested: bool,
    /// The attempt that runs, ran last, or will run next.
    #[cfg_attr(test, schema(minimum = 1))]
    attempt: i64,
    /// The last attempt that may start.
    #[cfg_attr(test, schema(minimum = 1))]
    max_attempts: i64,
    /// Jobs of higher priority run first.
    #[cfg_attr(test, schema(minimum = -100, maximum = 100))]
    priority: i64,
    /// Most threads that compute the packing, as the request has it; `null` for those that the service has to spare.
    #[cfg_attr(test, schema(required, minimum = 1, maximum = 64))]
    threads: Option<u32>,
    /// Whose the job is: the owner of the API key that submitted it; `null` where the server asks for none.
    #[cfg_attr(test, schema(required))]
    owner: Option<String>,
    /// Name of the API key that submitted the job; `null` where the server asks for none.
    #[cfg_attr(test, schema(required))]
    submitted_by: Option<String>,
    /// Whether other users of the server may read the job and its result.
    shared: bool,
    /// Seed of the random generator.
    #[cfg_attr(test, schema(minimum = 0, maximum = 9_007_199_254_740_991_u64))]
    seed: i64,
    /// Longest time of an attempt.
    #[cfg_attr(test, schema(required))]
    timeout_s: Option<f64>,
    /// When the job was accepted (RFC 3339, UTC).
    #[cfg_attr(test, schema(format = DateTime))]
    created_at: String,
    /// When this attempt started.
    #[cfg_attr(test, schema(format = DateTime, required))]
    started_at: Option<String>,
    /// When the job ended.
    #[cfg_attr(test, schema(format = DateTime, required))]
    finished_at: Option<String>,
    /// When the job last changed.
    #[cfg_attr(test, schema(format = DateTime))]
    updated_at: String,
    /// Past this, the finished job is removed.
    #[cfg_attr(test, schema(format = DateTime, required))]
    expires_at: Option<String>,
    /// Why the queued job is not started, beside for want of a free worker; `null` where nothing else keeps it.
    #[cfg_attr(test, schema(required))]
    waiting: Option<WaitView>,
    /// How far the latest attempt is.
    #[cfg_attr(test, schema(value_type = Option<crate::jobs::JobProgress>, required))]
    progress: Option<Value>,
    /// Why the job failed.
    #[cfg_attr(test, schema(required))]
    error: Option<FailureDocument>,
    /// What came out.
    #[cfg_attr(test, schema(required))]
    result: Option<ResultView>,
    /// What a user should know about the packing, one sentence each: what the plan of the request says until there
    /// is a result, then what the result says. Empty where there is nothing.
    warnings: Vec<String>,
    /// What computes, or computed, the result.
    #[cfg_attr(test, schema(value_type = packstone_engine::export::tables::EngineInfo))]
    engine: Value,
    /// Name of the worker process that runs the job, or ran it last (`packstone worker`); `null` where that is the
    /// server itself, or the job waits.
    #[cfg_attr(test, schema(required))]
    worker: Option<String>,
    /// The study that the job is part of.
    #[cfg_attr(test, schema(format = "uuid", required))]
    study_id: Option<String>,
    /// Index of its point in the study, from 0.
    #[cfg_attr(test, schema(required, minimum = 0))]
    point: Option<u32>,
    /// Index of the job in its point, from 0.
    #[cfg_attr(test, schema(required, minimum = 0))]
    replicate: Option<u32>,
    /// What its request packs, in a few words; where `overview=true` asks for it.
    #[cfg_attr(test, schema(required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    overview: Option<Overview>,
    /// Addresses of what belongs to it.
    links: Links,
}

/// A job.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Job {
    #[serde(flatten)]
    summary: JobSummary,
    /// The exports that are kept with it: those of `postprocess`, and those that `POST /v1/jobs/{id}/exports/{type}`
    /// started.
    exports: Vec<ExportLink>,
    /// The message that is sent when the job ends, for its owner; absent where the job has no `webhook_url`.
    #[cfg_attr(test, schema(required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    webhook: Option<WebhookView>,
    /// The request as submitted, with its defaults filled in; in the answer to a submission, and where
    /// `include=request` asks for it.
    #[cfg_attr(test, schema(value_type = crate::jobs::JobRequest, required = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    request: Option<Value>,
}

/// The result of a job, without its grains.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = JobResult))]
pub(crate) struct ResultView {
    /// Formats in which it can be had.
    formats: Vec<ResultFormat>,
    /// Length of the stored form.
    bytes: u64,
    /// SHA-256 of the stored form, in hexadecimal.
    #[cfg_attr(test, schema(pattern = "^[0-9a-f]{64}$"))]
    sha256: String,
    /// The figures people ask for first.
    #[cfg_attr(test, schema(value_type = packstone_engine::packing::Summary))]
    summary: Value,
}

/// Addresses of what belongs to a job.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Links {
    /// The job itself.
    #[serde(rename = "self")]
    this: String,
    /// Its events.
    events: String,
    /// Its result.
    result: String,
    /// Its result without the spheres.
    summary: String,
    /// Its request.
    request: String,
    /// Its plots, by kind.
    plots: BTreeMap<&'static str, String>,
    /// Its exports.
    exports: String,
    /// Where to cancel it.
    cancel: String,
    /// Where to end its run with the packing that it has reached.
    finish: String,
    /// Where to retry it.
    retry: String,
}

impl JobSummary {
    /// The jobs as listings show them.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn of_all(app: &App, jobs: &[JobRecord]) -> Result<Vec<Self>, StoreError> {
        let waits = waits_of(app, jobs).await?;
        Ok(jobs.iter().zip(waits).map(|(job, waiting)| Self::of(job, waiting)).collect())
    }

    /// One job as listings show it.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn of_one(app: &App, job: &JobRecord) -> Result<Self, StoreError> {
        let waiting = waits_of(app, std::slice::from_ref(job)).await?.pop().flatten();
        Ok(Self::of(job, waiting))
    }

    /// Adds what its request packs.
    pub(crate) fn set_overview(&mut self, overview: Option<Overview>) {
        self.overview = overview;
    }

    fn of(job: &JobRecord, waiting: Option<WaitView>) -> Self {
        let this = path(job);
        Self {
            id: job.id.to_string(),
            name: job.name.clone(),
            labels: job.labels.clone(),
            state: job.state,
            cancel_requested: job.cancel_requested,
            finish_requested: job.finish_requested,
            attempt: job.attempt,
            max_attempts: job.max_attempts,
            priority: job.priority,
            threads: job.threads,
            owner: named(&job.owner),
            submitted_by: named(&job.submitted_by),
            shared: job.shared,
            seed: job.seed,
            timeout_s: job.timeout_s,
            created_at: time(job.created_at),
            started_at: job.started_at.map(time),
            finished_at: job.finished_at.map(time),
            updated_at: time(job.updated_at),
            expires_at: job.expires_at.map(time),
            waiting,
            progress: job.progress.clone(),
            error: job.error.as_ref().map(FailureDocument::from),
            result: job.artifact.as_ref().map(ResultView::of),
            warnings: job.warnings(),
            engine: job.engine.clone(),
            worker: if job.state == State::Queued { None } else { named(&job.worker) },
            study_id: job.study.map(|place| place.id.to_string()),
            point: job.study.map(|place| place.point),
            replicate: job.study.map(|place| place.replicate),
            overview: None,
            links: Links {
                events: format!("{this}/events"),
                result: format!("{this}/result"),
                summary: format!("{this}/result/summary"),
                request: format!("{this}/request"),
                plots: JobPlot::ALL
                    .iter()
                    .map(|kind| (kind.name(), format!("{this}/plots/{}", kind.name())))
                    .collect(),
                exports: format!("{this}/exports"),
                cancel: format!("{this}/cancel"),
                finish: format!("{this}/finish"),
                retry: format!("{this}/retry"),
                this,
            },
        }
    }
}

impl Job {
    /// Adds what its request packs.
    pub(crate) fn set_overview(&mut self, overview: Option<Overview>) {
        self.summary.set_overview(overview);
    }
}

impl ResultView {
    fn of(artifact: &ArtifactRecord) -> Self {
        Self {
            formats: ResultFormat::ALL.to_vec(),
            bytes: artifact.bytes,
            sha256: artifact.sha256.clone(),
            summary: artifact.report.get("summary").cloned().unwrap_or_default(),
        }
    }
}

/// The whole job as a caller sees it, read from a record and the request that the store keeps apart, if that is wanted.
pub(crate) async fn whole(
    app: &App,
    caller: &Caller,
    job: &JobRecord,
    with_request: bool,
) -> Result<Job, StoreError> {
    let store = &app.shared.store;
    let request = if with_request { Some(store.request(job.seq).await?) } else { None };
    let kept = if job.state == State::Succeeded { store.kept_of(job.seq).await? } else { Vec::new() };
    let exports = kept.iter().map(|(kind, options)| ExportLink::of(job.id, *kind, options)).collect();
    let webhook = WebhookView::of_job(app, caller, job).await?;
    Ok(Job { summary: JobSummary::of_one(app, job).await?, exports, webhook, request })
}

/// The job as a response with its tag, and a hint when to come back while it is not finished.
pub(crate) async fn response(app: &App, status: StatusCode, record: &JobRecord, job: Job) -> Response {
    let is_long = job.request.as_ref().is_some_and(is_long);
    let mut response = json(app, status, job, is_long).await;
    set(&mut response, header::ETAG, &record.etag());
    if !record.state.is_finished() {
        set(&mut response, header::RETRY_AFTER, "1");
    }
    response
}

impl Changing for JobRecord {
    /// It changes with everything that clients see.
    fn etag(&self) -> String {
        format!("\"{}\"", self.version)
    }

    fn is_finished(&self) -> bool {
        self.state.is_finished()
    }
}

/// The path of a job.
pub(crate) fn path(job: &JobRecord) -> String {
    base_path::absolute(&format!("/v1/jobs/{}", job.id))
}
