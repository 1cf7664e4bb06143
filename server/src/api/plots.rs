//! Plots as SVG: of a job's result, by kind.
//!
//! A plot is a pure function of the result, the kind and this build's way of drawing, and its strong tag
//! names all three. It is made when asked for, off the threads that answer, a few at a time.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use tokio::time::timeout;

use super::App;
use super::conditional;
use super::job_view::set;
use super::openapi::PlotProblems;
use super::params::{JobPath, Query};
use super::results::{blocking, finished};
use crate::plots::job::{self, JobPlot, JobResult};
use crate::plots::{self, draw};
use crate::problem::{Kind, Problem};

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
pub(super) async fn of_job(
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
        let mut response = StatusCode::NOT_MODIFIED.into_response();
        set(&mut response, header::ETAG, &etag);
        return Ok(response);
    }
    let name = format!("{id}.{}.svg", kind.name());
    let turn = timeout(TURN, Arc::clone(&app.shared.plots).acquire_owned()).await;
    let Ok(Ok(permit)) = turn else {
        return Err(Problem::new(Kind::Busy, "as many plots are being drawn as this server draws at once")
            .with_header("retry-after", "10"));
    };
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

/// The drawing as an answer.
pub(super) fn svg(drawn: String, etag: &str, filename: &str) -> Response {
    let mut response = drawn.into_response();
    set(&mut response, header::ETAG, etag);
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(plots::MEDIA_TYPE));
    set(&mut response, header::CONTENT_DISPOSITION, &format!("inline; filename=\"{filename}\""));
    // A browser that opens it must not run what a viewer of pictures would not.
    let policy = "default-src 'none'; sandbox";
    set(&mut response, header::CONTENT_SECURITY_POLICY, policy);
    response
}
