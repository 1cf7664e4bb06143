//! Bounds of the requests that each key may send in a time.
//!
//! The generic cell rate algorithm (ITU-T I.371): of each key one moment is kept, at which all requests that were
//! admitted would have arrived at an even rate. A request is admitted while that moment lies less than a burst ahead.
//! It admits what a token bucket does, without a clock that ticks.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Keys are kept in memory up to this number; beyond, those are dropped that have not sent more than their rate.
const PRUNE_BEYOND: usize = 1024;
/// Least burst where none is given.
const LEAST_BURST: f64 = 10.0;
/// Seconds whose requests may come at once where no burst is given.
const BURST_S: f64 = 2.0;

/// How many requests a key may send.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rate {
    /// In a second, on average.
    pub(crate) per_second: f64,
    /// At once.
    pub(crate) burst: u32,
}

impl Rate {
    /// A rate with a burst, which is two seconds' requests and at least ten if it is not given.
    pub(crate) fn new(per_second: f64, burst: Option<u32>) -> Self {
        let burst = burst.unwrap_or_else(|| (BURST_S * per_second).max(LEAST_BURST).ceil() as u32);
        Self { per_second, burst: burst.max(1) }
    }
}

/// What was admitted of each key.
#[derive(Debug, Default)]
pub(super) struct Admitted(Mutex<HashMap<String, Instant>>);

impl Admitted {
    /// Admits a request of a key, or tells after what time the next one will be.
    pub(super) fn admit(&self, key: &str, rate: Rate, now: Instant) -> Result<(), Duration> {
        let interval = Duration::from_secs_f64(1.0 / rate.per_second);
        let ahead = interval.saturating_mul(rate.burst - 1);
        let mut admitted = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let due = admitted.get(key).map_or(now, |due| now.max(*due));
        let wait = due.duration_since(now).saturating_sub(ahead);
        if !wait.is_zero() {
            return Err(wait);
        }
        if admitted.len() >= PRUNE_BEYOND {
            admitted.retain(|_, due| *due > now);
        }
        if let Some(next) = due.checked_add(interval) {
            admitted.insert(key.to_owned(), next);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_is_admitted_then_the_rate() {
        let admitted = Admitted::default();
        let rate = Rate::new(10.0, Some(3));
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        for _ in 0..3 {
            assert_eq!(admitted.admit("a", rate, at(0)), Ok(()));
        }
        assert_eq!(admitted.admit("a", rate, at(0)), Err(Duration::from_millis(100)));
        assert_eq!(admitted.admit("a", rate, at(60)), Err(Duration::from_millis(40)));
        assert_eq!(admitted.admit("b", rate, at(60)), Ok(()), "each key has its own");
        assert_eq!(admitted.admit("a", rate, at(100)), Ok(()));
        assert!(admitted.admit("a", rate, at(100)).is_err(), "what is refused counts nothing");
        // A pause fills the burst again and no more.
        for _ in 0..3 {
            assert_eq!(admitted.admit("a", rate, at(5000)), Ok(()));
        }
        assert!(admitted.admit("a", rate, at(5000)).is_err());
        // Over ten seconds of asking all the time as many are admitted as the rate says.
        let count = (10_000..20_000).filter(|ms| admitted.admit("c", rate, at(*ms)).is_ok()).count();
        assert_eq!(count, 3 + 99);
    }

    #[test]
    fn memory_is_bounded_by_keys_that_exceed_their_rate() {
        let admitted = Admitted::default();
        let rate = Rate::new(1000.0, None);
        let start = Instant::now();
        for i in 0..100_000_u64 {
            let now = start + Duration::from_millis(i);
            assert_eq!(admitted.admit(&format!("key {i}"), rate, now), Ok(()));
        }
        assert!(admitted.0.lock().map_or(0, |map| map.len()) <= PRUNE_BEYOND);
        assert_eq!((Rate::new(0.5, None).burst, Rate::new(20.0, None).burst), (10, 40));
        assert_eq!(Rate::new(1.0, Some(0)).burst, 1);
    }
}
