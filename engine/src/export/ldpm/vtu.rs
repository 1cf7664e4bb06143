//! A lattice as VTK unstructured grids: its tetrahedra, its facets, its cells.
//!
//! Points of facets and cells are numbered tetrahedra first, then faces, then edges, then nodes of the surface,
//! so that neighbours share them.

use std::io::Write;

use super::Lattice;
use super::grid::{Grid, Kind, Place, Sink};
use super::tessellation::{EDGES, FACES, FACETS, Facet, Tet, edge_point, face_point, is_even, point};
use super::topology::{self, NONE, has_first};
use super::work::Work;
use crate::export::ExportError;

const TETRA: u8 = 10;
const TRIANGLE: u8 = 5;
const POLYHEDRON: u8 = 42;

/// Nodes between two looks at whether to pass on.
const CHUNK: usize = 512;

impl Lattice {
    fn int_of_grain(&self, node: usize) -> i32 {
        node as i32 - self.nodes.boundary as i32
    }
}

/// Writes one value per item of a column.
fn column<'a, T: Copy>(
    sink: &mut Sink<'_>,
    items: impl Iterator<Item = T> + 'a,
    mut put: impl FnMut(&mut Sink<'_>, T),
) -> Result<(), ExportError> {
    for (i, item) in items.enumerate() {
        put(sink, item);
        if i % CHUNK == 0 {
            sink.pass_on()?;
        }
    }
    Ok(())
}

pub(super) fn write_tets(lattice: &Lattice, work: &Work<'_>, out: &mut dyn Write) -> Result<(), ExportError> {
    let (nodes, tets) = (&lattice.nodes, &lattice.tets);
    let (n, m) = (nodes.len() as u64, tets.len() as u64);
    let mut grid = Grid::new(n, m);
    grid.add((Place::Points, "Points"), (Kind::Float64, 3), 3 * n, |sink| {
        column(sink, nodes.points_mm.as_flattened().iter(), |sink, &x| sink.float(x))
    });
    grid.add((Place::PointData, "radius"), (Kind::Float64, 1), n, |sink| {
        column(sink, nodes.radii_mm.iter(), |sink, &r| sink.float(r))
    });
    grid.add((Place::PointData, "diameter"), (Kind::Float64, 1), n, |sink| {
        column(sink, 0..nodes.len(), |sink, node| sink.float(nodes.diameter_mm(node)))
    });
    grid.add((Place::PointData, "grain"), (Kind::Int32, 1), n, |sink| {
        column(sink, 0..nodes.len(), |sink, node| sink.int(lattice.int_of_grain(node).max(-1)))
    });
    grid.add((Place::PointData, "cell_volume"), (Kind::Float64, 1), n, |sink| {
        column(sink, lattice.cells.iter(), |sink, cell| sink.float(cell.volume_mm3))
    });
    grid.add((Place::CellData, "volume"), (Kind::Float64, 1), m, |sink| {
        for &tet in tets {
            sink.float(Tet::new(nodes, tet).volume());
            sink.pass_on()?;
        }
        Ok(())
    });
    grid.add((Place::Cells, "connectivity"), (Kind::Int32, 1), 4 * m, |sink| {
        column(sink, tets.as_flattened().iter(), |sink, &node| sink.int(node as i32))
    });
    grid.add((Place::Cells, "offsets"), (Kind::Int64, 1), m, |sink| {
        column(sink, 1..=m, |sink, t| sink.long(4 * t))
    });
    grid.add((Place::Cells, "types"), (Kind::UInt8, 1), m, |sink| {
        column(sink, 0..m, |sink, _| sink.byte(TETRA))
    });
    grid.write(work, out)
}

