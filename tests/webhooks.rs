//! Webhooks: signed messages at the end of jobs and studies, to receivers on loopback that the server allows.

use std::collections::VecDeque;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::response::IntoResponse as _;
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use hmac::{Hmac, Mac as _};
use serde_json::{Value, json};
use sha2::Sha256;
use tokio::sync::{Semaphore, mpsc};

use crate::harness::deadline::patiently;
use crate::harness::machine::has_tools_of_scripts;
use crate::harness::{
    Client, Contract, DataDir, Launch, Reply, Running, Server, id_of, jobs, packstone, run,
};

/// A request that a receiver got.
#[derive(Debug)]
pub(crate) struct Message {
    method: Method,
    target: String,
    headers: HeaderMap,
    body: Bytes,
}

impl Message {
    fn header(&self, name: &str) -> &str {
        self.headers.get(name).unwrap_or_else(|| panic!("no {name}")).to_str().unwrap()
    }

    /// The body, which is what the interface document says of messages of its type.
    fn json(&self) -> Value {
        let body: Value = serde_json::from_slice(&self.body).unwrap();
        let kind = body["type"].as_str().unwrap();
        let post = &Contract::get().document()["webhooks"][kind]["post"];
        for header in post["parameters"].as_array().unwrap() {
            self.header(header["name"].as_str().unwrap());
        }
        let schema = format!("/webhooks/{kind}/post/requestBody/content/application~1json/schema");
        if let Err(why) = Contract::get().judge_value(&schema, &body) {
            panic!("{why}: {body:#}");
        }
        body
    }

    /// Whether the signature is that of the secret, computed here from the standard.
    fn verifies(&self, secret: &str) -> bool {
        let key = BASE64_STANDARD.decode(secret.strip_prefix("whsec_").unwrap()).unwrap();
        let mut mac = Hmac::<Sha256>::new_from_slice(&key).unwrap();
        mac.update(self.header("webhook-id").as_bytes());
        mac.update(b".");
        mac.update(self.header("webhook-timestamp").as_bytes());
        mac.update(b".");
        mac.update(&self.body);
        let expected = format!("v1,{}", BASE64_STANDARD.encode(mac.finalize().into_bytes()));
        self.header("webhook-signature").split(' ').any(|signature| signature == expected)
    }
}

/// A receiver of webhooks; it answers 204 unless it was told otherwise.
pub(crate) struct Receiver {
    address: SocketAddr,
    messages: mpsc::UnboundedReceiver<Message>,
    answers: Arc<Mutex<VecDeque<u16>>>,
    /// A permit for each answer, where answers are held back.
    permits: Arc<Semaphore>,
}

#[derive(Clone)]
struct Shared {
    got: mpsc::UnboundedSender<Message>,
    answers: Arc<Mutex<VecDeque<u16>>>,
    permits: Arc<Semaphore>,
}

impl Receiver {
    async fn start(ip: &str) -> Self {
        let receiver = Self::holding_back(ip).await;
        receiver.let_go();
        receiver
    }

    /// One that answers nothing.
    pub(crate) async fn holding_back(ip: &str) -> Self {
        let listener = tokio::net::TcpListener::bind((ip, 0)).await.unwrap();
        let address = listener.local_addr().unwrap();
        let (got, messages) = mpsc::unbounded_channel();
        let (answers, permits) = (Arc::default(), Arc::new(Semaphore::new(0)));
        let shared = Shared { got, answers: Arc::clone(&answers), permits: Arc::clone(&permits) };
        let router = Router::new().fallback(receive).with_state(shared);
        tokio::spawn(async move { axum::serve(listener, router).await });
        Self { address, messages, answers, permits }
    }

    pub(crate) fn url(&self, path: &str) -> Value {
        json!(format!("http://{}{path}", self.address))
    }

    /// The statuses of the next answers.
    fn answer(&self, statuses: &[u16]) {
        self.answers.lock().unwrap().extend(statuses);
    }

    /// Answers all that waits for an answer, and all that comes.
    pub(crate) fn let_go(&self) {
        self.permits.add_permits(Semaphore::MAX_PERMITS / 2);
    }

    pub(crate) async fn next(&mut self) -> Message {
        patiently("a webhook", self.messages.recv()).await.unwrap()
    }

