//! The form of a grain: the ratios of its three axes, which say how long and how flat it is.

use super::exceeds;
use crate::sorting;

/// Boundary between the classes of Zingg.
const ZINGG_BOUNDARY: f64 = 2.0 / 3.0;

/// Ratios of the axes `a >= b >= c` of a grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Form {
    /// Elongation `Ei = b/a`; at most 1.
    pub elongation: f64,
    /// Flatness `Fi = c/b`; at most 1.
    pub flatness: f64,
}

impl Form {
    /// The form of a sphere.
    pub const SPHERE: Self = Self { elongation: 1.0, flatness: 1.0 };

    /// The form of a grain with three axes of these lengths, in any order and unit.
    #[must_use]
    pub fn of_axes(mut axes: [f64; 3]) -> Self {
        sorting::descending(&mut axes);
        let [a, b, c] = axes;
        Self { elongation: b / a, flatness: c / b }
    }

    /// `(d_eq / D_s)³` of an ellipsoid: its volume over that of a sphere that passes the same sieve.
    #[must_use]
    pub fn volume_over_sieve_sphere(&self) -> f64 {
        let Self { elongation, flatness } = *self;
        let square = 2.0 * (1.0 + flatness * flatness);
        8.0 * flatness / (elongation * square * square.sqrt())
    }

    /// Length over thickness, `a/c`.
    #[must_use]
    pub fn length_over_thickness(&self) -> f64 {
        1.0 / (self.elongation * self.flatness)
    }

    /// The class of Zingg.
    #[must_use]
    pub fn zingg(&self) -> Zingg {
        match (exceeds(self.elongation, ZINGG_BOUNDARY), exceeds(self.flatness, ZINGG_BOUNDARY)) {
            (true, true) => Zingg::Equant,
            (true, false) => Zingg::Disc,
            (false, true) => Zingg::Rod,
            (false, false) => Zingg::Blade,
        }
    }
}

/// Classes of form by the ratios `b/a` and `c/b`, divided at 2/3 (T. Zingg, "Beitrag zur Schotteranalyse", ETH Zürich,
/// 1935, DOI 10.3929/ethz-a-000103455).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Zingg {
    /// `b/a > 2/3`, `c/b <= 2/3`: oblate.
    Disc,
    /// `b/a > 2/3`, `c/b > 2/3`: nearly a sphere.
    Equant,
    /// `b/a <= 2/3`, `c/b <= 2/3`.
    Blade,
    /// `b/a <= 2/3`, `c/b > 2/3`: prolate.
    Rod,
}
