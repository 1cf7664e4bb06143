//! The files that Project Chrono's reader of lattices takes, in one zip: text, each line that is no data begun
//! with `//`, numbers from 0.
//!
//! The layout is that of the workbench which the reader was written for. Nodes are written in full, so that the
//! lattice can be made from them again to the last bit; what follows from them has ten digits, as there.

use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::ops::Range;

use serde::Serialize;

use super::tessellation::{FACETS, Point, Tet, boundary_facets};
use super::{Lattice, LatticeOptions, LatticeReport, topology};
use crate::control::Part;
use crate::export::archive::{Archive, Content, PIECE_BYTES};
use crate::export::digits::{SPARE_BYTES, push_exact, push_number, push_whole};
use crate::export::steps::Steps;
use crate::export::{ExportError, go_on};
use crate::memory::reserved;

/// Name that all files begin with.
pub(super) const NAME: &str = "ldpm";
/// Most bytes of a number, with the space before it.
const NUMBER_BYTES: usize = 26;
/// Most bytes of what stands before the lines of a file.
const TITLE_BYTES: usize = 1 << 12;

/// Everything about a lattice but its elements.
#[derive(Serialize)]
struct Summary<'a> {
    engine: &'static str,
    options: &'a LatticeOptions,
    report: &'a LatticeReport,
}

/// What a file is about, and how much there is of it.
struct Title<'a> {
    suffix: &'a str,
    heading: &'a str,
    columns: &'a str,
    notes: &'a [&'a str],
    /// Number of what it lists.
    items: usize,
    /// Most numbers that an item has, in all its lines.
    numbers: usize,
}

impl Title<'_> {
    fn write(&self, text: &mut Vec<u8>) -> io::Result<()> {
        let rule = "// ================================================================================";
        writeln!(text, "{rule}\n// Packstone {}: lattice discrete particle model\n{rule}", crate::VERSION)?;
        writeln!(text, "// {}\n//\n// Data Structure:\n// {}", self.heading, self.columns)?;
        for note in self.notes {
            writeln!(text, "// {note}")?;
        }
        writeln!(text, "// Lengths in mm. All indices count from zero.\n{rule}")
    }
}

