//! The two questions that the tetrahedralisation asks of coordinates, answered exactly.
//!
//! Each is a determinant in floating point with a bound of its error first; only where that can't tell the sign,
//! Shewchuk's adaptive arithmetic does (crate `robust`). Signs follow `det(x2 - x1, x3 - x1, x4 - x1) > 0`.

use std::cmp::Ordering;

use robust::Coord3D;

use crate::arrays::Each as _;

type Point = [f64; 3];

/// Bound of the rounding error of a 3x3 determinant of rounded differences, over the product of the largest
/// magnitudes of its columns. Each of the 6 products of three has at most 8 roundings of 2^-53: a
/// difference each, two products, three sums. That is 5.4e-15, and the rest is for roundings of the bound.
const ORIENT_ERROR: f64 = 6e-15;
/// The same of the 4x4 determinant with squared distances: 24 products of four with at most 18 roundings (a
/// difference each, three of the square, two of its sum, three products, five sums) are 4.8e-14.
const INSPHERE_ERROR: f64 = 6e-14;

/// Bounds of the errors that hold for all pairs of points of a set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    orient: f64,
    insphere: f64,
}

impl Bounds {
    pub(super) fn of(points: &[Point]) -> Self {
        let [x, y, z] = [0, 1, 2].each(|axis| {
            let low = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
            let high = points.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
            high - low
        });
        Bounds {
            orient: ORIENT_ERROR * x * y * z,
            insphere: INSPHERE_ERROR * x * y * z * (x * x + y * y + z * z),
        }
    }
}

/// Whether `det(b - a, c - a, d - a)` is positive (`Greater`), zero or negative: exactly.
pub fn orientation(a: Point, b: Point, c: Point, d: Point) -> Ordering {
    orient(a, b, c, d, f64::INFINITY)
}

/// Whether `p` lies inside (`Greater`), on or outside the sphere through four points of positive orientation:
/// exactly.
pub fn inside_circumsphere(nodes: [Point; 4], p: Point) -> Ordering {
    insphere(nodes, p, f64::INFINITY)
}

#[inline]
fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
fn determinant(a: Point, b: Point, c: Point) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
}

#[inline]
fn sign(x: f64) -> Ordering {
    if x > 0.0 {
        Ordering::Greater
    } else if x < 0.0 {
        Ordering::Less
    } else {
        Ordering::Equal
    }
}

fn coord(p: Point) -> Coord3D<f64> {
    Coord3D { x: p[0], y: p[1], z: p[2] }
}

/// Sign of `det(b - a, c - a, d - a)`; `bound` is that of its error.
#[inline]
fn orient(a: Point, b: Point, c: Point, d: Point, bound: f64) -> Ordering {
    let det = determinant(minus(b, a), minus(c, a), minus(d, a));
    if det.abs() > bound { sign(det) } else { orient_exactly(a, b, c, d) }
}

#[cold]
#[inline(never)]
fn orient_exactly(a: Point, b: Point, c: Point, d: Point) -> Ordering {
    let rows = [minus(b, a), minus(c, a), minus(d, a)];
    let [x, y, z] = [0, 1, 2].each(|axis| rows.iter().map(|row| row[axis].abs()).fold(0.0, f64::max));
    let bound = ORIENT_ERROR * x * y * z;
    let det = determinant(rows[0], rows[1], rows[2]);
    if det.abs() > bound {
        return sign(det);
    }
    // A plane across an axis, the usual case of faces of a box: differences of zero are exact.
    if bound == 0.0 {
        return Ordering::Equal;
    }
    sign(-robust::orient3d(coord(a), coord(b), coord(c), coord(d)))
}

/// Sign of how far `p` lies inside the sphere through `nodes`; `bound` is that of the determinant's error.
#[inline]
fn insphere(nodes: [Point; 4], p: Point, bound: f64) -> Ordering {
    let det = insphere_determinant(nodes.each(|node| minus(node, p)));
    if det.abs() > bound { sign(det) } else { insphere_exactly(nodes, p) }
}

