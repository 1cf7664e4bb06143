//! A lattice as VTK unstructured grids: its tetrahedra, its facets, its cells.
//!
//! Points of facets and cells are numbered tetrahedra first, then faces, then edges, then nodes of the surface,
//! so that neighbours share them. Every array is a pass over the lattice, and computes facets and cells anew.

use std::io::Write;

use super::Lattice;
use super::tessellation::{EDGES, FACETS, Tet, edge_point, face_point, is_even, point};
use super::topology::{self, has_first};
use crate::arrays::Each as _;
use crate::export::steps::{LOOKS_PER_REPORT, Steps};
use crate::export::vtk_xml::VtkXml;
use crate::export::{ExportError, Provenance, go_on};
use crate::geometry::delaunay::{FACES, NONE};

const TETRA: u8 = 10;
const TRIANGLE: u8 = 5;
const POLYHEDRON: u8 = 42;

/// A lattice to be written.
pub(super) struct Vtu<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) provenance: Option<&'a Provenance>,
    pub(super) steps: &'a Steps<'a>,
}

impl Vtu<'_> {
    fn file(&self, points: usize, cells: usize) -> VtkXml<'_> {
        let piece = [("NumberOfPoints", points.to_string()), ("NumberOfCells", cells.to_string())];
        VtkXml::new("UnstructuredGrid", &[], &piece, self.provenance)
    }

    fn write(&self, file: VtkXml<'_>, out: &mut dyn Write) -> Result<(), ExportError> {
        let steps = Steps { total: file.bytes() as usize, unit: "bytes", ..*self.steps };
        let mut blocks: usize = 0;
        file.write(out, &mut |written| {
            if blocks.is_multiple_of(LOOKS_PER_REPORT) {
                steps.report(written as usize);
            }
            blocks += 1;
            go_on(steps.control)
        })
    }

    /// Writes tetrahedra between nodes.
    pub(super) fn write_tets(&self, out: &mut dyn Write) -> Result<(), ExportError> {
        let Lattice { nodes, tets, cells, .. } = self.lattice;
        let (n, m) = (nodes.len(), tets.len());
        let mut file = self.file(n, m);
        file.section("Points", None);
        file.array("Points", n, nodes.points_mm.iter().copied());
        file.section("PointData", None);
        file.array("radius", n, nodes.radii_mm.iter().copied());
        file.array("diameter", n, (0..n).map(|node| nodes.diameter_mm(node)));
        file.array("grain", n, (0..n).map(|node| self.lattice.grain(node)));
        file.array("cell_volume", n, cells.iter().map(|cell| cell.volume_mm3));
        file.section("CellData", None);
        file.array("volume", m, tets.iter().map(|&tet| Tet::new(nodes, tet).volume()));
        file.section("Cells", None);
        file.array("connectivity", 4 * m, tets.as_flattened().iter().map(|&node| node as i32));
        file.array("offsets", m, (1..=m).map(|t| 4 * t as i64));
        file.array("types", m, std::iter::repeat_n(TETRA, m));
        self.write(file, out)
    }

    /// Writes facets as triangles.
    pub(super) fn write_facets(&self, out: &mut dyn Write) -> Result<(), ExportError> {
        let numbers = Numbers::new(self.lattice)?;
        let Lattice { nodes, tets, .. } = self.lattice;
        let points = (numbers.tets + numbers.faces + numbers.edges) as usize;
        let m = 12 * tets.len();
        let facets = || {
            tets.iter().flat_map(|&tet| {
                let tet = Tet::new(nodes, tet);
                (0..12).map(move |facet| tet.facet(facet))
            })
        };
        let mut file = self.file(points, m);
        file.section("Points", None);
        file.array("Points", points, numbers.points());
        file.section("CellData", None);
        file.array("area", m, facets().map(|facet| facet.area()));
        file.array("projected_area", m, facets().map(|facet| facet.projected_area()));
        file.array("volume", m, facets().map(|facet| facet.volumes[0] + facet.volumes[1]));
        file.array("normal", m, facets().map(|facet| <[f64; 3]>::from(facet.normal)));
        file.array("tangent_1", m, facets().map(|facet| <[f64; 3]>::from(facet.tangents()[0])));
        file.array("tangent_2", m, facets().map(|facet| <[f64; 3]>::from(facet.tangents()[1])));
        file.array("tetrahedron", m, (0..m).map(|facet| (facet / 12) as i32));
        let ends = |tet: &[u32; 4], edge: usize| EDGES[edge].each(|corner| tet[corner] as i32);
        let nodes_of = move |tet| FACETS.each(|[edge, _]| ends(tet, edge));
        file.array("nodes", m, tets.iter().flat_map(nodes_of));
        file.section("Cells", None);
        let corners = |t| (0..12).flat_map(move |facet| numbers.facet(t, facet));
        file.array("connectivity", 3 * m, (0..numbers.tets).flat_map(corners));
        file.array("offsets", m, (1..=m).map(|facet| 3 * facet as i64));
        file.array("types", m, std::iter::repeat_n(TRIANGLE, m));
        self.write(file, out)
    }

    /// Writes the cells of nodes as polyhedra.
    pub(super) fn write_cells(&self, out: &mut dyn Write) -> Result<(), ExportError> {
        let numbers = &Numbers::new(self.lattice)?;
        let Lattice { nodes, cells, tets, neighbors, topology, report } = self.lattice;
        let n = nodes.len();
        let [t, f, e] = [numbers.tets, numbers.faces, numbers.edges].each(|count| count as usize);
        let surface_triangles = report.surface_triangles as usize;
        let points = t + f + e + nodes.boundary;
        // Each tetrahedron has a point in the cells of its four nodes, each face in three, each edge in two, each node
        // of the surface in its own.
        let connectivity = 4 * t + 3 * f + 2 * e + self.lattice.surface_nodes() as usize;
        // Facets bound two cells, triangles of the surface come in six parts; each is a count and three points, and
        // each cell has a count of them.
        let faces = n + 4 * (24 * t + 6 * surface_triangles);
        let mut surface_at = vec![0_usize; n];
        for node in topology::boundary(tets, neighbors).flatten() {
            surface_at[node as usize] += 1;
        }
        let triangles_at = |node: usize| 6 * topology.tets_at(node).len() + 2 * surface_at[node];
        // Ends of what the cells have, from how much each has.
        let ends = |count: fn(usize) -> usize| {
            (0..n).scan(0, move |end, node| {
                *end += count(triangles_at(node)) as i64;
                Some(*end)
            })
        };
        let mut file = self.file(points, n);
        file.section("Points", None);
        let on_surface = nodes.points_mm[..nodes.boundary].iter().copied();
        file.array("Points", points, numbers.points().chain(on_surface));
        file.section("CellData", None);
        file.array("volume", n, cells.iter().map(|cell| cell.volume_mm3));
        file.array("diameter", n, (0..n).map(|node| nodes.diameter_mm(node)));
        file.array("grain", n, (0..n).map(|node| self.lattice.grain(node)));
        let center = |(cell, &p): (&super::Cell, _)| {
            <[f64; 3]>::from(point(p) + point(cell.first_moment_mm4) / cell.volume_mm3)
        };
        file.array("center_of_mass", n, cells.iter().zip(&nodes.points_mm).map(center));
        file.section("Cells", None);
        file.fill::<i32>("connectivity", connectivity, |sink| {
            let mut cell = Polyhedron::default();
            (0..n).try_for_each(|node| {
                cell.take(numbers, node as u32);
                cell.points().iter().try_for_each(|&point| sink.put(point))
            })
        });
        // The triangles close a sphere: Euler's formula has its points.
        file.array("offsets", n, ends(|triangles| triangles / 2 + 2));
        file.array("types", n, std::iter::repeat_n(POLYHEDRON, n));
        file.fill::<i32>("faces", faces, |sink| {
            let mut cell = Polyhedron::default();
            (0..n).try_for_each(|node| {
                cell.take(numbers, node as u32);
                sink.put(cell.triangles.len() as i32)?;
                cell.triangles.iter().try_for_each(|&[a, b, c]| sink.put([3, a, b, c]))
            })
        });
        file.array("faceoffsets", n, ends(|triangles| 1 + 4 * triangles));
        self.write(file, out)
    }
}

