//! The grains where they are: poses, sizes, and the planes that part each from its neighbours.
//!
//! Grains keep the size that is requested, and the specimen shrinks onto them: at a scale `s` it is larger than
//! requested by `1 / s`, the stretch. That is the growth of all lengths by `s`, seen from the grains; nothing but
//! centres and planes changes with it.

use std::num::NonZeroUsize;
use std::ops::Range;

use super::group::Group;
use super::halves::Halves;
use super::window::Window;
use crate::arrays::Each as _;
use crate::cpu::Cpu;
use crate::distance::DistanceRule;
use crate::domain::{Domain, Face, FacePlane, MOST_FACES};
use crate::gap::grain::{ConvexShape, Orientation, Turned};
use crate::gap::linear::{Vector, dot};
use crate::geometry::images::Images;
use crate::memory::{Blocks, OutOfMemory, collected, reserved};
use crate::methods::image_names::ImageNames;
use crate::methods::morton;
use crate::shape::Pose;

/// What a pair test reads of a grain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hot<T> {
    pub(super) center: Vector,
    pub(super) turned: T,
    /// Equivalent diameter.
    pub(super) d: f64,
}

/// The rest of a grain. Lengths are in mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cold<S> {
    /// That of the principal axes.
    pub(super) orientation: Orientation,
    pub(super) shape: S,
    /// Largest step of a move along each axis.
    pub(super) step: f64,
    /// Where the list was built.
    pub(super) listed_center: Vector,
    pub(super) listed_orientation: Orientation,
    /// How far the grain may come out of where its list was built.
    pub(super) skin: f64,
    pub(super) list: List,
}

/// The planes of a grain, as groups of the system, and what is marked for it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct List {
    pub(super) first: u32,
    /// The number of groups above four marks: a word of their own would be eight bytes of a grain.
    count_and_marks: u32,
}

impl List {
    const MARKS: u32 = 4;
    const LEFT_SKIN: u32 = 1;
    const IS_NEAR_LATERAL: u32 = 2;
    const IS_NEAR_ITSELF: u32 = 4;
    const IS_MOVED: u32 = 8;

    const ALL: u32 = (1 << Self::MARKS) - 1;

    /// Makes it a list of `count` groups. What is marked stays.
    pub(super) fn set_groups(&mut self, first: usize, count: usize) {
        debug_assert!(count < 1 << (u32::BITS - Self::MARKS));
        self.first = first as u32;
        self.count_and_marks = (count as u32) << Self::MARKS | self.count_and_marks & Self::ALL;
    }

    #[inline(always)]
    pub(super) fn groups(self) -> Range<usize> {
        let first = self.first as usize;
        first..first + (self.count_and_marks >> Self::MARKS) as usize
    }

    /// Whether a displacement out of the skin of the grain was refused since the list was built.
    pub(super) fn left_skin(self) -> bool {
        self.count_and_marks & Self::LEFT_SKIN != 0
    }

    pub(super) fn mark_left_skin(&mut self, left_skin: bool) {
        self.mark(Self::LEFT_SKIN, left_skin);
    }

    /// Whether the grain can come close to the lateral surface of a cylinder.
    #[inline(always)]
    pub(super) fn is_near_lateral(self) -> bool {
        self.count_and_marks & Self::IS_NEAR_LATERAL != 0
    }

    /// Whether the grain can come close to an image of its own.
    #[inline(always)]
    pub(super) fn is_near_itself(self) -> bool {
        self.count_and_marks & Self::IS_NEAR_ITSELF != 0
    }

    pub(super) fn mark_near(&mut self, lateral: bool, itself: bool) {
        self.mark(Self::IS_NEAR_LATERAL, lateral);
        self.mark(Self::IS_NEAR_ITSELF, itself);
    }

    /// Whether a push has moved the grain, so that its pose before is kept.
    #[inline(always)]
    pub(super) fn is_moved(self) -> bool {
        self.count_and_marks & Self::IS_MOVED != 0
    }

    #[inline(always)]
    pub(super) fn mark_moved(&mut self, is_moved: bool) {
        self.mark(Self::IS_MOVED, is_moved);
    }

    #[inline(always)]
    fn mark(&mut self, mark: u32, is_set: bool) {
        self.count_and_marks = self.count_and_marks & !mark | if is_set { mark } else { 0 };
    }
}

