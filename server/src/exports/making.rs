//! Making exports, one of the two kinds of tasks ([`workers::task`](crate::workers::task)): the engine makes one from a
//! stored result.
//!
//! Exports have executors of their own, a few beside those that pack, and one more for what is made in a moment, so
//! that a slice need not wait for a lattice model.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use packstone_engine::Limits;
use packstone_engine::export::tables;
use packstone_engine::export::{ExportError, ExportRequest, Model, Provenance};
use packstone_engine::request::{Materials, Specimen};
use tokio_util::sync::CancellationToken;

use super::{ExportRecord, StoredFile, distance_kept};
use crate::artifacts::{Artifacts, InFlight};
use crate::disk::{Disk, is_passing};
use crate::failure::{Failure, FailureCode, FailureFacts};
use crate::gmsh;
use crate::jobs::store::ClaimedExport;
use crate::jobs::{JobProgress, StopRequests};
use crate::metrics::Metrics;
use crate::storage::{Bound, NoRoom, fits};
use crate::workers::control::RunControl;
use crate::workers::ending::{Cause, End, NotMade, Told};
use crate::workers::here::Here;
use crate::workers::task::{Claimed, Computing, Ended, Following, LeaseError, TaskKind, Terms};

/// What making exports needs.
#[derive(Clone, Debug)]
pub(crate) struct Exports {
    pub(crate) here: Here,
    pub(crate) artifacts: Artifacts,
    pub(crate) disk: Disk,
    pub(crate) metrics: Arc<Metrics>,
    /// Most bytes that files hold which nobody has asked to be kept.
    pub(crate) cache_bytes: u64,
    /// Only what is made in a moment is claimed.
    pub(crate) quick: bool,
}

/// An export to make.
pub(crate) struct Work {
    claimed: ClaimedExport,
    /// Bytes that the file may have, and what bounds them.
    room: (u64, Bound),
}

/// An export whose file is on disk.
pub(crate) struct MadeExport {
    file: StoredFile,
    report: serde_json::Value,
    /// Stays claimed until the store refers to it.
    _place: InFlight,
}

impl TaskKind for Exports {
    type Work = Work;
    type Made = MadeExport;

    async fn claim(&self, shutdown: &CancellationToken) -> Claimed<Work> {
        let Here { store, storage, .. } = &self.here;
        let Some(claimed) = store.claim_export(self.quick).await? else {
            tokio::select! {
                () = store.exports_queued(self.quick) => {}
                () = shutdown.cancelled() => {}
            }
            return Ok(None);
        };
        // Another may take the next of a burst that woke only this one.
        store.wake_next_export_worker();
        // A store that cannot tell fails the export at its end at the latest.
        let room = storage.room(&claimed.export.owner).await.unwrap_or((u64::MAX, Bound::Disk));
        Ok(Some((Work { claimed, room }, None)))
    }

    fn terms(&self, work: &Work) -> Terms {
        let of = &work.claimed.export;
        let span = tracing::info_span!("export", job_id = %of.job, export_id = %of.id, kind = of.kind.name(),
            attempt = of.attempt);
        Terms { span, timeout_s: None, faults: work.claimed.faults }
    }

    async fn prepare(&self, _work: &Work) -> RunControl {
        RunControl::default()
    }

    fn run(&self, work: &Work, control: &RunControl, _computing: Computing) -> Result<MadeExport, NotMade> {
        let Work { claimed, room: (left, bound) } = work;
        let (left, bound) = (*left, *bound);
        let record = &claimed.export;
        let export = ExportRequest::from_json(&record.options).map_err(Failure::invalid)?;
        let unreadable = |error: &dyn std::fmt::Display| {
            tracing::error!(%error, "the stored result is unreadable");
            NotMade::from(Failure::new(FailureCode::ResultDamaged, "the stored result is missing or damaged"))
        };
        let stored = self
            .artifacts
            .read(&claimed.result)
            .map_err(|error| if is_passing(&error) { fault(&error) } else { unreadable(&error) })?;
        let specimen = Specimen::from_json(&stored.head().request["specimen"])
            .map_err(|faults| unreadable(&faults.iter().map(ToString::to_string).collect::<String>()))?;
        let loaded_bytes = tables::loaded_bytes(&stored);
        let grains = tables::load(&stored).map_err(|error| match error.kind() {
            io::ErrorKind::OutOfMemory => failed(ExportError::OutOfMemory { bytes: loaded_bytes }),
            _ if is_passing(&error) => fault(&error),
            _ => unreadable(&error),
        })?;
        let provenance = Provenance {
            result_sha256: Some(claimed.result.sha256.clone()),
            ..Provenance::from(stored.head())
        };
        let distance = distance_kept(stored.head());
        let materials = Materials::of_request(&stored.head().request);
        drop(stored);
        let max_model_bytes = self.here.limits.max_model_bytes.saturating_sub(loaded_bytes);
        let limits = Limits { max_model_bytes, ..self.here.limits };
        let model = Model::new(&specimen, &grains)
            .with_distance(distance)
            .with_provenance(&provenance)
            .with_materials(materials.as_ref())
            .with_mesher(&gmsh::Installed);
        if let Ok(estimate) = export.estimate(&model) {
            fits(estimate.bytes, (left, bound)).map_err(|no_room| no_room_left(&no_room))?;
        }
        let place = self.artifacts.begin_export(&record.id.to_string(), record.attempt);
        let written = self
            .artifacts
            .write_export(&place, left, control, |out| export.write(&model, &limits, control, out))
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
        let (store, of) = (&self.here.store, &work.claimed.export);
        Following::Export(store.subscribe_export(of.id), store.subscribe(of.job))
    }

    async fn requests(&self, work: &Work) -> Result<StopRequests, LeaseError> {
        // An export is not cancelled but deleted, and its lease with it.
        self.here.store.check_export_lease(&work.claimed.export).await?;
        Ok(StopRequests::default())
    }

    async fn renew(&self, work: &Work, news: Option<JobProgress>) -> Result<StopRequests, LeaseError> {
        self.here.store.renew_export(&work.claimed.export, news).await?;
        Ok(StopRequests::default())
    }

    fn renew_every(&self) -> Duration {
        self.here.store.renew_every()
    }

    async fn end(&self, work: &Work, told: Told<'_, MadeExport>) -> Result<(), LeaseError> {
        let (store, of) = (&self.here.store, &work.claimed.export);
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
        let of = &work.claimed.export;
        self.metrics.export_ended(of.kind.name(), ended.outcome, ended.took);
        match ended.end {
            End::Made(_) if ended.is_recorded => self.shrink_cache(of).await,
            End::Made(made) => self.artifacts.discard(vec![made.file.path.clone()]).await,
            _ => {}
        }
    }
}

impl Exports {
    async fn shrink_cache(&self, made: &ExportRecord) {
        let shrunk = async {
            let most = self.here.storage.cache_bytes(self.cache_bytes).await?;
            self.here.store.shrink_cache(most, made.id).await
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
