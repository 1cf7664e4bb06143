//! The specimen shrinks or widens, or the gaps do, with the planes between grains; and whether all gaps are kept.

use super::descend::descend;
use super::group::{LANES, LONGEST, SHORTEST, below, is_wall};
use super::planes::Decided;
use super::system::{Part, System};
use crate::arrays::Each as _;
use crate::cpu::{InstructionSet, Lanes, with_instruction_set};
use crate::gap::grain::ConvexShape;
use crate::gap::linear::scaled;

impl<S: ConvexShape> System<S> {
    /// Whether all gaps are kept. Computes every separating plane again that a grain crosses, also after another pair
    /// has failed: the two planes of a pair are valid only together.
    pub(super) fn is_clear(&mut self) -> bool {
        let threads = self.threads;
        let work = |part: &mut Part<'_, _>, range: usize| lay_crossed_in_range(part, range);
        descend(&mut self.part(), threads, &work, |a, b| a && b)
    }

    /// Scales the specimen, the centres and the planes. Planes that come closer are laid closer to their grains, so
    /// that the gap between the two planes of a pair is still kept.
    pub(super) fn scale(&mut self, factor: f64) {
        self.frame.stretch *= factor;
        let largest = self.hot.iter().map(|hot| hot.d).fold(0.0, f64::max);
        self.on_leaves(&|part| part.scale(factor, largest));
    }

    /// Widens all gaps by a length, which may be negative.
    pub(super) fn widen_gaps(&mut self, by: f64) {
        self.frame.extra_gap += by;
        let closer = 0.5 * by * if by > 0.0 { LONGEST } else { SHORTEST };
        for group in &mut self.groups {
            group.offsets = group.offsets.each(|offset| below(f64::from(offset) - closer));
        }
        self.set_wall_planes();
    }

    /// Puts the planes of walls to where the walls are.
    pub(super) fn set_wall_planes(&mut self) {
        self.on_leaves(&|part| part.set_wall_planes());
    }

    /// Works on all grains of each leaf, whether they belong to it or not.
    fn on_leaves(&mut self, work: &(impl Fn(&mut Part<'_, S>) + Sync)) {
        let threads = self.threads;
        let work = |part: &mut Part<'_, S>, range: usize| {
            if range >= part.halves.leaves() {
                work(part);
            }
        };
        descend(&mut self.part(), threads, &work, |(), ()| ());
    }
}

/// Computes the planes again that the grains of a range cross; says whether they keep their gaps.
fn lay_crossed_in_range(part: &mut Part<'_, impl ConvexShape>, range: usize) -> bool {
    with_instruction_set!(part.frame.cpu, set => set.call(
        #[inline(always)]
        || {
            let mut is_clear = true;
            for i in part.halves.grains(range).sites() {
                is_clear &= part.lay_crossed(set, i);
            }
            is_clear
        }
    ))
}

impl<S: ConvexShape> Part<'_, S> {
    /// Scales centres and planes; the specimen is scaled already.
    fn scale(&mut self, factor: f64, largest: f64) {
        for i in self.hot.range() {
            let d = self.hot[i].d;
            let gap = self.frame.gap(d, d).max(self.frame.gap(d, largest));
            let closer = if factor < 1.0 { 0.5 * gap * (1.0 - factor) * LONGEST } else { 0.0 };
            let cold = &mut self.cold[i];
            self.hot[i].center = scaled(self.hot[i].center, factor);
            cold.listed_center = scaled(cold.listed_center, factor);
            for group in cold.list.groups() {
                let offsets = &mut self.groups[group].offsets;
                *offsets = offsets.each(|offset| below(f64::from(offset) * factor - closer));
            }
        }
        for leaf in self.moved.range() {
            for moved in self.moved[leaf].iter_mut() {
                moved.center = scaled(moved.center, factor);
            }
        }
        self.set_wall_planes();
    }

    /// Puts the planes of walls to where the walls are.
    fn set_wall_planes(&mut self) {
        if self.frame.container.is_periodic {
            return;
        }
        for i in self.hot.range() {
            let d = self.hot[i].d;
            let groups = self.cold[i].list.groups();
            // Walls come first in every list.
            for at in LANES * groups.start..LANES * groups.end {
                let neighbor = self.groups[at / LANES].neighbors[at % LANES];
                if !is_wall(neighbor) {
                    break;
                }
                self.lay_wall(i, at / LANES, at % LANES, d);
            }
        }
    }

    /// Computes the planes again that a grain crosses; says whether it keeps its gaps.
    #[inline(always)]
    fn lay_crossed<I: InstructionSet>(&mut self, set: I, i: usize) -> bool {
        let (hot, cold) = (self.hot[i], self.cold[i]);
        let spread = self.spread(set, i, &hot);
        let none = set.splat(0.0);
        let mut is_clear = true;
        for group in cold.list.groups() {
            let crossed = spread.crosses(set, &self.groups[group], none);
            if !crossed.any() {
                continue;
            }
            let crossed = crossed.to_array();
            for lane in 0..LANES {
                if crossed[lane].to_bits() == 0 || !self.crosses_itself(i, &hot, group, lane, 0.0) {
                    continue;
                }
                if is_wall(self.groups[group].neighbors[lane]) {
                    is_clear = false;
                    continue;
                }
                match self.decide(i, &hot, group, lane) {
                    Decided::Apart(planes) => self.lay(&planes),
                    Decided::TooClose(n) => {
                        self.lay_between(i, group, lane, n);
                        is_clear = false;
                    }
                }
            }
        }
        is_clear
            && (!cold.list.is_near_lateral() || self.lateral_slack(&hot).0 >= 0.0)
            && (!cold.list.is_near_itself() || self.clears_itself(&hot))
    }
}

/// The last bits of a number, from which [`with_last_bits`] finds it again.
pub(super) fn last_bits(x: f64) -> u8 {
    x.to_bits() as u8
}

/// The number nearest to another one, of its sign, that has these last bits: there is one among 256 in a row. Scaling a
/// number and scaling it back changes it by a few of them.
pub(super) fn with_last_bits(near: f64, last: u8) -> f64 {
    let bits = near.to_bits();
    let by = last.wrapping_sub(bits as u8) as i8;
    f64::from_bits(bits.wrapping_add_signed(by.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_found_by_its_last_bits_where_scaling_leaves_it() {
        for x in [0.0, -0.0, 1.0, -1.0, 75.123_456_789, -1e-300, 4.0 - 1e-15, 2.0, f64::MIN_POSITIVE] {
            for factor in [0.995, 1.0 / 3.0, 1.0 - 1e-14] {
                let scaled = x * factor * 1.002 * (1.0 / (factor * 1.002));
                assert_eq!(with_last_bits(scaled, last_bits(x)).to_bits(), x.to_bits(), "{x} by {factor}");
            }
            for by in [-127, -1, 0, 1, 127] {
                let near = f64::from_bits((x.abs() + 1.0).to_bits().wrapping_add_signed(by));
                assert_eq!(with_last_bits(near, last_bits(x.abs() + 1.0)), x.abs() + 1.0);
            }
        }
    }
}
