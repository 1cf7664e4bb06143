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
//! wall is a plane as well, but one that never moves; a grain that crosses it is held against the wall itself.
//!
//! [`Group`] says how planes are stored.

use std::marker::PhantomData;

use super::group::{FAR, Group, LANES, NEVER, Normal, Pair, UNIT, WALL, below, is_wall, normal};
use super::system::{Frame, Hot, Part};
use super::window::Window;
use crate::arrays::Each as _;
use crate::cpu::{InstructionSet, Lanes};
use crate::gap::grain::{ConvexShape, PushContact, Turned};
use crate::gap::linear::{Symmetric, Vector, dot, minus, norm, scaled, sum};

/// Turns of the search for the direction of a push.
pub(super) const PUSH_TURNS: u32 = 3;

/// A grain in four lanes, by the ellipsoid around it and its centre, from where its list was built.
#[derive(Clone, Copy)]
pub(super) struct Spread<L, T> {
    of: PhantomData<T>,
    center: [L; 3],
    matrix: [L; 6],
    zero: L,
}

impl<L: Lanes, T: Turned> Spread<L, T> {
    #[inline(always)]
    fn new<S: InstructionSet<Lanes = L>>(set: S, center: Vector, matrix: &Symmetric) -> Self {
        // The sums off the diagonal count twice.
        let [xx, xy, xz, yy, yz, zz] = matrix.0;
        Self {
            of: PhantomData,
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

    /// Mask of the planes of a group that the ellipsoid crosses, or would where their offsets were less by `slack_mm`.
    #[inline(always)]
    pub(super) fn crosses<S: InstructionSet<Lanes = L>>(&self, set: S, group: &Group, slack_mm: L) -> L {
        let [x, y, z] = [
            set.lanes(group.normals[0].each(f64::from)),
            set.lanes(group.normals[1].each(f64::from)),
            set.lanes(group.normals[2].each(f64::from)),
        ];
        let [xx, xy, xz, yy, yz, zz] = self.matrix;
        let along = x * self.center[0] + y * self.center[1] + z * self.center[2];
        let left = set.lanes(group.offsets.each(f64::from)) - along - slack_mm;
        let h2 = if T::IS_SPHERE {
            xx * (x * x + y * y + z * z)
        } else {
            x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + z * (zz * z)
        };
        left.lt(self.zero) | (left * left).lt(h2)
    }
}

/// Planes between two grains that are apart, to be laid when a move is made.
#[derive(Clone, Copy, Debug)]
pub(super) struct NewPlanes {
    /// Four times the group plus the lane, of the grain and of its neighbour.
    pub(super) at: u32,
    pub(super) mirror: u32,
    normal: Normal,
    offset: f32,
    other_offset: f32,
}

impl NewPlanes {
    /// Lays one of the two: the plane of the grain, or that of its neighbour.
    #[inline(always)]
    pub(super) fn lay(&self, groups: &mut Window<'_, Group>, at: u32) {
        let (group, lane) = (at as usize / LANES, at as usize % LANES);
        if at == self.at {
            groups[group].set(lane, self.normal, self.offset);
        } else {
            groups[group].set(lane, self.normal.each(|c| -c), self.other_offset);
        }
    }
}

/// What a pair turned out to be.
#[derive(Clone, Copy, Debug)]
pub(super) enum Decided {
    Apart(NewPlanes),
    /// Too close, along this unit vector from the grain to its neighbour.
    TooClose(Vector),
}

/// A gap along a normal, all times the length of it.
#[derive(Clone, Copy)]
struct Along {
    normal: Normal,
    supports: [f64; 2],
    /// Beyond the gap that the two keep.
    slack: f64,
}

impl Frame {
    /// How far a grain reaches beyond the plane of a wall that it stays behind, in mm.
    #[inline(always)]
    pub(super) fn beyond_wall<T: Turned>(&self, wall: u32, grain: &Hot<T>) -> f64 {
        let (n, o) = self.wall_plane(wall, grain.d);
        dot(grain.center, n) + grain.turned.support_mm(n) - o
    }
}

impl<S: ConvexShape> Part<'_, S> {
    /// A grain in four lanes.
    #[inline(always)]
    pub(super) fn spread<I: InstructionSet>(
        &self,
        set: I,
        i: usize,
        as_if: &Hot<S::Turned>,
    ) -> Spread<I::Lanes, S::Turned> {
        Spread::new(set, minus(as_if.center, self.cold[i].listed_center), &as_if.turned.around())
    }

    /// Whether a grain whose ellipsoid crosses a plane, or would where its offset was less by `slack_mm`, does so
    /// itself.
    #[inline(always)]
    pub(super) fn crosses_itself(
        &self,
        i: usize,
        as_if: &Hot<S::Turned>,
        group: usize,
        lane: usize,
        slack_mm: f64,
    ) -> bool {
        let planes = &self.groups[group];
        let neighbor = planes.neighbors[lane];
        if is_wall(neighbor) {
            return self.frame.beyond_wall(neighbor - WALL, as_if) > 0.0;
        }
        if S::Turned::IS_ELLIPSOID {
            return true;
        }
        let n = planes.normal(lane);
        let from_listed = minus(as_if.center, self.cold[i].listed_center);
        dot(from_listed, n) + as_if.turned.support_mm(n) > f64::from(planes.offsets[lane]) - slack_mm
    }

    /// Decides the pair of a grain's plane, where the grain is this one.
    #[inline(always)]
    pub(super) fn decide(&self, i: usize, as_if: &Hot<S::Turned>, group: usize, lane: usize) -> Decided {
        self.decide_pair(i, as_if, self.groups[group].pair(group, lane))
    }

    /// The same for a pair that may not have been laid yet.
    #[inline(always)]
    pub(super) fn decide_pair(&self, i: usize, as_if: &Hot<S::Turned>, pair: Pair) -> Decided {
        let (j, image) = self.frame.names.read(pair.neighbor);
        let other = &self.hot[j];
        let at = if self.frame.container.is_periodic {
            sum(other.center, self.frame.shift(image))
        } else {
            other.center
        };
        let r = minus(at, as_if.center);
        let gap = self.frame.gap(as_if.d, other.d);
        let mut along = along(as_if, other, r, gap, pair.normal);
        if along.slack < 0.0 {
            let n = pair.normal.each(f64::from);
            let decision = as_if.turned.decide(&other.turned, r, gap, scaled(n, 1.0 / norm(n)));
            let n = scaled(decision.normal, 1.0 / norm(decision.normal));
            if !decision.is_apart {
                return Decided::TooClose(n);
            }
            along = self::along(as_if, other, r, gap, normal(n));
            if along.slack < 0.0 {
                // The rounded normal does not show that they are apart: by s(n) of the unit vector alone.
                let (h_a, h_b) = (as_if.turned.support_mm(n), other.turned.support_back_mm(n));
                if dot(r, n) - h_a - h_b - gap < 0.0 {
                    return Decided::TooClose(n);
                }
            }
        }
        Decided::Apart(self.between(i, as_if, pair, along))
    }

    /// The planes between a grain and a neighbour that share the slack. Without any, a plane behind which one of the
    /// two is would prove nothing, for the other is not behind its own: both cross theirs wherever they are.
    #[inline(always)]
    fn between(&self, i: usize, as_if: &Hot<S::Turned>, pair: Pair, along: Along) -> NewPlanes {
        let (j, image) = self.frame.names.read(pair.neighbor);
        let (one, other) = (&self.cold[i], &self.cold[j]);
        let share = one.step / (one.step + other.step);
        let Along { normal, supports: [h_a, h_b], slack } = along;
        let n = normal.each(f64::from);
        let place = match pair.mirror {
            FAR => self.place_of(j, self.frame.names.name(i, self.frame.names.opposite(image))),
            place => u32::from(place),
        };
        let (at, mirror) = (pair.at, LANES as u32 * other.list.first + place);
        if slack < 0.0 {
            return NewPlanes { at, mirror, normal, offset: -NEVER, other_offset: -NEVER };
        }
        NewPlanes {
            at,
            mirror,
            normal,
            offset: below(dot(minus(as_if.center, one.listed_center), n) + h_a + share * slack),
            other_offset: below(
                h_b + (1.0 - share) * slack - dot(minus(self.hot[j].center, other.listed_center), n),
            ),
        }
    }

    /// Where a neighbour stands in the list of a grain.
    #[cold]
    fn place_of(&self, i: usize, neighbor: u32) -> u32 {
        let cold = &self.cold[i];
        let groups = &self.groups[cold.list.groups()];
        let place = groups.iter().flat_map(|group| group.neighbors).position(|listed| listed == neighbor);
        debug_assert!(place.is_some(), "a pair that one of its grains does not list");
        place.map_or(0, |place| place as u32)
    }

    /// The planes between a grain and a neighbour where they keep their gap; else where they push each other.
    #[inline(always)]
    pub(super) fn touch(&self, i: usize, group: usize, lane: usize) -> Result<NewPlanes, PushContact> {
        let (j, image) = self.frame.names.read(self.groups[group].neighbors[lane]);
        let (one, other) = (&self.hot[i], &self.hot[j]);
        let mut n = self.groups[group].unit(lane);
        if S::Turned::IS_ELLIPSOID {
            match self.decide(i, one, group, lane) {
                Decided::Apart(planes) => return Ok(planes),
                Decided::TooClose(too_close) => n = too_close,
            }
        }
        let r = minus(sum(other.center, self.frame.shift(image)), one.center);
        let gap = self.frame.gap(one.d, other.d);
        if !S::Turned::IS_ELLIPSOID {
            // One search finds whether polyhedra are apart and where they push.
            let along = along(one, other, r, gap, self.groups[group].stored_normal(lane));
            if along.slack >= 0.0 {
                return Ok(self.between(i, one, self.groups[group].pair(group, lane), along));
            }
        }
        let contact = one.turned.contact(&other.turned, r, gap, n, PUSH_TURNS);
        let [h_a, h_b] = contact.supports_mm;
        if !S::Turned::IS_ELLIPSOID && dot(r, contact.normal) - h_a - h_b - gap >= 0.0 {
            let along = along(one, other, r, gap, normal(contact.normal));
            return Ok(self.between(i, one, self.groups[group].pair(group, lane), along));
        }
        Err(contact)
    }

    #[inline(always)]
    pub(super) fn lay(&mut self, planes: &NewPlanes) {
        planes.lay(&mut self.groups, planes.at);
        planes.lay(&mut self.groups, planes.mirror);
    }

    /// Lays planes along this unit vector between a grain and a neighbour, wherever the two are.
    pub(super) fn lay_between(&mut self, i: usize, group: usize, lane: usize, n: Vector) {
        self.lay(&self.planes_along(i, self.groups[group].pair(group, lane), n));
    }

    /// Planes along this unit vector between a grain and a neighbour, wherever the two are.
    pub(super) fn planes_along(&self, i: usize, pair: Pair, n: Vector) -> NewPlanes {
        let (j, image) = self.frame.names.read(pair.neighbor);
        let (one, other) = (&self.hot[i], &self.hot[j]);
        let r = minus(sum(other.center, self.frame.shift(image)), one.center);
        let along = along(one, other, r, self.frame.gap(one.d, other.d), normal(n));
        self.between(i, one, pair, along)
    }

    /// Lays the plane of a wall that a grain of this diameter stays behind.
    pub(super) fn lay_wall(&mut self, i: usize, group: usize, lane: usize, d: f64) {
        let wall = self.groups[group].neighbors[lane] - WALL;
        let (n, o) = self.frame.wall_plane(wall, d);
        let offset = below(UNIT * (o - dot(self.cold[i].listed_center, n)));
        self.groups[group].set(lane, normal(n), offset);
    }
}

/// The gap of a grain and another one, whose centre lies at `r` from its own, along a normal.
#[inline(always)]
fn along<T: Turned>(one: &Hot<T>, other: &Hot<T>, r: Vector, gap: f64, normal: Normal) -> Along {
    let n = normal.each(f64::from);
    let supports = [one.turned.support_mm(n), other.turned.support_back_mm(n)];
    let slack = dot(r, n) - supports[0] - supports[1] - gap * norm(n);
    Along { normal, supports, slack }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "planes_tests.rs"]
mod tests;
