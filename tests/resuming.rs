//! Commands that are killed at any moment: the same command ends with 0 and the same bytes, and leaves nothing else.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::{Running, jobs, packstone, run};

/// The files below a folder with their bytes; members that state times are left out of results in JSON.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(&inside).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let mut bytes = fs::read(&path).unwrap();
            if path.ends_with("result.json") {
                let mut result: Value = serde_json::from_slice(&bytes).unwrap();
                result.as_object_mut().unwrap().remove("timings_s");
                bytes = result.to_string().into_bytes();
            }
            found.insert(path.strip_prefix(folder).unwrap().to_owned(), bytes);
        }
    }
    found
}

/// Runs a command and kills it after a time; whether it had ended before.
async fn killed_after(folder: &Path, args: &[&str], time: Duration) -> bool {
    let running = Running::spawn(folder, args);
    tokio::time::sleep(time).await;
    running.signal(Signal::KILL);
    running.ended().await.code.is_some()
}

/// Kills a command at so many moments from its start to its end, and runs it again in the same folder each time.
async fn survives_kills(folder: &Path, args: &[&str], moments: u32, compare: impl Fn(&Path)) {
    let begin = std::time::Instant::now();
    let whole = packstone(folder, args).await;
    assert_eq!(whole.code, Some(0), "{whole:?}");
    // Other tests may have made this run slow: the shortest run that was seen is the measure.
    let mut took = begin.elapsed();
    let out = folder.join("out");
    let expected = folder.join("expected");
    fs::rename(&out, &expected).unwrap();
    let mut killed = 0;
    for moment in 1..=moments {
        let until = took * moment / moments;
        if killed_after(folder, args, until).await {
            took = took.min(until);
        } else {
            killed += 1;
        }
        let resumed = packstone(folder, args).await;
        assert_eq!(resumed.code, Some(0), "killed after {moment} of {moments}: {resumed:?}");
        compare(&out);
        fs::remove_dir_all(&out).unwrap();
    }
    assert!(killed > moments / 3, "{killed} of {moments} were killed");
}

#[tokio::test]
async fn a_run_that_is_killed_at_any_moment_is_resumed_by_the_same_command() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), jobs::quick(3).to_string()).unwrap();
    for (formats, moments) in [("json,csv,npy", 12), ("csv", 6)] {
        let exports = ["--export", "mesh", "--export", "voxels:format=raw,cells=80", "--plot", "grading"];
        let run =
            [&["run", "job.json", "--out", "out", "--resume", "--format", formats][..], &exports].concat();
        survives_kills(folder, &run, moments, |out| {
            assert!(files(out) == files(&folder.join("expected")), "{:?}", files(out).keys());
        })
        .await;
        fs::remove_dir_all(folder.join("expected")).unwrap();
    }
}

/// The moment of each file, which a clock cannot meet: a folder in the place of the file stops the command there.
#[tokio::test]
async fn a_run_that_is_stopped_between_two_files_goes_on_with_its_seed() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let mut job = jobs::quick(3);
    job.as_object_mut().unwrap().remove("seed");
    fs::write(folder.join("job.json"), job.to_string()).unwrap();
    let run = [
        "run",
        "job.json",
        "--out",
        "out",
        "--resume",
        "--format",
        "npy,csv",
        "--export",
        "slice:format=json",
    ];
    let out = folder.join("out");
    fs::create_dir(&out).unwrap();
    // Every write to this device fails as on a full disk.
    std::os::unix::fs::symlink("/dev/full", out.join("result.csv.tmp")).unwrap();
    let stopped = packstone(folder, &run).await;
    assert_eq!(stopped.code, Some(6), "{stopped:?}");
    let first = fs::read(out.join("result.npy")).unwrap();
    assert!(!out.join("result.csv").exists());
    let without =
        packstone(folder, &run.map(|arg| if arg == "--resume" { "--no-plot-titles" } else { arg })).await;
    assert!(without.code == Some(3) && without.stderr.contains("--resume"), "{without:?}");
    let mut other = job.clone();
    other["mix"]["volume_fraction"] = json!(0.2);
    fs::write(folder.join("job.json"), other.to_string()).unwrap();
    let refused = packstone(folder, &run).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("another job"), "{refused:?}");
    fs::write(folder.join("job.json"), job.to_string()).unwrap();
    let resumed = packstone(folder, &run).await;
    assert_eq!(resumed.code, Some(0), "{resumed:?}");
    assert!(fs::read(out.join("result.npy")).unwrap() == first, "the seed that was drawn is kept");
    let names: Vec<PathBuf> = files(&out).into_keys().collect();
    let expected = ["result.csv", "result.npy", "result.slice.json", "result.slice.json.report.json"];
    assert_eq!(names, expected.map(PathBuf::from));
    // Complete: the same command has nothing to do. A table of somebody else is not taken for that of the job.
    fs::write(folder.join("job.json"), jobs::quick(3).to_string()).unwrap();
    fs::write(out.join("result.csv"), "mine").unwrap();
    let foreign = packstone(folder, &run).await;
    assert!(foreign.code == Some(3) && foreign.stderr.contains("result.npy"), "{foreign:?}");
    assert_eq!(fs::read(out.join("result.csv")).unwrap(), b"mine");
}

