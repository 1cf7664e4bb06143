//! What a request says about where grains of which size are to lie.
//!
//! Types, bounds and JSON form only; what a field means at a point is `crate::segregation`'s to know.

use serde::Serialize;

use super::decode::{At, Bound, Object};
use super::{Axis, Boundary, Specimen};

/// Largest strength of a gradient: sizes are then sorted to 2 % of the specimen.
pub const MAX_STRENGTH: f64 = 1000.0;

/// Where grains of which size are to lie.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Segregation {
    /// Anywhere, whatever their size.
    None {},
    /// Coarse grains gather at one end of a field, fine ones at the other, as vibration and gravity make them: of
    /// several free places a grain takes one at random, with weights `exp(-strength (u - q)^2)`. `q` is the
    /// share of the mass that is finer than the grain, `u` the share of the volume that lies further down the field.
    Gradient {
        /// Where the coarse grains gather.
        field: GradientField,
        /// How strictly: 0 is random placing, bit for bit; at 10 coarse grains still occur everywhere; 100 sorts
        /// sizes to 7 % of the specimen.
        #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1000))]
        strength: f64,
    },
}

impl Segregation {
    /// Whether nothing is asked for.
    #[allow(clippy::trivially_copy_pass_by_ref)] // Serde hands over a reference.
    pub fn is_none(&self) -> bool {
        matches!(self, Self::None {})
    }
}

/// A field that rises towards where the coarse grains gather.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum GradientField {
    /// Along an axis.
    Linear {
        /// Which one.
        axis: Axis,
        /// The end at which the coarse grains gather; `down`, as they sink, when absent.
        #[cfg_attr(feature = "openapi", schema(default = "down", required = false))]
        direction: FieldDirection,
    },
    /// By the distance from a face, at which the coarse grains gather.
    Face {
        /// Which one: that of a box, or `z_min`, `z_max` or `side` of a cylinder.
        face: SpecimenFace,
    },
}

/// An end of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum FieldDirection {
    /// The far end.
    Up,
    /// The end at 0.
    Down,
}

/// A face of the specimen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum SpecimenFace {
    /// Of a box, at x = 0.
    XMin,
    /// Of a box, at its far end in x.
    XMax,
    /// Of a box, at y = 0.
    YMin,
    /// Of a box, at its far end in y.
    YMax,
    /// The bottom.
    ZMin,
    /// The top.
    ZMax,
    /// The lateral surface of a cylinder.
    Side,
}

impl SpecimenFace {
    const OF_A_BOX: [(&'static str, Self); 6] = [
        ("x_min", Self::XMin),
        ("x_max", Self::XMax),
        ("y_min", Self::YMin),
        ("y_max", Self::YMax),
        ("z_min", Self::ZMin),
        ("z_max", Self::ZMax),
    ];
    const OF_A_CYLINDER: [(&'static str, Self); 3] =
        [("z_min", Self::ZMin), ("z_max", Self::ZMax), ("side", Self::Side)];
}

/// Reads a placement; its field must be one that the specimen has. A specimen that could not be read has
/// all of them.
///
/// `None` means that faults were reported.
pub(super) fn read_segregation(at: &At<'_>, specimen: Option<&Specimen>) -> Option<Segregation> {
    #[derive(Clone, Copy)]
    enum Kind {
        None,
        Gradient,
    }
    let mut object = at.object()?;
    let segregation = match object.variant(&[("none", Kind::None), ("gradient", Kind::Gradient)])? {
        Kind::None => Some(Segregation::None {}),
        Kind::Gradient => {
            let field = object.required("field").and_then(|at| read_field(&at, specimen));
            let strength =
                object.required("strength").and_then(|at| at.number(Bound::closed(0.0, MAX_STRENGTH, "")));
            field.zip(strength).map(|(field, strength)| Segregation::Gradient { field, strength })
        }
    };
    object.finish();
    segregation
}

fn read_field(at: &At<'_>, specimen: Option<&Specimen>) -> Option<GradientField> {
    #[derive(Clone, Copy)]
    enum Kind {
        Linear,
        Face,
    }
    let mut object = at.object()?;
    let field = match object.variant(&[("linear", Kind::Linear), ("face", Kind::Face)])? {
        Kind::Linear => read_linear(&mut object),
        Kind::Face => object.required("face").and_then(|at| {
            let faces: Vec<(&str, SpecimenFace)> = match specimen {
                Some(Specimen::Box { .. }) => SpecimenFace::OF_A_BOX.to_vec(),
                Some(Specimen::Cylinder { .. }) => SpecimenFace::OF_A_CYLINDER.to_vec(),
                None => SpecimenFace::OF_A_BOX.into_iter().chain(SpecimenFace::OF_A_CYLINDER).collect(),
            };
            at.choice(&faces).map(|face| GradientField::Face { face })
        }),
    };
    object.finish();
    if matches!(specimen, Some(Specimen::Box { boundary: Boundary::Periodic, .. })) {
        at.fault("a periodic box has no ends at which grains could gather: a gradient needs walls");
        return None;
    }
    field
}

fn read_linear(object: &mut Object<'_>) -> Option<GradientField> {
    let axis = object.required("axis").and_then(|at| at.choice(&Axis::ALL.map(|axis| (axis.name(), axis))));
    let direction = match object.optional("direction") {
        Some(at) => at.choice(&[("up", FieldDirection::Up), ("down", FieldDirection::Down)]),
        None => Some(FieldDirection::Down),
    };
    axis.zip(direction).map(|(axis, direction)| GradientField::Linear { axis, direction })
}

#[cfg(test)]
#[path = "segregation_tests.rs"]
mod tests;
