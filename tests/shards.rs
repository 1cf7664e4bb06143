//! `packstone study --shard` and `--merge`: a study that several processes run in one folder, whatever breaks them off,
//! has the table and the packings of a study on one machine.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;
use std::{fs, io};

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{Finished, Running, jobs, packstone};

/// Exit code of a merge that misses runs.
const UNFINISHED: Option<i32> = Some(7);
const INTERRUPTED: Option<i32> = Some(130);

/// Six points of some tens of milliseconds a run.
fn study(replicates: usize) -> Value {
    json!({
        "name": "three times two", "seed": 11,
        "template": jobs::with(jobs::equal_spheres(1500, 0), "/seed", Value::Null),
        "grid": {
            "/mix/volume_fraction": [0.2, 0.25, 0.3],
            "/method": [{"type": "rsa"}, {"type": "edmd"}]
        },
        "replicates": replicates
    })
}

/// A point that grows for some seconds, one that grows for less than one, and one that is quick.
fn long_study() -> Value {
    json!({
        "seed": 3,
        "template": jobs::with(jobs::growth(), "/seed", Value::Null),
        "grid": {"/mix/volume_fraction": [0.3, 0.5375, 0.525]}
    })
}

fn write(directory: &Path, study: &Value) {
    fs::write(directory.join("study.json"), study.to_string()).unwrap();
}

async fn run(directory: &Path, out: &str, more: &[&str]) -> Finished {
    packstone(directory, &[&["study", "study.json", "--out", out], more].concat()).await
}

async fn succeed(directory: &Path, out: &str, more: &[&str]) -> Finished {
    let ended = run(directory, out, more).await;
    assert_eq!(ended.code, Some(0), "{more:?}: {ended:?}");
    ended
}

/// The rows of a table without what no two runs agree on.
fn rows_without_times(out: &Path) -> Vec<Value> {
    let table: Value = serde_json::from_slice(&fs::read(out.join("table.json")).unwrap()).unwrap();
    let mut rows = table["rows"].as_array().unwrap().clone();
    for row in &mut rows {
        let columns = row.as_object_mut().unwrap();
        columns.retain(|column, _| !column.contains("time_s") && column != "event_us_median");
    }
    rows
}

/// The files of a folder, without those in folders of it; none where there is no folder yet.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return BTreeMap::new(),
        entries => entries.unwrap_or_else(|error| panic!("{}: {error}", folder.display())),
    };
    entries
        .map(Result::unwrap)
        .filter(|entry| entry.file_type().unwrap().is_file())
        .map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap()))
        .collect()
}

/// What each run came to, from `runs.jsonl`: point and replicate, outcome and digest.
fn runs(out: &Path) -> BTreeMap<(u64, u64), (String, String)> {
    let text = fs::read_to_string(out.join("runs.jsonl")).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let mut runs = BTreeMap::new();
    for run in lines {
        let key = (run["point"].as_u64().unwrap(), run["replicate"].as_u64().unwrap());
        let told = (run["outcome"].to_string(), run["digest"].as_str().unwrap().to_owned());
        assert_eq!(runs.insert(key, told), None, "{key:?} is told twice");
    }
    runs
}

/// A line of a log, of these members and the bracket after them: it begins with their CRC-32.
fn summed(members: &str) -> String {
    format!("{{\"crc32\":\"{:08x}\",{members}", crc32fast::hash(members.as_bytes()))
}

/// What two finished studies have in common, whoever ran them: everything but times.
fn assert_equal(one: &Path, other: &Path) {
    assert_eq!(rows_without_times(one), rows_without_times(other));
    assert_eq!(runs(one), runs(other));
    assert_eq!(files(&one.join("results")), files(&other.join("results")));
    let names = |out: &Path| files(out).into_keys().collect::<Vec<_>>();
    assert_eq!(names(one), names(other));
}

