//! A lattice as VTK unstructured grids: its tetrahedra, its facets, its cells.
//!
//! Points of facets and cells are numbered tetrahedra first, then faces, then edges, then nodes of the surface,
//! so that neighbours share them. Every array is a pass over the lattice, and computes facets and cells again; threads
//! share it.

use std::io::Write;
use std::num::NonZeroUsize;
use std::ops::Range;

use super::Lattice;
use super::tessellation::{EDGES, FACETS, Facet, Point, Tet, edge_point, face_point, is_even, point};
use super::topology::{self, has_first};
use crate::arrays::Each as _;
use crate::export::steps::{PIECES_PER_REPORT, Steps};
use crate::export::vtk_xml::{Value, Values, VtkXml};
use crate::export::{ExportError, Provenance, go_on};
use crate::geometry::delaunay::{FACES, NONE};

const TETRA: u8 = 10;
const TRIANGLE: u8 = 5;
const POLYHEDRON: u8 = 42;

/// A lattice to be written.
pub(super) struct Vtu<'a> {
    pub(super) lattice: &'a Lattice<'a>,
    pub(super) provenance: Option<&'a Provenance>,
    pub(super) steps: &'a Steps<'a>,
    /// Threads that share the arrays.
    pub(super) threads: NonZeroUsize,
}

impl<'a> Vtu<'a> {
    fn file<'f>(&self, points: usize, cells: usize) -> VtkXml<'f> {
        let piece = [("NumberOfPoints", points.to_string()), ("NumberOfCells", cells.to_string())];
        VtkXml::new("UnstructuredGrid", &[], &piece, self.provenance).on_threads(self.threads)
    }

    /// Adds an array with a value of each facet.
    fn of_facets<T: Value>(
        &self,
        file: &mut VtkXml<'a>,
        name: &'static str,
        value: impl Fn(&Facet) -> T + Sync + 'a,
    ) {
        let Lattice { nodes, tets, .. } = self.lattice;
        file.shared::<T>(
            name,
            (12 * tets.len(), tets.len()),
            move |range: Range<usize>, values: &mut Values| {
                for &tet in &tets[range] {
                    Tet::new(nodes, tet).facets().for_each(|facet| values.put(value(&facet)));
                }
            },
        );
    }

