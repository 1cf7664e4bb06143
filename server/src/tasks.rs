//! Tasks of the runtime whose type is erased: the code of a task is built once, not once for each function and each
//! future that is run. That code was a tenth of all that was generated for the server, by lines of LLVM's language.

use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};

use tokio::task::{JoinError, JoinHandle};

/// A future of any type.
pub(crate) type Boxed<T> = Pin<Box<dyn Future<Output = T> + Send>>;

/// A task that has begun. It goes on where this is dropped. Its output is the value of what it runs.
///
/// # Errors
/// What it runs panicked, or the runtime ended before it began.
#[derive(Debug)]
pub(crate) struct Task<T> {
    handle: JoinHandle<()>,
    value: Arc<Mutex<Option<T>>>,
}

impl<T> Future for Task<T> {
    type Output = Result<T, JoinError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        ready!(Pin::new(&mut self.handle).poll(context))?;
        let value = self.value.lock().unwrap_or_else(PoisonError::into_inner).take();
        Poll::Ready(Ok(
            value.expect("a task that ended without a panic has left its value, which is taken once")
        ))
    }
}

/// Runs a function that blocks its thread.
pub(crate) fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Task<T> {
    let value = Arc::new(Mutex::new(None));
    let place = Arc::clone(&value);
    let work: Box<dyn FnOnce() + Send> = Box::new(move || leave(&place, work()));
    Task { handle: tokio::task::spawn_blocking(work), value }
}

/// Runs a future to its end whatever becomes of the caller.
pub(crate) fn spawn<T: Send + 'static>(future: impl Future<Output = T> + Send + 'static) -> Task<T> {
    let value = Arc::new(Mutex::new(None));
    let place = Arc::clone(&value);
    let future: Boxed<()> = Box::pin(async move { leave(&place, future.await) });
    Task { handle: tokio::spawn(future), value }
}

fn leave<T>(place: &Mutex<Option<T>>, value: T) {
    *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
}
