//! What stands around a run at the terminal: its bar, its checkpoints, and the signals that stop it.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use packstone_engine::{Checkpoint, Control, Finish, Progress, Step};

use super::super::bar::Bar;
use super::super::exit::Failure;
use super::super::signals::stop_on_signals;
use crate::failure::Failure as JobFailure;
use crate::jobs::JobRequest;
use crate::local::Run;

/// Control of a run at the terminal: that of a run in any process, with a bar, and stopped by signals.
pub(super) struct Watch {
    bar: Bar,
    run: Run,
    every: Duration,
    stop: Arc<AtomicBool>,
    failing: AtomicBool,
}

impl Watch {
    /// Watches the run of a job whose checkpoints go to `file`, and that goes on from one where it is `resumed`.
    pub(super) fn new(
        job: &JobRequest,
        file: &Path,
        every: Duration,
        resumed: bool,
    ) -> Result<Self, Failure> {
        let run = Run::with_checkpoint_every(every);
        run.begin(Some(file), resumed, job.timeout_s, job.on_limit);
        Ok(Self { bar: Bar::new(), run, every, stop: stop_on_signals()?, failing: AtomicBool::new(false) })
    }

    /// Time between two checkpoints.
    pub(super) fn checkpoint_every(&self) -> Duration {
        self.every
    }

    /// Set when the run is to stop.
    pub(super) fn stop(&self) -> &Arc<AtomicBool> {
        &self.stop
    }

    /// The failure of a run that the time limit of its job ended; `None` where a signal did.
    pub(super) fn timed_out(&self, job: &JobRequest) -> Option<JobFailure> {
        self.run.timed_out(job.timeout_s)
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.bar.finish();
    }

    /// Passes on the request to stop.
    fn pass_on_stop(&self) {
        if self.stop.load(Ordering::Acquire) {
            self.run.stop();
        }
    }
}

impl Control for Watch {
    fn report(&self, progress: &Progress) {
        self.run.report(progress);
        let (fraction, eta_s) = self.run.fraction_and_eta_s();
        self.bar.show(fraction, || message(progress, eta_s));
    }

    fn should_stop(&self) -> bool {
        self.pass_on_stop();
        self.run.should_stop()
    }

    fn should_finish(&self) -> Option<Finish> {
        self.run.should_finish()
    }

    fn wants_last_checkpoint(&self) -> bool {
        self.run.wants_last_checkpoint()
    }

    fn wants_checkpoint(&self) -> bool {
        self.pass_on_stop();
        self.run.wants_checkpoint()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        self.run.keep_checkpoint(checkpoint);
        let fault = self.run.take_fault();
        let was_failing = self.failing.swap(fault.is_some(), Ordering::Relaxed);
        if let Some(fault) = fault.filter(|_| !was_failing) {
            self.bar.say(&format!("warning: {fault}; the run goes on"));
        }
    }
}

/// One line about where the run stands.
fn message(progress: &Progress, eta_s: Option<f64>) -> String {
    let step = match progress.step {
        Step::Sampling => "sampling",
        Step::Rsa => "rsa",
        Step::Edmd => "edmd",
        Step::MonteCarlo => "monte_carlo",
        Step::Check => "check",
        Step::Export => "export",
        Step::Write => "write",
    };
    let line = match &progress.growth {
        Some(growth) => {
            let distance = growth.distance_mm.map(|mm| format!(", distance {mm:.3} mm")).unwrap_or_default();
            format!(
                "{step}: volume fraction {:.4}{distance}, {:.2e} events/s",
                growth.volume_fraction, growth.events_per_s
            )
        }
        None => format!("{step}: {}/{} {}", progress.done, progress.total, progress.unit),
    };
    let left = eta_s.map(|s| format!(", {s:.0} s left")).unwrap_or_default();
    line + &left
}

#[cfg(test)]
mod tests {
    use packstone_engine::Growth;

    use super::*;

    #[test]
    fn the_line_tells_what_the_step_is_about() {
        let mut progress = Progress {
            step: Step::Rsa,
            fraction: 0.5,
            done: 3,
            total: 7,
            unit: "grains",
            message: String::new(),
            growth: None,
        };
        assert_eq!(message(&progress, None), "rsa: 3/7 grains");
        progress.step = Step::Edmd;
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
