//! The templates of polyhedra as JSON: an array of objects beside the table of grains.
//!
//! A template is stated once, however many grains have its form. Its lengths are in equivalent diameters: a vertex `v`
//! of a grain of the diameter `d` with the rotation `R` and the centre `x` lies at `x + R (d v)`, computed as
//! [`Polyhedron::world_vertices_mm`] says, and the grain is the hull of its vertices rounded by `d` times `rounding`.
//! Numbers have as many digits as it takes to read them back exactly.

use std::io;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::load::invalid;
use super::{Column, GrainSource};
use crate::shape::Polyhedron;

/// How far the equivalent diameter of a template may be from 1.
const SIZE_TOLERANCE: f64 = 1.0e-9;

/// A template. `vertices`, `faces` and `rounding` describe it; the other members follow from them and are not read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Template))]
pub struct TemplateRecord {
    /// Vertices of the core, in equivalent diameters.
    pub vertices: Vec<[f64; 3]>,
    /// Faces of the core by their vertices, counted from 0, counter-clockwise as seen from outside.
    pub faces: Vec<Vec<u32>>,
    /// Radius of rounding, in equivalent diameters; 0 where the grains are sharp.
    pub rounding: f64,
    /// Sieve size, in equivalent diameters: by definition the edge of the least square that holds the shadow of the
    /// body along some direction.
    #[serde(default)]
    pub sieve_size: f64,
    /// Volume of the rounded body, in cubes of the equivalent diameter.
    #[serde(default)]
    pub volume: f64,
    /// Surface of the rounded body, in squares of the equivalent diameter.
    #[serde(default)]
    pub surface: f64,
    /// Largest width of the rounded body, in equivalent diameters.
    #[serde(default)]
    pub length: f64,
    /// Least width of the rounded body, in equivalent diameters.
    #[serde(default)]
    pub thickness: f64,
}

impl From<&Polyhedron> for TemplateRecord {
    fn from(template: &Polyhedron) -> Self {
        Self {
            vertices: template.vertices().iter().map(|vertex| (*vertex).into()).collect(),
            faces: template.faces().to_vec(),
            rounding: template.rounding(),
            sieve_size: template.sieve_size(),
            volume: template.volume(),
            surface: template.surface(),
            length: template.length(),
            thickness: template.thickness(),
        }
    }
}

impl TemplateRecord {
    /// The template, to the last bit.
    fn polyhedron(self) -> Result<Polyhedron, String> {
        let vertices = self.vertices.into_iter().map(Vector3::from).collect();
        let template =
            Polyhedron::new(vertices, self.faces, self.rounding).map_err(|fault| fault.to_string())?;
        let size = template.equivalent_diameter();
        if (size - 1.0).abs() <= SIZE_TOLERANCE {
            Ok(template)
        } else {
            Err(format!("its equivalent diameter is {size} instead of 1"))
        }
    }
}

/// The templates of polyhedra; none of other grains.
pub(super) fn records(grains: &dyn GrainSource) -> Option<Vec<TemplateRecord>> {
    grains.has(Column::Template).then(|| grains.templates().iter().map(TemplateRecord::from).collect())
}

/// The templates of a result with these columns.
///
/// # Errors
/// [`io::ErrorKind::InvalidData`] for a template that is no convex polyhedron with an equivalent diameter of 1, and
/// where
/// polyhedra have no templates.
pub fn read(
    columns: &'static [Column],
    templates: Option<Vec<TemplateRecord>>,
) -> io::Result<Vec<Polyhedron>> {
    if !columns.contains(&Column::Template) {
        return Ok(Vec::new());
    }
    let templates = templates.ok_or_else(|| invalid("polyhedra without their `templates`".into()))?;
    let read = |(i, template): (usize, TemplateRecord)| {
        template.polyhedron().map_err(|fault| invalid(format!("template {i} is no grain: {fault}")))
    };
    templates.into_iter().enumerate().map(read).collect()
}
