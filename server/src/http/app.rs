//! What all handlers share: the store, the artifacts, the limits, and the permits that bound concurrent work.

use std::collections::HashSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use packstone_engine::Limits;
use tokio::sync::{OnceCell, Semaphore};
use tokio_util::sync::CancellationToken;

use crate::accounts::{Accounts, Caller};
use crate::artifacts::Artifacts;
use crate::audit::AuditLog;
use crate::checkpoints::Checkpoints;
use crate::config::{MAX_UPLOADS, ServeOptions, check_threads};
use crate::disk::Disk;
use crate::fair_places::FairPlaces;
use crate::http::computing::ComputePool;
use crate::http::hosts::Hosts;
use crate::http::jobs::polled::Polled;
use crate::http::session::Sessions;
use crate::http::web::Web;
use crate::jobs::store::Store;
use crate::memory;
use crate::memory_budget::MemoryBudget;
use crate::metrics::Metrics;
use crate::planning::Planner;
use crate::problem::{Kind, Problem};
use crate::processor;
use crate::storage::Storage;
use crate::tasks;
use crate::webhooks::WebhookRules;
use crate::webhooks::signature::SecretsFile;
use crate::workers::checks::Checks;
use crate::workers::heard::Heard;
use crate::workers::here::Here;
use crate::workers::in_slots::InSlots;
use crate::workers::probe;
use crate::workers::slots::Slots;

/// Bodies of more than this are read off the threads that answer: those below take less than a millisecond.
pub(crate) const SMALL_BODY_BYTES: usize = 1 << 12;
/// Bodies of more than this are read a few at a time.
pub(crate) const LARGE_BODY_BYTES: usize = 1 << 18;
/// Large bodies at once: parsed JSON takes up to thirty times the room of its text, 300 MB of 16 MiB.
const LARGE_BODIES: usize = 2;
/// With less memory than this, one.
const MEMORY_OF_LARGE_BODIES: u64 = 4 << 30;
/// Plots drawn at once: each may hold all spheres of a result, and take a core for a second or two.
const PLOTS: usize = 2;

/// What handlers share.
#[derive(Clone, Debug)]
pub(crate) struct App {
    pub(crate) shared: Arc<Shared>,
}

#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) store: Store,
    pub(crate) artifacts: Artifacts,
    pub(crate) checkpoints: Checkpoints,
    /// What is sent by worker processes is checked by these.
    pub(crate) checks: Checks,
    pub(crate) disk: Disk,
    /// Whether clients are sent to the storage for what lies there as it is sent.
    pub(crate) blobs_redirect: bool,
    pub(crate) storage: Storage,
    pub(crate) metrics: Arc<Metrics>,
    pub(crate) accounts: Arc<Accounts>,
    /// Sessions of browsers, in place of keys.
    pub(crate) sessions: Sessions,
    pub(crate) audit: Option<Arc<AuditLog>>,
    pub(crate) trust_proxy: bool,
    /// Names that `Host` may have, where others would let a web page of another site reach this server.
    pub(crate) hosts: Option<Hosts>,
    /// The files of the web page, where it is served.
    pub(crate) web: Option<Web>,
    pub(crate) webhook_rules: Arc<WebhookRules>,
    pub(crate) webhook_secrets: Option<Arc<SecretsFile>>,
    pub(crate) limits: Limits,
    pub(crate) max_body_bytes: u64,
    pub(crate) max_queued: u64,
    /// Longest time of a run, whatever the request of the job allows.
    pub(crate) max_run_s: Option<f64>,
    /// Days after which finished jobs and studies without `expires_at` are removed.
    pub(crate) expire_after_days: Option<f64>,
    pub(crate) workers: usize,
    /// The slots of this server's own workers.
    pub(crate) slots: Slots,
    /// One permit per connection that may be open.
    pub(crate) connections: Arc<Semaphore>,
    pub(crate) max_connections: usize,
    /// One place for each result being sent.
    pub(crate) downloads: FairPlaces,
    pub(crate) max_downloads: usize,
    pub(crate) export_cache_bytes: u64,
    /// One place for each plot being drawn.
    pub(crate) plots: FairPlaces,
    pub(crate) large_bodies: FairPlaces,
    /// Threads that plan requests, where that takes a while.
    pub(crate) compute: ComputePool,
    /// Threads that read and write long documents.
    pub(crate) documents: ComputePool,
    pub(crate) planner: Planner,
    /// One place for each file that is being taken in from a worker.
    pub(crate) uploads: FairPlaces,
    /// The memory of requests being read and of answers being sent.
    pub(crate) memory_budget: MemoryBudget,
    /// Jobs in other processes whose state was asked for lately.
    pub(crate) polled: Polled,
    /// Workers that ask for jobs.
    pub(crate) heard: Heard,
    /// Files that are being taken in from workers.
    receiving: Mutex<HashSet<String>>,
    /// Digest of the probe, once a worker has asked for jobs.
    bits: OnceCell<String>,
    pub(crate) ready: AtomicBool,
    pub(crate) shutdown: CancellationToken,
}

/// What the operator keeps in files of their own, beside the data directory.
#[derive(Clone, Debug, Default)]
pub(crate) struct OperatorFiles {
    /// The file of keys.
    pub(crate) accounts: Arc<Accounts>,
    pub(crate) webhook_secrets: Option<Arc<SecretsFile>>,
    pub(crate) audit: Option<Arc<AuditLog>>,
}

