//! A VTK unstructured grid in XML with raw appended data, written array by array.
//!
//! Every length is known before anything is written, which is what lets the head come first. It knows VTK's form; it
//! must never know what an array means.

use std::io::Write;

use super::work::{LOOKS_PER_REPORT, Work};
use crate::export::{ExportError, go_on};

const BLOCK_BYTES: usize = 1 << 16;

/// Where an array belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    PointData,
    CellData,
    Points,
    Cells,
}

/// What its values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Float64,
    Int32,
    Int64,
    UInt8,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Float64 => "Float64",
            Self::Int32 => "Int32",
            Self::Int64 => "Int64",
            Self::UInt8 => "UInt8",
        }
    }

    fn bytes(self) -> u64 {
        match self {
            Self::Float64 | Self::Int64 => 8,
            Self::Int32 => 4,
            Self::UInt8 => 1,
        }
    }
}

type Fill<'a> = Box<dyn Fn(&mut Sink<'_>) -> Result<(), ExportError> + 'a>;

struct Array<'a> {
    place: Place,
    name: &'static str,
    kind: Kind,
    components: u64,
    bytes: u64,
    fill: Fill<'a>,
}

/// A grid to be written.
pub(super) struct Grid<'a> {
    points: u64,
    cells: u64,
    arrays: Vec<Array<'a>>,
}

/// Where the values of an array go.
pub(super) struct Sink<'a> {
    out: &'a mut dyn Write,
    /// Counts the bytes of all arrays.
    work: &'a Work<'a>,
    bytes: Vec<u8>,
    written: u64,
    blocks: usize,
}

impl Sink<'_> {
    pub(super) fn float(&mut self, x: f64) {
        self.bytes.extend_from_slice(&x.to_le_bytes());
    }

    pub(super) fn floats<'b>(&mut self, values: impl IntoIterator<Item = &'b f64>) {
        values.into_iter().for_each(|&x| self.float(x));
    }

    /// A number of less than 2^31.
    pub(super) fn int(&mut self, i: i32) {
        self.bytes.extend_from_slice(&i.to_le_bytes());
    }

    pub(super) fn long(&mut self, i: u64) {
        self.bytes.extend_from_slice(&i.to_le_bytes());
    }

    pub(super) fn byte(&mut self, i: u8) {
        self.bytes.push(i);
    }

    /// Writes what has come together, and looks whether to go on; to be called every few values.
    pub(super) fn pass_on(&mut self) -> Result<(), ExportError> {
        if self.bytes.len() >= BLOCK_BYTES { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ExportError> {
        self.out.write_all(&self.bytes)?;
        self.written += self.bytes.len() as u64;
        self.bytes.clear();
        if self.blocks.is_multiple_of(LOOKS_PER_REPORT) {
            self.work.report(self.written as usize);
        }
        self.blocks += 1;
        go_on(self.work.control)
    }
}

impl<'a> Grid<'a> {
    pub(super) fn new(points: u64, cells: u64) -> Self {
        Self { points, cells, arrays: Vec::new() }
    }

    /// Adds an array of `values` values in all, which `fill` writes when its turn has come.
    pub(super) fn add(
        &mut self,
        (place, name): (Place, &'static str),
        (kind, components): (Kind, u64),
        values: u64,
        fill: impl Fn(&mut Sink<'_>) -> Result<(), ExportError> + 'a,
    ) {
        let bytes = values * kind.bytes();
        self.arrays.push(Array { place, name, kind, components, bytes, fill: Box::new(fill) });
    }

    /// Writes all arrays, each as its turn comes. `work` is told of bytes.
    pub(super) fn write(&self, work: &Work<'_>, out: &mut dyn Write) -> Result<(), ExportError> {
        let mut head = Vec::new();
        write!(
            head,
            r#"<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <UnstructuredGrid>
    <Piece NumberOfPoints="{}" NumberOfCells="{}">
"#,
            self.points, self.cells
        )?;
        for (place, tag) in [
            (Place::PointData, "PointData"),
            (Place::CellData, "CellData"),
            (Place::Points, "Points"),
            (Place::Cells, "Cells"),
        ] {
            writeln!(head, "      <{tag}>")?;
            let mut offset = 0;
            for array in &self.arrays {
                if array.place == place {
                    writeln!(
                        head,
                        "        <DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" offset=\"{offset}\"/>",
                        array.kind.name(),
                        array.name,
                        array.components,
                    )?;
                }
                offset += 8 + array.bytes;
            }
            writeln!(head, "      </{tag}>")?;
        }
        head.extend_from_slice(
            b"    </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n   _",
        );
        out.write_all(&head)?;
        let total = self.arrays.iter().map(|array| array.bytes as usize).sum();
        let work = Work { total, unit: "bytes", ..*work };
        let bytes = Vec::with_capacity(2 * BLOCK_BYTES);
        let mut sink = Sink { out: &mut *out, work: &work, bytes, written: 0, blocks: 0 };
        for array in &self.arrays {
            sink.out.write_all(&array.bytes.to_le_bytes())?;
            let before = sink.written;
            (array.fill)(&mut sink)?;
            sink.flush()?;
            let written = sink.written - before;
            if written != array.bytes {
                return Err(ExportError::CheckFailed(format!(
                    "{written} of {} bytes of the array {} were written",
                    array.bytes, array.name
                )));
            }
        }
        out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")?;
        Ok(())
    }
}
