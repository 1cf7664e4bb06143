//! The checks of what worker processes have sent: results, and failures that can be verified.
//!
//! A job whose worker has sent the end of its attempt stays `running` until the end is checked
//! ([`received`](crate::jobs::store)). Each result is held against the grains that the seed draws, and its report
//! against its grains; a share of them, drawn when the check begins, passes the independent check of all pairs too. The
//! checks run on threads of their own, so that requests never wait for them. A check that a stop or a crash of the
//! server ends begins again, here or in another server of the same database.

use std::sync::Arc;
use std::time::Duration;

use packstone_engine::check::Scope;
use packstone_engine::export::{ExportRequest, tables};
use packstone_engine::{Limits, TemplateCache, VerifyError, verify, verify_failure};
use serde_json::Value;
use tokio::sync::oneshot;
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep};
use tokio_util::sync::CancellationToken;
use tracing::Instrument as _;

use super::claims;
use super::control::{RunControl, Stop};
use super::packing::complete;
use crate::advice::failure_of;
use crate::artifacts::Artifacts;
use crate::checkpoints::Checkpoints;
use crate::disk::is_passing;
use crate::exports::NewExport;
use crate::failure::Failure;
use crate::jobs::store::{FormatLengths, MOST_WRONG_RESULTS, Received, ReceivedEnd, Store, StoreError};
use crate::jobs::{ArtifactRecord, JobProgress, JobRequest, Lease};
use crate::metrics::{CheckOutcome, Metrics};
use crate::studies::Facts;
use crate::tasks;

/// Time between two looks for ends that were received: of another server, or of one that has ended.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Pause after a fault of the machine.
const PAUSE: Duration = Duration::from_secs(5);

/// The checks of a server.
#[derive(Clone, Debug)]
pub(crate) struct Checks {
    pub(crate) store: Store,
    pub(crate) artifacts: Artifacts,
    pub(crate) checkpoints: Checkpoints,
    pub(crate) metrics: Arc<Metrics>,
    pub(crate) limits: Limits,
    pub(crate) templates: Arc<TemplateCache>,
    /// Threads that check.
    pub(crate) threads: usize,
    /// Share of the results whose pairs are checked, from 0 to 1.
    pub(crate) share: f64,
    pub(crate) shutdown: CancellationToken,
}

/// What a check has found.
enum Verdict {
    /// The result answers the request.
    Packing {
        grains: u64,
        facts: Facts,
        exports: Vec<NewExport>,
        formats: FormatLengths,
    },
    /// The run may have failed so.
    Failure(Failure, Facts),
    /// The worker has sent what does not answer the request.
    Wrong(String),
    /// The stored file is no longer what was received.
    Lost(String),
    /// A fault of this machine.
    Later(String),
    Stopped,
}

impl Checks {
    /// Checks what is received until the server stops.
    pub(crate) async fn run(self) {
        let mut running: JoinSet<()> = JoinSet::new();
        while !self.shutdown.is_cancelled() {
            loop {
                match self.store.next_check(running.len() < self.threads).await {
                    Ok(Some(received)) => {
                        let span = tracing::info_span!(
                            "check",
                            job_id = %received.lease.id,
                            attempt = received.lease.attempt,
                            worker = received.worker,
                            key = received.key
                        );
                        let check: tasks::Boxed<()> = Box::pin(self.clone().check(received).instrument(span));
                        running.spawn(check);
                    }
                    Ok(None) => break,
                    Err(error) => {
                        tracing::error!(%error, "what workers have sent cannot be looked for");
                        break;
                    }
                }
            }
            tokio::select! {
                Some(ended) = running.join_next() => note_panic(ended),
                () = self.store.checks_notified() => {}
                () = sleep(LOOK_EVERY) => {}
                () = self.shutdown.cancelled() => {}
            }
        }
        while let Some(ended) = running.join_next().await {
            note_panic(ended);
        }
    }

