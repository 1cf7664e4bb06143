//! How far a study is, for the person at the terminal: a bar, or a line now and then where there is no
//! terminal to draw one on.

use std::cell::Cell;
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

use super::crew::Crew;

const STEPS: u64 = 1000;
/// Without a terminal a line is told no more often than this.
const LINE_EVERY: Duration = Duration::from_secs(10);
/// Before this share of the work, the time that is left is a guess not worth showing.
const LEFT_FROM_SHARE: f64 = 0.02;

/// Tells of one call's work.
pub(super) struct Watch {
    bar: ProgressBar,
    start: Instant,
    told: Cell<Instant>,
    /// Runs that had ended before.
    before: usize,
}

impl Watch {
    /// Of a study of which `before` runs had ended.
    pub(super) fn new(before: usize) -> Self {
        Self { bar: bar(), start: Instant::now(), told: Cell::new(Instant::now()), before }
    }

    /// Shows where the study is.
    pub(super) fn show(&self, ended: usize, successes: u64, crew: &Crew<'_>) {
        let before = self.before;
        let jobs = ended + crew.waiting() + crew.running();
        let done = ended as f64 + crew.on_the_way();
        let share = |of: f64, all: f64| if all > 0.0 { of / all } else { 1.0 };
        let left = left(self.start.elapsed(), share(done - before as f64, (jobs - before.min(jobs)) as f64));
        let message = message(ended, jobs, successes, left);
        if self.bar.is_hidden() {
            if self.told.get().elapsed() >= LINE_EVERY {
                self.told.set(Instant::now());
                eprintln!("[{:.0} s] {message}", self.start.elapsed().as_secs_f64());
            }
            return;
        }
        self.bar.set_position((share(done, jobs as f64) * STEPS as f64) as u64);
        self.bar.set_message(message);
    }

    /// Tells a line.
    pub(super) fn say(&self, line: &str) {
        self.bar.suspend(|| eprintln!("{line}"));
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// How long the rest will take, when so much of the work took so long.
fn left(elapsed: Duration, share: f64) -> Option<Duration> {
    (share >= LEFT_FROM_SHARE).then(|| elapsed.mul_f64((1.0 / share - 1.0).max(0.0)))
}

fn message(ended: usize, jobs: usize, successes: u64, left: Option<Duration>) -> String {
    let left = left.map(|left| format!(", {} left", HumanDuration(left))).unwrap_or_default();
    format!("{ended} of {jobs} runs, {successes} succeeded{left}")
}

/// A bar; hidden where standard error is no terminal.
fn bar() -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(STEPS);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} [{bar:30}] {percent} % {msg}") {
        bar.set_style(style);
    }
    bar
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
