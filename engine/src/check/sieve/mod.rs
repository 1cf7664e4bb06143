//! The check's own measure of the sieve size of a polyhedron, with the proof that there is no smaller one.
//!
//! The sieve size is the side of the least square that the shadow of the body passes along some direction: the least,
//! over all pairs of unit directions `e1` and `e2` at right angles, of the larger width along them. The rotations that
//! carry the axes to such a pair are written as `q = (1, p)` with a vector `p` of three numbers (O. Rodrigues 1840), so
//! that `e_k = N_k(p) / (1 + |p|²)` with quadratic functions `N_k`. The body is no wider than `s` along both if and
//! only if for each difference `d` of two corners, and for both directions,
//!
//! ```text
//! Q(p) = d . N_k(p) - s (1 + |p|²) <= 0
//! ```
//!
//! In a box about `p0` with half sides `h`, `Q(p0 + u) >= Q(p0) + grad Q(p0) . u - (|d| + s) |h|²` holds exactly. Where
//! the largest of some of these linear functions is positive in all of the box (`linear`), no square of side `s` exists
//! for it. Boxes that are not proven empty so are divided (branch and bound; A. H. Land, A. G. Doig, Econometrica 28,
//! 497-520, 1960, DOI 10.2307/1910129), and squares that are found on the way become the new `s`. What is returned is
//! the side of a square that the body passes, and proven to be the least but for a share of 1e-10.
//!
//! Packing finds the same number by another search, over turns of frames, which proves nothing.

mod caps;
mod linear;

use nalgebra::Vector3;

use crate::shape::Polyhedron;
use crate::sorting;
use caps::Cap;
use linear::{Linear, lower_bound};

/// By what share no smaller square is looked for.
const TOLERANCE: f64 = 1.0e-10;
/// Boxes that the search starts with, along each coordinate.
const BOXES: [usize; 3] = [8, 8, 3];
/// Largest coordinates, up to the symmetry of a square: each pair of directions, up to their order and signs, is that
/// of eight rotations, of which one has the largest real part. They are `tan(90°/2)` and `tan(45°/2)`.
const FARTHEST: [f64; 3] = [1.0, 1.0, std::f64::consts::SQRT_2 - 1.0];
/// Linear programmes of a box, each with the corners at the ends of the widths where the last one was least.
const ROUNDS: usize = 5;
/// Differences that a half of a box takes over.
const KEPT: usize = 10;
/// Half sides of boxes below which caps about their directions are looked for, one after the other.
const CAP_SIZES: [f64; 4] = [0.03, 3.0e-3, 3.0e-4, 3.0e-5];
/// Widths over the side of the square from which on no cap is looked for.
const NARROW: f64 = 1.05;
/// Most boxes. A body that needs more is one of very many equal squares, of which the best is returned.
const MOST_BOXES: usize = 400_000;

type V = Vector3<f64>;

/// Side of the least square that the body passes, in units of the polyhedron.
pub(super) fn sieve_size(body: &Polyhedron) -> f64 {
    Search::new(body.vertices()).least() + 2.0 * body.rounding()
}

/// Whether a body passes a square of a side whose sides have two directions: these are at right angles, and the body is
/// no wider along them. `error` is the largest relative error of the side.
pub(super) fn passes(body: &Polyhedron, side: f64, directions: &[V; 2], error: f64) -> bool {
    let [first, second] = directions;
    let is_unit = |axis: &V| (axis.norm() - 1.0).abs() <= error;
    let widest = side * (1.0 + error) - 2.0 * body.rounding();
    is_unit(first)
        && is_unit(second)
        && first.dot(second).abs() <= error
        && directions.iter().all(|axis| ends(body.vertices(), axis).1 <= widest)
}

