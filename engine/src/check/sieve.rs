//! The check's own measure of the sieve size of a polyhedron.
//!
//! The shadow along `e3` fits a square whose sides have the directions `e1` and `e2`. For one side `e1` the other is
//! the least width of the outline across `e1`, which is that above an edge of the outline, so that
//!
//! ```text
//! D_s = min over e1 of max(width along e1, least width of the outline across e1)
//! ```
//!
//! The inner minimum is exact; the outer one is looked for over the half sphere, on rings of latitude and then by steps
//! from the best of them. Packing finds the same number by another search, over frames and by linear programmes.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::arrays::{self, Each as _};
use crate::elementary::{cos, sin, sin_cos};
use crate::shape::Polyhedron;
use crate::sorting;

/// Rings of latitude on the half sphere; as far apart as the directions on them.
const RINGS: usize = 26;
/// Most directions that the search goes on from.
const STARTS: usize = 60;
/// Openings after the coarse steps, over the least, that are followed to the end: more than these steps leave to gain.
const FINISHED: f64 = 1.01;
/// Angle by which these lie apart, in radians, and by which those that came to the same place do not.
const APART: f64 = 0.12;
const SAME: f64 = 3.0e-3;
/// Steps in radians: the first, the last of the coarse ones, the last.
const STEPS: [f64; 3] = [0.04, 1.0e-3, 2.0e-7];
/// Directions of a step.
const WAYS: usize = 16;
/// Steps in vain in turned directions before steps get shorter: of coarse ones and of others.
const TRIES: [usize; 2] = [2, 4];
/// A direction whose own width is so much more than the best opening is not followed.
const HOPELESS: f64 = 1.15;

/// Sine of the angle between an edge and an axis below which the edge lies along the axis.
const ALONG: f64 = 1.0e-9;

type V = Vector3<f64>;

/// Sieve size in units of the polyhedron.
pub(super) fn sieve_size(body: &Polyhedron) -> f64 {
    let corners = body.vertices();
    let mut outlines = Body::new(body);
    let mut best = f64::INFINITY;
    let mut widths: Vec<(f64, V)> = directions().map(|axis| (width(corners, &axis), axis)).collect();
    sorting::by_number(&mut widths, |(width, _)| *width);
    let mut found: Vec<(f64, V)> = Vec::new();
    for (width, axis) in widths {
        if width > HOPELESS * best {
            break;
        }
        let opening = outlines.opening(&axis, width);
        best = best.min(opening);
        found.push((opening, axis));
    }
    sorting::by_number(&mut found, |(opening, _)| *opening);
    let starts = apart(found, APART, STARTS);
    let mut search = |start: (f64, V), stage: usize| descend(&mut outlines, start, stage);
    let mut coarse: Vec<(f64, V)> = starts.into_iter().map(|start| search(start, 0)).collect();
    sorting::by_number(&mut coarse, |(opening, _)| *opening);
    let bound = FINISHED * coarse.first().map_or(f64::INFINITY, |start| start.0);
    coarse.retain(|start| start.0 <= bound);
    let fine = apart(coarse, SAME, STARTS).into_iter().map(|start| search(start, 1).0);
    fine.fold(f64::INFINITY, f64::min) + 2.0 * body.rounding()
}

/// The first directions that lie so far apart, in radians, up to a number of them.
fn apart(directions: Vec<(f64, V)>, angle: f64, most: usize) -> Vec<(f64, V)> {
    let chord2 = (2.0 * sin(angle / 2.0)).powi(2);
    let mut found: Vec<(f64, V)> = Vec::new();
    for candidate in directions {
        // A direction and its opposite are the same.
        let is_apart = |other: &(f64, V)| {
            let (difference, sum) = (candidate.1 - other.1, candidate.1 + other.1);
            difference.norm_squared().min(sum.norm_squared()) > chord2
        };
        if found.len() < most && found.iter().all(is_apart) {
            found.push(candidate);
        }
    }
    found
}

