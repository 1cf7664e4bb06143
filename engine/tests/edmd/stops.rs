//! How growth ends and what it says then; what it reports on the way.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use packstone_engine::packing::GrowthEnd;
use packstone_engine::request::{Boundary, Specimen};
use packstone_engine::{
    Checkpoint, Control, GrowthEffort, GrowthStopped, Limits, PackError, Packing, PackingRequest, Progress,
    Resume, Step, TargetNotReached, TemplateCache, Unattended, pack, pack_or_resume,
};
use serde_json::{Value, json};

/// Equal spheres in a cube of ten diameters with walls.
fn spheres(volume_fraction: f64, distance: &Value, method: &Value) -> PackingRequest {
    let mut method = method.clone();
    method["type"] = json!("edmd");
    let value = json!({
        "specimen": {"type": "box", "size_mm": [30, 30, 30]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 3}, "volume_fraction": volume_fraction},
        "distance": distance, "method": method,
    });
    PackingRequest::from_json(&value, 1).unwrap()
}

fn none() -> Value {
    json!({"type": "none"})
}

fn maximize() -> Value {
    json!({"type": "maximize"})
}

fn packed(request: &PackingRequest) -> Packing {
    pack(request, &Limits::default(), &Unattended).unwrap()
}

fn not_grown(request: &PackingRequest) -> GrowthStopped {
    match pack(request, &Limits::default(), &Unattended) {
        Err(PackError::TargetNotReached(TargetNotReached::GrowthStopped(not_grown))) => not_grown,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_target_that_jams_before_is_said_to() {
    let mut request = spheres(0.65, &none(), &json!({"growth_rate": 1.0}));
    // Few grains give up soon.
    request.specimen = Specimen::Box { size_mm: [16.0; 3], boundary: Boundary::Walls };
    let short = not_grown(&request);
    assert_eq!(short.end, GrowthEnd::Stalled);
    // Between what random placing starts from and the densest random packing.
    assert!(short.volume_fraction_reached > 0.5 && short.volume_fraction_reached < 0.64, "{short}");
    let of_scale = short.volume_fraction_asked * short.scale_reached.powi(3);
    assert!((short.volume_fraction_reached / of_scale - 1.0).abs() < 1e-9, "{short}");
    assert!(short.to_string().contains("it stalled, for the grains jam"), "{short}");
}

/// Keeps the checkpoints of every twentieth cycle.
#[derive(Default)]
struct Keeping(Mutex<Vec<Vec<u8>>>, AtomicU32);

impl Control for Keeping {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        false
    }
    fn wants_checkpoint(&self) -> bool {
        self.1.fetch_add(1, Ordering::Relaxed).is_multiple_of(20)
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        self.0.lock().unwrap().push(bytes);
    }
}

/// This seed jams below its target first: only a packing that stalled is expanded.
#[test]
fn a_packing_that_jams_just_below_its_target_is_expanded_and_reaches_it() {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
                "volume_fraction": 0.71, "volume_fraction_of": "placed_grains"},
        "method": {"type": "edmd"},
    });
    let request = PackingRequest::from_json(&value, 1).unwrap();
    let keeping = Keeping::default();
    let packing = pack(&request, &Limits::default(), &keeping).unwrap();
    let grown = packing.report.statistics.edmd.unwrap();
    assert!(grown.stop == GrowthEnd::Target && grown.expansions > 0, "{grown:?}");
    // It goes on from a checkpoint between two expansions to the same packing.
    let kept = keeping.0.into_inner().unwrap();
    let resume = Resume::read_from(&mut kept.last().unwrap().as_slice(), &request).unwrap();
    let resumed =
        pack_or_resume(&request, &Limits::default(), &TemplateCache::default(), Some(resume), &Unattended)
            .unwrap();
    assert_eq!(resumed.grains, packing.grains);
    let again = resumed.report.statistics.edmd.unwrap();
    assert_eq!((again.expansions, again.events, again.resumes), (grown.expansions, grown.events, 1));
}

