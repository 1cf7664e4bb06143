//! How far the work at the terminal is: a bar, or a line now and then where there is no terminal to draw
//! one on.
//!
//! It draws what it is told; it must never know what the work is.

use std::io::IsTerminal as _;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::telemetry::say;

const STEPS: u64 = 1000;
/// Without a terminal a line is told no more often than this.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// A bar on standard error.
pub(super) struct Bar {
    drawn: ProgressBar,
    start: Instant,
    told: Mutex<Instant>,
}

impl Bar {
    /// A bar of work that begins now.
    pub(super) fn new() -> Self {
        let now = Instant::now();
        Self { drawn: drawn(), start: now, told: Mutex::new(now) }
    }

    /// Time since the work began.
    pub(super) fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Shows which fraction of the work is done, and says more in words.
    pub(super) fn show(&self, fraction: f64, message: impl FnOnce() -> String) {
        if !self.drawn.is_hidden() {
            self.drawn.set_position((fraction * STEPS as f64) as u64);
            self.drawn.set_message(message());
            return;
        }
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.elapsed() >= LINE_EVERY {
            *told = Instant::now();
            say(&format!("[{:.0} s] {}", self.elapsed().as_secs_f64(), message()));
        }
    }

    /// Tells a line.
    pub(super) fn say(&self, line: &str) {
        if self.drawn.is_hidden() { say(line) } else { self.drawn.println(line) }
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.drawn.finish_and_clear();
    }
}

/// Hidden where standard error is no terminal.
fn drawn() -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(STEPS);
    if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} [{bar:30}] {percent} % {msg}") {
        bar.set_style(style);
    }
    bar
}
