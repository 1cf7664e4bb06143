//! The specimen shrinks, or the gap grows, and grains that have come too close push each other away.
//!
//! The pairs are visited one after the other. Two grains that lack `p = g - s(n)` to their gap are moved apart along
//! `n` by somewhat more than `p`, and turned: with the inverse masses `1 / m` and inertias `I⁻¹`, and the arms `x` from
//! the centres to the points of contact, the share of each is that of an impulse along `n`, weighted by `w = 1 / m + (x
//! × n) · I⁻¹ (x × n)` (position-based dynamics; Müller, Heidelberger, Hennix and Ratcliff 2007, DOI
//! 10.1016/j.jvcir.2007.01.005). Only grains that were touched look again in the next sweep.

use std::num::NonZeroUsize;

use super::descend::descend;
use super::group::{LANES, NO_NEIGHBOR, WALL, is_wall};
use super::planes::Decided;
use super::scale::{last_bits, with_last_bits};
use super::system::{Hot, Moved, Part, System, rotation};
use super::window::Window;
use crate::arrays::Each as _;
use crate::cpu::{InstructionSet, Lanes, with_instruction_set};
use crate::elementary::hypot;
use crate::gap::grain::{ConvexShape, PushContact, Turned};
use crate::gap::linear::{Vector, cross, dot, minus, scaled, sum};
use crate::memory::{Blocks, OutOfMemory, collected, refill, reserved};

/// How pairs that overlap are pushed apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Strength {
    /// How far: a share of the depth,
    beyond: f64,
    /// and of the diameter of the smaller grain in the first sweep of a cycle, beyond their gap. Grains that were
    /// pushed until they just touch have no room for a move, and the next growth makes them all overlap again: equal
    /// ellipsoids stalled at a volume fraction of 0.63 with the least share from the first sweep.
    first_beyond_d: f64,
    /// Most sweeps in a cycle, while the packing is loose enough to grow fast, and later on, when moves and swaps gain
    /// more for their time.
    most_sweeps: [u32; 2],
}

impl Strength {
    /// That of spheres; of ellipsoids while they grow fast, and once hard pushes bring them no further.
    pub(super) const LIGHT: Self = Self { beyond: 1.05, first_beyond_d: 0.02, most_sweeps: [32, 16] };
    /// The same of polyhedra, which need more sweeps while they are loose.
    pub(super) const LIGHT_ANGULAR: Self = Self { most_sweeps: [64, 16], ..Self::LIGHT };
    /// That of polyhedra: beyond the depth (successive over-relaxation) fewer sweeps of pushes end the overlaps, and
    /// grains that are apart after a cycle turn past each other in the moves of the next one.
    pub(super) const HARD_ANGULAR: Self = Self { beyond: 1.6, first_beyond_d: 0.04, most_sweeps: [64, 32] };
    /// The same where grains of a size jam each other, or most grains are spheres.
    pub(super) const HARD_ANGULAR_WIDE: Self = Self { first_beyond_d: 0.1, ..Self::HARD_ANGULAR };
    /// That of ellipsoids, which turn little when they are pushed: more of the depth leaves them looser.
    pub(super) const HARD: Self = Self { beyond: 1.3, first_beyond_d: 0.06, most_sweeps: [32, 48] };
}

/// The factor on the share of the diameter in each further sweep, and the least share.
const BEYOND_D_PER_SWEEP: f64 = 0.8;
const BEYOND_D: f64 = 1e-9;
/// Margin by which the specimen is widened to end the overlaps that are left.
const MARGIN: f64 = 1e-12;

/// Turns of the search for the least widening that ends an overlap.
const LEFT_TURNS: u32 = 4;

/// Pushes of a sweep below which the next one costs more to distribute to threads than to compute.
const LEAST_SHARED: u64 = 1000;

/// What is to become tighter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Tighten {
    /// All lengths of the specimen by a factor below 1.
    Shrink(f64),
    /// The gap by a length.
    Gap(f64),
}

