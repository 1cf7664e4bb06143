//! The planes between neighbours, four at a time.
//!
//! Between any two neighbours lies a gap bounded by two parallel planes, one that the first grain stays behind and one
//! that the second does, at least their gap `g` apart. As long as a grain stays behind its own planes,
//!
//! ```text
//! x · n + h(n) <= o,   that is   t = o - x · n >= 0  and  t² >= n · A n,
//! ```
//!
//! it keeps its gaps to all neighbours, which need not be looked at: the test reads the grain and its list and nothing
//! else. Four planes at a time are held against the ellipsoid that the grain is, or that lies around it, with the shape
//! matrix `A`; a polyhedron then looks at its vertices for the planes that the ellipsoid crosses. Only where it crosses
//! a plane the pair is decided ([`crate::gap`]), and new planes are laid between the two if they are apart. A plane
//! wall is a plane like any other, but one that never moves.

use super::system::{Hot, System};
use crate::arrays::Each as _;
use crate::cpu::{InstructionSet, Lanes};
use crate::gap::grain::{ConvexShape, PushContact, Turned};
use crate::gap::linear::{Symmetric, Vector, dot, minus, norm, scaled, sum};

/// Lanes of a group.
pub(super) const LANES: usize = 4;
/// The neighbour of an unused lane.
pub(super) const NOBODY: u32 = u32::MAX;
/// The first of the six plane walls, as a neighbour: twice the axis, and one more for the far side.
pub(super) const WALL: u32 = u32::MAX - 16;
/// Grains are named by 25 bits; the upper 7 bits name the image.
const IMAGE_SHIFT: u32 = 25;
const ID_MASK: u32 = (1 << IMAGE_SHIFT) - 1;
/// Largest number of grains that lists can name.
pub const MAX_GRAINS: usize = ID_MASK as usize - 1;

/// Turns of the search for the direction of a push.
const PUSH_TURNS: u32 = 3;

/// Four planes of a grain.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(super) struct Group {
    pub(super) n: [[f64; LANES]; 3],
    pub(super) o: [f64; LANES],
    /// Neighbours with their images.
    pub(super) neighbors: [u32; LANES],
    /// Where the neighbour has its plane: four times the group plus the lane.
    pub(super) mirrors: [u32; LANES],
}

impl Group {
    /// A group whose planes are never crossed.
    pub(super) const EMPTY: Self = Self {
        n: [[0.0; LANES]; 3],
        o: [f64::INFINITY; LANES],
        neighbors: [NOBODY; LANES],
        mirrors: [0; LANES],
    };

    #[inline(always)]
    pub(super) fn normal(&self, lane: usize) -> Vector {
        [self.n[0][lane], self.n[1][lane], self.n[2][lane]]
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, n: Vector, o: f64) {
        for (of_lane, n) in self.n.iter_mut().zip(n) {
            of_lane[lane] = n;
        }
        self.o[lane] = o;
    }
}

#[inline(always)]
pub(super) fn pack(id: usize, image: u32) -> u32 {
    id as u32 | image << IMAGE_SHIFT
}

#[inline(always)]
pub(super) fn unpack(neighbor: u32) -> (usize, u32) {
    ((neighbor & ID_MASK) as usize, neighbor >> IMAGE_SHIFT)
}

#[inline(always)]
pub(super) fn is_wall(neighbor: u32) -> bool {
    neighbor >= WALL && neighbor != NOBODY
}

/// A grain in four lanes, by the ellipsoid around it.
#[derive(Clone, Copy)]
pub(super) struct Spread<L> {
    center: [L; 3],
    matrix: [L; 6],
    zero: L,
}

impl<L: Lanes> Spread<L> {
    #[inline(always)]
    pub(super) fn new<S: InstructionSet<Lanes = L>>(set: S, center: Vector, matrix: &Symmetric) -> Self {
        // The sums off the diagonal count twice.
        let [xx, xy, xz, yy, yz, zz] = matrix.0;
        Self {
            center: [set.splat(center[0]), set.splat(center[1]), set.splat(center[2])],
            matrix: [
                set.splat(xx),
                set.splat(2.0 * xy),
                set.splat(2.0 * xz),
                set.splat(yy),
                set.splat(2.0 * yz),
                set.splat(zz),
            ],
            zero: set.splat(0.0),
        }
    }

    /// Mask of the planes of a group that the ellipsoid crosses, or would where they were nearer by `more`.
    #[inline(always)]
    pub(super) fn crosses<S: InstructionSet<Lanes = L>>(&self, set: S, group: &Group, more: L) -> L {
        let [x, y, z] = [set.lanes(group.n[0]), set.lanes(group.n[1]), set.lanes(group.n[2])];
        let [xx, xy, xz, yy, yz, zz] = self.matrix;
        let along = x * self.center[0] + y * self.center[1] + z * self.center[2];
        let left = set.lanes(group.o) - along - more;
        let h2 = x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + z * (zz * z);
        left.lt(self.zero) | (left * left).lt(h2)
    }
}

/// Whether a grain whose ellipsoid crosses a plane, or would where it was nearer by `more`, does so itself.
#[inline(always)]
pub(super) fn crosses_itself<T: Turned>(grain: &Hot<T>, group: &Group, lane: usize, more: f64) -> bool {
    if T::IS_ELLIPSOID {
        return true;
    }
    let n = group.normal(lane);
    dot(grain.center, n) + grain.turned.support_mm(n) > group.o[lane] - more
}

/// Planes between two grains that are apart, to be laid when a move is made.
#[derive(Clone, Copy, Debug)]
pub(super) struct NewPlanes {
    /// Four times the group plus the lane, of the grain and of its neighbour.
    pub(super) at: u32,
    pub(super) mirror: u32,
    n: Vector,
    o: f64,
    other_o: f64,
}

