//! What every storage of blobs must do: one suite for files of this process, shared folders and buckets.

#![allow(clippy::unwrap_used)]

#[allow(dead_code, unreachable_pub)]
#[path = "../../../tests/harness/bucket.rs"]
mod bucket;
#[allow(dead_code, unreachable_pub)]
#[path = "../../../tests/harness/machine.rs"]
mod machine;

use std::io::{self, Read as _, Write as _};
use std::path::Path;
use std::sync::{Arc, Barrier};
use std::time::Duration;

use super::{Blobs, Files, PARTIAL};

/// Longer than what goes to a bucket in one piece.
const LONG: usize = (17 << 20) + 5;

fn put(blobs: &dyn Blobs, name: &str, bytes: &[u8]) -> io::Result<()> {
    let staged = blobs.stage(name)?;
    staged.file().write_all(bytes)?;
    blobs.publish(staged, name, &|| false)
}

fn get(blobs: &dyn Blobs, name: &str) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    blobs.fetch(name)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn names(blobs: &dyn Blobs, folder: &str) -> Vec<String> {
    let mut names: Vec<String> = blobs.list(folder).unwrap().into_iter().map(|listed| listed.name).collect();
    names.sort();
    names
}

/// Runs the suite on blobs that hold none yet. `open` gives another process's view of the same blobs.
pub(super) fn conform(open: &dyn Fn() -> Arc<dyn Blobs>) {
    let blobs = open();
    let other = if blobs.is_shared() { open() } else { Arc::clone(&blobs) };
    what_is_put_is_read_whole_and_in_parts(&*blobs, &*other);
    a_name_is_given_once(&*blobs, &*other);
    one_of_many_racers_gives_a_name(&blobs, &other);
    what_is_not_published_is_not_seen(&*blobs, &*other);
    what_is_removed_is_gone(&*blobs, &*other);
    a_name_can_be_changed(&*blobs, &*other);
    dates_are_by_the_clock_of_the_storage(&*blobs);
}

fn what_is_put_is_read_whole_and_in_parts(blobs: &dyn Blobs, other: &dyn Blobs) {
    for (name, length) in
        [("artifacts/ab/empty", 0), ("artifacts/ab/short", 1000), ("artifacts/cd/long", LONG)]
    {
        let bytes: Vec<u8> = (0..length).map(|i| (i % 251) as u8).collect();
        put(blobs, name, &bytes).unwrap();
        assert!(get(other, name).unwrap() == bytes, "{name}");
        let end = length as u64;
        for range in [0..end, 0..end.min(1), end / 3..end / 2, end.saturating_sub(7)..end] {
            let opened = other.open(name).unwrap();
            assert_eq!(opened.length().unwrap(), end);
            let mut found = Vec::new();
            opened.read(range.clone()).unwrap().read_to_end(&mut found).unwrap();
            assert!(found == bytes[range.start as usize..range.end as usize], "{name} {range:?}");
        }
    }
    assert_eq!(names(other, "artifacts"), ["artifacts/ab/empty", "artifacts/ab/short", "artifacts/cd/long"]);
    assert_eq!(names(other, "artifacts/cd"), ["artifacts/cd/long"]);
    assert!(names(other, "artifacts/c").is_empty() && names(other, "nothing").is_empty());
    for missing in ["artifacts/ab/none", "none/none"] {
        assert_eq!(other.fetch(missing).unwrap_err().kind(), io::ErrorKind::NotFound, "{missing}");
    }
    assert_eq!(other.open("artifacts/ab/none").unwrap_err().kind(), io::ErrorKind::NotFound);
    other.remove_folder("artifacts").unwrap();
    assert!(names(blobs, "artifacts").is_empty());
}

