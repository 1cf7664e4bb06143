//! The memory of the service: what clients can make it hold at most, and that it is given back.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use futures_util::future::join_all;
use serde_json::json;

use crate::harness::deadline::{eventually, patiently, within};
use crate::harness::{DataDir, Launch, RawConnection, Server, id_of, jobs};
use crate::sessions::key;
use crate::users::laboratory;

const MEGABYTE: usize = 1 << 20;
/// The longest body that is read.
const LONGEST: usize = 16 * MEGABYTE;
/// Memory over that of the idle server while unfinished bodies are held, and after.
const MOST_PEAK_BYTES: u64 = 160 << 20;
const MOST_AFTER_BYTES: u64 = 64 << 20;
/// What a job of a million grains leaves at most.
const MOST_LEFT_BYTES: u64 = 24 << 20;
/// Connections of one address that a test opens at most: half of all may be open.
const CONNECTIONS: usize = 60;

/// How the length of a body is told.
#[derive(Clone, Copy, Debug)]
enum Framing {
    Length,
    Chunked,
}

impl Framing {
    fn head(self, route: &str, fields: &str) -> String {
        let framing = match self {
            Self::Length => format!("Content-Length: {LONGEST}"),
            Self::Chunked => "Transfer-Encoding: chunked".to_owned(),
        };
        format!(
            "POST {route} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n{fields}{framing}\r\n\r\n"
        )
    }

    /// Spaces, which may stand before JSON.
    fn spaces(self, bytes: usize) -> Vec<u8> {
        match self {
            Self::Length => vec![b' '; bytes],
            Self::Chunked => format!("{bytes:x}\r\n{}\r\n", " ".repeat(bytes)).into_bytes(),
        }
    }
}

/// Sends all but the end of a body of the longest length, as far as the server takes it.
async fn unfinished(address: SocketAddr, framing: Framing, head: String) -> RawConnection {
    let mut connection = RawConnection::open(address).await;
    connection.send(head).await;
    for _ in 0..15 {
        connection.send(framing.spaces(MEGABYTE)).await;
    }
    connection.send(framing.spaces(MEGABYTE - 1)).await;
    connection
}

#[tokio::test]
async fn sixty_unfinished_bodies_hold_little_memory_and_others_are_served() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let bert = format!("Authorization: Bearer {}\r\n", key(&keys, "bert"));
    let client = keys.client(&server, "bert");
    client.post("/v1/plans").json(&jobs::quick(1)).send().await.expect(200);
    let idle = server.reset_peak_bytes();
    for (route, fields) in [("/session", ""), ("/v1/plans", bert.as_str())] {
        for framing in [Framing::Length, Framing::Chunked] {
            let head = framing.head(route, fields);
            let held = join_all(
                (0..CONNECTIONS).map(|_| Box::pin(unfinished(server.address(), framing, head.clone()))),
            )
            .await;
            // Small requests of the same address, and large ones of another.
            client.post("/v1/plans").json(&jobs::quick(1)).send().await.expect(200);
            let large = jobs::quick(1).to_string() + &" ".repeat(4 * MEGABYTE);
            let mut other = RawConnection::open_from(Ipv4Addr::new(127, 0, 0, 2), server.address()).await;
            let length = large.len();
            other
                .send(format!(
                    "POST /v1/plans HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n{bert}\
                     Content-Length: {length}\r\n\r\n{large}"
                ))
                .await;
            let head = other.head().await;
            assert!(head.starts_with("HTTP/1.1 200 "), "{route} {framing:?}: {head}");
            let peak = server.peak_bytes().saturating_sub(idle);
            assert!(peak < MOST_PEAK_BYTES, "{route} {framing:?}: {} MB", peak >> 20);
            drop(held);
            let left = || server.resident_bytes().saturating_sub(idle);
            eventually("the memory to be given back", || left() < MOST_AFTER_BYTES).await;
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn a_body_beyond_the_budget_is_put_off() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let budget = (20 * MEGABYTE).to_string();
    let server = keys.launch(&data_dir).args(&["--request-memory-bytes", &budget]).start().await;
    let bert = format!("Authorization: Bearer {}\r\n", key(&keys, "bert"));
    let framing = Framing::Chunked;
    let first = async || unfinished(server.address(), framing, framing.head("/v1/plans", &bert)).await;
    let client = keys.client(&server, "bert");
    let large = jobs::quick(1).to_string() + &" ".repeat(8 * MEGABYTE);
    let put_off = || async {
        // A client that still writes may lose the answer.
        let reply = client.post("/v1/plans").text(large.clone()).try_send().await.ok()?;
        (reply.status == 503).then_some(reply)
    };
    // The server may still be reading the first, and put off that one.
    let (first, reply) = patiently("the budget to be used up", async {
        loop {
            let first = first().await;
            if let Some(reply) = put_off().await {
                break (first, reply);
            }
        }
    })
    .await;
    let problem = reply.expect_problem(503, "busy");
    assert!(problem["detail"].as_str().unwrap().contains("as much memory as they may"), "{problem:#}");
    assert!(reply.header("retry-after").parse::<u32>().unwrap() >= 1);
    drop(first);
    patiently("the memory to be free again", async {
        while client.post("/v1/plans").text(large.clone()).send().await.status != 200 {}
    })
    .await;
    server.stop().await;
}

/// Memory is given back every ten seconds: the job ends after that, so that what it holds has outlasted one time.
#[tokio::test]
async fn the_memory_of_a_long_job_is_given_back_after_its_end() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    // The pages of the program that a job needs are no memory that it holds.
    client.succeed(&jobs::quick(1)).await;
    let idle = server.resident_bytes();
    let job = client.submit(&jobs::with(jobs::endless(), "/timeout_s", json!(15))).await;
    let ended = client.finished(id_of(&job)).await;
    assert_eq!(ended["error"]["type"], "/problems/timed-out", "{ended:#}");
    assert!(server.peak_bytes() >= idle + MOST_LEFT_BYTES, "the job is too small to show it");
    eventually("the memory to be given back", || server.resident_bytes() < idle + MOST_LEFT_BYTES).await;
    server.stop().await;
}

