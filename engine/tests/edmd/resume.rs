//! A run that goes on from a checkpoint ends as one that was never interrupted, to the last bit.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use packstone_engine::packing::EdmdStatistics;
use packstone_engine::{
    Checkpoint, CheckpointError, Control, Limits, PackError, Packing, PackingRequest, Progress, Resume,
    TemplateCache, Unattended, pack, pack_or_resume,
};
use proptest::prelude::*;
use serde_json::{Value, json};

/// Keeps the checkpoint of one question whether it wants one, and pulls the plug.
pub(crate) struct Killer {
    questions: AtomicU32,
    at: u32,
    kept: Mutex<Option<Vec<u8>>>,
}

impl Killer {
    pub(crate) fn at(question: u32) -> Self {
        Self { questions: AtomicU32::new(0), at: question, kept: Mutex::new(None) }
    }

    /// The checkpoint that it kept.
    pub(crate) fn kept(self) -> Vec<u8> {
        self.kept.into_inner().unwrap().unwrap()
    }
}

impl Control for Killer {
    fn report(&self, _: &Progress) {}

    fn should_stop(&self) -> bool {
        self.kept.lock().unwrap().is_some()
    }

    fn wants_checkpoint(&self) -> bool {
        self.questions.fetch_add(1, Ordering::Relaxed) + 1 == self.at
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        assert!(self.kept.lock().unwrap().replace(bytes).is_none(), "only what is wanted is kept");
    }
}

pub(crate) fn resume(bytes: &[u8], request: &PackingRequest) -> Resume {
    Resume::read_from(&mut &bytes[..], request).unwrap()
}

/// What came of a run that was to be killed.
enum Killed {
    /// Its checkpoint.
    At(Vec<u8>),
    /// It ended before it was asked.
    Never(Box<Packing>),
}

/// Packs until the question.
fn killed_at(question: u32, request: &PackingRequest, from: Option<Resume>) -> Killed {
    let killer = Killer::at(question);
    let ended = pack_or_resume(request, &Limits::default(), &TemplateCache::default(), from, &killer);
    match (killer.kept.into_inner().unwrap(), ended) {
        (Some(bytes), Err(PackError::Stopped { .. })) => Killed::At(bytes),
        (None, Ok(packing)) => Killed::Never(Box::new(packing)),
        (_, other) => panic!("the run ended as {other:?}"),
    }
}

/// What was counted, but for what an interruption does change: how often, and how fast.
fn counted(packing: &Packing) -> EdmdStatistics {
    EdmdStatistics { resumes: 0, events_per_s: 0.0, ..packing.report.statistics.edmd.unwrap() }
}

fn assert_same(one: &Packing, other: &Packing, what: &str) {
    let bits = |column: &[f64]| column.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let columns = |p: &Packing| {
        [
            &p.spheres().unwrap().x_mm,
            &p.spheres().unwrap().y_mm,
            &p.spheres().unwrap().z_mm,
            &p.spheres().unwrap().d_mm,
        ]
        .map(|c| bits(c))
    };
    assert_eq!(columns(one), columns(other), "{what}");
    assert_eq!(counted(one), counted(other), "{what}");
    assert_eq!(one.report.summary, other.report.summary, "{what}");
    assert_eq!(one.report.check, other.report.check, "{what}");
    let distances =
        |p: &Packing| p.report.distance_curve().iter().map(|point| point[1].to_bits()).collect::<Vec<_>>();
    assert_eq!(distances(one), distances(other), "{what}");
}

/// Kills a run at each of some questions, lets it go on, and compares; returns how many of the questions
/// were asked at all.
fn check(name: &str, value: &Value, seed: u64, questions: &[u32]) -> usize {
    let request = PackingRequest::from_json(value, seed).unwrap();
    let whole = pack(&request, &Limits::default(), &Unattended).unwrap();
    let mut asked = 0;
    for &question in questions {
        let what = format!("{name}, killed at question {question}");
        let Killed::At(bytes) = killed_at(question, &request, None) else { continue };
        asked += 1;
        let from = resume(&bytes, &request);
        let resumed =
            pack_or_resume(&request, &Limits::default(), &TemplateCache::default(), Some(from), &Unattended)
                .unwrap();
        assert_eq!(resumed.report.statistics.edmd.unwrap().resumes, 1, "{what}");
        assert_same(&whole, &resumed, &what);
    }
    asked
}

const PERIODIC: &str = r#"{"type": "box", "size_mm": [24, 20, 18], "boundary": "periodic"}"#;
const WALLS: &str = r#"{"type": "box", "size_mm": [24, 20, 18]}"#;
const CYLINDER: &str = r#"{"type": "cylinder", "diameter_mm": 20, "height_mm": 24}"#;
/// A graded mix of about a hundred grains, dense enough that it takes many epochs.
const GRADED: &str = r#"{"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
    "volume_fraction": 0.57, "volume_fraction_of": "placed_grains"}"#;
const LOOSE: &str = r#"{"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
    "volume_fraction": 0.45, "volume_fraction_of": "placed_grains"}"#;

fn job(specimen: &str, mix: &str, distance: &Value, method: &Value) -> Value {
    let read = |text: &str| serde_json::from_str::<Value>(text).unwrap();
    json!({"specimen": read(specimen), "mix": read(mix), "distance": distance, "method": method})
}

