//! Grains of a shape, to look at before anything is packed.

use axum::extract::State;
use axum::response::{IntoResponse as _, Response};
#[cfg(test)]
use packstone_engine::samples::SampleRequest;
use packstone_engine::samples::ShapeSamples;

use crate::failure::Failure;
use crate::http::app::App;
use crate::http::body::RequestBody;
use crate::http::params::{NoParameters, Query};
use crate::problem::Problem;
use crate::strict_json;

/// Longest request for grains: the laws of a mixture of 16 shapes take a tenth of it.
const MAX_SHAPE_BYTES: u64 = 1 << 18;

/// Show grains of a shape
///
/// Eight grains of the shape in the body, drawn as a packing draws them, each with the volume of a sphere of diameter 1
/// in an orientation of its own: points and polygons for a picture, and the ratios of the axes. Nothing is stored.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/shapes", tag = "jobs", operation_id = "sample_shape",
    request_body(content = SampleRequest, content_type = "application/json"),
    responses(
        (status = 200, description = "The grains", body = ShapeSamples),
        crate::http::problems::sets::MixReadingProblems
    )
))]
pub(crate) async fn sample(
    State(app): State<App>,
    _: Query<NoParameters>,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let bytes = body.read(MAX_SHAPE_BYTES).await?;
    let shared = app.shared.clone();
    let work = move || -> Result<ShapeSamples, Failure> {
        let shape = strict_json::parse(&bytes)?;
        shared.planner.samples(&shape).map_err(Failure::invalid)
    };
    Ok(axum::Json(app.shared.compute.run(move |_| work()).await??).into_response())
}
