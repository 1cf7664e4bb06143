//! The surface of a rounded polyhedron as triangles, and planes around it.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::shape::Polyhedron;

/// Most of the angle that a step along a rounded edge turns by.
const STEP: f64 = 0.2;
/// Rings of triangles of a rounded corner.
const RINGS: usize = 2;
/// Planes around a rounded body besides those of its faces: no direction is farther than some 13 degrees from the
/// normal of one.
const DIRECTIONS: usize = 160;

/// A closed surface of triangles.
pub(super) struct Surface {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Counter-clockwise as seen from outside.
    pub(super) triangles: Vec<[usize; 3]>,
}

impl Surface {
    /// The surface of a body; of a rounded one a surface within it whose vertices lie on its own.
    pub(super) fn new(body: &Polyhedron) -> Self {
        let r = body.rounding();
        if r == 0.0 {
            let triangles = body.faces().iter().flat_map(|face| {
                let corner = |i: usize| face[i] as usize;
                (2..face.len()).map(move |i| [corner(0), corner(i - 1), corner(i)])
            });
            return Self { vertices: body.vertices().to_vec(), triangles: triangles.collect() };
        }
        let mut surface = Self { vertices: Vec::new(), triangles: Vec::new() };
        let normals: Vec<Vector3<f64>> = (0..body.faces().len()).map(|face| body.plane(face).0).collect();
        let mut face_of: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for (face, corners) in body.faces().iter().enumerate() {
            for (i, &from) in corners.iter().enumerate() {
                face_of.insert([from, corners[(i + 1) % corners.len()]], face);
            }
            let points: Vec<Vector3<f64>> =
                corners.iter().map(|&v| body.vertices()[v as usize] + normals[face] * r).collect();
            for i in 2..points.len() {
                surface.push([points[0], points[i - 1], points[i]], &normals[face]);
            }
        }
        let at = |v: u32| body.vertices()[v as usize];
        for (&[from, to], &face) in &face_of {
            let Some(&other) = face_of.get(&[to, from]).filter(|_| from < to) else { continue };
            for pair in arc(normals[face], normals[other]).windows(2) {
                let [m, n] = [pair[0], pair[1]];
                let corners = [at(from) + m * r, at(to) + m * r, at(to) + n * r, at(from) + n * r];
                surface.push([corners[0], corners[1], corners[2]], &(m + n));
                surface.push([corners[0], corners[2], corners[3]], &(m + n));
            }
        }
        // The outer normals at a vertex are a polygon on the sphere, whose corners are those of the faces around it.
        let mut arcs: BTreeMap<u32, Vec<Vec<Vector3<f64>>>> = BTreeMap::new();
        for (&[from, to], &face) in &face_of {
            if let Some(&other) = face_of.get(&[to, from]) {
                arcs.entry(from).or_default().push(arc(normals[face], normals[other]));
            }
        }
        for (vertex, arcs) in arcs {
            let center = arcs.iter().flatten().sum::<Vector3<f64>>().normalize();
            let toward = |normal: &Vector3<f64>, ring: usize| {
                (center + (normal - center) * (ring as f64 / RINGS as f64)).normalize()
            };
            for pair in arcs.iter().flat_map(|arc| arc.windows(2)) {
                for ring in 0..RINGS {
                    let [m, n] = [toward(&pair[0], ring), toward(&pair[1], ring)];
                    let [p, q] = [toward(&pair[0], ring + 1), toward(&pair[1], ring + 1)];
                    let point = |normal: Vector3<f64>| at(vertex) + normal * r;
                    surface.push([m, p, q].map(point), &(p + q));
                    if ring > 0 {
                        surface.push([m, q, n].map(point), &(p + q));
                    }
                }
            }
        }
        surface
    }

