//! A client that holds every answer against the contract before a test sees it.

use std::io::Read as _;
use std::net::SocketAddr;
use std::time::Duration;

use bytes::Bytes;
use flate2::read::GzDecoder;
use reqwest::header::{HeaderMap, HeaderValue};
use reqwest::{Method, StatusCode};
use serde_json::Value;

use super::contract::{Answer, Contract, essence};
use super::deadline::{PATIENCE, patiently};
use super::sse::EventStream;

/// Talks to one server.
#[derive(Clone)]
pub(crate) struct Client {
    http: reqwest::Client,
    base: String,
    key: Option<String>,
}

/// A request under construction.
pub(crate) struct Request {
    method: Method,
    path: String,
    inner: reqwest::RequestBuilder,
}

/// An answer that the contract has.
#[derive(Debug)]
pub(crate) struct Reply {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Client {
    /// A client of the server at `address`.
    pub(crate) fn new(address: SocketAddr) -> Self {
        let http = reqwest::Client::builder()
            // A proxy of the machine must not come between.
            .no_proxy()
            .timeout(PATIENCE)
            .build()
            .expect("a client");
        Self { http, base: format!("http://{address}"), key: None }
    }

    /// The same client, showing this key.
    pub(crate) fn with_key(&self, key: &str) -> Self {
        Self { key: Some(key.to_owned()), ..self.clone() }
    }

    /// A request by any method; `target` is a path with or without a query.
    pub(crate) fn request(&self, method: Method, target: &str) -> Request {
        let mut inner = self.http.request(method.clone(), format!("{}{target}", self.base));
        if let Some(key) = &self.key {
            inner = inner.bearer_auth(key);
        }
        let path = target.split('?').next().unwrap_or_default().to_owned();
        Request { method, path, inner }
    }

    pub(crate) fn get(&self, target: &str) -> Request {
        self.request(Method::GET, target)
    }

    pub(crate) fn head(&self, target: &str) -> Request {
        self.request(Method::HEAD, target)
    }

    pub(crate) fn post(&self, target: &str) -> Request {
        self.request(Method::POST, target)
    }

    pub(crate) fn delete(&self, target: &str) -> Request {
        self.request(Method::DELETE, target)
    }

    /// Submits a job and returns it.
    pub(crate) async fn submit(&self, job: &Value) -> Value {
        self.post("/v1/jobs").json(job).send().await.expect(201).json()
    }

    /// Submits a job and waits until it has succeeded.
    pub(crate) async fn succeed(&self, job: &Value) -> Value {
        let submitted = self.submit(job).await;
        let finished = self.finished(id_of(&submitted)).await;
        assert_eq!(finished["state"], "succeeded", "{finished:#}");
        finished
    }

    /// The job.
    pub(crate) async fn job(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}")).send().await.expect(200).json()
    }

