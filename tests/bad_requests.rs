//! Requests that are wrong before a job is read from them: bodies, media types, routes, sizes.

use std::time::Duration;

use bytes::Bytes;
use futures_util::stream;
use reqwest::Method;
use serde_json::json;

use crate::harness::{DataDir, Launch, Server, id_of, jobs};

/// 16 MiB, the documented default.
const BODY_LIMIT: usize = 16 << 20;

#[tokio::test]
async fn what_is_no_json_is_refused_where_it_stops_being_json() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = jobs::quick(1).to_string();
    let with_fraction =
        |text: &str| job.replace("\"volume_fraction\":0.4", &format!("\"volume_fraction\":{text}"));
    assert_ne!(with_fraction("NaN"), job);
    for (body, pointer) in [
        (String::new(), ""),
        ("{".to_owned(), ""),
        (job.clone() + "{}", ""),
        (with_fraction("NaN"), "/mix/volume_fraction"),
        (with_fraction("-Infinity"), "/mix/volume_fraction"),
        (with_fraction("0x10"), "/mix"),
        (with_fraction("0.4,"), "/mix"),
    ] {
        let shown: String = body.chars().take(60).collect();
        let problem = client.post("/v1/jobs").text(body).send().await.expect_problem(400, "malformed-json");
        let error = &problem["errors"][0];
        assert!(error["pointer"].as_str().unwrap().starts_with(pointer), "{shown}: {problem:#}");
        assert!(error["detail"].as_str().unwrap().contains("line "), "{shown}: {problem:#}");
    }
    let not_utf8 =
        client.post("/v1/jobs").header("content-type", "application/json").body(&b"{\"name\":\"\xff\"}"[..]);
    not_utf8.send().await.expect_problem(400, "malformed-json");
    // A byte order mark, as some editors and shells write it, says nothing about UTF-8; UTF-16 is named.
    client.post("/v1/plans").text("\u{feff}".to_owned() + &job).send().await.expect(200);
    let utf16: Vec<u8> = "\u{feff}{}".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let reply = client.post("/v1/jobs").header("content-type", "application/json").body(utf16).send().await;
    let problem = reply.expect_problem(400, "malformed-json");
    assert!(problem["detail"].as_str().unwrap().contains("UTF-16"), "{problem:#}");
    // JSON by its grammar, but of no number that there is.
    for number in ["1e999", "-1e999"] {
        let reply = client.post("/v1/jobs").text(with_fraction(number)).send().await;
        let problem = reply.expect_problem(422, "validation-error");
        assert_eq!(problem["errors"][0]["pointer"], "/mix/volume_fraction");
        assert!(problem["errors"][0]["detail"].as_str().unwrap().contains(number), "{problem:#}");
    }
    for (body, is) in [("null", "null"), ("[]", "an array"), ("1", "1"), ("\"job\"", "\"job\"")] {
        let problem = client.post("/v1/jobs").text(body).send().await.expect_problem(422, "validation-error");
        assert_eq!(problem["errors"][0]["pointer"], "");
        assert!(problem["errors"][0]["detail"].as_str().unwrap().contains(is), "{problem:#}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_field_given_twice_is_refused() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let body = jobs::quick(1).to_string().replace("\"seed\":1", "\"seed\":1,\"seed\":2");
    let reply = client.post("/v1/jobs").text(body).send().await;
    assert!(reply.status == 400 || reply.status == 422, "{}", reply.status);
    assert!(reply.json()["detail"].as_str().unwrap().contains("seed"), "{:#}", reply.json());
    server.stop().await;
}

#[tokio::test]
async fn json_of_any_depth_is_refused_and_survived() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let inner = if open == "[" { "" } else { "1" };
        let deep = open.repeat(100_000) + inner + &close.repeat(100_000);
        let as_field = format!("{{\"specimen\":{deep}}}");
        for body in [deep, as_field] {
            let problem =
                client.post("/v1/jobs").text(body).send().await.expect_problem(422, "validation-error");
            assert!(
                problem["detail"].as_str().unwrap().contains("127"),
                "the bound is not named: {problem:#}"
            );
        }
    }
    client.succeed(&jobs::quick(1)).await;
    server.stop().await;
}

#[tokio::test]
async fn a_body_over_the_limit_is_refused_unread() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let before = server.resident_bytes();
    let megabyte = Bytes::from(vec![b' '; 1 << 20]);
    let gigabyte = stream::iter((0..1000).map(move |_| Ok::<_, std::io::Error>(megabyte.clone())));
    let chunked = client
        .post("/v1/jobs")
        .header("content-type", "application/json")
        .body(reqwest::Body::wrap_stream(gigabyte))
        .timeout(Duration::from_mins(1));
    // A server may close the connection on whoever sends on after the answer.
    if let Ok(reply) = chunked.try_send().await {
        let problem = reply.expect_problem(413, "payload-too-large");
        assert!(problem["detail"].as_str().unwrap().contains(&BODY_LIMIT.to_string()), "{problem:#}");
    }
    let grown = server.resident_bytes().saturating_sub(before);
    assert!(grown < 100 << 20, "a body that is too large cost {grown} bytes");

    let mut job = jobs::quick(1).to_string();
    job.push_str(&" ".repeat(BODY_LIMIT - job.len()));
    client.post("/v1/jobs").text(job.clone()).send().await.expect(201);
    client.post("/v1/jobs").text(job + " ").send().await.expect_problem(413, "payload-too-large");
    server.stop().await;
}

