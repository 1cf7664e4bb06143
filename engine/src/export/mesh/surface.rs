//! A closed triangulated surface that is refined where it has to be, and stays closed.
//!
//! Triangles are split at the middle of their longest edge, and with each the one behind that edge (Rivara
//! 1984, longest-edge bisection): no vertex ever hangs on an edge, the refinement spreads no further than it
//! must, and no angle falls below half of the smallest that the surface began with. Afterwards edges are
//! flipped until the surface is Delaunay's (Lawson 1977); on a sphere that is the convex hull of its
//! vertices, and it has to be: beyond an edge that is dented inwards, the mesher is left with a tetrahedron
//! as flat as the dent, unless the other diagonal is far from Delaunay's.

use std::f64::consts::PI;

use crate::arrays::{self, Each as _};
use crate::elementary::atan2;
use crate::gap::linear::{cross, distance2, dot};

/// Most flips of edges for each triangle; Delaunay's surfaces take a few.
const MOST_FLIPS: usize = 30;

/// Where new vertices go, how long edges may be, and which of two diagonals is the right one.
pub(super) trait Shape {
    /// The vertex between two neighbours, on the surface meant.
    fn between(&mut self, a: u32, b: u32, points: &[[f64; 3]]) -> [f64; 3];
    /// Where a vertex lies in mm, of a surface that is kept as its image on another one.
    fn place(&self, p: [f64; 3]) -> [f64; 3] {
        p
    }
    /// Whether a triangle with this centroid and longest edge is too large for its place.
    fn wants_shorter(&self, centroid: [f64; 3], longest_mm: f64) -> bool;
    /// The longest that an edge may be of a triangle of that patch, beside what is asked for by its place.
    fn most_mm(&self, _patch: u32) -> f64 {
        f64::INFINITY
    }
    /// Whether edge ab, between triangles abc and bad, should be edge cd instead.
    fn is_wrong(&self, edge: [u32; 2], beside: [u32; 2], points: &[[f64; 3]]) -> bool;
}

/// The surface. Triangles turn anticlockwise for who looks from outside.
#[derive(Clone, Debug, Default)]
pub(super) struct Surface {
    /// Vertices in mm.
    pub(super) points: Vec<[f64; 3]>,
    /// Corners of the triangles.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The triangles behind the edges 01, 12 and 20.
    behind: Vec<[u32; 3]>,
    /// The patch of each triangle, such as a face of a polyhedron. Edges between two patches are never flipped. Empty
    /// where there is one patch.
    patches: Vec<u32>,
}

