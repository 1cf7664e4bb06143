//! The outline of a specimen: its corners and edges as the vertices of its shell lie on them.
//!
//! Formats with topology ask for it.

use std::collections::HashMap;

use super::shell::Shell;
use crate::elementary::atan2;
use crate::sorting;

/// A curve where two faces meet.
#[derive(Debug)]
pub(super) struct Curve {
    /// Its vertices in order; the first and the last are corners, and the same where it is closed.
    pub(super) chain: Vec<u32>,
    /// Its two faces, by bit, and whether the triangles of each turn the way the curve runs.
    pub(super) forward: Vec<(usize, bool)>,
}

/// Corners, curves, and what is left of faces.
#[derive(Debug)]
pub(super) struct Outline {
    /// Vertices that curves begin and end with.
    pub(super) corners: Vec<u32>,
    /// The curves.
    pub(super) curves: Vec<Curve>,
    /// Vertices within each face.
    pub(super) within: Vec<Vec<u32>>,
}

impl Outline {
    /// Finds the outline of a shell.
    pub(super) fn new(shell: &Shell) -> Self {
        let faces = shell.names.len();
        let mut within = vec![Vec::new(); faces];
        // Pairs of faces in their order, with the vertices on both.
        let mut on: Vec<(u8, Vec<u32>)> = Vec::new();
        for i in 0..faces {
            for j in i + 1..faces {
                on.push((1 << i | 1 << j, Vec::new()));
            }
        }
        for (vertex, &bits) in shell.faces_of.iter().enumerate() {
            if bits.is_power_of_two() {
                within[bits.trailing_zeros() as usize].push(vertex as u32);
            }
            for (pair, vertices) in on.iter_mut().filter(|(pair, _)| bits & pair == *pair) {
                debug_assert_eq!(pair.count_ones(), 2);
                vertices.push(vertex as u32);
            }
        }
        let mut curves: Vec<Curve> = on
            .into_iter()
            .filter(|(_, vertices)| vertices.len() > 1)
            .map(|(_, vertices)| Curve { chain: chain(shell, vertices), forward: Vec::new() })
            .collect();
        let mut corners: Vec<u32> = curves
            .iter()
            .flat_map(|curve| curve.chain.first().into_iter().chain(curve.chain.last()))
            .copied()
            .collect();
        corners.sort_unstable();
        corners.dedup();
        orient(shell, &mut curves);
        Self { corners, curves, within }
    }
}

/// Vertices of one curve in order: along an edge, or all around an end circle and back to the first.
fn chain(shell: &Shell, mut vertices: Vec<u32>) -> Vec<u32> {
    let point = |vertex: u32| shell.surface.points[vertex as usize];
    let Some(axis) = shell.axis else {
        // Along an edge one coordinate alone changes.
        let along = |vertex: u32| point(vertex).iter().sum::<f64>();
        sorting::by_number(&mut vertices, |&vertex| along(vertex));
        return vertices;
    };
    let turn = |vertex: u32| {
        let [x, y, _] = point(vertex);
        let angle = atan2(y - axis[1], x - axis[0]);
        if angle < 0.0 { angle + std::f64::consts::TAU } else { angle }
    };
    sorting::by_number(&mut vertices, |&vertex| turn(vertex));
    vertices.push(vertices[0]);
    vertices
}

/// Finds out whether each curve runs as the triangles of its faces turn.
fn orient(shell: &Shell, curves: &mut [Curve]) {
    let firsts: HashMap<(u32, u32), usize> =
        curves.iter().enumerate().map(|(i, curve)| ((curve.chain[0], curve.chain[1]), i)).collect();
    for corners in &shell.surface.triangles {
        for edge in 0..3 {
            let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
            for (key, forward) in [((a, b), true), ((b, a), false)] {
                if let Some(&curve) = firsts.get(&key) {
                    curves[curve].forward.push((shell.face_of(*corners), forward));
                }
            }
        }
    }
}