/// Steps from a direction to those of smaller openings, coarse ones in stage 0 and fine ones in stage 1.
fn descend(body: &mut Body<'_>, (mut best, mut axis): (f64, V), stage: usize) -> (f64, V) {
    let ways: [(f64, f64); WAYS] =
        arrays::from_fn(|way| sin_cos(std::f64::consts::TAU * way as f64 / WAYS as f64));
    let (mut step, mut turn, mut in_vain) = (STEPS[stage], 0.0_f64, 0);
    while step > STEPS[stage + 1] {
        let [u, v] = frame(&axis);
        let before = best;
        let (sin, cos) = sin_cos(turn);
        for (sin_of_way, cos_of_way) in ways {
            let way = u * (cos * cos_of_way - sin * sin_of_way) + v * (sin * cos_of_way + cos * sin_of_way);
            let next = (axis + way * step).normalize();
            let width = width(body.corners, &next);
            if width < best {
                let opening = body.opening(&next, width);
                if opening < best {
                    (best, axis) = (opening, next);
                }
            }
        }
        // Other ways each time, so that no narrow valley lies between them for ever.
        turn += 1.0;
        in_vain = if best < before { 0 } else { in_vain + 1 };
        if in_vain >= TRIES[stage] {
            step *= 0.5;
            in_vain = 0;
        }
    }
    (best, axis)
}

fn width(corners: &[V], axis: &V) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for corner in corners {
        let height = product(corner, axis);
        low = if height < low { height } else { low };
        high = if height > high { height } else { high };
    }
    high - low
}

/// Directions that fill the half sphere evenly.
fn directions() -> impl Iterator<Item = V> {
    (0..RINGS).flat_map(|ring| {
        let polar = std::f64::consts::FRAC_PI_2 * (ring as f64 + 0.5) / RINGS as f64;
        let n = (4.0 * RINGS as f64 * sin(polar)).ceil();
        (0..n as usize).map(move |i| {
            let angle = std::f64::consts::TAU * (i as f64 + 0.5 * (ring % 2) as f64) / n;
            V::new(sin(polar) * cos(angle), sin(polar) * sin(angle), cos(polar))
        })
    })
}

/// Two unit vectors at right angles to a unit vector and to each other.
fn frame(axis: &V) -> [V; 2] {
    let least = axis.iamin();
    let other = V::from_fn(|i, _| if i == least { 1.0 } else { 0.0 });
    let u = axis.cross(&other).normalize();
    [u, axis.cross(&u)]
}

/// An edge between two faces.
struct Edge {
    ends: [u32; 2],
    /// The face that it goes around counter-clockwise, from the first end to the second, and the other one.
    faces: [u32; 2],
    length2: f64,
}

/// What outlines are found from.
struct Body<'a> {
    corners: &'a [V],
    /// Normals of the faces, of any length.
    normals: Vec<V>,
    edges: Vec<Edge>,
    /// Kept for the next axis: whether each face is turned towards the axis, the corners as seen along it, those of
    /// the outline, and its edges as vectors there.
    is_front: Vec<bool>,
    seen: Vec<[f64; 2]>,
    outline: Vec<[f64; 2]>,
    sides: Vec<[f64; 2]>,
}

impl<'a> Body<'a> {
    fn new(body: &'a Polyhedron) -> Self {
        let corners = body.vertices();
        let at = |v: u32| corners[v as usize];
        let normal = |face: &Vec<u32>| {
            face[1..].windows(2).map(|p| (at(p[0]) - at(face[0])).cross(&(at(p[1]) - at(face[0])))).sum::<V>()
        };
        let mut open: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut edges = Vec::new();
        for (face, vertices) in body.faces().iter().enumerate() {
            for (i, &from) in vertices.iter().enumerate() {
                let to = vertices[(i + 1) % vertices.len()];
                match open.remove(&[to, from]) {
                    Some(other) => {
                        let length2 = (at(to) - at(from)).norm_squared();
                        edges.push(Edge { ends: [from, to], faces: [face as u32, other], length2 });
                    }
                    None => drop(open.insert([from, to], face as u32)),
                }
            }
        }
        let normals: Vec<V> = body.faces().iter().map(normal).collect();
        let (is_front, seen) = (vec![false; normals.len()], vec![[0.0; 2]; corners.len()]);
        Self { corners, normals, edges, is_front, seen, outline: Vec::new(), sides: Vec::new() }
    }

