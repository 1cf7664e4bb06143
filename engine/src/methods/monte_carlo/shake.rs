//! Hard-particle Monte Carlo: single moves that are made if they bring no grain too close to another (Metropolis and
//! others 1953, DOI 10.1063/1.1699114).
//!
//! A move displaces and turns one grain by uniform random amounts. Each grain has its own largest step, which grows
//! with success and falls with failure, until about one in four moves succeeds.

use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::descend::descend;
use super::group::{LANES, LONGEST, is_wall};
use super::halves::Grains;
use super::planes::{Decided, NewPlanes};
use super::system::{Hot, Part, System, rotation};
use crate::arrays::Each as _;
use crate::cpu::{InstructionSet, Lanes, with_instruction_set};
use crate::gap::grain::ConvexShape;
use crate::gap::linear::Vector;
use crate::rng::numbered_stream;

/// Factors on the step after a move that was made, and after one that was not.
const WIDER: f64 = 1.1;
const NARROWER: f64 = 0.97;
/// Factor after a move that would have used up too much of the skin.
const SKIN_NARROWER: f64 = 0.99;
/// Longest step over the equivalent diameter.
const LONGEST_STEP: f64 = 0.05;
/// Shortest step over the equivalent diameter: below it nothing is gained.
const SHORTEST_STEP: f64 = 1e-9;
/// Turns of a move, over its displacements at the end of the longest axis.
const TURN: f64 = 1.5;
/// Share of the skin that moves may use; the rest is for pushes.
const SKIN_SHARE: f64 = 0.6;
/// Most planes that are computed again for one move; one that needs more is not made.
const MOST_NEW: usize = 16;

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Moves {
    pub(super) tried: u64,
    pub(super) accepted: u64,
}

impl Moves {
    fn plus(self, more: Self) -> Self {
        Self { tried: self.tried + more.tried, accepted: self.accepted + more.accepted }
    }
}

/// Planes to be laid if a move is made.
pub(super) struct Pending {
    planes: [Option<NewPlanes>; MOST_NEW],
    count: usize,
}

impl Pending {
    pub(super) fn new() -> Self {
        Self { planes: [None; MOST_NEW], count: 0 }
    }

    #[inline(always)]
    fn push(&mut self, planes: NewPlanes) -> bool {
        if self.count == MOST_NEW {
            return false;
        }
        self.planes[self.count] = Some(planes);
        self.count += 1;
        true
    }

    #[inline(always)]
    pub(super) fn lay(&self, system: &mut Part<'_, impl ConvexShape>) {
        for planes in self.planes[..self.count].iter().flatten() {
            system.lay(planes);
        }
    }
}

/// Six uniform numbers in plus minus 1, of 21 bits each.
#[inline(always)]
fn six(rng: &mut Xoshiro256PlusPlus) -> [Vector; 2] {
    [(); 2].each(|()| {
        let bits = rng.next_u64();
        [0, 21, 42].each(|from| {
            let part = (bits >> from & 0x1f_ffff) as i32;
            f64::from(2 * part + 1 - (1 << 21)) * (1.0 / f64::from(1 << 21))
        })
    })
}

/// Tries one move of each grain.
pub(super) fn sweep(system: &mut System<impl ConvexShape>, rng: &mut Xoshiro256PlusPlus) -> Moves {
    let (threads, mut all) = (system.threads, system.part());
    if !all.halves.are_cut() {
        return sweep_range(&mut all, 1, rng);
    }
    let streams = rng.next_u64();
    let work = |part: &mut Part<'_, _>, range: usize| {
        sweep_range(part, range, &mut numbered_stream(streams, range as u64))
    };
    descend(&mut all, threads, &work, Moves::plus)
}

/// Tries one move of each grain that belongs to a range.
fn sweep_range(part: &mut Part<'_, impl ConvexShape>, range: usize, rng: &mut Xoshiro256PlusPlus) -> Moves {
    with_instruction_set!(part.frame.cpu, set => set.call(
        #[inline(always)]
        || sweep_with(set, part, part.halves.grains(range), rng)
    ))
}

#[inline(always)]
fn sweep_with<I: InstructionSet, S: ConvexShape>(
    set: I,
    system: &mut Part<'_, S>,
    grains: Grains<'_>,
    rng: &mut Xoshiro256PlusPlus,
) -> Moves {
    let mut moves = Moves::default();
    for i in grains.sites() {
        moves.tried += 1;
        let (hot, cold) = (&system.hot[i], &system.cold[i]);
        let step = cold.step;
        let [x, t] = six(rng);
        let angle = TURN * step / cold.shape.outer_mm();
        let center = [0, 1, 2].each(|a| hot.center[a] + step * x[a]);
        let orientation = system.turned(i, t.each(|t| angle * t));
        if system.skin_used(i, center, orientation) > SKIN_SHARE * cold.skin {
            system.cold[i].step *= SKIN_NARROWER;
            continue;
        }
        let as_if = Hot { center, turned: cold.shape.turned(&rotation(orientation)), d: hot.d };
        let mut pending = Pending::new();
        if fits(set, system, i, &as_if, 0.0, &mut pending) {
            pending.lay(system);
            system.set_pose(i, center, orientation, as_if.turned);
            let longest = LONGEST_STEP * as_if.d;
            system.cold[i].step = (step * WIDER).min(longest);
            moves.accepted += 1;
        } else {
            system.cold[i].step = (step * NARROWER).max(SHORTEST_STEP * as_if.d);
        }
    }
    moves
}

/// Whether the trial pose of a grain keeps all gaps; notes the planes that are to be computed again. `slack_mm` is how
/// far the grain may already be beyond its planes, because the gap that it must keep has just changed.
#[inline(always)]
pub(super) fn fits<I: InstructionSet, S: ConvexShape>(
    set: I,
    system: &Part<'_, S>,
    i: usize,
    as_if: &Hot<S::Turned>,
    slack_mm: f64,
    pending: &mut Pending,
) -> bool {
    let cold = &system.cold[i];
    let spread = system.spread(set, i, as_if);
    let slack_mm = slack_mm * LONGEST;
    let slack_lanes = set.splat(slack_mm);
    for group in cold.list.groups() {
        let crossed = spread.crosses(set, &system.groups[group], slack_lanes);
        if !crossed.any() {
            continue;
        }
        let crossed = crossed.to_array();
        for lane in 0..LANES {
            if crossed[lane].to_bits() == 0 || !system.crosses_itself(i, as_if, group, lane, slack_mm) {
                continue;
            }
            if is_wall(system.groups[group].neighbors[lane]) {
                return false;
            }
            match system.decide(i, as_if, group, lane) {
                Decided::Apart(planes) if pending.push(planes) => {}
                _ => return false,
            }
        }
    }
    if cold.list.is_near_lateral() && system.lateral_slack(as_if).0 < 0.0 {
        return false;
    }
    !cold.list.is_near_itself() || system.clears_itself(as_if)
}
