//! Models of a packing as formats of its result: `?format=` with options, and cuts by an address of their own.
//!
//! The file comes from the same place as everything that is export, where it is made if nobody has asked for it before;
//! who asks waits. However many ask for the same, it is made once.

use std::fs::File;
use std::io;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::response::Response;
use packstone_engine::export::slice;
use packstone_engine::export::{ExportRequest, ExportType};
use packstone_engine::request::Specimen;
use serde::Serialize;
use utoipa::ToSchema;

use crate::exports::{self, ExportRecord, ExportState, NewExport};
use crate::http::app::App;
use crate::http::conditional::Wait;
use crate::http::files::{self, Described};
use crate::http::params::{JobPath, Query};
use crate::http::problems::refused;
use crate::http::problems::sets::SliceProblems;
use crate::http::results::finished;
use crate::http::waiting;
use crate::jobs::store::{StoreError, Wish};
use crate::jobs::{JobId, JobRecord};
use crate::problem::{Kind, Problem};

/// How long an answer is held back while its file is made, if the request does not say.
const WAIT: Wait = Wait { s: 30 };
/// How often something is asked for anew that went away before it could be sent: dropped from the cache, or damaged on
/// the disk.
const TRIES: u32 = 3;

/// A format of results: of the grains themselves, or a model of the packing.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct ResultFormat(String);

/// Models that are a format of the result. Cuts are not: they have an address of their own, and several formats.
pub(crate) fn models() -> impl Iterator<Item = ExportType> {
    ExportType::ALL.into_iter().filter(|kind| *kind != ExportType::Slice)
}

/// The model that is a format of that name.
pub(crate) fn model(name: &str) -> Option<ExportType> {
    models().find(|kind| kind.name() == name)
}

/// Its media type, if no option changes it.
pub(crate) fn media_type(kind: ExportType) -> &'static str {
    let plain = ExportRequest::from_text(kind, []);
    plain.map_or("application/octet-stream", |export| export.media_type())
}

/// Options by name.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct FormatOptions(std::collections::BTreeMap<String, String>);

/// The result as a model of it.
pub(crate) async fn get(
    app: &App,
    id: JobId,
    kind: ExportType,
    mut query: Query,
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let _ = query.one("format");
    let options = query.rest();
    query.finish()?;
    respond(app, id, kind, &options, method, headers).await
}

/// Options as they are called in an address, and as the engine calls them.
const CALLED: [(&str, &str); 1] = [("at", "at_mm")];

async fn respond(
    app: &App,
    id: JobId,
    kind: ExportType,
    options: &[(String, String)],
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let short = |name: &str| CALLED.iter().find(|(short, _)| kind == ExportType::Slice && *short == name);
    let used: Vec<&str> = options.iter().map(|(name, _)| name.as_str()).collect();
    // Who said `at` is told of `at`.
    let called = |name: &str| {
        let called = CALLED.iter().find(|(short, whole)| *whole == name && used.contains(short));
        called.map_or(name, |(short, _)| short).to_owned()
    };
    let pairs = options
        .iter()
        .map(|(name, value)| (short(name).map_or(name.as_str(), |(_, whole)| whole), value.as_str()));
    let export = ExportRequest::from_text(kind, pairs)
        .map_err(|faults| Problem::fields(Kind::ValidationError, faults).of_parameters(called))?;
    let (job, result) = finished(app, id).await?;
    let new = NewExport::new(&export, &result.sha256);
    check(app, &job, &export, &new).await.map_err(|problem| problem.of_parameters(called))?;
    let described = described(export.media_type(), &new.key, &format!("{id}.{}", export.file_ending()));
    if let Some(response) = described.not_modified(headers) {
        return Ok(response);
    }
    let wait = Wait::of(headers).unwrap_or(WAIT);
    let (file, length) = made(app, &job, new, wait).await.map_err(|problem| problem.of_parameters(called))?;
    let part = described.part(method, headers, length)?;
    described.respond(part, |range| files::send_file(app, file, range)).await
}

/// How a file of that key is described.
pub(crate) fn described(media_type: &'static str, key: &str, filename: &str) -> Described {
    Described {
        etag: format!("\"{}\"", &key[..32.min(key.len())]),
        content_type: HeaderValue::from_static(media_type),
        filename: filename.to_owned(),
        inline: media_type.starts_with("image/"),
        negotiated: false,
    }
}

/// Refuses what cannot be made of such a specimen; what was taken in before need not be judged again.
pub(crate) async fn check(
    app: &App,
    job: &JobRecord,
    export: &ExportRequest,
    new: &NewExport,
) -> Result<(), Problem> {
    let store = &app.shared.store;
    if store.knows_export(job.seq, &new.key).await? {
        return Ok(());
    }
    let request = store.request(job.seq).await.map_err(|error| refused(error, job.id))?;
    let specimen = Specimen::from_json(&request["specimen"]).map_err(|faults| {
        tracing::error!(job_id = %job.id, ?faults, "the stored request is unreadable");
        Problem::internal()
    })?;
    Ok(export.check(&specimen, &app.shared.limits)?)
}