/// Adds a file of items; the steps count them.
fn add(
    archive: &mut Archive<'_>,
    steps: &Steps<'_>,
    title: &Title<'_>,
    write: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> Result<(), ExportError> {
    let item_bytes = NUMBER_BYTES * title.numbers;
    let items = PIECE_BYTES / item_bytes;
    let content = Content {
        pieces: title.items.div_ceil(items).max(1),
        most_bytes: TITLE_BYTES + items * item_bytes + SPARE_BYTES,
        write: |piece, text: &mut Vec<u8>| {
            go_on(steps.control)?;
            if piece == 0 {
                title.write(text)?;
            }
            for item in piece * items..title.items.min((piece + 1) * items) {
                write(item, text);
            }
            Ok(())
        },
        taken: |piece| steps.report(title.items.min((piece + 1) * items)),
    };
    archive.add(&format!("{NAME}-data-{}.dat", title.suffix), content)
}

fn whole_numbers(text: &mut Vec<u8>, values: &[u32]) {
    for (i, &value) in values.iter().enumerate() {
        separate(text, i);
        push_whole(text, u64::from(value));
    }
}

/// Numbers that read back exactly.
fn exactly(text: &mut Vec<u8>, values: &[f64]) {
    for (i, &value) in values.iter().enumerate() {
        separate(text, i);
        push_exact(text, value);
    }
}

fn numbers(text: &mut Vec<u8>, values: &[f64]) {
    for (i, &value) in values.iter().enumerate() {
        separate(text, i);
        push_number(text, value);
    }
}

fn separate(text: &mut Vec<u8>, column: usize) {
    if column > 0 {
        text.push(b' ');
    }
}

fn point(text: &mut Vec<u8>, p: Point) {
    text.push(b' ');
    numbers(text, p.as_slice());
}

pub(super) fn write(
    lattice: &Lattice,
    options: &LatticeOptions,
    threads: NonZeroUsize,
    steps: &Steps<'_>,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let mut archive = Archive::new(out, threads)?;
    write_summary(lattice, options, &mut archive)?;
    // By measured sizes.
    let parts = [0.0, 0.01, 0.04, 0.66, 1.0];
    let part = |i: usize| Part::new(steps.control, parts[i], parts[i + 1]);
    write_nodes(lattice, &mut archive, &Steps { control: &part(0), ..*steps })?;
    write_topology(lattice, &mut archive, &Steps { control: &part(1), ..*steps })?;
    write_facets(lattice, &mut archive, &Steps { control: &part(2), ..*steps })?;
    write_vertices(lattice, &mut archive, &Steps { control: &part(3), ..*steps })?;
    archive.finish()
}

fn write_summary(
    lattice: &Lattice,
    options: &LatticeOptions,
    archive: &mut Archive<'_>,
) -> Result<(), ExportError> {
    let summary = Summary { engine: crate::VERSION, options, report: &lattice.report };
    let mut text = serde_json::to_vec_pretty(&summary).map_err(io::Error::from)?;
    text.push(b'\n');
    let content = Content {
        pieces: 1,
        most_bytes: text.len(),
        write: |_, piece: &mut Vec<u8>| {
            piece.extend_from_slice(&text);
            Ok(())
        },
        taken: |_| {},
    };
    archive.add("summary.json", content)
}

fn write_nodes(lattice: &Lattice, archive: &mut Archive<'_>, steps: &Steps<'_>) -> Result<(), ExportError> {
    let nodes = &lattice.nodes;
    let title = Title {
        suffix: "nodes",
        heading: "Nodes",
        columns: "X Y Z",
        notes: &["One line per node: those of the surface first, then grains"],
        items: nodes.len(),
        numbers: 3,
    };
    add(archive, steps, &title, |node, text| {
        exactly(text, &nodes.points_mm[node]);
        text.push(b'\n');
    })?;
    let title = Title {
        suffix: "particles",
        heading: "Grains",
        columns: "n x y z d",
        notes: &["One line per grain; n counts grains, not nodes, and d is the diameter"],
        items: nodes.len() - nodes.boundary,
        numbers: 5,
    };
    add(archive, steps, &title, |grain, text| {
        let node = nodes.boundary + grain;
        let [x, y, z] = nodes.points_mm[node];
        whole_numbers(text, &[grain as u32]);
        text.push(b' ');
        exactly(text, &[x, y, z, nodes.diameter_mm(node)]);
        text.push(b'\n');
    })
}

fn write_topology(
    lattice: &Lattice,
    archive: &mut Archive<'_>,
    steps: &Steps<'_>,
) -> Result<(), ExportError> {
    let title = Title {
        suffix: "tets",
        heading: "Tetrahedra",
        columns: "Node1 Node2 Node3 Node4",
        notes: &["One line per tetrahedron, det(x2 - x1, x3 - x1, x4 - x1) > 0"],
        items: lattice.tets.len(),
        numbers: 4,
    };
    add(archive, steps, &title, |tet, text| {
        whole_numbers(text, &lattice.tets[tet]);
        text.push(b'\n');
    })?;
    let title = Title {
        suffix: "edges",
        heading: "Edges",
        columns: "Node1 Node2",
        notes: &["One line per edge, lower node first"],
        items: lattice.topology.edge_ends.len(),
        numbers: 2,
    };
    add(archive, steps, &title, |edge, text| {
        whole_numbers(text, &lattice.topology.ends(edge));
        text.push(b'\n');
    })?;
    let mut faces = reserved(lattice.report.surface_triangles as usize)?;
    faces.extend(topology::boundary(&lattice.tets, &lattice.neighbors));
    let title = Title {
        suffix: "faceFacets",
        heading: "Facets on the surface",
        columns: "n x1 y1 z1 x2 y2 z2 x3 y3 z3",
        notes: &[
            "Six lines per triangle of the surface, two for each of its nodes n; corners in outward order",
        ],
        items: faces.len(),
        numbers: 6 * 10,
    };
    add(archive, steps, &title, |face, text| {
        for (node, corners) in boundary_facets(&lattice.nodes, faces[face]) {
            whole_numbers(text, &[node]);
            for corner in corners {
                point(text, corner);
            }
            text.push(b'\n');
        }
    })
}

fn write_facets(lattice: &Lattice, archive: &mut Archive<'_>, steps: &Steps<'_>) -> Result<(), ExportError> {
    let title = Title {
        suffix: "facets",
        heading: "Facets",
        columns: "Tet IDx IDy IDz Vol pArea cx cy cz px py pz qx qy qz sx sy sz mF",
        notes: &[
            "One line per facet, twelve per tetrahedron in its order",
            "IDx IDy IDz are lines of facetsVertices",
        ],
        items: lattice.tets.len(),
        numbers: 12 * 19,
    };
    add(archive, steps, &title, |t, text| {
        // The two facets of an edge have the same frame: its text is copied.
        let mut frame = (usize::MAX, 0..0);
        for (i, facet) in Tet::new(&lattice.nodes, lattice.tets[t]).facets().enumerate() {
            push_whole(text, t as u64);
            for corner in 0..3 {
                text.push(b' ');
                push_whole(text, 3 * (12 * t as u64 + i as u64) + corner);
            }
            text.push(b' ');
            numbers(text, &[facet.unsigned_volume(), facet.projected_area().abs()]);
            point(text, facet.centroid());
            let [edge, _] = FACETS[i];
            if frame.0 == edge {
                text.extend_from_within(frame.1.clone());
            } else {
                let start = text.len();
                let [q, s] = facet.tangents();
                for vector in [facet.normal, q, s] {
                    point(text, vector);
                }
                frame = (edge, start..text.len());
            }
            // One material.
            text.extend_from_slice(b" 0\n");
        }
    })
}

fn write_vertices(
    lattice: &Lattice,
    archive: &mut Archive<'_>,
    steps: &Steps<'_>,
) -> Result<(), ExportError> {
    let title = Title {
        suffix: "facetsVertices",
        heading: "Vertices of the facets",
        columns: "X Y Z",
        notes: &["Three lines per facet: the points of its tetrahedron, face and edge"],
        items: lattice.tets.len(),
        numbers: 12 * 3 * 3,
    };
    add(archive, steps, &title, |t, text| {
        // Facets share their corners, those of the tetrahedron, its faces and its edges: a line is made once and
        // copied.
        let mut lines: [Range<usize>; 11] = std::array::from_fn(|_| 0..0);
        for (facet, [edge, face]) in Tet::new(&lattice.nodes, lattice.tets[t]).facets().zip(FACETS) {
            for (vertex, corner) in facet.vertices.iter().zip([0, 1 + face, 5 + edge]) {
                let line = &mut lines[corner];
                if line.start == line.end {
                    let start = text.len();
                    numbers(text, vertex.as_slice());
                    text.push(b'\n');
                    *line = start..text.len();
                } else {
                    text.extend_from_within(line.clone());
                }
            }
        }
    })
}
