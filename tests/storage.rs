//! What may be stored, backups and checks of a data directory, and data directories of earlier versions.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::harness::deadline::patiently;
use crate::harness::{DataDir, Launch, Reply, Server, holds_every_store, id_of, jobs, packstone, run};

#[tokio::test]
async fn a_job_that_would_exceed_a_quota_is_refused_with_figures() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-stored-bytes", "200000"]).start().await;
    let client = server.client();
    client.succeed(&jobs::equal_spheres(2000, 1)).await;
    let reply = client.post("/v1/jobs").json(&jobs::equal_spheres(5000, 1)).send().await;
    assert!(!reply.header("retry-after").is_empty());
    let problem = reply.expect_problem(507, "insufficient-storage");
    let (needed, free) = (problem["needed_bytes"].as_u64().unwrap(), problem["free_bytes"].as_u64().unwrap());
    assert!((160_000..200_000).contains(&needed) && free < 140_000, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("200000"), "{problem}");
    let metrics = client.get("/metrics").send().await;
    let text = String::from_utf8(metrics.body.to_vec()).unwrap();
    let stored = text.lines().find_map(|line| line.strip_prefix("packstone_stored_bytes{kind=\"results\"} "));
    assert!(stored.unwrap().parse::<u64>().unwrap() > 64_000, "{text}");
    for name in [
        "packstone_disk_free_bytes",
        "process_open_fds",
        "packstone_queue_age_seconds",
        "packstone_build_info",
    ] {
        assert!(text.lines().any(|line| line.starts_with(name)), "{name} is missing in\n{text}");
    }
    server.stop().await;
}

