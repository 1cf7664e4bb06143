//! Planes as a grain stores them, four in a line of cache.
//!
//! A plane takes 16 bytes, four of them a line of cache. The components of its normal are integers of 16 bits, which
//! both grains read as they are: a plane need not have the direction of the gap, nor a normal of length 1. Its offset
//! is counted from where the list of its grain was built, in single precision, rounded towards the grain. If the gap
//! holds only along the exact normal and not along that of 16 bits, no valid plane exists, and the pair is tested
//! exactly at every move.

use crate::arrays::Each as _;
use crate::gap::linear::{Vector, norm, scaled};

/// Lanes of a group.
pub(super) const LANES: usize = 4;
/// The neighbour of an unused lane. No image has all of the upper bits of a name ([`ImageNames`]).
///
/// [`ImageNames`]: crate::methods::image_names::ImageNames
pub(super) const NO_NEIGHBOR: u32 = u32::MAX;
/// The first of the plane walls, as a neighbour; the others follow by their numbers.
pub(super) const WALL: u32 = u32::MAX - 16;
/// Largest number of grains that lists can name where no grain is longer than an edge of its periodic box: beside the
/// images of two boxes to either side, and more than are ever grown.
pub const MAX_GRAINS: usize = (1 << 25) - 2;

/// Length of a normal but for the rounding of its components, which changes it by less than 1.
pub(super) const UNIT: f64 = 32_767.0;
/// Bounds of the length of a normal.
pub(super) const SHORTEST: f64 = UNIT - 1.0;
pub(super) const LONGEST: f64 = UNIT + 1.0;
/// Stands for a place beyond what 16 bits hold; the list is searched for it.
pub(super) const FAR: u16 = u16::MAX;

/// An offset that no grain reaches. Its negative is crossed by every grain, wherever it is.
pub(super) const NEVER: f32 = 1e30;

/// A normal, about [`UNIT`] long.
pub(super) type Normal = [i16; 3];

/// The normal nearest to a unit vector.
#[inline(always)]
pub(super) fn normal(n: Vector) -> Normal {
    // Positive before the conversion, which rounds down then.
    n.each(|c| ((c * UNIT + (UNIT + 1.5)) as i32 - (UNIT + 1.0) as i32) as i16)
}

/// An offset in single precision that is not above this one, and less by a share of 1.3e-7 at most.
#[inline(always)]
pub(super) fn below(offset: f64) -> f32 {
    // Rounding changes a number by less than 2^-24 of it.
    (offset - offset.abs() * 6e-8) as f32
}

/// Four planes of a grain.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Group {
    pub(super) normals: [[i16; LANES]; 3],
    /// The place of the plane of the neighbour in its list, or [`FAR`].
    pub(super) mirrors: [u16; LANES],
    /// From where the list of the grain was built, times the length of the normal.
    pub(super) offsets: [f32; LANES],
    /// Neighbours with their images.
    pub(super) neighbors: [u32; LANES],
}

impl Group {
    /// A group whose planes are never crossed.
    pub(super) const EMPTY: Self = Self {
        normals: [[0; LANES]; 3],
        mirrors: [FAR; LANES],
        offsets: [NEVER; LANES],
        neighbors: [NO_NEIGHBOR; LANES],
    };

    /// A normal as it is stored.
    #[inline(always)]
    pub(super) fn stored_normal(&self, lane: usize) -> Normal {
        [self.normals[0][lane], self.normals[1][lane], self.normals[2][lane]]
    }

    /// A normal as it is, which is not of length 1.
    #[inline(always)]
    pub(super) fn normal(&self, lane: usize) -> Vector {
        self.stored_normal(lane).each(f64::from)
    }

    /// The direction of a normal.
    #[inline(always)]
    pub(super) fn unit(&self, lane: usize) -> Vector {
        let n = self.normal(lane);
        scaled(n, 1.0 / norm(n))
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, normal: Normal, offset: f32) {
        for (of_lane, c) in self.normals.iter_mut().zip(normal) {
            of_lane[lane] = c;
        }
        self.offsets[lane] = offset;
    }

    /// What a lane has of a pair.
    #[inline(always)]
    pub(super) fn pair(&self, group: usize, lane: usize) -> Pair {
        Pair {
            at: (LANES * group + lane) as u32,
            neighbor: self.neighbors[lane],
            mirror: self.mirrors[lane],
            normal: self.stored_normal(lane),
        }
    }

    /// Enters a neighbour whose plane lies at this place of its list.
    pub(super) fn enter(&mut self, lane: usize, neighbor: u32, place: usize) {
        self.neighbors[lane] = neighbor;
        self.mirrors[lane] = u16::try_from(place).unwrap_or(FAR);
    }
}

#[inline(always)]
pub(super) fn is_wall(neighbor: u32) -> bool {
    neighbor >= WALL && neighbor != NO_NEIGHBOR
}

/// A grain's pair with a neighbour: the place of its plane, four times the group plus the lane; the neighbour with its
/// image, and the place of the plane of the neighbour in its list or [`FAR`]; and a normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) at: u32,
    pub(super) neighbor: u32,
    pub(super) mirror: u16,
    pub(super) normal: Normal,
}

impl Pair {
    /// The same along the normal nearest to this unit vector.
    pub(super) fn along(self, n: Vector) -> Self {
        Self { normal: normal(n), ..self }
    }

    /// Whether the place of the plane of the neighbour has to be looked for.
    pub(super) fn is_far(&self) -> bool {
        self.mirror == FAR
    }
}
