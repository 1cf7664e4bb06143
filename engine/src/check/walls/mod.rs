//! Gaps between grains and walls.

pub(super) mod ellipsoid;
pub(super) mod polyhedron;

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::check::region::SpecimenRegion;
use crate::elementary::{cos, sin};

/// Directions across the axis of a cylinder that are looked at, and bisections between them.
const DIRECTIONS: usize = 96;
const BISECTIONS: usize = 60;

/// Calls `visit` with the direction and the gap of each wall that is closer than a gap to a body, which is given by its
/// centre, its radius and its support function. Of the lateral surface of a cylinder it is the direction in which the
/// body comes nearest.
pub(super) fn for_each_near(
    region: &SpecimenRegion,
    center: Vector3<f64>,
    radius: f64,
    closer_than: f64,
    reach: &dyn Fn(&Vector3<f64>) -> f64,
    mut visit: impl FnMut(Vector3<f64>, f64),
) {
    let mut look = |direction: Vector3<f64>, distance: f64| {
        if distance - radius >= closer_than {
            return;
        }
        let gap = distance - reach(&direction);
        if gap < closer_than {
            visit(direction, gap);
        }
    };
    for (axis, length) in region.plane_walls() {
        for sign in [-1.0, 1.0] {
            let distance = if sign < 0.0 { center[axis] } else { length - center[axis] };
            look(Vector3::from_fn(|k, _| if k == axis { sign } else { 0.0 }), distance);
        }
    }
    let Some(r) = region.lateral_mm else { return };
    let off = center - Vector3::new(r, r, 0.0);
    let direction = |angle: f64| Vector3::new(cos(angle), sin(angle), 0.0);
    // How far the body reaches from the axis of the cylinder.
    let farthest = |angle: f64| off.dot(&direction(angle)) + reach(&direction(angle));
    let across = (off.x * off.x + off.y * off.y).sqrt();
    if r - across - radius >= closer_than {
        return;
    }
    let step = TAU / DIRECTIONS as f64;
    let best = (0..DIRECTIONS).map(|i| step * i as f64).max_by(|a, b| farthest(*a).total_cmp(&farthest(*b)));
    let (mut angle, mut width) = (best.unwrap_or_default(), 0.5 * step);
    for _ in 0..BISECTIONS {
        for side in [angle - width, angle + width] {
            if farthest(side) > farthest(angle) {
                angle = side;
            }
        }
        width *= 0.5;
    }
    look(direction(angle), r - off.dot(&direction(angle)));
}
