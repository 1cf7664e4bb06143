//! Holding an answer back until something is in the awaited state: long polls.

use std::hash::Hash;

use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use tokio::time::{Instant, timeout_at};

use crate::http::app::App;
use crate::http::conditional::{self, Wait};
use crate::http::response::set;
use crate::jobs::notifications::Subscription;
use crate::jobs::store::StoreError;

pub(crate) const PREFERENCE_APPLIED: HeaderName = HeaderName::from_static("preference-applied");

/// Waits until what `read` gives is in the awaited state, the time is over, or the server stops; what it is then.
/// Whoever calls has subscribed before, so that no change is missed.
pub(crate) async fn wait_until<Id, T, Reading>(
    app: &App,
    wait: Wait,
    mut changes: Subscription<Id>,
    read: impl Fn() -> Reading,
    reached: impl Fn(&T) -> bool,
) -> Result<T, StoreError>
where
    Id: Copy + Eq + Hash,
    Reading: Future<Output = Result<T, StoreError>>,
{
    let until = Instant::now() + wait.duration();
    loop {
        let found = read().await?;
        if wait.s == 0 || reached(&found) {
            return Ok(found);
        }
        let changed = async {
            tokio::select! {
                () = changes.changed() => true,
                () = app.shared.shutdown.cancelled() => false,
            }
        };
        if !matches!(timeout_at(until, changed).await, Ok(true)) {
            return read().await;
        }
    }
}

/// What changes until it is finished, and has a tag that tells one state from another.
pub(crate) trait Changing {
    /// The tag of the state it is in.
    fn etag(&self) -> String;
    /// Whether it is finished.
    fn is_finished(&self) -> bool;
}

/// How a client asks how something is: held back until it differs from what the client knows, or, where it
/// knows nothing, until it is finished.
pub(crate) struct Asked<'a> {
    headers: &'a HeaderMap,
    wait: Option<Wait>,
}

impl<'a> Asked<'a> {
    pub(crate) fn of(headers: &'a HeaderMap) -> Self {
        Self { headers, wait: Wait::of(headers) }
    }

    /// For how long the answer may be held back.
    pub(crate) fn wait(&self) -> Wait {
        self.wait.unwrap_or(Wait { s: 0 })
    }

    /// Whether this state is news to the client.
    pub(crate) fn settles(&self, state: &impl Changing) -> bool {
        if conditional::has_if_none_match(self.headers) { !self.knows(state) } else { state.is_finished() }
    }

    fn knows(&self, state: &impl Changing) -> bool {
        conditional::none_match_fails(self.headers, &state.etag())
    }

    /// The answer: that the state is known, or the whole of it.
    pub(crate) async fn answer<E>(
        &self,
        state: &impl Changing,
        whole: impl Future<Output = Result<Response, E>>,
    ) -> Result<Response, E> {
        let mut response = if self.knows(state) {
            let mut response = StatusCode::NOT_MODIFIED.into_response();
            set(&mut response, header::ETAG, &state.etag());
            response
        } else {
            whole.await?
        };
        if let Some(wait) = self.wait {
            set(&mut response, PREFERENCE_APPLIED, &wait.applied());
        }
        Ok(response)
    }
}
