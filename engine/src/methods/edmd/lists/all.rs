//! The lists of all grains, as a cycle starts.
//!
//! Threads share the search, in pieces of consecutive grains, and then the lists, each of which gets its entries in the
//! order of the pairs. Nothing depends on the number of threads.

use std::num::NonZeroUsize;

use super::SPARE;
use crate::memory::{OutOfMemory, collected, filled, make_room, refill, reserved};
use crate::methods::edmd::records::Cold;
use crate::methods::edmd::shortlist::{LEAST_NEIGHBOURS, MOST_SHORTLISTS, Shortlist};
use crate::methods::edmd::system::{GRAIN_BITS, GRAIN_MASK, System, mirror};
use crate::threads::share;

/// Grains of a piece of the search.
const GRAINS_PER_PIECE: usize = 16_384;
/// Grains from which threads share the work.
const LEAST_SHARED: usize = 20_000;
/// Grains between two reservations of room for pairs while lists are built, and the pairs of a grain that room is
/// reserved for: on average there are fewer than twenty.
const GRAINS_PER_RESERVATION: usize = 256;
const HALF_PER_GRAIN: usize = 64;

/// The pairs that some consecutive grains found.
#[derive(Debug)]
struct Pairs {
    first: usize,
    grains: usize,
    /// The other grains, as list entries, and where those of each grain end.
    entries: Vec<u32>,
    ends: Vec<u32>,
    refused: Option<OutOfMemory>,
}

impl Pairs {
    /// Calls `visit` with both grains of every pair, the second as a list entry of the first.
    #[inline(always)]
    fn for_each(&self, mut visit: impl FnMut(usize, u32)) {
        let mut from = 0;
        for (i, &end) in (self.first..).zip(&self.ends) {
            for &entry in &self.entries[from..end as usize] {
                visit(i, entry);
            }
            from = end as usize;
        }
    }
}

/// Consecutive grains whose lists one thread fills.
struct Lists<'a> {
    first: usize,
    cold: &'a mut [Cold],
    slab: &'a mut [u32],
    /// Where the slab of these grains begins in that of all.
    offset: u32,
}

impl Lists<'_> {
    /// Enters a neighbour in the list of a grain, if that is one of these.
    #[inline(always)]
    fn append(&mut self, grain: usize, entry: u32, is_coarse: &[bool]) {
        let Some(cold) = self.cold.get_mut(grain.wrapping_sub(self.first)) else { return };
        let start = (cold.offset - self.offset) as usize;
        let at = start + cold.len as usize;
        cold.len += 1;
        // Coarse neighbours come first.
        if is_coarse.get((entry & GRAIN_MASK) as usize).is_some_and(|&is_coarse| is_coarse) {
            let first = start + usize::from(cold.coarse_neighbours);
            cold.coarse_neighbours += 1;
            self.slab[at] = self.slab[first];
            self.slab[first] = entry;
        } else {
            self.slab[at] = entry;
        }
    }
}

impl System {
    /// Threads for the work on all grains.
    pub(in crate::methods::edmd) fn threads_for_all(&self) -> NonZeroUsize {
        if self.len() < LEAST_SHARED { NonZeroUsize::MIN } else { self.threads }
    }

