//! Volume fraction against depth from the wall: the wall effect.
//!
//! At a depth the grains cut a surface parallel to the wall; what they cover of it is the volume fraction
//! there. Planes parallel to a face or an end are cut in circles, whose area is exact. A cylinder's lateral surface
//! is followed by coaxial cylinders, whose cut is an integral of arcs over the height of the grain.
//!
//! Of shaped grains the volume in each slab between two planes is exact, but for rounded polyhedra
//! (`grain::below`); what they cover of a coaxial cylinder is an integral of chords along z over the angle.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::domain::Lateral;
use crate::elementary::{acos, atan2, hypot, sin_cos};
use crate::grain::{Grain as _, PlacedGrains};
use crate::memory::OutOfMemory;
use crate::packing::{GrainsRef, Spheres};
use crate::request::Specimen;

/// Nodes of the integral of arcs over half of the height. Substituted by a sine it is smooth and periodic, so
/// that equal steps converge fast, the faster the straighter the lateral surface is over the width of the grain.
const NODES: usize = 16;
/// Nodes for grains that are further from the axis than [`FAR`] radii.
const FEW_NODES: usize = 5;
const FAR: f64 = 4.0;
/// Nodes of the integral of chords over the angle that a sphere around the grain takes.
const CHORDS: usize = 64;

/// Volume fraction against depth from one kind of wall.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthProfile {
    /// Which walls.
    pub surface: Surface,
    /// Depths in mm, at equal steps from half a step on.
    pub depth_mm: Vec<f64>,
    /// Share of the surface at that depth which grains cover, averaged over all walls of the kind. For grains that are
    /// no spheres and walls that are plane it is the share of the volume of the slab, one step thick, around that
    /// depth.
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
///
/// # Errors
/// The system refused memory.
pub fn depth_profiles<'a>(
    grains: impl Into<GrainsRef<'a>>,
    specimen: &Specimen,
    max_depth_mm: f64,
    steps: usize,
) -> Result<Vec<DepthProfile>, OutOfMemory> {
    if !specimen.domain().has_walls() {
        return Ok(Vec::new());
    }
    let grains = grains.into();
    Ok(match grains.spheres() {
        Some(spheres) => profiles(spheres, specimen, max_depth_mm, steps),
        None => profiles(&PlacedGrains::new(grains)?, specimen, max_depth_mm, steps),
    })
}

/// Grains whose profiles can be measured.
trait Profiled {
    /// Profile of planes across each axis, given by its number, length and the area of a plane, from both ends.
    fn planes(&self, depths: &Depths, surface: Surface, axes: &[(usize, f64, f64)]) -> DepthProfile;

    /// Profile of cylinders around the axis.
    fn lateral(&self, depths: &Depths, radius: f64, height: f64) -> DepthProfile;
}

fn profiles(
    grains: &impl Profiled,
    specimen: &Specimen,
    max_depth_mm: f64,
    steps: usize,
) -> Vec<DepthProfile> {
    let domain = specimen.domain();
    let [x, y, z] = domain.bounds_mm;
    let Some(Lateral { radius_mm, .. }) = domain.lateral() else {
        let depths = Depths::new(max_depth_mm.min(x.min(y).min(z) / 2.0), steps);
        return vec![grains.planes(&depths, Surface::Faces, &[(0, x, y * z), (1, y, x * z), (2, z, x * y)])];
    };
    let depths = Depths::new(max_depth_mm.min(z / 2.0), steps);
    let ends = grains.planes(&depths, Surface::Ends, &[(2, z, PI / 4.0 * x * x)]);
    let depths = Depths::new(max_depth_mm.min(x / 2.0), steps);
    vec![ends, grains.lateral(&depths, radius_mm, z)]
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
}

impl Profiled for Spheres {
    fn planes(&self, depths: &Depths, surface: Surface, axes: &[(usize, f64, f64)]) -> DepthProfile {
        let mut covered = vec![0.0; depths.steps];
        let walls = 2.0 * axes.len() as f64;
        for &(axis, length, area) in axes {
            let coordinates = [&self.x_mm, &self.y_mm, &self.z_mm][axis];
            for (&x, &d) in coordinates.iter().zip(&self.d_mm) {
                let r = d / 2.0;
                for depth in [x, length - x] {
                    for i in depths.within(depth - r, depth + r) {
                        let off = depths.depth(i) - depth;
                        covered[i] += PI * (r * r - off * off).max(0.0) / (area * walls);
                    }
                }
            }
        }
        depths.profile(surface, covered)
    }

