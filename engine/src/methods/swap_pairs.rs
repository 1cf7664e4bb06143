//! Which grains a Monte Carlo swap move tries to swap: pairs of similar size (Berthier, Coslovich, Ninarello and
//! Ozawa 2016, DOI 10.1103/PhysRevLett.116.238002).
//!
//! Grains are ranked by size, from the largest down. The largest relative difference of sizes that is tried, the
//! window, is steered to a share of accepted swaps. Whether two grains can be swapped is up to the method.

use rand_xoshiro::Xoshiro256PlusPlus;

use crate::memory::{OutOfMemory, collected, copied, make_room, refill, reserved};
use crate::rng::uniform;

/// Share of accepted swaps that the window of sizes is steered to.
const ACCEPTED_AIM: f64 = 0.3;
const LEAST_WINDOW: f64 = 1e-7;
const MOST_WINDOW: f64 = 0.3;
/// Fewest tries by which the window is changed.
const FEWEST_TRIES: u64 = 20;

/// Sets of grains that swap positions among themselves only: those of one form, because a larger grain hardly
/// ever fits in the place of one of another form.
#[derive(Clone, Debug, Default)]
pub(crate) struct Families {
    /// The ranks, one family after the other, falling in size within each. Empty where there is one family.
    order: Vec<u32>,
    /// Where the family of each of these begins.
    first: Vec<u32>,
}

impl Families {
    /// The families of grains by rank.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn new<S>(shapes: &[S], are_similar: impl Fn(&S, &S) -> bool) -> Result<Self, OutOfMemory> {
        let mut examples: Vec<usize> = Vec::new();
        let mut family_of: Vec<u32> = reserved(shapes.len())?;
        for (rank, shape) in shapes.iter().enumerate() {
            let known = examples.iter().position(|&example| are_similar(&shapes[example], shape));
            family_of.push(known.unwrap_or(examples.len()) as u32);
            if known.is_none() {
                examples.push(rank);
            }
        }
        if examples.len() < 2 {
            return Ok(Self::default());
        }
        let mut order: Vec<u32> = collected(0..shapes.len() as u32)?;
        order.sort_by_key(|&rank| family_of[rank as usize]);
        let mut first: Vec<u32> = reserved(shapes.len())?;
        for (at, &rank) in order.iter().enumerate() {
            let is_next = at > 0 && family_of[order[at - 1] as usize] == family_of[rank as usize];
            first.push(if is_next { first[at - 1] } else { at as u32 });
        }
        Ok(Self { order, first })
    }

    /// The rank of a grain by its place in the order.
    #[inline]
    pub(crate) fn rank(&self, place: usize) -> usize {
        self.order.get(place).map_or(place, |&rank| rank as usize)
    }
}

/// The pairs of a packing. Grains are named by their places in the order of the families, which are their ranks where
/// there is one family.
#[derive(Clone, Debug)]
pub(crate) struct SwapPairs {
    /// Where each grain is.
    site: Vec<u32>,
    /// The first grain that each may change places with.
    limit: Vec<u32>,
    /// Largest relative difference of two sizes that is tried.
    pub(crate) window: f64,
    /// Swaps tried so far.
    pub(crate) tried: u64,
    /// Swaps made so far.
    pub(crate) accepted: u64,
}

/// Grains that swap positions among themselves.
#[derive(Clone, Debug, Default)]
pub(crate) struct SwapGroup {
    /// Their sites, in the order of their families and sizes.
    pub(crate) sites: Vec<u32>,
    /// Each family, and where it begins here.
    families: Vec<(u32, u32)>,
}

impl SwapPairs {
    pub(crate) fn new(window: f64) -> Self {
        Self { site: Vec::new(), limit: Vec::new(), window, tried: 0, accepted: 0 }
    }

    /// Pairs of other grains, of sizes as similar as those of these pairs.
    pub(crate) fn with_same_window(&self) -> Self {
        Self::new(self.window)
    }

