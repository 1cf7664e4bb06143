//! Growth by both ways: which one runs, spheres by moves, and runs that are interrupted.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use serde_json::{Value, json};

use super::{pack, pack_or_resume};
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, Progress, Unattended};
use crate::packing::{GrainsRef, MethodUsed, Packing};
use crate::request::PackingRequest;
use crate::{Limits, PackError, TemplateCache};

fn request(specimen: &Value, mix: &Value, more: &Value) -> PackingRequest {
    let mut value = json!({"specimen": specimen, "mix": mix});
    for (name, of) in more.as_object().unwrap() {
        value[name] = of.clone();
    }
    PackingRequest::from_json(&value, 5).unwrap()
}

fn packed(request: &PackingRequest) -> Packing {
    pack(request, &Limits::default(), &Unattended).unwrap()
}

fn walls(edge_mm: f64) -> Value {
    json!({"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm]})
}

fn periodic(edge_mm: f64) -> Value {
    json!({"type": "box", "size_mm": [edge_mm, edge_mm, edge_mm], "boundary": "periodic"})
}

fn fuller(volume_fraction: f64) -> Value {
    json!({"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
        "volume_fraction": volume_fraction, "volume_fraction_of": "placed_grains"})
}

fn shaped(volume_fraction: f64) -> Value {
    let mut mix = fuller(volume_fraction);
    mix["shape"] =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}});
    mix
}

/// Centres and sizes, to the last bit.
fn grains(packing: &Packing) -> Vec<[u64; 4]> {
    let grains = GrainsRef::from(&packing.grains);
    let one = |i: usize| {
        let [x, y, z] = grains.center_mm(i);
        [x, y, z, grains.d_mm(i)].map(f64::to_bits)
    };
    (0..grains.len()).map(one).collect()
}

#[test]
fn growth_takes_the_way_that_is_for_the_grains() {
    for (mix, forced, used) in
        [(fuller(0.55), "edmd", MethodUsed::Edmd), (shaped(0.5), "monte_carlo", MethodUsed::MonteCarlo)]
    {
        let by = |name: &str| packed(&request(&walls(16.0), &mix, &json!({"method": {"type": name}})));
        let (grown, forced) = (by("growth"), by(forced));
        assert_eq!(grown.report.summary.method_used, Some(used));
        assert_eq!(grains(&grown), grains(&forced));
    }
}

#[test]
fn spheres_grow_by_moves_in_every_specimen_with_every_distance() {
    let cylinder = json!({"type": "cylinder", "diameter_mm": 18, "height_mm": 16});
    for (specimen, volume_fraction) in [(walls(18.0), 0.52), (periodic(16.0), 0.56), (cylinder, 0.5)] {
        for distance in [
            json!({"type": "none"}),
            json!({"type": "constant", "gap_mm": 0.1, "wall_gap_mm": 0}),
            json!({"type": "proportional", "factor": 0.02}),
        ] {
            let more = json!({"method": {"type": "monte_carlo"}, "distance": distance});
            let packing = packed(&request(&specimen, &fuller(volume_fraction), &more));
            // The run has passed its own check.
            assert_eq!(packing.report.summary.method_used, Some(MethodUsed::MonteCarlo));
            assert!(packing.spheres().is_some());
            let counted = packing.report.statistics.monte_carlo.unwrap();
            assert!(counted.swaps_accepted > 0 && counted.moves_accepted > 0);
        }
    }
}

#[test]
fn the_largest_distance_of_spheres_by_moves_is_kept_by_all() {
    let more = json!({"method": {"type": "monte_carlo", "stop": {"sweeps": 800}},
        "distance": {"type": "maximize"}});
    let packing = packed(&request(&periodic(16.0), &fuller(0.45), &more));
    let distance_mm = packing.report.summary.distance_mm.unwrap();
    assert!(distance_mm > 0.3, "{distance_mm}");
    assert!(packing.report.check.min_excess_gap_mm.unwrap() >= -1e-12);
}

#[test]
fn moves_heed_the_scale_to_start_from_and_the_swaps() {
    let by = |method: Value| packed(&request(&periodic(14.0), &fuller(0.6), &json!({"method": method})));
    let plain = by(json!({"type": "monte_carlo"}));
    let other = by(json!({"type": "monte_carlo", "initial_scale": 0.6}));
    assert_ne!(grains(&plain), grains(&other));
    assert!(
        other.report.statistics.monte_carlo.unwrap().compression_cycles
            > plain.report.statistics.monte_carlo.unwrap().compression_cycles
    );
    let unswapped = by(json!({"type": "monte_carlo", "swap": false}));
    assert_eq!(unswapped.report.statistics.monte_carlo.unwrap().swaps_tried, 0);
}

/// Stops a run at a checkpoint.
struct Keeper {
    after: u32,
    questions: AtomicU32,
    kept: Mutex<Vec<u8>>,
}

impl Control for Keeper {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        !self.kept.lock().unwrap().is_empty()
    }
    fn wants_checkpoint(&self) -> bool {
        self.questions.fetch_add(1, Ordering::Relaxed) == self.after
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        checkpoint.write_to(&mut *self.kept.lock().unwrap()).unwrap();
    }
}

#[test]
fn spheres_that_grow_by_moves_go_on_from_a_checkpoint() {
    let stop = json!({"sweeps": 900});
    for more in [
        json!({"method": {"type": "monte_carlo"}}),
        json!({"method": {"type": "monte_carlo", "stop": stop}, "distance": {"type": "maximize"}}),
    ] {
        let fraction = if more["distance"].is_null() { 0.62 } else { 0.4 };
        let request = request(&periodic(14.0), &fuller(fraction), &more);
        let whole = packed(&request);
        for after in [1, 4] {
            let keeper = Keeper { after, questions: AtomicU32::new(0), kept: Mutex::new(Vec::new()) };
            let templates = TemplateCache::default();
            let ended = pack_or_resume(&request, &Limits::default(), &templates, None, &keeper);
            assert!(matches!(ended, Err(PackError::Stopped { .. })), "{ended:?}");
            let bytes = keeper.kept.into_inner().unwrap();
            let resume = Resume::read_from(&mut &bytes[..], &request).unwrap();
            let resumed =
                pack_or_resume(&request, &Limits::default(), &templates, Some(resume), &Unattended).unwrap();
            assert_eq!(resumed.report.statistics.monte_carlo.unwrap().resumes, 1);
            assert_eq!(grains(&resumed), grains(&whole));
        }
    }
}
