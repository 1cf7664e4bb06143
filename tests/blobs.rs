//! Results and exports in a shared folder and in a bucket of S3, which is moto's.

use std::fs;
use std::path::Path;

use crate::harness::deadline::{eventually, patiently};
use crate::harness::{DataDir, Launch, Server, holds_every_store, id_of, jobs, packstone, run};

/// The files below a folder, as paths from there, without the mark of its owner.
fn files(folder: &Path) -> Vec<String> {
    let mut folders = vec![folder.to_owned()];
    let mut files = Vec::new();
    while let Some(next) = folders.pop() {
        let Ok(entries) = fs::read_dir(next) else { continue };
        for entry in entries.map(Result::unwrap) {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                _ => files.push(entry.path().strip_prefix(folder).unwrap().to_str().unwrap().to_owned()),
            }
        }
    }
    // A sweep may learn the time of the storage at this moment.
    files.retain(|file| file != MARK && !file.starts_with("clock."));
    files.sort();
    files
}

/// The name of the mark by which a place names its database.
const MARK: &str = "owner.json";

/// Starts a server that is to be refused; what it says.
async fn refused(launch: Launch) -> String {
    let ended = run(launch.into_command()).await;
    assert_eq!(ended.code, Some(1), "{ended:?}");
    ended.stderr
}

#[tokio::test]
async fn a_place_is_used_with_one_database_only() {
    let (first, second, shared) = (DataDir::new(), DataDir::new(), tempfile::tempdir().unwrap());
    let folder = shared.path().to_str().unwrap();
    let launch =
        |data_dir: &DataDir| Launch::new(data_dir).args(&["--blobs", folder, "--sweep-interval-s", "0.2"]);
    let server = launch(&first).start().await;
    // Before anything lies there.
    let refusal = refused(launch(&second)).await;
    let mark: serde_json::Value =
        serde_json::from_slice(&fs::read(shared.path().join(MARK)).unwrap()).unwrap();
    let theirs = mark["database"].as_str().unwrap();
    assert!(theirs.len() >= 32, "{mark}");
    for part in [folder, theirs, mark["store"].as_str().unwrap(), MARK, "belongs to the database"] {
        assert!(refusal.contains(part), "{part}: {refusal}");
    }
    // Nor does a wish for orphans help.
    refused(launch(&second).args(&["--adopt-orphans"])).await;
    let job = server.client().succeed(&jobs::quick(1)).await;
    server.stop().await;
    let server = launch(&first).start().await;
    server.client().result(id_of(&job)).await;
    server.stop().await;
    if holds_every_store() {
        return;
    }
    // What is restored from a backup has the same database.
    let parent = tempfile::tempdir().unwrap();
    let target = parent.path().join("copy");
    let data = first.path().to_str().unwrap();
    let args = ["backup", target.to_str().unwrap(), "--data-dir", data, "--blobs", folder];
    assert_eq!(packstone(parent.path(), &args).await.code, Some(0));
    fs::remove_dir_all(first.path()).unwrap();
    fs::rename(&target, first.path()).unwrap();
    let server = launch(&first).start().await;
    server.client().result(id_of(&job)).await;
    server.stop().await;
    let checked = packstone(parent.path(), &["check", data, "--blobs", folder]).await;
    assert_eq!(checked.code, Some(0), "{checked:?}");
    let other = second.path().to_str().unwrap();
    let checked = packstone(parent.path(), &["check", other, "--blobs", folder]).await;
    assert!(checked.code == Some(1) && checked.stdout.contains(theirs), "{checked:?}");
    // A mark that names nothing is no leave to begin.
    fs::write(shared.path().join(MARK), "{").unwrap();
    assert!(refused(launch(&first)).await.contains(MARK));
    fs::remove_file(shared.path().join(MARK)).unwrap();
    launch(&first).start().await.stop().await;
}

