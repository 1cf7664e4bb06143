#![allow(clippy::unwrap_used)]

use std::io::Read as _;

use serde_json::json;

use super::*;
use crate::blobs::Blob as _;

fn request(seed: u64) -> PackingRequest {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [80, 80, 80]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.5},
        "method": {"type": "edmd"},
    });
    PackingRequest::from_json(&value, seed).unwrap()
}

fn checkpoint<T>(seed: u64, body: &str, kept_by: impl FnOnce(&Checkpoint<'_>) -> T) -> T {
    let write = |out: &mut dyn io::Write| out.write_all(body.as_bytes());
    kept_by(&Checkpoint::new(&request(seed), &write))
}

/// What a state is when it is read back.
fn state(seed: u64, body: &str) -> Resume {
    let mut bytes = Vec::new();
    checkpoint(seed, body, |checkpoint| checkpoint.write_to(&mut bytes).unwrap());
    Resume::read_from(&mut bytes.as_slice(), &request(seed)).unwrap()
}

struct Folder {
    checkpoints: Checkpoints,
    parent: tempfile::TempDir,
}

impl Folder {
    fn new() -> Self {
        let parent = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::open(parent.path().join("checkpoints"), Duration::ZERO).unwrap();
        Self { checkpoints, parent }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.parent.path().join("checkpoints").join(name)
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(self.parent.path().join("checkpoints"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

#[test]
fn an_attempt_goes_on_from_the_newest_state_of_its_job() {
    let folder = Folder::new();
    assert_eq!(folder.checkpoints.resume("job", &request(7)), None);
    let first = folder.checkpoints.writer("job", 1);
    checkpoint(7, "early", |c| first.keep(c));
    checkpoint(7, "late", |c| first.keep(c));
    checkpoint(7, "another's", |c| folder.checkpoints.writer("job-2", 1).keep(c));
    assert_eq!(folder.checkpoints.resume("job", &request(7)), Some(state(7, "late")));
    assert_eq!(folder.names(), ["job-2.1.checkpoint", "job.1.checkpoint"]);
}

#[test]
fn an_attempt_that_lost_its_lease_harms_no_later_one() {
    let folder = Folder::new();
    let (lost, holder) = (folder.checkpoints.writer("job", 9), folder.checkpoints.writer("job", 10));
    checkpoint(7, "lost, early", |c| lost.keep(c));
    checkpoint(7, "held", |c| holder.keep(c));
    assert_eq!(folder.names(), ["job.10.checkpoint"], "what the holder has replaced is gone");
    checkpoint(7, "lost, late", |c| lost.keep(c));
    assert_eq!(folder.checkpoints.resume("job", &request(7)), Some(state(7, "held")));
    folder.checkpoints.remove("job", 9);
    assert_eq!(folder.names(), ["job.10.checkpoint"], "the end of the lost attempt leaves the holder's");
    checkpoint(7, "lost, later", |c| lost.keep(c));
    folder.checkpoints.remove("job", 10);
    assert_eq!(folder.names(), [""; 0], "the end of the job takes all of them");
}

#[test]
fn what_cannot_be_gone_on_from_is_removed_and_an_older_state_taken() {
    let folder = Folder::new();
    checkpoint(7, "good", |c| folder.checkpoints.writer("job", 1).keep(c));
    fs::write(folder.file("job.2.checkpoint"), "damaged").unwrap();
    checkpoint(8, "of another request", |c| {
        write(&folder.file("job.3.checkpoint"), c).unwrap();
    });
    fs::write(folder.file("job.4.checkpoint.tmp"), "never finished").unwrap();
    assert_eq!(folder.checkpoints.resume("job", &request(7)), Some(state(7, "good")));
    assert_eq!(folder.names(), ["job.1.checkpoint"]);
}

#[test]
fn a_checkpoint_that_cannot_be_written_leaves_the_last_one() {
    let folder = Folder::new();
    let keeper = folder.checkpoints.writer("job", 1);
    checkpoint(7, "kept", |c| keeper.keep(c));
    let full = |_: &mut dyn io::Write| Err(io::ErrorKind::StorageFull.into());
    keeper.keep(&Checkpoint::new(&request(7), &full));
    assert_eq!(folder.names(), ["job.1.checkpoint"]);
    assert_eq!(folder.checkpoints.resume("job", &request(7)), Some(state(7, "kept")));
    // Nor does it matter if the whole folder goes.
    fs::remove_dir_all(folder.file("")).unwrap();
    checkpoint(7, "lost", |c| keeper.keep(c));
    assert_eq!(folder.checkpoints.resume("job", &request(7)), None);
}

#[test]
fn names_read_back() {
    assert_eq!(parse("0190.2.checkpoint"), Some(("0190", 2, true)));
    assert_eq!(parse("0190.2.checkpoint.tmp"), Some(("0190", 2, false)));
    for other in ["0190.2.packstone", "0190.checkpoint", "0190.x.checkpoint", "notes.txt", ".tmp"] {
        assert_eq!(parse(other), None, "{other}");
    }
}

#[test]
fn checkpoints_are_due_between_any_two_epochs_or_after_a_while() {
    let always = Schedule::new(Duration::ZERO);
    assert!(always.is_due());
    always.tried(Duration::from_mins(1));
    assert!(always.is_due());
    let hourly = Schedule::new(Duration::from_hours(1));
    assert!(!hourly.is_due());
    // The start is long ago, and the last one was cheap.
    *hourly.next.lock().unwrap() = Instant::now();
    assert!(hourly.is_due());
    hourly.tried(Duration::ZERO);
    assert!(!hourly.is_due());
}

#[test]
fn another_server_goes_on_from_a_copy() {
    let blobs = tempfile::tempdir().unwrap();
    let server = || {
        let Folder { checkpoints, parent } = Folder::new();
        let shared = crate::blobs::Files::shared(blobs.path().to_owned()).unwrap();
        Folder { checkpoints: checkpoints.shared_by(Arc::new(shared)), parent }
    };
    let copies = || fs::read_dir(blobs.path().join("checkpoints/job")).map_or(0, Iterator::count);
    let (first, second) = (server(), server());
    let keeper = first.checkpoints.writer("job", 1);
    first.checkpoints.share("job", 1);
    assert_eq!(copies(), 0, "there is none yet");
    checkpoint(7, "early", |c| keeper.keep(c));
    first.checkpoints.share("job", 1);
    checkpoint(7, "late", |c| keeper.keep(c));
    first.checkpoints.share("job", 1);
    assert_eq!(copies(), 1, "the older copy is gone");
    let here_and_there = first.checkpoints.kept_anywhere().unwrap();
    assert_eq!(here_and_there.len(), 1, "an attempt is not counted out twice: {here_and_there:?}");
    assert_eq!(second.checkpoints.kept().unwrap(), []);
    assert_eq!(second.checkpoints.kept_anywhere().unwrap()[0].attempt, 1);
    second.checkpoints.fetch_shared("job");
    assert_eq!(second.checkpoints.resume("job", &request(7)), Some(state(7, "late")));
    assert_eq!(second.names(), ["job.1.checkpoint"]);
    let next = second.checkpoints.writer("job", 2);
    second.checkpoints.remove("job", 0);
    checkpoint(7, "later", |c| next.keep(c));
    second.checkpoints.share("job", 2);
    assert_eq!(copies(), 1);
    // One that has lost its lease takes nothing from the holder.
    first.checkpoints.share("job", 1);
    let third = server();
    assert_eq!(read_newest(&third), Some(fs::read(third.file("job.2.checkpoint")).unwrap()));
    assert_eq!(third.checkpoints.resume("job", &request(7)), Some(state(7, "later")));
    assert_eq!(third.checkpoints.shared_ids().unwrap(), HashSet::from(["job".to_owned()]));
    third.checkpoints.remove("job", 2);
    assert_eq!(copies(), 0);
    assert_eq!(read_newest(&server()), None);
}

/// What is sent of the newest checkpoint of the job.
fn read_newest(folder: &Folder) -> Option<Vec<u8>> {
    let newest = Box::new(folder.checkpoints.newest("job")?);
    let (length, mut bytes) = (newest.length().unwrap(), Vec::new());
    newest.read(0..length).unwrap().read_to_end(&mut bytes).unwrap();
    Some(bytes)
}

#[test]
fn a_bit_that_flips_anywhere_in_a_checkpoint_is_found_at_its_next_read() {
    let folder = Folder::new();
    for (attempt, body) in [(1, "earlier".to_owned()), (2, "state".repeat(20_000))] {
        checkpoint(7, &body, |checkpoint| write(&folder.checkpoints.file("job", attempt), checkpoint))
            .unwrap();
    }
    let file = folder.file("job.2.checkpoint");
    let whole = fs::read(&file).unwrap();
    let earlier = fs::read(folder.file("job.1.checkpoint")).unwrap();
    assert_eq!(read_newest(&folder).as_ref(), Some(&whole));
    for at in (0..whole.len()).step_by(4999).chain([whole.len() - 1]) {
        let mut flipped = whole.clone();
        flipped[at] ^= 1;
        fs::write(&file, &flipped).unwrap();
        assert_eq!(folder.checkpoints.resume("job", &request(7)), Some(state(7, "earlier")), "{at}");
        assert!(!file.exists(), "{at}");
        fs::write(&file, &flipped).unwrap();
        assert_eq!(read_newest(&folder).as_ref(), Some(&earlier), "{at}");
        assert!(!file.exists(), "{at}");
    }
}

#[test]
fn a_checkpoint_from_elsewhere_that_is_damaged_leaves_the_one_before() {
    let folder = Folder::new();
    checkpoint(7, "kept", |checkpoint| write(&folder.checkpoints.file("job", 1), checkpoint)).unwrap();
    let whole = fs::read(folder.file("job.1.checkpoint")).unwrap();
    for damaged in [&whole[..whole.len() - 1], b"PACKSTCK", b""] {
        let mut receiving = folder.checkpoints.receive("job", 1).unwrap();
        receiving.write(damaged).unwrap();
        assert_eq!(receiving.finish().unwrap_err().kind(), io::ErrorKind::InvalidData);
        assert_eq!(folder.names(), ["job.1.checkpoint"]);
        assert_eq!(read_newest(&folder).as_ref(), Some(&whole));
    }
}
