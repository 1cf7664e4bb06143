//! When moving, growing spheres meet: the closed forms of every kind of event.
//!
//! Two spheres at separation `d` with relative velocity `v`, in contact at the distance `s + g t`, meet when `|d + v
//! t| = s + g t`: the first `t >= 0` at which `f(t) = c + 2 b t + a t^2` leaves its allowed side, with `a = v.v -
//! g^2`, `b = d.v - s g`, `c = d.d - s^2` (Lubachevsky and Stillinger 1990, DOI 10.1007/BF01025983). The roots are
//! taken in the form that does not cancel, `c / (-b + sqrt(b^2 - a c))`. A distance that rounding has already violated
//! counts by its sign of change: closing means now, opening means never (Bannerman, Strobl, Formella and Poeschel
//! 2014, DOI 10.1007/s40571-014-0021-8).
//!
//! No fused multiply-add: every target then computes the same bits.

use crate::cpu::{InstructionSet, Lanes};

/// Time after which `c + 2 b t + a t²` falls to zero, where it starts at `c >= 0` or violated by
/// rounding; infinite if it never does.
///
/// For two spheres: `c` the squared distance of the centres less the squared contact distance, `b`
/// half its rate, `a` the squared relative velocity less the squared growth rate.
#[inline(always)]
pub(crate) fn falls_to_zero(a: f64, b: f64, c: f64) -> f64 {
    let discriminant = b * b - a * c;
    let root = discriminant.max(0.0).sqrt();
    let closing = b < 0.0;
    // Receding for now, but growth outruns the motion: the later root of a parabola that opens
    // downwards.
    let (above, below) = if closing { (c.max(0.0), root - b) } else { (b + root, -a) };
    let time = above / below;
    let meets = if closing { discriminant >= 0.0 || c <= 0.0 } else { a < 0.0 };
    if meets { time } else { f64::INFINITY }
}

/// [`falls_to_zero`] for four pairs at once, to the same bits.
#[inline(always)]
pub(crate) fn fall_to_zero<S: InstructionSet>(set: S, a: S::Lanes, b: S::Lanes, c: S::Lanes) -> S::Lanes {
    let zero = set.splat(0.0);
    let discriminant = b * b - a * c;
    let root = discriminant.max(zero).sqrt();
    let closing = b.lt(zero);
    let above = closing.select(c.max(zero), b + root);
    let below = closing.select(root - b, -a);
    let meets = closing.select(discriminant.ge(zero) | c.le(zero), a.lt(zero));
    meets.select(above / below, set.splat(f64::INFINITY))
}

/// Time after which `c + 2 b t + a t²` rises to zero, where it starts at `c <= 0` or violated by
/// rounding; infinite if it never does.
///
/// For a point leaving a sphere or a grain reaching the lateral surface of a cylinder: `c` the squared
/// distance from the centre or axis less the squared bound.
#[inline(always)]
pub(crate) fn rises_to_zero(a: f64, b: f64, c: f64) -> f64 {
    falls_to_zero(-a, -b, -c)
}

/// Time after which a distance that changes at a constant rate is used up; infinite if it never is.
#[inline(always)]
pub(crate) fn used_up(distance: f64, rate: f64) -> f64 {
    if rate < 0.0 { (distance / -rate).max(0.0) } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn head_on_and_grazing() {
        // Unit spheres at distance 4, closing at 1: contact when the distance is 2.
        assert_eq!(falls_to_zero(1.0, -4.0, 12.0), 2.0);
        assert_eq!(falls_to_zero(1.0, 4.0, 12.0), f64::INFINITY);
        // Missing by far.
        assert_eq!(falls_to_zero(1.0, -1.0, 12.0), f64::INFINITY);
    }

    #[test]
    fn growth_outruns_receding() {
        // Receding at 1, growing at 2 together: 4 + t = 2 + 2 t at t = 2.
        let (a, b, c) = (1.0 - 4.0, 4.0 - 4.0, 12.0);
        assert_eq!(falls_to_zero(a, b, c), 2.0);
    }
}
