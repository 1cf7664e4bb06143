//! A client of a service on this machine, for the demo.

use std::net::SocketAddr;

use axum::body::Body;
use bytes::Bytes;
use http_body_util::BodyExt as _;
use hyper::body::Incoming;
use hyper::{Method, Request, Response, StatusCode, header};
use serde_json::Value;

use super::exit::Failure;
use crate::http_client::Origin;

/// Sends requests to one service.
pub(super) struct Client {
    origin: Origin,
}

impl Client {
    /// A client of the service that listens there.
    pub(super) fn new(address: SocketAddr) -> Self {
        Self { origin: Origin::at(address) }
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
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header(header::CONTENT_TYPE, "application/json")
            .body(Body::from(body))?;
        let response = self.origin.send(request).await?;
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
