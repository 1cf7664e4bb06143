//! Distance rules: the gap that two grains keep, and that to a wall.
//!
//! A rule is a function `g(d_i, d_j)` of two diameters: 0, a constant, `f (d_i + d_j) / 2` (Schlangen and van Mier),
//! or `f min(d_i, d_j)` (Wang and others). Where the request names no wall gap, a wall is kept at `g(d, d) / 2`.
//!
//! ```
//! use packstone_engine::{PackingRequest, distance::DistanceRule};
//! use serde_json::json;
//!
//! let request = PackingRequest::from_json(&json!({
//!     "specimen": {"type": "box", "size_mm": [50, 50, 50]},
//!     "mix": {"grading": {"type": "diameters", "diameters_mm": [8, 4]}},
//!     "distance": {"type": "proportional", "factor": 0.1},
//! }), 1).unwrap();
//! let rule = DistanceRule::new(&request.distance, &request.specimen);
//! assert!((rule.gap_mm(8.0, 4.0) - 0.6).abs() < 1e-12);
//! assert!((rule.wall_gap_mm(8.0) - 0.4).abs() < 1e-12);
//! ```

use crate::domain::Domain;
use crate::request::Distance;

/// A distance rule with its wall distance, ready to be evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceRule {
    kind: Kind,
    wall_gap_mm: Option<f64>,
    walls: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Constant(f64),
    Proportional(f64),
    SmallerDiameter(f64),
}

/// The exclusion between grains placed largest first, in additive form: the centre of a new grain
/// must stay `placed_factor r_j + part_mm` away from that of a placed grain of radius `r_j`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exclusion {
    /// Factor on the radius of the placed grain; the same for all grains of a run.
    pub placed_factor: f64,
    /// Part of the new grain.
    pub part_mm: f64,
}

/// A rule as contact distances: two grains touch at the sum of their contact radii
/// `factor r + offset_mm` and, where the rule is not additive, `smaller_share` times the smaller one;
/// a wall is touched at `wall_factor` times the contact radius plus `wall_offset_mm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContactParts {
    pub(crate) factor: f64,
    pub(crate) offset_mm: f64,
    pub(crate) smaller_share: f64,
    pub(crate) wall_factor: f64,
    pub(crate) wall_offset_mm: f64,
}

impl DistanceRule {
    /// The rule as contact distances.
    pub(crate) fn contact(&self) -> ContactParts {
        let (factor, offset_mm, smaller_share) = match self.kind {
            Kind::Constant(mm) => (1.0, mm / 2.0, 0.0),
            Kind::Proportional(factor) => (1.0 + factor, 0.0, 0.0),
            Kind::SmallerDiameter(factor) => (1.0, 0.0, 2.0 * factor),
        };
        let (wall_factor, wall_offset_mm) = match self.wall_gap_mm {
            // From the contact radius back to the true one, and on by the wall's own distance.
            Some(wall_gap_mm) => (1.0 / factor, wall_gap_mm - offset_mm),
            None => (1.0 + smaller_share / 2.0, 0.0),
        };
        ContactParts { factor, offset_mm, smaller_share, wall_factor, wall_offset_mm }
    }

    /// The rule of a request, in its specimen or in another domain.
    pub fn new(distance: &Distance, domain: impl Into<Domain>) -> Self {
        let (kind, wall_gap_mm) = match *distance {
            // What is to be maximized is no distance before the grains have grown.
            Distance::None { wall_gap_mm } | Distance::Maximize { wall_gap_mm } => {
                (Kind::Constant(0.0), wall_gap_mm)
            }
            Distance::Constant { gap_mm: mm, wall_gap_mm } => (Kind::Constant(mm), wall_gap_mm),
            Distance::Proportional { factor, wall_gap_mm } => (Kind::Proportional(factor), wall_gap_mm),
            Distance::SmallerDiameter { factor, wall_gap_mm } => (Kind::SmallerDiameter(factor), wall_gap_mm),
        };
        let walls = domain.into().has_walls();
        Self { kind, wall_gap_mm, walls }
    }

    /// The rule with all lengths scaled, as diameters are while they grow by a scale.
    pub(crate) fn scaled(&self, scale: f64) -> Self {
        let kind = match self.kind {
            Kind::Constant(mm) => Kind::Constant(scale * mm),
            other => other,
        };
        Self { kind, wall_gap_mm: self.wall_gap_mm.map(|mm| scale * mm), walls: self.walls }
    }

    /// Clear distance that grains of two diameters keep.
    pub fn gap_mm(&self, d_i: f64, d_j: f64) -> f64 {
        match self.kind {
            Kind::Constant(mm) => mm,
            Kind::Proportional(factor) => factor * (d_i + d_j) / 2.0,
            Kind::SmallerDiameter(factor) => factor * d_i.min(d_j),
        }
    }

    /// Clear distance that a grain keeps from the walls: by default half of what it keeps from its
    /// own kind, which is what enlarging the grains for the placement amounts to.
    pub fn wall_gap_mm(&self, d: f64) -> f64 {
        if self.walls { self.wall_gap_mm.unwrap_or(self.gap_mm(d, d) / 2.0) } else { 0.0 }
    }

    /// The exclusion that a new grain of diameter `d`, no larger than any placed one, meets.
    pub fn exclusion(&self, d: f64) -> Exclusion {
        match self.kind {
            Kind::Constant(mm) => Exclusion { placed_factor: 1.0, part_mm: d / 2.0 + mm },
            Kind::Proportional(factor) => {
                Exclusion { placed_factor: 1.0 + factor, part_mm: (1.0 + factor) * d / 2.0 }
            }
            Kind::SmallerDiameter(factor) => Exclusion { placed_factor: 1.0, part_mm: d / 2.0 + factor * d },
        }
    }

    /// The constant distance, where the rule has one.
    pub fn constant_mm(&self) -> Option<f64> {
        match self.kind {
            Kind::Constant(mm) => Some(mm),
            _ => None,
        }
    }

    /// `(factor, offset)` of the enlarged diameter `factor d + offset` with which grains may fill
    /// space like spheres without distance; a lower bound where the rule is not additive.
    pub fn enlargement(&self, d_min: f64) -> (f64, f64) {
        match self.kind {
            Kind::Constant(mm) => (1.0, mm),
            Kind::Proportional(factor) => (1.0 + factor, 0.0),
            // Two grains keep factor * min(d_i, d_j), at least that of the smallest pair.
            Kind::SmallerDiameter(factor) => (1.0, factor * d_min),
        }
    }
}