#[test]
fn a_prescribed_target_is_reached_the_same_after_a_kill_anywhere() {
    let method = json!({"type": "edmd", "initial_scale": 0.85});
    for (name, specimen) in [("walls", WALLS), ("periodic", PERIODIC), ("cylinder", CYLINDER)] {
        for (rule, mix, distance) in [
            ("none", GRADED, json!({"type": "none"})),
            ("constant", LOOSE, json!({"type": "constant", "gap_mm": 0.2, "wall_gap_mm": 0.05})),
            ("smaller_diameter", LOOSE, json!({"type": "smaller_diameter", "factor": 0.08})),
        ] {
            let value = job(specimen, mix, &distance, &method);
            let asked = check(&format!("{name}, {rule}"), &value, 3, &[1, 2, 3, 5, 7]);
            assert_eq!(asked, 5, "{name}, {rule}: long enough to be killed that late");
        }
    }
}

#[test]
fn the_largest_distance_is_the_same_after_a_kill_anywhere() {
    for (name, specimen) in [("walls", WALLS), ("periodic", PERIODIC), ("cylinder", CYLINDER)] {
        // The second grows to the true diameters first, and is killed in either stage.
        for (start, method) in [
            ("at once", json!({"type": "edmd", "stop": {"events": 40_000}})),
            ("by scale", json!({"type": "edmd", "initial_scale": 0.9, "stop": {"events": 40_000}})),
            (
                "without exchanges",
                json!({"type": "edmd", "swap": false, "equal_mass": true, "stop": {"events": 40_000}}),
            ),
        ] {
            let value = job(specimen, LOOSE, &json!({"type": "maximize"}), &method);
            let asked = check(&format!("{name}, {start}"), &value, 5, &[1, 2, 5, 9, 14]);
            assert_eq!(asked, 5, "{name}, {start}: long enough to be killed that late");
        }
    }
}

#[test]
fn a_run_that_is_killed_after_every_epoch_ends_the_same() {
    let stop = json!({"type": "edmd", "initial_scale": 0.9, "stop": {"events": 30_000}});
    let value = job(WALLS, LOOSE, &json!({"type": "maximize"}), &stop);
    let request = PackingRequest::from_json(&value, 8).unwrap();
    let whole = pack(&request, &Limits::default(), &Unattended).unwrap();
    let mut from = None;
    let mut kills = 0;
    let ended = loop {
        // The first question comes before anything has happened since.
        match killed_at(2, &request, from.take()) {
            Killed::At(bytes) => from = Some(resume(&bytes, &request)),
            Killed::Never(packing) => break packing,
        }
        kills += 1;
    };
    assert!(kills > 20, "{kills}");
    assert_eq!(ended.report.statistics.edmd.unwrap().resumes, kills);
    assert_same(&whole, &ended, "killed after every epoch");
}

/// Wants a checkpoint whenever it is asked.
struct Greedy(AtomicU32);

impl Control for Greedy {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        false
    }
    fn wants_checkpoint(&self) -> bool {
        true
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        checkpoint.write_to(&mut std::io::sink()).unwrap();
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn keeping_checkpoints_changes_nothing() {
    let value = job(CYLINDER, GRADED, &json!({"type": "none"}), &json!({"type": "edmd"}));
    let request = PackingRequest::from_json(&value, 4).unwrap();
    let greedy = Greedy(AtomicU32::new(0));
    let kept = pack(&request, &Limits::default(), &greedy).unwrap();
    assert!(greedy.0.load(Ordering::Relaxed) > 5);
    assert_same(&pack(&request, &Limits::default(), &Unattended).unwrap(), &kept, "all checkpoints kept");
}

#[test]
fn grains_sorted_in_memory_go_on_where_they_were() {
    // More than the 20 000 grains from which sorting pays, in a run just long enough to be killed.
    let value = json!({
        "specimen": {"type": "box", "size_mm": [60, 60, 60], "boundary": "periodic"},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 2}, "volume_fraction": 0.42},
        "method": {"type": "edmd", "initial_scale": 0.89},
    });
    assert!(check("sorted", &value, 1, &[3]) == 1);
}

#[test]
fn growth_after_a_failed_placing_is_gone_on_with() {
    // Walls leave less than random placing is taken to reach: it fails for some seeds, and growth takes over.
    let value = json!({
        "specimen": {"type": "box", "size_mm": [10, 10, 10]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4}, "volume_fraction": 0.23},
    });
    let mut grown = 0;
    for seed in 0..40 {
        let request = PackingRequest::from_json(&value, seed).unwrap();
        let whole = pack(&request, &Limits::default(), &Unattended).unwrap();
        if whole.report.statistics.edmd.is_some() {
            assert_eq!(check("after placing", &value, seed, &[2]), 1);
            grown += 1;
        }
    }
    assert!(grown > 0, "no seed came to growth");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_damaged_checkpoint_is_refused(at in any::<prop::sample::Index>(), flip in 1_u8..=255, cut: bool) {
        let value = job(WALLS, GRADED, &json!({"type": "none"}), &json!({"type": "edmd"}));
        let request = PackingRequest::from_json(&value, 4).unwrap();
        let Killed::At(mut bytes) = killed_at(3, &request, None) else { panic!("too short a run") };
        let at = at.index(bytes.len());
        if cut { bytes.truncate(at) } else { bytes[at] ^= flip }
        prop_assert!(Resume::read_from(&mut &bytes[..], &request).is_err());
    }
}

#[test]
fn a_checkpoint_serves_its_own_seed_only() {
    let value = job(WALLS, GRADED, &json!({"type": "none"}), &json!({"type": "edmd"}));
    let of_seed = |seed| PackingRequest::from_json(&value, seed).unwrap();
    let Killed::At(bytes) = killed_at(2, &of_seed(1), None) else { panic!("too short a run") };
    let other = Resume::read_from(&mut &bytes[..], &of_seed(2));
    assert!(matches!(other, Err(CheckpointError::OtherRequest)), "{other:?}");
}
