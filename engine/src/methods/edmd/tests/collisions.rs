//! One collision at a time: what it conserves, and what growth adds.

use std::cell::Cell;

use crate::properties::properties;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use super::*;

/// A unit vector of the height and the angle that it has on a sphere.
fn direction(height: f64, angle: f64) -> [f64; 3] {
    let across = (1.0 - height * height).sqrt();
    [across * angle.cos(), across * angle.sin(), height]
}

/// Some unit vector across another.
fn across(normal: [f64; 3]) -> [f64; 3] {
    let axis = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let part = plus_times(axis, -dot(axis, normal), normal);
    part.map(|x| x / dot(part, part).sqrt())
}

pub(super) fn unit() -> impl Strategy<Value = [f64; 3]> {
    (-1.0..=1.0_f64, 0.0..std::f64::consts::TAU).prop_map(|(height, angle)| direction(height, angle))
}

pub(super) fn anywhere(in_plus_minus: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-in_plus_minus..in_plus_minus)
}

/// Relative, absolute and non-additive growth, or none.
pub(super) fn growth() -> impl Strategy<Value = Growth> {
    let rate = || prop_oneof![Just(0.0), 1e-6..0.05_f64];
    let kappa = prop_oneof![Just(0.0), 0.0..1.0_f64];
    (rate(), rate(), kappa).prop_map(|(alpha, beta, kappa)| Growth {
        alpha,
        beta,
        kappa,
        wall_factor: 1.0,
        ..Growth::default()
    })
}

const EDGE_MM: f64 = 90.0;

/// Two grains in a periodic box that will meet, and the growth meanwhile.
fn meeting_pair() -> impl Strategy<Value = (Growth, [Placed; 2], f64)> {
    let radius = || 0.5..6.0_f64;
    let mass = || prop_oneof![Just(1.0), 1.0..1e4_f64];
    let geometry = (anywhere(40.0), unit(), radius(), radius(), 1e-6..1.0_f64);
    let motion = (anywhere(0.5), -2.0..-0.5_f64, 0.0..0.5_f64, mass(), mass());
    (growth(), geometry, motion).prop_map(|(growth, geometry, motion)| {
        let (center, normal, r_a, r_b, gap) = geometry;
        let (v_a, approach, slide, m_a, m_b) = motion;
        let (contact, _) = growth.pair(r_a, r_b);
        let p_a = center.map(|x| x + EDGE_MM / 2.0);
        let p_b = plus_times(p_a, contact * (1.0 + gap), normal).map(|x| x.rem_euclid(EDGE_MM));
        let v_b = plus_times(plus_times(v_a, approach, normal), slide * approach, across(normal));
        let placed = |position, velocity, radius, mass| Placed { position, velocity, radius, mass };
        // Half a contact distance aside at most, they meet before that much more has been covered.
        let end_s = contact * (1.0 + gap) / -approach;
        (growth, [placed(p_a, v_a, r_a, m_a), placed(p_b, v_b, r_b, m_b)], end_s)
    })
}

fn energy(grains: &[(f64, [f64; 3])]) -> f64 {
    grains.iter().map(|(mass, v)| 0.5 * mass * dot(*v, *v)).sum()
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn two_grains_part_as_elastic_surfaces_that_grow((growth, grains, end_s) in meeting_pair()) {
        let mut scene = Scene::new(Container::Periodic { size_mm: [EDGE_MM; 3] }, growth, end_s, &grains);
        let [a, b] = grains;
        let Some(time) = scene.collide() else { return Err(TestCaseError::fail("they never met")) };
        let way = minus(scene.position_at(1, time), scene.position_at(0, time));
        let way = way.map(|x| x - EDGE_MM * (x / EDGE_MM).round());
        let distance = dot(way, way).sqrt();
        let (start, rate) = growth.pair(a.radius, b.radius);
        prop_assert!((distance - (start + rate * time)).abs() < 1e-13 * EDGE_MM, "in contact");

        let normal = way.map(|x| x / distance);
        let (v_a, v_b) = (scene.velocity(0), scene.velocity(1));
        let scale = 1.0 + a.mass * dot(a.velocity, a.velocity).sqrt() + b.mass * dot(b.velocity, b.velocity).sqrt();
        for k in 0..3 {
            let momentum = |u: [f64; 3], w: [f64; 3]| a.mass * u[k] + b.mass * w[k];
            let change = momentum(v_a, v_b) - momentum(a.velocity, b.velocity);
            prop_assert!(change.abs() <= 16.0 * f64::EPSILON * scale, "momentum changes by {change:e} of {scale:e}");
        }
        let relative = minus(b.velocity, a.velocity);
        let after = minus(v_b, v_a);
        let u = dot(relative, normal);
        prop_assert!((dot(after, normal) - (2.0 * rate - u)).abs() < 1e-13, "from {u} to {}", dot(after, normal));
        let sideways = minus(plus_times(after, -dot(after, normal), normal), plus_times(relative, -u, normal));
        prop_assert!(dot(sideways, sideways).sqrt() < 1e-13, "no force acts across the normal: {sideways:?}");
        let reduced = a.mass * b.mass / (a.mass + b.mass);
        let before = energy(&[(a.mass, a.velocity), (b.mass, b.velocity)]);
        let gained = energy(&[(a.mass, v_a), (b.mass, v_b)]) - before;
        let expected = 2.0 * reduced * rate * (rate - u);
        prop_assert!((gained - expected).abs() < 1e-13 * (before + reduced), "{gained} instead of {expected}");
    }
}

