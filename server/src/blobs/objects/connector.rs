//! The client of HTTP that the rest of the server uses too, for the crate `object_store`.

use std::time::Duration;

use async_trait::async_trait;
use axum::body::Body;
use http_body_util::BodyExt as _;
use hyper::{Request, Uri};
use object_store::client::{
    ClientConfigKey, ClientOptions, HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest,
    HttpResponse, HttpResponseBody, HttpService,
};
use tokio::time::timeout;

use crate::http_client::{ClientError, Origin};

/// Time for the head of an answer, beside that for the bytes that are sent.
const ANSWER: Duration = Duration::from_secs(20);
/// Bytes that can be sent in a second at least.
const LEAST_SPEED: u64 = 256 << 10;

/// Makes clients.
#[derive(Debug)]
pub(super) struct Connector;

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let allow_http = options.get_config_value(&ClientConfigKey::AllowHttp);
        Ok(HttpClient::new(Client { allow_http: allow_http.is_some_and(|value| value == "true") }))
    }
}

#[derive(Debug)]
struct Client {
    allow_http: bool,
}

#[async_trait]
impl HttpService for Client {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let (mut parts, body) = request.into_parts();
        if parts.uri.scheme_str() == Some("http") && !self.allow_http {
            return Err(failed(HttpErrorKind::Unknown, "http:// is used only with AWS_ALLOW_HTTP=true"));
        }
        let origin = Origin::of(&parts.uri).map_err(|fault| failed(HttpErrorKind::Unknown, fault))?;
        let path = parts.uri.path_and_query().map_or("/", |path| path.as_str());
        parts.uri = path.parse::<Uri>().map_err(|error| HttpError::new(HttpErrorKind::Unknown, error))?;
        let limit = ANSWER + Duration::from_secs(body.content_length() as u64 / LEAST_SPEED);
        let answer = timeout(limit, origin.send(Request::from_parts(parts, Body::new(body)))).await;
        let answer =
            answer.map_err(|late| HttpError::new(HttpErrorKind::Timeout, late))?.map_err(of_client)?;
        let broken = |error| HttpError::new(HttpErrorKind::Interrupted, error);
        Ok(answer.map(|body| HttpResponseBody::new(body.map_err(broken))))
    }
}

/// A connection that failed, or broke off before the answer, is tried again.
fn of_client(error: ClientError) -> HttpError {
    let kind = match &error {
        ClientError::Connection(_) => HttpErrorKind::Connect,
        ClientError::Exchange(_) => HttpErrorKind::Request,
        ClientError::Request(_) => HttpErrorKind::Unknown,
    };
    HttpError::new(kind, error)
}

fn failed(kind: HttpErrorKind, text: &str) -> HttpError {
    HttpError::new(kind, std::io::Error::other(text.to_owned()))
}
