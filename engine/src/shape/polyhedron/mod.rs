//! Convex polyhedra, sharp or rounded: templates of angular grains.
//!
//! A template is a set of vertices and faces with its centroid at the origin. Rounded by a radius `r` it is the set of
//! points within `r` of it, with the volume `V + S r + M r² + 4/3 pi r³` (Steiner), where `M = 1/2 sum over the edges
//! of length times exterior angle`.

mod hull;
mod sieve;
mod template;

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use hull::{hull, intersection};
pub use template::{TemplateKind, draw_template};

/// A convex polyhedron with its centroid at the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyhedron {
    vertices_mm: Vec<Vector3<f64>>,
    /// Vertices of each face, counter-clockwise as seen from outside.
    faces: Vec<Vec<u32>>,
    volume_mm3: f64,
}

/// An edge between two faces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Its ends, as indices of vertices.
    pub ends: [u32; 2],
    /// Angle between the outward normals of its faces: pi less the dihedral angle.
    pub exterior_angle: f64,
}

impl Polyhedron {
    /// The convex hull of up to some hundred points in mm; `None` where they lie in a plane or are not finite.
    #[must_use]
    pub fn hull_of(points_mm: &[Vector3<f64>]) -> Option<Self> {
        if !points_mm.iter().all(|point| point.iter().all(|x| x.is_finite())) {
            return None;
        }
        // The tolerances of the hull are relative to the distance from the origin.
        let center = points_mm.iter().sum::<Vector3<f64>>() / points_mm.len().max(1) as f64;
        let points: Vec<Vector3<f64>> = points_mm.iter().map(|point| point - center).collect();
        let faces = hull(&points).into_iter().map(|facet| facet.points).collect();
        Self::new(&points, faces)
    }

    /// The body in which `normal . x <= offset` for all planes of unit normals and offsets above 0; `None` where it is
    /// not bounded.
    #[must_use]
    pub fn of_half_spaces(planes: &[(Vector3<f64>, f64)]) -> Option<Self> {
        if !planes.iter().all(|(normal, offset)| normal.norm().is_finite() && *offset > 0.0) {
            return None;
        }
        let (vertices, faces) = intersection(planes);
        Self::new(&vertices, faces)
    }

    /// A body of vertices and faces, moved to its centroid, without the vertices that no face has.
    fn new(vertices: &[Vector3<f64>], mut faces: Vec<Vec<u32>>) -> Option<Self> {
        let mut used = vec![None; vertices.len()];
        let mut kept = Vec::new();
        for vertex in faces.iter_mut().flatten() {
            let at = *vertex as usize;
            *vertex = *used[at].get_or_insert_with(|| {
                kept.push(vertices[at]);
                kept.len() as u32 - 1
            });
        }
        let mut body = Self { vertices_mm: kept, faces, volume_mm3: 0.0 };
        body.center()?;
        Some(body)
    }

    /// Measures the volume and moves the centroid to the origin.
    fn center(&mut self) -> Option<()> {
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for [p, q, r] in self.triangles() {
            let part = p.dot(&q.cross(&r)) / 6.0;
            volume += part;
            moment += part * (p + q + r) / 4.0;
        }
        if !(volume.is_finite() && volume > 0.0) {
            return None;
        }
        let centroid = moment / volume;
        for vertex in &mut self.vertices_mm {
            *vertex -= centroid;
        }
        self.volume_mm3 = volume;
        Some(())
    }

