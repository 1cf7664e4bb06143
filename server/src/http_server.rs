//! The accept loop: connections in, a service behind, and an orderly end.
//!
//! `axum::serve` waits for slow heads forever and for open event streams at the end; this loop
//! gives a head ten seconds, bounds the number of connections, and after the signal to stop lets
//! requests finish until a deadline. It knows sockets and hyper; it must never know a route.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

/// Time that the head of a request may take, and that an idle connection is kept.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// Time that requests may take to finish after the signal to stop.
const DRAIN: Duration = Duration::from_secs(5);
/// Pause after the system refused a connection, for want of file descriptors for example.
const REFUSED_PAUSE: Duration = Duration::from_millis(100);

/// Serves until `shutdown`, then drains; returns when all connections are closed.
pub(crate) async fn serve(
    listener: TcpListener,
    router: Router,
    connections: Arc<Semaphore>,
    shutdown: CancellationToken,
) {
    let tracker = TaskTracker::new();
    let abort = CancellationToken::new();
    loop {
        // The permit comes first: beyond the bound, connections wait in the system's backlog.
        let permit = tokio::select! {
            permit = Arc::clone(&connections).acquire_owned() => permit,
            () = shutdown.cancelled() => break,
        };
        let Ok(permit) = permit else { break };
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = shutdown.cancelled() => break,
        };
        match accepted {
            Ok((stream, _)) => {
                let (router, shutdown, abort) = (router.clone(), shutdown.clone(), abort.clone());
                tracker.spawn(async move {
                    connection(stream, router, shutdown, abort).await;
                    drop(permit);
                });
            }
            Err(error) => {
                tracing::warn!(%error, "a connection was not accepted");
                sleep(REFUSED_PAUSE).await;
            }
        }
    }
    drop(listener);
    tracker.close();
    if timeout(DRAIN, tracker.wait()).await.is_err() {
        tracing::warn!(open = tracker.len(), "closing connections whose requests did not finish");
        abort.cancel();
        tracker.wait().await;
    }
}

async fn connection(
    stream: TcpStream,
    router: Router,
    shutdown: CancellationToken,
    abort: CancellationToken,
) {
    // Small answers, as events, must not wait for the next.
    let _ = stream.set_nodelay(true);
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
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
