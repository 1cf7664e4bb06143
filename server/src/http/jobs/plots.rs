//! Plots of a job's result, as SVG.
//!
//! A plot is a pure function of the result, the kind and this build's way of drawing, and its strong tag names them. It
//! is drawn when it is asked for, off the threads that answer, a few at a time.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;

use crate::http::app::App;
use crate::http::conditional;
use crate::http::drawing::{PlotOptions, not_drawn, not_modified, svg, turn};
use crate::http::files::FileName;
use crate::http::params::{PlotPath, Query};
use crate::http::results::{blocking, finished};
use crate::plots::draw;
use crate::plots::job::{self as job_plots, JobPlot, JobResult};
use crate::plots::theme::themed;
use crate::problem::Problem;

/// Get a plot of a result
///
/// An SVG for print, 160 mm wide. `grading`: target and achieved grading curve; `distance`: distance against packing
/// time, for grains that were grown with a constant or the largest distance; `radial`: pair correlation function
/// against the gap between grains, by size class; `profile`: volume fraction against depth from the walls; `zingg`:
/// elongation against flatness of grains that are no spheres; `flakiness`: their share of flaky mass by particle size
/// fraction of EN 933-3; `quality`: whether the packing is random, by volumes near the walls, near pairs and bond
/// order. A plot for which the packing has no data is refused with the reason.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/plots/{kind}", tag = "results", operation_id = "get_job_plot",
    params(
        PlotPath<JobPlot>,
        PlotOptions,
        ("If-None-Match" = Option<String>, Header, description = "Tag of the plot as known"),
    ),
    responses(
        (status = 200, description = "The plot", content((String = "image/svg+xml")),
            headers(("ETag" = String, description = "Strong tag of the plot"))),
        (status = 304, description = "The plot is as known"),
        crate::http::problems::sets::PlotProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    PlotPath { id, kind }: PlotPath<JobPlot>,
    Query(query): Query<PlotOptions>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (heading, theme) = (query.title.get(), query.theme.0);
    let (job, artifact) = finished(&app, id).await?;
    // The heading and the theme are part of the address.
    let etag = format!(
        "\"{}-{}-{}\"",
        &artifact.sha256[..32.min(artifact.sha256.len())],
        kind.name(),
        draw::REVISION
    );
    if conditional::none_match_fails(&headers, &etag) {
        return Ok(not_modified(&etag));
    }
    let name = FileName::of(&job, &format!("{}.svg", kind.name()));
    let permit = turn(&app).await?;
    let artifacts = app.shared.artifacts.clone();
    let drawn = blocking(id, move || {
        let stored = artifacts.read(&artifact)?;
        let chart = job_plots::chart(kind, &JobResult { head: stored.head(), grains: &stored })?;
        let drawn = draw::svg(&chart, heading).map(|drawn| themed(drawn, theme));
        // Held until the work has ended, even if the client has gone.
        drop(permit);
        drawn.map(Ok).or_else(|error| not_drawn(error).map(Err))
    })
    .await??;
    Ok(svg(drawn, &etag, &name))
}
