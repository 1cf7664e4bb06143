//! Convex polyhedra, sharp or rounded: templates of angular grains.
//!
//! A polyhedron has vertices and faces, the core, and a radius of rounding `r`: the body is the set of all points
//! within `r` of the core. Angular grains refer to a template, a polyhedron of any unit of length, by a scale in mm.
//!
//! `draw` makes random templates, `platonic` the Platonic solids, `hull` finds vertices and faces, `measures` has
//! volumes, widths and inertia, `principal` what packing reads, `axes` the form, `sieve` the sieve size.

mod axes;
mod draw;
mod hull;
mod measures;
mod minimax;
mod platonic;
mod principal;
#[cfg(test)]
pub(crate) mod samples;
mod sieve;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::Vector3;

use super::Pose;
use crate::elementary::cbrt;
pub use draw::{DrawnTemplates, TemplateKind, draw_template};
use hull::{hull, intersection};
pub use measures::Edge;
pub use platonic::PlatonicSolid;
pub(crate) use principal::Principal;
use sieve::Passage;
pub use sieve::SievePassage;

/// Largest distance of a vertex above the plane of a face, relative to the size of the polyhedron: what rounding of
/// numbers leaves of a face with more than three vertices.
const FLATNESS: f64 = 1.0e-9;
/// Most steps of the search for the radius of a rounding.
const MOST_STEPS: usize = 100;

/// A convex polyhedron by the vertices and faces of its core, with a radius by which it is rounded. All lengths are in
/// one unit, which the scale of a grain gives in mm.
///
/// # Examples
/// ```
/// use nalgebra::Vector3;
/// use packstone_engine::shape::Polyhedron;
///
/// let corners: Vec<_> =
///     (0..8).map(|i| Vector3::from_fn(|axis, _| f64::from(i >> axis & 1))).collect();
/// let cube = Polyhedron::hull_of(&corners).unwrap();
/// assert_eq!(cube.faces().len(), 6);
/// assert!((cube.volume() - 1.0).abs() < 1e-12);
/// let round = cube.with_relative_rounding(0.1).unwrap();
/// assert!((round.equivalent_diameter() - cube.equivalent_diameter()).abs() < 1e-12);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Polyhedron {
    vertices: Vec<Vector3<f64>>,
    /// Vertices of each face, counter-clockwise as seen from outside.
    faces: Vec<Vec<u32>>,
    rounding: f64,
    /// Volume of the rounded body.
    volume: f64,
    /// Radii of the spheres around the origin that hold the body, and that it holds.
    outer_radius: f64,
    inner_radius: f64,
    principal: Principal,
    passage: Passage,
}

/// A template with its scale: the shape of one grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaledPolyhedron<'a> {
    /// The polyhedron, in units of the scale.
    pub template: &'a Polyhedron,
    /// The scale in mm.
    pub scale_mm: f64,
}

/// Why vertices and faces are no convex polyhedron.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PolyhedronFault {
    /// A coordinate or the radius is no number, or the radius is negative.
    #[error("a coordinate or the radius is no number, or the radius is negative")]
    NotANumber,
    /// A face names a vertex that does not exist, or fewer than three.
    #[error("face {face} names fewer than three vertices, or one that does not exist")]
    Face {
        /// Index of the face.
        face: usize,
    },
    /// The faces are no closed surface: an edge has not one face on each side.
    #[error("the edge from vertex {from} to vertex {to} has not one face on each side")]
    Edge {
        /// Index of a vertex.
        from: u32,
        /// Index of the next vertex of a face.
        to: u32,
    },
    /// A vertex lies above the plane of a face or is a corner of it and lies below, or the volume is not positive: the
    /// faces are not plane, not counter-clockwise seen from outside, or the body is not convex.
    #[error("vertex {vertex} lies above face {face}, or the face is not plane")]
    NotConvex {
        /// Index of the face.
        face: usize,
        /// Index of the vertex.
        vertex: usize,
    },
}

