//! What holds the grains: plane walls, the lateral surface of a cylinder, or the images of a periodic box.

use super::contact::{rises_to_zero, used_up};
use crate::arrays::{self, Each as _};
use crate::domain::Lateral;
use crate::geometry::images::Images;
use crate::request::Specimen;

/// Images of a periodic box reach two boxes to either side, so that even a grain as wide as the box
/// finds all of its neighbours: a plan refuses wider ones.
const IMAGES_PER_AXIS: i32 = 5;
/// Number of images.
pub(crate) const IMAGES: usize = 125;
/// The code of no shift at all.
pub(crate) const HOME: u32 = 62;

/// The specimen as the dynamics see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Container {
    Box {
        size_mm: [f64; 3],
    },
    Periodic {
        size_mm: [f64; 3],
    },
    Cylinder {
        radius_mm: f64,
        height_mm: f64,
    },
    /// A part of a specimen between planes. Where the specimen is a cylinder, with the place of its axis and its
    /// radius.
    Block {
        size_mm: [f64; 3],
        lateral: Option<[f64; 3]>,
    },
}

/// Number of the lateral wall in a block of a cylinder.
const LATERAL: u32 = 6;

impl Container {
    pub(crate) fn new(specimen: &Specimen) -> Self {
        let domain = specimen.domain();
        let size_mm = domain.bounds_mm;
        match domain.lateral() {
            Some(Lateral { radius_mm, .. }) => Self::Cylinder { radius_mm, height_mm: size_mm[2] },
            None if domain.has_walls() => Self::Box { size_mm },
            None => Self::Periodic { size_mm },
        }
    }

    #[inline(always)]
    pub(crate) fn bounds_mm(&self) -> [f64; 3] {
        match *self {
            Self::Box { size_mm } | Self::Periodic { size_mm } | Self::Block { size_mm, .. } => size_mm,
            Self::Cylinder { radius_mm, height_mm } => [2.0 * radius_mm, 2.0 * radius_mm, height_mm],
        }
    }

    #[inline(always)]
    pub(crate) fn is_periodic(&self) -> bool {
        matches!(self, Self::Periodic { .. })
    }

    /// What to add to a position for each image code: the images of a reach between one and two edges.
    pub(crate) fn shifts(&self) -> [[f64; 3]; IMAGES] {
        let size = self.bounds_mm();
        let (middle, half) = (size.each(|length| length / 2.0), size.each(|length| 2.25 * length));
        let mut shifts = [[0.0; 3]; IMAGES];
        for image in Images::of_box(size, true).meeting_box(middle, half) {
            shifts[image_code(image.steps) as usize] = image.offset_mm.into();
        }
        shifts
    }

    /// Brings a position back into the box.
    #[inline(always)]
    pub(crate) fn wrap(&self, p: [f64; 3]) -> [f64; 3] {
        match *self {
            Self::Periodic { size_mm } => arrays::from_fn(|a| {
                let wrapped = p[a] - size_mm[a] * (p[a] / size_mm[a]).floor();
                if wrapped < size_mm[a] { wrapped } else { 0.0 }
            }),
            _ => p,
        }
    }

    /// The walls that come within `distance_mm` of a point, as bits.
    #[inline(always)]
    pub(crate) fn walls_within(&self, p: [f64; 3], distance_mm: f64) -> u32 {
        let ends = |axes: std::ops::Range<usize>, size: [f64; 3]| {
            axes.fold(0, |mask, a| {
                let low = u32::from(p[a] < distance_mm) << (2 * a);
                let high = u32::from(p[a] > size[a] - distance_mm) << (2 * a + 1);
                mask | low | high
            })
        };
        match *self {
            Self::Periodic { .. } => 0,
            Self::Box { size_mm } => ends(0..3, size_mm),
            Self::Block { size_mm, lateral } => {
                let planes = ends(0..3, size_mm);
                let Some([axis_x, axis_y, radius_mm]) = lateral else { return planes };
                let is_near = is_near_lateral([p[0] - axis_x, p[1] - axis_y], radius_mm, distance_mm);
                planes | u32::from(is_near) << LATERAL
            }
            Self::Cylinder { radius_mm, height_mm } => {
                let is_near = is_near_lateral([p[0] - radius_mm, p[1] - radius_mm], radius_mm, distance_mm);
                u32::from(is_near) | ends(2..3, [0.0, 0.0, height_mm])
            }
        }
    }

