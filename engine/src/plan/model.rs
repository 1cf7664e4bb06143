//! What a run is likely to cost and whether it is likely to succeed, by a small model fitted to studies.
//!
//! Where random sequential addition ends, where grown packings jam, and how many events growth takes on
//! the way there, from a handful of moments of the sizes. The forms, the data they were fitted to, the
//! errors on cases left out of the fit, and how to fit again: `docs/estimates.md`. The module knows
//! sizes, walls and limits; it must never pack.

use super::grains::{self, Size};
use super::random;
use super::rods::random_close;
use crate::elementary::{exp, ln, log10, powf};
use crate::methods::edmd::MOST_START;
use crate::mix::MeanForm;
use crate::request::GrowthOptions;

/// Random sequential addition, whose reach is that of [`random`](super::random).
mod rsa {
    /// Standard error of the reach on the mixes of the fit,
    pub(super) const ERROR: f64 = 0.007;
    /// and of single runs about it, times the root of the number of grains.
    pub(super) const RUNS: f64 = 0.08;
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
    pub(super) const BULK: f64 = 1.0973;
    /// Per share of walls.
    pub(super) const WALLS: f64 = -0.1068;
    /// Equal grains have nothing to exchange.
    pub(super) const EQUAL: f64 = -0.0316;
    /// Spread of ln(d) up to which grains are as good as equal.
    pub(super) const EQUAL_SPREAD: f64 = 0.05;
    /// Per inverse cube root of the number of grains,
    pub(super) const FEW: f64 = -0.1465;
    /// and per inverse number of them, which counts for fewer than some dozens.
    pub(super) const VERY_FEW: f64 = -0.535;
    /// One or two grains between walls are not looser than that.
    pub(super) const LEAST: f64 = 0.3;
    /// ln of events per grain: at no gap and full size,
    pub(super) const EVENTS: f64 = 2.4739;
    /// per ln of the gap,
    pub(super) const GAP: f64 = -1.9856;
    /// per ln of the volume fraction over that of jamming,
    pub(super) const FILLED: f64 = 2.1896;
    /// and per ln of the share of the volume that is still to grow at the start.
    pub(super) const TO_GROW: f64 = 1.6819;
    /// Standard error of ln(events),
    pub(super) const ERROR: f64 = 0.4;
    /// and that of the volume fraction of jamming on mixes that no fit has seen,
    pub(super) const JAMMING_ERROR: f64 = 0.01;
    /// more per inverse number of grains.
    pub(super) const JAMMING_ERROR_OF_FEW: f64 = 0.15;
    /// Events per grain beyond which, by this power law, few runs of the studies succeeded: it is flatter near
    /// its end than they are.
    pub(super) const LAST_SUCCESS: f64 = 2000.0;
    /// Share of jamming that nine of ten runs reach.
    pub(super) const REACH: f64 = 0.959;
    /// Events per grain at which growth is usually found to have stalled,
    pub(super) const STALL: f64 = 4000.0;
    /// and the time of growth that jams near its target, and is expanded and tried again, in that of such a stall.
    pub(super) const STALLS_NEAR_TARGET: f64 = 7.0;
    /// Near the reach wide mixes take longer than their events: by this much more at the reach, per standard deviation
    /// of ln(d) by volume,
    pub(super) const NEAR: f64 = 8.0;
    /// and a quarter as much at this share of the reach below it.
    pub(super) const NEAR_WIDTH: f64 = 0.024;
    /// Microseconds per event while the grains stay in the cache, and the exponent beyond.
    pub(super) const EVENT_US: f64 = 0.56;
    pub(super) const EVENT_CACHE: f64 = 0.39;
    /// What the start costs per grain beside the random placing, likewise.
    pub(super) const START_US: f64 = 1.87;
    pub(super) const START_CACHE: f64 = 0.25;
}