/// The domain at no stretch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Container {
    /// Edge lengths of the bounding box.
    pub(super) bounds: Vector,
    /// Whether the domain repeats with them.
    pub(super) is_periodic: bool,
    /// The plane walls, with their inward normals.
    walls: [Option<FacePlane>; MOST_FACES],
    /// Radius of the lateral surface of a cylinder, whose axis is at x = y = radius.
    pub(super) lateral: Option<f64>,
}

impl Container {
    fn new(domain: &Domain) -> Self {
        let mut walls = [None; MOST_FACES];
        let planes = domain.walls().filter_map(|wall| match wall {
            Face::Plane(plane) => Some(plane),
            Face::Lateral(_) => None,
        });
        for (place, plane) in walls.iter_mut().zip(planes) {
            *place = Some(plane);
        }
        Self {
            bounds: domain.bounds_mm,
            is_periodic: !domain.has_walls(),
            walls,
            lateral: domain.lateral().map(|lateral| lateral.radius_mm),
        }
    }

    /// The numbers of the plane walls.
    pub(super) fn walls(&self) -> Range<u32> {
        0..self.walls.iter().flatten().count() as u32
    }

    /// The inward normal of a plane wall, and its distance from the origin along it.
    #[inline(always)]
    pub(super) fn wall(&self, wall: u32) -> (Vector, f64) {
        self.walls[wall as usize].map_or(([0.0; 3], 0.0), |plane| (plane.normal.into(), plane.offset_mm))
    }
}

/// What all grains share.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    pub(super) cpu: Cpu,
    pub(super) container: Container,
    /// The images of the specimen at no stretch; those that the lists name; and those in which a grain can come close
    /// to itself, one of each two opposite ones from the nearest on, by offset and distance.
    pub(super) images: Images,
    pub(super) names: ImageNames,
    pub(super) own_images: Vec<(Vector, f64)>,
    /// Size of the specimen over the requested one.
    pub(super) stretch: f64,
    pub(super) rule: DistanceRule,
    /// Gap beyond the rule's, and the share of it that is kept to walls.
    pub(super) extra_gap: f64,
    pub(super) wall_share: f64,
}

impl Frame {
    /// The gap of two grains of these diameters.
    #[inline(always)]
    pub(super) fn gap(&self, d_i: f64, d_j: f64) -> f64 {
        self.rule.gap_mm(d_i, d_j) + self.extra_gap
    }

    #[inline(always)]
    pub(super) fn wall_gap(&self, d: f64) -> f64 {
        self.rule.wall_gap_mm(d) + self.wall_share * self.extra_gap
    }

    /// The plane of a wall that a grain of this diameter stays behind: its outward normal and offset.
    pub(super) fn wall_plane(&self, wall: u32, d: f64) -> (Vector, f64) {
        let (inward, offset) = self.container.wall(wall);
        (inward.each(|x| -x), -offset * self.stretch - self.wall_gap(d))
    }

    /// The offset of an image at the present stretch.
    #[inline(always)]
    pub(super) fn shift(&self, image: u32) -> Vector {
        self.names.offset_mm(image).each(|x| x * self.stretch)
    }
}

/// The grains of a run.
#[derive(Clone, Debug)]
pub(super) struct System<S: ConvexShape> {
    pub(super) frame: Frame,
    /// Most threads that share the work; nothing depends on their number.
    pub(super) threads: NonZeroUsize,
    /// Which grains can be moved at the same time.
    pub(super) halves: Halves,
    pub(super) hot: Vec<Hot<S::Turned>>,
    pub(super) cold: Vec<Cold<S>>,
    /// Which shape stands at each site.
    pub(super) rank: Vec<u32>,
    pub(super) groups: Vec<Group>,
    /// Displacements that were not made, for they would have led out of a skin.
    pub(super) skins_left: u64,
    /// The poses that grains had before a push displaced them, by leaf, with room for all grains while one does; of
    /// other grains it changes the scale alone.
    pub(super) moved: Vec<Blocks<Moved>>,
}

/// Grains of a system that one thread reads and writes, by their sites in the system, with their planes.
#[derive(Debug)]
pub(super) struct Part<'a, S: ConvexShape> {
    pub(super) frame: &'a Frame,
    pub(super) halves: &'a Halves,
    pub(super) hot: Window<'a, Hot<S::Turned>>,
    pub(super) cold: Window<'a, Cold<S>>,
    pub(super) rank: Window<'a, u32>,
    pub(super) groups: Window<'a, Group>,
    pub(super) moved: Window<'a, Blocks<Moved>>,
    /// In a push, the grains that look at their neighbours in this sweep, and in the next one.
    pub(super) active: Window<'a, bool>,
    pub(super) next: Window<'a, bool>,
    /// As in the system, since the part was made.
    pub(super) skins_left: u64,
}

