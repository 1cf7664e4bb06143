//! Clearing up at intervals: expired jobs, leases that ran out, files that deletions left behind, and checkpoints.
//!
//! Files are listed first, then those of live attempts are left out, then the store is asked; a file that was renamed
//! but not committed is in flight until its commit. Where several processes write files, what the others have in flight
//! is not known here: then only files are looked at that are old enough by the clock of the storage, and belong to an
//! attempt that is over. A complete file is removed only where the database says that a deletion left it behind. One
//! that the database does not know is moved to the quarantine, and removed after some days.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use tokio::time::{MissedTickBehavior, interval, sleep};
use tokio_util::sync::CancellationToken;

use super::JobId;
use super::store::{Removed, Store, StoreError};
use crate::artifacts::Artifacts;
use crate::checkpoints::Checkpoints;
use crate::metrics::{LeaseEvent, Metrics};
use crate::tasks;

/// Files that deletions have left behind, looked at together.
const REMOVALS_AT_ONCE: u32 = 1000;

/// Pause between two transactions that remove many jobs, for the writes of clients.
pub(crate) const BATCH_PAUSE: Duration = Duration::from_millis(20);

/// What is swept.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SweepRules {
    /// Days after which files in the quarantine are removed.
    pub(crate) quarantine_days: u32,
    /// Age of the files that are looked at where several processes write.
    pub(crate) least_age: Duration,
    /// Time after the end of jobs and studies without `expires_at` at which they are removed, where there is one.
    pub(crate) expire_after: Option<Duration>,
}

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
    #[error("a folder of files failed: {0}")]
    Folder(#[from] io::Error),
    #[error("the sweep was broken off: {0}")]
    Broken(#[from] tokio::task::JoinError),
}

/// Sweeps at once and then every `every`, until the server stops.
pub(crate) async fn run(
    store: Store,
    artifacts: Artifacts,
    checkpoints: Checkpoints,
    every: Duration,
    rules: SweepRules,
    metrics: Arc<Metrics>,
    shutdown: CancellationToken,
) {
    let mut tick = interval(every);
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = tick.tick() => {}
            () = shutdown.cancelled() => return,
        }
        // A storage that does not answer must not hold up the stop; what is begun ends by itself.
        let swept = tokio::select! {
            swept = sweep(&store, &artifacts, &checkpoints, rules) => swept,
            () = shutdown.cancelled() => return,
        };
        metrics.swept(swept.is_ok());
        metrics.lease(LeaseEvent::Expired, swept.as_ref().map_or(0, |swept| swept.reclaimed) as u64);
        match swept {
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

/// Takes back the jobs whose lease ran out, as often as leases are renewed, until the server stops: a job of a machine
/// that died does not wait for the next sweep.
pub(crate) async fn take_back(
    store: Store,
    checkpoints: Checkpoints,
    metrics: Arc<Metrics>,
    shutdown: CancellationToken,
) {
    let mut tick = interval(store.renew_every());
    tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = tick.tick() => {}
            () = shutdown.cancelled() => return,
        }
        let taken_back = tokio::select! {
            taken_back = take_back_expired(&store, &checkpoints) => taken_back,
            () = shutdown.cancelled() => return,
        };
        match taken_back {
            Ok(0) => {}
            Ok(jobs) => {
                metrics.lease(LeaseEvent::Expired, jobs as u64);
                tracing::warn!(jobs, "leases ran out; the jobs wait for other workers");
            }
            Err(error) => tracing::error!(%error, "leases that ran out were not taken back"),
        }
    }
}

/// How many jobs were taken back.
async fn take_back_expired(store: &Store, checkpoints: &Checkpoints) -> Result<usize, SweepError> {
    // A look that costs no write, in most cases.
    if !store.has_expired_leases().await? {
        return Ok(0);
    }
    let checkpoints = checkpoints.clone();
    let kept = tasks::blocking(move || checkpoints.kept_anywhere()).await??;
    let exports = store.reclaim_expired_exports(kept.clone()).await?;
    if exports > 0 {
        tracing::warn!(exports, "leases ran out; the exports wait for other workers");
    }
    Ok(store.reclaim_expired_leases(kept).await?)
}

