//! What happens to grains and when: prediction of each grain's next event, and its processing.
//!
//! Every pair belongs to the grain whose velocity changed last: it alone looks for their meeting.
//! A grain's next event is therefore stale as soon as its partner changed after it did, and then the
//! grain looks again among the pairs that are still its own. This module knows grains one epoch
//! long; it must never know what they grow for.

use super::contact::falls_to_zero;
use super::growth::Growth;
use super::system::{Hot, Next, System, unpack};

/// Codes of events that are no meeting of grains, above every list entry of image 0..125.
const LEAVES_SPHERE: u32 = u32::MAX;
const NOTHING: u32 = u32::MAX - 1;
const WALL: u32 = u32::MAX - 16;

/// A collision whose partners are further apart than this share of their contact distance at its
/// time was predicted for velocities that are no more.
const CONTACT_TOLERANCE: f64 = 1e-7;

impl System {
    /// Predicts every grain's next event at the start of an epoch.
    pub(crate) fn predict_all(&mut self, events_per_time: f64) {
        let n = self.len();
        self.queue.reset(n, events_per_time);
        self.next.clear();
        self.next.resize(n, Next { time: f64::INFINITY, with: NOTHING });
        for i in 0..n {
            if self.container.is_periodic() {
                self.predict::<true>(i, 0.0)
            } else {
                self.predict::<false>(i, 0.0)
            }
        }
    }

    /// Processes events until the epoch ends or `most` of them have happened; returns the time that
    /// was reached.
    pub(crate) fn run(&mut self, most: u64) -> f64 {
        if self.container.is_periodic() { self.run_as::<true>(most) } else { self.run_as::<false>(most) }
    }

    fn run_as<const PERIODIC: bool>(&mut self, most: u64) -> f64 {
        let mut done = 0;
        let mut now = 0.0;
        while done < most {
            let next = &self.next;
            let Some(entry) = self.queue.pop(|e| next[e.grain as usize].time == e.time) else {
                return self.end;
            };
            now = entry.time;
            let i = entry.grain as usize;
            let with = self.next[i].with;
            done += u64::from(self.process::<PERIODIC>(i, with, now));
            if self.is_crowded() {
                break;
            }
        }
        now
    }

    /// Says whether a collision took place.
    fn process<const PERIODIC: bool>(&mut self, i: usize, with: u32, now: f64) -> bool {
        match with {
            LEAVES_SPHERE => {
                self.hot[i].advance(now);
                self.renew::<PERIODIC>(i);
                self.predict::<PERIODIC>(i, now);
                false
            }
            WALL.. => {
                self.hot[i].advance(now);
                self.bounce(i, with - WALL, now);
                self.predict::<PERIODIC>(i, now);
                true
            }
            _ => {
                let (j, image) = unpack(with);
                if self.hot[j].time > self.hot[i].time || !self.collide::<PERIODIC>(i, j, image, now) {
                    self.counts.stale_events += 1;
                    self.predict::<PERIODIC>(i, now);
                    return false;
                }
                self.predict::<PERIODIC>(i, now);
                self.predict::<PERIODIC>(j, now);
                true
            }
        }
    }

    /// Elastic collision of two grains in the frame of their growing surfaces; says whether they
    /// were in contact and closing.
    fn collide<const PERIODIC: bool>(&mut self, i: usize, j: usize, image: usize, now: f64) -> bool {
        let (mut a, mut b) = (self.hot[i], self.hot[j]);
        a.advance(now);
        b.advance(now);
        let mut d: [f64; 3] = std::array::from_fn(|k| b.position[k] - a.position[k]);
        if PERIODIC {
            let shift = &self.shifts[image];
            d = std::array::from_fn(|k| d[k] + shift[k]);
        }
        let distance = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let (start, rate) = self.growth.pair(a.radius, b.radius);
        let contact = start + rate * now;
        let normal = d.map(|x| x / distance);
        let closing: f64 = (0..3).map(|k| (b.velocity[k] - a.velocity[k]) * normal[k]).sum::<f64>() - rate;
        if closing >= 0.0 || distance > contact * (1.0 + CONTACT_TOLERANCE) {
            return false;
        }
        let (m_a, m_b) = (self.cold[i].mass, self.cold[j].mass);
        let impulse = -2.0 * closing * m_a * m_b / (m_a + m_b);
        for k in 0..3 {
            a.velocity[k] -= impulse / m_a * normal[k];
            b.velocity[k] += impulse / m_b * normal[k];
        }
        self.virial += impulse * contact;
        self.hot[i] = a;
        self.hot[j] = b;
        self.cold[i].collisions += 1;
        self.cold[j].collisions += 1;
        self.counts.grain_collisions += 1;
        true
    }