    /// Takes notice of the rank of the grain at each site, and of the sizes by rank, falling, in any unit.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn prepare(
        &mut self,
        families: &Families,
        ranks: &[u32],
        sizes: &[f64],
    ) -> Result<(), OutOfMemory> {
        self.find_sites(families, ranks)?;
        let mut first = families.first.iter();
        self.set_limits(
            |place| sizes[families.rank(place)],
            |_| first.next().map_or(0, |&first| first as usize),
        )
    }

    /// Takes notice of the rank of the grain at each site.
    fn find_sites(&mut self, families: &Families, ranks: &[u32]) -> Result<(), OutOfMemory> {
        refill(&mut self.site, ranks.len(), 0)?;
        for (site, &rank) in ranks.iter().enumerate() {
            self.site[rank as usize] = site as u32;
        }
        if !families.order.is_empty() {
            let by_rank = copied(&self.site)?;
            for (site, &rank) in self.site.iter_mut().zip(&families.order) {
                *site = by_rank[rank as usize];
            }
        }
        Ok(())
    }

    /// Finds the first grain that each may change places with, from the sizes of the grains, which fall in each family,
    /// and the first grain of the family of each.
    fn set_limits(
        &mut self,
        size: impl Fn(usize) -> f64,
        mut family: impl FnMut(usize) -> usize,
    ) -> Result<(), OutOfMemory> {
        self.limit.clear();
        make_room(&mut self.limit, self.site.len())?;
        let mut largest = 0;
        for place in 0..self.site.len() {
            let most = size(place) * (1.0 + self.window);
            largest = largest.max(family(place));
            while size(largest) > most {
                largest += 1;
            }
            self.limit.push(largest as u32);
        }
        Ok(())
    }

    /// The sites of the grains of each of so many groups, in the order of their families and sizes.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn groups(
        &mut self,
        families: &Families,
        ranks: &[u32],
        groups: usize,
        group_of: impl Fn(usize) -> usize,
    ) -> Result<Vec<SwapGroup>, OutOfMemory> {
        self.find_sites(families, ranks)?;
        let mut of_groups: Vec<SwapGroup> = collected((0..groups).map(|_| SwapGroup::default()))?;
        for (place, &site) in self.site.iter().enumerate() {
            let group = &mut of_groups[group_of(site as usize)];
            let family = families.first.get(place).copied().unwrap_or(0);
            if group.families.last().is_none_or(|last| last.0 != family) {
                group.families.push((family, group.sites.len() as u32));
            }
            make_room(&mut group.sites, 1)?;
            group.sites.push(site);
        }
        Ok(of_groups)
    }

    /// Pairs among the grains of a group, of sizes as similar as those of these pairs.
    ///
    /// # Errors
    /// The system refused memory.
    pub(crate) fn among(&self, group: &SwapGroup, size: impl Fn(usize) -> f64) -> Result<Self, OutOfMemory> {
        let site = copied(&group.sites)?;
        let mut pairs = Self { site, ..self.with_same_window() };
        let mut families = group.families.iter().peekable();
        let mut first = 0;
        pairs.set_limits(
            |place| size(group.sites[place] as usize),
            |place| {
                if let Some(&(_, begins)) = families.next_if(|&&(_, begins)| begins as usize == place) {
                    first = begins as usize;
                }
                first
            },
        )?;
        Ok(pairs)
    }

    /// Draws two grains, the larger first; they may be the same.
    #[inline]
    pub(crate) fn draw(&self, rng: &mut Xoshiro256PlusPlus) -> [usize; 2] {
        let smaller = (uniform(rng) * self.limit.len() as f64) as usize;
        let largest = self.limit[smaller] as usize;
        [largest + (uniform(rng) * (smaller - largest) as f64) as usize, smaller]
    }

    /// Where a grain is.
    #[inline]
    pub(crate) fn site(&self, place: usize) -> usize {
        self.site[place] as usize
    }

    /// Takes notice that two grains were swapped.
    #[inline]
    pub(crate) fn swap(&mut self, [larger, smaller]: [usize; 2]) {
        self.site.swap(larger, smaller);
    }

    /// Gives the memory back until the next [`Self::prepare`].
    pub(crate) fn give_memory_back(&mut self) {
        (self.site, self.limit) = (Vec::new(), Vec::new());
    }

    /// Counts the swaps of a sweep, and steers the window.
    pub(crate) fn count(&mut self, tried: u64, accepted: u64) {
        self.tried += tried;
        self.accepted += accepted;
        if tried >= FEWEST_TRIES {
            let share = accepted as f64 / tried as f64;
            let factor = if share < ACCEPTED_AIM { 0.7 } else { 1.3 };
            self.window = (self.window * factor).clamp(LEAST_WINDOW, MOST_WINDOW);
        }
    }
}
