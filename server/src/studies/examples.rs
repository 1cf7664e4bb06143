//! Tests of the study files of `examples/`: each is valid and requests what its name states.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;

use packstone_engine::{Limits, Plan};

use super::Study;
use crate::strict_json;

/// All of them, by the name of the file.
fn examples() -> BTreeMap<String, Study> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/studies");
    let read = |entry: std::io::Result<fs::DirEntry>| {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let value = strict_json::parse(&fs::read(&path).unwrap()).unwrap();
        assert!(value.get("seed").is_some(), "{name} would be another study every time");
        let study = Study::read(&value, 0, None, &Limits::default());
        (name.clone(), study.unwrap_or_else(|refusal| panic!("{name}: {refusal:?}")))
    };
    fs::read_dir(folder).unwrap().map(read).collect()
}

#[test]
fn each_expands_and_has_a_short_variant_of_the_same_columns() {
    let examples = examples();
    for section in ["5.4-event-time", "6.1-", "6.2-fuller-small", "6.2-fuller-large", "6.3-", "6.4-"] {
        assert_eq!(examples.keys().filter(|name| name.starts_with(section)).count(), 2, "{section}");
    }
    for (name, study) in examples.iter().filter(|(name, _)| !name.ends_with("-short")) {
        let short = &examples[&format!("{name}-short")];
        assert_eq!(short.columns, study.columns, "{name}");
        assert!(short.jobs() < study.jobs(), "{name}");
        assert!(short.jobs() > 0, "{name}");
    }
}

#[test]
fn equal_spheres_come_in_the_numbers_asked_for() {
    let examples = examples();
    let grains = |name: &str| -> Vec<u64> {
        let plan = |job: &crate::jobs::JobRequest| Plan::new(&job.packing(), &Limits::default()).unwrap();
        // Grains are drawn until the volume is reached.
        examples[name].points.iter().map(|point| plan(&point.job).grains.ceil() as u64).collect()
    };
    let full = grains("6.1-equal-spheres");
    assert_eq!(full[..40], (1..=40).collect::<Vec<_>>());
    assert_eq!(full.last(), Some(&8000));
    let short = grains("6.1-equal-spheres-short");
    assert!(short.iter().all(|n| full.contains(n)), "{short:?}");
}