    /// Panics if there is another message.
    pub(crate) fn nothing_more(&mut self) {
        assert!(self.messages.try_recv().is_err(), "another message");
    }
}

async fn receive(
    State(shared): State<Shared>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
    body: Bytes,
) -> axum::response::Response {
    let status = shared.answers.lock().unwrap().pop_front().unwrap_or(204);
    // The test may have ended.
    let _ = shared.got.send(Message { method, target: uri.to_string(), headers, body });
    let Ok(_answered) = shared.permits.acquire().await else { unreachable!("the permits are never closed") };
    (StatusCode::from_u16(status).unwrap(), [(header::LOCATION, "/elsewhere")]).into_response()
}

/// A secret in a file of its own.
pub(crate) struct Secret {
    _folder: tempfile::TempDir,
    file: PathBuf,
    text: String,
}

impl Secret {
    pub(crate) async fn make() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let made = packstone(folder.path(), &["webhook-secret"]).await;
        assert_eq!(made.code, Some(0), "{made:?}");
        let text = made.stdout.trim().to_owned();
        let file = folder.path().join("secret");
        std::fs::write(&file, &made.stdout).unwrap();
        Self { _folder: folder, file, text }
    }

    /// A server that signs with it and allows loopback; what fails is sent again soon.
    pub(crate) fn launch(&self, data_dir: &DataDir) -> Launch {
        self.launch_strict(data_dir).env("PACKSTONE_WEBHOOK_ALLOWED_HOST", "127.0.0.1,127.0.0.2")
    }

    /// The same without an allowed host.
    fn launch_strict(&self, data_dir: &DataDir) -> Launch {
        let launch = Launch::new(data_dir).env("PACKSTONE_WEBHOOK_SECRET_FILE", self.file.to_str().unwrap());
        launch.args(&["--webhook-first-pause-s", "0.05"])
    }
}

pub(crate) fn with_url(job: Value, url: &Value) -> Value {
    jobs::with(job, "/webhook_url", url.clone())
}

/// Long-polls until the webhook of the job is in a state.
pub(crate) async fn webhook_of(client: &Client, id: &str, state: &str) -> Value {
    client.job_when(id, state, |job| job["webhook"]["state"] == state).await["webhook"].clone()
}

/// The value of a counter of webhooks.
async fn counted(client: &Client, outcome: &str) -> u64 {
    let metrics = client.get("/metrics").send().await;
    let text = String::from_utf8(metrics.expect(200).body.to_vec()).unwrap();
    let line = format!("packstone_webhook_deliveries_total{{outcome=\"{outcome}\"}} ");
    text.lines().find_map(|found| found.strip_prefix(&line)).map_or(0, |count| count.parse().unwrap())
}

