//! What runs in the slots of a process: packings of jobs, and the exports that take as long, where the request of a job
//! asked for them. So a machine is not used twice, and what a worker has packed it also meshes or solves.
//!
//! A task holds a slot for each of its threads ([`slots`](super::slots)). Exports come before the next job.

use std::time::Duration;

use tokio_util::sync::CancellationToken;

use super::control::RunControl;
use super::ending::{NotMade, Told};
use super::packing::{self, Packings, Source, Stored};
use super::slots::Slots;
use super::task::{Claimed, Computing, Ended, Following, LeaseError, TaskKind, TaskSource, Terms};
use crate::exports::making::{self, Exports, MadeExport};
use crate::jobs::{JobProgress, StopRequests};

/// The tasks of the slots of a process.
#[derive(Clone, Debug)]
pub(crate) struct InSlots {
    pub(crate) packings: Packings,
    pub(crate) exports: Exports,
    pub(crate) slots: Slots,
}

/// Of a packing, or of an export.
#[derive(Clone, Debug)]
pub(crate) enum OneOf<P, E> {
    Packing(P),
    Export(E),
}

/// A task of a slot.
pub(crate) type SlotTask = OneOf<packing::Work, making::Work>;

impl<P, E> OneOf<P, E> {
    fn packing(&self) -> Option<&P> {
        match self {
            Self::Packing(packing) => Some(packing),
            Self::Export(_) => None,
        }
    }

    fn export(&self) -> Option<&E> {
        match self {
            Self::Packing(_) => None,
            Self::Export(export) => Some(export),
        }
    }
}

impl TaskSource for InSlots {
    async fn claim(&self, shutdown: &CancellationToken) -> Claimed<SlotTask> {
        let claimed = match &self.packings.source {
            Source::Here(here) => here.claim(&self.slots, shutdown).await?,
            Source::There(there) => there.claim(&self.slots, shutdown).await?,
        };
        Ok(claimed.map(|(work, slots)| (work, Some(slots))))
    }

    fn are_over(&self) -> bool {
        match &self.packings.source {
            Source::Here(_) => false,
            Source::There(there) => there.is_over(),
        }
    }
}

impl TaskKind for InSlots {
    type Work = SlotTask;
    type Made = OneOf<Stored, MadeExport>;

    fn terms(&self, work: &SlotTask) -> Terms {
        match work {
            OneOf::Packing(work) => self.packings.terms(work),
            OneOf::Export(work) => self.exports.terms(work),
        }
    }

    async fn prepare(&self, work: &SlotTask) -> RunControl {
        match work {
            OneOf::Packing(work) => self.packings.prepare(work).await,
            OneOf::Export(work) => self.exports.prepare(work).await,
        }
    }

    fn run(
        &self,
        work: &SlotTask,
        control: &RunControl,
        computing: Computing,
    ) -> Result<Self::Made, NotMade> {
        match work {
            OneOf::Packing(work) => self.packings.run(work, control, computing).map(OneOf::Packing),
            OneOf::Export(work) => self.exports.run(work, control, computing).map(OneOf::Export),
        }
    }

    fn follow(&self, work: &SlotTask) -> Following {
        match work {
            OneOf::Packing(work) => self.packings.follow(work),
            OneOf::Export(work) => self.exports.follow(work),
        }
    }

    async fn requests(&self, work: &SlotTask) -> Result<StopRequests, LeaseError> {
        match work {
            OneOf::Packing(work) => self.packings.requests(work).await,
            OneOf::Export(work) => self.exports.requests(work).await,
        }
    }

    async fn renew(&self, work: &SlotTask, news: Option<JobProgress>) -> Result<StopRequests, LeaseError> {
        match work {
            OneOf::Packing(work) => self.packings.renew(work, news).await,
            OneOf::Export(work) => self.exports.renew(work, news).await,
        }
    }

    fn renew_every(&self) -> Duration {
        self.packings.renew_every()
    }

    async fn hand_on(&self, work: &SlotTask) {
        match work {
            OneOf::Packing(work) => self.packings.hand_on(work).await,
            OneOf::Export(work) => self.exports.hand_on(work).await,
        }
    }

    async fn end(&self, work: &SlotTask, told: Told<'_, Self::Made>) -> Result<(), LeaseError> {
        match work {
            OneOf::Packing(work) => self.packings.end(work, told.of(OneOf::packing)).await,
            OneOf::Export(work) => self.exports.end(work, told.of(OneOf::export)).await,
        }
    }

    async fn ended(&self, work: &SlotTask, ended: Ended<'_, Self::Made>) {
        match work {
            OneOf::Packing(work) => self.packings.ended(work, ended.of(OneOf::packing)).await,
            OneOf::Export(work) => self.exports.ended(work, ended.of(OneOf::export)).await,
        }
    }
}
