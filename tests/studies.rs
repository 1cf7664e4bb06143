//! Studies: many jobs from one request, what becomes of them as a whole, and the table they come to.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::time::Duration;

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Server, id_of, jobs};

/// A job without its seed, which a study sets.
fn template(mut job: Value) -> Value {
    job.as_object_mut().unwrap().remove("seed");
    job
}

/// Two volume fractions, both methods, so many times.
fn small(replicates: u32) -> Value {
    json!({
        "name": "small", "labels": {"series": "TB-7"}, "seed": 7,
        "template": template(jobs::quick(1)),
        "grid": {"/mix/volume_fraction": [0.30, 0.35], "/method": [{"type": "rsa"}, {"type": "edmd"}]},
        "replicates": replicates
    })
}

/// The one job of a list that holds the worker, and others behind it.
fn held(others: usize) -> Value {
    let mut list = vec![jobs::endless()];
    list.extend((0..others).map(|seed| jobs::quick(seed as u64)));
    json!({"list": list})
}

fn count(study: &Value, state: &str) -> u64 {
    study["counts"][state].as_u64().unwrap()
}

#[tokio::test]
async fn a_study_runs_to_its_table() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let reply = client.post("/v1/studies").json(&small(2)).send().await;
    let study = reply.expect(201).json();
    let id = id_of(&study).to_owned();
    assert_eq!(reply.header("location"), format!("/v1/studies/{id}"));
    assert_eq!((&study["points"], &study["replicates"], &study["jobs"]), (&json!(4), &json!(2), &json!(8)));
    assert_eq!(study["columns"], json!(["/mix/volume_fraction", "/method"]));
    assert_eq!(study["request"], small(2));

    let finished = client.study_finished(&id).await;
    assert_eq!(count(&finished, "succeeded"), 8, "{finished:#}");
    // What may be long is in no poll.
    assert_eq!(finished.get("request"), None);
    let whole = client.get(&format!("/v1/studies/{id}?include=request")).send().await;
    assert_eq!((whole.json()["request"].clone(), whole.header("etag").len() > 2), (small(2), true));
    let retried = client.post(&format!("/v1/studies/{id}/retry")).send().await.expect(200).json();
    assert_eq!(retried.get("request"), None);
    let unknown = client.get(&format!("/v1/studies/{id}?include=table")).send().await;
    let problem = unknown.expect_problem(400, "validation-error");
    assert_eq!(problem["errors"][0]["detail"], "\"table\" is unknown: must be request");
    assert_eq!(finished["progress"], json!({"fraction": 1.0, "done": 8, "total": 8, "eta_s": 0.0}));
    let rows = client.table(&id).await;
    let keys: Vec<(f64, &str)> = rows
        .iter()
        .map(|row| (row["/mix/volume_fraction"].as_f64().unwrap(), row["/method"]["type"].as_str().unwrap()))
        .collect();
    assert_eq!(keys, [(0.30, "rsa"), (0.30, "edmd"), (0.35, "rsa"), (0.35, "edmd")]);
    for row in &rows {
        assert_eq!((&row["runs"], &row["successes"], &row["waiting"]), (&json!(2), &json!(2), &json!(0)));
        assert!(row["grains"].as_f64() > Some(10.0) && row["time_s_total"].as_f64() > Some(0.0), "{row:#}");
    }

    // The same as CSV, by the query and by Accept.
    let csv = client.get(&format!("/v1/studies/{id}/table?format=csv")).send().await;
    let text = String::from_utf8(csv.expect(200).body.to_vec()).unwrap();
    assert_eq!(text.lines().count(), 5);
    assert!(text.starts_with("/mix/volume_fraction,/method,grains,"), "{text}");
    let path = format!("/v1/studies/{id}/table");
    let accepted = client.get(&path).header("accept", "text/csv").send().await;
    assert_eq!(accepted.expect(200).body, csv.body);
    let etag = accepted.header("etag");
    client.get(&path).header("accept", "text/csv").header("if-none-match", etag).send().await.expect(304);
    client.get(&format!("{path}?format=npy")).send().await.expect_problem(406, "not-acceptable");

    // Every job tells its place; points that differ in the method pack the same grains.
    let all = client.jobs_of(&id).await;
    let places: HashSet<(u64, u64)> =
        all.iter().map(|job| (job["point"].as_u64().unwrap(), job["replicate"].as_u64().unwrap())).collect();
    assert_eq!(places.len(), 8);
    assert!(all.iter().all(|job| job["study_id"] == id.as_str()));
    let seed = |point: u64, replicate: u64| {
        let job = all.iter().find(|job| job["point"] == point && job["replicate"] == replicate).unwrap();
        job["seed"].as_u64().unwrap()
    };
    assert_eq!((seed(0, 0), seed(0, 1)), (seed(1, 0), seed(1, 1)));
    assert!(seed(0, 0) != seed(0, 1) && seed(0, 0) != seed(2, 0));
    let by_filter = client.get(&format!("/v1/jobs?study={id}&limit=5")).send().await.expect(200).json();
    let first_five: Vec<&str> = all[..5].iter().map(id_of).collect();
    assert_eq!(by_filter["items"].as_array().unwrap().iter().map(id_of).collect::<Vec<_>>(), first_five);
    let next = format!("/v1/jobs?study={id}&limit=5&cursor={}", by_filter["next_cursor"].as_str().unwrap());
    assert_eq!(client.get(&next).send().await.expect(200).json()["items"].as_array().unwrap().len(), 3);
    server.stop().await;
}

