//! A kind of tasks, as the [`executor`](super::executor) knows it: packings of jobs ([`packing`](super::packing)) and
//! exports ([`exports::making`](crate::exports::making)); in slots run both ([`in_slots`](super::in_slots)).

use std::time::Duration;

use tokio::sync::{oneshot, watch};
use tokio_util::sync::CancellationToken;

use super::control::RunControl;
use super::ending::{NotMade, Told};
use super::slots::Held;
use crate::ids::ExportId;
use crate::jobs::notifications::Subscription;
use crate::jobs::store::StoreError;
use crate::jobs::{JobId, JobProgress, StopRequests};

/// A leased task, if there is one, with its slots.
pub(crate) type Claimed<W> = Result<Option<(W, Option<Held>)>, LeaseError>;

/// Where tasks come from.
pub(crate) trait TaskSource: TaskKind {
    /// Leases the next task, with the slots that it holds where the kind has any. `None` where none came for a while,
    /// or the process is to stop.
    ///
    /// # Errors
    /// Those of the source.
    fn claim(&self, shutdown: &CancellationToken) -> impl Future<Output = Claimed<Self::Work>> + Send;

    /// Whether there are no more tasks for this process.
    fn are_over(&self) -> bool {
        false
    }
}

/// How a task of a kind is run, and who is told of it.
pub(crate) trait TaskKind: Clone + Send + Sync + 'static {
    /// A leased task.
    type Work: Send + Sync + 'static;
    /// What a run leaves on disk.
    type Made: Send + Sync + 'static;

    /// What the executor knows of a task.
    fn terms(&self, work: &Self::Work) -> Terms;

    /// Fetches what earlier attempts have left; the control of the run.
    fn prepare(&self, work: &Self::Work) -> impl Future<Output = RunControl> + Send;

    /// The run itself, on a thread that may block. It drops `computing` as soon as the next task may begin.
    ///
    /// # Errors
    /// Why nothing was made. Where the run was to stop, the reason to stop counts instead.
    fn run(
        &self,
        work: &Self::Work,
        control: &RunControl,
        computing: Computing,
    ) -> Result<Self::Made, NotMade>;

    /// Starts to listen for requests of clients, and for the loss of the lease.
    fn follow(&self, work: &Self::Work) -> Following;

    /// What clients want of the task.
    ///
    /// # Errors
    /// [`LeaseError::Lost`], or those of the source.
    fn requests(&self, work: &Self::Work) -> impl Future<Output = Result<StopRequests, LeaseError>> + Send;

    /// Renews the lease, with the progress where there is any; what clients want of the task.
    ///
    /// # Errors
    /// [`LeaseError::Lost`], or those of the source.
    fn renew(
        &self,
        work: &Self::Work,
        news: Option<JobProgress>,
    ) -> impl Future<Output = Result<StopRequests, LeaseError>> + Send;

    /// Time between two renewals, at most.
    fn renew_every(&self) -> Duration;

    /// Leaves to the next attempt what the process has of a task that it gives back.
    fn hand_on(&self, _work: &Self::Work) -> impl Future<Output = ()> + Send {
        std::future::ready(())
    }

    /// Tells how a run ended.
    ///
    /// # Errors
    /// [`LeaseError::Lost`], or those of the source.
    fn end(
        &self,
        work: &Self::Work,
        told: Told<'_, Self::Made>,
    ) -> impl Future<Output = Result<(), LeaseError>> + Send;

    /// Counts the run, and removes what nobody has a use for once its end was told.
    fn ended(&self, work: &Self::Work, ended: Ended<'_, Self::Made>) -> impl Future<Output = ()> + Send;
}

/// What the executor knows of a task.
pub(crate) struct Terms {
    pub(crate) span: tracing::Span,
    /// Time that the run may take.
    pub(crate) timeout_s: Option<f64>,
    /// Faults of the machine that earlier runs have met.
    pub(crate) faults: i64,
}

/// Held while a run computes, and dropped when its file is left to be written or recorded.
pub(crate) struct Computing {
    // Go before the signal, so that who follows it finds the slots free.
    pub(super) _slots: Option<Held>,
    // Nothing is ever sent: it goes when the run has computed, however it ends.
    pub(super) _done: oneshot::Sender<()>,
}

/// A run whose end was told.
pub(crate) struct Ended<'a, M> {
    /// What it has made.
    pub(crate) made: Option<&'a M>,
    /// The task goes back to the queue.
    pub(crate) is_requeued: bool,
    /// The end is recorded: the lease was not lost.
    pub(crate) is_recorded: bool,
    /// Its name in the log and the metrics.
    pub(crate) outcome: &'static str,
    pub(crate) took: Duration,
}

impl<'a, M> Ended<'a, M> {
    /// The same of what is made of it.
    pub(super) fn of<N>(self, of: impl FnOnce(&'a M) -> Option<&'a N>) -> Ended<'a, N> {
        let Self { made, is_requeued, is_recorded, outcome, took } = self;
        Ended { made: made.and_then(of), is_requeued, is_recorded, outcome, took }
    }
}

/// Why a lease was not renewed or ended.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LeaseError {
    /// Another attempt holds the task, or none does.
    #[error("the lease was lost")]
    Lost,
    /// A fault of the machine or the network, which passes.
    #[error("{0}")]
    Passing(String),
    /// A defect, or a refusal.
    #[error("{0}")]
    Failed(String),
}

impl From<StoreError> for LeaseError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::LeaseLost => Self::Lost,
            other if other.fault().is_some() => Self::Passing(other.to_string()),
            other => Self::Failed(other.to_string()),
        }
    }
}

/// Tells of requests of clients about a task, and of its loss.
pub(crate) enum Following {
    /// A job of the store of this process.
    Job(Subscription<JobId>),
    /// A job or an export of a server.
    There(watch::Receiver<super::there::State>),
    /// An export, and its job, with which it goes.
    Export(Subscription<ExportId>, Subscription<JobId>),
}

impl Following {
    /// Waits for a change since the last call, or since the start.
    pub(super) async fn changed(&mut self) {
        match self {
            Self::Job(changes) => changes.changed().await,
            Self::There(changes) => {
                if changes.changed().await.is_err() {
                    std::future::pending::<()>().await;
                }
            }
            Self::Export(export, job) => tokio::select! {
                () = export.changed() => {}
                () = job.changed() => {}
            },
        }
    }
}
