//! Packings in all specimens, the law of places, and when saturation is proven.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::{UnitQuaternion, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use serde_json::json;

use super::*;
use crate::PackingRequest;
use crate::control::{Progress, Step, Unattended};
use crate::gap::ellipsoids::Body;
use crate::methods::brute_force_tests::assert_valid;
use crate::methods::rsa::Rsa;
use crate::mix::uniform_orientation;
use crate::request::Specimen;
use crate::request::{Boundary, Distance};
use crate::rng::uniform;
use crate::shape::polyhedron::samples::cuboid;
use crate::shape::{Ellipsoid, ScaledPolyhedron};

fn boxed(size_mm: [f64; 3], boundary: Boundary) -> Specimen {
    Specimen::Box { size_mm, boundary }
}

/// Ellipsoids of diameters from `d_max` down to `d_min`, with these axis ratios.
fn shapes(count: usize, d_max: f64, d_min: f64, ratios: [f64; 3]) -> Vec<Ellipsoid> {
    let unit = libm::cbrt(ratios.iter().product::<f64>());
    let d = |i: usize| d_max * (d_min / d_max).powf(i as f64 / (count - 1) as f64);
    (0..count).map(|i| Ellipsoid::new(ratios.map(|r| r / unit * d(i) / 2.0)).unwrap()).collect()
}

#[test]
fn packings_keep_all_gaps_in_all_specimens() {
    let specimens = [
        boxed([30.0, 25.0, 20.0], Boundary::Walls),
        boxed([30.0, 25.0, 20.0], Boundary::Periodic),
        Specimen::Cylinder { diameter_mm: 28.0, height_mm: 24.0 },
    ];
    let distances = [
        Distance::None { wall_gap_mm: None },
        Distance::Constant { gap_mm: 0.3, wall_gap_mm: Some(0.7) },
        Distance::Proportional { factor: 0.1, wall_gap_mm: None },
        Distance::SmallerDiameter { factor: 0.15, wall_gap_mm: Some(0.0) },
    ];
    for (ratios, count, d_max) in [([1.5, 1.2, 1.0], 55, 8.0), ([4.0, 2.0, 1.0], 45, 5.0)] {
        let shapes = shapes(count, d_max, 2.0, ratios);
        for specimen in &specimens {
            for distance in &distances {
                let rsa = ShapeRsa {
                    shapes: &shapes,
                    domain: specimen.domain(),
                    rule: DistanceRule::new(distance, specimen),
                    attempts_per_grain: Some(1_000_000),
                    attempts_in: AttemptsIn::Specimen,
                    threads: NonZeroUsize::MIN,
                    orientation: &uniform_orientation,
                };
                let run = || rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(7), &Unattended);
                let outcome = run();
                assert_eq!(outcome.end, End::Complete, "{specimen:?} {distance:?}");
                assert_valid(specimen, &rsa.rule, rsa.shapes, &outcome.placed);
                assert_eq!(outcome, run());
            }
        }
    }
}

#[test]
fn a_box_that_is_hardly_longer_than_a_grain_repeats_without_overlap() {
    let specimen = boxed([9.0, 10.0, 9.5], Boundary::Periodic);
    // The longest axis is longer than every edge: the grain would meet its own image along an edge.
    let shapes = vec![Ellipsoid::new([6.0, 1.5, 1.0]).unwrap(), Ellipsoid::new([2.0, 1.0, 1.0]).unwrap()];
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule,
        attempts_per_grain: Some(100_000),
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    for seed in 0..20 {
        let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(seed), &Unattended);
        assert_eq!(outcome.end, End::Complete);
        assert_valid(&specimen, &rsa.rule, rsa.shapes, &outcome.placed);
    }
    let along_an_edge = |_: &mut Xoshiro256PlusPlus| UnitQuaternion::identity();
    let outcome = ShapeRsa { orientation: &along_an_edge, ..rsa }
        .run(&mut Xoshiro256PlusPlus::seed_from_u64(1), &Unattended);
    assert_eq!(outcome.end, End::InsertionFailed { saturation_proven: false, attempts: 100_000 });
}

