//! `packstone study --slurm-script`: the script by itself, and on a Slurm that the test starts.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};

use crate::harness::deadline::{eventually, within};
use crate::harness::{DataDir, Finished, Launch, Slurm, id_of, jobs, packstone, run};

/// Three points, one of them of some seconds.
fn study() -> Value {
    let template = jobs::with(jobs::contract(), "/seed", Value::Null);
    json!({
        "name": "three points", "seed": 3, "template": template,
        "grid": {"/mix/volume_fraction": [0.3, 0.54, 0.35]}
    })
}

/// A folder whose name a shell would take apart, with a study in it.
fn folder(directory: &Path, study: &Value) -> PathBuf {
    let folder = directory.join("it's a $HOME; of \"studies\"");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("study.json"), study.to_string()).unwrap();
    folder
}

/// Writes the script of a study in a folder.
async fn script(folder: &Path, more: &[&str]) -> String {
    let args = ["study", "study.json", "--out", "out", "--format", "npy", "--slurm-script"];
    let ended = packstone(folder, &[&args[..], more].concat()).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    fs::write(folder.join("study.sh"), &ended.stdout).unwrap();
    ended.stdout
}

/// Runs the script as Slurm would, in another folder.
async fn bash(script: &Path, args: &[&str], variables: &[(&str, &str)]) -> Finished {
    let mut command = Command::new("bash");
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("SLURM_")) {
        command.env_remove(name);
    }
    command.arg(script).args(args).envs(variables.iter().copied()).current_dir("/");
    run(command).await
}

/// The files of the packings, and what the runs came to but for times.
fn results(out: &Path) -> (BTreeMap<String, Vec<u8>>, Vec<Value>) {
    let entries = fs::read_dir(out.join("results")).unwrap().map(Result::unwrap);
    let files =
        entries.map(|e| (e.file_name().into_string().unwrap(), fs::read(e.path()).unwrap())).collect();
    let table: Value = serde_json::from_slice(&fs::read(out.join("table.json")).unwrap()).unwrap();
    let mut rows = table["rows"].as_array().unwrap().clone();
    for row in &mut rows {
        let columns = row.as_object_mut().unwrap();
        columns.retain(|column, _| !column.contains("time_s") && column != "event_us_median");
    }
    (files, rows)
}

