//! How far two polyhedra lie apart along a direction, and the direction along which it is most.
//!
//! With the corners `p` of the one core and `q` of the other, `s(n) |n|` is the least `n . (q - p)`, less the radii of
//! rounding. Directions: the line of the centres; then the algorithm of Wolfe 1976
//! ([doi:10.1007/BF01580381](https://doi.org/10.1007/BF01580381)) for the point of least norm of the differences `q -
//! p`, which keeps up to four of them with weights. Its directions are taken from these differences themselves: one of
//! them, the part of one across the line of two, or the normal of three. Before a pair is refused, the normals of all
//! faces and of all pairs of edges are tried: cores that are apart are apart along one of these.
//!
//! Decision: floating point where `s` is clear of the requirement, else the signs of `n . (q - p)` for all corners in
//! double-double arithmetic, in which `n` is computed from the corners again.

use nalgebra::{Matrix3, Vector3};

use super::{Cornered, Direction, EXACT_ERROR, Image, Verdict, holds_either_way};
use crate::arrays::{self, Each as _};
use crate::check::body::Polyhedron;
use crate::check::double_double::{DoubleDouble, Vector, cross, dot, minus, norm};

/// A difference of corners by their indices.
type Difference = [usize; 2];

/// Steps after which the search for a direction ends; it takes some three to six.
const MOST_STEPS: usize = 100;

/// Up to four differences whose weighted sum is the point of least norm found so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corral {
    members: [Difference; 4],
    weights: [f64; 4],
    len: usize,
}

/// Two polyhedra, the second moved by whole periods.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct Pair<'a> {
    a: &'a Polyhedron<'a>,
    b: &'a Polyhedron<'a>,
    r: Vector3<f64>,
    image: Image,
    /// Radii of rounding of both.
    rounding: f64,
    /// Sum of the lengths that rounding errors are relative to, but for the gap.
    scale: f64,
}

impl<'a> Pair<'a> {
    #[inline(always)]
    pub(in crate::check) fn new(a: &'a Polyhedron<'_>, b: &'a Polyhedron<'_>, image: Image) -> Self {
        let shift = image.shift();
        let r = (b.center - a.center) + shift;
        let rounding = a.rounding + b.rounding;
        let radii = a.relative_radius() + b.relative_radius();
        Self { a, b, r, image, rounding, scale: r.norm() + radii + rounding + shift.abs().sum() }
    }

    /// Whether the pair keeps a gap; clear if it is surely at least `enough` apart.
    #[inline(always)]
    pub(in crate::check) fn judge(&self, required: f64, enough: f64) -> Verdict {
        Cornered::judge(self, required, enough)
    }

    /// The direction of a vector, and the corners that attain `s`.
    #[inline(always)]
    fn along(&self, n: &Vector3<f64>) -> (Direction, Difference) {
        let length = n.norm();
        let normal = if length > 0.0 { n / length } else { Vector3::x() };
        let (of_a, p) = self.a.support(&normal);
        let (of_b, q) = self.b.support(&-normal);
        let separation = self.r.dot(&normal) - of_a - of_b - self.rounding;
        (Direction { normal, separation }, [p, q])
    }

    /// `q - p` of two corners.
    fn difference(&self, [p, q]: Difference) -> Vector3<f64> {
        (self.r + self.b.relative[q]) - self.a.relative[p]
    }

    /// Adds a difference and moves the weights to the point of least norm; `None` where that is the origin.
    fn extend(&self, corral: &mut Corral, difference: Difference) -> Option<Vector3<f64>> {
        if corral.len == 4 {
            return None;
        }
        corral.members[corral.len] = difference;
        corral.weights[corral.len] = if corral.len == 0 { 1.0 } else { 0.0 };
        corral.len += 1;
        loop {
            let w: [Vector3<f64>; 4] = corral.members.each(|member| self.difference(member));
            let affine = affine_weights(&w[..corral.len])?;
            let current = &mut corral.weights[..corral.len];
            // As far towards the affine point as no weight becomes negative; who reaches 0 leaves.
            let mut share = 1.0;
            for (weight, target) in current.iter().zip(&affine) {
                if *target <= 0.0 {
                    share = f64::min(share, weight / (weight - target));
                }
            }
            for (weight, target) in current.iter_mut().zip(&affine) {
                *weight += share * (target - *weight);
            }
            let leaves = (0..corral.len).filter(|&i| affine[i] <= 0.0);
            let leaving = leaves.min_by(|&i, &j| corral.weights[i].total_cmp(&corral.weights[j]));
            let Some(leaving) = leaving else {
                let point = (0..corral.len).map(|i| w[i] * corral.weights[i]).sum();
                return (corral.len < 4).then_some(point);
            };
            corral.members[leaving..].rotate_left(1);
            corral.weights[leaving..].rotate_left(1);
            corral.len -= 1;
        }
    }

    /// One difference, its part across the line of two, or the normal of three; `None` where it vanishes.
    fn normal(&self, members: &[Difference]) -> Option<Vector3<f64>> {
        let n = match *members {
            [a] => self.difference(a),
            [a, b] => {
                let (w, along) = (self.difference(a), self.difference(b) - self.difference(a));
                w - along * (along.dot(&w) / along.norm_squared())
            }
            [a, b, c] => {
                let w = self.difference(a);
                (self.difference(b) - w).cross(&(self.difference(c) - w))
            }
            _ => return None,
        };
        n.try_normalize(f64::MIN_POSITIVE)
    }

