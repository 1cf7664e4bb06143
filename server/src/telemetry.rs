//! Logs: one line an event on standard error, as text or as JSON.
//!
//! Standard output is for what a command was asked for. Nothing that is said on standard error holds up the program: a
//! thread of its own writes the lines ([`Writer`]). A line that cannot be written, to a full disk or a closed pipe, is
//! lost, and so is one for which the queue has no room because nobody reads the pipe; lost lines are counted, and the
//! log says how many once lines can be written again. `eprintln!` would block or panic, and the panic hook, which logs
//! as well, would end the process with signal 6.

use std::fs::File;
use std::io::{self, IsTerminal as _, Write};
use std::os::fd::AsFd as _;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::{ParseError, Targets};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Variable that holds the filter.
pub(crate) const FILTER_VARIABLE: &str = "PACKSTONE_LOG";
/// Most bytes of lines that wait to be written.
const MOST_QUEUED_BYTES: usize = 4 << 20;
/// Time for the last lines to be written at the end of the process.
const FLUSH_WITHIN: Duration = Duration::from_millis(500);
/// Pause before a stream that takes nothing at the moment, and does not block, is tried again.
const TRY_AGAIN: Duration = Duration::from_millis(20);

/// Form of the log lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// For machines, one object a line.
    Json,
}

/// What the thread that writes receives.
enum Message {
    Lines(Vec<u8>),
    /// Answered when all lines before it are written or lost.
    Flush(Sender<()>),
}

/// Writes lines by a thread of its own, so that no caller waits for the stream.
struct Writer {
    sender: Sender<Message>,
    counts: Arc<Counts>,
}

#[derive(Default)]
struct Counts {
    /// Bytes of lines that wait to be written.
    queued_bytes: AtomicUsize,
    /// Lines that were lost.
    lost: AtomicU64,
}

impl Writer {
    /// Starts the thread; `None` where the system allows none.
    fn start(stream: impl Write + Send + 'static) -> Option<Self> {
        let (sender, receiver) = mpsc::channel();
        let counts = Arc::new(Counts::default());
        let shared = Arc::clone(&counts);
        let thread = std::thread::Builder::new().name("log".into());
        thread.spawn(move || write_all(stream, &receiver, &shared)).ok()?;
        Some(Self { sender, counts })
    }

