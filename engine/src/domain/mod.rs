//! Domains: the region that whole grains lie in, by its faces and its periods.
//!
//! A request names a kind of specimen; each kind has a file here that states its faces, and a line in
//! [`Specimen::domain`]. The modules above, but for the check, ask the domain for the property that matters and do not
//! know the kind: the distance to a wall, whether a face is curved, the period along an axis. A test of the layers
//! holds this.

mod cuboid;
mod cylinder;
mod polytope;
mod region;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use nalgebra::Vector3;
pub use polytope::PolytopeError;
pub use region::Region;
use serde::{Deserialize, Serialize};

use crate::elementary::hypot;
use crate::request::Specimen;

/// Most faces of a domain.
pub const MOST_FACES: usize = 8;

impl Specimen {
    /// The region that it stands for.
    #[must_use]
    #[inline]
    pub fn domain(&self) -> Domain {
        match *self {
            Self::Box { size_mm, boundary } => cuboid::domain(size_mm, boundary),
            Self::Cylinder { diameter_mm, height_mm } => cylinder::domain(diameter_mm, height_mm),
        }
    }

    /// [`Domain::volume_mm3`].
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        self.domain().volume_mm3
    }

    /// [`Domain::bounds_mm`].
    #[must_use]
    pub fn bounds_mm(&self) -> [f64; 3] {
        self.domain().bounds_mm
    }

    /// [`Domain::is_periodic`].
    #[must_use]
    pub fn is_periodic(&self) -> bool {
        self.domain().is_periodic()
    }

    /// [`Domain::clearance_reaching_all`].
    #[must_use]
    pub fn clearance_reaching_all(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        self.domain().clearance_reaching_all(center, half)
    }

    /// [`Domain::center_region`].
    #[must_use]
    pub fn center_region(&self, clearance_mm: f64) -> Option<Region> {
        self.domain().center_region(clearance_mm)
    }
}

impl From<&Specimen> for Domain {
    fn from(specimen: &Specimen) -> Self {
        specimen.domain()
    }
}

impl From<&Domain> for Domain {
    fn from(domain: &Domain) -> Self {
        *domain
    }
}

/// A region of space, in a bounding box that starts at the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Domain {
    /// Edge lengths of the bounding box.
    pub bounds_mm: [f64; 3],
    /// The length after which the domain repeats along each axis; `None` where it does not.
    pub periods_mm: [Option<f64>; 3],
    /// Names of the faces, in their order.
    pub face_names: &'static [&'static str],
    faces: [Option<Face>; MOST_FACES],
    /// Whether plane faces lie across an axis at both ends of the bounding box.
    pairs: [bool; 3],
    /// Whether there are other plane faces.
    has_oblique: bool,
    /// Volume.
    pub volume_mm3: f64,
    /// Area of all faces, those through which the domain repeats among them.
    pub surface_mm2: f64,
}

/// A face of a domain. It is a wall unless the domain repeats through it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Face {
    /// A plane face.
    Plane(FacePlane),
    /// The inside of a cylinder with its axis along z.
    Lateral(Lateral),
}

/// A plane face: the points `p` with `normal · p = offset_mm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FacePlane {
    /// The inward normal, a unit vector.
    pub normal: Vector3<f64>,
    /// Distance of the face from the origin along the normal.
    pub offset_mm: f64,
}

/// The lateral surface of a cylinder with its axis along z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lateral {
    /// Where the axis stands in x and y.
    pub center_mm: [f64; 2],
    /// Radius of the cylinder.
    pub radius_mm: f64,
}

/// The part of a plane across an axis inside the specimen. Of the other two axes, in the order x, y, z, u is the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Outline {
    /// Of a box, or of a cylinder along its axis.
    Rectangle {
        /// From and to.
        u_mm: [f64; 2],
        /// From and to.
        v_mm: [f64; 2],
    },
    /// Of a cylinder across its axis.
    Disc {
        /// Its centre, u and v.
        center_mm: [f64; 2],
        /// Its radius.
        radius_mm: f64,
    },
}

impl Outline {
    /// Its area.
    pub fn area_mm2(&self) -> f64 {
        match *self {
            Self::Rectangle { u_mm: [u0, u1], v_mm: [v0, v1] } => (u1 - u0) * (v1 - v0),
            Self::Disc { radius_mm, .. } => PI * radius_mm * radius_mm,
        }
    }

    /// The rectangle around it, from and to along u and v.
    pub fn bounds_mm(&self) -> [[f64; 2]; 2] {
        match *self {
            Self::Rectangle { u_mm, v_mm } => [u_mm, v_mm],
            Self::Disc { center_mm, radius_mm } => center_mm.map(|c| [c - radius_mm, c + radius_mm]),
        }
    }
}

impl Domain {
    /// Whether it repeats in all directions.
    #[must_use]
    pub fn is_periodic(&self) -> bool {
        self.periods_mm.iter().all(Option::is_some)
    }

    /// Its faces, in the order of their names.
    pub fn faces(&self) -> impl Iterator<Item = Face> + use<> {
        self.faces.into_iter().flatten()
    }

    /// The faces that hold grains back.
    pub fn walls(&self) -> impl Iterator<Item = Face> + use<> {
        let periods_mm = self.periods_mm;
        self.faces().filter(move |face| match face {
            Face::Plane(plane) => plane.across().is_none_or(|(axis, _)| periods_mm[axis].is_none()),
            Face::Lateral(_) => true,
        })
    }

