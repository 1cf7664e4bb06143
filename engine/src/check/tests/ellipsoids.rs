#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;

use crate::check::region::SpecimenRegion;
use crate::properties::properties;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};

use super::{of_pairs, request, rule, specimen};
use crate::check::body::Ellipsoid as Body;
use crate::check::required::Required;
use crate::check::separation::Image;
use crate::check::separation::ellipsoids::Pair;
use crate::check::*;
use crate::request::PackingRequest;
use crate::rng::draws::{between, direction};
use crate::rng::{Stream, stream, uniform};
use crate::shape::{Ellipsoid, Pose, SizeMeasure, SolidRef};
use crate::{Limits, Unattended, pack};

type Rng = Xoshiro256PlusPlus;

/// Shape and pose of a grain.
type Grain = (Ellipsoid, Pose);

/// A quaternion of any direction whose norm is not 1.
fn orientation(rng: &mut Rng) -> UnitQuaternion<f64> {
    let coords = (0..4).map(|_| between(rng, -1.0, 1.0)).collect::<Vec<_>>();
    let q = Quaternion::new(coords[0], coords[1], coords[2], coords[3]);
    if q.norm_squared() < 0.01 { orientation(rng) } else { UnitQuaternion::new_unchecked(q) }
}

/// Semi-axes from 1/ratio to 1 times a size.
fn ellipsoid(rng: &mut Rng, size: f64, ratio: f64) -> Ellipsoid {
    let mut axis = || size * (-ratio.ln() * uniform(rng)).exp();
    Ellipsoid::new([axis(), axis(), size]).unwrap()
}

fn support_point((shape, pose): &Grain, n: &Vector3<f64>) -> Vector3<f64> {
    let matrix = shape.matrix_mm2(pose);
    matrix * n / n.dot(&(matrix * n)).sqrt()
}

fn request_for(specimen: &Value, distance: &Value, grains: &[Grain]) -> PackingRequest {
    let diameters: Vec<f64> = grains.iter().map(|(shape, _)| shape.equivalent_diameter_mm()).collect();
    request(specimen, distance, &diameters)
}

fn checked(grains: &[Grain], request: &PackingRequest) -> Result<Check, Fault> {
    let (shapes, poses): (Vec<SolidRef<'_>>, Vec<_>) =
        grains.iter().map(|&(shape, pose)| (SolidRef::from(shape), pose)).unzip();
    check_shapes(&shapes, &poses, request, SizeMeasure::Equivalent, &Unattended)
}

/// Largest `s(n)` over a grid of directions, refined around the best: the oracle of the search for directions.
fn brute_force_separation(a: &Grain, b: &Grain) -> f64 {
    let (of_a, of_b) = (a.0.matrix_mm2(&a.1), b.0.matrix_mm2(&b.1));
    let r = b.1.center_mm - a.1.center_mm;
    let s = |n: &Vector3<f64>| {
        let n = n.normalize();
        n.dot(&r) - n.dot(&(of_a * n)).sqrt() - n.dot(&(of_b * n)).sqrt()
    };
    let points = 400;
    let mut best = (0..points)
        .map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(points);
            let (angle, radius) = (f64::from(i) * 2.399_963_229_728_653, (1.0 - z * z).sqrt());
            Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
        })
        .max_by(|p, q| s(p).total_cmp(&s(q)))
        .unwrap();
    let mut step = 0.2;
    while step > 1.0e-9 {
        let u = best.cross(&if best.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() }).normalize();
        let v = best.cross(&u);
        let around = (0..8).map(|i| {
            let angle = f64::from(i) * TAU / 8.0;
            (best + (u * angle.cos() + v * angle.sin()) * step).normalize()
        });
        let next = around.max_by(|p, q| s(p).total_cmp(&s(q))).unwrap();
        if s(&next) > s(&best) { best = next } else { step *= 0.6 }
    }
    s(&best)
}

