//! Packings that are checked pair by pair, and runs that are repeated, interrupted and continued.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::{Matrix3, Vector3};

use super::*;
use crate::control::{Progress, Unattended};
use crate::cpu::tests::on_baseline;
use crate::methods::brute_force_tests::{assert_valid, is_valid};
use crate::mix::uniform_orientation;
use crate::request::Specimen;
use crate::request::{Boundary, Distance};
use crate::shape::Ellipsoid;

const BOX: Specimen = Specimen::Box { size_mm: [30.0, 25.0, 20.0], boundary: Boundary::Walls };

/// Ellipsoids of diameters from `d_max` to a quarter of it, with axis ratios, that fill this share of a specimen.
fn shapes(specimen: &Specimen, fraction: f64, d_max: f64, ratios: [f64; 3]) -> Vec<Ellipsoid> {
    let unit = cbrt(ratios.iter().product::<f64>());
    let of = |d: f64| Ellipsoid::new(ratios.map(|r| r / unit * d / 2.0)).unwrap();
    let wanted = fraction * specimen.volume_mm3();
    let count = (10..10_000).find(|count| {
        let d = |i: i32| d_max * 0.25_f64.powf(f64::from(i) / f64::from(*count));
        (0..*count).map(|i| of(d(i)).volume_mm3()).sum::<f64>() >= wanted
    });
    let count = count.unwrap() - 1;
    (0..count).map(|i| of(d_max * 0.25_f64.powf(f64::from(i) / f64::from(count)))).collect()
}

/// What growth counted.
fn counted(outcome: &Outcome<Vec<Pose>>) -> MonteCarloStatistics {
    outcome.statistics.monte_carlo.unwrap()
}

fn sweeps(most: u64) -> GrowthStop {
    GrowthStop { sweeps: Some(most), ..GrowthStop::default() }
}

fn rule(distance: &Distance, specimen: &Specimen) -> DistanceRule {
    DistanceRule::new(distance, specimen)
}

fn packing<'a>(
    shapes: &'a [Ellipsoid],
    specimen: &'a Specimen,
    distance: &Distance,
) -> MonteCarlo<'a, Ellipsoid> {
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

#[test]
fn packings_keep_all_gaps_in_all_specimens() {
    let specimens = [
        BOX,
        Specimen::Box { size_mm: [30.0, 25.0, 20.0], boundary: Boundary::Periodic },
        Specimen::Cylinder { diameter_mm: 28.0, height_mm: 24.0 },
    ];
    let distances = [
        Distance::None { wall_gap_mm: None },
        Distance::Constant { gap_mm: 0.2, wall_gap_mm: Some(0.3) },
        Distance::Proportional { factor: 0.06, wall_gap_mm: None },
        Distance::SmallerDiameter { factor: 0.08, wall_gap_mm: Some(0.0) },
    ];
    let ratios = [[1.5, 1.2, 1.0], [1.0, 1.0, 1.0], [2.5, 2.0, 1.0]];
    for (row, specimen) in specimens.iter().enumerate() {
        for (column, distance) in distances.iter().enumerate() {
            // Each ratio in each specimen and under each distance, but for one of the four.
            for ratios in [ratios[(row + column) % 3], ratios[(row + 2 * column + 1) % 3]] {
                let fraction = if matches!(distance, Distance::None { .. }) { 0.55 } else { 0.45 };
                let shapes = shapes(specimen, fraction, 6.0, ratios);
                let outcome = packing(&shapes, specimen, distance).run(None, &Unattended).unwrap();
                assert_eq!(
                    (outcome.end, outcome.scale),
                    (GrowthEnd::Target, 1.0),
                    "{specimen:?} {distance:?}"
                );
                assert_valid(specimen, &rule(distance, specimen), &shapes, &outcome.placed);
                assert!((outcome.volume_fraction - fraction).abs() < 0.03);
                assert!(counted(&outcome).compression_cycles > 1 && counted(&outcome).swaps_accepted > 0);
            }
        }
    }
}

