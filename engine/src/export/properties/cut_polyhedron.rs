//! The exact part of a convex polyhedron that lies in each voxel of a row, and the area vector of its surface there.
//!
//! The faces of the polyhedron are cut by the planes of the grid. By the divergence theorem with the field
//! `min(max(x - x_i, 0), h)` along x, the volume in voxel `i` of a row, which begins at `x_i` and has the edge `h`, is
//! the sum over the pieces of faces of the row: `(x - x_i) n_x` integrated over those in the voxel, and `h` times the
//! area along x of those beyond. Area vectors and first moments of flat polygons are exact.

use nalgebra::Vector3;

/// A flat convex polygon.
type Polygon = Vec<Vector3<f64>>;

/// What the pieces of faces in a voxel add up to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pieces {
    /// Area vector.
    pub(super) area: Vector3<f64>,
    /// Integral of the distance from the voxel's lower side over the area along x.
    moment: f64,
}

impl Pieces {
    /// No piece.
    pub(super) const NONE: Self = Self { area: Vector3::new(0.0, 0.0, 0.0), moment: 0.0 };

    fn add(&mut self, polygon: &[Vector3<f64>], side: f64) {
        let Some((a, rest)) = polygon.split_first() else { return };
        for pair in rest.windows(2) {
            let area = (pair[0] - a).cross(&(pair[1] - a)) / 2.0;
            self.area += area;
            self.moment += area.x * ((a.x + pair[0].x + pair[1].x) / 3.0 - side);
        }
    }
}

/// A range of voxels of a row of the grid, and rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    /// The first of them.
    pub(super) first: usize,
    /// How many they are.
    pub(super) n: usize,
    /// Edge of a voxel.
    pub(super) edge_mm: f64,
    /// Where the grid begins, from the centre of the grain.
    pub(super) origin_mm: f64,
}

impl Range {
    fn side(&self, i: usize) -> f64 {
        self.origin_mm + (self.first + i) as f64 * self.edge_mm
    }
}

/// Cuts faces by the voxels of a layer; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Cutter {
    face: Polygon,
    row: Polygon,
    voxel: Polygon,
    rest: Polygon,
}

impl Cutter {
    /// Adds a face, between two heights, to the voxels of a layer: rows of `x.n + 1` sums, the last of which is for
    /// what lies beyond the last voxel.
    pub(super) fn add(
        &mut self,
        face: impl Iterator<Item = Vector3<f64>>,
        heights: [f64; 2],
        [x, y]: [Range; 2],
        pieces: &mut [Pieces],
    ) {
        let Self { face: polygon, row, voxel, rest } = self;
        polygon.clear();
        polygon.extend(face);
        // What is before the layer and its first row, then what is after the layer.
        cut_off(polygon, 2, heights[0], voxel, rest);
        cut_off(polygon, 1, y.side(0), voxel, rest);
        cut_off(polygon, 2, heights[1], row, rest);
        std::mem::swap(polygon, row);
        for (j, pieces) in pieces.chunks_exact_mut(x.n + 1).enumerate() {
            if polygon.is_empty() {
                return;
            }
            cut_off(polygon, 1, y.side(j + 1), row, rest);
            cut_off(row, 0, x.side(0), voxel, rest);
            let Some((beyond, within)) = pieces.split_last_mut() else { return };
            for (i, pieces) in within.iter_mut().enumerate() {
                if row.is_empty() {
                    break;
                }
                cut_off(row, 0, x.side(i + 1), voxel, rest);
                pieces.add(voxel, x.side(i));
            }
            beyond.add(row, 0.0);
        }
    }
}

/// The share of each voxel of a row that lies in the polyhedron, from the last to the first.
pub(super) fn shares(row: &[Pieces], edges_mm: [f64; 3]) -> impl Iterator<Item = (f64, Vector3<f64>)> {
    let [h, dy, dz] = edges_mm;
    let mut beyond = row.last().map_or(0.0, |pieces| pieces.area.x);
    row.iter().rev().skip(1).map(move |pieces| {
        let volume = pieces.moment + h * beyond;
        beyond += pieces.area.x;
        (volume / (h * dy * dz), pieces.area)
    })
}

/// Moves the part of a polygon below a plane across an axis to `below`.
fn cut_off(polygon: &mut Polygon, axis: usize, at: f64, below: &mut Polygon, spare: &mut Polygon) {
    split(polygon, axis, at, below, spare);
    std::mem::swap(polygon, spare);
}

