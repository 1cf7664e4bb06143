//! How voxels are kept: in 4 bytes each where the level and the number of cells allow, in 8 to level 10, and with the
//! part that they wait for in 16.
//!
//! A run that is nearly saturated has tens of millions of them, most of levels 1 to 3.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::memory::{OutOfMemory, make_room, push};
use crate::methods::bins::Bins;

/// Deepest level whose voxels are kept in 64 bits.
const MAX_SHORT_LEVEL: usize = 10;
/// Deferred voxels of a block, which takes 1 KiB with the number of another one: half a block is wasted in every bin.
const PER_BLOCK: usize = 63;

/// A voxel of some level: its cell, and its place in the cell in units of its own edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Voxel {
    pub(super) cell: u32,
    pub(super) at: [u32; 3],
}

impl Voxel {
    /// Its place with as many bits along each axis as its level has, which is at most [`MAX_SHORT_LEVEL`].
    #[inline(always)]
    fn place(self, level: usize) -> u32 {
        let [x, y, z] = self.at;
        (x << level | y) << level | z
    }

    /// The voxel at such a place. Bits above it are of no account.
    #[inline(always)]
    fn new(cell: u32, place: u32, level: usize) -> Self {
        let mask = (1_u32 << level) - 1;
        Self { cell, at: [place >> (2 * level) & mask, place >> level & mask, place & mask] }
    }
}

/// A voxel of a level to [`MAX_SHORT_LEVEL`]: its cell, then a one, then its place with as many bits along each axis as
/// the level has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Short(u64);

impl Short {
    #[inline(always)]
    fn new(voxel: Voxel, level: usize) -> Self {
        Self(u64::from(voxel.cell) << 32 | 1 << (3 * level) | u64::from(voxel.place(level)))
    }

    #[inline(always)]
    fn voxel(self, level: usize) -> Voxel {
        Voxel::new((self.0 >> 32) as u32, self.place(), level)
    }

    /// The one and the place behind it.
    #[inline(always)]
    fn place(self) -> u32 {
        self.0 as u32
    }

    #[inline(always)]
    fn level(self) -> usize {
        (self.place().max(1).ilog2() / 3) as usize
    }

    /// What sorts voxels by level, cell and place.
    fn key(self) -> (usize, u64) {
        (self.level(), self.0)
    }
}

/// The voxels of a level.
#[derive(Debug)]
pub(super) enum Level {
    /// The cell, and behind it the place.
    Narrow(Vec<u32>),
    Short(Vec<Short>),
    Long(Vec<Voxel>),
}

impl Level {
    /// The level of `cells` cells, without a voxel.
    pub(super) fn new(level: usize, cells: usize) -> Self {
        if level > MAX_SHORT_LEVEL {
            Self::Long(Vec::new())
        } else if (cells as u64) << (3 * level) <= 1 << 32 {
            Self::Narrow(Vec::new())
        } else {
            Self::Short(Vec::new())
        }
    }

    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Narrow(voxels) => voxels.len(),
            Self::Short(voxels) => voxels.len(),
            Self::Long(voxels) => voxels.len(),
        }
    }

    /// A voxel of this level, if there is one at an index.
    #[inline(always)]
    pub(super) fn get(&self, index: usize, level: usize) -> Option<Voxel> {
        match self {
            Self::Narrow(voxels) => {
                voxels.get(index).map(|&narrow| Voxel::new(narrow >> (3 * level), narrow, level))
            }
            Self::Short(voxels) => voxels.get(index).map(|short| short.voxel(level)),
            Self::Long(voxels) => voxels.get(index).copied(),
        }
    }

    /// Appends a voxel of this level. Where the system refuses memory, it is left out and the refusal is noted.
    #[inline(always)]
    pub(super) fn push(&mut self, voxel: Voxel, level: usize, refused: &mut Option<OutOfMemory>) {
        match self {
            Self::Narrow(voxels) => push(voxels, voxel.cell << (3 * level) | voxel.place(level), refused),
            Self::Short(voxels) => push(voxels, Short::new(voxel, level), refused),
            Self::Long(voxels) => push(voxels, voxel, refused),
        }
    }

    /// The cells that are named, of which there are so many at most, in the memory of a level.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn of_cells(
        memory: Option<Self>,
        cells: impl Iterator<Item = usize>,
        most: usize,
    ) -> Result<Self, OutOfMemory> {
        let mut voxels = match memory {
            Some(Self::Narrow(voxels)) => voxels,
            _ => Vec::new(),
        };
        voxels.clear();
        make_room(&mut voxels, most)?;
        voxels.extend(cells.map(|cell| cell as u32));
        Ok(Self::Narrow(voxels))
    }

    /// Takes out a voxel, the last one taking its place.
    #[inline(always)]
    pub(super) fn swap_remove(&mut self, index: usize) {
        match self {
            Self::Narrow(voxels) => {
                voxels.swap_remove(index);
            }
            Self::Short(voxels) => {
                voxels.swap_remove(index);
            }
            Self::Long(voxels) => {
                voxels.swap_remove(index);
            }
        }
    }
}