#[tokio::test]
async fn the_quota_of_a_key_holds_for_its_results_and_exports_only() {
    let folder = tempfile::tempdir().unwrap();
    let (mut lines, mut keys) = (String::new(), Vec::new());
    for name in ["first", "second"] {
        let made = packstone(folder.path(), &["key", name]).await;
        let printed = made.stdout.clone() + &made.stderr;
        lines += made.stdout.lines().find(|line| line.contains(name)).expect("a line for the file");
        lines.push('\n');
        keys.push(printed.split_whitespace().find(|word| word.starts_with("packstone_")).unwrap().to_owned());
    }
    let file = folder.path().join("keys");
    fs::write(&file, lines).unwrap();
    let data_dir = DataDir::new();
    let quota = ["--max-stored-bytes-per-key", "400000"];
    let launch = Launch::new(&data_dir).env("PACKSTONE_API_KEYS_FILE", file.to_str().unwrap());
    let server = launch.args(&quota).start().await;
    let [first, second] = [0, 1].map(|i| server.client().with_key(&keys[i]));
    let refused = |reply: &Reply, needed: std::ops::Range<u64>, free: std::ops::Range<u64>| {
        assert!(!reply.header("retry-after").is_empty());
        let problem = reply.expect_problem(507, "insufficient-storage");
        assert!(needed.contains(&problem["needed_bytes"].as_u64().unwrap()), "{problem}");
        assert!(free.contains(&problem["free_bytes"].as_u64().unwrap()), "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains("400000"), "{problem}");
    };
    // Results count: 160 kB are stored, and as much again would exceed the quota with the export below.
    let job = first.succeed(&jobs::equal_spheres(5000, 1)).await;
    let exports = format!("/v1/jobs/{}/exports/voxels", id_of(&job));
    refused(
        &first.post(&format!("{exports}?format=raw&cells=100")).send().await,
        1_000_000..1_000_001,
        200_000..240_000,
    );
    // Kept exports count.
    let kept = first.post(&format!("{exports}?format=raw&cells=50")).header("prefer", "wait=60");
    assert_eq!(kept.send().await.expect(200).json()["state"], "succeeded");
    let large = jobs::equal_spheres(5000, 2);
    refused(&first.post("/v1/jobs").json(&large).send().await, 160_000..200_000, 80_000..120_000);
    second.succeed(&large).await;
    // What is deleted makes room.
    first.delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(204);
    first.succeed(&large).await;
    server.stop().await;
}

#[tokio::test]
async fn a_plan_tells_the_sizes_of_the_exports() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let exports = json!([{"type": "mesh"}, {"type": "voxels", "format": "raw", "cells": 100}]);
    let job = jobs::with(jobs::quick(1), "/postprocess", exports);
    let plan = client.post("/v1/plans").json(&job).send().await.expect(200).json();
    assert!(plan["grains"].as_f64().unwrap() > 100.0, "{plan:#}");
    let [mesh, voxels] = [0, 1].map(|i| plan["exports"][i].clone());
    assert_eq!((&mesh["export"]["type"], &voxels["export"]["type"]), (&json!("mesh"), &json!("voxels")));
    assert_eq!(voxels["estimate"]["bytes"], 1_000_000, "{voxels:#}");
    assert!(voxels["estimate"].get("mesh").is_none(), "{voxels:#}");
    assert!(mesh["estimate"]["mesh"]["triangles"].as_u64().unwrap() > 20_000, "{mesh:#}");
    let made = client.succeed(&jobs::quick(1)).await;
    let file = client.get(&format!("/v1/jobs/{}/exports/mesh", id_of(&made))).send().await;
    let ratio = file.expect(200).body.len() as f64 / mesh["estimate"]["bytes"].as_f64().unwrap();
    assert!((0.4..2.5).contains(&ratio), "{ratio} of {mesh:#}");
    let none = client.post("/v1/plans").json(&jobs::quick(1)).send().await.expect(200).json();
    assert_eq!(none["exports"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn an_export_that_would_exceed_a_quota_is_refused_before_it_starts() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-stored-bytes", "2000000"]).start().await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let exports = format!("/v1/jobs/{}/exports", id_of(&job));
    for method in ["POST", "GET"] {
        let path = format!("{exports}/voxels?format=raw&cells=200");
        let request = if method == "POST" { client.post(&path) } else { client.get(&path) };
        let reply = request.send().await;
        assert!(!reply.header("retry-after").is_empty());
        let problem = reply.expect_problem(507, "insufficient-storage");
        assert_eq!(problem["needed_bytes"], 8_000_000, "{problem}");
        assert!((1_900_000..2_000_000).contains(&problem["free_bytes"].as_u64().unwrap()), "{problem}");
    }
    let listed = client.get(&exports).send().await.expect(200).json();
    assert_eq!(listed["items"], json!([]), "a refused export is not stored");
    let beforehand = json!([{"type": "voxels", "format": "raw", "cells": 200}]);
    let job = jobs::with(jobs::quick(2), "/postprocess", beforehand);
    let problem = client.post("/v1/jobs").json(&job).send().await.expect_problem(507, "insufficient-storage");
    assert!(problem["needed_bytes"].as_u64().unwrap() > 8_000_000, "{problem}");
    client.get(&format!("{exports}/voxels?format=raw&cells=100")).send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn large_exports_are_announced_on_the_command_line() {
    const LARGE: &str = "voxels:format=raw,cells=370";
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.json"), jobs::quick(1).to_string()).unwrap();
    let small = "slice:format=json";
    let ended = packstone(folder.path(), &["plan", "job.json", LARGE, small]).await;
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let plan: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(plan["exports"][0]["estimate"]["bytes"], 50_653_000, "{plan:#}");
    assert_eq!(plan["exports"].as_array().unwrap().len(), 2);
    assert_eq!(ended.stderr.matches("about").count(), 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("voxels raw: about 50 MB"), "{}", ended.stderr);
    let periodic = jobs::with(jobs::quick(1), "/specimen/boundary", json!("periodic"));
    fs::write(folder.path().join("periodic.json"), periodic.to_string()).unwrap();
    let refused = packstone(folder.path(), &["plan", "periodic.json", "mesh"]).await;
    assert_eq!(refused.code, Some(3), "{}", refused.stderr);

    let run = ["run", "job.json", "--export", LARGE];
    let ended = packstone(folder.path(), &run).await;
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let lines: Vec<&str> = ended.stderr.lines().collect();
    let found = |what: &str| lines.iter().position(|line| line.contains(what)).expect(what);
    assert!(found("about 50 MB") < found("placed "), "before the packing: {}", ended.stderr);
    assert_eq!(ended.stderr.matches("about 50 MB").count(), 2, "and from it: {}", ended.stderr);
    let again = packstone(folder.path(), &["export", "result.json", LARGE, "--force"]).await;
    assert_eq!((again.code, again.stderr.contains("about 50 MB")), (Some(0), true), "{}", again.stderr);
}

#[tokio::test]
async fn a_backup_of_a_running_service_is_whole_and_can_be_served() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let before = client.result_in(id_of(&job), "npy").await;
    let parent = tempfile::tempdir().unwrap();
    let source = data_dir.path().to_str().unwrap();
    let ended = packstone(parent.path(), &["backup", "copy", "--data-dir", source]).await;
    assert_eq!(ended.code, Some(0), "{} {}", ended.stdout, ended.stderr);
    let again = packstone(parent.path(), &["backup", "copy", "--data-dir", source]).await;
    assert_ne!(again.code, Some(0), "a backup is never overwritten");
    client.delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(204);
    server.stop().await;

    let ended = packstone(parent.path(), &["check", "copy"]).await;
    assert_eq!(ended.code, Some(0), "{} {}", ended.stdout, ended.stderr);
    let restored = DataDir::new();
    fs::create_dir_all(restored.path().parent().unwrap()).unwrap();
    fs::rename(parent.path().join("copy"), restored.path())
        .or_else(|_| copy_all(&parent.path().join("copy"), restored.path()))
        .unwrap();
    let server = Server::start(&restored).await;
    assert_eq!(server.client().result_in(id_of(&job), "npy").await, before);
    server.stop().await;
}

#[tokio::test]
async fn a_check_finds_what_is_damaged_missing_and_unknown() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    for seed in 0..3 {
        server.client().succeed(&jobs::quick(seed)).await;
    }
    server.stop().await;
    let directory = data_dir.path().to_str().unwrap().to_owned();
    let files = data_dir.artifacts();
    fs::remove_file(&files[0]).unwrap();
    let mut changed = fs::read(&files[1]).unwrap();
    changed[100] ^= 1;
    fs::write(&files[1], changed).unwrap();
    fs::write(files[2].with_file_name("01900000-0000-7000-8000-000000000000.1.packstone"), "x").unwrap();
    let ended = packstone(Path::new("/"), &["check", &directory]).await;
    assert_eq!(ended.code, Some(1));
    assert_eq!(ended.stdout.lines().count(), 4, "{}", ended.stdout);
    assert!(ended.stdout.contains("3 files checked, 3 faults"), "{}", ended.stdout);
}

#[tokio::test]
async fn a_check_tells_what_a_killed_service_has_left_apart_from_faults() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--checkpoint-every-s", "0"]).start().await;
    let growing = server.client().submit(&jobs::growth()).await;
    crate::harness::deadline::eventually("a checkpoint", || !data_dir.checkpoints().is_empty()).await;
    server.kill().await;
    // A result that was complete when the service was killed, and waited for its row.
    let id = id_of(&growing);
    let folder = data_dir.path().join("artifacts").join(&id[id.len() - 2..]);
    fs::create_dir_all(&folder).unwrap();
    let result = folder.join(format!("{id}.1.packstone"));
    fs::write(&result, "a result").unwrap();
    let check = async || packstone(Path::new("/"), &["check", data_dir.path().to_str().unwrap()]).await;
    let ended = check().await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stdout.contains("not in the database yet"), "{ended:?}");
    assert!(ended.stdout.contains("0 faults") && ended.stdout.contains("1 checkpoints"), "{ended:?}");
    // After an hour it is a fault.
    let file = fs::File::options().write(true).open(&result).unwrap();
    let before = std::time::SystemTime::now() - std::time::Duration::from_secs(3700);
    file.set_modified(before).unwrap();
    let ended = check().await;
    assert!(ended.code == Some(1) && ended.stdout.contains("does not know it"), "{ended:?}");
    fs::remove_file(&result).unwrap();
    // So is a damaged checkpoint.
    let checkpoint = data_dir.path().join("checkpoints").join(&data_dir.checkpoints()[0]);
    let mut bytes = fs::read(&checkpoint).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&checkpoint, bytes).unwrap();
    let ended = check().await;
    assert!(ended.code == Some(1) && ended.stdout.contains("the checkpoint is damaged"), "{ended:?}");
}