    /// Checks the end of an attempt, and records what was found.
    async fn check(self, received: Received) {
        let begun = Instant::now();
        let lease = received.lease;
        let scope = if rand::random::<f64>() < self.share { Scope::All } else { Scope::WithoutPairs };
        let verdict = self.verdict(Arc::new(received.clone()), scope).await;
        let took = begun.elapsed();
        let outcome = match &verdict {
            Verdict::Packing { .. } | Verdict::Failure(..) => CheckOutcome::Right,
            Verdict::Wrong(_) => CheckOutcome::Wrong,
            Verdict::Lost(_) | Verdict::Later(_) | Verdict::Stopped => CheckOutcome::Broken,
        };
        self.metrics.result_checked(outcome, took);
        loop {
            match self.record(&received, &verdict).await {
                Ok(()) => break,
                // A cancellation, or another server that checks too, came first.
                Err(StoreError::LeaseLost) => return,
                Err(error) if error.fault().is_some() && !self.shutdown.is_cancelled() => {
                    tracing::error!(%error, "the end of a check was not recorded; trying again");
                    sleep(PAUSE).await;
                }
                Err(error) => {
                    tracing::error!(%error, "the end of a check was not recorded; it will begin again");
                    return;
                }
            }
        }
        let took_s = took.as_secs_f64();
        match verdict {
            Verdict::Packing { .. } => self.note_end(&received, "succeeded", took_s),
            Verdict::Failure(..) => self.note_end(&received, "failed", took_s),
            Verdict::Lost(why) => {
                tracing::error!(why, "a received result was lost on this machine; the job is requeued");
            }
            Verdict::Later(why) => {
                tracing::warn!(why, "a check met a fault of this machine; it begins again");
            }
            Verdict::Wrong(_) => {
                if let ReceivedEnd::Result(artifact) = received.end {
                    self.artifacts.discard(vec![artifact.path]).await;
                }
            }
            Verdict::Stopped => {}
        }
        if outcome == CheckOutcome::Right {
            self.remove_checkpoints(lease).await;
        }
    }

