//! What is kept of each grain in motion: a record that others read, one that its own events read, and its next
//! event.

use crate::arrays;
use crate::cpu::InstructionSet;

/// Rebuilds per collision in a cycle above which a grain gets more skin, and below which it gets
/// less: a rebuild costs about as much as ten collisions save by shorter lists.
const MANY_REBUILDS: f64 = 0.10;
const FEW_REBUILDS: f64 = 0.04;
const MORE: f64 = 1.15;
const LESS: f64 = 0.87;
/// What every prediction reads of a grain: one cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Hot {
    /// Centre at `time`, in mm.
    pub(crate) position: [f64; 3],
    /// When position and velocity last changed, in s since the start of the cycle.
    pub(crate) time: f64,
    /// Velocity in mm/s.
    pub(crate) velocity: [f64; 3],
    /// Contact radius at the start of the cycle, in mm.
    pub(crate) radius: f64,
}

impl Hot {
    #[inline(always)]
    pub(crate) fn position_at(&self, time: f64) -> [f64; 3] {
        let dt = time - self.time;
        arrays::from_fn(|a| self.position[a] + self.velocity[a] * dt)
    }

    /// Position and the time it holds for, as four numbers.
    #[inline(always)]
    pub(crate) fn position_and_time<S: InstructionSet>(&self, set: S) -> S::Lanes {
        set.lanes([self.position[0], self.position[1], self.position[2], self.time])
    }

    /// Velocity and contact radius, as four numbers.
    #[inline(always)]
    pub(crate) fn velocity_and_radius<S: InstructionSet>(&self, set: S) -> S::Lanes {
        set.lanes([self.velocity[0], self.velocity[1], self.velocity[2], self.radius])
    }

    /// Moves the record on to a time.
    #[inline(always)]
    pub(crate) fn advance(&mut self, time: f64) {
        self.position = self.position_at(time);
        self.time = time;
    }
}

/// What only its own events read of a grain: another cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Cold {
    /// Centre of the NNL sphere, in mm.
    pub(crate) center: [f64; 3],
    /// Its radius in mm.
    pub(crate) skin: f64,
    /// That and the contact radius at the end of the cycle, in mm.
    pub(crate) cutoff: f64,
    /// Where its list begins, how long it is, and for how many there is room.
    pub(crate) offset: u32,
    pub(crate) len: u32,
    pub(crate) capacity: u32,
    /// Its cell of the grid.
    pub(crate) cell: u32,
    /// Walls that can be met, as bits.
    pub(crate) walls: u8,
    /// Whether it has a shortlist.
    pub(crate) is_coarse: bool,
    /// Neighbours that have one: the first of the list.
    pub(crate) coarse_neighbours: u16,
    /// Collisions in the cycle.
    pub(crate) collisions: u16,
    /// Rebuilds in the cycle.
    pub(crate) rebuilds: u16,
}

impl Cold {
    /// Trades the length of the list against the number of its rebuilds.
    #[inline(always)]
    pub(crate) fn adapt_skin(&mut self) {
        let (rebuilds, collisions) = (f64::from(self.rebuilds), f64::from(self.collisions));
        if rebuilds > MANY_REBUILDS * (collisions + 2.0) {
            self.skin *= MORE;
        } else if rebuilds < FEW_REBUILDS * (collisions + 2.0) && collisions > 0.0 {
            self.skin *= LESS;
        }
    }
}

/// The next event of a grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Next {
    pub(crate) time: f64,
    /// The list entry of the partner, or one of the codes of `events`.
    pub(crate) with: u32,
}
