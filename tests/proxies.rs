//! The service behind nginx: streams arrive as they are written, and the service may lie below a path.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use reqwest::header::{CONTENT_TYPE, LINK, LOCATION};
use reqwest::{Response, Url};
use serde_json::{Value, json};

use crate::harness::deadline::{eventually, patiently, within};
use crate::harness::{DataDir, Launch, Running, Server, id_of, jobs, machine};
use crate::users::Keys;

/// The variable that requires these tests.
const REQUIRED: &str = "PACKSTONE_NGINX";
const PROGRAM: &str = "/usr/sbin/nginx";
/// Time in which an event must pass: with its defaults, nginx holds them back for minutes.
const SOON: Duration = Duration::from_secs(20);

/// A running nginx.
struct Nginx {
    _folder: tempfile::TempDir,
    process: Child,
    port: u16,
}

impl Nginx {
    /// Starts one with these locations; `None` where it is not installed.
    async fn start(locations: &str) -> Option<Self> {
        if !Path::new(PROGRAM).exists() {
            machine::skip(
                REQUIRED,
                "nginx missing",
                "Install nginx; the service was not tested behind a proxy.",
            );
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let port = machine::port();
        let at = folder.path().display();
        let paths: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|kind| format!("{kind}_temp_path {at}/{kind};"))
            .concat();
        let text = format!(
            "daemon off; pid {at}/pid; error_log {at}/errors; worker_processes 1; events {{ worker_connections 256; }}\n\
             http {{ access_log off; {paths}\nserver {{ listen 127.0.0.1:{port};\n{locations}\n}} }}\n"
        );
        let config = folder.path().join("nginx.conf");
        std::fs::write(&config, text).unwrap();
        let process = Command::new(PROGRAM)
            .arg("-e")
            .arg(folder.path().join("errors"))
            .arg("-c")
            .arg(&config)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let nginx = Self { _folder: folder, process, port };
        eventually("nginx to listen", || std::net::TcpStream::connect(("127.0.0.1", port)).is_ok()).await;
        Some(nginx)
    }

    fn url(&self, path: &str) -> Url {
        format!("http://127.0.0.1:{}{path}", self.port).parse().unwrap()
    }
}

impl Drop for Nginx {
    fn drop(&mut self) {
        // Its master ends its workers at this signal.
        let _ = Command::new("kill").args(["-TERM", &self.process.id().to_string()]).status();
        let _ = self.process.wait();
    }
}

fn http() -> reqwest::Client {
    let no_redirects = reqwest::redirect::Policy::none();
    reqwest::Client::builder()
        .no_proxy()
        .redirect(no_redirects)
        .timeout(Duration::from_mins(2))
        .build()
        .unwrap()
}

async fn get(url: Url) -> Response {
    patiently("an answer", http().get(url).send()).await.unwrap()
}

/// Reads a stream until it has told this.
async fn read_until(stream: &mut Response, told: &str, read: &mut String) {
    within(SOON, &format!("{told:?} on a stream"), async {
        while !read.contains(told) {
            let chunk =
                stream.chunk().await.unwrap().unwrap_or_else(|| panic!("the stream ended after {read:?}"));
            read.push_str(&String::from_utf8_lossy(&chunk));
        }
    })
    .await;
}

fn as_it_comes(address: SocketAddr) -> String {
    format!("location / {{ proxy_pass http://{address}; }}")
}

#[tokio::test]
async fn behind_nginx_as_it_comes_every_event_arrives_at_once() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let Some(nginx) = Nginx::start(&as_it_comes(server.address())).await else { return };
    let client = server.client();
    let (mut all, mut told) = (get(nginx.url("/v1/events")).await, String::new());
    read_until(&mut all, "\n\n", &mut told).await;
    let job = client.submit(&jobs::endless_growth()).await;
    let path = format!("/v1/jobs/{}", id_of(&job));
    read_until(&mut all, &format!("\"id\":\"{}\"", id_of(&job)), &mut told).await;
    client.running(id_of(&job)).await;
    let (mut events, mut of_job) = (get(nginx.url(&format!("{path}/events"))).await, String::new());
    read_until(&mut events, "event: state", &mut of_job).await;
    read_until(&mut events, "event: progress", &mut of_job).await;
    client.post(&format!("{path}/cancel")).send().await;
    read_until(&mut events, "event: end", &mut of_job).await;
    // A client that knows the present state waits for the next, and sees at once that the stream is there.
    let waiting = client.submit(&jobs::endless_growth()).await;
    let request = http().get(nginx.url(&format!("/v1/jobs/{}/events", id_of(&waiting))));
    let mut resumed = request.header("last-event-id", "9000000000").send().await.unwrap();
    read_until(&mut resumed, ":", &mut String::new()).await;
    server.stop().await;
}

