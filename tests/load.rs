//! Figures for `docs/development/measurements-service.md`: printed, not asserted, for they are the machine's as much as
//! the program's.
//!
//! ```sh
//! cargo test --release -p packstone-server --test e2e load:: -- --ignored --nocapture --test-threads 1
//! ```

use std::process::Stdio;
use std::time::{Duration, Instant};

use futures_util::future::join_all;
use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, RawConnection, Server, id_of, jobs, packstone};

/// Times of one kind of request.
struct Times(Vec<Duration>);

impl Times {
    fn new(mut times: Vec<Duration>) -> Self {
        times.sort_unstable();
        Self(times)
    }

    fn at(&self, share: f64) -> f64 {
        let last = self.0.len() - 1;
        self.0[(share * last as f64).ceil() as usize].as_secs_f64() * 1e3
    }

    fn print(&self, what: &str) {
        println!(
            "| {what} | {} | p50 {:.2} ms | p99 {:.2} ms | max {:.2} ms |",
            self.0.len(),
            self.at(0.50),
            self.at(0.99),
            self.at(1.0)
        );
    }
}

/// A job of one grain: what is measured is the service.
fn least_job() -> Value {
    json!({
        "seed": 1,
        "labels": {"series": "load"},
        "specimen": {"type": "box", "size_mm": [10, 10, 10]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [2]}}
    })
}

async fn submit_times(client: &Client, n: usize) -> Times {
    let job = jobs::with(jobs::quick(1), "/priority", json!(-100));
    let mut times = Vec::new();
    for _ in 0..n {
        let start = Instant::now();
        client.post("/v1/jobs").json(&job).send().await.expect(201);
        times.push(start.elapsed());
    }
    Times::new(times)
}

#[tokio::test]
#[ignore = "prints figures"]
async fn submissions() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).start().await;
    submit_times(&server.client(), 2000).await.print("submit, nothing running");
    server.stop().await;

    let cores = std::thread::available_parallelism().unwrap().get();
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(cores).start().await;
    let client = server.client();
    for _ in 0..cores {
        let job = client.submit(&jobs::endless()).await;
        client.running(id_of(&job)).await;
    }
    submit_times(&client, 2000).await.print("submit, all cores packing");
    server.stop().await;
}