#[tokio::test]
async fn senders_of_one_byte_a_second_hold_up_nobody() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for framing in [Framing::Length, Framing::Chunked] {
        let mut slow = Vec::new();
        for _ in 0..CONNECTIONS {
            let mut connection = RawConnection::open(server.address()).await;
            connection.send(framing.head("/v1/jobs", "")).await;
            slow.push(connection);
        }
        let mut seconds = tokio::time::interval(Duration::from_secs(1));
        for _ in 0..5 {
            seconds.tick().await;
            for connection in &mut slow {
                connection.send(framing.spaces(1)).await;
            }
            let asked = Instant::now();
            // The memory that those bodies are to have is not theirs before it arrives.
            let long = jobs::quick(1).to_string() + &" ".repeat(LONGEST - 1000);
            client.post("/v1/plans").text(long).send().await.expect(200);
            assert!(asked.elapsed() < Duration::from_secs(10), "{framing:?}: {:?}", asked.elapsed());
        }
        drop(slow);
    }
    server.stop().await;
}

#[tokio::test]
async fn bodies_are_as_long_as_their_route_allows_and_wait_for_the_key() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let root = keys.client(&server, "root");
    let job = root.succeed(&jobs::quick(1)).await;
    let id = id_of(&job);
    let admin = format!("Authorization: Bearer {}\r\n", key(&keys, "root"));
    for (method, route, fields, most) in [
        ("POST", "/session".to_owned(), String::new(), 4 << 10),
        ("PATCH", format!("/v1/jobs/{id}"), admin.clone(), 64 << 10),
        ("POST", "/v1/leases".to_owned(), admin.clone(), 16 << 10),
        ("POST", "/v1/leases/renewals".to_owned(), admin.clone(), 4 << 20),
        ("POST", format!("/v1/leases/{id}/1/end"), admin, 1 << 20),
    ] {
        let head = |framing: &str| {
            format!(
                "{method} {route} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n{fields}{framing}\r\n\r\n"
            )
        };
        // Announced: refused before a byte of it.
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(head(&format!("Content-Length: {}", most + 1))).await;
        let said = connection.head().await;
        assert!(said.starts_with("HTTP/1.1 413 "), "{route}: {said}");
        assert!(said.contains(&format!("at most {most} bytes")), "{route}: {said}");
        // Not announced: refused where it becomes too long.
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(head("Transfer-Encoding: chunked")).await;
        connection.send(Framing::Chunked.spaces(most + 1)).await;
        let said = connection.head().await;
        assert!(said.starts_with("HTTP/1.1 413 "), "{route}: {said}");
        // As long as may be: read, and no JSON.
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(head(&format!("Content-Length: {most}"))).await;
        connection.send(vec![b' '; most]).await;
        let said = connection.head().await;
        assert!(said.starts_with("HTTP/1.1 400 "), "{route}: {said}");
    }
    // Without a key the answer comes before the body.
    for route in ["/v1/jobs", "/v1/plans", "/v1/studies", "/v1/leases", "/v1/leases/renewals"] {
        for framing in [Framing::Length, Framing::Chunked] {
            let mut connection = RawConnection::open(server.address()).await;
            connection.send(framing.head(route, "")).await;
            let said = connection.head().await;
            assert!(said.starts_with("HTTP/1.1 401 "), "{route} {framing:?}: {said}");
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn with_a_gigabyte_of_address_space_five_hundred_connections_of_all_kinds_are_survived() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).address_space(1 << 30).start().await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(100_000, 1)).await;
    let result = format!("/v1/jobs/{}/result", id_of(&job));
    let get = |target: &str| format!("GET {target} HTTP/1.1\r\nHost: localhost\r\n\r\n");
    let address = server.address();
    // Bodies that do not end, of both framings.
    let bodies = (0..22).map(|i| {
        let framing = if i % 2 == 0 { Framing::Length } else { Framing::Chunked };
        unfinished(address, framing, framing.head("/v1/plans", ""))
    });
    let bodies = join_all(bodies.map(Box::pin)).await;
    let head = format!("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nx-long: {}", "x".repeat(30_000));
    let kinds = [
        get(&format!("{result}?format=json")),
        get(&format!("{result}?format=html")),
        get(&format!("{result}?format=vtp")),
        get("/openapi.json"),
        get("/v1/events"),
        get(&format!("/v1/jobs/{}/plots/grading", id_of(&job))),
        head,
        Framing::Chunked.head("/v1/jobs", ""),
        "GET /v1/jo".to_owned(),
        String::new(),
    ];
    // All that one address may have, but a few for the client of this test. Nobody reads the answers.
    let mut open = Vec::new();
    for i in 0..470 {
        let mut connection = RawConnection::open(address).await;
        connection.send(&kinds[i % kinds.len()]).await;
        open.push(connection);
    }
    for _ in 0..20 {
        let mut other = RawConnection::open_from(Ipv4Addr::new(127, 0, 0, 2), address).await;
        other.send(get("/v1/jobs")).await;
        let said = other.head().await;
        assert!(said.starts_with("HTTP/1.1 200 "), "{said}");
    }
    drop((bodies, open));
    client.succeed(&jobs::quick(2)).await;
    server.stop().await;
}