/// The pose that a grain had.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    pub(super) site: u32,
    /// At the present scale.
    pub(super) center: Vector,
    pub(super) orientation: Orientation,
}

impl<S: ConvexShape> System<S> {
    /// Grains at poses in the specimen at its requested size. The memory of the poses is freed before the derived
    /// arrays are allocated, which lowers the peak.
    pub(super) fn new(
        domain: &Domain,
        rule: DistanceRule,
        shapes: &[S],
        poses: Vec<Pose>,
    ) -> Result<Self, OutOfMemory> {
        let relative = |pose: &Pose| [0, 1, 2].each(|axis| pose.center_mm[axis] / domain.bounds_mm[axis]);
        let rank = morton::order(poses.iter().map(relative))?;
        let mut cold: Vec<Cold<S>> = reserved(shapes.len())?;
        for &rank in &rank {
            let (shape, pose) = (&shapes[rank as usize], &poses[rank as usize]);
            let q = pose.orientation.quaternion();
            let orientation = shape.to_principal([q.w, q.i, q.j, q.k]);
            let center = pose.center_mm.into();
            let d = shape.equivalent_diameter_mm();
            cold.push(Cold {
                orientation,
                shape: *shape,
                step: 0.1 * d,
                listed_center: center,
                listed_orientation: orientation,
                skin: 0.0,
                list: List::default(),
            });
        }
        drop(poses);
        let hot = collected(cold.iter().map(|cold| Hot {
            center: cold.listed_center,
            turned: cold.shape.turned(&rotation(cold.orientation)),
            d: cold.shape.equivalent_diameter_mm(),
        }))?;
        let frame = Frame {
            cpu: Cpu::detect(),
            container: Container::new(domain),
            images: Images::new(domain),
            names: ImageNames::new(&Images::new(domain), 0.0)?,
            own_images: Vec::new(),
            stretch: 1.0,
            rule,
            extra_gap: 0.0,
            wall_share: 0.0,
        };
        Ok(Self {
            frame,
            threads: NonZeroUsize::MIN,
            halves: Halves::new(hot.len()),
            hot,
            cold,
            rank,
            groups: Vec::new(),
            skins_left: 0,
            moved: Vec::new(),
        })
    }

    pub(super) fn len(&self) -> usize {
        self.hot.len()
    }

    /// All grains.
    pub(super) fn part(&mut self) -> Part<'_, S> {
        Part {
            frame: &self.frame,
            halves: &self.halves,
            hot: Window::whole(&mut self.hot),
            cold: Window::whole(&mut self.cold),
            rank: Window::whole(&mut self.rank),
            groups: Window::whole(&mut self.groups),
            moved: Window::whole(&mut self.moved),
            active: Window::whole(&mut []),
            next: Window::whole(&mut []),
            skins_left: 0,
        }
    }

    /// Makes the images that pairs need whose centres are less than `reach` apart, until the specimen has shrunk by
    /// `shrink`.
    ///
    /// # Errors
    /// When the system refuses memory, or the grains are more than can be named beside their images.
    pub(super) fn name_images(&mut self, reach: f64, shrink: f64) -> Result<(), OutOfMemory> {
        let reach = reach * shrink / self.frame.stretch;
        self.frame.names = ImageNames::new(&self.frame.images, reach)?;
        if self.len() as u64 > self.frame.names.grains() {
            return Err(OutOfMemory { bytes: self.len() as u64 * 8 });
        }
        let own = self.frame.images.of_itself(reach)?;
        self.frame.own_images =
            collected(own.iter().map(|image| (image.offset_mm.into(), image.offset_mm.norm())))?;
        Ok(())
    }

    /// Brings centres back into a periodic box.
    pub(super) fn wrap(&mut self) {
        if !self.frame.container.is_periodic {
            return;
        }
        let size = self.frame.container.bounds.each(|length| length * self.frame.stretch);
        for hot in &mut self.hot {
            for (x, length) in hot.center.iter_mut().zip(size) {
                let wrapped = *x - length * (*x / length).floor();
                *x = if wrapped < length { wrapped } else { 0.0 };
            }
        }
    }
}

