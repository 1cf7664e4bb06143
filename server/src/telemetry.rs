//! Logs: one line an event on standard error, as text or as JSON.
//!
//! Standard output is for what a command was asked for.

use std::io::IsTerminal as _;

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

/// Starts to log. `default_filter` holds where `PACKSTONE_LOG` is not set, as `info` or
/// `packstone_server=debug,sqlx=warn`.
pub(crate) fn start(format: LogFormat, default_filter: &str) {
    let filter = EnvFilter::builder()
        .with_default_directive(tracing::Level::WARN.into())
        .parse_lossy(std::env::var(FILTER_VARIABLE).unwrap_or_else(|_| default_filter.into()));
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr);
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
