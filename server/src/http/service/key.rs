//! What a client may do with its key.

use axum::Extension;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use utoipa::ToSchema;

use crate::accounts::{Caller, Role};
use crate::http::params::{NoParameters, Query};
use crate::http::problems::sets::OpenProblems;
use crate::http::response::named;
use crate::problem::Problem;

/// The API key of a request.
#[derive(Serialize, ToSchema)]
pub(crate) struct KeyInfo {
    /// Name of the key; `null` where the server asks for none.
    #[schema(required)]
    name: Option<String>,
    /// Whose jobs and studies the key is for; `null` where the server asks for no key.
    #[schema(required)]
    owner: Option<String>,
    /// What the key may do; `admin` where the server asks for no key.
    role: Role,
}

/// What the key of this request may do
#[utoipa::path(
    get, path = "/v1/key", tag = "service", operation_id = "get_key",
    responses((status = 200, description = "The key", body = KeyInfo), OpenProblems)
)]
pub(crate) async fn get(
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let Caller { by, role } = caller;
    Ok(axum::Json(KeyInfo { name: named(&by.key), owner: named(&by.owner), role }).into_response())
}
