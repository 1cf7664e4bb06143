//! The polyhedra that Gmsh makes of spheres and of spheres that are dilated to ellipsoids.
//!
//! Gmsh divides the half of the sphere's meridian between its poles first, into the whole number of segments next above
//! what the edges ask for, and the rest of the surface has triangles of the same edges. So the closed curve has an even
//! number `n` of segments, and its edges have the length `h` that divides it into `n`.
//!
//! Gmsh divides a surface on its parameters, and finds no triangles where the two semi-axes of the equator differ by
//! more than a factor of 2.9. So the poles are the ends of the short axis of flat ellipsoids and those of the long axis
//! of others. Where the semi-axes of the equator still differ much, Gmsh's algorithm `MeshAdapt` leaves triangles that
//! its default does not; it is slower.
//!
//! Triangles with edges `h` and corners on a surface with the mean curvature `H` lie `h² H / 8` below it in the mean.
//! Summed over an ellipsoid, whose integral of `H` is `2 pi` times its mean width `w`, the polyhedron lacks the share
//! `3 h² w / (16 a b c)` of the volume: `14.8 / n²` of a sphere. Measured with Gmsh 4.15.2, spheres lack `14.4 / n² - 6
//! / n³` within 3 %, and ellipsoids as much less or more than the formula: `docs/meshes.md`.

use std::f64::consts::PI;

use crate::elementary::powf;
use crate::shape::Ellipsoid;

/// Fewest segments of the circle with the short semi-axis as its radius, with the poles at the ends of the long axis,
/// where the surface is curved most, and of the short axis. With fewer Gmsh fails, or divides the meridian again.
const LEAST_SEGMENTS: [f64; 2] = [12.0, 9.0];
/// Semi-axes of the equator over each other below which the default algorithm leaves flat triangles or none.
const LEAST_EQUATOR: f64 = 0.55;
/// Short over long semi-axis above which an ellipsoid is nearly round, and the segments that it has at least.
const ROUND: f64 = 0.5;
const ROUND_SEGMENTS: f64 = 6.0;
/// Share by which edges may be longer than segments, so that rounding makes no more of these.
const EDGE_TOLERANCE: f64 = 1.0e-5;

/// A sphere or an ellipsoid, and how finely Gmsh divides it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dilated {
    /// The semi-axes, by their number from the long one, that the axes x, y and z of the sphere are dilated to; its
    /// poles lie on z, and its meridian in the plane of x and z.
    pub(super) order: [usize; 3],
    /// Whether the semi-axes of the equator differ much.
    pub(super) needs_mesh_adapt: bool,
    /// Half of the circumference of the meridian.
    half_mm: f64,
    /// Segments of that circumference, an even number.
    segments: f64,
    /// Mean width over twice the product of the semi-axes: the inverse square of the radius of a sphere.
    curvature_per_mm2: f64,
}

impl Dilated {
    /// A sphere by its radius, with edges that are not longer than that.
    pub(super) fn sphere(radius_mm: f64, longest_mm: f64) -> Self {
        Self::new([radius_mm; 3], 2.0 * radius_mm, longest_mm)
    }

    /// The same of an ellipsoid.
    pub(super) fn ellipsoid(shape: &Ellipsoid, longest_mm: f64) -> Self {
        Self::new(shape.semi_axes_mm().into(), shape.mean_width_mm(), longest_mm)
    }

    fn new([a, b, c]: [f64; 3], mean_width_mm: f64, longest_mm: f64) -> Self {
        let is_flat = b / a > c / b;
        let (order, meridian, equator) =
            if is_flat { ([0, 1, 2], [a, c], b / a) } else { ([1, 2, 0], [a, b], c / b) };
        let half_mm = half_circumference(meridian[0], meridian[1]);
        // Spheres and nearly round ellipsoids are not curved more in one place than in another.
        let least = if c > ROUND * a { ROUND_SEGMENTS } else { LEAST_SEGMENTS[usize::from(is_flat)] };
        let edge_mm = longest_mm.min(2.0 * PI * c / least);
        // A hundredth of a segment more is no reason for another.
        let segments = 2.0 * (half_mm / edge_mm - 0.01).ceil();
        Self {
            order,
            needs_mesh_adapt: equator < LEAST_EQUATOR,
            half_mm,
            segments,
            curvature_per_mm2: mean_width_mm / (2.0 * a * b * c),
        }
    }

