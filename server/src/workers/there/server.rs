//! The server of a worker: requests with the key, and answers or reasons why there are none.

use std::fs::File;
use std::io::{self, Seek as _};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use bytes::Bytes;
use http_body_util::BodyExt as _;
use hyper::body::Incoming;
use hyper::header::{AUTHORIZATION, CONTENT_LENGTH, CONTENT_TYPE, HeaderValue};
use hyper::{Method, Request, Response, StatusCode, Uri};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::io::AsyncReadExt as _;
use tokio::time::timeout;
use tokio_util::io::ReaderStream;

use super::key::ApiKey;
use crate::http_client::{ClientError, Kept, Origin};

/// Time for an answer, beside the time for which it may be held back.
const ANSWER: Duration = Duration::from_secs(30);
/// Least speed of a file, in bytes per second, that is waited for.
const LEAST_SPEED: u64 = 100_000;
/// Longest JSON answer that is read, in bytes: the requests of 1024 jobs.
const MAX_JSON_BYTES: usize = 1 << 28;

/// Why there is no answer of use.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ServerError {
    /// The server was not reached, or its answer broke off.
    #[error("the server does not answer: {0}")]
    Unreachable(String),
    /// It answered with a problem.
    #[error("the server answered {status}: {detail}")]
    Refused {
        status: StatusCode,
        /// Last segment of the problem's `type`.
        kind: String,
        detail: String,
    },
    /// A file of this machine cannot be read or written.
    #[error("a file cannot be read or written: {0}")]
    File(#[from] io::Error),
}

impl From<ClientError> for ServerError {
    fn from(error: ClientError) -> Self {
        Self::Unreachable(error.to_string())
    }
}

impl ServerError {
    /// Another attempt has the task.
    pub(super) fn lost() -> Self {
        let detail = "another attempt has the task".to_owned();
        Self::Refused { status: StatusCode::CONFLICT, kind: "lease-lost".to_owned(), detail }
    }

    /// Whether the server refuses this worker for good: another build or other bits, or a key that opens nothing.
    pub(crate) fn is_final(&self) -> bool {
        match self {
            Self::Refused { status, kind, .. } => {
                kind == "worker-refused"
                    || [StatusCode::UNAUTHORIZED, StatusCode::FORBIDDEN, StatusCode::NOT_FOUND]
                        .contains(status)
            }
            _ => false,
        }
    }

    /// Whether the lease that the request was about is lost.
    pub(super) fn is_lost(&self) -> bool {
        matches!(self, Self::Refused { kind, .. } if kind == "lease-lost")
    }

    /// Whether the same request may succeed later.
    pub(super) fn passes(&self) -> bool {
        match self {
            Self::Unreachable(_) | Self::File(_) => true,
            Self::Refused { status, .. } => {
                status.is_server_error()
                    || [StatusCode::TOO_MANY_REQUESTS, StatusCode::REQUEST_TIMEOUT].contains(status)
            }
        }
    }
}

/// The server of a worker.
#[derive(Clone, Debug)]
pub(crate) struct Server {
    service: Kept,
    /// Path before `/v1`, where a proxy has one.
    prefix: String,
    key: Arc<ApiKey>,
}

impl Server {
    /// The server at a URL, with the file of an API key where it asks for one.
    ///
    /// # Errors
    /// What is wrong with the URL or the key, in one sentence.
    pub(crate) fn new(url: &str, key_file: Option<&Path>) -> Result<Self, String> {
        let uri: Uri = url.parse().map_err(|error| format!("--server: {url:?} is no URL: {error}"))?;
        let origin = Origin::of(&uri).map_err(|fault| format!("--server: {url:?} {fault}"))?;
        let named = |error| format!("--key-file {}: {error}", key_file.unwrap_or(Path::new("")).display());
        let key = Arc::new(ApiKey::of(key_file).map_err(named)?);
        let prefix = uri.path().trim_end_matches('/').to_owned();
        Ok(Self { service: Kept::to(origin), prefix, key })
    }

    /// POST of a JSON document whose answer may be held back for so long; `None` where it has no content.
    pub(super) async fn post<T: DeserializeOwned>(
        &self,
        path: &str,
        document: &impl Serialize,
        wait: Duration,
    ) -> Result<Option<T>, ServerError> {
        let body = serde_json::to_vec(document).map_err(|error| io::Error::other(error.to_string()))?;
        let mut fields = vec![(CONTENT_TYPE, HeaderValue::from_static("application/json"))];
        if !wait.is_zero()
            && let Ok(prefer) = HeaderValue::try_from(format!("wait={}", wait.as_secs_f64().ceil()))
        {
            fields.push((hyper::header::HeaderName::from_static("prefer"), prefer));
        }
        let body = Bytes::from(body);
        let send = || self.send(Method::POST, path, Body::from(body.clone()), &fields, wait + ANSWER);
        let response = self.with_key(send).await?;
        if response.status() == StatusCode::NO_CONTENT {
            return Ok(None);
        }
        read(response).await.map(Some)
    }

