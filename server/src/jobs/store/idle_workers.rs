//! Idle workers of this process and of others: who waits for a job, and who is woken.
//!
//! Workers differ in the time that they have left. A job that does not fit into the time of one worker may fit into
//! that of another, and a worker with more time can take every job that one with less time can take. So a wake-up goes
//! to the idle worker with the most time left; of several, to the one that has waited longest. Where it finds no job,
//! no other idle worker would find one. Where it finds one, it wakes the next worker ([`Store::wake_next_worker`]).
//!
//! A worker takes a [`Mark`] before it asks the store for a job. A wake-up after the mark is not lost, though the
//! worker did not wait yet. A worker that is woken and stops waiting before it knows passes the wake-up to the next.
//!
//! [`Store::wake_next_worker`]: super::Store::wake_next_worker

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;
use tokio::time::Instant;

/// The number of wake-ups at a moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mark(u64);

/// Until when a worker takes jobs. The order is that of the time left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum WorkUntil {
    /// Its process ends then.
    Moment(Instant),
    /// Its process goes on.
    Unlimited,
}

/// Most time left first, then longest wait first.
type Place = (Reverse<WorkUntil>, u64);

/// The idle workers.
#[derive(Debug, Default)]
pub(super) struct IdleWorkers(Mutex<Waiting>);

#[derive(Debug, Default)]
struct Waiting {
    wake_ups: u64,
    /// How many workers have waited until now.
    waits: u64,
    workers: BTreeMap<Place, oneshot::Sender<()>>,
}

impl IdleWorkers {
    /// The mark of this moment.
    pub(super) fn mark(&self) -> Mark {
        Mark(self.lock().wake_ups)
    }

    /// Until when the idle worker with the most time left takes jobs; `None` where no worker is idle.
    pub(super) fn most_time(&self) -> Option<WorkUntil> {
        self.lock().workers.keys().next().map(|(Reverse(until), _)| *until)
    }

    /// Wakes the idle worker with the most time left. A worker that is about to wait asks once more instead.
    pub(super) fn wake(&self) {
        let mut waiting = self.lock();
        waiting.wake_ups += 1;
        // A worker that has just stopped waiting is passed over.
        while let Some((_, worker)) = waiting.workers.pop_first() {
            if worker.send(()).is_ok() {
                return;
            }
        }
    }

    /// Waits for a wake-up since the mark.
    pub(super) async fn woken(&self, since: Mark, until: WorkUntil) {
        let Some(mut waiter) = self.join(since, until) else { return };
        // The sender goes only with a wake-up.
        let _ = (&mut waiter.woken).await;
        waiter.is_served = true;
    }

    /// Begins to wait, unless there was a wake-up since the mark.
    fn join(&self, since: Mark, until: WorkUntil) -> Option<Waiter<'_>> {
        let mut waiting = self.lock();
        if waiting.wake_ups != since.0 {
            return None;
        }
        waiting.waits += 1;
        let place = (Reverse(until), waiting.waits);
        let (sender, woken) = oneshot::channel();
        waiting.workers.insert(place, sender);
        Some(Waiter { idle: self, place, woken, is_served: false })
    }

    /// A panic cannot have left it half-changed.
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A worker that waits.
#[derive(Debug)]
struct Waiter<'i> {
    idle: &'i IdleWorkers,
    place: Place,
    woken: oneshot::Receiver<()>,
    is_served: bool,
}

impl Drop for Waiter<'_> {
    fn drop(&mut self) {
        if self.is_served {
            return;
        }
        self.idle.lock().workers.remove(&self.place);
        if self.woken.try_recv().is_ok() {
            self.idle.wake();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use futures_util::poll;

    use super::*;

    fn in_seconds(s: u64) -> WorkUntil {
        WorkUntil::Moment(Instant::now() + Duration::from_secs(s))
    }

    #[tokio::test]
    async fn the_worker_with_the_most_time_is_woken_first() {
        let idle = IdleWorkers::default();
        let mark = idle.mark();
        let (short, long) = (in_seconds(10), in_seconds(20));
        let mut waits = [short, WorkUntil::Unlimited, long, WorkUntil::Unlimited]
            .map(|until| Box::pin(idle.woken(mark, until)));
        for wait in &mut waits {
            assert!(poll!(wait.as_mut()).is_pending());
        }
        for (expected, left) in
            [(1, WorkUntil::Unlimited), (3, long), (2, short)].map(|(place, left)| (place, Some(left)))
        {
            idle.wake();
            assert_eq!(idle.most_time(), left);
            assert!(poll!(waits[expected].as_mut()).is_ready(), "worker {expected}");
        }
        idle.wake();
        assert!(poll!(waits[0].as_mut()).is_ready());
        assert_eq!(idle.most_time(), None);
    }

    #[tokio::test]
    async fn a_wake_up_between_the_question_and_the_wait_is_not_lost() {
        let idle = IdleWorkers::default();
        let mark = idle.mark();
        idle.wake();
        idle.woken(mark, WorkUntil::Unlimited).await;
        assert!(poll!(Box::pin(idle.woken(idle.mark(), WorkUntil::Unlimited))).is_pending());
    }

    #[tokio::test]
    async fn a_worker_that_stops_waiting_passes_its_wake_up_to_the_next() {
        let idle = IdleWorkers::default();
        let mark = idle.mark();
        let mut first = Box::pin(idle.woken(mark, WorkUntil::Unlimited));
        let mut second = Box::pin(idle.woken(mark, WorkUntil::Unlimited));
        assert!(poll!(first.as_mut()).is_pending() && poll!(second.as_mut()).is_pending());
        idle.wake();
        drop(first);
        assert!(poll!(second.as_mut()).is_ready());
        assert_eq!(idle.most_time(), None);
    }
}
