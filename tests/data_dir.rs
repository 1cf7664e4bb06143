//! The data directory: one server's own, and swept of what no job refers to.

use std::fs;

use serde_json::json;

use crate::harness::deadline::{eventually, patiently};
use crate::harness::{Client, DataDir, Launch, Server, holds_every_store, id_of, jobs, run};

#[tokio::test]
async fn two_servers_never_share_one() {
    let data_dir = DataDir::new();
    let first = Server::start(&data_dir).await;
    let second = run(Launch::new(&data_dir).into_command()).await;
    assert_ne!(second.code, Some(0));
    let said = second.stderr.clone() + &second.stdout;
    assert!(said.contains(&*data_dir.path().to_string_lossy()), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    first.client().succeed(&jobs::quick(1)).await;

    // A lock that a dead process left behind is none.
    first.kill().await;
    let third = Server::start(&data_dir).await;
    third.client().succeed(&jobs::quick(1)).await;
    third.stop().await;
}

#[tokio::test]
async fn what_is_no_directory_is_refused_in_words() {
    let data_dir = DataDir::new();
    let file = data_dir.path().join("file");
    fs::create_dir_all(data_dir.path()).unwrap();
    fs::write(&file, "not a directory").unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_packstone"));
    command.args(["serve", "--listen", "127.0.0.1:0", "--data-dir"]).arg(&file);
    let ended = run(command).await;
    assert_ne!(ended.code, Some(0));
    let said = ended.stderr + &ended.stdout;
    assert!(said.contains(file.to_str().unwrap()) && !said.contains("panicked"), "{said}");
}

/// Asks until the job is gone. Its expiry is no change of the job: nobody is told of it.
async fn gone(client: &Client, id: &str) {
    patiently("an expired job to be swept", async {
        loop {
            let reply = client.get(&format!("/v1/jobs/{id}")).header("prefer", "wait=1").send().await;
            if reply.status == 404 {
                return;
            }
            let etag = reply.header("etag").to_owned();
            let request = client.get(&format!("/v1/jobs/{id}")).header("if-none-match", &etag);
            request.header("prefer", "wait=1").send().await;
        }
    })
    .await;
}

fn in_seconds(seconds: i64) -> String {
    (jiff::Timestamp::now() + jiff::SignedDuration::from_secs(seconds)).to_string()
}

#[tokio::test]
async fn expired_jobs_go_with_their_files() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--sweep-interval-s", "1"]).start().await;
    let client = server.client();
    let kept = client.succeed(&jobs::quick(1)).await;
    let expiring = client.succeed(&jobs::with(jobs::quick(2), "/expires_at", json!(in_seconds(2)))).await;
    assert_eq!(data_dir.artifacts().len(), 2);
    gone(&client, id_of(&expiring)).await;
    client
        .get(&format!("/v1/jobs/{}/result", id_of(&expiring)))
        .send()
        .await
        .expect_problem(404, "not-found");
    client.result(id_of(&kept)).await;
    eventually("the file of an expired job to go", || data_dir.artifacts().len() == 1).await;
    server.stop().await;
}

#[tokio::test]
async fn orphaned_files_are_swept_and_others_kept() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let job = server.client().succeed(&jobs::quick(1)).await;
    server.kill().await;

    let files = data_dir.artifacts();
    let [stored] = &files[..] else { panic!("one job has one file, not {files:?}") };
    // What a cut leaves: a half-written file, and a whole one whose job does not know of it.
    let of_no_job = stored
        .file_name()
        .unwrap()
        .to_string_lossy()
        .replace(id_of(&job), "01900000-0000-7000-8000-000000000000");
    let orphans = [stored.with_extension("packstone.tmp"), stored.with_file_name(of_no_job)];
    for orphan in &orphans {
        fs::write(orphan, "half a result").unwrap();
    }
    let refused = run(Launch::new(&data_dir).into_command()).await;
    assert_eq!(refused.code, Some(1));
    assert!(refused.stderr.contains("--adopt-orphans"), "{}", refused.stderr);
    assert!(orphans.iter().all(|orphan| orphan.exists()), "a refused start changes nothing");
    let args = ["--sweep-interval-s", "1", "--adopt-orphans"];
    let server = Launch::new(&data_dir).args(&args).start().await;
    eventually("orphans to be swept", || !orphans.iter().any(|orphan| orphan.exists())).await;
    assert!(stored.exists());
    let kept = quarantined(&data_dir);
    assert_eq!(kept.len(), 1, "the whole file is kept, the half one is not: {kept:?}");
    assert_eq!(fs::read(&kept[0]).unwrap(), b"half a result");
    // It is told after it is done.
    eventually("the log to tell of the quarantine", || server.log().contains("quarantine")).await;
    server.client().result(id_of(&job)).await;
    server.stop().await;
}

