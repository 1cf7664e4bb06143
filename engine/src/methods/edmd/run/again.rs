//! A further growth, slower from the start, of grains that jammed below their target.
//!
//! Towards a target grains grow fast until they are dense, and where they jam decides how far the target lies. What
//! does not depend on it is growth that is paced by a number of collisions, as towards the largest distance. Grains
//! that would end short of their target are made loose again and grow in that way, by the same seed. The densest state
//! before is kept, and is the result where the target is not reached.

use super::{FIRST_SWAP_WINDOW, Frame, LENGTH_COLLISIONS, Run, Stage, first_rate};
use crate::memory::OutOfMemory;
use crate::methods::edmd::growth_protocol::GrowthProtocol;
use crate::request::OnLimit;

/// Grains that lack at most this much of their scale grow again; it is more than that gains.
const NEAR_TARGET: f64 = 0.01;
/// The same where the packing is kept whether it reaches its target or not.
const NEAR_TARGET_KEPT: f64 = 0.02;
/// The same after the first time, and how many times there are at most.
const NEAR_TARGET_AGAIN: f64 = 2e-3;
const MOST: u64 = 2;
/// Factor on the number of collisions each time.
const SLOWER: f64 = 4.0;
/// Largest share of the scale of jamming to begin with: less than half of the volume of equal spheres, which are a
/// fluid then.
const LOOSE: f64 = 0.9;

/// What is known of growth before the present one.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Again {
    /// How many times grains grew again.
    pub(super) number: u64,
    /// Collisions before the last of them began.
    pub(super) from: u64,
    /// The largest scale at which they jammed before, and where they lay then, by rank.
    pub(super) best: f64,
    pub(super) places: Vec<[f64; 3]>,
}

impl Run {
    /// Makes grains that jammed loose again, to grow more slowly, where that may reach the target; says whether it did.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn grow_again(
        &mut self,
        frame: &Frame<'_>,
        protocol: &GrowthProtocol,
    ) -> Result<bool, OutOfMemory> {
        let near = match (self.again.number, frame.request.on_limit) {
            (0, OnLimit::Keep) => NEAR_TARGET_KEPT,
            (0, OnLimit::Fail) => NEAR_TARGET,
            _ => NEAR_TARGET_AGAIN,
        };
        let is_scaling = self.stage == Stage::Scale && frame.to_jamming.is_none();
        if !is_scaling || self.again.number >= MOST || 1.0 - self.size.max(self.again.best) > near {
            return Ok(false);
        }
        if self.size > self.again.best {
            (self.again.best, self.again.places) = (self.size, self.centers()?);
        }
        self.again.number += 1;
        self.again.from = self.system.counts.collisions();
        self.set_rate(frame, protocol);
        self.swaps.window = FIRST_SWAP_WINDOW;
        let loose = self.first_size.min(LOOSE * self.size);
        let filled = (loose / self.size).powi(3);
        self.size = loose;
        self.set_radii(protocol);
        // By free volume.
        let pressure = 3.0 / (1.0 - filled);
        self.events_per_time *= pressure / self.pressure;
        self.pressure = pressure;
        Ok(true)
    }

    /// Chooses rates as without a target, once grains grow again.
    pub(super) fn set_rate(&mut self, frame: &Frame<'_>, protocol: &GrowthProtocol) {
        if self.again.number > 0 {
            self.compression_rate =
                first_rate(frame, protocol).without_target(self.system.len(), frame.of_equal_grains());
        }
    }

    /// Collisions per grain that are left of those in which grains that grow again are to jam; `None` where they do
    /// not grow again.
    pub(super) fn paced_collisions_left(&self) -> Option<f64> {
        if self.stage == Stage::Length {
            return None;
        }
        let times = i32::try_from(self.again.number).ok()?.checked_sub(1).filter(|times| *times >= 0)?;
        let done = self.system.counts.collisions().saturating_sub(self.again.from) as f64;
        Some(LENGTH_COLLISIONS * SLOWER.powi(times) - done / self.system.len() as f64)
    }

    /// Puts the grains to where they jammed before, if they were larger there.
    pub(crate) fn go_back(&mut self, protocol: &GrowthProtocol) {
        if self.stage == Stage::Scale && self.size < self.again.best {
            self.size = self.again.best;
            for (hot, &rank) in self.system.hot.iter_mut().zip(&self.system.rank) {
                hot.position = self.again.places[rank as usize];
            }
            self.set_radii(protocol);
        }
    }
}
