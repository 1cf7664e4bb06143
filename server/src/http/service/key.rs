//! What a client may do with its key.

use axum::Extension;
use axum::extract::State;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;

use crate::accounts::{Caller, Quotas, Role};
use crate::http::app::App;
use crate::http::params::{NoParameters, Query};
use crate::http::response::named;
use crate::jobs::store::Usage;
use crate::problem::Problem;

/// The API key of a request.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct KeyInfo {
    /// Name of the key; `null` where the server asks for none.
    #[cfg_attr(test, schema(required))]
    name: Option<String>,
    /// Whose jobs and studies the key is for; `null` where the server asks for no key.
    #[cfg_attr(test, schema(required))]
    owner: Option<String>,
    /// What the key may do; `admin` where the server asks for no key.
    role: Role,
    /// Most requests of the key in a second, on average; `null` where there is no bound.
    #[cfg_attr(test, schema(required))]
    max_requests_per_second: Option<f64>,
    /// Most requests of the key at once; `null` where there is no bound.
    #[cfg_attr(test, schema(required))]
    request_burst: Option<u32>,
    /// What the jobs of the owner may take.
    quotas: Quotas,
    /// What the jobs of the owner take now.
    used: KeyUsage,
}

/// What the jobs of an owner take.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct KeyUsage {
    /// Jobs that wait.
    queued: u64,
    /// Jobs that run.
    running: u64,
    /// Bytes of results, kept exports and requests.
    stored_bytes: u64,
}

/// What the key of this request may do
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/key", tag = "service", operation_id = "get_key",
    responses(
        (status = 200, description = "The key", body = KeyInfo),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let rate = app.shared.accounts.rate_of(&caller);
    let Caller { by, role, .. } = caller;
    let quotas = app.shared.accounts.quotas(&by.owner);
    let Usage { queued, running, stored_bytes } = app.shared.store.usage_of(&by.owner).await?;
    let used = KeyUsage { queued, running, stored_bytes };
    let key = KeyInfo {
        name: named(&by.key),
        owner: named(&by.owner),
        role,
        max_requests_per_second: rate.map(|rate| rate.per_second),
        request_burst: rate.map(|rate| rate.burst),
        quotas,
        used,
    };
    Ok(axum::Json(key).into_response())
}
