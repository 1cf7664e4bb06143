//! Both methods with polyhedra, alone and among ellipsoids: packings that are checked pair by pair, laws, runs that are
//! repeated and continued.

use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::sync::Mutex;

use crate::properties::properties;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use serde_json::json;

use super::addition::End;
use super::growth::Outcome;
use super::monte_carlo::{MonteCarlo, USUAL_TARGET_SHARE};
use super::rsa_shapes::{AttemptsIn, ShapeRsa};
use crate::check::certify_shapes;
use crate::control::{Control, Progress, Unattended};
use crate::cpu::tests::on_baseline;
use crate::distance::DistanceRule;
use crate::gap::grain::ConvexShape;
use crate::gap::polyhedra::Body;
use crate::mix::uniform_orientation;
use crate::packing::{GrowthEnd, MonteCarloStatistics};
use crate::request::{Boundary, Distance, GrowthStop, PackingRequest, Specimen};
use crate::rng::uniform;
use crate::shape::polyhedron::samples::cuboid;
use crate::shape::polyhedron::{TemplateKind, draw_template};
use crate::shape::{Ellipsoid, Form, Polyhedron, Pose, ScaledPolyhedron, SolidRef};

const BOX: Specimen = Specimen::Box { size_mm: [30.0, 25.0, 20.0], boundary: Boundary::Walls };
const NONE: Distance = Distance::None { wall_gap_mm: None };

/// Templates of an equivalent diameter of 1.
fn templates(kind: TemplateKind, form: Form, rounding: f64, count: usize, seed: u64) -> Vec<Polyhedron> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut one = || draw_template(kind, form, &mut rng).unwrap().normalized();
    (0..count).map(|_| one().with_relative_rounding(rounding).unwrap()).collect()
}

fn cuts(rounding: f64) -> Vec<Polyhedron> {
    templates(TemplateKind::Cuts(15), Form { elongation: 0.8, flatness: 0.8 }, rounding, 6, 1)
}

/// Diameters from `d_max` to a quarter of it that fill this share of a specimen.
fn shapes<'a>(
    templates: &'a [Polyhedron],
    specimen: &Specimen,
    fraction: f64,
    d_max: f64,
) -> Vec<SolidRef<'a>> {
    let of = |count: usize| -> Vec<SolidRef<'a>> {
        let scale_mm = |i: usize| d_max * 0.25_f64.powf(i as f64 / count as f64);
        let template = |i: usize| &templates[i % templates.len()];
        (0..count).map(|i| polyhedron(template(i), scale_mm(i))).collect()
    };
    let volume = |shapes: &[SolidRef<'_>]| shapes.iter().map(SolidRef::volume_mm3).sum::<f64>();
    let count = (10..10_000).find(|&count| volume(&of(count)) >= fraction * specimen.volume_mm3());
    of(count.unwrap() - 1)
}

fn polyhedron(template: &Polyhedron, scale_mm: f64) -> SolidRef<'_> {
    ScaledPolyhedron { template, scale_mm }.into()
}

/// The same sizes; of three grains in turn one stays a polyhedron, one becomes an ellipsoid and one a sphere.
fn with_ellipsoids(shapes: Vec<SolidRef<'_>>) -> Vec<SolidRef<'_>> {
    let forms = [None, Some(Form { elongation: 0.7, flatness: 0.6 }), Some(Form::SPHERE)];
    let other = |(i, shape): (usize, &SolidRef<'_>)| {
        let form = forms[i % 3]?;
        Some(Ellipsoid::with_equivalent_diameter(shape.equivalent_diameter_mm(), form).unwrap().into())
    };
    let others: Vec<Option<SolidRef<'_>>> = shapes.iter().enumerate().map(other).collect();
    let mut mixed: Vec<SolidRef<'_>> =
        shapes.into_iter().zip(others).map(|(shape, other)| other.unwrap_or(shape)).collect();
    mixed.sort_by(|p, q| q.equivalent_diameter_mm().total_cmp(&p.equivalent_diameter_mm()));
    mixed
}

fn rule(distance: &Distance, specimen: &Specimen) -> DistanceRule {
    DistanceRule::new(distance, specimen)
}

fn rsa<'a>(
    shapes: &'a [SolidRef<'a>],
    specimen: &'a Specimen,
    distance: &Distance,
) -> ShapeRsa<'a, SolidRef<'a>> {
    ShapeRsa {
        shapes,
        domain: specimen.domain(),
        rule: rule(distance, specimen),
        attempts_per_grain: Some(3_000_000),
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    }
}

