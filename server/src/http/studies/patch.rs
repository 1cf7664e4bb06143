//! Changing a study: whether others may read it, and its webhook, by a JSON merge patch (RFC 7396).

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use packstone_engine::FieldError;
use packstone_engine::request::decode::{At, Faults};
use serde_json::Value;

use crate::accounts::Caller;
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::body::{PATCH_BYTES, RequestBody};
use crate::http::conditional::target;
use crate::http::params::{IdPath, NoParameters, Query, StudyPath};
use crate::http::problems::refused;
use crate::http::studies::view;
use crate::http::webhooks;
use crate::jobs::request::{Change, read_webhook_change};
use crate::problem::Problem;
use crate::webhooks::WebhookUrl;

/// Changes of a study, as a JSON merge patch (RFC 7396).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct StudyPatch {
    /// Whether other users of the server may read the study with all its jobs; `null` stands for `false`.
    #[cfg_attr(test, schema(required = false, nullable))]
    shared: Option<bool>,
    /// The new URL to which a signed message is sent when the study is finished; `null` removes it. A message that is
    /// recorded already goes to the URL of before.
    #[cfg_attr(test, schema(required = false, schema_with = crate::jobs::schema::webhook_url))]
    webhook_url: Change<WebhookUrl>,
}

impl StudyPatch {
    fn read(value: &Value) -> Result<Self, Vec<FieldError>> {
        let faults = Faults::default();
        let mut patch = Self::default();
        if let Some(mut object) = At::root(value, &faults).object() {
            patch.shared = match object.optional("shared") {
                Some(at) => at.boolean(),
                None => value.get("shared").is_some_and(Value::is_null).then_some(false),
            };
            patch.webhook_url = read_webhook_change(value, &mut object);
            object.finish();
        }
        if faults.count() == 0 { Ok(patch) } else { Err(faults.into_vec()) }
    }
}

/// Change a study
///
/// A JSON merge patch (RFC 7396). `shared` counts for all jobs of the study. A changed `webhook_url` counts for the
/// next time that the study is finished; `null` removes it.
#[cfg_attr(test, utoipa::path(
    patch, path = "/v1/studies/{id}", tag = "studies", operation_id = "patch_study",
    params(
        StudyPath,
        ("If-Match" = Option<String>, Header,
            description = "Tag of the study; the change is made only if the study still has it"),
    ),
    request_body(content = StudyPatch, content_type = "application/merge-patch+json"),
    responses(
        (status = 200, description = "The study after the change", body = view::Study,
            headers(("ETag" = String, description = "Tag of the study"))),
        crate::http::problems::sets::StudyPatchProblems
    )
))]
pub(crate) async fn patch(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    IdPath(id): StudyPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let patch = StudyPatch::read(&body.json(&app, PATCH_BYTES).await?).map_err(Failure::invalid)?;
    if let Change::Set(url) = &patch.webhook_url {
        webhooks::check(&app.shared.webhook_rules, Some(url))?;
    }
    let StudyPatch { shared, webhook_url } = patch;
    let changed = app.shared.store.patch_study(target(id, &headers), shared, webhook_url).await;
    let record = changed.map_err(|error| refused(error, id))?;
    tracing::info!(study_id = %id, "changed");
    view::response(&app, &caller, StatusCode::OK, &record, false).await.map_err(|error| refused(error, id))
}
