//! The executor: leases a job, runs the engine on a thread of the blocking pool, and tells how it ended.
//!
//! There are as many executors as the process has slots, and a job holds one slot for each of its threads ([`slots`]).
//! Executors for which no slot is left wait, so that the threads that pack are bounded by the slots. An executor
//! watches its run from outside: it tells of progress at most twice a second, renews the lease, and
//! passes on a client's request to cancel, the job's time limit and the stop of the process. It alone
//! decides what the end of a run means; the engine only ends. Where the jobs come from, it does not know: see
//! [`Leases`].
//!
//! [`slots`]: super::slots

use std::sync::Arc;
use std::time::Duration;

use packstone_engine::export::tables::{EngineInfo, Head};
use packstone_engine::{Control as _, Grains, PackError, Phase, Plan, Progress};
use tokio::sync::oneshot;

use tokio::time::{Instant, MissedTickBehavior, interval, sleep, sleep_until, timeout};
use tokio_util::sync::CancellationToken;
use tracing::Instrument as _;

use super::control::{RunControl, Stop};
use super::ending::{Cause, End, FailedRun, Run, Stored};
use super::leases::{LeaseError, Leases, Work};
use super::slots::{Held, Slots};
use crate::artifacts::{Artifacts, InFlight};
use crate::checkpoints::Checkpoints;
use crate::disk::Disk;
use crate::exports::NewExport;
use crate::failure::{Failure, FailureCode};
use crate::jobs::{ArtifactRecord, JobProgress, JobRequest, Lease};
use crate::metrics::Metrics;
use crate::remaining_time::RemainingTime;
use crate::storage::{Storage, fits};
use crate::studies::Facts;
use crate::tasks::{self, Task};

/// Progress is told no more often than this.
const PROGRESS_EVERY: Duration = Duration::from_millis(500);
/// A source of jobs that fails gets this much time before the next try.
const SOURCE_PAUSE: Duration = Duration::from_secs(1);
/// How often the end of a job is offered to a source that fails by a defect, before the lease of the job may run out.
const END_TRIES: u32 = 5;
/// How often it is offered after the process was asked to stop.
const END_TRIES_AT_STOP: u32 = 3;
/// Pauses before a result is written once more that a fault of the machine kept from the disk; it stays in memory.
const WRITE_PAUSES: [Duration; 4] =
    [Duration::from_secs(1), Duration::from_secs(2), Duration::from_secs(4), Duration::from_secs(8)];
/// How often a job or an export is requeued that finds no memory.
pub(crate) const MEMORY_FAULTS: i64 = 5;
/// Time for a last checkpoint after the process was asked to stop.
const LAST_CHECKPOINT: Duration = Duration::from_secs(5);
/// Time to copy it to where other servers find it.
const SHARE_CHECKPOINT: Duration = Duration::from_secs(2);

/// Held while a packing is computed, and dropped when only its result is left to be written.
struct Packing {
    // Goes before the signal, so that who follows it finds the slots free.
    slots: Held,
    // Nothing is ever sent: it goes when the engine is done, however it ends.
    _done: oneshot::Sender<()>,
}

/// What every executor needs.
#[derive(Clone, Debug)]
pub(crate) struct Executor {
    pub(crate) leases: Leases,
    /// The slots of this process, which the executors share.
    pub(crate) slots: Slots,
    /// Where results are written.
    pub(crate) artifacts: Artifacts,
    /// Where checkpoints are kept while a job runs.
    pub(crate) checkpoints: Checkpoints,
    pub(crate) disk: Disk,
    pub(crate) metrics: Arc<Metrics>,
    /// When cancelled, running jobs go back to the queue and executors end.
    pub(crate) shutdown: CancellationToken,
}

