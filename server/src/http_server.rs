//! The accept loop: connections in, a service behind, and an orderly end.
//!
//! `axum::serve` waits for slow heads forever and for open event streams at the end; this loop gives a head ten
//! seconds, bounds the number of connections, in all and of one client, and after the signal to stop lets requests
//! finish until a deadline. Connections beyond a bound are answered with 503, but for those of probes. Each request
//! carries the address of its client.

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::ConnectInfo;
use hyper::body::Incoming;
use hyper::header::{CONTENT_TYPE, HeaderValue, RETRY_AFTER};
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::base_path;
use crate::http::{OPEN_ROUTES, PROBLEM_JSON, protect};
use crate::tasks;

/// Time that the head of a request may take, and that an idle connection is kept.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Time that requests may take to finish after the signal to stop.
const DRAIN: Duration = Duration::from_secs(5);
/// Connections that are told at once that there is no place for them.
const REFUSALS: usize = 16;
/// Time that such a connection may take.
const REFUSAL_TIMEOUT: Duration = Duration::from_secs(2);
/// Most bytes of a refused request's body that are read.
const REFUSED_BODY_BYTES: usize = 1 << 16;
/// Pause after the system refused a connection, for want of file descriptors for example.
const REFUSED_PAUSE: Duration = Duration::from_millis(100);

/// Serves until `shutdown`, then drains; returns when all connections are closed. `connections` has a permit for each
/// that may be open, of which one address may hold `max_per_client`.
pub(crate) async fn serve(
    listener: TcpListener,
    router: Router,
    connections: Arc<Semaphore>,
    max_per_client: usize,
    shutdown: CancellationToken,
) {
    let tracker = TaskTracker::new();
    let abort = CancellationToken::new();
    let counts = Counts::default();
    let refusals = Arc::new(Semaphore::new(REFUSALS));
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = shutdown.cancelled() => break,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!(%error, "a connection was not accepted");
                sleep(REFUSED_PAUSE).await;
                continue;
            }
        };
        let admitted = counts.admit(peer.ip(), max_per_client);
        let permit =
            admitted.and_then(|place| Some((place, Arc::clone(&connections).try_acquire_owned().ok()?)));
        let Some(permit) = permit else {
            // Beyond the bound of refusals, connections are closed without a word.
            if let Ok(turn) = Arc::clone(&refusals).try_acquire_owned() {
                let router = router.clone();
                let refused: tasks::Boxed<()> = Box::pin(async move {
                    refuse(stream, peer, router).await;
                    drop(turn);
                });
                tracker.spawn(refused);
            }
            continue;
        };
        let (router, shutdown, abort) = (router.clone(), shutdown.clone(), abort.clone());
        let served: tasks::Boxed<()> = Box::pin(async move {
            connection(stream, peer, router, shutdown, abort).await;
            drop(permit);
        });
        tracker.spawn(served);
    }
    drop(listener);
    tracker.close();
    if timeout(DRAIN, tracker.wait()).await.is_err() {
        tracing::warn!(open = tracker.len(), "closing connections whose requests did not finish");
        abort.cancel();
        tracker.wait().await;
    }
}

/// Open connections by address of the client.
#[derive(Clone, Debug, Default)]
struct Counts(Arc<Mutex<HashMap<IpAddr, usize>>>);

/// One connection of a client; dropped, it makes room for another.
struct Admitted {
    counts: Counts,
    peer: IpAddr,
}

impl Counts {
    /// Counts a connection, unless the client has `most` already.
    fn admit(&self, peer: IpAddr, most: usize) -> Option<Admitted> {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = counts.entry(peer).or_default();
        if *count >= most {
            return None;
        }
        *count += 1;
        Some(Admitted { counts: self.clone(), peer })
    }
}

impl Drop for Admitted {
    fn drop(&mut self) {
        let mut counts = self.counts.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = counts.get_mut(&self.peer) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.peer);
            }
        }
    }
}

/// Serves one request of a connection for which there is no place: probes are answered as ever, so that a client that
/// takes all its connections does not make the service look dead; all else is answered with `503`.
async fn refuse(stream: TcpStream, client: SocketAddr, router: Router) {
    let _ = stream.set_nodelay(true);
    let router = TowerToHyperService::new(router);
    let service = service_fn(move |mut request: Request<Incoming>| {
        let router = router.clone();
        async move {
            if OPEN_ROUTES.contains(&base_path::get().strip(request.uri().path())) {
                request.extensions_mut().insert(ConnectInfo(client));
                return router.call(request).await;
            }
            // Closed with bytes unread, the connection would be reset, and the answer lost with it.
            let body = to_bytes(Body::new(request.into_body()), REFUSED_BODY_BYTES);
            let _ = timeout(REFUSAL_TIMEOUT / 2, body).await;
            Ok(busy())
        }
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(REFUSAL_TIMEOUT)
        .keep_alive(false)
        .serve_connection(TokioIo::new(stream), service);
    // Clients hang up all the time.
    let _ = timeout(REFUSAL_TIMEOUT, served).await;
}

/// The answer for which no place is needed.
fn busy() -> Response<Body> {
    const BODY: &str = r#"{"type":"/problems/busy","title":"Busy","status":503,"detail":"as many connections are open as may be, in all or of this address"}"#;
    let mut response = Response::new(Body::from(BODY));
    *response.status_mut() = StatusCode::SERVICE_UNAVAILABLE;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    headers.insert(RETRY_AFTER, HeaderValue::from_static("5"));
    protect(&mut response);
    response
}

async fn connection(
    stream: TcpStream,
    client: SocketAddr,
    router: Router,
    shutdown: CancellationToken,
    abort: CancellationToken,
) {
    // Small answers, as events, must not wait for the next.
    let _ = stream.set_nodelay(true);
    let router = TowerToHyperService::new(router);
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(ConnectInfo(client));
        router.call(request)
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .serve_connection(TokioIo::new(stream), service);
    let mut served = std::pin::pin!(served);
    let ended = tokio::select! {
        ended = served.as_mut() => ended,
        () = shutdown.cancelled() => {
            served.as_mut().graceful_shutdown();
            tokio::select! {
                ended = served.as_mut() => ended,
                () = abort.cancelled() => return,
            }
        }
    };
    if let Err(error) = ended {
        // Clients hang up all the time.
        tracing::debug!(%error, "a connection ended early");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_gets_its_share_and_no_more() {
        let counts = Counts::default();
        let peer = IpAddr::from([192, 0, 2, 1]);
        let most = 2;
        let first = counts.admit(peer, most);
        let second = counts.admit(peer, most);
        assert!(first.is_some() && second.is_some() && counts.admit(peer, most).is_none());
        assert!(counts.admit(IpAddr::from([192, 0, 2, 2]), most).is_some());
        drop(second);
        assert!(counts.admit(peer, most).is_some());
        drop(first);
        assert!(counts.0.lock().is_ok_and(|counts| counts.is_empty()));
    }
}
