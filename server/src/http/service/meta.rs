//! What the service says about itself: what it can do, how it is, what it counted, its interface.

use std::collections::{BTreeMap, BTreeSet};

use axum::extract::State;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse as _, Response};
use packstone_engine::export::ExportType;
use packstone_engine::export::tables::EngineInfo;
use packstone_engine::request::ShapePreset;
use packstone_engine::request::standard::{self, StandardGrading};
use packstone_engine::request::{Grading, MAX_LENGTH_MM, MAX_SEED, MIN_LENGTH_MM, PlainShape, Standard};
use serde::Serialize;

use crate::exports;
use crate::formats::ResultFormat;
use crate::http::app::App;
use crate::http::conditional::MAX_WAIT_S;
use crate::http::exports::media::media_type;
use crate::http::params::{NoParameters, Query};
use crate::jobs::request;
use crate::jobs::store::StoredKind;
use crate::metrics::Gauges;
use crate::problem::{Kind, Problem};
use crate::studies;
use crate::tasks;

/// What this server can do, and how much of it.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Capabilities {
    /// Version of the service.
    version: &'static str,
    /// What computes packings.
    engine: EngineInfo,
    /// Specimens.
    specimens: Vec<&'static str>,
    /// Gradings of a mix.
    gradings: Vec<&'static str>,
    /// Gradings of standards.
    standard_gradings: Vec<StandardInfo>,
    /// Rules for the distance between grains.
    distances: Vec<&'static str>,
    /// Shapes of grains.
    shapes: Vec<&'static str>,
    /// Shapes of grains by name, with their sources.
    shape_presets: Vec<PresetInfo>,
    /// Methods.
    methods: Vec<&'static str>,
    /// Formats of results.
    formats: Vec<FormatInfo>,
    /// Exports of results: their types, formats and options.
    exports: Vec<ExportInfo>,
    /// Whether jobs and studies may have a `webhook_url`.
    webhooks: bool,
    /// Bounds.
    limits: LimitsInfo,
}

/// A grading of a standard.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StandardInfo {
    /// The standard.
    standard: Standard,
    /// Its name in the standard.
    name: &'static str,
    /// `[sieve in mm, least and largest mass fraction passing]`, from fine to coarse; the same twice where the grading
    /// is one curve.
    limits: Vec<[f64; 3]>,
}

impl StandardInfo {
    fn of(grading: &StandardGrading) -> Self {
        let fraction = |percent: u8| f64::from(percent) / 100.0;
        let limits = grading.limits.iter().map(|&(mm, low, high)| [mm, fraction(low), fraction(high)]);
        Self { standard: grading.standard, name: grading.name, limits: limits.collect() }
    }
}

/// A shape of grains that a name stands for.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct PresetInfo {
    /// Its name.
    name: &'static str,
    /// What it is.
    about: &'static str,
    /// The publication that it is from.
    source: &'static str,
    /// DOI of the publication, where it has one.
    #[cfg_attr(test, schema(required))]
    doi: Option<&'static str>,
    /// The shape, as requests and results have it.
    shape: PlainShape,
}

impl PresetInfo {
    fn of(preset: &ShapePreset) -> Self {
        let ShapePreset { name, about, source, doi, .. } = *preset;
        Self { name, about, source, doi, shape: preset.shape() }
    }
}

/// A format of results.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct FormatInfo {
    /// Its name in `?format=`.
    name: ResultFormat,
    /// Its media type in `Accept`.
    media_type: &'static str,
}

/// A type of exports.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ExportInfo {
    /// Its name in addresses and in `postprocess`.
    r#type: ExportType,
    /// Its file formats, the default first.
    formats: Vec<ExportFormatInfo>,
}

/// A file format of an export.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ExportFormatInfo {
    /// Its name in `?format=`.
    name: &'static str,
    /// Media type of the file, if no option changes it.
    media_type: &'static str,
    /// Names of its options; their meaning and bounds are those of the schema `ExportRequest`.
    options: Vec<&'static str>,
    /// Programs that the option `for` may name; empty where the format has no such option.
    programs: Vec<&'static str>,
    /// Whether `for` must name one: the format is written for that program alone.
    needs_program: bool,
}