impl<S: ConvexShape> Part<'_, S> {
    /// The same grains in two parts, cut before a leaf.
    pub(super) fn split(&mut self, leaf: usize) -> [Part<'_, S>; 2] {
        let (site, _) = self.halves.leaf(leaf);
        // Lists lie in the order of the sites.
        let group = self.cold[site].list.groups().start;
        let (frame, halves, skins_left) = (self.frame, self.halves, 0);
        let [hot, hot_above] = self.hot.split(site);
        let [cold, cold_above] = self.cold.split(site);
        let [rank, rank_above] = self.rank.split(site);
        let [groups, groups_above] = self.groups.split(group);
        let [moved, moved_above] = self.moved.split(leaf);
        let [active, active_above] = self.active.split(site);
        let [next, next_above] = self.next.split(site);
        [
            Part { frame, halves, hot, cold, rank, groups, moved, active, next, skins_left },
            Part {
                frame,
                halves,
                hot: hot_above,
                cold: cold_above,
                rank: rank_above,
                groups: groups_above,
                moved: moved_above,
                active: active_above,
                next: next_above,
                skins_left,
            },
        ]
    }

    /// Puts a grain elsewhere.
    #[inline(always)]
    pub(super) fn set_pose(&mut self, i: usize, center: Vector, orientation: Orientation, turned: S::Turned) {
        self.hot[i].center = center;
        self.hot[i].turned = turned;
        self.cold[i].orientation = orientation;
    }

    /// The orientation of a grain turned by a small rotation vector. Of a sphere it stays.
    #[inline(always)]
    pub(super) fn turned(&self, i: usize, by: Vector) -> Orientation {
        let orientation = self.cold[i].orientation;
        if self.hot[i].turned.is_sphere() { orientation } else { turned(orientation, by) }
    }

    /// How far a pose has come out of where the list of a grain was built: the displacement, and what the rotation adds
    /// to the support function.
    #[inline(always)]
    pub(super) fn skin_used(&self, i: usize, center: Vector, q: Orientation) -> f64 {
        let cold = &self.cold[i];
        let x = [0, 1, 2].each(|a| center[a] - cold.listed_center[a]);
        if self.hot[i].turned.is_sphere() {
            return dot(x, x).sqrt();
        }
        let p = cold.listed_orientation;
        let cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
        let sine2 = (1.0 - cosine * cosine).max(0.0);
        // Twice the sine of half the angle; the angle is longer by less than a twentieth of its square, up to 1.
        let chord = 2.0 * sine2.sqrt();
        let angle = chord * (1.0 + 0.05 * chord * chord);
        dot(x, x).sqrt() + cold.shape.change_mm(angle)
    }

    /// By how much more than its gap a grain keeps from the lateral surface of a cylinder, and the direction in which
    /// it comes closest to it.
    pub(super) fn lateral_slack(&self, hot: &Hot<S::Turned>) -> (f64, Vector) {
        let Some(radius) = self.frame.container.lateral else { return (f64::INFINITY, [0.0; 3]) };
        let axis = radius * self.frame.stretch;
        let (reach, n) = hot.turned.reach_across_mm([hot.center[0] - axis, hot.center[1] - axis]);
        (axis - self.frame.wall_gap(hot.d) - reach, n)
    }
}

/// The rotation of a quaternion, by rows.
#[inline(always)]
pub(super) fn rotation(q: Orientation) -> [Vector; 3] {
    let [w, x, y, z] = q;
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// The quaternion turned by a small rotation vector, to first order, and made a unit again.
#[inline(always)]
fn turned(q: Orientation, by: Vector) -> Orientation {
    let [x, y, z] = by.each(|angle| 0.5 * angle);
    let p = [
        q[0] - x * q[1] - y * q[2] - z * q[3],
        q[1] + x * q[0] + y * q[3] - z * q[2],
        q[2] - x * q[3] + y * q[0] + z * q[1],
        q[3] + x * q[2] - y * q[1] + z * q[0],
    ];
    let inverse = 1.0 / (p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3]).sqrt();
    p.each(|c| c * inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_keeps_its_marks_and_its_groups_apart() {
        let mut list = List::default();
        list.mark_left_skin(true);
        list.mark_near(false, true);
        list.set_groups(7, 70_000);
        assert_eq!((list.groups(), list.left_skin(), list.is_moved()), (7..70_007, true, false));
        list.mark_moved(true);
        list.mark_left_skin(false);
        list.mark_near(true, false);
        assert_eq!((list.groups(), list.left_skin(), list.is_moved()), (7..70_007, false, true));
        assert!(list.is_near_lateral() && !list.is_near_itself());
    }
}
