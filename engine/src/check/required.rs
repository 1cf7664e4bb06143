//! What a request demands of every pair of grains and of every wall, read from the request itself.
//!
//! The distance rules stand here a second time, written as the request documents them, so that a mistake in
//! [`crate::distance`], which the packing methods use, does not pass the check.

use crate::elementary::hypot;
use crate::request::{Boundary, Distance, Specimen};

/// The demands of a request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Required {
    distance: Distance,
    specimen: Specimen,
}

impl Required {
    pub(super) fn new(distance: Distance, specimen: Specimen) -> Self {
        Self { distance, specimen }
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

    /// Edge lengths of the bounding box, which starts at the origin.
    pub(super) fn bounds_mm(&self) -> [f64; 3] {
        match self.specimen {
            Specimen::Box { size_mm, .. } => size_mm,
            Specimen::Cylinder { diameter_mm, height_mm } => [diameter_mm, diameter_mm, height_mm],
        }
    }

    /// Edge lengths with which the specimen repeats, if it does.
    pub(super) fn period_mm(&self) -> Option<[f64; 3]> {
        match self.specimen {
            Specimen::Box { size_mm, boundary: Boundary::Periodic } => Some(size_mm),
            Specimen::Box { boundary: Boundary::Walls, .. } | Specimen::Cylinder { .. } => None,
        }
    }

    /// Distance in mm from a point to the nearest wall; negative outside. Of a periodic box, to its nearest face.
    pub(super) fn wall_distance_mm(&self, [x, y, z]: [f64; 3]) -> f64 {
        let ends = |p: f64, length: f64| p.min(length - p);
        match self.specimen {
            Specimen::Box { size_mm: [a, b, c], .. } => ends(x, a).min(ends(y, b)).min(ends(z, c)),
            Specimen::Cylinder { diameter_mm, height_mm } => {
                let radius = 0.5 * diameter_mm;
                (radius - hypot(x - radius, y - radius)).min(ends(z, height_mm))
            }
        }
    }
}
