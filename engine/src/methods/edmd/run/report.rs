//! Progress, growth curve and statistics of a growth run.
//!
//! Reporting changes nothing about the packing: a run gives the same grains with and without it.

use super::{
    BEYOND_TARGET, CYCLE_EVENTS_PER_GRAIN, CYCLE_GROWTH, Frame, LENGTH_COLLISIONS, Run, STALL_EVENTS, Stage,
};
use crate::arrays;
use crate::control::{Growth as Grown, Progress, Step};
use crate::mix::sphere_volume;
use crate::packing::{EdmdStatistics, GrowthEnd, GrowthPoint};
use crate::request::Distance;

/// Sums over the diameters, from which the volume fraction follows at any distance without another
/// look at the grains.
pub(crate) struct Moments {
    sums: [f64; 4],
    specimen_volume_mm3: f64,
}

impl Moments {
    pub(crate) fn new(diameters_mm: &[f64], specimen_volume_mm3: f64) -> Self {
        let sums = arrays::from_fn(|power| diameters_mm.iter().map(|d| d.powi(power as i32)).sum());
        Self { sums, specimen_volume_mm3 }
    }

    /// Volume fraction of grains whose diameters are longer by `more_mm`.
    pub(crate) fn volume_fraction(&self, more_mm: f64) -> f64 {
        let [count, first, second, third] = self.sums;
        let cubes = third + more_mm * (3.0 * second + more_mm * (3.0 * first + more_mm * count));
        sphere_volume(1.0) * cubes / self.specimen_volume_mm3
    }
}

impl Run {
    /// The constant distance that the true diameters keep by now, where one is asked for.
    pub(crate) fn distance_mm(&self, frame: &Frame<'_>) -> Option<f64> {
        let largest = frame.diameters_mm.first().copied().unwrap_or(0.0);
        match (self.stage, &frame.request.distance) {
            (Stage::Length, _) => Some(2.0 * self.size * (1.0 - 1e-9)),
            _ if frame.to_jamming.is_some() => None,
            (Stage::Scale, Distance::Constant { gap_mm: mm, .. }) => {
                Some((self.size.min(1.0) * (largest + mm) - largest).max(0.0))
            }
            _ => None,
        }
    }

    /// Size of the grains over the requested one.
    fn scale(&self, frame: &Frame<'_>) -> f64 {
        if frame.to_jamming.is_some() { self.size } else { self.size.min(1.0) }
    }

    /// Volume fraction of the grains at their present size, without their distance; with it where it
    /// is what grows.
    pub(crate) fn volume_fraction(&self, frame: &Frame<'_>) -> f64 {
        match self.stage {
            Stage::Scale => frame.moments.volume_fraction(0.0) * self.scale(frame).powi(3),
            Stage::Length => frame.moments.volume_fraction(2.0 * self.size),
        }
    }

    /// Events per grain so far.
    fn events_per_grain(&self) -> f64 {
        self.system.counts.collisions() as f64 / self.system.len().max(1) as f64
    }

    /// Notes the end of a compression cycle, in the forecast and in the growth curve.
    pub(super) fn note_point(&mut self, frame: &Frame<'_>) {
        self.forecast.note(self.events_per_grain(), self.size.powi(3));
        if self.curve.has(self.compression_cycles) {
            self.curve.push(GrowthPoint {
                packing_time_s: self.elapsed_s(frame),
                simulated_time_s: Some(self.simulated_s),
                events: self.system.counts.collisions(),
                volume_fraction: self.volume_fraction(frame),
                distance_mm: self.distance_mm(frame),
                reduced_pressure: Some(self.pressure),
            });
        }
    }

    /// Share of the run's work that is done, and whether the remaining time follows from it.
    ///
    /// A limit of events or time ends the run if the target does not, so the larger of the shares counts. Growth to
    /// the largest distance has no target: without a limit it is paced by a number of collisions, whose share counts.
    /// Equal grains stall after about as many, but no remaining time follows from that.
    pub(super) fn share_done(&self, frame: &Frame<'_>) -> (f64, bool) {
        let limits = frame.options.stop;
        let events = self.system.counts.collisions();
        let by_limits = [
            limits.events.map(|most| events as f64 / most as f64),
            limits.time_s.map(|most| self.elapsed_s(frame) / most),
        ];
        let by_limits = by_limits.into_iter().flatten().reduce(f64::max);
        if frame.is_without_target() {
            return match by_limits {
                Some(share) => (share, true),
                None if frame.of_equal_grains() => ((self.events_per_grain() / STALL_EVENTS).min(0.9), false),
                None => ((self.events_per_grain() / LENGTH_COLLISIONS).min(0.99), true),
            };
        }
        let predicted = self.forecast.predict(
            self.events_per_grain(),
            self.compression_cycles as f64,
            CYCLE_EVENTS_PER_GRAIN as f64,
            3.0 * CYCLE_GROWTH,
        );
        match by_limits {
            Some(share) if share > predicted.fraction => (share, true),
            _ => (predicted.fraction, predicted.likely),
        }
    }

    /// Tells the control where the run stands.
    pub(super) fn report(&mut self, frame: &Frame<'_>) {
        frame.control.report(&self.progress(frame));
    }

    /// Where the run stands.
    pub(super) fn progress(&mut self, frame: &Frame<'_>) -> Progress {
        let events = self.system.counts.collisions();
        let (fraction, predictable) = self.share_done(frame);
        self.fraction = self.fraction.max(fraction.min(1.0));
        let seconds = self.grow_started.elapsed().as_secs_f64().max(1e-9);
        let per_s = self.system.counts.collisions() as f64 / seconds;
        let volume_fraction = self.volume_fraction(frame);
        Progress {
            step: Step::Edmd,
            fraction: self.fraction,
            done: events,
            total: frame.options.stop.events.unwrap_or(0),
            unit: "events",
            message: format!(
                "growing grains, volume fraction {volume_fraction:.4}, pressure {:.0}",
                self.pressure
            ),
            growth: Some(Grown {
                volume_fraction,
                distance_mm: self.distance_mm(frame),
                events,
                events_per_s: per_s,
                reduced_pressure: Some(self.pressure),
                predictable,
            }),
        }
    }

    /// What was counted.
    pub(crate) fn statistics(&self, frame: &Frame<'_>, stop: GrowthEnd, seconds: f64) -> EdmdStatistics {
        let counts = self.system.counts;
        let events = counts.collisions();
        EdmdStatistics {
            events,
            grain_collisions: counts.grain_collisions,
            wall_collisions: counts.wall_collisions,
            list_rebuilds: counts.list_rebuilds,
            predictions: counts.predictions,
            stale_events: counts.stale_events,
            swaps_tried: self.swaps.tried,
            swaps_accepted: self.swaps.accepted,
            velocity_rescalings: self.rescalings,
            compression_cycles: self.compression_cycles,
            pinned_grains: self.pinned_grains,
            expansions: self.expansions.number,
            resumes: self.resumes,
            predictions_per_event: counts.predictions as f64 / events.max(1) as f64,
            events_per_s: events as f64 / seconds.max(1e-9),
            simulated_time_s: self.simulated_s,
            growth_scale: match self.stage {
                // Without the margin beyond it the target is not reached.
                Stage::Scale if frame.to_jamming.is_some() => self.size,
                Stage::Scale if self.size < BEYOND_TARGET => self.size.min(1.0 - f64::EPSILON),
                _ => 1.0,
            },
            energy: self.system.energy() / self.energy,
            reduced_pressure: self.pressure,
            stop,
        }
    }
}
