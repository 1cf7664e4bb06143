//! The executor: leases a task, runs it on a thread of the blocking pool, and tells how it ended.
//!
//! It is the same for both kinds of tasks, packings and exports. Each kind has executors of its own, so that an export
//! does not wait behind hours of packing; their number bounds what runs at once, of packings together with the
//! [`slots`]. An executor watches its run from outside: it tells of progress at most twice a second, renews the lease,
//! and passes on a client's request to cancel, the time limit and the stop of the process. It alone decides what the
//! end of a run means; the engine only ends. Where the tasks come from and what a run does, it does not know: see
//! [`TaskKind`](super::task::TaskKind).
//!
//! [`slots`]: super::slots

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use packstone_engine::{Control as _, Progress};
use tokio::sync::oneshot;
use tokio::time::{Instant, MissedTickBehavior, interval_at, sleep, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::Instrument as _;

use super::control::{RunControl, Stop};
use super::ending::{End, LEASE_LOST, Run};
use super::task::{Computing, Ended, LeaseError, TaskSource, Terms};
use crate::failure::{Failure, FailureCode};
use crate::jobs::JobProgress;
use crate::remaining_time::RemainingTime;
use crate::tasks::{self, Task};

/// Progress is told no more often than this.
const PROGRESS_EVERY: Duration = Duration::from_millis(500);
/// The first progress is told so long after the start. Many runs have ended by then, and cost one write less.
const FIRST_PROGRESS: Duration = Duration::from_millis(100);
/// A source of tasks that fails gets this much time before the next try.
const SOURCE_PAUSE: Duration = Duration::from_secs(1);
/// How often the end of a task is offered to a source that fails by a defect, before the lease may run out.
const END_TRIES: u32 = 5;
/// How often it is offered after the process was asked to stop.
const END_TRIES_AT_STOP: u32 = 3;
/// Time for a last checkpoint after the process was asked to stop.
const LAST_CHECKPOINT: Duration = Duration::from_secs(5);

/// An executor of one kind of tasks.
#[derive(Clone, Debug)]
pub(crate) struct Executor<K> {
    pub(crate) kind: K,
    /// When cancelled, what runs goes back to its queue and the executor ends.
    pub(crate) shutdown: CancellationToken,
}

impl<K: TaskSource> Executor<K> {
    /// Runs tasks until the process stops, or there are no more for it. While the file of one is written or recorded,
    /// which is waiting for the disk, the next is computed; one file at a time, so that a slow disk does not pile them
    /// up in memory.
    pub(crate) async fn work(self) {
        let mut ending: Option<Task<()>> = None;
        while !self.shutdown.is_cancelled() && !self.kind.are_over() {
            match self.kind.claim(&self.shutdown).await {
                Ok(Some((work, slots))) => {
                    let (done, has_computed) = oneshot::channel();
                    let computing = Computing { _slots: slots, _done: done };
                    let terms = self.kind.terms(&work);
                    let span = terms.span.clone();
                    let run =
                        tasks::spawn(self.clone().run(Arc::new(work), terms, computing).instrument(span));
                    let _ = has_computed.await;
                    end_of(ending.replace(run)).await;
                }
                Ok(None) => {}
                Err(error) => {
                    tracing::error!(%error, "nothing could be leased");
                    tokio::select! {
                        () = sleep(SOURCE_PAUSE) => {}
                        () = self.shutdown.cancelled() => {}
                    }
                }
            }
        }
        end_of(ending).await;
    }

    /// Runs a task to its end.
    async fn run(self, work: Arc<K::Work>, terms: Terms, computing: Computing) {
        let started = Instant::now();
        let Terms { span, timeout_s, faults } = terms;
        let control = Arc::new(self.kind.prepare(&work).await);
        let deadline = timeout_s.map(|s| started + Duration::from_secs_f64(s));
        let mut running = tasks::blocking({
            let (kind, work, control) = (self.kind.clone(), Arc::clone(&work), Arc::clone(&control));
            move || {
                span.in_scope(|| match kind.run(&work, &control, computing) {
                    Ok(made) => End::Made(made),
                    Err(not_made) => {
                        control.stopped().map_or_else(|| End::of(not_made, faults), End::Stopped)
                    }
                })
            }
        });
        let end = tokio::select! {
            end = &mut running => end,
            never = self.watch(&work, &control, started, deadline) => match never {},
        };
        let end = end.unwrap_or_else(|panic| {
            tracing::error!(%panic, "the run panicked");
            let failure = Failure::new(
                FailureCode::InternalError,
                "the run came upon a defect of this program; the log has it under this ID",
            );
            End::Failed(failure.into())
        });
        if matches!(end, End::Stopped(Stop::Shutdown)) {
            self.kind.hand_on(&work).await;
        }
        let run = Run { took: started.elapsed(), timeout_s, fraction: control.fraction() };
        self.record_end(&work, end, run).await;
    }

    /// Watches a run for as long as it lasts.
    async fn watch(
        &self,
        work: &K::Work,
        control: &RunControl,
        started: Instant,
        deadline: Option<Instant>,
    ) -> Infallible {
        let mut changes = self.kind.follow(work);
        let mut tick = interval_at(Instant::now() + FIRST_PROGRESS, PROGRESS_EVERY);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut renewed = Instant::now();
        let mut remaining = RemainingTime::default();
        // A request that came between the lease and the subscription is seen here.
        let mut look = true;
        let mut last_checkpoint_by: Option<Instant> = None;
        loop {
            if look {
                match self.kind.requests(work).await {
                    Ok(requests) => control.follow(requests),
                    Err(LeaseError::Lost) => control.stop(Stop::LeaseLost),
                    Err(error) => tracing::warn!(%error, "a request to end the run may have been missed"),
                }
            }
            look = false;
            tokio::select! {
                () = changes.changed() => look = true,
                () = at(deadline), if !control.is_ending() => control.reach_deadline(),
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
                    if news.is_none() && renewed.elapsed() < self.kind.renew_every() {
                        continue;
                    }
                    renewed = Instant::now();
                    if control.take_resumed() {
                        remaining.resumed();
                    }
                    let news = news.map(|p| as_recorded(&p, &mut remaining, started.elapsed()));
                    match self.kind.renew(work, news).await {
                        Ok(requests) => control.follow(requests),
                        Err(LeaseError::Lost) => control.stop(Stop::LeaseLost),
                        Err(error) => tracing::warn!(%error, "progress was not recorded"),
                    }
                }
            }
        }
    }

    /// Tells how a run ended. A fault of the machine is waited out: the work is done and lies on the disk.
    async fn record_end(&self, work: &K::Work, end: End<K::Made>, run: Run) {
        let mut tries = 1;
        let is_recorded = loop {
            match self.kind.end(work, end.told(run)).await {
                Ok(()) => break true,
                Err(LeaseError::Lost) => {
                    tracing::warn!("the lease was lost; this attempt leaves no trace");
                    break false;
                }
                Err(error) if may_try_again(&error, tries, self.shutdown.is_cancelled()) => {
                    tracing::error!(%error, tries, "the end of the run was not recorded; trying again");
                    tries += 1;
                    sleep(SOURCE_PAUSE).await;
                }
                Err(error) => {
                    tracing::error!(%error, "the end of the run was not recorded; its lease will run out");
                    return;
                }
            }
        };
        let outcome = if is_recorded { end.name() } else { LEASE_LOST };
        tracing::info!(outcome, took_s = run.took.as_secs_f64(), "ended");
        let ended = Ended {
            made: end.made(),
            is_requeued: matches!(end, End::Stopped(Stop::Shutdown) | End::Faulted(_)),
            is_recorded,
            outcome,
            took: run.took,
        };
        self.kind.ended(work, ended).await;
    }
}

/// Whether the end of a run is to be offered once more.
fn may_try_again(error: &LeaseError, tries: u32, is_stopping: bool) -> bool {
    match error {
        _ if is_stopping => tries < END_TRIES_AT_STOP,
        LeaseError::Passing(_) => true,
        LeaseError::Failed(_) | LeaseError::Lost => tries < END_TRIES,
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
fn as_recorded(progress: &Progress, remaining: &mut RemainingTime, elapsed: Duration) -> JobProgress {
    remaining.follow(progress, elapsed);
    JobProgress {
        fraction: remaining.fraction(),
        step: progress.step,
        done: progress.done,
        total: progress.total,
        unit: progress.unit.into(),
        message: progress.message.clone(),
        eta_s: remaining.eta_s(elapsed),
        growth: progress.growth,
    }
}
