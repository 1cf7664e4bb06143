//! How much of a run is done, predicted while it goes on.
//!
//! Growth by moves slows down as the grains come near to what they reach: the time to a volume fraction follows from
//! its share of that reach ([`time_to`]). The reach is forecast by `plan`, with an error. The run tells more: the
//! nearer the reach, the less the grains grew in the last part of the time so far. Values of the reach are weighted by
//! both (Bayes). The law was fitted to runs of 72 mixes, and the error and the weights were chosen on these
//! (`docs/estimates.md`, "Progress").

use std::collections::VecDeque;

use crate::bayes::means;
use crate::elementary::{exp, ln, powf};

/// The power of what is left of the reach by which the time of growth rises, and what is left at least.
const POWER: f64 = -1.38;
const LEFT: f64 = 0.012;
/// What the start from random addition takes, at the reach, and how it rises with the target.
const START: f64 = 20.3;
const START_POWER: f64 = 5.7;
/// Beyond its reach growth is taken as this far from it.
const LEAST_LEFT: f64 = 0.003;
/// Standard error of the forecast of the reach, relative; the values that are weighted, and their step.
const ERROR: f64 = 0.06;
const FIRST: f64 = -0.165;
const VALUES: usize = 24;
const STEP: f64 = 0.015;
/// Share of the time so far from which on growth is looked at, and how much it weighs.
const BEFORE: f64 = 0.7;
const TELLING: f64 = 20.0;
/// Change of the time by which a prediction is made anew.
const AGAIN: f64 = 1.02;
/// Volume over that at the target where growth has reached it.
const REACHED: f64 = 1.0 - 1e-12;
/// Largest share that is predicted before the target is reached.
const MOST_DONE: f64 = 0.99;
/// Targets beyond this share of the reach are more likely missed than reached.
const LIKELY_TARGET: f64 = 1.02;

/// Time of growth by moves, with its start from random addition, to a share of the volume fraction that it reaches. The
/// unit depends on the grains.
pub(crate) fn time_to(share: f64) -> f64 {
    growth_to(share) + start_of(share)
}

/// The part of [`time_to`] a share that growth takes.
fn growth_to(share: f64) -> f64 {
    powf((1.0 + LEFT - share).max(LEAST_LEFT), POWER)
}

/// The part of [`time_to`] a target that its start takes.
fn start_of(share: f64) -> f64 {
    START * powf(share.min(1.0), START_POWER)
}

/// Share of the time to a target that its start is expected to take.
pub(in crate::methods::monte_carlo) fn start_share(target: f64) -> f64 {
    start_of(target) / time_to(target)
}

/// What is predicted at some time.
#[derive(Clone, Copy, Debug, Default)]
struct Prediction {
    time: f64,
    /// Share of the time that is done.
    done: f64,
    /// The target over the reach.
    target: f64,
}

/// What share of its time a run to a target has taken.
#[derive(Clone, Debug)]
pub(super) struct Forecast {
    /// Time so far, and the volume over that at the target, from `BEFORE` of the time on.
    points: VecDeque<[f64; 2]>,
    /// The largest volume so far.
    most: f64,
    /// The target over values of the reach.
    targets: [f64; VALUES],
    predicted: Prediction,
}

impl Forecast {
    /// To a target at this share of the reach that is forecast.
    pub(super) fn new(target: f64) -> Self {
        let targets = std::array::from_fn(|value| target * exp(-ln_value(value)));
        Self { points: VecDeque::new(), most: 0.0, targets, predicted: Prediction::default() }
    }

    /// Notes the volume over that at the target at some time.
    pub(super) fn note(&mut self, time: f64, share: f64) {
        if share < self.most {
            // The grains jammed, and were made smaller to grow again.
            self.points.clear();
            self.predicted.target = f64::INFINITY;
            return;
        }
        self.most = share;
        self.points.push_back([time, share]);
        while self.points.get(1).is_some_and(|[second, _]| *second <= BEFORE * time) {
            self.points.pop_front();
        }
        if time > AGAIN * self.predicted.time && self.points.len() > 1 {
            self.predicted = self.predict(time);
        }
    }

    /// Share of the time that is done: 1 at the target, 0 while nothing can be said.
    pub(super) fn done(&self) -> f64 {
        if self.most >= REACHED { 1.0 } else { self.predicted.done }
    }

    /// Whether the target is more likely reached than missed; `false` while nothing can be said.
    pub(super) fn is_likely(&self) -> bool {
        self.predicted.done > 0.0 && self.predicted.target < LIKELY_TARGET
    }

