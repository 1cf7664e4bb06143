//! How the shortlists of coarse grains are made, and how their neighbours enter themselves.

use super::contact::falls_to_zero;
use super::records::Hot;
use super::shortlist::Shortlist;
use super::system::{System, mirror, unpack};
use crate::arrays;
use crate::cpu::InstructionSet;
use crate::memory::{OutOfMemory, make_room};

/// Neighbours that a shortlist starts with: so many, and this share of the root of the number of neighbours.
const FEWEST: usize = 4;
const SHARE_OF_ROOT: f64 = 1.0;
/// Radius of the ball in the ways that the grain makes until the horizon.
const WAYS: f64 = 2.0;
/// The ball of a grain that hardly moves has at least this share of its contact radius, far more than rounding.
const LEAST_MARGIN: f64 = 1e-9;
/// And at most this.
const MOST_MARGIN: f64 = 0.5;

impl System {
    /// Makes the shortlist of a grain, which has one, at a time.
    #[inline(never)]
    pub(crate) fn scan<S: InstructionSet, const PERIODIC: bool>(&mut self, set: S, i: usize, now: f64) {
        let own = self.hot[i];
        let me = Hot { position: own.position_at(now), time: f64::INFINITY, ..own };
        let mut shortlist = std::mem::take(&mut self.shortlists[self.shortlist_of[i] as usize]);
        let mut arrivals = std::mem::take(&mut self.arrivals);
        let made = set.call(
            #[inline(always)]
            || self.fill_shortlist::<S, PERIODIC>(set, i, &me, now, &mut shortlist, &mut arrivals),
        );
        if let Err(refused) = made {
            self.refuse(refused);
        }
        self.arrivals = arrivals;
        self.shortlists[self.shortlist_of[i] as usize] = shortlist;
    }

    #[inline(always)]
    fn fill_shortlist<S: InstructionSet, const PERIODIC: bool>(
        &mut self,
        set: S,
        i: usize,
        me: &Hot,
        now: f64,
        shortlist: &mut Shortlist,
        arrivals: &mut Vec<f64>,
    ) -> Result<(), OutOfMemory> {
        let list = self.list(i);
        let speed = me.velocity.iter().map(|v| v * v).sum::<f64>().sqrt();
        let wanted = FEWEST + (SHARE_OF_ROOT * (list.len() as f64).sqrt()) as usize;
        shortlist.center = me.position;
        make_room(arrivals, 2 * list.len() + 8)?;
        // The first ball of a cycle is that of a horizon which the grain has at rest.
        let rounds = if shortlist.next_margin > 0.0 { 1 } else { 2 };
        for _ in 0..rounds {
            shortlist.margin = shortlist.next_margin.max(LEAST_MARGIN * me.radius);
            let ball = Hot { velocity: [0.0; 3], radius: me.radius + shortlist.margin, ..*me };
            arrivals.clear();
            self.arrivals::<S, PERIODIC>(set, &ball, list, now, arrivals);
            // Not counting those within the ball, so that the horizon lies ahead.
            let wanted = wanted + arrivals.iter().filter(|&&after| after <= 0.0).count();
            let horizon = if wanted < list.len() {
                arrivals.extend_from_within(..);
                *arrivals[list.len()..].select_nth_unstable_by(wanted, f64::total_cmp).1
            } else {
                f64::INFINITY
            };
            shortlist.until = (now + horizon).min(self.end);
            shortlist.next_margin = (WAYS * speed * (shortlist.until - now))
                .clamp(LEAST_MARGIN * me.radius, MOST_MARGIN * me.radius);
        }
        shortlist.entries.clear();
        make_room(&mut shortlist.entries, list.len())?;
        for (&entry, &after) in list.iter().zip(arrivals.iter()) {
            if now + after <= shortlist.until {
                shortlist.entries.push(entry);
            }
        }
        let looked_at = (rounds * list.len()) as u64;
        self.counts.predictions += looked_at;
        Ok(())
    }

    /// Enters a grain in the shortlists of the coarse grains that it may reach in time.
    #[inline(always)]
    pub(crate) fn announce<const PERIODIC: bool>(&mut self, i: usize, me: &Hot, now: f64) {
        let growth = self.growth;
        for k in 0..usize::from(self.cold[i].coarse_neighbours) {
            let entry = self.list(i)[k];
            let (coarse, image) = unpack(entry);
            let shortlist = self.shortlist(coarse);
            let within = shortlist.until - now;
            let mut d: [f64; 3] = arrays::from_fn(|k| me.position[k] - shortlist.center[k]);
            if PERIODIC {
                let shift = &self.shifts[image];
                d = arrays::from_fn(|k| d[k] - shift[k]);
            }
            let v = me.velocity;
            let (start, rate) = growth.pair(me.radius, self.hot[coarse].radius + shortlist.margin);
            let contact = start + rate * now;
            let a = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] - rate * rate;
            let b = d[0] * v[0] + d[1] * v[1] + d[2] * v[2] - contact * rate;
            let c = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - contact * contact;
            // The root only where nothing else tells.
            let far = c > 0.0 && a >= 0.0 && c > -2.0 * b * within;
            if !far && (c <= 0.0 || falls_to_zero(a, b, c) <= within) {
                let shortlist = &mut self.shortlists[self.shortlist_of[coarse] as usize];
                if let Err(refused) = shortlist.enter(mirror(entry, i)) {
                    self.refuse(refused);
                }
            }
        }
    }
}