/// What a pair turned out to be.
#[derive(Clone, Copy, Debug)]
pub(super) enum Decided {
    Apart(NewPlanes),
    /// Too close, along this unit vector from the grain to its neighbour.
    TooClose(Vector),
}

impl<S: ConvexShape> System<S> {
    /// Decides the pair of a grain's plane, where the grain is this one.
    #[inline(always)]
    pub(super) fn decide(&self, i: usize, as_if: &Hot<S::Turned>, group: usize, lane: usize) -> Decided {
        let planes = &self.groups[group];
        let (j, image) = unpack(planes.neighbors[lane]);
        let other = &self.hot[j];
        let at =
            if self.container.is_periodic() { sum(other.center, self.shift(image)) } else { other.center };
        let r = minus(at, as_if.center);
        let gap = self.gap(as_if.d, other.d);
        let mut n = planes.normal(lane);
        let (mut h_a, mut h_b) = (as_if.turned.support_mm(n), other.turned.support_back_mm(n));
        let mut slack = dot(r, n) - h_a - h_b - gap;
        if slack < 0.0 {
            let decision = as_if.turned.decide(&other.turned, r, gap, n);
            n = scaled(decision.normal, 1.0 / norm(decision.normal));
            if !decision.is_apart {
                return Decided::TooClose(n);
            }
            (h_a, h_b) = (as_if.turned.support_mm(n), other.turned.support_back_mm(n));
            slack = dot(r, n) - h_a - h_b - gap;
            // By s(n) alone: a slack that rounding has made negative is none.
            if slack < 0.0 {
                return Decided::TooClose(n);
            }
        }
        Decided::Apart(self.between(i, as_if, [group, lane], n, [h_a, h_b], slack))
    }

    /// The planes between a grain and a neighbour with this unit vector, values of the support functions, and gap
    /// beyond what they keep.
    #[inline(always)]
    fn between(
        &self,
        i: usize,
        as_if: &Hot<S::Turned>,
        [group, lane]: [usize; 2],
        n: Vector,
        [h_a, h_b]: [f64; 2],
        slack: f64,
    ) -> NewPlanes {
        let planes = &self.groups[group];
        let (j, _) = unpack(planes.neighbors[lane]);
        let share = self.cold[i].step / (self.cold[i].step + self.cold[j].step);
        NewPlanes {
            at: (LANES * group + lane) as u32,
            mirror: planes.mirrors[lane],
            n,
            o: dot(as_if.center, n) + h_a + share * slack,
            other_o: h_b + (1.0 - share) * slack - dot(self.hot[j].center, n),
        }
    }

    /// The planes between a grain and a neighbour where they keep their gap; else where they push each other.
    #[inline(always)]
    pub(super) fn touch(&self, i: usize, group: usize, lane: usize) -> Result<NewPlanes, PushContact> {
        let (j, image) = unpack(self.groups[group].neighbors[lane]);
        let (one, other) = (&self.hot[i], &self.hot[j]);
        let mut n = self.groups[group].normal(lane);
        if S::Turned::IS_ELLIPSOID {
            match self.decide(i, one, group, lane) {
                Decided::Apart(planes) => return Ok(planes),
                Decided::TooClose(too_close) => n = too_close,
            }
        }
        let r = minus(sum(other.center, self.shift(image)), one.center);
        let gap = self.gap(one.d, other.d);
        let slack = |n: Vector, [h_a, h_b]: [f64; 2]| dot(r, n) - h_a - h_b - gap;
        if !S::Turned::IS_ELLIPSOID {
            // One search finds whether polyhedra are apart and where they push.
            let supports = [one.turned.support_mm(n), other.turned.support_back_mm(n)];
            let left = slack(n, supports);
            if left >= 0.0 {
                return Ok(self.between(i, one, [group, lane], n, supports, left));
            }
        }
        let contact = one.turned.contact(&other.turned, r, gap, n, PUSH_TURNS);
        let left = slack(contact.normal, contact.supports_mm);
        if !S::Turned::IS_ELLIPSOID && left >= 0.0 {
            return Ok(self.between(i, one, [group, lane], contact.normal, contact.supports_mm, left));
        }
        Err(contact)
    }

    #[inline(always)]
    pub(super) fn lay(&mut self, planes: &NewPlanes) {
        let place = |at: u32| (at as usize / LANES, at as usize % LANES);
        let (group, lane) = place(planes.at);
        self.groups[group].set(lane, planes.n, planes.o);
        let (group, lane) = place(planes.mirror);
        self.groups[group].set(lane, planes.n.each(|c| -c), planes.other_o);
    }

    /// Lays planes with this unit vector between a grain and a neighbour, wherever the two are. Where they are too
    /// close, both cross them.
    pub(super) fn lay_between(&mut self, i: usize, group: usize, lane: usize, n: Vector) {
        let planes = &self.groups[group];
        let (j, image) = unpack(planes.neighbors[lane]);
        let (one, other) = (&self.hot[i], &self.hot[j]);
        let at = sum(other.center, self.shift(image));
        let (h_a, h_b) = (one.turned.support_mm(n), other.turned.support_back_mm(n));
        let slack = dot(minus(at, one.center), n) - h_a - h_b - self.gap(one.d, other.d);
        let share = self.cold[i].step / (self.cold[i].step + self.cold[j].step);
        self.lay(&NewPlanes {
            at: (LANES * group + lane) as u32,
            mirror: planes.mirrors[lane],
            n,
            o: dot(one.center, n) + h_a + share * slack,
            other_o: h_b + (1.0 - share) * slack - dot(other.center, n),
        });
    }
}
