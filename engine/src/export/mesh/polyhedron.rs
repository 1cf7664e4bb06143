//! The surface of one grain that is a convex polyhedron.
//!
//! The facets of its template (`facets`) are triangulated once for all of its grains (`template_surface`). The
//! triangles are turned and scaled to a grain, and divided where gaps ask for shorter edges; within a facet the
//! triangulation is Delaunay's, and vertices inside of a facet are moved to the middle of their neighbours.
//!
//! The volume is that of the grain: the polyhedron is scaled about its centre, as far as the gaps leave room. Of the
//! levels of precision of its template, a grain takes the coarsest whose volume fits into that room. Where no volume is
//! asked for, the polyhedron is the largest copy that lies inside of the grain.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector3;

use super::bodies::PlacedPolyhedron;
use super::size::Facing;
use super::surface::{Shape, Surface};
use super::template_surface::{SMOOTHINGS, STEPS, TemplateFacets, is_no_delaunay, middle, smooth};
use crate::elementary::cbrt;
use crate::gap::linear::{Vector, dot, norm, scaled};

/// Share by which inscribed surfaces are smaller, so that rounding brings no vertex out of the body.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Share of its volume that a grain may lack where no room is left, before its next level of precision is taken.
const MOST_LACKING: f64 = 1.0e-3;

/// How the surface of a grain is to be meshed, and what is around it, seen from its centre.
pub(super) struct Angular<'a> {
    /// Length of edges where nothing is close.
    pub(super) edge_mm: f64,
    /// The volume to be met, where volumes are corrected.
    pub(super) target_mm3: Option<f64>,
    pub(super) facing: Vec<Facing<'a>>,
    /// What no vertex crosses.
    pub(super) obstacles: Vec<Obstacle>,
    /// No vertex moves farther, for what is farther away was not looked at.
    pub(super) most_mm: f64,
}

/// What no vertex crosses where a grain is enlarged. The grain lies on the side where its centre is.
pub(super) enum Obstacle {
    /// A plane across a unit vector, and its distance from the centre.
    Plane(Vector, f64),
    /// A cylinder along z around the grain: where its axis stands, and its radius.
    Cylinder([f64; 2], f64),
}

/// The facets of a grain about its centre, in mm, before they are scaled to the volume of the grain.
pub(super) struct Placed {
    pub(super) template: Arc<TemplateFacets>,
    pub(super) vertices: Vec<Vector>,
    pub(super) volume_mm3: f64,
    /// By what they are scaled.
    pub(super) factor: f64,
    /// Whether they have the volume asked for then.
    pub(super) is_full: bool,
}

impl Placed {
    /// The facets of a grain at a level of precision.
    fn new(grain: &PlacedPolyhedron<'_>, template: Arc<TemplateFacets>, angular: &Angular<'_>) -> Self {
        let vertices: Vec<Vector> = turned(grain, &template.facets.vertices).collect();
        let volume_mm3 = template.facets.volume * grain.shape.scale_mm.powi(3);
        let mut placed = Self { template, vertices, volume_mm3, factor: 1.0, is_full: true };
        if !placed.template.facets.is_exact {
            (placed.factor, placed.is_full) = angular.factor(&placed);
        }
        placed
    }

    /// The facets of a grain at the coarsest of some levels of precision that has its volume, or else at that which
    /// lacks least of it.
    pub(super) fn fitting(
        grain: &PlacedPolyhedron<'_>,
        angular: &Angular<'_>,
        levels: Range<usize>,
        mut of_level: impl FnMut(usize) -> Arc<TemplateFacets>,
    ) -> Self {
        let lacking =
            |placed: &Self| angular.target_mm3.map_or(0.0, |target| 1.0 - placed.meshed_mm3() / target);
        let mut best = Self::new(grain, of_level(levels.start), angular);
        for level in levels.skip(1) {
            if lacking(&best) <= MOST_LACKING {
                break;
            }
            let next = Self::new(grain, of_level(level), angular);
            if lacking(&next) < lacking(&best) {
                best = next;
            }
        }
        best
    }

    /// Volume inside of the facets as they are meshed.
    pub(super) fn meshed_mm3(&self) -> f64 {
        self.volume_mm3 * self.factor.powi(3)
    }
}

