//! The event queue: a calendar of bins in time, of which only the current one is sorted (Paul 2007, DOI
//! 10.1016/j.jcp.2006.06.042).
//!
//! Pushing and popping cost O(1) whatever the number of events. A bin names grains only: the time of an event is that
//! of its grain's next one. Names are never removed: when a bin comes up, grains whose next event lies elsewhere by
//! then are dropped, and so are names that stand in it twice. Events beyond the last bin are not kept at all: when the
//! bins are used up, all grains are looked through. Ties in time are broken by the grain, so that the order of events
//! does not depend on the order of pushes.

use super::records::Next;
use crate::cpu::prefetch;
use crate::memory::OutOfMemory;
use crate::methods::bins::Bins;

/// Events per bin aimed at, and with so many grains that memory must be asked some events ahead.
const PER_BIN: f64 = 4.0;
const PER_BIN_AHEAD: f64 = 32.0;
/// Grains from which reading ahead pays: fewer stay in the cache.
pub(crate) const READ_AHEAD: usize = 8_000;
/// Grains of a block: with the number of another one, a cache line.
const PER_BLOCK: usize = 15;

/// One scheduled event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Entry {
    pub(crate) time: f64,
    pub(crate) grain: u32,
}

/// The queue.
#[derive(Debug, Default)]
pub(crate) struct Queue {
    /// Grains by the time of their next event.
    bins: Bins<u32, PER_BLOCK>,
    /// The current bin, latest first.
    current: Vec<Entry>,
    cursor: usize,
    start: f64,
    width: f64,
    per_width: f64,
    /// Memory that an event was refused; events are missing from then on.
    refused: Option<OutOfMemory>,
}

impl Queue {
    /// Empties the queue and sets it up from time 0 for so many grains that have about
    /// `events_per_time` events in all.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn reset(&mut self, grains: usize, events_per_time: f64) -> Result<(), OutOfMemory> {
        let per_bin = if grains < READ_AHEAD { PER_BIN } else { PER_BIN_AHEAD };
        let bins = ((grains as f64 / per_bin) as usize).next_power_of_two().clamp(64, 1 << 22);
        self.bins.reset(bins, bins + grains / PER_BLOCK)?;
        self.current.clear();
        self.cursor = 0;
        self.start = 0.0;
        self.set_width(per_bin, events_per_time);
        Ok(())
    }

    /// The memory that an event was refused, if one was: the run cannot go on.
    pub(crate) fn refused(&self) -> Option<OutOfMemory> {
        self.refused
    }

    fn set_width(&mut self, per_bin: f64, events_per_time: f64) {
        self.width = if events_per_time > 0.0 { per_bin / events_per_time } else { 1.0 };
        self.width = self.width.clamp(1e-300, 1e300);
        self.per_width = 1.0 / self.width;
    }

    /// Schedules the next event of a grain.
    #[inline(always)]
    pub(crate) fn push(&mut self, time: f64, grain: u32) {
        let bin = bin_of(time, self.start, self.per_width);
        if bin <= self.cursor {
            self.insert_current(Entry { time, grain });
        } else if bin < self.bins.len() {
            self.bins.push(bin, grain, &mut self.refused);
        }
    }

    #[inline]
    fn insert_current(&mut self, entry: Entry) {
        let mut at = self.current.len();
        while at > 0 && before(&self.current[at - 1], &entry) {
            at -= 1;
        }
        self.current.insert(at, entry);
    }

    /// The earliest of the next events of all grains, all of which were pushed.
    #[inline(always)]
    pub(crate) fn pop(&mut self, next: &[Next]) -> Option<Entry> {
        loop {
            while let Some(entry) = self.current.pop() {
                if next[entry.grain as usize].time == entry.time {
                    return Some(entry);
                }
            }
            if !self.advance(next) {
                return None;
            }
        }
    }

    /// The grain of the entry that comes up so many after the next one, if the current bin has it.
    #[inline(always)]
    pub(crate) fn ahead(&self, entries: usize) -> Option<usize> {
        let at = self.current.len().checked_sub(entries + 1)?;
        Some(self.current[at].grain as usize)
    }

    /// Loads the next bin that is not empty; says whether there was one.
    fn advance(&mut self, next: &[Next]) -> bool {
        loop {
            while self.cursor + 1 < self.bins.len() {
                self.cursor += 1;
                self.ask_ahead(next);
                self.load(next);
                if !self.current.is_empty() {
                    return true;
                }
            }
            if !self.turn(next) {
                return false;
            }
            if !self.current.is_empty() {
                return true;
            }
        }
    }

    /// Moves the grains of the bin at the cursor whose next event lies in it to the current bin.
    fn load(&mut self, next: &[Next]) {
        let Self { bins, current, cursor, start, per_width, .. } = self;
        bins.drain(*cursor, |grains| {
            for &grain in grains {
                let time = next[grain as usize].time;
                if bin_of(time, *start, *per_width) == *cursor {
                    current.push(Entry { time, grain });
                }
            }
        });
        sort_latest_first(&mut self.current);
        self.current.dedup();
    }

    /// Asks the memory for what the bins after that at the cursor need, each time one step further: their last blocks,
    /// those before them, then the next events of the grains.
    fn ask_ahead(&self, next: &[Next]) {
        self.bins.prefetch_last(self.cursor + 3);
        self.bins.ask_for_next_to_last(self.cursor + 2);
        self.bins.for_each(self.cursor + 1, |grain| prefetch(next, grain as usize));
    }

    /// Moves the window on; says whether anything is left.
    fn turn(&mut self, next: &[Next]) -> bool {
        let times = || next.iter().map(|next| next.time).filter(|time| time.is_finite());
        let Some(first) = times().reduce(f64::min) else { return false };
        // Where the next events lie far ahead the window jumps, and widens if it is far too narrow.
        let span = self.width * self.bins.len() as f64;
        self.start = first.max(self.start + span);
        let in_window = times().filter(|&time| time < self.start + span).count();
        if in_window * 16 < times().count() {
            self.width *= 4.0;
            self.per_width = 1.0 / self.width;
        }
        // Bin 0 is where the cursor stands, so that its events come to the current bin.
        self.cursor = 0;
        for (grain, next) in next.iter().enumerate() {
            if next.time.is_finite() {
                self.push(next.time, grain as u32);
            }
        }
        true
    }
}

