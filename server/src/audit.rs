//! The audit log: one line of JSON for each request that changes something.
//!
//! The file is only ever appended to, one line a write, by a thread of its own. Before each line it is opened again if
//! the path names another file or none, so that a rotation needs no signal. A line is written before the answer of its
//! request is sent, but no answer waits for a log that hangs: after one answer has waited for [`ANSWER_WAITS`], no
//! further one waits until the log takes lines again. A line that cannot be written, or for which the queue has no
//! room, is lost, counted, and said in the log of the service; its request is answered as ever.

use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::time::Duration;

use rustix::fs::OFlags;
use rustix::io::Errno;
use serde::Serialize;
use tokio::sync::oneshot;

use crate::metrics::Metrics;

/// Longest time that an answer waits for its line to be written.
const ANSWER_WAITS: Duration = Duration::from_millis(250);
/// Time for the last lines to be written when the service ends.
const CLOSE_WITHIN: Duration = Duration::from_secs(1);
/// Most lines that wait to be written.
const MOST_QUEUED: usize = 10_000;

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

/// A line on its way to the file; the sender is dropped once the line is written or lost.
#[derive(Debug)]
struct Line {
    text: String,
    _done: oneshot::Sender<()>,
}

/// The audit log of a service.
#[derive(Debug)]
pub(crate) struct AuditLog {
    path: PathBuf,
    sender: SyncSender<Line>,
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    metrics: Arc<Metrics>,
    /// Lines that wait to be written.
    queued: AtomicUsize,
    /// Whether an answer has waited in vain: further ones do not wait until a line is written.
    hangs: AtomicBool,
    /// Whether the queue had no room for the last line.
    is_full: AtomicBool,
}

