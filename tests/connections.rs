//! Clients that stop in the middle, dawdle or announce too much cost nobody else anything.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use futures_util::future::join_all;

use crate::harness::deadline::{patiently, within};
use crate::harness::{DataDir, Launch, RawConnection, Server, id_of, jobs};

/// One test, because both wait for time limits of the server, 10 s and 30 s: neither holds up a core for the other.
#[tokio::test]
async fn what_stops_arriving_is_given_up() {
    tokio::join!(
        half_open_connections_are_closed_and_others_served_meanwhile(),
        a_body_that_stops_arriving_is_given_up(),
    );
}

async fn half_open_connections_are_closed_and_others_served_meanwhile() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let fragments: [&[u8]; 4] = [
        b"",
        b"GET /v1/jo",
        b"GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\n",
        b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Le",
    ];
    let start = Instant::now();
    let mut half_open = Vec::new();
    for i in 0..500 {
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(fragments[i % fragments.len()]).await;
        half_open.push(connection);
    }
    let closing = tokio::spawn(async move {
        join_all(half_open.into_iter().map(RawConnection::until_closed)).await;
    });
    let mut served = 0;
    let mut turns = tokio::time::interval(Duration::from_millis(10));
    while !closing.is_finished() {
        // A new client each time: an open connection would prove nothing.
        let asked = Instant::now();
        server.client().get("/v1/jobs").send().await.expect(200);
        assert!(asked.elapsed() < Duration::from_secs(5), "others wait: {:?}", asked.elapsed());
        served += 1;
        assert!(start.elapsed() < Duration::from_secs(15), "half-open connections live after 15 s");
        // A hundred a second are enough: the next test needs the core.
        turns.tick().await;
    }
    closing.await.unwrap();
    assert!(served > 0);
    client.succeed(&jobs::quick(1)).await;
    server.stop().await;
}

#[tokio::test]
async fn an_announced_length_over_the_limit_is_refused_before_the_body() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let mut connection = RawConnection::open(server.address()).await;
    connection
        .send("POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 1073741824\r\n\r\n")
        .await;
    let head = connection.head().await;
    assert!(head.starts_with("HTTP/1.1 413 "), "{head}");
    assert!(head.contains("application/problem+json"), "{head}");
    drop(connection);
    server.client().get("/healthz").send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn nonsense_on_the_wire_is_survived() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let long_line = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "a".repeat(1 << 20));
    let many_headers =
        format!("GET /healthz HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "x-a: y\r\n".repeat(10_000));
    for nonsense in [
        &b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"[..],
        b"\0\0\0\0\0\0\0\0\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n",
        b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\nContent-Type: application/json\r\n\r\nzz\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        long_line.as_bytes(),
        many_headers.as_bytes(),
    ] {
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(nonsense).await;
        let said = within(Duration::from_secs(45), "nonsense to be refused", connection.until_closed()).await;
        let status: Option<u16> = said.split(' ').nth(1).and_then(|status| status.parse().ok());
        assert!(status.is_none_or(|status| (400..500).contains(&status)), "{said}");
    }
    server.client().get("/healthz").send().await.expect(200);
    server.stop().await;
}

async fn a_body_that_stops_arriving_is_given_up() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let mut connection = RawConnection::open(server.address()).await;
    connection
        .send("POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{")
        .await;
    let said =
        within(Duration::from_secs(45), "a stalled body to be given up", connection.until_closed()).await;
    assert!(said.starts_with("HTTP/1.1 408 "), "{said}");
    assert!(said.contains("/problems/request-timeout"), "{said}");
    server.stop().await;
}

#[tokio::test]
async fn a_reader_that_stops_reading_holds_up_nobody() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(100_000, 1)).await;
    let path = format!("/v1/jobs/{}/result?format=json", id_of(&job));
    let mut stopped = Vec::new();
    for _ in 0..20 {
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n")).await;
        let head = connection.head().await;
        assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
        stopped.push(connection);
    }
    client.get(&path).send().await.expect(200);
    client.succeed(&jobs::quick(2)).await;
    // They hold a stream each; ended, they must not keep the server from ending.
    server.stop().await;
    drop(stopped);
}

