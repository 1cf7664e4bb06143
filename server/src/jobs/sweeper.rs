//! Clearing up at intervals: expired jobs, leases that ran out, files that nothing refers to.
//!
//! The order keeps results safe: files are listed first, then those of live attempts are left out,
//! then the store is asked; a file that was renamed but not committed is in flight until its commit.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::store::{Store, StoreError};
use crate::artifacts::Artifacts;

/// What a sweep found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Swept {
    pub(crate) reclaimed: usize,
    pub(crate) expired: usize,
    pub(crate) files: usize,
}

#[derive(Debug, thiserror::Error)]
pub(crate) enum SweepError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("the folder of results failed: {0}")]
    Folder(#[from] std::io::Error),
    #[error("the sweep was broken off: {0}")]
    Broken(#[from] tokio::task::JoinError),
}

/// Sweeps at once and then every `every`, until the server stops.
pub(crate) async fn run(store: Store, artifacts: Artifacts, every: Duration, shutdown: CancellationToken) {
    let mut tick = interval(every);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = tick.tick() => {}
            () = shutdown.cancelled() => return,
        }
        match sweep(&store, &artifacts).await {
            Ok(swept) if swept != Swept::default() => tracing::info!(
                reclaimed = swept.reclaimed,
                expired = swept.expired,
                files = swept.files,
                "swept"
            ),
            Ok(_) => {}
            Err(error) => tracing::error!(%error, "the sweep failed"),
        }
    }
}

/// One sweep.
///
/// # Errors
/// Those of the store and of the folder; what was not swept is left for the next time.
pub(crate) async fn sweep(store: &Store, artifacts: &Artifacts) -> Result<Swept, SweepError> {
    let mut swept = Swept { reclaimed: store.reclaim_expired_leases().await?, ..Swept::default() };
    loop {
        let removed = store.remove_expired().await?;
        if removed.is_empty() {
            break;
        }
        swept.expired += removed.len();
        for path in removed.into_iter().filter_map(|job| job.artifact) {
            artifacts.remove(&path)?;
        }
    }
    let settled = tokio::task::spawn_blocking({
        let artifacts = artifacts.clone();
        move || artifacts.settled()
    })
    .await??;
    for (path, complete) in settled {
        let partial = path != complete;
        if partial || !store.refers_to(&complete).await? {
            artifacts.remove(&path)?;
            swept.files += 1;
        }
    }
    Ok(swept)
}