    /// Makes the lists of all grains, whose spheres are in the grid.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(in crate::methods::edmd) fn fill_lists(&mut self) -> Result<(), OutOfMemory> {
        let found = self.find_pairs()?;
        let places = self.lay_out_lists(&self.count_neighbours(&found)?);
        self.lay_out_shortlists()?;
        refill(&mut self.slab, places, 0)?;
        self.slab_at_start = places;
        self.enter_neighbours(&found)
    }

    fn find_pairs(&self) -> Result<Vec<Pairs>, OutOfMemory> {
        let n = self.len();
        let piece = |number: usize| {
            let first = number * GRAINS_PER_PIECE;
            let grains = GRAINS_PER_PIECE.min(n - first);
            Pairs { first, grains, entries: Vec::new(), ends: Vec::new(), refused: None }
        };
        let mut pieces = collected((0..n.div_ceil(GRAINS_PER_PIECE)).map(piece))?;
        share(self.threads_for_all(), &mut pieces, |_, piece| {
            // Called as a closure that is inlined: what it inlines is compiled for the instruction set.
            let found = if self.container.is_periodic() {
                self.cpu.call(
                    #[inline(always)]
                    || self.find_pairs_of::<true>(piece),
                )
            } else {
                self.cpu.call(
                    #[inline(always)]
                    || self.find_pairs_of::<false>(piece),
                )
            };
            piece.refused = found.err();
        });
        pieces.iter().try_for_each(|piece| piece.refused.map_or(Ok(()), Err))?;
        Ok(pieces)
    }

    /// Finds every pair once, at the coarser of the two or the later in memory: a fine grain would search many levels
    /// whose cells are nearly empty.
    #[inline(always)]
    fn find_pairs_of<const PERIODIC: bool>(&self, pairs: &mut Pairs) -> Result<(), OutOfMemory> {
        // The entries come last, so that they can grow where they are.
        pairs.ends = reserved(pairs.grains)?;
        pairs.entries = reserved(pairs.grains * 8)?;
        let half = &mut pairs.entries;
        for i in pairs.first..pairs.first + pairs.grains {
            if (i - pairs.first).is_multiple_of(GRAINS_PER_RESERVATION) {
                make_room(half, HALF_PER_GRAIN * GRAINS_PER_RESERVATION.min(pairs.grains))?;
            }
            let cutoff = self.cold[i].cutoff;
            let center = self.cold[i].center;
            let least_of_level = self.grid.least_of_level(cutoff);
            self.grid.visit::<PERIODIC>(
                center,
                cutoff,
                self.growth.kappa,
                self.grid.finer(cutoff),
                #[inline(always)]
                |j, image| {
                    let j_index = j as usize;
                    if j_index == i {
                        return;
                    }
                    if j_index > i && self.cold[j_index].cutoff > least_of_level {
                        return;
                    }
                    if self.are_neighbours::<PERIODIC>(i, j_index, image) {
                        half.push(j | image << GRAIN_BITS);
                    }
                },
            );
            pairs.ends.push(half.len() as u32);
        }
        // Of many pieces, what they have to spare is much.
        half.shrink_to_fit();
        Ok(())
    }

    /// The number of neighbours of each grain.
    fn count_neighbours(&self, found: &[Pairs]) -> Result<Vec<u32>, OutOfMemory> {
        let mut degrees = filled(self.len(), 0_u32)?;
        let threads = self.threads_for_all();
        let per_thread = self.len().div_ceil(threads.get()).max(1);
        let mut pieces = collected(degrees.chunks_mut(per_thread))?;
        share(threads, &mut pieces, |number, degrees| {
            let first = number * per_thread;
            let mut count = |grain: usize| {
                if let Some(degree) = degrees.get_mut(grain.wrapping_sub(first)) {
                    *degree += 1;
                }
            };
            for pairs in found {
                pairs.for_each(|i, entry| {
                    count(i);
                    count((entry & GRAIN_MASK) as usize);
                });
            }
        });
        Ok(degrees)
    }

    /// Gives every grain an empty list with room for its neighbours; returns the places of all lists.
    fn lay_out_lists(&mut self, degrees: &[u32]) -> usize {
        let mut offset = 0;
        for (i, (cold, &degree)) in self.cold.iter_mut().zip(degrees).enumerate() {
            cold.offset = offset;
            (cold.len, cold.coarse_neighbours) = (0, 0);
            cold.is_coarse = degree >= LEAST_NEIGHBOURS && i < self.moving;
            cold.capacity = degree + SPARE;
            offset += cold.capacity;
        }
        offset as usize
    }

    /// Gives every coarse grain an empty shortlist, to the limit of their number.
    fn lay_out_shortlists(&mut self) -> Result<(), OutOfMemory> {
        let coarse = self.cold.iter().filter(|cold| cold.is_coarse).count();
        if coarse > 0 {
            let n = self.len();
            refill(&mut self.shortlist_of, n, 0)?;
        }
        let mut given = 0;
        for (cold, own) in self.cold.iter_mut().zip(&mut self.shortlist_of) {
            cold.is_coarse &= given < MOST_SHORTLISTS;
            if cold.is_coarse {
                *own = given as u32;
                given += 1;
            }
        }
        let missing = given.saturating_sub(self.shortlists.len());
        make_room(&mut self.shortlists, missing)?;
        self.shortlists.resize_with(given.max(self.shortlists.len()), Shortlist::default);
        self.shortlists.iter_mut().for_each(Shortlist::clear);
        Ok(())
    }

    fn enter_neighbours(&mut self, found: &[Pairs]) -> Result<(), OutOfMemory> {
        let is_coarse = if self.cold.iter().any(|cold| cold.is_coarse) {
            collected(self.cold.iter().map(|cold| cold.is_coarse))?
        } else {
            Vec::new()
        };
        let threads = self.threads_for_all();
        let per_thread = self.len().div_ceil(threads.get()).max(1);
        let mut pieces: Vec<Lists<'_>> = reserved(threads.get())?;
        let (mut slab, mut first, mut offset) = (&mut self.slab[..], 0, 0);
        for cold in self.cold.chunks_mut(per_thread) {
            let grains = cold.len();
            let places: u32 = cold.iter().map(|cold| cold.capacity).sum();
            let (own, others) = slab.split_at_mut(places as usize);
            pieces.push(Lists { first, cold, slab: own, offset });
            (slab, first, offset) = (others, first + grains, offset + places);
        }
        share(threads, &mut pieces, |_, lists| {
            for pairs in found {
                pairs.for_each(|i, entry| {
                    lists.append(i, entry, &is_coarse);
                    lists.append((entry & GRAIN_MASK) as usize, mirror(entry, i), &is_coarse);
                });
            }
        });
        Ok(())
    }
}
