//! Plots as SVG: of a job's result and of a study's table, by kind.
//!
//! A plot is a pure function of the result or the study's state, the request and this build's way of drawing,
//! and its strong tag names them. It is made when asked for, off the threads that answer, a few at a time.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::timeout;

use crate::http::app::App;
use crate::http::conditional;
use crate::http::params::{JobPath, Query, StudyPath};
use crate::http::problems::refused;
use crate::http::problems::sets::{PlotProblems, StudyPlotProblems};
use crate::http::response::set;
use crate::http::results::{blocking, finished};
use crate::jobs::store::StoreError;
use crate::plots::job::{self, JobPlot, JobResult};
use crate::plots::study::{self, RunCurve, StudyOptions, StudyPlot};
use crate::plots::{self, draw};
use crate::problem::{Fault, Kind, Problem};

/// How long a plot waits for another before it is refused.
const TURN: Duration = Duration::from_secs(10);

/// Get a plot of a result
///
/// An SVG for a page of print, 160 mm wide. `grading`: target and achieved grading curve; `distance`: distance
/// against packing time, where the largest distance was asked for; `radial`: pair correlation against the clear
/// distance between grains, by size class; `profile`: volume fraction against depth from the walls. Where there is
/// nothing to show, the picture says why.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/plot.svg", tag = "results", operation_id = "get_job_plot",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the job"),
        ("kind" = JobPlot, Query, description = "What is shown"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the plot as known"),
    ),
    responses(
        (status = 200, description = "The plot", content((String = "image/svg+xml")),
            headers(("ETag" = String, description = "Strong tag of the plot"))),
        (status = 304, description = "The plot is as known"),
        PlotProblems
    )
)]
pub(crate) async fn of_job(
    State(app): State<App>,
    JobPath(id): JobPath,
    mut query: Query,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let kind = query.choice("kind", JobPlot::from_name, &JobPlot::names());
    query.finish()?;
    // `finish` has refused a request without a kind.
    let kind = kind.ok_or_else(Problem::internal)?;
    let (_, artifact) = finished(&app, id).await?;
    let etag = format!(
        "\"{}-{}-{}\"",
        &artifact.sha256[..32.min(artifact.sha256.len())],
        kind.name(),
        draw::REVISION
    );
    if conditional::none_match_fails(&headers, &etag) {
        return Ok(not_modified(&etag));
    }
    let name = format!("{id}.{}.svg", kind.name());
    let permit = turn(&app).await?;
    let artifacts = app.shared.artifacts.clone();
    let drawn = blocking(id, move || {
        let stored = artifacts.read(&artifact)?;
        let chart = job::chart(kind, &JobResult { head: stored.head(), spheres: &stored })?;
        let drawn = draw::svg(&chart).map_err(std::io::Error::other)?;
        // Until the end of the work, whether or not somebody still waits for it.
        drop(permit);
        Ok(drawn)
    })
    .await?;
    Ok(svg(drawn, &etag, &name))
}

/// Get a plot of a study
///
/// An SVG for a page of print, 160 mm wide: a figure of the table against one of its columns, one series for each
/// combination of the other columns that vary. `success`: success rate with its 95 % interval; `time`: time of all runs per
/// success; `distance`: distance reached; `curve`: distance against packing time, for the first replicate of each point;
/// `volume_fraction`: volume fraction with the coating; `event_time`: time of the growth per event.
#[utoipa::path(
    get, path = "/v1/studies/{id}/plot.svg", tag = "studies", operation_id = "get_study_plot",
    params(
        ("id" = String, Path, format = "uuid", description = "Name of the study"),
        ("kind" = StudyPlot, Query, description = "What is shown"),
        ("x" = Option<String>, Query, example = "/mix/volume_fraction", description = "The abscissa: a column of the table that has numbers only, or `grains`. When absent the first such pointer, or `grains` where there is none and for `volume_fraction` and `event_time`. `curve` has none but the time"),
        ("log_x" = Option<bool>, Query, description = "Whether the abscissa is logarithmic; decided by its values when absent"),
        ("If-None-Match" = Option<String>, Header, description = "Tag of the plot as known"),
    ),
    responses(
        (status = 200, description = "The plot", content((String = "image/svg+xml")),
            headers(("ETag" = String, description = "Tag of the plot"))),
        (status = 304, description = "The plot is as known"),
        StudyPlotProblems
    )
)]
pub(crate) async fn of_study(
    State(app): State<App>,
    StudyPath(id): StudyPath,
    mut query: Query,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let kind = query.choice("kind", StudyPlot::from_name, &StudyPlot::names());
    let x = query.one("x");
    let log_x = query.optional_flag("log_x");
    query.finish()?;
    let kind = kind.ok_or_else(Problem::internal)?;
    let store = &app.shared.store;
    let record = store.study(id).await?.ok_or_else(|| refused(StoreError::NoStudy, id))?;
    // Read before its runs, as that of the table. The abscissa is part of the address.
    let etag = format!("\"{}-{}-{}\"", record.version, kind.name(), draw::REVISION);
    if conditional::none_match_fails(&headers, &etag) {
        return Ok(not_modified(&etag));
    }
    let permit = turn(&app).await?;
    let table = store.study_table(&record).await?;
    let reports = match kind {
        StudyPlot::Curve => store.study_reports(record.seq).await?,
        _ => std::collections::BTreeMap::new(),
    };
    let options = StudyOptions { x, log_x };
    let drawn = blocking(id, move || {
        let curves: Vec<RunCurve> =
            reports.iter().map(|(&point, report)| RunCurve::of_report(point, report)).collect();
        let chart = study::chart(kind, record.name.as_deref(), &table, &curves, &options);
        let drawn = chart.map(|chart| draw::svg(&chart).map_err(std::io::Error::other));
        drop(permit);
        match drawn {
            Ok(drawn) => drawn.map(Ok),
            Err(fault) => Ok(Err(fault)),
        }
    })
    .await?
    .map_err(|fault| Problem::parameters(vec![Fault::parameter("x", fault.to_string())]))?;
    Ok(svg(drawn, &etag, &format!("{id}.{}.svg", kind.name())))
}

/// Waits to be one of the few that draw.
async fn turn(app: &App) -> Result<OwnedSemaphorePermit, Problem> {
    match timeout(TURN, Arc::clone(&app.shared.plots).acquire_owned()).await {
        Ok(Ok(permit)) => Ok(permit),
        _ => Err(Problem::new(Kind::Busy, "as many plots are being drawn as this server draws at once")
            .with_header("retry-after", "10")),
    }
}

fn not_modified(etag: &str) -> Response {
    let mut response = StatusCode::NOT_MODIFIED.into_response();
    set(&mut response, header::ETAG, etag);
    response
}

/// The drawing as an answer.
fn svg(drawn: String, etag: &str, filename: &str) -> Response {
    let mut response = drawn.into_response();
    set(&mut response, header::ETAG, etag);
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(plots::MEDIA_TYPE));
    set(&mut response, header::CONTENT_DISPOSITION, &format!("inline; filename=\"{filename}\""));
    // A browser that opens it must not run what a viewer of pictures would not.
    let policy = "default-src 'none'; sandbox";
    set(&mut response, header::CONTENT_SECURITY_POLICY, policy);
    response
}
