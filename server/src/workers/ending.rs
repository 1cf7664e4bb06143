//! How a run ended, and what a store or a server is told of it.

use std::time::Duration;

use packstone_engine::Phase;

use super::control::Stop;
use crate::artifacts::InFlight;
use crate::exports::NewExport;
use crate::failure::Failure;
use crate::jobs::{ArtifactRecord, JobProgress};
use crate::studies::Facts;

/// How a run ended.
pub(crate) enum End {
    /// The result is on disk; its place stays claimed until the store refers to it.
    Stored(Box<Stored>),
    Stopped(Stop),
    Failed(FailedRun),
    /// A fault of the machine kept the run from its end, or the result from being stored.
    Faulted(Cause),
}

/// Which fault of the machine a run met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cause {
    /// A result of so many bytes would not fit into the room that the source of the job told of.
    NoRoom(u64),
    /// A result of so many bytes could not be written to the disk of this process.
    NotWritten(u64),
    /// Another.
    Other,
}

/// What a run left on disk, and what is known of it.
pub(crate) struct Stored {
    pub(crate) artifact: ArtifactRecord,
    pub(crate) facts: Facts,
    pub(crate) grains: u64,
    pub(crate) postprocess: Vec<NewExport>,
    pub(crate) _place: InFlight,
}

/// What is known of a run besides its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) took: Duration,
    pub(crate) timeout_s: Option<f64>,
    /// Share of the work done.
    pub(crate) fraction: f64,
}

/// Why a run made no packing, and what a study keeps of it.
pub(crate) struct FailedRun {
    pub(crate) failure: Box<Failure>,
    pub(crate) facts: Facts,
}

impl From<Failure> for FailedRun {
    fn from(failure: Failure) -> Self {
        Self { failure: Box::new(failure), facts: Facts::default() }
    }
}

/// What is told of an end.
pub(crate) enum Told<'a> {
    Succeeded(&'a Stored),
    Failed(Failure, Facts),
    Cancelled,
    /// The process stops: the job goes back to the queue.
    Released,
    /// The job goes back to the queue, for a fault of the machine.
    Faulted(Cause),
    /// Nothing: the job is another attempt's.
    Nothing,
}

impl End {
    /// Its name in the log and the metrics.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Stored(_) => "succeeded",
            Self::Failed(_) | Self::Stopped(Stop::TimedOut) => "failed",
            Self::Stopped(Stop::Cancelled) => "cancelled",
            Self::Stopped(Stop::Shutdown) => "given_back",
            Self::Stopped(Stop::LeaseLost) => "lease_lost",
            Self::Faulted(_) => "requeued",
        }
    }

    /// What is told of the end of this run.
    pub(crate) fn told(&self, run: Run) -> Told<'_> {
        let time_s = run.took.as_secs_f64();
        match self {
            Self::Stored(stored) => Told::Succeeded(stored),
            Self::Failed(FailedRun { failure, facts }) => {
                Told::Failed((**failure).clone(), Facts { time_s, ..facts.clone() })
            }
            Self::Stopped(Stop::Cancelled) => Told::Cancelled,
            Self::Stopped(Stop::TimedOut) => {
                let failure = Failure::timed_out(run.timeout_s.unwrap_or_default(), run.fraction);
                Told::Failed(failure, Facts { time_s, ..Facts::default() })
            }
            Self::Stopped(Stop::Shutdown) => Told::Released,
            Self::Faulted(cause) => Told::Faulted(*cause),
            Self::Stopped(Stop::LeaseLost) => Told::Nothing,
        }
    }
}

/// Progress of a job that succeeded: a run can end between two reports.
pub(crate) fn complete(grains: u64) -> JobProgress {
    JobProgress {
        fraction: 1.0,
        phase: Phase::Write,
        done: grains,
        total: grains,
        unit: "grains".into(),
        message: String::new(),
        eta_s: Some(0.0),
        growth: None,
    }
}
