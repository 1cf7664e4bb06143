//! The store of jobs, studies and what is made of results: one SQLite file, or a database of PostgreSQL.
//!
//! Who may write: one connection behind a lock, in transactions that may write from their start on, so that no write
//! ever meets another. The short writes that every job takes share transactions where they wait for each other (see
//! [`group_commit`]); each other write has one of its own. Readers are a separate read-only pool and never wait. Writes
//! run in a task of their own: a client that hangs up halfway cannot leave a transaction open or a commit unannounced.
//! The clock here decides about leases and expiry.
//!
//! Every change a client can see raises `version` and is sent to [`Notifications`] after its commit. A fault of the
//! machine does not outlast its cause: see [`writer`] and [`faults`].

mod bodies;
#[cfg(test)]
mod bodies_tests;
mod changes;
mod checked;
mod claims;
mod clock;
mod database;
mod db;
mod every_row;
mod exports;
mod faults;
mod files;
mod forecasts;
mod group_commit;
mod idle_workers;
mod leased;
mod leases;
#[cfg(test)]
mod leases_tests;
mod lifecycle;
#[cfg(test)]
mod load_tests;
mod mark;
#[cfg(test)]
mod mark_tests;
#[cfg(test)]
mod owners_tests;
mod patch;
mod presence;
mod query;
mod received;
#[cfg(test)]
mod received_tests;
mod retention;
mod rows;
mod running;
mod schema;
mod servers;
#[cfg(test)]
mod servers_tests;
mod standings;
mod studies;
mod submit;
mod target;
#[cfg(test)]
mod tests;
pub(crate) mod transfer;
mod turns;
mod upkeep;
mod webhooks;
#[cfg(test)]
mod webhooks_tests;
mod writer;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Notify;

use super::journal::Journal;
use super::notifications::{Notifications, Subscription};
use super::{JobId, Lease, State};
use crate::accounts::Accounts;
use crate::disk::{Reserve, Shortage};
use crate::ids::{ExportId, StudyId};
use crate::jobs::request::MAX_LABELS;
use crate::open_files::OpenFiles;
use crate::tasks;
use database::Opened;
use db::{Durability, Readers, either, query as sql};
use idle_workers::IdleWorkers;
use mark::Mark;
use presence::{Damage, Presence};
use writer::{Writer, Writing};

pub(crate) use changes::WakeUp;
pub(crate) use checked::{FaultyWorker, FormatLengths, MOST_WRONG_RESULTS, Refused};
pub(crate) use claims::Claimed;
pub(crate) use database::{Database, NoDatabase};
#[cfg(test)]
pub(crate) use every_row::RowsRead;
pub(crate) use every_row::read_every_row;
pub(crate) use exports::{ClaimedExport, ExportQueue, Retention};
pub(crate) use faults::Fault;
pub(crate) use files::{ExpectedFile, files_of, known_of};
pub(crate) use forecasts::{ForecastWork, LEAST_TIME, UNKNOWN_FORECAST};
pub(crate) use idle_workers::WorkUntil;
pub(crate) use leases::{Claim, Held, Renewal};
pub(crate) use lifecycle::Cancelled;
pub(crate) use presence::Unusable;
pub(crate) use query::{Filter, Holder, Order, Position, SortKey, Totals, Usage};
pub(crate) use received::{Received, ReceivedEnd};
pub(crate) use retention::FinishedJobs;
pub(crate) use rows::DamagedRow;
pub(crate) use schema::SchemaError;
pub(crate) use standings::Standing;
pub(crate) use studies::{
    NewStudy, StudyCounts, StudyFilter, StudyRecord, StudyState, StudyWarning, SubmittedStudy,
};
pub(crate) use submit::{IdempotencyKey, NewJob, Submitted};
pub(crate) use target::Target;
pub(crate) use upkeep::{Kept, Removed, StoredKind};
pub(crate) use webhooks::{Attempt, Delivery, DeliveryState, Receiver, WaitingDelivery, WebhookRecord};

/// Name of the reserve of disk space, beside the database.
const RESERVE: &str = "reserve";
/// Free pages that a file of SQLite keeps: 1 MiB.
const FREE_PAGES: i64 = 256;
/// Time between two steps that give free pages back, in which others can write.
const VACUUM_PAUSE: Duration = Duration::from_millis(20);
/// An unusable database is lost for good after so long.
const LOST_AFTER: Duration = Duration::from_mins(1);

