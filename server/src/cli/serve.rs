//! `packstone serve`: the service until a signal.

use tokio::signal::unix::{SignalKind, signal};

use super::exit::{Exit, Failure};
use super::{block_on_threads, print};
use crate::base_path;
use crate::config::ServeOptions;
use crate::gmsh;
use crate::service::Service;
use crate::telemetry;

/// Variable that names the file of keys.
const KEYS_VARIABLE: &str = "PACKSTONE_API_KEYS_FILE";

/// Runs the service; `unknown` are variables of the environment that no option has.
pub(super) fn run(options: ServeOptions, unknown: &[String]) -> Result<(), Failure> {
    telemetry::start(options.log_format, "info");
    for variable in unknown {
        tracing::warn!(variable, "no option has this variable: it is misspelled, or of another version");
    }
    base_path::set(options.base_path.clone());
    gmsh::set(options.gmsh.clone());
    if options.api_keys_file.is_none() && std::env::var_os(KEYS_VARIABLE).is_some() {
        tracing::warn!("{KEYS_VARIABLE} is empty and counts as not set: the service asks for no keys");
    }
    block_on_threads(options.blocking_threads(), async {
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut hang_up = signal(SignalKind::hangup())?;
        let service = Service::open(options).await?;
        let address = service.address()?;
        let (shutdown, reload) = (service.shutdown(), service.reload());
        // The one line on standard output, for whoever started this with port 0.
        // Where nobody can read it, the service goes on, and it does not wait for a reader.
        std::thread::spawn(move || print(&format!("packstone listening on http://{address}\n")));
        tracing::info!(%address, "listening");
        tokio::spawn(async move {
            let name = loop {
                tokio::select! {
                    _ = terminate.recv() => break "SIGTERM",
                    _ = interrupt.recv() => break "SIGINT",
                    // The terminal that started it has gone, or an operator asks for a reload.
                    _ = hang_up.recv() => {
                        tracing::info!(signal = "SIGHUP", "reloading");
                        reload.notify_one();
                    }
                }
            };
            tracing::info!(signal = name, "stopping");
            shutdown.cancel();
        });
        service.serve().await.map_err(|why| Exit::Machine.because(why))
    })
}
