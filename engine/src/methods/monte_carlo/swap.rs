//! Monte Carlo swap moves of grains of similar size (Berthier, Coslovich, Ninarello and Ozawa 2016,
//! DOI 10.1103/PhysRevLett.116.238002).
//!
//! Two sites swap their shapes, each site keeping its centre and orientation, where both shapes fit. Near jamming,
//! where grains hardly move, this is what still lets sizes and voids find each other.

use rand::rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::descend::descend;
use super::group::{LANES, LONGEST, NO_NEIGHBOR, below, is_wall};
use super::shake::{Pending, fits};
use super::system::{Hot, Part, System, rotation};
use crate::arrays::Each as _;
use crate::cpu::{InstructionSet, with_instruction_set};
use crate::elementary::ln;
use crate::gap::grain::ConvexShape;
use crate::memory::{OutOfMemory, filled};
use crate::methods::swap_pairs::{Families, SwapPairs};
use crate::rng::{numbered_stream, uniform};
use crate::segregation::Preference;

/// Share of the skin that a larger grain may take.
const SKIN_SHARE: f64 = 0.5;
/// Pairs that are drawn ahead.
const AHEAD: usize = 8;

/// What swaps know of the grains, by rank.
pub(super) struct SwapGrains<'a> {
    pub(super) families: &'a Families,
    pub(super) preference: Option<&'a Preference>,
}

/// Tries swaps, by a number per grain: everywhere, or where the specimen is cut among the grains of each range. With a
/// preference they are as Metropolis and others (1953) have it: those that go against it happen the more rarely the
/// more they do, so that a gradient is kept and not levelled.
///
/// # Errors
/// When the system refuses memory.
pub(super) fn sweep<S: ConvexShape>(
    pairs: &mut SwapPairs,
    grains: &SwapGrains<'_>,
    system: &mut System<S>,
    (tries_per_grain, everywhere): (f64, bool),
    rng: &mut Xoshiro256PlusPlus,
) -> Result<(), OutOfMemory> {
    if system.len() < 2 {
        return Ok(());
    }
    let tries = |grains: usize| (tries_per_grain * grains as f64) as u64;
    let tried = if everywhere || !system.halves.are_cut() {
        let mut diameters = filled(system.len(), 0.0)?;
        for (hot, &rank) in system.hot.iter().zip(&system.rank) {
            diameters[rank as usize] = hot.d;
        }
        pairs.prepare(grains.families, &system.rank, &diameters)?;
        drop(diameters);
        let tries = tries(system.len());
        try_pairs(pairs, grains, &mut system.part(), tries, rng)
    } else {
        let halves = &system.halves;
        let range_of = |site: usize| halves.range_of(site);
        let groups = pairs.groups(grains.families, &system.rank, halves.ranges(), range_of)?;
        let streams = rng.next_u64();
        let of = &*pairs;
        let work = |part: &mut Part<'_, S>, range: usize| {
            let group = &groups[range];
            let mut rng = numbered_stream(streams, range as u64);
            match of.among(group, |site| part.hot[site].d) {
                Ok(mut pairs) => try_pairs(&mut pairs, grains, part, tries(group.sites.len()), &mut rng),
                Err(refused) => SwapCounts { refused: Some(refused), ..SwapCounts::default() },
            }
        };
        let threads = system.threads;
        descend(&mut system.part(), threads, &work, SwapCounts::plus)
    };
    pairs.count(tried.tried, tried.accepted);
    pairs.give_memory_back();
    tried.refused.map_or(Ok(()), Err)
}

/// How many pairs had different shapes, and how many of these were swapped.
#[derive(Clone, Copy, Default)]
struct SwapCounts {
    tried: u64,
    accepted: u64,
    refused: Option<OutOfMemory>,
}

impl SwapCounts {
    fn plus(self, more: Self) -> Self {
        Self {
            tried: self.tried + more.tried,
            accepted: self.accepted + more.accepted,
            refused: self.refused.or(more.refused),
        }
    }
}

/// Tries pairs.
fn try_pairs<S: ConvexShape>(
    pairs: &mut SwapPairs,
    grains: &SwapGrains<'_>,
    system: &mut Part<'_, S>,
    tries: u64,
    rng: &mut Xoshiro256PlusPlus,
) -> SwapCounts {
    with_instruction_set!(system.frame.cpu, set => set.call(
        #[inline(always)]
        || try_pairs_with(set, pairs, grains, system, tries, rng)
    ))
}

#[inline(always)]
fn try_pairs_with<I: InstructionSet, S: ConvexShape>(
    set: I,
    pairs: &mut SwapPairs,
    grains: &SwapGrains<'_>,
    system: &mut Part<'_, S>,
    tries: u64,
    rng: &mut Xoshiro256PlusPlus,
) -> SwapCounts {
    let families = grains.families;
    let (mut tried, mut accepted) = (0, 0);
    let mut left = tries;
    while left > 0 {
        let count = left.min(AHEAD as u64) as usize;
        left -= count as u64;
        // Pairs are drawn ahead, so that the cache misses behind them overlap.
        let mut drawn = [[0_usize; 2]; AHEAD];
        for pair in &mut drawn[..count] {
            *pair = pairs.draw(rng);
            for place in *pair {
                let site = pairs.site(place);
                system.hot.prefetch(site);
                system.cold.prefetch(site);
            }
        }
        for pair in &drawn[..count] {
            let cold = &system.cold[pairs.site(pair[1])];
            for group in cold.list.groups() {
                system.groups.prefetch(group);
            }
        }
        for &[larger, smaller] in &drawn[..count] {
            let sites = [larger, smaller].each(|place| pairs.site(place));
            let shape = |site: usize| &system.cold[site].shape;
            if larger == smaller || shape(sites[0]).is_same(shape(sites[1])) {
                continue;
            }
            tried += 1;
            let is_preferred = grains.preference.is_none_or(|preference| {
                let ranks = [larger, smaller].each(|place| families.rank(place));
                // The specimen is larger than requested by the stretch while the grains have their size.
                let centers = sites.each(|site| system.hot[site].center.each(|x| x / system.frame.stretch));
                ln(uniform(rng)) <= preference.log_acceptance_ratio(ranks, centers)
            });
            if is_preferred && swap(set, system, sites[0], sites[1]) {
                pairs.swap([larger, smaller]);
                accepted += 1;
            }
        }
    }
    SwapCounts { tried, accepted, refused: None }
}