    /// Runs the check on a thread of its own, and renews its lease meanwhile.
    async fn verdict(&self, received: Arc<Received>, scope: Scope) -> Verdict {
        let lease = received.lease;
        let control = Arc::new(RunControl::default());
        let (sender, mut receiver) = oneshot::channel();
        let work = {
            let (checks, control) = (self.clone(), Arc::clone(&control));
            let span = tracing::Span::current();
            // The receiver goes only where the server stops.
            move || drop(sender.send(span.in_scope(|| checks.check_end(&received, scope, &control))))
        };
        if let Err(error) = std::thread::Builder::new().name("check".into()).spawn(work) {
            return Verdict::Later(error.to_string());
        }
        let mut changes = self.store.subscribe(lease.id);
        let mut tick = interval(self.store.renew_every());
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                verdict = &mut receiver => {
                    // The hook of panics has logged it.
                    return verdict.unwrap_or_else(|_| Verdict::Wrong("the check came upon a defect".into()));
                }
                () = self.shutdown.cancelled(), if control.stopped().is_none() => control.stop(Stop::Shutdown),
                () = changes.changed() => {}
                _ = tick.tick() => {}
            }
            match self.store.renew_check(lease).await {
                Ok(false) => {}
                Ok(true) => control.stop(Stop::Cancelled),
                Err(StoreError::LeaseLost) => control.stop(Stop::LeaseLost),
                Err(error) => tracing::warn!(%error, "the lease of a check was not renewed"),
            }
        }
    }

    /// The check itself.
    fn check_end(&self, received: &Received, scope: Scope, control: &RunControl) -> Verdict {
        let read = serde_json::from_str::<Value>(&received.request)
            .map_err(|error| error.to_string())
            .and_then(|stored| JobRequest::read(&stored, 0, None).map_err(|faults| format!("{faults:?}")));
        let request = match read {
            Ok(request) => request,
            Err(error) => return Verdict::Later(format!("the stored request is unreadable: {error}")),
        };
        match &received.end {
            ReceivedEnd::Result(artifact) => self.check_result(&request, artifact, scope, control),
            ReceivedEnd::Failure(failure) => {
                let Some(told) = claims::error_of(failure) else {
                    return Verdict::Wrong(format!(
                        "the failure {:?} has not its figures",
                        failure.code.name()
                    ));
                };
                let packing = request.packing();
                match verify_failure(&packing, &self.limits, &told, &self.templates, control) {
                    Ok(()) => {
                        let took = received.at - received.started_at.unwrap_or(received.at);
                        let facts = Facts::of_failure(&told, took.max(0) as f64 / 1e6);
                        Verdict::Failure(failure_of(told, &packing, &self.limits), facts)
                    }
                    Err(error) => refusal(error),
                }
            }
        }
    }

    fn check_result(
        &self,
        request: &JobRequest,
        artifact: &ArtifactRecord,
        scope: Scope,
        control: &RunControl,
    ) -> Verdict {
        let stored = match self.artifacts.read(artifact) {
            Ok(stored) => stored,
            Err(error) if is_passing(&error) => return Verdict::Later(error.to_string()),
            Err(error) => return Verdict::Lost(error.to_string()),
        };
        let report = &stored.head().report;
        match verify(&request.packing(), report, &stored, scope, &self.templates, control) {
            Ok(()) => {
                let bytes = match stored.count_lengths() {
                    Ok(bytes) => bytes,
                    Err(error) => return refusal(VerifyError::Read(error)),
                };
                let items = request.postprocess.items();
                let beforehand = |(_, item): &(String, &ExportRequest)| {
                    NewExport::beforehand(item, &request.specimen, &artifact.sha256)
                };
                Verdict::Packing {
                    grains: report.summary.grains,
                    facts: Facts::of_packing(report),
                    formats: FormatLengths { revision: tables::REVISION, bytes },
                    exports: items.iter().map(beforehand).collect(),
                }
            }
            Err(error) => refusal(error),
        }
    }

    async fn record(&self, received: &Received, verdict: &Verdict) -> Result<(), StoreError> {
        let lease = received.lease;
        match verdict {
            Verdict::Packing { grains, facts, exports, formats } => {
                let (facts, exports, formats) = (facts.clone(), exports.clone(), formats.clone());
                self.store.accept_result(lease, complete(*grains), facts, exports, formats).await
            }
            Verdict::Failure(failure, facts) => {
                self.store.accept_failure(lease, failure, facts.clone()).await
            }
            Verdict::Wrong(fault) => self.refuse(lease, &received.worker, &received.key, fault).await,
            Verdict::Lost(_) => self.store.requeue_lost_result(lease).await,
            Verdict::Later(_) => self.store.leave_check(lease, Some(PAUSE)).await,
            Verdict::Stopped => self.store.leave_check(lease, None).await,
        }
    }

    /// Requeues the job of a wrong end of an attempt, counts it for the worker, and names both in the log. The next
    /// attempt begins without the checkpoints of this one: the same fault may be in them.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`], or the database's.
    pub(crate) async fn refuse(
        &self,
        lease: Lease,
        worker: &str,
        key: &str,
        fault: &str,
    ) -> Result<(), StoreError> {
        let refused = self.store.refuse_end(lease, fault).await?;
        let (wrong_results, has_failed) = (refused.of_worker, refused.has_failed);
        let (job_id, attempt) = (lease.id, lease.attempt);
        tracing::error!(%job_id, attempt, worker, key, fault, wrong_results, has_failed, "a worker sent a wrong result");
        if wrong_results == MOST_WRONG_RESULTS {
            tracing::error!(
                worker,
                key,
                wrong_results,
                "the worker gets no job until an administrator allows it again"
            );
        }
        self.remove_checkpoints(lease).await;
        Ok(())
    }

    /// Tells log and metrics of the end of an attempt.
    fn note_end(&self, received: &Received, outcome: &'static str, check_s: f64) {
        let ran_us = received.at - received.started_at.unwrap_or(received.at);
        let took = Duration::from_micros(ran_us.max(0).unsigned_abs());
        tracing::info!(outcome, took_s = took.as_secs_f64(), check_s, "a lease ended");
        self.metrics.job_ended(outcome, took);
    }

    async fn remove_checkpoints(&self, lease: Lease) {
        let checkpoints = self.checkpoints.clone();
        let removed = tasks::blocking(move || checkpoints.remove(&lease.id.to_string(), lease.attempt));
        if let Err(error) = removed.await {
            tracing::warn!(%error, "checkpoints are left to the sweeper");
        }
    }
}

/// Progress of a job whose end was received and is to be checked.
pub(crate) fn checking(grains: u64) -> JobProgress {
    JobProgress {
        step: packstone_engine::Step::Check,
        done: 0,
        message: "the server checks what the worker has sent".into(),
        eta_s: None,
        ..complete(grains)
    }
}

fn refusal(error: VerifyError) -> Verdict {
    match error {
        VerifyError::Wrong(fault) => Verdict::Wrong(fault),
        VerifyError::Stopped => Verdict::Stopped,
        VerifyError::OutOfMemory { .. } => Verdict::Later(error.to_string()),
        VerifyError::Read(ref read) if is_passing(read) => Verdict::Later(error.to_string()),
        VerifyError::Read(_) => Verdict::Lost(error.to_string()),
    }
}

fn note_panic(ended: Result<(), tokio::task::JoinError>) {
    if let Err(error) = ended {
        tracing::error!(%error, "a check ended by a defect of this program; it begins again");
    }
}
