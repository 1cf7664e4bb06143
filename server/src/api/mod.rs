//! The HTTP interface: one file per resource, problem documents for every error.
//!
//! A handler reads its request, asks the store, and shows what it got; rules about jobs live in
//! [`crate::jobs`], bytes of results in [`crate::artifacts`]. What clients rely on is written in
//! `openapi.yaml`, which is rendered from here.

pub(crate) mod auth;
mod body;
mod conditional;
mod export_view;
mod exports;
mod files;
mod formats;
mod job_actions;
mod job_events;
mod job_list;
mod job_view;
mod jobs;
mod meta;
mod negotiation;
mod observe;
pub(crate) mod openapi;
mod pages;
mod params;
mod plots;
mod problem;
mod problem_pages;
mod ranges;
mod request_schemas;
mod results;
mod router;
mod studies;
mod study_actions;
mod study_list;
mod study_schemas;
mod study_table;
mod study_view;
mod waiting;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use packstone_engine::Limits;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::artifacts::Artifacts;
use crate::checkpoints::Checkpoints;
use crate::config::ServeOptions;
use crate::jobs::runner::Runner;
use crate::jobs::store::Store;
use crate::metrics::Metrics;

pub(crate) use router::router;

/// Bodies of more than this are read and planned a few at a time and off the threads that answer.
const LARGE_BODY_BYTES: usize = 1 << 18;
/// Large bodies at once: parsed JSON takes up to thirty times the room of its text.
const LARGE_BODIES: usize = 2;
/// Plots drawn at once: each may hold all spheres of a result, and take a core for a second or two.
const PLOTS: usize = 2;

/// What handlers share.
#[derive(Clone, Debug)]
pub(crate) struct App {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    store: Store,
    artifacts: Artifacts,
    checkpoints: Checkpoints,
    metrics: Arc<Metrics>,
    keys: Option<auth::ApiKeys>,
    limits: Limits,
    max_body_bytes: u64,
    max_queued: u64,
    workers: usize,
    /// One permit per connection that may be open.
    connections: Arc<Semaphore>,
    max_connections: usize,
    /// One permit per result being sent.
    downloads: Arc<Semaphore>,
    max_downloads: usize,
    export_cache_bytes: u64,
    /// One permit per plot being drawn.
    plots: Arc<Semaphore>,
    large_bodies: Semaphore,
    ready: AtomicBool,
    shutdown: CancellationToken,
}

impl App {
    /// Gathers what handlers share, much of it with the runner.
    pub(crate) fn new(
        options: &ServeOptions,
        runner: &Runner,
        keys: Option<auth::ApiKeys>,
        connections: Arc<Semaphore>,
    ) -> Self {
        Self {
            shared: Arc::new(Shared {
                store: runner.store.clone(),
                artifacts: runner.artifacts.clone(),
                checkpoints: runner.checkpoints.clone(),
                metrics: Arc::clone(&runner.metrics),
                keys,
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
                large_bodies: Semaphore::new(LARGE_BODIES),
                ready: AtomicBool::new(false),
                shutdown: runner.shutdown.clone(),
            }),
        }
    }

    /// Whether the service takes jobs, as far as it decides that itself.
    pub(crate) fn set_ready(&self, ready: bool) {
        self.shared.ready.store(ready, Ordering::Release);
    }

    fn is_ready(&self) -> bool {
        self.shared.ready.load(Ordering::Acquire) && !self.shared.shutdown.is_cancelled()
    }
}
