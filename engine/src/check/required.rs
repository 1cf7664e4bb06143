//! What a request demands of every pair of grains and of every wall, read from the request itself.
//!
//! The distance rules stand here a second time, written as the request documents them, so that a mistake in
//! [`crate::distance`], which the packing methods use, does not pass the check.

use super::region::SpecimenRegion;
use crate::request::Distance;

/// The demands of a request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Required<R = SpecimenRegion> {
    distance: Distance,
    region: R,
}

impl<R> Required<R> {
    pub(super) fn new(distance: Distance, region: R) -> Self {
        Self { distance, region }
    }

    /// Gap in mm that grains of two diameters keep: 0, the constant `gap_mm`, `factor` times the mean of the
    /// diameters, or `factor` times the smaller diameter. Of a distance that is to be maximized, 0: what was reached
    /// is checked as a constant distance.
    #[inline(always)]
    pub(super) fn gap_mm(&self, d_i: f64, d_j: f64) -> f64 {
        match self.distance {
            Distance::None { .. } | Distance::Maximize { .. } => 0.0,
            Distance::Constant { gap_mm, .. } => gap_mm,
            Distance::Proportional { factor, .. } => factor * 0.5 * (d_i + d_j),
            Distance::SmallerDiameter { factor, .. } => factor * if d_i < d_j { d_i } else { d_j },
        }
    }

    /// Gap in mm that a grain keeps from the walls: the one that the request names, or half of what the grain keeps
    /// from its like.
    pub(super) fn wall_gap_mm(&self, d: f64) -> f64 {
        let (Distance::None { wall_gap_mm }
        | Distance::Maximize { wall_gap_mm }
        | Distance::Constant { wall_gap_mm, .. }
        | Distance::Proportional { wall_gap_mm, .. }
        | Distance::SmallerDiameter { wall_gap_mm, .. }) = self.distance;
        wall_gap_mm.unwrap_or(0.5 * self.gap_mm(d, d))
    }

    /// The region that the grains lie in.
    pub(super) fn region(&self) -> &R {
        &self.region
    }
}