    /// The request of a job, with its defaults filled in.
    pub(crate) async fn request_of(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}/request")).send().await.expect(200).json()
    }

    /// Long-polls until the job is in a final state.
    pub(crate) async fn finished(&self, id: &str) -> Value {
        self.job_when(id, "finished", |job| {
            ["succeeded", "failed", "cancelled"].contains(&job["state"].as_str().unwrap_or_default())
        })
        .await
    }

    /// Long-polls until the job is running.
    pub(crate) async fn running(&self, id: &str) -> Value {
        self.job_when(id, "running", |job| job["state"] == "running").await
    }

    /// Long-polls until `reached` holds for the job.
    pub(crate) async fn job_when(&self, id: &str, what: &str, reached: impl Fn(&Value) -> bool) -> Value {
        self.when(&format!("/v1/jobs/{id}"), what, reached).await
    }

    /// Long-polls until `reached` holds for what is at the path.
    pub(crate) async fn when(&self, path: &str, what: &str, reached: impl Fn(&Value) -> bool) -> Value {
        let poll = async {
            let mut etag: Option<HeaderValue> = None;
            loop {
                let mut request = self.get(path);
                if let Some(etag) = &etag {
                    request =
                        request.header("if-none-match", etag.to_str().unwrap()).header("prefer", "wait=20");
                }
                let reply = request.send().await;
                if reply.status == StatusCode::NOT_MODIFIED {
                    continue;
                }
                let found = reply.expect(200).json();
                if reached(&found) {
                    return found;
                }
                etag = reply.headers.get("etag").cloned();
                assert!(etag.is_some(), "{path} without an ETag");
            }
        };
        patiently(&format!("{path} to be {what}"), poll).await
    }

    /// Submits a study and returns it.
    pub(crate) async fn submit_study(&self, study: &Value) -> Value {
        self.post("/v1/studies").json(study).send().await.expect(201).json()
    }

    /// Long-polls until `reached` holds for the study.
    pub(crate) async fn study_when(&self, id: &str, what: &str, reached: impl Fn(&Value) -> bool) -> Value {
        self.when(&format!("/v1/studies/{id}"), what, reached).await
    }

    /// Long-polls until no job of the study is left to run.
    pub(crate) async fn study_finished(&self, id: &str) -> Value {
        self.study_when(id, "finished", |study| !study["finished_at"].is_null()).await
    }

    /// The rows of the study's table.
    pub(crate) async fn table(&self, id: &str) -> Vec<Value> {
        let table = self.get(&format!("/v1/studies/{id}/table")).send().await.expect(200).json();
        table["rows"].as_array().expect("rows").clone()
    }

    /// All jobs of the study, newest first.
    pub(crate) async fn jobs_of(&self, id: &str) -> Vec<Value> {
        let (mut jobs, mut cursor) = (Vec::new(), String::new());
        loop {
            let page = format!("/v1/studies/{id}/jobs?limit=500{cursor}");
            let page = self.get(&page).send().await.expect(200).json();
            jobs.extend(page["items"].as_array().expect("items").iter().cloned());
            match page["next_cursor"].as_str() {
                Some(next) => cursor = format!("&cursor={next}"),
                None => return jobs,
            }
        }
    }

    /// The value of a metric, which is named with its labels.
    pub(crate) async fn metric(&self, name: &str) -> f64 {
        let answer = self.get("/metrics").send().await;
        let text = std::str::from_utf8(&answer.expect(200).body).unwrap();
        let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        value.unwrap_or_else(|| panic!("no {name} in\n{text}")).parse().unwrap()
    }

    /// Waits until nothing is at an address.
    pub(crate) async fn gone(&self, path: &str) {
        patiently(path, async {
            let mut look_again = tokio::time::interval(Duration::from_millis(50));
            while self.get(path).send().await.status != StatusCode::NOT_FOUND {
                look_again.tick().await;
            }
        })
        .await;
    }

    /// Waits until `reached` holds for a metric.
    pub(crate) async fn metric_when(&self, name: &str, reached: impl Fn(f64) -> bool) {
        patiently(name, async {
            let mut look_again = tokio::time::interval(Duration::from_millis(50));
            while !reached(self.metric(name).await) {
                look_again.tick().await;
            }
        })
        .await;
    }

    /// The result as JSON.
    pub(crate) async fn result(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}/result?format=json")).send().await.expect(200).json()
    }

    /// The result's bytes in a format.
    pub(crate) async fn result_in(&self, id: &str, format: &str) -> Bytes {
        self.get(&format!("/v1/jobs/{id}/result?format={format}")).send().await.expect(200).body.clone()
    }

    /// The events of a job.
    pub(crate) async fn events(&self, id: &str, last_event_id: Option<&str>) -> EventStream {
        let mut request = self.get(&format!("/v1/jobs/{id}/events"));
        if let Some(last) = last_event_id {
            request = request.header("last-event-id", last);
        }
        EventStream::new(request.stream().await)
    }
}

impl Request {
    pub(crate) fn header(mut self, name: &str, value: &str) -> Self {
        self.inner = self.inner.header(name, value);
        self
    }

    pub(crate) fn json(mut self, body: &Value) -> Self {
        self.inner = self.inner.json(body);
        self
    }

    /// A body as it is, declared as JSON.
    pub(crate) fn text(mut self, body: impl Into<String>) -> Self {
        self.inner = self.inner.header("content-type", "application/json").body(body.into());
        self
    }