/// Cuts a polygon by a plane across an axis into the part below and that above; one in the plane is below.
fn split(polygon: &[Vector3<f64>], axis: usize, at: f64, below: &mut Polygon, above: &mut Polygon) {
    below.clear();
    above.clear();
    let is_above = polygon.iter().any(|p| p[axis] > at);
    let is_below = !is_above || polygon.iter().any(|p| p[axis] < at);
    for (i, p) in polygon.iter().enumerate() {
        let next = &polygon[(i + 1) % polygon.len()];
        let (a, b) = (p[axis] - at, next[axis] - at);
        if a <= 0.0 && is_below {
            below.push(*p);
        }
        if a >= 0.0 && is_above {
            above.push(*p);
        }
        if a * b < 0.0 {
            let mut crossing = p + (next - p) * (a / (a - b));
            crossing[axis] = at;
            below.push(crossing);
            above.push(crossing);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    /// Outward unit normal, and height above the origin.
    type Plane = (Vector3<f64>, f64);

    /// A cuboid with a corner cut off, and the half-spaces that it is the intersection of.
    fn body(angles: [f64; 3]) -> (Vec<Polygon>, Vec<Plane>, f64) {
        let rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        let half = Vector3::new(1.0, 0.75, 0.5);
        let corner = |x: f64, y: f64, z: f64| half.component_mul(&Vector3::new(x, y, z));
        let (a, b, c) = (corner(0.5, 1.0, 1.0), corner(1.0, 0.5, 1.0), corner(1.0, 1.0, 0.5));
        let faces = vec![
            vec![corner(-1., -1., -1.), corner(-1., -1., 1.), corner(-1., 1., 1.), corner(-1., 1., -1.)],
            vec![corner(1., -1., -1.), corner(1., 1., -1.), c, b, corner(1., -1., 1.)],
            vec![corner(-1., -1., -1.), corner(1., -1., -1.), corner(1., -1., 1.), corner(-1., -1., 1.)],
            vec![corner(-1., 1., -1.), corner(-1., 1., 1.), a, c, corner(1., 1., -1.)],
            vec![corner(-1., -1., -1.), corner(-1., 1., -1.), corner(1., 1., -1.), corner(1., -1., -1.)],
            vec![corner(-1., -1., 1.), corner(1., -1., 1.), b, a, corner(-1., 1., 1.)],
            vec![a, b, c],
        ];
        let faces: Vec<Polygon> =
            faces.into_iter().map(|face| face.into_iter().map(|p| rotation * p).collect()).collect();
        let planes = faces.iter().map(|face| {
            let normal = (face[1] - face[0]).cross(&(face[2] - face[0])).normalize();
            (normal, normal.dot(&face[0]))
        });
        let cut_off = 0.5 * 0.375 * 0.25 / 6.0;
        (faces.clone(), planes.collect(), 3.0 - cut_off)
    }

    #[test]
    fn parts_add_up_and_are_those_of_sums_over_lines() {
        // Also with faces in the planes of the grid.
        for angles in [[0.0; 3], [0.3, 0.5, 0.7], [0.0, 0.0, 0.4]] {
            let (faces, planes, volume) = body(angles);
            let (n, h) = (12, 0.25);
            let range = Range { first: 0, n, edge_mm: h, origin_mm: -1.5 };
            let (mut sum, mut area, mut cuts) = (0.0, Vector3::zeros(), 0);
            let mut cutter = Cutter::default();
            for k in 0..n {
                let z = [k, k + 1].map(|k| -1.5 + k as f64 * h);
                let mut pieces = vec![Pieces::NONE; (n + 1) * n];
                for face in &faces {
                    cutter.add(face.iter().copied(), z, [range; 2], &mut pieces);
                }
                for (j, row) in pieces.chunks_exact(n + 1).enumerate() {
                    for (i, (share, of_surface)) in (0..n).rev().zip(shares(row, [h; 3])) {
                        assert!((-1e-12..1.0 + 1e-12).contains(&share), "{share}");
                        sum += share;
                        area += of_surface;
                        if !(1e-9..=1.0 - 1e-9).contains(&share) {
                            continue;
                        }
                        cuts += 1;
                        if cuts % 5 == 0 {
                            let low = Vector3::new(-1.5 + i as f64 * h, -1.5 + j as f64 * h, z[0]);
                            let expected = sampled(&planes, &low, h);
                            assert!(
                                (share - expected).abs() < 2e-3,
                                "{angles:?} {i} {j} {k}: {share} {expected}"
                            );
                        }
                    }
                }
            }
            assert!((sum * h * h * h - volume).abs() < 1e-13 && area.norm() < 1e-12, "{sum} {area}");
        }
    }

    /// By lines along x, each cut exactly.
    fn sampled(planes: &[Plane], low: &Vector3<f64>, h: f64) -> f64 {
        let lines = 60;
        let mut sum = 0.0;
        for a in 0..lines {
            for b in 0..lines {
                let at = |k: i32| (f64::from(k) + 0.5) / f64::from(lines) * h;
                let from = low + Vector3::new(0.0, at(a), at(b));
                let (mut enter, mut leave) = (0.0_f64, h);
                for (normal, height) in planes {
                    let above = normal.dot(&from) - height;
                    if normal.x < -1e-12 {
                        enter = enter.max(-above / normal.x);
                    } else if normal.x > 1e-12 {
                        leave = leave.min(-above / normal.x);
                    } else if above > 0.0 {
                        leave = 0.0;
                    }
                }
                sum += (leave - enter).max(0.0) / h;
            }
        }
        sum / f64::from(lines * lines)
    }
}