async fn on_one_machine(folder: &Path) -> (BTreeMap<String, Vec<u8>>, Vec<Value>) {
    let ended = packstone(folder, &["study", "study.json", "--out", "one", "--format", "npy"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    results(&folder.join("one"))
}

#[tokio::test]
async fn the_script_runs_shards_and_merge_without_a_slurm() {
    let directory = tempfile::tempdir().unwrap();
    let quick = jobs::with(study(), "/grid", json!({"/mix/volume_fraction": [0.2, 0.3]}));
    let folder = folder(directory.path(), &quick);
    let text = script(&folder, &["2", "--workers", "3"]).await;
    for line in ["#SBATCH --array=0-1", "#SBATCH --cpus-per-task=3", "#SBATCH --signal=B:TERM@120"] {
        assert!(text.lines().any(|of| of == line), "{line} is not in {text}");
    }
    assert!(text.lines().any(|line| line.starts_with("#SBATCH --time=00:")), "{text}");
    let file = folder.join("study.sh");
    let mut check = Command::new("bash");
    check.arg("-n").arg(&file);
    let checked = run(check).await;
    assert_eq!((checked.code, checked.stderr.as_str()), (Some(0), ""), "{text}");

    let task = |id: &'static str| [("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_COUNT", "2")];
    for id in ["0", "1"] {
        let ended = bash(&file, &[], &task(id)).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
    // An array that counts from 1.
    let refused = bash(&file, &[], &task("2")).await;
    assert!(refused.code == Some(2) && refused.stderr.contains("--array=0-1"), "{refused:?}");
    let merged =
        bash(&file, &["merge"], &[("SLURM_ARRAY_TASK_ID", "0"), ("SLURM_ARRAY_TASK_COUNT", "1")]).await;
    assert_eq!(merged.code, Some(0), "{merged:?}");
    assert_eq!(results(&folder.join("out")), on_one_machine(&folder).await);

    // Outside of a job it submits both; options go to both.
    let bin = folder.join("bin");
    fs::create_dir(&bin).unwrap();
    let log = folder.join("calls");
    let sbatch = "#!/bin/bash\nprintf '%s\\n' \"$*\" >>\"$CALLS\"\necho \"$(wc -l <\"$CALLS\");cluster\"\n";
    fs::write(bin.join("sbatch"), sbatch).unwrap();
    fs::set_permissions(bin.join("sbatch"), fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let variables = [("PATH", path.as_str()), ("CALLS", log.to_str().unwrap())];
    let ended = bash(&file, &["--partition=long"], &variables).await;
    assert_eq!((ended.code, ended.stdout.as_str()), (Some(0), "array 1, then merge 2\n"), "{ended:?}");
    let script = file.display();
    assert_eq!(
        fs::read_to_string(&log).unwrap(),
        format!(
            "--parsable --partition=long {script}\n--parsable --partition=long --array=0 --cpus-per-task=1 \
             --time=00:10:00 --dependency=afterany:1 {script} merge\n"
        )
    );
}

#[tokio::test]
async fn a_script_that_could_not_work_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let folder = folder(directory.path(), &study());
    for (args, code, says) in [
        (["study.json", "--slurm-script", "4"], 3, "the study has 3 points"),
        (["study.json", "--slurm-script", "0"], 3, "1 to 3 are possible"),
        (["study.json", "--slurm-script", "ten"], 2, "a number of tasks, or auto"),
        (["study.json", "--slurm-script", "--merge"], 2, "cannot be used with"),
        (["-", "--slurm-script", "auto"], 3, "the file of the study"),
    ] {
        let ended = packstone(&folder, &[&["study", "--out", "out"], &args[..]].concat()).await;
        assert_eq!(ended.code, Some(code), "{args:?}: {ended:?}");
        assert!(ended.stderr.contains(says), "{says:?} is not in {}", ended.stderr);
    }
    assert!(!folder.join("out").exists());
}

/// What a job printed.
fn output(folder: &Path, job: &str) -> String {
    fs::read_to_string(folder.join(format!("slurm-{job}.out"))).unwrap_or_default()
}

/// Submits array and merge, and returns their numbers.
async fn submit(slurm: &Slurm, folder: &Path, options: &[&str]) -> (String, String) {
    let ended = slurm.run(folder, "bash", &[&["study.sh"], options].concat()).await;
    let numbers =
        ended.stdout.trim().strip_prefix("array ").and_then(|rest| rest.split_once(", then merge "));
    let (array, merge) = numbers.unwrap_or_else(|| panic!("{ended:?}"));
    (array.to_owned(), merge.to_owned())
}

#[tokio::test]
async fn an_array_that_is_cut_goes_on_in_another_and_is_merged() {
    let Some(slurm) = Slurm::start().await else { return };
    let directory = tempfile::tempdir().unwrap();
    let folder = folder(directory.path(), &study());
    script(&folder, &["3", "--workers", "1", "--checkpoint-every-s", "0"]).await;
    let (array, merge) = submit(&slurm, &folder, &[]).await;
    let out = folder.join("out");
    let checkpoint = out.join("checkpoints/1-0.1.checkpoint");
    eventually("a checkpoint of the long point", || checkpoint.exists()).await;
    // What Slurm does before the time limit.
    let task = format!("{array}_0");
    let cut = slurm.run(&folder, "scancel", &["--batch", "--signal=TERM", &task]).await;
    assert_eq!(cut.code, Some(0), "{cut:?}");
    eventually("the array and its merge to end", || slurm.queue().is_empty()).await;
    let said = output(&folder, &task);
    assert!(said.contains("shard 0/3 was stopped on request"), "{said}");
    let said = output(&folder, &format!("{merge}_0"));
    assert!(said.contains("the study is unfinished, 1 of 3 jobs are missing"), "{said}");
    assert!(checkpoint.exists());

    let (_, merge) = submit(&slurm, &folder, &["--array=0-1"]).await;
    eventually("the second array and its merge to end", || slurm.queue().is_empty()).await;
    let said = output(&folder, &format!("{merge}_0"));
    assert!(said.contains("table.csv") && !said.contains("unfinished"), "{said}");
    assert!(!checkpoint.exists());
    assert_eq!(results(&out), on_one_machine(&folder).await);
}

/// The script that is installed, with one core for each worker.
#[tokio::test]
async fn pilots_pack_the_jobs_of_a_server_and_hand_them_on() {
    let Some(slurm) = Slurm::start().await else { return };
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let made = packstone(folder.path(), &["key", "pilots", "--role", "worker"]).await;
    let admin = packstone(folder.path(), &["key", "root", "--role", "admin"]).await;
    let (key, line) = made.stdout.trim().split_once('\n').unwrap();
    let (admin, admin_line) = admin.stdout.trim().split_once('\n').unwrap();
    fs::write(folder.path().join("worker.key"), key).unwrap();
    fs::write(folder.path().join("keys"), format!("{line}\n{admin_line}\n")).unwrap();
    let keys = folder.path().join("keys").display().to_string();
    let server = Launch::new(&data_dir).workers(0).env("PACKSTONE_API_KEYS_FILE", &keys).start().await;
    let client = server.client().with_key(admin);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../packaging/slurm-workers.sh");
    let array = async |width: &str| {
        let mut command = slurm.command("sbatch");
        command.args(["--parsable", "--cpus-per-task=1", "--mem-per-cpu=0", "--time=5", width, script]);
        command.current_dir(folder.path());
        command.env("PACKSTONE", env!("CARGO_BIN_EXE_packstone"));
        command.env("PACKSTONE_SERVER", format!("http://{}", server.address()));
        command.env("PACKSTONE_KEY_FILE", folder.path().join("worker.key"));
        command.env("PACKSTONE_CHECKPOINT_EVERY_S", "0.2").env("PACKSTONE_IDLE_EXIT_S", "1");
        let submitted = run(command).await;
        assert_eq!(submitted.code, Some(0), "{submitted:?}");
        submitted.stdout.trim().to_owned()
    };
    // Some seconds more than growth takes in the smaller cube.
    let long = jobs::with(jobs::contract(), "/specimen/size_mm", json!([110, 110, 110]));
    let submitted = client.submit(&long).await;
    let id = id_of(&submitted);
    let first = array("--array=0").await;
    client.job_when(id, "growing", |job| job["progress"]["step"] == "edmd").await;
    let named = client.job(id).await["worker"].clone();
    assert!(named.as_str().unwrap().contains(&format!("(Slurm job {first}_0)")), "{named}");
    // What Slurm does before the time limit.
    let cut = slurm.run(folder.path(), "scancel", &["--batch", "--signal=TERM", &format!("{first}_0")]).await;
    assert_eq!(cut.code, Some(0), "{cut:?}");
    eventually("the first pilot to end", || slurm.queue().is_empty()).await;
    assert_eq!(client.job(id).await["state"], "queued");
    for seed in 0..4 {
        client.submit(&jobs::quick(seed)).await;
    }
    let second = array("--array=0-1").await;
    let done = client.finished(id).await;
    assert_eq!((&done["state"], &done["attempt"]), (&json!("succeeded"), &json!(2)), "{done:#}");
    eventually("the second pilots to end", || slurm.queue().is_empty()).await;
    let logs: String = (0..2)
        .map(|task| {
            fs::read_to_string(folder.path().join(format!("packstone-worker-{second}_{task}.log"))).unwrap()
        })
        .collect();
    assert!(logs.contains("going on from a checkpoint"), "{logs}");
    let listed = client.get("/v1/jobs?state=succeeded").send().await.expect(200).json();
    assert_eq!(listed["items"].as_array().unwrap().len(), 5);
    server.stop().await;
}

/// The time limit of Slurm itself, of which the shortest is a minute.
#[tokio::test]
#[ignore = "takes some minutes"]
async fn arrays_that_the_time_limit_cuts_end_with_the_bits_of_one_machine() {
    const PATIENCE: Duration = Duration::from_mins(10);
    let slurm = Slurm::start().await.expect("this test needs a Slurm");
    let directory = tempfile::tempdir().unwrap();
    let mut long = study();
    long["template"]["specimen"]["size_mm"] = json!([150, 150, 150]);
    long["template"]["distance"] = json!({"type": "maximize"});
    long["template"]["method"]["stop"] = json!({"events": 60_000_000});
    long["grid"] = json!({"/mix/volume_fraction": [0.5, 0.52]});
    let folder = folder(directory.path(), &long);
    // No checkpoint but the last one.
    script(&folder, &["2", "--workers", "1", "--checkpoint-every-s", "86400"]).await;
    let mut arrays = 0;
    loop {
        let (_, merge) = submit(&slurm, &folder, &["--time=1", "--signal=B:TERM@30"]).await;
        arrays += 1;
        within(PATIENCE, "an array and its merge", async {
            let mut look_again = tokio::time::interval(Duration::from_secs(1));
            while !slurm.queue().is_empty() {
                look_again.tick().await;
            }
        })
        .await;
        let said = output(&folder, &format!("{merge}_0"));
        if !said.contains("unfinished") {
            break;
        }
        assert_eq!(fs::read_dir(folder.join("out/checkpoints")).unwrap().count(), 2, "{said}");
        assert!(arrays < 30, "{said}");
    }
    assert!(arrays > 1, "nothing was cut");
    let one = within(PATIENCE, "one machine", async {
        let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
        command.args(["study", "study.json", "--out", "one", "--format", "npy"]).current_dir(&folder);
        let ended = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
        assert!(ended.status.success(), "{ended:?}");
        results(&folder.join("one"))
    })
    .await;
    assert_eq!(results(&folder.join("out")), one);
    println!("{arrays} arrays");
}
