//! The least speed of a body: a slower sender would hold memory or a thread that others need.

use std::time::Duration;

use tokio::time::Instant;

/// Time in which [`LEAST_BYTES`] must arrive, and longest pause between two pieces.
const WINDOW: Duration = Duration::from_secs(30);
/// Bytes that must arrive in that time.
const LEAST_BYTES: usize = 16 << 10;

/// The speed of a body.
pub(super) struct Pace {
    deadline: Instant,
    missing: usize,
}

impl Pace {
    /// Begins to measure.
    pub(super) fn new() -> Self {
        Self { deadline: Instant::now() + WINDOW, missing: LEAST_BYTES }
    }

    /// When the body is too slow.
    pub(super) fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Notes bytes that have arrived. A small body may be slower: each of its pieces counts.
    pub(super) fn arrived(&mut self, bytes: usize, is_small: bool) {
        self.missing = self.missing.saturating_sub(bytes);
        if self.missing == 0 || is_small {
            *self = Self::new();
        }
    }

    /// Adds time in which the sender could send nothing.
    pub(super) fn postpone(&mut self, by: Duration) {
        self.deadline += by;
    }

    /// The bound in words.
    pub(super) fn bound() -> String {
        format!("must bring at least {LEAST_BYTES} bytes in each {} s", WINDOW.as_secs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_large_body_must_bring_enough_in_its_time() {
        let mut pace = Pace::new();
        let first = pace.deadline();
        pace.arrived(LEAST_BYTES - 1, false);
        assert_eq!(pace.deadline(), first);
        pace.arrived(1, false);
        let second = pace.deadline();
        assert!(second > first);
        pace.arrived(1, true);
        assert!(pace.deadline() > second);
    }
}
