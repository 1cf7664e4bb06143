//! Deadlines that only a fault can reach: a test that would hang fails with a name instead.

use std::future::Future;
use std::time::Duration;

/// What a test waits for at most, unless it says otherwise. Long enough for a machine that builds
/// something else meanwhile.
pub(crate) const PATIENCE: Duration = Duration::from_secs(90);

/// Waits for `what`, at most [`PATIENCE`].
pub(crate) async fn patiently<T>(what: &str, future: impl Future<Output = T>) -> T {
    within(PATIENCE, what, future).await
}

/// Waits for `what`, at most `limit`.
pub(crate) async fn within<T>(limit: Duration, what: &str, future: impl Future<Output = T>) -> T {
    let outcome = tokio::time::timeout(limit, future).await;
    outcome.unwrap_or_else(|_| panic!("waited {limit:?} in vain for {what}"))
}

/// Waits until `condition` holds, for what gives no signal of its own, such as a file that goes.
pub(crate) async fn eventually(what: &str, condition: impl Fn() -> bool) {
    patiently(what, async {
        let mut look_again = tokio::time::interval(Duration::from_millis(20));
        while !condition() {
            look_again.tick().await;
        }
    })
    .await;
}