/// Each format alone: those that state their request, and tables, which are compared.
#[tokio::test]
async fn a_complete_result_of_any_format_is_left_as_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), jobs::quick(3).to_string()).unwrap();
    fs::write(folder.join("other.json"), jobs::quick(4).to_string()).unwrap();
    for format in ["json", "csv", "npy", "vtp", "vtk", "view", "html"] {
        let run = |job| ["run", job, "--out", format, "--resume", "--format", format];
        let (first, out) = (packstone(folder, &run("job.json")).await, folder.join(format));
        assert_eq!(first.code, Some(0), "{format}: {first:?}");
        let file = out.join(format!("result.{format}"));
        let bytes = fs::read(&file).unwrap();
        let again = packstone(folder, &run("job.json")).await;
        assert_eq!(again.code, Some(0), "{format}: {again:?}");
        assert!(fs::read(&file).unwrap() == bytes && files(&out).len() == 1, "{format}");
        let other = packstone(folder, &run("other.json")).await;
        assert_eq!(other.code, Some(3), "{format}: {other:?}");
        // A file that is cut is no complete result.
        fs::write(&file, &bytes[..bytes.len() - 3]).unwrap();
        let cut = packstone(folder, &run("job.json")).await;
        assert_eq!(cut.code, Some(3), "{format}: {cut:?}");
    }
}

#[tokio::test]
async fn exports_that_are_killed_at_any_moment_are_made_by_the_same_command() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), jobs::quick(3).to_string()).unwrap();
    assert_eq!(packstone(folder, &["run", "job.json", "--out", "run"]).await.code, Some(0));
    let export = ["export", "run/result.json", "mesh", "slice", "voxels:format=raw,cells=80", "--out", "out"];
    // A command that had ended is refused: no command overwrites what is complete.
    let begin = std::time::Instant::now();
    assert_eq!(packstone(folder, &export).await.code, Some(0));
    let took = begin.elapsed();
    let (out, expected) = (folder.join("out"), folder.join("expected"));
    fs::rename(&out, &expected).unwrap();
    for moment in 1..10 {
        if !killed_after(folder, &export, took * moment / 10).await {
            let again = packstone(folder, &export).await;
            // It may have been killed when all files were complete: they are not overwritten, and compared below.
            let is_refused = again.code == Some(3) && again.stderr.contains("these files exist");
            assert!(again.code == Some(0) || is_refused && files(&out) == files(&expected), "{again:?}");
        }
        assert!(files(&out) == files(&expected), "{:?}", files(&out).keys());
        fs::remove_dir_all(&out).unwrap();
    }
}

/// A study whose runs are long enough for checkpoints.
fn growing_study() -> Value {
    let template = json!({
        "specimen": {"type": "box", "size_mm": [30, 30, 30]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4}, "volume_fraction": 0.55},
        "method": {"type": "edmd"}
    });
    json!({"seed": 5, "replicates": 3, "template": template, "grid": {"/mix/volume_fraction": [0.5, 0.55]}})
}

