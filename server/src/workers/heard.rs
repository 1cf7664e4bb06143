//! Which processes ask for jobs. One that waits for a job holds no lease, so that the store does not know it.

use std::collections::{BTreeMap, HashMap};
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
    /// Whether it makes exports that need Gmsh.
    can_mesh: bool,
}

impl Heard {
    /// A request of a process, which makes exports that need Gmsh or does not, until what is returned is dropped.
    /// Processes that were not heard within `lease` are forgotten, so that there are never many.
    pub(crate) fn asking(&self, name: ProcessName, can_mesh: bool, lease: Duration) -> Asking {
        let mut processes = self.lock();
        processes.retain(|_, process| process.asking > 0 || process.at.elapsed() < lease);
        let new = Process { asking: 0, at: Instant::now(), can_mesh };
        let process = processes.entry(name.clone()).or_insert(new);
        process.asking += 1;
        process.can_mesh = can_mesh;
        Asking { heard: self.clone(), name }
    }

    /// The processes that were heard within `lease`, and whether each makes exports that need Gmsh.
    pub(crate) fn within(&self, lease: Duration) -> BTreeMap<ProcessName, bool> {
        let processes = self.lock();
        let heard =
            processes.iter().filter(|(_, process)| process.asking > 0 || process.at.elapsed() < lease);
        heard.map(|(name, process)| (name.clone(), process.can_mesh)).collect()
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
        let first = heard.asking(name("a"), false, hour);
        let again = heard.asking(name("a"), false, hour);
        let other = heard.asking(name("b"), true, hour);
        assert_eq!(heard.within(none).len(), 2);
        drop((first, other));
        assert_eq!(
            heard.within(none),
            BTreeMap::from([(name("a"), false)]),
            "its second request is not answered yet"
        );
        drop(again);
        assert_eq!(heard.within(none), BTreeMap::new());
        assert_eq!(heard.within(hour), BTreeMap::from([(name("a"), false), (name("b"), true)]));
        let next = heard.asking(name("c"), false, none);
        assert_eq!(heard.within(hour), BTreeMap::from([(name("c"), false)]), "the others are forgotten");
        drop(next);
    }
}