#[tokio::test]
async fn faults_point_to_the_job_and_the_field_and_nothing_is_taken_in() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let with = |pointer: &str, value: Value| jobs::with(small(1), pointer, value);
    let fractions = |values: Value| {
        let mut study = small(1);
        study["grid"]["/mix/volume_fraction"] = values;
        study
    };
    let far_apart = with("/template/distance", json!({"type": "constant", "gap_mm": 5}));
    let list = json!({"list": [jobs::quick(1), jobs::with(jobs::quick(2), "/priority", json!(1000))]});
    for (study, status, slug, pointer) in [
        (with("/replicates", json!(0)), 422, "validation-error", "/replicates"),
        (with("/colour", json!("red")), 422, "validation-error", "/colour"),
        (
            with("/template/specimen/size_mm", json!([0, 1, 1])),
            422,
            "validation-error",
            "/template/specimen/size_mm/0",
        ),
        (fractions(json!([0.3, 2])), 422, "validation-error", "/grid/~1mix~1volume_fraction/1"),
        (far_apart, 422, "infeasible-mix", "/grid/~1mix~1volume_fraction/0"),
        (with("/replicates", json!(5000)), 422, "too-large", ""),
        (list, 422, "validation-error", "/list/1/priority"),
    ] {
        let problem = client.post("/v1/studies").json(&study).send().await.expect_problem(status, slug);
        let pointers: Vec<&str> =
            problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
        assert!(pointers.contains(&pointer), "{problem:#}");
    }
    client.post("/v1/studies").text("[1,").send().await.expect_problem(400, "malformed-json");
    for path in ["/v1/studies/none", "/v1/studies/01900000-0000-7000-8000-000000000000/table"] {
        client.get(path).send().await.expect_problem(404, "not-found");
    }
    let none = client.get("/v1/studies").send().await.expect(200).json();
    assert_eq!(none, json!({"items": [], "next_cursor": null}));
    assert_eq!(client.get("/v1/jobs").send().await.expect(200).json()["items"], json!([]));
    server.stop().await;
}

/// A worker packs the next job while it stores the result of the one before, and no further ones.
#[tokio::test]
async fn no_more_than_two_jobs_of_each_worker_are_running() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let study = client.submit_study(&json!({"list": (0..200).map(jobs::quick).collect::<Vec<_>>()})).await;
    let path = format!("/v1/studies/{}", id_of(&study));
    let mut looks = 0;
    loop {
        let study = client.get(&path).send().await.expect(200).json();
        assert!(count(&study, "running") <= 4, "{looks}: {study:#}");
        if !study["finished_at"].is_null() {
            break;
        }
        looks += 1;
    }
    assert!(looks > 20, "{looks} looks while it ran");
    server.stop().await;
}

