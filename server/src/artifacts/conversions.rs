//! How many conversions of results compute at once: as many as there are cores.
//!
//! More would be no sooner done, and whatever else the service does would wait for them.

use std::sync::{Condvar, Mutex, PoisonError};
use std::thread::available_parallelism;

/// Conversions that compute.
static CONVERSIONS: Conversions = Conversions { running: Mutex::new(0), ended: Condvar::new() };

struct Conversions {
    running: Mutex<usize>,
    ended: Condvar,
}

/// The place of a conversion; dropped, another one begins.
#[derive(Debug)]
pub(crate) struct Place(());

/// Waits until a core is free of conversions. Blocks the thread.
pub(crate) fn begin() -> Place {
    let most = available_parallelism().map_or(1, usize::from);
    let running = CONVERSIONS.running.lock().unwrap_or_else(PoisonError::into_inner);
    let is_full = |running: &mut usize| *running >= most;
    let mut running = CONVERSIONS.ended.wait_while(running, is_full).unwrap_or_else(PoisonError::into_inner);
    *running += 1;
    Place(())
}

impl Drop for Place {
    fn drop(&mut self) {
        *CONVERSIONS.running.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        CONVERSIONS.ended.notify_one();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn no_more_conversions_compute_at_once_than_there_are_cores() {
        let most = available_parallelism().map_or(1, usize::from);
        let (running, peak) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 * most {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let place = begin();
                        peak.fetch_max(running.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                        std::thread::yield_now();
                        running.fetch_sub(1, Ordering::SeqCst);
                        drop(place);
                    }
                });
            }
        });
        assert!((1..=most).contains(&peak.load(Ordering::SeqCst)), "{peak:?}");
    }
}