fn growth<'a>(
    shapes: &'a [SolidRef<'a>],
    specimen: &'a Specimen,
    distance: &Distance,
) -> MonteCarlo<'a, SolidRef<'a>> {
    let maximize = match *distance {
        Distance::Maximize { wall_gap_mm } => Some(wall_gap_mm),
        _ => None,
    };
    MonteCarlo {
        shapes,
        domain: specimen.domain(),
        rule: rule(distance, specimen),
        maximize,
        initial_scale: None,
        swap: true,
        stop: GrowthStop::default(),
        orientation: &uniform_orientation,
        seed: 3,
        preference: None,
        keep_checkpoint: None,
        to_jamming: None,
        keeps_partial: false,
        threads: NonZeroUsize::MIN,
        target_share: USUAL_TARGET_SHARE,
    }
}

/// What growth counted.
fn counted(outcome: &Outcome<Vec<Pose>>) -> MonteCarloStatistics {
    outcome.statistics.monte_carlo.unwrap()
}

fn sweeps(most: u64) -> GrowthStop {
    GrowthStop { sweeps: Some(most), ..GrowthStop::default() }
}

/// Fails unless all gaps are kept, by the check, which shares nothing with the methods.
fn assert_valid(specimen: &Specimen, distance: &Distance, shapes: &[SolidRef<'_>], poses: &[Pose]) {
    let any = json!({
        "specimen": {"type": "box", "size_mm": [30, 30, 30]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [1]}},
    });
    let mut request = PackingRequest::from_json(&any, 1).unwrap();
    (request.specimen, request.distance) = (*specimen, *distance);
    assert_eq!(shapes.len(), poses.len());
    let certified = certify_shapes(shapes, poses, &request, 0.0, &Unattended);
    assert!(certified.is_ok(), "{specimen:?} {distance:?}: {certified:?}");
}

fn specimens() -> [Specimen; 3] {
    [
        BOX,
        Specimen::Box { size_mm: [30.0, 25.0, 20.0], boundary: Boundary::Periodic },
        Specimen::Cylinder { diameter_mm: 28.0, height_mm: 24.0 },
    ]
}

fn distances() -> [Distance; 4] {
    [
        NONE,
        Distance::Constant { gap_mm: 0.2, wall_gap_mm: Some(0.3) },
        Distance::Proportional { factor: 0.06, wall_gap_mm: None },
        Distance::SmallerDiameter { factor: 0.08, wall_gap_mm: Some(0.0) },
    ]
}

#[test]
fn added_grains_keep_all_gaps_in_all_specimens() {
    for (rounding, is_mixed) in [(0.0, false), (0.1, false), (0.0, true), (0.1, true)] {
        let templates = cuts(rounding);
        for specimen in &specimens() {
            for distance in &distances() {
                let shapes = shapes(&templates, specimen, 0.3, 7.0);
                let shapes = if is_mixed { with_ellipsoids(shapes) } else { shapes };
                let rsa = rsa(&shapes, specimen, distance);
                let run = || rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(7), &Unattended);
                let outcome = run();
                assert_eq!(outcome.end, End::Complete, "{specimen:?} {distance:?}");
                assert_valid(specimen, distance, &shapes, &outcome.placed);
                assert_eq!(outcome, run());
            }
        }
    }
}

