//! Volume fraction against depth from the wall: the wall effect.
//!
//! At a depth the grains cut a surface parallel to the wall; what they cover of it is the volume fraction
//! there. Planes parallel to a face or an end are cut in circles, whose area is exact. A cylinder's lateral surface
//! is followed by coaxial cylinders, whose cut is an integral of arcs over the height of the grain.

use std::f64::consts::PI;

use crate::packing::Spheres;
use crate::request::{Boundary, Specimen};

/// Nodes of the integral of arcs over half of the height. Substituted by a sine it is smooth and periodic, so
/// that equal steps converge fast, the faster the straighter the lateral surface is over the width of the grain.
const NODES: usize = 16;
/// Nodes for grains that are further from the axis than [`FAR`] radii.
const FEW_NODES: usize = 5;
const FAR: f64 = 4.0;

/// Volume fraction against depth from one kind of wall.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthProfile {
    /// Which walls.
    pub surface: Surface,
    /// Depths in mm, at equal steps from half a step on.
    pub depth_mm: Vec<f64>,
    /// Share of the surface at that depth which grains cover, averaged over all walls of the kind.
    pub volume_fraction: Vec<f64>,
}

/// Kinds of walls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// The six faces of a box.
    Faces,
    /// The two ends of a cylinder.
    Ends,
    /// The lateral surface of a cylinder.
    Lateral,
}

/// The profiles of a specimen, from its walls to `max_depth_mm` or to its middle, at `steps` depths each.
/// A periodic box has no walls, and no profiles.
pub fn depth_profiles(
    spheres: &Spheres,
    specimen: &Specimen,
    max_depth_mm: f64,
    steps: usize,
) -> Vec<DepthProfile> {
    match *specimen {
        Specimen::Box { boundary: Boundary::Periodic, .. } => Vec::new(),
        Specimen::Box { size_mm: [x, y, z], .. } => {
            let [columns_x, columns_y, columns_z] = [&spheres.x_mm, &spheres.y_mm, &spheres.z_mm];
            let depths = Depths::new(max_depth_mm.min(x.min(y).min(z) / 2.0), steps);
            let axes = [(columns_x, x, y * z), (columns_y, y, x * z), (columns_z, z, x * y)];
            vec![depths.planes(Surface::Faces, &axes, &spheres.d_mm)]
        }
        Specimen::Cylinder { diameter_mm, height_mm } => {
            let depths = Depths::new(max_depth_mm.min(height_mm / 2.0), steps);
            let area = PI / 4.0 * diameter_mm * diameter_mm;
            let ends = depths.planes(Surface::Ends, &[(&spheres.z_mm, height_mm, area)], &spheres.d_mm);
            let depths = Depths::new(max_depth_mm.min(diameter_mm / 2.0), steps);
            vec![ends, depths.lateral(spheres, diameter_mm / 2.0, height_mm)]
        }
    }
}

/// Equally spaced depths.
struct Depths {
    step_mm: f64,
    steps: usize,
}

impl Depths {
    fn new(max_mm: f64, steps: usize) -> Self {
        let steps = steps.max(1);
        Self { step_mm: max_mm / steps as f64, steps }
    }

    fn depth(&self, i: usize) -> f64 {
        (i as f64 + 0.5) * self.step_mm
    }

    /// The depths within `from..to`.
    fn within(&self, from: f64, to: f64) -> std::ops::Range<usize> {
        let index = |x: f64| ((x / self.step_mm - 0.5).ceil().max(0.0) as usize).min(self.steps);
        index(from)..index(to)
    }

    fn profile(&self, surface: Surface, volume_fraction: Vec<f64>) -> DepthProfile {
        DepthProfile { surface, depth_mm: (0..self.steps).map(|i| self.depth(i)).collect(), volume_fraction }
    }

    /// Planes across each axis, given as coordinates, length and the area of a plane, from both ends.
    fn planes(&self, surface: Surface, axes: &[(&Vec<f64>, f64, f64)], d_mm: &[f64]) -> DepthProfile {
        let mut covered = vec![0.0; self.steps];
        let walls = 2.0 * axes.len() as f64;
        for &(coordinates, length, area) in axes {
            for (&x, &d) in coordinates.iter().zip(d_mm) {
                let r = d / 2.0;
                for depth in [x, length - x] {
                    for i in self.within(depth - r, depth + r) {
                        let off = self.depth(i) - depth;
                        covered[i] += PI * (r * r - off * off).max(0.0) / (area * walls);
                    }
                }
            }
        }
        self.profile(surface, covered)
    }

    /// Cylinders around the axis.
    fn lateral(&self, spheres: &Spheres, radius: f64, height: f64) -> DepthProfile {
        let mut covered = vec![0.0; self.steps];
        for (i, &d) in spheres.d_mm.iter().enumerate() {
            let r = d / 2.0;
            let from_axis = (spheres.x_mm[i] - radius).hypot(spheres.y_mm[i] - radius);
            for k in self.within(radius - from_axis - r, radius - from_axis + r) {
                let at = radius - self.depth(k);
                covered[k] += arcs(r, from_axis, at) / (2.0 * PI * at * height);
            }
        }
        self.profile(Surface::Lateral, covered)
    }
}

/// Area that a sphere of radius `r`, its centre `from_axis` away, cuts out of a cylinder of radius `at`.
fn arcs(r: f64, from_axis: f64, at: f64) -> f64 {
    let off = at - from_axis;
    let half_height = (r * r - off * off).max(0.0).sqrt();
    let nodes = if from_axis > FAR * r { FEW_NODES } else { NODES };
    let mut sum = 0.0;
    // Half of the height only: the other half is its mirror image.
    for k in 0..nodes {
        let (sine, cosine) = ((k as f64 + 0.5) / nodes as f64 * PI / 2.0).sin_cos();
        let t = half_height * sine;
        // Radius squared of the circle at that height, and half the angle of the arc inside it.
        let s2 = r * r - t * t;
        let cos_angle = (at * at + from_axis * from_axis - s2) / (2.0 * at * from_axis);
        let angle = if cos_angle.is_nan() { PI } else { cos_angle.clamp(-1.0, 1.0).acos() };
        sum += 2.0 * angle * at * half_height * cosine;
    }
    PI * sum / nodes as f64
}
