//! Balls that keep nodes out, sorted by the buckets that they touch, so that one bucket answers for a point.

use crate::geometry::cells::Cells;

/// Most buckets; beyond, they grow.
const MAX_BUCKETS: f64 = 4.0e6;
const NONE: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct Ball {
    center: [f64; 3],
    radius: f64,
}

/// The balls.
#[derive(Debug)]
pub(super) struct Balls {
    cells: Cells,
    all: Vec<Ball>,
    /// First link of each bucket.
    heads: Vec<u32>,
    /// Ball and next link.
    links: Vec<[u32; 2]>,
}

impl Balls {
    /// No balls yet, in a region from the origin to `bounds`, and most of a radius near `typical`.
    pub(super) fn new(bounds: [f64; 3], typical: f64) -> Self {
        let volume: f64 = bounds.iter().product();
        let width = (2.0 * typical).max((volume / MAX_BUCKETS).cbrt());
        let cells = Cells::new(bounds, width);
        Self { cells, all: Vec::new(), heads: vec![NONE; cells.count()], links: Vec::new() }
    }

    /// Adds a ball.
    pub(super) fn push(&mut self, center: [f64; 3], radius: f64) {
        let id = self.all.len() as u32;
        self.all.push(Ball { center, radius });
        let cells = self.cells;
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

    /// Whether some ball holds `p` inside.
    pub(super) fn holds(&self, p: [f64; 3]) -> bool {
        self.any_near(p, |ball, distance2| distance2 < ball.radius * ball.radius)
    }

    /// Whether one ball holds everything within `reach` of `p`.
    pub(super) fn cover(&self, p: [f64; 3], reach: f64) -> bool {
        self.any_near(p, |ball, distance2| {
            let left = ball.radius - reach;
            left > 0.0 && distance2 < left * left
        })
    }

    fn any_near(&self, p: [f64; 3], mut asked: impl FnMut(&Ball, f64) -> bool) -> bool {
        let mut link = self.heads[self.cells.cell_of(p)];
        while link != NONE {
            let [id, next] = self.links[link as usize];
            let ball = &self.all[id as usize];
            let distance2 = (0..3).map(|a| (p[a] - ball.center[a]).powi(2)).sum();
            if asked(ball, distance2) {
                return true;
            }
            link = next;
        }
        false
    }
}
