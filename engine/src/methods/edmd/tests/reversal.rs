//! Motion without growth runs backwards as it ran forwards.
//!
//! Every collision of a grain multiplies what it is off by about tenfold, so a hundred thousand events
//! in a small system leave no digit. Spread over enough grains they are a few collisions each, and all
//! of them are run back at once.

use super::*;
use crate::control::Unattended;
use crate::distance::DistanceRule;
use crate::methods::rsa::Rsa;
use crate::request::{Boundary, Distance, Specimen};
use crate::rng::{Stream, cycle_stream, stream};

const GRAINS: usize = 24_000;
const EVENTS: u64 = 100_000;
const FRACTION: f64 = 0.25;

/// Grains of diameters 1 to 2 mm and of masses to match, in random places and in motion.
fn in_motion(specimen: &Specimen) -> System {
    let diameters: Vec<f64> = (0..GRAINS).map(|i| 2.0 - i as f64 / GRAINS as f64).collect();
    let addition = Rsa {
        diameters_mm: &diameters,
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, specimen),
        preference: None,
        threads: std::num::NonZeroUsize::MIN,
        attempts_per_grain: None,
    };
    let centers = addition.run(&mut stream(2, Stream::Rsa), &Unattended).placed;
    assert_eq!(centers.len(), GRAINS);
    let radii: Vec<f64> = diameters.iter().map(|d| d / 2.0).collect();
    let masses: Vec<f64> = diameters.iter().map(|d| d.powi(3)).collect();
    let mut system = System::new(Container::new(specimen), &centers, &radii, &masses).unwrap();
    system.set_in_motion(1.0, &mut cycle_stream(2, 0));
    system
}

const NO_GROWTH: Growth =
    Growth { alpha: 0.0, beta: 0.0, kappa: 0.0, wall_factor: 1.0, wall_offset_mm: 0.0, wall_beta: 0.0 };

/// One cycle of at most so much time and so many events; how long it was.
fn cycle(system: &mut System, time_s: f64, most: u64) -> f64 {
    system.rebuild_all_lists(NO_GROWTH, time_s).unwrap();
    system.predict_all(1e5).unwrap();
    let reached = system.run(most, u64::MAX);
    system.synchronise(reached);
    reached
}

/// Lets a time pass in cycles no longer than a share of it; lists that have grown too long cut some short.
fn pass(system: &mut System, time_s: f64, share: f64) {
    let mut left = time_s;
    while left > 0.0 {
        left -= cycle(system, left.min(share * time_s), u64::MAX);
    }
}

fn returns(specimen: &Specimen) {
    let mut system = in_motion(specimen);
    let start = system.hot.clone();
    let counted = |system: &System| [system.counts.grain_collisions, system.counts.wall_collisions];
    let before = counted(&system);
    let mut time_s = 0.0;
    while system.counts.collisions() < EVENTS {
        let most = EVENTS - system.counts.collisions();
        time_s += cycle(&mut system, 1e3, most);
    }
    // On to where nobody is in contact, as at the start.
    time_s += cycle(&mut system, 1e-5, u64::MAX);
    let half_way = counted(&system);
    let there: [u64; 2] = std::array::from_fn(|k| half_way[k] - before[k]);
    system.scale_velocities(-1.0);
    pass(&mut system, time_s, 0.4);
    let back: [u64; 2] = std::array::from_fn(|k| counted(&system)[k] - half_way[k]);
    assert_eq!(there, back);

    let size = specimen.bounds_mm();
    let off = |a: [f64; 3], b: [f64; 3], period: bool| {
        let way: [f64; 3] = std::array::from_fn(|k| {
            let way = a[k] - b[k];
            if period { way - size[k] * (way / size[k]).round() } else { way }
        });
        dot(way, way).sqrt()
    };
    let mut places: Vec<f64> = system
        .hot
        .iter()
        .zip(&start)
        .map(|(a, b)| off(a.position, b.position, specimen.is_periodic()))
        .collect();
    places.sort_by(f64::total_cmp);
    let speeds = system.hot.iter().zip(&start).map(|(a, b)| off(a.velocity, b.velocity.map(|v| -v), false));
    let speeds = speeds.fold(0.0, f64::max);
    assert!(places[GRAINS - 1] < 1e-6, "the worst is {:e} mm off", places[GRAINS - 1]);
    assert!(places[GRAINS / 2] < 1e-11, "half of them are {:e} mm off", places[GRAINS / 2]);
    assert!(speeds < 1e-6, "{speeds:e} mm/s off");
}

#[test]
fn a_hundred_thousand_events_run_back_in_a_periodic_box() {
    let edge = libm::cbrt(GRAINS as f64 * 1.964 / FRACTION);
    returns(&Specimen::Box { size_mm: [edge, edge, edge], boundary: Boundary::Periodic });
}

#[test]
fn a_hundred_thousand_events_run_back_within_walls() {
    // Flat and wide, so that walls take their part.
    let edge = libm::cbrt(GRAINS as f64 * 1.964 / FRACTION / 16.0);
    returns(&Specimen::Box { size_mm: [4.0 * edge, 4.0 * edge, edge], boundary: Boundary::Walls });
}

#[test]
fn a_hundred_thousand_events_run_back_in_a_cylinder() {
    let radius = libm::cbrt(GRAINS as f64 * 1.964 / FRACTION / (std::f64::consts::PI * 12.0));
    returns(&Specimen::Cylinder { diameter_mm: 2.0 * radius, height_mm: 12.0 * radius });
}