/// Growth by moves: what it reaches over what growth of spheres does, by the form of the grains.
mod moves {
    /// ln of the share of grains that are a little longer or flatter: they pack denser (Donev et al. 2004,
    /// 10.1126/science.1093010),
    pub(super) const ASPHERICAL: f64 = 0.048;
    /// and few of them order: the same per inverse cube root of the number of grains.
    pub(super) const FEW: f64 = 0.445;
    /// Fewer were not measured, and are taken as this number.
    pub(super) const FEWEST: f64 = 22.0;
    /// Both are reached at about this ln of surface times width;
    pub(super) const SMALL: f64 = 0.08;
    /// per ln of the surface, and of the mean width, over those of spheres;
    pub(super) const SURFACE: f64 = -0.169;
    pub(super) const WIDTH: f64 = -0.420;
    /// of polyhedra, and of cuboids, which order.
    pub(super) const ANGULAR: f64 = -0.042;
    pub(super) const CUBOID: f64 = 0.117;
    /// Share of jamming that nine of ten runs reach.
    pub(super) const REACH: f64 = 0.98;
    /// Standard error of the reach on the mixes of the fit, and of single runs.
    pub(super) const ERROR: f64 = 0.018;
    pub(super) const RUNS: f64 = 0.006;
}

/// Where growth starts, as a share of the limit of random sequential addition: where the time of both together was
/// least in measurements (`docs/estimates.md`, "Start of growth").
mod start {
    /// The limit of random addition by which starts were chosen: `-ln(1 - phi)` for equal spheres,
    pub(super) const EQUAL: f64 = 0.5195;
    /// per standard deviation of ln(d) by volume,
    pub(super) const SPREAD: f64 = -0.688;
    /// per mean of ln(d) by volume above that of the smallest grain,
    pub(super) const FINES: f64 = 0.9128;
    /// and per share of walls.
    pub(super) const WALLS: f64 = -0.1216;
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
    /// Factor on standard errors there.
    pub(super) const WIDER: f64 = 1.5;
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
    /// Volume fraction that nine of ten runs of random sequential addition reach,
    random: f64,
    /// share of the number of grains that are at least as large as those that end it,
    ending_share: f64,
    /// and the standard deviation of single runs.
    random_runs: f64,
    /// Number of the grains.
    grains: f64,
    /// Surface of the walls over the volume, times the ratio of the third to the second moment of the
    /// diameters.
    walls: f64,
    /// Largest diameter over the smallest.
    ratio: f64,
    /// Surface and mean width of the grains over those of spheres, in the mean by volume;
    surface: f64,
    width: f64,
    /// the share of polyhedra, and that of cuboids less their rounding.
    angular: f64,
    cuboid: f64,
}