/// Why the store did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StoreError {
    /// The database refused; the error of a commit is that of all writes which shared it.
    #[error("the database failed: {0}")]
    Database(Arc<sqlx::Error>),
    /// The tables are not those of this version.
    #[error(transparent)]
    Schema(#[from] SchemaError),
    /// It is not the store any more that was opened, or does not answer.
    #[error(transparent)]
    Unusable(#[from] Unusable),
    /// A row holds what this version cannot read.
    #[error("a row of the database is unreadable: {0}")]
    Row(String),
    /// The task that wrote ended early.
    #[error("a write of the database was broken off: {0}")]
    Broken(#[from] tokio::task::JoinError),
    /// There is no such job.
    #[error("there is no such job")]
    NoJob,
    /// The job's state forbids it.
    #[error("the job is {}", .0.name())]
    Forbidden(State),
    /// A run cannot end with a packing that it has not reached.
    #[error("nothing can be kept of the job: {1}")]
    NothingReached(State, &'static str),
    /// Another attempt holds the job or export, or none does.
    #[error("the lease was lost")]
    LeaseLost,
    /// There is no such study.
    #[error("there is no such study")]
    NoStudy,
    /// The study's state forbids it.
    #[error("the study is {}", .0.name())]
    StudyForbidden(StudyState),
    /// There is no such export.
    #[error("there is no such export")]
    NoExport,
    /// So many exports wait that no more are accepted.
    #[error("{most} exports wait to be made, as many as may")]
    TooManyWait { most: u64 },
    /// So much is kept of a job that there is no room for more.
    #[error("the job keeps {most} exports, as many as it may: delete some")]
    TooManyKept { most: u64 },
    /// So many jobs wait that there is no room for more.
    #[error("the queue holds {queued} jobs of at most {most}, without room for {more} more")]
    QueueFull { queued: u64, more: u64, most: u64 },
    /// So many jobs of the owner wait that there is no room for more of them.
    #[error(
        "{queued} jobs of the owner {owner:?} wait, of at most {most}, without room for {more} more: submit again when \
         some have started, or cancel some"
    )]
    OwnerQueueFull { owner: String, queued: u64, more: u64, most: u64 },
    /// A worker process asks for jobs that has sent so many wrong results.
    #[error(
        "the worker {worker:?} has sent {wrong} wrong results: it gets no job until an administrator allows it again"
    )]
    WorkerBlocked { worker: String, wrong: i64 },
    /// The job or study has another version than the client accepts.
    #[error("the version is another than If-Match names")]
    VersionDiffers,
    /// A patch would give the job too many labels.
    #[error("the job would have {found} labels: must have at most {MAX_LABELS}")]
    TooManyLabels { found: usize },
    /// The key came with another body before.
    #[error("the idempotency key was used with another body")]
    KeyReused,
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        match error {
            // A value of another type, or a text that is none: a damaged row.
            sqlx::Error::ColumnDecode { .. } | sqlx::Error::Decode(_) => Self::Row(error.to_string()),
            error => Self::Database(Arc::new(error)),
        }
    }
}

/// What the store allows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoreLimits {
    /// Most jobs that wait.
    pub(crate) max_queued: u64,
    /// How long a lease lasts without being renewed.
    pub(crate) lease: Duration,
}

/// The store; clones share it.
#[derive(Clone, Debug)]
pub(crate) struct Store {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    /// Which database it is.
    identity: String,
    presence: Presence,
    writer: Writer,
    readers: Readers,
    /// Whether other servers may use the database.
    others_may_use_it: bool,
    reserve: Reserve,
    shortage: Shortage,
    changes: Notifications<JobId>,
    study_changes: Notifications<StudyId>,
    export_changes: Notifications<ExportId>,
    journal: Journal,
    idle_workers: IdleWorkers,
    /// Of those who make anything, and of those who make only what is quick.
    export_workers: [Notify; 2],
    /// Of the task that sends webhooks.
    webhooks: Notify,
    /// Of the task that checks what worker processes have sent.
    checks: Notify,
    /// The other servers of the same database.
    servers: Option<servers::Servers>,
    limits: StoreLimits,
    accounts: Arc<Accounts>,
}

