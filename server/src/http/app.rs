//! What all handlers share: the store, the artifacts, the limits, and the permits that bound concurrent work.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use packstone_engine::Limits;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::accounts::{Accounts, Caller};
use crate::artifacts::Artifacts;
use crate::audit::AuditLog;
use crate::checkpoints::Checkpoints;
use crate::config::ServeOptions;
use crate::disk::Disk;
use crate::http::hosts::Hosts;
use crate::jobs::runner::Runner;
use crate::jobs::store::Store;
use crate::metrics::Metrics;
use crate::storage::Storage;
use crate::webhooks::WebhookRules;

/// Bodies of more than this are read and planned a few at a time and off the threads that answer.
pub(crate) const LARGE_BODY_BYTES: usize = 1 << 18;
/// Large bodies at once: parsed JSON takes up to thirty times the room of its text.
const LARGE_BODIES: usize = 2;
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
    pub(crate) disk: Disk,
    pub(crate) storage: Storage,
    pub(crate) metrics: Arc<Metrics>,
    pub(crate) accounts: Arc<Accounts>,
    pub(crate) audit: Option<Arc<AuditLog>>,
    pub(crate) trust_proxy: bool,
    /// Names that `Host` may have, where others would let a web page of another site reach this server.
    pub(crate) hosts: Option<Hosts>,
    pub(crate) webhook_rules: Arc<WebhookRules>,
    pub(crate) limits: Limits,
    pub(crate) max_body_bytes: u64,
    pub(crate) max_queued: u64,
    pub(crate) workers: usize,
    /// One permit per connection that may be open.
    pub(crate) connections: Arc<Semaphore>,
    pub(crate) max_connections: usize,
    /// One permit per result being sent.
    pub(crate) downloads: Arc<Semaphore>,
    pub(crate) max_downloads: usize,
    pub(crate) export_cache_bytes: u64,
    /// One permit per plot being drawn.
    pub(crate) plots: Arc<Semaphore>,
    pub(crate) large_bodies: Arc<Semaphore>,
    pub(crate) ready: AtomicBool,
    pub(crate) shutdown: CancellationToken,
}

impl App {
    /// Gathers what handlers share, much of it with the runner.
    pub(crate) fn new(
        options: &ServeOptions,
        runner: &Runner,
        accounts: Arc<Accounts>,
        audit: Option<Arc<AuditLog>>,
        connections: Arc<Semaphore>,
    ) -> Self {
        Self {
            shared: Arc::new(Shared {
                store: runner.store.clone(),
                artifacts: runner.artifacts.clone(),
                checkpoints: runner.checkpoints.clone(),
                disk: runner.disk.clone(),
                storage: runner.storage.clone(),
                metrics: Arc::clone(&runner.metrics),
                hosts: (options.listen.ip().is_loopback() && accounts.keys().is_none())
                    .then(|| Hosts::loopback_and(&options.allowed_host)),
                accounts,
                audit,
                trust_proxy: options.trust_proxy,
                webhook_rules: Arc::new(options.webhook_rules()),
                limits: options.limits(),
                max_body_bytes: options.max_body_bytes,
                max_queued: options.max_queued,
                workers: options.workers(),
                connections,
                max_connections: options.max_connections,
                downloads: Arc::new(Semaphore::new(options.max_downloads)),
                max_downloads: options.max_downloads,
                export_cache_bytes: options.export_cache_bytes,
                plots: Arc::new(Semaphore::new(PLOTS)),
                large_bodies: Arc::new(Semaphore::new(LARGE_BODIES)),
                ready: AtomicBool::new(false),
                shutdown: runner.shutdown.clone(),
            }),
        }
    }

    /// What one packing of the caller may use.
    pub(crate) fn limits_of(&self, caller: &Caller) -> Limits {
        let limits = self.shared.limits;
        let quota = self.shared.accounts.quotas(&caller.by.owner).grains;
        Limits { max_grains: quota.map_or(limits.max_grains, |most| most.min(limits.max_grains)), ..limits }
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
