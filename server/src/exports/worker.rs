//! Export workers: each claims the next export that waits, has the engine make it on a thread of the blocking pool, and
//! records how that ended.
//!
//! There are few of them beside the workers, and one more for what is made in a moment, so that a cut need not wait for
//! a lattice model. Each watches its run from outside, as workers do: progress out, the server's stop and the deletion
//! of what it makes in.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use packstone_engine::Limits;
use packstone_engine::export::tables;
use packstone_engine::export::{ExportError, ExportRequest, Model, Provenance};
use packstone_engine::request::Specimen;
use tokio::time::{Instant, MissedTickBehavior, interval, interval_at, sleep};
use tokio_util::sync::CancellationToken;
use tracing::Instrument as _;

use super::{ExportRecord, StoredFile};
use crate::artifacts::{Artifacts, InFlight};
use crate::disk::{Disk, is_passing};
use crate::failure::{Failure, FailureCode, FailureFacts};
use crate::jobs::store::{ClaimedExport, Store, StoreError};
use crate::metrics::Metrics;
use crate::remaining_time::RemainingTime;
use crate::storage::{Bound, NoRoom, Storage, fits};
use crate::tasks;
use crate::workers::control::{RunControl, Stop};
use crate::workers::executor::{MEMORY_FAULTS, as_recorded};

/// Progress is recorded no more often than this.
const PROGRESS_EVERY: Duration = Duration::from_millis(500);
/// A store that fails gets this much time before the next try.
const STORE_PAUSE: Duration = Duration::from_secs(1);

/// What each of them needs.
#[derive(Clone, Debug)]
pub(crate) struct ExportWorker {
    pub(crate) store: Store,
    pub(crate) artifacts: Artifacts,
    pub(crate) disk: Disk,
    pub(crate) storage: Storage,
    pub(crate) limits: Limits,
    pub(crate) metrics: Arc<Metrics>,
    /// When cancelled, what is being made goes back to its queue.
    pub(crate) shutdown: CancellationToken,
    /// Most bytes that files hold which nobody has asked to be kept.
    pub(crate) cache_bytes: u64,
}

/// How making something ended.
enum End {
    /// The file is on disk; its place stays claimed until the store refers to it.
    Made {
        file: StoredFile,
        report: serde_json::Value,
        _place: InFlight,
    },
    Failed(Failure),
    Stopped(Stop),
    /// A fault of the machine kept the file from being made.
    Faulted,
}

impl ExportWorker {
    /// Makes what waits, or only what is `quick`, until the server stops.
    pub(crate) async fn work(self, quick: bool) {
        while !self.shutdown.is_cancelled() {
            match self.store.claim_export(quick).await {
                Ok(Some(claimed)) => {
                    // Another may take the next of a burst that woke only this one.
                    self.store.wake_next_export_worker();
                    let of = &claimed.export;
                    let span = tracing::info_span!("derive", job_id = %of.job, export_id = %of.id,
                        kind = of.kind.name(), attempt = of.attempt);
                    self.run(claimed).instrument(span).await;
                }
                Ok(None) => {
                    tokio::select! {
                        () = self.store.exports_queued(quick) => {}
                        () = self.shutdown.cancelled() => {}
                    }
                }
                Err(error) => {
                    tracing::error!(%error, "nothing to derive could be claimed");
                    tokio::select! {
                        () = sleep(STORE_PAUSE) => {}
                        () = self.shutdown.cancelled() => {}
                    }
                }
            }
        }
    }

    async fn run(&self, claimed: ClaimedExport) {
        let started = Instant::now();
        let record = claimed.export.clone();
        let control = Arc::new(RunControl::default());
        // A store that cannot tell fails the export at its end at the latest.
        let room = self.storage.room(&record.owner).await.unwrap_or((u64::MAX, Bound::Disk));
        let mut making = tasks::blocking({
            let (export_worker, control, span) =
                (self.clone(), Arc::clone(&control), tracing::Span::current());
            move || span.in_scope(|| export_worker.make(&claimed, room, &control))
        });
        let end = tokio::select! {
            end = &mut making => end,
            never = self.watch(&record, &control, started) => match never {},
        };
        let end = end.unwrap_or_else(|panic| {
            tracing::error!(%panic, "making it panicked");
            let detail = "making it came upon a defect of this program; the log has it under its id";
            End::Failed(Failure::new(FailureCode::InternalError, detail))
        });
        self.record_end(&record, end, started.elapsed()).await;
    }

