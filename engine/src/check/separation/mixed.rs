//! How far an ellipsoid and a polyhedron lie apart along a direction, and the direction along which it is most.
//!
//! With the centre `x` of the ellipsoid and the corners `q` of the core of the polyhedron, `s(n) |n|` is the least
//! `n . (q - x)`, less the support function of the ellipsoid and the radius of rounding times `|n|`.
//!
//! The point of the polyhedron that is nearest to the ellipsoid lies within a corner, an edge or a face, and the
//! direction `n` of the gap is the one from the ellipsoid to the point, the line or the plane of that feature:
//!
//! - to a point `p`, `n = (A + t)^-1 p` with the root `t` of `p . A (A + t)^-2 p = 1` (`A` the shape matrix);
//! - to a line, the same in the plane across the line, with the shadow of the ellipsoid;
//! - to a plane, its normal.
//!
//! The search begins with the corners that are nearest where the ellipsoid is stretched to a ball. It knows the
//! distance of the hull of up to four corners, and adds the corner that the polyhedron reaches farthest with along
//! `-n`, until there is none farther. Before a pair is refused, all corners, edges and faces are tried: bodies that are
//! apart are apart along the direction of one of these.
//!
//! Decision: floating point where `s` is clear of the requirement by [`ERROR`] times the lengths involved, else
//! double-double arithmetic, in which `n` is computed from the corners of the face again, or turned across the edge.

use nalgebra::{Matrix2, Vector3};

use super::{Cornered, Direction, ERROR, EXACT_ERROR, Image, Verdict, holds_either_way};
use crate::arrays::{self, Each as _};
use crate::check::body::{Ellipsoid, Polyhedron};
use crate::check::double_double::{DoubleDouble, Vector, cross, dot, minus, norm};

/// Steps after which a search ends; it takes some two to five.
const MOST_STEPS: usize = 30;
/// Most steps of Newton's method for a root.
const MOST_NEWTON: usize = 60;

/// One to three corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Feature {
    corners: [usize; 3],
    len: usize,
}

impl Feature {
    const NONE: Self = Self { corners: [0; 3], len: 0 };

    fn new(corners: &[usize]) -> Self {
        let mut feature = Self { len: corners.len(), ..Self::NONE };
        feature.corners[..corners.len()].copy_from_slice(corners);
        feature
    }

    fn corners(&self) -> &[usize] {
        &self.corners[..self.len]
    }

    /// Parts of this feature with a corner more: that corner, its edges to the others, its triangles with two of them.
    fn with(&self, corner: usize) -> impl Iterator<Item = Self> {
        let own = *self;
        let of = move |i: usize| own.corners[i];
        let edges = (0..own.len).map(move |i| Self::new(&[of(i), corner]));
        let pairs = [[0, 1], [0, 2], [1, 2]].into_iter().filter(move |pair| pair[1] < own.len);
        let triangles = pairs.map(move |[i, j]| Self::new(&[of(i), of(j), corner]));
        std::iter::once(Self::new(&[corner])).chain(edges).chain(triangles)
    }
}

/// An ellipsoid and a polyhedron, which is moved by whole periods.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct Pair<'a> {
    a: &'a Ellipsoid,
    b: &'a Polyhedron<'a>,
    r: Vector3<f64>,
    image: Image,
    /// Sum of the lengths that rounding errors are relative to, but for the gap.
    scale: f64,
}

impl<'a> Pair<'a> {
    #[inline(always)]
    pub(in crate::check) fn new(a: &'a Ellipsoid, b: &'a Polyhedron<'_>, image: Image) -> Self {
        let shift = image.shift();
        let r = (b.center - a.center) + shift;
        Self { a, b, r, image, scale: r.norm() + a.radius + b.radius + shift.abs().sum() }
    }

    /// Whether the pair keeps a gap; clear if it is surely at least `enough` apart.
    #[inline(always)]
    pub(in crate::check) fn judge(&self, required: f64, enough: f64) -> Verdict {
        Cornered::judge(self, required, enough)
    }

