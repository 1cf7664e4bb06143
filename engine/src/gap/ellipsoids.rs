//! Two ellipsoids: whether they keep a gap, how long the gap is, and by which factor both may grow until they touch.
//!
//! With `C(l) = (1 - l) A + l B` and `n = C⁻¹ r` the function `F(l) = l (1 - l) r · n` is concave on `[0, 1]`; its
//! largest value is `mu²`, and both ellipsoids scaled by `mu` about their centres touch (Perram and Wertheim 1985, DOI
//! 10.1016/0021-9991(85)90171-8, as used by Donev, Torquato and Stillinger 2005, DOI 10.1016/j.jcp.2004.08.014). The
//! root of `F'` is the fixed point of `l <- h_A(n) / (h_A(n) + h_B(n))`. On the way each `n` may give either proof:
//!
//! - apart, where `r · n >= h_A(n) + h_B(n) + g |n|`;
//! - overlap, where `(1 - l) h_A(n) <= 1` and `l h_B(n) <= 1`: then `x_A + (1 - l) A n` lies in both.
//!
//! The gap is the largest `s(n)` on the unit sphere, found by Newton's method. With `h = sqrt(n · K n)` the gradient is
//! `w = r - A n / h_A - B n / h_B`, the Hessian of a support function is `(K - (K n)(K n)ᵀ / h²) / h`, and on the
//! tangent plane the radial part `w · n = s(n)` adds `-s(n)`. The points of both surfaces whose normal is `n` lie `|w|`
//! apart, so that `s(n) <= gap <= |w|` wherever the bodies are disjoint.
//!
//! An ellipsoid whose semi-axes are longer by `g / 2` lies inside the parallel body at the distance `g / 2`. Two such
//! ellipsoids that only touch are therefore closer than `g`: they are no test of a gap.

pub use super::grain::Decision;
use super::grain::{ConvexShape, PushContact, Turned};
use super::linear::{Symmetric, Vector, cross, dot, minus, norm, scaled, sum};
use super::walls;
use crate::arrays::Each as _;
use crate::request::Specimen;
use crate::shape::{Ellipsoid, Pose};

/// Most iterations of the fixed point. Pairs that are undecided by then touch to the last digits and count as overlap.
const MOST_ITERATIONS: u32 = 60;
/// Most iterations of Newton's method.
const MOST_NEWTON: u32 = 40;
/// Squared tangential part of the gradient, over the squared distance of the centres, at which `n` is found.
const FLAT: f64 = 1e-27;
/// Shortest share of a step of Newton's method.
const SHORTEST: f64 = 1e-6;

/// An ellipsoid in its place, ready for pair tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Centre in mm.
    pub center_mm: Vector,
    /// Shape matrix `A = R diag(a², b², c²) Rᵀ` in mm².
    pub matrix_mm2: Symmetric,
    /// Radius of the smallest sphere around it, which is its longest semi-axis, in mm.
    pub outer_mm: f64,
    /// Radius of the largest sphere inside it, which is its shortest semi-axis, in mm.
    pub inner_mm: f64,
}

