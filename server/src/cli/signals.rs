//! The signals that stop a command in good order.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::signal::unix::{SignalKind, signal};

use super::exit::Failure;

/// What a shell reports of a process that an interrupt ended.
const INTERRUPTED: i32 = 130;

/// Set by the first signal to end. The second ends the process at once: the run may be writing a result
/// of gigabytes, and whoever asks twice means it.
pub(super) fn stop_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (mut interrupt, mut terminate) = {
        let _context = runtime.enter();
        (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?)
    };
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    std::thread::spawn(move || {
        runtime.block_on(async {
            loop {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
                if asked.swap(true, Ordering::AcqRel) {
                    crate::telemetry::flush();
                    std::process::exit(INTERRUPTED);
                }
            }
        });
    });
    Ok(stop)
}