    /// The direction of a vector, and the corner that attains `s`.
    #[inline(always)]
    fn along(&self, n: &Vector3<f64>) -> (Direction, usize) {
        let length = n.norm();
        let normal = if length > 0.0 { n / length } else { Vector3::x() };
        let (of_b, corner) = self.b.support(&-normal);
        let separation = self.r.dot(&normal) - self.a.support(&normal) - of_b - self.b.rounding;
        (Direction { normal, separation }, corner)
    }

    /// A corner seen from the centre of the ellipsoid.
    fn corner(&self, corner: usize) -> Vector3<f64> {
        self.r + self.b.relative[corner]
    }

    /// Of the hull of the corners of a feature and another one, the part that is nearest to the ellipsoid, the
    /// direction to it and its distance; where the hull meets the ellipsoid, one of a small depth.
    fn nearest_with(&self, at: &Feature, corner: usize) -> Option<(Feature, Vector3<f64>, f64)> {
        let mut all = [corner; 4];
        all[..at.len].copy_from_slice(at.corners());
        let all = &all[..if at.corners().contains(&corner) { at.len } else { at.len + 1 }];
        let points = all.iter().map(|corner| self.corner(*corner));
        let mut best: Option<(Feature, Vector3<f64>, f64)> = None;
        for part in parts(all) {
            for normal in self.normals(&part) {
                let lowest = points.clone().map(|p| p.dot(&normal)).fold(f64::INFINITY, f64::min);
                let distance = lowest - self.a.support(&normal);
                if best.is_none_or(|(.., largest)| distance > largest) {
                    best = Some((part, normal, distance));
                }
            }
        }
        best
    }

    /// The corners of the feature that is nearest to the ellipsoid where that is stretched to a ball: the algorithm of
    /// Wolfe 1976 for the point of least norm of a hull. It need not end there, for it only begins the search.
    fn nearest_where_stretched(&self) -> Feature {
        let stretched = |corner: usize| self.a.unstretched(&self.corner(corner));
        let points: Vec<Vector3<f64>> = (0..self.b.relative.len()).map(stretched).collect();
        let by_norm = |p: &usize, q: &usize| points[*p].norm_squared().total_cmp(&points[*q].norm_squared());
        let Some(first) = (0..points.len()).min_by(by_norm) else { return Feature::NONE };
        let mut feature = Feature::new(&[first]);
        let mut y = points[first];
        for _ in 0..MOST_STEPS {
            let lowest = |p: &usize, q: &usize| points[*p].dot(&y).total_cmp(&points[*q].dot(&y));
            let Some(corner) = (0..points.len()).min_by(lowest) else { break };
            let gains = y.norm_squared() - points[corner].dot(&y) > 1e-9 * y.norm_squared();
            if !gains || feature.corners().contains(&corner) {
                break;
            }
            // The nearest point of all parts with that corner whose weights are positive.
            let candidates =
                feature.with(corner).filter_map(|part| Some((nearest_of(&points, &part)?, part)));
            let nearest = candidates.min_by(|p, q| p.0.norm_squared().total_cmp(&q.0.norm_squared()));
            match nearest {
                Some((nearer, part)) if nearer.norm_squared() < y.norm_squared() => {
                    (y, feature) = (nearer, part);
                }
                _ => break,
            }
        }
        feature
    }

    /// Unit vectors from the ellipsoid to the point, the line or the plane of a feature.
    fn normals(&self, feature: &Feature) -> impl Iterator<Item = Vector3<f64>> + use<> {
        let normals = match *feature.corners() {
            [p] => [self.normal_to_point(&self.corner(p)), None],
            [p, q] => [self.normal_to_line(&self.corner(p), &self.corner(q)), None],
            [p, q, s] => {
                let [p, q, s] = [p, q, s].each(|corner| self.corner(corner));
                let normal = (q - p).cross(&(s - p));
                [Some(normal), Some(-normal)]
            }
            _ => [None, None],
        };
        let unit = |n: Vector3<f64>| n.try_normalize(f64::MIN_POSITIVE);
        normals.into_iter().flatten().filter_map(unit).filter(|n| n.iter().all(|x| x.is_finite()))
    }