#[test]
fn grown_grains_keep_all_gaps_in_all_specimens() {
    for (rounding, is_mixed) in [(0.0, false), (0.1, false), (0.0, true), (0.1, true)] {
        let templates = cuts(rounding);
        for specimen in &specimens() {
            for distance in &distances() {
                let fraction = if *distance == NONE { 0.48 } else { 0.38 };
                let shapes = shapes(&templates, specimen, fraction, 7.0);
                let shapes = if is_mixed { with_ellipsoids(shapes) } else { shapes };
                let outcome = growth(&shapes, specimen, distance).run(None, &Unattended).unwrap();
                assert_eq!((outcome.end, outcome.scale), (GrowthEnd::Target, 1.0), "{distance:?}");
                assert_valid(specimen, distance, &shapes, &outcome.placed);
                assert!(counted(&outcome).compression_cycles > 1 && counted(&outcome).moves_accepted > 0);
            }
        }
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// Templates of all kinds, sharp and rounded, compact and elongated.
    #[test]
    fn random_templates_are_packed_without_violation(
        seed in 0_u64..1_000_000, kind in 0..3_usize, elongation in 0.3..1.0_f64, flatness in 0.4..1.0_f64,
        rounding in prop_oneof![Just(0.0), 0.001..0.25_f64], specimen in 0..3_usize,
        grows in any::<bool>(), is_mixed in any::<bool>(),
    ) {
        let kind =
            [TemplateKind::Cuts(8 + (seed % 20) as u32), TemplateKind::Cuboid(0.2), TemplateKind::Voronoi][kind];
        let templates = templates(kind, Form { elongation, flatness }, rounding, 4, seed);
        let specimen = specimens()[specimen];
        let distance = distances()[(seed % 4) as usize];
        let shapes = shapes(&templates, &specimen, if grows { 0.3 } else { 0.2 }, 6.0);
        let shapes = if is_mixed { with_ellipsoids(shapes) } else { shapes };
        let poses = if grows {
            let method = MonteCarlo { seed, ..growth(&shapes, &specimen, &distance) };
            method.run(None, &Unattended).unwrap().placed
        } else {
            let rsa = rsa(&shapes, &specimen, &distance);
            let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(seed), &Unattended);
            prop_assert_eq!(outcome.end, End::Complete);
            outcome.placed
        };
        assert_valid(&specimen, &distance, &shapes, &poses);
    }
}

/// The law of places is that of the textbook algorithm: means and spreads over many runs, with few attempts wasted in
/// one and all of them counted in the other.
#[test]
fn the_law_and_the_attempts_are_those_of_the_textbook_algorithm() {
    let specimen = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Walls };
    let templates = cuts(0.0);
    let sizes = [4.4, 4.2, 4.0, 3.9, 3.8, 3.6];
    let polyhedra: Vec<_> = sizes
        .iter()
        .zip(&templates)
        .map(|(&scale_mm, template)| ScaledPolyhedron { template, scale_mm })
        .collect();
    let shapes: Vec<SolidRef<'_>> = polyhedra.iter().map(|&shape| shape.into()).collect();
    let rsa = rsa(&shapes, &specimen, &NONE);
    let textbook = |rng: &mut Xoshiro256PlusPlus| {
        let (mut poses, mut attempts): (Vec<Pose>, u64) = (Vec::new(), 0);
        for (i, shape) in polyhedra.iter().enumerate() {
            loop {
                attempts += 1;
                let center_mm = Vector3::from_fn(|_, _| 10.0 * uniform(rng));
                let pose = Pose { center_mm, orientation: uniform_orientation(rng) };
                let is_inside = |v: Vector3<f64>| v.iter().all(|x| (0.0..=10.0).contains(x));
                let body = Body::new(shape.template, shape.scale_mm, &pose);
                let is_clear = |j: usize| {
                    let other = Body::new(polyhedra[j].template, polyhedra[j].scale_mm, &poses[j]);
                    body.with(&other).decide(0.0).is_apart
                };
                let mut corners = shape.template.world_vertices_mm(shape.scale_mm, &pose);
                if corners.all(is_inside) && (0..i).all(is_clear) {
                    poses.push(pose);
                    break;
                }
            }
        }
        (poses, attempts)
    };
    // Distance of the last grain from the middle, an axis of it along x, and the attempts.
    let measure = |poses: &[Pose], attempts: u64| {
        let last = poses.last().unwrap();
        let long = last.orientation * Vector3::x();
        [(last.center_mm - Vector3::from([5.0; 3])).norm(), long.x * long.x, (attempts as f64).ln()]
    };
    let runs = 1200;
    let mut sums = [[[0.0_f64; 2]; 3]; 2];
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(11);
    for _ in 0..runs {
        let outcome = rsa.run(&mut rng, &Unattended);
        assert_eq!(outcome.end, End::Complete);
        let (poses, attempts) = textbook(&mut rng);
        let both = [measure(&outcome.placed, outcome.statistics.attempts), measure(&poses, attempts)];
        for (sum, of) in sums.iter_mut().zip(both) {
            for (sum, x) in sum.iter_mut().zip(of) {
                *sum = [sum[0] + x, sum[1] + x * x];
            }
        }
    }
    let count = f64::from(runs);
    for (ours, theirs) in sums[0].iter().zip(&sums[1]) {
        let [mean, other] = [ours, theirs].map(|sum| sum[0] / count);
        let variance = (ours[1] + theirs[1]) / count - mean * mean - other * other;
        let error = (variance / count).sqrt();
        assert!((mean - other).abs() < 4.0 * error, "{mean} {other} {error}");
    }
}