/// A voxel that some sphere or wall holds for all grains whose part is above `covered_above`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Deferred {
    pub(super) covered_above: f64,
    pub(super) level: usize,
    pub(super) voxel: Voxel,
}

#[derive(Clone, Copy, Debug, Default)]
struct DeferredShort {
    covered_above: f64,
    voxel: Short,
}

impl Ord for DeferredShort {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_part = self.covered_above.total_cmp(&other.covered_above);
        by_part.then_with(|| self.voxel.key().cmp(&other.voxel.key()))
    }
}

#[derive(Clone, Copy, Debug)]
struct DeferredLong {
    covered_above: f64,
    level: u16,
    bin: u16,
    voxel: Voxel,
}

impl Ord for DeferredLong {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_part = self.covered_above.total_cmp(&other.covered_above);
        by_part.then_with(|| (self.level, self.voxel).cmp(&(other.level, other.voxel)))
    }
}

macro_rules! ordered {
    ($($name:ty),*) => {$(
        impl PartialEq for $name {
            fn eq(&self, other: &Self) -> bool {
                self.cmp(other) == Ordering::Equal
            }
        }

        impl Eq for $name {}

        impl PartialOrd for $name {
            fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
                Some(self.cmp(other))
            }
        }
    )*};
}
ordered!(DeferredShort, DeferredLong);

/// Deferred voxels by bin: a bin is opened after all before it, and its voxels then come out from the largest part
/// down.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    /// Voxels of bins that are not open yet.
    bins: Bins<DeferredShort, PER_BLOCK>,
    /// Bins before this one are open.
    open: usize,
    /// Voxels of open bins.
    due: BinaryHeap<DeferredShort>,
    /// Voxels of levels beyond [`MAX_SHORT_LEVEL`], of all bins.
    long: BinaryHeap<DeferredLong>,
    /// Memory that a voxel was refused.
    refused: Option<OutOfMemory>,
}

impl Waiting {
    /// Empties it, for a new number of bins.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(super) fn reset(&mut self, bins: usize) -> Result<(), OutOfMemory> {
        self.bins.reset(bins, 0)?;
        self.open = 0;
        self.due.clear();
        self.long.clear();
        Ok(())
    }

    /// The memory that a voxel was refused, if one was: voxels are missing since then.
    pub(super) fn refused(&self) -> Option<OutOfMemory> {
        self.refused
    }

    /// Defers a voxel to a bin.
    #[inline(always)]
    pub(super) fn add(&mut self, Deferred { covered_above, level, voxel }: Deferred, bin: usize) {
        if level > MAX_SHORT_LEVEL {
            if make_room_in(&mut self.long, 1, &mut self.refused) {
                self.long.push(DeferredLong { covered_above, level: level as u16, bin: bin as u16, voxel });
            }
            return;
        }
        let deferred = DeferredShort { covered_above, voxel: Short::new(voxel, level) };
        if bin < self.open {
            if make_room_in(&mut self.due, 1, &mut self.refused) {
                self.due.push(deferred);
            }
            return;
        }
        self.bins.push(bin, deferred, &mut self.refused);
    }

    /// Opens the bins to this one.
    pub(super) fn open_to(&mut self, bin: usize) {
        let Self { bins, open, due, refused, .. } = self;
        while *open <= bin {
            bins.drain(*open, |voxels| {
                if make_room_in(due, voxels.len(), refused) {
                    due.extend(voxels);
                }
            });
            *open += 1;
        }
    }

    /// Takes out the voxel of an open bin with the largest part, if that is at least `threshold_mm`; of several with
    /// one part, that of the deepest level, the last cell and the last place.
    pub(super) fn pop(&mut self, threshold_mm: f64) -> Option<Deferred> {
        let short = self.due.peek().filter(|due| due.covered_above >= threshold_mm);
        let long = self.long.peek().filter(|due| usize::from(due.bin) < self.open);
        let long = long.filter(|due| due.covered_above >= threshold_mm);
        let of_short = short.map_or(f64::NEG_INFINITY, |due| due.covered_above);
        if long.is_some_and(|long| long.covered_above.total_cmp(&of_short).is_ge()) {
            let DeferredLong { covered_above, level, voxel, .. } = self.long.pop()?;
            return Some(Deferred { covered_above, level: usize::from(level), voxel });
        }
        short?;
        let DeferredShort { covered_above, voxel } = self.due.pop()?;
        let level = voxel.level();
        Some(Deferred { covered_above, level, voxel: voxel.voxel(level) })
    }
}

