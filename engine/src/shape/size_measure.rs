//! What the size of a grain is that is no sphere.

use serde::Serialize;

use super::{Ellipsoid, Form};

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