#[test]
fn a_dense_packing_of_broad_sizes_is_reached() {
    let specimen = Specimen::Box { size_mm: [30.0; 3], boundary: Boundary::Walls };
    let unit = cbrt(1.8_f64);
    // As many by volume in each class.
    let mut shapes = Vec::new();
    for d in [8.0_f64, 6.0, 4.5, 3.4, 2.5, 1.9] {
        let shape = Ellipsoid::new([1.5, 1.2, 1.0].map(|axis| axis / unit * d / 2.0)).unwrap();
        let count = (0.64 / 6.0 * 27_000.0 / shape.volume_mm3()).round() as usize;
        shapes.extend(std::iter::repeat_n(shape, count));
    }
    let none = Distance::None { wall_gap_mm: None };
    let outcome = packing(&shapes, &specimen, &none).run(None, &Unattended).unwrap();
    assert_eq!(outcome.end, GrowthEnd::Target);
    assert!(outcome.volume_fraction > 0.63, "{}", outcome.volume_fraction);
    assert_valid(&specimen, &rule(&none, &specimen), &shapes, &outcome.placed);
    // Growth prefers no direction.
    let mut tensor = Matrix3::zeros();
    for pose in &outcome.placed {
        let axis = pose.orientation * Vector3::x();
        tensor += axis * axis.transpose() / outcome.placed.len() as f64;
    }
    assert!((tensor - Matrix3::identity() / 3.0).abs().max() < 0.05, "{tensor}");
    let fractions: Vec<f64> = outcome.growth_curve.iter().map(|point| point.volume_fraction).collect();
    assert!(fractions.is_sorted() && *fractions.last().unwrap() <= outcome.volume_fraction);
}

#[test]
fn every_cycle_ends_valid_at_its_scale() {
    let shapes = shapes(&BOX, 0.62, 6.0, [1.5, 1.2, 1.0]);
    let none = Distance::None { wall_gap_mm: None };
    for sweeps in [5, 20, 60, 120] {
        let mut packing = packing(&shapes, &BOX, &none);
        packing.stop.sweeps = Some(sweeps);
        let outcome = packing.run(None, &Unattended).unwrap();
        let scale = outcome.scale;
        assert!(
            outcome.end == GrowthEnd::SweepLimit && scale < 1.0 || outcome.end == GrowthEnd::Target,
            "{scale}"
        );
        let present: Vec<Ellipsoid> = shapes
            .iter()
            .map(|shape| Ellipsoid::new((shape.semi_axes_mm() * scale * (1.0 - 1e-12)).into()).unwrap())
            .collect();
        assert_valid(&BOX, &rule(&none, &BOX), &present, &outcome.placed);
    }
}

#[test]
fn runs_are_the_same_again_and_on_every_processor() {
    let shapes = shapes(&BOX, 0.56, 6.0, [1.5, 1.2, 1.0]);
    let distance = Distance::Proportional { factor: 0.02, wall_gap_mm: None };
    let run = || packing(&shapes, &BOX, &distance).run(None, &Unattended).unwrap().placed;
    let poses = run();
    assert_eq!(poses, run());
    assert_eq!(poses, on_baseline(run));
    let other = MonteCarlo { seed: 4, ..packing(&shapes, &BOX, &distance) };
    assert_ne!(poses, other.run(None, &Unattended).unwrap().placed);
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
    for distance in [Distance::None { wall_gap_mm: None }, Distance::Maximize { wall_gap_mm: None }] {
        let shapes = shapes(&BOX, 0.5, 6.0, [1.5, 1.2, 1.0]);
        let bodies: Mutex<Vec<Vec<u8>>> = Mutex::default();
        let keep = |write: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
            let mut body = Vec::new();
            write(&mut body).unwrap();
            bodies.lock().unwrap().push(body);
        };
        let stop = sweeps(120);
        let packing = MonteCarlo {
            keep_checkpoint: Some(&keep),
            stop,
            initial_scale: Some(0.9),
            ..packing(&shapes, &BOX, &distance)
        };
        let whole = packing.run(None, &Wants).unwrap();
        let without = packing.run(None, &Unattended).unwrap();
        assert_eq!(whole.placed, without.placed);
        let bodies = std::mem::take(&mut *bodies.lock().unwrap());
        assert!(bodies.len() > 2, "{}", bodies.len());
        for body in &bodies {
            let resumed = packing.run(Some(body), &Unattended).unwrap();
            assert_eq!(resumed.placed, whole.placed);
            let as_whole = MonteCarloStatistics { resumes: 0, ..counted(&resumed) };
            assert_eq!((as_whole, counted(&resumed).resumes), (counted(&whole), 1));
            assert_eq!((resumed.distance_mm, resumed.end), (whole.distance_mm, whole.end));
            assert_eq!(resumed.growth_curve.len(), whole.growth_curve.len());
        }
        // What is none of this request is ignored, and the run begins again.
        let body = &bodies[1];
        for damaged in [&body[..body.len() - 1], &body[..40], &[]] {
            let again = packing.run(Some(damaged), &Unattended).unwrap();
            assert_eq!((again.placed == whole.placed, counted(&again).resumes), (true, 0));
        }
        let short = MonteCarlo { stop: sweeps(5), ..packing };
        for at in (0..body.len()).step_by(body.len() / 40) {
            let mut damaged = body.clone();
            damaged[at] ^= 0xff;
            let outcome = short.run(Some(&damaged), &Unattended).unwrap();
            assert_eq!(outcome.placed.len(), shapes.len());
        }
    }
}

