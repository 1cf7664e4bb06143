//! The exact part of an ellipsoid that lies in a voxel, and the area vector of its surface there.
//!
//! An affine map turns the ellipsoid into the unit ball and voxels into parallelepipeds `P`. By the divergence theorem
//! with the field `x / 3` the volume of `P` within the ball is a sum over the faces `F` of `P`:
//! `(d A_in + W_out) / 3`, with the height `d` of the plane of `F` above the centre, the area `A_in` of `F` within the
//! ball, and the solid angle `W_out` of the rest of `F` as seen from the centre. Both are sums over the edges of `F`,
//! in the plane around the foot of the centre: along an edge at the distance `e` from the foot, between `t_1` and `t_2`
//! from the point nearest to it, and with the angle `p` between them,
//! - within the disc of the plane `A_in` grows by `e (t_2 - t_1) / 2`;
//! - outside `A_in` grows by `(1 - d^2) p / 2`, or by nothing where the plane misses the ball, and `W_out` by
//!   `c p - [atan(d t / (e sqrt(d^2 + e^2 + t^2)))]` from `t_1` to `t_2`, with `c = d`, or the sign of `d` where the
//!   plane misses the ball.
//!
//! The surface of the ellipsoid within the voxel closes what the covered parts of the faces of the voxel leave open, so
//! that its area vector is the difference of these.

use nalgebra::{Matrix3, Vector3};

use crate::elementary::atan2;

/// The part of a voxel that a grain fills.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    /// Its volume over that of the voxel.
    pub(super) share: f64,
    /// The area vector of the grain's surface in the voxel, outwards, over the area of a face of the voxel, about.
    pub(super) area: Vector3<f64>,
}

/// What a face of a voxel adds: to the volume in units of the ball, and the share of the face that is within.
#[derive(Clone, Copy, Debug, Default)]
struct FacePart {
    flux: f64,
    covered: f64,
}

/// An ellipsoid and a grid of voxels, seen where the ellipsoid is the unit ball.
#[derive(Clone, Debug)]
pub(super) struct CutEllipsoid {
    map: Matrix3<f64>,
    /// Edges of a voxel.
    edges: [Vector3<f64>; 3],
    /// Unit normal of the faces across each edge, and the area of such a face.
    faces: [(Vector3<f64>, f64); 3],
    volume: f64,
    /// Half of the longest diagonal of a voxel.
    reach: f64,
    /// Areas of the voxel's own faces over that of the largest.
    areas: [f64; 3],
}

impl CutEllipsoid {
    /// The ellipsoid around the origin with the points `p · M p <= 1`; none where `M` is no such matrix.
    pub(super) fn new(inverse: &Matrix3<f64>, voxel_mm: [f64; 3]) -> Option<Self> {
        let map = inverse.cholesky()?.l().transpose();
        let edges = [0, 1, 2].map(|axis| map.column(axis) * voxel_mm[axis]);
        let faces = [0, 1, 2].map(|axis| {
            let across = edges[(axis + 1) % 3].cross(&edges[(axis + 2) % 3]);
            (across.normalize(), across.norm())
        });
        let volume = edges[0].cross(&edges[1]).dot(&edges[2]);
        let diagonal = |[x, y]: [f64; 2]| (edges[0] + edges[1] * x + edges[2] * y).norm();
        let reach = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]].map(diagonal);
        let areas = [0, 1, 2].map(|axis| 1.0 / voxel_mm[axis]);
        let most = areas.into_iter().fold(0.0, f64::max);
        Some(Self {
            map,
            edges,
            faces,
            volume,
            reach: reach.into_iter().fold(0.0, f64::max) / 2.0,
            areas: areas.map(|area| area / most),
        })
    }

    /// The part of the voxel whose lowest corner lies at `low_mm` from the centre; none where it has no point or all
    /// points of the ellipsoid.
    pub(super) fn part(&self, low_mm: &Vector3<f64>) -> Part {
        let low = self.map * low_mm;
        let [u, v, w] = self.edges;
        let middle = low + (u + v + w) / 2.0;
        let distance = middle.norm();
        let whole = |share: f64| Part { share, area: Vector3::zeros() };
        if distance >= 1.0 + self.reach {
            return whole(0.0);
        }
        if distance <= 1.0 - self.reach {
            return whole(1.0);
        }
        let mut flux = 0.0;
        let mut area = Vector3::zeros();
        for axis in 0..3 {
            let [near, far] = [low, low + self.edges[axis]].map(|corner| self.face(axis, corner));
            flux += far.flux - near.flux;
            area[axis] = (near.covered - far.covered) * self.areas[axis];
        }
        Part { share: flux / self.volume, area }
    }

    /// The face across an axis with its lowest corner.
    fn face(&self, axis: usize, corner: Vector3<f64>) -> FacePart {
        let (normal, area) = &self.faces[axis];
        let (u, v) = (self.edges[(axis + 1) % 3], self.edges[(axis + 2) % 3]);
        let height = normal.dot(&corner);
        let plane = Plane::new(height);
        let a = corner - normal * height;
        let corners = [a, a + u, a + u + v, a + v];
        let mut sums = Sums::default();
        for (i, from) in corners.iter().enumerate() {
            let along = if i % 2 == 0 { &u } else { &v } * if i < 2 { 1.0 } else { -1.0 };
            let length = along.norm();
            let e = normal.dot(&from.cross(&along)) / length;
            let t = from.dot(&along) / length;
            plane.add_edge(e, [t, t + length], &mut sums);
        }
        FacePart { flux: (height * sums.inside + sums.angle) / 3.0, covered: sums.inside / area }
    }
}