impl OperatorFiles {
    /// Reads again what has changed of the files of settings. Blocks the thread.
    pub(crate) fn look(&self) {
        self.accounts.look_at_keys();
        if let Some(secrets) = &self.webhook_secrets {
            secrets.look();
        }
    }
}

impl App {
    /// Gathers what handlers share, much of it with the packings.
    pub(crate) fn new(
        options: &ServeOptions,
        InSlots { packings, slots, .. }: &InSlots,
        shutdown: CancellationToken,
        here: &Here,
        files: OperatorFiles,
        connections: Arc<Semaphore>,
    ) -> Self {
        let OperatorFiles { accounts, webhook_secrets, audit } = files;
        Self {
            shared: Arc::new(Shared {
                store: here.store.clone(),
                artifacts: packings.artifacts.clone(),
                checkpoints: packings.checkpoints.clone(),
                checks: Checks {
                    store: here.store.clone(),
                    artifacts: packings.artifacts.clone(),
                    checkpoints: packings.checkpoints.clone(),
                    metrics: Arc::clone(&packings.metrics),
                    limits: here.limits,
                    templates: Arc::clone(&packings.templates),
                    threads: check_threads(),
                    share: options.verify_results,
                    shutdown: shutdown.clone(),
                },
                disk: packings.disk.clone(),
                blobs_redirect: options.blobs_redirect,
                storage: here.storage.clone(),
                metrics: Arc::clone(&packings.metrics),
                hosts: (options.listen.ip().is_loopback() && accounts.keys().is_none())
                    .then(|| Hosts::loopback_and(&options.allowed_host)),
                accounts,
                sessions: Sessions::default(),
                audit,
                trust_proxy: options.trust_proxy,
                web: match &options.web_dir {
                    _ if options.no_web => None,
                    Some(folder) => Some(Web::Folder(folder.clone())),
                    None => Some(Web::compiled()),
                },
                webhook_rules: Arc::new(options.webhook_rules()),
                webhook_secrets,
                limits: options.limits(),
                max_body_bytes: options.max_body_bytes,
                max_queued: options.max_queued,
                max_run_s: options.max_run_s,
                expire_after_days: options.expire_after_days,
                workers: options.workers(),
                slots: slots.clone(),
                connections,
                max_connections: options.max_connections,
                downloads: FairPlaces::new(options.max_downloads, options.max_downloads / 2),
                max_downloads: options.max_downloads,
                export_cache_bytes: options.export_cache_bytes,
                plots: FairPlaces::new(PLOTS, PLOTS),
                large_bodies: FairPlaces::new(large_bodies(), large_bodies()),
                compute: ComputePool::of_requests(),
                documents: ComputePool::of_documents(),
                planner: Planner::new(Arc::clone(&packings.templates), processor::speed()),
                uploads: FairPlaces::new(MAX_UPLOADS, MAX_UPLOADS / 2),
                memory_budget: options.memory_budget(),
                polled: Polled::default(),
                heard: Heard::default(),
                receiving: Mutex::default(),
                bits: OnceCell::new(),
                ready: AtomicBool::new(false),
                shutdown,
            }),
        }
    }

    /// What one packing of the caller may use.
    pub(crate) fn limits_of(&self, caller: &Caller) -> Limits {
        let limits = self.shared.limits;
        let quota = self.shared.accounts.quotas(&caller.by.owner).grains;
        Limits { max_grains: quota.map_or(limits.max_grains, |most| most.min(limits.max_grains)), ..limits }
    }

    /// Digest of the packings by which workers show that they compute the same bits; `None` where they cannot be made.
    pub(crate) async fn bits(&self) -> Option<String> {
        let made = self.shared.bits.get_or_try_init(|| async {
            tasks::blocking(probe::bits)
                .await
                .map_err(|error| error.to_string())?
                .map_err(|error| error.to_string())
        });
        match made.await {
            Ok(bits) => Some(bits.clone()),
            Err(error) => {
                tracing::error!(error, "the bits of this server are unknown; no worker gets a job");
                None
            }
        }
    }

    /// Begins to take in a file of a worker, which nobody else may send until the end.
    ///
    /// # Errors
    /// `busy` where it is being sent already.
    pub(crate) fn receive_alone(&self, what: String) -> Result<Receiving, Problem> {
        let is_first =
            self.shared.receiving.lock().unwrap_or_else(PoisonError::into_inner).insert(what.clone());
        if !is_first {
            let detail = format!("the {what} is being sent by another request");
            return Err(Problem::new(Kind::Busy, detail).with_header("retry-after", "5"));
        }
        Ok(Receiving { shared: Arc::clone(&self.shared), what })
    }

    /// Whether the service takes jobs, as far as it decides that itself.
    pub(crate) fn set_ready(&self, ready: bool) {
        self.shared.ready.store(ready, Ordering::Release);
    }

    /// Whether the service takes jobs now.
    pub(crate) fn is_ready(&self) -> bool {
        self.shared.ready.load(Ordering::Acquire) && !self.shared.shutdown.is_cancelled()
    }
}

fn large_bodies() -> usize {
    if memory::total_bytes().is_some_and(|total| total < MEMORY_OF_LARGE_BODIES) { 1 } else { LARGE_BODIES }
}

/// A file of a worker that is being taken in.
pub(crate) struct Receiving {
    shared: Arc<Shared>,
    what: String,
}

impl Drop for Receiving {
    fn drop(&mut self) {
        self.shared.receiving.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.what);
    }
}
