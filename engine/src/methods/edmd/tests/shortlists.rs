//! Coarse grains among fine ones: with shortlists no collision is missed.

use super::*;
use crate::rng::{Stream, stream, uniform};

const EDGE_MM: f64 = 18.0;
/// Most collisions of a cycle, which lists that grow too long may end before.
const COLLISIONS: usize = 4000;
const CYCLES: usize = 12;
const CYCLE_S: f64 = 20.0;

/// Two coarse grains among fine ones, which are fast: equal energy for all on average.
fn coarse_among_fine() -> Vec<Placed> {
    let mut rng = stream(7, Stream::Rsa);
    let mut placed = |position, radius: f64| {
        let mass = (radius / 0.35_f64).powi(3);
        let velocity = std::array::from_fn(|_| (2.0 * uniform(&mut rng) - 1.0) / mass.sqrt());
        Placed { position, velocity, radius, mass }
    };
    let coarse = [([5.5, 9.0, 9.0], 4.0), ([13.5, 8.5, 9.0], 3.2)];
    let mut grains: Vec<Placed> = coarse.into_iter().map(|(at, radius)| placed(at, radius)).collect();
    let places = (0..18 * 18 * 18).map(|k| [k % 18, k / 18 % 18, k / 324].map(|x| f64::from(x) + 0.5));
    for at in places {
        let free = coarse.iter().all(|&(center, radius)| {
            let way = minus(at, center);
            dot(way, way).sqrt() > radius + 0.35
        });
        if free {
            grains.push(placed(at, 0.35));
        }
    }
    grains
}

/// The least gap of any two grains, by looking at all pairs of coarse grains with others.
fn least_gap_mm(scene: &Scene, growth: &Growth, time: f64, periodic: bool) -> f64 {
    let hot = &scene.system.hot;
    let mut least = f64::INFINITY;
    for i in 0..2 {
        for j in i + 1..hot.len() {
            let way = minus(hot[j].position_at(time), hot[i].position_at(time));
            let way = way.map(|x| if periodic { x - EDGE_MM * (x / EDGE_MM).round() } else { x });
            let (start, rate) = growth.pair(hot[i].radius, hot[j].radius);
            least = least.min(dot(way, way).sqrt() - (start + rate * time));
        }
    }
    least
}

fn never_overlap(container: Container, periodic: bool) {
    let growth = Growth { alpha: 0.0005, wall_factor: 1.0, ..Growth::default() };
    let mut scene = Scene::new(container, growth, CYCLE_S, &coarse_among_fine());
    assert!((0..2).all(|grain| scene.system.cold[grain].is_coarse), "both have a shortlist");
    let mut met = 0;
    for _ in 0..CYCLES {
        let mut time = 0.0;
        for k in 0..COLLISIONS {
            let before = [0, 1].map(|grain| scene.velocity(grain));
            let Some(reached) = scene.collide() else { break };
            time = reached;
            met += usize::from(before != [0, 1].map(|grain| scene.velocity(grain)));
            if k % 50 == 0 {
                let least = least_gap_mm(&scene, &growth, time, periodic);
                assert!(least > -1e-11, "after {k} collisions two grains overlap by {} mm", -least);
            }
        }
        scene.system.synchronise(time);
        for hot in &mut scene.system.hot {
            hot.radius = growth.radius(hot.radius, time);
        }
        scene.system.rebuild_all_lists(growth, CYCLE_S).unwrap();
        scene.system.predict_all(1.0).unwrap();
    }
    assert!(met > 400, "the coarse grains collide: {met} times");
}

#[test]
fn coarse_grains_and_fine_ones_never_overlap_between_walls() {
    never_overlap(Container::Box { size_mm: [EDGE_MM; 3] }, false);
}

#[test]
fn coarse_grains_and_fine_ones_never_overlap_in_a_periodic_box() {
    never_overlap(Container::Periodic { size_mm: [EDGE_MM; 3] }, true);
}
