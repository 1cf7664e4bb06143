//! A rounded convex polyhedron as a sharp one of facets that are not too small for the edges asked for.
//!
//! Triangles with their corners on flat faces and on narrow curved parts leave dents or needles, and beyond a dent Gmsh
//! is left with a flat tetrahedron; flat facets have neither. It begins with the planes of the faces, moved outwards by
//! the radius of the rounding. Then it is cut where it is farthest outside of the body: by the plane that touches the
//! body there, or a deeper one, where all edges made by that are long enough. `polyhedron` meshes what is left, scaled.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::geometry::convex::{Convex, directed_edges};

/// Shortest edges that a cut may make, in edges asked for where nothing is close.
const LEAST_EDGE: f64 = 0.15;
/// Depths of cuts below the touching plane, over the distance from the body that is cut away.
const DEPTHS: [f64; 9] = [0.0, 0.15, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0];
/// Distance from the body that is not cut away, in edges asked for.
const LEAST_DISTANCE: f64 = 0.01;
/// By how much more the middle of an edge counts than its ends do.
const MIDDLE_WEIGHT: f64 = 2.0;
/// Most cuts.
const MOST_CUTS: usize = 300;
/// Normals this close, as scalar products, are not tried twice.
const SAME_NORMAL: f64 = 0.9999;
/// Distance from a plane below which a vertex lies on it.
const ON_PLANE: f64 = 1.0e-10;
/// Half of the edge of the cube to begin with: no body with an equivalent diameter of 1 that can be drawn is longer.
const HALF_CUBE: f64 = 100.0;

/// A convex polyhedron that planes are cut off from.
#[derive(Clone, Debug)]
pub(super) struct Facets {
    pub(super) vertices: Vec<Vector3<f64>>,
    /// Vertices of the facets, counter-clockwise as seen from outside.
    pub(super) faces: Vec<Vec<u32>>,
}

impl Facets {
    /// Of a rounded body, in its units, for edges of that length where nothing is close.
    pub(super) fn new(body: &Convex, edge: f64) -> Self {
        let mut solid = Self::cube();
        for (normal, height) in &body.planes {
            solid.cut(normal, height + body.rounding);
        }
        let mut tried: Vec<Vector3<f64>> = Vec::new();
        for _ in 0..MOST_CUTS {
            let is_new = |normal: &Vector3<f64>| tried.iter().all(|old| old.dot(normal) < SAME_NORMAL);
            let outside = solid.places().filter_map(|(p, weight)| {
                let away = body.distance(&p);
                let normal = (away > LEAST_DISTANCE * edge).then(|| body.normal(&p)).filter(is_new)?;
                Some((away * weight, away, normal))
            });
            let Some((_, away, normal)) = outside.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            tried.push(normal);
            let highest = body.vertices.iter().map(|v| normal.dot(v)).fold(f64::NEG_INFINITY, f64::max);
            for depth in DEPTHS {
                let mut next = solid.clone();
                if next.cut(&normal, highest + body.rounding - depth * away) >= LEAST_EDGE * edge {
                    solid = next;
                    break;
                }
            }
        }
        solid.compacted()
    }

    fn cube() -> Self {
        let corner = |i: usize| Vector3::from_fn(|k, _| if i >> k & 1 == 1 { HALF_CUBE } else { -HALF_CUBE });
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Self { vertices: (0..8).map(corner).collect(), faces: faces.map(Vec::from).to_vec() }
    }

    /// Corners and middles of edges, and what they count.
    fn places(&self) -> impl Iterator<Item = (Vector3<f64>, f64)> {
        self.faces.iter().flat_map(|corners| directed_edges(corners)).flat_map(|[from, to]| {
            let [p, q] = [from, to].map(|v| self.vertices[v as usize]);
            [(p, 1.0), ((p + q) / 2.0, MIDDLE_WEIGHT)]
        })
    }

    /// Cuts off what lies above a plane, and says how long the shortest of the edges at new vertices is.
    fn cut(&mut self, normal: &Vector3<f64>, height: f64) -> f64 {
        let old = self.vertices.len() as u32;
        let above: Vec<f64> = self.vertices.iter().map(|v| normal.dot(v) - height).collect();
        let is_out = |v: u32| above[v as usize] > ON_PLANE;
        let mut made: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut next: BTreeMap<u32, u32> = BTreeMap::new();
        let mut kept = Vec::with_capacity(self.faces.len() + 1);
        for corners in &self.faces {
            if !corners.iter().any(|&v| is_out(v)) {
                kept.push(corners.clone());
                continue;
            }
            let (mut left, mut entered) = (None, None);
            let mut rest: Vec<u32> = Vec::new();
            for [from, to] in directed_edges(corners) {
                if !is_out(from) {
                    rest.push(from);
                }
                if is_out(from) == is_out(to) {
                    continue;
                }
                let (inside, outside) = if is_out(from) { (to, from) } else { (from, to) };
                let (low, high) = (above[inside as usize], above[outside as usize]);
                let crossing = if low > -ON_PLANE {
                    inside
                } else {
                    *made.entry([inside, outside]).or_insert_with(|| {
                        let (p, q) = (self.vertices[inside as usize], self.vertices[outside as usize]);
                        self.vertices.push(p + (q - p) * (low / (low - high)));
                        self.vertices.len() as u32 - 1
                    })
                };
                rest.push(crossing);
                *(if is_out(to) { &mut left } else { &mut entered }) = Some(crossing);
            }
            if let (Some(left), Some(entered)) = (left, entered)
                && left != entered
            {
                next.insert(entered, left);
            }
            rest.dedup();
            if rest.len() > 1 && rest.first() == rest.last() {
                rest.pop();
            }
            if rest.len() > 2 {
                kept.push(rest);
            }
        }
        if let Some((&start, _)) = next.iter().next() {
            let mut corners = vec![start];
            while let Some(&following) = corners.last().and_then(|last| next.get(last)) {
                if following == start || corners.len() > next.len() {
                    break;
                }
                corners.push(following);
            }
            if corners.len() > 2 {
                kept.push(corners);
            }
        }
        self.faces = kept;
        let edges = self.faces.iter().flat_map(|corners| directed_edges(corners));
        let lengths = edges
            .filter(|[from, to]| *from >= old || *to >= old)
            .map(|edge| edge.map(|v| self.vertices[v as usize]))
            .map(|[p, q]| (p - q).norm());
        lengths.fold(f64::INFINITY, f64::min)
    }

    /// The same without the vertices that no facet has.
    fn compacted(&self) -> Self {
        let mut numbers = BTreeMap::new();
        let mut vertices = Vec::new();
        let mut number = |v: &u32| {
            *numbers.entry(*v).or_insert_with(|| {
                vertices.push(self.vertices[*v as usize]);
                vertices.len() as u32 - 1
            })
        };
        let faces = self.faces.iter().map(|corners| corners.iter().map(&mut number).collect()).collect();
        Self { vertices, faces }
    }

    /// Factor of the largest copy about the origin that lies inside of the body.
    pub(super) fn inscribed(&self, body: &Convex) -> f64 {
        let leave = |v: &Vector3<f64>| body.chord(&Vector3::zeros(), v).map_or(0.0, |[_, leave]| leave);
        self.vertices.iter().map(leave).fold(f64::INFINITY, f64::min)
    }
}