    fn predict(&self, time: f64) -> Prediction {
        let (Some([from, before]), Some([_, now])) = (self.points.front(), self.points.back()) else {
            return Prediction::default();
        };
        let seen = ln((time / from).max(1.0));
        let cases = std::array::from_fn::<_, VALUES, _>(|value| {
            let target = self.targets[value];
            // The start is that of the target from the first.
            let time_to = |share: f64| growth_to(share * target) + start_of(target);
            let [before, now, all] = [*before, *now, 1.0].map(time_to);
            let off = ln(now / before) - seen;
            let ln_weight = -0.5 * (ln_value(value) / ERROR).powi(2) - TELLING * off * off;
            (ln_weight, [ln((now / all).min(1.0)), ln(target)])
        });
        let [done, target] = means(&cases).map(exp);
        Prediction { time, done: done.min(MOST_DONE), target }
    }
}

/// The logarithm of a value of the reach over that which is forecast.
fn ln_value(value: usize) -> f64 {
    FIRST + STEP * value as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The middle difference between what is predicted and the share of the time, from 20 to 90 % of it, of growth to a
    /// target that lies `share` from its reach, which is forecast wrong by a factor.
    fn off(share: f64, wrong: f64) -> f64 {
        let mut forecast = Forecast::new(share * wrong);
        let all = time_to(share);
        let start = start_of(share);
        let mut off = Vec::new();
        let (mut now, mut time) = (0.5 * share, 0.0);
        while now < share && time < 0.9 * all {
            time = start + growth_to(now);
            forecast.note(time, now / share);
            if time > 0.2 * all {
                off.push((forecast.done() - time / all).abs());
            }
            now += 2e-4;
        }
        off.sort_by(f64::total_cmp);
        off[off.len() / 2]
    }

    #[test]
    fn the_share_follows_the_time_though_the_reach_is_forecast_wrong() {
        for (share, wrong) in [(0.9, 1.0), (0.97, 1.0), (1.0, 1.0), (0.97, 1.03), (0.97, 0.97), (0.9, 1.03)] {
            let off = off(share, wrong);
            assert!(off < 0.25, "{off} at {share}, wrong by {wrong}");
        }
    }

    #[test]
    fn the_start_takes_the_largest_share_where_growth_is_short_but_not_missing() {
        assert!(start_share(1.0) < 0.06);
        assert!(start_share(0.9) > 0.3);
        assert!((0.0..0.1).contains(&start_share(0.3)));
        let mut nothing = Forecast::new(0.9);
        assert!(nothing.done() == 0.0 && !nothing.is_likely());
        // Time passes without growth.
        (1..100).for_each(|time| nothing.note(f64::from(time), 0.8));
        assert!((0.0..1.0).contains(&nothing.done()), "{nothing:?}");
    }

    /// Grains that jammed are made smaller and grow again: nothing follows from that until they are as large again.
    #[test]
    fn nothing_is_predicted_while_grains_grow_again() {
        let mut forecast = Forecast::new(0.95);
        let grown = |forecast: &mut Forecast, from: f64, to: f64, time: f64| {
            (0..100).map(|step| f64::from(step) / 100.0).for_each(|share| {
                let now = from + (to - from) * share;
                forecast.note(time + growth_to(0.95 * now), now);
            });
        };
        grown(&mut forecast, 0.6, 0.98, 10.0);
        let before = forecast.done();
        assert!(forecast.is_likely() && before > 0.0);
        grown(&mut forecast, 0.9, 0.97, 100.0);
        assert!(!forecast.is_likely() && forecast.done() == before);
        grown(&mut forecast, 0.975, 1.0, 150.0);
        assert!(forecast.is_likely() && (0.9..1.0).contains(&forecast.done()), "{forecast:?}");
        forecast.note(300.0, 1.0);
        assert_eq!(forecast.done(), 1.0);
    }

    #[test]
    fn a_target_beyond_the_reach_is_found_out_though_it_is_forecast_within() {
        for (share, wrong) in [(0.95, 1.0), (0.95, 1.05), (1.06, 1.0), (1.06, 0.97)] {
            let mut forecast = Forecast::new(share * wrong);
            (0..4166).map(|step| 0.5 + 1.2e-4 * f64::from(step)).filter(|now| *now < share).for_each(|now| {
                forecast.note(start_of(share) + growth_to(now), now / share);
            });
            assert_eq!(
                forecast.is_likely(),
                share < 1.0,
                "{share}, wrong by {wrong}: {:?}",
                forecast.predicted
            );
        }
    }
}
