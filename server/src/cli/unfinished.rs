//! The record of a command that is about to write several files: what an interruption left may be replaced.
//!
//! The record lies beside the first file, from before that file is written until all are. Where it is found, the files
//! that it names are parts of a result that was never finished, and the same command replaces them; without it they are
//! somebody's, and no command overwrites them. It holds the request as well, whose seed may have been drawn. Beside a
//! partial packing it stays, so that a run that goes on may replace its files.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::exit::{Exit, Failure, cannot_be};
use super::outputs::beside;
use crate::atomic_file::{partial_of, write_buffered};

/// Ending of the name of the record.
const ENDING: &str = "unfinished";

/// What the record says.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Record {
    /// The request of the packing, with its seed; `null` of a command that has none.
    pub(super) request: Option<Value>,
    /// Names of the files that the command writes, in the folder of the record.
    files: Vec<PathBuf>,
    /// Whether all of them are written, and the packing is partial: a run that goes on replaces them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) partial: bool,
}

impl Record {
    /// Whether the command that left this record was to write a file.
    pub(super) fn names(&self, file: &Path) -> bool {
        self.files.iter().any(|name| Some(name.as_os_str()) == file.file_name())
    }

    /// Removes what the command left, the record last.
    pub(super) fn discard(&self, unfinished: &Unfinished) -> Result<(), Failure> {
        for name in &self.files {
            let file = unfinished.0.with_file_name(name);
            remove(&partial_of(&file)).map_err(|error| cannot_be("removed", &file, &error))?;
        }
        unfinished.end()
    }
}

/// The place of the record of a command.
#[derive(Debug)]
pub(super) struct Unfinished(PathBuf);

impl Unfinished {
    /// That of a command whose first file is this one.
    pub(super) fn beside(first: &Path) -> Self {
        Self(beside(first, ENDING))
    }

    /// Where the record lies.
    pub(super) fn path(&self) -> &Path {
        &self.0
    }

    /// The record that an earlier command left, if there is one.
    pub(super) fn read(&self) -> Result<Option<Record>, Failure> {
        let path = &self.0;
        match fs::read(path) {
            Ok(text) => serde_json::from_slice(&text).map(Some).map_err(|error| {
                Exit::BadInput.because(format_args!("{} is damaged: {error}; remove it", path.display()))
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(cannot_be("read", path, &error)),
        }
    }

    /// Writes the record of these files, which lie in its folder.
    pub(super) fn begin(&self, files: &[PathBuf], request: Option<Value>) -> Result<(), Failure> {
        self.write(files, request, false)
    }

    /// Leaves the record of these files, all of which are written, of a packing that is partial.
    pub(super) fn end_partial(&self, files: &[PathBuf], request: Option<Value>) -> Result<(), Failure> {
        self.write(files, request, true)
    }

    fn write(&self, files: &[PathBuf], request: Option<Value>, partial: bool) -> Result<(), Failure> {
        let files = files.iter().filter_map(|file| Some(PathBuf::from(file.file_name()?))).collect();
        let text = serde_json::to_vec_pretty(&Record { request, files, partial })?;
        write_buffered(&self.0, |out| out.write_all(&text))
            .map_err(|error| cannot_be("written", &self.0, &error))
    }

    /// Removes the record: all files are written, or the command failed and will fail again.
    pub(super) fn end(&self) -> Result<(), Failure> {
        let removed = remove(&partial_of(&self.0)).and_then(|()| remove(&self.0));
        removed.map_err(|error| cannot_be("removed", &self.0, &error))
    }

    /// Ends a command: the record stays where the files can be written by the same command later.
    pub(super) fn ended<T>(&self, written: Result<T, Failure>) -> Result<T, Failure> {
        match &written {
            Err(failure) if Exit::may_pass(failure) => {}
            _ => self.end()?,
        }
        written
    }
}

/// Removes a file. A missing one is as good as removed.
pub(super) fn remove(file: &Path) -> io::Result<()> {
    match fs::remove_file(file) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
