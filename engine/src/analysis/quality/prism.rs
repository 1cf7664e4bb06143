//! Volume of a sphere within an upright prism: a cuboid, or a cylinder along z.
//!
//! A horizontal section of the sphere is a disc, whose area within a rectangle or a disc is known in closed form; over
//! the height it is integrated by Simpson's rule in the angle `theta` of `z = r sin theta`. Where one plane alone cuts
//! the sphere, the volume of the cap is in closed form.

use std::f64::consts::PI;

use crate::elementary::{acos, asin, cos, hypot};
use crate::mix::sphere_volume;

/// Steps of Simpson's rule, an even number.
const STEPS: usize = 48;

/// What a horizontal section of the prism is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Section {
    /// Bounds along x and y.
    Rectangle { low: [f64; 2], high: [f64; 2] },
    /// A disc.
    Disc { center: [f64; 2], radius: f64 },
}

/// A prism along z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prism {
    pub(super) section: Section,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Prism {
    pub(super) fn volume(&self) -> f64 {
        let area = match self.section {
            Section::Rectangle { low, high } => (high[0] - low[0]) * (high[1] - low[1]),
            Section::Disc { radius, .. } => PI * radius * radius,
        };
        area * (self.high - self.low)
    }

    /// Volume of a sphere within it.
    pub(super) fn common_volume(&self, [x, y, z]: [f64; 3], r: f64) -> f64 {
        // How far the sphere reaches beyond each boundary: not at all where it is below 0, wholly where it is above 2
        // r.
        let ends = [self.low - (z - r), z + r - self.high];
        let (sides, count) = match self.section {
            Section::Rectangle { low, high } => {
                ([low[0] - (x - r), x + r - high[0], low[1] - (y - r), y + r - high[1]], 4)
            }
            Section::Disc { center, radius } => {
                let beyond = hypot(x - center[0], y - center[1]) + r - radius;
                ([beyond, 0.0, 0.0, 0.0], 1)
            }
        };
        let mut planes = ends.into_iter().chain(sides.into_iter().take(count)).filter(|beyond| *beyond > 0.0);
        let (first, second) = (planes.next(), planes.next());
        let all = sphere_volume(2.0 * r);
        let is_plane = count == 4 || sides[0] <= 0.0;
        match (first, second) {
            (None, _) => all,
            (Some(beyond), None) if is_plane => {
                let h = beyond.min(2.0 * r);
                (all - PI * h * h * (r - h / 3.0)).max(0.0)
            }
            _ if ends.into_iter().chain(sides).any(|beyond| beyond >= 2.0 * r) && count == 4 => 0.0,
            _ => self.integral([x, y, z], r),
        }
    }

    fn integral(&self, [x, y, z]: [f64; 3], r: f64) -> f64 {
        let angle = |height: f64| asin(((height - z) / r).clamp(-1.0, 1.0));
        let (from, to) = (angle(self.low), angle(self.high));
        if to <= from {
            return 0.0;
        }
        let step = (to - from) / STEPS as f64;
        let mut sum = 0.0;
        for k in 0..=STEPS {
            let cosine = cos(from + k as f64 * step).max(0.0);
            let weight = match k {
                0 | STEPS => 1.0,
                k if k % 2 == 1 => 4.0,
                _ => 2.0,
            };
            let s = r * cosine;
            let area = match self.section {
                Section::Rectangle { low, high } => in_rectangle([x, y], s, low, high),
                Section::Disc { center, radius } => lens(hypot(x - center[0], y - center[1]), s, radius),
            };
            sum += weight * area * s;
        }
        sum * step / 3.0
    }
}

/// Area of a disc within a rectangle.
fn in_rectangle(center: [f64; 2], radius: f64, low: [f64; 2], high: [f64; 2]) -> f64 {
    if radius <= 0.0 {
        return 0.0;
    }
    let unit = |axis: usize, bound: f64| ((bound - center[axis]) / radius).clamp(-1.0, 1.0);
    let (x0, x1) = (unit(0, low[0]), unit(0, high[0]));
    let (y0, y1) = (unit(1, low[1]), unit(1, high[1]));
    let beyond = beyond_corner;
    radius * radius * (beyond(x0, y0) - beyond(x1, y0) - beyond(x0, y1) + beyond(x1, y1)).max(0.0)
}

/// Area of the unit disc where x and y are both above a bound from -1 to 1.
fn beyond_corner(p: f64, q: f64) -> f64 {
    let segment = |h: f64| acos(h) - h * (1.0 - h * h).max(0.0).sqrt();
    if p * p + q * q < 1.0 {
        let part = |h: f64| (asin(h) + h * (1.0 - h * h).sqrt()) / 2.0;
        return PI / 4.0 - part(p) - part(q) + p * q;
    }
    // The corner lies outside of the disc.
    match (p > 0.0, q > 0.0) {
        (true, true) => 0.0,
        (true, false) => segment(p),
        (false, true) => segment(q),
        (false, false) => PI - segment(-p) - segment(-q),
    }
}

/// Area that two discs have in common.
fn lens(distance: f64, a: f64, b: f64) -> f64 {
    if a <= 0.0 || b <= 0.0 || distance >= a + b {
        return 0.0;
    }
    if distance <= (a - b).abs() {
        return PI * a.min(b).powi(2);
    }
    let segment = |radius: f64, other: f64| {
        let h = ((distance * distance + radius * radius - other * other) / (2.0 * distance * radius))
            .clamp(-1.0, 1.0);
        radius * radius * (acos(h) - h * (1.0 - h * h).max(0.0).sqrt())
    };
    segment(a, b) + segment(b, a)
}

#[cfg(test)]
#[path = "prism_tests.rs"]
mod tests;