/// Position of `b` at which the two bodies keep a gap along a direction: the direction is the common normal there.
fn at_gap(a: &Grain, b: &Grain, n: &Vector3<f64>, gap: f64) -> Vector3<f64> {
    a.1.center_mm + support_point(a, n) + n * gap + support_point(b, n)
}

/// Distance along `d` at which `b` touches `a`, and the normal there, by the contact function of Perram and Wertheim:
/// the centres then lie `1 / sqrt(max l (1 - l) d . C^-1 d)` apart.
fn touching_along(a: &Grain, b: &Grain, d: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let (of_a, of_b) = (a.0.matrix_mm2(&a.1), b.0.matrix_mm2(&b.1));
    let normal = |l: f64| Matrix3::lu(of_a * (1.0 - l) + of_b * l).solve(d).unwrap();
    let f = |l: f64| l * (1.0 - l) * d.dot(&normal(l));
    let (mut low, mut high) = (0.0, 1.0);
    while high - low > 1.0e-9 {
        let (p, q) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if f(p) < f(q) { low = p } else { high = q }
    }
    (1.0 / f(low).sqrt(), normal(low).normalize())
}

fn wrapped(p: Vector3<f64>, size: [f64; 3]) -> Vector3<f64> {
    Vector3::from_fn(|k, _| p[k].rem_euclid(size[k]))
}

#[test]
fn grains_pushed_into_another_by_a_billionth_of_their_size_are_refused() {
    let mut rng = stream(7, Stream::Sampling);
    let size = [30.0, 32.0, 34.0];
    for case in 0..10_000_u64 {
        let (specimen, distance) = (specimen(case), rule(case / 3));
        let is_periodic = case % 3 == 1;
        let ratio = if case % 5 == 0 { 10.0 } else { 1.6 };
        let mut grains: Vec<Grain> = Vec::new();
        for place in 0..4 {
            let scale = between(&mut rng, 1.0, 3.0);
            let shape = ellipsoid(&mut rng, scale, ratio);
            // The first two meet in the middle or across the faces of the periodic box, the others keep to corners.
            let center = match place {
                0 if is_periodic => Vector3::from(size.map(|l| l * uniform(&mut rng))),
                0 => Vector3::from(size.map(|l| l * between(&mut rng, 0.47, 0.53))),
                _ => Vector3::new(16.0, 16.0, if place == 2 { 4.0 } else { 30.0 }),
            };
            grains.push((shape, Pose { center_mm: center, orientation: orientation(&mut rng) }));
        }
        if is_periodic {
            grains.truncate(2);
        }
        let request = request_for(&specimen, &distance, &grains);
        let gap = Required::new(request.distance, SpecimenRegion::new(&request.specimen))
            .gap_mm(grains[0].0.equivalent_diameter_mm(), grains[1].0.equivalent_diameter_mm());
        let d = direction(&mut rng);
        let (touching, n) = if gap > 0.0 || case % 2 == 0 {
            (at_gap(&grains[0], &grains[1], &d, gap), d)
        } else {
            let (distance, n) = touching_along(&grains[0], &grains[1], &d);
            (grains[0].1.center_mm + d * distance, n)
        };
        let step = n * grains[0].0.equivalent_diameter_mm().min(grains[1].0.equivalent_diameter_mm());
        for (share, is_valid) in [(1.0e-11, true), (-1.0e-9, false)] {
            let moved = touching + step * share;
            grains[1].1.center_mm = if is_periodic { wrapped(moved, size) } else { moved };
            let verdict = checked(&grains, &request);
            match verdict {
                Ok(check) => {
                    assert!(is_valid, "case {case}: {check:?}");
                    let excess = check.found.min_excess_gap_mm.unwrap();
                    assert!(excess < 1.0e-10, "case {case}: {excess}");
                }
                Err(Fault::Pair { first: 0, second: 1, .. }) => {
                    assert!(!is_valid, "case {case}: {verdict:?}");
                }
                Err(other) => panic!("case {case}: {other}"),
            }
        }
    }
}

