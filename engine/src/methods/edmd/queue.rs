//! The event queue: a calendar of bins in time, of which only the current one is sorted (Paul 2007, DOI
//! 10.1016/j.jcp.2006.06.042).
//!
//! Pushing and popping cost O(1) whatever the number of events. Entries are never removed: one that no longer matches
//! its grain's next event is dropped when it comes up. Ties in time are broken by the grain, so that the order of
//! events does not depend on the order of pushes.

use crate::cpu::prefetch;
use crate::memory::{OutOfMemory, make_room, probe};

/// Events per bin aimed at, and with so many grains that memory must be asked some events ahead.
const PER_BIN: f64 = 4.0;
const PER_BIN_AHEAD: f64 = 32.0;
/// Entries of the queue for each grain, those that are stale included.
const ENTRIES_PER_GRAIN: usize = 4;
/// Entries in a cache line.
const PER_LINE: usize = 64 / size_of::<Entry>();
/// Grains from which reading ahead pays: fewer stay in the cache.
pub(crate) const READ_AHEAD: usize = 8_000;

/// One scheduled event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Entry {
    pub(crate) time: f64,
    pub(crate) grain: u32,
}

/// The queue.
#[derive(Debug, Default)]
pub(crate) struct Queue {
    bins: Vec<Vec<Entry>>,
    /// Entries beyond the window.
    beyond: Vec<Entry>,
    /// The current bin, latest first.
    current: Vec<Entry>,
    cursor: usize,
    start: f64,
    width: f64,
    per_width: f64,
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
        // Bins keep their room from one cycle to the next. Entries come to them in small pieces: they are asked for as
        // one.
        let missing = bins.saturating_sub(self.bins.len());
        make_room(&mut self.bins, missing)?;
        probe(ENTRIES_PER_GRAIN.saturating_mul(size_of::<Entry>()).saturating_mul(grains))?;
        self.bins.resize_with(bins, Vec::new);
        self.bins.iter_mut().for_each(Vec::clear);
        self.beyond.clear();
        self.current.clear();
        self.cursor = 0;
        self.start = 0.0;
        self.set_width(per_bin, events_per_time);
        Ok(())
    }

    fn set_width(&mut self, per_bin: f64, events_per_time: f64) {
        self.width = if events_per_time > 0.0 { per_bin / events_per_time } else { 1.0 };
        self.width = self.width.clamp(1e-300, 1e300);
        self.per_width = 1.0 / self.width;
    }

    /// Schedules an event.
    #[inline(always)]
    pub(crate) fn push(&mut self, time: f64, grain: u32) {
        // Saturating, and 0 for times before the window.
        let bin = ((time - self.start) * self.per_width) as usize;
        if bin <= self.cursor {
            self.insert_current(Entry { time, grain });
        } else if bin < self.bins.len() {
            self.bins[bin].push(Entry { time, grain });
        } else {
            self.beyond.push(Entry { time, grain });
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

    /// The earliest entry that `is_next` still vouches for; `ask` hears of every grain that it will be
    /// asked about soon.
    #[inline(always)]
    pub(crate) fn pop(&mut self, is_next: impl Fn(&Entry) -> bool, ask: impl Fn(u32)) -> Option<Entry> {
        loop {
            while let Some(entry) = self.current.pop() {
                if is_next(&entry) {
                    return Some(entry);
                }
            }
            if !self.advance(&is_next, &ask) {
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
    fn advance(&mut self, is_next: &impl Fn(&Entry) -> bool, ask: &impl Fn(u32)) -> bool {
        loop {
            while self.cursor + 1 < self.bins.len() {
                self.cursor += 1;
                std::mem::swap(&mut self.current, &mut self.bins[self.cursor]);
                if let Some(soon) = self.bins.get(self.cursor + 1) {
                    for entry in soon {
                        ask(entry.grain);
                    }
                }
                if let Some(later) = self.bins.get(self.cursor + 2) {
                    for at in (0..later.len()).step_by(PER_LINE) {
                        prefetch(later, at);
                    }
                }
                self.current.retain(is_next);
                if !self.current.is_empty() {
                    sort_latest_first(&mut self.current);
                    return true;
                }
            }
            if !self.turn(is_next) {
                return false;
            }
            if !self.current.is_empty() {
                return true;
            }
        }
    }

    /// Moves the window on; says whether anything is left.
    fn turn(&mut self, is_next: &impl Fn(&Entry) -> bool) -> bool {
        self.beyond.retain(is_next);
        let Some(first) = self.beyond.iter().map(|e| e.time).reduce(f64::min) else { return false };
        // Where the next events lie far ahead the window jumps, and widens if it is far too narrow.
        let span = self.width * self.bins.len() as f64;
        self.start = first.max(self.start + span);
        let in_window = self.beyond.iter().filter(|e| e.time < self.start + span).count();
        if in_window * 16 < self.beyond.len() {
            self.width *= 4.0;
            self.per_width = 1.0 / self.width;
        }
        // Bin 0 is where the cursor stands, so entries of it go to the current bin.
        self.cursor = 0;
        for entry in std::mem::take(&mut self.beyond) {
            self.push(entry.time, entry.grain);
        }
        true
    }
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

    #[test]
    fn pops_in_order_of_time_then_grain() {
        let mut queue = Queue::default();
        assert_eq!(queue.reset(100, 10.0), Ok(()));
        let mut next = std::collections::HashMap::new();
        let mut x = 1_u64;
        for grain in 0..1000_u32 {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let time = (x >> 40) as f64 * 1e-3;
            queue.push(time, grain);
            next.insert(grain, time);
        }
        let mut seen = Vec::new();
        while let Some(entry) = queue.pop(|e| next.get(&e.grain) == Some(&e.time), |_| ()) {
            seen.push(entry);
            next.remove(&entry.grain);
            if entry.grain % 3 == 0 && seen.len() < 1500 {
                let time = entry.time + f64::from(entry.grain) * 0.01;
                queue.push(time, entry.grain + 3000);
                next.insert(entry.grain + 3000, time);
            }
        }
        assert!(next.is_empty());
        assert!(seen.len() > 1300);
        assert!(seen.windows(2).all(|w| before(&w[0], &w[1])));
    }
}
