//! What a run is likely to cost and whether it is likely to succeed, by a small model fitted to studies.
//!
//! Where random sequential addition ends, where grown packings jam, and how many events growth takes on
//! the way there, from a handful of moments of the sizes. The forms, the data they were fitted to, the
//! errors on cases left out of the fit, and how to fit again: `docs/estimates.md`. The module knows
//! sizes, walls and limits; it must never pack.

use super::rods::random_close;
use crate::elementary::{exp, ln, log10, powf};
use crate::methods::edmd::MOST_START;
use crate::request::GrowthOptions;

/// Random sequential addition: `-ln(1 - phi)` at its end is linear in moments of the sizes.
mod rsa {
    /// Equal spheres.
    pub(super) const EQUAL: f64 = 0.5195;
    /// Per standard deviation of ln(d) by volume.
    pub(super) const SPREAD: f64 = -0.688;
    /// Per mean of ln(d) by volume above that of the smallest grain.
    pub(super) const FINES: f64 = 0.9128;
    /// Per share of walls.
    pub(super) const WALLS: f64 = -0.1216;
    /// Standard error of the limit on cases left out, and of single runs about it.
    pub(super) const ERROR: f64 = 0.008;
    /// A limited number of attempts ends sooner: by this much per power of ten below 1e7.
    pub(super) const PER_DECADE_OF_ATTEMPTS: f64 = 0.025;
    /// Microseconds per grain in a loose specimen,
    pub(super) const LOOSE_US: f64 = 1.25;
    /// at the limit for equal spheres,
    pub(super) const CROWDED_US: f64 = 41.5;
    /// how fast that falls off below the limit (exponent per share of it),
    pub(super) const FALL_OFF: f64 = 12.4;
    /// and how it rises with the spread of sizes.
    pub(super) const CROWDED_SPREAD: f64 = 1.23;
    /// Cost of a cache that is too small: exponent of the number of grains over [`super::CACHED`].
    pub(super) const CACHE: f64 = 0.16;
}

/// Growth: jamming as a share of random close packing, and events per grain as a power law of the gap.
mod growth {
    pub(super) const BULK: f64 = 1.1197;
    /// Per share of walls, and its square.
    pub(super) const WALLS: f64 = -0.1241;
    pub(super) const WALLS_SQUARED: f64 = 0.05;
    /// Equal grains have nothing to exchange.
    pub(super) const EQUAL: f64 = -0.0106;
    /// Spread of ln(d) up to which grains are as good as equal.
    pub(super) const EQUAL_SPREAD: f64 = 0.05;
    /// Per cube root of the number of grains.
    pub(super) const FEW: f64 = -0.3678;
    /// ln of events per grain: at no gap and full size,
    pub(super) const EVENTS: f64 = -1.8665;
    /// per ln of the gap,
    pub(super) const GAP: f64 = -3.6566;
    /// per ln of the volume fraction over that of jamming,
    pub(super) const FILLED: f64 = -4.7432;
    /// and per ln of the share of the volume that is still to grow at the start.
    pub(super) const TO_GROW: f64 = 1.5492;
    /// Standard error of ln(events).
    pub(super) const ERROR: f64 = 0.4;
    /// Events per grain beyond which, by this power law, few runs of the studies succeeded: it is flatter near
    /// its end than they are.
    pub(super) const LAST_SUCCESS: f64 = 2000.0;
    /// Events per grain at which growth is usually found to have stalled.
    pub(super) const STALL: f64 = 4000.0;
    /// Microseconds per event while the grains stay in the cache, and the exponent beyond.
    pub(super) const EVENT_US: f64 = 0.56;
    pub(super) const EVENT_CACHE: f64 = 0.39;
    /// What the start costs per grain beside the random placing, likewise.
    pub(super) const START_US: f64 = 1.87;
    pub(super) const START_CACHE: f64 = 0.25;
}

/// Where growth starts, as a share of the limit of random sequential addition: where the time of both together was
/// least in measurements (`docs/estimates.md`, "Start of growth").
mod start {
    /// For a target at this share of the limit,
    pub(super) const TARGET: f64 = 0.867;
    /// the share is this,
    pub(super) const SHARE: f64 = 0.75;
    /// more by this per share of the target,
    pub(super) const PER_TARGET: f64 = 0.9;
    /// and per ln of the ratio of diameters above this one: events cost more in wide mixes.
    pub(super) const PER_RATIO: f64 = 0.107;
    pub(super) const RATIO: f64 = 8.0;
    /// Bounds of the share. Beyond the upper one random placing begins to fail.
    pub(super) const LEAST: f64 = 0.7;
    pub(super) const MOST: f64 = 0.88;
}