#[tokio::test]
async fn the_same_key_and_body_give_the_same_study() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).args(&["--max-queued", "10"]).start().await;
    let client = server.client();
    let post = |key: &'static str, body: Value| {
        client.post("/v1/studies").header("idempotency-key", key).json(&body).send()
    };
    let mut unseeded = small(2);
    unseeded.as_object_mut().unwrap().remove("seed");
    let first = post("a", unseeded.clone()).await.expect(201).json();
    let second = post("a", unseeded).await.expect(200).json();
    assert_eq!(second, first, "the seed that was drawn is kept");
    assert_eq!(first["request"]["seed"], first["seed"]);
    post("a", small(2)).await.expect_problem(422, "idempotency-key-reused");
    // Eight jobs wait, and there is room for two more: all of a study or nothing.
    let full = post("b", small(1)).await;
    full.expect_problem(429, "queue-full");
    assert!(full.header("retry-after").parse::<u32>().unwrap() >= 1);
    assert_eq!(client.get("/v1/jobs?limit=100").send().await.json()["items"].as_array().unwrap().len(), 8);
    // Keys of jobs are others.
    client.post("/v1/jobs").header("idempotency-key", "a").json(&jobs::quick(1)).send().await.expect(201);
    server.stop().await;
}

#[tokio::test]
async fn a_single_job_starts_before_the_backlog_of_a_study() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let study = client.submit_study(&held(200)).await;
    let holding = client.study_when(id_of(&study), "running", |study| count(study, "running") == 1).await;
    assert_eq!(count(&holding, "queued"), 200);
    let single = client.submit(&jobs::quick(1)).await;
    let running =
        client.get(&format!("/v1/studies/{}/jobs?state=running", id_of(&study))).send().await.json();
    let held = id_of(&running["items"][0]).to_owned();
    client.post(&format!("/v1/jobs/{held}/cancel")).send().await.expect(202);
    let single = client.finished(id_of(&single)).await;
    client.study_finished(id_of(&study)).await;
    let started = |job: &Value| job["started_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    for job in client.jobs_of(id_of(&study)).await.iter().filter(|job| id_of(job) != held) {
        assert!(started(&single) < started(job), "{job:#}");
    }
    server.stop().await;
}

#[tokio::test]
async fn a_point_that_keeps_failing_is_called_off() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let study = json!({
        "template": template(jobs::unreachable()),
        "grid": {"/mix/volume_fraction": [0.2, 0.5]},
        "replicates": 6,
        "stop_when": {"failed_in_a_row": 2}
    });
    let study = client.submit_study(&study).await;
    let finished = client.study_finished(id_of(&study)).await;
    assert_eq!((count(&finished, "succeeded"), count(&finished, "failed")), (6, 2), "{finished:#}");
    assert_eq!(count(&finished, "cancelled"), 4);
    let [reached, called_off] = &client.table(id_of(&study)).await[..] else { panic!("two points") };
    assert_eq!((&reached["successes"], &reached["stopped_early"]), (&json!(6), &json!(0)));
    assert_eq!((&called_off["runs"], &called_off["successes"]), (&json!(2), &json!(0)));
    assert_eq!((&called_off["stopped_early"], &called_off["void"]), (&json!(4), &json!(0)));
    server.stop().await;
}

