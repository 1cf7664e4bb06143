//! The form of a grain: the ratios of its three axes, which say how long and how flat it is.

use serde::Serialize;

use super::{Ellipsoid, exceeds};
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

/// What a diameter of the grading curve is of a grain that is no sphere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SizeMeasure {
    /// The smallest square opening that the grain passes, as in a sieve test. Of polyhedra it is defined as the least
    /// square that holds their shadow along some direction.
    #[default]
    Sieve,
    /// The diameter of the sphere of equal volume.
    Equivalent,
}

impl SizeMeasure {
    /// Whether this is the default.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    #[must_use]
    pub fn is_sieve(&self) -> bool {
        matches!(self, Self::Sieve)
    }

    /// The ellipsoid of a form whose size by this measure is `size_mm`.
    ///
    /// The size must be finite and positive, and the form have ratios above 0 and at most 1; sizes of other numbers
    /// are refused by [`Ellipsoid::with_sieve_size`] and [`Ellipsoid::with_equivalent_diameter`].
    #[must_use]
    pub fn ellipsoid(self, size_mm: f64, form: Form) -> Ellipsoid {
        match self {
            Self::Sieve => Ellipsoid::of_sieve_size(size_mm, form),
            Self::Equivalent => Ellipsoid::of_equivalent_diameter(size_mm, form),
        }
    }

    /// Volume of an ellipsoid over that of the sphere whose diameter is the ellipsoid's size by this measure.
    #[must_use]
    pub fn volume_ratio(self, form: Form) -> f64 {
        match self {
            Self::Sieve => form.volume_over_sieve_sphere(),
            Self::Equivalent => 1.0,
        }
    }
}
