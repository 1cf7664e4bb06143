//! The unit sphere as an inscribed polyhedron: an icosahedron whose faces are divided.
//!
//! It knows the sphere alone; it must never know which grain it is for.

use std::collections::HashMap;

use super::surface::{Surface, cross, distance2, dot};

/// Segments of a great circle for each division of an edge of the icosahedron: a triangle of the sphere
/// divided into `20 n²` equal ones has edges of `1.2046 / n`.
const SEGMENTS_PER_DIVISION: f64 = 5.216;

/// Largest number of divisions, that of 256 segments.
const MAX_DIVISIONS: usize = 49;

/// The unit sphere whose great circles have about that many segments.
pub(super) fn sphere(segments: f64) -> Surface {
    divided(divisions(segments))
}

fn divisions(segments: f64) -> usize {
    ((segments / SEGMENTS_PER_DIVISION).round() as usize).clamp(1, MAX_DIVISIONS)
}

/// An icosahedron, each face divided into `divisions²` triangles, its vertices on the unit sphere.
fn divided(divisions: usize) -> Surface {
    let corners = icosahedron();
    let mut faces = Vec::new();
    let edge2 =
        (0..12).map(|i| distance2(corners[0], corners[i])).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let near = |i: usize, j: usize| distance2(corners[i], corners[j]) < 1.1 * edge2;
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(k, i) {
                    let [a, b, c] = [corners[i], corners[j], corners[k]];
                    let outward = dot(a, cross(b, c)) > 0.0;
                    faces.push(if outward { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    let mut points = Vec::new();
    let mut known: HashMap<[(usize, usize); 3], u32> = HashMap::new();
    let mut triangles = Vec::new();
    for face in faces {
        let mut point = |i: usize, j: usize| {
            let weights = [divisions - i - j, i, j];
            // A vertex on an edge of the icosahedron is met from both its faces: named by what carries
            // weight.
            let mut name: [(usize, usize); 3] = std::array::from_fn(|k| (face[k], weights[k]));
            name.iter_mut().filter(|part| part.1 == 0).for_each(|part| *part = (usize::MAX, 0));
            name.sort_unstable();
            *known.entry(name).or_insert_with(|| {
                let mut p = [0.0; 3];
                for &(corner, weight) in name.iter().filter(|part| part.1 > 0) {
                    for a in 0..3 {
                        p[a] += weight as f64 * corners[corner][a];
                    }
                }
                points.push(unit(p));
                points.len() as u32 - 1
            })
        };
        for i in 0..divisions {
            for j in 0..divisions - i {
                triangles.push([point(i, j), point(i + 1, j), point(i, j + 1)]);
                if i + j + 1 < divisions {
                    triangles.push([point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]);
                }
            }
        }
    }
    Surface::new(points, triangles)
}

/// Its twelve vertices, turned so that none lies on an axis: grains that touch a wall touch it there.
fn icosahedron() -> [[f64; 3]; 12] {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut corners = [[0.0; 3]; 12];
    let signs = [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)];
    for (i, corner) in corners.iter_mut().enumerate() {
        let (one, long) = signs[i % 4];
        let axis = i / 4;
        corner[(axis + 1) % 3] = one;
        corner[(axis + 2) % 3] = long;
    }
    corners.map(|p| unit(turned(p)))
}

/// Turned about z and then x, by angles that bring the middles of faces near the axes and no vertex onto one.
fn turned([x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = 0.35_f64.sin_cos();
    let (x, y) = (cos * x - sin * y, sin * x + cos * y);
    let (sin, cos) = 0.60_f64.sin_cos();
    [x, cos * y - sin * z, sin * y + cos * z]
}

pub(super) fn unit(p: [f64; 3]) -> [f64; 3] {
    let length = dot(p, p).sqrt();
    p.map(|x| x / length)
}
