//! Pair tests against brute force and against formulas that share nothing with them.

use std::f64::consts::PI;

use crate::properties::properties;
use nalgebra::{Matrix2, Matrix3, Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

use super::ellipsoids::Body;
use super::linear::{Vector, dot, norm, scaled};
use crate::request::{Boundary, Specimen};
use crate::rng::uniform;
use crate::shape::{Ellipsoid, Pose};

fn symmetric(rng: &mut Xoshiro256PlusPlus) -> f64 {
    2.0 * uniform(rng) - 1.0
}

/// A uniform direction.
fn direction(rng: &mut Xoshiro256PlusPlus) -> Vector {
    loop {
        let v: Vector = std::array::from_fn(|_| symmetric(rng));
        let length = norm(v);
        if length > 0.01 && length <= 1.0 {
            return scaled(v, 1.0 / length);
        }
    }
}

fn orientation(rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
    let [i, j, k] = direction(rng);
    UnitQuaternion::new(Vector3::new(i, j, k) * (PI * uniform(rng)))
}

fn ellipsoid(axes: Vector) -> Ellipsoid {
    Ellipsoid::new(axes).unwrap()
}

/// Two ellipsoids with axis ratios up to `ratio` whose centres lie so far apart that either outcome is common.
fn random_pair(rng: &mut Xoshiro256PlusPlus, ratio: f64) -> [(Ellipsoid, Pose); 2] {
    let mut one = |center: Vector| {
        let size = 1.0 + 3.0 * uniform(rng);
        let mut axis = || size * ratio.powf(-uniform(rng));
        let shape = ellipsoid([axis(), axis(), axis()]);
        (shape, Pose { center_mm: center.into(), orientation: orientation(rng) })
    };
    let (a, mut b) = (one([3.0, -2.0, 7.0]), one([3.0, -2.0, 7.0]));
    let n = direction(rng);
    let far = 1.6 * uniform(rng) * (a.0.semi_axes_mm().x + b.0.semi_axes_mm().x);
    b.1.center_mm += Vector3::from(n) * far.max(0.05);
    [a, b]
}

fn bodies([a, b]: &[(Ellipsoid, Pose); 2]) -> [Body; 2] {
    [Body::new(&a.0, &a.1), Body::new(&b.0, &b.1)]
}

/// `s(n)` from the shapes themselves: `h(n) = |diag(a, b, c) Rᵀ n|`.
fn separation_by_shape(pair: &[(Ellipsoid, Pose); 2], n: Vector) -> f64 {
    let n = Vector3::from(n);
    let support = |(shape, pose): &(Ellipsoid, Pose)| {
        shape.semi_axes_mm().component_mul(&(pose.orientation.inverse() * n)).norm()
    };
    (pair[1].1.center_mm - pair[0].1.center_mm).dot(&n) - support(&pair[0]) - support(&pair[1])
}

/// The largest `s(n)` by search alone: many directions, then steps that shrink.
fn brute_force(pair: &[(Ellipsoid, Pose); 2], rng: &mut Xoshiro256PlusPlus) -> f64 {
    let mut best = (f64::NEG_INFINITY, [0.0; 3]);
    for _ in 0..3000 {
        let n = direction(rng);
        best = if separation_by_shape(pair, n) > best.0 { (separation_by_shape(pair, n), n) } else { best };
    }
    let mut step = 0.1;
    while step > 1e-9 {
        let mut gained = false;
        for _ in 0..12 {
            let m = std::array::from_fn(|a| best.1[a] + step * symmetric(rng));
            let m = scaled(m, 1.0 / norm(m));
            let s = separation_by_shape(pair, m);
            if s > best.0 {
                best = (s, m);
                gained = true;
            }
        }
        step *= if gained { 1.2 } else { 0.6 };
    }
    best.0
}

#[test]
fn spheres_give_their_own_separation() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    for _ in 0..2000 {
        let (r_a, r_b) = (0.5 + uniform(&mut rng), 0.5 + 3.0 * uniform(&mut rng));
        let n = direction(&mut rng);
        let far = (r_a + r_b) * (0.5 + uniform(&mut rng));
        let at = |center: Vector, q| Pose { center_mm: center.into(), orientation: q };
        let a = Body::new(&ellipsoid([r_a; 3]), &at([0.0; 3], orientation(&mut rng)));
        let b = Body::new(&ellipsoid([r_b; 3]), &at(scaled(n, far), orientation(&mut rng)));
        let expected = far - r_a - r_b;
        let scale = far + r_a + r_b;
        assert!((a.with(&b).separation_mm(n) - expected).abs() <= 1e-15 * scale);
        let gap = a.with(&b).gap();
        assert!((gap.gap_mm - expected).abs() <= 1e-15 * scale, "{} {expected}", gap.gap_mm);
        assert!((a.with(&b).contact().factor2.sqrt() - far / (r_a + r_b)).abs() <= 4e-15);
    }
}

