//! `packstone check`: whether every file of a data directory is what the database says, and the database sound.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};

use super::{Failure, block_on, print};
use crate::artifacts::{Artifacts, Settled};
use crate::blobs::{Files, Place};
use crate::jobs::store::{Database, ExpectedFile, NoDatabase, files_of};
use crate::tasks;

/// Name of the database in a data directory.
pub(super) const DATABASE: &str = "packstone.sqlite";

/// Options of `packstone check`.
#[derive(Args)]
pub(super) struct Options {
    /// Data directory of a service, running or not, or a backup of one
    #[arg(default_value = "packstone-data")]
    directory: PathBuf,
    /// Database of PostgreSQL that the service uses, as `postgres://user@host/database`
    #[arg(long, env = "PACKSTONE_STORE", value_name = "URL", hide_env_values = true)]
    store: Option<String>,
    /// Where the service keeps results and exports, if not in its data directory: a folder, or
    /// `s3://BUCKET/PREFIX`
    #[arg(long, env = "PACKSTONE_BLOBS", value_name = "FOLDER-OR-URL", value_parser = Place::read)]
    blobs: Option<Place>,
}

/// Something that is wrong.
pub(super) struct Found {
    pub(super) path: String,
    pub(super) fault: String,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let directory = &options.directory;
    let (mut faults, files) = match &options.store {
        Some(url) => {
            let database = url.parse().map_err(|error: NoDatabase| format!("--store {error}"))?;
            (Vec::new(), block_on(async { Ok(files_of(&database).await?) })?)
        }
        None if directory.join(DATABASE).is_file() => {
            let found = block_on(integrity(directory))?;
            let found = found.into_iter().map(|fault| Found { path: DATABASE.into(), fault });
            (found.collect(), block_on(files(directory))?)
        }
        None => {
            let path = directory.display();
            return Err(format!("{path} is no data directory: it holds no {DATABASE}").into());
        }
    };
    let files: Arc<[ExpectedFile]> = files.into();
    faults.extend(block_on(compare(options, &files))?);
    for found in &faults {
        print(&format!("{}: {}\n", found.path, found.fault))?;
    }
    print(&format!("{} files checked, {} faults\n", files.len(), faults.len()))?;
    if faults.is_empty() { Ok(()) } else { Err(format!("{} faults were found", faults.len()).into()) }
}

async fn open(directory: &Path) -> Result<SqliteConnection, Failure> {
    let options = SqliteConnectOptions::new().filename(directory.join(DATABASE)).create_if_missing(false);
    Ok(SqliteConnection::connect_with(&options).await?)
}

/// What SQLite's own check finds.
async fn integrity(directory: &Path) -> Result<Vec<String>, Failure> {
    let mut connection = open(directory).await?;
    let mut found: Vec<String> =
        sqlx::query_scalar("pragma integrity_check").fetch_all(&mut connection).await?;
    found.retain(|line| line != "ok");
    connection.close().await?;
    Ok(found)
}

/// All files that a database in a directory refers to.
pub(super) async fn files(directory: &Path) -> Result<Vec<ExpectedFile>, Failure> {
    Ok(files_of(&Database::File(directory.join(DATABASE))).await?)
}

/// Compares the files with the database.
async fn compare(options: &Options, files: &Arc<[ExpectedFile]>) -> Result<Vec<Found>, Failure> {
    let (blobs, directory, files) = (options.blobs.clone(), options.directory.clone(), Arc::clone(files));
    let compared = tasks::blocking(move || {
        let artifacts = match blobs {
            Some(place) => Artifacts::new(place.open(&directory, None)?),
            None => in_directory(&directory),
        };
        let mut faults = verify(&artifacts, &files);
        faults.extend(unknown(&artifacts, &files)?);
        Ok::<_, Failure>(faults)
    });
    compared.await?
}

/// The results and exports in a data directory, or in a backup of one.
pub(super) fn in_directory(directory: &Path) -> Artifacts {
    Artifacts::new(Arc::new(Files::alone(directory.to_owned())))
}

/// Compares each file with its length and digest.
pub(super) fn verify(artifacts: &Artifacts, files: &[ExpectedFile]) -> Vec<Found> {
    let fault = |file: &ExpectedFile| match artifacts.digest(&file.path) {
        Ok((bytes, _)) if bytes != file.bytes => Some(format!("{bytes} bytes instead of {}", file.bytes)),
        Ok((_, sha256)) if sha256 != file.sha256 => {
            Some(format!("the sha256 is {sha256} instead of {}", file.sha256))
        }
        Ok(_) => None,
        Err(error) => Some(error.to_string()),
    };
    files.iter().filter_map(|file| Some(Found { path: file.path.clone(), fault: fault(file)? })).collect()
}

/// Complete files that the database does not know.
fn unknown(artifacts: &Artifacts, files: &[ExpectedFile]) -> Result<Vec<Found>, Failure> {
    let known: std::collections::HashSet<&str> = files.iter().map(|file| file.path.as_str()).collect();
    let found = artifacts.settled(Duration::ZERO)?.into_iter().filter(Settled::is_complete);
    Ok(found
        .filter(|file| !known.contains(file.path.as_str()))
        .map(|file| Found { path: file.path, fault: "the database does not know it".into() })
        .collect())
}
