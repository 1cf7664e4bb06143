//! How far two ellipsoids lie apart along a direction, and the direction along which it is most.
//!
//! For `r = x_B - x_A` and a unit vector `n`, `s(n) = r . n - h_A(n) - h_B(n)` is never more than the distance of the
//! bodies, so `s(n) >= g` proves that they keep the gap `g`, however `n` was found. The largest `s` is the distance, or
//! minus the depth.
//!
//! Directions: the line of the centres; two steps on the contact function of Perram and Wertheim 1985
//! ([doi:10.1016/0021-9991(85)90171-8](https://doi.org/10.1016/0021-9991%2885%2990171-8)), `n = C^-1 r` with the matrix
//! `C = (1 - l) A + l B`; Newton steps on the unit sphere, with the gradient `r - A n / h_A - B n / h_B`. Before a pair
//! is refused, the zero in `l` of `(1 - l) h_A - l h_B`, at which the scaled bodies touch, is found by bisection, and
//! the Newton steps start from there: for disjoint bodies `s` is positive there, and `s` has one maximum.
//!
//! Decision: floating point where `s` is clear of `g` by [`ERROR`](super::ERROR) times the lengths involved, else
//! double-double arithmetic, in which `n` is improved too.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::{Direction, ERROR, EXACT_ERROR, Image, Verdict};
use crate::arrays::{self, Each as _};
use crate::check::body::Ellipsoid;
use crate::check::double_double::{DoubleDouble, Vector, dot, norm};

/// Two ellipsoids, the second moved by whole periods.
#[derive(Clone, Copy, Debug)]
pub(in crate::check) struct Pair<'a> {
    a: &'a Ellipsoid,
    b: &'a Ellipsoid,
    r: Vector3<f64>,
    image: Image,
    /// Sum of the lengths that rounding errors are relative to, but for the gap.
    scale: f64,
}

impl<'a> Pair<'a> {
    #[inline(always)]
    pub(in crate::check) fn new(a: &'a Ellipsoid, b: &'a Ellipsoid, image: Image) -> Self {
        let shift = image.shift();
        let r = (b.center - a.center) + shift;
        let scale = r.norm() + a.radius + b.radius + shift.abs().sum();
        Self { a, b, r, image, scale }
    }

    /// Whether the pair keeps a gap; clear if it is surely at least `enough` apart.
    #[inline(always)]
    pub(in crate::check) fn judge(&self, required: f64, enough: f64) -> Verdict {
        let enough = enough.max(required + self.error(required));
        let mut direction = self.search(enough);
        if direction.separation >= enough {
            return Verdict::Clear;
        }
        if !self.keeps(required, &direction) {
            direction = self.search_all(direction);
            if !self.keeps(required, &direction) {
                return Verdict::TooClose(direction);
            }
        }
        Verdict::Keeps(direction)
    }

    /// Bound on the rounding error of `s(n) - g`.
    #[inline(always)]
    fn error(&self, gap: f64) -> f64 {
        ERROR * (self.scale + gap)
    }

    /// A direction with `s(n) >= enough`, else the one with the largest `s` found.
    #[inline(always)]
    pub(in crate::check) fn search(&self, enough: f64) -> Direction {
        let mut best = self.along(&self.r);
        if best.separation >= enough {
            return best;
        }
        let mut supports = (self.a.support(&best.normal), self.b.support(&best.normal));
        for _ in 0..2 {
            let direction = self.along(&self.contact_normal(supports.0 / (supports.0 + supports.1)));
            if direction.separation >= enough {
                return direction;
            }
            supports = (self.a.support(&direction.normal), self.b.support(&direction.normal));
            best = best.or(direction);
        }
        self.ascend(best, enough)
    }

    /// The best of a direction and of what bisection on the contact function leads to.
    fn search_all(&self, best: Direction) -> Direction {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..100 {
            let l = 0.5 * (low + high);
            let n = self.contact_normal(l);
            if (1.0 - l) * self.a.support(&n) > l * self.b.support(&n) { low = l } else { high = l }
        }
        let touching = self.along(&self.contact_normal(0.5 * (low + high)));
        best.or(self.ascend(touching, f64::INFINITY))
    }

    /// Whether the pair keeps a gap, as the direction shows, or one near it.
    #[inline(always)]
    pub(in crate::check) fn keeps(&self, gap: f64, direction: &Direction) -> bool {
        let (excess, error) = (direction.separation - gap, self.error(gap));
        excess >= error || (excess >= -error && self.keeps_exactly(gap, direction.normal))
    }

    /// The direction of a vector that need not be of length 1.
    #[inline(always)]
    fn along(&self, n: &Vector3<f64>) -> Direction {
        let length = n.norm();
        let normal = if length > 0.0 { n / length } else { Vector3::x() };
        let separation = self.r.dot(&normal) - self.a.support(&normal) - self.b.support(&normal);
        Direction { normal, separation }
    }