/// The corners with the least and the largest coordinate along a direction, and their distance along it.
fn ends(corners: &[V], axis: &V) -> ([u32; 2], f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut lowest, mut highest) = (0, 0);
    for (i, corner) in corners.iter().enumerate() {
        let height = product(corner, axis);
        if height < low {
            (low, lowest) = (height, i as u32);
        }
        if height > high {
            (high, highest) = (height, i as u32);
        }
    }
    ([lowest, highest], high - low)
}

/// Two unit vectors at right angles to a unit vector and to each other.
fn frame_of(axis: &V) -> [V; 2] {
    let least = axis.iamin();
    let other = V::from_fn(|i, _| if i == least { 1.0 } else { 0.0 });
    let u = axis.cross(&other).normalize();
    [u, axis.cross(&u)]
}

/// The product of two vectors, written out: it is not inlined in every build otherwise.
#[inline(always)]
fn product(a: &V, b: &V) -> f64 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// The two directions of a rotation.
fn directions(p: &V) -> [V; 2] {
    let [x, y, z] = [p.x, p.y, p.z];
    let norm2 = 1.0 + p.norm_squared();
    [
        V::new(1.0 + x * x - y * y - z * z, 2.0 * (x * y + z), 2.0 * (x * z - y)) / norm2,
        V::new(2.0 * (x * y - z), 1.0 - x * x + y * y - z * z, 2.0 * (y * z + x)) / norm2,
    ]
}

/// A difference of two corners along one of the two directions.
#[derive(Clone, Copy, PartialEq)]
struct Difference {
    direction: usize,
    from: u32,
    to: u32,
}

/// Rotations whose `p` lies in a box.
struct Rotations {
    center: V,
    half: V,
    /// Differences that were found in the box that this one is a part of.
    known: Vec<Difference>,
    /// How many of [`CAP_SIZES`] the box has passed.
    caps_sought: usize,
}

struct Search<'a> {
    corners: &'a [V],
    /// Side of the least square that was found.
    side: f64,
    caps: Vec<Cap>,
    /// Boxes that were looked at.
    looked_at: usize,
}

impl<'a> Search<'a> {
    fn new(corners: &'a [V]) -> Self {
        Self { corners, side: f64::INFINITY, caps: Vec::new(), looked_at: 0 }
    }

    /// The side of the least square.
    fn least(&mut self) -> f64 {
        let half = V::from_fn(|axis, _| FARTHEST[axis] / BOXES[axis] as f64);
        let mut boxes: Vec<(f64, Rotations)> = Vec::new();
        for index in 0..BOXES.iter().product() {
            let [nx, ny, _] = BOXES;
            let index = [index % nx, index / nx % ny, index / (nx * ny)];
            let center = V::from_fn(|axis, _| half[axis] * (2 * index[axis] + 1) as f64 - FARTHEST[axis]);
            let least_sum = center.x.abs() - half.x + center.y.abs() - half.y;
            // Another of the eight rotations has a larger real part.
            if least_sum > std::f64::consts::SQRT_2 {
                continue;
            }
            let rotations = Rotations { center, half, known: Vec::new(), caps_sought: 0 };
            boxes.push((self.opening(&center), rotations));
        }
        sorting::by_number(&mut boxes, |(opening, _)| -opening);
        while let Some((_, rotations)) = boxes.pop() {
            self.looked_at += 1;
            if self.looked_at >= MOST_BOXES {
                break;
            }
            if let Some(mut halves) = self.divide(rotations) {
                sorting::by_number(&mut halves, |(opening, _)| -opening);
                boxes.extend(halves);
            }
        }
        self.side
    }

    /// The side of the square of a rotation.
    fn opening(&mut self, p: &V) -> f64 {
        let [first, second] = directions(p);
        let opening = ends(self.corners, &first).1.max(ends(self.corners, &second).1);
        self.side = self.side.min(opening);
        opening
    }

    /// Side below which squares are looked for.
    fn wanted(&self) -> f64 {
        self.side * (1.0 - TOLERANCE)
    }

