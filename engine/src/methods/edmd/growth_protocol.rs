//! Growth protocols: distance rules as contact radii, and what grows towards them.
//!
//! A prescribed target grows everything by one scale, gaps included, so that at scale 1 every pair and every wall
//! keeps exactly what its rule asks for; the largest distance grows all radii by the same length.

use super::growth::Growth;
use super::tolerances::BEYOND_TARGET;
use crate::distance::DistanceRule;

/// Contact radii at the target, and what turns them into those of a cycle.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GrowthProtocol {
    /// Contact radii at the target by rank, falling, in mm; where distances grow, the true radii.
    pub(crate) radii_mm: Vec<f64>,
    kappa: f64,
    wall_factor: f64,
    wall_offset_mm: f64,
    /// The wall distance where it is prescribed while the distance between grains grows.
    fixed_wall_mm: Option<f64>,
}

impl GrowthProtocol {
    /// Growth by a scale towards a distance rule.
    pub(crate) fn scaled(diameters_mm: &[f64], rule: &DistanceRule) -> Self {
        let parts = rule.contact();
        Self {
            radii_mm: diameters_mm.iter().map(|d| parts.factor * d / 2.0 + parts.offset_mm).collect(),
            kappa: parts.smaller_share,
            wall_factor: parts.wall_factor,
            wall_offset_mm: parts.wall_offset_mm,
            fixed_wall_mm: None,
        }
    }

    /// Growth of all radii by one length, from the true ones.
    pub(crate) fn lengthened(diameters_mm: &[f64], wall_gap_mm: Option<f64>) -> Self {
        Self {
            // Beyond the target from the start, so that the check sees no overlap however little the
            // distance grows.
            radii_mm: diameters_mm.iter().map(|d| d / 2.0 * BEYOND_TARGET).collect(),
            kappa: 0.0,
            wall_factor: 1.0,
            wall_offset_mm: 0.0,
            fixed_wall_mm: wall_gap_mm.map(|mm| mm * BEYOND_TARGET),
        }
    }

    /// The growth of a cycle that starts at a scale, with a relative rate in 1/s.
    pub(crate) fn by_scale(&self, scale: f64, alpha: f64) -> Growth {
        Growth {
            alpha,
            beta: 0.0,
            kappa: self.kappa,
            wall_factor: self.wall_factor,
            wall_offset_mm: scale * self.wall_offset_mm,
            wall_beta: 0.0,
        }
    }

    /// The growth of a cycle in which radii are `half_mm` longer than the true ones at its start,
    /// with a rate in mm/s.
    pub(crate) fn by_length(&self, half_mm: f64, beta: f64) -> Growth {
        Growth {
            alpha: 0.0,
            beta,
            kappa: 0.0,
            wall_factor: 1.0,
            wall_offset_mm: self.fixed_wall_mm.map_or(0.0, |wall_gap_mm| wall_gap_mm - half_mm),
            wall_beta: if self.fixed_wall_mm.is_some() { 0.0 } else { beta },
        }
    }
}
