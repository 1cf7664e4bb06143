//! Work that would hold up the threads that answer: plans, readings of mixes, large bodies, long documents.
//!
//! It runs on threads of the blocking pool, in each of two pools at most half as many at once as there are cores. A
//! request waits for its turn for a bounded time, and clients take turns. Work with many steps passes its place on
//! after a while, so that short work beside it is not held up either.

use std::cell::{Cell, RefCell};
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use tokio::runtime::Handle;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

use crate::fair_places::{Client, FairPlaces, Place};
use crate::http::client;
use crate::problem::{Kind, Problem};
use crate::tasks;

/// How long a request waits for its turn before it is refused.
const LONGEST_WAIT: Duration = Duration::from_secs(10);
/// How long work keeps its place while others may be waiting.
const SLICE: Duration = Duration::from_millis(100);

/// Places of threads that compute.
#[derive(Debug)]
pub(crate) struct ComputePool {
    places: FairPlaces,
    longest_wait: Duration,
}

/// Threads of a pool: half as many as there are cores, at least one.
fn threads() -> usize {
    let cores = available_parallelism().map_or(1, usize::from);
    (cores / 2).max(1)
}

/// The place of work that runs.
pub(crate) struct Turn {
    places: FairPlaces,
    client: Client,
    place: RefCell<Option<Place>>,
    since: Cell<Instant>,
    runtime: Handle,
    gone: CancellationToken,
}

impl ComputePool {
    /// The pool of plans and of large bodies.
    pub(crate) fn of_requests() -> Self {
        Self::new(threads(), LONGEST_WAIT)
    }

    /// The pool of long documents, read or written. Each takes milliseconds, so that none is refused.
    pub(crate) fn of_documents() -> Self {
        Self::new(threads(), Duration::MAX)
    }

    fn new(threads: usize, longest_wait: Duration) -> Self {
        Self { places: FairPlaces::new(threads, threads), longest_wait }
    }

    /// Computes once it is this request's turn. Work goes on until its end or its next [`Turn::go_on`], even if the
    /// client has hung up, and keeps its place: clients that hang up cannot start more of it.
    ///
    /// # Errors
    /// `busy` where others were computing for the whole of a bounded time, `internal-error` after a panic.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Turn) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let client = client::current();
        let Ok(place) = timeout(self.longest_wait, self.places.wait(&client)).await else {
            return Err(busy());
        };
        let gone = CancellationToken::new();
        let _gone_with_this_future = gone.clone().drop_guard();
        let (places, runtime) = (self.places.clone(), Handle::current());
        let computed = tasks::blocking(move || {
            let (place, since) = (RefCell::new(Some(place)), Cell::new(Instant::now()));
            work(&Turn { places, client, place, since, runtime, gone })
        });
        computed.await.map_err(|error| {
            tracing::error!(%error, "the computation of an answer ended early");
            Problem::internal()
        })
    }
}

impl Turn {
    /// Whether a client still waits for the work. Work that has run for a while gives its place to those that wait, and
    /// goes on when it is its turn again.
    pub(crate) fn go_on(&self) -> bool {
        if self.gone.is_cancelled() {
            return false;
        }
        if self.since.get().elapsed() >= SLICE {
            self.place.borrow_mut().take();
            let again = self.gone.run_until_cancelled(self.places.wait(&self.client));
            let Some(place) = self.runtime.block_on(again) else { return false };
            self.place.replace(Some(place));
            self.since.set(Instant::now());
        }
        true
    }
}