/// How pushing ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pushed {
    /// Sweeps that were needed.
    pub(super) sweeps: u32,
    /// Whether a grain would have come out of its skin: then the lists should be built again.
    pub(super) left_skin: bool,
    /// Whether all gaps are kept.
    pub(super) is_clear: bool,
    pub(super) pushes: u64,
}

/// What is needed to take a failed push back, beside the poses of the moved grains; and the grains to test again.
#[derive(Clone, Debug, Default)]
pub(super) struct Pusher {
    /// The last bits of the centre of each grain, and of where its list was built: scaling leaves the others.
    saved: Vec<[[u8; 3]; 2]>,
    saved_stretch: f64,
    saved_extra_gap: f64,
    active: Vec<bool>,
    next: Vec<bool>,
    /// How far beyond its gap a pair is pushed, in shares of the depth and of the diameter of the smaller grain.
    beyond: f64,
    beyond_d: f64,
}

impl Pusher {
    /// Makes the system tighter and pushes for as many sweeps at most as the strength has of a packing that grows fast
    /// or no longer does. [`Self::undo`] goes back to before.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn push(
        &mut self,
        system: &mut System<impl ConvexShape>,
        by: Tighten,
        strength: Strength,
        is_fast: bool,
    ) -> Result<Pushed, OutOfMemory> {
        (self.beyond, self.beyond_d) = (strength.beyond, strength.first_beyond_d);
        let [fast, slow] = strength.most_sweeps;
        let most_sweeps = if is_fast { fast } else { slow };
        let n = system.len();
        let both = system.hot.iter().zip(&system.cold);
        self.saved =
            collected(both.map(|(hot, cold)| [hot.center, cold.listed_center].each(|x| x.each(last_bits))))?;
        system.moved = reserved(system.halves.leaves())?;
        for leaf in 0..system.halves.leaves() {
            system.moved.push(Blocks::reserved(system.halves.leaf(leaf).1)?);
        }
        system.cold.iter_mut().for_each(|cold| cold.list.mark_moved(false));
        (self.saved_stretch, self.saved_extra_gap) = (system.frame.stretch, system.frame.extra_gap);
        match by {
            Tighten::Shrink(factor) => system.scale(factor),
            Tighten::Gap(more) => system.widen_gaps(more),
        }
        refill(&mut self.active, n, true)?;
        refill(&mut self.next, n, false)?;
        Ok(self.sweeps(system, most_sweeps))
    }

    fn sweeps(&mut self, system: &mut System<impl ConvexShape>, most: u32) -> Pushed {
        let held = system.skins_left;
        let mut pushed = Pushed { sweeps: 0, left_skin: false, is_clear: false, pushes: 0 };
        let mut threads = system.threads;
        for sweep in 1..=most {
            pushed.sweeps = sweep;
            let strengths = [self.beyond, self.beyond_d];
            let mut all = system.part();
            (all.active, all.next) = (Window::whole(&mut self.active), Window::whole(&mut self.next));
            let work = |part: &mut Part<'_, _>, range: usize| push_range(part, range, strengths);
            let pushes = descend(&mut all, threads, &work, |a, b| a + b);
            let more_held = all.skins_left;
            system.skins_left += more_held;
            pushed.pushes += pushes;
            pushed.left_skin = system.skins_left > held;
            if pushes == 0 {
                pushed.is_clear = true;
                return pushed;
            }
            if pushes < LEAST_SHARED {
                threads = NonZeroUsize::MIN;
            }
            std::mem::swap(&mut self.active, &mut self.next);
            self.next.fill(false);
            self.beyond_d = (self.beyond_d * BEYOND_D_PER_SWEEP).max(BEYOND_D);
        }
        pushed
    }

    /// Widens the specimen, or narrows the gap, until the overlaps that are left are none; says whether that is tighter
    /// than before and all gaps are kept.
    pub(super) fn keep_what_is_valid(&mut self, system: &mut System<impl ConvexShape>, by: Tighten) -> bool {
        match by {
            Tighten::Shrink(factor) => {
                let Some(widen) = self.least_factor(&system.part()) else { return false };
                let widen = widen * (1.0 + MARGIN);
                if widen * factor >= 1.0 {
                    return false;
                }
                system.scale(widen);
            }
            Tighten::Gap(more) => {
                let depth = self.deepest(&system.part());
                let less = depth * (1.0 + MARGIN) + MARGIN * system.frame.gap(0.0, 0.0);
                if less >= more {
                    return false;
                }
                system.widen_gaps(-less);
            }
        }
        system.is_clear()
    }

    /// Calls `visit` for every pair and wall of an active grain whose gap is not kept, with the distance between the
    /// centres, or of the centre from the wall, along the normal, and with the distance that the gap asks for.
    fn for_each_left(&self, system: &Part<'_, impl ConvexShape>, mut visit: impl FnMut(f64, f64)) {
        for i in system.hot.range().filter(|&i| self.active[i]) {
            let (hot, cold) = (system.hot[i], system.cold[i]);
            for group in cold.list.groups() {
                for lane in 0..LANES {
                    let planes = &system.groups[group];
                    let neighbor = planes.neighbors[lane];
                    if neighbor == NO_NEIGHBOR {
                        continue;
                    }
                    if is_wall(neighbor) {
                        let (n, o) = system.frame.wall_plane(neighbor - WALL, hot.d);
                        if system.frame.beyond_wall(neighbor - WALL, &hot) > 0.0 {
                            // Distance of the centre from the wall itself.
                            let away = o + system.frame.wall_gap(hot.d) - dot(hot.center, n);
                            visit(away, hot.turned.support_mm(n) + system.frame.wall_gap(hot.d));
                        }
                        continue;
                    }
                    let n = planes.normal(lane);
                    let left =
                        f64::from(planes.offsets[lane]) - dot(minus(hot.center, cold.listed_center), n);
                    if left >= hot.turned.support_mm(n) {
                        continue;
                    }
                    if let Decided::TooClose(n) = system.decide(i, &hot, group, lane) {
                        let (j, image) = system.frame.names.read(neighbor);
                        let other = &system.hot[j];
                        let r = minus(sum(other.center, system.frame.shift(image)), hot.center);
                        let gap = system.frame.gap(hot.d, other.d);
                        let contact = hot.turned.contact(&other.turned, r, gap, n, LEFT_TURNS);
                        let [h_a, h_b] = contact.supports_mm;
                        visit(dot(r, contact.normal), h_a + h_b + gap);
                    }
                }
            }
            if cold.list.is_near_lateral() {
                let (slack, _) = system.lateral_slack(&hot);
                if slack < 0.0 {
                    let axis = system.frame.container.bounds[0] / 2.0 * system.frame.stretch;
                    // In a wider cylinder the centre lies farther out in proportion, and the farthest point no more.
                    let out = hypot(hot.center[0] - axis, hot.center[1] - axis);
                    visit(axis - out, axis - out - slack);
                }
            }
            if cold.list.is_near_itself() {
                system.for_each_own_overlap(&hot, LEFT_TURNS, &mut visit);
            }
        }
    }

    /// The least factor on all lengths of the specimen, 1 or more, at which the gaps are kept.
    fn least_factor(&self, system: &Part<'_, impl ConvexShape>) -> Option<f64> {
        let mut factor = 1.0_f64;
        self.for_each_left(system, |away, needed| {
            factor = factor.max(if away > 0.0 { needed / away } else { f64::INFINITY });
        });
        factor.is_finite().then_some(factor)
    }

    /// The most that a gap lacks.
    fn deepest(&self, system: &Part<'_, impl ConvexShape>) -> f64 {
        let mut depth = 0.0_f64;
        self.for_each_left(system, |away, needed| depth = depth.max(needed - away));
        depth
    }

    /// Goes back to before the push; the planes follow.
    pub(super) fn undo(&mut self, system: &mut System<impl ConvexShape>) {
        if system.frame.extra_gap > self.saved_extra_gap {
            system.widen_gaps(self.saved_extra_gap - system.frame.extra_gap);
            system.frame.extra_gap = self.saved_extra_gap;
        }
        if system.frame.stretch < self.saved_stretch {
            system.scale(self.saved_stretch / system.frame.stretch);
        }
        system.frame.stretch = self.saved_stretch;
        let moved = std::mem::take(&mut system.moved);
        let mut all = system.part();
        for &Moved { site, center, orientation } in moved.iter().flat_map(Blocks::iter) {
            let turned = all.cold[site as usize].shape.turned(&rotation(orientation));
            all.set_pose(site as usize, center, orientation, turned);
        }
        for ((hot, cold), last) in system.hot.iter_mut().zip(&mut system.cold).zip(&self.saved) {
            for (x, last) in [&mut hot.center, &mut cold.listed_center].into_iter().zip(last) {
                *x = [0, 1, 2].each(|a| with_last_bits(x[a], last[a]));
            }
        }
        system.set_wall_planes();
        // Planes are computed again where they are crossed; the packing was valid before, but for rounding.
        let _ = system.is_clear();
    }
}

