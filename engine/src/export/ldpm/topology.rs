//! Which tetrahedra, edges and faces meet where, by the numbers of nodes alone.

use crate::arrays::Each as _;
use crate::control::Control;
use crate::export::{ExportError, go_on};
use crate::geometry::delaunay::{FACES, NONE};
use crate::memory::{copied, filled, reserved};

/// Nodes between two looks at whether to go on.
const NODES_PER_LOOK: usize = 512;

/// Lists of what meets at each node, and numbers for edges and faces.
#[derive(Debug)]
pub(super) struct Topology {
    /// Tetrahedra at node `i` are `tets_at[tet_starts[i]..tet_starts[i + 1]]`.
    pub(super) tet_starts: Vec<u32>,
    pub(super) tets_at: Vec<u32>,
    /// Edges by their lower node, then their upper; those of lower node `i` are
    /// `edge_starts[i]..edge_starts[i + 1]`, and here is their upper node.
    pub(super) edge_starts: Vec<u32>,
    pub(super) edge_ends: Vec<u32>,
    /// Number of the first face that each tetrahedron is the first to have.
    pub(super) face_starts: Vec<u32>,
    pub(super) faces: u32,
    /// How edges are surrounded.
    pub(super) rings: Rings,
}

/// How edges are surrounded by tetrahedra.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Rings {
    /// By one closed ring.
    pub(super) closed: u64,
    /// By one chain that begins and ends at the surface.
    pub(super) open: u64,
    /// Otherwise.
    pub(super) other: u64,
}

impl Topology {
    /// Counts and numbers. `neighbors[t][k]` is what lies across the face opposite node `k`.
    pub(super) fn new(
        nodes: usize,
        tets: &[[u32; 4]],
        neighbors: &[[u32; 4]],
        control: &dyn Control,
    ) -> Result<Self, ExportError> {
        let mut tet_starts = filled(nodes + 1, 0_u32)?;
        for &node in tets.as_flattened() {
            tet_starts[node as usize + 1] += 1;
        }
        for i in 0..nodes {
            tet_starts[i + 1] += tet_starts[i];
        }
        let mut next = copied(&tet_starts)?;
        let mut tets_at = filled(4 * tets.len(), 0_u32)?;
        for (t, tet) in tets.iter().enumerate() {
            for &node in tet {
                tets_at[next[node as usize] as usize] = t as u32;
                next[node as usize] += 1;
            }
        }
        drop(next);
        let mut face_starts = reserved(tets.len())?;
        let mut faces = 0;
        for (t, across) in neighbors.iter().enumerate() {
            face_starts.push(faces);
            faces += across.iter().filter(|&&other| has_first(t as u32, other)).count() as u32;
        }
        let mut edge_starts = filled(nodes + 1, 0_u32)?;
        let mut edge_ends = reserved(tets.len() * 6 / 5 + nodes)?;
        let mut rings = Rings::default();
        let mut around: Vec<[u32; 2]> = Vec::new();
        for node in 0..nodes {
            if node.is_multiple_of(NODES_PER_LOOK) {
                go_on(control)?;
            }
            around.clear();
            for &t in &tets_at[tet_starts[node] as usize..tet_starts[node + 1] as usize] {
                around.extend(tets[t as usize].iter().filter(|&&end| end > node as u32).map(|&end| [end, t]));
            }
            around.sort_unstable();
            for ring in around.chunk_by(|a, b| a[0] == b[0]) {
                let [end, tet] = ring[0];
                edge_ends.push(end);
                match walk(tets, neighbors, tet, [node as u32, end], ring.len()) {
                    Some(Walk { closed, met }) if met == ring.len() => {
                        *(if closed { &mut rings.closed } else { &mut rings.open }) += 1;
                    }
                    _ => rings.other += 1,
                }
            }
            edge_starts[node + 1] = edge_ends.len() as u32;
        }
        Ok(Self { tet_starts, tets_at, edge_starts, edge_ends, face_starts, faces, rings })
    }

