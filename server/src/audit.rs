//! The audit log: one line of JSON for each request that changes something.
//!
//! The file is only ever appended to, one line a write. Before each line it is opened anew if the path names another
//! file or none, so that a rotation needs no signal. A line that cannot be written is lost, said in the log and
//! counted; the request it tells of is answered as ever.

use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;

/// What is told of a request.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct AuditEntry {
    /// When the request came (RFC 3339, UTC).
    pub(crate) time: String,
    pub(crate) request_id: String,
    /// Name of the API key; empty where the server asks for none.
    pub(crate) key: String,
    /// Owner of the key; empty where the server asks for none.
    pub(crate) owner: String,
    /// Address of the client.
    pub(crate) address: String,
    /// What the request does: `submit_job`, `delete_study` and so on.
    pub(crate) action: String,
    /// ID of the job or study; `null` where a submission was refused.
    pub(crate) id: Option<String>,
    pub(crate) path: String,
    /// Status of the answer; `null` where the client hung up before, and the change may have been made.
    pub(crate) status: Option<u16>,
}

/// The audit log of a service.
#[derive(Debug)]
pub(crate) struct AuditLog {
    path: PathBuf,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    file: Option<File>,
    /// Whether the last line could not be written, or not as a whole.
    failed: bool,
}

impl AuditLog {
    /// Opens the file, or makes it.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn open(path: PathBuf) -> io::Result<Self> {
        let file = Some(append_to(&path)?);
        Ok(Self { path, state: Mutex::new(State { file, failed: false }) })
    }

    /// Appends a line; returns whether it was written as a whole.
    pub(crate) fn append(&self, entry: &AuditEntry) -> bool {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let written = state.write(&self.path, entry);
        let (failed, path) = (written.is_err(), self.path.display());
        match &written {
            Err(error) if !state.failed => {
                tracing::error!(%error, %path, "the audit log cannot be written; its lines are lost until it can");
            }
            Ok(()) if state.failed => tracing::warn!(%path, "the audit log can be written again"),
            _ => {}
        }
        state.failed = failed;
        !failed
    }
}

impl State {
    fn write(&mut self, path: &Path, entry: &AuditEntry) -> io::Result<()> {
        let mut line = serde_json::to_string(entry)?;
        line.push('\n');
        if self.failed {
            // A line that was written in part must not run into this one.
            line.insert(0, '\n');
        }
        if !self.file.as_ref().is_some_and(|file| is_at(file, path)) {
            self.file = Some(append_to(path)?);
        }
        match &mut self.file {
            Some(file) => file.write_all(line.as_bytes()),
            None => Err(io::Error::from(io::ErrorKind::NotFound)),
        }
    }
}

fn append_to(path: &Path) -> io::Result<File> {
    // It holds names and addresses of people.
    OpenOptions::new().append(true).create(true).mode(0o600).open(path)
}

/// Whether the path still names the open file.
fn is_at(file: &File, path: &Path) -> bool {
    let identity = |metadata: Metadata| (metadata.dev(), metadata.ino());
    let (open, named) = (file.metadata().map(identity), std::fs::metadata(path).map(identity));
    matches!((open, named), (Ok(open), Ok(named)) if open == named)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn entry(id: &str) -> AuditEntry {
        AuditEntry {
            time: "2030-01-01T00:00:00Z".into(),
            request_id: "r".into(),
            key: "a\"b\n".into(),
            owner: "lab".into(),
            address: "127.0.0.1".into(),
            action: "delete_job".into(),
            id: Some(id.into()),
            path: "/v1/jobs/x".into(),
            status: Some(204),
        }
    }

    fn ids(path: &Path) -> Vec<String> {
        let text = std::fs::read_to_string(path).unwrap();
        let lines = text.lines().filter(|line| !line.is_empty());
        lines
            .map(|line| {
                serde_json::from_str::<serde_json::Value>(line).unwrap()["id"].as_str().unwrap().to_owned()
            })
            .collect()
    }

    #[test]
    fn lines_follow_the_path_through_rotations() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let log = AuditLog::open(path.clone()).unwrap();
        assert!(log.append(&entry("1")) && log.append(&entry("2")));
        let rotated = folder.path().join("audit.jsonl.1");
        std::fs::rename(&path, &rotated).unwrap();
        assert!(log.append(&entry("3")));
        // Truncated in place, as `copytruncate` does.
        assert_eq!((ids(&rotated), ids(&path)), (vec!["1".to_owned(), "2".to_owned()], vec!["3".to_owned()]));
        std::fs::write(&path, "").unwrap();
        assert!(log.append(&entry("4")));
        assert_eq!(ids(&path), ["4"]);
        assert_eq!(std::fs::metadata(&rotated).unwrap().mode() & 0o777, 0o600);
        drop(log);
        assert!(AuditLog::open(path.clone()).unwrap().append(&entry("5")));
        assert_eq!(ids(&path), ["4", "5"], "what is there is never overwritten");
    }

    #[test]
    fn what_cannot_be_written_is_told_and_ends_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("logs/audit.jsonl");
        assert!(AuditLog::open(path.clone()).is_err());
        std::fs::create_dir(folder.path().join("logs")).unwrap();
        let log = AuditLog::open(path.clone()).unwrap();
        std::fs::remove_dir_all(folder.path().join("logs")).unwrap();
        assert!(!log.append(&entry("1")) && !log.append(&entry("2")));
        std::fs::create_dir(folder.path().join("logs")).unwrap();
        assert!(log.append(&entry("3")));
        assert_eq!(ids(&path), ["3"]);
        // A full device.
        let log = AuditLog::open("/dev/full".into()).unwrap();
        assert!(!log.append(&entry("1")));
    }
}
