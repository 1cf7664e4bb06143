//! The surface of one grain that is a convex polyhedron.
//!
//! It is meshed by its faces, exactly. The edges of its faces are divided with them, so that the triangles of two faces
//! fit; within a face the triangulation is Delaunay's, and vertices inside of a face are moved to the middle of their
//! neighbours.
//!
//! A rounded grain is meshed as a sharp polyhedron too (`rounded`), which is scaled about its centre. Where its
//! rounding is too fine for the edges asked for (a diameter below the shortest of them), that is its core. A grain with
//! faces or edges that are much shorter than the edges asked for is meshed without them (`rounded`). Where no
//! volume is asked for, the core is enlarged until its farthest vertex lies on the body: no vertex moves by more than
//! the radius of the rounding then, so that all of the core stays inside.

use std::collections::HashMap;

use super::bodies::PlacedPolyhedron;
use super::rounded::Facets;
use super::size::Facing;
use super::surface::{Shape, Surface, cross, distance2, dot, make_more_than_half_a_turn};
use crate::arrays::Each as _;
use crate::elementary::{atan2, cbrt};
use crate::gap::linear::{Vector, minus, norm, scaled, sum};
use crate::geometry::convex::directed_edges;
use crate::shape::Pose;

/// Edges in multiples of those asked for, from step to step: what is coarse is put in order before it is divided.
const STEPS: [f64; 3] = [4.0, 2.0, 1.0];
/// Times that vertices within a face are moved to the middle of their neighbours, in each step.
const SMOOTHINGS: usize = 2;
/// How high a vertex may lie above a plane that it counts as part of, over the size of the grain.
const FLATNESS: f64 = 1.0e-8;
/// Share by which inscribed surfaces are smaller, so that rounding brings no vertex out of the body.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// How the surface of a grain is to be meshed, and what is around it, seen from its centre.
pub(super) struct Angular<'a> {
    /// Length of edges where nothing is close.
    pub(super) edge_mm: f64,
    /// Shortest edges that are asked for.
    pub(super) floor_mm: f64,
    /// The volume to be met, where volumes are corrected.
    pub(super) target_mm3: Option<f64>,
    pub(super) facing: Vec<Facing<'a>>,
    /// What no vertex crosses.
    pub(super) obstacles: Vec<Obstacle>,
    /// No vertex moves farther, for what is farther away was not looked at.
    pub(super) most_mm: f64,
}

/// What no vertex crosses where a grain is enlarged. The grain lies on the side where its centre is.
pub(super) enum Obstacle {
    /// A plane across a unit vector, and its distance from the centre.
    Plane(Vector, f64),
    /// A cylinder along z around the grain: where its axis stands, and its radius.
    Cylinder([f64; 2], f64),
}

/// A polyhedron about the centre of its grain.
pub(super) struct Placed<'a> {
    pub(super) vertices: Vec<Vector>,
    pub(super) faces: &'a [Vec<u32>],
    /// Factor of the largest copy about the centre that lies inside of the grain.
    pub(super) inscribed: f64,
    /// Whether it is the grain itself.
    pub(super) is_exact: bool,
}

impl<'a> Placed<'a> {
    /// The core of a grain.
    pub(super) fn core(grain: &PlacedPolyhedron<'a>) -> Self {
        let PlacedPolyhedron { shape, pose, template, .. } = *grain;
        // About the origin, where vertices are the same but for the centre that is added.
        let about = Pose { center_mm: nalgebra::Vector3::zeros(), ..*pose };
        let vertices: Vec<Vector> =
            shape.template.world_vertices_mm(shape.scale_mm, &about).map(Into::into).collect();
        let farthest = vertices.iter().map(|vertex| norm(*vertex)).fold(0.0, f64::max);
        Self {
            vertices,
            faces: &template.faces,
            inscribed: 1.0 + shape.scale_mm * template.rounding / farthest * (1.0 - ROUNDING),
            is_exact: template.rounding == 0.0,
        }
    }

    /// The facets of a grain that is rounded, or has faces too narrow to be meshed.
    pub(super) fn facets(grain: &PlacedPolyhedron<'_>, facets: &'a Facets) -> Self {
        let (scale, rotation) = (grain.shape.scale_mm, grain.pose.rotation());
        Self {
            vertices: facets.vertices.iter().map(|vertex| (rotation * vertex * scale).into()).collect(),
            faces: &facets.faces,
            inscribed: facets.inscribed(grain.template) * (1.0 - ROUNDING),
            is_exact: false,
        }
    }

    pub(super) fn volume_mm3(&self) -> f64 {
        let at = |v: u32| self.vertices[v as usize];
        let fan = |corners: &Vec<u32>| {
            let start = at(corners[0]);
            corners.windows(2).map(|pair| dot(start, cross(at(pair[0]), at(pair[1])))).sum::<f64>() / 6.0
        };
        self.faces.iter().map(fan).sum()
    }
}

