//! `packstone backup`: a consistent copy of a data directory, of a running service too.
//!
//! The database is copied first, by SQLite's `VACUUM INTO`; results and exports after it, by hard link where the target
//! lies on the same file system. A file is never changed once it has its name, so that each copy is whole; what is
//! deleted meanwhile is missing, and said to be. The backup has its name once it is whole; until then, its directory is
//! called `DIRECTORY.tmp`.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use clap::Args;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};

use super::check::{self, Found};
use super::exit::{Exit, Failure, cannot_be};
use super::{block_on, print};
use crate::atomic_file::{partial_of, sync_folder};
use crate::blobs::Place;

/// Options of `packstone backup`.
#[derive(Args)]
pub(super) struct Options {
    /// Directory of the backup; must not exist
    directory: PathBuf,
    /// Data directory of the service
    #[arg(long, env = "PACKSTONE_DATA_DIR", default_value = "packstone-data")]
    data_dir: PathBuf,
    /// Where the service keeps results and exports, if not in its data directory; they are left there, and the backup
    /// is one of the database
    #[arg(long, env = "PACKSTONE_BLOBS", value_name = "FOLDER-OR-URL", value_parser = Place::read)]
    blobs: Option<Place>,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let directory = &options.directory;
    if directory.exists() {
        return Err(
            format!("{} exists already: a backup goes into a new directory", directory.display()).into()
        );
    }
    let partial = partial_of(directory);
    let lock = begin(&partial)?;
    let made = copy(options, &partial).and_then(|copied| {
        // All files of the backup reach the disk before it has its name.
        rustix::fs::syncfs(&lock)
            .map_err(std::io::Error::from)
            .and_then(|()| std::fs::rename(&partial, directory))
            .and_then(|()| directory.parent().map_or(Ok(()), sync_folder))
            .map_err(|error| cannot_be("written", directory, &error))?;
        Ok(copied)
    });
    if made.is_err() {
        // The space of what a full disk cut off is freed.
        let _ = std::fs::remove_dir_all(&partial);
    }
    made?.report(options)
}

/// Makes the directory of a backup that is under way. What a backup that was stopped left there is removed.
fn begin(partial: &Path) -> Result<File, Failure> {
    let failed = |error: std::io::Error| cannot_be("made", partial, &error);
    std::fs::create_dir_all(partial).map_err(failed)?;
    let lock = File::open(partial).map_err(failed)?;
    if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
        return Err(format!("another backup is writing {}", partial.display()).into());
    }
    for entry in std::fs::read_dir(partial).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let removed =
            if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        removed.map_err(failed)?;
    }
    Ok(lock)
}

/// What was copied, and what was found wrong with it.
#[derive(Default)]
struct Copied {
    files: u64,
    missing: Vec<String>,
    faults: Vec<Found>,
}

impl Copied {
    fn report(&self, options: &Options) -> Result<(), Failure> {
        let directory = options.directory.display();
        if let Some(place) = &options.blobs {
            return print(&format!("copied the database to {directory}; the files stay at {place}\n"));
        }
        for found in &self.faults {
            print(&format!("{}: {}\n", found.path, found.fault))?;
        }
        for path in &self.missing {
            print(&format!("{path}: deleted while the backup was made\n"))?;
        }
        print(&format!("copied the database and {} files to {directory}\n", self.files))?;
        match self.faults.len() {
            0 => Ok(()),
            faults => Err(format!("{faults} files are damaged").into()),
        }
    }
}

/// Copies database and files to a directory that exists.
fn copy(options: &Options, directory: &Path) -> Result<Copied, Failure> {
    block_on(copy_database(&options.data_dir, directory))?;
    if options.blobs.is_some() {
        return Ok(Copied::default());
    }
    let files = block_on(check::files(directory))?;
    let (mut copied, mut missing) = (0_u64, Vec::new());
    for file in &files {
        let from = options.data_dir.join("artifacts").join(&file.path);
        let to = directory.join("artifacts").join(&file.path);
        if let Some(folder) = to.parent() {
            std::fs::create_dir_all(folder).map_err(|error| cannot_be("made", folder, &error))?;
        }
        match std::fs::hard_link(&from, &to).or_else(|_| std::fs::copy(&from, &to).map(|_| ())) {
            Ok(()) => copied += 1,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => missing.push(file.path.clone()),
            Err(error) => return Err(cannot_be("copied", &from, &error)),
        }
    }
    let faults: Vec<Found> = check::verify(&check::in_directory(directory), &files)
        .into_iter()
        .filter(|found| !missing.contains(&found.path))
        .collect();
    Ok(Copied { files: copied, missing, faults })
}

async fn copy_database(data_dir: &Path, directory: &Path) -> Result<(), Failure> {
    let from = data_dir.join(check::DATABASE);
    if !from.is_file() {
        return Err(
            format!("{} is no data directory: it holds no {}", data_dir.display(), check::DATABASE).into()
        );
    }
    let options = SqliteConnectOptions::new().filename(from).create_if_missing(false);
    let mut connection = SqliteConnection::connect_with(&options).await?;
    let to = directory.join(check::DATABASE);
    let to = to.to_str().ok_or("the name of the directory is not UTF-8")?.to_owned();
    sqlx::query("vacuum into ?").bind(&to).execute(&mut connection).await.map_err(|error| {
        let exit = if is_fault_of_machine(&error) { Exit::Machine } else { Exit::Unexpected };
        exit.because(format_args!("the database cannot be copied to {to}: {error}"))
    })?;
    connection.close().await?;
    // In the place of the file of a service that runs, the copy is told from it.
    let copy = SqliteConnectOptions::new().filename(&to).create_if_missing(false);
    let mut connection = SqliteConnection::connect_with(&copy).await?;
    sqlx::query("update packstone set run = ''").execute(&mut connection).await.map_err(|error| {
        let exit = if is_fault_of_machine(&error) { Exit::Machine } else { Exit::Unexpected };
        exit.because(format_args!("the copy {to} of the database cannot be marked as one: {error}"))
    })?;
    Ok(connection.close().await?)
}

/// Whether an error of SQLite is one of the machine: no space, no memory, a disk that fails.
fn is_fault_of_machine(error: &sqlx::Error) -> bool {
    const OUT_OF_MEMORY: i32 = 7;
    const IO_ERROR: i32 = 10;
    const FULL: i32 = 13;
    let code = error.as_database_error().and_then(|error| error.code()?.parse::<i32>().ok());
    // The low byte is the primary code (sqlite.org/rescode.html).
    code.is_some_and(|code| [OUT_OF_MEMORY, IO_ERROR, FULL].contains(&(code & 0xff)))
}
