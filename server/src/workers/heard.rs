//! Which processes ask for jobs. One that waits for a job holds no lease, so that the store does not know it.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A process by the name of its API key and its own. Processes of one key and one name count as one.
pub(crate) type ProcessName = (String, String);

/// The processes that ask for jobs, or did not long ago.
#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    processes: Arc<Mutex<HashMap<ProcessName, Process>>>,
}

#[derive(Clone, Copy, Debug)]
struct Process {
    /// Requests that are being answered.
    asking: usize,
    /// When the last answer was given.
    at: Instant,
}

impl Heard {
    /// A request of a process, until what is returned is dropped. Processes that were not heard within `lease` are
    /// forgotten, so that there are never many.
    pub(crate) fn asking(&self, name: ProcessName, lease: Duration) -> Asking {
        let mut processes = self.lock();
        processes.retain(|_, process| process.asking > 0 || process.at.elapsed() < lease);
        let process = processes.entry(name.clone()).or_insert(Process { asking: 0, at: Instant::now() });
        process.asking += 1;
        Asking { heard: self.clone(), name }
    }

    /// The processes that were heard within `lease`.
    pub(crate) fn within(&self, lease: Duration) -> BTreeSet<ProcessName> {
        let processes = self.lock();
        let heard =
            processes.iter().filter(|(_, process)| process.asking > 0 || process.at.elapsed() < lease);
        heard.map(|(name, _)| name.clone()).collect()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<ProcessName, Process>> {
        self.processes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A request of a process that is being answered.
#[derive(Debug)]
pub(crate) struct Asking {
    heard: Heard,
    name: ProcessName,
}

impl Drop for Asking {
    fn drop(&mut self) {
        if let Some(process) = self.heard.lock().get_mut(&self.name) {
            process.asking -= 1;
            process.at = Instant::now();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(worker: &str) -> ProcessName {
        ("cluster".into(), worker.into())
    }

    #[test]
    fn a_process_is_heard_while_it_asks_and_for_a_lease_after() {
        let (heard, none, hour) = (Heard::default(), Duration::ZERO, Duration::from_hours(1));
        let first = heard.asking(name("a"), hour);
        let again = heard.asking(name("a"), hour);
        let other = heard.asking(name("b"), hour);
        assert_eq!(heard.within(none).len(), 2);
        drop((first, other));
        assert_eq!(heard.within(none), BTreeSet::from([name("a")]), "its second request is not answered yet");
        drop(again);
        assert_eq!(heard.within(none), BTreeSet::new());
        assert_eq!(heard.within(hour), BTreeSet::from([name("a"), name("b")]));
        let next = heard.asking(name("c"), none);
        assert_eq!(heard.within(hour), BTreeSet::from([name("c")]), "the others are forgotten");
        drop(next);
    }
}
