//! The request for the next task, and what becomes of it when the process stops before it has read the answer.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use packstone_engine::Limits;
use serde_json::{Map, Value};
use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;

use super::{Job, Key, PAUSES, ServerError, Shared, State, There, address};
use crate::artifacts::Artifacts;
use crate::exports::{ExportLease, making};
use crate::ids::TaskId;
use crate::jobs::{ArtifactRecord, Lease};
use crate::storage::Bound;
use crate::workers::documents::{
    BUILD, EndOutcome, EndRequest, LeaseDocument, LeaseRequest, LeasesDocument, MAX_REMAINING_S, MAX_SLOTS,
};
use crate::workers::in_slots::{OneOf, SlotTask};
use crate::workers::leased_export::ExportLeaseDocument;
use crate::workers::packing::Work;
use crate::workers::slots::{Held, Slots, threads_of};
use crate::workers::task::LeaseError;

/// How long an idle process waits for a task before it looks whether it is to stop.
const CLAIM_WAIT: Duration = Duration::from_secs(30);
/// Time to requeue a job whose lease this process has not read when it stops.
const RELEASE: Duration = Duration::from_secs(2);
/// How often a process whose disk is full looks for room.
const LOOK_FOR_ROOM: Duration = Duration::from_secs(1);

impl There {
    /// Leases the next job or export; `None` where none came for a while, or the process is to stop.
    pub(in crate::workers) async fn claim(
        &self,
        slots: &Slots,
        shutdown: &CancellationToken,
    ) -> Result<Option<(SlotTask, Held)>, LeaseError> {
        let asked = Mutex::default();
        let asking = async {
            let _turn = self.shared.claiming.lock().await;
            let reserved = slots.reserve().await;
            Ok(self.ask(&asked).await.map(|leased| {
                // No other claim is under way, so that nothing is waited for: the job would be lost if this were
                // dropped meanwhile.
                let (asked, most, queued) = match &leased {
                    OneOf::Packing(of) => (of.threads, of.most_threads, of.queued),
                    OneOf::Export(of) => (of.threads, MAX_SLOTS, of.queued),
                };
                let left = if asked.is_none() { queued } else { 0 };
                let held = reserved.take(threads_of(asked, most), left);
                let work = match leased {
                    OneOf::Packing(of) => OneOf::Packing(self.begin(&of, held.count())),
                    OneOf::Export(of) => OneOf::Export(self.begin_export(of, held.count())),
                };
                (work, held)
            }))
        };
        tokio::select! {
            claimed = asking => return claimed,
            // The server sees that the connection is closed, and gives the job to another.
            () = shutdown.cancelled() => {}
            () = self.shared.full.notified() => {}
        }
        if let Some(request) = asked.into_inner().unwrap_or_else(PoisonError::into_inner)
            && timeout(RELEASE, self.release_unread(request)).await.is_err()
        {
            tracing::warn!("the server did not say in time whether it has given this worker a job");
        }
        Ok(None)
    }

    /// Requeues the jobs of a request whose answer was on its way when it was broken off.
    async fn release_unread(&self, request: LeaseRequest) {
        let request = LeaseRequest { slots: 0, ..request };
        let released = async {
            let found =
                self.shared.server.post::<LeasesDocument>("/v1/leases", &request, Duration::ZERO).await?;
            let LeasesDocument { leases, exports } = found.unwrap_or_default();
            let leases = leases.iter().map(|of| Key { id: of.job.into(), attempt: of.attempt });
            let exports = exports.iter().map(|of| Key { id: of.export.into(), attempt: of.attempt });
            for lease in leases.chain(exports) {
                let end = EndRequest {
                    outcome: EndOutcome::Released,
                    failure: None,
                    facts: None,
                    needed_bytes: None,
                };
                self.shared.server.post::<Value>(&address(lease, "end"), &end, Duration::ZERO).await?;
            }
            Ok::<_, ServerError>(())
        };
        if let Err(error) = released.await {
            tracing::warn!(%error, "the server did not say whether it has given this worker a job");
        }
    }

