//! Volumes of grains below planes across an axis.
//!
//! An ellipsoid is the affine image of a ball, so that its volume below a plane is the same share of its own as that of
//! a ball: `(2 + 3 u - u³) / 4` at the height `u` over the reach of the grain, from -1 to 1.
//!
//! The volume of a polyhedron below the plane `z = t` is the integral of `(z - t) n_z` over the part of its surface
//! below the plane, by the divergence theorem, because the field `(0, 0, z - t)` has the divergence 1 and vanishes on
//! the section. A triangle of the area `A` contributes `-A n_z E[(t - z)+]`, the mean over its points, which is a cubic
//! of `t` between its heights and `t` less their mean above them.
//!
//! The surface of a rounded polyhedron is replaced by polygons within it ([`Skin`]), and volumes are scaled to that of
//! the grain. With the volume `V` of the grain and `V_in` within the polygons, the volume of the grain below any plane
//! lies between `V_in(t)` and `V_in(t) + V - V_in`, and so does `V_in(t) V / V_in`: no volume is wrong by more than
//! `V - V_in`, which a test bounds.

use nalgebra::Vector3;

use crate::arrays::Each as _;
use crate::geometry::convex::{Convex, Place, Skin, SkinPoint};
use crate::sorting;

/// Most of the angle that a polygon around a rounded edge or corner turns by.
const MOST_ANGLE: f64 = 0.2;

/// The surface of a template as triangles, in units of its scale.
#[derive(Debug)]
pub(super) struct TriangleSkin {
    vertices: Vec<Vector3<f64>>,
    /// Counter-clockwise as seen from outside.
    triangles: Vec<[u32; 3]>,
    /// Area of each triangle along its outward normal.
    areas: Vec<Vector3<f64>>,
    /// Volume of the template over that within the triangles.
    volume_ratio: f64,
}

impl TriangleSkin {
    /// The surface of a template of a volume.
    pub(super) fn new(form: &Convex, volume: f64) -> Self {
        let skin = Skin::new(form, MOST_ANGLE);
        let on_surface =
            |point: &SkinPoint| form.vertices[point.vertex as usize] + point.normal * form.rounding;
        let vertices: Vec<Vector3<f64>> = skin.points.iter().map(on_surface).collect();
        let fan = |corners: &Vec<u32>| -> Vec<[u32; 3]> {
            corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]).collect()
        };
        let triangles: Vec<[u32; 3]> = skin.polygons.iter().flat_map(|(_, corners)| fan(corners)).collect();
        let area = |triangle: &[u32; 3]| {
            let [p, q, r] = triangle.each(|corner| vertices[corner as usize]);
            (q - p).cross(&(r - p)) / 2.0
        };
        let areas: Vec<Vector3<f64>> = triangles.iter().map(area).collect();
        let within: f64 =
            triangles.iter().zip(&areas).map(|(t, area)| vertices[t[0] as usize].dot(area) / 3.0).sum();
        Self { vertices, triangles, areas, volume_ratio: volume / within }
    }
}

/// The volume of a grain below planes across an axis.
pub(crate) struct VolumeBelow<'a> {
    /// How far the grain reaches below and above its centre; where it is rounded it may reach a little farther.
    pub(crate) reach_mm: [f64; 2],
    volume_mm3: f64,
    /// `None` of an ellipsoid.
    polyhedron: Option<PolyhedronBelow<'a>>,
}

struct PolyhedronBelow<'a> {
    skin: &'a TriangleSkin,
    /// Of the vertices, above the centre.
    heights_mm: Vec<f64>,
    /// Its product with the area of a triangle is the area across the axis in mm², times the volume of the grain over
    /// that within the triangles.
    areas_along: Vector3<f64>,
}

impl<'a> VolumeBelow<'a> {
    /// That of an ellipsoid with its reach along the axis.
    pub(super) fn of_ellipsoid(reach_mm: f64, volume_mm3: f64) -> Self {
        Self { reach_mm: [reach_mm; 2], volume_mm3, polyhedron: None }
    }

    /// That of a polyhedron with its place.
    pub(super) fn of_polyhedron(skin: &'a TriangleSkin, place: &Place, axis: usize, volume_mm3: f64) -> Self {
        let direction = place.rotation.row(axis).transpose();
        let along = direction * place.scale;
        let heights_mm: Vec<f64> = skin.vertices.iter().map(|vertex| vertex.dot(&along)).collect();
        let low = heights_mm.iter().copied().fold(f64::INFINITY, f64::min);
        let high = heights_mm.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let areas_along = direction * place.scale.powi(2) * skin.volume_ratio;
        let polyhedron = Some(PolyhedronBelow { skin, heights_mm, areas_along });
        Self { reach_mm: [-low, high], volume_mm3, polyhedron }
    }

    /// Volumes in mm³ below planes at equal steps upwards, by their heights above the centre in mm.
    pub(crate) fn at(&self, first_mm: f64, step_mm: f64, count: usize) -> Vec<f64> {
        let [below, above] = self.reach_mm;
        let height = |k: usize| first_mm + step_mm * k as f64;
        let mut volumes = match &self.polyhedron {
            None => (0..count)
                .map(|k| {
                    let u = height(k) / above;
                    self.volume_mm3 * (2.0 + u * (3.0 - u * u)) / 4.0
                })
                .collect(),
            Some(heights) => heights.volumes(first_mm, step_mm, count),
        };
        for (k, volume) in volumes.iter_mut().enumerate() {
            if height(k) <= -below {
                *volume = 0.0;
            } else if height(k) >= above {
                *volume = self.volume_mm3;
            }
        }
        volumes
    }
}

impl PolyhedronBelow<'_> {
    fn volumes(&self, first_mm: f64, step_mm: f64, count: usize) -> Vec<f64> {
        let mut volumes = vec![0.0; count];
        // Of the triangles that lie below each plane, but not below the one before: area, and area times mean height.
        let mut whole = vec![[0.0; 2]; count + 1];
        let first_above = |height: f64| (((height - first_mm) / step_mm).ceil().max(0.0) as usize).min(count);
        for (corners, area) in self.skin.triangles.iter().zip(&self.skin.areas) {
            let mut heights = corners.each(|corner| self.heights_mm[corner as usize]);
            sorting::ascending(&mut heights);
            let area = area.dot(&self.areas_along);
            let above = first_above(heights[2]);
            for (k, volume) in volumes.iter_mut().enumerate().take(above).skip(first_above(heights[0])) {
                *volume -= area * mean_depth(heights, first_mm + step_mm * k as f64);
            }
            whole[above][0] += area;
            whole[above][1] += area * heights.iter().sum::<f64>() / 3.0;
        }
        let [mut area, mut moment] = [0.0; 2];
        for (k, volume) in volumes.iter_mut().enumerate() {
            area += whole[k][0];
            moment += whole[k][1];
            *volume += moment - area * (first_mm + step_mm * k as f64);
        }
        volumes
    }
}

/// `E[(t - z)+]` over the points of a triangle, by the heights of its corners from the lowest up and a `t` between.
fn mean_depth([low, middle, high]: [f64; 3], t: f64) -> f64 {
    if t <= low {
        0.0
    } else if t < middle {
        let x = t - low;
        x / 3.0 * (x / (middle - low)) * (x / (high - low))
    } else {
        let mean = (low + middle + high) / 3.0;
        let x = high - t;
        // The plane lies above the triangle, or cuts its highest corner.
        let corner = if x > 0.0 { x / 3.0 * (x / (high - low)) * (x / (high - middle)) } else { 0.0 };
        t - mean + corner
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
#[path = "below_tests.rs"]
mod tests;
