//! `packstone check`: whether every file of a data directory is what the database says, and the database sound.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use clap::Args;
use sha2::{Digest, Sha256};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection as _, Row as _, SqliteConnection};

use super::{Failure, block_on, print};
use crate::artifacts::Artifacts;
use crate::hex;

/// Name of the database in a data directory.
pub(super) const DATABASE: &str = "packstone.sqlite";
const BLOCK_BYTES: usize = 1 << 16;

/// Options of `packstone check`.
#[derive(Args)]
pub(super) struct Options {
    /// Data directory of a service, running or not, or a backup of one
    #[arg(default_value = "packstone-data")]
    directory: PathBuf,
}

/// A file that the database refers to.
pub(super) struct Expected {
    pub(super) path: String,
    bytes: u64,
    sha256: String,
}

/// Something that is wrong.
pub(super) struct Found {
    pub(super) path: String,
    pub(super) fault: String,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let directory = &options.directory;
    if !directory.join(DATABASE).is_file() {
        return Err(format!("{} is no data directory: it holds no {DATABASE}", directory.display()).into());
    }
    let mut faults: Vec<Found> = block_on(integrity(directory))?
        .into_iter()
        .map(|fault| Found { path: DATABASE.into(), fault })
        .collect();
    let files = block_on(files(directory))?;
    faults.extend(verify(directory, &files));
    faults.extend(unknown(directory, &files)?);
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

/// All files that the database refers to.
pub(super) async fn files(directory: &Path) -> Result<Vec<Expected>, Failure> {
    let mut connection = open(directory).await?;
    let rows = sqlx::query(
        "select path, bytes, sha256 from artifacts
         union all select path, bytes, sha256 from exports where path is not null order by path",
    )
    .fetch_all(&mut connection)
    .await?;
    connection.close().await?;
    let file = |row: &sqlx::sqlite::SqliteRow| -> Result<Expected, sqlx::Error> {
        let bytes = row.try_get::<i64, _>("bytes")?.cast_unsigned();
        Ok(Expected { path: row.try_get("path")?, bytes, sha256: row.try_get("sha256")? })
    };
    Ok(rows.iter().map(file).collect::<Result<_, _>>()?)
}

/// Compares each file with its length and digest.
pub(super) fn verify(directory: &Path, files: &[Expected]) -> Vec<Found> {
    let fault = |file: &Expected| match digest(&directory.join("artifacts").join(&file.path)) {
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
fn unknown(directory: &Path, files: &[Expected]) -> Result<Vec<Found>, Failure> {
    let root = directory.join("artifacts");
    if !root.is_dir() {
        return Ok(Vec::new());
    }
    let known: std::collections::HashSet<&str> = files.iter().map(|file| file.path.as_str()).collect();
    let found = Artifacts::open(root)?.settled()?.into_iter().filter(|(path, complete)| path == complete);
    Ok(found
        .filter(|(path, _)| !known.contains(path.as_str()))
        .map(|(path, _)| Found { path, fault: "the database does not know it".into() })
        .collect())
}

fn digest(path: &Path) -> io::Result<(u64, String)> {
    let mut file = File::open(path)?;
    let (mut digest, mut block, mut bytes) = (Sha256::new(), vec![0; BLOCK_BYTES], 0);
    loop {
        let read = file.read(&mut block)?;
        if read == 0 {
            return Ok((bytes, hex::encode(&digest.finalize())));
        }
        digest.update(&block[..read]);
        bytes += read as u64;
    }
}