/// The file of something export and its length, once it is made.
async fn made(app: &App, job: &JobRecord, new: NewExport, wait: Wait) -> Result<(File, u64), Problem> {
    let store = &app.shared.store;
    for _ in 0..TRIES {
        let (asked, _) = store
            .request_export(job.id, new.clone(), Wish::Use)
            .await
            .map_err(|error| refused(error, job.id))?;
        let record = match until_finished(app, &asked, wait).await {
            Ok(record) => record,
            // Dropped before it was seen, or called off: if its job is there still, it can be had.
            Err(StoreError::NoExport) => continue,
            Err(error) => return Err(error.into()),
        };
        match record.state {
            ExportState::Succeeded => {}
            ExportState::Failed => return Err(exports::failure(&record)),
            ExportState::Queued | ExportState::Running => return Err(not_yet(&record)),
        }
        if let Some(found) = open(app, &record).await? {
            return Ok(found);
        }
    }
    Err(not_ready("it was dropped or damaged as often as it was made".into()))
}

/// Opens the file of something that was made; `None` where it is not what was stored, and is made again.
pub(crate) async fn open(app: &App, record: &ExportRecord) -> Result<Option<(File, u64)>, Problem> {
    let Some(stored) = record.file.clone() else {
        tracing::error!(export_id = %record.id, "something was made without a file");
        return Err(Problem::internal());
    };
    let artifacts = app.shared.artifacts.clone();
    let (path, length) = (stored.path.clone(), stored.bytes);
    let opened = tokio::task::spawn_blocking(move || artifacts.open_export(&stored)).await;
    match opened.unwrap_or_else(|error| Err(io::Error::other(error))) {
        Ok(file) => Ok(Some((file, length))),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::InvalidData) => {
            tracing::warn!(%error, path, export_id = %record.id, "a file is not what was stored; it is made again");
            app.shared.store.requeue_export(record.seq, path).await?;
            Ok(None)
        }
        Err(error) => {
            tracing::error!(%error, path, "a file cannot be read");
            Err(Problem::internal())
        }
    }
}

/// Waits until something export is finished, the time is over, or the server stops.
pub(crate) async fn until_finished(
    app: &App,
    of: &ExportRecord,
    wait: Wait,
) -> Result<ExportRecord, StoreError> {
    let (store, job, id) = (&app.shared.store, of.job, of.id);
    let read = move || async move { store.export(job, id).await?.ok_or(StoreError::NoExport) };
    waiting::wait_until(app, wait, store.subscribe_export(id), read, |record| record.state.is_finished())
        .await
}

fn not_yet(record: &ExportRecord) -> Problem {
    let done = record.progress.as_ref().and_then(|progress| progress["fraction"].as_f64());
    not_ready(match (record.state, done) {
        (ExportState::Running, Some(done)) => {
            format!("it is being made, {:.0} % of it are done", 100.0 * done)
        }
        (ExportState::Running, None) => "it is being made".into(),
        _ => "it waits to be made behind others".into(),
    })
}

fn not_ready(detail: String) -> Problem {
    Problem::new(Kind::FormatNotReady, detail).with_header("retry-after", "2")
}

/// A cut in JSON.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct SliceDocument {
    #[serde(flatten)]
    report: slice::SliceReport,
    circles: CircleTable,
}

/// The circles of a cut.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct CircleTable {
    /// Names of the columns.
    columns: [String; 6],
    /// One row a circle.
    rows: Vec<[f64; 6]>,
}

/// What a route for each form of a cut does; they differ in nothing but its name.
macro_rules! slices {
    ($($handler:ident $form:literal $path:literal $operation:literal $body:ty, $media_type:literal $title:literal)*) => {$(
        #[doc = $title]
        ///
        /// The plane `axis` = `at_mm` through the packing, its grains as circles, with their share of its area. Supports
        /// `Range`, `If-Range` and `If-None-Match` as results do; further options are those of the schema `ExportRequest`.
        #[utoipa::path(
            get, path = $path, tag = "results", operation_id = $operation,
            params(
                ("id" = String, Path, format = "uuid", description = "Name of the job"),
                ("axis" = Option<String>, Query, description = "Axis that the plane is normal to: `x`, `y` or `z`"),
                ("at_mm" = Option<f64>, Query, description = "Where the plane meets the axis; the middle of the specimen when absent"),
                ("at" = Option<f64>, Query, description = "The same as `at_mm`, for short"),
                ("options" = Option<FormatOptions>, Query, style = Form, explode, description = "Further options"),
                ("If-None-Match" = Option<String>, Header, description = "Tag of the cut as known"),
            ),
            responses(
                (status = 200, description = "The cut", content(($body = $media_type)),
                    headers(("ETag" = String, description = "Strong tag of the cut"))),
                (status = 206, description = "A part of it", content(($body = $media_type)),
                    headers(("Content-Range" = String, description = "Which part, and of how much"))),
                (status = 304, description = "The cut is as known"),
                SliceProblems
            )
        )]
        pub(crate) async fn $handler(
            State(app): State<App>,
            JobPath(id): JobPath,
            mut query: Query,
            method: Method,
            headers: HeaderMap,
        ) -> Result<Response, Problem> {
            let mut options = query.rest();
            options.push(("form".into(), $form.into()));
            respond(&app, id, ExportType::Slice, &options, &method, &headers).await
        }
    )*};
}

slices! {
    slice_svg "svg" "/v1/jobs/{id}/slice.svg" "get_slice_svg" String, "image/svg+xml" "Get a cut as a drawing"
    slice_png "png" "/v1/jobs/{id}/slice.png" "get_slice_png" Vec<u8>, "image/png" "Get a cut as a picture"
    slice_json "json" "/v1/jobs/{id}/slice.json" "get_slice_json" SliceDocument, "application/json" "Get the circles of a cut"
    slice_geo "geo" "/v1/jobs/{id}/slice.geo" "get_slice_geo" String, "text/plain" "Get a cut as a Gmsh script"
}
