//! The grains where they are: poses, sizes, and the planes that part each from its neighbours.
//!
//! Grains keep the size that is requested, and the specimen shrinks onto them: at a scale `s` it is larger than
//! requested by `1 / s`, the stretch. That is the growth of all lengths by `s`, seen from the grains; nothing but
//! centres and planes changes with it.

use super::planes::Group;
use crate::arrays::Each as _;
use crate::cpu::Cpu;
use crate::distance::DistanceRule;
use crate::gap::grain::{ConvexShape, Orientation, Turned};
use crate::gap::linear::{Vector, dot};
use crate::memory::{OutOfMemory, collected, reserved};
use crate::request::{Boundary, Specimen};
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
    /// Factor on the skin: more than 1 for grains that were held by theirs lately.
    pub(super) margin: f64,
    /// Whether the grain was held by its skin since its list was built.
    pub(super) is_held: bool,
    /// Its planes are `groups[first..first + count]`.
    pub(super) first: u32,
    pub(super) count: u32,
    /// Whether it can come close to the lateral surface of a cylinder.
    pub(super) is_near_lateral: bool,
    /// Whether it can come close to an image of its own.
    pub(super) is_near_itself: bool,
}

/// The specimen at no stretch.
#[derive(Clone, Copy, Debug)]
pub(super) enum Container {
    Box { size: Vector },
    Periodic { size: Vector },
    Cylinder { radius: f64, height: f64 },
}

/// Images of a periodic box reach two boxes to either side, so that even a grain as wide as the box finds all of its
/// neighbours.
const IMAGES_PER_AXIS: u32 = 5;
pub(super) const IMAGES: u32 = 125;
/// The code of no shift at all.
pub(super) const HOME: u32 = 62;

impl Container {
    fn new(specimen: &Specimen) -> Self {
        match *specimen {
            Specimen::Box { size_mm: size, boundary: Boundary::Walls } => Self::Box { size },
            Specimen::Box { size_mm: size, boundary: Boundary::Periodic } => Self::Periodic { size },
            Specimen::Cylinder { diameter_mm, height_mm } => {
                Self::Cylinder { radius: diameter_mm / 2.0, height: height_mm }
            }
        }
    }

    pub(super) fn is_periodic(&self) -> bool {
        matches!(self, Self::Periodic { .. })
    }

    pub(super) fn bounds(&self) -> Vector {
        match *self {
            Self::Box { size } | Self::Periodic { size } => size,
            Self::Cylinder { radius, height } => [2.0 * radius, 2.0 * radius, height],
        }
    }

    /// The axes with a pair of plane walls.
    pub(super) fn walled_axes(&self) -> std::ops::Range<usize> {
        match self {
            Self::Box { .. } => 0..3,
            Self::Periodic { .. } => 0..0,
            Self::Cylinder { .. } => 2..3,
        }
    }

    /// The offset of an image at no stretch.
    #[inline(always)]
    pub(super) fn shift(&self, image: u32) -> Vector {
        let size = self.bounds();
        let steps =
            |divisor: u32| f64::from((image / divisor % IMAGES_PER_AXIS) as i32 - IMAGES_PER_AXIS as i32 / 2);
        [
            steps(IMAGES_PER_AXIS * IMAGES_PER_AXIS) * size[0],
            steps(IMAGES_PER_AXIS) * size[1],
            steps(1) * size[2],
        ]
    }
}

/// The code of the opposite image.
pub(super) fn opposite(image: u32) -> u32 {
    IMAGES - 1 - image
}

/// The grains of a run.
#[derive(Clone, Debug)]
pub(super) struct System<S: ConvexShape> {
    pub(super) cpu: Cpu,
    pub(super) container: Container,
    /// Size of the specimen over the requested one.
    pub(super) stretch: f64,
    pub(super) rule: DistanceRule,
    /// Gap beyond the rule's, and the share of it that is kept to walls.
    pub(super) more: f64,
    pub(super) wall_share: f64,
    pub(super) hot: Vec<Hot<S::Turned>>,
    pub(super) cold: Vec<Cold<S>>,
    /// Which shape stands at each site.
    pub(super) rank: Vec<u32>,
    pub(super) groups: Vec<Group>,
    /// Displacements that were not made, for they would have led out of a skin.
    pub(super) held: u64,
}