#[tokio::test]
#[ignore = "prints figures"]
async fn a_table_of_a_hundred_thousand_jobs() {
    const JOBS: usize = 100_000;
    const WRITERS: usize = 16;
    let data_dir = DataDir::new();
    let filling = ["--max-queued", "200000"];
    let server = Launch::new(&data_dir).workers(0).args(&filling).start().await;
    let client = server.client();
    let start = Instant::now();
    join_all((0..WRITERS).map(|_| async {
        for _ in 0..JOBS / WRITERS {
            client.post("/v1/jobs").json(&least_job()).send().await.expect(201);
        }
    }))
    .await;
    let elapsed = start.elapsed();
    println!(
        "| fill the table, {WRITERS} clients | {JOBS} | {:.0} jobs/s |",
        JOBS as f64 / elapsed.as_secs_f64()
    );
    listing(&client, "").await;
    server.stop().await;

    // The first thousand jobs are run one after another. What passes from the end of one to the start of the next is
    // the commit of the one and the claim of the other.
    let server = Launch::new(&data_dir).workers(1).args(&filling).start().await;
    let client = server.client();
    let mut waits = Vec::new();
    let mut cursor = String::new();
    let finished = loop {
        let page = client.get("/v1/jobs?state=succeeded&limit=1").send().await.expect(200).json();
        let count = client.get("/metrics").send().await;
        let text = String::from_utf8(count.body.to_vec()).unwrap();
        let series =
            text.lines().find(|line| line.starts_with("packstone_jobs{") && line.contains("succeeded"));
        let count: f64 = series.and_then(|line| line.rsplit(' ').next()?.parse().ok()).unwrap_or(0.0);
        if count >= 1000.0 && !page["items"].as_array().unwrap().is_empty() {
            break count;
        }
    };
    listing(&client, " while jobs run").await;
    server.stop().await;
    let server = Launch::new(&data_dir).workers(0).args(&filling).start().await;
    let client = server.client();
    let mut runs: Vec<(jiff::Timestamp, jiff::Timestamp)> = Vec::new();
    while runs.len() < 1000 {
        let target = format!("/v1/jobs?state=succeeded&limit=100{cursor}");
        let page = client.get(&target).send().await.expect(200).json();
        let moment = |job: &Value, field: &str| job[field].as_str().unwrap().parse().unwrap();
        runs.extend(
            page["items"]
                .as_array()
                .unwrap()
                .iter()
                .map(|j| (moment(j, "started_at"), moment(j, "finished_at"))),
        );
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    runs.sort_unstable();
    for pair in runs.windows(2) {
        waits.push(Duration::try_from(pair[1].0.duration_since(pair[0].1)).unwrap_or_default());
    }
    assert!(finished >= 1000.0);
    Times::new(waits).print("from the end of a job to the start of the next, 100 000 queued");
    server.stop().await;
}

async fn listing(client: &Client, when: &str) {
    for (what, filter) in [
        ("all", ""),
        ("by state", "&state=queued"),
        ("by label", "&label=series=load"),
        ("by state and label", "&state=queued&label=series=load"),
        ("by a label of no job", "&label=series=none"),
    ] {
        let (mut times, mut cursor) = (Vec::new(), String::new());
        for _ in 0..200 {
            let start = Instant::now();
            let target = format!("/v1/jobs?limit=50{filter}{cursor}");
            let page = client.get(&target).send().await.expect(200).json();
            times.push(start.elapsed());
            cursor = page["next_cursor"].as_str().map(|next| format!("&cursor={next}")).unwrap_or_default();
        }
        Times::new(times).print(&format!("list 50 of 100 000, {what}{when}"));
    }
}

#[tokio::test]
#[ignore = "prints figures"]
async fn cancels() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    for (what, job, runs) in [
        ("cancel of a job that searches for places", jobs::endless(), 20),
        ("cancel of a packing of 2 million grains", jobs::equal_spheres(2_000_000, 1), 10),
    ] {
        let mut times = Vec::new();
        for run in 0..runs {
            let job = client.submit(&job).await;
            let id = id_of(&job);
            // Each time a little later in the run.
            let share = f64::from(run) / f64::from(runs);
            client
                .job_when(id, "under way", |job| {
                    job["state"] == "running"
                        && job["progress"]["fraction"].as_f64().unwrap_or(0.0) >= share * 0.5
                })
                .await;
            let start = Instant::now();
            client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
            assert_eq!(client.finished(id).await["state"], "cancelled");
            times.push(start.elapsed());
        }
        Times::new(times).print(what);
    }
    server.stop().await;
}

#[tokio::test]
#[ignore = "prints figures"]
async fn half_open_connections() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let start = Instant::now();
    let mut half_open = Vec::new();
    for _ in 0..500 {
        let mut connection = RawConnection::open(server.address()).await;
        connection.send("GET /v1/jobs HTTP/1.1\r\nHost:").await;
        half_open.push(connection);
    }
    let closing = tokio::spawn(join_all(half_open.into_iter().map(RawConnection::until_closed)));
    let mut others = Vec::new();
    while !closing.is_finished() {
        let asked = Instant::now();
        server.client().get("/v1/jobs").send().await.expect(200);
        others.push(asked.elapsed());
    }
    println!("| 500 half-open connections | all closed after {:.1} s |", start.elapsed().as_secs_f64());
    Times::new(others).print("others meanwhile, a connection each");
    server.stop().await;
}

#[tokio::test]
#[ignore = "prints figures"]
async fn termination() {
    let cores = std::thread::available_parallelism().unwrap().get();
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(cores).start().await;
    let client = server.client();
    let mut streams = Vec::new();
    for _ in 0..cores {
        let job = client.submit(&jobs::endless()).await;
        client.running(id_of(&job)).await;
        for _ in 0..50 / cores {
            let mut stream = client.events(id_of(&job), None).await;
            stream.next().await.expect("a first event");
            streams.push(tokio::spawn(stream.drained()));
        }
    }
    let open = streams.len();
    let start = Instant::now();
    server.terminate();
    assert!(server.ends_within(Duration::from_secs(30)).await.success());
    println!(
        "| SIGTERM with {open} open streams, {cores} running jobs | ended after {:.2} s |",
        start.elapsed().as_secs_f64()
    );
}

