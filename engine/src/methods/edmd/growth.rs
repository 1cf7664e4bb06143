//! How contact distances grow in one compression cycle.
//!
//! A grain has a contact radius `r`, its radius with its share of the distance rule. Over a cycle it grows as `r (1 +
//! alpha t) + beta t`: isotropic scaling uses `alpha`, uniform growth of all radii `beta`.

/// The growth of one cycle, times counted from its start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Growth {
    /// Relative rate in 1/s.
    pub(crate) alpha: f64,
    /// Absolute rate of radii in mm/s.
    pub(crate) beta: f64,
    /// Extra contact distance as a share of the smaller radius: the non-additive part of the rule
    /// `smaller_diameter`.
    pub(crate) kappa: f64,
    /// Contact with a wall is at `wall_factor r + wall_offset` ...
    pub(crate) wall_factor: f64,
    /// ... at the start of the cycle, in mm,
    pub(crate) wall_offset_mm: f64,
    /// and grows at `alpha` times that plus this rate, in mm/s.
    pub(crate) wall_beta: f64,
}

impl Growth {
    /// Contact distance of two grains at the start of the cycle, and its rate.
    #[inline(always)]
    pub(crate) fn pair(&self, r_i: f64, r_j: f64) -> (f64, f64) {
        let start = r_i + r_j + self.kappa * r_i.min(r_j);
        (start, self.alpha * start + 2.0 * self.beta)
    }

    /// Distance from a wall at which a grain touches it at the start of the cycle, and its rate.
    #[inline(always)]
    pub(crate) fn wall(&self, r: f64) -> (f64, f64) {
        let start = self.wall_factor * r + self.wall_offset_mm;
        (start, self.alpha * start + self.wall_beta)
    }

    /// Distance of a grain from a face between two blocks at the start of the cycle, and its rate: with its share of
    /// what two grains on both sides keep between them.
    #[inline(always)]
    pub(crate) fn face(&self, r: f64) -> (f64, f64) {
        let share = 1.0 + 0.5 * self.kappa;
        (share * r, share * (self.alpha * r + self.beta))
    }

    /// Contact radius at a time.
    #[inline(always)]
    pub(crate) fn radius(&self, r: f64, t: f64) -> f64 {
        r + (self.alpha * r + self.beta) * t
    }
}
