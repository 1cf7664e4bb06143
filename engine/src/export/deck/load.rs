//! The loads of decks, and what each does to the faces of a specimen.
//!
//! The faces of a box are smooth rigid plates: each has one displacement normal to it, and nothing holds a node along
//! it. Plates that no load moves are free to move as a whole, so that the mean stress across them is zero. These
//! conditions hold in a cell that is mirrored at its faces, so that the stiffness is that of the mirrored cell
//! exactly: for normal strains the displacement along the normal is symmetric about a face, for shear the
//! displacements along the face are (Suquet 1987, in: Homogenization Techniques for Composite Media,
//! 10.1007/3-540-17616-0_15).

use serde::{Deserialize, Serialize};

use super::frame::Frame;
use crate::request::{Axis, Specimen};

/// What is done to a specimen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum Load {
    /// Stretched along x.
    UniaxialX,
    /// Stretched along y.
    UniaxialY,
    /// Stretched along z.
    UniaxialZ,
    /// Sheared in the plane of x and y.
    ShearXy,
    /// Sheared in the plane of x and z.
    ShearXz,
    /// Sheared in the plane of y and z.
    ShearYz,
    /// Heated, free to expand.
    Temperature,
}

impl Load {
    /// All loads, in the order of the documentation.
    pub const ALL: [Self; 7] = [
        Self::UniaxialX,
        Self::UniaxialY,
        Self::UniaxialZ,
        Self::ShearXy,
        Self::ShearXz,
        Self::ShearYz,
        Self::Temperature,
    ];

    /// Its name in requests.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::UniaxialX => "uniaxial_x",
            Self::UniaxialY => "uniaxial_y",
            Self::UniaxialZ => "uniaxial_z",
            Self::ShearXy => "shear_xy",
            Self::ShearXz => "shear_xz",
            Self::ShearYz => "shear_yz",
            Self::Temperature => "temperature",
        }
    }

    /// The axis that it stretches, if it does.
    #[must_use]
    pub fn axis(self) -> Option<usize> {
        match self {
            Self::UniaxialX => Some(0),
            Self::UniaxialY => Some(1),
            Self::UniaxialZ => Some(2),
            _ => None,
        }
    }

    /// The two axes of the plane that it shears, if it does.
    #[must_use]
    pub fn plane(self) -> Option<[usize; 2]> {
        match self {
            Self::ShearXy => Some([0, 1]),
            Self::ShearXz => Some([0, 2]),
            Self::ShearYz => Some([1, 2]),
            _ => None,
        }
    }

    /// Whether a specimen can have it: faces that are planes carry loads, a curved surface none.
    #[must_use]
    pub fn fits(self, specimen: &Specimen) -> bool {
        specimen.domain().lateral().is_none() || matches!(self, Self::UniaxialZ | Self::Temperature)
    }

    /// Whether it acts in the plane of a cut across that axis.
    #[must_use]
    pub fn fits_cut(self, axis: Axis) -> bool {
        let across = axis.index();
        self.axis() != Some(across) && !self.plane().is_some_and(|plane| plane.contains(&across))
    }
}

/// The set of the nodes on all faces.
pub(super) const ALL_FACES: &str = "faces";
/// The set of one node on the axis of a cylinder, and that of another along x from it, both on the bottom.
pub(super) const PINS: [&str; 2] = ["pin_axis", "pin_rotation"];

/// A displacement that is given to the nodes of a set along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prescribed {
    pub(super) set: &'static str,
    pub(super) axis: usize,
    pub(super) value_mm: f64,
}

/// What a load does to the faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Conditions {
    /// Displacements that are given.
    pub(super) prescribed: Vec<Prescribed>,
    /// Faces whose nodes share one displacement along the axis, which is free.
    pub(super) tied: Vec<(&'static str, usize)>,
}

impl Conditions {
    /// Those of a load on a mesh that [fits](Load::fits) it; the strain is that along the axis, or the shear angle.
    pub(super) fn of(load: Load, frame: &Frame, strain: f64) -> Self {
        let mut conditions = Self::default();
        let mut prescribe = |set, axis, value_mm| {
            conditions.prescribed.push(Prescribed { set, axis, value_mm });
        };
        let all = 0..frame.dimension();
        if let Some(plane) = load.plane() {
            let places = plane.map(|axis| frame.place(axis));
            for across in all.filter(|axis| !places.contains(&Some(*axis))) {
                prescribe(ALL_FACES, across, 0.0);
            }
            if let [Some(a), Some(b)] = places {
                // Half of the angle on either pair of faces.
                for (normal, along) in [(a, b), (b, a)] {
                    let [low, high] = frame.faces(normal);
                    prescribe(low, along, 0.0);
                    prescribe(high, along, strain / 2.0 * frame.size_mm[normal]);
                }
            }
            return conditions;
        }
        let axes = if frame.has_free_sides { 2..3 } else { all };
        for axis in axes.clone() {
            prescribe(frame.faces(axis)[0], axis, 0.0);
        }
        if frame.has_free_sides {
            prescribe(PINS[0], 0, 0.0);
            prescribe(PINS[0], 1, 0.0);
            prescribe(PINS[1], 1, 0.0);
        }
        let stretched = load.axis().and_then(|axis| frame.place(axis));
        for axis in axes {
            if stretched == Some(axis) {
                prescribe(frame.faces(axis)[1], axis, strain * frame.size_mm[axis]);
            } else {
                conditions.tied.push((frame.faces(axis)[1], axis));
            }
        }
        conditions
    }
}