#[tokio::test]
async fn three_shards_are_one_study() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    write(directory, &study(3));
    succeed(directory, "one", &["--format", "npy,csv"]).await;
    let mut points = 0;
    for shard in ["0/3", "1/3", "2/3"] {
        let ended = succeed(directory, "out", &["--format", "npy,csv", "--shard", shard]).await;
        assert!(ended.stdout.contains("ended, 0 left"), "{ended:?}");
        points += ended.stdout.split_once(": ").and_then(|(_, rest)| rest[..1].parse::<u32>().ok()).unwrap();
        assert!(!directory.join("out/table.json").exists());
    }
    assert_eq!(points, 6);
    let merged = succeed(directory, "out", &["--merge"]).await;
    assert!(merged.stdout.contains("table.csv") && merged.stdout.contains("3/3"), "{merged:?}");
    let (one, out) = (directory.join("one"), directory.join("out"));
    assert_equal(&one, &out);
    assert!(!out.join("checkpoints").exists());
    // Nothing is left but the logs: one for each point, and the forecast.
    let left: Vec<String> = fs::read_dir(out.join("shards"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(left.len(), 7, "{left:?}");

    // Nothing is repeated, by shards of any number, and a second merge changes nothing.
    let before = files(&out);
    for shard in ["0/1", "4/5", "9/10"] {
        succeed(directory, "out", &["--shard", shard, "--resume"]).await;
    }
    succeed(directory, "out", &["--merge"]).await;
    assert!(before == files(&out), "the second merge changed a file");
    // Without shards the study would not know of its runs.
    let refused = run(directory, "out", &["--resume"]).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("--shard 0/1"), "{refused:?}");
    let refused = run(directory, "one", &["--merge"]).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("no runs of shards"), "{refused:?}");
    let ended = succeed(directory, "out", &["--fresh"]).await;
    assert!(ended.stdout.contains("3/3") && !out.join("shards").exists(), "{ended:?}");
}

/// The same runs in logs of shards give the same files, times included.
#[tokio::test]
async fn a_merge_writes_what_one_machine_writes_byte_for_byte() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let mut study = study(4);
    study["template"]["distance"] = json!({"type": "maximize"});
    study["grid"] = json!({"/mix/volume_fraction": [0.2, 0.25, 0.3]});
    study["template"]["method"] = json!({"type": "edmd", "stop": {"events": 60_000}});
    write(directory, &study);
    succeed(directory, "one", &["--workers", "2"]).await;
    let (one, out) = (directory.join("one"), directory.join("out"));
    fs::create_dir_all(out.join("shards")).unwrap();
    fs::copy(one.join("study.json"), out.join("study.json")).unwrap();
    // Each point was cut after two runs, and went on in the next generation.
    for run in fs::read_to_string(one.join("runs.jsonl")).unwrap().lines() {
        let point = &serde_json::from_str::<Value>(run).unwrap()["point"];
        let log = |generation| out.join(format!("shards/{point}.{generation}.jsonl"));
        let full =
            |generation| fs::read_to_string(log(generation)).is_ok_and(|text| text.lines().count() == 2);
        let generation = if full(1) { 2 } else { 1 };
        let text = fs::read_to_string(log(generation)).unwrap_or_default();
        fs::write(log(generation), format!("{text}{}\n", summed(&format!("\"run\":{run}}}")))).unwrap();
    }
    succeed(directory, "out", &["--merge"]).await;
    let (mut one, mut out) = (files(&one), files(&out));
    // The order of the ends is that of the points here.
    let sorted = |files: &mut BTreeMap<String, Vec<u8>>| {
        let text = String::from_utf8(files.remove("runs.jsonl").unwrap()).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    assert_eq!(sorted(&mut one), sorted(&mut out));
    assert!(one.contains_key("curves.json") && one.contains_key("plot-curve.svg"), "{:?}", one.keys());
    for (name, bytes) in &one {
        assert!(out.get(name) == Some(bytes), "{name} is another");
    }
    assert_eq!(one.len(), out.len());
}

