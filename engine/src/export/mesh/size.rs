//! How long edges may be: in proportion to the gap that the mesh between two surfaces has to fill.
//!
//! A tetrahedron in a gap of width g with edges h on both its sides is as flat as g is small against h,
//! whatever mesher places it. So edges follow the gap, down to a floor. It knows shapes and gaps; it must
//! never know triangles.

use crate::arrays::{self, Each as _};
use crate::elementary::hypot;
use crate::gap::linear::{distance2, dot};
use crate::geometry::convex::{Convex, Place};

/// Most steps to the distance of an ellipsoid, which few of them find to rounding.
const MOST_STEPS: u32 = 30;

/// Edges in multiples of the gap they face. Measured: `docs/meshes.md`.
pub(super) const EDGE_PER_GAP: f64 = 3.0;

/// Something that a surface faces.
#[derive(Clone, Copy, Debug)]
pub(super) enum Other<'a> {
    /// A grain.
    Sphere {
        /// Its centre.
        center: [f64; 3],
        /// Its radius.
        radius: f64,
    },
    /// A grain that is an ellipsoid.
    Ellipsoid {
        /// Its centre.
        center: [f64; 3],
        /// Directions of its axes.
        axes: [[f64; 3]; 3],
        /// Its semi-axes in their order.
        semi_axes: [f64; 3],
    },
    /// A grain that is a polyhedron: its template, and its place.
    Polyhedron(&'a Convex, Place),
    /// A flat wall, by its axis and place.
    Plane(usize, f64),
    /// The lateral surface of a cylinder along z.
    Lateral {
        /// Where its axis stands.
        axis: [f64; 2],
        /// Its radius.
        radius: f64,
    },
}

impl Other<'_> {
    pub(super) fn gap_mm(&self, p: [f64; 3]) -> f64 {
        match *self {
            Self::Sphere { center, radius } => distance2(p, center).sqrt() - radius,
            Self::Ellipsoid { center, axes, semi_axes } => {
                let from_center = arrays::from_fn(|a| p[a] - center[a]);
                distance_of_ellipsoid(semi_axes, axes.each(|axis| dot(axis, from_center)))
            }
            Self::Polyhedron(template, place) => {
                place.scale * template.distance(&place.local(&p.into())).max(0.0)
            }
            Self::Plane(axis, at) => (p[axis] - at).abs(),
            Self::Lateral { axis, radius } => radius - hypot(p[0] - axis[0], p[1] - axis[1]),
        }
    }
}

/// Distance of a point from an ellipsoid about the origin with its axes along x, y and z; 0 inside.
///
/// The nearest point is `e_i v_i` with `v_i = e_i p_i / (t + e_i²)` and `|v| = 1`; `t` is found from below, as by Moré
/// and Sorensen (1983, DOI 10.1137/0904038).
fn distance_of_ellipsoid(semi_axes: [f64; 3], p: [f64; 3]) -> f64 {
    let mut t = 0.0;
    for _ in 0..MOST_STEPS {
        let v: [f64; 3] = arrays::from_fn(|i| semi_axes[i] * p[i] / (t + semi_axes[i] * semi_axes[i]));
        let norm2 = dot(v, v);
        if norm2 <= 1.0 + 1e-12 {
            break;
        }
        let slope: f64 = (0..3).map(|i| v[i] * v[i] / (t + semi_axes[i] * semi_axes[i])).sum();
        t += norm2 * (norm2.sqrt() - 1.0) / slope;
    }
    let apart: [f64; 3] = arrays::from_fn(|i| t * p[i] / (t + semi_axes[i] * semi_axes[i]));
    dot(apart, apart).sqrt()
}

/// Something that a surface faces, and the point of the surface that is nearest to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing<'a> {
    /// What it is.
    pub(super) other: Other<'a>,
    /// The point nearest to it.
    pub(super) at: [f64; 3],
    /// No edge has to be shorter than that because of it.
    pub(super) floor_mm: f64,
}

impl Facing<'_> {
    /// Whether a triangle with this centroid and longest edge is too large for the gap that it faces there. Edges may
    /// be longer by a factor of `coarse`, 1 or more.
    pub(super) fn wants_shorter(&self, centroid: [f64; 3], longest_mm: f64, coarse: f64) -> bool {
        if longest_mm <= coarse * self.floor_mm {
            return false;
        }
        // The narrowest that a triangle faces is at its point nearest to `at`, which the circle about its
        // centroid reaches.
        let reach = longest_mm * CIRCUMRADIUS;
        let toward: [f64; 3] = arrays::from_fn(|a| self.at[a] - centroid[a]);
        let share = (reach / dot(toward, toward).sqrt()).min(1.0);
        let nearest: [f64; 3] = arrays::from_fn(|a| centroid[a] + share * toward[a]);
        // Lower bounds, which take less time than the distance.
        let is_far = |least_mm: f64| EDGE_PER_GAP * least_mm > LONGER * longest_mm;
        match self.other {
            Other::Ellipsoid { center, semi_axes, .. } => {
                let outer = semi_axes.into_iter().fold(0.0, f64::max);
                if is_far(distance2(nearest, center).sqrt() - outer) {
                    return false;
                }
            }
            Other::Polyhedron(template, place) => {
                let local = place.local(&nearest.into());
                if is_far(place.scale * (local.norm() - template.outer))
                    || is_far(place.scale * (template.height(&local) - template.rounding))
                {
                    return false;
                }
            }
            Other::Sphere { .. } | Other::Plane(..) | Other::Lateral { .. } => {}
        }
        longest_mm > coarse * (EDGE_PER_GAP * self.other.gap_mm(nearest)).max(self.floor_mm)
    }
}

/// What a lower bound has to be longer by than what it is held against, for rounding.
const LONGER: f64 = 1.0 + 1e-9;
/// Distance of the corners of an equilateral triangle from its centroid, in edges.
pub(super) const CIRCUMRADIUS: f64 = 0.577;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::properties::properties;
    use proptest::prelude::*;

    properties! {
        /// A point at a distance along the normal of a point of the surface.
        #[test]
        fn distances_of_ellipsoids_are_those_along_normals(
            semi_axes in prop::array::uniform3(0.3..3.0_f64), n in prop::array::uniform3(-1.0..1.0_f64),
            distance in 0.0..3.0_f64,
        ) {
            let length = dot(n, n).sqrt();
            prop_assume!(length > 0.1);
            let n = n.map(|x| x / length);
            let scaled: [f64; 3] = std::array::from_fn(|i| semi_axes[i] * n[i]);
            let support = dot(scaled, scaled).sqrt();
            let p = std::array::from_fn(|i| semi_axes[i] * scaled[i] / support + distance * n[i]);
            let found = distance_of_ellipsoid(semi_axes, p);
            prop_assert!((found - distance).abs() < 1e-9, "{found} {distance}");
            prop_assert_eq!(distance_of_ellipsoid(semi_axes, p.map(|x| x * 1e-3)), 0.0);
        }
    }
}
