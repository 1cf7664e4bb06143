//! What stands around a run at the terminal: its bar, its checkpoints, and the signals that stop it.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use packstone_engine::{Checkpoint, Control, Phase, Progress};

use super::super::bar::Bar;
use super::super::exit::Failure;
use super::super::signals::stop_on_signals;
use crate::checkpoints::{self, Schedule};
use crate::remaining_time::RemainingTime;

/// Control of a run at the terminal.
pub(super) struct Watch {
    bar: Bar,
    remaining: Mutex<RemainingTime>,
    stop: Arc<AtomicBool>,
    file: PathBuf,
    schedule: Schedule,
    failing: AtomicBool,
}

impl Watch {
    /// Watches a run whose checkpoints go to `file`, and that goes on from one where it is `resumed`.
    pub(super) fn new(file: PathBuf, every: Duration, resumed: bool) -> Result<Self, Failure> {
        let mut remaining = RemainingTime::default();
        if resumed {
            remaining.resumed();
        }
        Ok(Self {
            bar: Bar::new(),
            remaining: Mutex::new(remaining),
            stop: stop_on_signals()?,
            file,
            schedule: Schedule::new(every),
            failing: AtomicBool::new(false),
        })
    }

    /// Set when the run is to stop.
    pub(super) fn stop(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.bar.finish();
    }
}

impl Control for Watch {
    fn report(&self, progress: &Progress) {
        let mut remaining = self.remaining.lock().unwrap_or_else(PoisonError::into_inner);
        remaining.follow(progress, self.bar.elapsed());
        self.bar.show(remaining.fraction(), || message(progress, remaining.eta_s(self.bar.elapsed())));
    }

    fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    fn wants_checkpoint(&self) -> bool {
        self.schedule.is_due()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let start = Instant::now();
        match checkpoints::write(&self.file, checkpoint) {
            Ok(_) => self.failing.store(false, Ordering::Relaxed),
            Err(error) => {
                if !self.failing.swap(true, Ordering::Relaxed) {
                    let said = format!(
                        "warning: {} cannot be written: {error}; the run goes on",
                        self.file.display()
                    );
                    self.bar.say(&said);
                }
            }
        }
        self.schedule.tried(start.elapsed());
    }
}

/// One line about where the run stands.
fn message(progress: &Progress, eta_s: Option<f64>) -> String {
    let phase = match progress.phase {
        Phase::Sampling => "sampling",
        Phase::Rsa => "rsa",
        Phase::Edmd => "edmd",
        Phase::MonteCarlo => "monte_carlo",
        Phase::Check => "check",
        Phase::Export => "export",
        Phase::Write => "write",
    };
    let line = match &progress.growth {
        Some(growth) => {
            let distance = growth.distance_mm.map(|mm| format!(", distance {mm:.3} mm")).unwrap_or_default();
            format!(
                "{phase}: volume fraction {:.4}{distance}, {:.2e} events/s",
                growth.volume_fraction, growth.events_per_s
            )
        }
        None => format!("{phase}: {}/{} {}", progress.done, progress.total, progress.unit),
    };
    let left = eta_s.map(|s| format!(", {s:.0} s left")).unwrap_or_default();
    line + &left
}

#[cfg(test)]
mod tests {
    use packstone_engine::Growth;

    use super::*;

    #[test]
    fn the_line_tells_what_the_phase_is_about() {
        let mut progress = Progress {
            phase: Phase::Rsa,
            fraction: 0.5,
            done: 3,
            total: 7,
            unit: "grains",
            message: String::new(),
            growth: None,
        };
        assert_eq!(message(&progress, None), "rsa: 3/7 grains");
        progress.phase = Phase::Edmd;
        progress.growth = Some(Growth {
            volume_fraction: 0.66123,
            distance_mm: Some(0.93),
            events: 10,
            events_per_s: 1_234_000.0,
            reduced_pressure: None,
            predictable: true,
        });
        assert_eq!(
            message(&progress, Some(34.6)),
            "edmd: volume fraction 0.6612, distance 0.930 mm, 1.23e6 events/s, 35 s left"
        );
    }
}