#[tokio::test]
async fn only_plain_json_is_read() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let body = jobs::quick(1).to_string();
    for media_type in [
        "text/plain",
        "application/x-www-form-urlencoded",
        "application/xml",
        "nonsense",
        "application/jsonx",
    ] {
        let request = client.post("/v1/jobs").header("content-type", media_type).body(body.clone());
        let problem = request.send().await.expect_problem(415, "unsupported-media-type");
        assert!(problem["detail"].as_str().unwrap().contains("application/json"), "{problem:#}");
    }
    client.post("/v1/jobs").body(body.clone()).send().await.expect_problem(415, "unsupported-media-type");
    for encoding in ["gzip", "br", "deflate, gzip"] {
        let request = client.post("/v1/jobs").header("content-encoding", encoding).text(body.clone());
        request.send().await.expect_problem(415, "unsupported-media-type");
    }
    for media_type in
        ["application/json; charset=utf-8", "APPLICATION/JSON", "application/vnd.packstone+json"]
    {
        let request = client.post("/v1/jobs").header("content-type", media_type).body(body.clone());
        request.send().await.expect(201);
    }
    client.post("/v1/jobs").header("content-encoding", "identity").text(body).send().await.expect(201);
    server.stop().await;
}

#[tokio::test]
async fn unknown_routes_and_methods_are_problem_documents() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let id = id_of(&job);
    for path in [
        "/page",
        "/v1",
        "/v1/",
        "/v1/job",
        "/v2/jobs",
        "/v1/jobs/",
        "/v1/study",
        "/v1/jobs/../../etc",
        "/%ff",
    ] {
        client.get(path).send().await.expect_problem(404, "not-found");
        client.post(path).text("{}").send().await.expect_problem(404, "not-found");
    }
    for (method, path, allowed) in [
        (Method::PUT, "/v1/jobs".to_owned(), "POST"),
        (Method::DELETE, "/v1/studies".to_owned(), "GET"),
        (Method::PUT, format!("/v1/jobs/{id}"), "PATCH"),
        (Method::POST, format!("/v1/jobs/{id}/result"), "GET"),
        (Method::GET, format!("/v1/jobs/{id}/cancel"), "POST"),
        (Method::GET, format!("/v1/jobs/{id}/retry"), "POST"),
        (Method::POST, format!("/v1/jobs/{id}/events"), "GET"),
        (Method::POST, "/healthz".to_owned(), "GET"),
        (Method::POST, "/".to_owned(), "GET"),
        (Method::from_bytes(b"BREW").unwrap(), "/v1/jobs".to_owned(), "GET"),
    ] {
        let reply = client.request(method, &path).send().await;
        reply.expect_problem(405, "method-not-allowed");
        assert!(reply.header("allow").contains(allowed), "{path}: {}", reply.header("allow"));
    }
    assert_eq!(client.job(id).await, job);
    server.stop().await;
}

#[tokio::test]
async fn faulty_parameters_and_preferences_are_named() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let path = format!("/v1/jobs/{}", id_of(&job));
    for (target, parameter) in [
        (format!("{path}?verbose=1"), "verbose"),
        (format!("{path}/result?formats=csv"), "formats"),
        (format!("{path}/result?format=csv&format=npy"), "format"),
    ] {
        let problem = client.get(&target).send().await.expect_problem(400, "validation-error");
        assert_eq!(problem["errors"][0]["parameter"], parameter, "{problem:#}");
    }
    // A preference that is not understood is no error (RFC 7240), a wait beyond the bound is cut.
    for preference in ["wait=abc", "wait=-1", "respond-async", "wait=1000000", ""] {
        client.get(&path).header("prefer", preference).send().await.expect(200);
    }
    let faulty = jobs::with(jobs::quick(1), "/mix/volume_fraction", json!(7));
    client.post("/v1/jobs").header("prefer", "wait=60").json(&faulty).send().await.expect(422);
    server.stop().await;
}

#[tokio::test]
async fn a_body_limit_can_be_set() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-body-bytes", "300"]).start().await;
    let client = server.client();
    let mut job = jobs::quick(1).to_string();
    assert!(job.len() < 300);
    client.post("/v1/jobs").text(job.clone()).send().await.expect(201);
    job.push_str(&" ".repeat(300));
    client.post("/v1/jobs").text(job).send().await.expect_problem(413, "payload-too-large");
    server.stop().await;
}