/// A study of so many jobs at 100 points.
fn study_of(template: &Value, jobs: u32) -> Value {
    let mut template = template.clone();
    template.as_object_mut().unwrap().remove("seed");
    let grid: Vec<u32> = (1..=100).collect();
    json!({"seed": 1, "template": template, "grid": {"/timeout_s": grid}, "replicates": jobs / 100})
}

async fn table_times(client: &Client, id: &str, what: &str) {
    for format in ["json", "csv"] {
        let mut times = Vec::new();
        for _ in 0..20 {
            let start = Instant::now();
            client.get(&format!("/v1/studies/{id}/table?format={format}")).send().await.expect(200);
            times.push(start.elapsed());
        }
        Times::new(times).print(&format!("table as {format}, {what}"));
    }
}

#[tokio::test]
#[ignore = "prints figures"]
async fn a_study_of_ten_thousand_jobs() {
    let megabytes = |server: &Server| server.resident_bytes() as f64 / 1e6;
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let mut times = Vec::new();
    for _ in 0..5 {
        let start = Instant::now();
        client.submit_study(&study_of(&least_job(), 10_000)).await;
        times.push(start.elapsed());
    }
    Times::new(times).print("study of 10 000 jobs accepted, a grid");
    let list: Vec<Value> = (0..10_000).map(jobs::quick).collect();
    let start = Instant::now();
    let study = client.submit_study(&json!({"list": list})).await;
    println!("| study of 10 000 jobs accepted, a list | {:.2} s |", start.elapsed().as_secs_f64());
    table_times(&client, id_of(&study), "10 000 points that wait").await;
    println!("| memory after 60 000 jobs came in | {:.0} MB |", megabytes(&server));
    let start = Instant::now();
    client.post(&format!("/v1/studies/{}/cancel", id_of(&study))).send().await.expect(200);
    println!("| cancel of 10 000 waiting jobs | {:.2} s |", start.elapsed().as_secs_f64());
    let start = Instant::now();
    client.post(&format!("/v1/studies/{}/retry?state=cancelled", id_of(&study))).send().await.expect(200);
    println!("| retry of 10 000 jobs | {:.2} s |", start.elapsed().as_secs_f64());
    server.stop().await;

    let cores = std::thread::available_parallelism().unwrap().get();
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(cores).start().await;
    let client = server.client();
    let start = Instant::now();
    let study = client.submit_study(&study_of(&least_job(), 10_000)).await;
    println!("| study of 10 000 jobs accepted by an idle server | {:.2} s |", start.elapsed().as_secs_f64());
    let id = id_of(&study);
    let (mut most, mut done) = (0.0_f64, 0);
    while done < 10_000 {
        let next = (done + 500).min(10_000);
        let study =
            client.study_when(id, "further", |study| study["progress"]["done"].as_u64() >= Some(next)).await;
        done = study["progress"]["done"].as_u64().unwrap();
        most = most.max(megabytes(&server));
    }
    let took = start.elapsed().as_secs_f64();
    println!("| 10 000 jobs of one grain run | {:.2} ms a job and worker |", took * 1e3 * cores as f64 / 1e4);
    table_times(&client, id, "100 points, 10 000 runs").await;
    println!("| memory, most | {:.0} MB |", most.max(megabytes(&server)));
    let start = Instant::now();
    client.delete(&format!("/v1/studies/{id}")).send().await.expect(204);
    println!("| delete of 10 000 finished jobs | {:.2} s |", start.elapsed().as_secs_f64());
    server.stop().await;
}

