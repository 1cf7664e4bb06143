//! The service as a whole: opened over a data directory, served on a listener, closed in order.
//!
//! `packstone serve` and `packstone demo` both start it here. The data directory belongs to one
//! service at a time, by a lock that the system drops with the process, however it ends.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::sync::{Notify, Semaphore};
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout, timeout_at};
use tokio_util::sync::CancellationToken;

use crate::accounts::{Accounts, KeysError, KeysFile};
use crate::audit::AuditLog;
use crate::blobs::owner::{Owner, OwnerError};
use crate::blobs::{OpenError, Place, RESULTS};
use crate::checkpoints::Checkpoints;
use crate::config::ServeOptions;
use crate::descriptors::{self, TooFew};
use crate::disk::{Disk, Elsewhere};
use crate::exports::making::Exports;
use crate::http::{self, App, OperatorFiles};
use crate::http_server::{self, ConnectionLimits};
use crate::jobs::store::{Database, ExportQueue, NoDatabase, Store, StoreError, StoreLimits, Unusable};
use crate::jobs::sweeper::{self, SweepError};
use crate::memory;
use crate::metrics::Metrics;
use crate::open_files::OpenFiles;
use crate::places;
use crate::storage::Storage;
use crate::tasks;
use crate::webhooks;
use crate::webhooks::sender::WebhookSender;
use crate::webhooks::signature::{SecretsError, SecretsFile};
use crate::workers::executor::Executor;
use crate::workers::heard::Heard;
use crate::workers::here::Here;
use crate::workers::in_slots::InSlots;
use crate::workers::packing::{Packings, Source};
use crate::workers::slots::Slots;

/// Time that running jobs may take to keep a last checkpoint (5 s) and to go back to the queue. It stays below the ten
/// seconds that init systems and container engines grant.
const STOP_RUNS: Duration = Duration::from_secs(8);

/// Time between two looks for jobs that an idle worker was not told of.
const LOOK_FOR_JOBS: Duration = Duration::from_secs(2);

/// Time between two looks at the files of settings.
const SETTINGS_EVERY: Duration = Duration::from_secs(1);

/// Time between two looks at the room for results, and for the reserve of disk space.
const ROOM_EVERY: Duration = Duration::from_secs(1);