    /// Reflects a grain at a wall, which recedes from it as fast as the grain's surface grows.
    fn bounce(&mut self, i: usize, wall: u32, now: f64) {
        let hot = &mut self.hot[i];
        let (normal, _) = self.container.wall_normal(wall, hot.position);
        let (start, rate) = self.growth.wall(hot.radius);
        let closing: f64 = (0..3).map(|k| hot.velocity[k] * normal[k]).sum::<f64>() - rate;
        if closing < 0.0 {
            for k in 0..3 {
                hot.velocity[k] -= 2.0 * closing * normal[k];
            }
            self.virial -= 2.0 * closing * self.cold[i].mass * (start + rate * now);
        }
        self.cold[i].collisions += 1;
        self.counts.wall_collisions += 1;
    }

    /// Finds the next event of a grain and schedules it.
    #[inline(always)]
    pub(crate) fn predict<const PERIODIC: bool>(&mut self, i: usize, now: f64) {
        let own = self.hot[i];
        let me = Hot { position: own.position_at(now), ..own };
        let mut best = self.next_without_partner(i, &me, now);
        let list = self.list(i);
        self.meet::<PERIODIC>(&me, list, now, &mut best);
        self.counts.predictions += list.len() as u64;
        self.next[i] = best;
        if best.time < self.end {
            self.queue.push(best.time, i as u32);
        } else {
            self.next[i].time = f64::INFINITY;
        }
    }

    /// Walls and the bound of the sphere of free movement.
    #[inline(always)]
    fn next_without_partner(&self, i: usize, me: &Hot, now: f64) -> Next {
        let cold = &self.cold[i];
        let d: [f64; 3] = std::array::from_fn(|k| me.position[k] - cold.center[k]);
        let v = me.velocity;
        let c = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - cold.reach * cold.reach;
        let b = d[0] * v[0] + d[1] * v[1] + d[2] * v[2];
        let a = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
        let mut best = Next { time: now + super::contact::rises_to_zero(a, b, c), with: LEAVES_SPHERE };
        if best.time >= self.end {
            best = Next { time: self.end, with: NOTHING };
        }
        let mut walls = cold.walls;
        if walls != 0 {
            let (start, rate) = self.growth.wall(me.radius);
            while walls != 0 {
                let wall = walls.trailing_zeros();
                walls &= walls - 1;
                let after = self.container.time_to_wall(wall, me.position, v, start + rate * now, rate);
                if now + after < best.time {
                    best = Next { time: now + after, with: WALL + wall };
                }
            }
        }
        best
    }

    /// The earliest meeting with a neighbour whose velocity did not change after the grain's own.
    #[inline(always)]
    fn meet<const PERIODIC: bool>(&self, me: &Hot, list: &[u32], now: f64, best: &mut Next) {
        let growth: Growth = self.growth;
        let mut soonest = best.time - now;
        for &entry in list {
            let (j, image) = unpack(entry);
            let other = &self.hot[j];
            if other.time > me.time {
                continue;
            }
            let dt = now - other.time;
            let mut d: [f64; 3] =
                std::array::from_fn(|k| other.position[k] + other.velocity[k] * dt - me.position[k]);
            if PERIODIC {
                let shift = &self.shifts[image];
                d = std::array::from_fn(|k| d[k] + shift[k]);
            }
            let v: [f64; 3] = std::array::from_fn(|k| other.velocity[k] - me.velocity[k]);
            let (start, rate) = growth.pair(me.radius, other.radius);
            let contact = start + rate * now;
            let b = d[0] * v[0] + d[1] * v[1] + d[2] * v[2] - contact * rate;
            let c = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - contact * contact;
            let a = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] - rate * rate;
            // Too far to meet before `soonest` even if nothing slowed the approach.
            if a >= 0.0 && (b >= 0.0 || c > -2.0 * b * soonest) {
                continue;
            }
            let after = falls_to_zero(a, b, c);
            if after < soonest {
                soonest = after;
                *best = Next { time: now + after, with: entry };
            }
        }
    }
}