    /// The normal of the ellipsoid at its point nearest to a point.
    fn normal_to_point(&self, p: &Vector3<f64>) -> Option<Vector3<f64>> {
        let axes: [Vector3<f64>; 3] = [0, 1, 2].each(|k| self.a.axes.row(k).transpose());
        let squares = axes.each(|axis| axis.norm_squared());
        let coordinates = [0, 1, 2].each(|k| axes[k].dot(p) / squares[k].sqrt());
        let normal = outward(squares, coordinates)?;
        Some((0..3).map(|k| axes[k] * (normal[k] / squares[k].sqrt())).sum())
    }

    /// The normal of the ellipsoid at its point nearest to a line.
    fn normal_to_line(&self, p: &Vector3<f64>, q: &Vector3<f64>) -> Option<Vector3<f64>> {
        let along = (q - p).try_normalize(0.0)?;
        let axis = if along.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let u = along.cross(&axis).normalize();
        let v = along.cross(&u);
        // The shadow along the line is the ellipse with this shape matrix.
        let (of_u, of_v) = (self.a.axes * u, self.a.axes * v);
        let mixed = of_u.dot(&of_v);
        let shadow = Matrix2::new(of_u.norm_squared(), mixed, mixed, of_v.norm_squared()).symmetric_eigen();
        let columns = [0, 1].each(|k| u * shadow.eigenvectors[(0, k)] + v * shadow.eigenvectors[(1, k)]);
        let normal = outward(shadow.eigenvalues.into(), columns.each(|column| column.dot(p)))?;
        Some(columns[0] * normal[0] + columns[1] * normal[1])
    }
}

impl Cornered for Pair<'_> {
    type Feature = Feature;

    fn scale(&self) -> f64 {
        self.scale
    }

    #[inline(always)]
    fn between_centers(&self) -> Direction {
        self.along(&self.r).0
    }

    /// A direction with `s(n) >= enough`, else the one with the largest `s` found, and its feature.
    ///
    /// The distance of the hull of some corners is known from the directions of their features. The corner that the
    /// polyhedron reaches farthest with along the opposite of that direction joins them, until it is none farther.
    fn search(&self, first: Direction, enough: f64) -> (Direction, Feature) {
        let mut best = (first, Feature::NONE);
        let mut at = Feature::NONE;
        let mut corner = self.along(&first.normal).1;
        for &nearest in self.nearest_where_stretched().corners() {
            if let Some((feature, ..)) = self.nearest_with(&at, nearest) {
                at = feature;
            }
            corner = nearest;
        }
        for _ in 0..MOST_STEPS {
            let Some((feature, normal, distance)) = self.nearest_with(&at, corner) else { break };
            let (direction, farthest) = self.along(&normal);
            if direction.separation > best.0.separation {
                best = (direction, feature);
            }
            let is_found = direction.separation + self.b.rounding >= distance - ERROR * self.scale;
            if best.0.separation >= enough || is_found || feature.corners().contains(&farthest) {
                break;
            }
            (at, corner) = (feature, farthest);
        }
        best
    }

    fn directions(&self) -> impl Iterator<Item = (Direction, Feature)> {
        let corners = (0..self.b.relative.len()).map(|corner| Feature::new(&[corner]));
        let edges = self.b.edges().map(|edge| Feature::new(&edge));
        let faces = self.b.triangles().map(|triangle| Feature::new(&triangle));
        let features = faces.chain(corners).chain(edges);
        features.flat_map(move |feature| {
            self.normals(&feature).map(move |normal| (self.along(&normal).0, feature))
        })
    }

    /// Decides `s(n) >= g` in double-double arithmetic for a direction, and for the one that the corners of its feature
    /// give.
    #[cold]
    fn keeps_exactly(&self, required: f64, feature: &Feature, normal: &Vector3<f64>) -> bool {
        // Corners relative to the centre of the ellipsoid, without rounding.
        let relative = |p: &Vector3<f64>| -> Vector {
            arrays::from_fn(|k| DoubleDouble::difference(p[k], self.a.center[k]) + self.image.exact_shift(k))
        };
        let points: Vec<Vector> = self.b.points.iter().map(relative).collect();
        let given: Vector = arrays::from_fn(|k| normal[k].into());
        let exact = match *feature.corners() {
            [p, q] => {
                let along = minus(&points[q], &points[p]);
                let share = dot(&along, &given) / dot(&along, &along);
                Some(arrays::from_fn(|k| given[k] - share * along[k]))
            }
            [p, q, s] => Some(cross(&minus(&points[q], &points[p]), &minus(&points[s], &points[p]))),
            _ => None,
        };
        let axes = self.a.exact_axes();
        let needed = DoubleDouble::from(required) + self.b.rounding.into();
        let tolerance = EXACT_ERROR * (self.scale + required);
        let keeps = |n: &Vector| {
            let length = norm(n);
            let lowest = points.iter().map(|p| dot(p, n));
            let lowest =
                lowest.reduce(|p, q| if (p - q).to_f64() <= 0.0 { p } else { q }).unwrap_or_default();
            let apart = lowest - norm(&Ellipsoid::exact_scaled(&axes, n));
            length.to_f64() > 0.0 && (apart - needed * length).to_f64() >= -tolerance * length.to_f64()
        };
        holds_either_way(&given, exact, keeps)
    }
}