/// One sweep.
///
/// # Errors
/// Those of the store and of the folder; what was not swept is left for the next time.
pub(crate) async fn sweep(
    store: &Store,
    artifacts: &Artifacts,
    checkpoints: &Checkpoints,
    rules: SweepRules,
) -> Result<Swept, SweepError> {
    let reclaimed = take_back_expired(store, checkpoints).await?;
    let mut swept = Swept { reclaimed, ..Swept::default() };
    swept.expired += cancel_expired(store).await?;
    let finished_before = rules.expire_after.map(|after| store.time_ago(after));
    while let Some(removed) = store.remove_expired_study(finished_before).await? {
        swept.expired += 1;
        remove_all(artifacts, removed).await?;
        sleep(BATCH_PAUSE).await;
    }
    loop {
        let removed = store.remove_expired().await?;
        if removed.is_empty() {
            break;
        }
        swept.expired += removed.len();
        remove_all(artifacts, removed).await?;
        sleep(BATCH_PAUSE).await;
    }
    if let Some(finished_before) = finished_before {
        let mut after = (0, 0);
        while let (removed, Some(last)) = store.remove_old(finished_before, after).await? {
            after = last;
            swept.expired += removed.len();
            remove_all(artifacts, removed).await?;
            sleep(BATCH_PAUSE).await;
        }
    }
    swept.files += sweep_files(store, artifacts, rules).await?;
    swept.files += sweep_checkpoints(store, checkpoints).await?;
    on(artifacts, Artifacts::remove_empty_folders).await?;
    Ok(swept)
}

/// Cancels waiting jobs that have expired; how many they were. No claim takes them, so that none of them starts.
///
/// # Errors
/// The store's.
pub(crate) async fn cancel_expired(store: &Store) -> Result<usize, StoreError> {
    let mut cancelled = 0;
    loop {
        let jobs = store.cancel_expired().await?;
        if jobs == 0 {
            if cancelled > 0 {
                tracing::info!(
                    jobs = cancelled,
                    "jobs have expired before they were started; they are cancelled"
                );
            }
            return Ok(cancelled);
        }
        cancelled += jobs;
        sleep(BATCH_PAUSE).await;
    }
}

/// Removes what was left over, and moves what is not known to the quarantine; how many files that were.
async fn sweep_files(store: &Store, artifacts: &Artifacts, rules: SweepRules) -> Result<usize, SweepError> {
    let SweepRules { quarantine_days, least_age, .. } = rules;
    let settled = on(artifacts, move |artifacts| artifacts.settled(least_age)).await?;
    let today = Timestamp::now().to_zoned(TimeZone::UTC).date();
    let (mut removed, mut unknown) = (Vec::new(), Vec::new());
    for file in settled {
        // Asked first: an attempt that is over has committed its row, or never will.
        if artifacts.are_shared()
            && let Some((id, attempt)) = file.attempt()
            && store.is_running(id, attempt).await?
        {
            continue;
        }
        if !file.is_complete() {
            // Half of a file, of an attempt that was killed.
            tracing::info!(path = file.path, "removing a file that was not written to its end");
            removed.push(file.path);
        } else if !store.refers_to(&file.complete).await? {
            let list = if store.is_removed(&file.complete).await? { &mut removed } else { &mut unknown };
            list.push(file.path);
        }
    }
    let files = removed.len() + unknown.len();
    on(artifacts, move |artifacts| {
        artifacts.remove(&removed)?;
        for path in unknown {
            match artifacts.quarantine(&path, today) {
                Ok(None) => {}
                Ok(Some(to)) => {
                    tracing::warn!(
                        path,
                        to,
                        "moved a file that the database does not know to the quarantine"
                    );
                }
                // The next sweep tries again; this one goes on.
                Err(error) => tracing::error!(%error, path, "a file was not moved to the quarantine"),
            }
        }
        Ok(())
    })
    .await?;
    forget_removals(store, artifacts).await?;
    for folder in on(artifacts, move |artifacts| artifacts.empty_quarantine(today, quarantine_days)).await? {
        tracing::warn!(folder, quarantine_days, "removed files from the quarantine");
    }
    Ok(files)
}