#[test]
fn the_largest_gap_is_kept_by_all() {
    for wall_gap_mm in [None, Some(0.1)] {
        for specimen in [BOX, Specimen::Cylinder { diameter_mm: 28.0, height_mm: 24.0 }] {
            let shapes = shapes(&specimen, 0.4, 6.0, [1.5, 1.2, 1.0]);
            let mut packing = packing(&shapes, &specimen, &Distance::Maximize { wall_gap_mm });
            packing.stop.sweeps = Some(400);
            let outcome = packing.run(None, &Unattended).unwrap();
            let gap_mm = outcome.distance_mm.unwrap();
            assert!(gap_mm > 0.2, "{gap_mm}");
            assert_eq!(outcome.scale, 1.0);
            let distance = Distance::Constant { gap_mm, wall_gap_mm };
            assert_valid(&specimen, &rule(&distance, &specimen), &shapes, &outcome.placed);
        }
    }
}

/// The largest gap that brute force finds: by bisection between what is kept and what is not, over all pairs and walls.
#[test]
fn the_gap_at_a_limit_is_the_largest_that_is_kept() {
    let periodic = |edge: f64| Specimen::Box { size_mm: [edge; 3], boundary: Boundary::Periodic };
    let one = || vec![Ellipsoid::new([4.0, 2.5, 2.0]).unwrap()];
    let few = || vec![Ellipsoid::new([3.0, 2.5, 2.0]).unwrap(); 4];
    let many = |specimen: &Specimen| shapes(specimen, 0.3, 6.0, [1.5, 1.2, 1.0]);
    let cylinder = Specimen::Cylinder { diameter_mm: 40.0, height_mm: 30.0 };
    for (specimen, shapes, least_mm) in [
        // The shortest way to an image is an edge of 20 mm, and the grain is 4 mm thick.
        (periodic(20.0), one(), 10.0),
        (BOX, one(), 3.0),
        (periodic(24.0), few(), 1.0),
        (cylinder, few(), 1.0),
        (BOX, many(&BOX), 0.05),
    ] {
        let mut packing = packing(&shapes, &specimen, &Distance::Maximize { wall_gap_mm: None });
        packing.stop.sweeps = Some(60);
        let outcome = packing.run(None, &Unattended).unwrap();
        assert_eq!(outcome.end, GrowthEnd::SweepLimit);
        let gap_mm = outcome.distance_mm.unwrap();
        assert!(gap_mm > least_mm, "{gap_mm}");
        assert_eq!(outcome.growth_curve.last().unwrap().distance_mm, Some(gap_mm));
        let keeps = |gap_mm: f64| {
            let rule = rule(&Distance::Constant { gap_mm, wall_gap_mm: None }, &specimen);
            is_valid(&specimen, &rule, &shapes, &outcome.placed)
        };
        assert!(keeps(gap_mm) && !keeps(gap_mm * (1.0 + 1e-6)), "{gap_mm} in {specimen:?}");
    }
}

