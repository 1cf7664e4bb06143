//! When growth ends, and what happens to a packing that jams just before its target.

use std::io::Write;

use super::{Frame, Run, Stage};
use crate::checkpoint::Checkpoint;
use crate::methods::edmd::compression_rate::scale_at_jamming;
use crate::methods::edmd::growth_protocol::GrowthProtocol;
use crate::methods::edmd::tolerances::BEYOND_TARGET;
use crate::methods::growth::{EXPANSION, may_go_on};
use crate::packing::GrowthEnd;
use crate::request::OnLimit;

/// A packing that jams is expanded and grown again where its scale lacks at most this much.
const NEAR_TARGET: f64 = 5e-4;
/// Pressure above which the scale at which a packing jams is known to a percent,
const NEAR_JAMMING: f64 = 50.0;
/// and the shares of a run between which it is judged: before, grains have not yet rearranged after they were
/// compressed from a loose state, and the pressure is too high; after, too little of the run is left for another.
const JUDGED: [f64; 2] = [0.2, 0.75];

impl Run {
    /// Whether the grains have the size that is their target.
    pub(super) fn is_grown(&self, frame: &Frame<'_>) -> bool {
        self.stage == Stage::Scale && self.size >= BEYOND_TARGET && frame.to_jamming.is_none()
    }

    /// Whether it is clear that grains which grow until they jam do so at a scale outside of the bounds that are given.
    pub(super) fn jams_outside(&self, frame: &Frame<'_>) -> bool {
        let Some([low, high]) = frame.to_jamming.and_then(|to| to.within) else { return false };
        let scale = scale_at_jamming(self.size, self.pressure);
        let (share, _) = self.share_done(frame);
        self.pressure > NEAR_JAMMING
            && (JUDGED[0]..=JUDGED[1]).contains(&share)
            && !(low..=high).contains(&scale)
    }

    /// Keeps a checkpoint of growth that ended short of its target, where its packing is kept and whoever runs it wants
    /// to go on later.
    pub(crate) fn keep_last(&self, frame: &Frame<'_>, end: GrowthEnd) {
        let is_scaling = self.stage == Stage::Scale && frame.to_jamming.is_none();
        let is_kept = frame.request.on_limit == OnLimit::Keep;
        if may_go_on(end, is_scaling, is_kept) && frame.control.wants_last_checkpoint() {
            let write = |out: &mut dyn Write| self.write(frame, out);
            frame.control.keep_checkpoint(&Checkpoint::new(frame.request, &write));
        }
    }

    pub(super) fn limit_reached(&self, frame: &Frame<'_>) -> Option<GrowthEnd> {
        if frame.control.should_finish().is_some() {
            return Some(GrowthEnd::Finished);
        }
        if frame.options.stop.events.is_some_and(|most| self.system.counts.collisions() >= most) {
            return Some(GrowthEnd::EventLimit);
        }
        frame.is_over(self.earlier_s).then_some(GrowthEnd::TimeLimit)
    }

    /// Expands a packing that jammed just below its target, where that helps; says whether it did.
    pub(crate) fn expand(&mut self, protocol: &GrowthProtocol) -> bool {
        if self.stage != Stage::Scale
            || self.again.number > 0
            || !self.expansions.begin(self.size, NEAR_TARGET)
        {
            return false;
        }
        self.size *= 1.0 - EXPANSION;
        self.set_radii(protocol);
        // By free volume: Z = 3 / (1 - phi / phi_j) with phi / phi_j = (1 - EXPANSION)^3.
        let pressure = 1.0 / EXPANSION;
        self.events_per_time *= pressure / self.pressure;
        self.pressure = pressure;
        true
    }
}
