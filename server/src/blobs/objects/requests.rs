//! A runtime for the requests to a bucket. That of the service ends while threads still wait for a bucket that does not
//! answer, and its timers would panic in them.

use std::io;

use tokio::runtime::{Builder, Runtime};

/// Threads that pass bytes.
const THREADS: usize = 2;

/// The runtime; it ends with the last who waits on it.
#[derive(Debug)]
pub(super) struct Requests(Option<Runtime>);

impl Requests {
    /// Starts it.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn new() -> io::Result<Self> {
        let mut builder = Builder::new_multi_thread();
        let runtime = builder.worker_threads(THREADS).thread_name("bucket").enable_all().build()?;
        Ok(Self(Some(runtime)))
    }

    /// Waits for the end of a request. Blocks the thread.
    pub(super) fn wait<F: Future>(&self, request: F) -> F::Output {
        match &self.0 {
            Some(runtime) => runtime.block_on(request),
            None => unreachable!("it is taken when this is dropped"),
        }
    }
}

impl Drop for Requests {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            // The last may be a thread of another runtime, which must not wait.
            runtime.shutdown_background();
        }
    }
}
