//! Packings of jobs, one of the two kinds of tasks. They come from the store of this process or from a server over
//! HTTP; a packing holds a slot for each of its threads ([`in_slots`](super::in_slots)).

use std::sync::Arc;
use std::time::Duration;

use packstone_engine::export::ExportRequest;
use packstone_engine::export::tables::{EngineInfo, Head};
use packstone_engine::{Control as _, Grains, Limits, PackError, Progress, Step, TemplateCache};
use tokio::time::timeout;

use super::control::RunControl;
use super::ending::{Cause, FailedRun, NotMade, Told};
use super::here::Here;
use super::task::{Computing, Ended, Following, LeaseError, TaskKind, Terms};
use super::there::There;
use crate::advice::failure_of;
use crate::artifacts::{Artifacts, InFlight};
use crate::checkpoints::Checkpoints;
use crate::disk::Disk;
use crate::exports::NewExport;
use crate::failure::{Failure, FailureCode};
use crate::jobs::{ArtifactRecord, JobProgress, JobRecord, JobRequest, Lease, StopRequests};
use crate::metrics::Metrics;
use crate::storage::{Bound, Storage, fits};
use crate::studies::Facts;
use crate::tasks;

/// Pauses before a result is written once more that a fault of the machine kept from the disk; it stays in memory.
const WRITE_PAUSES: [Duration; 4] =
    [Duration::from_secs(1), Duration::from_secs(2), Duration::from_secs(4), Duration::from_secs(8)];
/// Time to copy a last checkpoint to where other servers find it.
const SHARE_CHECKPOINT: Duration = Duration::from_secs(2);

/// What the packings of a process need.
#[derive(Clone, Debug)]
pub(crate) struct Packings {
    pub(crate) source: Source,
    /// Where results are written.
    pub(crate) artifacts: Artifacts,
    /// Where checkpoints are kept while a job runs.
    pub(crate) checkpoints: Checkpoints,
    pub(crate) disk: Disk,
    pub(crate) metrics: Arc<Metrics>,
    /// Templates of angular grains, for all jobs of the process.
    pub(crate) templates: Arc<TemplateCache>,
}

/// Where jobs and exports come from, and who is told of them.
#[derive(Clone, Debug)]
pub(crate) enum Source {
    /// The store of this process.
    Here(Here),
    /// A server.
    There(There),
}

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

/// What a run left on disk, and what is known of it.
pub(crate) struct Stored {
    pub(crate) artifact: ArtifactRecord,
    pub(crate) facts: Facts,
    pub(crate) grains: u64,
    pub(crate) postprocess: Vec<NewExport>,
    /// Stays claimed until the store refers to it.
    _place: InFlight,
}

impl Source {
    /// Time between two renewals of a lease, at most.
    pub(crate) fn renew_every(&self) -> Duration {
        match self {
            Self::Here(here) => here.store.renew_every(),
            // The process renews all its leases together.
            Self::There(_) => Duration::from_secs(1),
        }
    }
}

impl TaskKind for Packings {
    type Work = Work;
    type Made = Stored;

    fn terms(&self, work: &Work) -> Terms {
        let span = tracing::info_span!("job", job_id = %work.lease.id, attempt = work.lease.attempt);
        Terms { span, timeout_s: work.timeout_s, faults: work.faults }
    }

    async fn prepare(&self, work: &Work) -> RunControl {
        tracing::info!(threads = work.limits.threads, "started");
        if let (Source::There(there), true) = (&self.source, work.has_checkpoint) {
            there.fetch_checkpoint(work.lease, &self.checkpoints).await;
        }
        RunControl::with_checkpoints(self.checkpoints.writer(&work.lease.id.to_string(), work.lease.attempt))
    }

