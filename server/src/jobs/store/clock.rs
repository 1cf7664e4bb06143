//! The clock that decides about leases, pauses and expiry: that of the database.

use std::sync::atomic::{AtomicI64, Ordering};

use jiff::Timestamp;

/// The clock of the database, as this process knows it: its own, corrected by what the database last said. SQLite has
/// no clock besides that of the process.
#[derive(Debug, Default)]
pub(super) struct Clock {
    /// By how many microseconds the database is ahead.
    ahead_us: AtomicI64,
}

impl Clock {
    /// Microseconds since the Unix epoch.
    pub(super) fn now_us(&self) -> i64 {
        Timestamp::now().as_microsecond().saturating_add(self.ahead_us.load(Ordering::Relaxed))
    }

    /// Corrects it: the database says that it is `now_us`.
    #[cfg(feature = "postgres")]
    pub(super) fn set(&self, now_us: i64) {
        self.ahead_us.store(now_us.saturating_sub(Timestamp::now().as_microsecond()), Ordering::Relaxed);
    }
}
