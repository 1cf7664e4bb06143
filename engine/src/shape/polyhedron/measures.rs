//! Volume, surface, widths and inertia of polyhedra.
//!
//! A core of volume `V` and surface `S` that is rounded by the radius `r` has the volume `V + S r + M r² + 4/3 pi r³`
//! and the surface `S + 2 M r + 4 pi r²` (Steiner), where `M = 1/2 sum over the edges of length times exterior angle`.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::minimax::{Plane, least_maximum};
use super::{Polyhedron, ScaledPolyhedron, edges_of};
use crate::elementary::{atan2, cbrt};

/// An edge between two faces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Its ends, as indices of vertices.
    pub ends: [u32; 2],
    /// Angle between the outward normals of its faces: pi less the dihedral angle.
    pub exterior_angle: f64,
}

/// The cosine between the normals of opposite faces that are parallel is -1 but for this.
const PARALLEL: f64 = 1e-9;

impl Polyhedron {
    fn at(&self, vertex: u32) -> Vector3<f64> {
        self.vertices[vertex as usize]
    }

    /// The faces of the core as fans of triangles.
    pub fn triangles(&self) -> impl Iterator<Item = [Vector3<f64>; 3]> + '_ {
        self.faces.iter().flat_map(|face| {
            face.windows(2).skip(1).map(|pair| [self.at(face[0]), self.at(pair[0]), self.at(pair[1])])
        })
    }

    /// Twice the area of a face along its outward normal.
    pub(super) fn double_area(&self, face: usize) -> Vector3<f64> {
        let corners = &self.faces[face];
        let first = self.at(corners[0]);
        let pairs = corners[1..].windows(2);
        pairs.map(|pair| (self.at(pair[0]) - first).cross(&(self.at(pair[1]) - first))).sum()
    }

    /// Outward unit normal of a face of the core, and its height above the origin.
    #[must_use]
    pub fn plane(&self, face: usize) -> (Vector3<f64>, f64) {
        let normal = self.double_area(face).try_normalize(0.0).unwrap_or_default();
        let heights = self.faces[face].iter().map(|&vertex| normal.dot(&self.at(vertex)));
        (normal, heights.fold(f64::NEG_INFINITY, f64::max))
    }

    /// Volume without rounding.
    pub(super) fn core_volume(&self) -> f64 {
        self.triangles().map(|[p, q, r]| p.dot(&q.cross(&r)) / 6.0).sum()
    }

    /// Centroid of the core; `None` where its volume is not positive.
    pub(super) fn centroid(&self) -> Option<Vector3<f64>> {
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for [p, q, r] in self.triangles() {
            let part = p.dot(&q.cross(&r)) / 6.0;
            volume += part;
            moment += part * (p + q + r) / 4.0;
        }
        (volume.is_finite() && volume > 0.0).then(|| moment / volume)
    }

    fn core_surface(&self) -> f64 {
        (0..self.faces.len()).map(|face| self.double_area(face).norm() / 2.0).sum()
    }

    /// The edges of the core, each once, from the vertex of lower index.
    #[must_use]
    pub fn edges(&self) -> Vec<Edge> {
        let mut face_of = BTreeMap::new();
        for (face, corners) in self.faces.iter().enumerate() {
            face_of.extend(edges_of(corners).map(|edge| (edge, face)));
        }
        let normals: Vec<Vector3<f64>> = (0..self.faces.len()).map(|face| self.plane(face).0).collect();
        let both_sides = face_of.iter().filter(|([from, to], _)| from < to).filter_map(|(&ends, &face)| {
            let other = *face_of.get(&[ends[1], ends[0]])?;
            let (m, n) = (normals[face], normals[other]);
            Some(Edge { ends, exterior_angle: atan2(m.cross(&n).norm(), m.dot(&n)) })
        });
        both_sides.collect()
    }

    /// `M = 1/2 sum over the edges of length times exterior angle`, of the core.
    #[must_use]
    pub fn mean_curvature(&self) -> f64 {
        let of_edge = |edge: &Edge| {
            let [from, to] = edge.ends;
            (self.at(to) - self.at(from)).norm() * edge.exterior_angle / 2.0
        };
        self.edges().iter().map(of_edge).sum()
    }

    /// Volume of the rounded body.
    pub(super) fn steiner_volume(&self) -> f64 {
        let r = self.rounding;
        if r == 0.0 {
            return self.core_volume();
        }
        self.core_volume() + r * (self.core_surface() + r * (self.mean_curvature() + r * 4.0 / 3.0 * PI))
    }

    /// Volume of the core rounded by a radius, as a function of it.
    pub(super) fn core_parallel_volume(&self) -> impl Fn(f64) -> f64 + use<> {
        let (volume, surface, curvature) = (self.core_volume(), self.core_surface(), self.mean_curvature());
        move |r| volume + r * (surface + r * (curvature + r * 4.0 / 3.0 * PI))
    }

    /// Surface of the rounded body.
    #[must_use]
    pub fn surface(&self) -> f64 {
        let r = self.rounding;
        if r == 0.0 {
            return self.core_surface();
        }
        self.core_surface() + r * (2.0 * self.mean_curvature() + r * 4.0 * PI)
    }

    /// Radius of the largest sphere within the body, wherever its centre is.
    #[must_use]
    pub fn inscribed_radius(&self) -> f64 {
        let plane = |face: usize| {
            let (slope, height) = self.plane(face);
            Plane { value: -height, slope }
        };
        let planes: Vec<Plane> = (0..self.faces.len()).map(plane).collect();
        self.rounding - least_maximum(&planes, self.outer_radius).1
    }

    /// Roundness of Wadell: mean radius of the spheres that fit into corners and along edges, over that of the largest
    /// inscribed sphere (Zheng, He and Alimohammadi, Acta Geotechnica 16, 2021, DOI 10.1007/s11440-020-01004-9).
    ///
    /// All corners and edges have the radius of rounding. Sharp bodies have a roundness of 0.
    #[must_use]
    pub fn roundness(&self) -> f64 {
        self.rounding / self.inscribed_radius()
    }

    /// Whether the core is a parallelepiped, as a cube and what it is stretched to are.
    #[must_use]
    pub fn is_parallelepiped(&self) -> bool {
        let normal = |face: usize| self.plane(face).0;
        let has_opposite =
            |face: usize| (0..6).any(|other| normal(face).dot(&normal(other)) < -1.0 + PARALLEL);
        self.faces.len() == 6 && (0..6).all(has_opposite)
    }

    /// Diameter of the sphere of equal volume.
    #[must_use]
    pub fn equivalent_diameter(&self) -> f64 {
        cbrt(6.0 / PI * self.volume())
    }

    /// Inertia tensor of the core about the origin, with a density of 1.
    #[must_use]
    pub fn core_inertia(&self) -> Matrix3<f64> {
        let mut second = Matrix3::zeros();
        for [p, q, r] in self.triangles() {
            let sum = p + q + r;
            let squares = p * p.transpose() + q * q.transpose() + r * r.transpose();
            second += p.dot(&q.cross(&r)) / 120.0 * (sum * sum.transpose() + squares);
        }
        Matrix3::from_diagonal_element(second.trace()) - second
    }

    /// Support function: how far the body reaches from the origin along a unit vector, in its own axes.
    #[must_use]
    pub fn support(&self, direction: &Vector3<f64>) -> f64 {
        let heights = self.vertices.iter().map(|vertex| vertex.dot(direction));
        heights.fold(f64::NEG_INFINITY, f64::max) + self.rounding
    }

    /// Width along a unit vector.
    #[must_use]
    pub fn width(&self, direction: &Vector3<f64>) -> f64 {
        self.support(direction) + self.support(&-direction)
    }

    /// Largest caliper width: the largest distance of two points.
    #[must_use]
    pub fn length(&self) -> f64 {
        let pairs = self.vertices.iter().enumerate();
        let of_core = pairs
            .flat_map(|(i, p)| self.vertices[i + 1..].iter().map(move |q| (p - q).norm()))
            .fold(0.0, f64::max);
        of_core + 2.0 * self.rounding
    }

    /// Least caliper width. It is found along the normal of a face, or across two edges.
    #[must_use]
    pub fn thickness(&self) -> f64 {
        let along = |edge: &Edge| (self.at(edge.ends[1]) - self.at(edge.ends[0])).normalize();
        let directions: Vec<Vector3<f64>> = self.edges().iter().map(along).collect();
        let across = directions.iter().enumerate().flat_map(|(i, p)| {
            directions[i + 1..].iter().filter_map(move |q| p.cross(q).try_normalize(1e-9))
        });
        let normals = (0..self.faces.len()).map(|face| self.plane(face).0);
        normals.chain(across).map(|direction| self.width(&direction)).fold(f64::INFINITY, f64::min)
    }
}

impl ScaledPolyhedron<'_> {
    /// Volume in mm³.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        self.template.volume() * self.scale_mm.powi(3)
    }

    /// Diameter of the sphere of equal volume in mm.
    #[must_use]
    pub fn equivalent_diameter_mm(&self) -> f64 {
        self.template.equivalent_diameter() * self.scale_mm
    }
}