/// The shard that has the point that takes longest.
async fn start_long(directory: &Path, checkpoint_every_s: &str) -> Running {
    let args = ["study", "study.json", "--out", "out", "--format", "npy", "--workers", "1"];
    let more = ["--shard", "0/3", "--checkpoint-every-s", checkpoint_every_s];
    Running::start(directory, &[&args[..], &more].concat()).await
}

fn checkpoints(out: &Path) -> Vec<String> {
    let names = fs::read_dir(out.join("checkpoints")).into_iter().flatten();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.ends_with(".checkpoint")).collect()
}

/// Breaks the longest run off, goes on with shards of another number, and compares with a study on one machine.
async fn survives(signal: Signal) {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    write(directory, &long_study());
    let out = directory.join("out");
    // Killed, only what was kept before remains; asked to end, it keeps a checkpoint that was not due.
    let every = if signal == Signal::KILL { "0" } else { "3600" };
    let shard = start_long(directory, every).await;
    // Work of some seconds would be lost. A killed shard has what it kept; one that ends keeps a checkpoint.
    let kept = || signal == Signal::TERM || checkpoints(&out).len() == 1;
    eventually("some growth", || shard.cpu_time() > Duration::from_millis(400) && kept()).await;
    // A machine that is busy may have come to the first checkpoint that is due, whatever the interval.
    let kept = files(&out.join("checkpoints"));
    shard.signal(signal);
    let ended = shard.ended().await;
    assert_eq!(checkpoints(&out).len(), 1, "{ended:?}");
    if signal == Signal::TERM {
        assert!(kept != files(&out.join("checkpoints")), "no checkpoint was kept at the end");
        assert_eq!(ended.code, INTERRUPTED, "{ended:?}");
        assert!(ended.stderr.contains("1 of its 1 jobs not done"), "{ended:?}");
    }
    let unfinished = run(directory, "out", &["--merge"]).await;
    assert_eq!(unfinished.code, UNFINISHED, "{unfinished:?}");
    assert!(unfinished.stderr.contains("3 of 3 jobs are missing"), "{unfinished:?}");

    let mut said = String::new();
    for shard in ["1/2", "0/2"] {
        said += &succeed(directory, "out", &["--format", "npy,json", "--shard", shard]).await.stderr;
    }
    let mut resumes = Vec::new();
    for point in 0..3 {
        // It tells times, which differ.
        let file = out.join(format!("results/{point}-0.json"));
        let result: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
        resumes.push(result["statistics"]["edmd"]["resumes"].as_u64().unwrap());
        fs::remove_file(file).unwrap();
    }
    assert_eq!(resumes, [0, 1, 0]);
    assert_eq!(said.contains("is taken over from process"), signal == Signal::KILL, "{said}");
    assert!(checkpoints(&out).is_empty());
    succeed(directory, "out", &["--merge"]).await;
    let left: Vec<String> = fs::read_dir(out.join("shards"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert!(!left.iter().any(|name| name.contains("tmp") || name.contains("beat")), "{left:?}");
    succeed(directory, "one", &["--format", "npy"]).await;
    assert_equal(&directory.join("one"), &out);
}

#[tokio::test]
async fn a_shard_that_is_asked_to_end_loses_no_work() {
    survives(Signal::TERM).await;
}

#[tokio::test]
async fn a_shard_that_is_killed_goes_on_in_shards_of_another_number() {
    survives(Signal::KILL).await;
}

#[tokio::test]
async fn two_arrays_at_once_run_each_point_once() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    write(directory, &study(4));
    succeed(directory, "one", &["--format", "npy"]).await;
    let shards = ["0/2", "1/2", "0/3", "1/3", "2/3", "0/1"];
    let started = shards.map(|shard| async move {
        run(directory, "out", &["--format", "npy", "--workers", "1", "--shard", shard]).await
    });
    for (ended, shard) in futures_util::future::join_all(started).await.iter().zip(shards) {
        assert_eq!(ended.code, Some(0), "{shard}: {ended:?}");
    }
    succeed(directory, "out", &["--merge"]).await;
    assert_equal(&directory.join("one"), &directory.join("out"));
    // No point was claimed twice: all processes lived, and each released what it had finished.
    let logs: Vec<String> = files(&directory.join("out/shards")).into_keys().collect();
    assert!(!logs.iter().any(|name| name.ends_with(".2.jsonl")), "{logs:?}");
}

#[tokio::test]
async fn a_study_without_a_seed_has_one_seed_in_all_shards() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let mut seedless = study(1);
    seedless.as_object_mut().unwrap().remove("seed");
    write(directory, &seedless);
    let shards =
        ["0/3", "1/3", "2/3"].map(|shard| async move { run(directory, "out", &["--shard", shard]).await });
    for ended in futures_util::future::join_all(shards).await {
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
    succeed(directory, "out", &["--merge"]).await;
    let stored: Value = serde_json::from_slice(&fs::read(directory.join("out/study.json")).unwrap()).unwrap();
    write(directory, &jobs::with(seedless, "/seed", stored["request"]["seed"].clone()));
    succeed(directory, "one", &[]).await;
    assert_eq!(runs(&directory.join("one")), runs(&directory.join("out")));
}

#[tokio::test]
async fn a_merge_says_what_is_missing_and_refuses_what_two_logs_tell_differently() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    write(directory, &study(2));
    let refused = run(directory, "out", &["--merge"]).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("no study in out"), "{refused:?}");
    succeed(directory, "out", &["--shard", "1/3"]).await;
    let unfinished = run(directory, "out", &["--merge"]).await;
    assert_eq!(unfinished.code, UNFINISHED, "{unfinished:?}");
    assert!(unfinished.stderr.contains("8 of 12 jobs are missing"), "{unfinished:?}");
    let out = directory.join("out");
    let waiting =
        rows_without_times(&out).iter().map(|row| row["waiting"].as_u64().unwrap()).collect::<Vec<_>>();
    assert_eq!(waiting.iter().sum::<u64>(), 8);
    for (point, waiting) in waiting.iter().enumerate() {
        assert_eq!(
            unfinished.stderr.contains(&format!("point {point}: 2 of 2")),
            *waiting == 2,
            "{unfinished:?}"
        );
    }
    succeed(directory, "out", &["--shard", "0/1"]).await;
    succeed(directory, "out", &["--merge"]).await;
    let whole = files(&out);

    // A second log of a point that tells the same is no fault; one that tells another digest is.
    let log = fs::read_to_string(out.join("shards/0.1.jsonl")).unwrap();
    fs::write(out.join("shards/0.2.jsonl"), &log).unwrap();
    succeed(directory, "out", &["--merge"]).await;
    assert!(whole == files(&out), "equal runs changed the table");
    let run_of = |line: &&str| serde_json::from_str::<Value>(line).unwrap().get("run").cloned();
    let record = log.lines().find_map(|line| run_of(&line)).unwrap();
    let digest = record["digest"].as_str().unwrap();
    let forged = format!("{:0>64}", "abc");
    let forged_log = log.replace(digest, &forged);
    let members = |line: &str| line.strip_prefix("{\"crc32\":\"").unwrap()[10..].to_owned();
    let forged_log: String = forged_log.lines().map(|line| summed(&members(line)) + "\n").collect();
    fs::write(out.join("shards/0.2.jsonl"), &forged_log).unwrap();
    let refused = run(directory, "out", &["--merge"]).await;
    assert_eq!(refused.code, Some(3), "{refused:?}");
    let run = format!("point 0, replicate {}, seed {}", record["replicate"], record["seed"]);
    for says in [run.as_str(), digest, &forged, "0.2.jsonl"] {
        assert!(refused.stderr.contains(says), "{says:?} is not in {}", refused.stderr);
    }
    assert!(whole == files(&out), "a refused merge changed a file");

    let mut other = study(2);
    other["replicates"] = json!(3);
    write(directory, &other);
    for args in [&["--merge"][..], &["--shard", "0/1"]] {
        let refused = run_args(directory, args).await;
        assert!(refused.stderr.contains("/replicates is 3 in the file and 2 in the folder"), "{refused:?}");
    }
}