impl AuditLog {
    /// Opens the file, or makes it, and starts the thread that writes it. A pipe that nobody reads is opened once
    /// somebody does.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn open(path: PathBuf, metrics: Arc<Metrics>) -> io::Result<Self> {
        match append_to(&path, OFlags::NONBLOCK) {
            Err(error) if error.raw_os_error() == Some(Errno::NXIO.raw_os_error()) => {
                tracing::warn!(path = %path.display(), "nobody reads the pipe of the audit log yet");
            }
            opened => drop(opened?),
        }
        let (sender, receiver) = mpsc::sync_channel(MOST_QUEUED);
        let shared = Arc::new(Shared {
            metrics,
            queued: AtomicUsize::default(),
            hangs: AtomicBool::default(),
            is_full: AtomicBool::default(),
        });
        let (file, of_thread) = (path.clone(), Arc::clone(&shared));
        let thread = std::thread::Builder::new().name("audit log".into());
        thread.spawn(move || write_lines(&file, &receiver, &of_thread))?;
        Ok(Self { path, sender, shared })
    }

    /// Hands a line to the thread that writes it. What is returned ends once the line is written or lost.
    pub(crate) fn append(&self, entry: &AuditEntry) -> Option<oneshot::Receiver<()>> {
        let (done, written) = oneshot::channel();
        let mut text = serde_json::to_string(entry).unwrap_or_default();
        text.push('\n');
        self.shared.queued.fetch_add(1, Ordering::AcqRel);
        match self.sender.try_send(Line { text, _done: done }) {
            Ok(()) => {
                self.shared.is_full.store(false, Ordering::Release);
                Some(written)
            }
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {
                self.shared.queued.fetch_sub(1, Ordering::AcqRel);
                self.shared.metrics.audit_line_lost();
                if !self.shared.is_full.swap(true, Ordering::AcqRel) {
                    let path = self.path.display();
                    tracing::error!(%path, "the audit log takes no lines, {MOST_QUEUED} wait, further ones are lost");
                }
                None
            }
        }
    }

    /// Appends a line, and waits until it is written or lost unless the log hangs.
    pub(crate) async fn append_and_wait(&self, entry: &AuditEntry) {
        let Some(written) = self.append(entry) else { return };
        if self.shared.hangs.load(Ordering::Acquire) {
            return;
        }
        if tokio::time::timeout(ANSWER_WAITS, written).await.is_err()
            && !self.shared.hangs.swap(true, Ordering::AcqRel)
        {
            let path = self.path.display();
            tracing::error!(%path, "the audit log takes no lines; answers do not wait for it");
        }
    }

    /// Waits a moment for the last lines to be written, at the end of the service. Blocks the thread.
    pub(crate) fn close(&self) {
        let begin = std::time::Instant::now();
        loop {
            let queued = self.shared.queued.load(Ordering::Acquire);
            if queued == 0 {
                return;
            }
            if begin.elapsed() >= CLOSE_WITHIN {
                let path = self.path.display();
                tracing::error!(%path, lines = queued, "the audit log takes no lines; the last ones are lost");
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Writes lines until the service has ended.
fn write_lines(path: &Path, receiver: &Receiver<Line>, shared: &Shared) {
    let mut state = State::default();
    while let Ok(line) = receiver.recv() {
        let written = state.write(path, &line.text);
        let (failed, path) = (written.is_err(), path.display());
        match &written {
            Err(error) if !state.failed => {
                tracing::error!(%error, %path, "the audit log cannot be written; its lines are lost until it can");
            }
            Ok(()) if state.failed || shared.hangs.load(Ordering::Acquire) => {
                tracing::warn!(%path, "the audit log can be written again");
            }
            _ => {}
        }
        state.failed = failed;
        if failed {
            shared.metrics.audit_line_lost();
            // A pipe whose reader has left is opened again for the next line.
            state.file = None;
        }
        shared.hangs.store(false, Ordering::Release);
        shared.queued.fetch_sub(1, Ordering::AcqRel);
    }
}

#[derive(Debug, Default)]
struct State {
    file: Option<File>,
    /// Whether the last line could not be written, or not as a whole.
    failed: bool,
}

impl State {
    fn write(&mut self, path: &Path, line: &str) -> io::Result<()> {
        // A line that was written in part must not run into this one.
        let begin = if self.failed { "\n" } else { "" };
        if !self.file.as_ref().is_some_and(|file| is_at(file, path)) {
            self.file = Some(append_to(path, OFlags::empty())?);
        }
        match &mut self.file {
            Some(file) => file.write_all(format!("{begin}{line}").as_bytes()),
            None => Err(io::Error::from(io::ErrorKind::NotFound)),
        }
    }
}

fn append_to(path: &Path, flags: OFlags) -> io::Result<File> {
    let flags = flags.bits().cast_signed();
    // It holds names and addresses of people.
    OpenOptions::new().append(true).create(true).mode(0o600).custom_flags(flags).open(path)
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

    fn open(path: &Path) -> io::Result<AuditLog> {
        AuditLog::open(path.to_owned(), Arc::default())
    }

    /// Appends a line and waits until it is written or lost; returns the number of lines lost so far.
    fn append(log: &AuditLog, id: &str) -> u64 {
        // The sender is dropped, not used.
        let _ = log.append(&entry(id)).unwrap().blocking_recv();
        log.close();
        log.shared.metrics.audit_lines_lost()
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
        let log = open(&path).unwrap();
        assert_eq!((append(&log, "1"), append(&log, "2")), (0, 0));
        let rotated = folder.path().join("audit.jsonl.1");
        std::fs::rename(&path, &rotated).unwrap();
        assert_eq!(append(&log, "3"), 0);
        // Truncated in place, as `copytruncate` does.
        assert_eq!((ids(&rotated), ids(&path)), (vec!["1".to_owned(), "2".to_owned()], vec!["3".to_owned()]));
        std::fs::write(&path, "").unwrap();
        assert_eq!(append(&log, "4"), 0);
        assert_eq!(ids(&path), ["4"]);
        assert_eq!(std::fs::metadata(&rotated).unwrap().mode() & 0o777, 0o600);
        drop(log);
        assert_eq!(append(&open(&path).unwrap(), "5"), 0);
        assert_eq!(ids(&path), ["4", "5"], "what is there is never overwritten");
    }

    #[test]
    fn what_cannot_be_written_is_counted_and_ends_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("logs/audit.jsonl");
        assert!(open(&path).is_err());
        std::fs::create_dir(folder.path().join("logs")).unwrap();
        let log = open(&path).unwrap();
        std::fs::remove_dir_all(folder.path().join("logs")).unwrap();
        assert_eq!((append(&log, "1"), append(&log, "2")), (1, 2));
        std::fs::create_dir(folder.path().join("logs")).unwrap();
        assert_eq!(append(&log, "3"), 2);
        assert_eq!(ids(&path), ["3"]);
        // A full device.
        assert_eq!(append(&open(Path::new("/dev/full")).unwrap(), "1"), 1);
    }

    #[tokio::test]
    async fn a_pipe_that_nobody_reads_holds_up_one_answer_for_a_moment_and_loses_what_has_no_room() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let log = open(&path).unwrap();
        let begin = std::time::Instant::now();
        for i in 0..MOST_QUEUED + 50 {
            log.append_and_wait(&entry(&i.to_string())).await;
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "{:?}", begin.elapsed());
        let lost = log.shared.metrics.audit_lines_lost();
        // The thread holds one line more.
        assert!((48..=50).contains(&lost), "{lost}");
        let reader = path.clone();
        let read = std::thread::spawn(move || {
            let mut lines = io::BufRead::lines(io::BufReader::new(File::open(reader).unwrap()));
            (0..MOST_QUEUED).map(|_| lines.next().unwrap().unwrap()).collect::<Vec<_>>()
        });
        let read = tokio::task::spawn_blocking(move || read.join().unwrap()).await.unwrap();
        assert!(
            read[0].contains("\"id\":\"0\"") && read.len() == MOST_QUEUED,
            "the lines that wait are written"
        );
    }
}