impl Polyhedron {
    /// A polyhedron by vertices, faces whose vertices are counter-clockwise as seen from outside, and a radius of
    /// rounding. The vertices stay as they are, wherever the origin lies.
    ///
    /// # Errors
    /// See [`PolyhedronFault`].
    pub fn new(
        vertices: Vec<Vector3<f64>>,
        faces: Vec<Vec<u32>>,
        rounding: f64,
    ) -> Result<Self, PolyhedronFault> {
        let is_number = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        if !(vertices.iter().all(is_number) && rounding.is_finite() && rounding >= 0.0) {
            return Err(PolyhedronFault::NotANumber);
        }
        let mut edges = BTreeMap::new();
        for (face, corners) in faces.iter().enumerate() {
            if corners.len() < 3 || corners.iter().any(|&v| v as usize >= vertices.len()) {
                return Err(PolyhedronFault::Face { face });
            }
            for [from, to] in edges_of(corners) {
                *edges.entry([from, to]).or_insert(0) += 1;
            }
        }
        for (&[from, to], &faces) in &edges {
            if faces != 1 || from == to || !edges.contains_key(&[to, from]) {
                return Err(PolyhedronFault::Edge { from, to });
            }
        }
        let polyhedron = Self::of_parts(vertices, faces, rounding);
        let size = polyhedron.outer_radius();
        for face in 0..polyhedron.faces.len() {
            let (normal, height) = polyhedron.plane(face);
            let above = |v: &Vector3<f64>| normal.dot(v) - height;
            let outside = polyhedron.vertices.iter().position(|v| above(v) > FLATNESS * size);
            let corners = polyhedron.faces[face].iter().map(|&v| v as usize);
            let below = || corners.clone().find(|&v| above(&polyhedron.vertices[v]) < -FLATNESS * size);
            if let Some(vertex) = outside.or_else(below) {
                return Err(PolyhedronFault::NotConvex { face, vertex });
            }
        }
        if polyhedron.core_volume() > 0.0 {
            Ok(polyhedron)
        } else {
            Err(PolyhedronFault::NotConvex { face: 0, vertex: 0 })
        }
    }

    /// The convex hull of up to some hundred points, with its centroid at the origin; `None` where the points lie in a
    /// plane or are not finite.
    #[must_use]
    pub fn hull_of(points: &[Vector3<f64>]) -> Option<Self> {
        if !points.iter().all(|point| point.iter().all(|x| x.is_finite())) {
            return None;
        }
        // The tolerances of the hull are relative to the distance from the origin.
        let center = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let points: Vec<Vector3<f64>> = points.iter().map(|point| point - center).collect();
        let faces = hull(&points).into_iter().map(|facet| facet.points).collect();
        Self::centered(&points, faces)
    }

    /// The body in which `normal . x <= offset` for all planes of unit normals and offsets above 0, moved to its
    /// centroid; `None` where it is not bounded.
    #[must_use]
    pub fn of_half_spaces(planes: &[(Vector3<f64>, f64)]) -> Option<Self> {
        if !planes.iter().all(|(normal, offset)| normal.norm().is_finite() && *offset > 0.0) {
            return None;
        }
        let (vertices, faces) = intersection(planes);
        Self::centered(&vertices, faces)
    }

    /// A sharp body of vertices and faces, moved to its centroid, without the vertices that no face has.
    fn centered(vertices: &[Vector3<f64>], mut faces: Vec<Vec<u32>>) -> Option<Self> {
        let mut used = vec![None; vertices.len()];
        let mut kept = Vec::new();
        for vertex in faces.iter_mut().flatten() {
            let at = *vertex as usize;
            *vertex = *used[at].get_or_insert_with(|| {
                kept.push(vertices[at]);
                kept.len() as u32 - 1
            });
        }
        let body = Self::of_parts(kept, faces, 0.0);
        let centroid = body.centroid()?;
        let vertices = body.vertices.iter().map(|vertex| vertex - centroid).collect();
        Some(Self::of_parts(vertices, body.faces, 0.0))
    }

    /// Measures a body.
    fn of_parts(vertices: Vec<Vector3<f64>>, faces: Vec<Vec<u32>>, rounding: f64) -> Self {
        let (principal, passage) = (Principal::none(), Passage::default());
        let body = Self {
            vertices,
            faces,
            rounding,
            volume: 0.0,
            outer_radius: 0.0,
            inner_radius: 0.0,
            principal,
            passage,
        };
        let volume = body.steiner_volume();
        let outer_radius = body.vertices.iter().map(Vector3::norm).fold(0.0, f64::max) + rounding;
        let heights = (0..body.faces.len()).map(|face| body.plane(face).1);
        let core_inner = heights.fold(f64::INFINITY, f64::min);
        let principal = Principal::new(&body, core_inner);
        Self { volume, outer_radius, inner_radius: core_inner + rounding, principal, ..body }
    }

