//! Making exports, one of the two kinds of tasks ([`workers::task`](crate::workers::task)): the engine makes one from a
//! stored result.
//!
//! Exports have executors of their own, a few beside those that pack, and one more for what is made in a moment, so
//! that a slice need not wait for a lattice model. What takes as long as a packing, and was asked for by the request of
//! a job, is made in the slots of packings instead ([`in_slots`](crate::workers::in_slots)).

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use packstone_engine::export::tables;
use packstone_engine::export::{ExportError, ExportRequest, ExportType, Model, Provenance, SurfaceCache};
use packstone_engine::request::{Materials, Specimen};
use packstone_engine::{Control as _, Limits};
use serde_json::Value;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::{ExportLease, StoredFile, distance_kept};
use crate::artifacts::{Artifacts, InFlight};
use crate::checkpoints::Checkpoints;
use crate::disk::{Disk, is_passing};
use crate::failure::{Failure, FailureCode, FailureFacts};
use crate::gmsh;
use crate::jobs::store::{ClaimedExport, ExportQueue, Store};
use crate::jobs::{ArtifactRecord, JobProgress, StopRequests};
use crate::metrics::Metrics;
use crate::storage::{Bound, NoRoom, fits};
use crate::tasks;
use crate::workers::control::RunControl;
use crate::workers::ending::{Cause, NotMade, Told};
use crate::workers::heard::Heard;
use crate::workers::here::{Here, has_gmsh};
use crate::workers::packing::{self, Source};
use crate::workers::task::{Claimed, Computing, Ended, Following, LeaseError, TaskKind, TaskSource, Terms};

/// How often a server looks for exports that no slot will ever make.
const LOOK_FOR_HEAVY: Duration = Duration::from_secs(2);

/// What making exports needs.
#[derive(Clone, Debug)]
pub(crate) struct Exports {
    pub(crate) source: Source,
    pub(crate) artifacts: Artifacts,
    /// Where checkpoints are kept while an export is made.
    pub(crate) checkpoints: Checkpoints,
    pub(crate) disk: Disk,
    pub(crate) metrics: Arc<Metrics>,
    /// Most bytes that files hold which nobody has asked to be kept.
    pub(crate) cache_bytes: u64,
    /// What is claimed, if not for slots.
    pub(crate) queue: ExportQueue,
    /// Of a server without slots: the worker processes that it has heard. Where there is none, it also makes the
    /// exports that are meant for slots.
    pub(crate) heard: Option<Heard>,
    /// When that server began to listen.
    pub(crate) since: Instant,
}

/// An export to make.
#[derive(Clone, Debug)]
pub(crate) struct Work {
    pub(crate) lease: ExportLease,
    pub(crate) kind: ExportType,
    /// With its `type`, and defaults filled in.
    pub(crate) options: Value,
    /// The result that the export is made from.
    pub(crate) result: ArtifactRecord,
    /// Faults of the machine that earlier runs have met.
    pub(crate) faults: i64,
    /// What the run may use.
    pub(crate) limits: Limits,
    /// Bytes that the file may have, and what bounds them.
    pub(crate) room: (u64, Bound),
}

/// An export whose file is on disk.
pub(crate) struct MadeExport {
    pub(crate) file: StoredFile,
    pub(crate) report: Value,
    /// Stays claimed until the store refers to it.
    _place: InFlight,
}

impl Work {
    /// What the store has leased.
    pub(crate) fn of(claimed: ClaimedExport, limits: Limits, room: (u64, Bound)) -> Self {
        let ClaimedExport { export, result, faults, threads: _ } = claimed;
        let lease = ExportLease::from(&export);
        Self { lease, kind: export.kind, options: export.options, result, faults, limits, room }
    }
}

impl TaskSource for Exports {
    async fn claim(&self, shutdown: &CancellationToken) -> Claimed<Work> {
        let Source::Here(Here { store, storage, limits, .. }) = &self.source else {
            // A worker process leases exports together with its jobs.
            shutdown.cancelled().await;
            return Ok(None);
        };
        let mut claimed = store.claim_export(self.queue).await?;
        if claimed.is_none()
            && let Some(queue) = self.left_by_workers(store).await?
        {
            claimed = store.claim_export(queue).await?;
        }
        let Some(claimed) = claimed else {
            tokio::select! {
                () = store.exports_queued(self.queue) => {}
                () = sleep(LOOK_FOR_HEAVY), if self.heard.is_some() => {}
                () = shutdown.cancelled() => {}
            }
            return Ok(None);
        };
        // Another may take the next of a burst that woke only this one.
        store.wake_next_export_worker();
        // A store that cannot tell fails the export at its end at the latest.
        let room = storage.room(&claimed.export.owner).await.unwrap_or((u64::MAX, Bound::Disk));
        Ok(Some((Work::of(claimed, *limits, room), None)))
    }
}

impl TaskKind for Exports {
    type Work = Work;
    type Made = MadeExport;

