//! The accept loop: connections in, a service behind, and an orderly end.
//!
//! `axum::serve` waits for slow heads forever and for open event streams at the end; this loop gives a head ten
//! seconds, bounds the number of connections, in all and of one client, and after the signal to stop lets requests
//! finish until a deadline. Connections beyond a bound are answered with 503, but for those of probes. Each request
//! carries the address of its client. What is no request of HTTP/1.1 is answered with a problem document, too.

mod exchange;
mod stream;

use std::collections::HashMap;
use std::convert::Infallible;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::ConnectInfo;
use hyper::body::{Body as _, Incoming};
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper::{Method, Request, Response, StatusCode, Uri};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use jiff::Timestamp;
use jiff::fmt::rfc2822::DateTimePrinter;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::base_path;
use crate::http::{OPEN_ROUTES, Refused, client_address, no_memory};
use crate::memory_budget::{MemoryBudget, network_of};
use crate::problem::{Kind, Problem};
use crate::tasks;
use exchange::{Answer, Exchange};
use stream::{Refusal, Stream};

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
/// Longest head of a request, and most bytes that the library buffers on a connection in each direction.
const BUFFER_BYTES: usize = 32 << 10;
/// Bytes and time spent on the rest of what is no request: a client that still writes would lose the answer to a
/// connection reset.
const LINGER_BYTES: usize = 4 << 20;
const LINGER: Duration = Duration::from_secs(2);
/// Pause after the system refused a connection, for want of file descriptors for example.
const REFUSED_PAUSE: Duration = Duration::from_millis(100);

/// What connections may take.
#[derive(Clone, Debug)]
pub(crate) struct ConnectionLimits {
    /// One permit for each connection that may be open.
    pub(crate) connections: Arc<Semaphore>,
    /// Most connections of one client.
    pub(crate) max_per_client: usize,
    /// The memory of heads and answers.
    pub(crate) memory_budget: MemoryBudget,
    /// Whether clients are told apart by `X-Forwarded-For`.
    pub(crate) trust_proxy: bool,
    /// Time in which a client must take some of its answer.
    pub(crate) stalled_reader: Duration,
}

