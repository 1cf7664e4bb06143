//! Specimens: the region that whole grains lie in, and the region that remains for their centres.

use std::f64::consts::PI;

use crate::arrays::Each as _;
use crate::elementary::{asin, hypot};
use crate::request::{Boundary, Specimen};

/// Relative margin by which centres keep further from walls than asked, so that the check, which
/// rounds differently, never sees a violation in the last digit.
const ROUNDING_MARGIN: f64 = 4.0 * f64::EPSILON;

impl Specimen {
    /// Volume in mm³.
    pub fn volume_mm3(&self) -> f64 {
        match *self {
            Self::Box { size_mm: [x, y, z], .. } => x * y * z,
            Self::Cylinder { diameter_mm, height_mm } => PI / 4.0 * diameter_mm * diameter_mm * height_mm,
        }
    }

    /// Edge lengths of the bounding box, which starts at the origin.
    pub fn bounds_mm(&self) -> [f64; 3] {
        match *self {
            Self::Box { size_mm, .. } => size_mm,
            Self::Cylinder { diameter_mm, height_mm } => [diameter_mm, diameter_mm, height_mm],
        }
    }

    /// Whether the specimen repeats in all directions.
    pub fn is_periodic(&self) -> bool {
        matches!(self, Self::Box { boundary: Boundary::Periodic, .. })
    }

    /// Largest clearance to the walls that some point of a cuboid has; infinite without walls.
    pub fn clearance_reaching_some(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        let between = |a: usize, length: f64| (center[a] + half[a]).min(length - center[a] + half[a]);
        match *self {
            Self::Box { boundary: Boundary::Periodic, .. } => f64::INFINITY,
            Self::Box { size_mm: [x, y, z], .. } => between(0, x).min(between(1, y)).min(between(2, z)),
            Self::Cylinder { diameter_mm, height_mm } => {
                let radius = diameter_mm / 2.0;
                let nearest = |a: usize| ((center[a] - radius).abs() - half[a]).max(0.0);
                (radius - hypot(nearest(0), nearest(1))).min(between(2, height_mm))
            }
        }
    }

    /// Smallest clearance to the walls of all points of a cuboid; infinite without walls.
    pub fn clearance_reaching_all(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        let between = |a: usize, length: f64| (center[a] - half[a]).min(length - center[a] - half[a]);
        match *self {
            Self::Box { boundary: Boundary::Periodic, .. } => f64::INFINITY,
            Self::Box { size_mm: [x, y, z], .. } => between(0, x).min(between(1, y)).min(between(2, z)),
            Self::Cylinder { diameter_mm, height_mm } => {
                let radius = diameter_mm / 2.0;
                let farthest = |a: usize| (center[a] - radius).abs() + half[a];
                (radius - hypot(farthest(0), farthest(1))).min(between(2, height_mm))
            }
        }
    }

    /// Where a centre may lie that keeps `clearance_mm` (radius and wall distance) from the walls;
    /// `None` where that leaves nothing.
    pub fn center_region(&self, clearance_mm: f64) -> Option<Region> {
        match *self {
            Self::Box { size_mm, boundary: Boundary::Periodic } => {
                Some(Region { low: [0.0; 3], high: size_mm, disc: None })
            }
            Self::Box { size_mm, boundary: Boundary::Walls } => {
                let [x, y, z] = size_mm.each(|length| interval(length, clearance_mm));
                let ((x0, x1), (y0, y1), (z0, z1)) = (x?, y?, z?);
                Some(Region { low: [x0, y0, z0], high: [x1, y1, z1], disc: None })
            }
            Self::Cylinder { diameter_mm, height_mm } => {
                let (z0, z1) = interval(height_mm, clearance_mm)?;
                let axis = diameter_mm / 2.0;
                let radius = axis - clearance_mm;
                if radius < 0.0 {
                    return None;
                }
                let radius = (radius - ROUNDING_MARGIN * diameter_mm).max(0.0);
                Some(Region {
                    low: [axis - radius, axis - radius, z0],
                    high: [axis + radius, axis + radius, z1],
                    disc: Some(Disc { center: [axis, axis], radius }),
                })
            }
        }
    }
}

/// The part of `0..length` that keeps a clearance from both ends.
fn interval(length: f64, clearance: f64) -> Option<(f64, f64)> {
    if 2.0 * clearance > length {
        return None;
    }
    let inset = clearance + ROUNDING_MARGIN * length;
    // A grain that fits exactly has one place.
    Some(if 2.0 * inset < length { (inset, length - inset) } else { (length / 2.0, length / 2.0) })
}

/// A region for centres: a box, cut by a disc in x and y where the specimen is a cylinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Lower corner in mm.
    pub low: [f64; 3],
    /// Upper corner in mm.
    pub high: [f64; 3],
    disc: Option<Disc>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Disc {
    center: [f64; 2],
    radius: f64,
}

impl Region {
    /// Whether a centre may lie at `p`.
    #[inline]
    pub fn contains(&self, p: [f64; 3]) -> bool {
        let inside = |a: usize| p[a] >= self.low[a] && p[a] <= self.high[a];
        inside(0)
            && inside(1)
            && inside(2)
            && self.disc.is_none_or(|disc| disc.distance2(p) <= disc.radius * disc.radius)
    }

    /// Whether a cube, given by its centre and half its edges, lies wholly outside.
    pub fn misses_cuboid(&self, center: [f64; 3], half: [f64; 3]) -> bool {
        let outside = |a: usize| center[a] + half[a] < self.low[a] || center[a] - half[a] > self.high[a];
        outside(0)
            || outside(1)
            || outside(2)
            || self.disc.is_some_and(|disc| {
                let gap = |a: usize| ((center[a] - disc.center[a]).abs() - half[a]).max(0.0);
                hypot(gap(0), gap(1)) > disc.radius
            })
    }

    /// Share of the volume that lies below a coordinate of an axis; a half where there is one coordinate only.
    pub(crate) fn share_below(&self, axis: usize, x: f64) -> f64 {
        let (low, high) = (self.low[axis], self.high[axis]);
        if low >= high {
            return 0.5;
        }
        let along = ((x - low) / (high - low)).clamp(0.0, 1.0);
        if axis < 2 && self.disc.is_some() {
            let t = 2.0 * along - 1.0;
            return 0.5 + (t * (1.0 - t * t).sqrt() + asin(t)) / PI;
        }
        along
    }

    /// Share of the volume that lies nearer to the axis than a point; of a box, which has none, a half.
    pub(crate) fn share_within(&self, p: [f64; 3]) -> f64 {
        match self.disc {
            Some(disc) if disc.radius > 0.0 => (disc.distance2(p) / (disc.radius * disc.radius)).min(1.0),
            _ => 0.5,
        }
    }

    /// Volume in mm³; 0 where only a point, a line or a plane is left.
    pub fn volume_mm3(&self) -> f64 {
        let edge = |a: usize| self.high[a] - self.low[a];
        match self.disc {
            None => edge(0) * edge(1) * edge(2),
            Some(disc) => PI * disc.radius * disc.radius * edge(2),
        }
    }
}

impl Disc {
    #[inline]
    fn distance2(&self, p: [f64; 3]) -> f64 {
        let (x, y) = (p[0] - self.center[0], p[1] - self.center[1]);
        x * x + y * y
    }
}
