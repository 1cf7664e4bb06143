//! The region that a domain leaves for the centres of grains.

use std::f64::consts::PI;

use super::{Domain, Lateral};
use crate::elementary::{asin, hypot};

/// Relative margin by which centres keep further from walls than asked, so that the check, which
/// rounds differently, never sees a violation in the last digit.
const ROUNDING_MARGIN: f64 = 4.0 * f64::EPSILON;

impl Domain {
    /// Where a centre may lie that keeps `clearance_mm` (radius and wall distance) from the walls;
    /// `None` where that leaves nothing.
    #[must_use]
    pub fn center_region(&self, clearance_mm: f64) -> Option<Region> {
        let mut region = Region { low: [0.0; 3], high: self.bounds_mm, disc: None };
        for axis in self.walled_axes() {
            (region.low[axis], region.high[axis]) = interval(self.bounds_mm[axis], clearance_mm)?;
        }
        if let Some(Lateral { center_mm, radius_mm }) = self.lateral() {
            let radius = radius_mm - clearance_mm;
            if radius < 0.0 {
                return None;
            }
            let radius = (radius - ROUNDING_MARGIN * (2.0 * radius_mm)).max(0.0);
            for (axis, center) in center_mm.into_iter().enumerate() {
                (region.low[axis], region.high[axis]) = (center - radius, center + radius);
            }
            region.disc = Some(Disc { center: center_mm, radius });
        }
        Some(region)
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
