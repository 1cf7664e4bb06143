//! The worker slots of a process. A job holds as many of them as threads compute its packing.
//!
//! An executor reserves a slot before it claims a job. When it starts the job, it takes further slots from those that
//! are free at that moment; it never waits for one. A claim that is under way has a slot, too, and gives it back where
//! it finds no job. So a job that has work for several threads lets these claims end, which takes no longer than the
//! store takes to answer, and the next claim waits until the job has taken its slots.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use tokio::sync::{OwnedSemaphorePermit, RwLock, RwLockReadGuard, RwLockWriteGuard, Semaphore};

/// Most threads of a job: of those that it has work for, as many as its request allows.
pub(crate) fn threads_of(asked: Option<u32>, most: u32) -> usize {
    asked.map_or(most, |asked| asked.min(most)).max(1) as usize
}

/// The slots of a process.
#[derive(Clone, Debug)]
pub(crate) struct Slots {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    free: Arc<Semaphore>,
    /// Shared by the claims that are under way; held alone by a job that takes further slots.
    claims: RwLock<()>,
    /// Slots that jobs hold.
    busy: AtomicUsize,
}

/// A slot for a job that is being claimed.
#[derive(Debug)]
pub(crate) struct Reserved<'s> {
    // Goes before the guard, so that who waits for the end of this claim finds the slot free.
    slot: OwnedSemaphorePermit,
    _claim: Guard<'s>,
    shared: &'s Arc<Shared>,
}

/// Whether other claims may be under way. Held, never read.
#[derive(Debug)]
enum Guard<'s> {
    WithOthers { _held: RwLockReadGuard<'s, ()> },
    Alone { _held: RwLockWriteGuard<'s, ()> },
}

/// The slots of a job whose packing is computed. They are given back when this is dropped.
#[derive(Debug)]
pub(crate) struct Held {
    slots: OwnedSemaphorePermit,
    shared: Arc<Shared>,
}

impl Slots {
    /// So many slots, all of them free.
    pub(crate) fn new(slots: usize) -> Self {
        let free = Arc::new(Semaphore::new(slots));
        Self { shared: Arc::new(Shared { free, claims: RwLock::default(), busy: AtomicUsize::default() }) }
    }

    /// Slots that jobs hold.
    pub(crate) fn busy(&self) -> usize {
        self.shared.busy.load(Ordering::Acquire)
    }

    /// Waits for a free slot, and keeps it for a job that is to be claimed.
    pub(crate) async fn reserve(&self) -> Reserved<'_> {
        let shared = &self.shared;
        loop {
            // A slot must not be kept while the claim is not under way: it would not count as free.
            drop(shared.free.acquire().await);
            let held = shared.claims.read().await;
            if let Ok(slot) = Arc::clone(&shared.free).try_acquire_owned() {
                return Reserved { slot, _claim: Guard::WithOthers { _held: held }, shared };
            }
        }
    }
}

impl Reserved<'_> {
    /// Waits until no other claim is under way, and lets none begin until the slots are taken.
    pub(crate) async fn alone(self) -> Self {
        let Self { slot, _claim: claim, shared } = self;
        drop(claim);
        Self { slot, _claim: Guard::Alone { _held: shared.claims.write().await }, shared }
    }

    /// Takes the slots of a job: as many as it has work for in threads, of those that are free but for `left`.
    pub(crate) fn take(self, threads: usize, left: u64) -> Held {
        let Self { mut slot, _claim: _others, shared } = self;
        let left = usize::try_from(left).unwrap_or(usize::MAX);
        let spare = shared.free.available_permits().saturating_sub(left);
        let more = threads.saturating_sub(1).min(spare).try_into().unwrap_or(u32::MAX);
        if let Ok(more) = Arc::clone(&shared.free).try_acquire_many_owned(more) {
            slot.merge(more);
        }
        shared.busy.fetch_add(slot.num_permits(), Ordering::AcqRel);
        Held { slots: slot, shared: Arc::clone(shared) }
    }
}

impl Held {
    /// How many there are, at least one.
    pub(crate) fn count(&self) -> NonZeroUsize {
        NonZeroUsize::new(self.slots.num_permits()).unwrap_or(NonZeroUsize::MIN)
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.shared.busy.fetch_sub(self.slots.num_permits(), Ordering::AcqRel);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use tokio::task::yield_now;

    use super::*;

    /// Slots of a job that takes those free but for `left`.
    async fn started(slots: &Slots, threads: usize, left: u64) -> Held {
        slots.reserve().await.alone().await.take(threads, left)
    }

    #[tokio::test]
    async fn a_job_takes_what_is_free_and_gives_all_of_it_back() {
        let slots = Slots::new(4);
        let one = started(&slots, 1, 0).await;
        assert_eq!((one.count().get(), slots.busy()), (1, 1));
        let two = started(&slots, 2, 0).await;
        assert_eq!((two.count().get(), slots.busy()), (2, 3));
        let rest = started(&slots, 64, 0).await;
        assert_eq!((rest.count().get(), slots.busy()), (1, 4));
        drop((one, rest));
        assert_eq!(slots.busy(), 2);
        drop(two);
        assert_eq!(started(&slots, 64, 0).await.count().get(), 4);
        assert_eq!(slots.busy(), 0);
    }

    #[tokio::test]
    async fn slots_that_are_left_to_others_are_not_taken() {
        let slots = Slots::new(4);
        for (left, taken) in [(0, 4), (1, 3), (2, 2), (3, 1), (4, 1), (u64::MAX, 1)] {
            assert_eq!(started(&slots, 64, left).await.count().get(), taken, "{left} left");
        }
    }

    #[tokio::test]
    async fn no_claim_begins_while_all_slots_are_held() {
        let slots = Slots::new(2);
        let held = started(&slots, 2, 0).await;
        let next = tokio::spawn({
            let slots = slots.clone();
            async move { slots.reserve().await.take(1, 0).count().get() }
        });
        for _ in 0..100 {
            yield_now().await;
        }
        assert!(!next.is_finished());
        drop(held);
        assert_eq!(next.await.unwrap(), 1);
    }

    #[tokio::test]
    async fn a_job_that_takes_more_lets_claims_end_which_find_none() {
        let slots = Slots::new(3);
        let (first, second, third) = (slots.reserve().await, slots.reserve().await, slots.reserve().await);
        let taking = first.alone();
        tokio::pin!(taking);
        assert!(futures_util::poll!(taking.as_mut()).is_pending(), "two claims are under way");
        let found = second.take(1, 0);
        assert!(futures_util::poll!(taking.as_mut()).is_pending(), "one claim is under way");
        drop(third);
        let all = taking.await.take(64, 0);
        assert_eq!((all.count().get(), found.count().get(), slots.busy()), (2, 1, 3));
    }
}