#[tokio::test]
async fn the_end_of_a_job_is_one_signed_message() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let server = secret.launch(&data_dir).env("PACKSTONE_LOG", "debug").start().await;
    let (client, mut receiver) = (server.client(), Receiver::start("127.0.0.1").await);
    let capabilities = client.get("/v1/capabilities").send().await.expect(200).json();
    assert_eq!(capabilities["webhooks"], true);
    let job = with_url(jobs::with(jobs::quick(1), "/name", json!("wh")), &receiver.url("/in?token=geheim"));
    let job = jobs::with(job, "/labels", json!({"series": "TB-7"}));
    let submitted = client.submit(&job).await;
    let id = id_of(&submitted).to_owned();
    assert_eq!(submitted["webhook"]["url"], receiver.url("/in?token=geheim"));
    assert_eq!(submitted["webhook"]["attempts"], 0);
    let message = receiver.next().await;
    assert_eq!((message.method.as_str(), message.target.as_str()), ("POST", "/in?token=geheim"));
    assert_eq!(message.header("host"), receiver.address.to_string());
    assert_eq!(message.header("content-type"), "application/json");
    assert!(message.header("user-agent").starts_with("packstone/"));
    assert!(message.verifies(&secret.text), "{message:?}");
    assert!(!message.verifies("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"));
    let sent_at: i64 = message.header("webhook-timestamp").parse().unwrap();
    assert!((jiff::Timestamp::now().as_second() - sent_at).abs() < 60);
    let ended = client.job(&id).await;
    let expected = json!({
        "type": "job.succeeded", "timestamp": message.json()["timestamp"],
        "data": {
            "id": id, "name": "wh", "labels": {"series": "TB-7"}, "state": "succeeded",
            "links": {"self": format!("/v1/jobs/{id}")}
        }
    });
    assert_eq!(message.json(), expected);
    let time = |value: &Value| value.as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    assert_eq!(time(&message.json()["timestamp"]), time(&ended["finished_at"]));
    let webhook = webhook_of(&client, &id, "delivered").await;
    assert_eq!((&webhook["attempts"], &webhook["last_status"]), (&json!(1), &json!(204)));
    assert!(webhook["last_error"].is_null() && webhook["next_attempt_at"].is_null());
    assert!(time(&webhook["delivered_at"]) >= time(&ended["finished_at"]));

    // Other ends have other types.
    let failing = client.submit(&with_url(jobs::unreachable(), &receiver.url("/failed"))).await;
    let body = receiver.next().await.json();
    assert_eq!((&body["type"], &body["data"]["id"]), (&json!("job.failed"), &failing["id"]));
    assert_eq!(body["data"]["error"]["code"], "target-not-reached");
    let detail = client.job(id_of(&failing)).await["error"]["detail"].clone();
    assert_eq!(body["data"]["error"]["detail"], detail);
    let running = client.submit(&with_url(jobs::endless(), &receiver.url("/cancelled"))).await;
    client.running(id_of(&running)).await;
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&running))).send().await.expect(202);
    let message = receiver.next().await;
    assert_eq!(message.json()["type"], "job.cancelled");
    // A job without the field sends nothing, and a retried one sends again.
    client.succeed(&jobs::quick(2)).await;
    client.post(&format!("/v1/jobs/{}/retry", id_of(&failing))).send().await.expect(200);
    let again = receiver.next().await;
    assert_eq!((again.target.as_str(), &again.json()["type"]), ("/failed", &json!("job.failed")));
    webhook_of(&client, id_of(&failing), "delivered").await;
    receiver.nothing_more();
    assert_eq!(counted(&client, "delivered").await, 4);

    // The URL is in the view of the job and nowhere else.
    let shown = client.get(&format!("/v1/jobs/{id}?include=request")).send().await.expect(200).json();
    assert_eq!(shown["request"].get("webhook_url"), None);
    assert_eq!(client.request_of(&id).await.get("webhook_url"), None);
    assert!(!client.result(&id).await.to_string().contains("geheim"));
    server.terminate();
    let log = server.log_at_end().await;
    assert!(log.contains("webhook delivered") && log.contains("127.0.0.1"), "{log}");
    assert!(!log.contains("geheim") && !log.contains(&secret.text), "{log}");
}

#[tokio::test]
async fn a_study_is_one_message_and_its_jobs_none() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let server = secret.launch(&data_dir).start().await;
    let (client, mut receiver) = (server.client(), Receiver::start("127.0.0.1").await);
    let study =
        json!({"name": "s", "list": [jobs::quick(1), jobs::quick(2)], "webhook_url": receiver.url("/s")});
    let submitted = client.submit_study(&study).await;
    let id = id_of(&submitted).to_owned();
    assert_eq!(submitted["request"].get("webhook_url"), None);
    assert_eq!(
        (&submitted["webhook"]["url"], &submitted["webhook"]["state"]),
        (&receiver.url("/s"), &json!("waiting"))
    );
    let message = receiver.next().await;
    assert!(message.verifies(&secret.text));
    let body = message.json();
    assert_eq!(body["type"], "study.finished");
    let expected = json!({
        "id": id, "name": "s", "labels": {}, "state": "finished",
        "counts": {"succeeded": 2, "failed": 0, "cancelled": 0}, "links": {"self": format!("/v1/studies/{id}")}
    });
    assert_eq!(body["data"], expected);
    let delivered = |study: &Value| study["webhook"]["state"] == "delivered";
    client.study_when(&id, "told", delivered).await;
    receiver.nothing_more();
    for job in client.jobs_of(&id).await {
        assert_eq!(client.job(id_of(&job)).await.get("webhook"), None);
    }

    let in_a_job = json!({"list": [with_url(jobs::quick(1), &receiver.url("/j"))]});
    let problem =
        client.post("/v1/studies").json(&in_a_job).send().await.expect_problem(422, "validation-error");
    assert_eq!(problem["errors"][0]["pointer"], "/list/0/webhook_url", "{problem:#}");
    server.stop().await;
}

