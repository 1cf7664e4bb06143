//! Logs: one line an event on standard error, as text or as JSON.
//!
//! Standard output is for what a command was asked for. A line that cannot be written, to a full disk or a closed pipe,
//! is dropped: `eprintln!` would panic, and the panic hook, which logs as well, would end the process with signal 6.

use std::io::{self, IsTerminal as _, Write};

use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::{ParseError, Targets};
use tracing_subscriber::layer::SubscriberExt as _;
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
        .with_writer(|| Lossy(io::stderr()));
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
    use tracing::Level;

    use super::levels;

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