impl Surface {
    /// A closed surface of these triangles; every edge must be that of two.
    pub(super) fn new(points: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Self {
        // (smaller vertex, larger vertex, triangle, edge), so that the two sides of an edge are neighbours in
        // order.
        let mut sides: Vec<(u32, u32, u32, u8)> = Vec::with_capacity(3 * triangles.len());
        for (t, corners) in triangles.iter().enumerate() {
            for edge in 0..3 {
                let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
                sides.push((a.min(b), a.max(b), t as u32, edge as u8));
            }
        }
        sides.sort_unstable();
        let mut behind = vec![[u32::MAX; 3]; triangles.len()];
        for pair in sides.chunks_exact(2) {
            let [one, two] = [pair[0], pair[1]];
            debug_assert_eq!((one.0, one.1), (two.0, two.1), "an edge of one triangle alone");
            behind[one.2 as usize][usize::from(one.3)] = two.2;
            behind[two.2 as usize][usize::from(two.3)] = one.2;
        }
        Self { points, triangles, behind, patches: Vec::new() }
    }

    /// The same, with the patch of each triangle.
    pub(super) fn of_patches(points: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>, patches: Vec<u32>) -> Self {
        Self { patches, ..Self::new(points, triangles) }
    }

    /// The patch of a triangle.
    pub(super) fn patch(&self, triangle: usize) -> u32 {
        self.patches.get(triangle).copied().unwrap_or(0)
    }

    /// Splits triangles until none has a longer edge than its shape wants, and flips what edges are wrong
    /// then. `false` when that would take more than `most_triangles`.
    pub(super) fn refine(&mut self, shape: &mut impl Shape, most_triangles: usize) -> bool {
        let mut t = 0;
        // Those that come from a split stand behind, and are looked at in their turn.
        while t < self.triangles.len() {
            while self.is_too_long(t, shape) {
                if self.triangles.len() + 2 > most_triangles {
                    return false;
                }
                self.split(t as u32, shape);
            }
            t += 1;
        }
        self.flip(shape);
        true
    }

    /// Flips edges until none is wrong, or so many times that the criterion seems to go round in circles; says whether
    /// there was one.
    pub(super) fn flip(&mut self, shape: &impl Shape) -> bool {
        let mut flips = 0;
        let most = MOST_FLIPS * self.triangles.len();
        let mut open: Vec<u32> = (0..self.triangles.len() as u32).rev().collect();
        while let Some(t) = open.pop().filter(|_| flips < most) {
            for edge in 0..3 {
                let [a, b, c] = [0, 1, 2].each(|k| self.triangles[t as usize][(edge + k) % 3]);
                let other = self.behind[t as usize][edge];
                let Some(back) = (0..3).find(|&k| self.same_edge(t, edge, other, k)) else { continue };
                let d = self.triangles[other as usize][(back + 2) % 3];
                let is_inside = self.patch(t as usize) == self.patch(other as usize);
                if is_inside && shape.is_wrong([a, b], [c, d], &self.points) && !self.are_neighbours(t, c, d)
                {
                    let [_, bc, ca] = [0, 1, 2].each(|k| self.behind[t as usize][(edge + k) % 3]);
                    let [_, ad, db] = [0, 1, 2].each(|k| self.behind[other as usize][(back + k) % 3]);
                    self.triangles[t as usize] = [a, d, c];
                    self.behind[t as usize] = [ad, other, ca];
                    self.triangles[other as usize] = [d, b, c];
                    self.behind[other as usize] = [db, bc, t];
                    self.rename(ad, [d, a], t);
                    self.rename(bc, [c, b], other);
                    open.extend([other, t]);
                    flips += 1;
                    break;
                }
            }
        }
        flips > 0
    }

    /// Whether two vertices have an edge, the first of which is a corner of that triangle.
    fn are_neighbours(&self, t: u32, c: u32, d: u32) -> bool {
        let mut at = t;
        loop {
            let corners = self.triangles[at as usize];
            if corners.contains(&d) {
                return true;
            }
            let Some(k) = corners.iter().position(|p| *p == c) else { return true };
            at = self.behind[at as usize][k];
            if at == t {
                return false;
            }
        }
    }

    /// Tells a triangle what now lies behind its edge from one vertex to another.
    fn rename(&mut self, t: u32, [from, to]: [u32; 2], behind: u32) {
        let corners = self.triangles[t as usize];
        for edge in 0..3 {
            if corners[edge] == from && corners[(edge + 1) % 3] == to {
                self.behind[t as usize][edge] = behind;
            }
        }
    }

    fn is_too_long(&self, t: usize, shape: &impl Shape) -> bool {
        let [a, b, c] = self.triangles[t].each(|p| shape.place(self.points[p as usize]));
        let longest_mm = distance2(a, b).max(distance2(b, c)).max(distance2(c, a)).sqrt();
        let centroid = arrays::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0);
        longest_mm > shape.most_mm(self.patch(t)) || shape.wants_shorter(centroid, longest_mm)
    }

    /// The edge that a triangle is split at. Two triangles agree about which of two edges is longer, for
    /// equal lengths are ordered by their vertices.
    fn longest(&self, t: u32) -> usize {
        let corners = self.triangles[t as usize];
        let measure = |edge: usize| {
            let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
            // From the smaller vertex to the larger, or rounding could differ from side to side.
            let (a, b) = (a.min(b), a.max(b));
            (distance2(self.points[a as usize], self.points[b as usize]), a, b)
        };
        let mut longest = 0;
        for edge in 1..3 {
            let ((l, a, b), (m, c, d)) = (measure(edge), measure(longest));
            if (l, (a, b)) > (m, (c, d)) {
                longest = edge;
            }
        }
        longest
    }