#[tokio::test]
async fn readers_of_pages_that_stop_cost_little_and_lose_their_places() {
    let data_dir = DataDir::new();
    let options = ["--max-downloads", "100", "--stalled-reader-s", "5"];
    let server = Launch::new(&data_dir).args(&options).start().await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(300_000, 1)).await;
    let page = format!("/v1/jobs/{}/result?format=html", id_of(&job));
    let whole = client.get(&page).send().await;
    whole.expect(200);
    let again = client.get(&page).send().await;
    assert_eq!((whole.header("etag"), &whole.body), (again.header("etag"), &again.body));
    drop(again);
    let before = server.reset_peak_bytes();
    let mut stopped = Vec::new();
    for _ in 0..50 {
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(format!("GET {page} HTTP/1.1\r\nHost: localhost\r\n\r\n")).await;
        let head = connection.head().await;
        assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
        stopped.push(connection);
    }
    let grown = server.peak_bytes().saturating_sub(before);
    assert!(whole.body.len() > 3 * MEGABYTE, "{}", whole.body.len());
    assert!(grown < 80 << 20, "50 readers of a page cost {} MB", grown >> 20);
    // They go on reading nothing, and lose their places all the same.
    patiently("a place to be free", async { while client.get(&page).send().await.status != 200 {} }).await;
    drop(stopped);
    server.stop().await;
}

#[tokio::test]
async fn heads_that_never_end_hold_little_memory() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let idle = server.reset_peak_bytes();
    let mut open = Vec::new();
    for i in 0..400 {
        let mut connection = RawConnection::open(server.address()).await;
        let long = "x".repeat(if i % 2 == 0 { 31_000 } else { 400_000 });
        connection.send(format!("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nx-long: {long}")).await;
        open.push(connection);
    }
    server.client().get("/v1/jobs").send().await.expect(200);
    let grown = server.peak_bytes().saturating_sub(idle);
    assert!(grown < 64 << 20, "400 heads cost {} MB", grown >> 20);
    // One that is too long is told so, although the client still sends.
    let said = open.pop().unwrap().until_closed().await;
    assert!(said.starts_with("HTTP/1.1 431 "), "{said}");
    assert!(said.contains("/problems/head-too-large"), "{said}");
    server.stop().await;
}