#[test]
fn the_gap_is_what_brute_force_finds() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
    let (mut apart, mut overlapping) = (0, 0);
    for round in 0..600 {
        let pair = random_pair(&mut rng, if round % 3 == 0 { 10.0 } else { 2.0 });
        let [a, b] = bodies(&pair);
        let gap = a.with(&b).gap();
        let found = brute_force(&pair, &mut rng);
        // The certificate holds by the shapes themselves.
        assert!((separation_by_shape(&pair, gap.normal) - gap.gap_mm).abs() < 1e-12);
        if found > 0.0 {
            assert!((gap.gap_mm - found).abs() < 1e-8, "{} {found}", gap.gap_mm);
            assert!(gap.gap_mm > found - 1e-12);
            apart += 1;
        } else if found < -1e-9 {
            assert!(gap.gap_mm <= found + 1e-8, "{} {found}", gap.gap_mm);
            overlapping += 1;
        }
        if found.abs() > 1e-9 {
            assert_eq!(a.with(&b).decide(0.0).is_apart, found > 0.0, "{found}");
        }
    }
    assert!(apart > 150 && overlapping > 100, "{apart} {overlapping}");
}

#[test]
fn a_decision_for_a_gap_is_right_and_proven() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let (mut yes, mut no) = (0, 0);
    for round in 0..40_000 {
        let pair = random_pair(&mut rng, if round % 3 == 0 { 10.0 } else { 1.7 });
        let [a, b] = bodies(&pair);
        let (pair_of, gap_mm) = (a.with(&b), 0.4 * uniform(&mut rng));
        let gap = pair_of.gap().gap_mm;
        // Asked for just less, and just more.
        for asked in [gap_mm, gap * (1.0 - 1e-9), gap * (1.0 + 1e-9)] {
            if asked < 0.0 || (asked - gap).abs() < 1e-11 {
                continue;
            }
            let start = if round % 2 == 0 { pair_of.r } else { direction(&mut rng) };
            let decision = pair_of.decide_from(asked, start);
            assert_eq!(decision.is_apart, gap >= asked, "{gap} {asked}");
            if decision.is_apart {
                let n = scaled(decision.normal, 1.0 / norm(decision.normal));
                assert!(separation_by_shape(&pair, n) >= asked - 1e-13 * norm(pair_of.r));
                yes += 1;
            } else {
                no += 1;
            }
        }
    }
    assert!(yes > 10_000 && no > 10_000, "{yes} {no}");
}

#[test]
fn both_orders_of_a_pair_agree() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
    for _ in 0..20_000 {
        let [a, b] = bodies(&random_pair(&mut rng, 10.0));
        let (one, other) = (a.with(&b), b.with(&a));
        let (p, q) = (one.contact().factor2, other.contact().factor2);
        assert!((p - q).abs() <= 1e-13 * p, "{p} {q}");
        if p > 1.0 + 1e-9 {
            let (p, q) = (one.gap(), other.gap());
            assert!((p.gap_mm - q.gap_mm).abs() <= 1e-12 * norm(one.r), "{p:?} {q:?}");
            assert!(dot(p.normal, q.normal) < -1.0 + 1e-9);
        }
    }
}

#[test]
fn the_factor_is_the_largest_value_of_f_and_decides() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    for _ in 0..2000 {
        let pair = random_pair(&mut rng, 10.0);
        let [a, b] = bodies(&pair);
        let matrix = |i: usize| pair[i].0.matrix_mm2(&pair[i].1);
        let r = pair[1].1.center_mm - pair[0].1.center_mm;
        let f = |l: f64| {
            let c: Matrix3<f64> = (1.0 - l) * matrix(0) + l * matrix(1);
            l * (1.0 - l) * r.dot(&c.lu().solve(&r).unwrap())
        };
        // F is concave: thirds are cut off.
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..120 {
            let (p, q) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if f(p) < f(q) { low = p } else { high = q }
        }
        let (expected, found) = (f((low + high) / 2.0), a.with(&b).contact().factor2);
        assert!((found - expected).abs() < 1e-10 * expected, "{found} {expected}");
        if (found - 1.0).abs() > 1e-9 {
            assert_eq!(a.with(&b).decide(0.0).is_apart, found > 1.0);
        }
    }
}

