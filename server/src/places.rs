//! The place of the files of a service: opened at its start, owned by its database, and watched while it runs.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;

use crate::artifacts::Artifacts;
use crate::blobs::owner::{self, Owner, OwnerError};
use crate::blobs::{Blobs, Files, RESULTS, Watched};
use crate::config::ServeOptions;
use crate::disk::Elsewhere;
use crate::jobs::store::Database;
use crate::service::StartError;
use crate::tasks;

/// Time between two looks at the place.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// Time for the place to answer at the start.
const OPEN_WITHIN: Duration = Duration::from_secs(90);

/// Looks every two seconds whether the place of the files answers.
pub(crate) async fn watch(artifacts: Artifacts, shutdown: CancellationToken) {
    loop {
        let artifacts = artifacts.clone();
        let looked = tasks::blocking(move || artifacts.look());
        tokio::select! {
            // A panic in there is logged by the hook; the next look tries again.
            _ = looked => {}
            () = shutdown.cancelled() => return,
        }
        tokio::select! {
            () = sleep(LOOK_EVERY) => {}
            () = shutdown.cancelled() => return,
        }
    }
}

/// Opens the place of results and exports; also the jobs that results belong to by their names, with their paths, for
/// which all are listed. The latter are not asked for where orphans are welcome.
///
/// # Errors
/// The place cannot be used.
pub(crate) async fn open(
    options: &ServeOptions,
) -> Result<(Arc<dyn Blobs>, Vec<(String, String)>), StartError> {
    let place =
        options.blobs.as_ref().map_or_else(|| options.data_dir.clone(), |place| place.to_string().into());
    let opening = options.clone();
    let opened = tasks::blocking(move || -> Result<Arc<dyn Blobs>, StartError> {
        match &opening.blobs {
            Some(place) => Ok(place.open(&opening.data_dir, opening.min_free_bytes)?),
            None => Ok(Arc::new(in_data_dir(&opening)?)),
        }
    });
    // A folder on another machine that does not answer must not keep the start from its end without a word.
    let late = || {
        let error = io::Error::other(format!("it does not answer within {} s", OPEN_WITHIN.as_secs()));
        StartError::DataDir(place.clone(), error)
    };
    let blobs = timeout(OPEN_WITHIN, opened).await.map_err(|_| late())???;
    if options.adopt_orphans {
        return Ok((blobs, Vec::new()));
    }
    let artifacts = Artifacts::new(Arc::clone(&blobs));
    let results = tasks::blocking(move || artifacts.results()).await?;
    Ok((blobs, results.map_err(|error| StartError::DataDir(place, error))?))
}

/// The place of files in the data directory.
fn in_data_dir(options: &ServeOptions) -> Result<Files, StartError> {
    let files = Files::alone(options.data_dir.clone()).keeping(RESULTS);
    files.map_err(|error| StartError::DataDir(options.data_dir.clone(), error))
}

/// Whether a data directory has neither results nor checkpoints.
fn holds_nothing(data_dir: &Files) -> bool {
    let is_empty = |folder: &str| data_dir.list(folder).is_ok_and(|found| found.is_empty());
    ["artifacts", "checkpoints", "quarantine"].into_iter().all(is_empty)
}

/// How a mark names a database: without a password, a file by its whole path.
pub(crate) fn named(database: &Database) -> String {
    match database.file().map(std::path::absolute) {
        Some(Ok(file)) => file.display().to_string(),
        _ => database.to_string(),
    }
}

/// Makes sure that data directory and place of files belong to the database, and marks them as such where they belong
/// to none. Keeps the free space of a place on another machine in `space`.
///
/// # Errors
/// One of them belongs to another database, or cannot be used.
pub(crate) async fn claim(
    options: &ServeOptions,
    database: &Database,
    blobs: Arc<dyn Blobs>,
    owner: Owner,
    space: Elsewhere,
) -> Result<Artifacts, StartError> {
    let (options, is_file) = (options.clone(), database.file().is_some());
    tasks::blocking(move || {
        let data_dir = Files::alone(options.data_dir.clone());
        match owner::claim(&data_dir, &owner) {
            // The file in the directory was replaced: whether the results fit to it is looked at besides. A directory
            // without files has nothing that another database could lose.
            Err(OwnerError::Other { theirs, .. })
                if options.adopt_orphans
                    || (is_file && theirs.store == owner.store)
                    || holds_nothing(&data_dir) =>
            {
                tracing::warn!(%theirs, ours = %owner, "the data directory belongs to another database from now on");
                owner::take_over(&data_dir, &owner)?;
            }
            claimed => claimed?,
        }
        if options.blobs.is_none() {
            return Ok(Artifacts::new(blobs));
        }
        owner::claim(&*blobs, &owner)?;
        let watched = Watched::new(blobs, owner, space);
        watched.look();
        Ok(Artifacts::new(Arc::new(watched)))
    })
    .await?
}
