//! How far two grains lie apart: a direction that shows it, and the decision whether they keep a gap.
//!
//! For grains `A` and `B` with the support functions `h` and `r = x_B - x_A`, `s(n) = r . n - h_A(n) - h_B(-n)` along a
//! unit vector `n` is never more than their distance.

pub(super) mod ellipsoids;
pub(super) mod mixed;
pub(super) mod polyhedra;

use nalgebra::Vector3;

use super::double_double::{DoubleDouble, Vector};
use crate::arrays::Each as _;

/// Bound on the rounding error of `s(n) - g`, relative to `|r| + a_A + a_B + g` and the way around a periodic box: 25
/// times the spacing of floats by the errors that the module `ellipsoid` names, 7 units for `r . n`, and sums.
pub(in crate::check) const ERROR: f64 = 32.0 * f64::EPSILON;

/// The same for double-double arithmetic, whose operations err by up to 15 times `2^-106`. What lies closer to the
/// requirement cannot be decided and passes: bodies that touch exactly have no direction with `s(n) >= 0` that can
/// be written down.
pub(in crate::check) const EXACT_ERROR: f64 = 1.0 / (1_u128 << 96) as f64;

/// A direction and what it shows.
#[derive(Clone, Copy, Debug)]
pub struct Direction {
    /// From the first grain to the second, of length 1 within rounding.
    pub normal: Vector3<f64>,
    /// `s(n)` in mm.
    pub separation: f64,
}

impl Direction {
    /// The one that shows more.
    #[inline(always)]
    pub(super) fn or(self, other: Self) -> Self {
        if self.separation >= other.separation { self } else { other }
    }
}

/// What the search for a direction has shown of a pair.
#[derive(Clone, Copy, Debug)]
pub enum Verdict {
    /// The pair is farther apart than anything is asked about it.
    Clear,
    /// It keeps the required gap; the direction is that of the distance.
    Keeps(Direction),
    /// No direction shows the required gap.
    TooClose(Direction),
}

/// A second body moved by whole periods.
#[derive(Clone, Copy, Debug)]
pub struct Image {
    /// Periods that it is moved by.
    pub steps: [f64; 3],
    /// Their lengths in mm; 0 without periods.
    pub period: [f64; 3],
}

impl Image {
    /// What the second body is moved by, in mm.
    #[inline(always)]
    pub fn shift(&self) -> Vector3<f64> {
        Vector3::from_fn(|k, _| self.steps[k] * self.period[k])
    }

    /// A component of the shift without rounding.
    pub(super) fn exact_shift(&self, k: usize) -> DoubleDouble {
        DoubleDouble::product(self.steps[k], self.period[k])
    }
}

/// Two grains of which at least one has corners: directions follow from what these span.
trait Cornered {
    /// Corners of one grain, or differences of corners, that a direction is computed from.
    type Feature;

    /// Sum of the lengths that rounding errors are relative to, but for the gap.
    fn scale(&self) -> f64;

    /// The direction of the line of the centres.
    fn between_centers(&self) -> Direction;

    /// A direction with `s(n) >= enough`, else the one with the largest `s` found, and what it was computed from.
    fn search(&self, first: Direction, enough: f64) -> (Direction, Self::Feature);

    /// Directions of which one parts the grains if any does.
    fn directions(&self) -> impl Iterator<Item = (Direction, Self::Feature)>;

    /// Decides `s(n) >= required` in double-double arithmetic for a direction, and for the one that its feature gives.
    fn keeps_exactly(&self, required: f64, feature: &Self::Feature, normal: &Vector3<f64>) -> bool;

    /// Whether the pair keeps a gap; clear if it is surely at least `enough` apart.
    #[inline(always)]
    fn judge(&self, required: f64, enough: f64) -> Verdict {
        let error = ERROR * (self.scale() + required);
        let enough = enough.max(required + error);
        let first = self.between_centers();
        if first.separation >= enough {
            return Verdict::Clear;
        }
        self.judge_from(first, required, enough, error)
    }

    fn judge_from(&self, first: Direction, required: f64, enough: f64, error: f64) -> Verdict {
        let (best, feature) = self.search(first, enough);
        if best.separation >= enough {
            return Verdict::Clear;
        }
        let decide = |direction: &Direction, feature: &Self::Feature| {
            let excess = direction.separation - required;
            excess >= error || (excess >= -error && self.keeps_exactly(required, feature, &direction.normal))
        };
        if decide(&best, &feature) {
            return Verdict::Keeps(best);
        }
        let mut largest = best;
        for (direction, feature) in self.directions() {
            if decide(&direction, &feature) {
                return Verdict::Keeps(direction);
            }
            largest = largest.or(direction);
        }
        Verdict::TooClose(largest)
    }
}

/// Whether a direction holds as given, or as its corners give it, on either side.
fn holds_either_way(given: &Vector, exact: Option<Vector>, keeps: impl Fn(&Vector) -> bool) -> bool {
    keeps(given) || exact.is_some_and(|n| keeps(&n) || keeps(&n.each(|component| -component)))
}
