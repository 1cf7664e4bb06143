//! Result formats, written while streaming from columns to any [`std::io::Write`].
//!
//! Every format is a pure function of a [`Head`] and a [`SphereSource`], so that the bytes of a
//! result are the same whenever they are asked for; that is what ETags and byte ranges rely on.
//! Nothing here holds more than one block of rows in memory, and nothing knows files.

mod npy;
pub mod stored;
mod text;
mod vtk;

use std::io::{self, Write};

use serde::{Deserialize, Serialize};

pub use text::SphereTable;

use crate::memory::filled;
use crate::packing::{Report, Spheres};

/// Counts the changes of any format's bytes; part of an ETag.
pub const REVISION: u32 = 3;

/// A result format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Everything about the result, spheres as rows.
    Json,
    /// `x_mm,y_mm,z_mm,d_mm` under a header line.
    Csv,
    /// Legacy VTK polydata, binary.
    Vtk,
    /// VTK XML polydata, raw appended binary.
    Vtp,
    /// NumPy array of N x 4 float64.
    Npy,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 5] = [Self::Json, Self::Csv, Self::Vtk, Self::Vtp, Self::Npy];

    /// Name in `?format=`, and file extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Vtk => "vtk",
            Self::Vtp => "vtp",
            Self::Npy => "npy",
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
        }
    }

    /// The format of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// All of a result but its spheres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// Where the columns of a result come from: memory, or a file of the caller's.
pub trait SphereSource {
    /// Number of spheres.
    fn len(&self) -> usize;

    /// Whether there is none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads rows `start..start + block.len()` of one column.
    ///
    /// # Errors
    /// Those of the storage behind.
    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()>;
}

/// A column of a result, in the order of storage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// x in mm.
    X,
    /// y in mm.
    Y,
    /// z in mm.
    Z,
    /// Diameter in mm.
    Diameter,
}

impl Column {
    /// All columns in the order of storage.
    pub const ALL: [Self; 4] = [Self::X, Self::Y, Self::Z, Self::Diameter];
}

impl SphereSource for Spheres {
    fn len(&self) -> usize {
        Self::len(self)
    }

    fn read(&self, column: Column, start: usize, block: &mut [f64]) -> io::Result<()> {
        let all = match column {
            Column::X => &self.x_mm,
            Column::Y => &self.y_mm,
            Column::Z => &self.z_mm,
            Column::Diameter => &self.d_mm,
        };
        block.copy_from_slice(&all[start..start + block.len()]);
        Ok(())
    }
}

/// Reads all columns of a result into memory: 32 bytes a sphere.
///
/// # Errors
/// Those of the source, and [`io::ErrorKind::OutOfMemory`].
pub fn load(source: &dyn SphereSource) -> io::Result<Spheres> {
    let column = |column| -> io::Result<Vec<f64>> {
        let mut values = filled(source.len(), 0.0)?;
        source.read(column, 0, &mut values)?;
        Ok(values)
    };
    Ok(Spheres {
        x_mm: column(Column::X)?,
        y_mm: column(Column::Y)?,
        z_mm: column(Column::Z)?,
        d_mm: column(Column::Diameter)?,
    })
}

/// Rows that are read, converted and written at a time.
const BLOCK_ROWS: usize = 4096;

/// Writes a result.
///
/// # Errors
/// Those of the writer and of the source.
pub fn write(format: Format, head: &Head, spheres: &dyn SphereSource, out: &mut dyn Write) -> io::Result<()> {
    match format {
        Format::Json => text::write_json(head, SphereTable(spheres), out),
        Format::Csv => text::write_csv(spheres, out),
        Format::Vtk => vtk::write_legacy(head, spheres, out),
        Format::Vtp => vtk::write_xml(head, spheres, out),
        Format::Npy => npy::write(spheres, out),
    }
}

/// Number of bytes that [`write()`] writes. Text has to be made to be measured; it is thrown away.
///
/// # Errors
/// Those of the source.
pub fn length(format: Format, head: &Head, spheres: &dyn SphereSource) -> io::Result<u64> {
    let mut counter = Counter(0);
    match format {
        Format::Json | Format::Csv => write(format, head, spheres, &mut counter)?,
        // The length of the binary forms does not depend on the values.
        Format::Vtk | Format::Vtp | Format::Npy => write(format, head, &Zeros(spheres.len()), &mut counter)?,
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

/// A source of that many rows of zeros.
struct Zeros(usize);

impl SphereSource for Zeros {
    fn len(&self) -> usize {
        self.0
    }

    fn read(&self, _: Column, _: usize, block: &mut [f64]) -> io::Result<()> {
        block.fill(0.0);
        Ok(())
    }
}

/// Calls `visit` with blocks of rows, as slices of the asked columns, from the first row to the last.
fn for_each_block<const N: usize>(
    spheres: &dyn SphereSource,
    columns: [Column; N],
    mut visit: impl FnMut([&[f64]; N]) -> io::Result<()>,
) -> io::Result<()> {
    let mut buffers: [Vec<f64>; N] = std::array::from_fn(|_| vec![0.0; BLOCK_ROWS.min(spheres.len())]);
    let mut start = 0;
    while start < spheres.len() {
        let rows = BLOCK_ROWS.min(spheres.len() - start);
        for (column, buffer) in columns.iter().zip(&mut buffers) {
            spheres.read(*column, start, &mut buffer[..rows])?;
        }
        visit(std::array::from_fn(|i| &buffers[i][..rows]))?;
        start += rows;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
