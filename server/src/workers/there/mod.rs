//! Jobs and exports from a server over HTTP.
//!
//! A process renews all its leases by one request, which the server holds back until one of the jobs changes, for 15 s
//! at most: a request to cancel arrives at once. Checkpoints are written to the disk of the process, and sent to the
//! server every ten minutes and before a job is released.
//!
//! A process whose server does not answer goes on with its jobs. When it is heard again, it learns whether the lease
//! still holds: a job that was given to another process is stopped here, and its result is not taken. So a server that
//! is restarted costs no work, and a process that was cut off wastes its own time at most, for runs are deterministic.

mod claiming;
mod exports;
mod key;
mod server;

use std::collections::HashMap;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hyper::StatusCode;
use tokio::sync::{Notify, watch};
use tokio::time::{Instant, sleep};

use super::documents::{
    EndOutcome, EndRequest, LeaseState, RenewalDocument, RenewalRequest, RenewalsDocument,
};
use super::ending::{Cause, Told};
use super::packing::Stored;
use super::task::LeaseError;
use crate::artifacts::Artifacts;
use crate::checkpoints::Checkpoints;
use crate::disk::Disk;
use crate::exports::ExportLease;
use crate::failure::{Failure, FailureCode};
use crate::ids::TaskId;
use crate::jobs::{JobProgress, Lease, StopRequests};
use crate::studies::Facts;

pub(crate) use server::{Server, ServerError};

/// For how long a renewal may be held back; the server answers sooner where its leases are short.
const RENEWAL_WAIT: Duration = Duration::from_secs(15);
/// Shortest time between two renewals.
const LEAST_PAUSE: Duration = Duration::from_millis(200);
/// Pauses after a request that was not answered, doubled from the first to the last.
const PAUSES: (Duration, Duration) = (Duration::from_millis(500), Duration::from_secs(10));
/// How often the checkpoints of a running job are looked at.
const LOOK_AT_CHECKPOINTS: Duration = Duration::from_secs(5);

/// What became of a lease, as the last renewal told.
pub(crate) type State = LeaseState;

/// How a process asks for jobs.
#[derive(Clone, Debug)]
pub(crate) struct WorkerOptions {
    /// Its name, for people.
    pub(crate) name: String,
    /// Digest of the probe.
    pub(crate) bits: String,
    /// The Gmsh of this machine, as reports name it.
    pub(crate) mesher: Option<String>,
    /// Time between two checkpoints of a job that are sent to the server.
    pub(crate) send_checkpoints_every: Duration,
    /// No job is taken after this.
    pub(crate) until: Option<Instant>,
    /// The process ends when it has had no job for so long.
    pub(crate) idle: Option<Duration>,
}

/// A server, and the jobs that this process has of it.
#[derive(Clone, Debug)]
pub(crate) struct There {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    server: Server,
    options: WorkerOptions,
    artifacts: Artifacts,
    checkpoints: Checkpoints,
    /// One slot asks at a time: a process has one connection that waits for jobs.
    claiming: tokio::sync::Mutex<()>,
    jobs: Mutex<HashMap<Key, Job>>,
    /// A lease has begun or ended.
    changed: Notify,
    disk: Disk,
    /// Bytes of the result that could not be written to this disk last.
    needed_bytes: AtomicU64,
    /// Such a result is known: no request for a job is to wait any longer.
    full: Notify,
    /// When this process had a job last.
    busy: Mutex<Instant>,
    /// The server has refused this worker for good.
    refused: Mutex<Option<ServerError>>,
}

/// A job or an export that this process runs.
#[derive(Debug)]
struct Job {
    state: watch::Sender<State>,
    /// News that the server has not been told.
    progress: Option<JobProgress>,
    /// When its checkpoint was sent last, or it began.
    sent: Instant,
}

/// What names a lease: the job or the export, and the attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Key {
    id: TaskId,
    attempt: i64,
}

impl From<Lease> for Key {
    fn from(lease: Lease) -> Self {
        Self { id: lease.id.into(), attempt: lease.attempt }
    }
}

