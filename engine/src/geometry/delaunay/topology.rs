//! What touches what: faces, edges, the hull, the tetrahedra around an edge.
//!
//! All in canonical order, so that whoever numbers by these numbers the same every time.

use super::{Delaunay, FACES, NONE};
use crate::arrays::Each as _;

/// Pairs of places of a tetrahedron's nodes: its edges.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Tetrahedra's edges sorted at once, of 4 bytes each.
const EDGES_AT_ONCE: usize = 1 << 24;

/// A triangle between two tetrahedra, or of the hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Face {
    /// The tetrahedron with the lower number.
    pub tetrahedron: u32,
    /// Which of its nodes is opposite.
    pub opposite: usize,
    /// The tetrahedron on the other side; [`NONE`] on the hull.
    pub neighbor: u32,
    /// Counter-clockwise seen from the other side.
    pub nodes: [u32; 3],
}

/// All edges, each once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Edges {
    /// Both nodes, the lower first; in lexicographic order.
    pub nodes: Vec<[u32; 2]>,
    /// First edge of each lower node, and the number of edges at the end.
    starts: Vec<u32>,
}

impl Edges {
    /// Number of the edge between two nodes, in either order.
    pub fn find(&self, a: u32, b: u32) -> Option<u32> {
        let (low, high) = (a.min(b) as usize, a.max(b));
        let (start, end) = (*self.starts.get(low)?, *self.starts.get(low + 1)?);
        let of_low = self.nodes.get(start as usize..end as usize)?;
        of_low.binary_search_by_key(&high, |nodes| nodes[1]).ok().map(|place| start + place as u32)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }
}

impl Delaunay {
    /// All faces, each once, in the order of their lower tetrahedra.
    pub fn faces(&self) -> impl Iterator<Item = Face> + '_ {
        self.nodes.iter().zip(&self.neighbors).zip(0_u32..).flat_map(|((nodes, neighbors), tetrahedron)| {
            // `NONE` is larger than any number.
            (0..4).filter(move |&k| neighbors[k] > tetrahedron).map(move |opposite| Face {
                tetrahedron,
                opposite,
                neighbor: neighbors[opposite],
                nodes: FACES[opposite].each(|i| nodes[i]),
            })
        })
    }

    /// The triangles of the hull, counter-clockwise seen from outside, the lowest node first; in lexicographic order.
    pub fn hull_triangles(&self) -> Vec<[u32; 3]> {
        let mut hull: Vec<[u32; 3]> = self
            .faces()
            .filter(|face| face.neighbor == NONE)
            .map(|Face { nodes: [a, b, c], .. }| match a.min(b).min(c) {
                lowest if lowest == a => [a, b, c],
                lowest if lowest == b => [b, c, a],
                _ => [c, a, b],
            })
            .collect();
        hull.sort_unstable();
        hull
    }

    /// All edges.
    pub fn edges(&self) -> Edges {
        self.edges_by(EDGES_AT_ONCE)
    }

    /// All edges, by groups of lower nodes whose tetrahedra's edges are no more than this, or single nodes.
    pub(super) fn edges_by(&self, at_once: usize) -> Edges {
        let points = self.nodes.iter().flatten().max().map_or(0, |&node| node as usize + 1);
        // How often each node is the lower one of a tetrahedron's edge: never for the highest, thrice for the lowest.
        let mut ends = vec![0_usize; points + 1];
        for edge in self.nodes.iter().flat_map(edges_of) {
            ends[edge[0] as usize + 1] += 1;
        }
        for node in 0..points {
            ends[node + 1] += ends[node];
        }
        let mut edges = Edges { nodes: Vec::new(), starts: Vec::with_capacity(points + 1) };
        edges.starts.push(0);
        let mut uppers: Vec<u32> = Vec::new();
        let mut next: Vec<usize> = Vec::new();
        let mut first = 0;
        while first < points {
            let until = ends[first] + at_once;
            let last = ends.partition_point(|&end| end <= until).clamp(first + 2, points + 1) - 1;
            let before = ends[first];
            uppers.clear();
            uppers.resize(ends[last] - before, 0);
            next.clear();
            next.extend(ends[first..last].iter().map(|start| start - before));
            for [lower, upper] in self.nodes.iter().flat_map(edges_of) {
                if let Some(next) = (lower as usize).checked_sub(first).and_then(|place| next.get_mut(place))
                {
                    uppers[*next] = upper;
                    *next += 1;
                }
            }
            for lower in first..last {
                let of_lower = &mut uppers[ends[lower] - before..ends[lower + 1] - before];
                of_lower.sort_unstable();
                for (place, &upper) in of_lower.iter().enumerate() {
                    if place == 0 || of_lower[place - 1] != upper {
                        edges.nodes.push([lower as u32, upper]);
                    }
                }
                edges.starts.push(edges.nodes.len() as u32);
            }
            first = last;
        }
        edges
    }

    /// The tetrahedra around the edge between two nodes of one of them, each next to the one before it, and whether
    /// the last is next to the first. Where it is not, the edge lies on the hull, and so do a face of the first and one
    /// of the last. `ring` is emptied first; it stays empty if the tetrahedron has no such edge.
    pub fn ring(&self, tetrahedron: u32, edge: [u32; 2], ring: &mut Vec<u32>) -> bool {
        ring.clear();
        let nodes = self.nodes[tetrahedron as usize];
        let place = |node| nodes.iter().position(|&other| other == node);
        let (Some(i), Some(j)) = (place(edge[0]), place(edge[1])) else { return false };
        let [one, other] = others(i, j);
        ring.push(tetrahedron);
        let mut ahead = Turn { tetrahedron, edge, across: nodes[one], pivot: nodes[other] };
        while let Some(next) = ahead.next(self) {
            if next.tetrahedron == tetrahedron {
                return true;
            }
            ring.push(next.tetrahedron);
            ahead = next;
        }
        // Come to the hull: the first is the last of the other direction.
        ring.reverse();
        let mut back = Turn { tetrahedron, edge, across: nodes[other], pivot: nodes[one] };
        while let Some(next) = back.next(self) {
            ring.push(next.tetrahedron);
            back = next;
        }
        false
    }
}

/// The edges of a tetrahedron, the lower node first.
fn edges_of(nodes: &[u32; 4]) -> [[u32; 2]; 6] {
    EDGES.each(|[i, j]| [nodes[i].min(nodes[j]), nodes[i].max(nodes[j])])
}

/// The other two places of four.
fn others(i: usize, j: usize) -> [usize; 2] {
    let mut rest = (0..4).filter(|&k| k != i && k != j);
    [rest.next().unwrap_or_default(), rest.next().unwrap_or_default()]
}

/// A tetrahedron on the way around an edge.
#[derive(Clone, Copy)]
struct Turn {
    tetrahedron: u32,
    edge: [u32; 2],
    /// The node opposite the face to leave by.
    across: u32,
    /// The node of that face that is not the edge's.
    pivot: u32,
}

impl Turn {
    fn next(self, of: &Delaunay) -> Option<Turn> {
        let nodes = of.nodes[self.tetrahedron as usize];
        let exit = nodes.iter().position(|&node| node == self.across)?;
        let tetrahedron = of.neighbors[self.tetrahedron as usize][exit];
        let [a, b] = self.edge;
        let there = of.nodes.get(tetrahedron as usize)?;
        let pivot = *there.iter().find(|&&node| node != a && node != b && node != self.pivot)?;
        Some(Turn { tetrahedron, edge: self.edge, across: self.pivot, pivot })
    }
}