/// Changes the URL of a job's or a study's webhook.
async fn patch_url(client: &Client, path: &str, url: &Value) -> Reply {
    let patch = client.request(Method::PATCH, path).json(&json!({"webhook_url": url}));
    patch.header("content-type", "application/merge-patch+json").send().await
}

#[tokio::test]
async fn the_url_of_a_webhook_is_changed_and_removed() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let server = secret.launch(&data_dir).workers(1).start().await;
    let (client, mut receiver) = (server.client(), Receiver::start("127.0.0.1").await);
    let busy = client.submit(&jobs::endless()).await;
    client.running(id_of(&busy)).await;

    // While the jobs wait: set, changed, set and removed.
    let none = client.submit(&jobs::quick(1)).await;
    let first = client.submit(&with_url(jobs::quick(2), &receiver.url("/old"))).await;
    let removed = client.submit(&with_url(jobs::quick(3), &receiver.url("/removed"))).await;
    let path = |job: &Value| format!("/v1/jobs/{}", id_of(job));
    let set = patch_url(&client, &path(&none), &receiver.url("/set?token=geheim")).await.expect(200).json();
    assert_eq!(set["webhook"]["url"], receiver.url("/set?token=geheim"));
    assert_eq!(set["webhook"]["state"], "waiting");
    let changed = patch_url(&client, &path(&first), &receiver.url("/new")).await.expect(200).json();
    assert_eq!(changed["webhook"]["url"], receiver.url("/new"));
    let gone = patch_url(&client, &path(&removed), &Value::Null).await.expect(200).json();
    assert_eq!(gone.get("webhook"), None);
    patch_url(&client, &path(&removed), &Value::Null).await.expect(200);

    // The rules of a submission.
    for (url, says) in
        [("http://127.0.0.9/", "loopback"), ("ftp://example.org/", "scheme"), ("", "characters")]
    {
        let problem =
            patch_url(&client, &path(&first), &json!(url)).await.expect_problem(422, "validation-error");
        assert_eq!(problem["errors"][0]["pointer"], "/webhook_url", "{problem:#}");
        assert!(problem["detail"].as_str().unwrap().contains(says), "{problem:#}");
    }
    assert_eq!(client.job(id_of(&first)).await["webhook"]["url"], receiver.url("/new"));

    client.post(&format!("/v1/jobs/{}/cancel", id_of(&busy))).send().await.expect(202);
    let mut targets = vec![receiver.next().await.target, receiver.next().await.target];
    targets.sort();
    assert_eq!(targets, ["/new", "/set?token=geheim"]);
    client.finished(id_of(&removed)).await;

    // A message that is recorded goes where it was to go; the next one goes to the new URL.
    receiver.answer(&[500]);
    let failing = client.submit(&with_url(jobs::unreachable(), &receiver.url("/before"))).await;
    let id = id_of(&failing).to_owned();
    assert_eq!(receiver.next().await.target, "/before");
    patch_url(&client, &path(&failing), &receiver.url("/after")).await.expect(200);
    assert_eq!(receiver.next().await.target, "/before");
    client.post(&format!("/v1/jobs/{id}/retry")).send().await.expect(200);
    assert_eq!(receiver.next().await.target, "/after");
    webhook_of(&client, &id, "delivered").await;
    let gone = patch_url(&client, &path(&failing), &Value::Null).await.expect(200).json();
    assert_eq!(gone.get("webhook"), None);

    // A study has one, its jobs have none.
    let busy = client.submit(&jobs::endless()).await;
    client.running(id_of(&busy)).await;
    let study = client.submit_study(&json!({"list": [jobs::quick(1)]})).await;
    let study_path = format!("/v1/studies/{}", id_of(&study));
    let job = client.jobs_of(id_of(&study)).await.remove(0);
    let problem = patch_url(&client, &path(&job), &receiver.url("/job")).await;
    let problem = problem.expect_problem(422, "validation-error");
    assert!(
        problem["detail"].as_str().unwrap().contains("the jobs of a study send no messages"),
        "{problem:#}"
    );
    let problem = patch_url(&client, &study_path, &json!("http://10.0.0.1/")).await;
    problem.expect_problem(422, "validation-error");
    let set = patch_url(&client, &study_path, &receiver.url("/study")).await.expect(200).json();
    assert_eq!((&set["webhook"]["url"], &set["shared"]), (&receiver.url("/study"), &json!(false)));
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&busy))).send().await.expect(202);
    let message = receiver.next().await;
    assert_eq!((message.target.as_str(), &message.json()["type"]), ("/study", &json!("study.finished")));
    client.study_when(id_of(&study), "told", |study| study["webhook"]["state"] == "delivered").await;
    let gone = patch_url(&client, &study_path, &Value::Null).await.expect(200).json();
    assert_eq!(gone.get("webhook"), None);
    receiver.nothing_more();
    server.terminate();
    let log = server.log_at_end().await;
    assert!(!log.contains("geheim"), "{log}");

    // Without a secret there is none to set, and one to remove.
    let plain = Launch::new(&data_dir).start().await;
    let client = plain.client();
    let problem = patch_url(&client, &path(&first), &receiver.url("/x")).await;
    problem.expect_problem(422, "validation-error");
    let gone = patch_url(&client, &path(&first), &Value::Null).await.expect(200).json();
    assert_eq!(gone.get("webhook"), None);
    plain.stop().await;
}