    fn write(&self, file: VtkXml<'_>, out: &mut dyn Write) -> Result<(), ExportError> {
        let steps = Steps { total: file.bytes() as usize, unit: "bytes", ..*self.steps };
        let mut blocks: usize = 0;
        file.write(out, &mut |written| {
            if blocks.is_multiple_of(PIECES_PER_REPORT) {
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
        let tets = &self.lattice.tets;
        let points = (numbers.tets + numbers.faces + numbers.edges) as usize;
        let m = 12 * tets.len();
        let mut file = self.file(points, m);
        file.section("Points", None);
        file.shared::<[f64; 3]>("Points", (points, numbers.owners()), move |range, values| {
            range.for_each(|owner| numbers.points_of(owner, values));
        });
        file.section("CellData", None);
        self.of_facets(&mut file, "area", Facet::area);
        self.of_facets(&mut file, "projected_area", Facet::projected_area);
        self.of_facets(&mut file, "volume", |facet| facet.volumes[0] + facet.volumes[1]);
        self.of_facets(&mut file, "normal", |facet| <[f64; 3]>::from(facet.normal));
        self.of_facets(&mut file, "tangent_1", |facet| <[f64; 3]>::from(facet.tangents()[0]));
        self.of_facets(&mut file, "tangent_2", |facet| <[f64; 3]>::from(facet.tangents()[1]));
        file.array("tetrahedron", m, (0..m).map(|facet| (facet / 12) as i32));
        let ends = |tet: &[u32; 4], edge: usize| EDGES[edge].each(|corner| tet[corner] as i32);
        let nodes_of = move |tet| FACETS.each(|[edge, _]| ends(tet, edge));
        file.array("nodes", m, tets.iter().flat_map(nodes_of));
        file.section("Cells", None);
        file.shared::<i32>("connectivity", (3 * m, tets.len()), move |range, values| {
            for t in range {
                (0..12).for_each(|facet| values.put(numbers.facet(t as u32, facet)));
            }
        });
        file.array("offsets", m, (1..=m).map(|facet| 3 * facet as i64));
        file.array("types", m, std::iter::repeat_n(TRIANGLE, m));
        self.write(file, out)
    }

    /// Writes the cells of nodes as polyhedra.
    pub(super) fn write_cells(&self, out: &mut dyn Write) -> Result<(), ExportError> {
        let numbers = Numbers::new(self.lattice)?;
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
        let owners = numbers.owners();
        file.shared::<[f64; 3]>("Points", (points, owners + nodes.boundary), move |range, values| {
            range.for_each(|owner| match owner.checked_sub(owners) {
                None => numbers.points_of(owner, values),
                Some(node) => values.put(nodes.points_mm[node]),
            });
        });
        file.section("CellData", None);
        file.array("volume", n, cells.iter().map(|cell| cell.volume_mm3));
        file.array("diameter", n, (0..n).map(|node| nodes.diameter_mm(node)));
        file.array("grain", n, (0..n).map(|node| self.lattice.grain(node)));
        let center = |(cell, &p): (&super::Cell, _)| {
            <[f64; 3]>::from(point(p) + point(cell.first_moment_mm4) / cell.volume_mm3)
        };
        file.array("center_of_mass", n, cells.iter().zip(&nodes.points_mm).map(center));
        file.section("Cells", None);
        file.shared::<i32>("connectivity", (connectivity, n), move |range, values| {
            let mut cell = Polyhedron::default();
            for node in range {
                cell.take(&numbers, node as u32);
                cell.points().iter().for_each(|&point| values.put(point));
            }
        });
        // The triangles close a sphere: Euler's formula has its points.
        file.array("offsets", n, ends(|triangles| triangles / 2 + 2));
        file.array("types", n, std::iter::repeat_n(POLYHEDRON, n));
        file.shared::<i32>("faces", (faces, n), move |range, values| {
            let mut cell = Polyhedron::default();
            for node in range {
                cell.take(&numbers, node as u32);
                values.put(cell.triangles.len() as i32);
                cell.triangles.iter().for_each(|&[a, b, c]| values.put([3, a, b, c]));
            }
        });
        file.array("faceoffsets", n, ends(|triangles| 1 + 4 * triangles));
        self.write(file, out)
    }
}

impl Lattice<'_> {
    /// Row of the grain at a node; -1 for nodes of the surface.
    fn grain(&self, node: usize) -> i32 {
        (node as i32 - self.nodes.boundary as i32).max(-1)
    }
}

/// Numbers of the points of facets and cells.
#[derive(Clone, Copy)]
struct Numbers<'a> {
    lattice: &'a Lattice<'a>,
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

    /// Number of what has points, but for those of nodes: tetrahedra have their own, tetrahedra again those of their
    /// faces, nodes those of their edges.
    fn owners(&self) -> usize {
        2 * self.tets as usize + self.lattice.nodes.len()
    }

    /// Puts the points of an owner, in the order of their numbers.
    fn points_of(&self, owner: usize, values: &mut Values) {
        let Lattice { nodes, tets, neighbors, topology, .. } = self.lattice;
        let mut put = |point: Point| values.put(<[f64; 3]>::from(point));
        if let Some(&tet) = tets.get(owner) {
            return put(Tet::new(nodes, tet).middle);
        }
        let owner = owner - tets.len();
        if let Some(tet) = tets.get(owner) {
            let own = (0..4).filter(|&k| has_first(owner as u32, neighbors[owner][k]));
            return own.for_each(|k| put(face_point(nodes, FACES[k].each(|corner| tet[corner]))));
        }
        let node = owner - tets.len();
        topology.edges_of(node).iter().for_each(|&end| put(edge_point(nodes, node as u32, end)));
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
