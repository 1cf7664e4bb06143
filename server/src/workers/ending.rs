//! How a run ended, and what a store or a server is told of it.

use std::time::Duration;

use super::control::Stop;
use crate::failure::{Failure, FailureCode};
use crate::studies::Facts;

/// How often a task is requeued that finds no memory.
pub(crate) const MEMORY_FAULTS: i64 = 5;

/// How a run ended that is to make an `M`.
pub(crate) enum End<M> {
    /// The file is on disk.
    Made(M),
    Stopped(Stop),
    Failed(FailedRun),
    /// A fault of the machine kept the run from its end, or the file from being stored.
    Faulted(Cause),
}

/// Why a run made nothing.
pub(crate) enum NotMade {
    /// By the request, what it is made from, or a defect.
    Failed(FailedRun),
    /// By a fault of the machine.
    Faulted(Cause),
}

/// Which fault of the machine a run met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cause {
    /// A result of so many bytes would not fit into the room that the source of the job told of.
    NoRoom(u64),
    /// A result of so many bytes could not be written to the disk of this process.
    NotWritten(u64),
    /// The system refused memory.
    NoMemory,
    /// Another.
    Other,
}

/// What is known of a run besides its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) took: Duration,
    pub(crate) timeout_s: Option<f64>,
    /// Share of the work done.
    pub(crate) fraction: f64,
}

/// Why a run failed, and what a study keeps of it.
pub(crate) struct FailedRun {
    pub(crate) failure: Box<Failure>,
    pub(crate) facts: Box<Facts>,
}

impl From<Failure> for FailedRun {
    fn from(failure: Failure) -> Self {
        Self { failure: Box::new(failure), facts: Box::default() }
    }
}

impl<F: Into<FailedRun>> From<F> for NotMade {
    fn from(failed: F) -> Self {
        Self::Failed(failed.into())
    }
}

/// What is told of an end.
pub(crate) enum Told<'a, M> {
    Succeeded(&'a M),
    Failed(Failure, Box<Facts>),
    Cancelled,
    /// The process stops: the task goes back to the queue.
    Released,
    /// The task goes back to the queue, for a fault of the machine.
    Faulted(Cause),
    /// Nothing: the task is another attempt's.
    Nothing,
}

impl<'a, M> Told<'a, M> {
    /// The same of what is made of it; nothing where there is none.
    pub(super) fn of<N>(self, of: impl FnOnce(&'a M) -> Option<&'a N>) -> Told<'a, N> {
        match self {
            Self::Succeeded(made) => of(made).map_or(Told::Nothing, Told::Succeeded),
            Self::Failed(failure, facts) => Told::Failed(failure, facts),
            Self::Cancelled => Told::Cancelled,
            Self::Released => Told::Released,
            Self::Faulted(cause) => Told::Faulted(cause),
            Self::Nothing => Told::Nothing,
        }
    }
}

/// Name of an end of a run whose task is another attempt's, in the log and the metrics.
pub(crate) const LEASE_LOST: &str = "lease_lost";

impl<M> End<M> {
    /// The end of a run that made nothing, of a task that has met so many faults of the machine before. Another run may
    /// have taken the memory; a task that never finds any fails.
    pub(super) fn of(not_made: NotMade, faults: i64) -> Self {
        match not_made {
            NotMade::Failed(FailedRun { failure, .. })
                if failure.code == FailureCode::OutOfMemory && faults < MEMORY_FAULTS =>
            {
                tracing::warn!(error = failure.detail, "the run found no memory");
                Self::Faulted(Cause::NoMemory)
            }
            NotMade::Failed(failed) => Self::Failed(failed),
            NotMade::Faulted(cause) => Self::Faulted(cause),
        }
    }

    /// What the run has made.
    pub(super) fn made(&self) -> Option<&M> {
        match self {
            Self::Made(made) => Some(made),
            _ => None,
        }
    }

    /// Its name in the log and the metrics.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Made(_) => "succeeded",
            Self::Failed(_) | Self::Stopped(Stop::TimedOut) => "failed",
            Self::Stopped(Stop::Cancelled) => "cancelled",
            Self::Stopped(Stop::Shutdown) => "given_back",
            Self::Stopped(Stop::LeaseLost) => LEASE_LOST,
            Self::Faulted(_) => "requeued",
        }
    }

    /// What is told of the end of this run.
    pub(crate) fn told(&self, run: Run) -> Told<'_, M> {
        let time_s = run.took.as_secs_f64();
        match self {
            Self::Made(made) => Told::Succeeded(made),
            Self::Failed(FailedRun { failure, facts }) => {
                Told::Failed((**failure).clone(), Box::new(Facts { time_s, ..(**facts).clone() }))
            }
            Self::Stopped(Stop::Cancelled) => Told::Cancelled,
            Self::Stopped(Stop::TimedOut) => {
                let failure = Failure::timed_out(run.timeout_s.unwrap_or_default(), run.fraction);
                Told::Failed(failure, Box::new(Facts { time_s, ..Facts::default() }))
            }
            Self::Stopped(Stop::Shutdown) => Told::Released,
            Self::Faulted(cause) => Told::Faulted(*cause),
            Self::Stopped(Stop::LeaseLost) => Told::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_that_never_finds_memory_fails() {
        let end = |code, faults| End::<()>::of(Failure::new(code, "why").into(), faults);
        assert!(matches!(end(FailureCode::OutOfMemory, MEMORY_FAULTS - 1), End::Faulted(Cause::NoMemory)));
        let End::Failed(failed) = end(FailureCode::OutOfMemory, MEMORY_FAULTS) else {
            panic!("it goes on for ever")
        };
        assert_eq!(failed.failure.code, FailureCode::OutOfMemory);
        assert!(matches!(end(FailureCode::TooLarge, 0), End::Failed(_)));
        let full = End::<()>::of(NotMade::Faulted(Cause::NotWritten(1)), 100);
        assert!(matches!(full, End::Faulted(Cause::NotWritten(1))), "a full disk is waited for");
    }
}
