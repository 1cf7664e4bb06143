//! `packstone backup`: a consistent copy of a data directory, of a running service too.
//!
//! The database is copied first, by SQLite's `VACUUM INTO`; results and exports after it, by hard link where the target
//! lies on the same file system. A file is never changed once it has its name, so that each copy is whole; what is
//! deleted meanwhile is missing, and said to be.

use std::path::{Path, PathBuf};

use clap::Args;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, SqliteConnection};

use super::check::{self, Found};
use super::{Failure, block_on, print};
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
    let Options { directory, data_dir, blobs } = options;
    if directory.exists() {
        return Err(
            format!("{} exists already: a backup goes into a new directory", directory.display()).into()
        );
    }
    std::fs::create_dir_all(directory)?;
    block_on(copy_database(data_dir, directory))?;
    if let Some(place) = blobs {
        print(&format!("copied the database to {}; the files stay at {place}\n", directory.display()))?;
        return Ok(());
    }
    let files = block_on(check::files(directory))?;
    let (mut copied, mut missing) = (0_u64, Vec::new());
    for file in &files {
        let from = data_dir.join("artifacts").join(&file.path);
        let to = directory.join("artifacts").join(&file.path);
        if let Some(folder) = to.parent() {
            std::fs::create_dir_all(folder)?;
        }
        match std::fs::hard_link(&from, &to).or_else(|_| std::fs::copy(&from, &to).map(|_| ())) {
            Ok(()) => copied += 1,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => missing.push(file.path.clone()),
            Err(error) => return Err(format!("{} was not copied: {error}", from.display()).into()),
        }
    }
    let faults: Vec<Found> = check::verify(&check::in_directory(directory), &files)
        .into_iter()
        .filter(|found| !missing.contains(&found.path))
        .collect();
    for found in &faults {
        print(&format!("{}: {}\n", found.path, found.fault))?;
    }
    for path in &missing {
        print(&format!("{path}: deleted while the backup was made\n"))?;
    }
    print(&format!("copied the database and {copied} files to {}\n", directory.display()))?;
    match faults.len() {
        0 => Ok(()),
        faults => Err(format!("{faults} files are damaged").into()),
    }
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
    sqlx::query("vacuum into ?").bind(to).execute(&mut connection).await?;
    Ok(connection.close().await?)
}