    fn terms(&self, work: &Work) -> Terms {
        let of = &work.lease;
        let span = tracing::info_span!("export", job_id = %of.job, export_id = %of.id, kind = work.kind.name(),
            attempt = of.attempt);
        Terms { span, timeout_s: None, faults: work.faults }
    }

    async fn prepare(&self, work: &Work) -> RunControl {
        if let Source::There(there) = &self.source {
            there.fetch_result(work).await;
            if work.lease.attempt > 1 {
                there.fetch_checkpoint(work.lease, &self.checkpoints).await;
            }
        }
        RunControl::with_checkpoints(self.checkpoints.writer(&work.lease.id.to_string(), work.lease.attempt))
    }

    fn run(&self, work: &Work, control: &RunControl, _computing: Computing) -> Result<MadeExport, NotMade> {
        let Work { lease, result, room: (left, bound), .. } = work;
        let (left, bound) = (*left, *bound);
        let export = ExportRequest::from_json(&work.options).map_err(Failure::invalid)?;
        let unreadable = |error: &dyn std::fmt::Display| {
            tracing::error!(%error, "the stored result is unreadable");
            NotMade::from(Failure::new(FailureCode::ResultDamaged, "the stored result is missing or damaged"))
        };
        let stored = self.artifacts.read(result).map_err(|error| match &self.source {
            Source::Here(_) if !is_passing(&error) => unreadable(&error),
            // The copy of a worker process: the server has the result.
            _ => fault(&error),
        })?;
        let specimen = Specimen::from_json(&stored.head().request["specimen"])
            .map_err(|faults| unreadable(&faults.iter().map(ToString::to_string).collect::<String>()))?;
        let loaded_bytes = tables::loaded_bytes(&stored);
        let grains = tables::load(&stored).map_err(|error| match error.kind() {
            io::ErrorKind::OutOfMemory => failed(ExportError::OutOfMemory { bytes: loaded_bytes }),
            _ if is_passing(&error) => fault(&error),
            _ => unreadable(&error),
        })?;
        let provenance =
            Provenance { result_sha256: Some(result.sha256.clone()), ..Provenance::from(stored.head()) };
        let distance = distance_kept(stored.head());
        let materials = Materials::of_request(&stored.head().request);
        drop(stored);
        let max_model_bytes = work.limits.max_model_bytes.saturating_sub(loaded_bytes);
        let limits = Limits { max_model_bytes, ..work.limits };
        let surfaces = SurfaceCache::default();
        let model = Model::new(&specimen, &grains)
            .with_surfaces(&surfaces)
            .with_distance(distance)
            .with_provenance(&provenance)
            .with_materials(materials.as_ref())
            .with_mesher(&gmsh::Installed);
        if let Ok(estimate) = export.estimate(&model) {
            fits(estimate.bytes, (left, bound)).map_err(|no_room| no_room_left(&no_room))?;
        }
        let id = lease.id.to_string();
        let resume = export.checkpoint_identity(&model).and_then(|identity| {
            self.checkpoints.prepare(&id, &|| control.should_stop());
            self.checkpoints.resume_export(&id, &identity)
        });
        if resume.is_some() {
            control.resumed();
        }
        let place = self.artifacts.begin_export(&id, lease.attempt);
        let written = self
            .artifacts
            .write_export(&place, left, control, |out| {
                export.write_or_resume(&model, &limits, resume, control, out)
            })
            .map_err(|error| match error {
                ExportError::Write(error) if error.kind() == io::ErrorKind::QuotaExceeded => {
                    no_room_left(&NoRoom { needed: left.saturating_add(1), left, bound })
                }
                ExportError::Write(error) => {
                    self.disk.note_failure(&error);
                    fault(&error)
                }
                other => failed(other),
            })?;
        let (file, report) = written;
        let report = serde_json::to_value(&report).map_err(|error| unreadable(&error))?;
        Ok(MadeExport { file, report, _place: place })
    }

    fn follow(&self, work: &Work) -> Following {
        match &self.source {
            Source::Here(Here { store, .. }) => {
                Following::Export(store.subscribe_export(work.lease.id), store.subscribe(work.lease.job))
            }
            Source::There(there) => Following::There(there.follow(work.lease)),
        }
    }

    async fn requests(&self, work: &Work) -> Result<StopRequests, LeaseError> {
        // An export is not cancelled but deleted, and its lease with it.
        match &self.source {
            Source::Here(here) => here.store.check_export_lease(work.lease).await?,
            Source::There(there) => drop(there.requests(work.lease)?),
        }
        Ok(StopRequests::default())
    }

    async fn renew(&self, work: &Work, news: Option<JobProgress>) -> Result<StopRequests, LeaseError> {
        match &self.source {
            Source::Here(here) => here.store.renew_export(work.lease, news).await?,
            Source::There(there) => drop(there.renew(work.lease, news)?),
        }
        Ok(StopRequests::default())
    }

    fn renew_every(&self) -> Duration {
        self.source.renew_every()
    }