#[tokio::test]
async fn a_data_directory_of_postgresql_is_not_used_with_another_database() {
    let data_dir = DataDir::new();
    fs::create_dir_all(data_dir.path().join("checkpoints")).unwrap();
    // One without files has nothing to lose.
    fs::write(data_dir.path().join("checkpoints/01900000-0000-7000-8000-000000000000.1.checkpoint"), "x")
        .unwrap();
    let mark = r#"{"database": "0123", "store": "postgres://lab@db.example:5432/packstone"}"#;
    fs::write(data_dir.path().join(MARK), mark).unwrap();
    let refusal = refused(Launch::new(&data_dir)).await;
    assert!(refusal.contains("0123 at postgres://lab@db.example:5432/packstone"), "{refusal}");
    // Nor is the place of another service taken as a data directory.
    let (other, place) = (DataDir::new(), DataDir::new());
    let folder = place.path().to_str().unwrap();
    let first = Launch::new(&other).args(&["--blobs", folder]).start().await;
    first.client().succeed(&jobs::quick(1)).await;
    refused(Launch::new(&place)).await;
    first.stop().await;
    // Where the operator says that it is not needed any more.
    Launch::new(&data_dir).args(&["--adopt-orphans"]).start().await.stop().await;
    Server::start(&data_dir).await.stop().await;
}

#[tokio::test]
async fn a_place_that_is_replaced_or_gone_makes_the_service_not_ready_and_gets_no_file() {
    let (data_dir, parent) = (DataDir::new(), tempfile::tempdir().unwrap());
    let (place, aside) = (parent.path().join("blobs"), parent.path().join("aside"));
    let server = Launch::new(&data_dir).args(&["--blobs", place.to_str().unwrap()]).start().await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let result = format!("/v1/jobs/{}/result", id_of(&job));
    for replaced in [false, true] {
        fs::rename(&place, &aside).unwrap();
        if replaced {
            // As a folder whose file system is not mounted any more.
            fs::create_dir(&place).unwrap();
        }
        let not_ready = patiently("the service to notice", async {
            loop {
                let reply = client.get("/readyz").send().await;
                if reply.status == 503 {
                    return reply.json();
                }
            }
        })
        .await;
        assert!(not_ready["detail"].as_str().unwrap().contains(place.to_str().unwrap()), "{not_ready}");
        client.get(&result).send().await.expect_problem(503, "not-ready");
        assert_eq!(files(&place), [""; 0]);
        if replaced {
            fs::remove_dir_all(&place).unwrap();
        }
        fs::rename(&aside, &place).unwrap();
        patiently("the service to be ready", async {
            while client.get("/readyz").send().await.status != 200 {}
        })
        .await;
        client.get(&result).send().await.expect(200);
    }
    eventually("the log to tell of it", || server.log().contains("files cannot be read or written")).await;
    server.stop().await;
}

#[tokio::test]
async fn results_and_exports_lie_in_a_shared_folder() {
    let (data_dir, shared) = (DataDir::new(), tempfile::tempdir().unwrap());
    let folder = shared.path().to_str().unwrap();
    let launch = || Launch::new(&data_dir).args(&["--blobs", folder, "--sweep-interval-s", "1"]);
    let server = launch().start().await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let id = id_of(&job);
    let (result, exports) = (format!("/v1/jobs/{id}/result?format=csv"), format!("/v1/jobs/{id}/exports"));
    let csv = client.get(&result).send().await.expect(200).body.clone();
    let voxels =
        client.get(&format!("{exports}/voxels?format=raw&cells=50")).send().await.expect(200).body.clone();
    assert_eq!(voxels.len(), 50 * 50 * 50);
    let stored = files(shared.path());
    let fan = &id[id.len() - 2..];
    assert_eq!(stored.len(), 2, "{stored:?}");
    assert!(stored.contains(&format!("artifacts/{fan}/{id}.1.packstone")), "{stored:?}");
    assert!(data_dir.artifacts().is_empty());

    // A database that does not know what lies there is refused, as in the data directory.
    let other = DataDir::new();
    let refused = run(Launch::new(&other).args(&["--blobs", folder]).into_command()).await;
    assert_eq!(refused.code, Some(1));
    assert!(refused.stderr.contains(&format!("results in {folder}/artifacts")), "{}", refused.stderr);
    server.stop().await;

    let server = launch().start().await;
    let client = server.client();
    assert_eq!(client.get(&result).send().await.expect(200).body, csv);
    let data = data_dir.path().to_str().unwrap();
    let checked = packstone(data_dir.path(), &["check", data, "--blobs", folder]).await;
    assert_eq!(checked.code, Some(0), "{checked:?}");
    let target = shared.path().join("backup");
    let args = ["backup", target.to_str().unwrap(), "--data-dir", data, "--blobs", folder];
    assert_eq!(packstone(data_dir.path(), &args).await.code, Some(0));
    assert_eq!(files(&target), ["packstone.sqlite"]);
    fs::remove_dir_all(target).unwrap();
    client.delete(&format!("/v1/jobs/{id}")).send().await.expect(204);
    eventually("the files to go", || files(shared.path()).is_empty()).await;
    server.stop().await;
}

