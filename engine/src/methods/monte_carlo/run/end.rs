//! When a run ends, and what happens to a packing that hardly grows before.

use super::{CYCLES_PER_LIST, MOST_RATE, Run, Stage};
use crate::gap::grain::{ConvexShape, Turned};
use crate::methods::growth::EXPANSION;
use crate::methods::monte_carlo::MonteCarlo;
use crate::packing::GrowthEnd;

/// Cycles over which growth is compared to tell that it has stalled, and the least growth, relative.
pub(super) const STALL_CYCLES: u64 = 200;
const STALL_GROWTH: f64 = 1e-5;
/// A packing that jams is expanded and grown again where its scale lacks at most this much.
pub(super) const NEAR_TARGET: f64 = 0.02;
/// Growth over as many cycles below which hard pushes are tried, relative.
pub(super) const SLOW_GROWTH: f64 = 1e-3;
/// Cycles of the trial: the first one or two hundred bring little, until the grains have rearranged. What it must gain
/// over what light pushes gained in the cycles before: three times as many cycles, of twice as many sweeps of pushes.
pub(super) const TRIAL_CYCLES: u64 = 600;
const TRIAL_GAIN: f64 = 6.0;

/// How hard grains push each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pushes {
    /// Lightly, as at the start.
    Light,
    /// Hard, for a trial; light pushes had so much growth before it, relative.
    Tried {
        /// Over [`STALL_CYCLES`].
        growth: f64,
    },
    /// Hard: the trial has gained more.
    Hard,
    /// Lightly, to the end: hard pushes gain no more.
    LightForGood,
}

impl Pushes {
    pub(super) fn are_hard(self) -> bool {
        matches!(self, Self::Tried { .. } | Self::Hard)
    }

    /// For a checkpoint.
    pub(super) fn to_numbers(self) -> (u64, f64) {
        match self {
            Self::Light => (0, 0.0),
            Self::Tried { growth } => (1, growth),
            Self::Hard => (2, 0.0),
            Self::LightForGood => (3, 0.0),
        }
    }

    /// Of a checkpoint.
    pub(super) fn of_numbers(number: u64, growth: f64) -> Option<Self> {
        match number {
            0 => Some(Self::Light),
            1 => Some(Self::Tried { growth }),
            2 => Some(Self::Hard),
            3 => Some(Self::LightForGood),
            _ => None,
        }
    }
}

impl<S: ConvexShape> Run<S> {
    pub(super) fn limit_reached(&mut self, of: &MonteCarlo<'_, S>) -> Option<GrowthEnd> {
        if of.stop.sweeps.is_some_and(|most| self.counted.sweeps >= most) {
            return Some(GrowthEnd::SweepLimit);
        }
        if of.stop.time_s.is_some_and(|most| self.elapsed_s() >= most) {
            return Some(GrowthEnd::TimeLimit);
        }
        let cycles = if let Pushes::Tried { .. } = self.pushes { TRIAL_CYCLES } else { STALL_CYCLES };
        if self.counted.compression_cycles < self.mark.1 + cycles {
            return None;
        }
        let size = self.size();
        let growth = size / self.mark.0 - 1.0;
        let has_grown = size > self.mark.0 * (1.0 + STALL_GROWTH);
        self.mark = (size, self.counted.compression_cycles);
        let within = of.to_jamming.and_then(|to| to.within);
        if growth < SLOW_GROWTH && within.is_some_and(|[low, high]| !(low..=high).contains(&size)) {
            return Some(GrowthEnd::Stalled);
        }
        let goes_on =
            self.change_pushes(of, growth) || has_grown || self.expand(of) || self.try_hard_pushes(growth);
        (!goes_on).then_some(GrowthEnd::Stalled)
    }

    /// Expands a packing that jammed below its target, where that helps; says whether it did.
    fn expand(&mut self, of: &MonteCarlo<'_, S>) -> bool {
        let size = self.size();
        let is_scaling = self.stage == Stage::Scale && of.to_jamming.is_none();
        if !is_scaling || !self.expansions.begin(size, NEAR_TARGET) {
            return false;
        }
        self.system.scale(1.0 + EXPANSION);
        self.rate = MOST_RATE;
        self.listed_cycles = CYCLES_PER_LIST;
        self.mark = (0.0, self.counted.compression_cycles);
        true
    }

    /// Decides how hard grains push each other from now on, by the growth since the mark; says whether that changes.
    ///
    /// Where light pushes hardly bring grains any further that are far from their target, hard ones are tried. They
    /// stay where they gain more for their time, until growth stalls with them as well. Near the target they are tried
    /// where it would end otherwise.
    fn change_pushes(&mut self, of: &MonteCarlo<'_, S>, growth: f64) -> bool {
        let is_far =
            self.stage == Stage::Scale && (of.to_jamming.is_some() || 1.0 - self.size() > NEAR_TARGET);
        let pushes = match self.pushes {
            Pushes::Light if is_far && growth < SLOW_GROWTH => return self.try_hard_pushes(growth),
            Pushes::Tried { growth: by_light } if growth > TRIAL_GAIN * by_light.max(STALL_GROWTH) => {
                Pushes::Hard
            }
            Pushes::Tried { .. } => Pushes::LightForGood,
            Pushes::Hard if growth <= STALL_GROWTH => Pushes::LightForGood,
            pushes => pushes,
        };
        std::mem::replace(&mut self.pushes, pushes) != pushes
    }

    /// Tries hard pushes unless they were tried; says whether it does. Of ellipsoids, which turn little when they are
    /// pushed, they made looser packings: 0.694 in place of 0.713 after 3000 sweeps of moves, with the share of the
    /// depth alone.
    fn try_hard_pushes(&mut self, growth: f64) -> bool {
        let can = !S::Turned::IS_ELLIPSOID && self.stage == Stage::Scale && self.pushes == Pushes::Light;
        if can {
            self.pushes = Pushes::Tried { growth };
        }
        can
    }
}