/// A mix as they are asked for; equal spheres make as many grains in that time as can be, and as long a result.
fn a_tenth_of_a_second() -> Value {
    json!({
        "specimen": {"type": "box", "size_mm": [60, 60, 60]},
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
            "volume_fraction": 0.6, "volume_fraction_of": "placed_grains"
        }
    })
}

#[tokio::test]
#[ignore = "prints figures"]
async fn overhead_over_the_bare_engine() {
    let cores = std::thread::available_parallelism().unwrap().get();
    for workers in [1, cores] {
        for job in [jobs::equal_spheres(1, 1), jobs::equal_spheres(30_000, 1), a_tenth_of_a_second()] {
            let data_dir = DataDir::new();
            let server = Launch::new(&data_dir).workers(workers).start().await;
            let client = server.client();
            let study = client.submit_study(&study_of(&job, 400)).await;
            let finished = client.study_finished(id_of(&study)).await;
            assert_eq!(finished["counts"]["succeeded"], 400);
            let moment = |text: &Value| text.as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
            let jobs = client.jobs_of(id_of(&study)).await;
            let first = jobs.iter().map(|job| moment(&job["started_at"])).min().unwrap();
            let wall_s =
                moment(&finished["finished_at"]).duration_since(first).as_secs_f64() * workers as f64;
            let engine_s: f64 = client
                .table(id_of(&study))
                .await
                .iter()
                .map(|row| row["time_s_total"].as_f64().unwrap())
                .sum();
            println!(
                "| {workers} workers, jobs of {:.1} ms | {:.2} ms a job of the service | {:.1} % |",
                engine_s * 1e3 / 400.0,
                (wall_s - engine_s) * 1e3 / 400.0,
                (wall_s / engine_s - 1.0) * 100.0
            );
            server.stop().await;
        }
    }
}

/// A worker as the server sees it: leases a job, is silent for as long as it would pack, ends it.
async fn simulated_worker(
    http: reqwest::Client,
    base: String,
    lease: Value,
    packs_for: Duration,
    until: Instant,
) -> (Vec<Duration>, u32) {
    let (mut claims, mut ended) = (Vec::new(), 0);
    for number in 0.. {
        let mut claim = lease.clone();
        claim["claim"] = json!(format!("{}-{number}", lease["worker"].as_str().unwrap()));
        let asked = Instant::now();
        let request = http.post(format!("{base}/v1/leases")).header("prefer", "wait=5").json(&claim);
        let answer = request.send().await.expect("an answer");
        if Instant::now() >= until {
            break;
        }
        if answer.status() != 200 {
            assert_eq!(answer.status(), 204);
            continue;
        }
        claims.push(asked.elapsed());
        let leased: Value = answer.json().await.expect("leases");
        tokio::time::sleep(packs_for).await;
        let path = format!("/v1/leases/{}/1/end", leased["leases"][0]["job"].as_str().unwrap());
        let failure = json!({"code": "timed-out", "detail": "simulated"});
        let end =
            json!({"outcome": "failed", "failure": failure, "facts": {"time_s": packs_for.as_secs_f64()}});
        let answer = http.post(format!("{base}{path}")).json(&end).send().await.expect("an answer");
        let status = answer.status();
        assert_eq!(status, 200, "{}", answer.text().await.unwrap_or_default());
        ended += 1;
    }
    (claims, ended)
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "prints figures"]
async fn a_thousand_simulated_workers() {
    const WORKERS: u32 = 1000;
    const PACKS_FOR: Duration = Duration::from_secs(3);
    const LASTS: Duration = Duration::from_mins(1);
    let data_dir = DataDir::new();
    let launch = Launch::new(&data_dir).workers(0).env("PACKSTONE_MAX_CONNECTIONS", "3000");
    let server = launch.env("PACKSTONE_MAX_CONNECTIONS_PER_CLIENT", "3000").start().await;
    let client = server.client();
    let lease = json!({"worker": "w", "slots": 1, "build": packstone_build().await, "bits": "none"});
    let mut lease = jobs::with(lease, "/claim", json!("x"));
    let refused = client.post("/v1/leases").json(&lease).send().await.expect_problem(409, "worker-refused");
    lease["bits"] = json!(refused["detail"].as_str().unwrap().rsplit('"').nth(1).unwrap());
    let base = format!("http://{}", server.address());
    let http = reqwest::Client::builder().no_proxy().build().unwrap();
    let run = |until: Instant| {
        let (http, base, lease) = (http.clone(), base.clone(), lease.clone());
        join_all((0..WORKERS).map(move |number| {
            let lease = jobs::with(lease.clone(), "/worker", json!(format!("worker {number}")));
            tokio::spawn(simulated_worker(http.clone(), base.clone(), lease, PACKS_FOR, until))
        }))
    };
    run(Instant::now() + Duration::from_secs(4)).await;
    println!("| memory, {WORKERS} workers wait | {:.0} MB |", server.peak_bytes() as f64 / 1e6);
    // A limit of time is the end that a worker may report without figures of the packing.
    let job = jobs::with(least_job(), "/timeout_s", json!(PACKS_FOR.as_secs_f64()));
    for _ in 0..4 {
        let mut template = job.clone();
        template.as_object_mut().unwrap().remove("seed");
        client.submit_study(&json!({"seed": 1, "template": template, "replicates": 10_000})).await;
    }
    let start = Instant::now();
    let ended = run(start + LASTS).await;
    let took = start.elapsed().as_secs_f64();
    let (mut claims, mut jobs) = (Vec::new(), 0);
    for worker in ended {
        let (of_worker, ended) = worker.unwrap();
        claims.extend(of_worker);
        jobs += ended;
    }
    let packed = f64::from(jobs) * PACKS_FOR.as_secs_f64() / (took * f64::from(WORKERS));
    println!(
        "| {WORKERS} workers, jobs of 3 s | {:.0} jobs/s | {:.0} % of the workers pack |",
        f64::from(jobs) / took,
        1e2 * packed
    );
    Times::new(claims).print("claim of one of them");
    println!("| memory, most | {:.0} MB |", server.peak_bytes() as f64 / 1e6);
    server.stop().await;
}