    /// Waits while there is no room for a result as the last that could not be written: each job would be packed in
    /// vain.
    async fn await_room(&self) {
        let Shared { disk, needed_bytes, .. } = &*self.shared;
        let needed = needed_bytes.load(Ordering::Acquire);
        let free = || disk.space().map_or(u64::MAX, |space| space.free);
        if free() >= needed {
            return;
        }
        tracing::error!(
            free_bytes = free(),
            needed,
            "the disk of this worker is full; it takes no job until there is room"
        );
        while free() < needed && !self.is_over() {
            sleep(LOOK_FOR_ROOM).await;
        }
        needed_bytes.store(0, Ordering::Release);
    }

    /// Asks for a job until the server has answered. While a request is under way, `asked` has it.
    async fn ask(
        &self,
        asked: &Mutex<Option<LeaseRequest>>,
    ) -> Option<OneOf<LeaseDocument, ExportLeaseDocument>> {
        let set = |request| *asked.lock().unwrap_or_else(PoisonError::into_inner) = request;
        self.await_room().await;
        let options = &self.shared.options;
        let left = || options.until.map(|until| until.saturating_duration_since(Instant::now()));
        let mut wait = CLAIM_WAIT;
        if let Some(left) = left() {
            wait = wait.min(left);
        }
        if let Some(idle) = options.idle {
            wait = wait.min(idle);
        }
        let mut request = LeaseRequest {
            // An ID as good as any other: it is only ever compared.
            claim: TaskId::new().to_string(),
            worker: options.name.clone(),
            slots: 1,
            remaining_s: None,
            mesher: options.mesher.clone(),
            build: BUILD.into(),
            bits: options.bits.clone(),
        };
        let mut pause = PAUSES.0;
        while !self.is_over() {
            request.remaining_s = left().map(|left| left.as_secs_f64().min(MAX_REMAINING_S));
            set(Some(request.clone()));
            match self.shared.server.post::<LeasesDocument>("/v1/leases", &request, wait).await {
                Ok(found) => {
                    set(None);
                    let LeasesDocument { leases, exports } = found?;
                    let export = exports.into_iter().next().map(OneOf::Export);
                    return export.or_else(|| leases.into_iter().next().map(OneOf::Packing));
                }
                Err(error) if error.is_final() => {
                    set(None);
                    *self.shared.refused.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                }
                Err(error) => {
                    tracing::warn!(%error, pause_s = pause.as_secs_f64(), "no answer to the request for a job");
                    sleep(pause).await;
                    pause = (2 * pause).min(PAUSES.1);
                }
            }
        }
        None
    }

    fn keep_renewing_of(&self, lease: Key) {
        let state = watch::Sender::new(State::Running);
        self.jobs().insert(lease, Job { state, progress: None, sent: Instant::now() });
        self.shared.changed.notify_one();
    }

    fn begin_export(&self, document: ExportLeaseDocument, threads: NonZeroUsize) -> making::Work {
        let ExportLeaseDocument { export: id, job, attempt, .. } = document;
        let lease = ExportLease { seq: 0, id, job, attempt };
        self.keep_renewing_of(lease.into());
        let limits = Limits {
            max_model_bytes: document.max_model_bytes,
            max_voxel_file_bytes: document.max_model_bytes,
            export_threads: threads,
            ..Limits::default()
        };
        let result = ArtifactRecord {
            path: Artifacts::path_of_result(&id.to_string(), attempt),
            bytes: document.result_bytes,
            sha256: document.result_sha256,
            report: Map::new(),
            format_revision: 0,
            format_lengths: BTreeMap::new(),
        };
        making::Work {
            lease,
            kind: document.r#type,
            options: document.options,
            result,
            faults: document.faults,
            limits,
            room: (document.room_bytes, Bound::Disk),
        }
    }

    fn begin(&self, document: &LeaseDocument, threads: NonZeroUsize) -> Work {
        let lease = Lease { seq: 0, id: document.job, attempt: document.attempt, study: None };
        self.keep_renewing_of(lease.into());
        let limits = Limits {
            max_grains: document.max_grains,
            max_memory_bytes: document.max_memory_bytes,
            threads,
            ..Limits::default()
        };
        Work {
            lease,
            request: document.request.to_string(),
            timeout_s: document.timeout_s,
            faults: document.faults,
            limits,
            room: (document.room_bytes, Bound::Disk),
            has_checkpoint: document.has_checkpoint,
        }
    }
}
