//! The files of the web page as a browser gets them: types, safety, cache, and nothing beside them.

use std::path::Path;

use reqwest::Method;

use crate::auth::key_file;
use crate::harness::{DataDir, Launch, Server};

const PAGES: [&str; 6] = ["/", "/jobs", "/jobs/any-id", "/studies", "/studies/any-id", "/service"];

fn file(name: &str) -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../web").join(name)).unwrap()
}

#[tokio::test]
async fn pages_and_assets_are_safe_and_are_sent_again_only_when_they_have_changed() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for path in PAGES.into_iter().chain(["/assets/app.css"]) {
        let answer = client.get(path).send().await;
        answer.expect(200);
        let is_page = path != "/assets/app.css";
        let media_type = if is_page { "text/html; charset=utf-8" } else { "text/css; charset=utf-8" };
        assert_eq!(answer.header("content-type"), media_type, "{path}");
        let policy = answer.header("content-security-policy");
        for rule in
            ["default-src 'none'", "script-src 'self'", "frame-ancestors 'none'", "require-trusted-types-for"]
        {
            assert!(policy.contains(rule), "{path}: {rule} is not in {policy}");
        }
        assert_eq!(answer.header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(answer.header("referrer-policy"), "no-referrer", "{path}");
        assert_eq!(answer.header("cross-origin-opener-policy"), "same-origin", "{path}");
        assert_eq!(answer.header("cache-control"), "no-cache", "{path}");
        assert_eq!(answer.header("vary"), "accept-encoding", "{path}");
        let etag = answer.header("etag").to_owned();
        assert!(etag.starts_with('"'), "a strong tag: {etag}");
        let known = client.get(path).header("if-none-match", &etag).send().await;
        known.expect(304);
        assert_eq!((known.header("etag"), known.body.len()), (&*etag, 0), "{path}");
        let head = client.head(path).send().await;
        head.expect(200);
        assert_eq!(head.header("content-length"), answer.body.len().to_string(), "{path}");
        client.request(Method::POST, path).send().await.expect_problem(405, "method-not-allowed");
    }
    assert_eq!(client.get("/").send().await.body, file("index.html"));
    let zipped = client.get("/").header("accept-encoding", "gzip").send().await;
    zipped.expect(200);
    assert_eq!(zipped.header("content-encoding"), "gzip");
    assert!(zipped.body.starts_with(&[0x1f, 0x8b]) && zipped.body.len() < file("index.html").len());
    assert_ne!(zipped.header("etag"), client.get("/").send().await.header("etag"), "each form has its tag");
    server.stop().await;
}

#[tokio::test]
async fn other_names_do_not_exist_and_routes_are_counted_by_their_pattern() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for path in
        ["/assets/", "/assets/none.js", "/assets/index.html", "/assets/..%2fCargo.toml", "/none", "/jobs/a/b"]
    {
        client.get(path).send().await.expect_problem(404, "not-found");
    }
    let metrics = client.get("/metrics").send().await;
    let metrics = String::from_utf8(metrics.expect(200).body.to_vec()).unwrap();
    assert!(metrics.contains("/assets/{*name}") && !metrics.contains("none.js"), "{metrics}");
    server.stop().await;

    let server = Launch::new(&data_dir).args(&["--no-web"]).start().await;
    for path in PAGES.into_iter().chain(["/assets/app.css"]) {
        server.client().get(path).send().await.expect_problem(404, "not-found");
    }
    server.stop().await;
}

#[tokio::test]
async fn pages_are_open_where_the_interface_needs_a_key() {
    let data_dir = DataDir::new();
    let (_folder, keys, _) = key_file(&["laboratory"]).await;
    let server = Launch::new(&data_dir).args(&["--api-keys-file", keys.to_str().unwrap()]).start().await;
    for path in PAGES.into_iter().chain(["/assets/app.css"]) {
        server.client().get(path).send().await.expect(200);
    }
    server.client().get("/v1/jobs").send().await.expect_problem(401, "unauthorized");
    server.stop().await;
}

#[tokio::test]
async fn a_folder_of_files_is_read_at_each_request_and_no_further() {
    let data_dir = DataDir::new();
    let folder = tempfile::tempdir().unwrap();
    let web = folder.path().join("web");
    std::fs::create_dir(&web).unwrap();
    std::fs::write(folder.path().join("app.js"), "outside").unwrap();
    std::fs::write(web.join("other.css"), "not in the table").unwrap();
    std::fs::write(web.join("app.css"), "a {}").unwrap();
    let server = Launch::new(&data_dir).args(&["--web-dir", web.to_str().unwrap()]).start().await;
    let client = server.client();
    let first = client.get("/assets/app.css").send().await;
    assert_eq!(&first.expect(200).body[..], b"a {}");
    std::fs::write(web.join("app.css"), "b {}").unwrap();
    let changed = client.get("/assets/app.css").header("if-none-match", first.header("etag")).send().await;
    assert_eq!(&changed.expect(200).body[..], b"b {}");
    for path in
        ["/", "/assets/other.css", "/assets/../app.js", "/assets/..%2fapp.js", "/assets/%2e%2e/app.js"]
    {
        client.get(path).send().await.expect_problem(404, "not-found");
    }
    server.stop().await;
}

#[tokio::test]
async fn documents_are_open_and_a_browser_gets_a_page_for_an_address_that_does_not_exist() {
    let data_dir = DataDir::new();
    let (_folder, keys, _) = key_file(&["laboratory"]).await;
    let server = Launch::new(&data_dir).args(&["--api-keys-file", keys.to_str().unwrap()]).start().await;
    let client = server.client();
    let html = "text/html; charset=utf-8";
    for (path, media_type) in [
        ("/docs/", html),
        ("/docs/mixes", html),
        ("/docs/tutorial/", html),
        ("/docs/files/docs/tutorial/first.json", "application/json"),
        ("/assets/gallery.json", "application/json"),
        ("/assets/gallery/dice.png", "image/png"),
        ("/assets/version.json", "application/json"),
    ] {
        let answer = client.get(path).send().await;
        assert_eq!(answer.expect(200).header("content-type"), media_type, "{path}");
        assert!(answer.header("content-security-policy").contains("default-src 'none'"), "{path}");
    }
    // Redirected.
    client.get("/docs").send().await.expect(200);
    for path in ["/docs/none", "/docs/mixes.md", "/assets/none.js", "/assets/gallery/none.png"] {
        client.get(path).send().await.expect_problem(404, "not-found");
        let page = client.get(path).header("accept", "text/html,*/*;q=0.8").send().await;
        page.expect(404);
        assert_eq!(page.header("content-type"), html, "{path}");
        let root = "../".repeat(path.matches('/').count() - 1);
        let link = format!("<a href=\"{root}docs/\">");
        assert!(String::from_utf8_lossy(&page.body).contains(&link), "{path}");
    }
    server.stop().await;

    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--no-web"]).start().await;
    for path in ["/docs/", "/assets/gallery.json", "/none"] {
        let browser = server.client().get(path).header("accept", "text/html").send().await;
        browser.expect_problem(404, "not-found");
    }
    server.stop().await;
}