#[tokio::test]
async fn a_message_is_sent_until_it_is_accepted_or_refused_for_good() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let server = secret.launch(&data_dir).start().await;
    let (client, mut receiver) = (server.client(), Receiver::start("127.0.0.1").await);
    receiver.answer(&[503, 302, 500, 200]);
    let job = client.submit(&with_url(jobs::quick(1), &receiver.url("/in"))).await;
    let webhook = webhook_of(&client, id_of(&job), "delivered").await;
    assert_eq!((&webhook["attempts"], &webhook["last_status"]), (&json!(4), &json!(200)));
    let mut ids = Vec::new();
    for _ in 0..4 {
        let message = receiver.next().await;
        assert!(message.verifies(&secret.text));
        // A redirect is not followed.
        assert_eq!(message.target, "/in");
        ids.push((message.header("webhook-id").to_owned(), message.body));
    }
    assert!(ids.iter().all(|sent| *sent == ids[0]), "{ids:?}");
    assert_eq!((counted(&client, "retried").await, counted(&client, "delivered").await), (3, 1));

    receiver.answer(&[410]);
    let job = client.submit(&with_url(jobs::quick(2), &receiver.url("/gone"))).await;
    let webhook = webhook_of(&client, id_of(&job), "failed").await;
    assert_eq!((&webhook["attempts"], &webhook["last_status"]), (&json!(1), &json!(410)));
    assert_eq!(webhook["last_error"], "the receiver answered 410");
    receiver.next().await;
    receiver.nothing_more();
    assert_eq!(counted(&client, "failed").await, 1);
    server.stop().await;
}

#[tokio::test]
async fn a_message_that_was_not_answered_survives_a_kill() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let server = secret.launch(&data_dir).start().await;
    let mut receiver = Receiver::holding_back("127.0.0.1").await;
    let job = server.client().submit(&with_url(jobs::quick(1), &receiver.url("/in"))).await;
    let first = receiver.next().await;
    server.kill().await;
    receiver.let_go();
    let server = secret.launch(&data_dir).start().await;
    let second = receiver.next().await;
    assert_eq!((first.header("webhook-id"), &first.body), (second.header("webhook-id"), &second.body));
    assert!(second.verifies(&secret.text));
    webhook_of(&server.client(), id_of(&job), "delivered").await;
    receiver.nothing_more();
    server.stop().await;
}