#[tokio::test]
async fn a_study_is_cancelled_retried_and_deleted_as_a_whole() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    // Finished jobs first, then one that does not end by itself, then some that wait.
    let mut list = vec![jobs::quick(1), jobs::quick(2), jobs::unreachable(), jobs::endless()];
    list.extend((3..8).map(jobs::quick));
    let study = client.submit_study(&json!({"list": list})).await;
    let id = id_of(&study).to_owned();
    let path = format!("/v1/studies/{id}");
    client
        .study_when(&id, "held", |study| {
            count(study, "failed") == 1 && count(study, "running") == 1 && count(study, "queued") == 5
        })
        .await;
    client.delete(&path).send().await.expect_problem(409, "conflict");
    client.post(&format!("{path}/cancel")).send().await.expect(202);
    let cancelled = client.study_finished(&id).await;
    assert_eq!((count(&cancelled, "succeeded"), count(&cancelled, "cancelled")), (2, 6), "{cancelled:#}");
    client.post(&format!("{path}/cancel")).send().await.expect_problem(409, "conflict");
    let rows = client.table(&id).await;
    assert_eq!((&rows[0]["point"], &rows[0]["successes"]), (&json!(0), &json!(1)));
    assert_eq!((&rows[2]["runs"], &rows[3]["void"], &rows[4]["void"]), (&json!(1), &json!(1), &json!(1)));

    let retried = client.post(&format!("{path}/retry")).send().await.expect(200).json();
    assert_eq!((count(&retried, "failed"), count(&retried, "cancelled")), (0, 6));
    assert_eq!(
        count(&client.study_finished(&id).await, "failed"),
        1,
        "what cannot be reached cannot be reached"
    );
    let problem = client.post(&format!("{path}/retry?state=running")).send().await;
    problem.expect_problem(400, "validation-error");
    // All but the endless one, which is in the way of none now.
    let jobs = client.jobs_of(&id).await;
    let endless = jobs.iter().find(|job| job["point"] == 3).unwrap();
    client.delete(&format!("/v1/jobs/{}", id_of(endless))).send().await.expect(204);
    client.post(&format!("{path}/retry?state=failed,cancelled")).send().await.expect(200);
    let again = client.study_finished(&id).await;
    assert_eq!((count(&again, "succeeded"), count(&again, "failed"), count(&again, "cancelled")), (7, 1, 1));
    assert_eq!(client.table(&id).await[3]["void"], 1, "the run of a deleted job stays");

    assert_eq!(data_dir.artifacts().len(), 7);
    client.delete(&path).send().await.expect(204);
    eventually("the results to go", || data_dir.artifacts().is_empty()).await;
    client.get(&path).send().await.expect_problem(404, "not-found");
    assert_eq!(client.get("/v1/jobs").send().await.json()["items"], json!([]));
    server.stop().await;
}

#[tokio::test]
async fn studies_are_listed_by_state_and_label() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let labelled = |series: &str| jobs::with(small(1), "/labels/series", json!(series));
    let mut ids = Vec::new();
    for series in ["a", "b", "a"] {
        ids.insert(0, id_of(&client.submit_study(&labelled(series)).await).to_owned());
    }
    client.post(&format!("/v1/studies/{}/cancel", ids[0])).send().await.expect(200);
    let list = async |query: &str| -> Vec<String> {
        let page = client.get(&format!("/v1/studies{query}")).send().await.expect(200).json();
        page["items"].as_array().unwrap().iter().map(|study| id_of(study).to_owned()).collect()
    };
    assert_eq!(list("").await, ids);
    assert_eq!(list("?state=open").await, ids[1..]);
    assert_eq!(list("?state=finished").await, ids[..1]);
    assert_eq!(list("?label=series=a&state=open").await, ids[2..]);
    let first = client.get("/v1/studies?limit=2").send().await;
    let link = first.header("link").split(['<', '>']).nth(1).unwrap().to_owned();
    assert_eq!(list(link.strip_prefix("/v1/studies").unwrap()).await, ids[2..]);
    for query in ["state=queued", "cursor=00", "label=series", "colour=red"] {
        let refused = client.get(&format!("/v1/studies?{query}")).send().await;
        refused.expect_problem(400, "validation-error");
    }
    client.get("/v1/jobs?study=7").send().await.expect_problem(400, "validation-error");
    server.stop().await;
}

#[tokio::test]
async fn an_answer_may_wait_for_a_study() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let reply = client.post("/v1/studies").header("prefer", "wait=60").json(&small(1)).send().await;
    assert_eq!(count(&reply.expect(201).json(), "succeeded"), 4);
    assert_eq!(reply.header("preference-applied"), "wait=60");
    let path = reply.header("location").to_owned();
    let etag = reply.header("etag");
    client.get(&path).header("if-none-match", etag).send().await.expect(304);
    server.stop().await;
}

#[tokio::test]
async fn power_cuts_during_a_study_lose_and_repeat_nothing() {
    survive(5, 80, 1).await;
}

#[tokio::test]
#[ignore = "long: cargo test -p packstone-server --test e2e studies::twenty -- --ignored"]
async fn twenty_power_cuts_during_a_study_of_500_jobs() {
    survive(20, 500, 2).await;
}

