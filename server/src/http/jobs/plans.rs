//! Plans: what a job amounts to, before it is submitted.

use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse as _, Response};
use packstone_engine::Plan;

use crate::http::app::App;
use crate::http::body;
use crate::http::jobs::reading::{Proposal, read};
use crate::http::params::{NoParameters, Query};
use crate::http::problems::sets::PlanProblems;
use crate::jobs::JobRequest;
use crate::problem::Problem;

/// Plan a job
///
/// What the job in the body amounts to: expected grains, volume fractions, memory, time, and whether the mix can fit at
/// all. Nothing is stored. What a submission refuses, this refuses with the same problem.
#[utoipa::path(
    post, path = "/v1/plans", tag = "jobs", operation_id = "plan_job",
    request_body(content = JobRequest, content_type = "application/json"),
    responses((status = 200, description = "The plan", body = Plan), PlanProblems)
)]
pub(crate) async fn plan(
    State(app): State<App>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let bytes = body::json_bytes(&app, &headers, body).await?;
    Ok(axum::Json(read(&app, bytes, Proposal::Made).await?.plan).into_response())
}
