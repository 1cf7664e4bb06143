//! A client of HTTP/1.1 for a service on this machine: one connection per request, no TLS, no proxy.

use std::net::SocketAddr;

use bytes::Bytes;
use http_body_util::{BodyExt as _, Full};
use hyper::body::Incoming;
use hyper::{Method, Request, Response, StatusCode, header};
use hyper_util::rt::TokioIo;
use serde_json::Value;
use tokio::net::TcpStream;

use super::exit::Failure;

/// Sends requests to one service.
#[derive(Clone, Copy)]
pub(super) struct Client {
    address: SocketAddr,
}

impl Client {
    /// A client of the service that listens there.
    pub(super) fn new(address: SocketAddr) -> Self {
        Self { address }
    }

    /// GET of a path.
    ///
    /// # Errors
    /// The connection's, and the status with the problem's detail where it is not a success.
    pub(super) async fn get(&self, path: &str) -> Result<Response<Incoming>, Failure> {
        self.send(Method::GET, path, "").await
    }

    /// POST of a JSON document.
    ///
    /// # Errors
    /// As [`Client::get`].
    pub(super) async fn post(&self, path: &str, body: &'static str) -> Result<Response<Incoming>, Failure> {
        self.send(Method::POST, path, body).await
    }

    async fn send(
        &self,
        method: Method,
        path: &str,
        body: &'static str,
    ) -> Result<Response<Incoming>, Failure> {
        let stream = TcpStream::connect(self.address).await?;
        let (mut sender, connection) = hyper::client::conn::http1::handshake(TokioIo::new(stream)).await?;
        // It ends with the response; what goes wrong with it is told by the response.
        tokio::spawn(connection);
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header(header::HOST, self.address.to_string())
            .header(header::CONTENT_TYPE, "application/json")
            .body(Full::new(Bytes::from_static(body.as_bytes())))?;
        let response = sender.send_request(request).await?;
        let status = response.status();
        if status.is_success() { Ok(response) } else { Err(problem(status, response).await) }
    }
}

/// The body as JSON.
pub(super) async fn json(response: Response<Incoming>) -> Result<Value, Failure> {
    Ok(serde_json::from_slice(&response.into_body().collect().await?.to_bytes())?)
}

/// The next piece of a body; nothing at its end.
pub(super) async fn chunk(body: &mut Incoming) -> Result<Option<Bytes>, Failure> {
    while let Some(frame) = body.frame().await {
        // Trailers are no data.
        if let Ok(data) = frame?.into_data() {
            return Ok(Some(data));
        }
    }
    Ok(None)
}

async fn problem(status: StatusCode, response: Response<Incoming>) -> Failure {
    let detail = match json(response).await {
        Ok(problem) => problem["detail"].as_str().unwrap_or_default().to_owned(),
        Err(error) => error.to_string(),
    };
    format!("{status}: {detail}").into()
}
