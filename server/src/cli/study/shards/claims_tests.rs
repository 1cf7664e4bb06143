use packstone_engine::Limits;
use serde_json::json;

use super::super::files::{merge_staging, publish, tidy};
use super::*;
use crate::studies::Facts;

fn study() -> Study {
    let request = json!({
        "seed": 1, "replicates": 2,
        "template": {
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        },
        "grid": {"/mix/volume_fraction": [0.1, 0.2]}
    });
    Study::read(&request, 1, None, &Limits::default()).unwrap()
}

fn run(study: &Study, point: usize, replicate: usize, outcome: Outcome) -> RunRecord {
    let seed = study.points[point].seeds[replicate];
    let digest = Some("00".into());
    RunRecord { point, replicate, seed, outcome, facts: Facts::default(), digest, distance_curve: Vec::new() }
}

fn claims<'a>(out: &Path, study: &'a Study) -> Claims<'a> {
    Claims::open(out, study, &[], DEAD_AFTER).unwrap()
}

/// A process of another machine.
fn elsewhere() -> Process {
    let text = json!({"name": "there", "host": "node7", "pid": 4, "machine": "another", "started": 5});
    serde_json::from_value(text).unwrap()
}

fn claimed_elsewhere(out: &Path, point: usize) {
    let line = summed_lines::line(&Line::Claim(elsewhere())).unwrap();
    fs::create_dir_all(out.join(FOLDER)).unwrap();
    fs::write(log_path(&out.join(FOLDER), point, 1), line).unwrap();
}

#[test]
fn a_point_is_held_until_it_is_released_and_then_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    let (first, second) = (claims(directory.path(), &study), claims(directory.path(), &study));
    assert_eq!(first.claim(0).unwrap(), Claimed::Held(Vec::new()));
    let Claimed::Taken(by) = second.claim(0).unwrap() else { panic!("it is taken") };
    assert_eq!(by, first.process.to_string());
    assert_eq!(second.claim(1).unwrap(), Claimed::Held(Vec::new()));
    // A void run is repeated.
    first.add(&run(&study, 0, 0, Outcome::Void)).unwrap();
    first.add(&run(&study, 0, 1, Outcome::Succeeded)).unwrap();
    first.close().unwrap();
    assert!(first.add(&run(&study, 0, 0, Outcome::Succeeded)).is_err(), "it is not held");
    let known = run(&study, 0, 1, Outcome::Succeeded);
    assert_eq!(second.claim(0).unwrap(), Claimed::Held(vec![known.clone()]));
    assert_eq!(second.generation(0), Some(2));
    let other = run(&study, 0, 0, Outcome::TargetNotReached);
    second.add(&other).unwrap();
    second.close().unwrap();
    // In the order in which they ended.
    assert_eq!(claims(directory.path(), &study).claim(0).unwrap(), Claimed::Finished(vec![known, other]));
}

#[test]
fn one_of_many_claims_of_a_point_succeeds() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    for _ in 0..20 {
        let held = std::thread::scope(|scope| {
            let claim = || matches!(claims(directory.path(), &study).claim(0), Ok(Claimed::Held(_)));
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(claim)).collect();
            threads.into_iter().filter_map(|thread| thread.join().unwrap().then_some(())).count()
        });
        assert_eq!(held, 1);
        fs::remove_dir_all(directory.path().join(FOLDER)).unwrap();
    }
}

#[test]
fn a_process_elsewhere_is_dead_when_it_gives_no_sign_of_life() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    claimed_elsewhere(directory.path(), 0);
    let beat = directory.path().join(FOLDER).join("there.beat");
    fs::write(&beat, "..").unwrap();
    let claims = Claims::open(directory.path(), &study, &[], Duration::from_millis(50)).unwrap();
    assert_eq!(claims.claim(0).unwrap(), Claimed::Unknown);
    fs::write(&beat, "...").unwrap();
    assert_eq!(claims.claim(0).unwrap(), Claimed::Taken("process 4 on node7".into()));
    // The time is what is tested.
    std::thread::sleep(Duration::from_millis(60));
    assert_eq!(claims.claim(0).unwrap(), Claimed::Held(Vec::new()));
    assert_eq!(claims.generation(0), Some(2));
}

#[test]
fn a_process_that_died_before_it_gave_its_name_is_taken_over() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    fs::create_dir_all(directory.path().join(FOLDER)).unwrap();
    fs::write(log_path(&directory.path().join(FOLDER), 1, 1), "{\"claim\":{\"na").unwrap();
    let claims = Claims::open(directory.path(), &study, &[], Duration::ZERO).unwrap();
    assert_eq!(claims.claim(1).unwrap(), Claimed::Held(Vec::new()));
    let patient = Claims::open(directory.path(), &study, &[], DEAD_AFTER).unwrap();
    assert!(matches!(patient.claim(1).unwrap(), Claimed::Taken(_)));
}

#[test]
fn a_point_that_was_taken_over_is_told_of() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    let claims = claims(directory.path(), &study);
    claims.claim(0).unwrap();
    claims.claim(1).unwrap();
    fs::write(log_path(&claims.folder, 1, 2), "").unwrap();
    *lock(&claims.beaten) = None;
    assert_eq!(claims.beat(), [1]);
    assert_eq!(claims.beat(), [0_usize; 0], "none is due");
}

#[test]
fn runs_without_shards_count_and_damage_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    let earlier = [run(&study, 0, 0, Outcome::Succeeded), run(&study, 0, 1, Outcome::Succeeded)];
    let claims = Claims::open(directory.path(), &study, &earlier, DEAD_AFTER).unwrap();
    assert_eq!(claims.claim(0).unwrap(), Claimed::Finished(earlier.to_vec()));
    let mut foreign = run(&study, 1, 0, Outcome::Succeeded);
    foreign.seed += 1;
    for line in [Line::Run(foreign), Line::Run(earlier[0].clone())] {
        let line = summed_lines::line(&line).unwrap();
        fs::write(log_path(&claims.folder, 1, 1), format!("\n{line}")).unwrap();
        let error = claims.claim(1).unwrap_err();
        assert!(error.to_string().contains("1.1.jsonl: line 2: the study has no such run"), "{error}");
        assert_eq!(error.kind(), ErrorKind::InvalidData);
    }
}

#[test]
fn files_are_moved_whole_and_leave_no_folder() {
    let directory = tempfile::tempdir().unwrap();
    let study = study();
    let claims = claims(directory.path(), &study);
    let abandoned = claims.staging(0, 1, 1).unwrap();
    fs::write(abandoned.join("0-1.npy"), "half").unwrap();
    let staging = claims.staging(0, 1, 2).unwrap();
    assert!(abandoned.exists(), "its process may live");
    fs::write(staging.join("0-1.npy"), "whole").unwrap();
    let results = directory.path().join("results");
    publish(&staging, &results).unwrap();
    assert_eq!(fs::read(results.join("0-1.npy")).unwrap(), b"whole");
    assert!(!staging.exists());
    // Without files there is no folder of results.
    publish(&claims.staging(1, 0, 1).unwrap(), &directory.path().join("none")).unwrap();
    assert!(!directory.path().join("none").exists());

    claims.claim(0).unwrap();
    let merge = merge_staging(directory.path()).unwrap();
    tidy(directory.path()).unwrap();
    assert!(!abandoned.exists() && merge.exists());
    let left = fs::read_dir(directory.path().join(FOLDER)).unwrap().count();
    assert_eq!(left, 2, "the log and the folder of the merge");
}