impl Lattice {
    /// Row of the grain at a node; -1 for nodes of the surface.
    fn grain(&self, node: usize) -> i32 {
        (node as i32 - self.nodes.boundary as i32).max(-1)
    }
}

/// Numbers of the points of facets and cells.
#[derive(Clone, Copy)]
struct Numbers<'a> {
    lattice: &'a Lattice,
    tets: u32,
    faces: u32,
    edges: u32,
}

impl<'a> Numbers<'a> {
    fn new(lattice: &'a Lattice) -> Result<Self, ExportError> {
        let topology = &lattice.topology;
        let (tets, faces, edges) = (lattice.tets.len(), topology.faces, topology.edge_ends.len());
        let all = tets as u64 + u64::from(faces) + edges as u64 + lattice.nodes.boundary as u64;
        if all > i32::MAX as u64 {
            return Err(ExportError::Unavailable(format!(
                "the grid has {all} points, more than 32 bits can number: write the file `chrono` or `tets`"
            )));
        }
        Ok(Self { lattice, tets: tets as u32, faces, edges: edges as u32 })
    }

    fn face(&self, t: u32, k: usize) -> i32 {
        (self.tets + self.lattice.topology.face(&self.lattice.neighbors, t, k)) as i32
    }

    fn edge(&self, a: u32, b: u32) -> i32 {
        (self.tets + self.faces + self.lattice.topology.edge(a, b)) as i32
    }

