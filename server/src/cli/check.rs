//! `packstone check`: whether a packing is valid, or whether every file of a data directory is what the database says,
//! and the database sound.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use clap::Args;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};

use super::check_packing::PackingOptions;
use super::exit::Exit;
use super::{Failure, block_on, print};
use crate::artifacts::{Artifacts, Settled};
use crate::blobs::owner::{self, Owner, OwnerError};
use crate::blobs::{Blobs, Files, Place};
use crate::checkpoints;
use crate::jobs::store::{
    DamagedRow, Database, ExpectedFile, NoDatabase, files_of, known_of, read_every_row,
};
use crate::tasks;

/// Name of the database in a data directory.
pub(super) const DATABASE: &str = "packstone.sqlite";

/// How long a complete file may wait for its row: servers that share a place leave such files alone for an hour.
const UNFINISHED_FOR: Duration = Duration::from_hours(1);

/// Options of `packstone check`.
#[derive(Args)]
pub(super) struct Options {
    /// Data directory of a service, running or not, or a backup of one; or a packing in a file: a result as JSON or as
    /// the service stores it, or a table of grains
    #[arg(value_name = "FOLDER-OR-FILE", default_value = "packstone-data")]
    directory: PathBuf,
    #[command(flatten)]
    packing: PackingOptions,
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
    if directory.is_file() {
        return options.packing.check(directory);
    }
    if let Err(error) = std::fs::metadata(directory) {
        return Err(Exit::BadInput.because(format_args!("{} cannot be read: {error}", directory.display())));
    }
    if options.packing.are_given() {
        let path = directory.display();
        return Err(Exit::BadInput.because(format_args!(
            "{path} is no file: --specimen, --figures, --json and --threads are for packings in files"
        )));
    }
    let (mut faults, files) = match &options.store {
        Some(_) => {
            let database = options.database()?;
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
    let database = match &options.store {
        Some(url) => url.parse().map_err(|error: NoDatabase| format!("--store {error}"))?,
        None => Database::File(directory.join(DATABASE)),
    };
    let read = block_on(async { Ok(read_every_row(&database).await?) })?;
    faults.extend(read.damaged.into_iter().map(|(table, DamagedRow { id, fault })| Found {
        path: format!("{table} {id}").trim_end().to_owned(),
        fault,
    }));
    let files: Arc<[ExpectedFile]> = files.into();
    let compared = block_on(compare(options, &files))?;
    faults.extend(compared.faults);
    for found in &faults {
        print(&format!("{}: {}\n", found.path, found.fault))?;
    }
    for path in &compared.unfinished {
        print(&format!(
            "{path}: not in the database yet, written less than an hour ago for a job or an export that it has; no \
             fault: it is recorded soon, or a service removes it\n"
        ))?;
    }
    let bytes: u64 = files.iter().map(|file| file.bytes).sum();
    print(&format!(
        "{} rows and {} files checked, {} faults ({bytes} bytes compared with the SHA-256 of each file, {} checkpoints with their \
         sums)\n",
        read.rows,
        files.len(),
        faults.len(),
        compared.checkpoints
    ))?;
    if faults.is_empty() { Ok(()) } else { Err(format!("{} faults were found", faults.len()).into()) }
}

impl Options {
    fn database(&self) -> Result<Database, Failure> {
        match &self.store {
            Some(url) => url.parse().map_err(|error: NoDatabase| format!("--store {error}").into()),
            None => Ok(Database::File(self.directory.join(DATABASE))),
        }
    }
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

/// What was found in the files.
struct Compared {
    faults: Vec<Found>,
    /// Complete files that wait for their row, or were left by a service that was killed.
    unfinished: Vec<String>,
    /// Checkpoints that were read.
    checkpoints: usize,
}

/// Compares the files with the database.
async fn compare(options: &Options, files: &Arc<[ExpectedFile]>) -> Result<Compared, Failure> {
    let (blobs, directory, files) = (options.blobs.clone(), options.directory.clone(), Arc::clone(files));
    let has_place = blobs.is_some();
    let compared = tasks::blocking(move || {
        let place: Arc<dyn Blobs> = match blobs {
            Some(place) => place.open(&directory, None)?,
            None => Arc::new(Files::looked_at(directory.clone())),
        };
        let artifacts = Artifacts::new(Arc::clone(&place));
        let faults = verify(&artifacts, &files);
        let unknown = unknown(&artifacts, &files)?;
        let checkpoints = checkpoints::verify_all(&directory.join("checkpoints"))?;
        Ok::<_, Failure>((place, faults, unknown, checkpoints))
    });
    let (place, mut faults, unknown, (checkpoints, damaged)) = compared.await??;
    let ids = unknown.iter().filter_map(|(file, _)| Some(file.attempt()?.0.to_owned())).collect();
    let database = options.database()?;
    let (identity, known) = known_of(&database, &ids).await?;
    let mut unfinished = Vec::new();
    for (file, is_young) in unknown {
        if is_young && file.attempt().is_some_and(|(id, _)| known.contains(id)) {
            unfinished.push(file.path);
        } else {
            faults.push(Found { path: file.path, fault: "the database does not know it".into() });
        }
    }
    for (name, fault) in damaged {
        faults.push(Found { path: format!("checkpoints/{name}"), fault });
    }
    if has_place {
        let ours = Owner { database: identity, store: database.to_string() };
        let owner = tasks::blocking(move || match owner::check(&*place, &ours) {
            // No service has used the place yet.
            Err(OwnerError::Io { error, .. }) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
            checked => checked,
        });
        if let Err(error) = owner.await? {
            faults.push(Found { path: owner::MARK.into(), fault: error.to_string() });
        }
    }
    Ok(Compared { faults, unfinished, checkpoints })
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

/// Complete files that the database does not know, and whether each was written within the last hour.
fn unknown(artifacts: &Artifacts, files: &[ExpectedFile]) -> Result<Vec<(Settled, bool)>, Failure> {
    let known: HashSet<&str> = files.iter().map(|file| file.path.as_str()).collect();
    let young_since = SystemTime::now().checked_sub(UNFINISHED_FOR);
    let is_young =
        |written: Option<SystemTime>| written.is_some_and(|at| young_since.is_none_or(|since| at > since));
    let found = artifacts.dated()?.into_iter().filter(|(file, _)| file.is_complete());
    let found = found.filter(|(file, _)| !known.contains(file.path.as_str()));
    Ok(found.map(|(file, written)| (file, is_young(written))).collect())
}
