//! The surface of a rounded polyhedron as polygons, finer or coarser.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::{Convex, ConvexEdge};
use crate::arrays::Each as _;
use crate::elementary::{atan2, sin};

/// A point of a skin: a vertex of the core, and the unit normal along which it is moved by the radius of rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SkinPoint {
    pub(crate) vertex: u32,
    pub(crate) normal: Vector3<f64>,
}

/// The surface of a body as convex polygons with their corners on it: of a sharp one its faces; of a rounded one its
/// faces, rectangles around its edges and triangles around its vertices.
#[derive(Clone, Debug, Default)]
pub(crate) struct Skin {
    pub(crate) points: Vec<SkinPoint>,
    /// The part of the body that each polygon belongs to, faces first, then edges, then vertices; and its corners,
    /// counter-clockwise as seen from outside.
    pub(crate) polygons: Vec<(u32, Vec<u32>)>,
}

impl Skin {
    /// The skin of a template, whose arcs and caps are divided so that no part turns by more than an angle along them.
    pub(crate) fn new(form: &Convex, most_angle: f64) -> Self {
        if form.rounding == 0.0 {
            let points =
                (0..form.vertices.len() as u32).map(|vertex| SkinPoint { vertex, normal: Vector3::zeros() });
            return Self {
                points: points.collect(),
                polygons: (0..).zip(form.faces.iter().cloned()).collect(),
            };
        }
        let mut skin = Self::default();
        // The point of each face at each of its vertices.
        let mut own = BTreeMap::new();
        for (face, corners) in (0_u32..).zip(&form.faces) {
            let normal = form.planes[face as usize].0;
            let points: Vec<u32> = corners.iter().map(|&vertex| skin.point(vertex, normal)).collect();
            own.extend(corners.iter().zip(&points).map(|(&vertex, &point)| ((face, vertex), point)));
            skin.polygons.push((face, points));
        }
        // The points between the faces of an edge at each of its ends, from the first face to the second.
        let mut arcs = BTreeMap::new();
        for (i, edge) in (form.faces.len() as u32..).zip(&form.edges) {
            let [from, to] = edge.ends.map(|vertex| {
                let arc = skin.arc(form, edge, vertex, most_angle, &own);
                let [first, second] = edge.faces;
                arcs.insert((vertex, first, second), arc.clone());
                arcs.insert((vertex, second, first), arc.iter().rev().copied().collect());
                arc
            });
            for (a, b) in from.windows(2).zip(to.windows(2)) {
                skin.polygons.push((i, vec![a[0], a[1], b[1], b[0]]));
            }
        }
        let first = (form.faces.len() + form.edges.len()) as u32;
        for vertex in 0..form.vertices.len() as u32 {
            skin.cap(form, vertex, first + vertex, most_angle, &arcs);
        }
        skin
    }

    fn point(&mut self, vertex: u32, normal: Vector3<f64>) -> u32 {
        self.points.push(SkinPoint { vertex, normal });
        self.points.len() as u32 - 1
    }

    fn arc(
        &mut self,
        form: &Convex,
        edge: &ConvexEdge,
        vertex: u32,
        most_angle: f64,
        own: &BTreeMap<(u32, u32), u32>,
    ) -> Vec<u32> {
        let [first, second] = edge.faces.each(|face| own[&(face, vertex)]);
        let [m, n] = edge.faces.each(|face| form.planes[face as usize].0);
        let parts = (edge.angle / most_angle - 1e-9).ceil().max(1.0);
        let mut arc = vec![first];
        for part in 1..parts as u32 {
            let turned = edge.angle * f64::from(part) / parts;
            let normal = m * sin(edge.angle - turned) + n * sin(turned);
            arc.push(self.point(vertex, normal.normalize()));
        }
        arc.push(second);
        arc
    }

    /// The spherical polygon around a vertex as rings about its middle.
    fn cap(
        &mut self,
        form: &Convex,
        vertex: u32,
        part: u32,
        most_angle: f64,
        arcs: &BTreeMap<(u32, u32, u32), Vec<u32>>,
    ) {
        // From each face around the vertex to the next, counter-clockwise: across the edge to the vertex before.
        let mut next = BTreeMap::new();
        for edge in form.edges.iter().filter(|edge| edge.ends.contains(&vertex)) {
            let [first, second] = edge.faces;
            if edge.ends[0] == vertex {
                next.insert(second, first)
            } else {
                next.insert(first, second)
            };
        }
        let Some(&start) = next.keys().next() else { return };
        let mut around = Vec::new();
        let mut face = start;
        for _ in 0..next.len() {
            let Some(&following) = next.get(&face) else { return };
            if let Some(arc) = arcs.get(&(vertex, face, following)) {
                around.extend_from_slice(&arc[..arc.len() - 1]);
            }
            face = following;
        }
        let normals: Vec<Vector3<f64>> = around.iter().map(|&p| self.points[p as usize].normal).collect();
        let middle = normals.iter().sum::<Vector3<f64>>().normalize();
        let widest = normals.iter().map(|n| atan2(middle.cross(n).norm(), middle.dot(n))).fold(0.0, f64::max);
        let rings = (widest / most_angle - 1e-9).ceil().max(1.0) as u32;
        if around.len() == 3 && rings == 1 {
            self.polygons.push((part, around));
            return;
        }
        let mut outer = around;
        for ring in (1..rings).rev() {
            let share = f64::from(ring) / f64::from(rings);
            let toward = |normal: &Vector3<f64>| (middle + (normal - middle) * share).normalize();
            let inner: Vec<u32> = normals.iter().map(|normal| self.point(vertex, toward(normal))).collect();
            for i in 0..outer.len() {
                let next = (i + 1) % outer.len();
                self.polygons.push((part, vec![outer[i], outer[next], inner[next]]));
                self.polygons.push((part, vec![outer[i], inner[next], inner[i]]));
            }
            outer = inner;
        }
        let middle = self.point(vertex, middle);
        for i in 0..outer.len() {
            self.polygons.push((part, vec![outer[i], outer[(i + 1) % outer.len()], middle]));
        }
    }
}
