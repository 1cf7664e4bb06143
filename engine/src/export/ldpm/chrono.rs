//! The files that Project Chrono's reader of lattices takes, in one zip: text, each line that is no data begun
//! with `//`, numbers from 0.
//!
//! The layout is that of the workbench which the reader was written for. Nodes are written in full, so that the
//! lattice can be made from them again to the last bit; what follows from them has ten digits, as there.

use std::cell::Cell;
use std::io::{self, Write};

use serde::Serialize;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::tessellation::{Point, Tet, boundary_facets};
use super::text::{push_number, push_whole};
use super::{Lattice, LatticeOptions, LatticeReport, topology};
use crate::control::{Control, Part};
use crate::export::steps::Steps;
use crate::export::{ExportError, go_on};

/// Name that all files begin with.
pub(super) const NAME: &str = "ldpm";
/// Fast: the text is long and compresses to two fifths whatever is spent on it.
const LEVEL: i64 = 1;
const BLOCK_BYTES: usize = 1 << 16;

/// Everything about a lattice but its elements.
#[derive(Serialize)]
struct Summary<'a> {
    engine: &'static str,
    options: &'a LatticeOptions,
    report: &'a LatticeReport,
}

/// Passes on what is written until told that all is lost; the archive's end is then written to nowhere.
struct Tap<'a> {
    out: &'a mut dyn Write,
    closed: &'a Cell<bool>,
}

impl Write for Tap<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.closed.get() { Ok(bytes.len()) } else { self.out.write(bytes) }
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.closed.get() { Ok(()) } else { self.out.flush() }
    }
}

/// An archive under way: one file at a time, in blocks of text.
struct Archive<'a, W: Write> {
    zip: ZipWriter<zip::write::StreamWriter<W>>,
    text: Vec<u8>,
    control: &'a dyn Control,
}

impl<W: Write> Archive<'_, W> {
    /// Begins the next file.
    fn begin(&mut self, suffix: &str, title: &str, columns: &str, notes: &[&str]) -> Result<(), ExportError> {
        self.start(&format!("{NAME}-data-{suffix}.dat"))?;
        let rule = "// ================================================================================";
        writeln!(
            self.text,
            "{rule}\n// Packstone {}: lattice discrete particle model\n{rule}",
            crate::VERSION
        )?;
        writeln!(self.text, "// {title}\n//\n// Data Structure:\n// {columns}")?;
        for note in notes {
            writeln!(self.text, "// {note}")?;
        }
        writeln!(self.text, "// Lengths in mm. All indices count from zero.\n{rule}")?;
        Ok(())
    }

    fn start(&mut self, name: &str) -> Result<(), ExportError> {
        self.write()?;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .compression_level(Some(LEVEL))
            .large_file(true)
            .last_modified_time(zip::DateTime::default());
        self.zip.start_file(name, options).map_err(io::Error::from)?;
        Ok(())
    }

    /// Ends a line, and sees to it that not too much text is held.
    fn end_line(&mut self) -> Result<(), ExportError> {
        self.text.push(b'\n');
        if self.text.len() >= BLOCK_BYTES { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> Result<(), ExportError> {
        if !self.text.is_empty() {
            go_on(self.control)?;
            self.zip.write_all(&self.text)?;
            self.text.clear();
        }
        Ok(())
    }

    fn whole_numbers(&mut self, values: &[u32]) {
        for (i, &value) in values.iter().enumerate() {
            self.separate(i);
            push_whole(&mut self.text, u64::from(value));
        }
    }

    /// Numbers that read back exactly.
    fn exactly(&mut self, values: &[f64]) {
        for (i, &value) in values.iter().enumerate() {
            self.separate(i);
            self.text.extend_from_slice(zmij::Buffer::new().format_finite(value).as_bytes());
        }
    }

    fn numbers<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        for (i, &value) in values.into_iter().enumerate() {
            self.separate(i);
            push_number(&mut self.text, value);
        }
    }

    fn separate(&mut self, column: usize) {
        if column > 0 {
            self.text.push(b' ');
        }
    }

    fn point(&mut self, p: Point) {
        self.text.push(b' ');
        self.numbers(p.iter());
    }
}

pub(super) fn write(
    lattice: &Lattice,
    options: &LatticeOptions,
    steps: &Steps<'_>,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let closed = Cell::new(false);
    let tap = Tap { out, closed: &closed };
    let mut archive = Archive {
        zip: ZipWriter::new_stream(tap),
        text: Vec::with_capacity(2 * BLOCK_BYTES),
        control: steps.control,
    };
    let written = write_files(lattice, options, steps, &mut archive);
    // A writer that is dropped half way finishes its archive first, and complains where it can't.
    closed.set(written.is_err());
    written?;
    archive.zip.finish().map_err(io::Error::from).map_err(|error| {
        closed.set(true);
        ExportError::Write(error)
    })?;
    Ok(())
}