    /// `C^-1 r` but for a positive factor, with `C = (1 - l) A + l B`.
    #[inline(always)]
    fn contact_normal(&self, l: f64) -> Vector3<f64> {
        let c: Matrix3<f64> = self.a.matrix * (1.0 - l) + self.b.matrix * l;
        let (x, y, z) = (c.column(0), c.column(1), c.column(2));
        let (yz, zx, xy) = (y.cross(&z), z.cross(&x), x.cross(&y));
        Vector3::new(yz.dot(&self.r), zx.dot(&self.r), xy.dot(&self.r))
    }

    /// Newton steps from a direction until `s >= enough`, or until the steps gain nothing more.
    fn ascend(&self, from: Direction, enough: f64) -> Direction {
        let mut best = from;
        for _ in 0..60 {
            let n = best.normal;
            let (v_a, v_b) = (self.a.scaled(&n), self.b.scaled(&n));
            let gradient =
                self.r - self.a.axes.tr_mul(&v_a) / v_a.norm() - self.b.axes.tr_mul(&v_b) / v_b.norm();
            let step = self.newton_step(&n, best.separation, &gradient);
            if 0.5 * step.dot(&gradient) <= 0.25 * f64::EPSILON * self.scale {
                break;
            }
            let mut share = 1.0;
            let mut next = self.along(&(n + step));
            while next.separation <= best.separation && share > 1.0e-9 {
                share *= 0.5;
                next = self.along(&(n + step * share));
            }
            if next.separation <= best.separation {
                break;
            }
            best = next;
            if best.separation >= enough {
                break;
            }
        }
        best
    }

    /// The Newton step on the unit sphere for a gradient of `s`. Where the bodies overlap, the Hessian is that of the
    /// support functions alone, which is always definite.
    fn newton_step(&self, n: &Vector3<f64>, separation: f64, gradient: &Vector3<f64>) -> Vector3<f64> {
        let axis = if n.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let u = n.cross(&axis).normalize();
        let v = n.cross(&u);
        let mut hessian = Matrix2::from_diagonal_element(separation.max(0.0));
        for body in [self.a, self.b] {
            let (of_n, of_u, of_v) = (body.scaled(n), body.scaled(&u), body.scaled(&v));
            let h = of_n.norm();
            let along = Vector2::new(of_u.dot(&of_n), of_v.dot(&of_n)) / h;
            let mixed = of_u.dot(&of_v);
            hessian += (Matrix2::new(of_u.norm_squared(), mixed, mixed, of_v.norm_squared())
                - along * along.transpose())
                / h;
        }
        let slope = Vector2::new(gradient.dot(&u), gradient.dot(&v));
        let determinant = hessian.determinant();
        let step = Vector2::new(
            hessian.m22 * slope.x - hessian.m12 * slope.y,
            hessian.m11 * slope.y - hessian.m12 * slope.x,
        ) / determinant;
        if step.iter().all(|x| x.is_finite()) { u * step.x + v * step.y } else { Vector3::zeros() }
    }

    /// Decides `s(n) >= g` in double-double arithmetic, for a direction and for better ones near it.
    fn keeps_exactly(&self, gap: f64, normal: Vector3<f64>) -> bool {
        let r: Vector = arrays::from_fn(|k| {
            DoubleDouble::difference(self.b.center[k], self.a.center[k]) + self.image.exact_shift(k)
        });
        let axes = [self.a, self.b].each(Ellipsoid::exact_axes);
        let tolerance = EXACT_ERROR * (self.scale + gap);
        let mut n: Vector = arrays::from_fn(|k| normal[k].into());
        for _ in 0..4 {
            let length = norm(&n);
            let along = dot(&r, &n);
            let mut excess = along - DoubleDouble::from(gap) * length;
            let mut gradient = r;
            for axes in &axes {
                let v = Ellipsoid::exact_scaled(axes, &n);
                let h = norm(&v);
                excess = excess - h;
                for (k, entry) in gradient.iter_mut().enumerate() {
                    let column = [axes[0][k], axes[1][k], axes[2][k]];
                    *entry = *entry - dot(&column, &v) / h;
                }
            }
            if excess.to_f64() >= -tolerance {
                return true;
            }
            // The part of the gradient across `n`, which is what the step needs, is far below the gradient itself.
            let share = dot(&gradient, &n) / (length * length);
            let across = Vector3::from_fn(|k, _| (gradient[k] - share * n[k]).to_f64());
            let unit = Vector3::from_fn(|k, _| n[k].to_f64());
            let step = self.newton_step(&unit, share.to_f64(), &across);
            n = arrays::from_fn(|k| n[k] + step[k].into());
        }
        false
    }
}