/// Area within the ball and solid angle outside.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    inside: f64,
    angle: f64,
}

/// A plane at a height above the centre of the unit ball.
struct Plane {
    height: f64,
    /// Square of the radius of its disc; 0 where it misses the ball.
    disc: f64,
}

impl Plane {
    fn new(height: f64) -> Self {
        Self { height, disc: ((1.0 - height) * (1.0 + height)).max(0.0) }
    }

    /// An edge at the signed distance `e` from the foot of the centre.
    fn add_edge(&self, e: f64, [from, to]: [f64; 2], sums: &mut Sums) {
        let half = self.disc - e * e;
        if half <= 0.0 {
            self.outside(e, [from, to], sums);
            return;
        }
        let half = half.sqrt();
        let [first, last] = [from.clamp(-half, half), to.clamp(-half, half)];
        if first > from {
            self.outside(e, [from, first.min(to)], sums);
        }
        sums.inside += e * (last - first) / 2.0;
        if last < to {
            self.outside(e, [last.max(from), to], sums);
        }
    }

    fn outside(&self, e: f64, [from, to]: [f64; 2], sums: &mut Sums) {
        let d = self.height;
        let angle = atan2(e * (to - from), e * e + from * to);
        sums.inside += self.disc * angle / 2.0;
        let [(x1, y1), (x2, y2)] = [from, to].map(|t| (e.abs() * (d * d + e * e + t * t).sqrt(), d * t));
        let seen = atan2(y2 * x1 - y1 * x2, x1 * x2 + y1 * y2);
        let factor = if self.disc > 0.0 { d } else { d.signum() };
        sums.angle += factor * angle - seen * e.signum();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    use super::*;
    use crate::properties::properties;

    fn inverse(axes: [f64; 3], angles: [f64; 3]) -> Matrix3<f64> {
        let rotation =
            UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]).to_rotation_matrix();
        let squares = Vector3::from(axes).map(|axis| 1.0 / (axis * axis));
        rotation.matrix() * Matrix3::from_diagonal(&squares) * rotation.matrix().transpose()
    }

    /// By a sum over lines along x, each cut exactly: the length, and the area along x of the surface.
    fn sampled(m: &Matrix3<f64>, low: &Vector3<f64>, h: [f64; 3]) -> (f64, f64) {
        let n = 300;
        let (mut share, mut area) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..n {
                let [y, z] = [(i, 1), (j, 2)]
                    .map(|(k, axis)| low[axis] + (f64::from(k) + 0.5) / f64::from(n) * h[axis]);
                let (a, b) = (m.m11, m.m12 * y + m.m13 * z);
                let c = m.m22 * y * y + 2.0 * m.m23 * y * z + m.m33 * z * z - 1.0;
                let root = b * b - a * c;
                if root <= 0.0 {
                    continue;
                }
                let [from, to] = [-1.0, 1.0].map(|side| (-b + side * root.sqrt()) / a - low.x);
                share += (to.min(h[0]) - from.max(0.0)).max(0.0) / h[0];
                area += f64::from(u8::from((0.0..h[0]).contains(&to)))
                    - f64::from(u8::from((0.0..h[0]).contains(&from)));
            }
        }
        let lines = f64::from(n * n);
        (share / lines, area / lines)
    }

    properties! {
        #[test]
        fn parts_are_those_of_sums_over_lines(
            axes in prop::array::uniform3(0.3..2.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
            at in prop::array::uniform3(-1.5..1.0_f64), edge in 0.1..1.0_f64,
        ) {
            let m = inverse(axes, angles);
            let (low, h) = (Vector3::from(at), [edge; 3]);
            let found = CutEllipsoid::new(&m, h).unwrap().part(&low);
            let (share, area) = sampled(&m, &low, h);
            prop_assert!((found.share - share).abs() < 1e-4, "{found:?} {share}");
            prop_assert!((found.area.x - area).abs() < 6e-3, "{found:?} {area}");
        }
    }

    #[test]
    fn the_parts_of_ellipsoids_add_up_and_their_surfaces_close() {
        let cases: [([f64; 3], [f64; 3]); 4] = [
            ([1.0; 3], [0.0; 3]),
            ([2.0, 1.5, 1.0], [0.3, 0.5, 0.7]),
            ([5.0, 1.0, 0.5], [1.0, 0.2, -0.7]),
            ([1.0, 1.0, 0.1], [0.1, 0.0, 0.0]),
        ];
        for (axes, angles) in cases {
            let longest = axes.into_iter().fold(0.0, f64::max);
            let h = [0.11, 0.1, 0.09].map(|h| h * longest);
            let cut = CutEllipsoid::new(&inverse(axes, angles), h).unwrap();
            let n = h.map(|h| (2.1 * longest / h) as i32);
            let (mut share, mut area) = (0.0, Vector3::zeros());
            for k in 0..n[2] {
                for j in 0..n[1] {
                    for i in 0..n[0] {
                        let at = |axis: usize, i: i32| f64::from(i) * h[axis] - 1.041 * longest;
                        let part = cut.part(&Vector3::new(at(0, i), at(1, j), at(2, k)));
                        assert!((-1e-11..1.0 + 1e-11).contains(&part.share), "{part:?}");
                        share += part.share;
                        area += part.area;
                    }
                }
            }
            let volume = share * h.iter().product::<f64>();
            let exact = 4.0 / 3.0 * PI * axes.iter().product::<f64>();
            assert!((volume / exact - 1.0).abs() < 1e-12 && area.norm() < 1e-10, "{volume} {exact} {area}");
        }
        // An octant of a ball, a half, and a ball whose surface touches the sides of the voxel.
        let part = |edge: f64, low: [f64; 3]| {
            CutEllipsoid::new(&Matrix3::identity(), [edge; 3]).unwrap().part(&Vector3::from(low)).share
        };
        assert!((part(1.5, [0.0; 3]) * 1.5_f64.powi(3) - PI / 6.0).abs() < 1e-14);
        assert!((part(2.0, [-1.0, 0.0, -1.0]) * 8.0 - PI * 2.0 / 3.0).abs() < 1e-14);
        assert!((part(2.0, [-1.0; 3]) * 8.0 - PI * 4.0 / 3.0).abs() < 1e-14);
    }

    /// A cap that a plane cuts off: the area vector is that of its base.
    #[test]
    fn normals_of_a_flat_part_are_those_of_the_plane() {
        let cut = CutEllipsoid::new(&Matrix3::from_diagonal_element(1e-8), [1.0; 3]).unwrap();
        let direction = Vector3::new(0.6, 0.64, 0.48);
        let part = cut.part(&(direction * 1e4 - Vector3::repeat(0.5)));
        assert!((part.area.normalize() - direction).norm() < 1e-4, "{part:?}");
        assert!((part.share - 0.5).abs() < 1e-4, "{part:?}");
    }
}