#[tokio::test]
async fn health_is_asked_without_a_client() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let url = format!("http://{}", server.address());
    let ended = packstone(Path::new("/"), &["health", &url]).await;
    assert_eq!((ended.code, ended.stdout.as_str()), (Some(0), "ready\n"), "{}", ended.stderr);
    server.stop().await;
    assert_eq!(packstone(Path::new("/"), &["health", &url]).await.code, Some(1));
}

#[tokio::test]
async fn empty_variables_are_not_set_and_names_are_addresses() {
    let data_dir = DataDir::new();
    let launch = Launch::new(&data_dir).listen("localhost:0");
    let launch = launch
        .env("PACKSTONE_INSECURE", "")
        .env("PACKSTONE_API_KEYS_FILE", "")
        .env("PACKSTONE_MAX_QUEUED", "");
    let server = launch.start().await;
    assert!(server.address().ip().is_loopback());
    server.stop().await;
    let server = Launch::new(&data_dir).listen(":0").env("PACKSTONE_INSECURE", "1").start().await;
    server.stop().await;
    let refused = run(Launch::new(&data_dir).args(&["--max-model-mib", "0"]).into_command()).await;
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
}

#[tokio::test]
async fn a_closed_terminal_does_not_end_a_service() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    server.hang_up();
    server.client().succeed(&jobs::quick(1)).await;
    server.stop().await;
}