fn a_name_is_given_once(blobs: &dyn Blobs, other: &dyn Blobs) {
    for length in [10, LONG] {
        put(blobs, "artifacts/ab/x", &vec![1; length]).unwrap();
        let refused = put(other, "artifacts/ab/x", &vec![2; length]).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
        assert!(get(other, "artifacts/ab/x").unwrap() == vec![1; length], "it is as it was");
        assert_eq!(names(blobs, "artifacts"), ["artifacts/ab/x"], "nothing is left of the second");
        blobs.remove(&["artifacts/ab/x".into()]).unwrap();
        other.forget("artifacts/ab/x");
    }
}

fn one_of_many_racers_gives_a_name(blobs: &Arc<dyn Blobs>, other: &Arc<dyn Blobs>) {
    if !blobs.is_shared() {
        // One attempt of one process writes a name.
        return;
    }
    let start = Barrier::new(8);
    let won: Vec<u8> = std::thread::scope(|scope| {
        let racers: Vec<_> = (0..8_u8)
            .map(|racer| {
                let blobs = if racer % 2 == 0 { Arc::clone(blobs) } else { Arc::clone(other) };
                let start = &start;
                scope.spawn(move || {
                    let staged = blobs.stage("artifacts/ab/race").unwrap();
                    staged.file().write_all(&[racer; 100]).unwrap();
                    start.wait();
                    match blobs.publish(staged, "artifacts/ab/race", &|| false) {
                        Ok(()) => Some(racer),
                        Err(error) => {
                            assert_eq!(error.kind(), io::ErrorKind::AlreadyExists, "{error}");
                            None
                        }
                    }
                })
            })
            .collect();
        racers.into_iter().filter_map(|racer| racer.join().unwrap()).collect()
    });
    assert_eq!(won.len(), 1, "{won:?}");
    assert_eq!(get(&**blobs, "artifacts/ab/race").unwrap(), [won[0]; 100]);
    assert_eq!(names(&**blobs, "artifacts"), ["artifacts/ab/race"]);
    blobs.remove_folder("artifacts").unwrap();
}

fn what_is_not_published_is_not_seen(blobs: &dyn Blobs, other: &dyn Blobs) {
    let name = "artifacts/ab/staged";
    let unseen = |what: &str| {
        assert_eq!(other.open(name).unwrap_err().kind(), io::ErrorKind::NotFound, "{what}");
        let seen = names(other, "artifacts");
        assert!(seen.iter().all(|name| name.ends_with(PARTIAL)), "{what}: {seen:?}");
    };
    let staged = blobs.stage(name).unwrap();
    staged.file().write_all(b"half").unwrap();
    unseen("while it is written");
    drop(staged);
    assert!(names(other, "artifacts").is_empty());
    for length in [10, LONG] {
        let staged = blobs.stage(name).unwrap();
        staged.file().write_all(&vec![7; length]).unwrap();
        let stopped = blobs.publish(staged, name, &|| true).unwrap_err();
        assert_eq!(stopped.kind(), io::ErrorKind::ConnectionAborted);
        unseen("stopped");
        assert!(names(other, "artifacts").is_empty());
    }
}

fn what_is_removed_is_gone(blobs: &dyn Blobs, other: &dyn Blobs) {
    let paths: Vec<String> = (0..3).map(|i| format!("artifacts/ab/{i}")).collect();
    for path in &paths {
        put(blobs, path, b"x").unwrap();
    }
    other.remove(&paths[..2]).unwrap();
    other.remove(&paths[..2]).unwrap();
    other.remove(&[]).unwrap();
    assert_eq!(names(blobs, "artifacts"), [paths[2].clone()]);
    blobs.remove_folder("artifacts").unwrap();
    blobs.remove_folder("artifacts").unwrap();
    assert!(names(other, "artifacts").is_empty());
}

fn a_name_can_be_changed(blobs: &dyn Blobs, other: &dyn Blobs) {
    put(blobs, "artifacts/ab/x", b"what it holds").unwrap();
    assert!(blobs.rename("artifacts/ab/x", "quarantine/2026-03-28/ab/x").unwrap());
    assert_eq!(get(other, "quarantine/2026-03-28/ab/x").unwrap(), b"what it holds");
    assert!(names(other, "artifacts").is_empty());
    assert!(!blobs.rename("artifacts/ab/x", "quarantine/2026-03-29/ab/x").unwrap(), "it is not there");
    assert!(blobs.shown("quarantine/2026-03-28/ab/x").ends_with("quarantine/2026-03-28/ab/x"));
    blobs.remove_folder("quarantine").unwrap();
}