#[tokio::test]
async fn a_study_that_is_killed_at_any_moment_is_resumed_by_the_same_command() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("study.json"), growing_study().to_string()).unwrap();
    let study = ["study", "study.json", "--out", "out", "--resume", "--format", "npy", "--workers", "2"];
    let study = [&study[..], &["--checkpoint-every-s", "0"]].concat();
    let names = |out: &Path| files(out).into_keys().collect::<Vec<_>>();
    survives_kills(folder, &study, 12, |out| {
        let expected = folder.join("expected");
        assert_eq!(names(out), names(&expected));
        for (file, bytes) in files(out).iter().filter(|(file, _)| file.starts_with("results")) {
            assert!(fs::read(expected.join(file)).unwrap() == *bytes, "{}", file.display());
        }
        assert!(!out.join("checkpoints").exists());
    })
    .await;
}

#[tokio::test]
async fn shards_that_are_killed_at_any_moment_are_run_and_merged_by_the_same_commands() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("study.json"), growing_study().to_string()).unwrap();
    let run = [
        "study",
        "study.json",
        "--out",
        "out",
        "--shard",
        "0/1",
        "--format",
        "npy",
        "--checkpoint-every-s",
        "0",
    ];
    let merge = ["study", "study.json", "--out", "out", "--merge"];
    let all = async || {
        for args in [&run[..], &merge] {
            let ended = packstone(folder, args).await;
            assert_eq!(ended.code, Some(0), "{ended:?}");
        }
    };
    let begin = std::time::Instant::now();
    all().await;
    let took = begin.elapsed();
    let (out, expected) = (folder.join("out"), folder.join("expected"));
    fs::rename(&out, &expected).unwrap();
    // But for the logs, of which each process that claims a point makes one.
    let names = |out: &Path| {
        let names = files(out).into_keys().map(|name| name.display().to_string());
        names.filter(|name| !(name.starts_with("shards/") && name.contains(".jsonl"))).collect::<Vec<_>>()
    };
    for moment in 1..8 {
        killed_after(folder, &run, took * moment / 8).await;
        killed_after(folder, &run, took * moment / 16).await;
        let ended = packstone(folder, &run).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        killed_after(folder, &merge, Duration::from_millis(u64::from(moment) * 8)).await;
        all().await;
        assert_eq!(names(&out), names(&expected));
        assert!(!out.join("checkpoints").exists());
        fs::remove_dir_all(&out).unwrap();
    }
}

#[tokio::test]
async fn a_study_that_was_killed_before_it_was_recorded_starts_anew() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("study.json"), json!({"list": [jobs::quick(1)]}).to_string()).unwrap();
    let study = ["study", "study.json", "--out", "out", "--resume"];
    fs::create_dir(folder.join("out")).unwrap();
    fs::write(folder.join("out/runs.jsonl"), "").unwrap();
    fs::write(folder.join("out/study.json.tmp"), "{\"eng").unwrap();
    let ended = packstone(folder, &study).await;
    assert!(ended.code == Some(0) && ended.stderr.contains("starts anew"), "{ended:?}");
    let shard = ["study", "study.json", "--out", "out2", "--shard", "0/1"];
    fs::create_dir_all(folder.join("out2/shards")).unwrap();
    fs::write(folder.join("out2/shards/018f.tmp"), "{\"eng").unwrap();
    assert_eq!(packstone(folder, &shard).await.code, Some(0));
    let merged = packstone(folder, &["study", "study.json", "--out", "out2", "--merge"]).await;
    assert_eq!(merged.code, Some(0), "{merged:?}");
    for out in ["out", "out2"] {
        let names = files(&folder.join(out)).into_keys();
        assert!(names.into_iter().all(|name| name.extension().is_none_or(|ending| ending != "tmp")), "{out}");
    }
}

#[tokio::test]
async fn a_file_without_end_is_read_to_a_bound() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let pipe = folder.join("pipe");
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    for command in ["run", "plan", "study"] {
        let args =
            [&[command, "/dev/zero"][..], if command == "plan" { &[] } else { &["--out", "out"] }].concat();
        let ended = packstone(folder, &args).await;
        assert!(ended.code == Some(3) && ended.stderr.contains("16777216"), "{command}: {ended:?}");
        let running =
            Running::spawn(folder, &[&args[..1], &["pipe", "--max-body-bytes", "1000"], &args[2..]].concat());
        let path = pipe.clone();
        let written = tokio::task::spawn_blocking(move || {
            use std::io::Write as _;
            let mut pipe = fs::File::options().write(true).open(path).unwrap();
            // The reader leaves: `BrokenPipe` ends it.
            while pipe.write_all(&[b' '; 512]).is_ok() {}
        });
        let ended = running.ended().await;
        assert!(
            ended.code == Some(3) && ended.stderr.contains("more than 1000 bytes"),
            "{command}: {ended:?}"
        );
        written.await.unwrap();
    }
}