fn write_files<W: Write>(
    lattice: &Lattice,
    options: &LatticeOptions,
    steps: &Steps<'_>,
    archive: &mut Archive<'_, W>,
) -> Result<(), ExportError> {
    archive.start("summary.json")?;
    let summary = Summary { engine: crate::VERSION, options, report: &lattice.report };
    archive.text = serde_json::to_vec_pretty(&summary).map_err(io::Error::from)?;
    archive.end_line()?;
    write_nodes(lattice, archive)?;
    archive.begin(
        "tets",
        "Tetrahedra",
        "Node1 Node2 Node3 Node4",
        &["One line per tetrahedron, det(x2 - x1, x3 - x1, x4 - x1) > 0"],
    )?;
    for tet in &lattice.tets {
        archive.whole_numbers(tet);
        archive.end_line()?;
    }
    archive.begin("edges", "Edges", "Node1 Node2", &["One line per edge, lower node first"])?;
    for edge in lattice.topology.edges() {
        archive.whole_numbers(&edge);
        archive.end_line()?;
    }
    write_surface(lattice, archive)?;
    // By measured times.
    let facets = Part::new(steps.control, 0.0, 0.6);
    write_facets(lattice, archive, &Steps { control: &facets, ..*steps })?;
    let vertices = Part::new(steps.control, 0.6, 1.0);
    write_vertices(lattice, archive, &Steps { control: &vertices, ..*steps })?;
    archive.write()
}

fn write_nodes<W: Write>(lattice: &Lattice, archive: &mut Archive<'_, W>) -> Result<(), ExportError> {
    let nodes = &lattice.nodes;
    archive.begin(
        "nodes",
        "Nodes",
        "X Y Z",
        &["One line per node: those of the surface first, then grains"],
    )?;
    for p in &nodes.points_mm {
        archive.exactly(p);
        archive.end_line()?;
    }
    archive.begin(
        "particles",
        "Grains",
        "n x y z d",
        &["One line per grain; n counts grains, not nodes, and d is the diameter"],
    )?;
    for grain in 0..nodes.len() - nodes.boundary {
        let node = nodes.boundary + grain;
        let [x, y, z] = nodes.points_mm[node];
        archive.whole_numbers(&[grain as u32]);
        archive.text.push(b' ');
        archive.exactly(&[x, y, z, nodes.diameter_mm(node)]);
        archive.end_line()?;
    }
    Ok(())
}

fn write_surface<W: Write>(lattice: &Lattice, archive: &mut Archive<'_, W>) -> Result<(), ExportError> {
    archive.begin(
        "faceFacets",
        "Facets on the surface",
        "n x1 y1 z1 x2 y2 z2 x3 y3 z3",
        &["Six lines per triangle of the surface, two for each of its nodes n; corners in outward order"],
    )?;
    for face in topology::boundary(&lattice.tets, &lattice.neighbors) {
        for (node, corners) in boundary_facets(&lattice.nodes, face) {
            archive.whole_numbers(&[node]);
            for corner in corners {
                archive.point(corner);
            }
            archive.end_line()?;
        }
    }
    Ok(())
}

fn write_facets<W: Write>(
    lattice: &Lattice,
    archive: &mut Archive<'_, W>,
    steps: &Steps<'_>,
) -> Result<(), ExportError> {
    archive.begin(
        "facets",
        "Facets",
        "Tet IDx IDy IDz Vol pArea cx cy cz px py pz qx qy qz sx sy sz mF",
        &[
            "One line per facet, twelve per tetrahedron in its order",
            "IDx IDy IDz are lines of facetsVertices",
        ],
    )?;
    let mut row = 0_u64;
    for (t, &tet) in lattice.tets.iter().enumerate() {
        steps.look(t)?;
        for facet in Tet::new(&lattice.nodes, tet).facets() {
            push_whole(&mut archive.text, t as u64);
            for corner in 0..3 {
                archive.text.push(b' ');
                push_whole(&mut archive.text, 3 * row + corner);
            }
            archive.text.push(b' ');
            archive.numbers(&[facet.unsigned_volume(), facet.projected_area().abs()]);
            let [q, s] = facet.tangents();
            for vector in [facet.centroid(), facet.normal, q, s] {
                archive.point(vector);
            }
            // One material.
            archive.text.extend_from_slice(b" 0");
            archive.end_line()?;
            row += 1;
        }
    }
    Ok(())
}

fn write_vertices<W: Write>(
    lattice: &Lattice,
    archive: &mut Archive<'_, W>,
    steps: &Steps<'_>,
) -> Result<(), ExportError> {
    archive.begin(
        "facetsVertices",
        "Vertices of the facets",
        "X Y Z",
        &["Three lines per facet: the points of its tetrahedron, face and edge"],
    )?;
    for (t, &tet) in lattice.tets.iter().enumerate() {
        steps.look(t)?;
        for facet in Tet::new(&lattice.nodes, tet).facets() {
            for vertex in facet.vertices {
                archive.numbers(vertex.iter());
                archive.end_line()?;
            }
        }
    }
    Ok(())
}
