#![allow(clippy::unwrap_used)]

use nalgebra::{Quaternion, UnitQuaternion};

use super::*;
use crate::rng::{Stream, stream, uniform};

fn close(found: f64, known: f64, tolerance: f64) {
    assert!((found / known - 1.0).abs() < tolerance, "{found} for {known}");
}

/// Ellipsoids with ratios from 0.1 to 1.
fn random_ellipsoids(n: usize) -> Vec<Ellipsoid> {
    let mut rng = stream(11, Stream::Sampling);
    let mut ratio = || 0.1 + 0.9 * uniform(&mut rng);
    (0..n).map(|_| Ellipsoid::new([1.0, ratio(), ratio()].map(|axis| 7.0 * axis)).unwrap()).collect()
}

#[test]
fn surface_of_spheroids_in_closed_form() {
    for ratio in [0.1, 0.3, 0.5, 0.8, 0.99, 0.999_999, 1.0_f64] {
        let (long, short) = (3.0, 3.0 * ratio);
        let eccentricity = (1.0 - ratio * ratio).sqrt();
        let (oblate, prolate) = if ratio < 1.0 {
            let e = eccentricity;
            (
                2.0 * PI * long * long * (1.0 + (1.0 - e * e) / e * e.atanh()),
                2.0 * PI * short * short * (1.0 + e.asin() / (ratio * e)),
            )
        } else {
            (36.0 * PI, 36.0 * PI)
        };
        close(Ellipsoid::new([long, long, short]).unwrap().surface_mm2(), oblate, 1e-12);
        close(Ellipsoid::new([long, short, short]).unwrap().surface_mm2(), prolate, 1e-12);
    }
    assert_eq!(Ellipsoid::sphere(2.0).unwrap().surface_mm2(), 4.0 * PI);
}

#[test]
fn surface_by_integration() {
    // S = integral over the unit sphere of a b c |A^-1 u| dS; by Gauss points in z and equal steps in angle.
    for shape in random_ellipsoids(20) {
        let [a, b, c]: [f64; 3] = shape.semi_axes_mm().into();
        let (steps, mut sum) = (400, 0.0);
        for i in 0..steps {
            let t = (f64::from(i) + 0.5) / f64::from(steps) * PI;
            for j in 0..steps {
                let p = (f64::from(j) + 0.5) / f64::from(steps) * PI / 2.0;
                let u = [t.sin() * p.cos() / a, t.sin() * p.sin() / b, t.cos() / c];
                sum += t.sin() * u.iter().map(|x| x * x).sum::<f64>().sqrt();
            }
        }
        let integral = 4.0 * a * b * c * sum * PI * PI / 2.0 / f64::from(steps * steps);
        close(shape.surface_mm2(), integral, 1e-4);
        assert!(shape.sphericity() < 1.0 && shape.sphericity() > 0.2);
    }
}

#[test]
fn mean_width_by_integration() {
    for shape in random_ellipsoids(20) {
        let pose = Pose::at(Vector3::zeros());
        let (steps, mut sum) = (200, 0.0);
        for i in 0..steps {
            let z = (f64::from(i) + 0.5) / f64::from(steps);
            for j in 0..steps {
                let p = (f64::from(j) + 0.5) / f64::from(steps) * PI / 2.0;
                let across = (1.0 - z * z).sqrt();
                let u = Vector3::new(across * p.cos(), across * p.sin(), z);
                sum += 2.0 * shape.support_mm(&pose, &u);
            }
        }
        close(shape.mean_width_mm(), sum / f64::from(steps * steps), 1e-4);
    }
}

#[test]
fn a_sphere_has_the_closed_forms_of_a_sphere() {
    for d in [1e-6, 0.1, 2.3, 7.7, 16.0, 31.5, 1e6] {
        for shape in [
            Ellipsoid::sphere(d).unwrap(),
            Ellipsoid::with_equivalent_diameter(d, Form::SPHERE).unwrap(),
            Ellipsoid::with_sieve_size(d, Form::SPHERE).unwrap(),
        ] {
            assert_eq!(shape.semi_axes_mm(), Vector3::repeat(d / 2.0));
            assert_eq!(shape.equivalent_diameter_mm(), d);
            assert_eq!(shape.sieve_size_mm(), d);
            close(shape.mean_width_mm(), d, 1e-15);
            close(shape.volume_mm3(), PI / 6.0 * d * d * d, 1e-15);
            close(shape.sphericity(), 1.0, 1e-15);
        }
    }
}

#[test]
fn ellipsoids_have_the_size_they_are_made_for() {
    for shape in random_ellipsoids(1000) {
        let form = shape.form();
        let by_volume = Ellipsoid::with_equivalent_diameter(5.3, form).unwrap();
        close(by_volume.equivalent_diameter_mm(), 5.3, 1e-15);
        let by_sieve = Ellipsoid::with_sieve_size(5.3, form).unwrap();
        close(by_sieve.sieve_size_mm(), 5.3, 1e-15);
        for made in [by_volume, by_sieve] {
            close(made.elongation(), form.elongation, 1e-15);
            close(made.flatness(), form.flatness, 1e-15);
            let ratio = made.equivalent_diameter_mm() / made.sieve_size_mm();
            close(ratio.powi(3), form.volume_over_sieve_sphere(), 1e-14);
        }
        close(shape.length_over_thickness(), form.length_over_thickness(), 1e-14);
    }
    let bad = Form { elongation: 0.5, flatness: 1.1 };
    assert_eq!(Ellipsoid::with_sieve_size(5.0, bad), None);
    assert_eq!(Ellipsoid::with_equivalent_diameter(f64::NAN, Form::SPHERE), None);
    assert_eq!(Ellipsoid::new([1.0, 0.0, 2.0]), None);
}

