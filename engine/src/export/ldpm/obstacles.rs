//! What keeps nodes out of a region: balls about the nodes so far, and grains with a clearance. They are sorted by the
//! buckets that they touch, so that one bucket answers for a point.

use nalgebra::Vector3;

use super::surface::Edge;
use crate::arrays::Each as _;
use crate::elementary::cbrt;
use crate::geometry::cells::Cells;
use crate::grain::{Grain, PlacedGrains};

/// Most buckets; beyond, they grow.
const MAX_BUCKETS: f64 = 4.0e6;
const NONE: u32 = u32::MAX;
/// Steps of the searches for the part of a line that a grain takes; each leaves 0.62 or a half of the interval.
const STEPS: u32 = 60;
/// Share of an interval in which the golden section is.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A ball, or a grain with its clearance within a ball.
#[derive(Clone, Copy, Debug)]
pub(super) struct Obstacle {
    center: [f64; 3],
    /// Radius of the ball that holds it.
    radius: f64,
    /// The grain with its clearance; none of a ball.
    grain: Option<(u32, f64)>,
}

impl Obstacle {
    /// A ball.
    pub(super) fn ball(center: [f64; 3], radius: f64) -> Self {
        Self { center, radius, grain: None }
    }

    /// The points within a clearance of a grain.
    pub(super) fn grain(grains: &PlacedGrains<'_>, grain: usize, clear_mm: f64) -> Self {
        let (center, own) = (grains.center_mm(grain), grains.grain(grain));
        let radius = own.outer_radius_mm() + clear_mm;
        let is_ball = own.inner_radius_mm() == own.outer_radius_mm();
        Self { center, radius, grain: (!is_ball).then_some((grain as u32, clear_mm)) }
    }

    /// Whether it holds everything within `reach` of `p`, as far as is easily proven.
    fn covers(&self, grains: &PlacedGrains<'_>, p: [f64; 3], reach: f64) -> bool {
        let distance2: f64 = (0..3).map(|a| (p[a] - self.center[a]).powi(2)).sum();
        let left = self.radius - reach;
        left > 0.0
            && distance2 < left * left
            && self.grain.is_none_or(|(grain, clear)| beyond_mm(grains, grain, p) + reach < clear)
    }

    /// The part of a line that it takes.
    pub(super) fn on_line(&self, grains: &PlacedGrains<'_>, edge: &Edge) -> Option<(f64, f64)> {
        let (from, to) = edge.inside(self.center, self.radius)?;
        let Some((grain, clear)) = self.grain else { return Some((from, to)) };
        // Beyond the surface by less than the clearance: that is an interval, for the grain is convex.
        let beyond = |along: f64| beyond_mm(grains, grain, edge.at(along)) - clear;
        let (mut low, mut high) = (from, to);
        let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
        let mut values = inner.each(beyond);
        for _ in 0..STEPS {
            if values.iter().any(|&value| value < 0.0) {
                break;
            }
            if values[0] < values[1] {
                (high, inner[1], values[1]) = (inner[1], inner[0], values[0]);
                inner[0] = high - GOLDEN * (high - low);
                values[0] = beyond(inner[0]);
            } else {
                (low, inner[0], values[0]) = (inner[0], inner[1], values[1]);
                inner[1] = low + GOLDEN * (high - low);
                values[1] = beyond(inner[1]);
            }
        }
        let inside = if values[0] <= values[1] { inner[0] } else { inner[1] };
        if beyond(inside) >= 0.0 {
            return None;
        }
        // The ends, on their outer sides.
        let end = |mut outside: f64| {
            let mut within = inside;
            for _ in 0..STEPS {
                let middle = 0.5 * (within + outside);
                if beyond(middle) < 0.0 { within = middle } else { outside = middle }
            }
            outside
        };
        Some((end(from), end(to)))
    }

    /// Whether it holds a point inside.
    pub(super) fn holds(&self, grains: &PlacedGrains<'_>, p: [f64; 3]) -> bool {
        self.covers(grains, p, 0.0)
    }
}

/// Distance of a point from the surface of a grain, as [`Grain::distance_mm`].
pub(super) fn beyond_mm(grains: &PlacedGrains<'_>, grain: u32, p: [f64; 3]) -> f64 {
    let from_center = Vector3::from(p) - Vector3::from(grains.center_mm(grain as usize));
    grains.grain(grain as usize).distance_mm(&from_center)
}

/// The obstacles.
#[derive(Debug)]
pub(super) struct Obstacles {
    cells: Cells,
    all: Vec<Obstacle>,
    /// First link of each bucket.
    heads: Vec<u32>,
    /// Obstacle and next link.
    links: Vec<[u32; 2]>,
}

impl Obstacles {
    /// No obstacles yet, in a region from the origin to `bounds`, and most of a radius near `typical`.
    pub(super) fn new(bounds: [f64; 3], typical: f64) -> Self {
        let volume: f64 = bounds.iter().product();
        let width = (2.0 * typical).max(cbrt(volume / MAX_BUCKETS));
        let cells = Cells::new(bounds, width);
        Self { cells, all: Vec::new(), heads: vec![NONE; cells.count()], links: Vec::new() }
    }

    /// Adds an obstacle.
    pub(super) fn push(&mut self, obstacle: Obstacle) {
        let id = self.all.len() as u32;
        self.all.push(obstacle);
        let cells = self.cells;
        let Obstacle { center, radius, .. } = obstacle;
        let [x, y, z] = [0, 1, 2].map(|a| cells.span(a, center[a] - radius, center[a] + radius));
        for z in z {
            for y in y.clone() {
                for x in x.clone() {
                    let bucket = cells.number([x, y, z]);
                    self.links.push([id, self.heads[bucket]]);
                    self.heads[bucket] = self.links.len() as u32 - 1;
                }
            }
        }
    }

    /// Whether some obstacle holds `p` inside.
    pub(super) fn hold(&self, grains: &PlacedGrains<'_>, p: [f64; 3]) -> bool {
        self.any_near(p, |obstacle| obstacle.holds(grains, p))
    }

    /// Whether one obstacle holds everything within `reach` of `p`, as far as is easily proven.
    pub(super) fn cover(&self, grains: &PlacedGrains<'_>, p: [f64; 3], reach: f64) -> bool {
        self.any_near(p, |obstacle| obstacle.covers(grains, p, reach))
    }

    fn any_near(&self, p: [f64; 3], mut asked: impl FnMut(&Obstacle) -> bool) -> bool {
        let mut link = self.heads[self.cells.cell_of(p)];
        while link != NONE {
            let [id, next] = self.links[link as usize];
            if asked(&self.all[id as usize]) {
                return true;
            }
            link = next;
        }
        false
    }
}