/// Grains that stay in the cache.
const CACHED: f64 = 1e4;
/// What the studies covered; beyond it an estimate extrapolates.
mod covered {
    pub(super) const RATIO: f64 = 16.0;
    pub(super) const SPREAD: f64 = 0.8;
    pub(super) const WALLS: f64 = 1.1;
    pub(super) const GRAINS: std::ops::RangeInclusive<f64> = 300.0..=3e6;
}

/// A mix as the model sees it, with the distances as a coating, in a specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Features {
    /// Volume fraction of a random close packing of these sizes, without walls.
    random_close: f64,
    /// Standard deviation of ln(d) by volume.
    spread: f64,
    /// Mean of ln(d) by volume above that of the smallest grain.
    fines: f64,
    /// Surface of the walls over the volume, times the ratio of the third to the second moment of the
    /// diameters.
    walls: f64,
    /// Largest diameter over the smallest.
    ratio: f64,
}

impl Features {
    /// Of diameters with their numbers from fine to coarse, the bounds that they stand within, and the
    /// surface of walls per volume in 1/mm.
    pub(crate) fn new(sizes: &[(f64, f64)], [least, largest]: [f64; 2], walls_per_mm: f64) -> Self {
        let moment = |of: &dyn Fn(f64) -> f64| sizes.iter().map(|&(d, number)| number * of(d)).sum::<f64>();
        let volume = moment(&|d| d.powi(3));
        let mean = moment(&|d| d.powi(3) * ln(d)) / volume;
        let variance = moment(&|d| d.powi(3) * (ln(d) - mean).powi(2)) / volume;
        Self {
            random_close: random_close(sizes),
            spread: variance.sqrt(),
            fines: mean - ln(least),
            walls: walls_per_mm * volume / moment(&|d| d * d),
            ratio: largest / least,
        }
    }

    /// Volume fraction of a random close packing of these sizes, without walls.
    pub(crate) fn random_close(&self) -> f64 {
        self.random_close
    }

    /// Surface of the walls over the volume, times the ratio of the third to the second moment of the diameters.
    pub(crate) fn walls(&self) -> f64 {
        self.walls
    }

    /// Standard deviation of ln(d) by volume.
    pub(crate) fn spread(&self) -> f64 {
        self.spread
    }

    /// Largest diameter over the smallest.
    pub(crate) fn ratio(&self) -> f64 {
        self.ratio
    }

    /// Volume fraction, coating included, at which random sequential addition ends.
    pub(crate) fn rsa_limit(&self, attempts_per_grain: Option<u64>) -> f64 {
        let voids =
            rsa::EQUAL + rsa::SPREAD * self.spread + rsa::FINES * self.fines + rsa::WALLS * self.walls;
        let fewer = attempts_per_grain.map_or(0.0, |attempts| (7.0 - log10(attempts as f64)).max(0.0));
        (1.0 - exp(-voids) - rsa::PER_DECADE_OF_ATTEMPTS * fewer).max(0.05)
    }

    /// Volume fraction, coating included, up to which random placing is cheaper than growth to a target; an infinite
    /// target stands for the largest distance.
    pub(crate) fn growth_start(&self, filled: f64) -> f64 {
        let limit = self.rsa_limit(None);
        let wide = ln((self.ratio / start::RATIO).max(1.0));
        let by_target = start::PER_TARGET * (filled / limit - start::TARGET);
        let share = start::SHARE + by_target + start::PER_RATIO * wide;
        limit * share.clamp(start::LEAST, start::MOST)
    }

    /// Volume fraction, coating included, from which growth to a target starts.
    fn starts_from(&self, filled: f64) -> f64 {
        self.growth_start(filled).min(MOST_START.powi(3) * filled)
    }

    /// Volume fraction, coating included, at which so many growing grains jam.
    pub(crate) fn jamming(&self, grains: f64) -> f64 {
        let equal = exp(-(self.spread / growth::EQUAL_SPREAD).powi(2));
        let share = growth::BULK
            + growth::WALLS * self.walls
            + growth::WALLS_SQUARED * self.walls.powi(2)
            + growth::EQUAL * equal
            + growth::FEW * powf(grains.max(1.0), -1.0 / 3.0);
        // Of very few grains in large walls nothing is known; they are not looser than that.
        self.random_close * share.max(0.5)
    }

    /// Events per grain that growth to a volume fraction takes; infinite where it jams before.
    pub(crate) fn events_per_grain(&self, filled: f64, grains: f64) -> f64 {
        let share = filled / self.jamming(grains);
        if share >= 1.0 {
            return f64::INFINITY;
        }
        let to_grow = 1.0 - self.starts_from(filled) / filled;
        let at_jamming = growth::EVENTS + growth::GAP * ln(1.0 - share) + growth::FILLED * ln(share);
        exp(at_jamming + growth::TO_GROW * ln(to_grow))
    }