/// Points of a template about the centre of a grain, in mm.
fn turned<'p>(
    grain: &PlacedPolyhedron<'_>,
    points: &'p [Vector3<f64>],
) -> impl Iterator<Item = Vector> + use<'p> {
    let (scale, rotation) = (grain.shape.scale_mm, grain.pose.rotation());
    points.iter().map(move |point| {
        let u = point * scale;
        [0, 1, 2].map(|k| (rotation[(k, 0)] * u[0] + rotation[(k, 1)] * u[1]) + rotation[(k, 2)] * u[2])
    })
}

impl Obstacle {
    /// How far a point may move away from the centre.
    fn room(&self, p: Vector) -> f64 {
        let length = norm(p);
        match *self {
            Self::Plane(across, distance) => {
                let along = dot(p, across);
                if along > 0.0 { (distance / along - 1.0) * length } else { f64::INFINITY }
            }
            Self::Cylinder(axis, radius) => {
                let from_axis = [p[0] - axis[0], p[1] - axis[1]];
                let along = [p[0] / length, p[1] / length];
                let square = along[0] * along[0] + along[1] * along[1];
                let slope = from_axis[0] * along[0] + from_axis[1] * along[1];
                let inside = radius * radius - from_axis[0] * from_axis[0] - from_axis[1] * from_axis[1];
                if square > 0.0 {
                    ((slope * slope + square * inside.max(0.0)).sqrt() - slope) / square
                } else {
                    f64::INFINITY
                }
            }
        }
    }
}

impl Angular<'_> {
    /// The surface of a polyhedron, and whether it has the volume asked for; `None` when that would take more than
    /// `most_triangles`.
    pub(super) fn surface(
        &self,
        grain: &PlacedPolyhedron<'_>,
        placed: &Placed,
        most_triangles: usize,
    ) -> Option<(Surface, bool)> {
        let mut surface = placed.template.surface(most_triangles)?.into_owned();
        let points: Vec<Vector3<f64>> = surface.points.iter().map(|p| Vector3::from(*p)).collect();
        surface.points = turned(grain, &points).map(|p| scaled(p, placed.factor)).collect();
        let mut divided = Divided { facing: &self.facing, coarse: STEPS[0] };
        for coarse in STEPS {
            if self.facing.is_empty() {
                break;
            }
            divided.coarse = coarse;
            let before = surface.triangles.len();
            if !surface.refine(&mut divided, most_triangles) {
                return None;
            }
            if surface.triangles.len() > before {
                for _ in 0..SMOOTHINGS {
                    smooth(&mut surface);
                    surface.flip(&divided);
                }
            }
        }
        (surface.triangles.len() <= most_triangles).then_some((surface, placed.is_full))
    }

    /// How far a point may move away from the centre.
    fn room(&self, p: Vector) -> f64 {
        self.obstacles.iter().map(|obstacle| obstacle.room(p)).fold(self.most_mm, f64::min).max(0.0)
    }

    /// By what facets are scaled about the centre, into the grain or to the volume asked for as far as there is room,
    /// and whether they have that volume then.
    fn factor(&self, placed: &Placed) -> (f64, bool) {
        let inscribed = placed.template.facets.inscribed * (1.0 - ROUNDING);
        let Some(target) = self.target_mm3 else { return (inscribed, true) };
        let room = |vertex: &Vector| self.room(scaled(*vertex, inscribed)) / norm(*vertex);
        let most = inscribed + placed.vertices.iter().map(room).fold(f64::INFINITY, f64::min);
        let wanted = cbrt(target / placed.volume_mm3);
        (wanted.min(most), wanted <= most)
    }
}

/// A surface that is divided where gaps ask for shorter edges.
struct Divided<'a> {
    facing: &'a [Facing<'a>],
    coarse: f64,
}

impl Shape for Divided<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[Vector]) -> Vector {
        middle(a, b, points)
    }

    fn wants_shorter(&self, centroid: Vector, longest_mm: f64) -> bool {
        self.facing.iter().any(|facing| facing.wants_shorter(centroid, longest_mm, self.coarse))
    }

    fn is_wrong(&self, edge: [u32; 2], beside: [u32; 2], points: &[Vector]) -> bool {
        is_no_delaunay(edge, beside, points)
    }
}