/// The bin of a time: 0 before the window, and none that there is beyond it.
#[inline(always)]
fn bin_of(time: f64, start: f64, per_width: f64) -> usize {
    ((time - start) * per_width) as usize
}

/// Whether `a` comes before `b`.
#[inline(always)]
fn before(a: &Entry, b: &Entry) -> bool {
    a.time < b.time || (a.time == b.time && a.grain < b.grain)
}

#[inline]
fn sort_latest_first(entries: &mut [Entry]) {
    if entries.len() > 1 {
        entries.sort_unstable_by(|a, b| b.time.total_cmp(&a.time).then(b.grain.cmp(&a.grain)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grains without a next event.
    fn none(grains: usize) -> Vec<Next> {
        vec![Next { time: f64::INFINITY, with: 0 }; grains]
    }

    #[test]
    fn pops_in_order_of_time_then_grain() {
        let mut queue = Queue::default();
        assert_eq!(queue.reset(100, 10.0), Ok(()));
        let mut next = none(4000);
        let mut x = 1_u64;
        for grain in 0..1000_u32 {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let time = (x >> 40) as f64 * 1e-3;
            next[grain as usize].time = time;
            queue.push(time, grain);
        }
        let mut seen = Vec::new();
        while let Some(entry) = queue.pop(&next) {
            seen.push(entry);
            next[entry.grain as usize].time = f64::INFINITY;
            if entry.grain % 3 == 0 && entry.grain < 1000 {
                let time = entry.time + f64::from(entry.grain) * 0.01;
                next[entry.grain as usize + 3000].time = time;
                queue.push(time, entry.grain + 3000);
            }
        }
        assert_eq!(seen.len(), 1334);
        assert!(seen.windows(2).all(|w| before(&w[0], &w[1])));
    }

    #[test]
    fn blocks_are_used_again() {
        let mut queue = Queue::default();
        assert_eq!(queue.reset(1000, 100.0), Ok(()));
        let mut next = none(1000);
        let mut most = 0;
        for turn in 0..20_000_u32 {
            // Every grain changes its mind as often as it has events.
            for grain in [turn % 1000, turn * 7 % 1000] {
                let time = f64::from(turn) * 0.01 + 10.0 + f64::from(grain % 13);
                next[grain as usize].time = time;
                queue.push(time, grain);
            }
            if let Some(entry) = queue.pop(&next).filter(|_| turn > 1000) {
                next[entry.grain as usize].time = f64::INFINITY;
            }
            if turn == 5000 {
                most = queue.bins.blocks();
            }
        }
        assert!(most > 0 && queue.bins.blocks() < 2 * most, "{most} {}", queue.bins.blocks());
    }
}