    /// What the polyhedron lacks of the volume.
    pub(super) fn lacking(&self) -> f64 {
        let of_sphere = match self.segments {
            ..7.0 => 12.3,
            7.0..9.0 => 12.9,
            _ => 14.4 - 6.0 / self.segments,
        };
        let radius_mm = self.half_mm / PI;
        of_sphere / (self.segments * self.segments) * radius_mm * radius_mm * self.curvature_per_mm2
    }

    /// Factor by which it is enlarged so that its polyhedron has its volume.
    pub(super) fn factor(&self) -> f64 {
        powf(1.0 - self.lacking(), -1.0 / 3.0)
    }

    /// Edges that Gmsh is told to make, with the same number of segments, where it is enlarged by a factor.
    pub(super) fn edge_mm(&self, factor: f64) -> f64 {
        2.0 * self.half_mm * factor / self.segments * (1.0 + EDGE_TOLERANCE)
    }
}

/// Half of the circumference of an ellipse, by Ramanujan's second formula (1914): exact for a circle, and within 1e-5
/// for all ratios of axes that grains may have.
fn half_circumference(a: f64, b: f64) -> f64 {
    let h = ((a - b) / (a + b)).powi(2);
    PI / 2.0 * (a + b) * (1.0 + 3.0 * h / (10.0 + (4.0 - 3.0 * h).sqrt()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn circumferences_have_the_next_even_number_of_segments() {
        let of = |segments: f64| Dilated::sphere(3.0, 6.0 * PI / segments).segments;
        assert_eq!([of(15.0), of(16.0), of(16.01), of(16.1), of(17.0)], [16.0, 16.0, 16.0, 18.0, 18.0]);
        assert_eq!(of(2.0), 6.0);
        // Twelve edges in the circle with the radius 0.5, and an ellipse of the semi-axes 3 and 0.5.
        let long = Ellipsoid::new([3.0, 0.5, 0.5]).unwrap();
        let long = Dilated::ellipsoid(&long, 10.0);
        assert_eq!((long.segments, long.order, long.needs_mesh_adapt), (48.0, [1, 2, 0], false));
        let flat = Dilated::ellipsoid(&Ellipsoid::new([3.0, 3.0, 0.5]).unwrap(), 10.0);
        assert_eq!((flat.segments, flat.order, flat.needs_mesh_adapt), (36.0, [0, 1, 2], false));
        let blade = Dilated::ellipsoid(&Ellipsoid::new([3.0, 1.0, 0.33]).unwrap(), 10.0);
        assert!(blade.needs_mesh_adapt);
    }

    #[test]
    fn an_ellipsoid_that_is_a_sphere_lacks_what_a_sphere_lacks() {
        for segments in [6.0, 8.0, 16.0, 40.0] {
            let longest_mm = 4.0 * PI / segments;
            let sphere = Dilated::sphere(2.0, longest_mm);
            let ellipsoid = Dilated::ellipsoid(&Ellipsoid::new([2.0; 3]).unwrap(), longest_mm);
            assert!((ellipsoid.lacking() / sphere.lacking() - 1.0).abs() < 1e-14);
            assert!((ellipsoid.edge_mm(1.0) / longest_mm - 1.0).abs() < 2e-5);
            assert!((sphere.factor().powi(3) * (1.0 - sphere.lacking()) - 1.0).abs() < 1e-14);
        }
        // An ellipse of the semi-axes 2 and 1 has the circumference 9.688448220547675.
        assert!((half_circumference(2.0, 1.0) - 4.844_224_110_273_84).abs() < 1e-7);
    }
}