#[inline]
fn insphere_determinant([a, b, c, d]: [Point; 4]) -> f64 {
    let ab = a[0] * b[1] - b[0] * a[1];
    let bc = b[0] * c[1] - c[0] * b[1];
    let cd = c[0] * d[1] - d[0] * c[1];
    let da = d[0] * a[1] - a[0] * d[1];
    let ac = a[0] * c[1] - c[0] * a[1];
    let bd = b[0] * d[1] - d[0] * b[1];
    let abc = a[2] * bc - b[2] * ac + c[2] * ab;
    let bcd = b[2] * cd - c[2] * bd + d[2] * bc;
    let cda = c[2] * da + d[2] * ac + a[2] * cd;
    let dab = d[2] * ab + a[2] * bd + b[2] * da;
    let [a2, b2, c2, d2] = [square(a), square(b), square(c), square(d)];
    (c2 * dab - d2 * abc) + (a2 * bcd - b2 * cda)
}

#[inline]
fn square(a: Point) -> f64 {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
}

#[cold]
#[inline(never)]
fn insphere_exactly(nodes: [Point; 4], p: Point) -> Ordering {
    let rows = nodes.each(|node| minus(node, p));
    let [x, y, z] = [0, 1, 2].each(|axis| rows.iter().map(|row| row[axis].abs()).fold(0.0, f64::max));
    let lift = rows.iter().map(|&row| square(row)).fold(0.0, f64::max);
    let det = insphere_determinant(rows);
    if det.abs() > INSPHERE_ERROR * x * y * z * lift {
        return sign(det);
    }
    let [a, b, c, d] = nodes.map(coord);
    sign(-robust::insphere(a, b, c, d, coord(p)))
}

impl Bounds {
    /// [`orientation`] of points of the set.
    #[inline]
    pub(super) fn orientation(self, a: Point, b: Point, c: Point, d: Point) -> Ordering {
        orient(a, b, c, d, self.orient)
    }

    /// Whether a point of the set lies inside the sphere through four others of positive orientation, once
    /// all are lifted a little: each by far more than those before it in lexicographic order.
    #[inline]
    pub(super) fn in_conflict(self, nodes: [Point; 4], p: Point) -> bool {
        match insphere(nodes, p, self.insphere) {
            Ordering::Greater => true,
            Ordering::Less => false,
            Ordering::Equal => in_conflict_once_lifted(nodes, p),
        }
    }
}

/// Of five points on one sphere: `p` is inside when, with the lifts, the hyperplane through the four is above `p`
/// at `p`. Its height there is the mean of theirs with the barycentric coordinates of `p` as weights, so the
/// highest lift decides, unless its weight is zero, which is when `p` lies in the plane of the other three.
#[cold]
#[inline(never)]
fn in_conflict_once_lifted(nodes: [Point; 4], p: Point) -> bool {
    let mut by_lift = [0, 1, 2, 3];
    by_lift.sort_unstable_by(|&i, &j| lexicographic(nodes[j], nodes[i]));
    for i in by_lift {
        if lexicographic(nodes[i], p) == Ordering::Less {
            return false;
        }
        let mut with_p = nodes;
        with_p[i] = p;
        let [a, b, c, d] = with_p;
        match orientation(a, b, c, d) {
            Ordering::Greater => return true,
            Ordering::Less => return false,
            Ordering::Equal => {}
        }
    }
    false
}

fn lexicographic(a: Point, b: Point) -> Ordering {
    // Coordinates are finite, and zeros of both signs the same.
    a.partial_cmp(&b).unwrap_or(Ordering::Equal)
}

/// Whether three points lie on one line: exactly, for so do their projections.
pub(super) fn collinear(a: Point, b: Point, c: Point) -> bool {
    [(0, 1), (1, 2), (2, 0)].into_iter().all(|(i, j)| {
        let [a, b, c] = [a, b, c].map(|p| robust::Coord { x: p[i], y: p[j] });
        robust::orient2d(a, b, c) == 0.0
    })
}
