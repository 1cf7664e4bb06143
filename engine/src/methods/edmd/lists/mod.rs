//! Near-neighbour lists: all of them at the start of a cycle, single ones as grains leave their NNL spheres.

mod all;

use super::system::{GRAIN_BITS, GRAIN_MASK, System, mirror, unpack};
use crate::arrays;
use crate::cpu::{InstructionSet, prefetch};
use crate::memory::make_room;

/// Free places of a new list.
const SPARE: u32 = 3;

impl System {
    /// Whether two grains must know of each other, the second in some image.
    #[inline(always)]
    pub(super) fn are_neighbours<const PERIODIC: bool>(&self, i: usize, j: usize, image: u32) -> bool {
        let (a, b) = (&self.cold[i], &self.cold[j]);
        let smaller = (a.cutoff - a.skin).min(b.cutoff - b.skin);
        let range = a.cutoff + b.cutoff + self.growth.kappa * smaller;
        let mut d: [f64; 3] = arrays::from_fn(|k| b.center[k] - a.center[k]);
        if PERIODIC {
            let shift = &self.shifts[image as usize];
            d = arrays::from_fn(|k| d[k] + shift[k]);
        }
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2] < range * range
    }

    #[inline(always)]
    fn append(&mut self, grain: usize, entry: u32) {
        let is_coarse = self.cold[(entry & GRAIN_MASK) as usize].is_coarse;
        let cold = &mut self.cold[grain];
        if cold.len == cold.capacity {
            // A new place at the end of the slab; the old one stays empty until the next cycle.
            let (from, len) = (cold.offset as usize, cold.len as usize);
            let capacity = 2 * cold.capacity + SPARE;
            if let Err(refused) = make_room(&mut self.slab, capacity as usize) {
                self.refuse(refused);
                return;
            }
            cold.offset = self.slab.len() as u32;
            cold.capacity = capacity;
            let capacity = cold.capacity as usize;
            self.slab.extend_from_within(from..from + len);
            self.slab.resize(cold.offset as usize + capacity, 0);
        }
        let at = (cold.offset + cold.len) as usize;
        cold.len += 1;
        if is_coarse {
            let first = cold.offset as usize + usize::from(cold.coarse_neighbours);
            cold.coarse_neighbours += 1;
            self.slab[at] = self.slab[first];
            self.slab[first] = entry;
        } else {
            self.slab[at] = entry;
        }
    }

    #[inline(always)]
    fn take_out(&mut self, grain: usize, entry: u32) {
        let cold = &mut self.cold[grain];
        let list = &mut self.slab[cold.offset as usize..(cold.offset + cold.len) as usize];
        let Some(at) = position(list, entry) else { return };
        let last = list.len() - 1;
        cold.len -= 1;
        let coarse = usize::from(cold.coarse_neighbours);
        if at < coarse {
            // The last of the coarse ones comes to its place, and the last of all to that.
            list[at] = list[coarse - 1];
            list[coarse - 1] = list[last];
            cold.coarse_neighbours -= 1;
        } else {
            list[at] = list[last];
        }
        if cold.is_coarse {
            self.shortlists[self.shortlist_of[grain] as usize].remove(entry);
        }
    }

    /// Gives a grain whose record stands at the present a new NNL sphere and new
    /// neighbours.
    #[inline(never)]
    pub(crate) fn rebuild_list<S: InstructionSet, const PERIODIC: bool>(&mut self, set: S, i: usize) {
        set.call(
            #[inline(always)]
            || self.rebuild_list_inlined::<PERIODIC>(i),
        );
    }

    #[inline(always)]
    fn rebuild_list_inlined<const PERIODIC: bool>(&mut self, i: usize) {
        self.counts.list_rebuilds += 1;
        let (offset, len) = (self.cold[i].offset as usize, self.cold[i].len as usize);
        // Far apart in memory: asked for all at once, not one after the other.
        for k in offset..offset + len {
            prefetch(&self.cold, unpack(self.slab[k]).0);
        }
        for k in offset..offset + len {
            self.prefetch_list(unpack(self.slab[k]).0);
        }
        for k in offset..offset + len {
            let entry = self.slab[k];
            self.take_out((entry & GRAIN_MASK) as usize, mirror(entry, i));
        }
        (self.cold[i].len, self.cold[i].coarse_neighbours) = (0, 0);
        self.grid.remove(i as u32, self.cold[i].cell);
        if PERIODIC {
            self.hot[i].position = self.container.wrap(self.hot[i].position);
        }
        self.cold[i].rebuilds = self.cold[i].rebuilds.saturating_add(1);
        if self.cold[i].rebuilds > 2 {
            self.cold[i].adapt_skin();
        }
        let most = self.grid.top_mm() - self.last_radius(i);
        self.cold[i].skin = self.cold[i].skin.min(most);
        self.center_sphere(i);
        let cutoff = self.cold[i].cutoff;
        let center = self.cold[i].center;
        self.cold[i].cell = self.grid.insert(i as u32, center, cutoff);
        let mut found = std::mem::take(&mut self.found);
        found.clear();
        self.grid.visit::<PERIODIC>(
            center,
            cutoff,
            self.growth.kappa,
            self.grid.all(),
            #[inline(always)]
            |j, image| {
                prefetch(&self.cold, j as usize);
                found.push(j | image << GRAIN_BITS);
            },
        );
        // By hand, for `retain` would not be compiled for the instruction set.
        let mut kept = 0;
        for at in 0..found.len() {
            let (j, image) = unpack(found[at]);
            if j != i && self.are_neighbours::<PERIODIC>(i, j, image as u32) {
                found[kept] = found[at];
                kept += 1;
            }
        }
        found.truncate(kept);
        for &entry in &found {
            self.prefetch_list(unpack(entry).0);
        }
        for &entry in &found {
            self.append(i, entry);
            self.append((entry & GRAIN_MASK) as usize, mirror(entry, i));
        }
        self.found = found;
    }
}

/// Where an entry stands in a list: sixteen comparisons at once.
#[inline(always)]
fn position(list: &[u32], entry: u32) -> Option<usize> {
    let mut from = 0;
    for chunk in list.chunks_exact(16) {
        if chunk.iter().fold(0, |found, &e| found | u32::from(e == entry)) != 0 {
            break;
        }
        from += 16;
    }
    list[from..].iter().position(|&e| e == entry).map(|at| from + at)
}
