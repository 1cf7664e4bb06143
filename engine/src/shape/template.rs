//! The convex polyhedron.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::Vector3;

use super::Pose;

/// Largest distance of a vertex above the plane of a face, relative to the size of the polyhedron: what rounding leaves
/// of a face with more than three vertices.
const FLATNESS: f64 = 1.0e-9;

/// A convex polyhedron by its vertices and faces, with a radius by which it is rounded: the body is the set of all
/// points within that radius of the polyhedron. Grains refer to it as a template with a scale in mm.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexPolyhedron {
    vertices: Vec<Vector3<f64>>,
    faces: Vec<Vec<u32>>,
    rounding: f64,
}

/// A template with its scale: the shape of one grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaledPolyhedron<'a> {
    /// The polyhedron, in units of the scale.
    pub template: &'a ConvexPolyhedron,
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

impl ConvexPolyhedron {
    /// A polyhedron by vertices, faces whose vertices are counter-clockwise seen from outside, and a radius of
    /// rounding, all in units of the scale.
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
        let polyhedron = Self { vertices, faces, rounding };
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

    /// Vertices in units of the scale.
    #[must_use]
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Faces by their vertices, counter-clockwise seen from outside.
    #[must_use]
    pub fn faces(&self) -> &[Vec<u32>] {
        &self.faces
    }

    /// Radius of rounding in units of the scale.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        self.rounding
    }

    /// Edges, each once, from the vertex of lower index.
    pub fn edges(&self) -> impl Iterator<Item = [u32; 2]> {
        self.faces.iter().flat_map(|corners| edges_of(corners)).filter(|[from, to]| from < to)
    }

    /// Radius of the sphere around the origin that holds the body, in units of the scale.
    #[must_use]
    pub fn outer_radius(&self) -> f64 {
        self.vertices.iter().map(Vector3::norm).fold(0.0, f64::max) + self.rounding
    }

    /// Radius of the largest sphere around the origin within the body, in units of the scale; negative where the origin
    /// lies outside.
    #[must_use]
    pub fn inner_radius(&self) -> f64 {
        let heights = (0..self.faces.len()).map(|face| self.plane(face).1);
        heights.fold(f64::INFINITY, f64::min) + self.rounding
    }

    /// Volume in cubes of the scale, by Steiner's formula `V + S rho + M rho² + 4/3 pi rho³` with the surface `S` and
    /// `M = 1/2 sum over the edges of length times (pi - dihedral angle)`.
    #[must_use]
    pub fn volume(&self) -> f64 {
        let rho = self.rounding;
        if rho == 0.0 {
            return self.core_volume();
        }
        let areas = (0..self.faces.len()).map(|face| 0.5 * self.area_vector(face).norm());
        let surface: f64 = areas.sum();
        let mut normals = BTreeMap::new();
        for (face, corners) in self.faces.iter().enumerate() {
            for edge in edges_of(corners) {
                normals.insert(edge, self.plane(face).0);
            }
        }
        let turning = |[from, to]: [u32; 2]| {
            let (m, n) = (normals[&[from, to]], normals[&[to, from]]);
            let angle = m.cross(&n).norm().atan2(m.dot(&n));
            0.5 * (self.vertices[from as usize] - self.vertices[to as usize]).norm() * angle
        };
        let curvature: f64 = self.edges().map(turning).sum();
        self.core_volume() + rho * (surface + rho * (curvature + rho * 4.0 / 3.0 * PI))
    }

    /// Diameter of the sphere of equal volume, in units of the scale.
    #[must_use]
    pub fn equivalent_diameter(&self) -> f64 {
        (self.volume() * 6.0 / PI).cbrt()
    }

    /// The vertices of a grain in mm, in the one order of operations that everything which reads a packing follows.
    ///
    /// With the scale `s`, the rotation `R` of [`Pose::rotation`] and the centre `x`, a vertex `v` lies at `x + w`,
    /// where `w_k = (R_k0 u_0 + R_k1 u_1) + R_k2 u_2` and `u = s v`, each operation rounded once. The grain *is* the
    /// hull of these points, rounded by the radius `s rho`.
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

    fn core_volume(&self) -> f64 {
        let cone =
            |face: usize| self.area_vector(face).dot(&self.vertices[self.faces[face][0] as usize]) / 6.0;
        (0..self.faces.len()).map(cone).sum()
    }

    /// Normal of a face, of twice its area.
    fn area_vector(&self, face: usize) -> Vector3<f64> {
        let corners = &self.faces[face];
        let at = |v: u32| self.vertices[v as usize] - self.vertices[corners[0] as usize];
        corners[1..].windows(2).map(|pair| at(pair[0]).cross(&at(pair[1]))).sum()
    }

    /// Outward unit normal of a face, and its height above the origin.
    fn plane(&self, face: usize) -> (Vector3<f64>, f64) {
        let normal = self.area_vector(face).try_normalize(0.0).unwrap_or_default();
        let corners = self.faces[face].iter().map(|&v| normal.dot(&self.vertices[v as usize]));
        (normal, corners.fold(f64::NEG_INFINITY, f64::max))
    }
}