    /// Watches a run for as long as it lasts.
    async fn watch(
        &self,
        record: &ExportRecord,
        control: &RunControl,
        started: Instant,
    ) -> std::convert::Infallible {
        // Both are told when what they name goes; each also of what changes nothing here.
        let (mut changes, mut job) =
            (self.store.subscribe_export(record.id), self.store.subscribe(record.job));
        let mut tick = interval(PROGRESS_EVERY);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let renew_every = self.store.renew_every();
        let mut renew = interval_at(Instant::now() + renew_every, renew_every);
        renew.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut remaining = RemainingTime::default();
        loop {
            let wanted = tokio::select! {
                () = changes.changed() => self.store.export_is_wanted(record).await,
                () = job.changed() => self.store.export_is_wanted(record).await,
                () = self.shutdown.cancelled(), if control.stopped().is_none() => {
                    control.stop(Stop::Shutdown);
                    continue;
                }
                _ = renew.tick() => self.store.renew_export(record).await,
                _ = tick.tick() => match control.take_progress() {
                    Some(progress) => {
                        let news = as_recorded(&progress, &mut remaining, started.elapsed());
                        self.store.export_progress(record, news).await
                    }
                    None => continue,
                },
            };
            match wanted {
                Ok(true) => {}
                Ok(false) => control.stop(Stop::Cancelled),
                Err(error) => tracing::warn!(%error, "progress was not recorded"),
            }
        }
    }

    /// The work itself, on a thread that may block.
    fn make(&self, claimed: &ClaimedExport, room: (u64, Bound), control: &RunControl) -> End {
        match self.try_make(claimed, room, control) {
            Ok(end) => end,
            Err(failure) => control.stopped().map_or_else(|| failure.end(claimed.faults), End::Stopped),
        }
    }