impl ExportInfo {
    fn of(kind: ExportType) -> Self {
        let format = |name: &'static str| ExportFormatInfo {
            name,
            media_type: media_type(kind, name),
            options: kind.option_names(name),
            programs: kind.programs(name),
            needs_program: kind.needed_program(name).is_some(),
        };
        Self { r#type: kind, formats: kind.formats().iter().map(|name| format(name)).collect() }
    }
}

/// Bounds of this server.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct LimitsInfo {
    /// Most grains of a packing.
    max_grains: u64,
    /// Most memory of a packing.
    max_memory_bytes: u64,
    /// Most memory of an export, and longest file of one.
    max_model_bytes: u64,
    /// Shortest length of a grain, a sieve or a specimen.
    min_length_mm: f64,
    /// Longest length in a request.
    max_length_mm: f64,
    /// Largest seed.
    max_seed: u64,
    /// Longest body of a request.
    max_body_bytes: u64,
    /// Most jobs that wait.
    max_queued: u64,
    /// Longest time of a run in s, whatever `timeout_s` of the job allows; `null` where there is none.
    #[cfg_attr(test, schema(required))]
    max_run_s: Option<f64>,
    /// Days after which finished jobs and studies without `expires_at` are removed; `null` where they stay.
    #[cfg_attr(test, schema(required))]
    expire_after_days: Option<f64>,
    /// Jobs that run at once, of which one with several threads counts as so many.
    workers: usize,
    /// Most attempts of a job.
    max_attempts: i64,
    /// Priorities lie between this and its negative.
    max_priority: i64,
    /// Most threads that a job may ask for.
    max_threads: i64,
    /// Longest time of an attempt.
    max_timeout_s: f64,
    /// Longest name of a job, in characters.
    max_name_chars: usize,
    /// Most labels of a job.
    max_labels: usize,
    /// Most jobs of a study.
    max_study_jobs: usize,
    /// Longest `Prefer: wait`.
    max_wait_s: u64,
    /// Most results being sent at once.
    max_downloads: usize,
    /// Most exports in `postprocess`.
    max_postprocess: usize,
    /// Most exports that are kept with one job.
    max_kept_exports: u64,
    /// Bytes of exports that nobody asked to be kept.
    export_cache_bytes: u64,
}

/// What this server can do
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/capabilities", tag = "service", operation_id = "get_capabilities",
    responses(
        (status = 200, description = "What this server can do", body = Capabilities),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn capabilities(
    State(app): State<App>,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let shared = &app.shared;
    let capabilities = Capabilities {
        version: env!("CARGO_PKG_VERSION"),
        engine: EngineInfo::current(),
        specimens: vec!["box", "cylinder"],
        gradings: Grading::types().collect(),
        standard_gradings: standard::GRADINGS.iter().map(StandardInfo::of).collect(),
        distances: vec!["none", "constant", "proportional", "smaller_diameter", "maximize"],
        shapes: vec!["sphere", "ellipsoid", "polyhedron", "preset", "mixture"],
        shape_presets: ShapePreset::ALL.iter().map(PresetInfo::of).collect(),
        methods: vec!["auto", "rsa", "growth", "edmd", "monte_carlo"],
        formats: ResultFormat::ALL
            .into_iter()
            .map(|format| FormatInfo { name: format, media_type: format.media_type() })
            .collect(),
        exports: ExportType::ALL.iter().map(|&kind| ExportInfo::of(kind)).collect(),
        webhooks: shared.webhook_rules.enabled(),
        limits: LimitsInfo {
            max_grains: shared.limits.max_grains,
            max_memory_bytes: shared.limits.max_memory_bytes,
            max_model_bytes: shared.limits.max_model_bytes,
            min_length_mm: MIN_LENGTH_MM,
            max_length_mm: MAX_LENGTH_MM,
            max_seed: MAX_SEED,
            max_body_bytes: shared.max_body_bytes,
            max_queued: shared.max_queued,
            max_run_s: shared.max_run_s,
            expire_after_days: shared.expire_after_days,
            workers: shared.workers,
            max_attempts: request::MAX_ATTEMPTS,
            max_priority: request::MAX_PRIORITY,
            max_threads: request::MAX_THREADS,
            max_timeout_s: request::MAX_TIMEOUT_S,
            max_name_chars: request::MAX_NAME_CHARS,
            max_labels: request::MAX_LABELS,
            max_study_jobs: studies::MAX_JOBS,
            max_wait_s: MAX_WAIT_S,
            max_downloads: shared.max_downloads,
            max_postprocess: exports::MAX_POSTPROCESS,
            max_kept_exports: exports::MAX_KEPT,
            export_cache_bytes: shared.export_cache_bytes,
        },
    };
    Ok(axum::Json(capabilities).into_response())
}

/// How the service is.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Health {
    /// `ok`.
    status: &'static str,
}

