//! What happens to grains and when: prediction of each grain's next event, and its processing.
//!
//! Every pair belongs to the grain whose velocity changed last: it alone looks for their collision. A grain's next
//! event is therefore stale as soon as its partner changed after it did, and then the grain looks again among the
//! pairs that are still its own. Impulses are those of an elastic collision in the frame of the growing surfaces.

use super::contact::fall_to_zero;
use super::container::HOME;
use super::growth::Growth;
use super::queue::READ_AHEAD;
use super::records::{Hot, Next};
use super::system::{System, unpack};
use crate::arrays::{self, Each as _};
use crate::cpu::{InstructionSet, Lanes, prefetch, with_instruction_set};
use crate::memory::{OutOfMemory, refill};

/// Codes of events that are no meeting of grains, above every list entry of image 0..125.
const LEAVES_SPHERE: u32 = u32::MAX;
const NOTHING: u32 = u32::MAX - 1;
const SCANS: u32 = u32::MAX - 2;
const WALL: u32 = u32::MAX - 16;

/// Partners that barely close are parted by at least this share of their speeds, so that rounding
/// cannot make them meet again at once.
const LEAST_CLOSING: f64 = 1e-12;
/// A collision whose partners are further apart than this share of their contact distance at its
/// time was predicted for velocities that are no more.
const CONTACT_TOLERANCE: f64 = 1e-7;