/// Makes room for `more` further elements of a heap; says whether there is, or else notes the refusal.
#[inline]
fn make_room_in<T: Ord>(heap: &mut BinaryHeap<T>, more: usize, refused: &mut Option<OutOfMemory>) -> bool {
    let reserved_ok = heap.try_reserve(more).is_ok();
    if !reserved_ok {
        let bytes = (heap.len() + more) * size_of::<T>();
        *refused = Some(OutOfMemory { bytes: bytes as u64 });
    }
    reserved_ok
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;

    fn voxel(level: usize, cells: u32) -> impl Strategy<Value = Voxel> {
        let at = 0..1_u32 << level;
        (0..cells, [at.clone(), at.clone(), at]).prop_map(|(cell, at)| Voxel { cell, at })
    }

    /// A level, a number of cells, and voxels of both.
    fn level() -> impl Strategy<Value = (usize, u32, Vec<Voxel>)> {
        (0..=30_usize, prop_oneof![Just(1_u32), Just(4_100_000), Just(u32::MAX)]).prop_flat_map(
            |(level, cells)| {
                let voxels = prop::collection::vec(voxel(level, cells), 1..20);
                voxels.prop_map(move |voxels| (level, cells, voxels))
            },
        )
    }

    #[test]
    fn voxels_of_large_runs_are_narrow_to_level_3() {
        let widths = [0, 3, 4, 10, 11].map(|level| match Level::new(level, 4_100_000) {
            Level::Narrow(_) => 4,
            Level::Short(_) => 8,
            Level::Long(_) => 16,
        });
        assert_eq!(widths, [4, 4, 8, 8, 16]);
        assert!(matches!(Level::new(0, u32::MAX as usize), Level::Narrow(_)));
        assert_eq!(size_of::<DeferredShort>(), 16);
    }

    /// Deferred voxels with the bins that they are given to; parts fall with the bins.
    fn deferred() -> impl Strategy<Value = (Deferred, usize)> {
        let of_level = |level| (Just(level), voxel(level, 50), 0..6_usize, 0..3_u32);
        (0..14_usize).prop_flat_map(of_level).prop_map(|(level, voxel, bin, part)| {
            let covered_above = 10.0 - bin as f64 + f64::from(part) / 4.0;
            (Deferred { covered_above, level, voxel }, bin)
        })
    }

    properties! {
        #[test]
        fn voxels_come_out_of_a_level_as_they_were_entered((level, cells, voxels) in level()) {
            let mut entered = Level::new(level, cells as usize);
            let mut refused = None;
            for &voxel in &voxels {
                entered.push(voxel, level, &mut refused);
            }
            prop_assert_eq!(refused, None);
            prop_assert_eq!(entered.len(), voxels.len());
            for (index, &voxel) in voxels.iter().enumerate() {
                prop_assert_eq!(entered.get(index, level), Some(voxel));
            }
            prop_assert_eq!(entered.get(voxels.len(), level), None);
            entered.swap_remove(0);
            prop_assert_eq!(entered.get(0, level), voxels[1..].last().copied());
        }

        /// Against the plainest model: a list that is sorted.
        #[test]
        fn deferred_voxels_come_out_in_order(
            batches in prop::collection::vec(prop::collection::vec(deferred(), 0..300), 1..6),
        ) {
            let mut waiting = Waiting::default();
            // A second time in the same memory.
            for _ in 0..2 {
                prop_assert_eq!(waiting.reset(6), Ok(()));
                let mut model: Vec<(Deferred, usize)> = Vec::new();
                for (open, batch) in batches.iter().enumerate() {
                    for &(deferred, bin) in batch {
                        waiting.add(deferred, bin);
                        model.push((deferred, bin));
                    }
                    waiting.open_to(open);
                    let threshold = 10.1 - open as f64;
                    let is_due = |&(deferred, bin): &(Deferred, usize)| {
                        bin <= open && deferred.covered_above >= threshold
                    };
                    let mut due: Vec<Deferred> = model.iter().filter(|row| is_due(row)).map(|row| row.0).collect();
                    model.retain(|row| !is_due(row));
                    due.sort_by(|a, b| {
                        let by_part = b.covered_above.total_cmp(&a.covered_above);
                        by_part.then_with(|| (b.level, b.voxel).cmp(&(a.level, a.voxel)))
                    });
                    let popped: Vec<Deferred> = std::iter::from_fn(|| waiting.pop(threshold)).collect();
                    prop_assert_eq!(popped, due);
                }
                prop_assert_eq!(waiting.refused(), None);
            }
        }
    }
}