#[tokio::test]
async fn connections_beyond_the_bound_are_answered() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-connections", "2"]).start().await;
    let open: Vec<_> = (0..2).map(|_| std::net::TcpStream::connect(server.address()).unwrap()).collect();
    let address = server.address();
    let answer = tokio::task::spawn_blocking(move || {
        use std::io::{Read as _, Write as _};
        let mut stream = std::net::TcpStream::connect(address).unwrap();
        stream.write_all(b"GET /v1/jobs HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        let mut block = [0; 1024];
        while let Ok(read @ 1..) = stream.read(&mut block) {
            answer.extend_from_slice(&block[..read]);
            if answer.ends_with(b"}") {
                break;
            }
        }
        String::from_utf8(answer).unwrap()
    })
    .await
    .unwrap();
    assert!(answer.starts_with("HTTP/1.1 503 ") && answer.contains("retry-after"), "{answer}");
    server.client().get("/healthz").send().await.expect(200);
    drop(open);
    patiently("a closed connection to make room", async {
        while server.client().get("/v1/jobs").send().await.status != 200 {
            tokio::task::yield_now().await;
        }
    })
    .await;
    server.stop().await;
}

#[tokio::test]
async fn too_few_file_descriptors_are_said_at_the_start() {
    let data_dir = DataDir::new();
    let serve = |limit: u32| {
        let mut command = std::process::Command::new("sh");
        let script = format!(
            "ulimit -n {limit}; exec {} serve --listen 127.0.0.1:0 --workers 1 --data-dir {}",
            env!("CARGO_BIN_EXE_packstone"),
            data_dir.path().display()
        );
        command.args(["-c", &script]);
        command
    };
    let refused = run(serve(100)).await;
    assert_eq!(refused.code, Some(1));
    assert!(refused.stderr.contains("ulimit -n"), "{}", refused.stderr);
}

fn copy_all(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy_all(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}
