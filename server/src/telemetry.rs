//! Logs: one line an event on standard error, as text or as JSON.
//!
//! Standard output is for what a command was asked for. A line that cannot be written, to a full disk or a closed pipe, is
//! dropped: `eprintln!` would panic, and the panic hook, which logs as well, would end the process with signal 6.

use std::io::{self, IsTerminal as _, Write};

use tracing_subscriber::EnvFilter;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Variable that holds the filter.
const FILTER_VARIABLE: &str = "PACKSTONE_LOG";

/// Form of the log lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum LogFormat {
    /// For people.
    #[default]
    Text,
    /// For machines, one object a line.
    Json,
}

/// A writer whose failures nobody hears of.
struct Lossy<W>(W);

impl<W: Write> Write for Lossy<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // A part of a line is no better than none; the caller must not try the rest for ever.
        let _ = self.0.write_all(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let _ = self.0.flush();
        Ok(())
    }
}

/// Writes a line to standard error; one that cannot be written is dropped.
pub(crate) fn say(line: &str) {
    let _ = Lossy(io::stderr()).write_all(format!("{line}\n").as_bytes());
}

/// Starts to log. `default_filter` holds where `PACKSTONE_LOG` is not set, as `info` or
/// `packstone_server=debug,sqlx=warn`.
pub(crate) fn start(format: LogFormat, default_filter: &str) {
    let filter = EnvFilter::builder()
        .with_default_directive(tracing::Level::WARN.into())
        .parse_lossy(std::env::var(FILTER_VARIABLE).unwrap_or_else(|_| default_filter.into()));
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(io::stderr().is_terminal())
        // Its default is to report a failed write by `eprintln!`.
        .log_internal_errors(false)
        .with_writer(|| Lossy(io::stderr()));
    // A second start, in tests, keeps the first.
    let _ = match format {
        LogFormat::Text => lines.finish().try_init(),
        LogFormat::Json => lines.json().finish().try_init(),
    };
    std::panic::set_hook(Box::new(|panic| {
        let at = panic.location().map(ToString::to_string).unwrap_or_default();
        tracing::error!(at, message = panic.payload_as_str().unwrap_or("no message"), "panic");
    }));
}