    /// Appends a triangle, turned so that it faces a direction.
    fn push(&mut self, [p, q, r]: [Vector3<f64>; 3], outward: &Vector3<f64>) {
        let is_turned = (q - p).cross(&(r - p)).dot(outward) < 0.0;
        let first = self.vertices.len();
        self.vertices.extend(if is_turned { [p, r, q] } else { [p, q, r] });
        self.triangles.push([first, first + 1, first + 2]);
    }

    /// Area of a triangle along its outward normal.
    pub(super) fn area(&self, triangle: &[usize; 3]) -> Vector3<f64> {
        let [p, q, r] = triangle.map(|corner| self.vertices[corner]);
        (q - p).cross(&(r - p)) / 2.0
    }

    /// Volume within the surface.
    pub(super) fn volume(&self) -> f64 {
        self.triangles.iter().map(|t| self.vertices[t[0]].dot(&self.area(t)) / 3.0).sum()
    }
}

/// Unit vectors from one to another, at equal angles of [`STEP`] at most.
fn arc(from: Vector3<f64>, to: Vector3<f64>) -> Vec<Vector3<f64>> {
    let angle = from.cross(&to).norm().atan2(from.dot(&to));
    let steps = (angle / STEP).ceil().max(1.0) as usize;
    let across = (to - from * from.dot(&to)).try_normalize(0.0).unwrap_or_default();
    (0..=steps)
        .map(|i| match i {
            0 => from,
            i if i == steps => to,
            i => {
                let (sine, cosine) = (angle * i as f64 / steps as f64).sin_cos();
                from * cosine + across * sine
            }
        })
        .collect()
}

/// Planes that hold a body, by outward normals and heights: those of its faces, and of a rounded one others that touch
/// it.
pub(super) fn planes_around(body: &Polyhedron) -> Vec<(Vector3<f64>, f64)> {
    let of_face = |face| {
        let (normal, height) = body.plane(face);
        (normal, height + body.rounding())
    };
    let mut planes: Vec<(Vector3<f64>, f64)> = (0..body.faces().len()).map(of_face).collect();
    if body.rounding() > 0.0 {
        let golden_angle = PI * (3.0 - 5.0_f64.sqrt());
        planes.extend((0..DIRECTIONS).map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / DIRECTIONS as f64;
            let (sine, cosine) = (golden_angle * i as f64).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            let normal = Vector3::new(radius * cosine, radius * sine, z);
            (normal, body.support(&normal))
        }));
    }
    planes
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::shape::Form;
    use crate::shape::polyhedron::{TemplateKind, draw_template, samples};

    #[test]
    fn the_surface_is_closed_lies_in_the_body_and_holds_nearly_all_of_it() {
        let mut rng = stream(1, Stream::Shape);
        let kinds =
            [TemplateKind::Cuts(24), TemplateKind::Cuboid(0.2), TemplateKind::Voronoi, TemplateKind::Cuts(6)];
        let form = Form { elongation: 0.7, flatness: 0.7 };
        let drawn = kinds.map(|kind| draw_template(kind, form, &mut rng).unwrap());
        let regular = [samples::cuboid([1.0, 1.0, 1.0], 0.0), samples::octahedron(1.0)];
        for body in drawn.into_iter().chain(regular).map(|body| body.normalized()) {
            for (rounding, most) in [(0.0, 1e-12), (0.01, 0.001), (0.05, 0.005), (0.2, 0.015), (0.4, 0.05)] {
                let rounded = body.with_relative_rounding(rounding).unwrap();
                let surface = Surface::new(&rounded);
                let open: Vector3<f64> = surface.triangles.iter().map(|t| surface.area(t)).sum();
                assert!(open.norm() < 1e-12, "{rounding}: {open}");
                let missing = 1.0 - surface.volume() / rounded.volume();
                assert!(missing > -1e-12 && missing < most, "{rounding}: {missing}");
                let planes = planes_around(&rounded);
                for vertex in &surface.vertices {
                    assert!(planes.iter().all(|(normal, height)| normal.dot(vertex) < height + 1e-12));
                }
            }
        }
    }
}