impl Executor {
    /// Runs jobs until the process stops, or its source has no more for it. While the result of one is written, which
    /// is waiting for the disk, the next is packed; one result at a time, so that a slow disk does not pile them up in
    /// memory.
    pub(crate) async fn work(self) {
        let mut writing: Option<Task<()>> = None;
        while !self.shutdown.is_cancelled() && !self.leases.are_over() {
            let claimed = self.leases.claim(&self.slots, &self.shutdown).await;
            match claimed {
                Ok(Some((work, slots))) => {
                    let span =
                        tracing::info_span!("job", job_id = %work.lease.id, attempt = work.lease.attempt);
                    let (done, has_packed) = oneshot::channel();
                    let packing = Packing { slots, _done: done };
                    let run = tasks::spawn(self.clone().run(work, packing).instrument(span));
                    let _ = has_packed.await;
                    end_of(writing.replace(run)).await;
                }
                Ok(None) => {}
                Err(error) => {
                    tracing::error!(%error, "no job could be leased");
                    tokio::select! {
                        () = sleep(SOURCE_PAUSE) => {}
                        () = self.shutdown.cancelled() => {}
                    }
                }
            }
        }
        end_of(writing).await;
    }

    /// Runs a job to its end.
    async fn run(self, work: Work, packing: Packing) {
        let started = Instant::now();
        let lease = work.lease;
        tracing::info!(threads = packing.slots.count(), "started");
        self.leases.prepare(&work, &self.checkpoints).await;
        let checkpoints = self.checkpoints.writer(&lease.id.to_string(), lease.attempt);
        let control = Arc::new(RunControl::with_checkpoints(checkpoints));
        let timeout_s = work.timeout_s;
        let deadline = timeout_s.map(|s| started + Duration::from_secs_f64(s));
        let mut running = tasks::blocking({
            let (control, executor, span) = (Arc::clone(&control), self.clone(), tracing::Span::current());
            move || span.in_scope(|| executor.pack_and_write(&work, &control, packing))
        });
        let end = tokio::select! {
            end = &mut running => end,
            never = self.watch(lease, &control, started, deadline) => match never {},
        };
        let end = end.unwrap_or_else(|panic| {
            tracing::error!(%panic, "the run panicked");
            let failure = Failure::new(
                FailureCode::InternalError,
                "the run came upon a defect of this program; the log has it under the job's id",
            );
            End::Failed(failure.into())
        });
        if matches!(end, End::Stopped(Stop::Shutdown)) {
            self.share_checkpoint(lease).await;
        }
        let run = Run { took: started.elapsed(), timeout_s, fraction: control.fraction() };
        self.record_end(lease, end, run).await;
    }

    /// Watches a run for as long as it lasts.
    async fn watch(
        &self,
        lease: Lease,
        control: &RunControl,
        started: Instant,
        deadline: Option<Instant>,
    ) -> std::convert::Infallible {
        let mut changes = self.leases.follow(lease);
        let mut tick = interval(PROGRESS_EVERY);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut renewed = Instant::now();
        let mut remaining = RemainingTime::default();
        // A request to cancel that came between the lease and the subscription is seen here.
        let mut look = true;
        let mut last_checkpoint_by: Option<Instant> = None;
        loop {
            if look {
                match self.leases.is_cancelled(lease).await {
                    Ok(true) => control.stop(Stop::Cancelled),
                    Ok(false) => {}
                    Err(LeaseError::Lost) => control.stop(Stop::LeaseLost),
                    Err(error) => tracing::warn!(%error, "a request to cancel may have been missed"),
                }
            }
            look = false;
            tokio::select! {
                () = changes.changed() => look = true,
                () = at(deadline), if !control.should_stop() => control.stop(Stop::TimedOut),
                () = self.shutdown.cancelled(), if last_checkpoint_by.is_none() && !control.should_stop() => {
                    if control.stop_after_checkpoint() {
                        last_checkpoint_by = Some(Instant::now() + LAST_CHECKPOINT);
                    } else {
                        control.stop(Stop::Shutdown);
                    }
                }
                () = at(last_checkpoint_by), if !control.should_stop() => control.stop(Stop::Shutdown),
                _ = tick.tick() => {
                    let news = control.take_progress();
                    if news.is_none() && renewed.elapsed() < self.leases.renew_every() {
                        continue;
                    }
                    renewed = Instant::now();
                    if control.take_resumed() {
                        remaining.resumed();
                    }
                    let news = news.map(|p| as_recorded(&p, &mut remaining, started.elapsed()));
                    match self.leases.renew(lease, news).await {
                        Ok(true) => control.stop(Stop::Cancelled),
                        Ok(false) => {}
                        Err(LeaseError::Lost) => control.stop(Stop::LeaseLost),
                        Err(error) => tracing::warn!(%error, "progress was not recorded"),
                    }
                }
            }
        }
    }