/// The files in the quarantine.
fn quarantined(data_dir: &DataDir) -> Vec<std::path::PathBuf> {
    let mut folders = vec![data_dir.path().join("quarantine")];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        let Ok(entries) = fs::read_dir(folder) else { continue };
        for entry in entries.map(Result::unwrap) {
            let into = if entry.file_type().unwrap().is_dir() { &mut folders } else { &mut files };
            into.push(entry.path());
        }
    }
    files
}

#[tokio::test]
async fn a_database_that_does_not_belong_to_the_results_is_refused() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let database = data_dir.path().join("packstone.sqlite");
    let server = Server::start(&data_dir).await;
    let first = server.client().succeed(&jobs::quick(1)).await;
    server.stop().await;
    let older = fs::read(&database).unwrap();
    let server = Server::start(&data_dir).await;
    let second = server.client().succeed(&jobs::quick(2)).await;
    server.stop().await;
    let present = fs::read(&database).unwrap();
    let remove = || {
        for ending in ["", "-wal", "-shm"] {
            let _ = fs::remove_file(data_dir.path().join(format!("packstone.sqlite{ending}")));
        }
    };
    for wrong in [None, Some(Vec::new()), Some(older)] {
        remove();
        if let Some(wrong) = wrong {
            fs::write(&database, wrong).unwrap();
        }
        let refused = run(Launch::new(&data_dir).into_command()).await;
        assert_eq!(refused.code, Some(1));
        assert!(refused.stderr.contains("--adopt-orphans"), "{}", refused.stderr);
        assert_eq!(data_dir.artifacts().len(), 2, "nothing is removed");
    }
    // What is put in quarantine can be put back.
    remove();
    let server = Launch::new(&data_dir).args(&["--adopt-orphans"]).start().await;
    eventually("the results to be moved", || data_dir.artifacts().is_empty()).await;
    assert_eq!(quarantined(&data_dir).len(), 2);
    server.stop().await;
    for file in quarantined(&data_dir) {
        let parts: Vec<_> = file.iter().collect();
        let back: std::path::PathBuf = parts[parts.len() - 2..].iter().collect();
        fs::rename(&file, data_dir.path().join("artifacts").join(back)).unwrap();
    }
    remove();
    fs::write(&database, present).unwrap();
    let server = Server::start(&data_dir).await;
    for job in [&first, &second] {
        server.client().result(id_of(job)).await;
    }
    server.stop().await;
}

#[tokio::test]
async fn a_missing_or_damaged_result_is_a_fault_and_harms_nothing_else() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let other = client.succeed(&jobs::quick(2)).await;
    let of = |id: &str| data_dir.artifacts().into_iter().find(|f| f.to_string_lossy().contains(id)).unwrap();
    let path = format!("/v1/jobs/{}/result", id_of(&job));

    let file = of(id_of(&job));
    let whole = fs::read(&file).unwrap();
    fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    client.get(&path).send().await.expect_problem(410, "result-damaged");
    fs::remove_file(&file).unwrap();
    client.get(&path).send().await.expect_problem(410, "result-damaged");
    assert_eq!(client.job(id_of(&job)).await["state"], "succeeded");
    client.result(id_of(&other)).await;
    // Put back from a backup, it is served again.
    fs::write(&file, &whole).unwrap();
    let before = client.result(id_of(&job)).await;
    client.post(&format!("/v1/jobs/{}/retry", id_of(&job))).send().await.expect_problem(409, "conflict");
    // Without one, the job packs the same spheres again.
    fs::remove_file(&file).unwrap();
    client.post(&format!("/v1/jobs/{}/retry", id_of(&job))).send().await.expect(200);
    assert_eq!(client.finished(id_of(&job)).await["state"], "succeeded");
    assert_eq!(client.result(id_of(&job)).await["grains"], before["grains"]);
    server.stop().await;
}
