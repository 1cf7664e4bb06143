//! Jobs, and exports that take as long, from the store of this process.

use futures_util::FutureExt as _;
use packstone_engine::Limits;
use tokio_util::sync::CancellationToken;

use super::ending::{Cause, Told};
use super::in_slots::{OneOf, SlotTask};
use super::packing::{Stored, Work, complete};
use super::slots::{Held, Slots, threads_of};
use super::task::LeaseError;
use crate::exports::making;
use crate::gmsh;
use crate::jobs::store::{Store, WakeUp, WorkUntil};
use crate::jobs::{Lease, WaitReason};
use crate::storage::{Bound, Storage};
use crate::tasks;

/// Most threads of an export without `threads`: as many as a packing may have.
const MOST_THREADS: u32 = 64;

/// The store of this process.
#[derive(Clone, Debug)]
pub(crate) struct Here {
    pub(crate) store: Store,
    pub(crate) storage: Storage,
    pub(crate) limits: Limits,
    /// Longest time of a run, whatever the request allows.
    pub(crate) max_run_s: Option<f64>,
}

/// Longest time of a run, in s: that of the request, or that of the server where this is shorter.
pub(crate) fn run_limit_s(timeout_s: Option<f64>, max_run_s: Option<f64>) -> Option<f64> {
    timeout_s.into_iter().chain(max_run_s).min_by(f64::total_cmp)
}

/// Whether this machine has Gmsh.
pub(crate) async fn has_gmsh() -> bool {
    tasks::blocking(|| gmsh::version().is_some()).await.unwrap_or(false)
}

impl Here {
    /// Leases the next task for a slot, or waits until there may be one. An export comes before the next job: its own
    /// has had its turn.
    pub(super) async fn claim(
        &self,
        slots: &Slots,
        shutdown: &CancellationToken,
    ) -> Result<Option<(SlotTask, Held)>, LeaseError> {
        let mut wake_up: Option<WakeUp> = None;
        let (mut reserved, claimed) = loop {
            let reserved = if let Some(reserved) = slots.reserve().now_or_never() {
                reserved
            } else {
                // Without a free slot the wake-up is another worker's.
                drop(wake_up.take());
                tokio::select! {
                    reserved = slots.reserve() => reserved,
                    () = shutdown.cancelled() => return Ok(None),
                }
            };
            let mark = self.store.queue_mark();
            let claimed = match self.store.claim_heavy_export(has_gmsh()).await? {
                Some(export) => Some(OneOf::Export(export)),
                None => self.store.claim().await?.map(OneOf::Packing),
            };
            wake_up.take().into_iter().for_each(WakeUp::end);
            if let Some(claimed) = claimed {
                break (reserved, claimed);
            }
            drop(reserved);
            tokio::select! {
                woken = self.store.queue_notified(mark, WorkUntil::Unlimited) => wake_up = Some(woken),
                () = shutdown.cancelled() => return Ok(None),
            }
        };
        let (asked, most) = match &claimed {
            OneOf::Packing(claimed) => (claimed.job.threads, claimed.job.most_threads),
            OneOf::Export(claimed) => (claimed.threads, MOST_THREADS),
        };
        let threads = threads_of(asked, most);
        let mut left = 0;
        if threads > 1 {
            reserved = reserved.alone().await;
            if asked.is_none() {
                // A store that cannot tell how many jobs wait may have as many as there are slots.
                left = self.store.queued().await.unwrap_or(u64::MAX);
            }
        }
        let held = reserved.take(threads, left);
        // Another worker may take the next job of a burst that woke only this one.
        self.store.wake_next_worker();
        // A store that cannot tell fails the run at its end at the latest.
        let owner = match &claimed {
            OneOf::Packing(claimed) => &claimed.job.owner,
            OneOf::Export(claimed) => &claimed.export.owner,
        };
        let room = self.storage.room(owner).await.unwrap_or((u64::MAX, Bound::Disk));
        let claimed = match claimed {
            OneOf::Packing(claimed) => claimed,
            OneOf::Export(claimed) => {
                let limits = Limits { export_threads: held.count(), ..self.limits };
                let work = making::Work::of(claimed, limits, room);
                return Ok(Some((OneOf::Export(work), held)));
            }
        };
        let work = Work {
            lease: claimed.lease,
            request: claimed.request,
            timeout_s: run_limit_s(claimed.job.timeout_s, self.max_run_s),
            faults: claimed.job.faults,
            limits: Limits { threads: held.count(), ..self.limits },
            room,
            has_checkpoint: false,
        };
        Ok(Some((OneOf::Packing(work), held)))
    }

    /// Records how a run ended.
    pub(super) async fn end(&self, lease: Lease, told: Told<'_, Stored>) -> Result<(), LeaseError> {
        match told {
            Told::Succeeded(stored) => {
                let (progress, postprocess) = (complete(stored.grains), stored.postprocess.clone());
                let (artifact, facts) = (stored.artifact.clone(), stored.facts.clone());
                self.store.succeed(lease, artifact, progress, facts, postprocess).await?;
            }
            Told::Failed(failure, facts) => self.store.fail(lease, &failure, *facts).await?,
            Told::Cancelled => self.store.finish_cancelled(lease).await?,
            Told::Released => self.store.give_back(lease).await?,
            Told::Faulted(cause) => {
                let needed_bytes = match cause {
                    Cause::NoRoom(bytes) | Cause::NotWritten(bytes) => Some(bytes),
                    Cause::NoMemory | Cause::Other => None,
                };
                let why = match needed_bytes {
                    Some(bytes) => self.storage.why_it_waits(lease.id, bytes).await,
                    None if cause == Cause::NoMemory => WaitReason::memory(),
                    None => WaitReason::machine(),
                };
                let owner = self.store.requeue_after_fault(lease, why).await?;
                if let Some(bytes) = needed_bytes {
                    self.storage.wait_for_room(&owner, bytes).await;
                }
            }
            Told::Nothing => return Err(LeaseError::Lost),
        }
        Ok(())
    }
}
