//! How long edges may be: in proportion to the gap that the mesh between two surfaces has to fill.
//!
//! A tetrahedron in a gap of width g with edges h on both its sides is as flat as g is small against h,
//! whatever mesher places it. So edges follow the gap, down to a floor. It knows shapes and gaps; it must
//! never know triangles.

use super::surface::{distance2, dot};

/// Edges in multiples of the gap they face. Measured: `docs/meshes.md`.
pub(super) const EDGE_PER_GAP: f64 = 3.0;

/// Something that a surface faces.
#[derive(Clone, Copy, Debug)]
pub(super) enum Other {
    /// A grain.
    Sphere {
        /// Its centre.
        center: [f64; 3],
        /// Its radius.
        radius: f64,
    },
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

impl Other {
    pub(super) fn gap_mm(&self, p: [f64; 3]) -> f64 {
        match *self {
            Self::Sphere { center, radius } => distance2(p, center).sqrt() - radius,
            Self::Plane(axis, at) => (p[axis] - at).abs(),
            Self::Lateral { axis, radius } => radius - (p[0] - axis[0]).hypot(p[1] - axis[1]),
        }
    }
}

/// Something that a surface faces, and the point of the surface that is nearest to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// What it is.
    pub(super) other: Other,
    /// The point nearest to it.
    pub(super) at: [f64; 3],
    /// No edge has to be shorter than that because of it.
    pub(super) floor_mm: f64,
}

impl Facing {
    /// The longest that an edge may be of a triangle.
    pub(super) fn length_mm(&self, centroid: [f64; 3], longest_mm: f64) -> f64 {
        // The narrowest that a triangle faces is at its point nearest to `at`, which the circle about its
        // centroid reaches.
        let reach = longest_mm * CIRCUMRADIUS;
        let toward: [f64; 3] = std::array::from_fn(|a| self.at[a] - centroid[a]);
        let share = (reach / dot(toward, toward).sqrt()).min(1.0);
        let nearest = std::array::from_fn(|a| centroid[a] + share * toward[a]);
        (EDGE_PER_GAP * self.other.gap_mm(nearest)).max(self.floor_mm)
    }
}

/// Distance of the corners of an equilateral triangle from its centroid, in edges.
pub(super) const CIRCUMRADIUS: f64 = 0.577;