/// The site as it would be with another shape: how much longer the semi-axes of the ellipsoid around it are at most,
/// and how much closer it may come to its planes for its gaps.
struct Changed<S: ConvexShape> {
    as_if: Hot<S::Turned>,
    shape: S,
    longer: f64,
    slack_mm: f64,
}

impl<S: ConvexShape> Changed<S> {
    /// Whether the skin of the site has room for the other shape where the site is now, for the lists hold no farther.
    #[inline(always)]
    fn keeps_skin(&self, system: &Part<'_, S>, site: usize) -> bool {
        let (cold, taken) = (&system.cold[site], self.longer + self.slack_mm);
        taken <= SKIN_SHARE * cold.skin
            && (taken == 0.0
                || taken + system.skin_used(site, system.hot[site].center, cold.orientation) <= cold.skin)
    }
}

#[inline(always)]
fn changed<S: ConvexShape>(system: &Part<'_, S>, site: usize, from: usize) -> Changed<S> {
    let (old, new) = (&system.cold[site], &system.cold[from]);
    let (d_old, d_new) = (system.hot[site].d, system.hot[from].d);
    let (around, around_old) = (new.shape.around_mm(), old.shape.around_mm());
    let longer = [0, 1, 2].each(|a| around[a] - around_old[a]).into_iter().fold(0.0, f64::max);
    let turned = new.shape.turned(&rotation(old.orientation));
    let as_if = Hot { center: system.hot[site].center, turned, d: d_new };
    Changed { as_if, shape: new.shape, longer, slack_mm: system.more_gap(d_old, d_new) }
}

/// Lets the shapes of two sites change places if they fit; the larger one is at the first site.
#[inline(always)]
fn swap<I: InstructionSet>(set: I, system: &mut Part<'_, impl ConvexShape>, i: usize, j: usize) -> bool {
    let at_j = changed(system, j, i);
    let mut planes_j = Pending::new();
    if !at_j.keeps_skin(system, j) || !fits(set, system, j, &at_j.as_if, at_j.slack_mm, &mut planes_j) {
        return false;
    }
    let at_i = changed(system, i, j);
    let mut planes_i = Pending::new();
    if !at_i.keeps_skin(system, i) || !fits(set, system, i, &at_i.as_if, at_i.slack_mm, &mut planes_i) {
        return false;
    }
    // Each fits beside the other as it was.
    if are_neighbors(system, i, j) {
        return false;
    }
    for (site, change) in [(j, &at_j), (i, &at_i)] {
        system.come_closer(site, change.slack_mm, change.as_if.d);
        system.hot[site] = change.as_if;
        let cold = &mut system.cold[site];
        cold.shape = change.shape;
        cold.skin -= change.longer + change.slack_mm;
    }
    planes_j.lay(system);
    planes_i.lay(system);
    let (step_i, step_j) = (system.cold[i].step, system.cold[j].step);
    (system.cold[i].step, system.cold[j].step) = (step_j, step_i);
    (system.rank[i], system.rank[j]) = (system.rank[j], system.rank[i]);
    true
}

/// Whether two sites are in each other's lists.
fn are_neighbors(system: &Part<'_, impl ConvexShape>, i: usize, j: usize) -> bool {
    let cold = &system.cold[i];
    let groups = &system.groups[cold.list.groups()];
    groups.iter().flat_map(|group| group.neighbors).any(|neighbor| {
        neighbor != NO_NEIGHBOR && !is_wall(neighbor) && system.frame.names.read(neighbor).0 == j
    })
}

impl<S: ConvexShape> Part<'_, S> {
    /// The most by which a gap of a grain grows when its diameter changes.
    #[inline(always)]
    fn more_gap(&self, d_old: f64, d_new: f64) -> f64 {
        let to_itself = self.frame.gap(d_new, d_new) - self.frame.gap(d_old, d_old);
        let to_walls = self.frame.wall_gap(d_new) - self.frame.wall_gap(d_old);
        to_itself.max(to_walls).max(0.0)
    }

    /// Brings the planes of a grain, but not those of its neighbours, closer to it, for the gaps of its new diameter.
    fn come_closer(&mut self, i: usize, slack_mm: f64, d: f64) {
        for group in self.cold[i].list.groups() {
            for lane in 0..LANES {
                let neighbor = self.groups[group].neighbors[lane];
                if neighbor != NO_NEIGHBOR && is_wall(neighbor) {
                    self.lay_wall(i, group, lane, d);
                } else {
                    let offset = &mut self.groups[group].offsets[lane];
                    *offset = below(f64::from(*offset) - slack_mm * LONGEST);
                }
            }
        }
    }
}