async fn run_args(directory: &Path, args: &[&str]) -> Finished {
    run(directory, "out", args).await
}

#[tokio::test]
async fn stop_rules_hold_in_shards() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let unreachable = jobs::with(jobs::unreachable(), "/seed", Value::Null);
    let study = json!({
        "seed": 5, "template": unreachable, "grid": {"/mix/volume_fraction": [0.2, 0.5]}, "replicates": 6,
        "stop_when": {"failed_in_a_row": 2}
    });
    write(directory, &study);
    succeed(directory, "one", &["--workers", "1"]).await;
    for shard in ["1/2", "0/2"] {
        succeed(directory, "out", &["--workers", "1", "--shard", shard]).await;
    }
    // A point whose rule is met is not taken up.
    let again = succeed(directory, "out", &["--shard", "0/1"]).await;
    assert!(again.stdout.contains("8 runs ended, 0 left"), "{again:?}");
    succeed(directory, "out", &["--merge"]).await;
    let (one, out) = (directory.join("one"), directory.join("out"));
    assert_eq!(rows_without_times(&one), rows_without_times(&out));
    assert_eq!(runs(&one), runs(&out));
}

#[tokio::test]
async fn a_shard_that_does_not_exist_is_refused_with_the_range() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    write(directory, &study(1));
    let refused = run(directory, "out", &["--shard", "3/3"]).await;
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.stderr.contains("the 3 shards are 0 to 2"), "{refused:?}");
    assert!(!directory.join("out").exists());
    // More shards than points: the others have nothing to do.
    let idle = succeed(directory, "out", &["--shard", "7/8"]).await;
    assert!(idle.stdout.contains("shard 7/8 has no points: the study has 6"), "{idle:?}");
}

