//! How much of the work of a growth run is done, predicted while it runs.
//!
//! The unit of work is one event per grain; the start and the work between compression cycles are counted in it by
//! constants, so the prediction depends on the packing only and not on the machine. Two predictions of the remaining
//! events are combined:
//!
//! - `R1 = E - e`: the total `E` that the fitted model of `docs/estimates.md` expects, less the events `e` so far.
//! - `R2 = (1 - s) de/ds c(s)`: the remaining growth, where `s` is the volume over that at the target, times the events
//!   per growth over the last part of the run. Events per growth rise until `s` is about 0.955 and are nearly constant
//!   after that; `c(s)` corrects for the rise.
//!
//! `R = (R1/v1 + R2/v2) / (1/v1 + 1/v2)` weighs them by their variances. `v2` is large while `e` is small against `E`,
//! so that a run starts with the model and corrects it by what it observes. The coefficients were chosen on runs of
//! Fuller 0.66, 0.70 and 0.725, A16 with 1 mm and equal spheres, with `E` taken wrong by factors from 0.7 to 1.4
//! (`docs/estimates.md`, "Progress").

use std::collections::VecDeque;

use crate::elementary::ln;
use crate::methods::edmd::Expected;

/// Work before the first event besides the random addition: the first lists and predictions.
const START: f64 = 2.0;
/// Work between two compression cycles: swaps, rebuilt lists and predictions.
const CYCLE: f64 = 1.8;
/// Standard error of the model's total, as a share of it.
const MODEL_ERROR: f64 = 0.35;
/// Share of the model's total at which the run has proved the model wrong: its error grows without bound towards it.
const MODEL_UPTO: f64 = 1.5;
/// Standard error of the extrapolation, as a share of it,
const TREND_ERROR: f64 = 0.25;
/// and what is added to it early in a run, per event of the model that lies ahead of `EARLY` times those done.
const EARLY_ERROR: f64 = 0.45;
const EARLY: f64 = 1.6;
/// Share of the events so far, and least events per grain, from which the trend is taken.
const TREND_SHARE: f64 = 0.3;
const TREND_EVENTS: f64 = 10.0;
/// Share of the target's volume above which events per growth are constant, the width of the rise below it, and how
/// much is still to come at its start.
const FLAT_FROM: f64 = 0.955;
const RISE: f64 = 0.03;
const RISE_BY: f64 = 5.0;
/// Least remaining work, as a share of the model's total, before the target is reached.
const LEAST_LEFT: f64 = 0.02;
/// Events per grain by which growth has usually stalled.
pub(crate) const STALL_EVENTS: f64 = 4000.0;
/// Total events per grain beyond which a run is more likely to jam than to reach its target.
const LIKELY_EVENTS: f64 = 2000.0;

/// Where a growth run stands, between compression cycles.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    events: f64,
    share: f64,
}

/// Prediction of the work of one run.
#[derive(Clone, Debug)]
pub(super) struct Forecast {
    /// Work before the first event,
    start: f64,
    /// and events per grain, as the model expects them.
    expected: f64,
    /// Ends of compression cycles that the trend is taken from, oldest first.
    points: VecDeque<Point>,
}

/// What a run is predicted to take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Predicted {
    /// Share of the work that is done.
    pub(super) fraction: f64,
    /// Whether the run is likely to reach its target, so that the remaining time follows from the fraction.
    pub(super) likely: bool,
}

/// Share of a run's work that lies before the first event.
pub(crate) fn start_share(expected: &Expected, events_per_cycle: f64) -> f64 {
    let start = START + expected.start_work;
    start / (start + expected.events_per_grain * (1.0 + CYCLE / events_per_cycle))
}

impl Forecast {
    /// A forecast of a run that the model expects to take so much.
    pub(super) fn new(expected: &Expected) -> Self {
        let events = expected.events_per_grain;
        let events = if events.is_nan() { STALL_EVENTS } else { events.clamp(1.0, STALL_EVENTS) };
        Self { start: START + expected.start_work, expected: events, points: VecDeque::new() }
    }

    /// Notes the end of a compression cycle: events per grain so far, and the volume over that at the target.
    pub(super) fn note(&mut self, events: f64, share: f64) {
        self.points.push_back(Point { events, share });
        let from = events - (TREND_SHARE * events).max(TREND_EVENTS);
        while self.points.get(1).is_some_and(|second| second.events <= from) {
            self.points.pop_front();
        }
    }