    /// Whether there is any wall.
    #[must_use]
    pub fn has_walls(&self) -> bool {
        self.walls().next().is_some()
    }

    /// The axes with a pair of plane walls at the ends of the bounding box, in ascending order.
    pub fn walled_axes(&self) -> impl Iterator<Item = usize> + use<> {
        let (pairs, periods_mm) = (self.pairs, self.periods_mm);
        (0..3).filter(move |&axis| pairs[axis] && periods_mm[axis].is_none())
    }

    /// The plane walls that are none of these pairs.
    pub fn oblique_walls(&self) -> impl Iterator<Item = FacePlane> + use<> {
        let pairs = self.pairs;
        self.walls().filter_map(move |wall| match wall {
            Face::Plane(plane) if !plane.across().is_some_and(|(axis, _)| pairs[axis]) => Some(plane),
            _ => None,
        })
    }

    /// Its curved face, where it has one.
    #[must_use]
    pub fn lateral(&self) -> Option<Lateral> {
        self.faces().find_map(|face| match face {
            Face::Lateral(lateral) => Some(lateral),
            Face::Plane(_) => None,
        })
    }

    /// Area of the walls over the volume in 1/mm: 2 over the distance of each two planes, and 2 over the radius.
    #[must_use]
    pub fn walls_per_mm(&self) -> f64 {
        let curved: f64 = self.lateral().map_or(0.0, |lateral| 2.0 / lateral.radius_mm);
        self.walled_axes().fold(curved, |sum, axis| sum + 2.0 / self.bounds_mm[axis])
    }

    /// Largest clearance to the walls that some point of a cuboid has; infinite without walls.
    #[must_use]
    pub fn clearance_reaching_some(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        let reached = |wall| match wall {
            Face::Plane(plane) => plane.distance_mm(center) + plane.half_width_mm(half),
            Face::Lateral(Lateral { center_mm, radius_mm }) => {
                let nearest = |a: usize| ((center[a] - center_mm[a]).abs() - half[a]).max(0.0);
                radius_mm - hypot(nearest(0), nearest(1))
            }
        };
        self.walls().map(reached).fold(f64::INFINITY, f64::min)
    }

    /// Smallest clearance to the walls of all points of a cuboid; infinite without walls.
    #[must_use]
    pub fn clearance_reaching_all(&self, center: [f64; 3], half: [f64; 3]) -> f64 {
        let reached = |wall| match wall {
            Face::Plane(plane) => plane.distance_mm(center) - plane.half_width_mm(half),
            Face::Lateral(Lateral { center_mm, radius_mm }) => {
                let farthest = |a: usize| (center[a] - center_mm[a]).abs() + half[a];
                radius_mm - hypot(farthest(0), farthest(1))
            }
        };
        self.walls().map(reached).fold(f64::INFINITY, f64::min)
    }

    /// The section by the plane at a coordinate along an axis.
    #[must_use]
    pub fn outline(&self, axis: usize, at_mm: f64) -> Outline {
        let ends = |a: usize| [0.0, self.bounds_mm[a]];
        match (self.lateral(), axis) {
            (Some(Lateral { center_mm, radius_mm }), 2) => Outline::Disc { center_mm, radius_mm },
            (Some(Lateral { center_mm, .. }), _) => {
                let half_chord = (at_mm * (self.bounds_mm[axis] - at_mm)).max(0.0).sqrt();
                let middle = center_mm[1 - axis];
                Outline::Rectangle { u_mm: [middle - half_chord, middle + half_chord], v_mm: ends(2) }
            }
            (None, 0) => Outline::Rectangle { u_mm: ends(1), v_mm: ends(2) },
            (None, 1) => Outline::Rectangle { u_mm: ends(0), v_mm: ends(2) },
            (None, _) => Outline::Rectangle { u_mm: ends(0), v_mm: ends(1) },
        }
    }
}

impl FacePlane {
    /// The face through a point, with its inward normal, which need not be of length 1.
    #[must_use]
    pub fn new(normal: Vector3<f64>, through_mm: Vector3<f64>) -> Self {
        let normal = normal.normalize();
        Self { normal, offset_mm: normal.dot(&through_mm) }
    }

    /// The two faces across an axis at 0 and at a length.
    fn pair(axis: usize, length_mm: f64) -> [Self; 2] {
        let along = |sign: f64| Vector3::from_fn(|a, _| if a == axis { sign } else { 0.0 });
        [Self { normal: along(1.0), offset_mm: 0.0 }, Self { normal: along(-1.0), offset_mm: -length_mm }]
    }

    /// The axis that the face is across, and its coordinate along this axis; `None` of an oblique face.
    #[must_use]
    pub fn across(&self) -> Option<(usize, f64)> {
        let axis = (0..3).find(|&axis| self.normal[axis].abs() == 1.0)?;
        Some((axis, self.offset_mm * self.normal[axis]))
    }

    /// How far inside of the face a point lies.
    #[must_use]
    #[inline]
    pub fn distance_mm(&self, p: [f64; 3]) -> f64 {
        self.normal.dot(&Vector3::from(p)) - self.offset_mm
    }

    /// Half of the extent across the face of a cuboid with these half edges.
    #[inline]
    fn half_width_mm(&self, half: [f64; 3]) -> f64 {
        self.normal.abs().dot(&Vector3::from(half))
    }
}
