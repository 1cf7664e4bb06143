//! The shape of each grain as a table: sizes, ratios of the axes, sphericity and roundness.
//!
//! Definitions are those of the shape report of a result ([`crate::analysis::shape_report`]). A sphere has the figures
//! of a sphere. Rows are in the order of the grains of the result, so that `grain` leads to their other columns.

use std::io::Write;

use serde::{Deserialize, Serialize};

use super::estimate::{Expected, ExportEstimate};
use super::kind::Export;
use super::rows::{Cell, Rows, TableFormat};
use super::{ExportError, Model, go_on};
use crate::analysis::shapes::Measured;
use crate::control::{Control, Progress, Step};
use crate::packing::GrainsRef;
use crate::plan::Limits;
use crate::request::decode::Object;
use crate::shape::{ShapeFigures, Zingg};

/// Names of the columns, in their order.
pub const COLUMNS: [&str; 14] = [
    "grain",
    "shape",
    "template",
    "d_mm",
    "sieve_mm",
    "length_mm",
    "thickness_mm",
    "volume_mm3",
    "surface_mm2",
    "elongation",
    "flatness",
    "sphericity",
    "roundness",
    "zingg",
];
/// Bytes of a row of text, on average.
const ROW_BYTES: f64 = 190.0;
/// Rows between two looks at whether to stop.
const ROWS_PER_LOOK: usize = 1 << 14;

/// In which format.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ShapeTableOptions {
    /// The file format.
    #[cfg_attr(feature = "openapi", schema(default = "csv", required = false))]
    pub format: TableFormat,
}

impl ShapeTableOptions {
    /// Reads the options, whose names this asks `object` for.
    ///
    /// `None` means that faults were reported.
    pub fn read(object: &mut Object<'_>) -> Option<Self> {
        Some(Self { format: TableFormat::read(object)? })
    }
}

/// The figures of the table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ShapeTableReport {
    /// Number of grains, which is that of the rows.
    pub grains: u64,
}

impl Export for ShapeTableOptions {
    type Report = ShapeTableReport;

    const NAME: &'static str = "shapes";
    const FORMATS: &'static [&'static str] = &["csv", "json"];

    fn from_object(object: &mut Object<'_>) -> Option<Self> {
        Self::read(object)
    }

    fn format(&self) -> &'static str {
        self.format.name()
    }

    fn media_type(&self) -> &'static str {
        self.format.media_type()
    }

    fn estimate(&self, of: &Expected<'_>) -> Result<ExportEstimate, ExportError> {
        Ok(ExportEstimate::of_bytes((of.grains() * ROW_BYTES) as u64))
    }

    /// Writes the table.
    ///
    /// # Errors
    /// [`ExportError::Stopped`], [`ExportError::Write`].
    fn write(
        &self,
        model: &Model<'_>,
        _: &Limits,
        control: &dyn Control,
        out: &mut dyn Write,
    ) -> Result<ShapeTableReport, ExportError> {
        let grains = model.grains.len();
        let measured = Measured::new(model.grains);
        let mut rows = Rows::begin(out, self.format, &COLUMNS, &[])?;
        for grain in 0..grains {
            if grain.is_multiple_of(ROWS_PER_LOOK) {
                go_on(control)?;
                control.report(&Progress::counted(Step::Export, grain, grains, "grains", "writing shapes"));
            }
            rows.row(&cells(model.grains, grain, &measured.of(grain)))?;
        }
        rows.end()?;
        Ok(ShapeTableReport { grains: grains as u64 })
    }
}

fn cells(grains: GrainsRef<'_>, grain: usize, figures: &ShapeFigures) -> [Cell; 14] {
    let class = match figures.form.zingg() {
        Zingg::Disc => "disc",
        Zingg::Equant => "equant",
        Zingg::Blade => "blade",
        Zingg::Rod => "rod",
    };
    [
        Cell::Whole(grain as i64),
        Cell::Word(grains.noun(grain)),
        grains.template(grain).map_or(Cell::None, |template| Cell::Whole(template.into())),
        Cell::Number(grains.d_mm(grain)),
        Cell::Number(figures.sizes.sieve_mm),
        Cell::Number(figures.sizes.length_mm),
        Cell::Number(figures.sizes.thickness_mm),
        Cell::Number(figures.sizes.volume_mm3),
        Cell::Number(figures.surface_mm2),
        Cell::Number(figures.form.elongation),
        Cell::Number(figures.form.flatness),
        Cell::Number(figures.sphericity),
        Cell::Number(figures.roundness),
        Cell::Word(class),
    ]
}

#[cfg(test)]
#[path = "shapes_tests.rs"]
mod tests;
