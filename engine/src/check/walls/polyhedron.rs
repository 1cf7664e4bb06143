//! Polyhedra and walls: the nearest corner, less the radius of rounding.

use nalgebra::Vector3;

use crate::arrays::Each as _;
use crate::check::body::Polyhedron;
use crate::check::double_double::DoubleDouble;
use crate::check::region::SpecimenRegion;
use crate::check::separation::{ERROR, EXACT_ERROR};
use crate::elementary::hypot;

/// Gap between a polyhedron and the nearest wall, and whether it is at least `required`.
pub(in crate::check) fn wall_gap(
    body: &Polyhedron<'_>,
    region: &SpecimenRegion,
    required: f64,
) -> (f64, bool) {
    if region.is_periodic {
        return (f64::INFINITY, true);
    }
    let (bounds, axis) = (region.faces_mm, region.lateral_mm);
    let mut gap = f64::INFINITY;
    let mut scale = body.radius + required;
    for p in &body.points {
        for k in 0..3 {
            if let Some(length) = bounds[k] {
                gap = gap.min(p[k]).min(length - p[k]);
                scale = scale.max(body.radius + required + length + p[k].abs());
            }
        }
        if let Some(axis) = axis {
            gap = gap.min(axis - hypot(p.x - axis, p.y - axis));
            scale = scale.max(body.radius + required + axis + p.x.abs() + p.y.abs());
        }
    }
    let gap = gap - body.rounding;
    let (excess, error) = (gap - required, ERROR * scale);
    if excess >= error || excess < -error {
        return (gap, excess > 0.0);
    }
    let planes = (0..3).all(|k| {
        let Some(length) = bounds[k] else { return true };
        all_keep(body, required, scale, |p| p[k].into())
            && all_keep(body, required, scale, |p| DoubleDouble::difference(length, p[k]))
    });
    let lateral = axis.is_none_or(|axis| {
        all_keep(body, required, scale, |p| {
            let [x, y] = [0, 1].each(|k| DoubleDouble::difference(p[k], axis));
            DoubleDouble::from(axis) - (x * x + y * y).sqrt()
        })
    });
    (gap, planes && lateral)
}

/// Whether a distance that a corner must keep, `of(p)`, is at least `required` and the radius of rounding more for
/// all of them.
fn all_keep(
    body: &Polyhedron<'_>,
    required: f64,
    scale: f64,
    of: impl Fn(&Vector3<f64>) -> DoubleDouble,
) -> bool {
    let inset = DoubleDouble::from(body.rounding) + required.into();
    body.points.iter().all(|p| (of(p) - inset).to_f64() >= -EXACT_ERROR * scale)
}