/// The corners, edges and triangles of up to four corners.
fn parts(corners: &[usize]) -> impl Iterator<Item = Feature> {
    let sets = (1_u32..1 << corners.len()).filter(|set| set.count_ones() <= 3);
    sets.map(|set| {
        let mut part = Feature::NONE;
        for (_, &corner) in corners.iter().enumerate().filter(|(i, _)| set >> i & 1 == 1) {
            part.corners[part.len] = corner;
            part.len += 1;
        }
        part
    })
}

/// The point of least norm of the hull of the corners of a feature, where it lies inside of the hull.
fn nearest_of(points: &[Vector3<f64>], feature: &Feature) -> Option<Vector3<f64>> {
    match *feature.corners() {
        [p] => Some(points[p]),
        [p, q] => {
            let (p, along) = (points[p], points[q] - points[p]);
            let share = -along.dot(&p) / along.norm_squared();
            (share > 0.0 && share < 1.0).then(|| p + along * share)
        }
        [p, q, s] => {
            let (p, u, v) = (points[p], points[q] - points[p], points[s] - points[p]);
            let normal = u.cross(&v);
            let area2 = normal.norm_squared();
            let [x, y] = [-p.cross(&v).dot(&normal) / area2, -u.cross(&p).dot(&normal) / area2];
            (x > 0.0 && y > 0.0 && x + y < 1.0).then(|| p + u * x + v * y)
        }
        _ => None,
    }
}

/// The direction from an ellipsoid in its axes, by the squares of its semi-axes, to a point: `u_k / (a_k² + t)` with
/// the root `t >= 0` of `|v| = 1`, `v_k = a_k u_k / (a_k² + t)`; that of the scaled ellipsoid through the point where
/// it lies inside.
///
/// `1 / |v|` is nearly linear in `t` and concave, so that Newton's method for `1 / |v| = 1` comes to the root from
/// below.
fn outward<const N: usize>(squares: [f64; N], point: [f64; N]) -> Option<[f64; N]> {
    let mut t = 0.0_f64;
    for _ in 0..MOST_NEWTON {
        let (mut norm2, mut slope) = (0.0, 0.0);
        for k in 0..N {
            let v2 = squares[k] * point[k] * point[k] / ((squares[k] + t) * (squares[k] + t));
            norm2 += v2;
            slope += v2 / (squares[k] + t);
        }
        if norm2 <= 1.0 || slope <= 0.0 {
            break;
        }
        let next = t + norm2 * (norm2.sqrt() - 1.0) / slope;
        if !next.is_finite() || next <= t {
            break;
        }
        t = next;
    }
    let n: [f64; N] = arrays::from_fn(|k| point[k] / (squares[k] + t));
    n.iter().all(|x| x.is_finite()).then_some(n)
}
