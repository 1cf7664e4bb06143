//! Results on a real disk: what is written is what is read, and a damaged file is noticed.

#![allow(clippy::unwrap_used)]

use std::io;

use packstone_engine::export::tables::{self, EngineInfo, Format, Head};
use packstone_engine::{Limits, Packing, PackingRequest, Unattended, pack};
use serde_json::json;

use super::*;
use crate::fair_places::{Client, FairPlaces};
use crate::jobs::ArtifactRecord;
use crate::workers::control::{RunControl, Stop};

struct Stored {
    folder: tempfile::TempDir,
    artifacts: Artifacts,
    packing: Packing,
    head: Head,
}

impl Stored {
    fn new() -> Self {
        let request = json!({
            "specimen": {"type": "box", "size_mm": [60, 60, 60]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 2}, "volume_fraction": 0.2}
        });
        let packing =
            pack(&PackingRequest::from_json(&request, 1).unwrap(), &Limits::default(), &Unattended).unwrap();
        let head = Head {
            job_id: Some("job-ab".into()),
            request,
            engine: EngineInfo::current(),
            report: packing.report.clone(),
        };
        let folder = tempfile::tempdir().unwrap();
        let artifacts = Artifacts::open(folder.path()).unwrap();
        Self { folder, artifacts, packing, head }
    }

    fn write(&self) -> ArtifactRecord {
        let place = self.artifacts.begin("job-ab", 1);
        self.artifacts.write(&place, &self.head, &self.packing.grains, &Unattended).unwrap()
    }

    fn formatted(&self, format: Format) -> Vec<u8> {
        let mut bytes = Vec::new();
        tables::write(format, &self.head, &self.packing.grains, &mut bytes).unwrap();
        bytes
    }
}

#[tokio::test]
async fn every_format_and_range_comes_back_as_it_was() {
    let stored = Stored::new();
    let record = stored.write();
    assert_eq!(record.path, "ab/job-ab.1.packstone");
    assert_eq!(record.report["summary"]["grains"], stored.packing.grains.len() as u64);
    let file = fs::read(stored.folder.path().join("artifacts").join(&record.path)).unwrap();
    assert_eq!((record.bytes, record.sha256.clone()), (file.len() as u64, crate::hex::sha256(&file)));
    assert_eq!(stored.artifacts.read(&record).unwrap().count_lengths().unwrap(), record.format_lengths);
    for format in Format::ALL {
        let expected = stored.formatted(format);
        let length = expected.len() as u64;
        assert_eq!(record.format_lengths[format.name()], length, "{}", format.name());
        for range in [0..length, 0..1, length / 3..length / 2, length - 7..length] {
            let result = stored.artifacts.read(&record).unwrap();
            let turn = FairPlaces::new(1, 1).wait(&Client::default()).await;
            let mut blocks = stream::start(result, format, range.clone(), false, turn);
            let mut found = Vec::new();
            while let Some(block) = blocks.recv().await {
                found.extend_from_slice(&block.unwrap());
            }
            assert!(
                found == expected[range.start as usize..range.end as usize],
                "{} {range:?}",
                format.name()
            );
        }
    }
}

#[test]
fn a_damaged_or_missing_file_is_noticed() {
    let stored = Stored::new();
    let record = stored.write();
    let file = stored.folder.path().join("artifacts").join(&record.path);
    let whole = fs::read(&file).unwrap();
    let mut flipped = whole.clone();
    let last = flipped.len() - 1;
    flipped[last] ^= 1;
    fs::write(&file, &flipped).unwrap();
    let error = stored.artifacts.read(&record).unwrap_err();
    assert!(error.kind() == io::ErrorKind::InvalidData && error.to_string().contains("sha256"), "{error}");
    fs::write(&file, &whole[..last]).unwrap();
    assert_eq!(stored.artifacts.read(&record).unwrap_err().kind(), io::ErrorKind::InvalidData);
    fs::write(&file, &whole).unwrap();
    stored.artifacts.read(&record).unwrap();
    fs::remove_file(&file).unwrap();
    assert_eq!(stored.artifacts.read(&record).unwrap_err().kind(), io::ErrorKind::NotFound);
}

#[test]
fn an_attempt_that_is_begun_once_more_is_not_kept_from_its_name() {
    let mut stored = Stored::new();
    let first = stored.write();
    assert_eq!(stored.write().sha256, first.sha256, "the same bytes are as good as written");
    // A run tells its times.
    stored.head.report.timings_s.check += 1.0;
    let place = stored.artifacts.begin("job-ab", 1);
    let again = || stored.artifacts.write(&place, &stored.head, &stored.packing.grains, &Unattended);
    let error = again().unwrap_err();
    assert!(crate::disk::is_passing(&error) && error.to_string().contains("has been moved"), "{error}");
    let second = again().unwrap();
    assert_ne!(second.sha256, first.sha256);
    stored.artifacts.read(&second).unwrap();
    let quarantine = fs::read_dir(stored.folder.path().join("quarantine")).unwrap().next().unwrap().unwrap();
    let kept = fs::read(quarantine.path().join(&first.path)).unwrap();
    assert_eq!(crate::hex::sha256(&kept), first.sha256, "nothing is lost that was made");
}

#[test]
fn a_stopped_write_leaves_nothing_behind() {
    let stored = Stored::new();
    let control = RunControl::default();
    control.stop(Stop::Cancelled);
    let place = stored.artifacts.begin("job-ab", 1);
    let error = stored.artifacts.write(&place, &stored.head, &stored.packing.grains, &control).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::ConnectionAborted);
    drop(place);
    assert_eq!(stored.artifacts.settled(Duration::ZERO).unwrap(), []);
}
