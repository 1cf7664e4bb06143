//! The unit sphere as an inscribed polyhedron of nearly equal triangles, in any fineness.
//!
//! Geodesic polyhedra of the icosahedron (Caspar and Klug 1962, Cold Spring Harbor Symposia 27): a face is the triangle
//! from 0 to `(b, c)` of the triangular lattice, which holds `T = b^2 + b c + c^2` lattice triangles. The polyhedron
//! has `20 T` triangles and `10 T + 2` vertices. All pairs `b >= c >= 0` are used, so that `T` is 1, 3, 4, 7, 9, 12,
//! 13, 16, 19, 21 and so on, and the fineness changes in small steps.

use std::collections::{HashMap, HashSet};

use super::surface::Surface;
use crate::arrays::Each as _;
use crate::elementary::sin_cos;
use crate::gap::linear::{cross, distance2, dot, unit};

/// Segments of a great circle of a polyhedron with `T = 1`. A polyhedron of `20 T` equal triangles on the unit sphere
/// has edges of `sqrt(4 pi / (5 sqrt(3) T))`, that is `1.2046 / sqrt(T)`.
const SEGMENTS_PER_ROOT: f64 = 5.216;

/// Largest `b + c` that is tried: beyond what 256 segments need.
const MOST_STEPS: i64 = 60;

/// The lattice vector from one corner of a face of the icosahedron to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Fineness {
    b: i64,
    c: i64,
}

/// All finenesses up to what 256 segments need, from coarse to fine.
#[derive(Clone, Debug)]
pub(super) struct Finenesses(Vec<Fineness>);

impl Finenesses {
    pub(super) fn new() -> Self {
        let pairs =
            (1..=MOST_STEPS).flat_map(|b| (0..=b.min(MOST_STEPS - b)).map(move |c| Fineness { b, c }));
        let mut all: Vec<Fineness> = pairs.collect();
        all.sort_by_key(|fineness| (fineness.per_face(), fineness.c));
        all.dedup_by_key(|fineness| fineness.per_face());
        Self(all)
    }

    /// The one whose great circles have the number of segments nearest to that.
    pub(super) fn nearest(&self, segments: f64) -> Fineness {
        let above = self.0.partition_point(|fineness| fineness.segments() < segments);
        let around = &self.0[above.saturating_sub(1)..(above + 1).min(self.0.len())];
        let off = |fineness: &&Fineness| (fineness.segments() - segments).abs();
        around.iter().min_by(|x, y| off(x).total_cmp(&off(y))).copied().unwrap_or(Fineness { b: 1, c: 0 })
    }
}

impl Fineness {
    /// The icosahedron.
    pub(super) const ICOSAHEDRON: Self = Self { b: 1, c: 0 };

    /// Lattice triangles of a face of the icosahedron.
    fn per_face(self) -> i64 {
        self.b * self.b + self.b * self.c + self.c * self.c
    }

    /// Triangles of the polyhedron.
    pub(super) fn triangles(self) -> u64 {
        20 * self.per_face() as u64
    }

    /// Segments of a great circle.
    pub(super) fn segments(self) -> f64 {
        SEGMENTS_PER_ROOT * (self.per_face() as f64).sqrt()
    }

    /// The polyhedron, its vertices on the unit sphere.
    pub(super) fn polyhedron(self) -> Surface {
        let corners = icosahedron();
        let mut vertices = Vertices { corners: &corners, known: HashMap::new(), points: Vec::new() };
        let mut met = HashSet::new();
        let mut triangles = Vec::new();
        for face in faces(&corners) {
            for place in self.places(&face) {
                let corners = place.each(|weights| vertices.at(weights));
                // A triangle across an edge of the icosahedron is met from both sides.
                let mut name = corners;
                name.sort_unstable();
                if met.insert(name) {
                    triangles.push(corners);
                }
            }
        }
        Surface::new(vertices.points, triangles)
    }

    /// The lattice triangles with their centroid in a face, each corner by the weights of corners of the icosahedron.
    fn places(self, face: &Face) -> Vec<[Weights; 3]> {
        let Self { b, c } = self;
        let mut found = Vec::new();
        for j in -1..=b + c {
            for i in -c - 1..=b {
                for [p, q, r] in [[(i, j), (i + 1, j), (i, j + 1)], [(i + 1, j), (i + 1, j + 1), (i, j + 1)]]
                {
                    let weights = [p, q, r].each(|place| self.weights(place));
                    let inside = (0..3).all(|k| weights.iter().map(|w| w[k]).sum::<i64>() >= 0);
                    if inside {
                        found.push(weights.each(|w| face.weights(w)));
                    }
                }
            }
        }
        found
    }