/// The directed edges of a face.
fn edges_of(corners: &[u32]) -> impl Iterator<Item = [u32; 2]> {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(&from, &to)| [from, to])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::{Quaternion, UnitQuaternion};

    use super::super::polyhedron_samples::cuboid;
    use super::*;

    #[test]
    fn a_rounded_cuboid_has_the_volume_of_its_parts() {
        let (a, b, c, rho) = (2.0, 3.0, 4.0, 0.25);
        let parts = a * b * c
            + 2.0 * rho * (a * b + b * c + c * a)
            + PI * rho * rho * (a + b + c)
            + 4.0 / 3.0 * PI * rho.powi(3);
        let rounded = cuboid([0.5 * a, 0.5 * b, 0.5 * c], rho);
        assert!((rounded.volume() / parts - 1.0).abs() < 1e-14, "{} {parts}", rounded.volume());
        assert!((rounded.equivalent_diameter().powi(3) * PI / 6.0 - parts).abs() < 1e-12);
        assert_eq!(rounded.edges().count(), 12);
        assert!((cuboid([1.0; 3], 0.0).volume() - 8.0).abs() < 1e-14);
    }

    #[test]
    fn open_inverted_and_dented_surfaces_are_refused() {
        let cube = cuboid([1.0; 3], 0.0);
        let (vertices, faces) = (cube.vertices().to_vec(), cube.faces().to_vec());
        let new = |v: &[Vector3<f64>], f: &[Vec<u32>]| ConvexPolyhedron::new(v.to_vec(), f.to_vec(), 0.0);
        assert!(matches!(new(&vertices, &faces[1..]), Err(PolyhedronFault::Edge { .. })));
        let inverted: Vec<Vec<u32>> = faces.iter().map(|f| f.iter().rev().copied().collect()).collect();
        assert!(matches!(new(&vertices, &inverted), Err(PolyhedronFault::NotConvex { .. })));
        let mut dented = vertices.clone();
        dented[7] = Vector3::new(0.5, 0.5, 0.5);
        assert!(matches!(new(&dented, &faces), Err(PolyhedronFault::NotConvex { .. })));
        dented[7].x = f64::NAN;
        assert_eq!(new(&dented, &faces), Err(PolyhedronFault::NotANumber));
        let mut wrong = faces.clone();
        wrong[2][1] = 8;
        assert_eq!(new(&vertices, &wrong), Err(PolyhedronFault::Face { face: 2 }));
    }

    #[test]
    fn world_vertices_are_turned_scaled_and_moved() {
        let q = UnitQuaternion::new_unchecked(Quaternion::new(0.3, 0.1, -0.7, 0.2));
        let pose = Pose { center_mm: Vector3::new(5.0, 6.0, 7.0), orientation: q };
        let cube = cuboid([1.0, 2.0, 3.0], 0.0);
        let turned = UnitQuaternion::new_normalize(*q.quaternion());
        for (w, v) in cube.world_vertices_mm(2.5, &pose).zip(cube.vertices()) {
            assert!((w - (pose.center_mm + turned * (v * 2.5))).norm() < 1e-14);
        }
    }
}
