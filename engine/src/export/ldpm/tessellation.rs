//! The tessellation of one tetrahedron: points on edges, faces and inside, 12 facets, and what they enclose
//! (Cusatis, Pelessone and Mencarelli 2011; numbering as in the files that Project Chrono reads).
//!
//! A tetrahedron falls into 24 pieces, one for each chain node - edge - face - tetrahedron; a facet is the triangle
//! that the two pieces at the ends of its edge share. Points of edges and faces are computed from their nodes
//! in the order of their numbers, so that neighbours find the same bits.

use nalgebra::Vector3;

use super::nodes::Nodes;
use crate::arrays::Each as _;
use crate::geometry::delaunay::FACES;

pub(super) type Point = Vector3<f64>;

/// Nodes of each edge, as positions in the tetrahedron.
pub(super) const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Edge and face of each facet. The facet's corners are the tetrahedron's point, the face's and the edge's.
pub(super) const FACETS: [[usize; 2]; 12] =
    [[0, 2], [0, 3], [1, 1], [1, 3], [2, 1], [2, 2], [3, 0], [3, 3], [4, 0], [4, 2], [5, 0], [5, 1]];

/// Whether the chain (first node of the edge, its second, the face's third, the last) is an even permutation.
const EVEN: [bool; 12] = parities();

const fn parities() -> [bool; 12] {
    let mut even = [false; 12];
    let mut facet = 0;
    while facet < 12 {
        let [edge, face] = FACETS[facet];
        let [i, j] = EDGES[edge];
        let chain = [i, j, 6 - i - j - face, face];
        let mut inversions = 0;
        let mut a = 0;
        while a < 4 {
            let mut b = a + 1;
            while b < 4 {
                if chain[a] > chain[b] {
                    inversions += 1;
                }
                b += 1;
            }
            a += 1;
        }
        even[facet] = inversions % 2 == 0;
        facet += 1;
    }
    even
}

/// Whether edge, face and tetrahedron's point of a facet are clockwise seen from the first node of its edge,
/// which is to say that their area vector points away from it.
pub(super) fn is_even(facet: usize) -> bool {
    EVEN[facet]
}

pub(super) fn point(p: [f64; 3]) -> Point {
    Point::from(p)
}

/// Where the point of an edge lies, as a parameter from 0 at its first node to 1 at its
/// second: in the middle of the gap between the grains.
pub(super) fn edge_parameter(length: f64, first_reach: f64, second_reach: f64) -> f64 {
    (length + first_reach - second_reach) / (2.0 * length)
}

/// The point of the edge between two nodes.
pub(super) fn edge_point(nodes: &Nodes<'_>, a: u32, b: u32) -> Point {
    let (i, j) = (a.min(b) as usize, a.max(b) as usize);
    let (from, to) = (point(nodes.points_mm[i]), point(nodes.points_mm[j]));
    let along = to - from;
    from + along * edge_parameter(along.norm(), nodes.reach_mm(i, &along), nodes.reach_mm(j, &-along))
}

/// Half way from `from` to the surface of the body of `node`, towards the node.
fn half_way(nodes: &Nodes<'_>, from: Point, node: u32) -> Point {
    let to_center = point(nodes.points_mm[node as usize]) - from;
    from + to_center * (0.5 - 0.5 * nodes.reach_mm(node as usize, &-to_center) / to_center.norm())
}

/// The point of the face between three nodes.
pub(super) fn face_point(nodes: &Nodes<'_>, mut face: [u32; 3]) -> Point {
    face.sort_unstable();
    let [a, b, c] = face;
    mean_on_face(
        half_way(nodes, edge_point(nodes, a, b), c),
        half_way(nodes, edge_point(nodes, a, c), b),
        half_way(nodes, edge_point(nodes, b, c), a),
    )
}

/// Written so that three points of one plane of constant x, y or z have their mean in it to the last bit.
fn mean_on_face(a: Point, b: Point, c: Point) -> Point {
    a + ((b - a) + (c - a)) / 3.0
}

/// The points of one tetrahedron.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tet {
    pub(super) nodes: [u32; 4],
    pub(super) corners: [Point; 4],
    pub(super) edges: [Point; 6],
    pub(super) faces: [Point; 4],
    pub(super) middle: Point,
}