/// Numbers of the points of facets and cells.
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
        let [i, j] = EDGES[edge].map(|corner| self.lattice.tets[t as usize][corner]);
        [t as i32, self.face(t, face), self.edge(i, j)]
    }

    /// Writes all points but those of nodes.
    fn write_points(&self, sink: &mut Sink<'_>) -> Result<(), ExportError> {
        let Lattice { nodes, tets, neighbors, topology, .. } = self.lattice;
        for &tet in tets {
            sink.floats(Tet::new(nodes, tet).middle.iter());
            sink.pass_on()?;
        }
        for (t, (tet, across)) in tets.iter().zip(neighbors).enumerate() {
            for (k, &other) in across.iter().enumerate() {
                if has_first(t as u32, other) {
                    sink.floats(face_point(nodes, FACES[k].map(|corner| tet[corner])).iter());
                }
            }
            sink.pass_on()?;
        }
        for [a, b] in topology.edges() {
            sink.floats(edge_point(nodes, a, b).iter());
            sink.pass_on()?;
        }
        Ok(())
    }
}

pub(super) fn write_facets(
    lattice: &Lattice,
    work: &Work<'_>,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let numbers = Numbers::new(lattice)?;
    let (nodes, tets) = (&lattice.nodes, &lattice.tets);
    let points = u64::from(numbers.tets) + u64::from(numbers.faces) + u64::from(numbers.edges);
    let m = 12 * tets.len() as u64;
    // Every array is a pass, and computes the facets anew.
    let each = |sink: &mut Sink<'_>, put: &dyn Fn(&mut Sink<'_>, &Facet)| {
        for &tet in tets {
            Tet::new(nodes, tet).facets().for_each(|facet| put(sink, &facet));
            sink.pass_on()?;
        }
        Ok(())
    };
    let mut grid = Grid::new(points, m);
    grid.add((Place::Points, "Points"), (Kind::Float64, 3), 3 * points, |sink| numbers.write_points(sink));
    grid.add((Place::CellData, "area"), (Kind::Float64, 1), m, move |sink| {
        each(sink, &|sink, facet| sink.float(facet.area()))
    });
    grid.add((Place::CellData, "projected_area"), (Kind::Float64, 1), m, move |sink| {
        each(sink, &|sink, facet| sink.float(facet.projected_area()))
    });
    grid.add((Place::CellData, "volume"), (Kind::Float64, 1), m, move |sink| {
        each(sink, &|sink, facet| sink.float(facet.volumes[0] + facet.volumes[1]))
    });
    grid.add((Place::CellData, "normal"), (Kind::Float64, 3), 3 * m, move |sink| {
        each(sink, &|sink, facet| sink.floats(facet.normal.iter()))
    });
    grid.add((Place::CellData, "tangent_1"), (Kind::Float64, 3), 3 * m, move |sink| {
        each(sink, &|sink, facet| sink.floats(facet.tangents()[0].iter()))
    });
    grid.add((Place::CellData, "tangent_2"), (Kind::Float64, 3), 3 * m, move |sink| {
        each(sink, &|sink, facet| sink.floats(facet.tangents()[1].iter()))
    });
    grid.add((Place::CellData, "tetrahedron"), (Kind::Int32, 1), m, |sink| {
        column(sink, 0..tets.len(), |sink, t| (0..12).for_each(|_| sink.int(t as i32)))
    });
    grid.add((Place::CellData, "nodes"), (Kind::Int32, 2), 2 * m, |sink| {
        column(sink, tets.iter(), |sink, tet| {
            for [edge, _] in FACETS {
                EDGES[edge].iter().for_each(|&corner| sink.int(tet[corner] as i32));
            }
        })
    });
    grid.add((Place::Cells, "connectivity"), (Kind::Int32, 1), 3 * m, |sink| {
        for t in 0..numbers.tets {
            (0..12).flat_map(|facet| numbers.facet(t, facet)).for_each(|point| sink.int(point));
            sink.pass_on()?;
        }
        Ok(())
    });
    grid.add((Place::Cells, "offsets"), (Kind::Int64, 1), m, |sink| {
        column(sink, 1..=m, |sink, facet| sink.long(3 * facet))
    });
    grid.add((Place::Cells, "types"), (Kind::UInt8, 1), m, |sink| {
        column(sink, 0..m, |sink, _| sink.byte(TRIANGLE))
    });
    grid.write(work, out)
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
                    .map(|other| numbers.edge(node, tet[other]));
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

