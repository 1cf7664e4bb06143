//! Reads the grains of a result from its columns.

use std::io;

use nalgebra::{Quaternion, UnitQuaternion};

use super::columns::Column;
use super::source::{BLOCK_ROWS, GrainSource, for_each_block, for_each_body};
use crate::memory::{filled, reserved};
use crate::packing::{Grains, Solids, Spheres};
use crate::shape::{Ellipsoid, Pose, Solid};
use crate::sorting;

/// Data that are no result.
pub(super) fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// Memory that the grains of a result take, in bytes: 32 a sphere, 88 another grain, and 2 for the aggregate of each.
pub fn loaded_bytes(source: &dyn GrainSource) -> u64 {
    let has_orientations = source.has(Column::Qw);
    let bytes = if has_orientations { size_of::<Solid>() + size_of::<Pose>() } else { 4 * size_of::<f64>() };
    let bytes = if source.has(Column::Aggregate) { bytes + size_of::<u16>() } else { bytes };
    (source.len() as u64).saturating_mul(bytes as u64)
}

/// Reads all columns of a result into memory: [`loaded_bytes`].
///
/// # Errors
/// Those of the source, [`io::ErrorKind::OutOfMemory`], and [`io::ErrorKind::InvalidData`] for a grain with a
/// coordinate that is no number, without a positive size, without an orientation, or without its template.
pub fn load(source: &dyn GrainSource) -> io::Result<Grains> {
    let aggregate = load_aggregate(source)?;
    if source.has(Column::Qw) {
        return Ok(Solids { aggregate, ..load_bodies(source)? }.into());
    }
    let column = |column| -> io::Result<Vec<f64>> {
        let mut values = filled(source.len(), 0.0)?;
        source.read(column, 0, &mut values)?;
        Ok(values)
    };
    let spheres = Spheres {
        x_mm: column(Column::X)?,
        y_mm: column(Column::Y)?,
        z_mm: column(Column::Z)?,
        d_mm: column(Column::Diameter)?,
        aggregate,
    };
    for (grain, &d_mm) in spheres.d_mm.iter().enumerate() {
        judge_numbers(grain, spheres.center(grain), d_mm)?;
    }
    Ok(spheres.into())
}

/// Reads the column of aggregates; none where there is no such column.
fn load_aggregate(source: &dyn GrainSource) -> io::Result<Vec<u16>> {
    if !source.has(Column::Aggregate) {
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

/// Reads grains with orientations; the numbers of the source stay as they are.
fn load_bodies(source: &dyn GrainSource) -> io::Result<Solids> {
    let rows = source.len();
    let templates = source.templates().to_vec();
    let mut grains =
        Solids { templates, shapes: reserved(rows)?, poses: reserved(rows)?, aggregate: Vec::new() };
    let templates = grains.templates.len();
    for_each_body(source, &mut |row| {
        let grain = grains.len();
        let (shape, d_mm) = match row.template {
            None => {
                let ellipsoid = Ellipsoid::new(row.semi_axes_mm).ok_or_else(|| {
                    invalid(format!("the semi-axes of grain {grain} are not positive numbers"))
                })?;
                // Where all grains have semi-axes, no diameter is read.
                let d_mm =
                    if source.has(Column::Template) { row.d_mm } else { ellipsoid.equivalent_diameter_mm() };
                (ellipsoid.into(), d_mm)
            }
            Some(template) if template >= 0.0 && template.fract() == 0.0 && template < templates as f64 => {
                (Solid::of_template(template as u32, row.d_mm), row.d_mm)
            }
            Some(template) => {
                return Err(invalid(format!(
                    "grain {grain} has the template {template}, and there are {templates}, counted from 0"
                )));
            }
        };
        judge_numbers(grain, row.center_mm, d_mm)?;
        let orientation = orientation(grain, row.quaternion)?;
        grains.shapes.push(shape);
        grains.poses.push(Pose { center_mm: row.center_mm.into(), orientation });
        Ok(())
    })?;
    Ok(grains)
}

/// Refuses a centre or a diameter that are no numbers.
fn judge_numbers(grain: usize, center_mm: [f64; 3], d_mm: f64) -> io::Result<()> {
    if center_mm.iter().all(|x| x.is_finite()) && d_mm.is_finite() && d_mm > 0.0 {
        return Ok(());
    }
    Err(invalid(format!("grain {grain} has a coordinate that is no number, or no positive diameter")))
}

/// The orientation of a grain by its quaternion, whose numbers stay as they are.
fn orientation(grain: usize, [w, i, j, k]: [f64; 4]) -> io::Result<UnitQuaternion<f64>> {
    let quaternion = Quaternion::new(w, i, j, k);
    let length = quaternion.norm();
    if (length - 1.0).abs() <= UNIT_TOLERANCE {
        return Ok(UnitQuaternion::new_unchecked(quaternion));
    }
    Err(invalid(format!(
        "grain {grain} has an orientation that is no unit quaternion: its length is {length}"
    )))
}

/// The rows of a source from the largest diameter down; `None` where they stand in this order, but for rounding.
///
/// # Errors
/// Those of the source.
pub fn descending(source: &dyn GrainSource) -> io::Result<Option<Vec<usize>>> {
    let mut diameters = filled(source.len(), 0.0)?;
    source.read(Column::Diameter, 0, &mut diameters)?;
    if !diameters.windows(2).any(|pair| pair[1] > pair[0] * (1.0 + ORDER_TOLERANCE)) {
        return Ok(None);
    }
    let mut rows: Vec<usize> = (0..source.len()).collect();
    sorting::by_number(&mut rows, |&row| -diameters[row]);
    Ok(Some(rows))
}

/// A value of a source that is not that of its grain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Row of the grain.
    pub grain: usize,
    /// The column.
    pub column: Column,
    /// The value in the source.
    pub found: f64,
    /// The value that follows from the other columns.
    pub expected: f64,
}

/// The first value of these columns of a source that its grains would not be stored with, up to a relative tolerance:
/// some columns follow from others.
///
/// # Errors
/// Those of the source.
pub fn difference(
    source: &dyn GrainSource,
    columns: &[Column],
    grains: &Grains,
    tolerance: f64,
) -> io::Result<Option<Difference>> {
    let most = BLOCK_ROWS.min(source.len());
    let (mut found, mut expected) = (vec![0.0; most], vec![0.0; most]);
    for &column in columns {
        for start in (0..source.len()).step_by(BLOCK_ROWS) {
            let rows = BLOCK_ROWS.min(source.len() - start);
            source.read(column, start, &mut found[..rows])?;
            grains.read(column, start, &mut expected[..rows])?;
            let differs = |row: &usize| {
                let (found, expected): (f64, f64) = (found[*row], expected[*row]);
                let is_near = (found - expected).abs() <= tolerance * expected.abs();
                found.to_bits() != expected.to_bits() && !(tolerance > 0.0 && is_near)
            };
            if let Some(row) = (0..rows).find(differs) {
                let (found, expected) = (found[row], expected[row]);
                return Ok(Some(Difference { grain: start + row, column, found, expected }));
            }
        }
    }
    Ok(None)
}

/// By how much a diameter may exceed that of the grain before: equivalent diameters are rounded.
const ORDER_TOLERANCE: f64 = 1.0e-9;

/// How far the length of the quaternion of an orientation may be from 1.
const UNIT_TOLERANCE: f64 = 1.0e-6;
