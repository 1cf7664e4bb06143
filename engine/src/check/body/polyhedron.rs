//! A polyhedron as the check sees it: the hull of the points that its stored numbers give, rounded by a radius.
//!
//! The points are computed in the order of operations that is part of the stored form
//! ([`crate::shape::Polyhedron`], `world_vertices_mm`): `x + ((R_k0 u_0 + R_k1 u_1) + R_k2 u_2)` with `u = s v`.
//! From there on they are exact. Faces and edges only suggest directions.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{Matrix3, Quaternion, Vector3};

use crate::arrays::Each as _;
use crate::elementary::{acos, cbrt};
use crate::shape::{Pose, ScaledPolyhedron};

/// A polyhedron with position and orientation.
#[derive(Clone, Debug)]
pub(in crate::check) struct Polyhedron<'a> {
    pub(in crate::check) center: Vector3<f64>,
    /// Corners of the core.
    pub(in crate::check) points: Vec<Vector3<f64>>,
    /// The same relative to the centre, within rounding.
    pub(in crate::check) relative: Vec<Vector3<f64>>,
    /// Those of the template, counter-clockwise seen from outside.
    faces: &'a [Vec<u32>],
    /// Radius of rounding.
    pub(in crate::check) rounding: f64,
    /// Radius of the sphere around the centre that holds the body.
    pub(in crate::check) radius: f64,
    /// Volume in mm³.
    pub(in crate::check) volume: f64,
    /// Diameter of the sphere of equal volume.
    pub(in crate::check) equivalent_diameter: f64,
}

impl<'a> Polyhedron<'a> {
    /// `None` where the numbers describe no body in space.
    pub(in crate::check) fn new(shape: &ScaledPolyhedron<'a>, pose: &Pose) -> Option<Self> {
        let (template, scale, center) = (shape.template, shape.scale_mm, pose.center_mm);
        let &Quaternion { coords } = pose.orientation.quaternion();
        let (x, y, z, w) = (coords.x, coords.y, coords.z, coords.w);
        let norm2 = w * w + x * x + y * y + z * z;
        let valid = scale.is_finite()
            && scale > 0.0
            && center.iter().all(|x| x.is_finite())
            && (1.0e-30..1.0e30).contains(&norm2);
        if !valid {
            return None;
        }
        let t = 2.0 / norm2;
        let rows = [
            [1.0 - t * (y * y + z * z), t * (x * y - w * z), t * (x * z + w * y)],
            [t * (x * y + w * z), 1.0 - t * (x * x + z * z), t * (y * z - w * x)],
            [t * (x * z - w * y), t * (y * z + w * x), 1.0 - t * (x * x + y * y)],
        ];
        let place = |v: &Vector3<f64>| {
            let u = [v[0] * scale, v[1] * scale, v[2] * scale];
            Vector3::from_fn(|k, _| center[k] + ((rows[k][0] * u[0] + rows[k][1] * u[1]) + rows[k][2] * u[2]))
        };
        let points: Vec<Vector3<f64>> = template.vertices().iter().map(place).collect();
        let relative: Vec<Vector3<f64>> = points.iter().map(|p| p - center).collect();
        let rounding = template.rounding() * scale;
        let mut polyhedron = Self {
            center,
            radius: relative.iter().map(Vector3::norm).fold(0.0, f64::max) + rounding,
            points,
            relative,
            faces: template.faces(),
            rounding,
            volume: 0.0,
            equivalent_diameter: 0.0,
        };
        polyhedron.volume = polyhedron.own_volume();
        polyhedron.equivalent_diameter = cbrt(6.0 * polyhedron.volume / PI);
        (polyhedron.equivalent_diameter > 0.0).then_some(polyhedron)
    }

    /// Triangles that make up the faces.
    pub(in crate::check) fn triangles(&self) -> impl Iterator<Item = [usize; 3]> {
        self.faces.iter().flat_map(|face| {
            face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]].each(|corner| corner as usize))
        })
    }

    /// Edges: each lies between two faces, which run along it in opposite directions.
    pub(in crate::check) fn edges(&self) -> impl Iterator<Item = [usize; 2]> {
        let all = self.faces.iter().flat_map(|face| {
            (0..face.len()).map(|at| [face[at], face[(at + 1) % face.len()]].each(|corner| corner as usize))
        });
        all.filter(|[from, to]| from < to)
    }

    /// The volume by Steiner's formula: each edge adds a sector of a cylinder, all corners together one sphere.
    fn own_volume(&self) -> f64 {
        let (mut volume, mut surface, mut curvature) = (0.0, 0.0, 0.0);
        let mut normals: BTreeMap<[usize; 2], Vector3<f64>> = BTreeMap::new();
        for face in self.faces {
            let corners: Vec<usize> = face.iter().map(|&v| v as usize).collect();
            let mut area = Vector3::zeros();
            for pair in corners[1..].windows(2) {
                let [a, b, c] = [corners[0], pair[0], pair[1]].each(|v| self.relative[v]);
                area += 0.5 * (b - a).cross(&(c - a));
                volume += Matrix3::from_columns(&[a, b, c]).determinant() / 6.0;
            }
            surface += area.norm();
            let normal = area.try_normalize(0.0).unwrap_or_default();
            for (at, &from) in corners.iter().enumerate() {
                let to = corners[(at + 1) % corners.len()];
                match normals.remove(&[to, from]) {
                    Some(other) => {
                        let length = (self.relative[from] - self.relative[to]).norm();
                        curvature += 0.5 * length * acos(normal.dot(&other).clamp(-1.0, 1.0));
                    }
                    None => drop(normals.insert([from, to], normal)),
                }
            }
        }
        let rho = self.rounding;
        volume + surface * rho + curvature * rho * rho + 4.0 / 3.0 * PI * rho.powi(3)
    }

    /// Radius of the sphere around the centre that holds the core.
    #[inline(always)]
    pub(in crate::check) fn relative_radius(&self) -> f64 {
        self.radius - self.rounding
    }

    /// Largest `n . p` of the core over the corners relative to the centre.
    #[inline(always)]
    pub(in crate::check) fn support(&self, n: &Vector3<f64>) -> (f64, usize) {
        let mut best = (f64::NEG_INFINITY, 0);
        for (index, p) in self.relative.iter().enumerate() {
            let height = n.x * p.x + n.y * p.y + n.z * p.z;
            if height > best.0 {
                best = (height, index);
            }
        }
        best
    }
}