#[tokio::test]
async fn kills_at_many_moments_cost_time_only() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let mut study = study(4);
    study["template"] = jobs::with(jobs::quick_growth(0), "/seed", Value::Null);
    study["template"]["distance"] = json!({"type": "maximize"});
    study["template"]["method"]["stop"] = json!({"events": 200_000});
    study["grid"] = json!({"/mix/volume_fraction": [0.4, 0.45, 0.5]});
    write(directory, &study);
    succeed(directory, "one", &["--format", "npy"]).await;
    let args = ["study", "study.json", "--out", "out", "--format", "npy", "--workers", "1"];
    let mut claims = 0;
    // A machine that is busy needs the longer times until a process gets as far as a second claim.
    for ms in [10, 50, 150, 300, 500, 700, 1_000, 2_000, 4_000, 8_000, 16_000] {
        if claims > 3 && ms > 700 {
            break;
        }
        // Two arrays at once.
        let mut running = Vec::new();
        for shard in ["0/2", "1/2", "0/1"] {
            let more = ["--checkpoint-every-s", "0", "--shard", shard];
            running.push(Running::spawn(directory, &[&args[..], &more].concat()));
        }
        // The moment is what is tested.
        tokio::time::sleep(Duration::from_millis(ms)).await;
        for shard in running {
            shard.signal(Signal::KILL);
            shard.ended().await;
        }
        claims = files(&directory.join("out/shards")).keys().filter(|name| name.contains(".jsonl")).count();
    }
    assert!(claims > 3, "no claim of a killed process was taken over");
    for shard in ["1/3", "2/3", "0/3"] {
        succeed(directory, "out", &["--format", "npy", "--shard", shard]).await;
    }
    succeed(directory, "out", &["--merge"]).await;
    assert_equal(&directory.join("one"), &directory.join("out"));
    assert!(!directory.join("out/checkpoints").exists());
}