    /// Splits one triangle at its longest edge, after those behind it that have to be split before.
    fn split(&mut self, t: u32, shape: &mut impl Shape) {
        let mut path = vec![t];
        while let Some(&last) = path.last() {
            let edge = self.longest(last);
            let other = self.behind[last as usize][edge];
            let back = self.longest(other);
            if self.behind[other as usize][back] == last && self.same_edge(last, edge, other, back) {
                self.bisect(last, edge, other, back, shape);
                path.pop();
            } else {
                path.push(other);
            }
        }
    }

    fn same_edge(&self, t: u32, edge: usize, other: u32, back: usize) -> bool {
        let (one, two) = (self.triangles[t as usize], self.triangles[other as usize]);
        one[edge] == two[(back + 1) % 3] && one[(edge + 1) % 3] == two[back]
    }

    /// Splits the two triangles of an edge at its middle.
    fn bisect(&mut self, t: u32, edge: usize, other: u32, back: usize, shape: &mut impl Shape) {
        let corners = self.triangles[t as usize];
        let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
        let middle = self.points.len() as u32;
        let point = shape.between(a, b, &self.points);
        self.points.push(point);
        let (new, far) = (self.triangles.len() as u32, self.triangles.len() as u32 + 1);
        self.halve(t, edge, middle, new);
        self.halve(other, back, middle, far);
        // Each kept triangle has the first corner of its edge; those of the two sides lie at opposite ends.
        self.behind[t as usize][edge] = far;
        self.behind[far as usize][0] = t;
        self.behind[other as usize][back] = new;
        self.behind[new as usize][0] = other;
    }

    /// Makes of triangle abc, split at ab, the triangle amc in its place and the new one mbc.
    fn halve(&mut self, t: u32, edge: usize, middle: u32, new: u32) {
        let (second, third) = ((edge + 1) % 3, (edge + 2) % 3);
        let corners = self.triangles[t as usize];
        let beyond = self.behind[t as usize][second];
        self.triangles[t as usize][second] = middle;
        self.behind[t as usize][second] = new;
        self.triangles.push([middle, corners[second], corners[third]]);
        self.behind.push([u32::MAX, beyond, t]);
        if !self.patches.is_empty() {
            self.patches.push(self.patch(t as usize));
        }
        self.rename(beyond, [corners[third], corners[second]], new);
    }

    /// Volume inside, in mm³.
    pub(super) fn volume_mm3(&self) -> f64 {
        let six: f64 = self
            .triangles
            .iter()
            .map(|corners| {
                let [a, b, c] = corners.each(|p| self.points[p as usize]);
                dot(a, cross(b, c))
            })
            .sum();
        six / 6.0
    }

    /// Shortest and longest edge, in mm.
    pub(super) fn edges_mm(&self) -> (f64, f64) {
        let mut range = (f64::INFINITY, 0.0_f64);
        for corners in &self.triangles {
            for edge in 0..3 {
                let [a, b] = [corners[edge], corners[(edge + 1) % 3]].each(|p| self.points[p as usize]);
                let length2 = distance2(a, b);
                range = (range.0.min(length2), range.1.max(length2));
            }
        }
        (range.0.sqrt(), range.1.sqrt())
    }
}

/// Whether the angles of two triangles opposite to the edge that they share make more than half a turn: by Delaunay's
/// criterion they should have the other diagonal. Each triangle by its other two sides, from the corner opposite to the
/// edge.
pub(super) fn make_more_than_half_a_turn(one: [[f64; 3]; 2], other: [[f64; 3]; 2]) -> bool {
    // Two angles of a quarter of a turn at most: the most frequent case.
    [one, other].iter().any(|[p, q]| dot(*p, *q) < 0.0) && angle(one) + angle(other) > PI + 1e-9
}

/// The angle between two vectors.
pub(super) fn angle([p, q]: [[f64; 3]; 2]) -> f64 {
    let normal = cross(p, q);
    atan2(dot(normal, normal).sqrt(), dot(p, q))
}