pub(super) fn write_cells(
    lattice: &Lattice,
    work: &Work<'_>,
    out: &mut dyn Write,
) -> Result<(), ExportError> {
    let numbers = Numbers::new(lattice)?;
    let nodes = &lattice.nodes;
    let n = nodes.len() as u64;
    let [t, f, e, b, s] = [
        u64::from(numbers.tets),
        u64::from(numbers.faces),
        u64::from(numbers.edges),
        nodes.boundary as u64,
        lattice.report.surface_triangles,
    ];
    let points = t + f + e + b;
    // Each tetrahedron has a point in the cells of its four nodes, each face in three, each edge in two, each node of
    // the surface in its own.
    let connectivity = 4 * t + 3 * f + 2 * e + lattice.surface_nodes();
    // Facets bound two cells, triangles of the surface come in six parts; each is a count and three points, and each cell
    // begins with its count.
    let faces = 4 * (24 * t + 6 * s) + n;
    let mut surface_at = vec![0_u64; nodes.len()];
    for node in topology::boundary(&lattice.tets, &lattice.neighbors).flatten() {
        surface_at[node as usize] += 1;
    }
    let triangles_at = |node: usize| 6 * lattice.topology.tets_at(node).len() as u64 + 2 * surface_at[node];
    let each = |sink: &mut Sink<'_>, put: &dyn Fn(&mut Sink<'_>, &mut Polyhedron)| {
        let mut cell = Polyhedron::default();
        for node in 0..nodes.len() {
            cell.take(&numbers, node as u32);
            put(sink, &mut cell);
            sink.pass_on()?;
        }
        Ok(())
    };
    // Ends of what the cells have, from how much each has.
    let ends = |sink: &mut Sink<'_>, count: &dyn Fn(u64) -> u64| {
        let mut end = 0;
        column(sink, 0..nodes.len(), |sink, node| {
            end += count(triangles_at(node));
            sink.long(end);
        })
    };
    let mut grid = Grid::new(points, n);
    grid.add((Place::Points, "Points"), (Kind::Float64, 3), 3 * points, |sink| {
        numbers.write_points(sink)?;
        column(sink, nodes.points_mm[..nodes.boundary].as_flattened().iter(), |sink, &x| sink.float(x))
    });
    grid.add((Place::CellData, "volume"), (Kind::Float64, 1), n, |sink| {
        column(sink, lattice.cells.iter(), |sink, cell| sink.float(cell.volume_mm3))
    });
    grid.add((Place::CellData, "diameter"), (Kind::Float64, 1), n, |sink| {
        column(sink, 0..nodes.len(), |sink, node| sink.float(nodes.diameter_mm(node)))
    });
    grid.add((Place::CellData, "grain"), (Kind::Int32, 1), n, |sink| {
        column(sink, 0..nodes.len(), |sink, node| sink.int(lattice.int_of_grain(node).max(-1)))
    });
    grid.add((Place::CellData, "center_of_mass"), (Kind::Float64, 3), 3 * n, |sink| {
        column(sink, lattice.cells.iter().zip(&nodes.points_mm), |sink, (cell, &p)| {
            let moment = point(cell.first_moment_mm4);
            sink.floats((point(p) + moment / cell.volume_mm3).iter());
        })
    });
    grid.add((Place::Cells, "connectivity"), (Kind::Int32, 1), connectivity, |sink| {
        each(sink, &|sink, cell| cell.points().iter().for_each(|&point| sink.int(point)))
    });
    // The triangles close a sphere: Euler's formula has its points.
    grid.add((Place::Cells, "offsets"), (Kind::Int64, 1), n, |sink| {
        ends(sink, &|triangles| triangles / 2 + 2)
    });
    grid.add((Place::Cells, "types"), (Kind::UInt8, 1), n, |sink| {
        column(sink, 0..n, |sink, _| sink.byte(POLYHEDRON))
    });
    grid.add((Place::Cells, "faces"), (Kind::Int32, 1), faces, |sink| {
        each(sink, &|sink, cell| {
            sink.int(cell.triangles.len() as i32);
            for triangle in &cell.triangles {
                sink.int(3);
                for &point in triangle {
                    sink.int(point);
                }
            }
        })
    });
    grid.add((Place::Cells, "faceoffsets"), (Kind::Int64, 1), n, |sink| {
        ends(sink, &|triangles| 1 + 4 * triangles)
    });
    grid.write(work, out)
}