#[test]
fn saturation_is_proven_where_a_grain_leaves_no_place_and_only_there() {
    let specimen = boxed([10.0; 3], Boundary::Walls);
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
    let run = |axes: [[f64; 3]; 2]| {
        let shapes = axes.map(|axes| Ellipsoid::new(axes).unwrap());
        let rsa = ShapeRsa {
            shapes: &shapes,
            domain: specimen.domain(),
            rule,
            attempts_per_grain: None,
            attempts_in: AttemptsIn::Specimen,
            threads: NonZeroUsize::MIN,
            orientation: &uniform_orientation,
        };
        rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(3), &Unattended)
    };
    // Spheres of 9 mm and 8 mm in a box of 10 mm.
    let outcome = run([[4.5; 3], [4.0; 3]]);
    assert!(matches!(outcome.end, End::InsertionFailed { saturation_proven: true, .. }), "{:?}", outcome.end);
    assert_eq!(outcome.placed.len(), 1);
    // A grain that is wider than the specimen.
    let outcome = run([[6.0; 3], [4.0; 3]]);
    assert!(matches!(outcome.end, End::InsertionFailed { saturation_proven: true, .. }));
    // A corner is free.
    assert_eq!(run([[4.5; 3], [0.8; 3]]).end, End::Complete);
}