#[test]
fn jammed_grains_stall_and_limits_are_obeyed() {
    // Twelve spheres of 10 mm have no place in 20 x 20 x 22 mm.
    let specimen = Specimen::Box { size_mm: [20.0, 20.0, 22.0], boundary: Boundary::Walls };
    let shapes = vec![Ellipsoid::new([5.0; 3]).unwrap(); 12];
    let none = Distance::None { wall_gap_mm: None };
    let outcome = packing(&shapes, &specimen, &none).run(None, &Unattended).unwrap();
    assert_eq!(outcome.end, GrowthEnd::Stalled);
    assert!(outcome.scale < 1.0 && outcome.scale > 0.8, "{}", outcome.scale);
    let mut timed = packing(&shapes, &specimen, &none);
    timed.stop.time_s = Some(1e-9);
    assert_eq!(timed.run(None, &Unattended).unwrap().end, GrowthEnd::TimeLimit);
}

#[test]
fn eight_spheres_fill_a_box_of_their_size() {
    let specimen = Specimen::Box { size_mm: [20.0 * (1.0 + 1e-4); 3], boundary: Boundary::Walls };
    let shapes = vec![Ellipsoid::new([5.0; 3]).unwrap(); 8];
    let none = Distance::None { wall_gap_mm: None };
    let outcome = packing(&shapes, &specimen, &none).run(None, &Unattended).unwrap();
    assert_eq!(outcome.end, GrowthEnd::Target);
    assert_valid(&specimen, &rule(&none, &specimen), &shapes, &outcome.placed);
}

#[test]
fn what_jams_just_below_its_target_is_expanded_as_long_as_it_helps() {
    // Eight spheres of 10 mm fit at 0.995 of their size, and no better after an expansion.
    let specimen = Specimen::Box { size_mm: [19.9; 3], boundary: Boundary::Walls };
    let shapes = vec![Ellipsoid::new([5.0; 3]).unwrap(); 8];
    let none = Distance::None { wall_gap_mm: None };
    let outcome = packing(&shapes, &specimen, &none).run(None, &Unattended).unwrap();
    assert_eq!((outcome.end, counted(&outcome).expansions), (GrowthEnd::Stalled, 1));
    assert!((0.99..=0.995).contains(&outcome.scale), "{}", outcome.scale);
}

#[test]
fn a_long_grain_keeps_clear_of_its_own_images() {
    let specimen = Specimen::Box { size_mm: [9.0, 10.0, 9.5], boundary: Boundary::Periodic };
    let mut shapes = vec![Ellipsoid::new([6.0, 1.5, 1.0]).unwrap()];
    shapes.extend(vec![Ellipsoid::new([1.6, 1.2, 1.0]).unwrap(); 35]);
    let none = Distance::None { wall_gap_mm: None };
    let outcome = packing(&shapes, &specimen, &none).run(None, &Unattended).unwrap();
    assert_eq!(outcome.end, GrowthEnd::Target);
    assert_valid(&specimen, &rule(&none, &specimen), &shapes, &outcome.placed);
}

#[test]
fn progress_never_falls_and_a_stop_is_obeyed() {
    #[derive(Default)]
    struct Watches {
        fractions: Mutex<Vec<f64>>,
        looks: AtomicU64,
        stop_after: Option<u64>,
    }
    impl Control for Watches {
        fn report(&self, progress: &Progress) {
            self.fractions.lock().unwrap().push(progress.fraction);
        }
        fn should_stop(&self) -> bool {
            let looks = self.looks.fetch_add(1, Ordering::Relaxed);
            self.stop_after.is_some_and(|after| looks >= after)
        }
    }
    let shapes = shapes(&BOX, 0.55, 6.0, [1.5, 1.2, 1.0]);
    let none = Distance::None { wall_gap_mm: None };
    let watches = Watches::default();
    packing(&shapes, &BOX, &none).run(None, &watches).unwrap();
    let fractions = watches.fractions.into_inner().unwrap();
    assert!(fractions.is_sorted() && fractions.len() > 3);
    assert!(fractions.iter().all(|fraction| (0.0..=1.0).contains(fraction)));
    assert!(*fractions.last().unwrap() > 0.9, "{fractions:?}");
    let looks = watches.looks.into_inner();
    for stop_after in [0, looks / 2, looks - 1] {
        let watches = Watches { stop_after: Some(stop_after), ..Watches::default() };
        let outcome = packing(&shapes, &BOX, &none).run(None, &watches);
        assert_eq!(outcome.map(|outcome| outcome.end), Err(Interrupted::Stopped));
        assert!(watches.looks.into_inner() <= stop_after + 1);
    }
}