impl Body {
    /// An ellipsoid at a pose.
    #[must_use]
    pub fn new(shape: &Ellipsoid, pose: &Pose) -> Self {
        let axes = shape.semi_axes_mm();
        let r = pose.rotation();
        let rows = [0, 1, 2].each(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]]);
        Self {
            center_mm: pose.center_mm.into(),
            matrix_mm2: Symmetric::rotated_diagonal(&rows, axes.component_mul(&axes).into()),
            outer_mm: axes.x,
            inner_mm: axes.z,
        }
    }

    /// Support function along `n`, in mm where `n` is a unit vector.
    #[inline(always)]
    #[must_use]
    pub fn support_mm(&self, n: Vector) -> f64 {
        self.matrix_mm2.quadratic(n).sqrt()
    }

    /// Smallest clear distance to the walls in mm, negative where the body reaches beyond one; infinite without walls.
    #[must_use]
    pub fn wall_gap_mm(&self, specimen: &Specimen) -> f64 {
        walls::wall_gap_mm(self.center_mm, &self.matrix_mm2, &specimen.domain())
    }

    /// Distance in mm of the farthest point from an axis along z.
    #[must_use]
    pub fn reach_from_axis_mm(&self, axis_mm: [f64; 2]) -> f64 {
        self.matrix_mm2.reach_across_mm(self.offset_mm(axis_mm)).0
    }

    /// The direction across the axis to the farthest point, as a unit vector.
    #[must_use]
    pub fn reach_direction(&self, axis_mm: [f64; 2]) -> Vector {
        self.matrix_mm2.reach_across_mm(self.offset_mm(axis_mm)).1
    }

    fn offset_mm(&self, axis_mm: [f64; 2]) -> [f64; 2] {
        [self.center_mm[0] - axis_mm[0], self.center_mm[1] - axis_mm[1]]
    }

    /// The pair of this body and another one.
    #[inline(always)]
    #[must_use]
    pub fn with<'a>(&'a self, other: &'a Self) -> Pair<'a> {
        self.with_at(other, other.center_mm)
    }

    /// The pair of this body and another one whose centre is taken to lie elsewhere, as an image in a periodic box.
    #[inline(always)]
    #[must_use]
    pub fn with_at<'a>(&'a self, other: &'a Self, center_mm: Vector) -> Pair<'a> {
        Pair { a: &self.matrix_mm2, b: &other.matrix_mm2, r: minus(center_mm, self.center_mm) }
    }
}

/// Two ellipsoids by their shape matrices and the vector from the centre of A to that of B.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// Shape matrix of A in mm².
    pub a: &'a Symmetric,
    /// Shape matrix of B in mm².
    pub b: &'a Symmetric,
    /// From the centre of A to that of B, in mm.
    pub r: Vector,
}

/// The gap of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// The gap or, where the bodies overlap, minus their depth along `normal`, in mm. The depth is a local minimum.
    pub gap_mm: f64,
    /// The unit vector from A to B for which `s(n)` is the gap.
    pub normal: Vector,
}

/// How far a pair is from touching, as a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// `mu²`, the square of the factor by which both grow about their centres until they touch.
    pub factor2: f64,
    /// The normal at the point of contact, from A to B, of any length.
    pub normal: Vector,
}

/// `s(n)` at a unit vector with what Newton's method needs.
struct Evaluation {
    s: f64,
    a_n: Vector,
    b_n: Vector,
    h_a: f64,
    h_b: f64,
    gradient: Vector,
}