#[test]
fn saturation_is_proven_where_a_grain_leaves_no_place_and_only_there() {
    let specimen = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Walls };
    let cube = cuboid([0.5; 3], 0.0);
    let along = |_: &mut Xoshiro256PlusPlus| UnitQuaternion::identity();
    let run = |scales: [f64; 2], attempts_per_grain| {
        let shapes = scales.map(|scale_mm| polyhedron(&cube, scale_mm));
        let rsa = ShapeRsa { attempts_per_grain, orientation: &along, ..rsa(&shapes, &specimen, &NONE) };
        rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(3), &Unattended).end
    };
    let is_proven = |end: &End| matches!(end, End::InsertionFailed { saturation_proven: true, .. });
    for scales in [[9.5, 9.0], [11.0, 4.0]] {
        let end = run(scales, None);
        assert!(is_proven(&end), "{end:?}");
    }
    // Spheres inside would have a place in a corner: nothing is proven where only the cube has none.
    let end = run([8.0, 2.5], Some(100_000));
    assert_eq!(end, End::InsertionFailed { saturation_proven: false, attempts: 100_000 });
    assert_eq!(run([6.0, 2.0], Some(1_000_000)), End::Complete);
}

#[test]
fn a_long_grain_keeps_clear_of_its_own_images() {
    let specimen = Specimen::Box { size_mm: [9.0, 10.0, 9.5], boundary: Boundary::Periodic };
    let (beam, cube) = (cuboid([6.0, 1.2, 1.0], 0.0), cuboid([1.0; 3], 0.2));
    let mut shapes = vec![polyhedron(&beam, 1.0)];
    shapes.extend(vec![polyhedron(&cube, 1.0); 18]);
    let outcome = growth(&shapes, &specimen, &NONE).run(None, &Unattended).unwrap();
    assert_eq!(outcome.end, GrowthEnd::Target);
    assert_valid(&specimen, &NONE, &shapes, &outcome.placed);
    let along = |_: &mut Xoshiro256PlusPlus| UnitQuaternion::identity();
    let rsa =
        ShapeRsa { orientation: &along, attempts_per_grain: Some(100_000), ..rsa(&shapes, &specimen, &NONE) };
    let end = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(1), &Unattended).end;
    assert_eq!(end, End::InsertionFailed { saturation_proven: false, attempts: 100_000 });
}

#[test]
fn a_dense_packing_prefers_no_direction() {
    let specimen = Specimen::Box { size_mm: [30.0; 3], boundary: Boundary::Walls };
    let templates = cuts(0.0);
    let shapes = shapes(&templates, &specimen, 0.53, 7.0);
    let outcome = growth(&shapes, &specimen, &NONE).run(None, &Unattended).unwrap();
    assert_eq!(outcome.end, GrowthEnd::Target);
    assert_valid(&specimen, &NONE, &shapes, &outcome.placed);
    let mut tensor = Matrix3::zeros();
    for pose in &outcome.placed {
        let axis = pose.orientation * Vector3::x();
        tensor += axis * axis.transpose() / outcome.placed.len() as f64;
    }
    assert!((tensor - Matrix3::identity() / 3.0).abs().max() < 0.06, "{tensor}");
}

