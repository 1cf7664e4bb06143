//! Plans: what a job amounts to, before it is submitted.

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse as _, Response};

use crate::accounts::Caller;
use crate::exports::estimates::{JobPlan, planned};
use crate::http::app::App;
use crate::http::body;
use crate::http::jobs::reading::{Proposal, Submission, read};
use crate::http::params::{NoParameters, Query};
use crate::problem::Problem;
use crate::tasks;

/// Plan a job
///
/// What the job in the body amounts to: expected grains, volume fractions, memory, time, whether the mix can fit at
/// all, and the sizes of the exports that `postprocess` names. Nothing is stored. What a submission refuses, this
/// refuses with the same problem.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/plans", tag = "jobs", operation_id = "plan_job",
    request_body(content = crate::jobs::JobRequest, content_type = "application/json"),
    responses(
        (status = 200, description = "The plan", body = JobPlan),
        crate::http::problems::sets::PlanProblems
    )
))]
pub(crate) async fn plan(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let bytes = body::json_bytes(&app, &headers, body).await?;
    let Submission { request, plan, .. } = read(&app, bytes, app.limits_of(&caller), Proposal::Made).await?;
    let estimated = tasks::blocking(move || {
        let exports = planned(request.exports(), &request.packing(), &plan);
        JobPlan { plan, exports }
    });
    let job_plan = estimated.await.map_err(|error| {
        tracing::error!(%error, "the exports could not be estimated");
        Problem::internal()
    })?;
    Ok(axum::Json(job_plan).into_response())
}