    fn lateral(&self, depths: &Depths, radius: f64, height: f64) -> DepthProfile {
        let mut covered = vec![0.0; depths.steps];
        for (i, &d) in self.d_mm.iter().enumerate() {
            let r = d / 2.0;
            let from_axis = hypot(self.x_mm[i] - radius, self.y_mm[i] - radius);
            for k in depths.within(radius - from_axis - r, radius - from_axis + r) {
                let at = radius - depths.depth(k);
                covered[k] += arcs(r, from_axis, at) / (2.0 * PI * at * height);
            }
        }
        depths.profile(Surface::Lateral, covered)
    }
}

impl Profiled for PlacedGrains<'_> {
    fn planes(&self, depths: &Depths, surface: Surface, axes: &[(usize, f64, f64)]) -> DepthProfile {
        let step = depths.step_mm;
        let mut covered = vec![0.0; depths.steps];
        let walls = 2.0 * axes.len() as f64;
        for &(axis, length, area) in axes {
            let per_volume = 1.0 / (area * step * walls);
            for grain in 0..self.len() {
                let x = self.center_mm(grain)[axis];
                let below = self.grain(grain).volume_below(axis);
                let [down, up] = below.reach_mm;
                let slabs = |from: f64, to: f64| {
                    let first = ((from / step).floor().max(0.0) as usize).min(depths.steps);
                    first..((to / step).ceil().max(0.0) as usize).min(depths.steps)
                };
                // From the wall at 0, and from the one at the other end, whose depths run down the axis.
                for (range, height, sign) in [
                    (slabs(x - down, x + up), -x, 1.0),
                    (slabs(length - x - up, length - x + down), length - x, -1.0),
                ] {
                    // Depths run up the axis, or down: then heights run up from the last slab to the first.
                    let count = range.len() + 1;
                    let lowest = if sign > 0.0 { range.start } else { range.end };
                    let mut volumes = below.at(height + sign * step * lowest as f64, step, count);
                    if sign < 0.0 {
                        volumes.reverse();
                    }
                    for (slab, ends) in range.zip(volumes.windows(2)) {
                        covered[slab] += (ends[1] - ends[0]).abs() * per_volume;
                    }
                }
            }
        }
        depths.profile(surface, covered)
    }

    fn lateral(&self, depths: &Depths, radius: f64, height: f64) -> DepthProfile {
        let mut covered = vec![0.0; depths.steps];
        for grain in 0..self.len() {
            let ([x, y, _], grain) = (self.center_mm(grain), self.grain(grain));
            let (x, y) = (x - radius, y - radius);
            let (from_axis, reach) = (hypot(x, y), grain.outer_radius_mm());
            let chord_mm = |x, y| {
                let ends = grain.chord_mm(&Vector3::new(x, y, 0.0), &Vector3::z());
                ends.map_or(0.0, |[enter, leave]| leave - enter)
            };
            for k in depths.within(radius - from_axis - reach, radius - from_axis + reach) {
                let at = radius - depths.depth(k);
                let cos_angle = (at * at + from_axis * from_axis - reach * reach) / (2.0 * at * from_axis);
                let half_angle = if cos_angle.is_nan() { PI } else { acos(cos_angle.clamp(-1.0, 1.0)) };
                let step = 2.0 * half_angle / CHORDS as f64;
                let from = atan2(y, x) - half_angle;
                let lengths = (0..CHORDS).map(|node| {
                    let (sine, cosine) = sin_cos(from + (node as f64 + 0.5) * step);
                    chord_mm(at * cosine - x, at * sine - y)
                });
                covered[k] += lengths.sum::<f64>() * step / (2.0 * PI * height);
            }
        }
        depths.profile(Surface::Lateral, covered)
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
        let (sine, cosine) = sin_cos((k as f64 + 0.5) / nodes as f64 * PI / 2.0);
        let t = half_height * sine;
        // Radius squared of the circle at that height, and half the angle of the arc inside it.
        let s2 = r * r - t * t;
        let cos_angle = (at * at + from_axis * from_axis - s2) / (2.0 * at * from_axis);
        let angle = if cos_angle.is_nan() { PI } else { acos(cos_angle.clamp(-1.0, 1.0)) };
        sum += 2.0 * angle * at * half_height * cosine;
    }
    PI * sum / nodes as f64
}