    /// Lets other servers go on from the last checkpoint of a run.
    async fn hand_on(&self, work: &Work) {
        packing::share_last(&self.checkpoints, work.lease.id.to_string(), work.lease.attempt).await;
    }

    async fn end(&self, work: &Work, told: Told<'_, MadeExport>) -> Result<(), LeaseError> {
        let (store, of) = match &self.source {
            Source::Here(here) => (&here.store, work.lease),
            Source::There(there) => return there.end_export(work.lease, told).await,
        };
        match told {
            Told::Succeeded(made) => store.export_made(of, made.file.clone(), made.report.clone()).await?,
            Told::Failed(failure, _) => store.export_failed(of, &failure).await?,
            Told::Released => store.export_requeued(of).await?,
            Told::Faulted(_) => store.export_requeued_after_fault(of).await?,
            Told::Cancelled | Told::Nothing => return Err(LeaseError::Lost),
        }
        Ok(())
    }

    async fn ended(&self, work: &Work, ended: Ended<'_, MadeExport>) {
        self.metrics.export_ended(work.kind.name(), ended.outcome, ended.took);
        if ended.is_recorded && !ended.is_requeued {
            let (checkpoints, lease) = (self.checkpoints.clone(), work.lease);
            let removed = tasks::blocking(move || checkpoints.remove(&lease.id.to_string(), lease.attempt));
            if let Err(error) = removed.await {
                tracing::warn!(%error, "checkpoints are left to the sweeper");
            }
        }
        match (ended.made, &self.source) {
            (Some(_), Source::Here(here)) if ended.is_recorded => self.shrink_cache(here, work.lease).await,
            (Some(made), _) => self.artifacts.discard(vec![made.file.path.clone()]).await,
            (None, _) => {}
        }
        if let Source::There(_) = &self.source {
            self.artifacts.discard(vec![work.result.path.clone()]).await;
        }
    }
}

impl Exports {
    /// Exports for slots, of this source.
    pub(crate) fn in_slots(
        source: Source,
        artifacts: Artifacts,
        checkpoints: Checkpoints,
        disk: Disk,
        metrics: Arc<Metrics>,
        cache_bytes: u64,
    ) -> Self {
        let (queue, heard, since) = (ExportQueue::Heavy, None, Instant::now());
        Self { source, artifacts, checkpoints, disk, metrics, cache_bytes, queue, heard, since }
    }

    /// Which of the exports that are meant for slots this server makes, where it has none: all that it can once no
    /// worker process was heard for the time of a lease, and what needs Gmsh where none of those that were heard may
    /// make it.
    async fn left_by_workers(&self, store: &Store) -> Result<Option<ExportQueue>, LeaseError> {
        let Some(heard) = self.heard.as_ref().filter(|_| self.since.elapsed() >= store.lease()) else {
            return Ok(None);
        };
        if !store.has_claimable_export(ExportQueue::Heavy).await? {
            return Ok(None);
        }
        let processes = heard.within(store.lease());
        let is_alone =
            processes.is_empty() && !store.processes().await?.iter().any(|process| process.is_heard);
        let of_gmsh = store.has_claimable_export(ExportQueue::HeavyMeshed).await?;
        let makes_them = of_gmsh && !processes.values().any(|can_mesh| *can_mesh) && has_gmsh().await;
        Ok(match (is_alone, of_gmsh, makes_them) {
            (true, true, false) => Some(ExportQueue::HeavyUnmeshed),
            (true, _, _) => Some(ExportQueue::Heavy),
            (false, _, true) => Some(ExportQueue::HeavyMeshed),
            (false, _, false) => None,
        })
    }

    async fn shrink_cache(&self, here: &Here, made: ExportLease) {
        let shrunk = async {
            let most = here.storage.cache_bytes(self.cache_bytes).await?;
            here.store.shrink_cache(most, made.id).await
        };
        match shrunk.await {
            Ok(paths) if paths.is_empty() => {}
            Ok(paths) => {
                tracing::info!(files = paths.len(), "dropped what was used longest ago of the cache");
                self.artifacts.discard(paths).await;
            }
            Err(error) => tracing::warn!(%error, "the cache was not shrunk"),
        }
    }
}

/// A fault of the machine.
fn fault(error: &io::Error) -> NotMade {
    tracing::warn!(%error, "a file could not be read or written");
    NotMade::Faulted(Cause::Other)
}

fn no_room_left(no_room: &NoRoom) -> NotMade {
    let figures = FailureFacts {
        needed_bytes: Some(no_room.needed),
        free_bytes: Some(no_room.left),
        ..FailureFacts::default()
    };
    Failure::new(FailureCode::InsufficientStorage, no_room.to_string()).with_facts(figures).into()
}

fn failed(error: ExportError) -> NotMade {
    match error {
        ExportError::Write(error) => fault(&error),
        ExportError::CheckFailed(what) => {
            tracing::error!(%what, "what was made failed its check");
            Failure::from(ExportError::CheckFailed(what)).into()
        }
        other => Failure::from(other).into(),
    }
}