/// Why the service does not start.
#[derive(Debug, thiserror::Error)]
pub(crate) enum StartError {
    /// The data directory cannot be used.
    #[error("the data directory {0} cannot be used: {1}")]
    DataDir(PathBuf, std::io::Error),
    /// It is another service's.
    #[error("the data directory {0} is in use by another packstone")]
    Locked(PathBuf),
    /// The address cannot be listened on.
    #[error("cannot listen on {0}: {1}")]
    Listen(std::net::SocketAddr, std::io::Error),
    /// It would be open to everyone.
    #[error(
        "{0} is reachable from other machines: name API keys (--api-keys-file), or say --insecure to let everyone in"
    )]
    Open(std::net::SocketAddr),
    /// The API keys cannot be read.
    #[error(transparent)]
    Keys(#[from] KeysError),
    /// The secrets of webhooks cannot be read.
    #[error(transparent)]
    Secrets(#[from] SecretsError),
    /// The audit log cannot be opened.
    #[error("the audit log {0} cannot be opened: {1}")]
    AuditLog(PathBuf, std::io::Error),
    /// Results cannot be kept where they are to be.
    #[error(transparent)]
    Blobs(#[from] OpenError),
    /// The first task of the service ended by a defect.
    #[error("the start was broken off: {0}")]
    Broken(#[from] tokio::task::JoinError),
    /// The store has no database that this program can use.
    #[error("--store {0}")]
    Database(#[from] NoDatabase),
    /// The store cannot be opened.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A place belongs to another database.
    #[error(transparent)]
    Owner(#[from] OwnerError),
    /// Results lie there that the database does not know.
    #[error(
        "{count} results in {place}/artifacts belong to no job of the database {database}, as {example}: the database is \
         missing, empty, or older than they are. Put the right database back; or start with --adopt-orphans, which moves \
         them to {place}/quarantine, where they are removed after --quarantine-days"
    )]
    Orphans { place: String, database: String, count: usize, example: String },
    /// The system allows too few open files.
    #[error(transparent)]
    Descriptors(#[from] TooFew),
    /// The first sweep failed.
    #[error(transparent)]
    Sweep(#[from] SweepError),
}

/// An opened service, not yet serving.
pub(crate) struct Service {
    app: App,
    executor: Executor<InSlots>,
    here: Here,
    listener: TcpListener,
    connections: Arc<Semaphore>,
    options: ServeOptions,
    files: OperatorFiles,
    reload: Arc<Notify>,
    /// The data directory and its lock, as they were at the start.
    folders: OpenFiles,
    // Held, never read: the lock ends with it.
    _lock: File,
}

impl Service {
    /// Opens the data directory and the socket, and takes jobs of a crash back into the queue.
    ///
    /// # Errors
    /// See [`StartError`]: each is something the operator can change.
    pub(crate) async fn open(mut options: ServeOptions) -> Result<Self, StartError> {
        let keys = options.api_keys_file.clone().map(KeysFile::open).transpose()?;
        if !options.listen.ip().is_loopback() && keys.is_none() && !options.insecure {
            return Err(StartError::Open(options.listen));
        }
        let webhook_secrets = options.webhook_secret_file.clone().map(SecretsFile::open).transpose()?;
        let webhook_secrets = webhook_secrets.map(Arc::new);
        let metrics = Arc::new(Metrics::default());
        let audit = match options.audit_log.clone() {
            Some(path) => {
                let opened = AuditLog::open(path.clone(), Arc::clone(&metrics));
                Some(Arc::new(opened.map_err(|error| StartError::AuditLog(path, error))?))
            }
            None => None,
        };
        let data_dir = |error| StartError::DataDir(options.data_dir.clone(), error);
        std::fs::create_dir_all(&options.data_dir).map_err(data_dir)?;
        let lock = lock(&options.data_dir)?;
        Place::empty_scratch(&options.data_dir).map_err(data_dir)?;
        let (blobs, results) = places::open(&options).await?;
        let mut checkpoints =
            Checkpoints::open(options.data_dir.join("checkpoints"), options.checkpoint_every())
                .map_err(data_dir)?;
        let database = options.database()?;
        let is_empty = |file: &Path| std::fs::metadata(file).map_or(true, |found| found.len() == 0);
        if database.file().is_some_and(is_empty) && !options.adopt_orphans {
            refuse_orphans(&options, &database, &results)?;
        }
        let listener = TcpListener::bind(options.listen)
            .await
            .map_err(|error| StartError::Listen(options.listen, error))?;
        let limits = StoreLimits { max_queued: options.max_queued, lease: options.lease() };
        let accounts = Arc::new(
            Accounts::new(keys, options.quotas())
                .with_rate(options.max_requests_per_second_per_key, options.request_burst_per_key),
        );
        let store = Store::open(&database, &options.data_dir, limits, Arc::clone(&accounts)).await?;
        tracing::info!(%database, identity = store.identity(), "opened the store");
        let mut disk = Disk::new(options.data_dir.clone(), options.min_free_bytes, store.shortage());
        let owner = Owner { database: store.identity().to_owned(), store: places::named(&database) };
        let elsewhere = Elsewhere::default();
        let artifacts = places::claim(&options, &database, blobs, owner, elsewhere.clone()).await?;
        disk = disk.with_files_in(elsewhere);
        if let Some(shared) = artifacts.shared() {
            checkpoints = checkpoints.shared_by(shared);
        }
        if !options.adopt_orphans {
            let mut orphans = Vec::new();
            for (job, path) in results {
                if !store.knows_job(&job).await? && !store.is_removed(&path).await? {
                    orphans.push((job, path));
                }
            }
            refuse_orphans(&options, &database, &orphans)?;
        }
        let of_all = checkpoints.clone();
        let kept = tasks::blocking(move || of_all.kept_anywhere()).await?.map_err(data_dir)?;
        let recovered = store.recover(kept.clone()).await?;
        if recovered > 0 {
            tracing::info!(recovered, "jobs found running were taken back");
        }
        let elsewhere = store.await_workers().await?;
        if elsewhere > 0 {
            tracing::info!(
                elsewhere,
                "jobs run in worker processes; they keep them if they are heard within a minute"
            );
        }
        let unchecked = store.recover_checks().await?;
        if unchecked > 0 {
            tracing::info!(unchecked, "results of worker processes wait for their check");
        }
        let recovered = store.recover_exports(kept).await?;
        if recovered > 0 {
            tracing::info!(recovered, "exports that were being made were requeued");
        }
        let shutdown = CancellationToken::new();
        let webhooks = if webhook_secrets.is_some() { webhooks::AT_ONCE } else { 0 };
        let open_files =
            options.max_downloads + 8 * (options.workers() + usize::from(options.export_workers)) + webhooks;
        options.max_connections = descriptors::provide(options.max_connections, open_files)?;
        let connections = Arc::new(Semaphore::new(options.max_connections));
        let storage =
            Storage::new(store.clone(), disk.clone(), options.max_stored_bytes, Arc::clone(&accounts));
        let limits = options.limits();
        let here = Here { store, storage, limits, max_run_s: options.max_run_s };
        let source = Source::Here(here.clone());
        let slots = Slots::new(options.workers());
        let packings = Packings { source, artifacts, checkpoints, disk, metrics, templates: Arc::default() };
        let in_slots = in_slots(packings, slots, options.export_cache_bytes);
        let connected = Arc::clone(&connections);
        let files = OperatorFiles { accounts, webhook_secrets, audit };
        let app = App::new(&options, &in_slots, shutdown.clone(), &here, files.clone(), connected);
        let executor = Executor { kind: in_slots, shutdown };
        let reload = Arc::default();
        let folders = OpenFiles::of(folders_of(&options)).map_err(data_dir)?;
        Ok(Self { app, executor, here, listener, connections, options, files, reload, folders, _lock: lock })
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> std::io::Result<std::net::SocketAddr> {
        self.listener.local_addr()
    }

    /// Notified when the files of settings are to be read again at once: API keys and secrets of webhooks.
    pub(crate) fn reload(&self) -> Arc<Notify> {
        Arc::clone(&self.reload)
    }

    /// Cancel it to stop the service.
    pub(crate) fn shutdown(&self) -> CancellationToken {
        self.executor.shutdown.clone()
    }

    /// Serves until [`Self::shutdown`] is cancelled, then ends in order: no new connections, event
    /// streams end, running jobs go back to the queue, the store closes.
    ///
    /// # Errors
    /// The store or a folder of the service was moved, removed or replaced; then the service has ended by itself.
    pub(crate) async fn serve(self) -> Result<(), Unusable> {
        let Self { app, executor, here, listener, connections, options, files, reload, folders, _lock } =
            self;
        let (store, shutdown) = (here.store.clone(), executor.shutdown.clone());
        let router = http::router(app.clone());
        let checks = tasks::spawn(app.shared.checks.clone().run());
        tasks::spawn(watch_settings(files.clone(), reload, shutdown.clone()));
        tasks::spawn(memory::release_regularly(shutdown.clone()));
        let workers = tasks::spawn(work(
            executor,
            here,
            options.clone(),
            files.webhook_secrets,
            app.shared.heard.clone(),
        ));
        let audit = files.audit;
        app.set_ready(true);
        let watched = tasks::spawn(watch_store(store.clone(), folders, shutdown.clone()));
        let stopped = tasks::spawn({
            let shutdown = shutdown.clone();
            async move {
                shutdown.cancelled().await;
                Instant::now()
            }
        });
        let limits = ConnectionLimits {
            connections,
            max_per_client: options.max_connections_per_client(),
            memory_budget: app.shared.memory_budget.clone(),
            trust_proxy: options.trust_proxy,
            stalled_reader: options.stalled_reader(),
        };
        http_server::serve(listener, router, limits, shutdown.clone()).await;
        // The listener may end on its own only by a bug; the workers must not outlive it.
        shutdown.cancel();
        let stopped = stopped.await.unwrap_or_else(|_| Instant::now());
        if timeout_at(stopped + STOP_RUNS, workers).await.is_err() {
            tracing::error!("a run did not stop in time; its job is taken back at the next start");
        }
        if timeout_at(stopped + STOP_RUNS, checks).await.is_err() {
            tracing::warn!("a check did not stop in time; it begins again after the next start");
        }
        if timeout(Duration::from_secs(1), store.close()).await.is_err() {
            tracing::warn!("the store did not close in time; nothing is lost by it");
        }
        if let Some(audit) = audit {
            let _ = tasks::blocking(move || audit.close()).await;
        }
        tracing::info!("stopped");
        watched.await.unwrap_or(Ok(()))
    }
}

/// What runs in the slots: packings, and the exports that take as long.
fn in_slots(packings: Packings, slots: Slots, cache_bytes: u64) -> InSlots {
    let Packings { source, artifacts, checkpoints, disk, metrics, .. } = &packings;
    let (source, artifacts, disk) = (source.clone(), artifacts.clone(), disk.clone());
    let exports =
        Exports::in_slots(source, artifacts, checkpoints.clone(), disk, Arc::clone(metrics), cache_bytes);
    InSlots { packings, exports, slots }
}

/// Runs the workers, the export workers, the sweeper and the task that sends webhooks to their end. The first sweep
/// comes before the first job: what it finds is from an earlier life, and no attempt of this one has the same name yet.
async fn work(
    executor: Executor<InSlots>,
    here: Here,
    options: ServeOptions,
    webhook_secrets: Option<Arc<SecretsFile>>,
    heard: Heard,
) {
    let Executor { kind: InSlots { packings, exports, .. }, shutdown } = &executor;
    let rules = options.sweep_rules();
    if let Err(error) = sweeper::sweep(&here.store, &packings.artifacts, &packings.checkpoints, rules).await {
        tracing::error!(%error, "the first sweep failed");
    }
    let mut running: JoinSet<()> = JoinSet::new();
    let mut run = |task: tasks::Boxed<()>| drop(running.spawn(task));
    run(Box::pin(sweeper::run(
        here.store.clone(),
        packings.artifacts.clone(),
        packings.checkpoints.clone(),
        options.sweep_interval(),
        rules,
        Arc::clone(&packings.metrics),
        shutdown.clone(),
    )));
    if let Some(secrets) = webhook_secrets {
        let sender = WebhookSender {
            store: here.store.clone(),
            secrets,
            rules: options.webhook_rules(),
            first_pause: options.webhook_first_pause(),
            metrics: Arc::clone(&packings.metrics),
            shutdown: shutdown.clone(),
        };
        run(Box::pin(sender.run()));
    }
    let checkpoints = packings.checkpoints.clone();
    let metrics = Arc::clone(&packings.metrics);
    run(Box::pin(sweeper::take_back(here.store.clone(), checkpoints, metrics, shutdown.clone())));
    run(Box::pin(watch_room(here.clone(), shutdown.clone())));
    run(Box::pin(look_for_jobs(here.store.clone(), shutdown.clone())));
    if packings.artifacts.are_shared() {
        run(Box::pin(places::watch(packings.artifacts.clone(), shutdown.clone())));
    }
    let has_slots = options.workers() > 0;
    for _ in 0..options.export_workers {
        let heard = (!has_slots).then(|| heard.clone());
        let kind = Exports { queue: ExportQueue::Usual, heard, ..exports.clone() };
        run(Box::pin(Executor { kind, shutdown: shutdown.clone() }.work()));
    }
    let kind = Exports { queue: ExportQueue::Quick, ..exports.clone() };
    run(Box::pin(Executor { kind, shutdown: shutdown.clone() }.work()));
    for _ in 0..options.workers() {
        run(Box::pin(executor.clone().work()));
    }
    while let Some(ended) = running.join_next().await {
        if let Err(error) = ended {
            tracing::error!(%error, "a worker ended by a defect of this program");
        }
    }
}

/// Reads files of settings again once they have changed, and at once where that is requested by a signal.
async fn watch_settings(files: OperatorFiles, reload: Arc<Notify>, shutdown: CancellationToken) {
    loop {
        let look = files.clone();
        tokio::select! {
            _ = tasks::blocking(move || look.look()) => {}
            () = shutdown.cancelled() => return,
        }
        tokio::select! {
            () = sleep(SETTINGS_EVERY) => {}
            () = reload.notified() => {}
            () = shutdown.cancelled() => return,
        }
    }
}

/// Ends the service where its store or its data directory is replaced: what it accepts then is lost.
async fn watch_store(store: Store, folders: OpenFiles, shutdown: CancellationToken) -> Result<(), Unusable> {
    tokio::select! {
        why = store.watch(folders) => {
            shutdown.cancel();
            Err(why)
        }
        () = shutdown.cancelled() => Ok(()),
    }
}

/// The data directory with its lock and its folders. A place of files besides is watched by its mark (see [`places`]).
fn folders_of(options: &ServeOptions) -> Vec<PathBuf> {
    let data_dir = &options.data_dir;
    let mut folders = vec![data_dir.clone(), data_dir.join("lock"), data_dir.join("checkpoints")];
    if options.blobs.is_none() {
        folders.push(data_dir.join(RESULTS));
    }
    folders
}

/// Starts jobs that wait for room as soon as there is some, and takes the reserve of disk space again after a deletion
/// has used it.
async fn watch_room(here: Here, shutdown: CancellationToken) {
    loop {
        tokio::select! {
            () = sleep(ROOM_EVERY) => {}
            () = shutdown.cancelled() => return,
        }
        here.store.refill_reserve().await;
        if let Err(error) = here.store.give_back_pages().await {
            tracing::warn!(%error, "free space of the database was not given back to the file system");
        }
        if let Err(error) = here.storage.start_what_fits().await {
            tracing::warn!(%error, "jobs that wait for room could not be started");
        }
    }
}

/// Wakes an idle worker for a job that it was not told of, and cancels waiting jobs that have expired, until the server
/// stops.
async fn look_for_jobs(store: Store, shutdown: CancellationToken) {
    loop {
        tokio::select! {
            () = sleep(LOOK_FOR_JOBS) => {}
            () = shutdown.cancelled() => return,
        }
        if let Err(error) = store.look_for_jobs().await {
            tracing::warn!(%error, "the queue could not be read for idle workers");
        }
        if let Err(error) = sweeper::cancel_expired(&store).await {
            tracing::warn!(%error, "waiting jobs that have expired were not cancelled");
        }
    }
}

/// Refuses to start over results that the database does not know.
fn refuse_orphans(
    options: &ServeOptions,
    database: &Database,
    orphans: &[(String, String)],
) -> Result<(), StartError> {
    let Some((_, example)) = orphans.first() else { return Ok(()) };
    let data_dir = options.data_dir.display().to_string();
    Err(StartError::Orphans {
        place: options.blobs.as_ref().map_or_else(|| data_dir.clone(), Place::to_string),
        database: database.to_string(),
        count: orphans.len(),
        example: example.clone(),
    })
}

/// Takes a folder for this process alone.
///
/// # Errors
/// It is another process's, or cannot be used.
pub(crate) fn lock(data_dir: &Path) -> Result<File, StartError> {
    let failed = |error| StartError::DataDir(data_dir.to_owned(), error);
    let file = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(data_dir.join("lock"))
        .map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(StartError::Locked(data_dir.to_owned())),
        Err(TryLockError::Error(error)) => Err(failed(error)),
    }
}
