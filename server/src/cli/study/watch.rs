//! The progress of a study at the terminal.

use std::time::Duration;

use indicatif::HumanDuration;

use super::super::bar::Bar;
use super::worker_pool::WorkerPool;

/// The remaining time is shown from this fraction of the work on.
const LEFT_FROM_SHARE: f64 = 0.02;

/// The progress of one call.
pub(super) struct Watch {
    bar: Bar,
    /// Runs that had ended before.
    before: usize,
}

impl Watch {
    /// Of a study of which `before` runs had ended.
    pub(super) fn new(before: usize) -> Self {
        Self { bar: Bar::new(), before }
    }

    /// So many runs more had ended before.
    pub(super) fn found(&mut self, runs: usize) {
        self.before += runs;
    }

    /// Shows the progress of the study.
    pub(super) fn show(&self, ended: usize, successes: u64, pool: &WorkerPool<'_>) {
        let before = self.before;
        let jobs = ended + pool.left();
        // The end of a run may be noted before its thread has taken back its fraction.
        let done = (ended as f64 + pool.fraction_of_running()).min(jobs as f64);
        let share = |of: f64, all: f64| if all > 0.0 { of / all } else { 1.0 };
        let left = left(self.bar.elapsed(), share(done - before as f64, (jobs - before.min(jobs)) as f64));
        self.bar.show(share(done, jobs as f64), || message(ended, jobs, successes, left));
    }

    /// Prints a line above the bar.
    pub(super) fn say(&self, line: &str) {
        self.bar.say(line);
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        self.bar.finish();
    }
}

/// The remaining time, from the time that a fraction of the work took.
fn left(elapsed: Duration, share: f64) -> Option<Duration> {
    (share >= LEFT_FROM_SHARE).then(|| elapsed.mul_f64((1.0 / share - 1.0).max(0.0)))
}

fn message(ended: usize, jobs: usize, successes: u64, left: Option<Duration>) -> String {
    let left = left.map(|left| format!(", {} left", HumanDuration(left))).unwrap_or_default();
    format!("{ended} of {jobs} runs, {successes} succeeded{left}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_waits_for_a_basis() {
        let minute = Duration::from_mins(1);
        assert_eq!(left(minute, 0.0), None);
        assert_eq!(left(minute, 0.019), None);
        assert_eq!(left(minute, 0.25), Some(3 * minute));
        assert_eq!(left(minute, 1.0), Some(Duration::ZERO));
    }

    #[test]
    fn the_line_counts_runs() {
        assert_eq!(message(3, 40, 2, None), "3 of 40 runs, 2 succeeded");
        let line = message(20, 40, 20, Some(Duration::from_mins(3)));
        assert_eq!(line, "20 of 40 runs, 20 succeeded, 3 minutes left");
    }
}