    /// Time of random sequential addition in s, to its end or its success.
    pub(crate) fn rsa_time_s(&self, filled: f64, grains: f64, attempts_per_grain: Option<u64>) -> f64 {
        let crowding = (filled / self.rsa_limit(attempts_per_grain)).min(1.0);
        let crowded =
            rsa::CROWDED_US * exp(rsa::FALL_OFF * (crowding - 1.0) + rsa::CROWDED_SPREAD * self.spread);
        grains * (rsa::LOOSE_US + crowded) * 1e-6 * beyond_cache(grains, rsa::CACHE)
    }

    /// Probability that random sequential addition reaches a volume fraction.
    pub(crate) fn rsa_success(&self, filled: f64, attempts_per_grain: Option<u64>) -> f64 {
        normal((self.rsa_limit(attempts_per_grain) - filled) / rsa::ERROR)
    }

    /// Events per grain that the options leave growth.
    fn events_allowed(grains: f64, options: &GrowthOptions) -> f64 {
        let by_events = options.stop.events.map_or(f64::INFINITY, |events| events as f64 / grains);
        let by_time = options.stop.time_s.map_or(f64::INFINITY, |seconds| {
            ((seconds / grains - start_s(grains)) / event_s(grains)).max(0.0)
        });
        by_events.min(by_time)
    }

    /// Probability that growth reaches a volume fraction.
    pub(crate) fn growth_success(&self, filled: f64, grains: f64, options: &GrowthOptions) -> f64 {
        let needed = self.events_per_grain(filled, grains);
        let allowed = growth::LAST_SUCCESS.min(Self::events_allowed(grains, options));
        normal(ln(allowed / needed) / growth::ERROR)
    }

    /// Time of growth in s, to its end or its success.
    pub(crate) fn growth_time_s(&self, filled: f64, grains: f64, options: &GrowthOptions) -> f64 {
        let most = growth::STALL.min(Self::events_allowed(grains, options));
        let events = self.events_per_grain(filled, grains).min(most);
        let placing_s = self.rsa_time_s(self.starts_from(filled), grains, None);
        placing_s + grains * (start_s(grains) + events * event_s(grains))
    }

    /// Volume fraction up to which growth succeeds with a probability of 90 % within the options.
    pub(crate) fn growth_reach(&self, grains: f64, options: &GrowthOptions) -> f64 {
        bisect(0.0, self.jamming(grains), |filled| self.growth_success(filled, grains, options) >= LIKELY)
    }

    /// The same of random sequential addition.
    pub(crate) fn rsa_reach(&self, attempts_per_grain: Option<u64>) -> f64 {
        bisect(0.0, 1.0, |filled| self.rsa_success(filled, attempts_per_grain) >= LIKELY)
    }

    /// In what the mix lies beyond the studies, in words.
    pub(crate) fn beyond(&self, grains: f64) -> Vec<String> {
        let mut beyond = Vec::new();
        if self.ratio > covered::RATIO * 1.01 {
            beyond.push(format!("a ratio of diameters of {:.1} (up to {:.0})", self.ratio, covered::RATIO));
        }
        if self.spread > covered::SPREAD {
            beyond.push(format!(
                "a spread of ln(d) by volume of {:.2} (up to {})",
                self.spread,
                covered::SPREAD
            ));
        }
        if self.walls > covered::WALLS {
            beyond.push("a specimen that is small for its grains".into());
        }
        if !covered::GRAINS.contains(&grains) {
            let (from, to) = (covered::GRAINS.start(), covered::GRAINS.end());
            beyond.push(format!("{grains:.0} grains ({from} to {to})"));
        }
        beyond
    }
}

/// Events per grain at which growth is usually found to have stalled.
pub(crate) const STALL_EVENTS: f64 = growth::STALL;

/// What counts as likely.
pub(crate) const LIKELY: f64 = 0.9;

pub(super) fn event_s(grains: f64) -> f64 {
    growth::EVENT_US * 1e-6 * beyond_cache(grains, growth::EVENT_CACHE)
}

/// What starting to grow costs per grain.
fn start_s(grains: f64) -> f64 {
    growth::START_US * 1e-6 * beyond_cache(grains, growth::START_CACHE)
}

fn beyond_cache(grains: f64, exponent: f64) -> f64 {
    powf((grains / CACHED).max(1.0), exponent)
}

/// The largest value for which `holds`, which holds below it.
pub(crate) fn bisect(from: f64, to: f64, holds: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (from, to);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Distribution function of the standard normal distribution, to 1e-7 (Abramowitz and Stegun, 7.1.26).
fn normal(x: f64) -> f64 {
    const COEFFICIENTS: [f64; 5] =
        [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    if x.is_nan() {
        return 0.0;
    }
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs() / std::f64::consts::SQRT_2);
    let series = COEFFICIENTS.iter().rev().fold(0.0, |sum, c| (sum + c) * t);
    let tail = 0.5 * series * exp(-0.5 * x * x);
    if x >= 0.0 { 1.0 - tail } else { tail }
}
