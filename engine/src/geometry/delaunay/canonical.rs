//! From the tetrahedra in the order of their making to the one order that the points determine.
//!
//! In place, for the arrays are most of the memory there is.

use super::build::{self, GHOST, Raw};
use super::{Delaunay, DelaunayError, NONE};
use crate::arrays::Each as _;
use crate::control::Control;
use crate::memory::{OutOfMemory, copied, filled};

/// Tetrahedra between two looks at the control.
const STRIDE: usize = 1 << 16;

/// Drops ghosts and free slots, names nodes by their original numbers, sorts.
pub(super) fn canonical(raw: Raw, control: &dyn Control) -> Result<Delaunay, DelaunayError> {
    let points = raw.numbers.len();
    let step = |part: f64| {
        super::report(control, build::SHARE + (1.0 - build::SHARE) * part, points, points);
        super::go_on(control)
    };
    step(0.0)?;
    let (mut nodes, mut neighbors) = compact(raw)?;
    for (nodes, neighbors) in nodes.iter_mut().zip(&mut neighbors) {
        sort_nodes(nodes, neighbors);
    }
    step(0.2)?;
    let mut place = places(&nodes, points)?;
    step(0.5)?;
    for link in neighbors.iter_mut().flatten() {
        if *link != NONE {
            *link = place[*link as usize];
        }
    }
    // Swaps each tetrahedron to its place, until the right one has come to this.
    for at in 0..place.len() {
        if at % STRIDE == 0 {
            step(0.6 + 0.4 * at as f64 / place.len() as f64)?;
        }
        while place[at] as usize != at {
            let to = place[at] as usize;
            nodes.swap(at, to);
            neighbors.swap(at, to);
            place.swap(at, to);
        }
    }
    Ok(Delaunay { nodes, neighbors })
}

/// Nodes and neighbours.
type Tetrahedra = (Vec<[u32; 4]>, Vec<[u32; 4]>);

/// The finite tetrahedra, close together, with numbers for links.
fn compact(raw: Raw) -> Result<Tetrahedra, OutOfMemory> {
    let Raw { numbers, mut nodes, mut links, finite } = raw;
    let mut place = filled(nodes.len(), NONE)?;
    let mut next = 0;
    for (place, nodes) in place.iter_mut().zip(&nodes) {
        if nodes[3] != GHOST {
            *place = next;
            next += 1;
        }
    }
    for slot in 0..nodes.len() {
        let to = place[slot];
        if to != NONE {
            nodes[to as usize] = nodes[slot].each(|node| numbers[node as usize]);
            links[to as usize] = links[slot].each(|link| place[(link >> 2) as usize]);
        }
    }
    nodes.truncate(finite);
    links.truncate(finite);
    nodes.shrink_to_fit();
    links.shrink_to_fit();
    Ok((nodes, links))
}

/// Sorts the nodes, but for the last two where that would turn the tetrahedron inside out.
fn sort_nodes(nodes: &mut [u32; 4], neighbors: &mut [u32; 4]) {
    let mut odd = false;
    for (i, j) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
        if nodes[i] > nodes[j] {
            nodes.swap(i, j);
            neighbors.swap(i, j);
            odd = !odd;
        }
    }
    if odd {
        nodes.swap(2, 3);
        neighbors.swap(2, 3);
    }
}

/// Where each tetrahedron comes in the lexicographic order of nodes.
fn places(nodes: &[[u32; 4]], points: usize) -> Result<Vec<u32>, OutOfMemory> {
    let mut starts = filled(points + 1, 0_u32)?;
    for nodes in nodes {
        starts[nodes[0] as usize + 1] += 1;
    }
    for node in 0..points {
        starts[node + 1] += starts[node];
    }
    let mut order = filled(nodes.len(), 0_u32)?;
    let mut next = copied(&starts)?;
    for (number, nodes) in nodes.iter().enumerate() {
        let next = &mut next[nodes[0] as usize];
        order[*next as usize] = number as u32;
        *next += 1;
    }
    let mut place = filled(nodes.len(), 0_u32)?;
    let mut bucket: Vec<([u32; 3], u32)> = Vec::new();
    for range in starts.windows(2) {
        bucket.clear();
        bucket.extend(order[range[0] as usize..range[1] as usize].iter().map(|&number| {
            let [_, b, c, d] = nodes[number as usize];
            ([b, c, d], number)
        }));
        bucket.sort_unstable();
        for (&(_, number), at) in bucket.iter().zip(range[0]..) {
            place[number as usize] = at;
        }
    }
    Ok(place)
}