impl Store {
    /// Opens the database; makes a file that is missing, and tables where there are none. `folder` is where a reserve
    /// of disk space lies.
    ///
    /// # Errors
    /// When the database cannot be opened, or its tables are not those of this version.
    pub(crate) async fn open(
        database: &Database,
        folder: &Path,
        limits: StoreLimits,
        accounts: Arc<Accounts>,
    ) -> Result<Self, StoreError> {
        let Opened { mut connection, options, identity, run } = database.open().await?;
        let mark = Mark::of(&mut connection, database.file(), run).await?;
        let damage = Damage::default();
        let readers = options.readers(Some(&mark), &damage).await?;
        let writer = Writer::new(connection, options, mark.clone());
        // Sets the clock.
        writer.lock(Durability::PowerCut).await?.begin().await?.rollback().await?;
        let (servers, others) = database.servers().unzip();
        let files = OpenFiles::of(database.open_files()).map_err(sqlx::Error::Io)?;
        let shared = Arc::new(Shared {
            identity,
            presence: Presence::new(files, mark, damage),
            writer,
            readers,
            others_may_use_it: database.is_shared(),
            reserve: Reserve::open(folder.join(RESERVE)),
            shortage: Shortage::default(),
            changes: Notifications::default(),
            study_changes: Notifications::default(),
            export_changes: Notifications::default(),
            journal: Journal::default(),
            idle_workers: IdleWorkers::default(),
            export_workers: [Notify::new(), Notify::new()],
            webhooks: Notify::new(),
            checks: Notify::new(),
            servers,
            limits,
            accounts,
        });
        if let Some(others) = others {
            others.talk(&shared);
        }
        Ok(Self { shared })
    }

    /// Whether this server does what only one of those that share the database may do.
    pub(crate) fn is_leader(&self) -> bool {
        if let Some(servers) = &self.shared.servers {
            return servers.is_leader();
        }
        true
    }

    /// Which database it is: random, made with the tables. It stays the same in a backup and after `packstone
    /// migrate-store`.
    pub(crate) fn identity(&self) -> &str {
        &self.shared.identity
    }

    /// How long a lease lasts without being renewed.
    pub(crate) fn lease(&self) -> Duration {
        self.limits().lease
    }

    /// Time between two renewals of a lease: it outlives a few that are missed, and a short suspension of the machine.
    pub(crate) fn renew_every(&self) -> Duration {
        self.limits().lease / 4
    }

    /// Whether jobs may be held back until others of their owner have ended.
    fn bounds_running(&self) -> bool {
        self.shared.accounts.bounds_running()
    }

    /// Closes the file, after which every call fails; folds the write-ahead log into it.
    pub(crate) async fn close(&self) {
        self.shared.readers.close().await;
        // The connection itself closes with the last clone; what is not folded in is folded in later.
        self.shrink_log().await;
    }

    /// Folds the write-ahead log into the file, and gives its space back to the file system.
    pub(crate) async fn shrink_log(&self) {
        if self.shared.presence.check().is_err() {
            return;
        }
        if let Err(error) = self.shared.writer.fold_log().await {
            tracing::warn!(%error, "the write-ahead log was not folded in");
        }
    }

    /// Gives free pages of the file back to the file system, some at a time, beyond those that are soon used again.
    pub(crate) async fn give_back_pages(&self) -> Result<(), StoreError> {
        let free = either("select freelist_count from pragma_freelist_count", "select 0::bigint");
        while sql(free.clone()).scalar::<i64>(self.readers()).await? > FREE_PAGES {
            let mut writer = self.quick_writer().await?;
            sql("pragma incremental_vacuum(500)").execute(&mut writer).await?;
            drop(writer);
            tokio::time::sleep(VACUUM_PAUSE).await;
        }
        Ok(())
    }

    /// Takes the reserve of disk space again after a deletion has used it, as soon as there is space.
    pub(crate) async fn refill_reserve(&self) {
        if self.shared.reserve.is_held() {
            return;
        }
        // The log that the deletion wrote lies in the space of the reserve.
        self.shrink_log().await;
        let reserve = self.shared.reserve.clone();
        // A panic in there is logged by the hook; the next call tries again.
        let _ = tasks::blocking(move || reserve.refill()).await;
    }