    /// Barycentric coordinates of a lattice point in the triangle of a face, times `T`. The second corner lies at
    /// `(b, c)`, the third at `(-c, b + c)`.
    fn weights(self, (i, j): (i64, i64)) -> [i64; 3] {
        let Self { b, c } = self;
        let second = i * (b + c) + j * c;
        let third = b * j - c * i;
        [self.per_face() - second - third, second, third]
    }
}

/// Corners of the icosahedron with positive weights, in the order of their numbers; the rest is padding.
type Weights = [(usize, i64); 3];
const PADDING: (usize, i64) = (usize::MAX, 0);

/// A face of the icosahedron: its corners anticlockwise from outside, and the corners beyond its edges.
struct Face {
    corners: [usize; 3],
    /// The corner beyond the edge opposite to each corner.
    beyond: [usize; 3],
}

impl Face {
    /// The weights of corners of the icosahedron at a point of the lattice of this face. A point beyond an edge lies in
    /// the next face, whose lattice is this one turned by half a turn about the middle of the edge.
    fn weights(&self, mut w: [i64; 3]) -> Weights {
        let mut corners = self.corners;
        if let Some(k) = (0..3).find(|&k| w[k] < 0) {
            let out = w[k];
            w[(k + 1) % 3] += out;
            w[(k + 2) % 3] += out;
            w[k] = -out;
            corners[k] = self.beyond[k];
        }
        debug_assert!(w.iter().all(|&w| w >= 0), "a triangle reaches beyond two edges of a face");
        let mut name = [0, 1, 2].each(|k| if w[k] > 0 { (corners[k], w[k]) } else { PADDING });
        name.sort_unstable();
        name
    }
}

/// The faces of the icosahedron.
fn faces(corners: &[[f64; 3]; 12]) -> Vec<Face> {
    let edge2 = (1..12).map(|i| distance2(corners[0], corners[i])).fold(f64::INFINITY, f64::min);
    let near = |i: usize, j: usize| i != j && distance2(corners[i], corners[j]) < 1.1 * edge2;
    let mut found = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(k, i) {
                    let [a, b, c] = [corners[i], corners[j], corners[k]];
                    let face = if dot(a, cross(b, c)) > 0.0 { [i, j, k] } else { [i, k, j] };
                    // Two corners are near both ends of an edge: the face's third, and the one beyond.
                    let beyond = [0, 1, 2].each(|n| {
                        let [own, p, q] = [0, 1, 2].each(|m| face[(n + m) % 3]);
                        (0..12).find(|&x| x != own && near(x, p) && near(x, q)).unwrap_or(own)
                    });
                    found.push(Face { corners: face, beyond });
                }
            }
        }
    }
    found
}

/// Vertices by the corners that carry their weight, so that those on edges of the icosahedron are met once.
struct Vertices<'a> {
    corners: &'a [[f64; 3]; 12],
    known: HashMap<Weights, u32>,
    points: Vec<[f64; 3]>,
}

impl Vertices<'_> {
    fn at(&mut self, weights: Weights) -> u32 {
        *self.known.entry(weights).or_insert_with(|| {
            let mut p = [0.0; 3];
            for &(corner, weight) in weights.iter().filter(|(_, weight)| *weight > 0) {
                for (sum, x) in p.iter_mut().zip(self.corners[corner]) {
                    *sum += weight as f64 * x;
                }
            }
            self.points.push(unit(p));
            self.points.len() as u32 - 1
        })
    }
}

/// The twelve vertices of the icosahedron, turned so that none lies on an axis: grains that touch a wall touch it
/// there.
fn icosahedron() -> [[f64; 3]; 12] {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut corners = [[0.0; 3]; 12];
    let signs = [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)];
    for (i, corner) in corners.iter_mut().enumerate() {
        let (one, long) = signs[i % 4];
        let axis = i / 4;
        corner[(axis + 1) % 3] = one;
        corner[(axis + 2) % 3] = long;
    }
    corners.each(|p| unit(turned(p)))
}

/// Turned about z and then x, by angles that bring the middles of faces near the axes and no vertex onto one.
fn turned([x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = sin_cos(0.35);
    let (x, y) = (cos * x - sin * y, sin * x + cos * y);
    let (sin, cos) = sin_cos(0.60);
    [x, cos * y - sin * z, sin * y + cos * z]
}
