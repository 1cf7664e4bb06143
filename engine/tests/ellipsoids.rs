//! Requests whose grains have a shape: packed, checked, the same for a seed, and judged by a search of the test's own.

use std::sync::Mutex;

use nalgebra::{Matrix3, Vector3};
use packstone_engine::packing::GrowthEnd;
use packstone_engine::request::{Distance, GrowthOptions, GrowthStop, Method};
use packstone_engine::shape::{Ellipsoid, Pose};
use packstone_engine::{
    Checkpoint, Control, Limits, PackError, Packing, PackingRequest, Progress, Resume, TargetNotReached,
    TemplateCache, Unattended, pack, pack_or_resume,
};
use serde_json::{Value, json};

pub(crate) fn request(specimen: &Value, fraction: f64, shape: &Value, distance: &Value) -> PackingRequest {
    let request = json!({
        "specimen": specimen,
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 10, "exponent": 0.5}, "d_min_mm": 3,
            "volume_fraction": fraction, "volume_fraction_of": "placed_grains", "shape": shape,
        },
        "distance": distance,
        "method": {"type": "rsa"},
    });
    PackingRequest::from_json(&request, 7).unwrap()
}

pub(crate) fn packed(request: &PackingRequest) -> Packing {
    pack(request, &Limits::default(), &Unattended).unwrap()
}

fn ellipsoids(packing: &Packing) -> Vec<(Ellipsoid, &Pose)> {
    let grains = packing.grains.solids().expect("the grains are no ellipsoids");
    grains.iter().map(|(shape, pose)| (shape.ellipsoid().unwrap(), pose)).collect()
}

pub(crate) fn cube(edge: f64, boundary: &str) -> Value {
    json!({"type": "box", "size_mm": [edge, edge, edge], "boundary": boundary})
}