impl Obstacle {
    /// How far a point may move away from the centre.
    fn room(&self, p: Vector) -> f64 {
        let length = norm(p);
        match *self {
            Self::Plane(across, distance) => {
                let along = dot(p, across);
                if along > 0.0 { (distance / along - 1.0) * length } else { f64::INFINITY }
            }
            Self::Cylinder(axis, radius) => {
                let from_axis = [p[0] - axis[0], p[1] - axis[1]];
                let along = [p[0] / length, p[1] / length];
                let square = along[0] * along[0] + along[1] * along[1];
                let slope = from_axis[0] * along[0] + from_axis[1] * along[1];
                let inside = radius * radius - from_axis[0] * from_axis[0] - from_axis[1] * from_axis[1];
                if square > 0.0 {
                    ((slope * slope + square * inside.max(0.0)).sqrt() - slope) / square
                } else {
                    f64::INFINITY
                }
            }
        }
    }
}

impl Angular<'_> {
    /// The surface of a polyhedron, and whether it has the volume asked for; `None` when that would take more than
    /// `most_triangles`.
    pub(super) fn surface(&self, placed: &Placed<'_>, most_triangles: usize) -> Option<(Surface, bool)> {
        let size = placed.vertices.iter().map(|vertex| norm(*vertex)).fold(0.0, f64::max);
        let mut patches = Patches {
            angular: self,
            points: placed.vertices.clone(),
            faces: Vec::new(),
            coarse: STEPS[0],
            flat: FLATNESS * size,
        };
        let triangles = patches.divided(placed.faces);
        let mut surface = Surface::new(patches.points.clone(), triangles);
        surface.flip(&patches);
        for coarse in STEPS {
            patches.coarse = coarse;
            if !surface.refine(&mut patches, most_triangles) {
                return None;
            }
            for _ in 0..SMOOTHINGS {
                patches.smooth(&mut surface);
                surface.flip(&patches);
            }
        }
        let (factor, full) = self.factor(surface.volume_mm3(), placed);
        surface.points.iter_mut().for_each(|p| *p = scaled(*p, factor));
        Some((surface, full))
    }

    /// How far a point may move away from the centre.
    fn room(&self, p: Vector) -> f64 {
        self.obstacles.iter().map(|obstacle| obstacle.room(p)).fold(self.most_mm, f64::min).max(0.0)
    }

    /// By what a polyhedron of that volume is scaled about its centre, into the grain or to the volume asked for as far
    /// as there is room, and whether it has that volume then.
    pub(super) fn factor(&self, volume_mm3: f64, placed: &Placed<'_>) -> (f64, bool) {
        let inscribed = placed.inscribed;
        match self.target_mm3 {
            _ if placed.is_exact => (1.0, true),
            None => (inscribed, true),
            Some(target) => {
                let room = |vertex: &Vector| self.room(scaled(*vertex, inscribed)) / norm(*vertex);
                let most = inscribed + placed.vertices.iter().map(room).fold(f64::INFINITY, f64::min);
                let wanted = cbrt(target / volume_mm3);
                (wanted.min(most), wanted <= most)
            }
        }
    }
}

/// The faces of a surface while it is divided.
struct Patches<'a> {
    angular: &'a Angular<'a>,
    /// The vertices to begin with.
    points: Vec<Vector>,
    /// The faces that each vertex lies on.
    faces: Vec<Vec<u32>>,
    coarse: f64,
    /// How high a vertex may lie above a plane that it counts as part of.
    flat: f64,
}