/// Removes the files that committed deletions have left behind, and forgets them.
async fn forget_removals(store: &Store, artifacts: &Artifacts) -> Result<(), SweepError> {
    loop {
        let paths = store.removals(REMOVALS_AT_ONCE).await?;
        if paths.is_empty() {
            return Ok(());
        }
        let mut useless = Vec::new();
        for path in &paths {
            if !store.refers_to(path).await? {
                useless.push(path.clone());
            }
        }
        on(artifacts, move |artifacts| artifacts.remove(&useless)).await?;
        store.forget_removals(paths).await?;
    }
}

/// Removes the results of jobs that are gone.
async fn remove_all(artifacts: &Artifacts, jobs: Vec<Removed>) -> Result<(), SweepError> {
    let paths: Vec<String> = jobs.into_iter().flat_map(|job| job.files).collect();
    on(artifacts, move |artifacts| artifacts.remove(&paths)).await
}

/// Does something with the files, on a thread that may block.
async fn on<T: Send + 'static>(
    artifacts: &Artifacts,
    work: impl FnOnce(&Artifacts) -> io::Result<T> + Send + 'static,
) -> Result<T, SweepError> {
    let artifacts = artifacts.clone();
    Ok(tasks::blocking(move || work(&artifacts)).await??)
}

/// Removes the checkpoints of jobs that are finished or gone. Those of open jobs are left alone, of
/// whatever attempt: the next one may go on from them.
async fn sweep_checkpoints(store: &Store, checkpoints: &Checkpoints) -> Result<usize, SweepError> {
    let found = tasks::blocking({
        let checkpoints = checkpoints.clone();
        move || checkpoints.list()
    })
    .await??;
    let mut removed = 0;
    for found in found {
        let open = match JobId::parse(&found.id) {
            Some(id) => store.is_open(id).await?,
            None => false,
        };
        if !open {
            Checkpoints::remove_found(&found)?;
            removed += 1;
        }
    }
    let shared = checkpoints.clone();
    for id in tasks::blocking(move || shared.shared_ids()).await?? {
        let open = match JobId::parse(&id) {
            Some(id) => store.is_open(id).await?,
            None => false,
        };
        if !open {
            let checkpoints = checkpoints.clone();
            tasks::blocking(move || checkpoints.remove_all_shared(&id)).await??;
            removed += 1;
        }
    }
    Ok(removed)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::path::Path;

    use serde_json::json;

    use super::*;
    use crate::jobs::moments;
    use crate::jobs::request::{Change, JobPatch};
    use crate::jobs::store::{NewJob, StoreLimits, Submitted};
    use crate::jobs::{ArtifactRecord, JobProgress, JobRequest};

    const RULES: SweepRules =
        SweepRules { quarantine_days: 7, least_age: Duration::from_hours(1), expire_after: None };

    /// What a sweep works on, in a folder.
    async fn opened(folder: &Path) -> (Store, Artifacts, Checkpoints) {
        let limits = StoreLimits { max_queued: 10, lease: Duration::from_mins(1) };
        let database = folder.join("packstone.sqlite").as_path().into();
        let store = Store::open(&database, folder, limits, Arc::default()).await.unwrap();
        let checkpoints = Checkpoints::open(folder.join("checkpoints"), Duration::from_secs(30)).unwrap();
        (store, Artifacts::open(folder).unwrap(), checkpoints)
    }

    #[tokio::test]
    async fn only_what_nothing_refers_to_is_swept() {
        let folder = tempfile::tempdir().unwrap();
        let (store, artifacts, checkpoints) = opened(folder.path()).await;
        let file = |name: &str| folder.path().join("artifacts/ab").join(name);
        std::fs::create_dir(folder.path().join("artifacts/ab")).unwrap();
        for name in
            ["kept.1.packstone", "orphan.1.packstone", "partial.1.packstone.tmp", "expired.1.packstone"]
        {
            std::fs::write(file(name), "x").unwrap();
        }
        finish(&store, "ab/kept.1.packstone", "2999-01-01T00:00:00Z").await;
        finish(&store, "ab/expired.1.packstone", "2020-01-01T00:00:00Z").await;
        // A result that was renamed and waits for its commit.
        let place = artifacts.begin("live-ab", 1);
        std::fs::write(file("live-ab.1.packstone"), "x").unwrap();

        let swept = sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap();
        assert_eq!(swept, Swept { reclaimed: 0, expired: 1, files: 2 });
        let mut left: Vec<String> = std::fs::read_dir(folder.path().join("artifacts/ab"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        left.sort();
        assert_eq!(left, ["kept.1.packstone", "live-ab.1.packstone"]);
        drop(place);
        assert_eq!(
            sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap().files,
            1,
            "its attempt ended without a commit"
        );
    }

    #[tokio::test]
    async fn checkpoints_stay_while_their_job_is_open() {
        let folder = tempfile::tempdir().unwrap();
        let (store, artifacts, checkpoints) = opened(folder.path()).await;
        let id = submit(&store, "2999-01-01T00:00:00Z").await;
        let write = |name: String| std::fs::write(folder.path().join("checkpoints").join(name), "x").unwrap();
        for name in ["1.checkpoint", "2.checkpoint.tmp"] {
            write(format!("{id}.{name}"));
            write(format!("{}.{name}", JobId::new()));
        }
        write("nonsense.1.checkpoint".into());
        write("notes.txt".into());
        assert_eq!(
            sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap().files,
            3,
            "of a job that waits"
        );
        assert_eq!(sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap().files, 0);
        let lease = store.claim().await.unwrap().unwrap().lease;
        assert_eq!(
            sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap().files,
            0,
            "of one that runs"
        );
        store.finish_cancelled(lease).await.unwrap();
        assert_eq!(
            sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap().files,
            2,
            "of one that ended"
        );
        assert!(folder.path().join("checkpoints/notes.txt").exists());
        // Folders without a file go, and those that hold one stay.
        let named = |name: &str| folder.path().join(name);
        for empty in ["artifacts/ab", "artifacts/cd", "quarantine/2026-03-28/ab"] {
            std::fs::create_dir_all(named(empty)).unwrap();
        }
        std::fs::write(named("artifacts/cd/notes.txt"), "x").unwrap();
        sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap();
        assert!(named("artifacts/ab").exists(), "the next file may come at any moment");
        let before = std::time::SystemTime::now() - Duration::from_mins(1);
        for old in ["artifacts/ab", "artifacts/cd", "quarantine/2026-03-28/ab", "quarantine/2026-03-28"] {
            std::fs::File::open(named(old)).unwrap().set_modified(before).unwrap();
        }
        sweep(&store, &artifacts, &checkpoints, RULES).await.unwrap();
        assert!(!named("artifacts/ab").exists() && !named("quarantine/2026-03-28").exists());
        assert!(named("artifacts/cd/notes.txt").exists());
    }

    async fn submit(store: &Store, expires_at: &str) -> JobId {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2},
            "expires_at": expires_at
        });
        let request = JobRequest::read(&request, 1, None).unwrap();
        match store
            .submit(NewJob {
                request,
                warnings: Vec::new(),
                forecast_s: 1.0,
                keeps_checkpoints: true,
                most_threads: 1,
                by: crate::accounts::Submitter::default(),
                idempotency_key: None,
            })
            .await
            .unwrap()
        {
            Submitted::Created(job) | Submitted::Existing(job) => job.id,
        }
    }

    async fn finish(store: &Store, path: &str, expires_at: &str) {
        let id = submit(store, "2999-01-01T00:00:00Z").await;
        let lease = store.claim().await.unwrap().unwrap().lease;
        let artifact = ArtifactRecord {
            path: path.into(),
            bytes: 1,
            sha256: "00".repeat(32),
            report: serde_json::Map::new(),
            format_revision: 1,
            format_lengths: std::collections::BTreeMap::new(),
        };
        let progress = JobProgress {
            fraction: 1.0,
            step: packstone_engine::Step::Write,
            done: 1,
            total: 1,
            unit: "grains".into(),
            message: String::new(),
            eta_s: None,
            growth: None,
        };
        store.succeed(lease, artifact, progress, crate::studies::Facts::default(), Vec::new()).await.unwrap();
        let expires_at = Change::Set(moments::read(expires_at).unwrap());
        store.patch(id, JobPatch { expires_at, ..JobPatch::default() }).await.unwrap();
    }
}