    /// When a grain at `p` with velocity `v` touches a wall, from now; `contact` is the distance at
    /// which it does now, growing at `rate`.
    #[inline(always)]
    pub(crate) fn time_to_wall(&self, wall: u32, p: [f64; 3], v: [f64; 3], contact: f64, rate: f64) -> f64 {
        let axis = (wall / 2) as usize;
        match *self {
            Self::Cylinder { radius_mm, .. } if wall == 0 => {
                time_to_lateral([p[0] - radius_mm, p[1] - radius_mm], radius_mm, v, contact, rate)
            }
            Self::Block { lateral: Some([x, y, radius_mm]), .. } if wall == LATERAL => {
                time_to_lateral([p[0] - x, p[1] - y], radius_mm, v, contact, rate)
            }
            _ if wall.is_multiple_of(2) => used_up(p[axis] - contact, v[axis] - rate),
            _ => used_up(self.bounds_mm()[axis] - p[axis] - contact, -v[axis] - rate),
        }
    }

    /// The inward normal of a wall at a point, and the point's distance from it.
    #[inline(always)]
    pub(crate) fn wall_normal(&self, wall: u32, p: [f64; 3]) -> ([f64; 3], f64) {
        let axis = (wall / 2) as usize;
        let mut normal = [0.0; 3];
        match *self {
            Self::Cylinder { radius_mm, .. } if wall == 0 => {
                lateral_normal([p[0] - radius_mm, p[1] - radius_mm], radius_mm)
            }
            Self::Block { lateral: Some([x, y, radius_mm]), .. } if wall == LATERAL => {
                lateral_normal([p[0] - x, p[1] - y], radius_mm)
            }
            _ if wall.is_multiple_of(2) => {
                normal[axis] = 1.0;
                (normal, p[axis])
            }
            _ => {
                normal[axis] = -1.0;
                (normal, self.bounds_mm()[axis] - p[axis])
            }
        }
    }
}

/// Whether the lateral surface of a cylinder comes within a distance of a point beside the axis.
#[inline(always)]
fn is_near_lateral([x, y]: [f64; 2], radius_mm: f64, distance_mm: f64) -> bool {
    let bound = radius_mm - distance_mm;
    bound <= 0.0 || x * x + y * y > bound * bound
}

/// When a grain beside the axis of a cylinder touches the lateral surface.
#[inline(always)]
fn time_to_lateral([x, y]: [f64; 2], radius_mm: f64, v: [f64; 3], contact: f64, rate: f64) -> f64 {
    let bound = radius_mm - contact;
    if bound <= 0.0 {
        return 0.0;
    }
    let c = x * x + y * y - bound * bound;
    let b = x * v[0] + y * v[1] + bound * rate;
    let a = v[0] * v[0] + v[1] * v[1] - rate * rate;
    // The room across vanishes after `bound / rate`; that bounds a double root which rounding has made none.
    let at_last = if rate > 0.0 { bound / rate } else { f64::INFINITY };
    rises_to_zero(a, b, c).min(at_last)
}

/// The inward normal of the lateral surface at a point beside the axis, and the point's distance from the surface.
#[inline(always)]
fn lateral_normal([x, y]: [f64; 2], radius_mm: f64) -> ([f64; 3], f64) {
    let distance = (x * x + y * y).sqrt();
    let normal = if distance > 0.0 { [-x / distance, -y / distance, 0.0] } else { [0.0; 3] };
    (normal, radius_mm - distance)
}

/// The code of an image, counted in boxes along each axis.
#[inline(always)]
pub(crate) fn image_code(image: [i32; 3]) -> u32 {
    let at = |i: i32| (i + IMAGES_PER_AXIS / 2) as u32;
    (at(image[0]) * IMAGES_PER_AXIS as u32 + at(image[1])) * IMAGES_PER_AXIS as u32 + at(image[2])
}

/// The image in which the first sees the second, turned into that in which the second sees the first.
#[inline(always)]
pub(crate) fn mirrored(code: u32) -> u32 {
    2 * HOME - code
}