    /// The halves of a box with the openings at their centres, unless no rotation in it has a smaller square.
    fn divide(&mut self, mut rotations: Rotations) -> Option<Vec<(f64, Rotations)>> {
        if self.is_in_cap(&rotations) {
            return None;
        }
        let Rotations { center, half, .. } = rotations;
        self.look(&center, &mut rotations.known);
        let mut place = center;
        for _ in 0..ROUNDS {
            let functions = rotations.known.iter().map(|known| self.function(known, &rotations));
            let bound = lower_bound(&functions.collect::<Vec<_>>())?;
            if bound.least > 0.0 {
                return None;
            }
            place = center + V::from(bound.at).component_mul(&half);
            if !self.look(&place, &mut rotations.known) {
                break;
            }
        }
        self.seek_caps(&mut rotations, &place);
        if self.is_in_cap(&rotations) {
            return None;
        }
        // The differences that are largest where the last programme was least.
        let mut known: Vec<(f64, Difference)> =
            rotations.known.iter().map(|known| (self.excess(known, &place), *known)).collect();
        sorting::by_number(&mut known, |(excess, _)| -excess);
        known.truncate(KEPT);
        let known: Vec<Difference> = known.into_iter().map(|(_, known)| known).collect();
        let axis = half.imax();
        let mut part = half;
        part[axis] *= 0.5;
        let halves = [-1.0, 1.0].map(|sign| {
            let mut center = center;
            center[axis] += sign * part[axis];
            let caps_sought = rotations.caps_sought;
            (self.opening(&center), Rotations { center, half: part, known: known.clone(), caps_sought })
        });
        Some(halves.into())
    }

    /// Adds the differences at the ends of the widths of a rotation; whether there are new ones.
    fn look(&mut self, p: &V, known: &mut Vec<Difference>) -> bool {
        let before = known.len();
        let mut opening = 0.0_f64;
        for (direction, axis) in directions(p).iter().enumerate() {
            let ([from, to], width) = ends(self.corners, axis);
            opening = opening.max(width);
            let difference = Difference { direction, from, to };
            if !known.contains(&difference) {
                known.push(difference);
            }
        }
        self.side = self.side.min(opening);
        known.len() > before
    }

    /// How much a difference exceeds a square at a rotation: `Q / (1 + |p|²)`.
    fn excess(&self, known: &Difference, p: &V) -> f64 {
        self.vector(known).dot(&directions(p)[known.direction]) - self.wanted()
    }

    fn vector(&self, known: &Difference) -> V {
        self.corners[known.to as usize] - self.corners[known.from as usize]
    }

    /// The linear function of a box that `Q` is nowhere below, over the box as a cube.
    fn function(&self, known: &Difference, rotations: &Rotations) -> Linear {
        let Rotations { center: p, half, .. } = rotations;
        let (d, side) = (self.vector(known), self.wanted());
        let [x, y, z] = [p.x, p.y, p.z];
        let norm2 = 1.0 + p.norm_squared();
        let value = d.dot(&directions(p)[known.direction]) * norm2 - side * norm2;
        let gradient = match known.direction {
            0 => V::new(x * d.x + y * d.y + z * d.z, x * d.y - y * d.x - d.z, x * d.z - z * d.x + d.y),
            _ => V::new(y * d.x - x * d.y + d.z, x * d.x + y * d.y + z * d.z, y * d.z - z * d.y - d.x),
        };
        let slope = (gradient - p * side) * 2.0;
        let curved = (d.norm() + side) * half.norm_squared();
        Linear { value: value - curved, slope: slope.component_mul(half).into() }
    }

    /// Tangent of half of the largest angle between the rotation at the centre of a box and another one in it.
    fn half_tan(rotations: &Rotations) -> f64 {
        let (p, h) = (rotations.center.norm(), rotations.half.norm());
        let (along, across) = (1.0 + p * p - h * p, h * (1.0 + p * p).sqrt());
        if along > 0.0 { across / along } else { f64::INFINITY }
    }