    /// The run itself, on a thread that may block.
    fn pack_and_write(&self, work: &Work, control: &RunControl, packing: Packing) -> End {
        match self.try_pack_and_write(work, control, packing) {
            Ok(end) => end,
            Err(failure) => control.stopped().map_or(End::Failed(failure), End::Stopped),
        }
    }

    fn try_pack_and_write(
        &self,
        work: &Work,
        control: &RunControl,
        packing: Packing,
    ) -> Result<End, FailedRun> {
        let stored: serde_json::Value = serde_json::from_str(&work.request).map_err(|error| {
            tracing::error!(%error, "the stored request is unreadable");
            Failure::new(FailureCode::InternalError, "the stored request is unreadable")
        })?;
        let request = JobRequest::read(&stored, 0, None).map_err(Failure::invalid)?;
        let (request, postprocess) = (request.packing(), request.postprocess);
        let bytes = Plan::new(&request, &work.limits).map_or(0, |plan| Storage::bytes_of_result(plan.grains));
        if let Err(no_room) = fits(bytes, work.room) {
            tracing::warn!(%no_room, "the result would not fit; the job waits");
            return Ok(End::Faulted(Cause::NoRoom(bytes)));
        }
        let id = work.lease.id.to_string();
        self.checkpoints.prepare(&id, &|| control.should_stop());
        let resume = self.checkpoints.resume(&id, &request);
        if resume.is_some() {
            control.resumed();
        }
        let packed = match packstone_engine::pack_or_resume(&request, &work.limits, resume, control) {
            Ok(packed) => packed,
            // Another run may have taken the memory; what never finds it is at fault itself.
            Err(error @ PackError::OutOfMemory { .. }) if work.faults < MEMORY_FAULTS => {
                tracing::warn!(%error, "the run found no memory");
                return Ok(control.stopped().map_or(End::Faulted(Cause::Other), End::Stopped));
            }
            Err(error) => {
                if let PackError::CheckFailed(what) = &error {
                    tracing::error!(%what, "a packing failed its check");
                }
                return Err(FailedRun {
                    facts: Facts::of_failure(&error, 0.0),
                    failure: Box::new(Failure::from(error)),
                });
            }
        };
        drop(packing);
        let facts = Facts::of_packing(&packed.report);
        let grains = packed.grains.len() as u64;
        control.report(&Progress {
            phase: Phase::Write,
            fraction: 1.0,
            done: 0,
            total: grains,
            unit: "grains",
            message: "writing the result".into(),
            growth: None,
        });
        let head = Head {
            job_id: Some(work.lease.id.to_string()),
            request: stored,
            engine: EngineInfo::current(),
            report: packed.report,
        };
        let place = self.artifacts.begin(&work.lease.id.to_string(), work.lease.attempt);
        let Some(artifact) = self.write(&place, &head, &packed.grains, control) else {
            return Ok(control.stopped().map_or(End::Faulted(Cause::NotWritten(bytes)), End::Stopped));
        };
        let postprocess =
            postprocess.items().iter().map(|(_, item)| NewExport::new(item, &artifact.sha256)).collect();
        Ok(End::Stored(Box::new(Stored { artifact, facts, grains, postprocess, _place: place })))
    }

