//! When a run ends, and what happens to a packing that hardly grows before.

use super::{CYCLES_PER_LIST, MOST_RATE, Run, Stage};
use crate::gap::grain::{ConvexShape, Turned};
use crate::methods::growth::EXPANSION;
use crate::methods::monte_carlo::MonteCarlo;
use crate::methods::monte_carlo::push::Strength;
use crate::packing::GrowthEnd;

/// Cycles over which growth is compared to tell that it has stalled, and the least growth, relative.
pub(super) const STALL_CYCLES: u64 = 200;
const STALL_GROWTH: f64 = 1e-5;
/// A packing that jams is expanded and grown again where its scale lacks at most this much.
pub(super) const NEAR_TARGET: f64 = 0.02;
/// Growth over as many cycles below which a packing hardly grows, relative.
const SLOW_GROWTH: f64 = 1e-3;

/// How hard grains push each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pushes {
    /// Hard, from the start.
    Hard,
    /// Lightly, to the end: hard pushes bring the grains no further, or they are spheres.
    Light,
}

impl Pushes {
    /// Those that growth starts with. Spheres have light ones alone.
    pub(super) fn first<S: ConvexShape>() -> Self {
        if S::Turned::IS_SPHERE { Self::Light } else { Self::Hard }
    }

    /// Ellipsoids that grow fast need no hard pushes.
    pub(super) fn strength<S: ConvexShape>(self, is_fast: bool, is_wide: bool) -> Strength {
        match (S::Turned::IS_ELLIPSOID, self) {
            (true, Self::Hard) if !is_fast => Strength::HARD,
            (true, _) => Strength::LIGHT,
            (false, Self::Light) => Strength::LIGHT_ANGULAR,
            (false, Self::Hard) if is_wide => Strength::HARD_ANGULAR_WIDE,
            (false, Self::Hard) => Strength::HARD_ANGULAR,
        }
    }

    /// For a checkpoint.
    pub(super) fn to_number(self) -> u64 {
        match self {
            Self::Hard => 0,
            Self::Light => 1,
        }
    }

    /// Of a checkpoint.
    pub(super) fn of_number(number: u64) -> Option<Self> {
        match number {
            0 => Some(Self::Hard),
            1 => Some(Self::Light),
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
        if self.counted.compression_cycles < self.mark.1 + STALL_CYCLES {
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
        let goes_on = has_grown || self.push_lightly() || self.expand(of);
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

    /// Pushes lightly from now on; says whether it did not.
    fn push_lightly(&mut self) -> bool {
        std::mem::replace(&mut self.pushes, Pushes::Light) != Pushes::Light
    }
}