fn dates_are_by_the_clock_of_the_storage(blobs: &dyn Blobs) {
    // File systems take times from a clock that ticks every 10 ms, buckets tell whole seconds.
    let tick = Duration::from_millis(1100);
    let before = blobs.now().unwrap();
    put(blobs, "artifacts/ab/x", b"x").unwrap();
    let after = blobs.now().unwrap();
    let written = blobs.list("artifacts").unwrap()[0].written;
    assert_eq!(written.is_some(), blobs.is_shared());
    let written = written.unwrap_or(after);
    assert!(before <= written + tick && written <= after + tick, "{before:?} {written:?} {after:?}");
    assert!(names(blobs, "").iter().all(|name| !name.ends_with(PARTIAL)), "the clock leaves nothing staged");
    blobs.remove_folder("artifacts").unwrap();
}

fn files(root: &Path) -> Arc<dyn Blobs> {
    Arc::new(Files::alone(root.to_owned()))
}

#[test]
fn files_of_one_process_conform() {
    let folder = tempfile::tempdir().unwrap();
    conform(&|| files(folder.path()));
}

#[test]
fn files_of_a_scratch_folder_conform() {
    let folder = tempfile::tempdir().unwrap();
    conform(&|| Arc::new(Files::scratch(folder.path().to_owned())));
}

#[test]
fn files_in_a_shared_folder_conform() {
    let folder = tempfile::tempdir().unwrap();
    conform(&|| Arc::new(Files::shared(folder.path().join("made")).unwrap()));
}

#[test]
fn objects_of_a_bucket_conform() {
    use object_store::aws::AmazonS3Builder;

    use super::Objects;
    use crate::disk::{Disk, Shortage};

    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let Some(bucket) = runtime.block_on(bucket::Bucket::start()) else { return };
    let _inside = runtime.enter();
    let folder = tempfile::tempdir().unwrap();
    for prefix in ["", "lab/packstone"] {
        conform(&|| {
            let settings = bucket::Bucket::variables(&bucket.endpoint()).into_iter().fold(
                AmazonS3Builder::new(),
                |settings, (name, value)| {
                    settings.with_config(name.to_ascii_lowercase().parse().unwrap(), value)
                },
            );
            let disk = Disk::new(folder.path().to_owned(), Some(0), Shortage::default());
            Arc::new(
                Objects::open(settings, "packstone", prefix, folder.path().join("scratch"), disk).unwrap(),
            )
        });
    }
    assert!(runtime.block_on(bucket.uploads()).is_empty(), "parts of uploads that were stopped are given up");
    let objects = runtime.block_on(bucket.objects());
    assert_eq!(objects, ["clock", "lab/packstone/clock"], "the suite removes what it writes");
    let staged = std::fs::read_dir(folder.path().join("scratch")).unwrap().count();
    assert_eq!(staged, 0, "copies and staged files go with their storage");
}

#[test]
fn what_a_killed_process_has_staged_does_not_keep_the_next_from_writing() {
    let folder = tempfile::tempdir().unwrap();
    for open in
        [|path: &Path| files(path), |path: &Path| Arc::new(Files::shared(path.to_owned()).unwrap()) as _]
    {
        let blobs: Arc<dyn Blobs> = open(folder.path());
        std::mem::forget(blobs.stage("artifacts/ab/x").unwrap());
        put(&*blobs, "artifacts/ab/x", b"whole").unwrap();
        assert_eq!(get(&*blobs, "artifacts/ab/x").unwrap(), b"whole");
        blobs.remove_folder("artifacts").unwrap();
    }
}