/// One grain on its way to a wall, and the growth meanwhile, in a share of the room it has.
fn alone() -> impl Strategy<Value = (Growth, Placed, Container)> {
    let container = prop_oneof![
        Just(Container::Box { size_mm: [40.0, 50.0, 60.0] }),
        Just(Container::Cylinder { radius_mm: 20.0, height_mm: 50.0 }),
    ];
    let wall = (0.3..1.5_f64, 0.0..2.0_f64, prop_oneof![Just(0.0), 0.0..0.05_f64]);
    (growth(), wall, container, 0.5..6.0_f64, anywhere(0.9), anywhere(1.0), 1.0..1e3_f64).prop_map(
        |(growth, (wall_factor, wall_offset_mm, wall_beta), container, radius, share, velocity, mass)| {
            let growth = Growth { wall_factor, wall_offset_mm, wall_beta, ..growth };
            let room = |length: f64| length / 2.0 - growth.wall(radius).0;
            let position = if let Container::Cylinder { radius_mm, height_mm } = container {
                let (sin, cos) = (3.5 * share[1]).sin_cos();
                let out = room(2.0 * radius_mm) * share[0];
                [radius_mm + out * cos, radius_mm + out * sin, height_mm / 2.0 + share[2] * room(height_mm)]
            } else {
                let size = container.bounds_mm();
                std::array::from_fn(|k| size[k] / 2.0 + share[k] * room(size[k]))
            };
            (growth, Placed { position, velocity, radius, mass }, container)
        },
    )
}

/// Distance from each wall and its inward normal, by hand.
fn walls(container: Container, p: [f64; 3]) -> Vec<(f64, [f64; 3])> {
    let axis = |k: usize, sign: f64| std::array::from_fn(|a| if a == k { sign } else { 0.0 });
    let ends = |k: usize, length: f64| [(p[k], axis(k, 1.0)), (length - p[k], axis(k, -1.0))];
    match container {
        Container::Cylinder { radius_mm, height_mm } => {
            let (x, y) = (p[0] - radius_mm, p[1] - radius_mm);
            let out = x.hypot(y);
            let mut all = vec![(radius_mm - out, [-x / out, -y / out, 0.0])];
            all.extend(ends(2, height_mm));
            all
        }
        _ => (0..3).flat_map(|k| ends(k, container.bounds_mm()[k])).collect(),
    }
}

#[test]
fn a_grain_leaves_every_wall_as_one_that_recedes_as_fast_as_it_grows() {
    let met: [Cell<u32>; 9] = Default::default();
    let tried =
        TestRunner::new(ProptestConfig::with_cases(3000)).run(&alone(), |(growth, grain, container)| {
            let mut scene = Scene::new(container, growth, 400.0, &[grain]);
            // The slowest may grow and drift for longer; no more is asked of them.
            let Some(time) = scene.collide() else { return Ok(()) };
            let position = scene.position_at(0, time);
            let (start, rate) = growth.wall(grain.radius);
            let contact = start + rate * time;
            let all = walls(container, position);
            let nearest = (0..all.len()).min_by(|&i, &j| all[i].0.total_cmp(&all[j].0)).unwrap();
            let (distance, normal) = all[nearest];
            prop_assert!(
                (distance - contact).abs() < 1e-11,
                "{distance} from the nearest wall, {contact} expected"
            );
            let first = if all.len() == 3 { 6 } else { 0 };
            met[first + nearest].set(met[first + nearest].get() + 1);

            let (before, after) = (grain.velocity, scene.velocity(0));
            let u = dot(before, normal);
            prop_assert!(u < rate, "it closed in on the wall");
            let expected = plus_times(before, 2.0 * (rate - u), normal);
            let off = minus(after, expected);
            prop_assert!(dot(off, off).sqrt() < 1e-11, "{after:?} instead of {expected:?}");
            let gained = energy(&[(grain.mass, after)]) - energy(&[(grain.mass, before)]);
            let expected = 2.0 * grain.mass * rate * (rate - u);
            prop_assert!((gained - expected).abs() < 1e-11 * grain.mass, "{gained} instead of {expected}");
            Ok(())
        });
    tried.unwrap();
    let met = met.map(|count| count.get());
    assert!(met.iter().all(|&count| count > 50), "every face, the lateral surface and both ends: {met:?}");
}

/// In contact but for rounding, and receding exactly as fast as they grow: by distances they close, and by
/// velocities they do not. Whichever is right, they are done with each other.
#[test]
fn a_pair_that_neither_closes_nor_parts_is_not_met_for_ever() {
    let growth = Growth { beta: 0.5, wall_factor: 1.0, ..Growth::default() };
    let still = Placed { position: [8.0, 10.0, 10.0], velocity: [0.0; 3], radius: 1.0, mass: 1.0 };
    for roundings in -8..=8 {
        let x = 10.0 + f64::from(roundings) * 8.0 * f64::EPSILON;
        let beside = Placed { position: [x, 10.0, 10.0], velocity: [1.0, 0.0, 0.0], ..still };
        let mut scene = Scene::new(Container::Box { size_mm: [40.0; 3] }, growth, 1.0, &[still, beside]);
        let times: Vec<f64> = std::iter::from_fn(|| scene.collide()).take(3).collect();
        assert!(times.len() < 2, "{roundings} roundings apart: {times:?}");
    }
}
