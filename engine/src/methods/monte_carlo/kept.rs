//! The gap that grains keep, which is the one that they were made to keep or more: what growth of the gap has reached.
//!
//! A pair keeps every gap for which some direction `n` shows `s(n) >= g` ([`crate::gap`]). The normal of its planes
//! shows most pairs to be farther apart than the closest known one; only of a pair that is closer the largest gap is
//! looked for, by bisection between what the normal shows and what is known.

use super::group::{LANES, NO_NEIGHBOR, is_wall};
use super::system::Part;
use crate::gap::grain::{ConvexShape, Turned};
use crate::gap::linear::{Vector, dot, minus, norm, scaled, sum};

/// Share of the diameter of equal volume to which the gap of a pair is found.
const PRECISION: f64 = 1e-10;

impl<S: ConvexShape> Part<'_, S> {
    /// The constant gap that all grains keep beyond their rule, up to a most; pairs that are not listed keep that.
    pub(super) fn kept_gap(&self, most: f64) -> f64 {
        let mut kept = most;
        for i in self.hot.range() {
            let (hot, cold) = (&self.hot[i], &self.cold[i]);
            for group in &self.groups[cold.list.groups()] {
                for lane in 0..LANES {
                    let neighbor = group.neighbors[lane];
                    if neighbor == NO_NEIGHBOR || is_wall(neighbor) {
                        continue;
                    }
                    let (j, image) = self.frame.names.read(neighbor);
                    // Each pair once.
                    if j >= i {
                        let other = &self.hot[j];
                        let r = minus(sum(other.center, self.frame.shift(image)), hot.center);
                        let least = self.frame.rule.gap_mm(hot.d, other.d);
                        let turned = [&hot.turned, &other.turned];
                        kept =
                            of_pair(turned, r, group.unit(lane), [least, self.frame.extra_gap, kept], hot.d);
                    }
                }
            }
            if cold.list.is_near_itself() {
                let least = self.frame.rule.gap_mm(hot.d, hot.d);
                for r in self.own_images_near(&hot.turned, least + kept) {
                    let along = scaled(r, 1.0 / norm(r));
                    kept = of_pair([&hot.turned; 2], r, along, [least, self.frame.extra_gap, kept], hot.d);
                }
            }
            if self.frame.wall_share > 0.0 {
                let slack = |wall: u32| -self.frame.beyond_wall(wall, hot);
                let least = self.frame.container.walls().map(slack).fold(self.lateral_slack(hot).0, f64::min);
                kept = kept.min(self.frame.extra_gap + least / self.frame.wall_share);
            }
        }
        kept
    }
}

/// The gap that two grains keep beyond the least, which is at least one and of no interest above another one, to the
/// precision of a diameter; from a direction that may be near that of their gap.
fn of_pair<T: Turned>(
    [one, other]: [&T; 2],
    r: Vector,
    along: Vector,
    [least, from, known]: [f64; 3],
    d: f64,
) -> f64 {
    let shown = dot(r, along) - one.support_mm(along) - other.support_back_mm(along) - least;
    if shown >= known {
        return known;
    }
    let keeps = |gap: f64, normal: Vector| one.decide(other, r, least + gap, normal);
    let decision = keeps(known, along);
    if decision.is_apart {
        return known;
    }
    let (mut low, mut high, mut normal) = (shown.max(from), known, decision.normal);
    while high - low > PRECISION * d {
        let middle = low + (high - low) / 2.0;
        let decision = keeps(middle, normal);
        normal = decision.normal;
        if decision.is_apart { low = middle } else { high = middle }
    }
    low
}