    /// The side of the square for a side of a direction along which the body has this width: that width, or the least
    /// width of the outline across the direction where it is more.
    ///
    /// The latter is the extent of the outline at right angles to one of its edges, of the edge where that is least.
    /// The outline has the edges between a face that is turned towards the axis and one that is not; a face along the
    /// axis may count as either.
    fn opening(&mut self, axis: &V, width: f64) -> f64 {
        let [u, v] = frame(axis);
        for (is_front, normal) in self.is_front.iter_mut().zip(&self.normals) {
            *is_front = product(normal, axis) > 0.0;
        }
        for (seen, corner) in self.seen.iter_mut().zip(self.corners) {
            *seen = [product(corner, &u), product(corner, &v)];
        }
        self.sides.clear();
        self.outline.clear();
        for Edge { ends, faces: [left, right], length2 } in &self.edges {
            let is_front = self.is_front[*left as usize];
            if is_front == self.is_front[*right as usize] {
                continue;
            }
            let [from, to] = ends.each(|end| self.seen[end as usize]);
            // With the faces that are turned towards the axis on its left, each corner is where one edge begins.
            self.outline.push(if is_front { from } else { to });
            let side = [to[0] - from[0], to[1] - from[1]];
            // An edge along the axis is a corner of the outline, and has no direction in it.
            if side[0] * side[0] + side[1] * side[1] > ALONG * ALONG * length2 {
                self.sides.push(side);
            }
        }
        // The least width as its square times that of the length of the side, and the latter.
        let (mut least2, mut of_length2) = (f64::INFINITY, 1.0);
        for [x, y] in &self.sides {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for seen in &self.outline {
                let height = seen[1] * x - seen[0] * y;
                low = if height < low { height } else { low };
                high = if height > high { height } else { high };
            }
            let (extent2, length2) = ((high - low) * (high - low), x * x + y * y);
            if extent2 <= width * width * length2 {
                return width;
            }
            if extent2 * of_length2 < least2 * length2 {
                (least2, of_length2) = (extent2, length2);
            }
        }
        (least2 / of_length2).sqrt()
    }
}

/// The product of two vectors, written out: it is not inlined in every build otherwise.
#[inline(always)]
#[allow(clippy::inline_always)]
fn product(a: &V, b: &V) -> f64 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream};
    use crate::shape::Form;
    use crate::shape::polyhedron::{TemplateKind, draw_template};

    fn cuboid(edges: [f64; 3]) -> Polyhedron {
        let corner = |i: usize| V::from_fn(|axis, _| if i >> axis & 1 == 1 { edges[axis] } else { 0.0 });
        Polyhedron::hull_of(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_cuboid_passes_upright_or_turned() {
        for [b, c] in [[1.0, 1.0], [1.0, 0.8], [1.0, 0.5], [1.0, 0.3], [1.0, 0.1_f64]] {
            let known = f64::min(b, (b + c) / 2.0_f64.sqrt());
            let found = sieve_size(&cuboid([3.0, b, c]));
            assert!((found - known).abs() < 1e-6, "{found} {known}");
        }
    }

    /// The two searches find the same size: that of packing is neither too large nor too small.
    #[test]
    fn templates_of_all_kinds_have_the_sieve_size_that_packing_finds() {
        let mut rng = stream(1, Stream::Shape);
        let kinds = [
            TemplateKind::Cuts(6),
            TemplateKind::Cuts(12),
            TemplateKind::Cuts(24),
            TemplateKind::Cuts(60),
            TemplateKind::Cuboid(0.0),
            TemplateKind::Cuboid(0.2),
            TemplateKind::Cuboid(0.4),
            TemplateKind::Voronoi,
        ];
        let n: usize = std::env::var("TEMPLATES").map_or(3, |n| n.parse().unwrap());
        for kind in kinds {
            for axes in [[1.0, 1.0, 1.0], [1.5, 1.2, 1.0], [10.0, 9.0, 1.0], [10.0, 1.2, 1.0]] {
                let (mut larger, mut smaller): (f64, f64) = (0.0, 0.0);
                for _ in 0..n {
                    let body = draw_template(kind, Form::of_axes(axes), &mut rng).unwrap();
                    let (here, there) = (sieve_size(&body), body.sieve_size());
                    larger = larger.max(there / here - 1.0);
                    smaller = smaller.max(here / there - 1.0);
                }
                println!("{kind:?} {axes:?}: {larger:e} {smaller:e}");
                assert!(larger < 2e-6 && smaller < 5e-6, "{kind:?} {axes:?}: {larger:e} {smaller:e}");
            }
        }
    }
}