#[tokio::test]
async fn a_forwarded_address_has_its_own_share_of_the_memory() {
    let data_dir = DataDir::new();
    let budget = (34 * MEGABYTE).to_string();
    let options = ["--trust-proxy", "--request-memory-bytes", &budget];
    let server = Launch::new(&data_dir).args(&options).start().await;
    let (framing, client) = (Framing::Length, server.client());
    let head = framing.head("/v1/plans", "X-Forwarded-For: 192.0.2.1\r\n");
    let large = jobs::quick(1).to_string() + &" ".repeat(8 * MEGABYTE);
    let plan =
        |address: &str| client.post("/v1/plans").header("x-forwarded-for", address).text(large.clone());
    // The server may still be reading the first, and put off that one.
    let held = patiently("the share of the first to be used up", async {
        loop {
            let held = unfinished(server.address(), framing, head.clone()).await;
            // A client that still writes may lose the answer.
            let own = plan("192.0.2.1").try_send().await;
            plan("192.0.2.2").send().await.expect(200);
            if let Ok(reply) = own
                && reply.status == 503
            {
                reply.expect_problem(503, "busy");
                break held;
            }
        }
    })
    .await;
    drop(held);
    server.stop().await;
}

#[tokio::test]
async fn requests_that_are_none_are_answered_with_problem_documents() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let long_line = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "a".repeat(1 << 20));
    let many_fields =
        format!("GET /healthz HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "x-a: y\r\n".repeat(1000));
    for (sent, status, slug) in [
        (&b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n"[..], 400, "malformed-request"),
        (b"GET / HTTP/9.9\r\n\r\n", 400, "malformed-request"),
        (b"GET  /two HTTP/1.1\r\nHost: localhost\r\n\r\n", 400, "malformed-request"),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nno colon\r\n\r\n", 400, "malformed-request"),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nbad\x01name: 1\r\n\r\n", 400, "malformed-request"),
        (
            b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
            400,
            "malformed-request",
        ),
        (
            b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\n",
            400,
            "malformed-request",
        ),
        (
            b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: gzip\r\n\r\n",
            400,
            "malformed-request",
        ),
        (b"POST /v1/jobs HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n", 400, "malformed-request"),
        (
            b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\
              Content-Type: application/json\r\n\r\nzz\r\n",
            400,
            "malformed-json",
        ),
        (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 400, "malformed-request"),
        (long_line.as_bytes(), 431, "head-too-large"),
        (many_fields.as_bytes(), 431, "head-too-large"),
    ] {
        let shown = String::from_utf8_lossy(&sent[..sent.len().min(80)]).into_owned();
        for before in ["", "GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"] {
            let mut connection = RawConnection::open(server.address()).await;
            if !before.is_empty() {
                connection.send(before).await;
                assert!(connection.head().await.starts_with("HTTP/1.1 200 "));
            }
            connection.send(sent).await;
            let said = within(Duration::from_secs(45), "an answer", connection.until_closed()).await;
            // The rest of the answer before may come first.
            let said = &said[said.find("HTTP/1.1").unwrap_or_default()..];
            let (head, body) = said.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{shown:?}: {said:?}"));
            assert!(head.starts_with(&format!("HTTP/1.1 {status} ")), "{shown:?}: {said}");
            let head = head.to_ascii_lowercase();
            for field in
                ["content-type: application/problem+json", "x-request-id: ", "connection: close", "date: "]
            {
                assert!(head.contains(field), "{shown:?}: {field:?}: {said}");
            }
            let problem: serde_json::Value = serde_json::from_str(body).unwrap_or_else(|_| panic!("{said}"));
            assert_eq!(problem["type"], json!(format!("/problems/{slug}")), "{shown:?}: {problem:#}");
            assert_eq!(problem["status"], json!(status), "{shown:?}: {problem:#}");
        }
    }
    let metrics = server.client().get("/metrics").send().await;
    let text = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(text.lines().any(|line| line.contains("status=\"431\"")), "{text}");
    server.stop().await;
}