    fn node(&self, node: u32) -> i32 {
        (self.tets + self.faces + self.edges + node) as i32
    }

    /// Corners of a facet of tetrahedron `t`: its own point, the face's, the edge's.
    fn facet(&self, t: u32, facet: usize) -> [i32; 3] {
        let [edge, face] = FACETS[facet];
        let [i, j] = EDGES[edge].each(|corner| self.lattice.tets[t as usize][corner]);
        [t as i32, self.face(t, face), self.edge(i, j)]
    }

    /// All points but those of nodes.
    fn points(&self) -> impl Iterator<Item = [f64; 3]> {
        let Lattice { nodes, tets, neighbors, topology, .. } = self.lattice;
        let of_tets = tets.iter().map(|&tet| Tet::new(nodes, tet).middle);
        let of_faces = tets.iter().zip(neighbors).enumerate().flat_map(move |(t, (tet, across))| {
            let own = (0..4).filter(move |&k| has_first(t as u32, across[k]));
            own.map(move |k| face_point(nodes, FACES[k].each(|corner| tet[corner])))
        });
        let of_edges = topology.edges().map(|[a, b]| edge_point(nodes, a, b));
        of_tets.chain(of_faces).chain(of_edges).map(Into::into)
    }
}

/// What makes up one cell, as numbers of points.
#[derive(Default)]
struct Polyhedron {
    points: Vec<i32>,
    triangles: Vec<[i32; 3]>,
}

impl Polyhedron {
    /// Becomes the cell of a node.
    fn take(&mut self, numbers: &Numbers<'_>, node: u32) {
        let lattice = numbers.lattice;
        self.triangles.clear();
        for &t in lattice.topology.tets_at(node as usize) {
            let tet = lattice.tets[t as usize];
            let Some(own) = tet.iter().position(|&n| n == node) else { continue };
            for (facet, [edge, _]) in FACETS.into_iter().enumerate() {
                let [i, j] = EDGES[edge];
                if i == own || j == own {
                    let [middle, face, edge] = numbers.facet(t, facet);
                    // Outward from the first node of the edge where the chain is even.
                    let outward = is_even(facet) == (i == own);
                    self.triangles.push(if outward { [edge, face, middle] } else { [edge, middle, face] });
                }
            }
            for k in (0..4).filter(|&k| k != own && lattice.neighbors[t as usize][k] == NONE) {
                let Some(at) = FACES[k].iter().position(|&corner| corner == own) else { continue };
                let [before, after] = [FACES[k][(at + 1) % 3], FACES[k][(at + 2) % 3]]
                    .each(|other| numbers.edge(node, tet[other]));
                let (own_point, face) = (numbers.node(node), numbers.face(t, k));
                self.triangles.extend([[own_point, before, face], [own_point, face, after]]);
            }
        }
    }

    /// Its points, each once.
    fn points(&mut self) -> &[i32] {
        self.points.clear();
        self.points.extend(self.triangles.as_flattened());
        self.points.sort_unstable();
        self.points.dedup();
        &self.points
    }
}
