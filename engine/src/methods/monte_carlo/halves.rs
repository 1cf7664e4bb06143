//! The specimen in halves, halves of these, and so on, whose grains threads move at the same time with equal bits.
//!
//! The grains lie in memory along a curve through the specimen, so that a range of sites is a region of it. The range
//! of all sites is halved, and each half again, as often as the number of grains says: that is a tree of ranges, whose
//! leaves have some thousand grains each. A grain whose neighbours, as its list names them, all lie in its leaf touches
//! nothing outside of it when it moves: neither poses nor planes. Such grains of different leaves are moved at the same
//! time. A grain with a neighbour in another leaf belongs to the smallest range of the tree that has both. It is moved
//! after the grains of both halves of that range, at the same time as those of other ranges of that size. Last come the
//! few grains at the cut through the whole specimen.
//!
//! So the outcome is that of one thread that moves the grains in a certain order, which the grains alone decide. As
//! every range has a random stream of its own, nothing depends on the number of threads.

use crate::memory::{OutOfMemory, make_room, refill};

/// Fewest grains of a leaf: below, the cuts hold too many of them.
const LEAST_GRAINS: usize = 5000;
/// Most times that the grains are halved.
const MOST_HALVINGS: u32 = 6;
/// Grains from which a specimen is cut.
pub(crate) const LEAST_CUT: usize = 2 * LEAST_GRAINS;

/// The tree of ranges. They have the numbers of a binary heap: 1 is that of all sites, and the halves of `k` are `2 k`
/// and `2 k + 1`.
#[derive(Clone, Debug)]
pub(super) struct Halves {
    sites: usize,
    halvings: u32,
    /// Sites of a leaf; the last one has less.
    per_leaf: usize,
    /// The range that the grain at each site belongs to. Empty where there is one range.
    range_of: Vec<u16>,
    /// The sites of each range that is halved, rising.
    cut: Vec<Vec<u32>>,
}

impl Halves {
    /// A tree of ranges of sites, no matter where they are.
    pub(super) fn new(sites: usize) -> Self {
        Self::with_least(sites, LEAST_GRAINS)
    }

    /// The same with at least `least` grains in a leaf.
    pub(super) fn with_least(sites: usize, least: usize) -> Self {
        let halvings = (sites / least).checked_ilog2().unwrap_or(0).min(MOST_HALVINGS);
        Self {
            sites,
            halvings,
            per_leaf: sites.div_ceil(1 << halvings).max(1),
            range_of: Vec::new(),
            cut: Vec::new(),
        }
    }

    /// Whether there is more than one range.
    pub(super) fn are_cut(&self) -> bool {
        self.halvings > 0
    }

    /// Number of leaves.
    pub(super) fn leaves(&self) -> usize {
        1 << self.halvings
    }

    #[inline(always)]
    pub(super) fn leaf_of(&self, site: usize) -> usize {
        site / self.per_leaf
    }

    /// First site and number of sites of a leaf.
    pub(super) fn leaf(&self, leaf: usize) -> (usize, usize) {
        let end = |leaf: usize| (leaf * self.per_leaf).min(self.sites);
        (end(leaf), end(leaf + 1) - end(leaf))
    }

    /// One more than the largest number of a range.
    pub(super) fn ranges(&self) -> usize {
        2 << self.halvings
    }

    /// The range that the grain at a site belongs to.
    pub(super) fn range_of(&self, site: usize) -> usize {
        self.range_of.get(site).map_or(1, |&range| range.into())
    }

    /// The smallest range that has all leaves from one to another one.
    pub(super) fn smallest(&self, [first, last]: [usize; 2]) -> usize {
        let (mut first, mut last) = (self.leaves() + first, self.leaves() + last);
        while first != last {
            (first, last) = (first / 2, last / 2);
        }
        first
    }