#[test]
fn contacts_in_line_with_the_rounding_of_coordinates_are_decided_by_the_stored_numbers() {
    let mut rng = stream(8, Stream::Sampling);
    let (mut kept, mut refused) = (0, 0);
    for _ in 0..2000 {
        let shapes = [1.0, 2.0].map(|size| ellipsoid(&mut rng, size, 10.0));
        let pose = |rng: &mut Rng| Pose { center_mm: Vector3::zeros(), orientation: orientation(rng) };
        let mut grains = shapes.map(|shape| (shape, pose(&mut rng)));
        let bodies = grains.map(|(shape, pose)| Body::new(&shape, &pose).unwrap());
        let n = direction(&mut rng);
        grains[1].1.center_mm = at_gap(&grains[0], &grains[1], &n, 0.0);
        // One step of the last digit along the normal changes the answer, whichever it is here.
        let answer = |units: f64| {
            let mut b = bodies[1];
            b.center = grains[1].1.center_mm + n * (units * f64::EPSILON * 8.0);
            let pair = Pair::new(&bodies[0], &b, Image { steps: [0.0; 3], period: [0.0; 3] });
            let found = pair.search(f64::INFINITY);
            pair.keeps(0.0, &found)
        };
        let answers = [-8.0, -4.0, -1.0, 0.0, 1.0, 4.0, 8.0].map(answer);
        assert!(!answers[0] && answers[6], "{answers:?}");
        assert!(answers.is_sorted(), "{answers:?}");
        if answers[3] { kept += 1 } else { refused += 1 }
    }
    assert!(kept > 200 && refused > 200, "{kept} {refused}");
}

#[test]
fn equal_spheres_that_touch_pass_at_any_orientation_and_the_last_digit_of_an_overlap_fails() {
    let mut rng = stream(9, Stream::Sampling);
    for case in 0..2000 {
        let shape = Ellipsoid::new([2.0; 3]).unwrap();
        let at =
            |x: [f64; 3], rng: &mut Rng| (shape, Pose { center_mm: x.into(), orientation: orientation(rng) });
        // Pythagorean: 2^2 + 2^2 + ... and 12/5, 16/5 are not representable, so that only whole numbers touch exactly.
        let (p, q) = match case % 3 {
            0 => ([4.0, 5.0, 5.0], [8.0, 5.0, 5.0]),
            1 => ([2.0, 2.0, 2.0], [2.0, 6.0, 2.0]),
            _ => ([5.0, 5.0, 2.0], [5.0, 5.0, 6.0]),
        };
        let mut grains = vec![at(p, &mut rng), at(q, &mut rng)];
        for kind in 0..3 {
            let request = request_for(&specimen(kind), &json!({"type": "none"}), &grains);
            let is_in_cylinder = |p: [f64; 3]| (p[0] - 16.0).hypot(p[1] - 16.0) <= 14.0;
            if kind == 2 && !(is_in_cylinder(p) && is_in_cylinder(q)) {
                continue;
            }
            let found = checked(&grains, &request).unwrap().found;
            assert!(found.min_gap_mm.unwrap().abs() < 1e-14, "{found:?}");
            assert_eq!(found.min_excess_gap_mm.map(|e| e < 1e-14), Some(true));
        }
        let request = request_for(&specimen(0), &json!({"type": "none"}), &grains);
        let axis = (0..3).find(|&k| p[k] != q[k]).unwrap();
        grains[1].1.center_mm[axis] = grains[1].1.center_mm[axis].next_down();
        assert!(matches!(checked(&grains, &request), Err(Fault::Pair { first: 0, second: 1, .. })));
    }
}