/// Serves until `shutdown`, then drains; returns when all connections are closed.
pub(crate) async fn serve(
    listener: TcpListener,
    router: Router,
    limits: ConnectionLimits,
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
        let admitted = counts.admit(network_of(peer.ip()), limits.max_per_client);
        let permit = admitted
            .and_then(|place| Some((place, Arc::clone(&limits.connections).try_acquire_owned().ok()?)));
        let is_admitted = permit.is_some();
        let connection =
            Connection { client: peer, router: router.clone(), limits: limits.clone(), is_admitted };
        let (shutdown, abort) = (shutdown.clone(), abort.clone());
        let Some(permit) = permit else {
            // Beyond the bound of refusals, connections are closed without a word.
            if let Ok(turn) = Arc::clone(&refusals).try_acquire_owned() {
                let refused: tasks::Boxed<()> = Box::pin(async move {
                    // Clients hang up all the time.
                    let _ = timeout(REFUSAL_TIMEOUT, connection.serve(stream, shutdown, abort)).await;
                    drop(turn);
                });
                tracker.spawn(refused);
            }
            continue;
        };
        let served: tasks::Boxed<()> = Box::pin(async move {
            connection.serve(stream, shutdown, abort).await;
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

fn too_many_connections() -> Problem {
    let detail = "as many connections are open as may be, in all or of this address";
    Problem::new(Kind::Busy, detail).with_header("retry-after", "5")
}

/// A connection of a client.
#[derive(Clone)]
struct Connection {
    client: SocketAddr,
    router: Router,
    limits: ConnectionLimits,
    /// Whether there is a place for it. Otherwise one request is answered: probes as ever, so that a client that takes
    /// all its connections does not make the service look dead; all else with `503`.
    is_admitted: bool,
}

impl Connection {
    /// Serves its requests.
    async fn serve(self, stream: TcpStream, shutdown: CancellationToken, abort: CancellationToken) {
        // Small answers, as events, must not wait for the next.
        let _ = stream.set_nodelay(true);
        // Whom a trusted proxy connects for is known when the head is complete.
        let peer = self.client.ip().to_string();
        let of_peer = (!self.limits.trust_proxy).then_some(peer.as_str());
        let exchange = Exchange::new(self.limits.memory_budget.reservation(of_peer));
        let stream = Stream::new(stream, Arc::clone(&exchange), self.limits.stalled_reader);
        let service = {
            let (connection, exchange) = (self.clone(), Arc::clone(&exchange));
            service_fn(move |request| {
                exchange.begin();
                connection.clone().answer(request, Arc::clone(&exchange))
            })
        };
        let mut served = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(if self.is_admitted { HEAD_TIMEOUT } else { REFUSAL_TIMEOUT })
            .max_buf_size(BUFFER_BYTES)
            .keep_alive(self.is_admitted)
            .serve_connection(TokioIo::new(stream), service);
        let ended = tokio::select! {
            ended = &mut served => ended,
            () = shutdown.cancelled() => {
                std::pin::Pin::new(&mut served).graceful_shutdown();
                tokio::select! {
                    ended = &mut served => ended,
                    () = abort.cancelled() => return,
                }
            }
        };
        let Err(error) = ended else { return };
        // Clients hang up all the time.
        tracing::debug!(%error, "a connection ended early");
        let is_in_head = exchange.has_begun() && !exchange.is_answering();
        let (stream, refusal) = served.into_parts().io.into_inner().into_parts();
        let Some(problem) = problem_of(&error, refusal, is_in_head) else { return };
        // Boxed, as whatever few connections need, so that the others take less memory.
        let answered = Box::pin(async {
            let Ok(response) = self.refuse(unknown_request(), problem).await;
            write_last(stream, response).await
        });
        let _ = timeout(LINGER, answered).await;
    }

    /// The answer to a request, as far as there is memory for it while others are sent.
    async fn answer(
        self,
        request: Request<Incoming>,
        exchange: Arc<Exchange>,
    ) -> Result<Response<Answer>, Infallible> {
        let (head, body) = request.into_parts();
        let mut request = Request::from_parts(head, Body::new(body));
        if !self.is_admitted && !OPEN_ROUTES.contains(&base_path::get().strip(request.uri().path())) {
            // Closed with bytes unread, the connection would be reset, and the answer lost with it.
            let body = Box::pin(to_bytes(std::mem::take(request.body_mut()), REFUSED_BODY_BYTES));
            let _ = timeout(REFUSAL_TIMEOUT / 2, body).await;
            let response = Box::pin(self.refuse(request, too_many_connections())).await?;
            return Ok(response.map(|body| Answer::new(body, exchange, None)));
        }
        request.extensions_mut().insert(ConnectInfo(self.client));
        let client = client_address(&request, self.limits.trust_proxy);
        let mut response = self.route(request).await?;
        let mut memory = None;
        // What is known to its end is in memory.
        if let Some(bytes) = response.body().size_hint().exact() {
            match self.limits.memory_budget.reserve_answer(&client, bytes) {
                Ok(reserved) => memory = Some(reserved),
                Err(exceeded) => {
                    drop(response);
                    response = Box::pin(self.refuse(unknown_request(), no_memory(exceeded))).await?;
                }
            }
        }
        Ok(response.map(|body| Answer::new(body, exchange, memory)))
    }

    /// The problem document that answers a request.
    async fn refuse(
        &self,
        mut request: Request<Body>,
        problem: Problem,
    ) -> Result<Response<Body>, Infallible> {
        request.extensions_mut().insert(ConnectInfo(self.client));
        request.extensions_mut().insert(Refused(problem));
        self.route(request).await
    }

    async fn route(&self, request: Request<Body>) -> Result<Response<Body>, Infallible> {
        TowerToHyperService::new(self.router.clone()).call(request).await
    }
}

/// What stands for a request in the log of which nothing is known.
fn unknown_request() -> Request<Body> {
    let mut request = Request::new(Body::empty());
    *request.method_mut() = Method::from_bytes(b"UNKNOWN").unwrap_or_default();
    *request.uri_mut() = Uri::from_static("*");
    request
}

/// Why a connection ended, where its client should be told: there was no request, or not one of HTTP/1.1.
fn problem_of(error: &hyper::Error, refusal: Option<Refusal>, is_in_head: bool) -> Option<Problem> {
    let malformed = |detail: String| Problem::new(Kind::MalformedRequest, detail);
    match refusal {
        Some(Refusal::Memory(exceeded)) => Some(no_memory(exceeded)),
        Some(Refusal::Library(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE | StatusCode::URI_TOO_LONG)) => {
            let detail = format!(
                "the head of the request is too large: must have at most {BUFFER_BYTES} bytes and 100 fields"
            );
            Some(Problem::new(Kind::HeadTooLarge, detail))
        }
        Some(Refusal::Library(_)) => Some(malformed(format!("the request cannot be read: {error}"))),
        None if error.is_parse() => Some(malformed(format!("the request is not one of HTTP/1.1: {error}"))),
        None if error.is_timeout() && is_in_head => {
            let detail = format!("the head of the request took more than {} s", HEAD_TIMEOUT.as_secs());
            Some(Problem::new(Kind::RequestTimeout, detail))
        }
        None => None,
    }
}

/// Writes the last answer of a connection that the library does not serve any more, and closes it.
async fn write_last(mut stream: TcpStream, response: Response<Body>) -> io::Result<()> {
    let (head, body) = response.into_parts();
    let body = to_bytes(body, REFUSED_BODY_BYTES).await.map_err(io::Error::other)?;
    let mut bytes = format!("HTTP/1.1 {}\r\nconnection: close\r\n", head.status).into_bytes();
    for (name, value) in &head.headers {
        bytes.extend_from_slice(name.as_str().as_bytes());
        bytes.extend_from_slice(b": ");
        bytes.extend_from_slice(value.as_bytes());
        bytes.extend_from_slice(b"\r\n");
    }
    if let Ok(date) = DateTimePrinter::new().timestamp_to_rfc9110_string(&Timestamp::now()) {
        bytes.extend_from_slice(format!("date: {date}\r\n").as_bytes());
    }
    bytes.extend_from_slice(b"\r\n");
    bytes.extend_from_slice(&body);
    stream.write_all(&bytes).await?;
    stream.shutdown().await?;
    let (mut rest, mut taken) = ([0; 4096], 0);
    while taken < LINGER_BYTES {
        match stream.read(&mut rest).await? {
            0 => break,
            read => taken += read,
        }
    }
    Ok(())
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