/// Whether the process works
///
/// It fails only where the database cannot be opened any more, does not answer for a minute, or is another one than at
/// the start, so that a restart is the only help.
#[cfg_attr(test, utoipa::path(
    get, path = "/healthz", tag = "service", operation_id = "get_health",
    responses(
        (status = 200, description = "It works", body = Health),
        crate::http::problems::sets::ReadyProblems
    )
))]
pub(crate) async fn health(State(app): State<App>) -> Result<Response, Problem> {
    if app.shared.store.is_lost() {
        let detail = "the database cannot be opened any more; the server has to be restarted";
        return Err(Problem::new(Kind::NotReady, detail).with_header("retry-after", "5"));
    }
    Ok(axum::Json(Health { status: "ok" }).into_response())
}

/// Whether the service takes jobs, and what is wrong nevertheless.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Readiness {
    /// `ready`.
    status: &'static str,
    /// What an operator has to mend although jobs are taken; empty where all is well.
    details: Vec<ReadinessDetail>,
}

/// Something that an operator has to mend.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ReadinessDetail {
    /// Part of the service: `api_keys` or `webhook_secrets`.
    part: &'static str,
    /// What is wrong; the log says more.
    detail: &'static str,
}

impl ReadinessDetail {
    /// All that is wrong now. It holds no names and paths: probes have no key.
    fn all(app: &App) -> Vec<Self> {
        let keys = app.shared.accounts.is_keys_file_faulty().then_some(Self {
            part: "api_keys",
            detail: "the file of API keys has changed and cannot be used: the keys read before stay in force; the \
                     server's log says why",
        });
        let secrets = app.shared.webhook_secrets.as_ref().is_some_and(|secrets| secrets.is_faulty());
        let secrets = secrets.then_some(Self {
            part: "webhook_secrets",
            detail: "the file of webhook secrets has changed and cannot be used: the secrets read before stay in \
                     force; the server's log says why",
        });
        keys.into_iter().chain(secrets).collect()
    }
}

