//! Polyhedra that tests use.

use nalgebra::Vector3;

use super::Polyhedron;

/// The hull of points of which no four lie in a plane: every triple with all points on one side is a face. Points
/// inside are left out.
pub(crate) fn hull(points: &[Vector3<f64>], rounding: f64) -> Option<Polyhedron> {
    let n = points.len();
    let mut faces = Vec::new();
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let normal = (points[j] - points[i]).cross(&(points[k] - points[i]));
                let others = || (0..n).filter(|&m| m != i && m != j && m != k);
                let height = |m: usize| normal.dot(&(points[m] - points[i]));
                if others().all(|m| height(m) < 0.0) {
                    faces.push([i, j, k]);
                } else if others().all(|m| height(m) > 0.0) {
                    faces.push([i, k, j]);
                }
            }
        }
    }
    let mut used: Vec<usize> = faces.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let index = |v: usize| used.iter().position(|&u| u == v).unwrap_or(0) as u32;
    let faces = faces.iter().map(|face| face.map(index).to_vec()).collect();
    Polyhedron::new(used.iter().map(|&v| points[v]).collect(), faces, rounding).ok()
}

/// A cuboid by half its edges.
pub(crate) fn cuboid(half: [f64; 3], rounding: f64) -> Polyhedron {
    let corner = |i: u32| Vector3::from_fn(|k, _| if i >> k & 1 == 1 { half[k] } else { -half[k] });
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let faces = faces.iter().map(|face| face.to_vec()).collect();
    Polyhedron::new((0..8).map(corner).collect(), faces, rounding).unwrap_or_else(|_| unreachable!())
}

/// A regular octahedron by the distance of its vertices from the centre.
pub(crate) fn octahedron(radius: f64) -> Polyhedron {
    let vertices = (0..6).map(|i| Vector3::ith(i / 2, if i % 2 == 0 { radius } else { -radius })).collect();
    let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let faces = faces.iter().map(|face| face.to_vec()).collect();
    Polyhedron::new(vertices, faces, 0.0).unwrap_or_else(|_| unreachable!())
}