    /// Where a run stands after so many events per grain and compression cycles; `cycle_events` and `cycle_growth`
    /// are the most events per grain and the most growth of the volume, relative, of one cycle.
    pub(super) fn predict(
        &self,
        events: f64,
        cycles: f64,
        cycle_events: f64,
        cycle_growth: f64,
    ) -> Predicted {
        let left = self.events_left(events);
        let total = events + left;
        let share = self.points.back().map_or(0.0, |last| last.share);
        let cycles_left = if share > 0.0 && share < 1.0 {
            (left / cycle_events).max(-ln(share) / cycle_growth)
        } else {
            left / cycle_events
        };
        let done = self.start + events + CYCLE * cycles;
        let fraction = done / (done + left + CYCLE * cycles_left);
        Predicted { fraction, likely: total <= LIKELY_EVENTS }
    }

    /// Events per grain that are still to come.
    fn events_left(&self, events: f64) -> f64 {
        let by_model = (self.expected - events).max(LEAST_LEFT * self.expected);
        let Some(by_trend) = self.trend(events) else { return by_model };
        let trusted = (1.0 - events / (MODEL_UPTO * self.expected)).max(1.0e-9);
        let model_error = MODEL_ERROR * self.expected / trusted;
        let early = (self.expected - EARLY * events).max(0.0);
        let trend_error = TREND_ERROR * by_trend + EARLY_ERROR * early + 0.5;
        let (of_model, of_trend) = (model_error.powi(-2), trend_error.powi(-2));
        let left = (of_model * by_model + of_trend * by_trend) / (of_model + of_trend);
        // Growth that goes on beyond the events of a stall ends soon, in one way or the other.
        left.min((STALL_EVENTS - events).max(0.1 * events))
    }

    /// The remaining events by the events per growth lately; `None` while the grains have not grown.
    fn trend(&self, events: f64) -> Option<f64> {
        let (first, last) = (self.points.front()?, self.points.back()?);
        let grown = last.share - first.share;
        if grown <= 0.0 || last.share <= 0.0 {
            return None;
        }
        let to_rise = ((FLAT_FROM - last.share) / RISE).clamp(0.0, 1.0);
        let per_growth = (last.events - first.events) / grown * (1.0 + RISE_BY * to_rise);
        let left = (1.0 - last.share) * per_growth - (events - last.events);
        Some(left.max(0.01 * self.expected))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Events of a run that starts at 0.52 of its volume.
    fn expected(events_per_grain: f64) -> Expected {
        Expected { start_fraction: 0.52, start_work: 6.0, events_per_grain }
    }

    /// Follows a run whose events per growth are constant, where the model is wrong by a factor.
    fn followed(model_factor: f64) -> Vec<(f64, f64)> {
        let (total, from) = (400.0, FLAT_FROM);
        let mut forecast = Forecast::new(&expected(model_factor * total));
        let mut found = Vec::new();
        forecast.note(0.0, from);
        for cycle in 1..80_u32 {
            let events = 5.0 * f64::from(cycle);
            forecast.note(events, from + (1.0 - from) * events / total);
            let predicted = forecast.predict(events, f64::from(cycle), 5.0, 0.03);
            found.push((events / total, predicted.fraction));
        }
        found
    }

    #[test]
    fn the_fraction_follows_the_work_though_the_model_is_wrong() {
        for factor in [0.6, 1.0, 1.6] {
            for (share, fraction) in followed(factor) {
                let tolerance = if share < 0.4 { 0.15 } else { 0.08 };
                assert!((share - fraction).abs() < tolerance, "{factor}: {fraction} at {share}");
            }
        }
    }

    #[test]
    fn a_run_that_hardly_grows_is_no_longer_likely() {
        let mut forecast = Forecast::new(&expected(300.0));
        forecast.note(0.0, 0.8);
        for cycle in 1..400_u32 {
            let events = 5.0 * f64::from(cycle);
            forecast.note(events, 0.9 - 0.1 / (1.0 + f64::from(cycle)));
        }
        let predicted = forecast.predict(1995.0, 399.0, 5.0, 0.03);
        assert!(!predicted.likely && predicted.fraction < 0.7, "{predicted:?}");
    }

    #[test]
    fn before_the_first_cycle_the_model_stands_alone() {
        let predicted = Forecast::new(&expected(100.0)).predict(0.0, 0.0, 5.0, 0.03);
        assert!((predicted.fraction - start_share(&expected(100.0), 5.0)).abs() < 1e-12, "{predicted:?}");
        for odd in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            let predicted = Forecast::new(&expected(odd)).predict(1.0, 1.0, 5.0, 0.03);
            assert!((0.0..=1.0).contains(&predicted.fraction), "{predicted:?}");
        }
    }
}