#[tokio::test]
async fn a_dead_receiver_holds_up_no_other() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let server = secret.launch(&data_dir).start().await;
    let client = server.client();
    let mut dead = Receiver::holding_back("127.0.0.2").await;
    let mut live = Receiver::start("127.0.0.1").await;
    let mut held_up = Vec::new();
    for seed in 1..=3 {
        held_up.push(client.succeed(&with_url(jobs::quick(seed), &dead.url("/in"))).await);
    }
    dead.next().await;
    let job = client.succeed(&with_url(jobs::quick(4), &live.url("/in"))).await;
    live.next().await;
    webhook_of(&client, id_of(&job), "delivered").await;
    // One message at a time is sent to a host, and what is deleted is not sent.
    dead.nothing_more();
    for job in &held_up[1..] {
        assert_eq!(client.job(id_of(job)).await["webhook"]["attempts"], 0);
        client.delete(&format!("/v1/jobs/{}", id_of(job))).send().await.expect(204);
    }
    dead.permits.add_permits(1_000_000);
    webhook_of(&client, id_of(&held_up[0]), "delivered").await;
    assert_eq!(counted(&client, "delivered").await, 2);
    server.stop().await;
}

#[tokio::test]
async fn addresses_that_are_not_public_are_refused() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let mut receiver = Receiver::start("127.0.0.1").await;
    let server = secret.launch_strict(&data_dir).start().await;
    let client = server.client();
    let refused = async |client: &Client, path: &str, body: &Value| {
        let problem = client.post(path).json(body).send().await.expect_problem(422, "validation-error");
        assert_eq!(problem["errors"][0]["pointer"], "/webhook_url", "{problem:#}");
        problem["errors"][0]["detail"].as_str().unwrap().to_owned()
    };
    let port = receiver.address.port();
    for host in
        ["127.0.0.1", "[::1]", "[::ffff:127.0.0.1]", "169.254.169.254", "10.0.0.1", "0.0.0.0", "2130706433"]
    {
        let job = with_url(jobs::quick(1), &json!(format!("http://{host}:{port}/in?token=geheim")));
        let detail = refused(&client, "/v1/jobs", &job).await;
        assert!(detail.contains("refused") && detail.contains("--webhook-allowed-host"), "{detail}");
        assert!(!detail.contains("geheim"), "{detail}");
        assert_eq!(refused(&client, "/v1/plans", &job).await, detail);
    }
    let study = json!({"list": [jobs::quick(1)], "webhook_url": receiver.url("/")});
    refused(&client, "/v1/studies", &study).await;
    for (url, says) in [
        (json!("ftp://a.example/"), "must be http or https"),
        (json!("http://user@a.example/"), "must have none"),
        (json!(format!("http://a.example/{}", "x".repeat(2000))), "at most 2000"),
        (json!(7), "7"),
    ] {
        let detail = refused(&client, "/v1/jobs", &with_url(jobs::quick(1), &url)).await;
        assert!(detail.contains(says), "{detail}");
    }
    // A name is resolved when the message is sent.
    let by_name = json!(format!("http://localhost:{port}/in"));
    let job = client.submit(&with_url(jobs::quick(1), &by_name)).await;
    let webhook = webhook_of(&client, id_of(&job), "failed").await;
    assert_eq!((&webhook["attempts"], &webhook["last_status"]), (&json!(1), &Value::Null));
    let error = webhook["last_error"].as_str().unwrap();
    assert!(error.contains("loopback") && error.contains("refused"), "{error}");
    receiver.nothing_more();
    server.stop().await;

    let server = Server::start(&data_dir).await;
    let detail =
        refused(&server.client(), "/v1/jobs", &with_url(jobs::quick(1), &json!("http://a.example/"))).await;
    assert!(detail.contains("--webhook-secret-file"), "{detail}");
    server.stop().await;

    // The name itself may be allowed.
    let server = secret.launch_strict(&data_dir).args(&["--webhook-allowed-host", "localhost"]).start().await;
    let job = server.client().submit(&with_url(jobs::quick(2), &by_name)).await;
    assert_eq!(receiver.next().await.header("host"), format!("localhost:{port}"));
    webhook_of(&server.client(), id_of(&job), "delivered").await;
    server.stop().await;
}