    /// Whether one of the two directions lies in a cap for all rotations of a box.
    fn is_in_cap(&self, rotations: &Rotations) -> bool {
        if self.caps.is_empty() {
            return false;
        }
        let half_tan = Self::half_tan(rotations);
        let directions = directions(&rotations.center);
        self.caps.iter().any(|cap| directions.iter().any(|axis| cap.holds(axis, half_tan)))
    }

    /// Looks for caps about the directions of a rotation of a box whose size asks for it.
    fn seek_caps(&mut self, rotations: &mut Rotations, p: &V) {
        let is_due = |size: &f64| rotations.half.max() < *size;
        let Some(true) = CAP_SIZES.get(rotations.caps_sought).map(is_due) else { return };
        rotations.caps_sought += 1;
        for axis in directions(p) {
            let is_narrow = ends(self.corners, &axis).1 < NARROW * self.side;
            if !is_narrow || self.caps.iter().any(|cap| cap.holds(&axis, 0.0)) {
                continue;
            }
            if let Some(cap) = Cap::near(self.corners, &axis, self.wanted()) {
                self.caps.push(cap);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::rng::{Stream, stream, uniform};
    use crate::shape::Form;
    use crate::shape::polyhedron::{TemplateKind, draw_template};

    fn cuboid(edges: [f64; 3]) -> Polyhedron {
        let corner = |i: usize| V::from_fn(|axis, _| if i >> axis & 1 == 1 { edges[axis] } else { 0.0 });
        Polyhedron::hull_of(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
    }

    /// Templates of all kinds, from flat to long, some of them rounded.
    fn templates(of_each: usize) -> impl Iterator<Item = (String, Polyhedron)> {
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
        let forms = [[1.0, 1.0, 1.0], [1.5, 1.2, 1.0], [10.0, 9.0, 1.0], [10.0, 1.2, 1.0]];
        let mut rng = stream(1, Stream::Shape);
        let mut drawn = Vec::new();
        for kind in kinds {
            for axes in forms {
                for i in 0..of_each {
                    let body = draw_template(kind, Form::of_axes(axes), &mut rng).unwrap().normalized();
                    let rounding = [0.0, 0.05, 0.2][i % 3];
                    drawn.push((
                        format!("{kind:?} {axes:?} {i}"),
                        body.with_relative_rounding(rounding).unwrap(),
                    ));
                }
            }
        }
        drawn.into_iter()
    }

    /// A body and its image in a plane, as one: it has that plane of symmetry, and equal minima on its two sides.
    fn mirrored(body: &Polyhedron, normal: &V) -> Polyhedron {
        let normal = normal.normalize();
        let image = body.vertices().iter().map(|v| v - normal * (2.0 * v.dot(&normal)));
        Polyhedron::hull_of(&body.vertices().iter().copied().chain(image).collect::<Vec<_>>()).unwrap()
    }

    fn agree(bodies: impl Iterator<Item = (String, Polyhedron)>) -> usize {
        let (mut worst, mut number, mut boxes) = (0.0_f64, 0, 0);
        let mut misses = Vec::new();
        let mut times = [0.0; 2];
        for (name, body) in bodies {
            let start = std::time::Instant::now();
            let there = body.sieve_passage();
            times[0] += start.elapsed().as_secs_f64();
            let start = std::time::Instant::now();
            let mut search = Search::new(body.vertices());
            let here = search.least() + 2.0 * body.rounding();
            times[1] += start.elapsed().as_secs_f64();
            boxes += search.looked_at;
            assert!(search.looked_at < MOST_BOXES, "{name}");
            let difference = there.size / here - 1.0;
            worst = worst.max(difference.abs());
            if difference.abs() > 1.0e-9 {
                misses.push(format!("{name}: {difference:e}"));
            }
            assert!(passes(&body, here, &there.sides, 1.0e-9) || difference.abs() > 1.0e-9, "{name}");
            number += 1;
        }
        let per = 1e3 / f64::from(number);
        println!(
            "{number} templates, {worst:e}, {} ms and {} ms, {} boxes each",
            times[0] * per,
            times[1] * per,
            boxes / number as usize
        );
        assert!(misses.is_empty(), "{} of {number}: {misses:#?}", misses.len());
        number as usize
    }

    #[test]
    fn packing_finds_the_sieve_sizes_that_are_proven() {
        agree(templates(1));
    }

    /// 1920 templates as drawn, and as many that have a plane of symmetry.
    #[test]
    #[ignore = "takes half a minute"]
    fn packing_finds_the_sieve_sizes_of_1920_templates() {
        let of_each = std::env::var("TEMPLATES").map_or(60, |n| n.parse().unwrap());
        agree(templates(of_each));
        let mut rng = stream(2, Stream::Shape);
        let mut number = || 2.0 * uniform(&mut rng) - 1.0;
        agree(templates(of_each).map(|(name, body)| {
            (format!("{name}, mirrored"), mirrored(&body, &V::new(number(), number(), number())))
        }));
    }

    #[test]
    fn mirrored_and_regular_bodies_have_equal_minima() {
        let mut rng = stream(3, Stream::Shape);
        let mut number = || 2.0 * uniform(&mut rng) - 1.0;
        let random = templates(1).step_by(3).map(|(name, body)| (name, mirrored(&body, &V::z())));
        let random: Vec<(String, Polyhedron)> = random.collect();
        let turned = random.iter().map(|(name, body)| {
            (format!("{name}, about a plane"), mirrored(body, &V::new(number(), number(), number())))
        });
        agree(turned.collect::<Vec<_>>().into_iter());
        agree(random.into_iter());
    }

    /// Closed forms, with the edge 1. A cuboid passes upright, or turned by 45 degrees. A tetrahedron shows a square
    /// with diagonals of the edge. The shadow of a cylinder of many sides is a strip as wide as its diameter.
    #[test]
    fn known_bodies_have_known_sizes() {
        for [b, c] in
            [[1.0, 1.0], [1.0, 0.8], [1.0, 0.5], [1.0, 0.42], [1.0, 0.41], [1.0, 0.3], [1.0, 0.1_f64]]
        {
            for a in [1.0, 3.0, 30.0] {
                let body = cuboid([a, b, c]);
                let known = f64::min(b, (b + c) / 2.0_f64.sqrt());
                for found in [sieve_size(&body), body.sieve_size()] {
                    assert!((found - known).abs() < 1e-9, "{a} {b} {c}: {found} {known}");
                }
            }
        }
        let corners = [[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]].map(|v| V::from(v.map(f64::from)));
        let tetrahedron = Polyhedron::hull_of(&corners).unwrap();
        for found in [sieve_size(&tetrahedron), tetrahedron.sieve_size()] {
            assert!((found - 1.0).abs() < 1e-9, "{found}");
        }
    }

    /// A smaller square is found where there is one, and a square that is too small is not accepted.
    #[test]
    fn only_squares_that_the_body_passes_are_accepted() {
        let body = cuboid([3.0, 1.0, 1.0]);
        assert!(passes(&body, 1.0, &[V::y(), V::z()], 1e-12));
        assert!(!passes(&body, 1.0 - 1e-9, &[V::y(), V::z()], 1e-12));
        assert!(!passes(&body, 1.0, &[V::x(), V::z()], 1e-12));
        assert!(!passes(&body, 1.0, &[V::y(), V::y()], 1e-12));
        assert!(!passes(&body, 1.0, &[V::y() * 0.5, V::z() * 0.5], 1e-12));
        assert!(!passes(&body, 1.0, &[V::y() * f64::NAN, V::z()], 1e-12));
    }
}
