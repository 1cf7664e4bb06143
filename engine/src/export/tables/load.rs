//! Reads the grains of a result from its columns.

use std::io;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::columns::{Column, ELLIPSOID_ROW, MIXED_ROW, POLYHEDRON_ROW};
use super::source::{GrainSource, OF_ELLIPSOID, for_each_block, for_each_rows};
use crate::arrays::{self, Each as _};
use crate::memory::{filled, reserved};
use crate::packing::{Grains, Solids, Spheres};
use crate::request::GrainKind;
use crate::shape::{Ellipsoid, Pose, Solid};

/// Data that are no result.
pub(super) fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// Memory that the grains of a result take, in bytes: 32 a sphere, 88 another grain, and 2 for the aggregate of each.
pub fn loaded_bytes(source: &dyn GrainSource) -> u64 {
    let bytes = match source.kind() {
        GrainKind::Spheres => 4 * size_of::<f64>(),
        GrainKind::Ellipsoids | GrainKind::Polyhedra | GrainKind::Mixed => {
            size_of::<Solid>() + size_of::<Pose>()
        }
    };
    let bytes = if source.has_aggregates() { bytes + size_of::<u16>() } else { bytes };
    (source.len() as u64).saturating_mul(bytes as u64)
}

/// Reads all columns of a result into memory: [`loaded_bytes`].
///
/// # Errors
/// Those of the source, [`io::ErrorKind::OutOfMemory`], and [`io::ErrorKind::InvalidData`] for an ellipsoid whose
/// semi-axes are not positive, and for a polyhedron without a template, a diameter or an orientation.
pub fn load(source: &dyn GrainSource) -> io::Result<Grains> {
    let column = |column| -> io::Result<Vec<f64>> {
        let mut values = filled(source.len(), 0.0)?;
        source.read(column, 0, &mut values)?;
        Ok(values)
    };
    let aggregate = load_aggregate(source)?;
    let solids = match source.kind() {
        GrainKind::Spheres => {
            return Ok(Grains::Spheres(Spheres {
                x_mm: column(Column::X)?,
                y_mm: column(Column::Y)?,
                z_mm: column(Column::Z)?,
                d_mm: column(Column::Diameter)?,
                aggregate,
            }));
        }
        GrainKind::Ellipsoids => load_ellipsoids(source)?,
        GrainKind::Polyhedra | GrainKind::Mixed => load_polyhedra(source)?,
    };
    Ok(Grains::Solids(Solids { aggregate, ..solids }))
}

/// Reads the column of aggregates; none where there is no such column.
fn load_aggregate(source: &dyn GrainSource) -> io::Result<Vec<u16>> {
    if !source.has_aggregates() {
        return Ok(Vec::new());
    }
    let mut aggregate = reserved(source.len())?;
    for_each_block(source, [Column::Aggregate], |[values]| {
        for &value in values {
            if !(value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u16::MAX)) {
                return Err(invalid(format!("grain {} has the aggregate {value}", aggregate.len())));
            }
            aggregate.push(value as u16);
        }
        Ok(())
    })?;
    Ok(aggregate)
}

/// Reads ellipsoids.
fn load_ellipsoids(source: &dyn GrainSource) -> io::Result<Solids> {
    let rows = source.len();
    let mut grains = Solids { shapes: reserved(rows)?, poses: reserved(rows)?, ..Solids::default() };
    let mut fault = None;
    for_each_block(source, ELLIPSOID_ROW, |columns| {
        for row in 0..columns[0].len() {
            let [x, y, z, w, i, j, k, a, b, c] = columns.each(|column| column[row]);
            let Some(shape) = Ellipsoid::new([a, b, c]) else {
                fault.get_or_insert(grains.shapes.len());
                continue;
            };
            let orientation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
            grains.shapes.push(shape.into());
            grains.poses.push(Pose { center_mm: Vector3::new(x, y, z), orientation });
        }
        Ok(())
    })?;
    match fault {
        None => Ok(grains),
        Some(grain) => Err(invalid(format!("the semi-axes of grain {grain} are not positive numbers"))),
    }
}

/// Reads polyhedra, and ellipsoids among them; the numbers of the source stay as they are.
fn load_polyhedra(source: &dyn GrainSource) -> io::Result<Solids> {
    let rows = source.len();
    let templates = source.templates().to_vec();
    let mut grains =
        Solids { templates, shapes: reserved(rows)?, poses: reserved(rows)?, aggregate: Vec::new() };
    let templates = grains.templates.len();
    for_each_rows(source, angular_row(source), &mut |columns| {
        for row in 0..columns[0].len() {
            let [x, y, z, d, w, i, j, k, template] = arrays::from_fn(|column| columns[column][row]);
            let grain = grains.len();
            let fault = |what: String| Err(invalid(format!("grain {grain} {what}")));
            let semi_axes = columns.get(POLYHEDRON_ROW.len()..).filter(|axes| axes.len() == 3);
            let semi_axes = semi_axes.filter(|_| template == OF_ELLIPSOID);
            let ellipsoid = match semi_axes.map(|axes| Ellipsoid::new([0, 1, 2].each(|k| axes[k][row]))) {
                Some(None) => return fault("has semi-axes that are not positive numbers".into()),
                Some(found) => found,
                None => None,
            };
            let is_template = template >= 0.0 && template.fract() == 0.0 && template < templates as f64;
            if !is_template && ellipsoid.is_none() {
                return fault(format!(
                    "has the template {template}, and there are {templates}, counted from 0"
                ));
            }
            if !([x, y, z, d].iter().all(|x| x.is_finite()) && d > 0.0) {
                return fault("has a coordinate that is no number, or no positive diameter".into());
            }
            let quaternion = Quaternion::new(w, i, j, k);
            let is_unit = (quaternion.norm() - 1.0).abs() <= UNIT_TOLERANCE;
            if !is_unit {
                return fault(format!(
                    "has an orientation that is no unit quaternion: its length is {}",
                    quaternion.norm()
                ));
            }
            let orientation = UnitQuaternion::new_unchecked(quaternion);
            let polyhedron = || Solid::Polyhedron { template: template as u32, d_mm: d };
            grains.shapes.push(ellipsoid.map_or_else(polyhedron, Solid::Ellipsoid));
            grains.poses.push(Pose { center_mm: Vector3::new(x, y, z), orientation });
        }
        Ok(())
    })?;
    Ok(grains)
}

/// How far the length of the quaternion of a polyhedron may be from 1.
const UNIT_TOLERANCE: f64 = 1.0e-6;

/// What a grain of a result with polyhedra is read from: the semi-axes come last, where there are ellipsoids too.
pub(super) fn angular_row(source: &dyn GrainSource) -> &'static [Column] {
    if source.kind() == GrainKind::Mixed { &MIXED_ROW } else { &POLYHEDRON_ROW }
}