#[tokio::test]
async fn what_others_may_be_writing_is_left_alone() {
    let (data_dir, shared) = (DataDir::new(), tempfile::tempdir().unwrap());
    let folder = shared.path().to_str().unwrap();
    let launch = |age: &str| {
        let args =
            ["--blobs", folder, "--sweep-interval-s", "0.2", "--adopt-orphans", "--least-blob-age-s", age];
        Launch::new(&data_dir).args(&args)
    };
    let unknown = "artifacts/00/01900000-0000-7000-8000-000000000000.1.packstone";
    let partial = "artifacts/00/01900000-0000-7000-8000-000000000000.2.packstone.0192af.tmp";
    fs::create_dir_all(shared.path().join("artifacts/00")).unwrap();
    for file in [unknown, partial] {
        fs::write(shared.path().join(file), "half a result").unwrap();
    }
    let server = launch("3600").start().await;
    server.client().succeed(&jobs::quick(1)).await;
    assert!([unknown, partial].iter().all(|file| shared.path().join(file).exists()), "they are young");
    server.stop().await;

    // Of an attempt that runs, however old.
    let server = launch("0").workers(1).start().await;
    let running = server.client().submit(&jobs::endless()).await;
    let running = server.client().running(id_of(&running)).await;
    let of_running = shared.path().join(format!("artifacts/00/{}.1.packstone.0192af.tmp", id_of(&running)));
    fs::write(&of_running, "half a result").unwrap();
    let of_ended = shared.path().join(format!("artifacts/00/{}.2.packstone.0192af.tmp", id_of(&running)));
    fs::write(&of_ended, "half a result").unwrap();
    eventually("what nobody writes to go", || {
        let left = [unknown, partial].iter().any(|file| shared.path().join(file).exists());
        !left && !of_ended.exists()
    })
    .await;
    assert!(of_running.exists());
    let kept = files(&shared.path().join("quarantine"));
    assert_eq!(kept.len(), 1, "the whole file is kept, the half ones are not: {kept:?}");
    server.client().post(&format!("/v1/jobs/{}/cancel", id_of(&running))).send().await.expect(202);
    eventually("its file to go", || !of_running.exists()).await;
    server.stop().await;
}

#[tokio::test]
async fn a_checkpoint_is_shared_when_the_server_stops() {
    let (data_dir, shared) = (DataDir::new(), tempfile::tempdir().unwrap());
    let args = ["--blobs", shared.path().to_str().unwrap(), "--checkpoint-every-s", "0"];
    let start = || Launch::new(&data_dir).args(&args).env("RUST_LOG", "info").start();
    let server = start().await;
    let job = server.client().submit(&jobs::growth()).await;
    eventually("a checkpoint", || !data_dir.checkpoints().is_empty()).await;
    server.stop().await;
    let copies = || files(&shared.path().join("checkpoints"));
    let [copy] = &copies()[..] else { panic!("one copy is shared, not {:?}", copies()) };
    assert!(copy.starts_with(&format!("{}/1.", id_of(&job))), "{copy}");
    // As on another machine: what this one had is not there.
    for name in data_dir.checkpoints() {
        fs::remove_file(data_dir.path().join("checkpoints").join(name)).unwrap();
    }
    let server = start().await;
    let job = server.client().finished(id_of(&job)).await;
    assert_eq!((&job["state"], &job["attempt"]), (&"succeeded".into(), &1.into()), "{job:#}");
    assert!(server.log().contains("going on from a checkpoint"), "{}", server.log());
    eventually("the copies to go with the job", || copies().is_empty()).await;
    server.stop().await;
}

