//! Sessions of browsers: a key is exchanged for a cookie, which stands for it until either ends.

use std::fs;

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Reply, Request, Server, id_of, jobs};
use crate::users::{Keys, audit_lines, laboratory};

pub(crate) fn key<'k>(keys: &'k Keys, name: &str) -> &'k str {
    &keys.by_name.iter().find(|(known, _)| known == name).unwrap().1
}

async fn sign_in(client: &Client, key: &str) -> Reply {
    client.post("/session").json(&json!({"key": key})).send().await
}

/// The cookie as a browser sends it back.
fn cookie(reply: &Reply) -> String {
    reply.expect(204).header("set-cookie").split(';').next().unwrap().to_owned()
}

fn by_page(request: Request, cookie: &str) -> Request {
    request.header("cookie", cookie).header("sec-fetch-site", "same-origin")
}

#[tokio::test]
async fn a_session_reads_everywhere_and_changes_for_pages_of_this_server_only() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let client = server.client();
    let reply = sign_in(&client, key(&keys, "anna")).await;
    let set = reply.header("set-cookie").to_owned();
    for attribute in ["packstone_session=", "HttpOnly", "SameSite=Strict", "Path=/", "Max-Age=43200"] {
        assert!(set.contains(attribute), "{attribute} is not in {set}");
    }
    assert!(!set.contains("Secure") && !set.contains(key(&keys, "anna")), "{set}");
    assert_eq!(reply.header("cache-control"), "no-store");
    let anna = cookie(&reply);

    let known = client.get("/v1/key").header("cookie", &anna).send().await.expect(200).json();
    assert_eq!((&known["name"], &known["role"]), (&json!("anna"), &json!("submit")));
    let post = || client.post("/v1/jobs").json(&jobs::quick(1));
    let job = by_page(post(), &anna).send().await.expect(201).json();
    let path = format!("/v1/jobs/{}", id_of(&job));
    let mut events = client.get(&format!("{path}/events")).header("cookie", &anna).stream().await;
    assert!(events.chunk().await.unwrap().is_some());
    // Another page of this machine, another site, a program: they have no say by a cookie.
    for fields in [
        &[("sec-fetch-site", "same-site")][..],
        &[("sec-fetch-site", "cross-site")],
        &[("sec-fetch-site", "none")],
        &[("origin", "http://evil.example")],
        &[],
    ] {
        for request in [post(), client.delete(&path), client.post(&format!("{path}/cancel"))] {
            let request = fields.iter().fold(request, |request, (name, value)| request.header(name, value));
            request.header("cookie", &anna).send().await.expect_problem(403, "forbidden");
        }
    }
    // Browsers send no Sec-Fetch-Site to an address that is neither TLS nor of their machine.
    let origin = format!("http://{}", server.address());
    post().header("cookie", &anna).header("origin", &origin).send().await.expect(201);
    // The role is that of the key, and a key in the header wins.
    let bert = cookie(&sign_in(&client, key(&keys, "bert")).await);
    by_page(post(), &bert).send().await.expect_problem(403, "forbidden");
    let anna_s = client.with_key(key(&keys, "anna"));
    let known = anna_s.get("/v1/key").header("cookie", &bert).send().await.expect(200).json();
    assert_eq!(known["name"], "anna");
    client
        .with_key("none")
        .get("/v1/key")
        .header("cookie", &bert)
        .send()
        .await
        .expect_problem(401, "unauthorized");
    server.stop().await;
}

#[tokio::test]
async fn a_session_begins_by_a_known_key_alone() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let client = server.client();
    for wrong in ["", "packstone_", "none"] {
        let reply = sign_in(&client, wrong).await;
        reply.expect_problem(401, "unauthorized");
        assert!(!reply.headers.contains_key("set-cookie"), "{:?}", reply.headers);
    }
    for (body, pointer) in
        [(json!({}), "/key"), (json!({"key": 7}), "/key"), (json!({"key": "a", "b": 1}), "/b")]
    {
        let problem =
            client.post("/session").json(&body).send().await.expect_problem(422, "validation-error");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    }
    let right = json!({"key": key(&keys, "anna")});
    // A form of another site, which browsers send without asking first.
    let form = client.post("/session").header("content-type", "text/plain").body(right.to_string());
    form.send().await.expect_problem(415, "unsupported-media-type");
    let foreign = client.post("/session").json(&right).header("sec-fetch-site", "cross-site");
    foreign.send().await.expect_problem(403, "forbidden");
    client.get("/session").send().await.expect_problem(405, "method-not-allowed");
    // By TLS, of which the browser tells in its origin.
    let secure = client.post("/session").json(&right).header("sec-fetch-site", "same-origin");
    let reply = secure.header("origin", "https://lab.example").send().await;
    assert!(reply.expect(204).header("set-cookie").ends_with("; Secure"), "{:?}", reply.headers);
    for forged in ["packstone_session=", "packstone_session=9999999999.00.00", "other=1"] {
        client.get("/v1/jobs").header("cookie", forged).send().await.expect_problem(401, "unauthorized");
    }
    server.stop().await;

    // Where no keys are asked for, pages need no session.
    let server = Server::start(&data_dir).await;
    let reply = sign_in(&server.client(), "any").await;
    assert!(!reply.expect(204).headers.contains_key("set-cookie"));
    server.stop().await;
}

#[tokio::test]
async fn a_session_ends_on_request_with_its_key_and_with_the_process() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("audit.jsonl");
    let server = keys.launch(&data_dir).args(&["--audit-log", log.to_str().unwrap()]).start().await;
    let client = server.client();
    let read = async |cookie: &str| client.get("/v1/jobs").header("cookie", cookie).send().await;
    let [first, second] = [
        cookie(&sign_in(&client, key(&keys, "anna")).await),
        cookie(&sign_in(&client, key(&keys, "anna")).await),
    ];
    let ended = by_page(client.delete("/session"), &first).send().await;
    assert!(ended.expect(204).header("set-cookie").starts_with("packstone_session=; Path=/; Max-Age=0"));
    read(&first).await.expect_problem(401, "unauthorized");
    read(&second).await.expect(200);
    client.delete("/session").send().await.expect(204);
    sign_in(&client, "wrong").await.expect(401);
    let told: Vec<Value> = audit_lines(&log);
    let told: Vec<(&str, &str, &Value)> = told
        .iter()
        .map(|line| (line["action"].as_str().unwrap(), line["key"].as_str().unwrap(), &line["status"]))
        .collect();
    let done = json!(204);
    let expected =
        [("begin_session", "anna", &done), ("begin_session", "anna", &done), ("end_session", "anna", &done)];
    assert_eq!(told, expected);

    // A key that is withdrawn takes its sessions with it; the server looks at the file once a second.
    let carl = cookie(&sign_in(&client, key(&keys, "carl")).await);
    let text = fs::read_to_string(&keys.file).unwrap();
    let rest: Vec<&str> = text.lines().filter(|line| !line.contains("anna")).collect();
    fs::write(&keys.file, rest.join("\n") + "\n").unwrap();
    crate::harness::deadline::patiently("the withdrawn key to count", async {
        while read(&second).await.status != 401 {}
    })
    .await;
    read(&carl).await.expect(200);
    server.stop().await;
    let server = keys.launch(&data_dir).start().await;
    let request = server.client().get("/v1/jobs").header("cookie", &carl);
    request.send().await.expect_problem(401, "unauthorized");
    server.stop().await;
}