    fn try_make(
        &self,
        claimed: &ClaimedExport,
        (left, bound): (u64, Bound),
        control: &RunControl,
    ) -> Result<End, NotMade> {
        let record = &claimed.export;
        let export = ExportRequest::from_json(&record.options)
            .map_err(|faults| NotMade::Lasting(Failure::invalid(faults)))?;
        let unreadable = |error: &dyn std::fmt::Display| {
            tracing::error!(%error, "the stored result is unreadable");
            NotMade::Lasting(Failure::new(
                FailureCode::ResultDamaged,
                "the stored result is missing or damaged",
            ))
        };
        let stored = self
            .artifacts
            .read(&claimed.result)
            .map_err(|error| if is_passing(&error) { NotMade::fault(&error) } else { unreadable(&error) })?;
        let specimen = Specimen::from_json(&stored.head().request["specimen"])
            .map_err(|faults| unreadable(&faults.iter().map(ToString::to_string).collect::<String>()))?;
        let loaded_bytes = tables::loaded_bytes(&stored);
        let grains = tables::load(&stored).map_err(|error| match error.kind() {
            io::ErrorKind::OutOfMemory => failed(ExportError::OutOfMemory { bytes: loaded_bytes }),
            _ if is_passing(&error) => NotMade::fault(&error),
            _ => unreadable(&error),
        })?;
        let provenance = Provenance {
            result_sha256: Some(claimed.result.sha256.clone()),
            ..Provenance::from(stored.head())
        };
        drop(stored);
        let max_model_bytes = self.limits.max_model_bytes.saturating_sub(loaded_bytes);
        let limits = Limits { max_model_bytes, ..self.limits };
        let model = Model::new(&specimen, &grains).with_provenance(&provenance);
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
                    NotMade::fault(&error)
                }
                other => failed(other),
            })?;
        let (file, report) = written;
        let report = serde_json::to_value(&report).map_err(|error| unreadable(&error))?;
        Ok(End::Made { file, report, _place: place })
    }

    /// Writes down how it ended, and keeps trying: the work is done.
    async fn record_end(&self, record: &ExportRecord, end: End, took: Duration) {
        loop {
            let (outcome, recorded) = match &end {
                End::Made { file, report, .. } => {
                    ("succeeded", self.store.export_made(record, file.clone(), report.clone()).await)
                }
                End::Failed(failure) => ("failed", self.store.export_failed(record, failure).await),
                End::Faulted => ("requeued", self.store.export_requeued_after_fault(record).await),
                End::Stopped(Stop::Shutdown) => ("given_back", self.store.export_requeued(record).await),
                End::Stopped(_) => ("called_off", Ok::<_, StoreError>(false)),
            };
            match recorded {
                Ok(wanted) => {
                    tracing::info!(outcome, wanted, took_s = took.as_secs_f64(), "ended");
                    self.metrics.export_ended(record.kind.name(), outcome, took);
                    if let End::Made { file, .. } = &end {
                        if wanted {
                            self.shrink_cache(record).await;
                        } else {
                            self.artifacts.discard(vec![file.path.clone()]).await;
                        }
                    }
                    return;
                }
                Err(error) => {
                    tracing::error!(%error, "the end was not recorded; trying again");
                    // Nothing else could be claimed from such a store; at the next start it is taken back.
                    tokio::select! {
                        () = sleep(STORE_PAUSE) => {}
                        () = self.shutdown.cancelled() => return,
                    }
                }
            }
        }
    }

    async fn shrink_cache(&self, made: &ExportRecord) {
        let shrunk = async {
            let most = self.storage.cache_bytes(self.cache_bytes).await?;
            self.store.shrink_cache(most, made.id).await
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

/// Why a file was not made.
enum NotMade {
    /// By the request, the packing or a defect.
    Lasting(Failure),
    /// By a fault of the machine.
    Fault,
    /// By memory that the system refused.
    NoMemory(Failure),
}

impl NotMade {
    fn fault(error: &io::Error) -> Self {
        tracing::warn!(%error, "a file could not be read or written");
        Self::Fault
    }

    /// How an export ends that was not made, and has met so many faults of the machine before. Another run may have
    /// taken the memory; an export that never finds any fails.
    fn end(self, faults: i64) -> End {
        match self {
            Self::Lasting(failure) => End::Failed(failure),
            Self::NoMemory(failure) if faults >= MEMORY_FAULTS => End::Failed(failure),
            Self::NoMemory(failure) => {
                tracing::warn!(error = failure.detail, "the export found no memory");
                End::Faulted
            }
            Self::Fault => End::Faulted,
        }
    }
}

fn no_room_left(no_room: &NoRoom) -> NotMade {
    let figures = FailureFacts {
        needed_bytes: Some(no_room.needed),
        free_bytes: Some(no_room.left),
        ..FailureFacts::default()
    };
    let failure = Failure::new(FailureCode::InsufficientStorage, no_room.to_string()).with_facts(figures);
    NotMade::Lasting(failure)
}

fn failed(error: ExportError) -> NotMade {
    match error {
        ExportError::Write(error) => NotMade::fault(&error),
        ExportError::CheckFailed(what) => {
            tracing::error!(%what, "what was made failed its check");
            NotMade::Lasting(ExportError::CheckFailed(what).into())
        }
        error @ ExportError::OutOfMemory { .. } => NotMade::NoMemory(error.into()),
        other => NotMade::Lasting(other.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_export_that_never_finds_memory_fails() {
        let refused = || failed(ExportError::OutOfMemory { bytes: 1 << 40 });
        assert!(matches!(refused().end(MEMORY_FAULTS - 1), End::Faulted));
        let End::Failed(failure) = refused().end(MEMORY_FAULTS) else { panic!("it goes on for ever") };
        assert_eq!(failure.code, FailureCode::OutOfMemory);
        let full = failed(ExportError::Write(io::ErrorKind::StorageFull.into()));
        assert!(matches!(full.end(100), End::Faulted));
    }
}