#[test]
fn a_limit_of_events_ends_growth_at_exactly_so_many() {
    for events in [1, 999, 12_345] {
        let stop = json!({"stop": {"events": events}});
        let short = not_grown(&spheres(0.55, &none(), &stop));
        assert_eq!(short.end, GrowthEnd::EventLimit);
        assert!(matches!(short.effort, GrowthEffort::Events { events: spent, .. } if spent == events));
        assert!(short.scale_reached < 1.0 && short.to_string().contains("raise stop.events"), "{short}");
        // The distance reached is a result, however short the run.
        let packing = packed(&spheres(0.25, &maximize(), &stop));
        let grown = packing.report.statistics.edmd.unwrap();
        assert_eq!((grown.stop, grown.events), (GrowthEnd::EventLimit, events));
    }
}

#[test]
fn a_limit_of_time_ends_growth() {
    let stop = json!({"stop": {"time_s": 1e-3}});
    let short = not_grown(&spheres(0.6, &none(), &stop));
    assert_eq!(short.end, GrowthEnd::TimeLimit);
    assert!(short.scale_reached < 1.0 && short.to_string().contains("raise stop.time_s"), "{short}");
    let packing = packed(&spheres(0.25, &maximize(), &stop));
    assert_eq!(packing.report.statistics.edmd.unwrap().stop, GrowthEnd::TimeLimit);
}

#[test]
fn a_prescribed_distance_that_was_not_reached_is_told() {
    let distance = json!({"type": "constant", "gap_mm": 0.6});
    let short = not_grown(&spheres(0.32, &distance, &json!({"stop": {"events": 3000}})));
    let (reached, asked) = (short.distance_mm_reached.unwrap(), short.distance_mm_asked.unwrap());
    assert_eq!(asked, 0.6);
    assert!(reached < asked && short.to_string().contains("of 0.6000 mm"), "{short}");
    // Spheres of the true size at that distance fill what they fill at the scale that was reached.
    assert!(((3.0 + reached) / (3.6 * short.scale_reached) - 1.0).abs() < 1e-9, "{short}");
}

/// Some 470 grains of Fuller's curve at 0.4, with the largest distance within so many events, or without a limit.
fn paced(events: Option<u64>) -> Packing {
    let stop = events.map_or(json!({}), |events| json!({"events": events}));
    let request = json!({
        "specimen": {"type": "box", "size_mm": [20, 20, 20]},
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 4, "exponent": 0.5},
            "d_min_mm": 1.5, "volume_fraction": 0.4, "volume_fraction_of": "placed_grains",
        },
        "distance": maximize(),
        "method": {"type": "edmd", "stop": stop},
    });
    packed(&PackingRequest::from_json(&request, 1).unwrap())
}

#[test]
fn growth_to_the_largest_distance_uses_its_limit_and_more_collisions_make_it_larger() {
    let packings = [Some(40_000), Some(300_000), None].map(paced);
    let reached = packings.each_ref().map(|packing| packing.report.summary.distance_mm.unwrap());
    for (packing, least) in packings.iter().zip([100.0, 1000.0, 1e6]) {
        let edmd = packing.report.statistics.edmd.as_ref().unwrap();
        assert!(edmd.reduced_pressure > least, "{edmd:?}");
    }
    assert!(reached[0] < reached[1] && reached[1] < reached[2], "{reached:?}");
    let grains = packings[2].spheres().unwrap().len() as u64;
    let events = packings[2].report.statistics.edmd.as_ref().unwrap().events;
    assert!((3500 * grains..5000 * grains).contains(&events), "{events} events of {grains} grains");
}

#[test]
fn the_largest_distance_comes_with_the_way_to_it() {
    let packing = packed(&spheres(0.4, &maximize(), &json!({"stop": {"events": 150_000}})));
    let report = packing.report;
    let distance = report.summary.distance_mm.unwrap();
    let curve = report.distance_curve();
    assert!(curve.len() > 10, "{curve:?}");
    assert!(curve.windows(2).all(|w| w[0][0] <= w[1][0] && w[0][1] < w[1][1]), "it rises: {curve:?}");
    assert!(
        curve[0][1] < 0.3 * distance && curve.last().unwrap()[1] == distance,
        "{distance} after {curve:?}"
    );
    let slack = report.check.min_excess_gap_mm.unwrap();
    assert!((0.0..1e-3).contains(&slack), "the distance is kept, and some pair keeps no more: {slack}");
}

/// Stops after so many reports of one step.
struct StopAfter {
    step: Step,
    reports: AtomicU32,
}

