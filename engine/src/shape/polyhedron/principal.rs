//! A polyhedron in its principal axes: what methods and pair tests read of a template.
//!
//! The axes are those of the second moments of the core, the longest first. Along them lie two ellipsoids about the
//! origin, the largest in the body and the smallest around it (each of those with these axes). Both are the solution
//! `q` of one problem, to maximize `q_x q_y q_z` under `sum over k of q_k p_k² <= 1` for all points `p`: of the
//! vertices it gives `1 / e_k²` of the ellipsoid around them, of `n / h` of all planes `n · x = h` it gives `e_k²` of
//! the ellipsoid inside. It is solved by the multiplicative algorithm of Titterington 1976 (DOI 10.2307/2347230) for
//! the weights of the points.

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::Polyhedron;
use crate::arrays::Each as _;

/// Steps for the weights; whatever they are, the result holds.
const STEPS: usize = 40;
/// Share by which ellipsoids stay clear of rounding errors.
const MARGIN: f64 = 1e-12;

/// A polyhedron in its principal axes, in units of its scale.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Principal {
    /// Rotation from the principal axes to those of the body.
    pub(crate) axes: UnitQuaternion<f64>,
    /// Vertices of the core in groups of four: x, y, z. The first vertex fills the last group.
    pub(crate) groups: Vec<[[f64; 4]; 3]>,
    /// Semi-axes of an ellipsoid that the body holds, from the longest down; 0 where the origin is not inside.
    pub(crate) inside: [f64; 3],
    /// Semi-axes of an ellipsoid that holds the body.
    pub(crate) around: [f64; 3],
    /// One over the moments of inertia about the axes, of the core with a mass of 1.
    pub(crate) per_inertia: [f64; 3],
    /// Longest distance of a vertex from the foot of the origin on a face of it: under a rotation by an angle, no
    /// value of the support function changes by more than that times the angle.
    pub(crate) turn_radius: f64,
}

impl Principal {
    /// Zero moments.
    pub(super) fn none() -> Self {
        Self {
            axes: UnitQuaternion::identity(),
            groups: Vec::new(),
            inside: [0.0; 3],
            around: [0.0; 3],
            per_inertia: [0.0; 3],
            turn_radius: 0.0,
        }
    }

    /// Of a polyhedron whose inner radius, rounding left out, is known.
    pub(super) fn new(of: &Polyhedron, core_inner: f64) -> Self {
        let inertia = of.core_inertia();
        let volume = of.core_volume();
        let size2 = of.vertices.iter().map(Vector3::norm_squared).fold(0.0, f64::max);
        if !(volume > 0.0 && inertia.iter().all(|x| x.is_finite()) && size2.is_finite()) {
            return Self::none();
        }
        let axes = Rotation3::from_matrix_unchecked(of.principal_axes());
        let axes = UnitQuaternion::from_rotation_matrix(&axes);
        let local: Vec<Vector3<f64>> = of.vertices.iter().map(|v| axes.inverse_transform_vector(v)).collect();
        let groups = (0..local.len().div_ceil(4)).map(|g| {
            let at = |lane: usize| local.get(4 * g + lane).unwrap_or(&local[0]);
            [0, 1, 2].each(|k| [0, 1, 2, 3].each(|lane| at(lane)[k]))
        });
        let turned = axes.to_rotation_matrix();
        let moments = (turned.matrix().transpose() * inertia * turned.matrix()).diagonal();
        let planes: Vec<_> = (0..of.faces.len()).map(|face| of.plane(face)).collect();
        let mut turn_radius = 0.0_f64;
        for (face, (normal, _)) in of.faces.iter().zip(&planes) {
            for &corner in face {
                let vertex = of.vertices[corner as usize];
                turn_radius = turn_radius.max((vertex - normal * normal.dot(&vertex)).norm());
            }
        }
        let rounding = of.rounding;
        let around = widest(&local).each(|q| 1.0 / q);
        // (h + r)² <= (1 + k) h² + (1 + 1 / k) r².
        let k = rounding / (around.iter().sum::<f64>() / 3.0).sqrt();
        let around = around.each(|e2| {
            let rounded =
                if rounding > 0.0 { (1.0 + k) * e2 + (1.0 + 1.0 / k) * rounding * rounding } else { e2 };
            rounded.sqrt() * (1.0 + MARGIN)
        });
        let inside = if core_inner > 0.0 {
            let duals: Vec<_> = planes.iter().map(|(n, h)| axes.inverse_transform_vector(n) / *h).collect();
            let inside = widest(&duals).each(|q| q.sqrt() * (1.0 - MARGIN) + rounding);
            // The longest axis of the body's moments need not be that of the ellipsoid.
            if inside.is_sorted_by(|p, q| p >= q) {
                inside
            } else {
                [inside.into_iter().fold(f64::INFINITY, f64::min); 3]
            }
        } else {
            [0.0; 3]
        };
        Self {
            axes,
            groups: groups.collect(),
            inside,
            around,
            per_inertia: (moments / volume).map(|moment| 1.0 / moment).into(),
            turn_radius,
        }
    }
}

/// Numbers `q` of largest product with `sum over k of q_k p_k² <= 1` for all points, nearly.
fn widest(points: &[Vector3<f64>]) -> [f64; 3] {
    let squares: Vec<Vector3<f64>> = points.iter().map(|p| p.component_mul(p)).collect();
    let mut weights = vec![1.0 / points.len() as f64; points.len()];
    let moments = |weights: &[f64]| squares.iter().zip(weights).map(|(s, w)| s * *w).sum::<Vector3<f64>>();
    for _ in 0..STEPS {
        let moments = moments(&weights);
        for (weight, s) in weights.iter_mut().zip(&squares) {
            *weight *= s.component_div(&moments).sum() / 3.0;
        }
    }
    let moments = moments(&weights);
    let most = squares.iter().map(|s| s.component_div(&moments).sum()).fold(0.0, f64::max);
    moments.map(|moment| 1.0 / (moment * most)).into()
}
