//! Jobs whose state a client has asked for lately. A client that polls watches a job as one that is connected does, and
//! nothing else tells of it between two requests.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::jobs::JobId;

/// For how long a request counts as watching.
pub(crate) const RECENT: Duration = Duration::from_secs(30);
/// So many jobs are kept without a look for those that were asked for too long ago.
const FEW: usize = 64;

/// The jobs that were asked for, each with the time of the last request.
#[derive(Debug, Default)]
pub(crate) struct Polled {
    jobs: Mutex<Asked>,
}

#[derive(Debug, Default)]
struct Asked {
    at: HashMap<JobId, Instant>,
    /// Old ones are forgotten when there are so many: twice as many as were left the last time, so that a request costs
    /// the same however many jobs are polled.
    look_at: usize,
}

impl Polled {
    /// Notes a request for the state of a job. Those of before the last `recent` may be forgotten.
    pub(crate) fn note(&self, job: JobId, recent: Duration) {
        let mut asked = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        if asked.at.len() >= asked.look_at.max(FEW) {
            asked.at.retain(|_, at| at.elapsed() < recent);
            asked.look_at = 2 * asked.at.len();
        }
        asked.at.insert(job, Instant::now());
    }

    /// Whether there was a request for the state of a job within the last `recent`.
    pub(crate) fn is_recent(&self, job: JobId, recent: Duration) -> bool {
        let asked = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        asked.at.get(&job).is_some_and(|at| at.elapsed() < recent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_counts_for_a_while_and_old_ones_are_forgotten() {
        let (polled, hour) = (Polled::default(), Duration::from_hours(1));
        let (first, other) = (JobId::new(), JobId::new());
        polled.note(first, hour);
        assert!(polled.is_recent(first, hour) && !polled.is_recent(first, Duration::ZERO));
        assert!(!polled.is_recent(other, hour));
        for _ in 0..10 * FEW {
            polled.note(JobId::new(), Duration::ZERO);
        }
        assert!(!polled.is_recent(first, hour), "it was forgotten");
        assert!(polled.jobs.lock().is_ok_and(|asked| asked.at.len() <= FEW));
    }
}