impl Features {
    /// Of diameters with their numbers from fine to coarse, the bounds that they stand within, and the
    /// surface of walls per volume in 1/mm; `grains` are the same sizes with their forms, whose
    /// mean is `form`.
    pub(crate) fn new(
        sizes: &[(f64, f64)],
        grains: &[Size],
        [least, largest]: [f64; 2],
        walls_per_mm: f64,
        form: MeanForm,
    ) -> Self {
        let moment = |of: &dyn Fn(f64) -> f64| sizes.iter().map(|&(d, number)| number * of(d)).sum::<f64>();
        let volume = moment(&|d| d.powi(3));
        let mean = moment(&|d| d.powi(3) * ln(d)) / volume;
        let number = moment(&|_| 1.0);
        let random::Reach { volume_fraction: random, ending_share } =
            random::reach(grains, walls_per_mm, form.angular);
        let variance = moment(&|d| d.powi(3) * (ln(d) - mean).powi(2)) / volume;
        let [surface, width] = grains::surface_and_width(grains);
        Self {
            random_close: random_close(sizes),
            spread: variance.sqrt(),
            fines: mean - ln(least),
            random,
            ending_share,
            random_runs: rsa::RUNS / number.max(1.0).sqrt(),
            grains: number,
            walls: walls_per_mm * volume / moment(&|d| d * d),
            ratio: largest / least,
            surface,
            width,
            angular: form.angular,
            cuboid: form.cuboid,
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

    /// Surface times mean width of the grains over those of spheres.
    pub(crate) fn form(&self) -> f64 {
        self.surface * self.width
    }

    /// Share of the number of grains that are at least as large as those that end random addition.
    pub(crate) fn ending_share(&self) -> f64 {
        self.ending_share
    }

    /// Standard deviation of ln(d) by volume.
    pub(crate) fn spread(&self) -> f64 {
        self.spread
    }

    /// Largest diameter over the smallest.
    pub(crate) fn ratio(&self) -> f64 {
        self.ratio
    }

    /// Volume fraction, coating included, that nine of ten runs of random sequential addition reach.
    pub(crate) fn rsa_limit(&self, attempts_per_grain: Option<u64>) -> f64 {
        let fewer = attempts_per_grain.map_or(0.0, |attempts| (7.0 - log10(attempts as f64)).max(0.0));
        (self.random - rsa::PER_DECADE_OF_ATTEMPTS * fewer).max(0.05)
    }

    /// The limit of random addition by which growth starts. Packings of every seed depend on it: it is no forecast.
    fn start_limit(&self) -> f64 {
        let voids = start::EQUAL
            + start::SPREAD * self.spread
            + start::FINES * self.fines
            + start::WALLS * self.walls;
        (1.0 - exp(-voids)).max(0.05)
    }

    /// Volume fraction, coating included, up to which random placing is cheaper than growth to a target; an infinite
    /// target stands for the largest distance.
    pub(crate) fn growth_start(&self, filled: f64) -> f64 {
        let limit = self.start_limit();
        let wide = ln((self.ratio / start::RATIO).max(1.0));
        let by_target = start::PER_TARGET * (filled / limit - start::TARGET);
        let share = start::SHARE + by_target + start::PER_RATIO * wide;
        limit * share.clamp(start::LEAST, start::MOST)
    }

    /// Volume fraction, coating included, from which growth to a target starts.
    fn starts_from(&self, filled: f64) -> f64 {
        self.growth_start(filled).min(MOST_START.powi(3) * filled)
    }

    /// Volume fraction, coating included, at which so many grains jam that grow by events.
    pub(crate) fn jamming(&self, grains: f64) -> f64 {
        let very_few = growth::VERY_FEW / grains.max(1.0);
        (self.jamming_of_dozens(grains) + self.random_close * very_few).max(growth::LEAST * self.random_close)
    }

    /// The same as if a few grains lacked no more than some dozens do.
    fn jamming_of_dozens(&self, grains: f64) -> f64 {
        let equal = exp(-(self.spread / growth::EQUAL_SPREAD).powi(2));
        let share = growth::BULK
            + growth::WALLS * self.walls
            + growth::EQUAL * equal
            + growth::FEW * powf(grains.max(1.0), -1.0 / 3.0);
        // In large walls nothing is known; grains are not looser than that.
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
        // Nine of ten runs reach the limit, where the model is right.
        let middle = self.rsa_limit(attempts_per_grain) + QUANTILE * self.random_runs;
        let error = rsa::ERROR * self.wider(self.grains);
        normal((middle - filled) / (self.random_runs.powi(2) + error.powi(2)).sqrt())
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
        let middle = self.growth_reach_at(0.0, grains, options);
        let runs = (middle - self.growth_reach(grains, options)) / QUANTILE;
        let error =
            growth::JAMMING_ERROR * self.wider(grains) + growth::JAMMING_ERROR_OF_FEW / grains.max(1.0);
        normal((middle - filled) / (runs.powi(2) + error.powi(2)).sqrt())
    }

    /// Time of growth in s, to its end or its success, within a limit of events; without a target until it stalls.
    pub(crate) fn growth_time_s(&self, target: Option<f64>, grains: f64, most_events: Option<u64>) -> f64 {
        let filled = target.unwrap_or(1.0);
        let events = match target {
            Some(_) => (self.events_per_grain(filled, grains) * self.longer_near_reach(filled, grains))
                .min(growth::STALLS_NEAR_TARGET * growth::STALL),
            None => growth::STALL,
        };
        let most = most_events.map_or(f64::INFINITY, |events| events as f64 / grains);
        let placing_s = self.rsa_time_s(self.starts_from(filled), grains, None);
        placing_s + grains * (start_s(grains) + events.min(most) * event_s(grains))
    }

    /// Factor on the time of events near the reach.
    fn longer_near_reach(&self, filled: f64, grains: f64) -> f64 {
        let left = (1.0 - filled / (growth::REACH * self.jamming(grains))).max(0.0);
        1.0 + growth::NEAR * self.spread / (1.0 + left / growth::NEAR_WIDTH).powi(2)
    }

    /// Volume fraction, coating included, that nine of ten runs of growth reach within the options.
    pub(crate) fn growth_reach(&self, grains: f64, options: &GrowthOptions) -> f64 {
        self.growth_reach_at(QUANTILE, grains, options)
    }

    /// Volume fraction that growth reaches if the logarithm of its events is this many standard errors above the
    /// expected one.
    fn growth_reach_at(&self, errors: f64, grains: f64, options: &GrowthOptions) -> f64 {
        let allowed = Self::events_allowed(grains, options);
        let factor = exp(errors * growth::ERROR);
        bisect(0.0, self.jamming(grains), |filled| {
            let most = (allowed / self.longer_near_reach(filled, grains)).min(growth::LAST_SUCCESS);
            self.events_per_grain(filled, grains) * factor <= most
        })
    }

    /// Volume fraction, coating included, that nine of ten runs of growth by moves reach.
    pub(crate) fn moves_limit(&self, grains: f64) -> f64 {
        let (surface, width) = (ln(self.surface), ln(self.width));
        let aspherical = moves::ASPHERICAL + moves::FEW * powf(grains.max(moves::FEWEST), -1.0 / 3.0);
        let by_form = aspherical * (1.0 - exp(-(surface + width) / moves::SMALL))
            + moves::SURFACE * surface
            + moves::WIDTH * width
            + moves::ANGULAR * self.angular
            + moves::CUBOID * self.cuboid;
        (growth::REACH * self.jamming_of_dozens(grains) * exp(by_form)).min(moves::REACH)
    }

    /// Volume fraction, coating included, at which so many grains jam that grow by moves.
    pub(crate) fn moves_jamming(&self, grains: f64) -> f64 {
        self.moves_limit(grains) / moves::REACH
    }

    /// Probability that growth by moves reaches a volume fraction.
    pub(crate) fn moves_success(&self, filled: f64, grains: f64) -> f64 {
        let middle = self.moves_limit(grains) + QUANTILE * moves::RUNS;
        let error = moves::ERROR * self.wider(grains);
        normal((middle - filled) / (moves::RUNS.powi(2) + error.powi(2)).sqrt())
    }

    /// Factor on the standard errors of what is reached: where the mix lies beyond the studies, they are wider.
    fn wider(&self, grains: f64) -> f64 {
        let is_covered = self.ratio <= covered::RATIO * 1.01
            && self.spread <= covered::SPREAD
            && self.walls <= covered::WALLS
            && covered::GRAINS.contains(&grains);
        if is_covered { 1.0 } else { covered::WIDER }
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

/// What counts as likely,
pub(crate) const LIKELY: f64 = 0.9;
/// and the quantile of the normal distribution that belongs to it.
const QUANTILE: f64 = 1.281_55;

/// Seconds of an operation on a core of 2 GHz.
pub(super) const OPERATION_S: f64 = growth::EVENT_US * 1e-6;

pub(super) fn event_s(grains: f64) -> f64 {
    growth::EVENT_US * 1e-6 * beyond_cache(grains, growth::EVENT_CACHE)
}

/// What starting to grow costs per grain.
fn start_s(grains: f64) -> f64 {
    growth::START_US * 1e-6 * beyond_cache(grains, growth::START_CACHE)
}

/// Probability that what is expected to take some time takes no more than another.
pub(super) fn likely_within(time_s: f64, most_s: f64) -> f64 {
    normal(ln(most_s / time_s) / growth::ERROR)
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
