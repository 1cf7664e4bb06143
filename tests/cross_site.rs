//! Pages of other sites in the browser of a user: they change nothing, with and without keys.

use reqwest::Method;
use serde_json::json;

use crate::harness::{Client, DataDir, RawConnection, Server, id_of, jobs};
use crate::published_contract::operations;
use crate::users::laboratory;

/// What browsers say of a request of another site's page: those that take the address for safe, and others.
const FOREIGN: [&[(&str, &str)]; 4] = [
    &[("origin", "http://evil.example"), ("sec-fetch-site", "cross-site")],
    &[("sec-fetch-site", "same-site")],
    &[("origin", "http://evil.example")],
    &[("origin", "null")],
];

/// Every operation of the interface that changes something, with a path.
fn changing() -> Vec<(Method, String)> {
    let id = "01900000-0000-7000-8000-0123456789ab";
    operations()
        .into_iter()
        .filter_map(|(name, _)| {
            let (method, path) = name.split_once(' ').unwrap();
            let path = path
                .replace("{id}", id)
                .replace("{job}", id)
                .replace("{attempt}", "1")
                .replace("{type}", "shapes");
            let method: Method = method.to_uppercase().parse().unwrap();
            (![Method::GET, Method::HEAD].contains(&method)).then_some((method, path))
        })
        .collect()
}

async fn foreign_pages_change_nothing(client: &Client) {
    let changing = changing();
    assert!(changing.len() > 15, "{changing:?}");
    for (method, path) in &changing {
        for fields in FOREIGN {
            let request = client.request(method.clone(), path);
            let request = fields.iter().fold(request, |request, (name, value)| request.header(name, value));
            // As the form of a page sends it.
            let request = request.header("content-type", "text/plain").body("{}");
            request.send().await.expect_problem(403, "forbidden");
        }
        // A program says nothing of pages.
        let status = client.request(method.clone(), path).send().await.status;
        assert_ne!(status, 403, "{method} {path}");
    }
}

#[tokio::test]
async fn a_page_of_another_site_changes_nothing() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    foreign_pages_change_nothing(&client).await;
    let job = client.submit(&jobs::endless_growth()).await;
    let path = format!("/v1/jobs/{}", id_of(&job));
    let cancel = || client.post(&format!("{path}/cancel"));
    cancel().header("origin", "http://evil.example").send().await.expect_problem(403, "forbidden");
    assert_eq!(client.running(id_of(&job)).await["cancel_requested"], false);
    // Reading is left to the rules of browsers.
    client.get(&path).header("sec-fetch-site", "cross-site").send().await.expect(200);
    // The page of this server, in both forms.
    cancel().header("origin", &format!("http://{}", server.address())).send().await;
    cancel().header("sec-fetch-site", "same-origin").send().await;
    assert_eq!(client.finished(id_of(&job)).await["state"], "cancelled");
    server.stop().await;
}

#[tokio::test]
async fn a_page_of_another_site_changes_nothing_by_a_key() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let root = keys.client(&server, "root");
    for (method, path) in changing() {
        let request = root.request(method, &path).header("sec-fetch-site", "cross-site").body("{}");
        request.send().await.expect_problem(403, "forbidden");
    }
    root.post("/v1/jobs").json(&jobs::quick(1)).send().await.expect(201);
    server.stop().await;
}

#[tokio::test]
async fn a_picture_of_another_site_starts_no_export_and_a_link_does() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let slice = format!("/v1/jobs/{}/exports/slice?format=svg", id_of(&job));
    let embedded =
        || client.get(&slice).header("sec-fetch-site", "cross-site").header("sec-fetch-mode", "no-cors");
    embedded().send().await.expect_problem(403, "forbidden");
    let link = client.get(&slice).header("sec-fetch-site", "cross-site").header("sec-fetch-mode", "navigate");
    link.send().await.expect(200);
    embedded().send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn the_host_of_a_whole_target_is_judged_like_the_field() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let own = server.address();
    for (target, host, status) in [
        ("http://evil.example/v1/jobs", "localhost", 400),
        ("http://evil.example/v1/jobs", "evil.example", 400),
        ("http://localhost/v1/jobs", "evil.example", 400),
        ("http://localhost/v1/jobs", "localhost", 200),
        (&format!("http://{own}/v1/jobs"), &own.to_string(), 200),
        ("/v1/jobs", "evil.example", 400),
        ("/v1/jobs", "localhost", 200),
    ] {
        let mut connection = RawConnection::open(own).await;
        connection.send(format!("GET {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")).await;
        let said = connection.until_closed().await;
        assert!(said.starts_with(&format!("HTTP/1.1 {status} ")), "{target} {host}: {said}");
    }
    server.stop().await;
}

#[tokio::test]
async fn files_are_called_as_their_job_in_every_script() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::with(jobs::quick(1), "/name", json!("Würfel 日本"))).await;
    let path = format!("/v1/jobs/{}", id_of(&job));
    for target in [
        "/result?format=csv",
        "/result?format=html",
        "/plots/grading",
        "/exports/slice?format=svg",
        "/exports/shapes?format=csv",
    ] {
        let reply = client.get(&format!("{path}{target}")).send().await;
        let shown = reply.expect(200).header("content-disposition").to_owned();
        assert!(shown.contains("filename=\"W-rfel-"), "{target}: {shown}");
        assert!(shown.contains("; filename*=UTF-8''W%C3%BCrfel-%E6%97%A5%E6%9C%AC-"), "{target}: {shown}");
    }
    server.stop().await;
}
