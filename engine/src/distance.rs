//! Distance rules: the clear distance two grains keep, and that to a wall (`engine.md` section 3).

use crate::request::{Boundary, Distance, Specimen};

/// A distance rule with its wall distance, ready to be evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceRule {
    kind: Kind,
    wall_mm: Option<f64>,
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

impl DistanceRule {
    /// The rule of a request.
    pub fn new(distance: &Distance, specimen: &Specimen) -> Self {
        let (kind, wall_mm) = match *distance {
            // What is to be maximized is no distance before the grains have grown.
            Distance::None { wall_mm } | Distance::Maximize { wall_mm } => (Kind::Constant(0.0), wall_mm),
            Distance::Constant { mm, wall_mm } => (Kind::Constant(mm), wall_mm),
            Distance::Proportional { factor, wall_mm } => (Kind::Proportional(factor), wall_mm),
            Distance::SmallerDiameter { factor, wall_mm } => (Kind::SmallerDiameter(factor), wall_mm),
        };
        let walls = !matches!(specimen, Specimen::Box { boundary: Boundary::Periodic, .. });
        Self { kind, wall_mm, walls }
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
        if self.walls { self.wall_mm.unwrap_or(self.gap_mm(d, d) / 2.0) } else { 0.0 }
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