/// The law of places is that of the textbook algorithm: means and spreads of coordinates over many runs, with few
/// attempts wasted in one and all of them counted in the other.
#[test]
fn the_law_and_the_attempts_are_those_of_the_textbook_algorithm() {
    let specimen = boxed([10.0; 3], Boundary::Walls);
    let shapes = shapes(6, 4.4, 3.6, [1.6, 1.2, 1.0]);
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule,
        attempts_per_grain: Some(1_000_000),
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let textbook = |rng: &mut Xoshiro256PlusPlus| {
        let (mut poses, mut attempts): (Vec<Pose>, u64) = (Vec::new(), 0);
        for (i, shape) in shapes.iter().enumerate() {
            loop {
                attempts += 1;
                let center_mm = Vector3::from_fn(|_, _| 10.0 * uniform(rng));
                let pose = Pose { center_mm, orientation: uniform_orientation(rng) };
                let body = Body::new(shape, &pose);
                let is_clear = |j: usize| body.with(&Body::new(&shapes[j], &poses[j])).decide(0.0).is_apart;
                if body.wall_gap_mm(&specimen) >= 0.0 && (0..i).all(is_clear) {
                    poses.push(pose);
                    break;
                }
            }
        }
        (poses, attempts)
    };
    // Distance of the last grain from the middle, its longest axis along x, and the attempts.
    let measure = |poses: &[Pose], attempts: u64| {
        let last = poses.last().unwrap();
        let long = last.orientation * Vector3::x();
        [(last.center_mm - Vector3::from([5.0; 3])).norm(), long.x * long.x, (attempts as f64).ln()]
    };
    let runs = 1500;
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

/// Spheres as ellipsoids take as many attempts as spheres.
#[test]
fn spheres_are_placed_as_spheres() {
    let specimen = boxed([20.0; 3], Boundary::Walls);
    let shapes = shapes(36, 6.0, 4.0, [1.0; 3]);
    let diameters: Vec<f64> = shapes.iter().map(Ellipsoid::equivalent_diameter_mm).collect();
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for seed in 0..200 {
        let rsa = ShapeRsa {
            shapes: &shapes,
            domain: specimen.domain(),
            rule,
            attempts_per_grain: Some(10_000_000),
            attempts_in: AttemptsIn::Reach,
            threads: NonZeroUsize::MIN,
            orientation: &uniform_orientation,
        };
        let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(seed), &Unattended);
        assert_eq!(outcome.end, End::Complete);
        ours.push((outcome.statistics.attempts as f64).ln());
        let spheres = Rsa {
            diameters_mm: &diameters,
            domain: specimen.domain(),
            rule,
            attempts_per_grain: Some(10_000_000),
            preference: None,
            threads: std::num::NonZeroUsize::MIN,
        };
        let statistics =
            spheres.run(&mut Xoshiro256PlusPlus::seed_from_u64(seed + 1000), &Unattended).statistics;
        theirs.push((statistics.attempts as f64).ln());
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let variance = |x: &[f64]| x.iter().map(|y| (y - mean(x)).powi(2)).sum::<f64>() / x.len() as f64;
    let error = ((variance(&ours) + variance(&theirs)) / 200.0).sqrt();
    assert!((mean(&ours) - mean(&theirs)).abs() < 4.0 * error, "{} {}", mean(&ours), mean(&theirs));
}

/// A sphere that is given as an ellipsoid fills its specimen exactly, in any orientation, and passes the check.
#[test]
fn a_sphere_that_fits_exactly_is_packed_and_passes_the_check() {
    let boxed = |edge: f64, boundary: &str| json!({"type": "box", "size_mm": [edge, edge, edge], "boundary": boundary});
    let cylinder = |size: f64| json!({"type": "cylinder", "diameter_mm": size, "height_mm": size});
    for (specimen, d_mm, gap_mm) in [
        (boxed(8.0, "walls"), 8.0, 0.0),
        (boxed(8.0, "periodic"), 8.0, 0.0),
        (cylinder(8.0), 8.0, 0.0),
        (boxed(9.0, "walls"), 8.0, 1.0),
        (boxed(9.0, "periodic"), 8.0, 1.0),
        (cylinder(9.0), 8.0, 1.0),
        (boxed(7.3, "walls"), 7.3, 0.0),
        (boxed(7.3, "periodic"), 7.3, 0.0),
        (cylinder(7.3), 7.3, 0.0),
    ] {
        for seed in 0..20 {
            let value = json!({
                "specimen": specimen,
                "mix": {"grading": {"type": "diameters", "diameters_mm": [d_mm]}, "allow_coarse": true,
                    "shape": {"type": "ellipsoid",
                        "ratios": {"type": "constant", "elongation": 1, "flatness": 1}}},
                "distance": {"type": "constant", "gap_mm": gap_mm},
                "method": {"type": "rsa", "attempts_per_grain": 1000},
            });
            let request = PackingRequest::from_json(&value, seed).unwrap();
            let packed = crate::pack(&request, &crate::Limits::default(), &Unattended);
            assert!(packed.is_ok(), "{specimen} {gap_mm}, seed {seed}: {packed:?}");
        }
    }
}

/// A sphere has one place in a box or a cylinder of its size. A cube that is hardly narrower than its box has a place
/// that random orientations do not meet: nothing is proven, and that is what the end says.
#[test]
fn grains_that_fit_exactly_are_placed_or_nothing_is_said_to_be_proven() {
    let none = Distance::None { wall_gap_mm: None };
    let gap = Distance::Constant { gap_mm: 1.0, wall_gap_mm: Some(0.5) };
    for (specimen, distance) in [
        (boxed([8.0; 3], Boundary::Walls), &none),
        (boxed([9.0, 8.0, 20.0], Boundary::Walls), &none),
        (boxed([8.0; 3], Boundary::Periodic), &none),
        (Specimen::Cylinder { diameter_mm: 8.0, height_mm: 8.0 }, &none),
        (boxed([9.0; 3], Boundary::Walls), &gap),
        (boxed([9.0; 3], Boundary::Periodic), &gap),
    ] {
        for attempts_per_grain in [None, Some(1000)] {
            let shapes = [Ellipsoid::new([4.0; 3]).unwrap()];
            let rsa = ShapeRsa {
                shapes: &shapes,
                domain: specimen.domain(),
                rule: DistanceRule::new(distance, &specimen),
                attempts_per_grain,
                attempts_in: AttemptsIn::Specimen,
                threads: NonZeroUsize::MIN,
                orientation: &uniform_orientation,
            };
            let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(1), &Unattended);
            assert_eq!(outcome.end, End::Complete, "{specimen:?}");
        }
    }
    let specimen = boxed([5.01; 3], Boundary::Walls);
    let cube = cuboid([5.0; 3], 0.0).normalized();
    let scale_mm = 5.0 / libm::cbrt(std::f64::consts::PI / 6.0);
    let shapes = [ScaledPolyhedron { template: &cube, scale_mm }];
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(&none, &specimen),
        attempts_per_grain: None,
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let rng = &mut Xoshiro256PlusPlus::seed_from_u64(1);
    let outcome = rsa.run_with(None, None, 20_000, rng, &Unattended);
    assert_eq!(outcome.end, End::InsertionFailed { saturation_proven: false, attempts: 20_000 });
    // In its own orientation it is placed.
    let along = |_: &mut Xoshiro256PlusPlus| UnitQuaternion::identity();
    let outcome = ShapeRsa { orientation: &along, ..rsa }.run(rng, &Unattended);
    assert_eq!(outcome.end, End::Complete);
}

#[test]
fn a_stop_is_obeyed_and_progress_reported() {
    struct Stops(AtomicU64);
    impl Control for Stops {
        fn report(&self, progress: &Progress) {
            assert_eq!((progress.step, progress.unit), (Step::Rsa, "grains"));
            assert!((0.0..=1.0).contains(&progress.fraction));
            self.0.fetch_add(1, Ordering::Relaxed);
        }
        fn should_stop(&self) -> bool {
            self.0.load(Ordering::Relaxed) >= 3
        }
    }
    let specimen = boxed([10.0; 3], Boundary::Walls);
    let shapes = shapes(40, 5.0, 4.0, [2.0, 1.5, 1.0]);
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen);
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule,
        attempts_per_grain: None,
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let control = Stops(AtomicU64::new(0));
    let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(1), &control);
    assert_eq!(outcome.end, End::Stopped);
    assert!(outcome.placed.len() < shapes.len());
}
