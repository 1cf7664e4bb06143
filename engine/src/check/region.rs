//! The region that grains lie in as the check sees it. [`Region`] is what the check of gaps asks of any region, and
//! [`SpecimenRegion`] answers for the specimens of requests: lengths, faces, period, volume. It is written a second
//! time, apart from the domain that the packing methods ask; the kinds of specimens are told apart here alone.

use std::f64::consts::FRAC_PI_4;

use crate::arrays::Each as _;
use crate::elementary::hypot;
use crate::request::{Boundary, Specimen};

/// What the check asks of a region. How far a grain stays from its walls is said by the [`Body`](super::Body).
pub trait Region: Sync {
    /// Edge lengths of a box at the origin that holds the region.
    fn bounds_mm(&self) -> [f64; 3];

    /// Edge lengths with which the region repeats, if it does, so that its faces are no walls.
    fn period_mm(&self) -> Option<[f64; 3]>;

    /// Distance in mm from a point to the nearest face; negative outside.
    fn face_distance_mm(&self, p: [f64; 3]) -> f64;
}

/// The region of a specimen, with faces across the axes or, standing on z = 0, with a lateral surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpecimenRegion {
    /// Edge lengths of the bounding box, which starts at the origin.
    pub(super) bounds_mm: [f64; 3],
    /// Of an axis with plane faces across it, at 0 and at a length, that length.
    pub(super) faces_mm: [Option<f64>; 3],
    /// Radius of the lateral surface of a cylinder, whose axis is at x = y = radius.
    pub(super) lateral_mm: Option<f64>,
    /// Whether the region repeats with its edge lengths, so that its faces are no walls.
    pub(super) is_periodic: bool,
    /// Volume in mm³.
    pub(super) volume_mm3: f64,
}

impl SpecimenRegion {
    pub(super) fn new(specimen: &Specimen) -> Self {
        match *specimen {
            Specimen::Box { size_mm, boundary } => Self {
                bounds_mm: size_mm,
                faces_mm: size_mm.each(Some),
                lateral_mm: None,
                is_periodic: boundary == Boundary::Periodic,
                volume_mm3: size_mm[0] * size_mm[1] * size_mm[2],
            },
            Specimen::Cylinder { diameter_mm, height_mm } => Self {
                bounds_mm: [diameter_mm, diameter_mm, height_mm],
                faces_mm: [None, None, Some(height_mm)],
                lateral_mm: Some(0.5 * diameter_mm),
                is_periodic: false,
                volume_mm3: FRAC_PI_4 * diameter_mm * diameter_mm * height_mm,
            },
        }
    }

    /// The axes with plane walls across them, with their lengths in mm.
    pub(super) fn plane_walls(&self) -> impl Iterator<Item = (usize, f64)> {
        let faces = if self.is_periodic { [None; 3] } else { self.faces_mm };
        (0..3).filter_map(move |axis| Some((axis, faces[axis]?)))
    }
}

impl Region for SpecimenRegion {
    fn bounds_mm(&self) -> [f64; 3] {
        self.bounds_mm
    }

    fn period_mm(&self) -> Option<[f64; 3]> {
        self.is_periodic.then_some(self.bounds_mm)
    }

    fn face_distance_mm(&self, p: [f64; 3]) -> f64 {
        let mut least = f64::INFINITY;
        for (x, length) in p.into_iter().zip(self.faces_mm) {
            if let Some(length) = length {
                least = least.min(x.min(length - x));
            }
        }
        match self.lateral_mm {
            Some(radius) => least.min(radius - hypot(p[0] - radius, p[1] - radius)),
            None => least,
        }
    }
}