    /// The core stretched along x, y and z, sharp and moved to its centroid; `None` unless the factors are finite and
    /// positive.
    #[must_use]
    pub fn stretched(&self, factors: Vector3<f64>) -> Option<Self> {
        if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
            return None;
        }
        let vertices: Vec<Vector3<f64>> =
            self.vertices.iter().map(|vertex| vertex.component_mul(&factors)).collect();
        Self::centered(&vertices, self.faces.clone())
    }

    /// The same body in other units: all lengths times a factor, which must be finite and positive.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let vertices = self.vertices.iter().map(|vertex| vertex * factor).collect();
        Self::of_parts(vertices, self.faces.clone(), self.rounding * factor)
    }

    /// The body with an equivalent diameter of 1.
    #[must_use]
    pub fn normalized(&self) -> Self {
        self.scaled(1.0 / self.equivalent_diameter())
    }

    /// A smaller core with a radius of rounding that is a share of the equivalent diameter, which stays what it is;
    /// `None` unless the share lies in 0..0.5, where 0.5 would be a sphere.
    #[must_use]
    pub fn with_relative_rounding(&self, share: f64) -> Option<Self> {
        if !(0.0..0.5).contains(&share) {
            return None;
        }
        let size = self.equivalent_diameter();
        let rounded = |radius| Self::of_parts(self.vertices.clone(), self.faces.clone(), radius);
        // The ratio of the radius to the equivalent diameter of the rounded body grows with the radius.
        let (mut low, mut high) = (0.0, share * size);
        let volume = self.core_parallel_volume();
        let ratio = |radius: f64| radius / cbrt(6.0 / PI * volume(radius));
        while ratio(high) < share {
            high *= 2.0;
        }
        for _ in 0..MOST_STEPS {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if ratio(middle) < share { low = middle } else { high = middle }
        }
        let rounded = rounded(high);
        let factor = size / rounded.equivalent_diameter();
        Some(rounded.scaled(factor))
    }

    /// Vertices of the core.
    #[must_use]
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Faces of the core by their vertices, counter-clockwise as seen from outside.
    #[must_use]
    pub fn faces(&self) -> &[Vec<u32>] {
        &self.faces
    }

    /// Volume of the rounded body.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// Radius of the sphere around the origin that holds the body.
    #[must_use]
    pub fn outer_radius(&self) -> f64 {
        self.outer_radius
    }

    /// Radius of the largest sphere around the origin within the body; negative where the origin lies outside.
    #[must_use]
    pub fn inner_radius(&self) -> f64 {
        self.inner_radius
    }

    /// The body in its principal axes.
    pub(crate) fn principal(&self) -> &Principal {
        &self.principal
    }

    /// Radius of rounding.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        self.rounding
    }

    /// The vertices of a grain in mm, in the one order of operations that everything which reads a packing follows.
    ///
    /// With the scale `s`, the rotation `R` of [`Pose::rotation`] and the centre `x`, a vertex `v` lies at `x + w`,
    /// where `w_k = (R_k0 u_0 + R_k1 u_1) + R_k2 u_2` and `u = s v`, each operation rounded once. The grain *is* the
    /// hull of these points, rounded by the radius `s r`.
    pub fn world_vertices_mm(&self, scale_mm: f64, pose: &Pose) -> impl Iterator<Item = Vector3<f64>> {
        let (rotation, center) = (pose.rotation(), pose.center_mm);
        self.vertices.iter().map(move |v| {
            let u = v * scale_mm;
            Vector3::from_fn(|k, _| {
                let turned = (rotation[(k, 0)] * u[0] + rotation[(k, 1)] * u[1]) + rotation[(k, 2)] * u[2];
                center[k] + turned
            })
        })
    }
}

/// The directed edges of a face.
fn edges_of(corners: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&from, &to)| [from, to])
}
