//! A box from the origin, between walls or periodic.

use super::{Domain, Face, FacePlane};
use crate::request::Boundary;

/// Names of the faces.
const NAMES: [&str; 6] = ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"];

pub(super) fn domain(size_mm: [f64; 3], boundary: Boundary) -> Domain {
    let [x, y, z] = size_mm;
    let is_periodic = boundary == Boundary::Periodic;
    let pair = |axis| FacePlane::pair(axis, size_mm[axis]).map(|plane| Some(Face::Plane(plane)));
    let [[x_min, x_max], [y_min, y_max], [z_min, z_max]] = [0, 1, 2].map(pair);
    Domain {
        bounds_mm: size_mm,
        periods_mm: size_mm.map(|length| is_periodic.then_some(length)),
        face_names: &NAMES,
        faces: [x_min, x_max, y_min, y_max, z_min, z_max, None, None],
        pairs: [true; 3],
        has_oblique: false,
        volume_mm3: x * y * z,
        surface_mm2: 2.0 * (x * y + y * z + z * x),
    }
}