#[tokio::test]
async fn more_downloads_than_allowed_are_put_off() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-downloads", "4"]).start().await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(200_000, 1)).await;
    let path = format!("/v1/jobs/{}/result?format=json", id_of(&job));
    let mut stopped = Vec::new();
    for _ in 0..2 {
        let mut connection = RawConnection::open(server.address()).await;
        connection.send(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n")).await;
        assert!(connection.head().await.starts_with("HTTP/1.1 200 "));
        stopped.push(connection);
    }
    let put_off = client.get(&path).send().await;
    put_off.expect_problem(503, "busy");
    assert!(put_off.header("retry-after").parse::<u32>().unwrap() >= 1);
    client.head(&path).send().await.expect(200);
    client.get(&format!("/v1/jobs/{}/result/summary", id_of(&job))).send().await.expect(200);
    // Half of the places are for others.
    let (head, _) = ask(SECOND, server.address(), &path).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
    // Whoever hangs up gives the place back.
    drop(stopped);
    client.get(&path).send().await.expect(200);
    server.stop().await;
}

const FIRST: Ipv4Addr = Ipv4Addr::LOCALHOST;
const SECOND: Ipv4Addr = Ipv4Addr::new(127, 0, 0, 2);

/// Asks once, on a connection that stays open, and returns the head of the answer with the connection.
async fn ask(source: Ipv4Addr, address: SocketAddr, path: &str) -> (String, RawConnection) {
    let mut connection = RawConnection::open_from(source, address).await;
    connection.send(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n")).await;
    (connection.head().await, connection)
}

#[tokio::test]
async fn one_client_takes_half_of_the_connections_at_most() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-connections", "8"]).start().await;
    let address = server.address();
    let mut open = Vec::new();
    for _ in 0..4 {
        let (head, connection) = ask(FIRST, address, "/v1/jobs").await;
        assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
        open.push(connection);
    }
    for _ in 0..10 {
        let (head, connection) = ask(FIRST, address, "/v1/jobs").await;
        assert!(head.starts_with("HTTP/1.1 503 ") && head.contains("/problems/busy"), "{head}");
        assert!(head.contains("retry-after: 5") && head.contains("connection: close"), "{head}");
        connection.until_closed().await;
        let (head, _) = ask(SECOND, address, "/v1/jobs").await;
        assert!(head.starts_with("HTTP/1.1 200 "), "another client is served: {head}");
        for probe in ["/healthz", "/readyz"] {
            let (head, connection) = ask(FIRST, address, probe).await;
            assert!(head.starts_with("HTTP/1.1 200 "), "{probe}: {head}");
            connection.until_closed().await;
        }
    }
    drop(open.pop());
    patiently("a closed connection to make room", async {
        while !Box::pin(ask(FIRST, address, "/v1/jobs")).await.0.starts_with("HTTP/1.1 200 ") {
            tokio::task::yield_now().await;
        }
    })
    .await;
    drop(open);
    server.stop().await;
}

#[tokio::test]
async fn the_share_of_a_client_can_be_set_and_a_trusted_proxy_has_all() {
    for (options, most) in [
        (&["--max-connections", "6", "--max-connections-per-client", "2"][..], 2),
        (&["--max-connections", "6", "--trust-proxy"], 6),
    ] {
        let data_dir = DataDir::new();
        let server = Launch::new(&data_dir).args(options).start().await;
        let mut open = Vec::new();
        for _ in 0..most {
            let (head, connection) = ask(FIRST, server.address(), "/v1/jobs").await;
            assert!(head.starts_with("HTTP/1.1 200 "), "{options:?}: {head}");
            open.push(connection);
        }
        let (head, _) = ask(FIRST, server.address(), "/v1/jobs").await;
        assert!(head.starts_with("HTTP/1.1 503 "), "{options:?}: {head}");
        drop(open);
        server.stop().await;
    }
}