    /// Differences whose normals are those of all faces and of all pairs of edges.
    fn axes(&self) -> impl Iterator<Item = [Difference; 3]> {
        let of_a = self.a.triangles().map(|t| t.each(|p| [p, 0]));
        let of_b = self.b.triangles().map(|t| t.each(|q| [0, q]));
        let edges =
            self.a.edges().flat_map(|[p, u]| self.b.edges().map(move |[q, v]| [[p, q], [u, q], [p, v]]));
        of_a.chain(of_b).chain(edges)
    }
}

impl Cornered for Pair<'_> {
    type Feature = Corral;

    fn scale(&self) -> f64 {
        self.scale
    }

    #[inline(always)]
    fn between_centers(&self) -> Direction {
        self.along(&self.r).0
    }

    /// A direction with `s(n) >= enough`, else the one with the largest `s` found and the differences that it is
    /// across.
    fn search(&self, first: Direction, enough: f64) -> (Direction, Corral) {
        let mut best = first;
        let mut direction = first.normal;
        let mut corral = Corral { members: [[0; 2]; 4], weights: [0.0; 4], len: 0 };
        let mut best_corral = corral;
        let mut least = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let (found, difference) = self.along(&direction);
            if found.separation > best.separation || best_corral.len == 0 {
                (best, best_corral) = (found.or(best), corral);
            }
            if best.separation >= enough || corral.members().contains(&difference) {
                break;
            }
            let Some(point) = self.extend(&mut corral, difference) else { break };
            // The norm falls until it is the least, but for rounding.
            if point.norm() >= least {
                break;
            }
            least = point.norm();
            let Some(normal) = self.normal(corral.members()) else { break };
            direction = if normal.dot(&point) < 0.0 { -normal } else { normal };
        }
        if best_corral.len == 0 {
            best_corral = corral;
        }
        (best, best_corral)
    }

    fn directions(&self) -> impl Iterator<Item = (Direction, Corral)> {
        let normals = self.axes().filter_map(|members| Some((self.normal(&members)?, members)));
        let both = normals.flat_map(|(normal, members)| [(normal, members), (-normal, members)]);
        both.map(|(normal, members)| (self.along(&normal).0, Corral::across(members)))
    }

    /// Decides `s(n) >= g` in double-double arithmetic for the direction that the differences give, on either side, and
    /// for one that is given.
    #[cold]
    fn keeps_exactly(&self, required: f64, corral: &Corral, normal: &Vector3<f64>) -> bool {
        // Corners relative to the first centre, without rounding.
        let points = |body: &Polyhedron<'_>, is_second: bool| -> Vec<Vector> {
            let relative = |p: &Vector3<f64>| {
                arrays::from_fn(|k| {
                    let difference = DoubleDouble::difference(p[k], self.a.center[k]);
                    if is_second { difference + self.image.exact_shift(k) } else { difference }
                })
            };
            body.points.iter().map(relative).collect()
        };
        let (of_a, of_b) = (points(self.a, false), points(self.b, true));
        let w = |[p, q]: Difference| minus(&of_b[q], &of_a[p]);
        let exact = match *corral.members() {
            [a] => Some(w(a)),
            [a, b] => {
                let (w, along) = (w(a), minus(&w(b), &w(a)));
                let share = dot(&along, &w) / dot(&along, &along);
                Some(arrays::from_fn(|k| w[k] - share * along[k]))
            }
            [a, b, c] => {
                let w = [a, b, c].each(w);
                Some(cross(&minus(&w[1], &w[0]), &minus(&w[2], &w[0])))
            }
            _ => None,
        };
        let needed = DoubleDouble::from(required) + self.a.rounding.into() + self.b.rounding.into();
        let tolerance = EXACT_ERROR * (self.scale + required);
        let keeps = |n: &Vector| {
            let length = norm(n);
            let farthest = |points: &[Vector], sign: f64| {
                let heights = points.iter().map(|p| DoubleDouble::from(sign) * dot(p, n));
                heights.reduce(|p, q| if (p - q).to_f64() >= 0.0 { p } else { q }).unwrap_or_default()
            };
            let apart = -farthest(&of_b, -1.0) - farthest(&of_a, 1.0);
            length.to_f64() > 0.0 && (apart - needed * length).to_f64() >= -tolerance * length.to_f64()
        };
        let given: Vector = arrays::from_fn(|k| normal[k].into());
        holds_either_way(&given, exact, keeps)
    }
}

impl Corral {
    /// Three differences without weights.
    fn across([a, b, c]: [Difference; 3]) -> Self {
        Self { members: [a, b, c, [0; 2]], weights: [0.0; 4], len: 3 }
    }

    fn members(&self) -> &[Difference] {
        &self.members[..self.len]
    }
}

/// Weights, which add up to 1, of the point of an affine hull that is nearest to the origin; `None` where the points
/// span no hull of their number.
fn affine_weights(w: &[Vector3<f64>]) -> Option<[f64; 4]> {
    let mut weights = [1.0, 0.0, 0.0, 0.0];
    let first = w[0];
    match *w {
        [_] => {}
        [_, b] => {
            let u = b - first;
            weights[1] = -u.dot(&first) / u.norm_squared();
        }
        [_, b, c] => {
            let (u, v) = (b - first, c - first);
            let normal = u.cross(&v);
            let area2 = normal.norm_squared();
            weights[1] = -first.cross(&v).dot(&normal) / area2;
            weights[2] = -u.cross(&first).dot(&normal) / area2;
        }
        [_, b, c, d] => {
            let inverse = Matrix3::from_columns(&[b - first, c - first, d - first]).try_inverse()?;
            let solution = inverse * -first;
            weights[1..].copy_from_slice(solution.as_slice());
        }
        _ => return None,
    }
    weights[0] = 1.0 - weights[1] - weights[2] - weights[3];
    weights.iter().all(|weight| weight.is_finite()).then_some(weights)
}
