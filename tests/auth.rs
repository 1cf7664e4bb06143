//! Keys: who may ask, and where the service dares to listen without them.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::harness::deadline::patiently;
use crate::harness::{Client, DataDir, Launch, Server, jobs, packstone, run};

/// A key as a client shows it, and the file that knows its hash.
pub(crate) async fn key_file(names: &[&str]) -> (tempfile::TempDir, PathBuf, Vec<String>) {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("keys");
    let (mut lines, mut keys) = (String::from("# who may ask\n\n"), Vec::new());
    for name in names {
        let made = packstone(directory.path(), &["key", name, "--role", "admin"]).await;
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

/// Waits until `/readyz` names the files of settings that cannot be used, or none.
async fn faulty_settings(client: &Client, expected: &[&str]) {
    patiently(&format!("/readyz to name {expected:?}"), async {
        loop {
            let ready = client.get("/readyz").send().await.expect(200).json();
            let parts = ready["details"].as_array().unwrap().iter().map(|detail| detail["part"].clone());
            if parts.collect::<Vec<Value>>() == expected {
                return;
            }
            tokio::time::sleep(std::time::Duration::from_millis(50)).await;
        }
    })
    .await;
}

#[tokio::test]
async fn a_file_of_keys_that_is_cut_or_misspelled_changes_no_right_and_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let mut keys = Vec::new();
    for args in [&["root", "--role", "admin"][..], &["anna", "--owner", "lab", "--max-queued", "12"]] {
        let made = packstone(folder.path(), &[&["key"], args, &["--add-to", "keys"]].concat()).await;
        assert_eq!(made.code, Some(0), "{made:?}");
        keys.push(made.stdout.trim().to_owned());
    }
    let file = folder.path().join("keys");
    let whole = fs::read_to_string(&file).unwrap();
    let data_dir = DataDir::new();
    let launch = || Launch::new(&data_dir).env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap());
    let server = launch().start().await;
    let rights = async || {
        let mut found = Vec::new();
        for key in &keys {
            let key = server.client().with_key(key).get("/v1/key").send().await.expect(200).json();
            found.push(json!([key["name"], key["owner"], key["role"], key["quotas"]["max_queued"]]));
        }
        found
    };
    let made = [json!(["root", "root", "admin", null]), json!(["anna", "lab", "submit", 12])];
    assert_eq!(rights().await, made);
    let cut = |before: &str| whole[..whole.find(before).unwrap()].to_owned();
    let line_before = |before: &str| cut(before) + "\n";
    for unusable in [
        cut(" role=submit"),
        line_before(" role=submit"),
        cut("mit owner="),
        cut("ab max_queued"),
        cut("2\n"),
        whole.replace("role=submit", "role:submit"),
        whole.replace("role=submit owner", "submit owner"),
        whole.replace("role=submit", "rol=submit"),
        whole.replace("max_queued=", "max_queued:"),
        String::new(),
        "# all are gone\n".to_owned(),
        "\0".repeat(whole.len()),
    ] {
        assert_ne!(unusable, whole);
        fs::write(&file, &unusable).unwrap();
        faulty_settings(&server.client(), &["api_keys"]).await;
        assert_eq!(rights().await, made, "{unusable:?}");
        let refused = run(launch().listen("127.0.0.1:0").into_command()).await;
        assert_ne!(refused.code, Some(0), "{unusable:?}");
        fs::write(&file, &whole).unwrap();
        faulty_settings(&server.client(), &[]).await;
    }
    // Of the same length, with the same time: the digit of a quota.
    let time = fs::metadata(&file).unwrap().modified().unwrap();
    fs::write(&file, whole.replace("max_queued=12", "max_queued=11")).unwrap();
    fs::File::options().write(true).open(&file).unwrap().set_modified(time).unwrap();
    patiently("the other quota to count", async { while rights().await[1][3] != 11 {} }).await;
    server.terminate();
    let log = server.log_at_end().await;
    assert!(log.contains("the API keys stay as they were"), "{log}");
}

#[tokio::test]
async fn a_key_is_added_to_a_file_in_one_step() {
    let folder = tempfile::tempdir().unwrap();
    let add = async |args: &[&str]| {
        packstone(folder.path(), &[&["key"], args, &["--add-to", "keys"]].concat()).await
    };
    let file = folder.path().join("keys");
    let first = add(&["laboratory"]).await;
    assert_eq!(first.code, Some(0), "{first:?}");
    let key = first.stdout.trim();
    assert!(key.starts_with("packstone_") && key.lines().count() == 1, "{first:?}");
    assert!(fs::read_to_string(&file).unwrap().ends_with(" laboratory role=submit\n"));
    fs::set_permissions(&file, fs::Permissions::from_mode(0o604)).unwrap();
    assert_eq!(add(&["operator", "--role", "admin"]).await.code, Some(0));
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o604);
    let both = fs::read_to_string(&file).unwrap();
    let twice = add(&["laboratory"]).await;
    assert_eq!(twice.code, Some(3), "{twice:?}");
    assert!(twice.stdout.is_empty() && twice.stderr.contains("\"laboratory\""), "{twice:?}");
    fs::write(&file, both.trim_end()).unwrap();
    let cut = add(&["other"]).await;
    assert!(cut.code == Some(3) && cut.stderr.contains("has no line break"), "{cut:?}");
    fs::write(&file, &both).unwrap();
    // Each name once, whatever the order of commands that run at once.
    let names = ["a", "b", "c", "d"].map(|name| [name]);
    let ended = futures_util::future::join_all(names.iter().map(|name| add(name))).await;
    assert!(ended.iter().all(|ended| ended.code == Some(0)), "{ended:?}");
    assert_eq!(fs::read_to_string(&file).unwrap().lines().count(), 6);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no partial file is left");
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--api-keys-file", file.to_str().unwrap()]).start().await;
    server.client().with_key(key).get("/v1/jobs").send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn a_misspelled_switch_does_not_switch_on() {
    let data_dir = DataDir::new();
    for name in ["INSECURE", "TRUST_PROXY", "NO_WEB", "ADOPT_ORPHANS", "BLOBS_REDIRECT"] {
        let name = format!("PACKSTONE_{name}");
        let refused = run(Launch::new(&data_dir).env(&name, "flase").into_command()).await;
        assert_eq!(refused.code, Some(2), "{name}: {refused:?}");
    }
    let misspelled =
        Launch::new(&data_dir).env("PACKSTONE_API_KEY_FILE", "keys").env("PACKSTONE_API_KEYS_FILE", "");
    let server = misspelled
        .env("PACKSTONE_SERVICE_PORT", "80")
        .env("PACKSTONE_PORT", "tcp://10.0.0.1:80")
        .start()
        .await;
    server.terminate();
    let log = server.log_at_end().await;
    assert!(log.contains("PACKSTONE_API_KEY_FILE") && !log.contains("_PORT"), "{log}");
    assert!(log.contains("the service asks for no keys"), "{log}");
    for faulty in ["--blobs=", "--data-dir=", "--max-downloads=0", "--max-connections=0"] {
        let refused = run(Launch::new(&data_dir).args(&[faulty]).into_command()).await;
        assert_eq!(refused.code, Some(2), "{faulty}: {refused:?}");
    }
    let refused = run(Launch::new(&data_dir).env("PACKSTONE_ALLOWED_HOST", "a,,b").into_command()).await;
    assert_eq!(refused.code, Some(2), "{refused:?}");
}