impl Pair<'_> {
    /// `s(n)` in mm for a unit vector `n` from A to B: every `n` proves a gap of at least that.
    #[inline(always)]
    #[must_use]
    pub fn separation_mm(&self, n: Vector) -> f64 {
        dot(self.r, n) - self.a.quadratic(n).sqrt() - self.b.quadratic(n).sqrt()
    }

    /// Whether the pair keeps a gap of `gap_mm`, which must not be negative.
    #[inline(always)]
    #[must_use]
    pub fn decide(&self, gap_mm: f64) -> Decision {
        self.decide_from(gap_mm, self.r)
    }

    /// The same, from a direction that may be near the one that decides.
    #[inline(always)]
    #[must_use]
    pub fn decide_from(&self, gap_mm: f64, normal: Vector) -> Decision {
        let (a, b, r) = (self.a, self.b, self.r);
        let mut n = normal;
        let (mut h_a, mut h_b) = (a.quadratic(n).sqrt(), b.quadratic(n).sqrt());
        let clears = |n: Vector, h: f64| {
            let left = dot(r, n) - h;
            left >= 0.0 && (gap_mm == 0.0 || left * left >= gap_mm * gap_mm * dot(n, n))
        };
        if clears(n, h_a + h_b) {
            return Decision { is_apart: true, normal: n };
        }
        for _ in 0..MOST_ITERATIONS {
            let l = h_a / (h_a + h_b);
            n = Symmetric::blend(a, b, l).solve(r);
            (h_a, h_b) = (a.quadratic(n).sqrt(), b.quadratic(n).sqrt());
            if clears(n, h_a + h_b) {
                return Decision { is_apart: true, normal: n };
            }
            if (1.0 - l) * h_a <= 1.0 && l * h_b <= 1.0 {
                return Decision { is_apart: false, normal: n };
            }
            if gap_mm > 0.0 && dot(r, n) > h_a + h_b {
                return self.decide_gap(gap_mm, n);
            }
        }
        Decision { is_apart: false, normal: n }
    }

    /// Whether two disjoint bodies keep a gap, from a direction that parts them.
    #[cold]
    fn decide_gap(&self, gap_mm: f64, normal: Vector) -> Decision {
        let gap = self.ascend(scaled(normal, 1.0 / norm(normal)), |at| {
            at.s >= gap_mm || dot(at.gradient, at.gradient) < gap_mm * gap_mm
        });
        Decision { is_apart: gap.gap_mm >= gap_mm, normal: gap.normal }
    }

    /// The factor of Perram and Wertheim, to rounding.
    #[must_use]
    pub fn contact(&self) -> Contact {
        let (a, b, r) = (self.a, self.b, self.r);
        let (mut h_a, mut h_b) = (a.quadratic(r).sqrt(), b.quadratic(r).sqrt());
        let mut best = Contact { factor2: 0.0, normal: r };
        for _ in 0..4 * MOST_ITERATIONS {
            let l = h_a / (h_a + h_b);
            let n = Symmetric::blend(a, b, l).solve(r);
            let factor2 = l * (1.0 - l) * dot(r, n);
            (h_a, h_b) = (a.quadratic(n).sqrt(), b.quadratic(n).sqrt());
            let gain = factor2 - best.factor2;
            if gain > 0.0 {
                best = Contact { factor2, normal: n };
            }
            if gain <= 1e-15 * factor2 {
                break;
            }
        }
        best
    }

    /// The gap to about 1e-12 of the distance of the centres; of overlapping bodies minus a local minimum of the depth.
    #[must_use]
    pub fn gap(&self) -> Gap {
        let normal = self.decide(0.0).normal;
        self.ascend(scaled(normal, 1.0 / norm(normal)), |_| false)
    }

    /// The gap from a unit vector near the one that gives it.
    #[must_use]
    pub fn gap_from(&self, unit: Vector) -> Gap {
        self.ascend(unit, |_| false)
    }

    #[inline(always)]
    fn evaluate(&self, n: Vector) -> Evaluation {
        let (a_n, b_n) = (self.a.times(n), self.b.times(n));
        let (h_a, h_b) = (dot(n, a_n).sqrt(), dot(n, b_n).sqrt());
        let gradient = minus(self.r, sum(scaled(a_n, 1.0 / h_a), scaled(b_n, 1.0 / h_b)));
        Evaluation { s: dot(self.r, n) - h_a - h_b, a_n, b_n, h_a, h_b, gradient }
    }

    /// Climbs from a unit vector to the largest `s(n)` nearby, or until `is_enough`.
    fn ascend(&self, mut n: Vector, is_enough: impl Fn(&Evaluation) -> bool) -> Gap {
        let mut at = self.evaluate(n);
        let flat = FLAT * dot(self.r, self.r);
        for _ in 0..MOST_NEWTON {
            let tangential = minus(at.gradient, scaled(n, at.s));
            if dot(tangential, tangential) <= flat || is_enough(&at) {
                break;
            }
            let step = self.newton_step(n, &at);
            let mut share = 1.0;
            let better = loop {
                let m = sum(n, scaled(step, share));
                let m = scaled(m, 1.0 / norm(m));
                let there = self.evaluate(m);
                if there.s > at.s {
                    break Some((m, there));
                }
                share *= 0.5;
                if share < SHORTEST {
                    break None;
                }
            };
            let Some(better) = better else { break };
            let gain = better.1.s - at.s;
            (n, at) = better;
            if gain < 4.0 * f64::EPSILON * norm(self.r) {
                break;
            }
        }
        Gap { gap_mm: at.s, normal: n }
    }

    /// The step of Newton's method in the tangent plane.
    #[inline(always)]
    fn newton_step(&self, n: Vector, at: &Evaluation) -> Vector {
        let axis = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let u = cross(n, axis);
        let u = scaled(u, 1.0 / norm(u));
        let v = cross(n, u);
        let bent = |of: &Symmetric, of_n: Vector, h: f64| {
            let (of_u, of_v) = (of.times(u), of.times(v));
            let (p, q) = (dot(u, of_n) / h, dot(v, of_n) / h);
            [(dot(u, of_u) - p * p) / h, (dot(u, of_v) - p * q) / h, (dot(v, of_v) - q * q) / h]
        };
        let (of_a, of_b) = (bent(self.a, at.a_n, at.h_a), bent(self.b, at.b_n, at.h_b));
        let [mut uu, uv, mut vv] = [of_a[0] + of_b[0], of_a[1] + of_b[1], of_a[2] + of_b[2]];
        // Deep in each other the surfaces bend less than the sphere of directions: then only the definite part counts.
        if at.s > 0.0 || (uu + at.s > 0.0 && (uu + at.s) * (vv + at.s) > 2.0 * uv * uv) {
            uu += at.s;
            vv += at.s;
        }
        let (g_u, g_v) = (dot(at.gradient, u), dot(at.gradient, v));
        let inverse = 1.0 / (uu * vv - uv * uv);
        let (s_u, s_v) = ((vv * g_u - uv * g_v) * inverse, (uu * g_v - uv * g_u) * inverse);
        sum(scaled(u, s_u), scaled(v, s_v))
    }
}

