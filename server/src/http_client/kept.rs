//! Connections that are kept for the next request to the same service.
//!
//! A request goes over a kept connection whose last response was read to its end, else over a new one. The other side
//! may close a kept connection at any time: a request that was not written then is sent again over another one, and
//! one that was written in part fails, for it may have been acted on.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::body::Body;
use hyper::body::Incoming;
use hyper::{Request, Response};
use tokio::time::Instant;

use super::{ClientError, Connection, Origin};

/// For how long a connection is kept without a request: less than the ten seconds after which a server of Packstone
/// closes it.
const IDLE: Duration = Duration::from_secs(5);
/// For how long a connection is used at all: a name may come to stand for other addresses.
const LIFE: Duration = Duration::from_mins(1);
/// Most connections that are kept at once.
const MOST: usize = 4;

/// A service, and connections to it that are kept.
#[derive(Clone, Debug)]
pub(crate) struct Kept {
    origin: Origin,
    idle: Arc<Mutex<Vec<KeptConnection>>>,
}

#[derive(Debug)]
struct KeptConnection {
    connection: Connection,
    made: Instant,
    used: Instant,
}

impl Kept {
    /// A service to which no connection is open yet.
    pub(crate) fn to(origin: Origin) -> Self {
        Self { origin, idle: Arc::default() }
    }

    /// Sends a request whose URI is a path; `Host` is set here. The connection is used again when the body of the
    /// response was read to its end. Where the future is dropped before there is a response, the connection is closed.
    ///
    /// # Errors
    /// See [`ClientError`].
    pub(crate) async fn send(&self, mut request: Request<Body>) -> Result<Response<Incoming>, ClientError> {
        self.origin.set_host(&mut request)?;
        while let Some(mut kept) = self.take() {
            match kept.connection.try_send_request(request).await {
                Ok(response) => {
                    self.keep(kept);
                    return Ok(response);
                }
                Err(mut error) => match error.take_message() {
                    Some(unsent) => request = unsent,
                    None => return Err(error.into_error().into()),
                },
            }
        }
        let mut connection = self.origin.connect().await?;
        let made = Instant::now();
        let response = connection.send_request(request).await?;
        self.keep(KeptConnection { connection, made, used: made });
        Ok(response)
    }

    /// A connection that is ready for a request. Those that are closed or too old go.
    fn take(&self) -> Option<KeptConnection> {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        idle.retain(|kept| {
            !kept.connection.is_closed() && kept.used.elapsed() < IDLE && kept.made.elapsed() < LIFE
        });
        let ready = idle.iter().rposition(|kept| kept.connection.is_ready())?;
        Some(idle.swap_remove(ready))
    }

    fn keep(&self, mut kept: KeptConnection) {
        kept.used = Instant::now();
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.len() < MOST {
            idle.push(kept);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use http_body_util::BodyExt as _;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpListener;
    use tokio::sync::mpsc;

    use super::*;

    /// A service whose connections end after so many answers, and the number of each connection that is accepted.
    async fn service(answers: usize) -> (Kept, mpsc::UnboundedReceiver<usize>) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let kept = Kept::to(Origin::at(listener.local_addr().unwrap()));
        let (accepted, accepts) = mpsc::unbounded_channel();
        tokio::spawn(async move {
            for number in 0.. {
                let (mut stream, _) = listener.accept().await.unwrap();
                accepted.send(number).unwrap();
                tokio::spawn(async move {
                    let mut head = Vec::new();
                    for _ in 0..answers {
                        while !head.ends_with(b"\r\n\r\n") {
                            let Ok(byte) = stream.read_u8().await else { return };
                            head.push(byte);
                        }
                        head.clear();
                        stream.write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\n\r\nok").await.unwrap();
                    }
                });
            }
        });
        (kept, accepts)
    }

    async fn ask(kept: &Kept) -> Result<(), ClientError> {
        let request = Request::builder().uri("/").body(Body::empty()).unwrap();
        let body = kept.send(request).await?.into_body().collect().await?;
        assert_eq!(body.to_bytes(), "ok");
        // The task of the connection learns of the end of the body when it runs next.
        let is_busy = |kept: &KeptConnection| !kept.connection.is_ready() && !kept.connection.is_closed();
        while kept.idle.lock().unwrap().iter().any(is_busy) {
            tokio::task::yield_now().await;
        }
        Ok(())
    }

    #[tokio::test]
    async fn requests_one_after_the_other_go_over_one_connection() {
        let (kept, mut accepts) = service(100).await;
        for _ in 0..100 {
            ask(&kept).await.unwrap();
        }
        assert_eq!(accepts.recv().await, Some(0));
        assert!(accepts.try_recv().is_err(), "a second connection");
    }

    #[tokio::test]
    async fn a_connection_that_the_other_side_has_closed_is_replaced() {
        let (kept, mut accepts) = service(1).await;
        for number in 0..20 {
            // The other side closes at once, and this one may not have seen it yet: the request may fail, but the next
            // one does not.
            if ask(&kept).await.is_err() {
                ask(&kept).await.unwrap();
            }
            assert_eq!(accepts.recv().await, Some(number));
        }
    }
}