    /// Tetrahedra at a node.
    pub(super) fn tets_at(&self, node: usize) -> &[u32] {
        &self.tets_at[self.tet_starts[node] as usize..self.tet_starts[node + 1] as usize]
    }

    /// All edges, lower node first, in order.
    pub(super) fn edges(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.edge_starts.len() - 1)
            .flat_map(|node| self.edges_of(node).iter().map(move |&end| [node as u32, end]))
    }

    /// The upper nodes of the edges of a lower node, in order.
    pub(super) fn edges_of(&self, node: usize) -> &[u32] {
        &self.edge_ends[self.edge_starts[node] as usize..self.edge_starts[node + 1] as usize]
    }

    /// Nodes of an edge by its number, lower first.
    pub(super) fn ends(&self, edge: usize) -> [u32; 2] {
        let node = self.edge_starts.partition_point(|&start| start as usize <= edge) - 1;
        [node as u32, self.edge_ends[edge]]
    }

    /// Number of the edge between two nodes that have one.
    pub(super) fn edge(&self, a: u32, b: u32) -> u32 {
        let (low, high) = (a.min(b) as usize, a.max(b));
        let start = self.edge_starts[low];
        let ends = &self.edge_ends[start as usize..self.edge_starts[low + 1] as usize];
        start + ends.partition_point(|&end| end < high) as u32
    }

    /// Number of the face of tetrahedron `t` opposite its node `k`.
    pub(super) fn face(&self, neighbors: &[[u32; 4]], t: u32, k: usize) -> u32 {
        let across = neighbors[t as usize][k];
        if has_first(t, across) {
            let before = neighbors[t as usize][..k].iter().filter(|&&other| has_first(t, other)).count();
            return self.face_starts[t as usize] + before as u32;
        }
        let back = neighbors[across as usize].iter().position(|&other| other == t).unwrap_or_default();
        self.face(neighbors, across, back)
    }

    /// Nodes that some tetrahedron has.
    pub(super) fn nodes_met(&self) -> u64 {
        self.tet_starts.windows(2).filter(|w| w[0] < w[1]).count() as u64
    }
}

/// Whether tetrahedron `t` is the first to have the face that it shares with `other`.
pub(super) fn has_first(t: u32, other: u32) -> bool {
    other == NONE || t < other
}

/// Faces on the surface, counter-clockwise from outside.
pub(super) fn boundary<'a>(
    tets: &'a [[u32; 4]],
    neighbors: &'a [[u32; 4]],
) -> impl Iterator<Item = [u32; 3]> + 'a {
    tets.iter().zip(neighbors).flat_map(|(tet, across)| {
        (0..4).filter(|&k| across[k] == NONE).map(move |k| FACES[k].each(|corner| tet[corner]))
    })
}

struct Walk {
    closed: bool,
    met: usize,
}

/// Goes around an edge from face to face, no further than `most` tetrahedra; `None` where neighbours do not agree.
fn walk(tets: &[[u32; 4]], neighbors: &[[u32; 4]], start: u32, edge: [u32; 2], most: usize) -> Option<Walk> {
    let others = tets[start as usize].iter().copied().filter(|node| !edge.contains(node));
    let mut met = 1;
    for leave in others {
        // The face opposite `leave` is crossed; the node beyond it is the next to leave behind.
        let (mut t, mut leave) = (start, leave);
        loop {
            let k = tets[t as usize].iter().position(|&node| node == leave)?;
            let across = neighbors[t as usize][k];
            if across == NONE {
                break;
            }
            if across == start {
                return Some(Walk { closed: true, met });
            }
            let stays = tets[t as usize].iter().copied().find(|n| *n != leave && !edge.contains(n))?;
            let beyond = &tets[across as usize];
            if !edge.iter().all(|node| beyond.contains(node)) || !beyond.contains(&stays) {
                return None;
            }
            met += 1;
            if met > most {
                return None;
            }
            (t, leave) = (across, stays);
        }
    }
    Some(Walk { closed: false, met })
}