#[test]
fn known_ratios_of_diameters() {
    for (axes, known) in [([1.5, 1.2, 1.0], 1.101), ([3.0, 1.0, 1.0], 1.442), ([2.0, 2.0, 1.0], 1.004)] {
        let ratio = Form::of_axes(axes).volume_over_sieve_sphere().cbrt();
        assert!((ratio - known).abs() < 5e-4, "{ratio} for {known}");
    }
}

#[test]
fn the_support_function_is_that_of_the_matrix_and_bounds_the_surface() {
    let mut rng = stream(12, Stream::Sampling);
    let mut number = || 2.0 * uniform(&mut rng) - 1.0;
    for shape in random_ellipsoids(100) {
        let orientation =
            UnitQuaternion::new_normalize(Quaternion::new(number(), number(), number(), number()));
        let pose = Pose { center_mm: Vector3::new(1.0, 2.0, 3.0), orientation };
        let n = Vector3::new(number(), number(), number()).normalize();
        let support = shape.support_mm(&pose, &n);
        let matrix = shape.matrix_mm2(&pose);
        close(support, n.dot(&(matrix * n)).sqrt(), 1e-13);
        // The point of the surface that reaches farthest along n lies on the ellipsoid.
        let point = matrix * n / support;
        close(point.dot(&(matrix.try_inverse().unwrap() * point)), 1.0, 1e-9);
        close(point.dot(&n), support, 1e-13);
    }
}

#[test]
fn zingg_classes_are_divided_at_two_thirds() {
    let class = |axes| Ellipsoid::new(axes).unwrap().zingg();
    assert_eq!(class([1.0, 0.9, 0.8]), Zingg::Equant);
    assert_eq!(class([1.0, 0.9, 0.4]), Zingg::Disc);
    assert_eq!(class([1.0, 0.5, 0.45]), Zingg::Rod);
    assert_eq!(class([1.0, 0.5, 0.2]), Zingg::Blade);
}

/// Half of the smallest square opening that holds the shadow along `(sin t cos p, sin t sin p, cos t)`: at the turn
/// where both widths are equal.
fn half_opening(shape: &Ellipsoid, [t, p]: [f64; 2]) -> f64 {
    let (along_t, along_p) =
        (Vector3::new(t.cos() * p.cos(), t.cos() * p.sin(), -t.sin()), Vector3::new(-p.sin(), p.cos(), 0.0));
    let half_width =
        |turn: f64| shape.semi_axes_mm().component_mul(&(along_t * turn.cos() + along_p * turn.sin())).norm();
    let (mut low, mut high) = (0.0, PI / 2.0);
    let excess = |turn: f64| half_width(turn) - half_width(turn + PI / 2.0);
    let sign = excess(low).signum();
    for _ in 0..40 {
        let middle = f64::midpoint(low, high);
        if excess(middle) * sign > 0.0 { low = middle } else { high = middle }
    }
    half_width(low).max(half_width(low + PI / 2.0))
}

/// The least value near `start`, by a search with shrinking steps.
fn minimum(f: &dyn Fn([f64; 2]) -> f64, start: [f64; 2]) -> f64 {
    let (mut at, mut best, mut step) = (start, f(start), 0.3);
    while step > 1e-5 {
        let around = [
            [1.0, 0.0],
            [-1.0, 0.0],
            [0.0, 1.0],
            [0.0, -1.0],
            [0.7, 0.7],
            [-0.7, 0.7],
            [0.7, -0.7],
            [-0.7, -0.7],
        ];
        let next = around.map(|[x, y]| [at[0] + step * x, at[1] + step * y]);
        let better =
            next.into_iter().map(|p| (f(p), p)).min_by(|p, q| p.0.total_cmp(&q.0)).filter(|(v, _)| *v < best);
        match better {
            Some((value, point)) => (best, at) = (value, point),
            None => step /= 2.0,
        }
    }
    best
}

#[test]
fn the_sieve_size_is_the_least_square_opening_over_all_rotations() {
    for shape in random_ellipsoids(300) {
        let starts = [[0.5, 0.4], [1.2, 2.0], [2.0, 1.0], [1.5, 3.0]];
        let least = starts
            .map(|start| minimum(&|at| half_opening(&shape, at), start))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        close(2.0 * least, shape.sieve_size_mm(), 1e-6);
    }
}

#[test]
fn roundness_is_that_of_the_circles_at_the_ends_of_the_long_axis() {
    let [a, b, c] = [3.0, 2.0, 1.0];
    let shape = Ellipsoid::new([a, b, c]).unwrap();
    // The sphere that touches at the end of the long axis with the smaller radius of curvature there lies inside.
    let radius = c * c / a;
    assert!((shape.roundness() - radius / c).abs() < 1e-15);
    let is_inside = |radius: f64| {
        (0..=10_000).all(|i| {
            let t = PI * f64::from(i) / 10_000.0;
            let (x, z) = (a - radius + radius * t.cos(), radius * t.sin());
            (x / a).powi(2) + (z / c).powi(2) <= 1.0 + 1e-12
        })
    };
    assert!(is_inside(radius) && !is_inside(1.01 * radius));
    assert_eq!(Ellipsoid::sphere(2.0).unwrap().roundness(), 1.0);
}