/// Addresses of files in a page.
fn addresses(page: &str) -> BTreeSet<&str> {
    let values = |name: &'static str| page.split(name).skip(1).filter_map(|rest| rest.split('"').next());
    values("href=\"").chain(values("src=\"")).filter(|address| !address.starts_with('#')).collect()
}

/// The modules that a script imports, relative to it.
fn imports(script: &str) -> BTreeSet<&str> {
    ["from \"", "import(\"", "import \""]
        .into_iter()
        .flat_map(|start| script.split(start).skip(1))
        .filter_map(|rest| rest.split('"').next())
        .filter(|name| Path::new(name).extension().is_some_and(|extension| extension == "js"))
        .collect()
}

/// Every page below an address with all its files: each is there, below the same path.
async fn pages_are_whole(base: &Url, job: &str) {
    let (mut open, mut known) = (Vec::new(), BTreeSet::new());
    for path in ["", "jobs", "studies", "service", &format!("jobs/{job}"), &format!("studies/{job}")] {
        open.push(base.join(path).unwrap());
    }
    while let Some(url) = open.pop() {
        // Documents cite papers and name other programs.
        if url.origin() != base.origin() || !known.insert(url.to_string()) {
            continue;
        }
        assert!(url.path().starts_with(base.path()), "{url} is not below {base}");
        let answer = get(url.clone()).await;
        // What is no page needs a key, where there are keys.
        if answer.status() == 401 && ["/metrics", "/openapi.json"].iter().any(|end| url.path().ends_with(end))
        {
            continue;
        }
        assert_eq!(answer.status(), 200, "{url}");
        let kind = answer.headers().get(CONTENT_TYPE).unwrap().to_str().unwrap().to_owned();
        let text = answer.text().await.unwrap();
        let named = if kind.starts_with("text/html") {
            addresses(&text)
        } else if kind.starts_with("text/javascript") {
            imports(&text)
        } else {
            BTreeSet::new()
        };
        open.extend(named.into_iter().map(|address| url.join(address).unwrap()));
    }
    // Six pages, their styles and their scripts, and the documents.
    assert!(known.len() > 100, "{known:?}");
}

/// Every string of a document that is an address.
fn links<'a>(document: &'a Value, found: &mut Vec<&'a str>) {
    match document {
        Value::String(text) if text.starts_with('/') => found.push(text),
        Value::Array(items) => items.iter().for_each(|item| links(item, found)),
        Value::Object(members) => members.values().for_each(|member| links(member, found)),
        _ => {}
    }
}

