//! What has changed lately, in order: for streams that follow all jobs and studies.
//!
//! Each change has a number, and what changes again moves to the end, so that a stream hears of an item once, however
//! often it changed meanwhile. The journal holds a bounded number of items in memory, and knows up to which number it
//! has forgotten some. It begins anew with each process.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

use crate::ids::{JobId, StudyId};

/// Items whose last change is held.
const MOST: usize = 10_000;

/// What has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Changed {
    /// A job, or it is gone.
    Job(JobId),
    /// A study, or it is gone.
    Study(StudyId),
}

/// The changes of this process.
#[derive(Debug)]
pub(crate) struct Journal {
    entries: Mutex<Entries>,
    last: watch::Sender<u64>,
}

#[derive(Debug, Default)]
struct Entries {
    by_number: BTreeMap<u64, Changed>,
    numbers: HashMap<Changed, u64>,
    last: u64,
    /// Some changes up to this number are not here.
    forgotten: u64,
}

impl Default for Journal {
    fn default() -> Self {
        Self { entries: Mutex::default(), last: watch::Sender::new(0) }
    }
}

impl Journal {
    /// Notes that something has changed.
    pub(crate) fn record(&self, changed: Changed) {
        let mut entries = self.lock();
        entries.last += 1;
        let number = entries.last;
        if let Some(before) = entries.numbers.insert(changed, number) {
            entries.by_number.remove(&before);
        }
        entries.by_number.insert(number, changed);
        if entries.by_number.len() > MOST
            && let Some((number, oldest)) = entries.by_number.pop_first()
        {
            entries.numbers.remove(&oldest);
            entries.forgotten = number;
        }
        // With the lock held, so that numbers rise.
        self.last.send_replace(entries.last);
    }

    /// Notes that anything may have changed, of which nobody told.
    pub(crate) fn lose(&self) {
        let mut entries = self.lock();
        let last = entries.last + 1;
        *entries = Entries { last, forgotten: last, ..Entries::default() };
        // With the lock held, so that numbers rise.
        self.last.send_replace(entries.last);
    }

    /// Number of the last change.
    pub(crate) fn last(&self) -> u64 {
        self.lock().last
    }

    /// Changes after that number, in order, of at most so many items; `None` where some are not known any more.
    pub(crate) fn after(&self, number: u64, most: usize) -> Option<Vec<(u64, Changed)>> {
        let entries = self.lock();
        if number < entries.forgotten || number > entries.last {
            return None;
        }
        let newer = entries.by_number.range(number + 1..).take(most);
        Some(newer.map(|(number, changed)| (*number, *changed)).collect())
    }

    /// Wakes with the number of each change from now on.
    pub(crate) fn subscribe(&self) -> watch::Receiver<u64> {
        self.last.subscribe()
    }

    fn lock(&self) -> MutexGuard<'_, Entries> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn changes_come_in_order_once_each_and_those_forgotten_are_known_to_be() {
        let journal = Journal::default();
        let [a, b] = [Changed::Job(JobId::new()), Changed::Study(StudyId::new())];
        for changed in [a, b, a] {
            journal.record(changed);
        }
        assert_eq!(journal.after(0, 9).unwrap(), [(2, b), (3, a)]);
        assert_eq!(journal.after(0, 1).unwrap(), [(2, b)]);
        assert_eq!(journal.after(3, 9).unwrap(), []);
        assert_eq!(journal.after(4, 9), None, "of another process");
        for _ in 0..MOST {
            journal.record(Changed::Job(JobId::new()));
        }
        assert_eq!(journal.after(2, 9), None);
        assert_eq!(journal.after(3, MOST + 1).unwrap().len(), MOST);
        journal.lose();
        assert_eq!(journal.after(3, 9), None);
        assert_eq!(journal.after(journal.last(), 9).unwrap(), []);
    }

    #[tokio::test]
    async fn a_change_before_the_wait_is_not_missed() {
        let journal = Journal::default();
        let mut last = journal.subscribe();
        journal.record(Changed::Job(JobId::new()));
        last.changed().await.unwrap();
        assert_eq!(*last.borrow(), journal.last());
    }
}
