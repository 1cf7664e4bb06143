//! Tasks of the runtime whose type is erased: the code of a task is built once, not once for each function and each
//! future that is run. That code was a tenth of all that was generated for the server, by lines of LLVM's language.

use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Wake, Waker, ready};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};

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

/// Waits on this thread, which may block, for a future that needs no runtime, for so long at most; `None` where it has
/// not ended by then. The timers of a runtime would panic here once the process stops.
pub(crate) fn wait_for<T>(future: impl Future<Output = T>, longest: Duration) -> Option<T> {
    let waker = Waker::from(Arc::new(Unpark(thread::current())));
    let mut context = Context::from_waker(&waker);
    let mut future = pin!(future);
    let end = Instant::now() + longest;
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return Some(value);
        }
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return None;
        }
        thread::park_timeout(left);
    }
}

/// Wakes a thread.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

fn leave<T>(place: &Mutex<Option<T>>, value: T) {
    *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_future_is_waited_for_without_a_runtime_and_not_for_ever() {
        let (sender, mut receiver) = tokio::sync::mpsc::channel(1);
        let sent = thread::spawn(move || sender.blocking_send(7));
        assert_eq!(wait_for(receiver.recv(), Duration::from_mins(1)), Some(Some(7)));
        assert!(sent.join().is_ok_and(|sent| sent.is_ok()));
        assert_eq!(wait_for(std::future::pending::<()>(), Duration::from_millis(1)), None);
    }
}