impl<S: ConvexShape> System<S> {
    /// Grains at poses in the specimen at its requested size.
    pub(super) fn new(
        specimen: &Specimen,
        rule: DistanceRule,
        shapes: &[S],
        poses: &[Pose],
    ) -> Result<Self, OutOfMemory> {
        let order = along_a_curve(poses, specimen.bounds_mm())?;
        let mut hot = reserved(shapes.len())?;
        let mut cold = reserved(shapes.len())?;
        for &rank in &order {
            let (shape, pose) = (&shapes[rank as usize], &poses[rank as usize]);
            let q = pose.orientation.quaternion();
            let orientation = shape.to_principal([q.w, q.i, q.j, q.k]);
            let center = pose.center_mm.into();
            let d = shape.equivalent_diameter_mm();
            hot.push(Hot { center, turned: shape.turned(&rotation(orientation)), d });
            cold.push(Cold {
                orientation,
                shape: *shape,
                step: 0.1 * d,
                listed_center: center,
                listed_orientation: orientation,
                skin: 0.0,
                margin: 1.0,
                is_held: false,
                first: 0,
                count: 0,
                is_near_lateral: false,
                is_near_itself: false,
            });
        }
        Ok(Self {
            cpu: Cpu::detect(),
            container: Container::new(specimen),
            stretch: 1.0,
            rule,
            more: 0.0,
            wall_share: 0.0,
            hot,
            cold,
            rank: collected(order.iter().copied())?,
            groups: Vec::new(),
            held: 0,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.hot.len()
    }

    /// The gap of two grains of these diameters.
    #[inline(always)]
    pub(super) fn gap(&self, d_i: f64, d_j: f64) -> f64 {
        self.rule.gap_mm(d_i, d_j) + self.more
    }

    #[inline(always)]
    pub(super) fn wall_gap(&self, d: f64) -> f64 {
        self.rule.wall_gap_mm(d) + self.wall_share * self.more
    }

    /// The offset of an image at the present stretch.
    #[inline(always)]
    pub(super) fn shift(&self, image: u32) -> Vector {
        self.container.shift(image).each(|x| x * self.stretch)
    }

    /// Puts a grain elsewhere.
    #[inline(always)]
    pub(super) fn set_pose(&mut self, i: usize, center: Vector, orientation: Orientation, turned: S::Turned) {
        self.hot[i].center = center;
        self.hot[i].turned = turned;
        self.cold[i].orientation = orientation;
    }

    /// How far a pose has come out of where the list of a grain was built: the displacement, and what the rotation adds
    /// to the support function.
    #[inline(always)]
    pub(super) fn skin_used(&self, i: usize, center: Vector, q: Orientation) -> f64 {
        let cold = &self.cold[i];
        let x = [0, 1, 2].each(|a| center[a] - cold.listed_center[a]);
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
        let Container::Cylinder { radius, .. } = self.container else { return (f64::INFINITY, [0.0; 3]) };
        let axis = radius * self.stretch;
        let (reach, n) = hot.turned.reach_across_mm([hot.center[0] - axis, hot.center[1] - axis]);
        (axis - self.wall_gap(hot.d) - reach, n)
    }

    /// Whether a grain of a periodic box keeps its gap to its own images.
    pub(super) fn clears_itself(&self, hot: &Hot<S::Turned>) -> bool {
        let gap = self.gap(hot.d, hot.d);
        // One of each pair of opposite images.
        (HOME + 1..IMAGES).all(|image| {
            let r = self.shift(image);
            hot.turned.decide(&hot.turned, r, gap, r).is_apart
        })
    }

    /// Brings centres back into a periodic box.
    pub(super) fn wrap(&mut self) {
        if !self.container.is_periodic() {
            return;
        }
        let size = self.container.bounds().each(|length| length * self.stretch);
        for hot in &mut self.hot {
            for (x, length) in hot.center.iter_mut().zip(size) {
                let wrapped = *x - length * (*x / length).floor();
                *x = if wrapped < length { wrapped } else { 0.0 };
            }
        }
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
pub(super) fn turned(q: Orientation, by: Vector) -> Orientation {
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

/// The order of the grains along a curve through the specimen, so that neighbours are neighbours in memory.
fn along_a_curve(poses: &[Pose], bounds: Vector) -> Result<Vec<u32>, OutOfMemory> {
    let code = |pose: &Pose| {
        let mut code = 0_u64;
        for (axis, length) in bounds.into_iter().enumerate() {
            let cell = (pose.center_mm[axis] / length * 1024.0).clamp(0.0, 1023.0) as u64;
            for bit in 0..10 {
                code |= (cell >> bit & 1) << (3 * bit + axis);
            }
        }
        code
    };
    let mut keyed: Vec<(u64, u32)> = reserved(poses.len())?;
    keyed.extend(poses.iter().enumerate().map(|(rank, pose)| (code(pose), rank as u32)));
    keyed.sort_unstable();
    collected(keyed.iter().map(|(_, rank)| *rank))
}
