//! Notifications of changes of jobs, studies and exports.
//!
//! A change is notified after its commit, and only by ID: a waiter that wakes reads the store. A waiter that subscribes
//! before it reads misses nothing.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

type Waiters<Id> = Mutex<HashMap<Id, watch::Sender<()>>>;

/// All who wait for something of one sort.
#[derive(Clone, Debug)]
pub(crate) struct Notifications<Id> {
    waiters: Arc<Waiters<Id>>,
}

impl<Id> Default for Notifications<Id> {
    fn default() -> Self {
        Self { waiters: Arc::default() }
    }
}

impl<Id: Copy + Eq + Hash> Notifications<Id> {
    /// Starts to listen for changes of what has this id.
    pub(crate) fn subscribe(&self, id: Id) -> Subscription<Id> {
        let receiver = lock(&self.waiters).entry(id).or_insert_with(|| watch::Sender::new(())).subscribe();
        Subscription { id, receiver: Some(receiver), waiters: Arc::clone(&self.waiters) }
    }

    /// How many listen for changes of what has this id.
    pub(crate) fn listeners(&self, id: Id) -> usize {
        lock(&self.waiters).get(&id).map_or(0, watch::Sender::receiver_count)
    }

    /// Wakes all who wait for what has this id.
    pub(crate) fn notify(&self, id: Id) {
        if let Some(sender) = lock(&self.waiters).get(&id) {
            sender.send_replace(());
        }
    }

    /// Wakes all who wait for anything.
    pub(crate) fn notify_all(&self) {
        for sender in lock(&self.waiters).values() {
            sender.send_replace(());
        }
    }
}

/// One waiter.
#[derive(Debug)]
pub(crate) struct Subscription<Id: Copy + Eq + Hash> {
    id: Id,
    // Always there until the drop, which must count receivers without this one.
    receiver: Option<watch::Receiver<()>>,
    waiters: Arc<Waiters<Id>>,
}

impl<Id: Copy + Eq + Hash> Subscription<Id> {
    /// Waits for a change since the last call, or since the subscription.
    pub(crate) async fn changed(&mut self) {
        if let Some(receiver) = &mut self.receiver
            && receiver.changed().await.is_ok()
        {
            return;
        }
        // The sender lives as long as a receiver; without one nothing will ever change.
        std::future::pending::<()>().await;
    }
}

impl<Id: Copy + Eq + Hash> Drop for Subscription<Id> {
    fn drop(&mut self) {
        let mut waiters = lock(&self.waiters);
        self.receiver = None;
        if waiters.get(&self.id).is_some_and(|sender| sender.receiver_count() == 0) {
            waiters.remove(&self.id);
        }
    }
}

/// A waiter that panicked cannot have left the map half-changed.
fn lock<Id>(waiters: &Waiters<Id>) -> MutexGuard<'_, HashMap<Id, watch::Sender<()>>> {
    waiters.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::JobId;

    #[tokio::test]
    async fn a_change_before_the_wait_is_not_missed_and_nothing_is_kept() {
        let changes = Notifications::default();
        let id = JobId::new();
        let mut first = changes.subscribe(id);
        let mut second = changes.subscribe(id);
        changes.notify(id);
        first.changed().await;
        second.changed().await;
        assert_eq!(changes.listeners(id), 2);
        drop(first);
        assert_eq!(changes.listeners(id), 1);
        assert_eq!(lock(&changes.waiters).len(), 1);
        drop(second);
        assert_eq!(lock(&changes.waiters).len(), 0);
        changes.notify(id);
    }
}