/// Pushes the grains of a range that are to look at their neighbours; returns how often.
fn push_range(part: &mut Part<'_, impl ConvexShape>, range: usize, strengths: [f64; 2]) -> u64 {
    with_instruction_set!(part.frame.cpu, set => set.call(
        #[inline(always)]
        || {
            let mut pushes = 0;
            for i in part.halves.grains(range).sites() {
                if part.active[i] {
                    pushes += part.visit(set, i, strengths);
                }
            }
            pushes
        }
    ))
}

impl<S: ConvexShape> Part<'_, S> {
    /// Pushes a grain and its neighbours apart; returns how often.
    #[inline(always)]
    fn visit<I: InstructionSet>(&mut self, set: I, i: usize, strengths: [f64; 2]) -> u64 {
        let mut pushes = 0;
        let range = self.cold[i].list.groups();
        let mut spread = self.spread(set, i, &self.hot[i]);
        let none = set.splat(0.0);
        for group in range {
            let crossed = spread.crosses(set, &self.groups[group], none);
            if !crossed.any() {
                continue;
            }
            let crossed = crossed.to_array();
            for lane in 0..LANES {
                if crossed[lane].to_bits() == 0 || !self.crosses_itself(i, &self.hot[i], group, lane, 0.0) {
                    continue;
                }
                let neighbor = self.groups[group].neighbors[lane];
                if is_wall(neighbor) {
                    let depth = self.frame.beyond_wall(neighbor - WALL, &self.hot[i]);
                    let (n, _) = self.frame.wall_plane(neighbor - WALL, self.hot[i].d);
                    self.push_from_wall(i, n, depth);
                    self.next[i] = true;
                } else {
                    match self.touch(i, group, lane) {
                        Ok(planes) => {
                            self.lay(&planes);
                            continue;
                        }
                        Err(contact) => {
                            let (j, _) = self.frame.names.read(neighbor);
                            self.push_apart(i, group, lane, &contact, strengths);
                            self.next[j] = true;
                            self.next[i] = true;
                        }
                    }
                }
                pushes += 1;
                spread = self.spread(set, i, &self.hot[i]);
            }
        }
        let cold = &self.cold[i];
        if cold.list.is_near_lateral() {
            let (slack, n) = self.lateral_slack(&self.hot[i]);
            if slack < 0.0 {
                self.push_from_wall(i, n, -slack);
                self.next[i] = true;
                pushes += 1;
            }
        }
        if self.cold[i].list.is_near_itself()
            && let Some((r, n)) = self.own_image_met(&self.hot[i])
        {
            self.turn_from_itself(i, r, n, strengths);
            self.next[i] = true;
            pushes += 1;
        }
        pushes
    }

    /// Pushes a grain away from a wall with this outward normal.
    fn push_from_wall(&mut self, i: usize, n: Vector, depth: f64) {
        let by = depth * (1.0 + 1e-6) + BEYOND_D * self.hot[i].d;
        self.displace(i, scaled(n, -by), [0.0; 3]);
    }

    /// Pushes a grain and its neighbour apart, by a share of the depth and one of the smaller diameter, and computes
    /// their planes again.
    fn push_apart(
        &mut self,
        i: usize,
        group: usize,
        lane: usize,
        contact: &PushContact,
        [beyond, beyond_d]: [f64; 2],
    ) {
        let (j, image) = self.frame.names.read(self.groups[group].neighbors[lane]);
        let (a, b) = (self.hot[i], self.hot[j]);
        let r = minus(sum(b.center, self.frame.shift(image)), a.center);
        let gap = self.frame.gap(a.d, b.d);
        let (n, [h_a, h_b], [arm_a, arm_b]) = (contact.normal, contact.supports_mm, contact.arms_mm);
        let lacks = gap + h_a + h_b - dot(r, n);
        // Spheres do not turn past each other.
        let [beyond, beyond_d] = if !S::Turned::IS_SPHERE && a.turned.is_sphere() && b.turned.is_sphere() {
            [Strength::LIGHT.beyond, beyond_d]
        } else {
            [beyond, beyond_d]
        };
        let by = beyond * lacks + beyond_d * a.d.min(b.d);
        let (pushed_a, pushed_b) = (self.inertia(i, &a, arm_a, n), self.inertia(j, &b, arm_b, n));
        let share = by / (pushed_a.weight + pushed_b.weight);
        self.displace(i, scaled(n, -share * pushed_a.per_mass), scaled(pushed_a.turn, -share));
        self.displace(j, scaled(n, share * pushed_b.per_mass), scaled(pushed_b.turn, share));
        self.lay_between(i, group, lane, n);
    }

    /// What an impulse along `n` at the end of an arm does to a grain.
    #[inline(always)]
    pub(super) fn inertia(&self, i: usize, hot: &Hot<S::Turned>, arm: Vector, n: Vector) -> Impulse {
        let cold = &self.cold[i];
        let per_mass = 1.0 / hot.d;
        if hot.turned.is_sphere() {
            return Impulse { per_mass, weight: per_mass, turn: [0.0; 3] };
        }
        let moment = cross(arm, n);
        let rows = rotation(cold.orientation);
        let per_inertia = cold.shape.per_inertia(per_mass);
        let local = [0, 1, 2].each(|k| {
            per_inertia[k] * (rows[0][k] * moment[0] + rows[1][k] * moment[1] + rows[2][k] * moment[2])
        });
        let turn = rows.each(|row| dot(row, local));
        Impulse { per_mass, weight: per_mass + dot(moment, turn), turn }
    }

    /// Displaces and turns a grain, unless it would come out of its skin, for which the lists do not hold.
    #[inline(always)]
    pub(super) fn displace(&mut self, i: usize, by: Vector, turn: Vector) {
        let center = sum(self.hot[i].center, by);
        let orientation = self.turned(i, turn);
        if self.skin_used(i, center, orientation) > self.cold[i].skin {
            self.skins_left += 1;
            self.cold[i].list.mark_left_skin(true);
            return;
        }
        if !self.cold[i].list.is_moved() {
            self.cold[i].list.mark_moved(true);
            let before =
                Moved { site: i as u32, center: self.hot[i].center, orientation: self.cold[i].orientation };
            // There is room for all.
            self.moved[self.halves.leaf_of(i)].push(before, &mut None);
        }
        let turned = self.cold[i].shape.turned(&rotation(orientation));
        self.set_pose(i, center, orientation, turned);
    }
}

/// What an impulse does to a grain: one over its mass, the displacement of the end of the arm, and the turn.
pub(super) struct Impulse {
    pub(super) per_mass: f64,
    pub(super) weight: f64,
    pub(super) turn: Vector,
}
