//! The clock that decides about leases, pauses and expiry: that of the database.

use std::sync::atomic::{AtomicI64, Ordering};

use jiff::Timestamp;

/// Time between two looks at the clock of the database.
const ASK_EVERY: std::time::Duration = std::time::Duration::from_secs(1);

/// The clock of the database, as this process knows it: its own, corrected by what the database last said. SQLite has
/// no clock besides that of the process.
#[derive(Debug, Default)]
pub(super) struct Clock {
    /// By how many microseconds the database is ahead.
    ahead_us: AtomicI64,
    /// When the database was asked last.
    asked: std::sync::Mutex<Option<std::time::Instant>>,
}

impl Clock {
    /// Microseconds since the Unix epoch.
    pub(super) fn now_us(&self) -> i64 {
        Timestamp::now().as_microsecond().saturating_add(self.ahead_us.load(Ordering::Relaxed))
    }

    /// Whether the database is to be asked again: clocks drift by much less than a millisecond in this time.
    pub(super) fn is_stale(&self) -> bool {
        let asked = *self.asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        asked.is_none_or(|asked| asked.elapsed() >= ASK_EVERY)
    }

    /// Corrects it: the database says that it is `now_us`.
    pub(super) fn set(&self, now_us: i64) {
        let now = std::time::Instant::now();
        *self.asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(now);
        self.ahead_us.store(now_us.saturating_sub(Timestamp::now().as_microsecond()), Ordering::Relaxed);
    }
}