/// Semi-axes that are longer by half the gap are no test of the gap.
#[test]
fn longer_semi_axes_accept_grains_that_are_too_close() {
    let (gap_mm, mut rng) = (0.5, Xoshiro256PlusPlus::seed_from_u64(6));
    let mut caught = 0;
    for _ in 0..20_000 {
        let pair = random_pair(&mut rng, 5.0);
        let longer = pair.map(|(shape, pose)| {
            let axes = shape.semi_axes_mm().map(|axis| axis + gap_mm / 2.0);
            (ellipsoid(axes.into()), pose)
        });
        let [a, b] = bodies(&longer);
        let by_axes = a.with(&b).decide(0.0).is_apart;
        let [a, b] = bodies(&pair);
        let decision = a.with(&b).decide(gap_mm);
        assert!(by_axes || !decision.is_apart, "the longer ellipsoid lies inside the parallel body");
        caught += u32::from(by_axes && !decision.is_apart);
    }
    assert!(caught > 20, "{caught}");
}

#[test]
fn walls_keep_the_whole_grain() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    let walled = Specimen::Box { size_mm: [20.0, 21.0, 22.0], boundary: Boundary::Walls };
    let cylinder = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 22.0 };
    for round in 0..3000 {
        let [(shape, mut pose), _] = random_pair(&mut rng, 10.0);
        pose.center_mm =
            Vector3::from([10.0; 3]) + Vector3::from(direction(&mut rng)) * 8.0 * uniform(&mut rng);
        if round % 4 == 0 {
            // On the axis, and on an axis of the ellipse: the hard cases of the trust region.
            let far = if round % 8 == 0 { 0.0 } else { 3.0 * uniform(&mut rng) };
            pose = Pose::at(Vector3::new(10.0, 10.0 + far, 10.0));
        }
        let body = Body::new(&shape, &pose);
        let (mut least_box, mut farthest) = (f64::INFINITY, 0.0_f64);
        for i in 0..20_000 {
            let n = if i % 2 == 0 {
                direction(&mut rng)
            } else {
                let turn = PI * f64::from(i) / 10_000.0;
                [turn.cos(), turn.sin(), 0.0]
            };
            // The point whose normal is n.
            let n = Vector3::from(n);
            let local = pose.orientation.inverse() * n;
            let axes = shape.semi_axes_mm();
            let squares = axes.component_mul(&axes);
            let point = squares.component_mul(&local) / axes.component_mul(&local).norm();
            let p = pose.center_mm + pose.orientation * point;
            least_box = least_box.min(p.min()).min(20.0 - p.x).min(21.0 - p.y).min(22.0 - p.z);
            farthest = farthest.max((p.x - 10.0).hypot(p.y - 10.0));
            if round > 100 {
                break;
            }
        }
        let reach = body.reach_from_axis_mm([10.0, 10.0]);
        assert!(reach >= farthest - 1e-12, "{reach} {farthest}");
        let toward = body.reach_direction([10.0, 10.0]);
        let at = [body.center_mm[0] - 10.0, body.center_mm[1] - 10.0, 0.0];
        assert!((dot(at, toward) + body.support_mm(toward) - reach).abs() < 1e-9 * reach, "{toward:?}");
        assert!((norm(toward) - 1.0).abs() < 1e-12);
        let gap = body.wall_gap_mm(&walled);
        assert!(gap <= least_box + 1e-12);
        let in_cylinder = body.wall_gap_mm(&cylinder);
        if round <= 100 {
            assert!((reach - farthest).abs() < 1e-5 * reach, "{reach} {farthest}");
        }
        let half = |axis: Vector3<f64>| {
            shape.semi_axes_mm().component_mul(&(pose.orientation.inverse() * axis)).norm()
        };
        let between = |axis: usize, length: f64| {
            let half = half(Vector3::ith(axis, 1.0));
            (pose.center_mm[axis] - half).min(length - pose.center_mm[axis] - half)
        };
        let expected = between(0, 20.0).min(between(1, 21.0)).min(between(2, 22.0));
        assert!((gap - expected).abs() < 1e-12, "{gap} {expected}");
        assert!(in_cylinder <= 10.0 - reach);
        let periodic = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Periodic };
        assert_eq!(body.wall_gap_mm(&periodic), f64::INFINITY);
    }
}

