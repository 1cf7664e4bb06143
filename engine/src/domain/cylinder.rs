//! A cylinder that stands on z = 0, within walls.

use std::f64::consts::PI;

use super::{Domain, Face, FacePlane, Lateral};

/// Names of the faces.
const NAMES: [&str; 3] = ["side", "z_min", "z_max"];

pub(super) fn domain(diameter_mm: f64, height_mm: f64) -> Domain {
    let radius_mm = diameter_mm / 2.0;
    let [z_min, z_max] = FacePlane::pair(2, height_mm).map(|plane| Some(Face::Plane(plane)));
    let side = Some(Face::Lateral(Lateral { center_mm: [radius_mm; 2], radius_mm }));
    Domain {
        bounds_mm: [diameter_mm, diameter_mm, height_mm],
        periods_mm: [None; 3],
        face_names: &NAMES,
        faces: [side, z_min, z_max, None, None, None, None, None],
        pairs: [false, false, true],
        has_oblique: false,
        volume_mm3: PI / 4.0 * diameter_mm * diameter_mm * height_mm,
        surface_mm2: PI * diameter_mm * (diameter_mm / 2.0 + height_mm),
    }
}