#[tokio::test]
async fn only_the_owner_sees_the_webhook() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let folder = tempfile::tempdir().unwrap();
    let (mut lines, mut keys) = (String::new(), Vec::new());
    for name in ["anna", "bert"] {
        let made = packstone(folder.path(), &["key", name, "--role", "submit"]).await;
        let mut printed = made.stdout.lines();
        keys.push(printed.next().unwrap().to_owned());
        lines += printed.next().unwrap();
        lines.push('\n');
    }
    let file = folder.path().join("keys");
    std::fs::write(&file, lines).unwrap();
    let server =
        secret.launch(&data_dir).env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap()).start().await;
    let [anna, bert] = [0, 1].map(|i| server.client().with_key(&keys[i]));
    let mut receiver = Receiver::start("127.0.0.1").await;
    let url = receiver.url("/in?token=geheim");
    let job = anna.submit(&jobs::with(with_url(jobs::quick(1), &url), "/shared", json!(true))).await;
    let study = json!({"list": [jobs::quick(2)], "webhook_url": url, "shared": true});
    let study = anna.submit_study(&study).await;
    for path in [format!("/v1/jobs/{}", id_of(&job)), format!("/v1/studies/{}", id_of(&study))] {
        let query = format!("{path}?include=request");
        let own = anna.get(&query).send().await.expect(200).json();
        assert_eq!(own["webhook"]["url"], url);
        let shared = bert.get(&query).send().await.expect(200).json();
        assert_eq!(shared.get("webhook"), None);
        assert!(!shared.to_string().contains("geheim"), "{shared:#}");
    }
    receiver.next().await;
    receiver.next().await;
    server.stop().await;
}

#[tokio::test]
async fn files_of_secrets_and_hosts_that_are_none_are_refused() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    for (content, says) in
        [("whsec_short\n", "line 1"), ("", "0 secrets"), (&secret.text.repeat(2), "line 1")]
    {
        std::fs::write(&secret.file, content).unwrap();
        let refused = run(secret.launch(&data_dir).into_command()).await;
        assert_ne!(refused.code, Some(0));
        let said = refused.stderr + &refused.stdout;
        assert!(said.contains(says) && said.contains(secret.file.to_str().unwrap()), "{content:?}: {said}");
        assert!(!said.contains("panicked") && !said.contains(&secret.text), "{said}");
    }
    let with_port = Launch::new(&data_dir).args(&["--webhook-allowed-host", "127.0.0.1:8080"]);
    let refused = run(with_port.into_command()).await;
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("without scheme and port"), "{}", refused.stderr);
}

/// The server sends the message of a job that a worker in another process has run. The worker does not learn the URL.
#[tokio::test]
async fn a_job_that_runs_elsewhere_ends_in_a_message_too() {
    let (secret, data_dir, folder) = (Secret::make().await, DataDir::new(), tempfile::tempdir().unwrap());
    let server = secret.launch(&data_dir).workers(0).start().await;
    let (client, mut receiver) = (server.client(), Receiver::start("127.0.0.1").await);
    let job = client.submit(&with_url(jobs::quick(1), &receiver.url("/in?token=geheim"))).await;
    let url = format!("http://{}", server.address());
    let args = ["worker", "--server", &url, "--name", "elsewhere", "--slots", "1", "--idle-exit-s", "1"];
    let worker = Running::spawn(folder.path(), &args);
    let message = receiver.next().await;
    assert!(message.verifies(&secret.text));
    assert_eq!(
        (&message.json()["type"], &message.json()["data"]["id"]),
        (&json!("job.succeeded"), &job["id"])
    );
    assert_eq!(client.job(id_of(&job)).await["worker"], "elsewhere");
    let ended = worker.ended().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(!(ended.stdout + &ended.stderr).contains("geheim"));
    server.stop().await;
}

/// Two secrets sign until the old one is taken out of the file, without a restart.
#[tokio::test]
async fn secrets_are_replaced_without_a_gap() {
    let (old, new, data_dir) = (Secret::make().await, Secret::make().await, DataDir::new());
    let server = old.launch(&data_dir).start().await;
    let (client, mut receiver) = (server.client(), Receiver::start("127.0.0.1").await);
    for (content, by_old, by_new) in [
        (format!("{}\n", old.text), true, false),
        (format!("# the new one\n{}\n{}\n", new.text, old.text), true, true),
        (format!("{}\n", new.text), false, true),
    ] {
        std::fs::write(&old.file, content).unwrap();
        client.submit(&with_url(jobs::quick(1), &receiver.url("/in"))).await;
        let message = receiver.next().await;
        assert_eq!((message.verifies(&old.text), message.verifies(&new.text)), (by_old, by_new));
    }
    server.stop().await;
}