impl Control for StopAfter {
    fn report(&self, progress: &Progress) {
        if progress.step == self.step {
            let left = self.reports.load(Ordering::Relaxed);
            self.reports.store(left.saturating_sub(1), Ordering::Relaxed);
        }
    }
    fn should_stop(&self) -> bool {
        self.reports.load(Ordering::Relaxed) == 0
    }
}

#[test]
fn growth_can_be_stopped_at_any_report() {
    for (distance, fraction) in [(none(), 0.58), (maximize(), 0.3)] {
        for (step, reports) in [(Step::Rsa, 1), (Step::Edmd, 1), (Step::Edmd, 2), (Step::Edmd, 20)] {
            let control = StopAfter { step, reports: AtomicU32::new(reports) };
            let ended = pack(&spheres(fraction, &distance, &json!({})), &Limits::default(), &control);
            assert!(matches!(ended, Err(PackError::Stopped { .. })), "{step:?} {reports}: {ended:?}");
        }
    }
}

/// Keeps every report.
#[derive(Default)]
struct Reports(Mutex<Vec<Progress>>);

impl Control for Reports {
    fn report(&self, progress: &Progress) {
        self.0.lock().unwrap().push(progress.clone());
    }
    fn should_stop(&self) -> bool {
        false
    }
}

fn reports(request: &PackingRequest) -> Vec<Progress> {
    let control = Reports::default();
    pack(request, &Limits::default(), &control).unwrap();
    control.0.into_inner().unwrap()
}

fn assert_rising(reports: &[Progress]) {
    for two in reports.windows(2) {
        assert!(two[0].fraction <= two[1].fraction, "{:?} after {:?}", two[1], two[0]);
        assert!(two[0].step as u32 <= two[1].step as u32, "{:?} after {:?}", two[1], two[0]);
    }
    assert!(reports.iter().all(|progress| (0.0..=1.0).contains(&progress.fraction)));
    assert_eq!(reports.last().unwrap().fraction, 1.0);
}

#[test]
fn growth_reports_how_far_it_is() {
    let reports = reports(&spheres(0.56, &none(), &json!({})));
    assert_rising(&reports);
    let growing: Vec<_> = reports.iter().filter(|progress| progress.step == Step::Edmd).collect();
    assert!(growing.len() > 10);
    let grown: Vec<_> = growing.iter().map(|progress| progress.growth.unwrap()).collect();
    assert!(
        grown.windows(2).all(|w| w[0].volume_fraction <= w[1].volume_fraction && w[0].events <= w[1].events)
    );
    let last = grown.last().unwrap();
    assert!((last.volume_fraction - 0.56).abs() < 0.001, "{last:?}");
    assert!(last.reduced_pressure.unwrap() > 5.0, "{last:?}");
    // It is not all said at the end: half of the events are half of the way, or so.
    let half = growing.iter().find(|progress| progress.done * 2 >= last.events).unwrap();
    assert!(half.fraction > 0.1 && half.fraction < 0.9, "{half:?} of {}", last.events);
}

#[test]
fn the_largest_distance_is_reported_as_it_grows() {
    let reports = reports(&spheres(0.25, &maximize(), &json!({"stop": {"events": 100_000}})));
    assert_rising(&reports);
    let distances: Vec<f64> = reports.iter().filter_map(|progress| progress.growth?.distance_mm).collect();
    assert!(distances.len() > 10 && distances.is_sorted(), "{distances:?}");
}

#[test]
fn progress_does_not_fall_between_the_stages_of_the_largest_distance() {
    let method = json!({"initial_scale": 0.9, "stop": {"events": 100_000}});
    assert_rising(&reports(&spheres(0.4, &maximize(), &method)));
}

#[test]
fn progress_does_not_fall_when_growth_takes_over() {
    // Between walls this near, random placing reaches less than its estimate has it: it fails, and not at once.
    let value = json!({
        "specimen": {"type": "box", "size_mm": [150, 150, 6]},
        "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4}, "volume_fraction": 0.27},
    });
    let reports = reports(&PackingRequest::from_json(&value, 1).unwrap());
    let furthest = |step| reports.iter().filter(|p| p.step == step).map(|p| p.fraction).reduce(f64::max);
    assert!(furthest(Step::Rsa) > Some(0.1) && furthest(Step::Edmd).is_some(), "both have something to say");
    assert_rising(&reports);
}
