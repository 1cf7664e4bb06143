//! Who is told of changes: those who wait for a job, a study or an export, workers without work, and the other servers
//! of the same database. Each is told after the commit.

use std::time::Duration;

use tokio::sync::Notify;
use tokio::time::{Instant, timeout};

use super::idle_workers::{Mark, WorkUntil};
use super::{ExportQueue, Lease, Shared, Store, StoreError, Subscription};
use crate::ids::{ExportId, StudyId, TaskId};
use crate::jobs::journal::Changed;
use crate::jobs::{JobId, JobRecord};
use crate::tasks;

/// A pause by the monotonic clock may end before it does by the clock of the database.
const CLOCKS_DIFFER: Duration = Duration::from_millis(50);
/// How often an idle export worker looks for exports, whatever was told.
const LOOK_FOR_EXPORTS: Duration = Duration::from_secs(2);

/// What has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Change {
    /// Jobs wait for workers.
    Queue,
    /// Exports wait for workers.
    Exports,
    /// Webhooks wait to be sent.
    Webhooks,
    /// Ends of attempts that worker processes have sent wait for their check.
    Checks,
    /// Clients see another state of a job.
    Job(JobId),
    /// Clients see another state of a study.
    Study(StudyId),
    /// Clients see another state of an export.
    Export(ExportId),
    /// Anything may have changed: changes of another server were not told.
    Lost,
}

/// The wake-up of an idle worker. It passes to the next idle worker when it is dropped: the worker has stopped before
/// the store has answered, has no slot, or may not have a job.
#[derive(Debug)]
#[must_use = "it passes to the next idle worker when it is dropped"]
pub(crate) struct WakeUp(Option<Store>);

impl WakeUp {
    /// Ends the wake-up: the store has answered the worker. Where it had no job, no other idle worker would find one.
    pub(crate) fn end(mut self) {
        self.0 = None;
    }
}

impl Drop for WakeUp {
    fn drop(&mut self) {
        if let Some(store) = self.0.take() {
            store.wake_next_worker();
        }
    }
}

impl Shared {
    /// Wakes those who wait in this process.
    pub(super) fn wake(&self, change: Change) {
        match change {
            Change::Queue => self.idle_workers.wake(),
            Change::Exports => self.export_workers.iter().for_each(Notify::notify_one),
            Change::Webhooks => self.webhooks.notify_one(),
            Change::Checks => self.checks.notify_one(),
            Change::Job(id) => {
                self.journal.record(Changed::Job(id));
                self.changes.notify(id);
            }
            Change::Study(id) => {
                self.journal.record(Changed::Study(id));
                self.study_changes.notify(id);
            }
            Change::Export(id) => self.export_changes.notify(id),
            Change::Lost => self.journal.lose(),
        }
    }

    /// Wakes all who wait in this process, for any change.
    pub(super) fn wake_all(&self) {
        for change in [Change::Queue, Change::Exports, Change::Webhooks, Change::Checks] {
            self.wake(change);
        }
        self.changes.notify_all();
        self.study_changes.notify_all();
        self.export_changes.notify_all();
    }
}

impl Store {
    /// Starts to listen for changes of a job. Subscribe first, then read.
    pub(crate) fn subscribe(&self, id: JobId) -> Subscription<JobId> {
        self.shared.changes.subscribe(id)
    }

    /// Starts to listen for changes of a job or an export. Subscribe first, then read.
    pub(crate) fn subscribe_task(&self, id: TaskId) -> (Subscription<JobId>, Subscription<ExportId>) {
        (self.subscribe(id.job()), self.subscribe_export(id.export()))
    }

    /// How many listen for changes of a job or an export.
    pub(crate) fn watchers(&self, id: TaskId) -> usize {
        // Who listens for what may be either listens for both.
        self.shared.changes.listeners(id.job()).max(self.shared.export_changes.listeners(id.export()))
    }

    /// Starts to listen for changes of a study. Subscribe first, then read.
    pub(crate) fn subscribe_study(&self, id: StudyId) -> Subscription<StudyId> {
        self.shared.study_changes.subscribe(id)
    }

    /// Starts to listen for changes of an export. Subscribe first, then read.
    pub(crate) fn subscribe_export(&self, id: ExportId) -> Subscription<ExportId> {
        self.shared.export_changes.subscribe(id)
    }

    /// Waits until there may be an export to make. No wake-up tells of the end of a pause that another process began,
    /// or of a clock that was set: so it looks for itself from time to time.
    pub(crate) async fn exports_queued(&self, queue: ExportQueue) {
        let workers = &self.shared.export_workers[usize::from(queue == ExportQueue::Quick)];
        while timeout(LOOK_FOR_EXPORTS, workers.notified()).await.is_err() {
            // A store that cannot tell is asked by the claim, which reports the fault.
            if self.has_claimable_export(queue).await.unwrap_or(true) {
                return;
            }
        }
    }