#[tokio::test]
async fn below_a_path_everything_is_found() {
    let keys = Keys::make(&[(&["root"], "")]).await;
    let (plain_dir, below_dir) = (DataDir::new(), DataDir::new());
    let plain = Launch::new(&plain_dir).workers(1).start().await;
    let below = keys.launch(&below_dir).args(&["--base-path", "/packstone"]).workers(1).start().await;
    let locations = format!(
        "location /plain/ {{ proxy_pass http://{}/; proxy_set_header Host $http_host; }}\n\
         location /packstone {{ proxy_pass http://{}; proxy_set_header Host $http_host; }}",
        plain.address(),
        below.address()
    );
    let Some(nginx) = Nginx::start(&locations).await else { return };
    let stripping = format!(
        "location /packstone/ {{ proxy_pass http://{}/; proxy_set_header Host $http_host; }}",
        below.address()
    );
    let stripping = Nginx::start(&stripping).await.unwrap();
    // A proxy that removes the path needs no option for the pages: their addresses are relative.
    let job = plain.client().succeed(&jobs::quick(1)).await;
    pages_are_whole(&nginx.url("/plain/"), id_of(&job)).await;

    let key = &keys.by_name[0].1;
    let job = below.client().with_key(key).succeed(&jobs::quick(1)).await;
    for proxy in [&nginx, &stripping] {
        pages_are_whole(&proxy.url("/packstone/"), id_of(&job)).await;
        let send = async |request: reqwest::RequestBuilder| request.bearer_auth(key).send().await.unwrap();
        let ask = async |path: &str| send(http().get(proxy.url(path))).await;
        let submitted = send(http().post(proxy.url("/packstone/v1/jobs")).json(&jobs::quick(2))).await;
        assert_eq!(submitted.status(), 201);
        let location = submitted.headers()[LOCATION].to_str().unwrap().to_owned();
        assert!(location.starts_with("/packstone/v1/jobs/"), "{location}");
        let shown: Value = ask(&location).await.json().await.unwrap();
        let mut found = Vec::new();
        links(&shown["links"], &mut found);
        assert!(found.len() > 10 && found.iter().all(|link| link.starts_with("/packstone/v1/")), "{found:?}");
        assert_eq!(ask(shown["links"]["request"].as_str().unwrap()).await.status(), 200);
        let page = ask("/packstone/v1/jobs?limit=1").await;
        let link = page.headers()[LINK].to_str().unwrap().to_owned();
        assert!(link.starts_with("</packstone/v1/jobs?"), "{link}");
        let next = link.trim_start_matches('<').split('>').next().unwrap();
        assert_eq!(ask(next).await.status(), 200);
        let started = send(http().post(proxy.url(&format!("{location}/exports/shapes")))).await;
        for field in ["location", "content-location"] {
            let refused = started.headers().get(field).map(|link| link.to_str().unwrap());
            assert!(refused.is_none_or(|link| link.starts_with("/packstone/v1/jobs/")), "{refused:?}");
        }
        let problem: Value = ask("/packstone/v1/jobs/none").await.json().await.unwrap();
        assert_eq!(problem["type"], "/packstone/problems/not-found");
        assert_eq!(ask(problem["type"].as_str().unwrap()).await.status(), 200);
        let document: Value = ask("/packstone/openapi.json").await.json().await.unwrap();
        assert_eq!(document["servers"][0]["url"], "/packstone");
        let session = http().post(proxy.url("/packstone/session")).json(&json!({"key": key}));
        let session = session.send().await.unwrap();
        let cookie = session.headers()["set-cookie"].to_str().unwrap();
        assert!(cookie.contains("; Path=/packstone;"), "{cookie}");
    }
    let redirected = get(nginx.url("/packstone")).await;
    assert_eq!(
        (redirected.status().as_u16(), &redirected.headers()[LOCATION]),
        (308, &"/packstone/".parse().unwrap())
    );
    // Probes know nothing of the path.
    assert_eq!(below.client().get("/healthz").send().await.status, 200);
    plain.stop().await;
    below.stop().await;
}

#[tokio::test]
async fn a_worker_finds_its_server_below_a_path() {
    let data_dir = DataDir::new();
    // It packs nothing itself.
    let server = Launch::new(&data_dir).args(&["--base-path", "/packstone"]).workers(0).start().await;
    let locations = format!("location /packstone {{ proxy_pass http://{}; }}", server.address());
    let Some(nginx) = Nginx::start(&locations).await else { return };
    let client = server.client();
    let job = client.submit(&jobs::quick(1)).await;
    let folder = tempfile::tempdir().unwrap();
    let url = nginx.url("/packstone/").to_string();
    let worker = Running::spawn(folder.path(), &["worker", "--server", &url, "--slots", "1"]);
    let done = client.finished(id_of(&job)).await;
    assert_eq!(done["state"], "succeeded", "{done:#}");
    let health = crate::harness::packstone(folder.path(), &["health", &url]).await;
    assert_eq!((health.code, health.stdout.as_str()), (Some(0), "ready\n"), "{health:?}");
    drop(worker);
    server.stop().await;
}