/// Whether the service takes jobs
///
/// False while it starts or stops, and while it cannot write to its data directory: while less space is free than must
/// stay free, and after a write failed on a full disk until a write succeeds. False too while the store does not
/// answer, is damaged or cannot be written, and once its files or its database were moved, removed or replaced.
/// `details` names what is wrong although jobs are taken, as a file of API keys that cannot be read again.
#[cfg_attr(test, utoipa::path(
    get, path = "/readyz", tag = "service", operation_id = "get_readiness",
    responses(
        (status = 200, description = "It takes jobs", body = Readiness),
        crate::http::problems::sets::ReadyProblems
    )
))]
pub(crate) async fn ready(State(app): State<App>) -> Result<Response, Problem> {
    let not_ready = |why: &str| Problem::new(Kind::NotReady, why).with_header("retry-after", "1");
    if !app.is_ready() {
        return Err(not_ready("the server is starting or stopping"));
    }
    app.shared.store.usable().map_err(|why| not_ready(&why.to_string()))?;
    let disk = &app.shared.disk;
    match disk.space() {
        Ok(space) if space.free < disk.min_free_bytes(space) => {
            let (free, least) = (space.free, disk.min_free_bytes(space));
            return Err(not_ready(&format!(
                "{free} bytes are free in the data directory, fewer than the {least} that must stay free"
            )));
        }
        Ok(_) => {}
        Err(error) => tracing::warn!(%error, "the free space of the data directory is not known"),
    }
    if let Some(trouble) = app.shared.artifacts.trouble() {
        return Err(not_ready(&trouble));
    }
    let trial = disk.clone();
    if tasks::blocking(move || trial.is_short()).await.unwrap_or(true) {
        return Err(not_ready("a write failed because the disk is full, and it is still full"));
    }
    app.shared.store.works().await.map_err(|why| {
        tracing::error!(%why, "the store cannot be used");
        not_ready(&why.to_string())
    })?;
    Ok(axum::Json(Readiness { status: "ready", details: ReadinessDetail::all(&app) }).into_response())
}

/// Seconds since the newest checkpoint was written.
async fn newest_checkpoint(app: &App) -> Option<f64> {
    let checkpoints = app.shared.checkpoints.clone();
    let kept = tasks::blocking(move || checkpoints.kept()).await.ok()?.ok()?;
    let newest = kept.iter().map(|kept| kept.at_us).max()?;
    Some((jiff::Timestamp::now().as_microsecond() - newest).max(0) as f64 / 1e6)
}

/// Counters in the text form of Prometheus
#[cfg_attr(test, utoipa::path(
    get, path = "/metrics", tag = "service", operation_id = "get_metrics",
    responses(
        (status = 200, description = "The counters", body = String, content_type = "text/plain"),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn metrics(State(app): State<App>) -> Result<Response, Problem> {
    let shared = &app.shared;
    let export = shared.store.export_counts().await?;
    let mut stored: BTreeMap<&'static str, u64> =
        StoredKind::ALL.iter().map(|kind| (kind.name(), 0)).collect();
    for ((_, kind), bytes) in shared.store.stored_bytes().await? {
        *stored.entry(kind.name()).or_default() += bytes;
    }
    let faulty = shared.store.faulty_workers().await?;
    let running = shared.store.processes().await?;
    let mut heard: BTreeSet<_> = shared.heard.within(shared.store.lease()).into_keys().collect();
    heard
        .extend(running.iter().filter(|process| process.is_heard).map(|p| (p.key.clone(), p.worker.clone())));
    let gauges = Gauges {
        running_elsewhere: running.iter().map(|process| process.jobs).sum(),
        worker_processes: heard.len(),
        export: export.states,
        export_cache_bytes: export.cache_bytes,
        jobs: shared.store.counts().await?,
        work: shared.store.forecast_work().await?,
        open_studies: shared.store.open_studies().await?,
        workers: shared.workers,
        busy_slots: shared.slots.busy(),
        connections: shared.max_connections.saturating_sub(shared.connections.available_permits()),
        stored_bytes: stored,
        disk: shared.disk.space().ok().map(|space| (space.free, shared.disk.min_free_bytes(space))),
        store_faults: shared.store.faults(),
        queue_age_s: shared.store.queue_age().await?.as_secs_f64(),
        checkpoint_age_s: newest_checkpoint(&app).await,
        unchecked: shared.store.unchecked().await?,
        blocked_workers: faulty.iter().filter(|worker| worker.is_blocked()).count(),
        webhooks_waiting: shared.store.waiting_deliveries().await?,
        results_being_sent: shared.max_downloads.saturating_sub(shared.downloads.free()),
    };
    let mut response = shared.metrics.render(&gauges).into_response();
    let text = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
    response.headers_mut().insert(header::CONTENT_TYPE, text);
    Ok(response)
}