    /// The moment before a worker asks for a job; see [`Self::queue_notified`].
    pub(crate) fn queue_mark(&self) -> Mark {
        self.shared.idle_workers.mark()
    }

    /// Waits until there may be a job for a worker that takes jobs until then, and has found none since the mark.
    pub(crate) async fn queue_notified(&self, since: Mark, until: WorkUntil) -> WakeUp {
        self.shared.idle_workers.woken(since, until).await;
        WakeUp(Some(self.clone()))
    }

    /// Wakes an idle worker where a job or an export waits that it may start, whatever was told: quotas are raised,
    /// pauses end and clocks are set without a word, and the words of other servers may be lost. Costs nothing where no
    /// worker is idle, else statements that change nothing.
    ///
    /// # Errors
    /// The database's.
    pub(crate) async fn look_for_jobs(&self) -> Result<(), StoreError> {
        let Some(until) = self.shared.idle_workers.most_time() else { return Ok(()) };
        let remaining = match until {
            WorkUntil::Moment(moment) => Some(moment.saturating_duration_since(Instant::now())),
            WorkUntil::Unlimited => None,
        };
        if self.has_claimable_job(remaining).await? || self.has_claimable_export(ExportQueue::Heavy).await? {
            self.wake_next_worker();
        }
        Ok(())
    }

    /// Waits until a delivery may have been recorded.
    pub(crate) async fn webhooks_notified(&self) {
        self.shared.webhooks.notified().await;
    }

    /// Waits until the end of an attempt may have been received.
    pub(crate) async fn checks_notified(&self) {
        self.shared.checks.notified().await;
    }

    /// After a commit that received the end of an attempt.
    pub(super) fn wake_checks(&self) {
        self.announce(Change::Checks);
    }

    /// Wakes one more worker of this process: of a burst of submissions each wakes one, but some may have woken a
    /// worker that was about to ask anyway.
    pub(crate) fn wake_next_worker(&self) {
        self.shared.wake(Change::Queue);
    }

    /// After a commit that put an export into the queue: one for export workers, or for the slots of packings.
    pub(super) fn wake_export_workers(&self) {
        self.announce(Change::Exports);
        self.wake_worker();
    }

    /// Wakes one more export worker: of a burst of requests, only the last may have left its mark.
    pub(crate) fn wake_next_export_worker(&self) {
        self.shared.wake(Change::Exports);
    }

    /// The same for an export that may not start yet.
    pub(super) fn wake_export_workers_after(&self, pause: Duration) {
        let store = self.clone();
        tasks::spawn(async move {
            tokio::time::sleep(pause + CLOCKS_DIFFER).await;
            store.wake_export_workers();
        });
    }

    /// After a commit by which a job runs no longer: another of its owner may be held back.
    pub(super) fn wake_worker_for_held_back(&self) {
        if self.bounds_running() {
            self.wake_worker();
        }
    }

    /// After a commit that put a job into the queue which may not start yet.
    pub(super) fn wake_worker_after(&self, pause: Duration) {
        let store = self.clone();
        tasks::spawn(async move {
            tokio::time::sleep(pause + CLOCKS_DIFFER).await;
            store.wake_worker();
        });
    }

    /// After a commit that put a job into the queue.
    pub(super) fn wake_worker(&self) {
        self.announce(Change::Queue);
    }

    /// After a commit that may have ended a job or finished a study.
    pub(super) fn wake_webhooks(&self) {
        self.announce(Change::Webhooks);
    }

    /// After a commit that changed what clients see of the job.
    pub(super) fn notify(&self, id: JobId) {
        self.announce(Change::Job(id));
    }

    /// After a commit that changed what clients see of these jobs.
    pub(super) fn notify_all(&self, ids: &[JobId]) {
        for id in ids {
            self.notify(*id);
        }
    }

    /// After a commit that moved the job to another state.
    pub(super) fn notify_job(&self, job: &JobRecord) {
        self.notify(job.id);
        if let Some(place) = job.study {
            self.notify_study(place.id);
        }
        self.wake_webhooks();
    }

    /// The same for a job that was leased.
    pub(super) fn notify_lease(&self, lease: Lease) {
        self.notify(lease.id);
        if let Some(study) = lease.study {
            self.notify_study(study);
        }
        self.wake_webhooks();
    }

    /// After a commit that changed what clients see of the study.
    pub(super) fn notify_study(&self, id: StudyId) {
        self.announce(Change::Study(id));
    }

    /// After a commit that changed what clients see of an export.
    pub(super) fn notify_export(&self, id: ExportId) {
        self.announce(Change::Export(id));
    }

    /// Tells all whom it concerns, in this process and in others.
    fn announce(&self, change: Change) {
        self.shared.wake(change);
        if let Some(servers) = &self.shared.servers {
            servers.tell(change);
        }
    }
}