    /// Tells whether a write of the store, or of those who share this, failed for want of space.
    pub(crate) fn shortage(&self) -> Shortage {
        self.shared.shortage.clone()
    }

    /// Faults after which the database was opened anew.
    pub(crate) fn faults(&self) -> u64 {
        self.shared.writer.replaced()
    }

    /// Whether the database cannot be opened any more, and only a restart or an operator can help.
    pub(crate) fn is_lost(&self) -> bool {
        let lost_for = self.shared.writer.lost_for().max(self.silent_for());
        self.usable().is_err_and(|why| why.is_final())
            || lost_for.is_some_and(|lost_for| lost_for >= LOST_AFTER)
    }

    /// Waits for the right to write; what is committed survives a power cut.
    async fn writer(&self) -> Result<Writing<'_>, StoreError> {
        self.shared.writer.lock(Durability::PowerCut).await
    }

    /// What the commit of a lease must survive. A crash of the database that undoes a lease lets another worker have
    /// the same attempt. Where all workers end with the database no harm comes of it; where a worker may go on, two
    /// runs would write the same file.
    fn durability_of_leases(&self) -> Durability {
        if self.is_shared() { Durability::PowerCut } else { Durability::ProcessEnd }
    }

    /// The same for what may be lost in a power cut together with all that followed it.
    async fn quick_writer(&self) -> Result<Writing<'_>, StoreError> {
        self.shared.writer.lock(Durability::ProcessEnd).await
    }

    /// Runs a write after which space can be freed. On a full disk it gets the reserve's space and is run once more.
    async fn freeing<T, W>(&self, write: impl Fn(Self) -> W) -> Result<T, StoreError>
    where
        T: Send + 'static,
        W: Future<Output = Result<T, StoreError>> + Send + 'static,
    {
        match self.detached(write(self.clone())).await {
            Err(error) if error.is_full() && self.shared.reserve.release() => {
                self.detached(write(self.clone())).await
            }
            ended => ended,
        }
    }

    /// Runs a write to its end whatever becomes of the caller. What it has committed counts only where the store is
    /// still the one of its name.
    async fn detached<T: Send + 'static>(
        &self,
        write: impl Future<Output = Result<T, StoreError>> + Send + 'static,
    ) -> Result<T, StoreError> {
        let presence = &self.shared.presence;
        // What is written over damage may be lost with it, and what is written to another file is.
        presence.check()?;
        presence.check_damage()?;
        let ended = tasks::spawn(write).await?;
        presence.check()?;
        if let Err(error) = &ended {
            presence.note(error);
            if error.is_full() {
                self.shared.shortage.note();
            }
        }
        presence.check_damage()?;
        ended
    }

    fn readers(&self) -> &Readers {
        &self.shared.readers
    }

    fn accounts(&self) -> &Accounts {
        &self.shared.accounts
    }

    /// Whether other servers may use the database.
    fn is_shared(&self) -> bool {
        self.shared.others_may_use_it
    }

    /// The clock of the database, in microseconds since the Unix epoch.
    fn now_us(&self) -> i64 {
        self.shared.writer.clock().now_us()
    }

    /// The moment so long ago by the clock of the database, in microseconds since the Unix epoch.
    pub(crate) fn time_ago(&self, ago: Duration) -> i64 {
        self.now_us().saturating_sub(micros(ago))
    }

    fn limits(&self) -> StoreLimits {
        self.shared.limits
    }
}

/// How long a job or an export waits after so many faults of the machine: 5 s, doubled by each, at most 10 min.
fn fault_pause(faults: i64) -> Duration {
    const FIRST_S: u64 = 5;
    const LONGEST_S: u64 = 600;
    let doublings = u32::try_from((faults - 1).clamp(0, 10)).unwrap_or(10);
    Duration::from_secs((FIRST_S << doublings).min(LONGEST_S))
}

fn micros(duration: Duration) -> i64 {
    i64::try_from(duration.as_micros()).unwrap_or(i64::MAX)
}
