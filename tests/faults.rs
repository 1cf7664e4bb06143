//! Faults of the machine: a full disk, no file descriptors, a locked database. None may lose or stick anything.
//!
//! Disks of their own are `tmpfs` mounts, for which the suite must run as root; without, these tests say so and pass.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};
use sqlx::Connection as _;

use crate::harness::deadline::{eventually, patiently, within};
use crate::harness::{
    Client, DataDir, Launch, Server, holds_every_store, id_of, jobs, machine, packstone, run,
};

/// A data directory on a small file system of its own.
struct SmallDisk {
    data_dir: DataDir,
    disk: machine::SmallDisk,
}

impl SmallDisk {
    /// One of so many bytes; `None`, aloud, where this user may not mount.
    fn mounted(bytes: u64) -> Option<Self> {
        let data_dir = DataDir::new();
        let disk = machine::SmallDisk::mount(data_dir.path().ancestors().nth(2).unwrap(), bytes)?;
        Some(Self { data_dir, disk })
    }

    fn filler(&self) -> PathBuf {
        self.disk.path().join("filler")
    }

    /// Writes until nothing fits any more.
    fn fill(&self) {
        let mut file = fs::OpenOptions::new().create(true).append(true).open(self.filler()).unwrap();
        let block = vec![7; 1 << 12];
        while file.write_all(&block).is_ok() {}
        // Less than a block may still fit.
        while file.write_all(&[7]).is_ok() {}
    }

    fn clear(&self) {
        fs::remove_file(self.filler()).unwrap();
    }
}

async fn start(disk: &SmallDisk) -> Server {
    Launch::new(&disk.data_dir).start().await
}

/// Submits until a write meets a full disk, and not only the look at the free space before it.
async fn submit_until_a_write_fails(disk: &SmallDisk, client: &Client) {
    for _ in 0..100 {
        let refused = submit_until_refused(client).await;
        if refused["detail"].as_str().unwrap().contains("is full") {
            return;
        }
        let filler = fs::OpenOptions::new().write(true).open(disk.filler()).unwrap();
        filler.set_len(filler.metadata().unwrap().len() - (36 << 10)).unwrap();
    }
    panic!("no write has met a full disk");
}

async fn faults(client: &Client) -> u64 {
    let reply = client.get("/metrics").send().await;
    let text = String::from_utf8(reply.body.to_vec()).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("packstone_store_faults_total "));
    line.unwrap().parse().unwrap()
}

/// Submits until the disk refuses, and returns the refusal.
async fn submit_until_refused(client: &Client) -> Value {
    for seed in 0..10_000 {
        let reply = client.post("/v1/jobs").json(&jobs::quick(seed)).send().await;
        assert_ne!(reply.status, 500, "a full disk is no internal error");
        if reply.status != 201 {
            assert!(!reply.header("retry-after").is_empty());
            return reply.expect_problem(507, "insufficient-storage");
        }
    }
    panic!("the disk is never full");
}

#[tokio::test]
async fn writes_come_back_after_a_full_disk() {
    if holds_every_store() {
        return;
    }
    let Some(disk) = SmallDisk::mounted(20 << 20) else { return };
    let server = Launch::new(&disk.data_dir).args(&["--min-free-bytes", "0"]).start().await;
    let client = server.client();
    let before = client.succeed(&jobs::quick(1)).await;
    client.get("/readyz").send().await.expect(200);
    disk.fill();
    submit_until_a_write_fails(&disk, &client).await;
    for _ in 0..3 {
        client.get("/readyz").send().await.expect_problem(503, "not-ready");
    }
    client.get("/healthz").send().await.expect(200);
    // What is there can be read.
    assert_eq!(client.job(id_of(&before)).await["state"], "succeeded");
    client.result(id_of(&before)).await;
    client.get("/v1/jobs").send().await.expect(200);

    disk.clear();
    let accepted = within(Duration::from_secs(5), "the first write after there is space", async {
        loop {
            let reply = client.post("/v1/jobs").json(&jobs::quick(2)).send().await;
            if reply.status == 201 {
                return reply.json();
            }
            tokio::task::yield_now().await;
        }
    })
    .await;
    assert_eq!(client.finished(id_of(&accepted)).await["state"], "succeeded");
    client.get("/readyz").send().await.expect(200);
    assert!(faults(&client).await >= 1, "no connection was replaced: the test has not met the fault");
    server.stop().await;
}

