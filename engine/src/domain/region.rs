//! The region that a domain leaves for the centres of grains.

use std::f64::consts::PI;

use super::polytope::Polytope;
use super::{Domain, FacePlane, Lateral, MOST_FACES};
use crate::elementary::{asin, hypot};

/// Relative margin by which centres keep further from walls than asked, so that the check, which
/// rounds differently, never sees a violation in the last digit.
const ROUNDING_MARGIN: f64 = 4.0 * f64::EPSILON;

impl Domain {
    /// Where a centre may lie that keeps `clearance_mm` (radius and wall distance) from the walls;
    /// `None` where that leaves nothing.
    #[must_use]
    pub fn center_region(&self, clearance_mm: f64) -> Option<Region> {
        let mut region = Region { low: [0.0; 3], high: self.bounds_mm, cut: Cut::Nothing };
        for axis in self.walled_axes() {
            (region.low[axis], region.high[axis]) = interval(self.bounds_mm[axis], clearance_mm)?;
        }
        if self.has_oblique {
            let inset_mm = clearance_mm + ROUNDING_MARGIN * self.bounds_mm.iter().sum::<f64>();
            return region.between(self.oblique_walls(), inset_mm);
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
            region.cut = Cut::Disc(Disc { center: center_mm, radius });
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

/// A region for centres: a box, cut by a disc in x and y where the specimen is a cylinder, or by planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Lower corner in mm.
    pub low: [f64; 3],
    /// Upper corner in mm.
    pub high: [f64; 3],
    cut: Cut,
}

/// What cuts the box of a region. A region is copied with its planes: searches that ask it millions of times read it
/// from where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)]
enum Cut {
    Nothing,
    Disc(Disc),
    Planes { inside: [Option<FacePlane>; MOST_FACES], volume_mm3: f64 },
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Disc {
    center: [f64; 2],
    radius: f64,
}

impl Region {
    /// The part of a box that keeps a distance from oblique walls; `None` where there is none.
    fn between(mut self, walls: impl Iterator<Item = FacePlane>, inset_mm: f64) -> Option<Self> {
        let moved = walls.map(|wall| FacePlane { offset_mm: wall.offset_mm + inset_mm, ..wall });
        let mut inside = [None; MOST_FACES];
        let mut all: Vec<FacePlane> = Vec::new();
        for (place, wall) in inside.iter_mut().zip(moved) {
            *place = Some(wall);
            all.push(wall);
        }
        for axis in 0..3 {
            let [low, high] = FacePlane::pair(axis, self.high[axis]);
            all.extend([FacePlane { offset_mm: self.low[axis], ..low }, high]);
        }
        let polytope = Polytope::between(&all)?;
        for axis in 0..3 {
            let along = || polytope.corners_mm.iter().map(|corner| corner[axis]);
            self.low[axis] = self.low[axis].max(along().reduce(f64::min)?);
            self.high[axis] = self.high[axis].min(along().reduce(f64::max)?);
        }
        self.cut = Cut::Planes { inside, volume_mm3: polytope.volume_mm3 };
        Some(self)
    }

    /// Whether a centre may lie at `p`.
    #[inline]
    pub fn contains(&self, p: [f64; 3]) -> bool {
        let inside = |a: usize| p[a] >= self.low[a] && p[a] <= self.high[a];
        inside(0)
            && inside(1)
            && inside(2)
            && match &self.cut {
                Cut::Nothing => true,
                Cut::Disc(disc) => disc.distance2(p) <= disc.radius * disc.radius,
                Cut::Planes { inside, .. } => {
                    inside.iter().flatten().all(|plane| plane.distance_mm(p) >= 0.0)
                }
            }
    }

    /// Whether a cuboid, given by its centre and half its edges, lies wholly outside of a face of the region.
    pub fn misses_cuboid(&self, center: [f64; 3], half: [f64; 3]) -> bool {
        let outside = |a: usize| center[a] + half[a] < self.low[a] || center[a] - half[a] > self.high[a];
        outside(0)
            || outside(1)
            || outside(2)
            || match &self.cut {
                Cut::Nothing => false,
                Cut::Disc(disc) => {
                    let gap = |a: usize| ((center[a] - disc.center[a]).abs() - half[a]).max(0.0);
                    hypot(gap(0), gap(1)) > disc.radius
                }
                Cut::Planes { inside, .. } => inside
                    .iter()
                    .flatten()
                    .any(|plane| plane.distance_mm(center) + plane.half_width_mm(half) < 0.0),
            }
    }

    /// Share of the volume that lies below a coordinate of an axis, of the box around the region where planes cut it; a
    /// half where there is one coordinate only.
    pub(crate) fn share_below(&self, axis: usize, x: f64) -> f64 {
        let (low, high) = (self.low[axis], self.high[axis]);
        if low >= high {
            return 0.5;
        }
        let along = ((x - low) / (high - low)).clamp(0.0, 1.0);
        if axis < 2 && matches!(self.cut, Cut::Disc(_)) {
            let t = 2.0 * along - 1.0;
            return 0.5 + (t * (1.0 - t * t).sqrt() + asin(t)) / PI;
        }
        along
    }

    /// Share of the volume that lies nearer to the axis than a point; of a region without an axis a half.
    pub(crate) fn share_within(&self, p: [f64; 3]) -> f64 {
        match self.cut {
            Cut::Disc(disc) if disc.radius > 0.0 => {
                (disc.distance2(p) / (disc.radius * disc.radius)).min(1.0)
            }
            _ => 0.5,
        }
    }

    /// Volume in mm³; 0 where only a point, a line or a plane is left.
    pub fn volume_mm3(&self) -> f64 {
        let edge = |a: usize| self.high[a] - self.low[a];
        match self.cut {
            Cut::Nothing => edge(0) * edge(1) * edge(2),
            Cut::Disc(disc) => PI * disc.radius * disc.radius * edge(2),
            Cut::Planes { volume_mm3, .. } => volume_mm3,
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