impl ConvexShape for Ellipsoid {
    type Turned = Symmetric;

    fn volume_mm3(&self) -> f64 {
        self.volume_mm3()
    }

    fn equivalent_diameter_mm(&self) -> f64 {
        self.equivalent_diameter_mm()
    }

    fn scaled(&self, factor: f64) -> Option<Self> {
        Self::scaled(self, factor)
    }

    #[inline(always)]
    fn is_same(&self, other: &Self) -> bool {
        self == other
    }

    #[inline(always)]
    fn is_similar(&self, _: &Self) -> bool {
        true
    }

    #[inline(always)]
    fn outer_mm(&self) -> f64 {
        self.semi_axes_mm().x
    }

    #[inline(always)]
    fn inner_mm(&self) -> f64 {
        self.semi_axes_mm().z
    }

    #[inline(always)]
    fn inside_mm(&self) -> Vector {
        self.semi_axes_mm().into()
    }

    #[inline(always)]
    fn around_mm(&self) -> Vector {
        self.semi_axes_mm().into()
    }

    /// `(a - c) t` and `a - c` in all.
    #[inline(always)]
    fn change_mm(&self, angle: f64) -> f64 {
        let axes = self.semi_axes_mm();
        (axes.x - axes.z) * angle.min(1.0)
    }

    #[inline(always)]
    fn per_inertia(&self, per_mass: f64) -> Vector {
        let [a, b, c] = Vector::from(self.semi_axes_mm()).each(|axis| axis * axis);
        [5.0 * per_mass / (b + c), 5.0 * per_mass / (a + c), 5.0 * per_mass / (a + b)]
    }

    #[inline(always)]
    fn turned(&self, rows: &[Vector; 3]) -> Symmetric {
        Symmetric::rotated_diagonal(rows, Vector::from(self.semi_axes_mm()).each(|axis| axis * axis))
    }
}

/// An ellipsoid by its shape matrix.
impl Turned for Symmetric {
    const IS_ELLIPSOID: bool = true;

    #[inline(always)]
    fn around(&self) -> Symmetric {
        *self
    }

    #[inline(always)]
    fn support_mm(&self, n: Vector) -> f64 {
        self.quadratic(n).sqrt()
    }

    #[inline(always)]
    fn support_back_mm(&self, n: Vector) -> f64 {
        self.quadratic(n).sqrt()
    }

    #[inline(always)]
    fn decide(&self, other: &Self, r: Vector, gap_mm: f64, normal: Vector) -> Decision {
        Pair { a: self, b: other, r }.decide_from(gap_mm, normal)
    }

    #[inline(always)]
    fn first_direction(&self, _: &Self, r: Vector) -> Vector {
        r
    }

    #[inline(always)]
    fn contact(&self, other: &Self, _: Vector, _: f64, normal: Vector, _: u32) -> PushContact {
        let (a_n, b_n) = (self.times(normal), other.times(normal));
        let (h_a, h_b) = (dot(normal, a_n).sqrt(), dot(normal, b_n).sqrt());
        PushContact {
            normal,
            supports_mm: [h_a, h_b],
            arms_mm: [scaled(a_n, 1.0 / h_a), scaled(b_n, -1.0 / h_b)],
        }
    }

    fn reach_across_mm(&self, from_axis_mm: [f64; 2]) -> (f64, Vector) {
        walls::farthest_of_ellipsoid(self, from_axis_mm)
    }
}
