//! Shortlists: of the many neighbours of a coarse grain, those that may reach it soon.
//!
//! Hundreds of fine grains stand in the list of a coarse one, and it collides more often than any of them; nearly all
//! are far from it in time. A coarse grain therefore lives in a small ball, its *margin*, until a *horizon* in time and
//! looks only at its shortlist: the neighbours that would touch it before the horizon if it were anywhere in the ball.
//! The shortlist is complete at all times. It is made from the whole list; a neighbour that gets another velocity, or
//! is new in the list, looks itself whether it belongs there; and it is rebuilt at the horizon, when the grain leaves
//! the ball, and when it gets a new NNL sphere.
//!
//! The horizon is the time by which a number of neighbours about the root of the length of the list would have arrived:
//! a longer horizon means longer shortlists, a shorter one more scans of the list.

use super::contact::rises_to_zero;
use super::records::Hot;
use crate::arrays;
use crate::memory::{OutOfMemory, make_room};

/// Neighbours from which a grain has a shortlist; with fewer, looking at all of them costs less than keeping one.
pub(crate) const LEAST_NEIGHBOURS: u32 = 80;
/// Most grains with shortlists: so many fit in a count of 16 bits.
pub(crate) const MOST_SHORTLISTS: usize = u16::MAX as usize;

/// What a coarse grain looks at.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shortlist {
    /// Centre of the ball and its radius, in mm; the radius is 0 before the first scan of a cycle.
    pub(crate) center: [f64; 3],
    pub(crate) margin: f64,
    /// Radius of the ball of the next scan.
    pub(crate) next_margin: f64,
    /// The horizon in s since the start of the cycle.
    pub(crate) until: f64,
    pub(crate) entries: Vec<u32>,
}

impl Shortlist {
    /// Forgets everything, as a cycle starts.
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        (self.margin, self.next_margin, self.until) = (0.0, 0.0, 0.0);
    }

    pub(crate) fn entries(&self) -> &[u32] {
        &self.entries
    }

    /// When it has to be rebuilt, for a grain that now moves like this.
    #[inline(always)]
    pub(crate) fn valid_until(&self, me: &Hot, now: f64) -> f64 {
        let d: [f64; 3] = arrays::from_fn(|k| me.position[k] - self.center[k]);
        let v = me.velocity;
        let c = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - self.margin * self.margin;
        let b = d[0] * v[0] + d[1] * v[1] + d[2] * v[2];
        let a = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        self.until.min(now + rises_to_zero(a, b, c))
    }

    /// Enters a neighbour unless it is there.
    #[inline(always)]
    pub(crate) fn enter(&mut self, entry: u32) -> Result<(), OutOfMemory> {
        if !self.contains(entry) {
            make_room(&mut self.entries, 1)?;
            self.entries.push(entry);
        }
        Ok(())
    }

    #[inline(always)]
    fn contains(&self, entry: u32) -> bool {
        // Without a way out: eight comparisons at once.
        self.entries.iter().fold(0, |found, &e| found | u32::from(e == entry)) != 0
    }

    /// Removes a neighbour if it is there.
    #[inline(always)]
    pub(crate) fn remove(&mut self, entry: u32) {
        if let Some(at) = self.entries.iter().position(|&e| e == entry) {
            self.entries.swap_remove(at);
        }
    }
}
