//! Holding an answer back until something is as wished.

use axum::http::HeaderName;
use std::hash::Hash;

use tokio::time::{Instant, timeout_at};

use super::App;
use super::conditional::Wait;
use crate::jobs::changes::Subscription;
use crate::jobs::store::StoreError;

pub(super) const PREFERENCE_APPLIED: HeaderName = HeaderName::from_static("preference-applied");

/// Waits until what `read` gives is as wished, the time is over, or the server stops; what it is then.
/// Whoever calls has subscribed before, so that no change is missed.
pub(super) async fn wait_until<Id, T, Reading>(
    app: &App,
    wait: Wait,
    mut changes: Subscription<Id>,
    read: impl Fn() -> Reading,
    wished: impl Fn(&T) -> bool,
) -> Result<T, StoreError>
where
    Id: Copy + Eq + Hash,
    Reading: Future<Output = Result<T, StoreError>>,
{
    let until = Instant::now() + wait.duration();
    loop {
        let found = read().await?;
        if wait.s == 0 || wished(&found) {
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
