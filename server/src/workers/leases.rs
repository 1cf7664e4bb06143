//! Where an executor gets jobs, and whom it tells of them: the store of this process, or a server over HTTP.

use std::time::Duration;

use packstone_engine::Limits;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::ending::{End, Run};
use super::here::Here;
use super::slots::{Held, Slots};
use super::there::There;
use crate::checkpoints::Checkpoints;
use crate::jobs::notifications::Subscription;
use crate::jobs::store::StoreError;
use crate::jobs::{JobId, JobProgress, Lease};
use crate::storage::Bound;

/// A job to run.
#[derive(Clone, Debug)]
pub(crate) struct Work {
    pub(crate) lease: Lease,
    /// The request as stored.
    pub(crate) request: String,
    pub(crate) timeout_s: Option<f64>,
    /// Faults of the machine that earlier runs have met.
    pub(crate) faults: i64,
    /// What the run may use.
    pub(crate) limits: Limits,
    /// Bytes that the result may have, and what bounds them.
    pub(crate) room: (u64, Bound),
    /// An attempt before has left a checkpoint, which is not in this process.
    pub(crate) has_checkpoint: bool,
}

/// Why a lease was not renewed or ended.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LeaseError {
    /// Another attempt holds the job, or none does.
    #[error("the lease of the job was lost")]
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

/// A source of jobs.
#[derive(Clone, Debug)]
pub(crate) enum Leases {
    /// The store of this process.
    Here(Here),
    /// A server.
    There(There),
}

/// Tells of requests to cancel a job, and of its loss.
pub(crate) enum Following {
    Here(Subscription<JobId>),
    There(watch::Receiver<super::there::State>),
}

impl Following {
    /// Waits for a change since the last call, or since the start.
    pub(crate) async fn changed(&mut self) {
        match self {
            Self::Here(changes) => changes.changed().await,
            Self::There(changes) => {
                if changes.changed().await.is_err() {
                    std::future::pending::<()>().await;
                }
            }
        }
    }
}

impl Leases {
    /// Leases the next job once a slot is free, and takes its slots. `None` where none came for a while, or the
    /// process is to stop.
    ///
    /// # Errors
    /// Those of the source.
    pub(crate) async fn claim(
        &self,
        slots: &Slots,
        shutdown: &CancellationToken,
    ) -> Result<Option<(Work, Held)>, LeaseError> {
        match self {
            Self::Here(here) => here.claim(slots, shutdown).await,
            Self::There(there) => there.claim(slots, shutdown).await,
        }
    }

    /// Whether the source has no more jobs for this process.
    pub(crate) fn are_over(&self) -> bool {
        match self {
            Self::Here(_) => false,
            Self::There(there) => there.is_over(),
        }
    }

    /// Fetches what earlier attempts have left, where it is not in this process.
    pub(crate) async fn prepare(&self, work: &Work, checkpoints: &Checkpoints) {
        if let Self::There(there) = self {
            there.fetch_checkpoint(work, checkpoints).await;
        }
    }

    /// Starts to listen for requests to cancel.
    pub(crate) fn follow(&self, lease: Lease) -> Following {
        match self {
            Self::Here(here) => Following::Here(here.store.subscribe(lease.id)),
            Self::There(there) => Following::There(there.follow(lease)),
        }
    }

    /// Whether a client has cancelled the job.
    ///
    /// # Errors
    /// [`LeaseError::Lost`], or those of the source.
    pub(crate) async fn is_cancelled(&self, lease: Lease) -> Result<bool, LeaseError> {
        match self {
            Self::Here(here) => {
                let job = here.store.get(lease.id).await?;
                Ok(job.is_some_and(|job| job.cancel_requested))
            }
            Self::There(there) => there.is_cancelled(lease),
        }
    }

    /// Renews the lease, with the progress where there is any; whether a client has cancelled the job.
    ///
    /// # Errors
    /// [`LeaseError::Lost`], or those of the source.
    pub(crate) async fn renew(&self, lease: Lease, news: Option<JobProgress>) -> Result<bool, LeaseError> {
        match self {
            Self::Here(here) => Ok(here.store.heartbeat(lease, news).await?.cancel_requested),
            Self::There(there) => there.renew(lease, news),
        }
    }

    /// Time between two renewals, at most.
    pub(crate) fn renew_every(&self) -> Duration {
        match self {
            Self::Here(here) => here.store.renew_every(),
            // The process renews all its leases together.
            Self::There(_) => Duration::from_secs(1),
        }
    }

    /// Tells how a run ended, with its result.
    ///
    /// # Errors
    /// [`LeaseError::Lost`], or those of the source.
    pub(crate) async fn end(&self, lease: Lease, end: &End, run: Run) -> Result<(), LeaseError> {
        match self {
            Self::Here(here) => here.end(lease, end.told(run)).await,
            Self::There(there) => there.end(lease, end.told(run)).await,
        }
    }
}

/// How long an idle process waits for a job before it looks whether it is to stop.
pub(super) const CLAIM_WAIT: Duration = Duration::from_secs(30);
