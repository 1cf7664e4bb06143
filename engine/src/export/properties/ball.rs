//! The exact volume that a ball and a voxel have in common.
//!
//! For a ball of radius `R` around the origin, the volume beyond `x = a` and `y = b`, from `z_0` to `z_1`, is a sum of
//! integrals of `h_a(r) = r^2 asin(a / r) + a sqrt(r^2 - a^2)` with `r^2 = R^2 - z^2`, where `h_a = ± pi r^2 / 2` for
//! `r < |a|`. Their antiderivative is symmetric in `a` and `z`:
//! `J(a, z) = P(z) asin(a / sqrt(R^2 - z^2)) + P(a) asin(z / sqrt(R^2 - a^2)) + 2/3 a z w - 2/3 R^3 atan(a z / (R w))`
//! with `P(z) = R^2 z - z^3 / 3` and `w^2 = R^2 - a^2 - z^2`. A voxel is the difference of four such volumes. `J`
//! belongs to planes of the grid, not to voxels; only where a vertical edge of a voxel meets the surface are others
//! needed.

use std::f64::consts::FRAC_PI_2;

use crate::elementary::{asin, atan2};

/// A ball, and a layer between two heights.
pub(super) struct Layer {
    radius: f64,
    heights: [f64; 2],
    /// `pi / 2` times the difference of `P` at the heights.
    half_disc: f64,
}

/// A plane across x or y, at a coordinate from the centre, with `J` at both heights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    at: f64,
    ends: [f64; 2],
}

impl Side {
    /// Its coordinate from the centre.
    pub(super) fn at(&self) -> f64 {
        self.at
    }
}

impl Layer {
    /// The part of a ball between two heights from its centre; none where they are all outside.
    pub(super) fn new(radius: f64, [low, high]: [f64; 2]) -> Option<Self> {
        let heights = [low.max(-radius), high.min(radius)];
        let mut layer = Self { radius, heights, half_disc: 0.0 };
        layer.half_disc = FRAC_PI_2 * (layer.p(heights[1]) - layer.p(heights[0]));
        (heights[0] < heights[1]).then_some(layer)
    }

    fn p(&self, z: f64) -> f64 {
        z * (self.radius * self.radius - z * z / 3.0)
    }

    fn j(&self, a: f64, z: f64) -> f64 {
        let r = self.radius;
        let q2 = (r - a) * (r + a);
        let sign = if a < 0.0 { -1.0 } else { 1.0 };
        if q2 <= 0.0 {
            return sign * FRAC_PI_2 * self.p(z);
        }
        let q = q2.sqrt();
        if z.abs() >= q {
            let of_end = FRAC_PI_2 * (self.p(z.abs()) + self.p(a.abs()) - 2.0 / 3.0 * r * r * r);
            return if (z < 0.0) == (a < 0.0) { of_end } else { -of_end };
        }
        let w = (q2 - z * z).max(0.0).sqrt();
        let disc = ((r - z) * (r + z)).sqrt();
        self.p(z) * asin((a / disc).clamp(-1.0, 1.0))
            + self.p(a) * asin(z / q)
            + 2.0 / 3.0 * (a * z * w - r * r * r * atan2(a * z, r * w))
    }

    /// A plane across x or y.
    pub(super) fn side(&self, at: f64) -> Side {
        Side { at, ends: self.heights.map(|z| self.j(at, z)) }
    }

    /// Where the columns beyond `a` and `b` are a corner of the disc.
    fn corner([a, b]: [&Side; 2], [from, to]: [f64; 2], ja: f64, jb: f64, half_disc: f64) -> f64 {
        (half_disc - ja - jb) / 2.0 + a.at * b.at * (to - from)
    }

    /// Where they are nothing, or all beyond a chord or two.
    fn chords(a: &Side, b: &Side, ja: f64, jb: f64, half_disc: f64) -> f64 {
        match (a.at < 0.0, b.at < 0.0) {
            (false, false) => 0.0,
            (true, false) => half_disc - jb,
            (false, true) => half_disc - ja,
            (true, true) => -ja - jb,
        }
    }