#[test]
fn spheres_give_the_figures_of_the_sphere_check() {
    let mut rng = stream(10, Stream::Sampling);
    for kind in 0..12 {
        let value = json!({"specimen": specimen(kind), "distance": rule(kind / 3),
            "mix": {"grading": {"type": "standard", "name": "B8"}, "volume_fraction": 0.3, "allow_coarse": true}});
        let request = PackingRequest::from_json(&value, kind).unwrap();
        let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
        let expected = check(packing.spheres().unwrap(), &request).unwrap();
        let grains: Vec<Grain> = (0..packing.spheres().unwrap().len())
            .map(|row| {
                let center_mm = packing.spheres().unwrap().center(row).into();
                let shape = Ellipsoid::new([0.5 * packing.spheres().unwrap().d_mm[row]; 3]).unwrap();
                (shape, Pose { center_mm, orientation: orientation(&mut rng) })
            })
            .collect();
        let found = checked(&grains, &request).unwrap();
        let same = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() < 1e-12,
            (a, b) => a == b,
        };
        let (f, e) = (found.found, expected.found);
        assert!(same(f.min_gap_mm, e.min_gap_mm), "{f:?} {e:?}");
        assert!(same(f.min_wall_gap_mm, e.min_wall_gap_mm), "{f:?} {e:?}");
        assert!(same(f.min_excess_gap_mm, e.min_excess_gap_mm), "{f:?} {e:?}");
        assert!((f.max_class_mass_error - e.max_class_mass_error).abs() < 1e-9, "{f:?} {e:?}");
        assert_eq!(found.classes.len(), expected.classes.len());
        for (f, e) in found.classes.iter().zip(&expected.classes) {
            assert_eq!((f.grains, f.d_min_mm, f.d_max_mm), (e.grains, e.d_min_mm, e.d_max_mm));
            assert_eq!(f.target_volume_mm3, e.target_volume_mm3);
            assert!((f.volume_mm3 / e.volume_mm3 - 1.0).abs() < 1e-9 || e.volume_mm3 == 0.0);
        }
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(1000))]
    /// Pairs anywhere, of any ratio up to 10:1: the check agrees with the largest `s` of many directions on whether
    /// they overlap, and on how far apart they are where they do not.
    #[test]
    fn random_pairs_are_judged_as_by_brute_force(
        seed in 0_u64..1_000_000_000, size in 0.3..3.0_f64, ratio in 1.0..10.0_f64, near in 0.2..1.5_f64,
    ) {
        let mut rng = stream(seed, Stream::Sampling);
        let center = Vector3::new(16.0, 16.0, 17.0);
        let mut pose = || Pose { center_mm: center, orientation: orientation(&mut rng) };
        let poses = [pose(), pose()];
        let a = (ellipsoid(&mut rng, 3.0, ratio), poses[0]);
        let mut b = (ellipsoid(&mut rng, size, ratio), poses[1]);
        b.1.center_mm += direction(&mut rng) * near * (size + 3.0);
        let request = request_for(&specimen(0), &json!({"type": "none"}), &[a, b]);
        let s = brute_force_separation(&a, &b);
        match checked(&[a, b], &request) {
            Ok(check) => {
                let gap = check.found.min_gap_mm.unwrap();
                prop_assert!(s > -1e-12 && (gap - s).abs() < 1e-9, "{gap} {s}");
                prop_assert!(gap >= s - 1e-13, "{gap} {s}");
            }
            Err(Fault::Pair { clearance_mm, .. }) => {
                // Of overlapping bodies `s` may have several maxima.
                prop_assert!(s < 1e-12 && clearance_mm <= 0.0, "{clearance_mm} {s}");
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }

    /// All images of a periodic box, and those of a grain itself, against brute force.
    #[test]
    fn images_of_long_grains_are_seen(
        seed in 0_u64..1_000_000_000, length in 1.0..14.0_f64, scale in 0.05..0.6_f64, n in 1_usize..5,
    ) {
        let mut rng = stream(seed, Stream::Sampling);
        let size = [10.0, 12.0, 9.0];
        let specimen = json!({"type": "box", "size_mm": size, "boundary": "periodic"});
        let grains: Vec<Grain> = (0..n).map(|_| {
            let thin = length * scale * between(&mut rng, 0.1, 0.3);
            let shape = Ellipsoid::new([length * scale, thin, thin * between(&mut rng, 0.5, 1.0)]).unwrap();
            let center_mm = Vector3::from(size.map(|l| l * uniform(&mut rng)));
            (shape, Pose { center_mm, orientation: orientation(&mut rng) })
        }).collect();
        let mut least = f64::INFINITY;
        for i in 0..n {
            for j in 0..=i {
                for image in 0..343 {
                    let steps = [image % 7 - 3, image / 7 % 7 - 3, image / 49 - 3];
                    if i == j && steps == [0; 3] {
                        continue;
                    }
                    let mut moved = grains[j];
                    moved.1.center_mm += Vector3::from_fn(|k, _| f64::from(steps[k]) * size[k]);
                    let far = (moved.1.center_mm - grains[i].1.center_mm).norm() - 2.0 * length * scale;
                    if far < least.min(12.0) {
                        least = least.min(brute_force_separation(&grains[i], &moved));
                    }
                }
            }
        }
        match checked(&grains, &request_for(&specimen, &json!({"type": "none"}), &grains)) {
            Ok(check) => {
                let gap = check.found.min_gap_mm.unwrap();
                prop_assert!((gap - least).abs() < 1e-8, "{gap} {least}");
            }
            Err(Fault::Pair { .. }) => prop_assert!(least < 1e-12, "{least}"),
            Err(other) => prop_assert!(false, "{other}"),
        }
    }

    /// The farthest point from the axis of a cylinder, against many points of the surface.
    #[test]
    fn walls_are_judged_as_by_brute_force(
        seed in 0_u64..1_000_000_000, ratio in 1.0..10.0_f64, size in 0.2..15.9_f64, place in 0.0..1.0_f64,
        kind in 0..2_u64,
    ) {
        let mut rng = stream(seed, Stream::Sampling);
        let shape = ellipsoid(&mut rng, size, ratio);
        let off = Vector3::from_fn(|_, _| between(&mut rng, -place, place)) * (16.0 - size);
        let center_mm = Vector3::new(16.0, 16.0, 17.0) + off;
        let grain = (shape, Pose { center_mm, orientation: orientation(&mut rng) });
        let specimen = specimen(2 * kind);
        let request = request_for(&specimen, &json!({"type": "none", "wall_gap_mm": 0.25}), &[grain]);
        let h = |n: &Vector3<f64>| n.dot(&support_point(&grain, n));
        let plane = |k: usize, length: f64| {
            let h = h(&Vector3::ith(k, 1.0));
            (center_mm[k] - h).min(length - center_mm[k] - h)
        };
        let gap = if kind == 0 {
            plane(0, 30.0).min(plane(1, 32.0)).min(plane(2, 34.0))
        } else {
            // The tangent plane of the cylinder at each angle, refined at the least.
            let c = center_mm - Vector3::new(16.0, 16.0, 0.0);
            let reach = |angle: f64| {
                let m = Vector3::new(angle.cos(), angle.sin(), 0.0);
                c.dot(&m) + h(&m)
            };
            let steps = 720;
            let angle = |i: i32| f64::from(i) * TAU / f64::from(steps);
            let best = (0..steps).map(|i| reach(angle(i))).fold(0.0, f64::max);
            let refined = |i: i32| {
                let (mut low, mut high) = (angle(i - 1), angle(i + 1));
                while high - low > 1e-9 {
                    let (p, q) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                    if reach(p) < reach(q) { low = p } else { high = q }
                }
                reach(low)
            };
            let near = (0..steps).filter(|&i| reach(angle(i)) > best - 1e-3);
            let farthest = near.map(refined).fold(0.0, f64::max);
            plane(2, 34.0).min(16.0 - farthest)
        };
        match checked(&[grain], &request) {
            Ok(check) => {
                let found = check.found.min_wall_gap_mm.unwrap();
                prop_assert!(gap >= 0.25 - 1e-12 && (gap - found).abs() < 1e-10, "{gap} {found}");
            }
            Err(Fault::Wall { clearance_mm, .. }) => {
                prop_assert!(gap < 0.25 + 1e-12 && (gap - clearance_mm).abs() < 1e-10, "{gap} {clearance_mm}");
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

#[test]
fn grains_pushed_into_a_wall_by_a_billionth_of_their_size_are_refused() {
    let mut rng = stream(11, Stream::Sampling);
    for case in 0..6000_u64 {
        let is_cylinder = case % 2 == 1;
        let (specimen, distance) = (specimen(if is_cylinder { 2 } else { 0 }), rule(case / 2));
        let scale = between(&mut rng, 1.0, 4.0);
        // A thin grain may touch the lateral surface at two points; these touch it at one.
        let shape = ellipsoid(&mut rng, scale, if is_cylinder { 1.7 } else { 10.0 });
        let mut grain =
            (shape, Pose { center_mm: Vector3::new(16.0, 16.0, 17.0), orientation: orientation(&mut rng) });
        let request = request_for(&specimen, &distance, &[grain]);
        let gap = Required::new(request.distance, SpecimenRegion::new(&request.specimen))
            .wall_gap_mm(shape.equivalent_diameter_mm());
        let angle = TAU * uniform(&mut rng);
        let (m, to_wall) = match (is_cylinder, case / 2 % 3) {
            (true, 0 | 1) => (Vector3::new(angle.cos(), angle.sin(), 0.0), 16.0),
            (_, 2) => (Vector3::z(), 17.0),
            (false, _) => (-Vector3::y(), 16.0),
            (true, _) => unreachable!(),
        };
        let point = support_point(&grain, &m);
        // The touching point of the lateral surface must lie on the ray from the axis along its normal.
        let aside = if is_cylinder && m.z == 0.0 { point - m * m.dot(&point) } else { Vector3::zeros() };
        let aside = Vector3::new(aside.x, aside.y, 0.0);
        let touching = grain.1.center_mm + m * (to_wall - gap - m.dot(&point)) - aside;
        for (share, is_valid) in [(-1.0e-11, true), (1.0e-9, false)] {
            grain.1.center_mm = touching + m * (share * shape.equivalent_diameter_mm());
            let verdict = checked(&[grain], &request);
            match verdict {
                Ok(_) => assert!(is_valid, "case {case}: {verdict:?}"),
                Err(Fault::Wall { .. }) => assert!(!is_valid, "case {case}: {verdict:?}"),
                Err(other) => panic!("case {case}: {other}"),
            }
        }
    }
}

#[test]
fn grains_that_fit_exactly_fit() {
    let grain = |axes: [f64; 3], center: [f64; 3], q: [f64; 4]| {
        let orientation = UnitQuaternion::new_unchecked(Quaternion::new(q[0], q[1], q[2], q[3]));
        (Ellipsoid::new(axes).unwrap(), Pose { center_mm: center.into(), orientation })
    };
    let none = json!({"type": "none"});
    let cube = json!({"type": "box", "size_mm": [6, 4, 2]});
    let tube = json!({"type": "cylinder", "diameter_mm": 8, "height_mm": 4});
    for (specimen, grain) in [
        (&cube, grain([3.0, 2.0, 1.0], [3.0, 2.0, 1.0], [1.0, 0.0, 0.0, 0.0])),
        (&cube, grain([3.0, 2.0, 1.0], [3.0, 2.0, 1.0], [0.0, 0.3, 0.0, 0.0])),
        (&tube, grain([4.0, 4.0, 2.0], [4.0, 4.0, 2.0], [0.3, 0.0, 0.0, 0.7])),
        (&tube, grain([4.0, 3.0, 2.0], [4.0, 4.0, 2.0], [0.3, 0.0, 0.0, 0.7])),
        (&tube, grain([2.0, 2.0, 2.0], [4.0, 2.0, 2.0], [0.3, 0.1, 0.2, 0.7])),
        (&tube, grain([2.0, 1.0, 1.0], [6.0, 4.0, 2.0], [0.3, 0.0, 0.0, 0.0])),
    ] {
        let found = checked(&[grain], &request_for(specimen, &none, &[grain])).unwrap().found;
        assert!(found.min_wall_gap_mm.unwrap().abs() < 1e-14, "{found:?}");
        let mut larger = grain;
        larger.0 = Ellipsoid::new(grain.0.semi_axes_mm().map(f64::next_up).into()).unwrap();
        let request = request_for(specimen, &none, &[larger]);
        assert!(matches!(checked(&[larger], &request), Err(Fault::Wall { .. })), "{grain:?}");
    }
}

#[test]
fn every_certificate_can_be_evaluated_again() {
    let mut rng = stream(12, Stream::Sampling);
    let size = [30.0, 32.0, 34.0];
    for kind in 0..2 {
        let mut grains: Vec<Grain> = Vec::new();
        let request = |grains: &[Grain]| request_for(&specimen(kind), &rule(1), grains);
        for _ in 0..3000 {
            let pose = Pose {
                center_mm: Vector3::from(size.map(|l| l * uniform(&mut rng))),
                orientation: orientation(&mut rng),
            };
            grains.push((ellipsoid(&mut rng, 3.0, 3.0), pose));
            if checked(&grains, &request(&grains)).is_err() {
                grains.pop();
            }
        }
        let (shapes, poses): (Vec<SolidRef<'_>>, Vec<_>) =
            grains.iter().map(|&(shape, pose)| (SolidRef::from(shape), pose)).unzip();
        let list = of_pairs(certify_shapes(&shapes, &poses, &request(&grains), 1.5, &Unattended).unwrap());
        assert!(list.len() > 100, "{}", list.len());
        for c in &list {
            let n = Vector3::from(c.normal).normalize();
            let shift = Vector3::from_fn(|k, _| f64::from(c.image[k]) * size[k]);
            let r = grains[c.second.unwrap()].1.center_mm + shift - grains[c.first].1.center_mm;
            let s = r.dot(&n)
                - n.dot(&support_point(&grains[c.first], &n))
                - n.dot(&support_point(&grains[c.second.unwrap()], &n));
            assert!((s - c.separation_mm).abs() < 1e-12 && (0.7..1.5).contains(&s), "{c:?} {s}");
        }
        let least = list.iter().map(|c| c.separation_mm).fold(f64::INFINITY, f64::min);
        let found = checked(&grains, &request(&grains)).unwrap().found;
        assert!((found.min_gap_mm.unwrap() - least).abs() < 1e-13);
        // Every pair that is closer is in the list, once.
        if kind == 0 {
            let mut closer = 0;
            for i in 0..grains.len() {
                closer +=
                    (0..i).filter(|&j| brute_force_separation(&grains[i], &grains[j]) < 1.5 - 1e-9).count();
            }
            assert_eq!(closer, list.len());
        }
    }
}

#[test]
fn the_norm_of_a_quaternion_changes_nothing() {
    let mut rng = stream(13, Stream::Sampling);
    let mut grains: Vec<Grain> = (0..8)
        .map(|i| {
            let center_mm = Vector3::new(
                8.0 + 14.0 * f64::from(i & 1),
                8.0 + 7.0 * f64::from(i & 2),
                8.0 + 4.0 * f64::from(i & 4),
            );
            (ellipsoid(&mut rng, 5.0, 8.0), Pose { center_mm, orientation: orientation(&mut rng) })
        })
        .collect();
    let request = request_for(&specimen(0), &json!({"type": "none"}), &grains);
    let expected = checked(&grains, &request).unwrap().found;
    for factor in [-1.0, 4.0, 1.0e-9, 3.7e12] {
        for (_, pose) in &mut grains {
            let scaled = *pose.orientation.quaternion() * factor;
            pose.orientation = UnitQuaternion::new_unchecked(scaled);
        }
        let found = checked(&grains, &request).unwrap().found;
        assert!((found.min_gap_mm.unwrap() - expected.min_gap_mm.unwrap()).abs() < 1e-13, "{factor}");
        assert!(
            (found.min_wall_gap_mm.unwrap() - expected.min_wall_gap_mm.unwrap()).abs() < 1e-13,
            "{factor}"
        );
        for (_, pose) in &mut grains {
            pose.orientation = UnitQuaternion::new_unchecked(*pose.orientation.quaternion() / factor);
        }
    }
    for broken in [Quaternion::new(0.0, 0.0, 0.0, 0.0), Quaternion::new(1.0, f64::NAN, 0.0, 0.0)] {
        grains[3].1.orientation = UnitQuaternion::new_unchecked(broken);
        assert_eq!(checked(&grains, &request), Err(Fault::NotABody { grain: 3 }));
    }
    let (shapes, poses): (Vec<SolidRef<'_>>, Vec<_>) =
        grains.iter().map(|&(shape, pose)| (SolidRef::from(shape), pose)).unzip();
    let verdict = check_shapes(&shapes[1..], &poses, &request, SizeMeasure::Sieve, &Unattended);
    assert_eq!(verdict, Err(Fault::Columns));
}

#[test]
fn the_grading_counts_the_mass_of_bodies_by_the_sieve_that_they_pass() {
    // Flat grains of sieve size 4 and thickness 1: b = sqrt(8 - 1), of twice that length.
    let b = 7.0_f64.sqrt();
    let shape = Ellipsoid::new([2.0 * b, b, 1.0]).unwrap();
    let at = |x: f64| Pose::at(Vector3::new(16.0, 16.0, x));
    let (shapes, poses) = (vec![SolidRef::from(shape); 6], [3.0, 6.0, 9.0, 12.0, 15.0, 18.0].map(at));
    let fraction = 5.5 * shape.volume_mm3() / (30.0 * 32.0 * 34.0);
    let value = json!({"specimen": specimen(0), "mix": {"grading": {"type": "monodisperse", "diameter_mm": 4},
        "volume_fraction": fraction, "allow_coarse": true}});
    let request = PackingRequest::from_json(&value, 1).unwrap();
    let verdict =
        |size, rows: usize| check_shapes(&shapes[..rows], &poses[..rows], &request, size, &Unattended);
    let found = verdict(SizeMeasure::Sieve, 6).unwrap();
    assert_eq!(found.classes[0].grains, 6);
    assert!((found.classes[0].volume_mm3 - 6.0 * shape.volume_mm3()).abs() < 1e-9);
    assert!(matches!(verdict(SizeMeasure::Sieve, 5), Err(Fault::Grading(_))));
    assert!(matches!(verdict(SizeMeasure::Equivalent, 6), Err(Fault::Grading(_))));
    let value = json!({"specimen": specimen(0), "mix": {"grading": {"type": "diameters", "diameters_mm": [4, 4, 4]}}});
    let list = PackingRequest::from_json(&value, 1).unwrap();
    let verdict =
        |rows: usize| check_shapes(&shapes[..rows], &poses[..rows], &list, SizeMeasure::Sieve, &Unattended);
    assert_eq!(verdict(3).unwrap().found.max_class_mass_error, 0.0);
    assert!(matches!(verdict(4), Err(Fault::Grading(_))));
}