async fn survive(kills: u64, replicates: u64, seed: u64) {
    let data_dir = DataDir::new();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let launch = || Launch::new(&data_dir).workers(2);
    let mut template = template(jobs::equal_spheres(8000, 1));
    template["max_attempts"] = json!(10);
    let mut server = launch().start().await;
    let study = json!({"seed": seed, "template": template, "replicates": replicates});
    let id = id_of(&server.client().submit_study(&study).await).to_owned();
    let mut ended: HashMap<String, Value> = HashMap::new();
    for kill in 0..kills {
        let client = server.client();
        let share = replicates * kill / kills;
        client.study_when(&id, "under way", |study| study["progress"]["done"].as_u64() >= Some(share)).await;
        remember(&client, &id, &mut ended).await;
        // Not a wait for anything: the moment of the power cut is drawn.
        tokio::time::sleep(Duration::from_micros(random.next_u64() % 60_000)).await;
        server.kill().await;
        server = launch().start().await;
    }
    let client = server.client();
    let finished = client.study_finished(&id).await;
    assert_eq!(count(&finished, "succeeded"), replicates, "{finished:#}");
    assert_eq!(client.table(&id).await[0]["successes"], replicates);
    remember(&client, &id, &mut ended).await;
    assert_eq!(ended.len() as u64, replicates, "a job was lost, or came from nowhere");
    let all = client.jobs_of(&id).await;
    let replicate = |job: &Value| job["replicate"].as_u64().unwrap();
    assert_eq!(all.iter().map(replicate).collect::<HashSet<_>>().len() as u64, replicates);
    let mut attempts: BTreeMap<u64, u64> = BTreeMap::new();
    for job in &all {
        *attempts.entry(job["attempt"].as_u64().unwrap()).or_default() += 1;
    }
    eventually("one result for each job", || data_dir.artifacts().len() as u64 == replicates).await;
    server.stop().await;
    println!("{kills} kills: {replicates} results; jobs by attempts {attempts:?}");
}

/// Looks at what has ended: it must be as it was seen before.
async fn remember(client: &Client, study: &str, ended: &mut HashMap<String, Value>) {
    for job in client.jobs_of(study).await.into_iter().filter(|job| job["state"] == "succeeded") {
        let before = ended.entry(id_of(&job).to_owned()).or_insert_with(|| job.clone());
        assert_eq!(*before, job, "a finished job changed");
    }
}

#[tokio::test]
async fn warnings_of_the_plans_are_shown_once_for_each_point() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut job = template(jobs::quick(1));
    job["mix"]["allow_coarse"] = json!(true);
    job["specimen"]["size_mm"] = json!([60, 60, 60]);
    // So few grains that whole ones miss the volume.
    let grid = json!({"/mix/volume_fraction": [0.35, 1e-6], "/distance/gap_mm": [0.2, 0.201]});
    let study = json!({"template": job, "grid": grid, "replicates": 3});
    let accepted = client.submit_study(&study).await;
    let warned = accepted["warnings"].as_array().unwrap();
    let coarse = jobs::with(job, "/mix/volume_fraction", json!(1e-6));
    let plan = client.post("/v1/plans").json(&coarse).send().await.expect(200).json();
    // The points 2 and 3 have the same warnings, which are given once, with their number.
    let texts: Vec<&Value> = warned.iter().map(|warning| &warning["detail"]).collect();
    assert_eq!(texts, plan["warnings"].as_array().unwrap().iter().collect::<Vec<_>>(), "{accepted:#}");
    assert!(!warned.is_empty());
    for warning in warned {
        assert_eq!((&warning["points"], &warning["point"]), (&json!(2), &json!(2)), "{accepted:#}");
    }
    let finished = client.study_finished(id_of(&accepted)).await;
    assert_eq!(finished["warnings"], accepted["warnings"]);
    for job in client.jobs_of(id_of(&accepted)).await {
        let is_ample = job["point"] == 0 || job["point"] == 1;
        assert!(is_ample || !job["warnings"].as_array().unwrap().is_empty(), "{job:#}");
    }
    server.stop().await;
}
