//! How grains rearrange in a compression cycle besides growing: swaps, and for many grains collisions without growth in
//! blocks that threads share.

use std::sync::atomic::{AtomicU64, Ordering};

use rand_xoshiro::Xoshiro256PlusPlus;

use super::{CYCLE_EVENTS_PER_GRAIN, EVENTS_WITH_GROWTH, Ended, Frame, Run, SWAPS_PER_GRAIN, Stage};
use crate::control::Progress;
use crate::memory::OutOfMemory;
use crate::methods::edmd::blocks::{self, Outcome, Swaps, Task};
use crate::methods::edmd::growth_protocol::GrowthProtocol;
use crate::methods::edmd::swap::{self, LogRatio};

impl Run {
    /// Tries swaps of all grains, whose lists are new.
    pub(super) fn swap(
        &mut self,
        frame: &Frame<'_>,
        protocol: &GrowthProtocol,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<(), OutOfMemory> {
        let tries = (SWAPS_PER_GRAIN * self.system.len() as f64) as u64;
        let log_ratio = frame.preference.as_ref().map(|preference| {
            move |pair: [usize; 2], places: [[f64; 3]; 2]| preference.log_acceptance_ratio(pair, places)
        });
        let log_ratio = log_ratio.as_ref().map(|log_ratio| log_ratio as LogRatio<'_>);
        swap::sweep(&mut self.swaps, &mut self.system, &protocol.radii_mm, log_ratio, tries, rng)
    }

    /// Lets the grains collide in blocks, after a part of the cycle with growth in which they had a pressure. Returns
    /// the simulated time, and why the run ends if it does.
    pub(super) fn rearrange(
        &mut self,
        frame: &Frame<'_>,
        protocol: &GrowthProtocol,
        pressure_before: f64,
        swaps_help: bool,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Result<Result<f64, Ended>, OutOfMemory> {
        let n = self.system.len() as f64;
        let events = self.system.counts.collisions();
        let left = frame.options.stop.events.map_or(f64::INFINITY, |most| most.saturating_sub(events) as f64);
        let events_per_grain = ((CYCLE_EVENTS_PER_GRAIN - EVENTS_WITH_GROWTH) as f64).min(left / n);
        // While grains grow they collide more often.
        let share = (pressure_before / self.pressure).clamp(0.01, 1.0);
        let events_per_time = self.events_per_time * share;
        let progress = self.progress(frame);
        let earlier_s = self.earlier_s;
        let collisions = AtomicU64::new(0);
        let is_over = |more: u64| {
            let so_far = collisions.fetch_add(more, Ordering::Relaxed) + more;
            frame.control.report(&further(&progress, so_far));
            frame.is_over(earlier_s) || frame.control.should_stop()
        };
        let swaps = Swaps {
            per_grain: SWAPS_PER_GRAIN,
            pairs: &self.swaps,
            sizes: &protocol.radii_mm,
            preference: frame.preference.as_ref(),
        };
        let task = Task {
            growth: match self.stage {
                Stage::Scale => protocol.by_scale(self.size, 0.0),
                Stage::Length => protocol.by_length(self.size, 0.0),
            },
            events_per_grain,
            events_per_time,
            swaps: swaps_help.then_some(swaps),
            is_over: &is_over,
        };
        let Outcome { time, pressure, swaps_tried, swaps_accepted, .. } =
            blocks::collide(&mut self.system, &task, rng)?;
        if frame.control.should_stop() {
            return Ok(Err(Ended::Stopped));
        }
        self.swaps.count(swaps_tried, swaps_accepted);
        // Finite, for it is stored.
        if pressure > 1.0 && pressure.is_finite() {
            self.pressure = pressure;
        }
        Ok(Ok(time))
    }
}

/// Progress after more collisions.
fn further(progress: &Progress, collisions: u64) -> Progress {
    let mut further = progress.clone();
    further.done += collisions;
    if let Some(growth) = &mut further.growth {
        growth.events += collisions;
    }
    further
}