    /// The same body stretched along x, y and z; `None` unless the factors are finite and positive.
    #[must_use]
    pub fn stretched(&self, factors: Vector3<f64>) -> Option<Self> {
        if !factors.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
            return None;
        }
        let vertices: Vec<Vector3<f64>> =
            self.vertices_mm.iter().map(|vertex| vertex.component_mul(&factors)).collect();
        Self::new(&vertices, self.faces.clone())
    }

    /// Vertices in mm.
    #[must_use]
    pub fn vertices_mm(&self) -> &[Vector3<f64>] {
        &self.vertices_mm
    }

    /// Faces by their vertices, counter-clockwise as seen from outside.
    #[must_use]
    pub fn faces(&self) -> &[Vec<u32>] {
        &self.faces
    }

    fn at(&self, vertex: u32) -> Vector3<f64> {
        self.vertices_mm[vertex as usize]
    }

    /// The faces as fans of triangles.
    fn triangles(&self) -> impl Iterator<Item = [Vector3<f64>; 3]> + '_ {
        self.faces.iter().flat_map(|face| {
            face.windows(2).skip(1).map(|pair| [self.at(face[0]), self.at(pair[0]), self.at(pair[1])])
        })
    }

    /// Twice the area of a face along its outward normal.
    fn double_area(&self, face: &[u32]) -> Vector3<f64> {
        let first = self.at(face[0]);
        face.windows(2)
            .skip(1)
            .map(|pair| (self.at(pair[0]) - first).cross(&(self.at(pair[1]) - first)))
            .sum()
    }

    /// Volume in mm³, without rounding.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        self.volume_mm3
    }

    /// Surface in mm², without rounding.
    #[must_use]
    pub fn surface_mm2(&self) -> f64 {
        self.faces.iter().map(|face| self.double_area(face).norm() / 2.0).sum()
    }

    /// The edges, in the order of the faces that have them first.
    #[must_use]
    pub fn edges(&self) -> Vec<Edge> {
        let normals: Vec<Vector3<f64>> =
            self.faces.iter().map(|face| self.double_area(face).normalize()).collect();
        let mut of_edge = std::collections::BTreeMap::new();
        for (face, vertices) in self.faces.iter().enumerate() {
            for (i, &from) in vertices.iter().enumerate() {
                of_edge.insert((from, vertices[(i + 1) % vertices.len()]), face);
            }
        }
        let mut edges = Vec::new();
        for (&(from, to), &face) in &of_edge {
            if let (true, Some(&other)) = (from < to, of_edge.get(&(to, from))) {
                let (p, q) = (normals[face], normals[other]);
                edges.push(Edge { ends: [from, to], exterior_angle: p.cross(&q).norm().atan2(p.dot(&q)) });
            }
        }
        edges
    }

    /// `M = 1/2 sum over the edges of length times exterior angle`, in mm.
    #[must_use]
    pub fn mean_curvature_mm(&self) -> f64 {
        let of_edge = |edge: &Edge| {
            let [from, to] = edge.ends;
            (self.at(to) - self.at(from)).norm() * edge.exterior_angle / 2.0
        };
        self.edges().iter().map(of_edge).sum()
    }

    /// Volume in mm³ of the body rounded by a radius in mm.
    #[must_use]
    pub fn rounded_volume_mm3(&self, radius_mm: f64) -> f64 {
        let r = radius_mm;
        self.volume_mm3 + r * (self.surface_mm2() + r * (self.mean_curvature_mm() + r * 4.0 / 3.0 * PI))
    }

    /// Diameter of the sphere of equal volume, in mm, without rounding.
    #[must_use]
    pub fn equivalent_diameter_mm(&self) -> f64 {
        (6.0 / PI * self.volume_mm3).cbrt()
    }

    /// Inertia tensor about the centroid in mm⁵, with a density of one per mm³, without rounding.
    #[must_use]
    pub fn inertia_mm5(&self) -> Matrix3<f64> {
        let mut second = Matrix3::zeros();
        for [p, q, r] in self.triangles() {
            let sum = p + q + r;
            let squares = p * p.transpose() + q * q.transpose() + r * r.transpose();
            second += p.dot(&q.cross(&r)) / 120.0 * (sum * sum.transpose() + squares);
        }
        Matrix3::from_diagonal_element(second.trace()) - second
    }

    /// Support function in mm: how far the body reaches from its centroid along a unit vector, in its own axes, without
    /// rounding.
    #[must_use]
    pub fn support_mm(&self, direction: &Vector3<f64>) -> f64 {
        self.vertices_mm.iter().map(|vertex| vertex.dot(direction)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Width in mm along a unit vector.
    #[must_use]
    pub fn width_mm(&self, direction: &Vector3<f64>) -> f64 {
        self.support_mm(direction) + self.support_mm(&-direction)
    }

    /// Largest caliper width in mm: the largest distance of two vertices.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        let pairs = self.vertices_mm.iter().enumerate();
        pairs
            .flat_map(|(i, p)| self.vertices_mm[i + 1..].iter().map(move |q| (p - q).norm()))
            .fold(0.0, f64::max)
    }

    /// Least caliper width in mm. It is found along the normal of a face, or across two edges.
    #[must_use]
    pub fn thickness_mm(&self) -> f64 {
        let directions: Vec<Vector3<f64>> = self
            .edges()
            .iter()
            .map(|edge| (self.at(edge.ends[1]) - self.at(edge.ends[0])).normalize())
            .collect();
        let across = directions.iter().enumerate().flat_map(|(i, p)| {
            directions[i + 1..].iter().filter_map(move |q| p.cross(q).try_normalize(1e-9))
        });
        let normals = self.faces.iter().map(|face| self.double_area(face).normalize());
        normals.chain(across).map(|direction| self.width_mm(&direction)).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
#[path = "polyhedron_tests.rs"]
mod tests;