#[tokio::test]
async fn a_request_is_read_in_utf_8_with_and_without_a_mark_and_other_encodings_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let job = jobs::with(jobs::quick(4), "/name", json!("Würfel Ø50")).to_string();
    let utf16 = job.encode_utf16().flat_map(u16::to_le_bytes);
    let latin: Vec<u8> = job.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    for (name, text, says) in [
        ("marked", format!("\u{feff}{job}").into_bytes(), None),
        ("utf16", [0xFF, 0xFE].into_iter().chain(utf16).collect(), Some("UTF-16 (little-endian)")),
        ("latin", latin, Some("Latin-1")),
    ] {
        let file = format!("{name}.json");
        fs::write(folder.join(&file), text).unwrap();
        let ended = packstone(folder, &["run", &file, "--out", name]).await;
        match says {
            None => assert_eq!(ended.code, Some(0), "{ended:?}"),
            Some(says) => assert!(ended.code == Some(3) && ended.stderr.contains(says), "{ended:?}"),
        }
    }
    let result = fs::read(folder.join("marked/result.json")).unwrap();
    fs::write(folder.join("edited.json"), [b"\xEF\xBB\xBF", &result[..]].concat()).unwrap();
    let ended = packstone(folder, &["export", "edited.json", "slice", "--out", "slice"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

/// A command of the shell in a folder, with the binary under test as `packstone`.
async fn shell(folder: &Path, script: &str) -> crate::harness::Finished {
    let mut command = Command::new("bash");
    let binaries = Path::new(env!("CARGO_BIN_EXE_packstone")).parent().unwrap().display().to_string();
    let path = format!("{binaries}:{}", std::env::var("PATH").unwrap());
    command.args(["-c", script]).current_dir(folder).env("PATH", path);
    run(command).await
}

#[tokio::test]
async fn streams_that_are_closed_full_or_unread_do_not_stop_a_command() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    // The job warns, so that there is something to say.
    fs::write(folder.join("job.json"), jobs::quick(3).to_string()).unwrap();
    fs::write(folder.join("study.json"), json!({"list": [jobs::quick(1)]}).to_string()).unwrap();
    let mut n = 0;
    for streams in
        [">&- 2>&-", "2>&-", ">&-", "2>/dev/full", ">/dev/null 2>/dev/full", "2> >(exit)", "> >(exit) 2>&1"]
    {
        for command in ["run job.json --format json,csv --export slice", "study study.json"] {
            n += 1;
            // The reader has left once the command begins.
            let script = format!("exec packstone {command} --out {n} {streams} < <(sleep 0.2)");
            let ended = shell(folder, &script).await;
            assert_eq!(ended.code, Some(0), "{script}: {ended:?}");
            let last = if command.starts_with("run") { "result.slice.svg" } else { "table.csv" };
            assert!(folder.join(n.to_string()).join(last).exists(), "{script}");
            assert!(!folder.join(format!("{n}/result.json.unfinished")).exists(), "{script}");
        }
    }
    // What nobody could read is not made: a key.
    let ended = shell(folder, "packstone key lab --add-to keys >/dev/full").await;
    assert_eq!(ended.code, Some(6), "{ended:?}");
    assert_eq!(fs::read_to_string(folder.join("keys")).unwrap_or_default(), "");
    for command in ["key lab --add-to keys >&-", "key lab >&-", "webhook-secret >&-"] {
        let ended = shell(folder, &format!("packstone {command}")).await;
        assert_eq!(ended.code, Some(6), "{ended:?}");
        assert!(ended.stderr.contains("standard output is closed"), "{ended:?}");
        assert_eq!(fs::read_to_string(folder.join("keys")).unwrap_or_default(), "");
    }
    // Who throws it away in so many words has decided it.
    let ended = shell(folder, "packstone key lab --add-to keys >/dev/null").await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let ended = shell(folder, "packstone plan job.json >/dev/full").await;
    assert_eq!(ended.code, Some(6), "{ended:?}");
}
