//! Progress, growth curve and statistics of a run.
//!
//! Reporting changes nothing about the packing. [`forecast`](super::forecast) predicts the time that is left
//! to a target.

use super::{BEYOND_TARGET, Run, Stage};
use crate::control::{Control, Growth, Progress, Step};
use crate::gap::grain::ConvexShape;
use crate::methods::monte_carlo::MonteCarlo;
use crate::packing::{GrowthPoint, MonteCarloStatistics};

/// Work of a push, in tried moves.
const PUSH_WORK: f64 = 4.0;
/// Moves per grain by which the growth of the gap has usually stalled.
const STALL_WORK: f64 = 30_000.0;

impl<S: ConvexShape> Run<S> {
    /// Work so far, in tried moves per grain.
    fn work(&self) -> f64 {
        let counted = self.counted;
        let moves = (counted.moves_tried + self.swaps.tried) as f64;
        (moves + PUSH_WORK * counted.pushes as f64) / self.system.len().max(1) as f64
    }

    /// The constant gap that the grains keep by now at their full size, where one is requested.
    pub(super) fn gap_mm(&self, of: &MonteCarlo<'_, S>) -> Option<f64> {
        match (self.stage, of.maximize, of.rule.constant_mm()) {
            (Stage::Gap, ..) => Some(self.kept),
            _ if of.to_jamming.is_some() => None,
            (Stage::Scale, None, Some(mm)) if mm > 0.0 => {
                Some((self.size().min(1.0) * (self.largest_mm + mm) - self.largest_mm).max(0.0))
            }
            _ => None,
        }
    }

    /// Volume of the grains at their present size over that of the specimen.
    pub(super) fn volume_fraction(&self, of: &MonteCarlo<'_, S>) -> f64 {
        let most = if of.to_jamming.is_some() { f64::INFINITY } else { 1.0 };
        self.target_fraction * (1.0 / self.system.frame.stretch).min(most).powi(3)
    }

    /// Notes the end of a cycle, in the forecast and in the growth curve.
    pub(super) fn note_point(&mut self, of: &MonteCarlo<'_, S>) {
        let share = (1.0 / (self.system.frame.stretch * BEYOND_TARGET)).powi(3);
        self.forecast.note(self.elapsed_s(), share);
        if self.curve.has(self.counted.compression_cycles) {
            self.curve.push(GrowthPoint {
                packing_time_s: self.elapsed_s(),
                simulated_time_s: None,
                events: self.counted.moves_tried,
                volume_fraction: self.volume_fraction(of),
                distance_mm: self.gap_mm(of),
                reduced_pressure: None,
            });
        }
    }

    /// Share of the run that is done, and whether the remaining time follows from it.
    fn share_done(&self, of: &MonteCarlo<'_, S>) -> (f64, bool) {
        let limits = of.stop;
        let by_limits = [
            limits.sweeps.map(|most| self.counted.sweeps as f64 / most as f64),
            limits.time_s.map(|most| self.elapsed_s() / most),
        ];
        let by_limits = by_limits.into_iter().flatten().reduce(f64::max);
        if of.maximize.is_some() || of.to_jamming.is_some() {
            return match by_limits {
                Some(share) => (share, true),
                None => ((self.work() / STALL_WORK).min(0.9), false),
            };
        }
        let done = self.forecast.done();
        match by_limits {
            Some(share) if share > done => (share, true),
            _ => (done, self.forecast.is_likely()),
        }
    }

    /// Tells the control where the run stands.
    pub(super) fn report(&mut self, of: &MonteCarlo<'_, S>, control: &dyn Control) {
        let (fraction, predictable) = self.share_done(of);
        self.fraction = self.fraction.max(fraction.min(1.0));
        let moves = self.counted.moves_tried;
        let seconds = (self.elapsed_s() - self.rsa_s).max(1e-9);
        let volume_fraction = self.volume_fraction(of);
        control.report(&Progress {
            step: Step::MonteCarlo,
            fraction: self.fraction,
            done: moves,
            total: of.stop.sweeps.unwrap_or(0) * self.system.len() as u64,
            unit: "moves",
            message: format!("growing grains, volume fraction {volume_fraction:.4}"),
            growth: Some(Growth {
                volume_fraction,
                distance_mm: self.gap_mm(of),
                events: moves,
                events_per_s: moves as f64 / seconds,
                reduced_pressure: None,
                predictable,
            }),
        });
    }

    /// What was counted.
    pub(super) fn counted(&self) -> MonteCarloStatistics {
        MonteCarloStatistics {
            swaps_tried: self.swaps.tried,
            swaps_accepted: self.swaps.accepted,
            expansions: self.expansions.number,
            ..self.counted
        }
    }
}
