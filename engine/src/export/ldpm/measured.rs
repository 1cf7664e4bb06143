//! What the checks measure of tetrahedra, one by one.

use std::cmp::Ordering;

use super::nodes::Nodes;
use super::report::Checks;
use super::tessellation::{EDGES, Facet, Point, Tet, face_point};
use super::topology::has_first;
use crate::arrays::Each as _;
use crate::geometry::delaunay::{FACES, NONE, inside_circumsphere};

/// The tetrahedra of a lattice.
#[derive(Clone, Copy)]
pub(super) struct Mesh<'a> {
    pub(super) nodes: &'a Nodes<'a>,
    pub(super) tets: &'a [[u32; 4]],
    /// What lies across the face opposite each node.
    pub(super) neighbors: &'a [[u32; 4]],
}

/// What a cell encloses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Signed volume.
    pub volume_mm3: f64,
    /// Volume times the vector from the node to the centre of mass.
    pub first_moment_mm4: [f64; 3],
}

/// Outward area vectors of a cell, and the sum of their lengths.
#[derive(Clone, Copy, Default)]
pub(super) struct Closure {
    pub(super) vector: Point,
    pub(super) area: f64,
}

/// What some tetrahedra have shown.
#[derive(Default)]
pub(super) struct Measured {
    pub(super) tets: Vec<MeasuredTet>,
    /// Counts and largest errors of these tetrahedra.
    pub(super) checks: Checks,
}

/// What a tetrahedron adds to sums, and to the cells of its nodes. Plain sums of its own, so that the careful ones over
/// all tetrahedra have few terms.
pub(super) struct MeasuredTet {
    nodes: [u32; 4],
    pub(super) volume: f64,
    /// Volume of its pieces, each counted as positive.
    pub(super) unsigned: f64,
    /// A third of projected area times length of edge, of all facets.
    pub(super) projected: f64,
    /// Projected area times length times `n n`, of all facets: xx, yy, zz, xy, yz, zx.
    pub(super) fabric: [f64; 6],
    /// Volume times centre.
    pub(super) moment: Point,
    facets: [MeasuredFacet; 12],
}

/// What a facet adds to the cells on its two sides.
struct MeasuredFacet {
    /// The two nodes, as positions in the tetrahedron.
    ends: [usize; 2],
    area_vector: Point,
    area: f64,
    volumes: [f64; 2],
    /// Of the pieces: volume times the vector from the node to the centre of mass.
    moments: [Point; 2],
}

impl Closure {
    /// Adds an area vector and its length.
    pub(super) fn add(&mut self, vector: Point, area: f64) {
        self.vector += vector;
        self.area += area;
    }
}

impl Measured {
    /// Measures a tetrahedron and the faces that it is the first to have.
    pub(super) fn add(&mut self, mesh: &Mesh<'_>, t: usize) {
        let tet = Tet::new(mesh.nodes, mesh.tets[t]);
        let facets: [Facet; 12] = std::array::from_fn(|facet| tet.facet(facet));
        self.add_faces(mesh, t, &tet);
        self.tets.push(MeasuredTet::new(&tet, &facets, &mut self.checks));
    }

    fn add_faces(&mut self, Mesh { nodes, tets, neighbors }: &Mesh<'_>, t: usize, tet: &Tet) {
        for (k, &other) in neighbors[t].iter().enumerate() {
            if other == NONE || !has_first(t as u32, other) {
                continue;
            }
            let across = neighbors[other as usize].iter().position(|&back| back as usize == t);
            let seen = across.map(|k| FACES[k].each(|i| tets[other as usize][i]));
            let point = seen.map(|face| face_point(nodes, face));
            self.checks.nonconforming_faces += u64::from(point != Some(tet.faces[k]));
            self.checks.delaunay_violations += u64::from(across.is_some_and(|k| {
                let sphere = tet.nodes.each(|node| nodes.points_mm[node as usize]);
                let beyond = nodes.points_mm[tets[other as usize][k] as usize];
                inside_circumsphere(sphere, beyond) == Ordering::Greater
            }));
        }
    }
}

impl MeasuredTet {
    fn new(tet: &Tet, facets: &[Facet; 12], checks: &mut Checks) -> Self {
        let volume = tet.volume();
        let (mut pieces, mut unsigned, mut projected, mut fabric) = (0.0, 0.0, 0.0, [0.0; 6]);
        let mut inverted = 0;
        for facet in facets {
            for piece in facet.volumes {
                pieces += piece;
                inverted += u64::from(piece < 0.0);
            }
            unsigned += facet.unsigned_volume();
            let (area, along) = (facet.area(), facet.projected_area());
            let excess = (along.abs() - area) / area.max(f64::MIN_POSITIVE);
            checks.projected_area_error = checks.projected_area_error.max(excess);
            checks.facets_not_positive += u64::from(along <= 0.0);
            let weight = along * facet.length;
            projected += weight / 3.0;
            let n = facet.normal;
            let products = [n.x * n.x, n.y * n.y, n.z * n.z, n.x * n.y, n.y * n.z, n.z * n.x];
            for (sum, product) in fabric.iter_mut().zip(products) {
                *sum += weight * product;
            }
        }
        let corners: Point = tet.corners.iter().sum();
        let longest2 = EDGES
            .each(|[i, j]| (tet.corners[j] - tet.corners[i]).norm_squared())
            .into_iter()
            .fold(0.0, f64::max);
        let error = (pieces - volume).abs() / (longest2 * longest2.sqrt());
        checks.tetrahedron_volume_error = checks.tetrahedron_volume_error.max(error);
        checks.inverted_pieces += inverted;
        checks.inverted_tetrahedra += u64::from(inverted > 0);
        let moment = corners * (volume / 4.0);
        let facets = std::array::from_fn(|i| MeasuredFacet::new(tet, &facets[i]));
        Self { nodes: tet.nodes, volume, unsigned, projected, fabric, moment, facets }
    }

    /// Adds the pieces of the tetrahedron to the cells of its nodes, and its facets to their surfaces.
    pub(super) fn add_to(&self, cells: &mut [Cell], closures: &mut [Closure]) {
        for facet in &self.facets {
            let [from, to] = facet.ends.each(|end| self.nodes[end] as usize);
            closures[from].add(facet.area_vector, facet.area);
            closures[to].add(-facet.area_vector, facet.area);
            for (node, (volume, moment)) in
                [from, to].into_iter().zip(facet.volumes.iter().zip(&facet.moments))
            {
                cells[node].volume_mm3 += volume;
                for (sum, part) in cells[node].first_moment_mm4.iter_mut().zip(moment.iter()) {
                    *sum += part;
                }
            }
        }
    }
}

impl MeasuredFacet {
    fn new(tet: &Tet, facet: &Facet) -> Self {
        let corners: Point = facet.vertices.iter().sum();
        // The piece's centre of mass is the mean of its four corners, of which the node is one.
        let moment =
            |side: usize| (corners - 3.0 * tet.corners[facet.ends[side]]) * (facet.volumes[side] / 4.0);
        Self {
            ends: facet.ends,
            area_vector: facet.area_vector,
            area: facet.area(),
            volumes: facet.volumes,
            moments: [moment(0), moment(1)],
        }
    }
}
