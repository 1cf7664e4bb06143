//! Every pair of a packing again, by a formula and a search of their own.

use nalgebra::{Matrix3, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

use crate::distance::DistanceRule;
use crate::gap::ellipsoids::Body;
use crate::request::Specimen;
use crate::rng::uniform;
use crate::shape::{Ellipsoid, Pose};

fn support(shape: &Ellipsoid, pose: &Pose, n: Vector3<f64>) -> f64 {
    shape.semi_axes_mm().component_mul(&(pose.orientation.inverse() * n)).norm()
}

/// The largest `s(n)` found, or one that is enough: along the bisection for the root of `F'`, then at random.
fn best_separation(a: (&Ellipsoid, &Pose), b: (&Ellipsoid, &Pose), r: Vector3<f64>, enough: f64) -> f64 {
    let (p, q): (Matrix3<f64>, Matrix3<f64>) = (a.0.matrix_mm2(a.1), b.0.matrix_mm2(b.1));
    let s = |n: Vector3<f64>| r.dot(&n) - support(a.0, a.1, n) - support(b.0, b.1, n);
    let (mut low, mut high, mut best) = (0.0, 1.0, s(r.normalize()));
    for _ in 0..50 {
        let l = (low + high) / 2.0;
        let n = ((1.0 - l) * p + l * q).lu().solve(&r).unwrap();
        best = best.max(s(n.normalize()));
        let more = (1.0 - l) * (1.0 - l) * n.dot(&(p * n)) > l * l * n.dot(&(q * n));
        if more { low = l } else { high = l }
    }
    // From the normal of contact to that of the gap, by steps at random that shrink.
    let l = (low + high) / 2.0;
    let mut n = ((1.0 - l) * p + l * q).lu().solve(&r).unwrap().normalize();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0);
    let mut step = 0.1;
    while step > 1e-7 && best < enough {
        let mut gained = false;
        for _ in 0..8 {
            let m = (n + Vector3::from_fn(|_, _| step * (2.0 * uniform(&mut rng) - 1.0))).normalize();
            if s(m) > s(n) {
                (n, gained) = (m, true);
            }
        }
        best = best.max(s(n));
        step *= if gained { 1.2 } else { 0.6 };
    }
    best
}

/// Fails unless all gaps are kept.
pub(super) fn assert_valid(specimen: &Specimen, rule: &DistanceRule, shapes: &[Ellipsoid], poses: &[Pose]) {
    assert_eq!(violation(specimen, rule, shapes, poses), None);
}

/// Whether all gaps are kept.
pub(super) fn is_valid(
    specimen: &Specimen,
    rule: &DistanceRule,
    shapes: &[Ellipsoid],
    poses: &[Pose],
) -> bool {
    violation(specimen, rule, shapes, poses).is_none()
}

/// The first gap that is not kept, in words.
fn violation(
    specimen: &Specimen,
    rule: &DistanceRule,
    shapes: &[Ellipsoid],
    poses: &[Pose],
) -> Option<String> {
    let bounds = specimen.bounds_mm();
    let longest = shapes.iter().map(|shape| shape.semi_axes_mm().x).fold(0.0, f64::max);
    let widest = shapes.iter().map(Ellipsoid::equivalent_diameter_mm).fold(0.0, f64::max);
    let reach = 2.0 * longest + rule.gap_mm(widest, widest);
    // Grains may be longer than an edge.
    let steps = |axis: usize| {
        let most = if specimen.is_periodic() { (reach / bounds[axis]) as i32 + 1 } else { 0 };
        -most..=most
    };
    let images: Vec<Vector3<f64>> = steps(0)
        .flat_map(|x| steps(1).flat_map(move |y| steps(2).map(move |z| [x, y, z].map(f64::from))))
        .map(|[x, y, z]| Vector3::new(x * bounds[0], y * bounds[1], z * bounds[2]))
        .collect();
    for (i, a) in poses.iter().enumerate() {
        let shape = &shapes[i];
        let d_i = shape.equivalent_diameter_mm();
        let wall = Body::new(shape, a).wall_gap_mm(specimen);
        if wall < rule.wall_gap_mm(d_i) {
            return Some(format!("{i}: {wall} from a wall"));
        }
        for (j, b) in poses.iter().enumerate().skip(i) {
            let other = &shapes[j];
            let gap_mm = rule.gap_mm(d_i, other.equivalent_diameter_mm());
            for shift in &images {
                let r = b.center_mm + shift - a.center_mm;
                let far = shape.semi_axes_mm().x + other.semi_axes_mm().x + gap_mm;
                if r.norm() == 0.0 || r.norm() >= far {
                    continue;
                }
                let s = best_separation((shape, a), (other, b), r, gap_mm);
                if s < gap_mm {
                    return Some(format!("{i} {j}: {s} {gap_mm}"));
                }
            }
        }
    }
    None
}
