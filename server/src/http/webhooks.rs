//! Webhooks as their owners see them, and the check of the URL of a submission.

use packstone_engine::FieldError;
use serde::Serialize;

use crate::accounts::Caller;
use crate::failure::Failure;
use crate::http::app::App;
use crate::http::response::time;
use crate::jobs::JobRecord;
use crate::jobs::store::{DeliveryState, StoreError, StudyRecord, StudyState, WebhookRecord};
use crate::webhooks::{NONE_OF_JOBS, WebhookRules, WebhookUrl};

/// The message that is sent when a job ends or a study is finished, and how far it is.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = Webhook))]
pub(crate) struct WebhookView {
    /// Where it is sent.
    #[cfg_attr(test, schema(format = "uri"))]
    url: String,
    /// Whether it has arrived.
    state: DeliveryState,
    /// How often it was sent.
    attempts: u32,
    /// What was wrong with the last attempt.
    #[cfg_attr(test, schema(required))]
    last_error: Option<String>,
    /// HTTP status of the answer to the last attempt, if there was one.
    #[cfg_attr(test, schema(required, minimum = 100, maximum = 999))]
    last_status: Option<u16>,
    /// When it is sent next (RFC 3339, UTC), while it waits.
    #[cfg_attr(test, schema(format = DateTime, required))]
    next_attempt_at: Option<String>,
    /// When the receiver accepted it.
    #[cfg_attr(test, schema(format = DateTime, required))]
    delivered_at: Option<String>,
}

impl WebhookView {
    /// The webhook of a job, for its owner.
    pub(crate) async fn of_job(
        app: &App,
        caller: &Caller,
        job: &JobRecord,
    ) -> Result<Option<Self>, StoreError> {
        if job.study.is_some() || caller.by.owner != job.owner {
            return Ok(None);
        }
        let found = app.shared.store.webhook_of_job(job.seq).await?;
        Ok(found.map(|webhook| Self::of(webhook, job.state.is_finished())))
    }

    /// The webhook of a study, for its owner.
    pub(crate) async fn of_study(
        app: &App,
        caller: &Caller,
        study: &StudyRecord,
    ) -> Result<Option<Self>, StoreError> {
        if caller.by.owner != study.owner {
            return Ok(None);
        }
        let found = app.shared.store.webhook_of_study(study.seq).await?;
        Ok(found.map(|webhook| Self::of(webhook, study.state() == StudyState::Finished)))
    }

    fn of(webhook: WebhookRecord, finished: bool) -> Self {
        // What was sent before a retry says nothing of the end to come.
        let webhook = if finished { webhook } else { webhook.of_unfinished() };
        Self {
            url: webhook.url,
            state: webhook.state,
            attempts: webhook.attempts,
            last_error: webhook.last_error,
            last_status: webhook.last_status,
            next_attempt_at: webhook.next_attempt_at.map(time),
            delivered_at: webhook.delivered_at.map(time),
        }
    }
}

/// The refusal of a URL for a job of a study.
pub(crate) fn of_a_study() -> Failure {
    Failure::invalid(vec![FieldError::new("/webhook_url", NONE_OF_JOBS)])
}

/// Judges the URL of a submission or a change, where it names one.
///
/// # Errors
/// A `validation-error` at `/webhook_url`.
pub(crate) fn check(rules: &WebhookRules, url: Option<&WebhookUrl>) -> Result<(), Failure> {
    let Some(url) = url else { return Ok(()) };
    rules.check(url).map_err(|detail| Failure::invalid(vec![FieldError::new("/webhook_url", detail)]))
}
