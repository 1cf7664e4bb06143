//! States of a run that cannot be: whatever passed the checksum but does not make sense starts again.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::json;

use crate::control::Unattended;
use crate::{
    Checkpoint, Control, Limits, PackError, Packing, PackingRequest, Progress, Resume, TemplateCache,
    pack_or_resume,
};

/// Keeps the first checkpoint after some cycles, and stops there.
struct Keeper {
    questions: AtomicU32,
    kept: Mutex<Vec<u8>>,
}

impl Control for Keeper {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        !self.kept.lock().unwrap().is_empty()
    }
    fn wants_checkpoint(&self) -> bool {
        self.questions.fetch_add(1, Ordering::Relaxed) == 3
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        checkpoint.write_to(&mut *self.kept.lock().unwrap()).unwrap();
    }
}

fn request() -> PackingRequest {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [16, 15, 14]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2.5,
            "volume_fraction": 0.25, "volume_fraction_of": "placed_grains"},
        "distance": {"type": "maximize"},
        "method": {"type": "edmd", "stop": {"events": 12_000}},
    });
    PackingRequest::from_json(&value, 11).unwrap()
}

/// The body of a checkpoint amid the run.
fn body() -> Vec<u8> {
    let keeper = Keeper { questions: AtomicU32::new(0), kept: Mutex::new(Vec::new()) };
    let ended = pack_or_resume(&request(), &Limits::default(), &TemplateCache::default(), None, &keeper);
    assert!(matches!(ended, Err(PackError::Stopped { .. })), "{ended:?}");
    let bytes = keeper.kept.into_inner().unwrap();
    Resume::read_from(&mut &bytes[..], &request()).unwrap().body
}

fn gone_on_from(body: Vec<u8>) -> Packing {
    pack_or_resume(
        &request(),
        &Limits::default(),
        &TemplateCache::default(),
        Some(Resume { body }),
        &Unattended,
    )
    .unwrap()
}

fn resumes(packing: &Packing) -> u64 {
    packing.report.statistics.edmd.unwrap().resumes
}

/// Numbers before the columns: counts and measures; then each column with its length in front.
const COUNTS: usize = 18;
const HEAD_BYTES: usize = (COUNTS + 12) * 8;
/// Three columns of places before skin, which a run has that grows again, have a length alone.
const NO_PLACES: usize = 3 * 8;

#[test]
fn a_whole_body_is_gone_on_from_and_a_broken_one_starts_anew() {
    let body = body();
    let whole = gone_on_from(body.clone());
    assert_eq!(resumes(&whole), 1);
    let grains = u64::from_le_bytes(body[HEAD_BYTES..HEAD_BYTES + 8].try_into().unwrap()) as usize;
    assert_eq!(grains, whole.spheres().unwrap().len());

    let measure = |index: usize| (COUNTS + index) * 8;
    let column = |index: usize| HEAD_BYTES + index * (8 + 8 * grains);
    let with = |at: usize, bytes: &[u8]| {
        let mut body = body.clone();
        body[at..at + bytes.len()].copy_from_slice(bytes);
        body
    };
    // Three pairs of columns of positions and velocities, skin, and then two of four bytes each.
    let ranks = column(7) + NO_PLACES + 8 + 4 * grains + 8;
    let mut longer = body.clone();
    longer.extend([0; 8]);
    let broken = [
        ("empty", Vec::new()),
        ("longer", longer),
        ("cut within a number", body[..body.len() - 3].to_vec()),
        ("another number of grains", with(column(0), &(grains as u64 - 1).to_le_bytes())),
        ("more grains than bytes", with(column(1), &u64::MAX.to_le_bytes())),
        ("a rank of no grain", with(ranks, &(grains as u32).to_le_bytes())),
        ("a rank twice", with(ranks, &body[ranks + 4..ranks + 8])),
        ("a size below nothing", with(measure(0), &(-1e-3_f64).to_le_bytes())),
        ("jammed beyond the target", with(measure(1), &1.5_f64.to_le_bytes())),
        ("no pressure", with(measure(4), &0_f64.to_le_bytes())),
        ("no events", with(measure(5), &0_f64.to_le_bytes())),
        ("another energy", with(measure(6), &1e9_f64.to_le_bytes())),
        ("more than done", with(measure(9), &1.5_f64.to_le_bytes())),
        ("a grain nowhere", with(column(0) + 8, &f64::NAN.to_le_bytes())),
        ("a grain far away", with(column(0) + 8, &1e6_f64.to_le_bytes())),
        ("a grain too fast", with(column(1) + 8, &1e200_f64.to_le_bytes())),
        ("a skin below nothing", with(column(6) + NO_PLACES + 8, &(-1_f64).to_le_bytes())),
    ];
    for (what, body) in broken {
        let anew = gone_on_from(body);
        assert_eq!(resumes(&anew), 0, "{what}");
        assert_eq!(anew.spheres().unwrap(), whole.spheres().unwrap(), "{what}");
    }
}

/// Equal spheres that jam below their target, and reach it when they grow again.
fn jamming_request() -> PackingRequest {
    let edge_mm = (40.0 * std::f64::consts::PI / 6.0 / 0.64).cbrt();
    let value = json!({
        "specimen": {"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm], "boundary": "periodic"},
        "mix": {"grading": {"type": "diameters", "diameters_mm": vec![1.0; 40]}},
        "method": {"type": "edmd"}, "on_limit": "keep",
    });
    PackingRequest::from_json(&value, 1).unwrap()
}

/// Keeps the first checkpoint of grains that grow again, and stops there.
#[derive(Default)]
struct AgainKeeper {
    kept: Mutex<Vec<u8>>,
    grows_again: AtomicBool,
}

/// The place of the number that counts how often grains grow again.
const AGAIN: usize = 6 * 8;

impl Control for AgainKeeper {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        self.grows_again.load(Ordering::Relaxed)
    }
    fn wants_checkpoint(&self) -> bool {
        true
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        let body = Resume::read_from(&mut &bytes[..], &jamming_request()).unwrap().body;
        if body[AGAIN] > 0 {
            *self.kept.lock().unwrap() = body;
            self.grows_again.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn grains_that_jam_below_their_target_grow_again_and_go_on_from_a_checkpoint() {
    let request = jamming_request();
    let run = |resume: Option<Resume>, control: &dyn Control| {
        pack_or_resume(&request, &Limits::default(), &TemplateCache::default(), resume, control)
    };
    let whole = run(None, &Unattended).unwrap();
    let keeper = AgainKeeper::default();
    assert!(matches!(run(None, &keeper), Err(PackError::Stopped { .. })));
    let gone_on = run(Some(Resume { body: keeper.kept.into_inner().unwrap() }), &Unattended).unwrap();
    assert_eq!(resumes(&gone_on), 1);
    assert_eq!(gone_on.spheres().unwrap(), whole.spheres().unwrap());
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn a_body_cut_anywhere_starts_anew(at in any::<prop::sample::Index>()) {
        let body = body();
        let anew = gone_on_from(body[..at.index(body.len())].to_vec());
        prop_assert_eq!(resumes(&anew), 0);
    }
}