/// The refusal of work for which there was no place in time.
pub(crate) fn busy() -> Problem {
    let detail =
        "as many plans, submissions and readings of mixes are being computed as this server computes at once";
    Problem::new(Kind::Busy, detail).with_header("retry-after", "10")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::{Arc, Mutex, mpsc};

    use futures_util::FutureExt as _;

    use super::*;

    const PATIENCE: Duration = Duration::from_mins(1);

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn who_waits_for_too_long_is_refused_with_a_time_to_come_back() {
        let pool = ComputePool::new(1, Duration::from_millis(20));
        let (end, ends) = mpsc::channel::<()>();
        let (begun, has_begun) = tokio::sync::oneshot::channel();
        let busy = pool.run(move |_| {
            begun.send(()).unwrap();
            ends.recv_timeout(PATIENCE)
        });
        let other = async {
            has_begun.await.unwrap();
            let refused = pool.run(|_| ()).await.unwrap_err();
            end.send(()).unwrap();
            refused
        };
        let (computed, refused) = tokio::join!(busy, other);
        computed.unwrap().unwrap();
        assert_eq!((refused.status, refused.headers[0].0), (503, "retry-after"));
        assert!(pool.run(|_| ()).await.is_ok());
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_client_with_many_requests_lets_others_pass() {
        let pool = ComputePool::new(1, PATIENCE);
        let (end, ends) = mpsc::channel::<()>();
        let (begun, has_begun) = tokio::sync::oneshot::channel();
        let order = Arc::new(Mutex::new(Vec::new()));
        let of = |name: &str| Client::named([name.to_owned()]);
        let first = pool.run(move |_| {
            begun.send(()).unwrap();
            ends.recv_timeout(PATIENCE)
        });
        let mut others = Vec::new();
        for name in ["many", "many", "many", "one"] {
            let order = Arc::clone(&order);
            others.push(client::answering(of(name), pool.run(move |_| order.lock().unwrap().push(name))));
        }
        let others = async {
            has_begun.await.unwrap();
            let mut others = futures_util::future::join_all(others);
            // Each has joined the line.
            assert!((&mut others).now_or_never().is_none());
            end.send(()).unwrap();
            others.await
        };
        let (first, _) = tokio::join!(client::answering(of("many"), first), others);
        first.unwrap().unwrap();
        assert_eq!(order.lock().unwrap()[..2], ["many", "one"]);
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn long_work_lets_short_work_pass() {
        let pool = ComputePool::new(1, PATIENCE);
        let (passed, has_passed) = mpsc::channel();
        let (begun, has_begun) = tokio::sync::oneshot::channel();
        let long = pool.run(move |turn| {
            begun.send(()).unwrap();
            let start = Instant::now();
            while has_passed.try_recv().is_err() && start.elapsed() < PATIENCE {
                assert!(turn.go_on());
                std::thread::sleep(Duration::from_millis(1));
            }
            start.elapsed()
        });
        let short = async {
            has_begun.await.unwrap();
            pool.run(move |_| passed.send(())).await
        };
        let (long, short) = tokio::join!(long, short);
        assert!(long.unwrap() < PATIENCE);
        short.unwrap().unwrap();
    }

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn work_ends_when_its_client_has_gone_and_keeps_its_place_until_then() {
        let pool = ComputePool::new(1, PATIENCE);
        let (begun, has_begun) = tokio::sync::oneshot::channel();
        let (end, has_ended) = mpsc::channel();
        let mut given_up = Box::pin(pool.run(move |turn| {
            begun.send(()).unwrap();
            while turn.go_on() {
                std::thread::sleep(Duration::from_millis(1));
            }
            end.send(()).unwrap();
        }));
        tokio::select! {
            _ = &mut given_up => unreachable!("the work ends with its client alone"),
            begun = has_begun => begun.unwrap(),
        }
        drop(given_up);
        pool.run(move |_| has_ended.try_recv()).await.unwrap().unwrap();
    }

    #[tokio::test]
    async fn a_panic_is_an_error_of_this_request_alone() {
        let pool = ComputePool::new(1, PATIENCE);
        let failed = pool.run(|_| assert!(available_parallelism().is_err(), "on purpose")).await;
        assert_eq!(failed.unwrap_err().status, 500);
        assert!(pool.run(|_| ()).await.is_ok());
    }
}
