//! Collisions in blocks: nothing overlaps, nothing is lost, and threads change nothing.

use std::num::NonZeroUsize;

use crate::methods::edmd::blocks::{self, Outcome, Task};
use crate::methods::edmd::container::Container;
use crate::methods::edmd::growth::Growth;
use crate::methods::edmd::system::System;
use crate::rng::{Stream, stream};

/// Grains along an edge: enough for blocks.
const PER_EDGE: usize = 38;
/// Two grains keep a share of the smaller one's radius, and grains keep a distance from walls.
const GROWTH: Growth =
    Growth { alpha: 0.0, beta: 0.0, kappa: 0.2, wall_factor: 1.0, wall_offset_mm: 0.02, wall_beta: 0.0 };

/// Grains of two sizes on a lattice of 1 mm, in motion.
fn lattice(container: Container, threads: usize) -> System {
    let size = container.bounds_mm();
    let centers: Vec<[f64; 3]> = (0..PER_EDGE.pow(3))
        .map(|i| [i % PER_EDGE, i / PER_EDGE % PER_EDGE, i / PER_EDGE.pow(2)].map(|k| k as f64 + 0.5))
        .filter(|p| match container {
            Container::Cylinder { radius_mm, .. } => {
                (p[0] - radius_mm).hypot(p[1] - radius_mm) < radius_mm - 0.5
            }
            _ => (0..3).all(|a| p[a] < size[a]),
        })
        .collect();
    let radii: Vec<f64> = (0..centers.len()).map(|i| if i % 3 == 0 { 0.45 } else { 0.4 }).collect();
    let masses: Vec<f64> = radii.iter().map(|r| (r / 0.4).powi(3)).collect();
    let mut system = System::new(container, &centers, &radii, &masses).unwrap();
    system.set_in_motion(1.0, &mut stream(1, Stream::Edmd));
    system.threads = NonZeroUsize::new(threads).unwrap();
    system
}

fn collide(system: &mut System, seed: u64) -> Outcome {
    let task = Task {
        growth: GROWTH,
        events_per_grain: 4.0,
        events_per_time: 30.0 * system.len() as f64,
        swaps: None,
        is_over: &|_| false,
    };
    blocks::collide(system, &task, &mut stream(seed, Stream::Rsa)).unwrap()
}

/// The least distance of two grains, and of a grain and a wall, beyond what they keep; by cells of 1 mm.
fn least_room(system: &System) -> f64 {
    let size = system.container.bounds_mm();
    let cells: [usize; 3] = size.map(|length| length.floor() as usize);
    let cell = |p: [f64; 3]| -> [usize; 3] {
        std::array::from_fn(|a| ((p[a] * cells[a] as f64 / size[a]) as usize).min(cells[a] - 1))
    };
    let at = |c: [usize; 3]| (c[0] * cells[1] + c[1]) * cells[2] + c[2];
    let mut grains: Vec<Vec<usize>> = vec![Vec::new(); cells.iter().product()];
    for (i, hot) in system.hot.iter().enumerate() {
        grains[at(cell(hot.position))].push(i);
    }
    let mut least = f64::INFINITY;
    for (i, a) in system.hot.iter().enumerate() {
        let wall = GROWTH.wall(a.radius).0;
        match system.container {
            Container::Periodic { .. } => {}
            Container::Cylinder { radius_mm, height_mm } => {
                let beside = (a.position[0] - radius_mm).hypot(a.position[1] - radius_mm);
                let ends = a.position[2].min(height_mm - a.position[2]);
                least = least.min((radius_mm - beside).min(ends) - wall);
            }
            _ => {
                for k in 0..3 {
                    least = least.min(a.position[k].min(size[k] - a.position[k]) - wall);
                }
            }
        }
        let c = cell(a.position);
        for k in 0..27 {
            let other = [k % 3, k / 3 % 3, k / 9];
            let other: [usize; 3] = std::array::from_fn(|a| (c[a] + other[a] + cells[a] - 1) % cells[a]);
            for &j in grains[at(other)].iter().filter(|&&j| j > i) {
                let b = &system.hot[j];
                let d: [f64; 3] = std::array::from_fn(|a_| {
                    let d = b.position[a_] - a.position[a_];
                    if system.container.is_periodic() { d - size[a_] * (d / size[a_]).round() } else { d }
                });
                let distance = d.iter().map(|x| x * x).sum::<f64>().sqrt();
                least = least.min(distance - GROWTH.pair(a.radius, b.radius).0);
            }
        }
    }
    least
}

const SPECIMENS: [Container; 3] = [
    Container::Box { size_mm: [38.0, 38.0, 38.0] },
    Container::Periodic { size_mm: [38.0, 38.0, 38.0] },
    Container::Cylinder { radius_mm: 19.0, height_mm: 38.0 },
];

#[test]
fn grains_keep_their_distances_and_their_energy() {
    for container in SPECIMENS {
        let mut system = lattice(container, 2);
        assert!(blocks::can_cut(&system), "{container:?}");
        let energy = system.energy();
        for seed in 1..=4 {
            let before = system.hot.clone();
            let collisions = system.counts.collisions();
            let outcome = collide(&mut system, seed);
            let per_grain = (system.counts.collisions() - collisions) as f64 / system.len() as f64;
            assert!((per_grain / (1.0 - outcome.held) - 4.0).abs() < 0.01, "{per_grain} {outcome:?}");
            let unmoved =
                before.iter().zip(&system.hot).filter(|(old, new)| old.position == new.position).count();
            assert_eq!(unmoved as f64, (outcome.held * system.len() as f64).round(), "all others move");
            assert!((0.02..0.3).contains(&outcome.held), "{outcome:?}");
            assert!((system.energy() / energy - 1.0).abs() < 1e-9);
            assert!(outcome.time > 0.0 && outcome.pressure > 1.0, "{outcome:?}");
            let room = least_room(&system);
            assert!(room > -1e-9, "{container:?}: {room}");
        }
    }
}

#[test]
fn the_outcome_does_not_depend_on_the_threads() {
    for container in SPECIMENS {
        let of = |threads: usize| {
            let mut system = lattice(container, threads);
            let outcome = collide(&mut system, 7);
            (outcome, system.hot, system.rank, system.counts)
        };
        let one = of(1);
        for threads in [2, 3, 8] {
            assert!(of(threads) == one, "{threads} threads, {container:?}");
        }
    }
}

#[test]
fn a_block_that_is_to_end_keeps_what_it_has() {
    let mut system = lattice(SPECIMENS[0], 1);
    let task = Task {
        growth: GROWTH,
        events_per_grain: 1000.0,
        events_per_time: 1e6,
        swaps: None,
        is_over: &|_| true,
    };
    let outcome = blocks::collide(&mut system, &task, &mut stream(1, Stream::Rsa)).unwrap();
    assert!(outcome.time > 0.0);
    assert!(system.counts.collisions() < 100 * system.len() as u64);
    assert!(least_room(&system) > -1e-9);
}