#[tokio::test]
async fn a_backup_to_a_full_disk_ends_with_6_and_leaves_nothing() {
    if holds_every_store() {
        return;
    }
    let Some(disk) = SmallDisk::mounted(4 << 20) else { return };
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    server.client().succeed(&jobs::quick(1)).await;
    server.stop().await;
    let copy = disk.disk.path().join("copy");
    let args = ["backup", copy.to_str().unwrap(), "--data-dir", data_dir.path().to_str().unwrap()];
    disk.fill();
    for left in [0, 200 << 10] {
        // Room for nothing, then for a part of the database.
        let filler = fs::OpenOptions::new().write(true).open(disk.filler()).unwrap();
        filler.set_len(filler.metadata().unwrap().len() - left).unwrap();
        let ended = packstone(disk.disk.path(), &args).await;
        assert_eq!(ended.code, Some(6), "{left}: {ended:?}");
        let names: Vec<_> =
            fs::read_dir(disk.disk.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert!(names.iter().all(|name| !name.to_str().unwrap().starts_with("copy")), "{names:?}");
    }
    disk.clear();
    // What a backup that was killed has left.
    fs::create_dir_all(disk.disk.path().join("copy.tmp/artifacts/00")).unwrap();
    fs::write(disk.disk.path().join("copy.tmp/packstone.sqlite"), "half").unwrap();
    let ended = packstone(disk.disk.path(), &args).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(!disk.disk.path().join("copy.tmp").exists() && !copy.join("artifacts/00").exists());
    let checked = packstone(disk.disk.path(), &["check", copy.to_str().unwrap()]).await;
    assert_eq!(checked.code, Some(0), "{checked:?}");
}

#[tokio::test]
async fn readiness_fails_before_the_disk_is_full() {
    let Some(disk) = SmallDisk::mounted(20 << 20) else { return };
    let server = Launch::new(&disk.data_dir).args(&["--min-free-bytes", "8000000"]).start().await;
    let client = server.client();
    client.get("/readyz").send().await.expect(200);
    fs::write(disk.filler(), vec![7; 13 << 20]).unwrap();
    let problem = client.get("/readyz").send().await.expect_problem(503, "not-ready");
    assert!(problem["detail"].as_str().unwrap().contains("8000000"), "{problem}");
    disk.clear();
    client.get("/readyz").send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn readiness_fails_on_a_full_disk_before_any_write_does() {
    let Some(disk) = SmallDisk::mounted(20 << 20) else { return };
    let server = start(&disk).await;
    let client = server.client();
    client.get("/readyz").send().await.expect(200);
    disk.fill();
    client.get("/readyz").send().await.expect_problem(503, "not-ready");
    disk.clear();
    client.get("/readyz").send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn jobs_can_be_deleted_on_a_full_disk() {
    let Some(disk) = SmallDisk::mounted(20 << 20) else { return };
    let server = start(&disk).await;
    let client = server.client();
    let mut finished = Vec::new();
    for seed in 0..20 {
        finished.push(client.succeed(&jobs::equal_spheres(4000, seed)).await);
    }
    // A log that was folded in has no room of its own left: restart, so that the deletion has to grow it.
    server.stop().await;
    let server = start(&disk).await;
    let client = server.client();
    disk.fill();
    submit_until_refused(&client).await;
    for job in &finished {
        client.delete(&format!("/v1/jobs/{}", id_of(job))).send().await.expect(204);
    }
    eventually("the files to go", || disk.data_dir.artifacts().is_empty()).await;
    // Their space is the service's again, and the reserve with it.
    let reserve = disk.data_dir.path().join("reserve");
    eventually("the reserve to be made again", || reserve.exists()).await;
    client.succeed(&jobs::quick(99)).await;
    server.stop().await;
}

#[tokio::test]
async fn a_study_goes_on_after_a_full_disk() {
    if holds_every_store() {
        return;
    }
    let Some(disk) = SmallDisk::mounted(24 << 20) else { return };
    let start =
        |workers| Launch::new(&disk.data_dir).workers(workers).args(&["--min-free-bytes", "5000000"]).start();
    // It is accepted while there is space, and starts when not half of its eight megabytes of results find room.
    let server = start(0).await;
    let mut template = jobs::equal_spheres(10_000, 1);
    template.as_object_mut().unwrap().remove("seed");
    let study = json!({"template": template, "replicates": 24});
    let study = server.client().post("/v1/studies").json(&study).send().await.expect(201).json();
    let path = format!("/v1/studies/{}", id_of(&study));
    server.stop().await;
    fs::write(disk.filler(), vec![7; 16 << 20]).unwrap();
    let server = start(2).await;
    let client = server.client();
    patiently("jobs to wait for room", async {
        while !server.log().contains("pause_s=10") {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
    // No file can become longer now. Where the log of the database has room for it no more, not even that a job is
    // leased can be written; else the jobs are tried once more in vain.
    disk.fill();
    patiently("the jobs to meet the full disk", async {
        while !["disk is full", "pause_s=20"].iter().any(|told| server.log().contains(told)) {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
    disk.clear();
    let ended = client.get(&path).header("prefer", "wait=60").send().await.expect(200).json();
    assert_eq!(ended["counts"]["succeeded"], 24, "{ended:#}");
    // The pauses did not last to their ends.
    assert!(server.log().contains("there is room again: jobs wait no longer"), "{}", server.log());
    server.stop().await;
}

#[tokio::test]
async fn a_log_on_a_full_disk_ends_nothing() {
    let Some(disk) = SmallDisk::mounted(8 << 20) else { return };
    let data_dir = DataDir::new();
    let log = fs::File::create(disk.disk.path().join("log")).unwrap();
    disk.fill();
    let mut command = Launch::new(&data_dir).env("PACKSTONE_LOG", "info").into_command();
    let mut child = command.stdout(std::process::Stdio::piped()).stderr(log).spawn().unwrap();
    let address = tokio::task::spawn_blocking({
        let stdout = child.stdout.take().unwrap();
        move || {
            let mut line = String::new();
            std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut line).unwrap();
            line.trim().rsplit_once("http://").unwrap().1.parse().unwrap()
        }
    })
    .await
    .unwrap();
    let client = Client::new(address);
    client.succeed(&jobs::quick(1)).await;
    assert_eq!(child.try_wait().unwrap(), None, "it still runs");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Locks the database for writing, as another program would: this process is not that of the server. The lock goes with
/// the connection.
async fn lock(database: &Path) -> sqlx::SqliteConnection {
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(database);
    let mut connection = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await.unwrap();
    connection
}

#[tokio::test]
async fn a_database_that_another_program_locks_is_not_ready() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    client.succeed(&jobs::quick(1)).await;
    let locked = lock(&data_dir.path().join("packstone.sqlite")).await;
    let reply = client.post("/v1/jobs").json(&jobs::quick(2)).send().await;
    assert!(!reply.header("retry-after").is_empty());
    reply.expect_problem(503, "not-ready");
    locked.close().await.unwrap();
    client.succeed(&jobs::quick(2)).await;
    server.stop().await;
}

/// A job of a second that is failed at the end of its first attempt, if that counts.
fn growth_with_one_attempt() -> Value {
    jobs::with(jobs::growth(), "/max_attempts", json!(1))
}

/// One test, because both wait for the pauses of the runner, 15 s: neither holds up a core for the other.
#[tokio::test]
async fn a_result_that_cannot_be_written_is_no_fault_of_its_job() {
    tokio::join!(
        a_result_that_finds_no_descriptors_is_no_fault_of_its_job(),
        a_result_that_finds_no_space_is_no_fault_of_its_job(),
    );
}

async fn a_result_that_finds_no_descriptors_is_no_fault_of_its_job() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let before = client.succeed(&jobs::quick(1)).await;
    let job = client.post("/v1/jobs").json(&growth_with_one_attempt()).send().await.expect(201).json();
    client.running(id_of(&job)).await;
    let exhausted = server.without_descriptors();
    let refused = client.get(&format!("/v1/jobs/{}/result?format=npy", id_of(&before))).send().await;
    assert!(!refused.header("retry-after").is_empty());
    refused.expect_problem(503, "not-ready");
    eventually("the job to be requeued", || server.log().contains("the job is requeued")).await;
    assert!(server.log().contains("Too many open files"), "{}", server.log());
    drop(exhausted);
    let ended = client.finished(id_of(&job)).await;
    assert_eq!(ended["state"], "succeeded", "{ended:#}");
    client.result(id_of(&job)).await;
    server.stop().await;
}

async fn a_result_that_finds_no_space_is_no_fault_of_its_job() {
    let Some(disk) = SmallDisk::mounted(20 << 20) else { return };
    let server = Launch::new(&disk.data_dir).args(&["--min-free-bytes", "0"]).start().await;
    let client = server.client();
    let job = client.post("/v1/jobs").json(&growth_with_one_attempt()).send().await.expect(201).json();
    client.job_when(id_of(&job), "growing", |job| job["progress"]["step"] == "edmd").await;
    disk.fill();
    let tries = || server.log().matches("the result was not written").count();
    eventually("the result to be tried four times", || tries() >= 4).await;
    client.get("/readyz").send().await.expect_problem(503, "not-ready");
    // After the fifth, the requeued job has to be recorded, which a full disk does not allow either.
    eventually("the job to be given back", || {
        let log = server.log();
        log.contains("the end of the run was not recorded; trying again")
            || log.contains("the job is requeued")
    })
    .await;
    disk.clear();
    let ended = client.finished(id_of(&job)).await;
    assert_eq!(ended["state"], "succeeded", "{ended:#}");
    assert!(server.log().contains("the job is requeued"), "{}", server.log());
    client.get("/readyz").send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn what_finds_no_memory_is_requeued_and_the_service_goes_on() {
    const MEGABYTE: u64 = 1 << 20;
    let data_dir = DataDir::new();
    let limits = ["--max-grains", "100000000", "--max-memory-mib", "1000000", "--max-model-mib", "1000000"];
    let server = Launch::new(&data_dir).args(&limits).start().await;
    let client = server.client();
    let small = client.succeed(&jobs::quick(1)).await;
    server.limit_address_space(128 * MEGABYTE);
    // 240 MB of diameters.
    let large =
        client.post("/v1/jobs").json(&jobs::equal_spheres(30_000_000, 1)).send().await.expect(201).json();
    eventually("the job to find no memory", || server.log().contains("the run found no memory")).await;
    assert!(server.log().contains("out of memory: the run needs 24"), "{}", server.log());
    let exports = format!("/v1/jobs/{}/exports", id_of(&small));
    client
        .post(&format!("{exports}/mesh?size_mm=0.05&size_field=false&max_bytes=100000000000"))
        .send()
        .await
        .expect(202);
    let is_of_export = |line: &str| line.contains(" export{") && line.contains("the run found no memory");
    eventually("the export to find no memory", || server.log().lines().any(is_of_export)).await;
    assert!(server.log().contains("out of memory: the export needs"), "{}", server.log());
    client.succeed(&jobs::quick(2)).await;
    client.get(&format!("{exports}/slice")).send().await.expect(200);
    assert_eq!(client.job(id_of(&large)).await["error"], Value::Null);
    client.post(&format!("/v1/jobs/{}/cancel", id_of(&large))).send().await;
    server.stop().await;
}

#[tokio::test]
async fn a_command_that_finds_no_memory_ends_with_its_code() {
    let folder = tempfile::tempdir().unwrap();
    let job = jobs::with(jobs::equal_spheres(160_000, 1), "/mix/volume_fraction", json!(0.30));
    let edge_mm = libm::cbrt(160_000.0 * std::f64::consts::PI / 6.0 / 0.30);
    let job = jobs::with(job, "/specimen/size_mm", json!([edge_mm, edge_mm, edge_mm]));
    let job = jobs::with(job, "/method", json!({"type": "edmd", "stop": {"events": 1}}));
    fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    let mut codes = Vec::new();
    // From a limit that the plan refuses to one that suffices, and further: a second thread sets memory aside where it
    // can, and may leave little. Wherever memory ends, no signal ends the process, and nothing waits for ever.
    for mib in (66..=126).step_by(12).chain((150..=190).step_by(10)) {
        let mut command = Command::new("sh");
        let script =
            format!("ulimit -v {}; exec {} run job.json", mib << 10, env!("CARGO_BIN_EXE_packstone"));
        command.args(["-c", &script]).current_dir(folder.path());
        let ended = run(command).await;
        let code = ended.code.unwrap_or_else(|| panic!("{mib} MiB: {}", ended.stderr));
        assert!([3, 4, 6].contains(&code), "{mib} MiB: {code}: {}", ended.stderr);
        assert_eq!(code == 6, ended.stderr.contains("out of memory: the run needs"), "{}", ended.stderr);
        codes.push(code);
    }
    assert!([3, 4, 6].iter().all(|code| codes.contains(code)), "{codes:?}");
}
