//! `packstone serve`: the service until a signal.

use tokio::signal::unix::{SignalKind, signal};

use super::exit::Failure;
use super::{block_on, print};
use crate::config::ServeOptions;
use crate::service::Service;
use crate::telemetry;

pub(super) fn run(options: ServeOptions) -> Result<(), Failure> {
    telemetry::start(options.log_format, "info");
    block_on(async {
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let service = Service::open(options).await?;
        let address = service.address()?;
        let shutdown = service.shutdown();
        // The one line on standard output, for whoever started this with port 0.
        print(&format!("packstone listening on http://{address}\n"))?;
        tracing::info!(%address, "listening");
        tokio::spawn(async move {
            let name = tokio::select! {
                _ = terminate.recv() => "SIGTERM",
                _ = interrupt.recv() => "SIGINT",
            };
            tracing::info!(signal = name, "stopping");
            shutdown.cancel();
        });
        service.serve().await;
        Ok(())
    })
}