mod s3 {
    use std::time::Duration;

    use reqwest::redirect::Policy;
    use rustix::process::Signal;
    use serde_json::{Value, json};

    use super::*;
    use crate::harness::deadline::patiently;
    use crate::harness::{Bucket, Client, Fault, Proxy, Reply, Running};

    /// A server whose results and exports lie in the bucket, under a prefix.
    fn launch(data_dir: &DataDir, endpoint: &str) -> Launch {
        let launch = Launch::new(data_dir).args(&["--blobs", &Bucket::url("lab"), "--sweep-interval-s", "1"]);
        Bucket::variables(endpoint).iter().fold(launch, |launch, (name, value)| launch.env(name, value))
    }

    /// The results and exports in the bucket.
    async fn artifacts(bucket: &Bucket) -> Vec<String> {
        let objects = bucket.objects().await;
        objects.into_iter().filter_map(|name| Some(name.strip_prefix("lab/artifacts/")?.to_owned())).collect()
    }

    async fn eventually_lies(bucket: &Bucket, what: &str, reached: impl Fn(&[String]) -> bool) {
        patiently(what, async {
            let mut look_again = tokio::time::interval(Duration::from_millis(50));
            while !reached(&artifacts(bucket).await) {
                look_again.tick().await;
            }
        })
        .await;
    }

    /// Sent in three parts.
    const LARGE: &str = "voxels?format=raw&cells=260";
    const LARGE_BYTES: usize = 260 * 260 * 260;

    async fn part(client: &Client, path: &str, range: &str) -> Reply {
        let reply = client.get(path).header("range", range).send().await;
        reply.expect(206);
        reply
    }

    #[tokio::test]
    async fn results_and_exports_lie_in_a_bucket() {
        let Some(bucket) = Bucket::start().await else { return };
        let data_dir = DataDir::new();
        let server = launch(&data_dir, &bucket.endpoint()).start().await;
        let client = server.client();
        let job = client.succeed(&jobs::quick(1)).await;
        let id = id_of(&job);
        let large = format!("/v1/jobs/{id}/exports/{LARGE}");
        let made = client.get(&large).send().await;
        let voxels = made.expect(200).body.clone();
        assert_eq!(voxels.len(), LARGE_BYTES);
        let names = artifacts(&bucket).await;
        let fan = &id[id.len() - 2..];
        assert_eq!(names.len(), 2, "{names:?}");
        assert!(names.contains(&format!("{fan}/{id}.1.packstone")), "{names:?}");
        assert!(data_dir.artifacts().is_empty());
        let mut formats = Vec::new();
        for format in ["json", "csv", "npy", "vtp", "vtk"] {
            let path = format!("/v1/jobs/{id}/result?format={format}");
            let whole = client.get(&path).send().await.expect(200).body.clone();
            let piece = part(&client, &path, "bytes=10-99").await;
            assert_eq!(piece.body, whole[10..100], "{format}");
            formats.push((path, whole));
        }
        for (range, expected) in [
            ("bytes=0-0", 0..1),
            ("bytes=8388600-8388700", 8_388_600..8_388_701),
            ("bytes=-7", LARGE_BYTES - 7..LARGE_BYTES),
        ] {
            assert_eq!(part(&client, &large, range).await.body, voxels[expected], "{range}");
        }
        let tag = made.header("etag").to_owned();
        client.get(&large).header("if-none-match", &tag).send().await.expect(304);
        assert!(client.head(&large).send().await.expect(200).body.is_empty());
        let data = data_dir.path().to_str().unwrap();
        server.stop().await;

        let mut check = std::process::Command::new(env!("CARGO_BIN_EXE_packstone"));
        check
            .args(["check", data, "--blobs", &Bucket::url("lab")])
            .envs(Bucket::variables(&bucket.endpoint()));
        let checked = run(check).await;
        assert_eq!(checked.code, Some(0), "{checked:?}");

        // Another life of the service reads what the first has stored.
        let server = launch(&data_dir, &bucket.endpoint()).start().await;
        let client = server.client();
        for (path, whole) in &formats {
            assert_eq!(client.get(path).send().await.expect(200).body, *whole, "{path}");
        }
        assert_eq!(client.get(&large).send().await.expect(200).body, voxels);
        // An export that is gone is made again, a result is missed.
        let export = artifacts(&bucket).await.into_iter().find(|name| name.ends_with(".export")).unwrap();
        bucket.delete(&format!("lab/artifacts/{export}")).await;
        assert_eq!(client.get(&large).send().await.expect(200).body, voxels);
        let other = client.succeed(&jobs::quick(2)).await;
        let of_other = format!("{}.1.packstone", id_of(&other));
        let name = artifacts(&bucket).await.into_iter().find(|name| name.ends_with(&of_other)).unwrap();
        bucket.delete(&format!("lab/artifacts/{name}")).await;
        bucket.put(&format!("lab/artifacts/{name}"), b"something else".to_vec()).await;
        let result = format!("/v1/jobs/{}/result", id_of(&other));
        client.get(&result).send().await.expect_problem(410, "result-damaged");
        client.post(&format!("/v1/jobs/{}/retry", id_of(&other))).send().await.expect(200);
        client.finished(id_of(&other)).await;
        client.get(&result).send().await.expect(200);
        for job in [&job, &other] {
            client.delete(&format!("/v1/jobs/{}", id_of(job))).send().await.expect(204);
        }
        eventually_lies(&bucket, "the objects to go", <[String]>::is_empty).await;
        server.stop().await;
        assert_eq!(files(&data_dir.path().join("scratch")), [""; 0], "copies go with the process");
    }