    /// Writes a result; `None` where the run was stopped, or a fault of the machine does not pass within 15 s.
    fn write(
        &self,
        place: &InFlight,
        head: &Head,
        grains: &Grains,
        control: &RunControl,
    ) -> Option<ArtifactRecord> {
        let mut pauses = WRITE_PAUSES.iter();
        loop {
            let error = match self.artifacts.write(place, head, grains, control) {
                Ok(artifact) => return Some(artifact),
                Err(error) => error,
            };
            self.disk.note_failure(&error);
            let pause = pauses.next().filter(|_| control.stopped().is_none())?;
            tracing::warn!(%error, pause_s = pause.as_secs(), "the result was not written; trying again");
            let until = std::time::Instant::now() + *pause;
            while std::time::Instant::now() < until && control.stopped().is_none() {
                std::thread::sleep(Duration::from_millis(100));
            }
        }
    }

    /// Tells how a run ended. A fault of the machine is waited out: the work is done and lies on the disk.
    async fn record_end(&self, lease: Lease, end: End, run: Run) {
        let mut tries = 1;
        loop {
            match self.leases.end(lease, &end, run).await {
                Ok(()) => {
                    tracing::info!(outcome = end.name(), took_s = run.took.as_secs_f64(), "ended");
                    self.metrics.job_ended(end.name(), run.took);
                    if !matches!(end, End::Stopped(Stop::Shutdown) | End::Faulted(_)) {
                        self.remove_checkpoints(lease).await;
                    }
                    return;
                }
                Err(LeaseError::Lost) => {
                    tracing::warn!("the lease was lost; this attempt leaves no trace");
                    if let End::Stored(stored) = &end {
                        self.artifacts.discard(vec![stored.artifact.path.clone()]).await;
                    }
                    return;
                }
                Err(error) if self.may_try_again(&error, tries) => {
                    tracing::error!(%error, tries, "the end of the job was not recorded; trying again");
                    tries += 1;
                    sleep(SOURCE_PAUSE).await;
                }
                Err(error) => {
                    tracing::error!(%error, "the end of the job was not recorded; its lease will run out");
                    return;
                }
            }
        }
    }

    /// Whether the end of a job is to be offered once more.
    fn may_try_again(&self, error: &LeaseError, tries: u32) -> bool {
        if self.shutdown.is_cancelled() {
            tries < END_TRIES_AT_STOP
        } else {
            matches!(error, LeaseError::Passing(_)) || tries < END_TRIES
        }
    }

    /// Lets other servers go on from the last checkpoint of a run, within the time that a stop has.
    async fn share_checkpoint(&self, lease: Lease) {
        let checkpoints = self.checkpoints.clone();
        let shared = tasks::blocking(move || checkpoints.share(&lease.id.to_string(), lease.attempt));
        if timeout(SHARE_CHECKPOINT, shared).await.is_err() {
            tracing::warn!("the last checkpoint was not shared in time");
        }
    }

    /// Removes what an ended job has no more use for. Not before its end is recorded: until then the end
    /// may be lost, and the checkpoint is what is left of the work.
    async fn remove_checkpoints(&self, lease: Lease) {
        let checkpoints = self.checkpoints.clone();
        let removed = tasks::blocking(move || checkpoints.remove(&lease.id.to_string(), lease.attempt));
        if let Err(error) = removed.await {
            tracing::warn!(%error, "checkpoints are left to the sweeper");
        }
    }
}

/// Waits for the end of a run, if there is one.
async fn end_of(run: Option<Task<()>>) {
    if let Some(run) = run
        && let Err(error) = run.await
    {
        tracing::error!(%error, "a run ended by a defect of this program; its lease will run out");
    }
}

/// Waits for a moment that may never come.
async fn at(moment: Option<Instant>) {
    match moment {
        Some(moment) => sleep_until(moment).await,
        None => std::future::pending().await,
    }
}

/// Progress as clients see it: never falling, and with the time that is left.
pub(crate) fn as_recorded(
    progress: &Progress,
    remaining: &mut RemainingTime,
    elapsed: Duration,
) -> JobProgress {
    remaining.follow(progress, elapsed);
    JobProgress {
        fraction: remaining.fraction(),
        phase: progress.phase,
        done: progress.done,
        total: progress.total,
        unit: progress.unit.into(),
        message: progress.message.clone(),
        eta_s: remaining.eta_s(elapsed),
        growth: progress.growth,
    }
}