    pub(crate) fn body(mut self, body: impl Into<reqwest::Body>) -> Self {
        self.inner = self.inner.body(body);
        self
    }

    pub(crate) fn timeout(mut self, limit: Duration) -> Self {
        self.inner = self.inner.timeout(limit);
        self
    }

    /// Sends it; an answer that the contract does not have, or none, is a panic.
    pub(crate) async fn send(self) -> Reply {
        let what = format!("{} {}", self.method, self.path);
        match self.try_send().await {
            Ok(reply) => reply,
            Err(error) => panic!("{what} was not answered: {error:?}"),
        }
    }

    /// Sends it to a server that may die meanwhile; what it does answer is held against the contract.
    pub(crate) async fn try_send(self) -> reqwest::Result<Reply> {
        let (method, path) = (self.method, self.path);
        let response = self.inner.send().await?;
        let (status, headers) = (response.status(), response.headers().clone());
        let body = response.bytes().await?;
        let reply = Reply { status, headers, body };
        let read = (method != Method::HEAD).then_some(&reply.body[..]);
        check(&method, &path, status, &reply.headers, read);
        Ok(reply)
    }

    /// Sends it and leaves the body to the caller.
    pub(crate) async fn stream(self) -> reqwest::Response {
        let (method, path) = (self.method, self.path);
        // The limit for a whole answer is no limit for a stream.
        let response = self.inner.timeout(Duration::from_mins(10)).send().await.expect("an answer");
        check(&method, &path, response.status(), response.headers(), None);
        assert!(response.status().is_success(), "{method} {path}: {}", response.status());
        response
    }
}

fn check(method: &Method, path: &str, status: StatusCode, headers: &HeaderMap, body: Option<&[u8]>) {
    // What this server answers; a client that is sent to a bucket gets the answer of that.
    if headers.contains_key("x-request-id") {
        let field = |name: &str| headers.get(name).map(|value| value.to_str().expect("ASCII"));
        assert_eq!(field("x-content-type-options"), Some("nosniff"), "{method} {path}: {headers:?}");
        let kept = field("cache-control").unwrap_or_else(|| panic!("{method} {path}: no Cache-Control"));
        let is_error = status.is_client_error() || status.is_server_error();
        assert!(!is_error || kept == "no-store", "{method} {path}: {status} with Cache-Control {kept}");
    }
    let content_type =
        headers.get("content-type").map(|value| value.to_str().expect("an ASCII content type"));
    // The contract is one of what is sent, before its coding.
    let decoded = body.filter(|_| headers.get("content-encoding").is_some()).map(|coded| {
        let mut decoded = Vec::new();
        GzDecoder::new(coded).read_to_end(&mut decoded).expect("gzip");
        decoded
    });
    let body = decoded.as_deref().or(body);
    Contract::get().check(&Answer {
        method: method.as_str(),
        path,
        status: status.as_u16(),
        content_type,
        body,
    });
}

impl Reply {
    /// Panics unless it has this status.
    #[track_caller]
    pub(crate) fn expect(&self, status: u16) -> &Self {
        assert_eq!(self.status.as_u16(), status, "{}", String::from_utf8_lossy(&self.body));
        self
    }

    /// Panics unless it is this problem with this status; returns the problem document.
    #[track_caller]
    pub(crate) fn expect_problem(&self, status: u16, slug: &str) -> Value {
        self.expect(status);
        assert_eq!(essence(self.header("content-type")), "application/problem+json");
        let problem = self.json();
        assert_eq!(problem["status"], status, "{problem:#}");
        let kind = problem["type"].as_str().expect("a problem has a type");
        assert_eq!(kind.rsplit('/').next(), Some(slug), "{problem:#}");
        problem
    }

    /// The body as JSON.
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("a JSON body")
    }

    /// A header that must be there.
    #[track_caller]
    pub(crate) fn header(&self, name: &str) -> &str {
        let value = self.headers.get(name).unwrap_or_else(|| panic!("no {name} in {:?}", self.headers));
        value.to_str().expect("an ASCII header")
    }
}

/// The id of a job.
#[track_caller]
pub(crate) fn id_of(job: &Value) -> &str {
    job["id"].as_str().expect("a job has an id")
}
