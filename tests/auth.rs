//! Keys: who may ask, and where the service dares to listen without them.

use std::fs;
use std::path::PathBuf;

use crate::harness::{DataDir, Launch, Server, jobs, packstone, run};

/// A key as a client shows it, and the file that knows its hash.
pub(crate) async fn key_file(names: &[&str]) -> (tempfile::TempDir, PathBuf, Vec<String>) {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    let (mut lines, mut keys) = (String::from("# who may ask\n\n"), Vec::new());
    for name in names {
        let made = packstone(directory.path(), &["key", name]).await;
        assert_eq!(made.code, Some(0), "{made:?}");
        let printed = made.stdout.clone() + &made.stderr;
        let line = made.stdout.lines().find(|line| line.contains(name)).expect("a line for the file");
        lines.push_str(line);
        lines.push('\n');
        let key = printed.split_whitespace().find(|word| word.starts_with("packstone_")).expect("a key");
        assert!(!line.contains(key), "the file would hold the key itself");
        keys.push(key.to_owned());
    }
    fs::write(&file, lines).unwrap();
    (directory, file, keys)
}

#[tokio::test]
async fn only_keys_of_the_file_open() {
    let (_directory, file, keys) = key_file(&["laboratory", "students"]).await;
    let data_dir = DataDir::new();
    let launch = Launch::new(&data_dir).env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap());
    let server = launch.env("PACKSTONE_LOG", "debug").start().await;
    let client = server.client();

    for key in &keys {
        client.with_key(key).get("/v1/jobs").send().await.expect(200);
    }
    client.with_key(&keys[0]).succeed(&jobs::quick(1)).await;

    let mut others = vec![client.clone()];
    for key in
        ["", "packstone_", "nonsense", &keys[0][1..], &keys[0].to_uppercase(), &format!("{}x", keys[0])]
    {
        others.push(client.with_key(key));
    }
    for other in &others {
        for path in ["/v1/jobs", "/v1/capabilities", "/metrics", "/v1/jobs/none/result"] {
            let reply = other.get(path).send().await;
            reply.expect_problem(401, "unauthorized");
            assert!(reply.header("www-authenticate").starts_with("Bearer"));
        }
        other.post("/v1/jobs").json(&jobs::quick(1)).send().await.expect_problem(401, "unauthorized");
        // Probes carry no keys.
        other.get("/healthz").send().await.expect(200);
        other.get("/readyz").send().await.expect(200);
    }
    let basic = client.get("/v1/jobs").header("authorization", &format!("Basic {}", keys[0]));
    basic.send().await.expect_problem(401, "unauthorized");

    server.terminate();
    let log = server.log_at_end().await;
    for key in &keys {
        assert!(!log.contains(key.as_str()), "the log holds a key");
    }
}

#[tokio::test]
async fn beyond_loopback_it_listens_only_with_keys_or_on_being_told() {
    let data_dir = DataDir::new();
    let refused = run(Launch::new(&data_dir).listen("0.0.0.0:0").into_command()).await;
    assert_ne!(refused.code, Some(0));
    let said = refused.stderr + &refused.stdout;
    assert!(said.contains("--insecure") && said.contains("0.0.0.0"), "{said}");

    let insecure = Launch::new(&data_dir).listen("0.0.0.0:0").args(&["--insecure"]).start().await;
    insecure.stop().await;
    let (_directory, file, _) = key_file(&["laboratory"]).await;
    let keys = ["--api-keys-file", file.to_str().unwrap()];
    let with_keys = Launch::new(&data_dir).listen("0.0.0.0:0").args(&keys).start().await;
    with_keys.stop().await;
    let loopback = Server::start(&data_dir).await;
    loopback.stop().await;
}

#[tokio::test]
async fn a_key_file_that_is_none_is_refused_by_line() {
    let data_dir = DataDir::new();
    let (_directory, file, _) = key_file(&["laboratory"]).await;
    for (content, says) in [("not a hash\n", "line 1"), ("", "no key"), ("# only a comment\n", "no key")] {
        fs::write(&file, content).unwrap();
        let launch = Launch::new(&data_dir).args(&["--api-keys-file", file.to_str().unwrap()]);
        let refused = run(launch.into_command()).await;
        assert_ne!(refused.code, Some(0));
        let said = refused.stderr + &refused.stdout;
        assert!(said.contains(says) && said.contains(file.to_str().unwrap()), "{content:?}: {said}");
        assert!(!said.contains("panicked"), "{said}");
    }
    let missing = Launch::new(&data_dir).args(&["--api-keys-file", "/nowhere/keys"]);
    let refused = run(missing.into_command()).await;
    assert_ne!(refused.code, Some(0));
    assert!((refused.stderr + &refused.stdout).contains("/nowhere/keys"));
}