    #[tokio::test]
    async fn clients_are_sent_to_the_bucket_where_the_operator_says_so() {
        let Some(bucket) = Bucket::start().await else { return };
        let (data_dir, keys) = (DataDir::new(), tempfile::tempdir().unwrap());
        let made = packstone(keys.path(), &["key", "first"]).await;
        let file = keys.path().join("keys");
        let line = made.stdout.lines().find(|line| line.contains("first")).unwrap();
        fs::write(&file, format!("{line}\n")).unwrap();
        let printed = made.stdout.clone() + &made.stderr;
        let key = printed.split_whitespace().find(|word| word.starts_with("packstone_")).unwrap();
        let launch = launch(&data_dir, &bucket.endpoint()).args(&["--blobs-redirect"]);
        let server = launch.env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap()).start().await;
        let client = server.client().with_key(key);
        let job = client.succeed(&jobs::quick(1)).await;
        let path = format!("/v1/jobs/{}/exports/voxels?format=raw&cells=50", id_of(&job));
        // The head of a file comes from the server.
        let served = client.head(&path).send().await;
        served.expect(200);
        let plain = reqwest::Client::builder().no_proxy().redirect(Policy::none()).build().unwrap();
        let url = format!("http://{}{path}", server.address());
        assert_eq!(plain.get(&url).send().await.unwrap().status(), 401);
        let sent = plain.get(&url).bearer_auth(key).send().await.unwrap();
        assert_eq!(sent.status(), 307);
        assert_eq!(sent.headers()["cache-control"], "no-store");
        let location = sent.headers()["location"].to_str().unwrap().to_owned();
        assert!(
            location.starts_with(&bucket.endpoint()) && location.contains("X-Amz-Expires=300"),
            "{location}"
        );
        let direct = plain.get(&location).send().await.unwrap();
        assert_eq!(direct.status(), 200);
        for name in ["content-type", "content-disposition", "content-length"] {
            assert_eq!(direct.headers()[name], served.headers[name], "{name}");
        }
        let bytes = direct.bytes().await.unwrap();
        let piece = plain.get(&location).header("range", "bytes=5-9").send().await.unwrap();
        assert_eq!(piece.bytes().await.unwrap(), bytes[5..10]);
        // Formats that are made of the stored form are sent by the server.
        let result = format!("http://{}/v1/jobs/{}/result?format=npy", server.address(), id_of(&job));
        assert_eq!(plain.get(&result).bearer_auth(key).send().await.unwrap().status(), 200);
        // Who follows gets the file.
        assert_eq!(client.get(&path).send().await.expect(200).body, bytes);
        server.stop().await;
    }

    #[tokio::test]
    async fn a_server_that_is_killed_while_it_uploads_loses_nothing() {
        let Some(bucket) = Bucket::start().await else { return };
        let proxy = Proxy::start(bucket.address()).await;
        let data_dir = DataDir::new();
        let server = launch(&data_dir, &proxy.url()).start().await;
        let first = server.client().succeed(&jobs::quick(1)).await;
        let large = format!("/v1/jobs/{}/exports/{LARGE}", id_of(&first));
        proxy.set(Fault::HeldWrites);
        let second = server.client().submit(&jobs::quick(2)).await;
        server.client().post(&large).send().await.expect(202);
        // The result, and the first two parts of the export.
        proxy.has_failed(3).await;
        server.kill().await;
        let scratch = files(&data_dir.path().join("scratch"));
        assert!(scratch.len() >= 2, "{scratch:?}");
        assert_eq!(artifacts(&bucket).await.len(), 1);
        assert!(
            bucket.uploads().await.len() <= 1,
            "parts of an export may be left to the rule of the bucket"
        );
        let age = ["--least-blob-age-s", "0"];
        let server = launch(&data_dir, &bucket.endpoint()).args(&age).start().await;
        let client = server.client();
        let second = client.finished(id_of(&second)).await;
        assert_eq!(second["state"], "succeeded");
        client.result(id_of(&second)).await;
        client.result(id_of(&first)).await;
        assert_eq!(client.get(&large).send().await.expect(200).body.len(), LARGE_BYTES);
        let names = artifacts(&bucket).await;
        assert_eq!(names.len(), 3, "no object is left over: {names:?}");
        // What is complete but unknown is kept apart. An object of an attempt that is over, and one that is not an
        // artifact.
        bucket.put("lab/artifacts/00/01900000-0000-7000-8000-000000000000.1.packstone", b"x".to_vec()).await;
        eventually_lies(&bucket, "the unknown object to be moved", |names| names.len() == 3).await;
        let objects = bucket.objects().await;
        let kept = |name: &&String| name.starts_with("lab/quarantine/") && name.ends_with(".1.packstone");
        assert_eq!(objects.iter().filter(kept).count(), 1, "{objects:?}");
        server.stop().await;
    }

    #[tokio::test]
    async fn a_bucket_that_fails_for_a_while_costs_no_job_and_no_attempt() {
        let Some(bucket) = Bucket::start().await else { return };
        let proxy = Proxy::start(bucket.address()).await;
        let data_dir = DataDir::new();
        let server = launch(&data_dir, &proxy.url()).start().await;
        let client = server.client();
        let first = client.succeed(&jobs::quick(1)).await;
        let export = format!("/v1/jobs/{}/exports/slice?format=svg", id_of(&first));
        let svg = client.get(&export).send().await.expect(200).body.clone();
        // Of this one the server has no copy.
        let unread = client.succeed(&jobs::quick(9)).await;
        let unread = format!("/v1/jobs/{}/result", id_of(&unread));
        for (seed, fault) in [(2, Fault::Unavailable), (3, Fault::Closed)] {
            proxy.set(fault);
            let job = jobs::with(jobs::quick(seed), "/max_attempts", json!(1));
            let job = client.submit(&job).await;
            proxy.has_failed(3).await;
            for path in [&unread, &export] {
                let refused = client.get(path).send().await;
                refused.expect_problem(503, "not-ready");
                assert!(!refused.header("retry-after").is_empty());
            }
            // The result was tried for 15 s; then the job waits, and would be packed again.
            let waits = |job: &Value| job["state"] == "queued";
            if fault == Fault::Unavailable {
                client.job_when(id_of(&job), "its turn to be given back", waits).await;
            }
            proxy.set(Fault::None);
            let job = client.finished(id_of(&job)).await;
            assert_eq!((&job["state"], &job["attempt"]), (&json!("succeeded"), &json!(1)), "{job:#}");
            client.result(id_of(&job)).await;
            assert_eq!(client.get(&export).send().await.expect(200).body, svg);
        }
        // What cannot be removed now is removed later.
        proxy.set(Fault::Unavailable);
        client.delete(&format!("/v1/jobs/{}", id_of(&first))).send().await.expect(204);
        assert_eq!(artifacts(&bucket).await.len(), 5);
        proxy.set(Fault::None);
        eventually_lies(&bucket, "the objects of a deleted job to go", |names| names.len() == 3).await;
        client.get(&unread).send().await.expect(200);
        server.stop().await;
    }

    #[tokio::test]
    async fn a_bucket_that_does_not_answer_is_not_waited_for_without_end() {
        let Some(bucket) = Bucket::start().await else { return };
        let proxy = Proxy::start(bucket.address()).await;
        let data_dir = DataDir::new();
        let server = launch(&data_dir, &proxy.url()).start().await;
        let client = server.client();
        let job = client.succeed(&jobs::quick(1)).await;
        let result = format!("/v1/jobs/{}/result", id_of(&job));
        proxy.set(Fault::Held);
        // The patience of the client is longer than that of the server.
        let refused = client.get(&result).send().await;
        refused.expect_problem(503, "not-ready");
        assert!(!refused.header("retry-after").is_empty());
        let not_ready = client.get("/readyz").send().await.expect_problem(503, "not-ready");
        assert!(not_ready["detail"].as_str().unwrap().contains("s3://packstone/lab"), "{not_ready}");
        // From then on nobody waits, however many ask.
        let asked = std::time::Instant::now();
        let all = (0..100).map(|_| client.get(&result).send());
        for refused in futures_util::future::join_all(all).await {
            refused.expect_problem(503, "not-ready");
        }
        assert!(asked.elapsed() < Duration::from_secs(10), "{:?}", asked.elapsed());
        // Nor does the server wait for what it has begun when it is to stop.
        let stuck = client.submit(&jobs::quick(2)).await;
        proxy.has_failed(2).await;
        server.terminate();
        let log = server.log_at_end().await;
        assert!(!log.contains("panicked"), "{log}");
        proxy.set(Fault::None);
        let server = launch(&data_dir, &proxy.url()).start().await;
        let stuck = server.client().finished(id_of(&stuck)).await;
        assert_eq!((&stuck["state"], &stuck["attempt"]), (&json!("succeeded"), &json!(1)), "{stuck:#}");
        server.client().get(&result).send().await.expect(200);
        server.stop().await;
    }

    #[tokio::test]
    async fn workers_elsewhere_deliver_to_a_server_with_a_bucket() {
        let Some(bucket) = Bucket::start().await else { return };
        let proxy = Proxy::start(bucket.address()).await;
        let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
        let server = launch(&data_dir, &proxy.url()).workers(0).start().await;
        let client = server.client();
        let url = format!("http://{}", server.address());
        let worker = Running::spawn(folder.path(), &["worker", "--server", &url, "--slots", "1"]);
        // The first tries to deliver fail.
        proxy.set(Fault::Unavailable);
        let job = client.submit(&jobs::quick(1)).await;
        proxy.has_failed(3).await;
        proxy.set(Fault::None);
        let job = client.finished(id_of(&job)).await;
        assert_eq!((&job["state"], &job["attempt"]), (&json!("succeeded"), &json!(1)), "{job:#}");
        client.result(id_of(&job)).await;
        assert_eq!(artifacts(&bucket).await.len(), 1);
        worker.signal(Signal::TERM);
        assert_eq!(worker.ended().await.code, Some(0));
        server.stop().await;
    }

    #[tokio::test]
    async fn a_bucket_that_cannot_be_used_is_told_at_the_start() {
        let Some(bucket) = Bucket::start().await else { return };
        let data_dir = DataDir::new();
        let mut launched = Launch::new(&data_dir).args(&["--blobs", "s3://missing/lab"]);
        for (name, value) in Bucket::variables(&bucket.endpoint()) {
            launched = launched.env(name, &value);
        }
        let refused = run(launched.into_command()).await;
        assert_eq!(refused.code, Some(1));
        assert!(
            refused.stderr.contains("the blobs at s3://missing/lab cannot be used"),
            "{}",
            refused.stderr
        );
        let plain = launch(&data_dir, &bucket.endpoint()).env("AWS_ALLOW_HTTP", "false");
        let refused = run(plain.into_command()).await;
        assert_eq!(refused.code, Some(1));
        assert!(refused.stderr.contains("AWS_ALLOW_HTTP"), "{}", refused.stderr);
    }
}