    /// PUT of a file as it lies, behind `head`.
    pub(super) async fn put_file(&self, path: &str, head: Vec<u8>, file: File) -> Result<(), ServerError> {
        let length = head.len() as u64 + file.metadata()?.len();
        let (head, begin) = (Bytes::from(head), file);
        let fields = [
            (CONTENT_LENGTH, HeaderValue::from(length)),
            (CONTENT_TYPE, HeaderValue::from_static("application/octet-stream")),
        ];
        let limit = ANSWER + Duration::from_secs(length / LEAST_SPEED);
        let send = || async {
            let mut file = begin.try_clone()?;
            // Both have one position.
            file.rewind()?;
            let file = io::Cursor::new(head.clone()).chain(tokio::fs::File::from_std(file));
            let body = Body::from_stream(ReaderStream::with_capacity(file, 1 << 18));
            self.send(Method::PUT, path, body, &fields, limit).await
        };
        let answer = self.with_key(send).await?;
        // What it says is not needed, but the connection is used again only when it was read.
        let answer = http_body_util::Limited::new(answer.into_body(), MAX_JSON_BYTES).collect();
        let _ = timeout(ANSWER, answer).await;
        Ok(())
    }

    /// GET of a file, piece by piece.
    pub(super) async fn get_file(
        &self,
        path: &str,
        mut keep: impl FnMut(&Bytes) -> io::Result<()>,
    ) -> Result<(), ServerError> {
        let send = || self.send(Method::GET, path, Body::empty(), &[], ANSWER);
        let mut body = self.with_key(send).await?.into_body();
        loop {
            let frame = timeout(ANSWER, body.frame()).await.map_err(|_| too_late())?;
            let Some(frame) = frame else { return Ok(()) };
            let frame = frame.map_err(|error| ServerError::Unreachable(error.to_string()))?;
            if let Some(data) = frame.data_ref() {
                keep(data)?;
            }
        }
    }

    /// Sends a request; once more where the server has refused the key and its file has another one by now.
    async fn with_key<Sending>(&self, send: impl Fn() -> Sending) -> Result<Response<Incoming>, ServerError>
    where
        Sending: Future<Output = Result<Response<Incoming>, ServerError>>,
    {
        let sent = self.key.authorization();
        match send().await {
            Err(ServerError::Refused { status: StatusCode::UNAUTHORIZED, .. })
                if self.key.has_changed(sent.as_ref()) =>
            {
                send().await
            }
            answered => answered,
        }
    }

    async fn send(
        &self,
        method: Method,
        path: &str,
        body: Body,
        fields: &[(hyper::header::HeaderName, HeaderValue)],
        limit: Duration,
    ) -> Result<Response<Incoming>, ServerError> {
        let mut request = Request::builder().method(method).uri(format!("{}{path}", self.prefix));
        for (name, value) in fields {
            request = request.header(name, value);
        }
        if let Some(authorization) = self.key.authorization() {
            request = request.header(AUTHORIZATION, authorization);
        }
        let request = request.body(body).map_err(ClientError::from)?;
        let response = timeout(limit, self.service.send(request)).await.map_err(|_| too_late())??;
        let status = response.status();
        if status.is_success() {
            return Ok(response);
        }
        let problem: Value = read(response).await.unwrap_or_default();
        let text = |member: &str| problem[member].as_str().unwrap_or_default();
        let kind = text("type").rsplit('/').next().unwrap_or_default().to_owned();
        Err(ServerError::Refused { status, kind, detail: text("detail").to_owned() })
    }
}

fn too_late() -> ServerError {
    ServerError::Unreachable("the answer took too long".into())
}

async fn read<T: DeserializeOwned>(response: Response<Incoming>) -> Result<T, ServerError> {
    let body = http_body_util::Limited::new(response.into_body(), MAX_JSON_BYTES).collect();
    let collected = timeout(ANSWER, body).await.map_err(|_| too_late())?;
    let bytes = collected.map_err(|error| ServerError::Unreachable(error.to_string()))?.to_bytes();
    serde_json::from_slice(&bytes).map_err(|error| ServerError::Unreachable(error.to_string()))
}
