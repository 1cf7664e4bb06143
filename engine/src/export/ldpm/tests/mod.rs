//! Tests of the lattice.
#![allow(clippy::unwrap_used)]

mod boundary;
mod ellipsoids;
mod extremes;
mod files;
mod model;
mod tessellation;

use serde_json::{Value, json};

use crate::packing::Spheres;
use crate::request::{PackingRequest, Specimen};
use crate::{Unattended, pack};

/// A packing of a box or a cylinder, 40 mm across and 30 mm high.
fn packed(specimen: &Value, volume_fraction: f64, distance: &Value) -> (Specimen, Spheres) {
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 10.0, "exponent": 0.5}, "d_min_mm": 3.0, "volume_fraction": volume_fraction},
        "distance": distance,
    });
    let request = PackingRequest::from_json(&request, 7).unwrap();
    (
        request.specimen,
        pack(&request, &crate::Limits::default(), &Unattended).unwrap().into_spheres().unwrap(),
    )
}

fn in_box() -> (Specimen, Spheres) {
    packed(&json!({"type": "box", "size_mm": [40.0, 35.0, 30.0]}), 0.5, &json!({"type": "none"}))
}

fn in_cylinder() -> (Specimen, Spheres) {
    packed(
        &json!({"type": "cylinder", "diameter_mm": 40.0, "height_mm": 30.0}),
        0.4,
        &json!({"type": "none"}),
    )
}

/// What the documentation recommends.
fn with_clearance() -> (Specimen, Spheres) {
    packed(
        &json!({"type": "box", "size_mm": [40.0, 40.0, 40.0]}),
        0.4,
        &json!({"type": "constant", "gap_mm": 0.6, "wall_gap_mm": 1.65}),
    )
}