impl Tet {
    pub(super) fn new(nodes: &Nodes<'_>, tet: [u32; 4]) -> Self {
        let edges = EDGES.each(|[i, j]| edge_point(nodes, tet[i], tet[j]));
        let edge_of = |i: usize, j: usize| match (i.min(j), i.max(j)) {
            (0, j) => edges[j - 1],
            (1, j) => edges[j + 1],
            _ => edges[5],
        };
        let faces = FACES.each(|face| {
            // As `face_point` does it, but for the edges, which are at hand.
            let mut order = face;
            order.sort_unstable_by_key(|&corner| tet[corner]);
            let [a, b, c] = order;
            mean_on_face(
                half_way(nodes, edge_of(a, b), tet[c]),
                half_way(nodes, edge_of(a, c), tet[b]),
                half_way(nodes, edge_of(b, c), tet[a]),
            )
        });
        let from_faces: Point = (0..4).map(|k| half_way(nodes, faces[k], tet[k])).sum();
        Self {
            nodes: tet,
            corners: tet.each(|node| point(nodes.points_mm[node as usize])),
            edges,
            faces,
            middle: from_faces / 4.0,
        }
    }

    /// Volume, positive where the nodes are in positive order.
    pub(super) fn volume(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        (b - a).dot(&(c - a).cross(&(d - a))) / 6.0
    }

    pub(super) fn facet(&self, facet: usize) -> Facet {
        let [edge, face] = FACETS[facet];
        let [i, j] = EDGES[edge];
        let vertices = [self.middle, self.faces[face], self.edges[edge]];
        let [t, f, e] = vertices;
        let area_vector = (f - e).cross(&(t - e)) * if EVEN[facet] { 0.5 } else { -0.5 };
        let (from, to) = (self.corners[i], self.corners[j]);
        let along = to - from;
        let length = along.norm();
        Facet {
            ends: [i, j],
            vertices,
            area_vector,
            normal: along / length,
            length,
            volumes: [area_vector.dot(&(e - from)) / 3.0, area_vector.dot(&(to - e)) / 3.0],
        }
    }

    pub(super) fn facets(&self) -> impl Iterator<Item = Facet> + '_ {
        (0..12).map(|facet| self.facet(facet))
    }
}

/// A facet: the triangle between the cells of two nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    /// The two nodes, as positions in the tetrahedron.
    pub(super) ends: [usize; 2],
    /// Points of the tetrahedron, the face and the edge.
    pub(super) vertices: [Point; 3],
    /// Area as a vector out of the first node's cell; against the edge where the pieces are inverted.
    pub(super) area_vector: Point,
    /// Direction from the first node to the second.
    pub(super) normal: Point,
    /// Distance of the nodes.
    pub(super) length: f64,
    /// Signed volumes of the pieces of the two nodes.
    pub(super) volumes: [f64; 2],
}

impl Facet {
    pub(super) fn area(&self) -> f64 {
        self.area_vector.norm()
    }

    /// Area projected along the edge; negative where inverted.
    pub(super) fn projected_area(&self) -> f64 {
        self.area_vector.dot(&self.normal)
    }

    pub(super) fn centroid(&self) -> Point {
        let [t, f, e] = self.vertices;
        (t + f + e) / 3.0
    }

    /// Volume of both pieces, each counted as positive: what the preprocessor of Project Chrono writes.
    pub(super) fn unsigned_volume(&self) -> f64 {
        self.volumes[0].abs() + self.volumes[1].abs()
    }

    /// Two tangents that make a right-handed frame with the normal (Duff and others 2017), without a jump but at
    /// the sign of z.
    pub(super) fn tangents(&self) -> [Point; 2] {
        let n = self.normal;
        let sign = 1.0_f64.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        [
            Point::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            Point::new(b, sign + n.y * n.y * a, -n.y),
        ]
    }
}

/// The six parts of a face on the surface, each with the node whose cell it bounds, and its corners in outward
/// order. `face` is counter-clockwise from outside.
pub(super) fn boundary_facets(nodes: &Nodes<'_>, face: [u32; 3]) -> [(u32, [Point; 3]); 6] {
    let f = face_point(nodes, face);
    let [e01, e12, e20] =
        [[0, 1], [1, 2], [2, 0]].each(|[i, j]: [usize; 2]| edge_point(nodes, face[i], face[j]));
    let part = |corner: usize, before: Point, after: Point| {
        let v = point(nodes.points_mm[face[corner] as usize]);
        [(face[corner], [v, before, f]), (face[corner], [v, f, after])]
    };
    let [[a, b], [c, d], [e, g]] = [part(0, e01, e20), part(1, e12, e01), part(2, e20, e12)];
    [a, b, c, d, e, g]
}

/// Area of a triangle as a vector, out of the side from which its corners are counter-clockwise.
pub(super) fn triangle_area([a, b, c]: [Point; 3]) -> Point {
    (b - a).cross(&(c - a)) / 2.0
}