/// The farthest point from the axis by the eigenvalues of the section and a fine search over its parameter.
#[test]
fn the_reach_is_exact() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(8);
    for _ in 0..300 {
        let [(shape, mut pose), _] = random_pair(&mut rng, 10.0);
        pose.center_mm = Vector3::from(direction(&mut rng)) * 3.0 * uniform(&mut rng);
        let body = Body::new(&shape, &pose);
        let section: Matrix2<f64> = shape.matrix_mm2(&pose).fixed_view::<2, 2>(0, 0).into();
        let root = section.symmetric_eigen();
        let at = |turn: f64| {
            let v = root.eigenvectors.column(0) * (root.eigenvalues[0].sqrt() * turn.cos())
                + root.eigenvectors.column(1) * (root.eigenvalues[1].sqrt() * turn.sin());
            (v.x + pose.center_mm.x).hypot(v.y + pose.center_mm.y)
        };
        let steps = 2000;
        let step = 2.0 * PI / f64::from(steps);
        let best = (0..steps).map(|i| f64::from(i) * step).max_by(|p, q| at(*p).total_cmp(&at(*q))).unwrap();
        let (mut low, mut high) = (best - step, best + step);
        for _ in 0..100 {
            let (p, q) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if at(p) < at(q) { low = p } else { high = q }
        }
        let (reach, expected) = (body.reach_from_axis_mm([0.0, 0.0]), at((low + high) / 2.0));
        assert!((reach - expected).abs() < 1e-12 * expected, "{reach} {expected}");
    }
}

/// Centres so near the short axis of the section, or its long axis, that the sum with a squared semi-axis does not show
/// the offset: the reach is that of a centre on the axis, in closed form, and no wall is passed over.
#[test]
fn a_centre_nearly_on_an_axis_of_the_section_is_kept_from_the_wall() {
    let shape = ellipsoid([5.0, 4.0, 3.0]);
    // Across the axis along z: semi-axes 5 along x and 3 along y.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI / 2.0);
    let turned =
        |center_mm: [f64; 3]| Body::new(&shape, &Pose { center_mm: center_mm.into(), orientation: turn });
    let specimen = Specimen::Cylinder { diameter_mm: 10.0, height_mm: 40.0 };
    for tiny in [0.0, 5e-324, 1e-300, 1e-200, 1e-30, 1e-17, 1e-16, 3e-16, 1e-15, 1e-12] {
        for (y, sign) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (0.5, 1.0)] {
            // On the short axis at y: the farthest point has cos² = 1 - (3 y / 16)², and the square of its distance
            // is 25 + y² + 9 y² / 16.
            let reach = turned([sign * tiny, y, 0.0]).reach_from_axis_mm([0.0, 0.0]);
            let expected: f64 = (25.0 + y * y * (1.0 + 9.0 / 16.0)).sqrt();
            assert!((reach - expected).abs() < 2e-12 * expected, "{tiny} {y}: {reach} {expected}");
            // On the long axis at y.
            let reach = turned([y, sign * tiny, 0.0]).reach_from_axis_mm([0.0, 0.0]);
            assert!((reach - 5.0 - y.abs()).abs() < 2e-12 * reach, "{tiny} {y}: {reach}");
            let body = turned([5.0 + sign * tiny, 5.0 + y, 20.0]);
            let gap = body.wall_gap_mm(&specimen);
            assert!((gap - (5.0 - expected)).abs() < 1e-11, "{tiny} {y}: {gap}");
            assert!(body.reach_direction([5.0, 5.0]).iter().all(|x| x.is_finite()));
        }
    }
    // A circle, and a centre in its middle.
    let ball = Body::new(&ellipsoid([2.0; 3]), &Pose::at(Vector3::new(1e-17, -1e-18, 0.0)));
    assert!((ball.reach_from_axis_mm([0.0, 0.0]) - 2.0).abs() < 1e-15);
}

properties! {
    #[test]
    fn every_direction_is_a_lower_bound(
        axes in prop::array::uniform3(0.2..2.0_f64),
        others in prop::array::uniform3(0.2..2.0_f64),
        q in prop::array::uniform4(-1.0..1.0_f64),
        r in prop::array::uniform3(-6.0..6.0_f64),
        n in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        prop_assume!(q.iter().map(|x| x * x).sum::<f64>() > 0.01 && norm(n) > 0.1 && norm(r) > 0.1);
        let orientation = UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
        let a = Body::new(&ellipsoid(axes), &Pose { center_mm: Vector3::zeros(), orientation });
        let b = Body::new(&ellipsoid(others), &Pose::at(r.into()));
        let gap = a.with(&b).gap();
        let n = scaled(n, 1.0 / norm(n));
        if gap.gap_mm > 1e-9 {
            prop_assert!(a.with(&b).separation_mm(n) <= gap.gap_mm + 1e-12);
        }
        prop_assert!((a.with(&b).separation_mm(gap.normal) - gap.gap_mm).abs() < 1e-13);
    }
}
