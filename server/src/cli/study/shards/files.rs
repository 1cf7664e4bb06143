//! The files of a study that several processes make in one folder: each has its name only once it is complete, and what
//! dead processes left is removed by the merge of a complete study.

use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use uuid::Uuid;

use crate::atomic_file::{self, PARTIAL};
use crate::cli::process::Process;

/// Name of the folder of the claims, in that of the study.
pub(in super::super) const FOLDER: &str = "shards";
/// Ending of the file of a process's signs of life.
pub(super) const BEAT: &str = ".beat";
/// The folder of a merge of another machine is abandoned after this time.
const ABANDONED_AFTER: Duration = Duration::from_hours(1);
/// What the name of the folder of a merge begins with.
const MERGE: &str = "merge.";

/// The folder in which a merge makes its files; its name tells the process.
pub(in super::super) fn merge_staging(out: &Path) -> io::Result<PathBuf> {
    let mark = Process::current().mark().unwrap_or_default();
    let name = format!("{MERGE}{}.{mark}{PARTIAL}", Uuid::now_v7().simple());
    let folder = out.join(FOLDER).join(name);
    fs::create_dir_all(&folder).map_err(|error| named(&folder, "made", &error))?;
    Ok(folder)
}

/// Whether the folder of a merge belongs to no merge that still runs, as far as its process or its age tells.
fn is_abandoned(folder: &Path) -> bool {
    let name = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mark = name.trim_end_matches(PARTIAL).rsplit('.').next().unwrap_or_default();
    if let Some(is_alive) = Process::is_alive_by(mark) {
        return !is_alive;
    }
    let age = fs::metadata(folder).and_then(|found| found.modified()).map(|changed| changed.elapsed());
    age.is_ok_and(|age| age.is_ok_and(|age| age >= ABANDONED_AFTER))
}

/// Removes what dead processes left of a study that is complete: signs of life and incomplete results.
pub(in super::super) fn tidy(out: &Path) -> io::Result<()> {
    for entry in fs::read_dir(out.join(FOLDER))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        // What fails was removed by another merge.
        let is_partial = name.ends_with(PARTIAL) && (!name.starts_with(MERGE) || is_abandoned(&entry.path()));
        let _ = if name.ends_with(BEAT) {
            fs::remove_file(entry.path())
        } else if is_partial {
            // The folder of a result, or a file that was being made.
            fs::remove_dir_all(entry.path()).or_else(|_| fs::remove_file(entry.path()))
        } else {
            Ok(())
        };
    }
    Ok(())
}

/// Moves the files of a folder to another one on the same disk, each at once, and removes the folder.
pub(in super::super) fn publish(from: &Path, to: &Path) -> io::Result<()> {
    let mut moved = false;
    for entry in fs::read_dir(from).map_err(|error| named(from, "read", &error))? {
        let entry = entry?;
        if !moved {
            fs::create_dir_all(to).map_err(|error| named(to, "made", &error))?;
            moved = true;
        }
        let file = to.join(entry.file_name());
        fs::rename(entry.path(), &file).map_err(|error| named(&file, "written", &error))?;
    }
    if moved {
        atomic_file::sync_folder(to)?;
    }
    fs::remove_dir(from)
}

/// Creates a file of the study in `out` if there is none. Returns whether it did. The file has its name only once it is
/// complete, so that a process that is killed meanwhile leaves none that others would wait for.
pub(super) fn create(out: &Path, path: &Path, bytes: &[u8]) -> io::Result<bool> {
    let claims = out.join(FOLDER);
    fs::create_dir_all(&claims).map_err(|error| named(&claims, "made", &error))?;
    let partial = claims.join(format!("{}{PARTIAL}", Uuid::now_v7().simple()));
    let write = || {
        let mut file = OpenOptions::new().write(true).create_new(true).open(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()
    };
    let made = write().map_err(|error| named(path, "made", &error)).and_then(|()| {
        match fs::hard_link(&partial, path) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
            // A disk without hard links.
            Err(_) => create_in_place(path, bytes),
        }
    });
    let _ = fs::remove_file(&partial);
    if matches!(made, Ok(true))
        && let Some(folder) = path.parent()
    {
        atomic_file::sync_folder(folder)?;
    }
    made
}

fn create_in_place(path: &Path, bytes: &[u8]) -> io::Result<bool> {
    match OpenOptions::new().write(true).create_new(true).open(path) {
        Ok(mut file) => {
            file.write_all(bytes)?;
            file.sync_all()?;
            Ok(true)
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(named(path, "made", &error)),
    }
}

/// An error of the system that names the file, which cannot be `read`, `made` or `written`.
pub(super) fn named(path: &Path, participle: &str, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{} cannot be {participle}: {error}", path.display()))
}
