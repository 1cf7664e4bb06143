//! Result formats, written while streaming from columns to any [`std::io::Write`].
//!
//! Every format is a pure function of a [`Head`] and a [`GrainSource`], so that the bytes of a
//! result are the same whenever they are asked for; that is what ETags and byte ranges rely on.
//! Nothing here holds more than one block of rows in memory, and nothing knows files.

mod columns;
mod load;
mod npy;
mod source;
pub mod stored;
mod surfaces;
mod templates;
mod text;
mod view;
mod vtk;

use std::io::{self, Write};

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

pub use columns::Column;
pub use load::{Difference, descending, difference, load, loaded_bytes};
pub use source::{GrainSource, Table};
pub(crate) use surfaces::surface_of;
pub use templates::{TemplateRecord, read as read_templates};
pub use text::GrainTable;

use crate::export::provenance::Provenance;
use crate::packing::Report;
use source::Zeros;

/// Counts the changes of any format's bytes; part of an ETag.
pub const REVISION: u32 = 7;

/// A result format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Everything about the result, grains as rows.
    Json,
    /// The columns under a header line: `x_mm,y_mm,z_mm,d_mm` for spheres.
    Csv,
    /// Legacy VTK polydata, binary; the surfaces of all grains where there are polyhedra.
    Vtk,
    /// VTK XML polydata, raw appended binary; the surfaces of all grains where there are polyhedra.
    Vtp,
    /// NumPy array of float64, N x 4 for spheres.
    Npy,
    /// Binary, for viewers: 8 bytes a sphere, largest first.
    View,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 6] = [Self::Json, Self::Csv, Self::Vtk, Self::Vtp, Self::Npy, Self::View];

    /// Name in `?format=`, and file extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Vtk => "vtk",
            Self::Vtp => "vtp",
            Self::Npy => "npy",
            Self::View => "view",
        }
    }

    /// Media type without parameters.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv",
            Self::Vtk => "application/vnd.vtk.legacy",
            Self::Vtp => "application/vnd.vtk.polydata+xml",
            Self::Npy => "application/x-npy",
            Self::View => "application/vnd.packstone.view",
        }
    }

    /// The format of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// All of a result but its grains.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = ResultHead))]
pub struct Head {
    /// The job, where there is one.
    #[cfg_attr(feature = "openapi", schema(format = "uuid", required = false, nullable = false))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub job_id: Option<String>,
    /// The request as submitted, with its defaults filled in.
    pub request: serde_json::Value,
    /// What computed the result.
    pub engine: EngineInfo,
    /// What is known about the packing.
    #[serde(flatten)]
    pub report: Report,
}

/// By way of a value, which takes less to compile than the buffers of flattened fields.
impl<'de> Deserialize<'de> for Head {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Own {
            job_id: Option<String>,
            request: serde_json::Value,
            engine: EngineInfo,
        }
        let value = serde_json::Value::deserialize(deserializer)?;
        let report = Report::deserialize(&value).map_err(D::Error::custom)?;
        let Own { job_id, request, engine } = serde_json::from_value(value).map_err(D::Error::custom)?;
        Ok(Self { job_id, request, engine, report })
    }
}

/// Where the packing of a result comes from.
impl From<&Head> for Provenance {
    fn from(head: &Head) -> Self {
        let summary = &head.report.summary;
        Self {
            job_id: head.job_id.clone(),
            name: head.request["name"].as_str().map(str::to_owned),
            seed: head.request["seed"].as_u64(),
            engine_version: head.engine.version.clone(),
            volume_fraction_mixture: summary.volume_fraction_mixture,
            volume_fraction_effective: summary.volume_fraction_effective,
            aggregates: Self::aggregates_of(&head.request),
            result_sha256: None,
        }
    }
}

/// What computed a result.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EngineInfo {
    /// Version of the engine.
    pub version: String,
    /// Random generator.
    pub rng: String,
}

impl EngineInfo {
    /// This build.
    pub fn current() -> Self {
        Self { version: crate::VERSION.into(), rng: crate::packing::RNG_NAME.into() }
    }
}

/// Writes a result.
///
/// # Errors
/// Those of the writer and of the source.
pub fn write(format: Format, head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    // Where there are templates, grains are written as surfaces.
    match format {
        Format::Json => text::write_json(head, GrainTable(grains), out),
        Format::Csv => text::write_csv(grains, out),
        Format::Vtk if grains.has(Column::Template) => surfaces::write_legacy(head, grains, out),
        Format::Vtp if grains.has(Column::Template) => surfaces::write_xml(head, grains, out),
        Format::Vtk => vtk::write_legacy(head, grains, out),
        Format::Vtp => vtk::write_xml(head, grains, out),
        Format::Npy => npy::write(grains, out),
        Format::View => view::write(head, grains, out),
    }
}

/// The column whose value the grading curve classifies: the diameter of spheres; of other grains the sieve size, unless
/// the mix says that its sizes are equivalent diameters.
pub fn nominal_size(head: &Head, grains: &dyn GrainSource) -> Column {
    let is_equivalent = head.request["mix"]["size"] == "equivalent";
    if is_equivalent || !grains.has(Column::Sieve) { Column::Diameter } else { Column::Sieve }
}

/// Number of bytes that [`write()`] writes. Text has to be made to be measured; it is thrown away.
///
/// # Errors
/// Those of the source.
pub fn length(format: Format, head: &Head, grains: &dyn GrainSource) -> io::Result<u64> {
    let mut counter = Counter(0);
    match format {
        Format::View => return Ok(view::length(grains)),
        Format::Json | Format::Csv => write(format, head, grains, &mut counter)?,
        // That of polyhedra as surfaces depends on the templates of the grains.
        Format::Vtk | Format::Vtp if grains.has(Column::Template) => {
            write(format, head, grains, &mut counter)?;
        }
        // The length of the binary forms does not depend on the values.
        Format::Vtk | Format::Vtp | Format::Npy => {
            let zeros = Zeros { rows: grains.len(), columns: grains.columns() };
            write(format, head, &zeros, &mut counter)?;
        }
    }
    Ok(counter.0)
}

/// Counts what is written.
struct Counter(u64);

impl Write for Counter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod polyhedron_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod view_tests;