    /// The volume beyond two planes.
    fn beyond(&self, a: &Side, b: &Side) -> f64 {
        let whole = |side: &Side| side.ends[1] - side.ends[0];
        let [low, high] = self.heights;
        let q2 = self.radius * self.radius - a.at * a.at - b.at * b.at;
        let q = q2.max(0.0).sqrt();
        if q2 <= 0.0 || low >= q || high <= -q {
            return Self::chords(a, b, whole(a), whole(b), self.half_disc);
        }
        if low >= -q && high <= q {
            return Self::corner([a, b], self.heights, whole(a), whole(b), self.half_disc);
        }
        // Up to three parts, between which the vertical edge meets the surface.
        let at = |z: f64| [self.j(a.at, z), self.j(b.at, z), FRAC_PI_2 * self.p(z)];
        let known = |end: usize| [a.ends[end], b.ends[end], FRAC_PI_2 * self.p(self.heights[end])];
        let mut sum = 0.0;
        let mut from = (low, known(0));
        let top = (high, known(1));
        let breaks = [-q, q].map(|z| (low < z && z < high).then(|| (z, at(z))));
        for to in breaks.into_iter().flatten().chain([top]) {
            let [ja, jb, half_disc] = [0, 1, 2].map(|i| to.1[i] - from.1[i]);
            let is_inside = (from.0 + to.0).abs() < 2.0 * q;
            sum += if is_inside {
                Self::corner([a, b], [from.0, to.0], ja, jb, half_disc)
            } else {
                Self::chords(a, b, ja, jb, half_disc)
            };
            from = to;
        }
        sum
    }

    /// The volume between two planes across x and two across y.
    pub(super) fn volume(&self, x: [&Side; 2], y: [&Side; 2]) -> f64 {
        self.beyond(x[0], y[0]) - self.beyond(x[1], y[0]) - self.beyond(x[0], y[1]) + self.beyond(x[1], y[1])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::f64::consts::PI;

    use crate::properties::properties;
    use proptest::prelude::*;

    use super::*;

    fn volume(radius: f64, low: [f64; 3], high: [f64; 3]) -> f64 {
        let Some(layer) = Layer::new(radius, [low[2], high[2]]) else { return 0.0 };
        let side = |at: f64| layer.side(at);
        layer.volume([&side(low[0]), &side(high[0])], [&side(low[1]), &side(high[1])])
    }

    /// By a sum over lines along z.
    fn sampled(radius: f64, low: [f64; 3], high: [f64; 3]) -> f64 {
        let n = 400;
        let step = [0, 1].map(|axis| (high[axis] - low[axis]) / f64::from(n));
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let [x, y] = [i, j].map(|k| f64::from(k) + 0.5);
                let (x, y) = (low[0] + x * step[0], low[1] + y * step[1]);
                let half = (radius * radius - x * x - y * y).max(0.0).sqrt();
                sum += (high[2].min(half) - low[2].max(-half)).max(0.0);
            }
        }
        sum * step[0] * step[1]
    }

    properties! {
        #[test]
        fn volumes_are_those_of_sums_over_lines(
            low in prop::array::uniform3(-1.2..1.0_f64), edge in prop::array::uniform3(0.02..1.5_f64),
        ) {
            let high = [0, 1, 2].map(|axis| low[axis] + edge[axis]);
            let (found, expected) = (volume(1.0, low, high), sampled(1.0, low, high));
            prop_assert!((found - expected).abs() < 3e-4 * edge.iter().product::<f64>() + 1e-6, "{found} {expected}");
        }
    }

    #[test]
    fn the_parts_of_a_ball_add_up() {
        for (n, radius) in [(7, 1.0), (10, 3.3), (4, 0.01)] {
            let h = 2.2 * radius / f64::from(n);
            let node = |i: i32| f64::from(i) * h - 1.07 * radius;
            let mut sum = 0.0;
            for i in 0..n {
                for j in 0..n {
                    for k in 0..n {
                        let part = volume(radius, [i, j, k].map(node), [i, j, k].map(|i| node(i + 1)));
                        assert!(part > -1e-12 * radius.powi(3) && part < h * h * h * (1.0 + 1e-9), "{part}");
                        sum += part;
                    }
                }
            }
            assert!((sum / (4.0 / 3.0 * PI * radius.powi(3)) - 1.0).abs() < 1e-12, "{sum}");
        }
        // An octant, and a half.
        assert!((volume(2.0, [0.0; 3], [3.0; 3]) - PI * 8.0 / 6.0).abs() < 1e-13);
        assert!((volume(2.0, [-3.0, 0.0, -3.0], [3.0; 3]) - PI * 16.0 / 3.0).abs() < 1e-13);
    }
}