    /// Room for the ranges that the grains belong to, none where there is one range.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn begin_ranges(&mut self) -> Result<Vec<u16>, OutOfMemory> {
        let mut ranges = std::mem::take(&mut self.range_of);
        refill(&mut ranges, if self.are_cut() { self.sites } else { 0 }, 0)?;
        Ok(ranges)
    }

    /// Takes notice of the range that the grain at each site belongs to, the smallest one that has its neighbours.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn end_ranges(&mut self, range_of: Vec<u16>) -> Result<(), OutOfMemory> {
        self.range_of = range_of;
        if !self.are_cut() {
            return Ok(());
        }
        self.cut.resize_with(self.leaves(), Vec::new);
        self.cut.iter_mut().for_each(Vec::clear);
        for (site, &range) in self.range_of.iter().enumerate() {
            if let Some(cut) = self.cut.get_mut(usize::from(range)) {
                make_room(cut, 1)?;
                cut.push(site as u32);
            }
        }
        Ok(())
    }

    /// Gives back what was noted of neighbours.
    pub(super) fn forget(&mut self) {
        (self.range_of, self.cut) = (Vec::new(), Vec::new());
    }

    /// The grains that belong to a range.
    pub(super) fn grains(&self, range: usize) -> Grains<'_> {
        if let Some(cut) = self.cut.get(range) {
            return Grains { cut: Some(cut), first: 0, count: cut.len(), range_of: &[], range: 0 };
        }
        let (first, count) = self.leaf(range - self.leaves());
        Grains { cut: None, first, count, range_of: &self.range_of, range: range as u16 }
    }
}

/// The grains that belong to a range, by their sites.
#[derive(Clone, Copy)]
pub(super) struct Grains<'a> {
    /// The sites, of a range that is halved.
    cut: Option<&'a [u32]>,
    /// The sites of a leaf, of which those count that belong to it.
    first: usize,
    count: usize,
    range_of: &'a [u16],
    range: u16,
}

impl Grains<'_> {
    /// Their sites, rising.
    #[inline(always)]
    pub(super) fn sites(self) -> impl Iterator<Item = usize> {
        (0..self.count).filter_map(move |k| {
            if let Some(cut) = self.cut {
                return Some(cut[k] as usize);
            }
            let site = self.first + k;
            self.range_of.get(site).is_none_or(|&range| range == self.range).then_some(site)
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn few_grains_are_one_range() {
        for sites in [0, 1, LEAST_CUT - 1] {
            let mut halves = Halves::new(sites);
            let ranges = halves.begin_ranges().unwrap();
            halves.end_ranges(ranges).unwrap();
            assert!(!halves.are_cut() && halves.ranges() == 2);
            assert!(halves.grains(1).sites().eq(0..sites));
        }
        assert!(Halves::new(LEAST_CUT).are_cut());
        assert_eq!(Halves::new(100_000_000).halvings, MOST_HALVINGS);
    }

    #[test]
    fn every_grain_belongs_to_the_smallest_range_that_has_its_neighbours() {
        let mut halves = Halves::with_least(1003, 120);
        assert_eq!((halves.leaves(), halves.leaf(0), halves.leaf(7)), (8, (0, 126), (882, 121)));
        // Each grain has the next 25 as neighbours, and one is far away.
        let mut ranges = halves.begin_ranges().unwrap();
        for (site, range) in ranges.iter_mut().enumerate() {
            let last = if site == 5 { 1002 } else { (site + 25).min(1002) };
            *range = halves.smallest([site, last].map(|site| halves.leaf_of(site))) as u16;
        }
        halves.end_ranges(ranges).unwrap();
        let mut seen: Vec<usize> = Vec::new();
        for range in 1..halves.ranges() {
            let sites: Vec<usize> = halves.grains(range).sites().collect();
            assert!(sites.is_sorted() && sites.iter().all(|&site| halves.range_of(site) == range));
            seen.extend(sites);
        }
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..1003));
        let of = |range: usize| halves.grains(range).sites().collect::<Vec<_>>();
        assert_eq!(of(1), std::iter::once(5).chain(479..504).collect::<Vec<_>>());
        assert_eq!(of(2), (227..252).collect::<Vec<_>>());
        assert_eq!(of(8), (0..101).filter(|&site| site != 5).collect::<Vec<_>>());
    }
}