    fn run(&self, work: &Work, control: &RunControl, computing: Computing) -> Result<Self::Made, NotMade> {
        let stored: serde_json::Value = serde_json::from_str(&work.request).map_err(|error| {
            tracing::error!(%error, "the stored request is unreadable");
            Failure::new(FailureCode::InternalError, "the stored request is unreadable")
        })?;
        let request = JobRequest::read(&stored, 0, None).map_err(Failure::invalid)?;
        let (request, postprocess) = (request.packing(), request.postprocess);
        if !request.on_limit.is_fail() {
            control.keep_past_deadline();
        }
        let bytes = (self.templates.plan(&request, &work.limits))
            .map_or(0, |plan| Storage::bytes_of_result(plan.grains, &request.mix));
        if let Err(no_room) = fits(bytes, work.room) {
            tracing::warn!(%no_room, "the result would not fit; the job waits");
            return Err(NotMade::Faulted(Cause::NoRoom(bytes)));
        }
        let id = work.lease.id.to_string();
        self.checkpoints.prepare(&id, &|| control.should_stop());
        let resume = self.checkpoints.resume(&id, &request);
        if resume.is_some() {
            control.resumed();
        }
        let packed =
            packstone_engine::pack_or_resume(&request, &work.limits, &self.templates, resume, control);
        let packed = packed.map_err(|error| {
            if let PackError::CheckFailed(what) = &error {
                tracing::error!(%what, "a packing failed its check");
            }
            let facts = Box::new(Facts::of_failure(&error, 0.0));
            FailedRun { facts, failure: Box::new(failure_of(error, &request, &work.limits)) }
        })?;
        drop(computing);
        let facts = Facts::of_packing(&packed.report);
        let grains = packed.grains.len() as u64;
        control.report(&Progress {
            step: Step::Write,
            fraction: 1.0,
            done: 0,
            total: grains,
            unit: "grains",
            message: "writing the result".into(),
            growth: None,
        });
        let head = Head {
            job_id: Some(id.clone()),
            request: stored,
            engine: EngineInfo::current(),
            report: packed.report,
        };
        let place = self.artifacts.begin(&id, work.lease.attempt);
        let artifact = self
            .write(&place, &head, &packed.grains, control)
            .ok_or(NotMade::Faulted(Cause::NotWritten(bytes)))?;
        let beforehand = |(_, item): &(String, &ExportRequest)| {
            NewExport::beforehand(item, &request.specimen, &artifact.sha256)
        };
        let postprocess = postprocess.items().iter().map(beforehand).collect();
        Ok(Stored { artifact, facts, grains, postprocess, _place: place })
    }

    fn follow(&self, work: &Work) -> Following {
        match &self.source {
            Source::Here(here) => Following::Job(here.store.subscribe(work.lease.id)),
            Source::There(there) => Following::There(there.follow(work.lease)),
        }
    }

    async fn requests(&self, work: &Work) -> Result<StopRequests, LeaseError> {
        match &self.source {
            Source::Here(here) => {
                let job = here.store.get(work.lease.id).await?;
                let requests = |job: JobRecord| StopRequests {
                    cancel: job.cancel_requested,
                    finish: job.finish_requested,
                };
                Ok(job.map_or(StopRequests::default(), requests))
            }
            Source::There(there) => there.requests(work.lease),
        }
    }

    async fn renew(&self, work: &Work, news: Option<JobProgress>) -> Result<StopRequests, LeaseError> {
        match &self.source {
            Source::Here(here) => Ok(here.store.heartbeat(work.lease, news).await?),
            Source::There(there) => there.renew(work.lease, news),
        }
    }

    fn renew_every(&self) -> Duration {
        self.source.renew_every()
    }

    /// Lets other servers go on from the last checkpoint of a run, within the time that a stop has.
    async fn hand_on(&self, work: &Work) {
        share_last(&self.checkpoints, work.lease.id.to_string(), work.lease.attempt).await;
    }

    async fn end(&self, work: &Work, told: Told<'_, Self::Made>) -> Result<(), LeaseError> {
        match &self.source {
            Source::Here(here) => here.end(work.lease, told).await,
            Source::There(there) => there.end(work.lease, told).await,
        }
    }

    async fn ended(&self, work: &Work, ended: Ended<'_, Self::Made>) {
        self.metrics.job_ended(ended.outcome, ended.took);
        match ended.made {
            Some(stored) if !ended.is_recorded => {
                self.artifacts.discard(vec![stored.artifact.path.clone()]).await;
            }
            _ if ended.is_requeued => {}
            _ if ended.is_recorded => self.remove_checkpoints(work.lease).await,
            _ => {}
        }
    }
}

impl Packings {
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

/// Lets other servers go on from the last checkpoint of an attempt, within the time that a stop has.
pub(crate) async fn share_last(checkpoints: &Checkpoints, id: String, attempt: i64) {
    let checkpoints = checkpoints.clone();
    let shared = tasks::blocking(move || checkpoints.share(&id, attempt));
    if timeout(SHARE_CHECKPOINT, shared).await.is_err() {
        tracing::warn!("the last checkpoint was not shared in time");
    }
}

/// Progress of a job that succeeded: a run can end between two reports.
pub(crate) fn complete(grains: u64) -> JobProgress {
    JobProgress {
        fraction: 1.0,
        step: Step::Write,
        done: grains,
        total: grains,
        unit: "grains".into(),
        message: String::new(),
        eta_s: Some(0.0),
        growth: None,
    }
}