fn triangle() -> Value {
    json!({"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.4}})
}

/// The largest `s(n)` of two ellipsoids over directions, by ascent from many starts: the surface-to-surface gap.
fn gap(r: Vector3<f64>, a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    let s = |n: &Vector3<f64>| r.dot(n) - n.dot(&(a * n)).sqrt() - n.dot(&(b * n)).sqrt();
    let mut best = (s(&r.normalize()), r.normalize());
    let mut step = 0.5;
    while step > 1e-7 {
        let across = best.1.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize();
        let other = best.1.cross(&across);
        let tried = (0..8)
            .map(|i| f64::from(i) * std::f64::consts::FRAC_PI_4)
            .map(|angle| (best.1 + (across * angle.cos() + other * angle.sin()) * step).normalize())
            .map(|n| (s(&n), n))
            .fold(best, |best, next| if next.0 > best.0 { next } else { best });
        if tried.0 > best.0 { best = tried } else { step /= 2.0 }
    }
    best.0
}

fn growth_of(sweeps: u64) -> GrowthOptions {
    let stop = GrowthStop { sweeps: Some(sweeps), ..GrowthStop::default() };
    GrowthOptions { stop, ..GrowthOptions::default() }
}

#[test]
fn packings_hold_in_all_specimens_and_under_all_rules() {
    let specimens = [
        cube(30.0, "walls"),
        cube(30.0, "periodic"),
        json!({"type": "cylinder", "diameter_mm": 30, "height_mm": 30}),
    ];
    let rules = [
        json!({"type": "none"}),
        json!({"type": "constant", "gap_mm": 0.5}),
        json!({"type": "proportional", "factor": 0.1}),
        json!({"type": "smaller_diameter", "factor": 0.1}),
    ];
    for specimen in &specimens {
        for rule in &rules {
            let request = request(specimen, 0.3, &triangle(), rule);
            let packing = packed(&request);
            let grains = ellipsoids(&packing);
            let matrices: Vec<_> = grains.iter().map(|(shape, pose)| shape.matrix_mm2(pose)).collect();
            let distance =
                packstone_engine::distance::DistanceRule::new(&request.distance, &request.specimen);
            let period = if request.specimen.is_periodic() { 30.0 } else { f64::INFINITY };
            let mut least = f64::INFINITY;
            for i in 0..grains.len() {
                for j in 0..i {
                    let mut r = grains[j].1.center_mm - grains[i].1.center_mm;
                    if period.is_finite() {
                        r.iter_mut().for_each(|x| *x -= period * (*x / period).round());
                    }
                    let [d_i, d_j] = [i, j].map(|k| grains[k].0.equivalent_diameter_mm());
                    let found = gap(r, &matrices[i], &matrices[j]);
                    assert!(found >= distance.gap_mm(d_i, d_j) - 1e-6, "{specimen} {rule} {i} {j} {found}");
                    least = least.min(found);
                }
            }
            let reported = packing.report.check.min_gap_mm.unwrap();
            // The search of the test is a little short of the largest, and sees the nearest images alone.
            assert!(
                (reported - least).abs() < 1e-4 || period.is_finite() && reported < least,
                "{reported} {least}"
            );
            let found: f64 = grains.iter().map(|(shape, _)| shape.volume_mm3()).sum();
            let fraction = found / request.specimen.volume_mm3();
            assert!((fraction / 0.3 - 1.0).abs() < 0.05, "{fraction}");
            assert!((packing.report.summary.volume_fraction_effective - fraction).abs() < 1e-12);
            assert!(packing.report.shapes.is_some());
        }
    }
}

/// AB8 and AB16 of `PyCMG` (Holla et al. 2021, DOI 10.3390/ma14143782): flat ratios by size class, at 0.45.
#[test]
fn the_mixes_of_pycmg_hold() {
    let examples =
        [include_str!("../../examples/pycmg-ab8.json"), include_str!("../../examples/pycmg-ab16.json")];
    for example in examples {
        let mut job: Value = serde_json::from_str(example).unwrap();
        job.as_object_mut().unwrap().retain(|field, _| field != "name");
        let request = PackingRequest::from_json(&job, 1).unwrap();
        let packing = packed(&request);
        let grains = ellipsoids(&packing);
        let matrices: Vec<_> = grains.iter().map(|(shape, pose)| shape.matrix_mm2(pose)).collect();
        let volume: f64 = grains.iter().map(|(shape, _)| shape.volume_mm3()).sum();
        let fraction = volume / request.specimen.volume_mm3();
        assert!((fraction - 0.45).abs() < 0.01, "{fraction}");
        let mut pairs = 0;
        for i in 0..grains.len() {
            for j in 0..i {
                let r = grains[j].1.center_mm - grains[i].1.center_mm;
                let longest = grains[i].0.semi_axes_mm()[0] + grains[j].0.semi_axes_mm()[0];
                if r.norm() < longest {
                    pairs += 1;
                    let found = gap(r, &matrices[i], &matrices[j]);
                    assert!(found >= -1e-6, "{i} {j} {found}");
                }
            }
        }
        assert!(pairs > grains.len(), "{pairs} pairs of {} grains were near", grains.len());
        assert!(grains.iter().any(|(shape, _)| shape.flatness() < 0.8 || shape.elongation() < 0.8));
    }
}

#[test]
fn a_seed_gives_one_packing() {
    let request = request(&cube(40.0, "walls"), 0.4, &triangle(), &json!({"type": "none"}));
    let (first, again) = (packed(&request), packed(&request));
    assert_eq!(first.grains, again.grains);
    let other = packed(&PackingRequest { seed: 8, ..request });
    assert_ne!(first.grains, other.grains);
}

#[test]
fn grains_of_a_mixture_have_their_shares_and_classes_their_shapes() {
    let mixture = json!({"type": "mixture", "of": [
        {"share": 0.5, "shape": {"type": "sphere"}},
        {"share": 0.5, "shape": {"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.8, "flatness": 0.5}}},
    ]});
    let packing = packed(&request(&cube(50.0, "walls"), 0.35, &mixture, &json!({"type": "none"})));
    let report = packing.report.shapes.unwrap();
    assert!((report.zingg.equant - 0.5).abs() < 0.1, "{report:?}");
    assert!((report.zingg.equant + report.zingg.disc - 1.0).abs() < 1e-12, "{report:?}");
    for (grain, _) in ellipsoids(&packing) {
        let (is_sphere, flatness) = (grain.elongation() > 0.99, grain.flatness());
        assert!(if is_sphere { flatness > 0.99 } else { (flatness - 0.5).abs() < 1e-12 }, "{grain:?}");
    }
}

#[test]
fn grains_about_an_axis_lie_flat() {
    let mut value = serde_json::to_value(request(
        &cube(40.0, "walls"),
        0.25,
        &json!({"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.9, "flatness": 0.4}}),
        &json!({"type": "none"}),
    ))
    .unwrap();
    value["mix"]["orientation"] = json!({"type": "axis", "axis": "z", "concentration": 8});
    let packing = packed(&PackingRequest::from_json(&value, 1).unwrap());
    let [xx, yy, zz, ..] = packing.report.shapes.unwrap().short_axis_tensor;
    assert!(zz > 0.75 && (xx + yy + zz - 1.0).abs() < 1e-12, "{xx} {yy} {zz}");
}

#[test]
fn what_no_method_packs_is_refused_by_name() {
    let base =
        serde_json::to_value(request(&cube(30.0, "walls"), 0.3, &triangle(), &json!({"type": "none"})))
            .unwrap();
    for (pointer, at, value, expected) in [
        ("/method/type", "method", json!({"type": "edmd"}), "packs spheres alone"),
        (
            "/segregation/strength",
            "segregation",
            json!({"type": "gradient", "field": {"type": "linear", "axis": "z"}, "strength": 1001}),
            "1000",
        ),
    ] {
        let mut request = base.clone();
        request["method"] = json!({"type": "auto"});
        request[at] = value;
        let faults = PackingRequest::from_json(&request, 1).unwrap_err();
        assert!(
            faults.iter().any(|fault| fault.pointer == pointer && fault.detail.contains(expected)),
            "{faults:?}"
        );
    }
}

/// Keeps the checkpoint at the first cycle that it can, and stops the run after it.
#[derive(Default)]
struct StopAtCheckpoint(Mutex<Vec<u8>>);

impl Control for StopAtCheckpoint {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        !self.0.lock().unwrap().is_empty()
    }
    fn wants_checkpoint(&self) -> bool {
        self.0.lock().unwrap().is_empty()
    }
    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let mut bytes = Vec::new();
        checkpoint.write_to(&mut bytes).unwrap();
        *self.0.lock().unwrap() = bytes;
    }
}

/// Ellipsoids at 0.55, or polyhedra at 0.5.
fn dense(kind: &str, distance: &Value) -> PackingRequest {
    let polyhedron =
        json!({"type": "polyhedron", "rounding": 0.05, "ratios": {"type": "triangle", "k": 0.4}});
    let (shape, fraction) = if kind == "polyhedra" { (polyhedron, 0.5) } else { (triangle(), 0.55) };
    let mut request = request(&cube(30.0, "walls"), fraction, &shape, distance);
    request.method = Method::MonteCarlo { options: GrowthOptions::default() };
    request
}

#[test]
fn growth_goes_on_from_a_checkpoint_as_if_it_had_never_stopped() {
    for kind in ["ellipsoids", "polyhedra"] {
        goes_on_from_a_checkpoint(kind);
    }
}

fn goes_on_from_a_checkpoint(kind: &str) {
    let request = dense(kind, &json!({"type": "constant", "gap_mm": 0.1}));
    let whole = packed(&request);
    let statistics = whole.report.statistics.monte_carlo.unwrap();
    assert_eq!((statistics.stop, statistics.growth_scale), (GrowthEnd::Target, 1.0));
    assert!(whole.report.check.min_gap_mm.unwrap() >= 0.1 && !whole.report.growth_curve.is_empty());
    let stopper = StopAtCheckpoint::default();
    let stopped = pack(&request, &Limits::default(), &stopper).unwrap_err();
    assert!(matches!(stopped, PackError::Stopped { .. }), "{stopped}");
    let checkpoint = stopper.0.into_inner().unwrap();
    let resume = Resume::read_from(&mut &checkpoint[..], &request).unwrap();
    let resumed =
        pack_or_resume(&request, &Limits::default(), &TemplateCache::default(), Some(resume), &Unattended)
            .unwrap();
    assert_eq!(resumed.grains, whole.grains);
    assert_eq!(resumed.report.statistics.monte_carlo.unwrap().resumes, 1);
}

#[test]
fn the_largest_distance_is_found_and_checked() {
    for kind in ["ellipsoids", "polyhedra"] {
        let mut request = dense(kind, &json!({"type": "none"}));
        request.distance = Distance::Maximize { wall_gap_mm: None };
        request.method = Method::MonteCarlo { options: growth_of(2000) };
        let packing = packed(&request);
        let reached = packing.report.summary.distance_mm.unwrap();
        assert!(reached > 0.05 && packing.report.check.min_gap_mm.unwrap() >= reached, "{kind} {reached}");
    }
}

#[test]
fn growth_that_ends_early_says_how_far_it_came() {
    let mut request = dense("ellipsoids", &json!({"type": "none"}));
    request.method = Method::MonteCarlo { options: growth_of(5) };
    match pack(&request, &Limits::default(), &Unattended) {
        Err(PackError::TargetNotReached(TargetNotReached::GrowthStopped(short))) => {
            assert_eq!(short.end, GrowthEnd::SweepLimit);
            assert!(short.scale_reached < 1.0 && short.to_string().contains("raise stop.sweeps"), "{short}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_mix_that_is_too_dense_says_how_far_it_came() {
    let mut request = request(&cube(30.0, "walls"), 0.65, &triangle(), &json!({"type": "none"}));
    request.method = Method::Rsa { attempts_per_grain: Some(1000) };
    match pack(&request, &Limits::default(), &Unattended) {
        Err(PackError::TargetNotReached(TargetNotReached::InsertionFailed(failed))) => {
            assert!(failed.volume_fraction_reached > 0.2 && failed.placed < failed.grains, "{failed}");
        }
        other => panic!("{other:?}"),
    }
}

/// Counts the reports of random addition, one for 2000 draws.
#[derive(Default)]
struct Draws(Mutex<u32>);

impl Control for Draws {
    fn report(&self, progress: &Progress) {
        *self.0.lock().unwrap() += u32::from(progress.step == packstone_engine::Step::Rsa);
    }

    fn should_stop(&self) -> bool {
        false
    }
}

/// It went on for two minutes and 2 GB, for a packing that growth makes in 20 ms.
#[test]
fn a_search_near_saturation_gives_way_to_growth() {
    let request = json!({
        "specimen": cube(30.0, "periodic"),
        "mix": {
            "grading": {"type": "standard", "name": "A8"}, "d_min_mm": 4, "volume_fraction": 0.5,
            "volume_fraction_of": "placed_grains", "allow_coarse": true,
            "shape": {"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.5}},
        },
        "distance": {"type": "constant", "gap_mm": 0.1},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let draws = Draws::default();
    let packing = pack(&request, &Limits::default(), &draws).unwrap();
    assert!(packing.report.statistics.monte_carlo.is_some(), "random addition reached it");
    let reports = *draws.0.lock().unwrap();
    assert!(reports < 500, "{reports} times 2000 draws");
}