impl Patches<'_> {
    /// The triangles to begin with: edges are divided evenly, and faces are triangulated as Delaunay's triangulation of
    /// their boundary.
    fn divided(&mut self, polygons: &[Vec<u32>]) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        let mut faces: Vec<(u32, [u32; 3])> = Vec::new();
        let mut chains = HashMap::new();
        for [from, to] in polygons.iter().flat_map(|corners| directed_edges(corners)) {
            self.divide(from, to, &mut chains);
        }
        let side = |[from, to]: [u32; 2]| -> Vec<u32> {
            match chains.get(&[from.min(to), from.max(to)]) {
                None => vec![from, to],
                Some(chain) if from < to => chain.clone(),
                Some(chain) => chain.iter().rev().copied().collect(),
            }
        };
        for (face, corners) in (0..).zip(polygons) {
            let first = triangles.len();
            let sides = directed_edges(corners).map(side);
            let boundary: Vec<u32> = sides.flat_map(|side| side[..side.len() - 1].to_vec()).collect();
            self.triangulate(&boundary, &mut triangles);
            faces.extend(triangles[first..].iter().map(|corners| (face, *corners)));
        }
        self.faces = vec![Vec::new(); self.points.len()];
        for (face, corners) in faces {
            for corner in corners {
                self.faces[corner as usize].push(face);
            }
        }
        self.faces.iter_mut().for_each(|faces| {
            faces.sort_unstable();
            faces.dedup();
        });
        triangles
    }

    /// Divides an edge evenly, once.
    fn divide(&mut self, from: u32, to: u32, chains: &mut HashMap<[u32; 2], Vec<u32>>) {
        let key = [from.min(to), from.max(to)];
        chains.entry(key).or_insert_with(|| {
            let [p, q] = key.each(|p| self.points[p as usize]);
            let count = (distance2(p, q).sqrt() / self.angular.edge_mm).round().max(1.0);
            let mut chain = vec![key[0]];
            for k in 1..count as u32 {
                let share = f64::from(k) / count;
                self.points.push(sum(p, scaled(minus(q, p), share)));
                chain.push(self.points.len() as u32 - 1);
            }
            chain.push(key[1]);
            chain
        });
    }

    /// Triangulates a convex polygon, some of whose corners may lie on a line: on the edge from the first corner to the
    /// last stands the triangle with the largest angle, and so on at both sides of it.
    fn triangulate(&self, boundary: &[u32], triangles: &mut Vec<[u32; 3]>) {
        let mut open = vec![boundary.to_vec()];
        while let Some(corners) = open.pop() {
            let n = corners.len();
            if n < 3 {
                continue;
            }
            let at = |k: usize| self.points[corners[k] as usize];
            let (p, q) = (at(0), at(n - 1));
            let angle = |k: usize| {
                let (u, v) = (minus(p, at(k)), minus(q, at(k)));
                let normal = cross(u, v);
                let area = dot(normal, normal).sqrt();
                // Corners on the line of the edge make no triangle.
                let height = area / norm(minus(q, p));
                if height > self.flat { atan2(area, dot(u, v)) } else { -1.0 }
            };
            let apex = (1..n - 1).max_by(|&i, &j| angle(i).total_cmp(&angle(j))).unwrap_or(1);
            triangles.push([corners[0], corners[apex], corners[n - 1]]);
            open.push(corners[..=apex].to_vec());
            open.push(corners[apex..].to_vec());
        }
    }

    /// Moves vertices inside of faces to the middle of their neighbours, where no triangle turns over by that.
    fn smooth(&self, surface: &mut Surface) {
        let mut around: HashMap<u32, Vec<[u32; 2]>> = HashMap::new();
        for &[a, b, c] in &surface.triangles {
            for [own, p, q] in [[a, b, c], [b, c, a], [c, a, b]] {
                if self.faces[own as usize].len() == 1 {
                    around.entry(own).or_default().push([p, q]);
                }
            }
        }
        let mut inside: Vec<(u32, Vec<[u32; 2]>)> = around.into_iter().collect();
        inside.sort_unstable();
        for (own, edges) in inside {
            let at = |p: u32| surface.points[p as usize];
            let total = edges.iter().fold([0.0; 3], |total, [p, _]| sum(total, at(*p)));
            let (old, new) = (at(own), scaled(total, 1.0 / edges.len() as f64));
            let normal = |center: Vector, [p, q]: [u32; 2]| cross(minus(at(p), center), minus(at(q), center));
            let keeps = edges.iter().all(|&edge| {
                let (before, after) = (normal(old, edge), normal(new, edge));
                dot(before, after) > 0.05 * dot(before, before)
            });
            if keeps {
                surface.points[own as usize] = new;
            }
        }
    }
}

impl Shape for Patches<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[[f64; 3]]) -> [f64; 3] {
        let [of_a, of_b] = [a, b].map(|p| &self.faces[p as usize]);
        let common = of_a.iter().copied().filter(|face| of_b.contains(face)).collect();
        self.faces.push(common);
        scaled(sum(points[a as usize], points[b as usize]), 0.5)
    }

    fn wants_shorter(&self, centroid: [f64; 3], longest_mm: f64) -> bool {
        longest_mm > self.coarse * self.angular.edge_mm
            || self
                .angular
                .facing
                .iter()
                .any(|facing| facing.wants_shorter(centroid, longest_mm, self.coarse))
    }

    /// Within a face: whether the angles opposite to ab make more than half a turn.
    fn is_wrong(&self, [a, b]: [u32; 2], [c, d]: [u32; 2], points: &[[f64; 3]]) -> bool {
        let of = |p: u32| &self.faces[p as usize];
        if !of(a).iter().any(|face| [b, c, d].iter().all(|&p| of(p).contains(face))) {
            return false;
        }
        let [a, b, c, d] = [a, b, c, d].each(|p| points[p as usize]);
        make_more_than_half_a_turn([minus(a, c), minus(b, c)], [minus(a, d), minus(b, d)])
    }
}