    /// Takes lines to be written, or loses them where too many wait.
    fn take(&self, lines: &[u8]) {
        let bytes = lines.len();
        let before = self.counts.queued_bytes.fetch_add(bytes, Ordering::AcqRel);
        let is_full = before + bytes > MOST_QUEUED_BYTES;
        if is_full || self.sender.send(Message::Lines(lines.to_vec())).is_err() {
            self.counts.queued_bytes.fetch_sub(bytes, Ordering::AcqRel);
            self.counts.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits until what was taken is written or lost, at most so long.
    fn flush(&self, within: Duration) {
        let (done, flushed) = mpsc::channel();
        if self.sender.send(Message::Flush(done)).is_ok() {
            let _ = flushed.recv_timeout(within);
        }
    }
}

/// Writes lines as they come. Once some can be written after others were lost, it says how many were.
fn write_all(mut stream: impl Write, receiver: &Receiver<Message>, counts: &Counts) {
    let (mut is_broken, mut told) = (false, 0);
    while let Ok(message) = receiver.recv() {
        let lines = match message {
            Message::Lines(lines) => lines,
            Message::Flush(done) => {
                let _ = done.send(());
                continue;
            }
        };
        // A line that was written in part must not run into this one.
        let begin: &[u8] = if is_broken { b"\n" } else { b"" };
        let written = write_patiently(&mut stream, begin).and_then(|()| write_patiently(&mut stream, &lines));
        counts.queued_bytes.fetch_sub(lines.len(), Ordering::AcqRel);
        is_broken = written.is_err();
        if is_broken {
            counts.lost.fetch_add(1, Ordering::Relaxed);
            continue;
        }
        let lost = counts.lost.load(Ordering::Relaxed);
        if lost > told {
            tracing::warn!(lost = lost - told, "lines of the log were lost: standard error took none");
            told = lost;
        }
    }
}

/// Writes all bytes, to a stream too that another program has set not to block.
fn write_patiently(stream: &mut impl Write, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match stream.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(written) => bytes = &bytes[written..],
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(TRY_AGAIN),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// The writer of standard error; `None` where it has no thread.
fn writer() -> Option<&'static Writer> {
    static WRITER: OnceLock<Option<Writer>> = OnceLock::new();
    // A handle of its own: the lock of `io::stderr` would be held while the thread waits for the stream.
    let start = || Writer::start(File::from(io::stderr().as_fd().try_clone_to_owned().ok()?));
    WRITER.get_or_init(start).as_ref()
}

/// Standard error as a writer whose failures the caller does not see, and for which it does not wait.
struct StandardError;

impl Write for StandardError {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match writer() {
            Some(writer) => writer.take(bytes),
            // Better late than never.
            None => drop(io::stderr().write_all(bytes)),
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes a line to standard error; one that cannot be written is lost.
pub(crate) fn say(line: &str) {
    let _ = StandardError.write_all(format!("{line}\n").as_bytes());
}

/// Waits a moment for the last lines to be written: before the process ends.
pub(crate) fn flush() {
    if let Some(writer) = writer() {
        writer.flush(FLUSH_WITHIN);
    }
}

/// Lines of the log that were lost since the start.
pub(crate) fn lost_lines() -> u64 {
    writer().map_or(0, |writer| writer.counts.lost.load(Ordering::Relaxed))
}

/// The levels by target that a text such as `info` or `packstone_server=debug,sqlx=warn` names. Targets that it does
/// not name log warnings and errors.
fn levels(text: &str) -> Result<Targets, ParseError> {
    let targets = text.parse::<Targets>()?;
    Ok(match targets.default_level() {
        Some(_) => targets,
        None => targets.with_default(LevelFilter::WARN),
    })
}

/// Starts to log. `default_filter` holds where `PACKSTONE_LOG` is not set, is empty or cannot be read.
pub(crate) fn start(format: LogFormat, default_filter: &str) {
    let named = std::env::var(FILTER_VARIABLE).ok().filter(|text| !text.is_empty()).map(|text| levels(&text));
    let filter = match &named {
        Some(Ok(filter)) => filter.clone(),
        _ => levels(default_filter).unwrap_or_else(|_| Targets::new().with_default(LevelFilter::INFO)),
    };
    let lines = tracing_subscriber::fmt::layer()
        .with_ansi(io::stderr().is_terminal())
        // Its default is to report a failed write by `eprintln!`.
        .log_internal_errors(false)
        .with_writer(|| StandardError);
    let registry = tracing_subscriber::registry().with(filter);
    // A second start, in tests, keeps the first.
    let _ = match format {
        LogFormat::Text => registry.with(lines).try_init(),
        LogFormat::Json => registry.with(lines.json()).try_init(),
    };
    if let Some(Err(error)) = named {
        tracing::warn!(%error, filter = default_filter, "{FILTER_VARIABLE} cannot be read, the default filter holds");
    }
    std::panic::set_hook(Box::new(|panic| {
        let at = panic.location().map(ToString::to_string).unwrap_or_default();
        tracing::error!(at, message = panic.payload_as_str().unwrap_or("no message"), "panic");
    }));
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Mutex;

    use tracing::Level;

    use super::*;

    /// A stream that takes nothing until it is opened, as a full pipe that nobody reads.
    #[derive(Clone, Default)]
    struct Pipe {
        is_open: Arc<std::sync::atomic::AtomicBool>,
        taken: Arc<Mutex<Vec<u8>>>,
    }

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if !self.is_open.load(Ordering::Acquire) {
                return Err(io::ErrorKind::WouldBlock.into());
            }
            self.taken.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_stream_that_takes_nothing_holds_up_nobody_and_loses_counted_lines() {
        let pipe = Pipe::default();
        let writer = Writer::start(pipe.clone()).unwrap();
        let line = [b'x'; 1023].into_iter().chain(*b"\n").collect::<Vec<u8>>();
        let most = MOST_QUEUED_BYTES / line.len();
        for _ in 0..most + 7 {
            writer.take(&line);
        }
        assert_eq!(writer.counts.lost.load(Ordering::Relaxed), 7);
        writer.flush(Duration::from_millis(10));
        pipe.is_open.store(true, Ordering::Release);
        writer.flush(Duration::from_mins(1));
        assert_eq!(pipe.taken.lock().unwrap().len(), most * line.len());
        assert_eq!(writer.counts.queued_bytes.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn a_stream_that_fails_loses_lines_and_is_tried_again() {
        struct Full(u8);
        impl Write for Full {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                self.0 += 1;
                if self.0 <= 2 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(bytes.len()) }
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let writer = Writer::start(Full(0)).unwrap();
        for _ in 0..4 {
            writer.take(b"line\n");
        }
        writer.flush(Duration::from_mins(1));
        assert_eq!(writer.counts.lost.load(Ordering::Relaxed), 2);
    }

    #[test]
    fn targets_that_are_not_named_log_warnings() {
        let targets = levels("packstone_server=debug").unwrap();
        assert!(targets.would_enable("packstone_server::jobs", &Level::DEBUG));
        assert!(targets.would_enable("sqlx", &Level::WARN));
        assert!(!targets.would_enable("sqlx", &Level::INFO));
    }

    #[test]
    fn a_level_alone_holds_for_all_targets() {
        let targets = levels("info,sqlx=error").unwrap();
        assert!(targets.would_enable("hyper", &Level::INFO));
        assert!(!targets.would_enable("sqlx", &Level::WARN));
        assert!(levels("packstone_server=loud").is_err());
    }
}