/// Before a script, it says the port of its server in a first line: port 0 of the script is a free one, which nobody
/// can take in between.
const SAYS_PORT: &str = "
import http.server
class Server(http.server.HTTPServer):
    def server_activate(self):
        super().server_activate()
        print(self.server_port, flush=True)
http.server.HTTPServer = Server
";

/// Ends with the test.
struct Python(Child);

impl Drop for Python {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The receiver of `docs/operation.md`, as it stands there but for its port, is told of a job by a real server, and
/// refuses what is signed with another secret.
#[tokio::test]
async fn the_documented_receiver_verifies() {
    if !has_tools_of_scripts(&["python3"]) {
        return;
    }
    let docs = include_str!("../docs/operation.md");
    let script = docs.split("```python\n").nth(1).unwrap().split("```").next().unwrap();
    assert!(script.contains("8090") && script.contains("webhook-secret"));
    let (secret, other) = (Secret::make().await, Secret::make().await);
    for (signing, state) in [(&secret, "delivered"), (&other, "waiting")] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("webhook-secret"), &secret.text).unwrap();
        let mut python = Command::new("python3");
        python.args(["-c", &(SAYS_PORT.to_owned() + &script.replace("8090", "0"))]);
        python.current_dir(folder.path()).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut python = Python(python.spawn().expect("python3"));
        // Kept to the end, for the script prints what it is told.
        let mut said = BufReader::new(python.0.stdout.take().unwrap());
        let mut port = String::new();
        said.read_line(&mut port).unwrap();
        let port: u16 = port.trim().parse().unwrap();
        let data_dir = DataDir::new();
        let server = signing.launch(&data_dir).start().await;
        let client = server.client();
        let url = json!(format!("http://127.0.0.1:{port}/"));
        let job = client.succeed(&with_url(jobs::quick(1), &url)).await;
        let answered = |job: &Value| !job["webhook"]["last_status"].is_null();
        let webhook = client.job_when(id_of(&job), "answered", answered).await["webhook"].clone();
        let status = if state == "delivered" { 204 } else { 401 };
        assert_eq!(
            (&webhook["state"], &webhook["last_status"]),
            (&json!(state), &json!(status)),
            "{webhook:#}"
        );
        server.stop().await;
    }
}

/// A message to a good host does not wait for those to hosts that hang. Attempts are counted, not seconds: where the
/// hosts that hang go first, each of the 80 attempts ends before the message is sent (46 s).
#[tokio::test]
async fn hosts_that_hang_hold_up_no_other() {
    let (secret, data_dir) = (Secret::make().await, DataDir::new());
    let hosts: Vec<String> = (1..=80).map(|i| format!("127.0.1.{i}")).collect();
    let server = secret
        .launch_strict(&data_dir)
        .env("PACKSTONE_WEBHOOK_ALLOWED_HOST", &format!("127.0.0.1,{}", hosts.join(",")))
        .start()
        .await;
    let client = server.client();
    // All of them are one listener, which accepts and says nothing.
    let silent = tokio::net::TcpListener::bind("0.0.0.0:0").await.unwrap();
    let port = silent.local_addr().unwrap().port();
    let held = tokio::spawn(async move {
        let mut held = Vec::new();
        while let Ok((connection, _)) = silent.accept().await {
            held.push(connection);
        }
    });
    for (host, seed) in hosts.iter().zip(1..) {
        client.submit(&with_url(jobs::quick(seed), &json!(format!("http://{host}:{port}/")))).await;
    }
    let mut good = Receiver::start("127.0.0.1").await;
    let job = client.succeed(&with_url(jobs::quick(100), &good.url("/in"))).await;
    let ended_attempts = async || {
        let metrics = client.get("/metrics").send().await;
        let name = "packstone_webhook_deliveries_total{outcome=\"retried\"} ";
        let text = std::str::from_utf8(&metrics.expect(200).body).unwrap();
        // No line before the first.
        text.lines().find_map(|line| line.strip_prefix(name)).map_or(0.0, |count| count.parse().unwrap())
    };
    let before = ended_attempts().await;
    good.next().await;
    let meanwhile: f64 = ended_attempts().await - before;
    assert!(meanwhile < hosts.len() as f64 / 2.0, "{meanwhile} attempts have ended meanwhile");
    webhook_of(&client, id_of(&job), "delivered").await;
    held.abort();
    server.stop().await;
}