async fn packstone_build() -> String {
    let version = packstone(std::path::Path::new("/"), &["--version"]).await.stdout;
    version.trim().strip_prefix("packstone ").unwrap().to_owned()
}

/// The same jobs by the server's own workers and by as many in another process.
#[tokio::test]
#[ignore = "prints figures"]
async fn jobs_of_one_grain_here_and_there() {
    let cores = std::thread::available_parallelism().unwrap().get();
    let places = [(false, cores), (true, cores), (true, 4 * cores)];
    for ((there, slots), every_change) in places.into_iter().flat_map(|place| [(place, true), (place, false)])
    {
        let data_dir = DataDir::new();
        let folder = tempfile::tempdir().unwrap();
        let server = Launch::new(&data_dir).workers(if there { 0 } else { cores }).start().await;
        let client = server.client();
        let url = format!("http://{}", server.address());
        let slots = slots.to_string();
        // Its log would fill a pipe that nobody reads.
        let worker = there.then(|| {
            let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_packstone"));
            command.args(["worker", "--server", &url, "--slots", &slots]).current_dir(folder.path());
            command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
            command.spawn().expect("a worker")
        });
        let start = Instant::now();
        let study = client.submit_study(&study_of(&least_job(), 3000)).await;
        if every_change {
            client.study_finished(id_of(&study)).await;
        } else {
            let address = format!("/v1/studies/{}", id_of(&study));
            while client.get(&address).send().await.expect(200).json()["finished_at"].is_null() {
                tokio::time::sleep(Duration::from_millis(250)).await;
            }
        }
        let took = start.elapsed().as_secs_f64();
        let place = if there { "in another process" } else { "in the server" };
        let told =
            if every_change { "a client is told of each change" } else { "a client asks every 250 ms" };
        println!("| 3000 jobs of one grain, {slots} slots {place}, {told} | {:.0} jobs/s |", 3000.0 / took);
        if let Some(mut worker) = worker {
            worker.kill().unwrap();
            worker.wait().unwrap();
        }
        server.stop().await;
    }
}