impl System {
    /// Predicts every grain's next event at the start of a cycle.
    ///
    /// # Errors
    /// When the system refuses memory.
    pub(crate) fn predict_all(&mut self, events_per_time: f64) -> Result<(), OutOfMemory> {
        let n = self.len();
        self.queue.reset(n, events_per_time)?;
        refill(&mut self.next, n, Next { time: f64::INFINITY, with: NOTHING })?;
        with_instruction_set!(self.cpu, set => set.call(#[inline(always)] || {
            if self.container.is_periodic() {
                self.predict_all_as::<_, true>(set);
            } else {
                self.predict_all_as::<_, false>(set);
            }
        }));
        Ok(())
    }

    #[inline(always)]
    fn predict_all_as<S: InstructionSet, const PERIODIC: bool>(&mut self, set: S) {
        for i in 0..self.moving {
            if self.cold[i].is_coarse {
                self.scan::<S, PERIODIC>(set, i, 0.0);
            }
            self.predict::<S, PERIODIC>(set, i, 0.0);
        }
    }

    /// Processes events until the cycle ends, `collisions` have taken place or `looked_at` events of
    /// any kind were processed; returns the time that was reached.
    pub(crate) fn run(&mut self, collisions: u64, looked_at: u64) -> f64 {
        with_instruction_set!(self.cpu, set => if self.container.is_periodic() {
            set.call(#[inline(always)] || self.run_as::<_, true>(set, collisions, looked_at))
        } else {
            set.call(#[inline(always)] || self.run_as::<_, false>(set, collisions, looked_at))
        })
    }

    #[inline(always)]
    fn run_as<S: InstructionSet, const PERIODIC: bool>(
        &mut self,
        set: S,
        collisions: u64,
        looked_at: u64,
    ) -> f64 {
        let last = self.counts.collisions().saturating_add(collisions);
        let mut now = 0.0;
        for _ in 0..looked_at {
            if self.counts.collisions() >= last || self.is_crowded() {
                break;
            }
            let Some(entry) = self.queue.pop(&self.next) else { return self.end };
            now = entry.time;
            let i = entry.grain as usize;
            if self.len() >= READ_AHEAD {
                self.read_ahead();
            }
            self.process::<S, PERIODIC>(set, i, self.next[i].with, now);
        }
        now
    }

    /// Asks the memory for what the next events need, each time one step further: records, then lists
    /// and partners, then neighbours.
    #[inline(always)]
    fn read_ahead(&self) {
        if let Some(grain) = self.queue.ahead(3) {
            prefetch(&self.next, grain);
            prefetch(&self.cold, grain);
            prefetch(&self.hot, grain);
        }
        if let Some(grain) = self.queue.ahead(2) {
            self.prefetch_list(grain);
            let partner = unpack(self.next[grain].with).0;
            prefetch(&self.hot, partner);
            prefetch(&self.cold, partner);
        }
        if let Some(grain) = self.queue.ahead(1) {
            self.prefetch_neighbours(grain);
            if self.next[grain].with == LEAVES_SPHERE {
                self.prefetch_rebuild(grain);
            }
            let partner = unpack(self.next[grain].with).0;
            if partner < self.len() {
                self.prefetch_list(partner);
            }
        }
        if let Some(grain) = self.queue.ahead(0) {
            let partner = unpack(self.next[grain].with).0;
            if partner < self.len() {
                self.prefetch_neighbours(partner);
            }
        }
    }

    #[inline(always)]
    fn process<S: InstructionSet, const PERIODIC: bool>(&mut self, set: S, i: usize, with: u32, now: f64) {
        match with {
            LEAVES_SPHERE => {
                self.hot[i].advance(now);
                self.rebuild_list::<S, PERIODIC>(set, i);
                if self.cold[i].is_coarse {
                    self.scan::<S, PERIODIC>(set, i, now);
                }
                self.predict::<S, PERIODIC>(set, i, now);
            }
            SCANS => {
                self.scan::<S, PERIODIC>(set, i, now);
                self.predict::<S, PERIODIC>(set, i, now);
            }
            WALL.. => {
                self.hot[i].advance(now);
                self.bounce(i, with - WALL, now);
                self.predict::<S, PERIODIC>(set, i, now);
            }
            _ => {
                let (j, image) = unpack(with);
                if self.hot[j].time > self.hot[i].time || !self.collide::<PERIODIC>(i, j, image, now) {
                    self.counts.stale_events += 1;
                    self.predict::<S, PERIODIC>(set, i, now);
                    return;
                }
                self.predict::<S, PERIODIC>(set, i, now);
                if j < self.moving {
                    self.predict::<S, PERIODIC>(set, j, now);
                }
            }
        }
    }

    /// Elastic collision of two grains in the frame of their growing surfaces; says whether they
    /// were in contact and closing.
    #[inline(always)]
    fn collide<const PERIODIC: bool>(&mut self, i: usize, j: usize, image: usize, now: f64) -> bool {
        let (mut a, mut b) = (self.hot[i], self.hot[j]);
        a.advance(now);
        b.advance(now);
        let mut d: [f64; 3] = arrays::from_fn(|k| b.position[k] - a.position[k]);
        if PERIODIC {
            let shift = &self.shifts[image];
            d = arrays::from_fn(|k| d[k] + shift[k]);
        }
        let distance = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let (start, rate) = self.growth.pair(a.radius, b.radius);
        let contact = start + rate * now;
        let normal = d.each(|x| x / distance);
        let v: [f64; 3] = arrays::from_fn(|k| b.velocity[k] - a.velocity[k]);
        // The test of the prediction, and not another one that rounds differently.
        let half_rate = d[0] * v[0] + d[1] * v[1] + d[2] * v[2] - contact * rate;
        if half_rate >= 0.0 || distance > contact * (1.0 + CONTACT_TOLERANCE) {
            return false;
        }
        let closing = v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2] - rate;
        let speed = v[0].abs() + v[1].abs() + v[2].abs() + rate.abs();
        let closing = closing.min(-LEAST_CLOSING * speed);
        let (m_a, m_b) = (self.mass[i], self.mass[j]);
        // A grain that is held has an infinite mass.
        let moves = j < self.moving;
        let impulse = if moves { -2.0 * closing * m_a * m_b / (m_a + m_b) } else { -2.0 * closing * m_a };
        for k in 0..3 {
            a.velocity[k] -= impulse / m_a * normal[k];
            b.velocity[k] += impulse / m_b * normal[k];
        }
        self.virial += impulse * contact;
        self.hot[i] = a;
        if moves {
            self.hot[j] = b;
        }
        for grain in [i, j] {
            self.cold[grain].collisions = self.cold[grain].collisions.saturating_add(1);
        }
        self.counts.grain_collisions += 1;
        true
    }

    /// Reflects a grain at a wall, which recedes from it as fast as the grain's surface grows.
    #[inline(always)]
    fn bounce(&mut self, i: usize, wall: u32, now: f64) {
        let (start, rate) = self.wall_contact(self.hot[i].radius, wall);
        let is_face = self.is_face(wall);
        let hot = &mut self.hot[i];
        let (normal, _) = self.container.wall_normal(wall, hot.position);
        let closing: f64 = (0..3).map(|k| hot.velocity[k] * normal[k]).sum::<f64>() - rate;
        if closing < 0.0 {
            for k in 0..3 {
                hot.velocity[k] -= 2.0 * closing * normal[k];
            }
            if !is_face {
                self.virial -= 2.0 * closing * self.mass[i] * (start + rate * now);
            }
        }
        // What happens at a face is no collision of the packing.
        if !is_face {
            self.cold[i].collisions = self.cold[i].collisions.saturating_add(1);
            self.counts.wall_collisions += 1;
        }
    }

    /// Finds the next event of a grain and schedules it.
    #[inline(always)]
    pub(crate) fn predict<S: InstructionSet, const PERIODIC: bool>(&mut self, set: S, i: usize, now: f64) {
        let own = self.hot[i];
        let me = Hot { position: own.position_at(now), ..own };
        let mut best = self.next_without_partner(i, &me, now);
        let cold = &self.cold[i];
        let coarse_neighbours = cold.coarse_neighbours;
        let list = if cold.is_coarse {
            let shortlist = self.shortlist(i);
            let until = shortlist.valid_until(&me, now);
            if until < best.time {
                best = Next { time: until, with: SCANS };
            }
            shortlist.entries()
        } else {
            self.list(i)
        };
        self.meet::<S, PERIODIC>(set, &me, list, now, &mut best);
        self.counts.predictions += list.len() as u64;
        if coarse_neighbours > 0 {
            self.announce::<PERIODIC>(i, &me, now);
        }
        self.next[i] = best;
        if best.time < self.end {
            self.queue.push(best.time, i as u32);
        } else {
            self.next[i].time = f64::INFINITY;
        }
    }

    /// Walls and the bound of the NNL sphere.
    #[inline(always)]
    fn next_without_partner(&self, i: usize, me: &Hot, now: f64) -> Next {
        let cold = &self.cold[i];
        let d: [f64; 3] = arrays::from_fn(|k| me.position[k] - cold.center[k]);
        let v = me.velocity;
        let c = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - cold.skin * cold.skin;
        let b = d[0] * v[0] + d[1] * v[1] + d[2] * v[2];
        let a = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        let mut best = Next { time: now + super::contact::rises_to_zero(a, b, c), with: LEAVES_SPHERE };
        if best.time >= self.end {
            best = Next { time: self.end, with: NOTHING };
        }
        let mut walls = cold.walls;
        while walls != 0 {
            let wall = walls.trailing_zeros();
            walls &= walls - 1;
            let (start, rate) = self.wall_contact(me.radius, wall);
            let after = self.container.time_to_wall(wall, me.position, v, start + rate * now, rate);
            if now + after < best.time {
                best = Next { time: now + after, with: WALL + wall };
            }
        }
        best
    }

    /// The earliest meeting with a neighbour whose velocity did not change after the grain's own.
    ///
    /// Four pairs at a time: which of them approach is a coin toss that no branch predictor foresees. Arrays are
    /// written out: code that goes through `array::map` may be left outside of the function that is compiled for the
    /// set.
    #[inline(always)]
    fn meet<S: InstructionSet, const PERIODIC: bool>(
        &self,
        set: S,
        me: &Hot,
        list: &[u32],
        now: f64,
        best: &mut Next,
    ) {
        let mut soonest = best.time - now;
        let own_time = set.splat(me.time);
        let mut from = 0;
        while from < list.len() {
            let entries = block(list, from);
            from += 4;
            let ([a, b, c], time) = self.coefficients::<S, PERIODIC>(set, me, entries, now);
            // Not those that are too far to meet before `soonest` even if nothing slowed the approach.
            let near = a.lt(set.splat(0.0)) | c.le(b * set.splat(-2.0 * soonest));
            let candidates = near & time.le(own_time);
            if !candidates.any() {
                continue;
            }
            let after = candidates.select(fall_to_zero(set, a, b, c), set.splat(f64::INFINITY));
            if after.lt(set.splat(soonest)).any() {
                for (after, entry) in after.to_array().into_iter().zip(entries) {
                    if after < soonest {
                        soonest = after;
                        *best = Next { time: now + after, with: entry };
                    }
                }
            }
        }
    }
    /// Times after which the neighbours of a list would touch a grain at rest; 0 of those that do already.
    #[inline(always)]
    pub(crate) fn arrivals<S: InstructionSet, const PERIODIC: bool>(
        &self,
        set: S,
        me: &Hot,
        list: &[u32],
        now: f64,
        after: &mut Vec<f64>,
    ) {
        for from in (0..list.len()).step_by(4) {
            let ([a, b, c], _) = self.coefficients::<S, PERIODIC>(set, me, block(list, from), now);
            let touch = c.le(set.splat(0.0)).select(set.splat(0.0), fall_to_zero(set, a, b, c));
            after.extend_from_slice(&touch.to_array());
        }
        after.truncate(list.len());
    }

    /// The coefficients of `contact` for a grain and four of its neighbours, and when these changed last.
    #[inline(always)]
    fn coefficients<S: InstructionSet, const PERIODIC: bool>(
        &self,
        set: S,
        me: &Hot,
        entries: [u32; 4],
        now: f64,
    ) -> ([S::Lanes; 3], S::Lanes) {
        let growth: Growth = self.growth;
        let [x, y, z] = me.position;
        let own_position = [set.splat(x), set.splat(y), set.splat(z)];
        let [u, v, w] = me.velocity;
        let own_velocity = [set.splat(u), set.splat(v), set.splat(w)];
        let own_radius = set.splat(me.radius);
        let (at, kappa) = (set.splat(now), set.splat(growth.kappa));
        let (alpha, beta) = (set.splat(growth.alpha), set.splat(2.0 * growth.beta));
        let [a, b, c, d] = entries;
        let a = &self.hot[unpack(a).0];
        let b = &self.hot[unpack(b).0];
        let c = &self.hot[unpack(c).0];
        let d = &self.hot[unpack(d).0];
        let [x, y, z, time] = S::Lanes::transpose([
            a.position_and_time(set),
            b.position_and_time(set),
            c.position_and_time(set),
            d.position_and_time(set),
        ]);
        let [u, v, w, radius] = S::Lanes::transpose([
            a.velocity_and_radius(set),
            b.velocity_and_radius(set),
            c.velocity_and_radius(set),
            d.velocity_and_radius(set),
        ]);
        let since = at - time;
        let mut d = [
            x + u * since - own_position[0],
            y + v * since - own_position[1],
            z + w * since - own_position[2],
        ];
        if PERIODIC && entries.iter().any(|&entry| unpack(entry).1 != HOME as usize) {
            let shifts = entries.map(|entry| &self.shifts[unpack(entry).1]);
            for (axis, d) in d.iter_mut().enumerate() {
                *d = *d + set.lanes(shifts.each(|shift| shift[axis]));
            }
        }
        let v = [u - own_velocity[0], v - own_velocity[1], w - own_velocity[2]];
        let start = own_radius + radius + kappa * own_radius.min(radius);
        let rate = alpha * start + beta;
        let contact = start + rate * at;
        let a = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] - rate * rate;
        let b = d[0] * v[0] + d[1] * v[1] + d[2] * v[2] - contact * rate;
        let c = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - contact * contact;
        ([a, b, c], time)
    }
}

/// Four entries of a list from a place on; behind its end the last one again, which changes nothing.
#[inline(always)]
fn block(list: &[u32], from: usize) -> [u32; 4] {
    let entry = |k: usize| list[(from + k).min(list.len() - 1)];
    [entry(0), entry(1), entry(2), entry(3)]
}