impl From<ExportLease> for Key {
    fn from(lease: ExportLease) -> Self {
        Self { id: lease.id.into(), attempt: lease.attempt }
    }
}

fn address(lease: impl Into<Key>, what: &str) -> String {
    let Key { id, attempt } = lease.into();
    format!("/v1/leases/{id}/{attempt}/{what}")
}

impl There {
    /// Jobs of a server. Results and checkpoints lie in these folders, on this disk, until they are sent.
    pub(crate) fn new(
        server: Server,
        options: WorkerOptions,
        artifacts: Artifacts,
        checkpoints: Checkpoints,
        disk: Disk,
    ) -> Self {
        let shared = Shared {
            disk,
            needed_bytes: AtomicU64::new(0),
            full: Notify::new(),
            server,
            options,
            artifacts,
            checkpoints,
            claiming: tokio::sync::Mutex::default(),
            jobs: Mutex::default(),
            changed: Notify::new(),
            busy: Mutex::new(Instant::now()),
            refused: Mutex::default(),
        };
        Self { shared: Arc::new(shared) }
    }

    /// Why the server wants nothing of this worker, where that is so.
    pub(crate) fn refusal(&self) -> Option<ServerError> {
        self.shared.refused.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Whether this process takes no more jobs.
    pub(super) fn is_over(&self) -> bool {
        let Shared { options, busy, refused, .. } = &*self.shared;
        let is_idle = |limit: Duration| {
            let busy = *busy.lock().unwrap_or_else(PoisonError::into_inner);
            self.jobs().is_empty() && busy.elapsed() >= limit
        };
        options.until.is_some_and(|until| Instant::now() >= until)
            || options.idle.is_some_and(is_idle)
            || refused.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Fetches the checkpoint of an earlier attempt. Without it the task starts from its beginning.
    pub(crate) async fn fetch_checkpoint(&self, lease: impl Into<Key>, checkpoints: &Checkpoints) {
        let key = lease.into();
        // Below the attempt that runs, as that of the attempt before it would be.
        let (id, attempt) = (key.id.to_string(), key.attempt - 1);
        let fetched = async {
            let mut file = checkpoints.receive(&id, attempt)?;
            let path = address(key, "checkpoint");
            self.shared.server.get_file(&path, |piece| file.write(piece)).await?;
            Ok::<_, ServerError>(file.finish()?)
        };
        match fetched.await {
            // The attempt before may not have kept one yet.
            Ok(()) | Err(ServerError::Refused { status: StatusCode::NOT_FOUND, .. }) => {}
            Err(error) => {
                tracing::warn!(%error, "the checkpoint of the job was not fetched; it starts anew");
            }
        }
    }

    /// Starts to listen for what becomes of a lease.
    pub(crate) fn follow(&self, lease: impl Into<Key>) -> watch::Receiver<State> {
        match self.jobs().get(&lease.into()) {
            Some(job) => job.state.subscribe(),
            None => watch::Sender::new(State::Lost).subscribe(),
        }
    }

    /// What clients want of the task, as the last renewal told.
    pub(crate) fn requests(&self, lease: impl Into<Key>) -> Result<StopRequests, LeaseError> {
        let state = self.jobs().get(&lease.into()).map(|job| *job.state.borrow());
        match state {
            Some(State::Running) => Ok(StopRequests::default()),
            Some(State::FinishRequested) => Ok(StopRequests { finish: true, cancel: false }),
            Some(State::CancelRequested) => Ok(StopRequests { finish: false, cancel: true }),
            Some(State::Lost) | None => Err(LeaseError::Lost),
        }
    }

    /// Leaves news for the next renewal.
    pub(crate) fn renew(
        &self,
        lease: impl Into<Key>,
        news: Option<JobProgress>,
    ) -> Result<StopRequests, LeaseError> {
        let key = lease.into();
        if news.is_some()
            && let Some(job) = self.jobs().get_mut(&key)
        {
            job.progress = news;
        }
        self.requests(key)
    }

    /// Sends the result or the end of a run; the lease ends with it.
    pub(super) async fn end(&self, lease: Lease, told: Told<'_, Stored>) -> Result<(), LeaseError> {
        let sent = self.send_end(lease, told).await;
        self.ended(lease.into(), sent)
    }

    /// Forgets a lease whose end was sent, unless it is to be sent once more.
    fn ended(&self, key: Key, sent: Result<(), ServerError>) -> Result<(), LeaseError> {
        if let Err(error) = &sent
            && error.passes()
            && self.requests(key).is_ok()
        {
            return Err(LeaseError::Passing(error.to_string()));
        }
        self.jobs().remove(&key);
        *self.shared.busy.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        self.shared.changed.notify_one();
        sent.map_err(|error| {
            if error.is_lost() || error.passes() {
                LeaseError::Lost
            } else {
                LeaseError::Failed(error.to_string())
            }
        })
    }

    async fn send_end(&self, lease: Lease, told: Told<'_, Stored>) -> Result<(), ServerError> {
        let end = |outcome: EndOutcome, failure: Option<Failure>, facts: Option<Facts>| EndRequest {
            outcome,
            failure,
            facts,
            needed_bytes: None,
        };
        let no_room =
            |bytes: u64| EndRequest { needed_bytes: Some(bytes), ..end(EndOutcome::Faulted, None, None) };
        let document = match told {
            Told::Succeeded(stored) => {
                let file = self.shared.artifacts.open_file(&stored.artifact.path)?;
                let path = format!("{}?sha256={}", address(lease, "result"), stored.artifact.sha256);
                match self.shared.server.put_file(&path, Vec::new(), file).await {
                    Ok(()) => {
                        self.shared.artifacts.discard(vec![stored.artifact.path.clone()]).await;
                        return Ok(());
                    }
                    // The job waits until there is room again, as one of the server itself does.
                    Err(ServerError::Refused {
                        status: StatusCode::INSUFFICIENT_STORAGE, detail, ..
                    }) => {
                        tracing::warn!(detail, "the server has no room for the result; the job waits");
                        self.shared.artifacts.discard(vec![stored.artifact.path.clone()]).await;
                        no_room(stored.artifact.bytes)
                    }
                    Err(error) => return Err(error),
                }
            }
            Told::Failed(failure, facts) => end(EndOutcome::Failed, Some(failure), Some(*facts)),
            Told::Cancelled => end(EndOutcome::Cancelled, None, None),
            Told::Faulted(Cause::NoRoom(bytes)) => no_room(bytes),
            Told::Faulted(cause) => {
                if let Cause::NotWritten(bytes) = cause {
                    self.shared.needed_bytes.store(bytes, Ordering::Release);
                    self.shared.full.notify_waiters();
                }
                let failure = (cause == Cause::NoMemory)
                    .then(|| Failure::new(FailureCode::OutOfMemory, "the worker found no memory"));
                end(EndOutcome::Faulted, failure, None)
            }
            Told::Released => {
                self.send_last_checkpoint(lease).await?;
                end(EndOutcome::Released, None, None)
            }
            Told::Nothing => return Err(ServerError::lost()),
        };
        let path = address(lease, "end");
        self.shared.server.post::<serde_json::Value>(&path, &document, Duration::ZERO).await?;
        Ok(())
    }

    /// Sends the checkpoint that an attempt has kept, if it has, before it is given back.
    pub(super) async fn send_last_checkpoint(&self, lease: impl Into<Key>) -> Result<(), ServerError> {
        let key = lease.into();
        let Some(file) = self.shared.checkpoints.kept_by(&key.id.to_string(), key.attempt)? else {
            return Ok(());
        };
        match self.send_checkpoint(key, &file).await {
            // The next attempt goes on from an older one, sooner than if the lease ran out.
            Err(ServerError::Refused { status: StatusCode::INSUFFICIENT_STORAGE, detail, .. }) => {
                tracing::warn!(detail, "the server has no room for the last checkpoint");
            }
            Err(error) if !error.passes() && !error.is_lost() => {
                tracing::warn!(%error, "the server did not accept the last checkpoint");
            }
            sent => sent?,
        }
        Ok(())
    }

    async fn send_checkpoint(&self, lease: impl Into<Key>, file: &Path) -> Result<(), ServerError> {
        let key = lease.into();
        self.shared.server.put_file(&address(key, "checkpoint"), Vec::new(), File::open(file)?).await?;
        tracing::info!(job_id = %key.id, attempt = key.attempt, "sent a checkpoint");
        Ok(())
    }

    /// Renews the leases for as long as the process lives.
    pub(crate) async fn keep_renewing(self) {
        let mut pause = PAUSES.0;
        let mut wait = RENEWAL_WAIT;
        loop {
            let renewals = self.take_news();
            if renewals.is_empty() {
                self.shared.changed.notified().await;
                continue;
            }
            let request = RenewalRequest { renewals };
            match self.shared.server.post::<RenewalsDocument>("/v1/leases/renewals", &request, wait).await {
                Ok(answer) => {
                    pause = PAUSES.0;
                    let Some(answer) = answer else { continue };
                    for renewed in answer.leases {
                        let key = Key { id: renewed.task, attempt: renewed.attempt };
                        if let Some(job) = self.jobs().get(&key) {
                            job.state.send_if_modified(|state| {
                                let changed = *state != renewed.state;
                                *state = renewed.state;
                                changed
                            });
                        }
                    }
                    let every = Duration::try_from_secs_f64(answer.report_every_s).unwrap_or(RENEWAL_WAIT);
                    // Where a client watches, no answer is held back, and the next news are sent soon.
                    wait = if every <= Duration::from_secs(1) { Duration::ZERO } else { RENEWAL_WAIT };
                    sleep(if wait.is_zero() { every } else { LEAST_PAUSE }).await;
                }
                Err(error) => {
                    tracing::warn!(%error, pause_s = pause.as_secs_f64(), "the leases were not renewed");
                    wait = Duration::ZERO;
                    sleep(pause).await;
                    pause = (2 * pause).min(PAUSES.1);
                }
            }
        }
    }

    fn take_news(&self) -> Vec<RenewalDocument> {
        let mut jobs = self.jobs();
        let renewals = jobs.iter_mut().map(|(key, running)| RenewalDocument {
            task: key.id,
            attempt: key.attempt,
            progress: running.progress.take(),
        });
        renewals.collect()
    }

    /// Sends checkpoints of running jobs now and then, for as long as the process lives.
    pub(crate) async fn keep_sending_checkpoints(self) {
        let every = self.shared.options.send_checkpoints_every;
        let mut sent: HashMap<Key, std::time::SystemTime> = HashMap::new();
        loop {
            sleep(LOOK_AT_CHECKPOINTS.min(every)).await;
            let due: Vec<Key> = {
                let jobs = self.jobs();
                sent.retain(|lease, _| jobs.contains_key(lease));
                jobs.iter().filter(|(_, job)| job.sent.elapsed() >= every).map(|(lease, _)| *lease).collect()
            };
            for key in due {
                let found = self.shared.checkpoints.kept_by(&key.id.to_string(), key.attempt);
                let Ok(Some(file)) = found else { continue };
                let Ok(changed) = std::fs::metadata(&file).and_then(|found| found.modified()) else {
                    continue;
                };
                if sent.get(&key) == Some(&changed) {
                    continue;
                }
                match self.send_checkpoint(key, &file).await {
                    Ok(()) => drop(sent.insert(key, changed)),
                    Err(error) => tracing::warn!(%error, "a checkpoint was not sent"),
                }
                if let Some(job) = self.jobs().get_mut(&key) {
                    job.sent = Instant::now();
                }
            }
        }
    }

    fn jobs(&self) -> MutexGuard<'_, HashMap<Key, Job>> {
        self.shared.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