#[test]
fn every_cycle_ends_valid_at_its_scale() {
    let templates = cuts(0.05);
    let polyhedra = shapes(&templates, &BOX, 0.55, 6.0);
    for (sweeps, is_mixed) in [(5, false), (40, false), (120, false), (5, true), (120, true)] {
        let shapes = if is_mixed { with_ellipsoids(polyhedra.clone()) } else { polyhedra.clone() };
        let mut method = growth(&shapes, &BOX, &NONE);
        method.stop.sweeps = Some(sweeps);
        let outcome = method.run(None, &Unattended).unwrap();
        let scale = outcome.scale * (1.0 - 1e-12);
        let present: Vec<_> = shapes.iter().map(|shape| shape.scaled(scale).unwrap()).collect();
        assert_valid(&BOX, &NONE, &present, &outcome.placed);
    }
}

#[test]
fn runs_are_the_same_again_and_on_every_processor() {
    let templates = cuts(0.02);
    let polyhedra = shapes(&templates, &BOX, 0.5, 6.0);
    let distance = Distance::Proportional { factor: 0.02, wall_gap_mm: None };
    for shapes in [polyhedra.clone(), with_ellipsoids(polyhedra)] {
        let run = || growth(&shapes, &BOX, &distance).run(None, &Unattended).unwrap().placed;
        let poses = run();
        assert_eq!(poses, run());
        assert_eq!(poses, on_baseline(run));
        let other = MonteCarlo { seed: 4, ..growth(&shapes, &BOX, &distance) };
        assert_ne!(poses, other.run(None, &Unattended).unwrap().placed);
    }
}

/// Wants every checkpoint that it is offered.
struct Wants;

impl Control for Wants {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        false
    }
    fn wants_checkpoint(&self) -> bool {
        true
    }
}

#[test]
fn a_run_goes_on_from_any_checkpoint_as_if_it_had_never_stopped() {
    let templates = cuts(0.03);
    let largest = Distance::Maximize { wall_gap_mm: None };
    for (distance, is_mixed) in [(NONE, false), (largest, false), (NONE, true), (largest, true)] {
        let shapes = shapes(&templates, &BOX, 0.45, 6.0);
        let shapes = if is_mixed { with_ellipsoids(shapes) } else { shapes };
        let bodies: Mutex<Vec<Vec<u8>>> = Mutex::default();
        let keep = |write: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
            let mut body = Vec::new();
            write(&mut body).unwrap();
            bodies.lock().unwrap().push(body);
        };
        let method = MonteCarlo {
            keep_checkpoint: Some(&keep),
            stop: sweeps(120),
            initial_scale: Some(0.85),
            ..growth(&shapes, &BOX, &distance)
        };
        let whole = method.run(None, &Wants).unwrap();
        let bodies = std::mem::take(&mut *bodies.lock().unwrap());
        assert!(bodies.len() > 2 && counted(&whole).swaps_accepted > 0, "{}", bodies.len());
        // The first, the last and every other one between.
        for body in bodies.iter().step_by(2).chain(bodies.last()) {
            let resumed = method.run(Some(body), &Unattended).unwrap();
            assert_eq!(resumed.placed, whole.placed);
            let as_whole = MonteCarloStatistics { resumes: 0, ..counted(&resumed) };
            assert_eq!((as_whole, counted(&resumed).resumes), (counted(&whole), 1));
            assert_eq!((resumed.distance_mm, resumed.end), (whole.distance_mm, whole.end));
        }
        let body = &bodies[1];
        let short = MonteCarlo { stop: sweeps(5), ..method };
        for at in (0..body.len()).step_by(body.len() / 20) {
            let mut damaged = body.clone();
            damaged[at] ^= 0xff;
            let outcome = short.run(Some(&damaged), &Unattended).unwrap();
            assert_eq!(outcome.placed.len(), shapes.len());
        }
    }
}

#[test]
fn the_largest_gap_is_kept_by_all() {
    let templates = cuts(0.0);
    for wall_gap_mm in [None, Some(0.1)] {
        for specimen in &specimens() {
            let shapes = shapes(&templates, specimen, 0.35, 6.0);
            let mut method = growth(&shapes, specimen, &Distance::Maximize { wall_gap_mm });
            method.stop.sweeps = Some(400);
            let outcome = method.run(None, &Unattended).unwrap();
            let gap_mm = outcome.distance_mm.unwrap();
            assert!(gap_mm > 0.1 && outcome.scale == 1.0, "{gap_mm}");
            let distance = Distance::Constant { gap_mm, wall_gap_mm };
            assert_valid(specimen, &distance, &shapes, &outcome.placed);
        }
    }
}
