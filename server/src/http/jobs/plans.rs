//! Plans: what a job amounts to, before it is submitted.

use axum::Extension;
use axum::extract::State;
use axum::response::{IntoResponse as _, Response};

use crate::accounts::Caller;
use crate::exports::estimates::JobPlan;
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::jobs::reading::{Submission, read};
use crate::http::params::{NoParameters, Query};
use crate::planning::Proposal;
use crate::problem::Problem;

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
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let bytes = body.read(app.shared.max_body_bytes).await?;
    let submission = read(&app, bytes, app.limits_of(&caller), Proposal::Made).await?;
    let Submission { plan, exports, .. } = submission;
    Ok(axum::Json(JobPlan { plan, exports }).into_response())
}
