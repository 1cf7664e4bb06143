//! The surface of one grain: what is around it, and a polyhedron with the volume of the grain whose edges follow the
//! gaps.
//!
//! Spheres and ellipsoids are made by `curved`, polyhedra by `polyhedron`.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

use super::bodies::{Between, Bodies, MeshModel, PlacedPolyhedron};
use super::cache::{EDGE_STEPS, FacetsForm, SurfaceCache};
use super::curved::{Ball, Obstacle, Room};
use super::facets::Facets;
use super::near::Near;
use super::options::{FaceChoice, GAP_SHARE, SurfaceOptions, VolumeCorrection};
use super::polyhedron::{self, Angular, Placed};
use super::size::{EDGE_PER_GAP, Facing, Other};
use super::sphere::{Fineness, Finenesses};
use super::surface::{Shape as _, Surface};
use super::template_surface::TemplateFacets;
use crate::elementary::ln;
use crate::gap::linear::dot;
use crate::memory::OutOfMemory;

/// How far a correction looks for obstacles, in multiples of how far the size field does.
const ROOM_REACH: f64 = 3.0;
/// Longest edges on ellipsoids that are divided evenly, over the edges asked for: bisection makes them shorter by that
/// in the mean.
const EVEN_EDGE: f64 = 1.3;
/// Most triangles of an ellipsoid that are made for an estimate.
const MOST_EVEN_TRIANGLES: usize = 1_000_000;
/// Most rounds of turning dents into ridges.
const MOST_ROUNDS: usize = 8;

/// Makes the surfaces of grains. Copies, which several threads use, look up what is near in one place, and share the
/// facets of templates.
#[derive(Clone)]
pub(super) struct Grains<'a> {
    model: &'a MeshModel<'a>,
    options: &'a SurfaceOptions,
    near: Arc<Near>,
    finenesses: Finenesses,
    /// Polyhedra of the unit sphere that were needed so far.
    templates: HashMap<Fineness, Surface>,
    /// Facets of templates, by their numbers, that were needed so far.
    facets: HashMap<(u32, FacetsForm), Arc<TemplateFacets>>,
    /// Those that any of the copies needed.
    all_facets: SurfaceCache,
}

/// What a grain faces, seen from its centre.
pub(super) struct Faced<'a> {
    pub(super) other: Other<'a>,
    /// Which grain it is; none of a wall.
    pub(super) row: Option<usize>,
    pub(super) gap: f64,
    /// Direction from the nearest point of the grain to its own, a unit vector.
    pub(super) toward: [f64; 3],
    /// The point of the grain nearest to it; only of polyhedra.
    pub(super) own: Option<[f64; 3]>,
}

impl<'a> Grains<'a> {
    pub(super) fn new(model: &'a MeshModel<'a>, options: &'a SurfaceOptions) -> Result<Self, OutOfMemory> {
        let near = Arc::new(Near::new(&model.bodies, model.specimen.bounds_mm())?);
        Ok(Self {
            model,
            options,
            near,
            finenesses: Finenesses::new(),
            templates: HashMap::new(),
            facets: HashMap::new(),
            all_facets: model.surfaces.cloned().unwrap_or_default(),
        })
    }

    /// The fineness of a grain where nothing is close: its edges have the length asked for in the mean.
    pub(super) fn fineness(&self, row: usize) -> Fineness {
        let diameter = self.model.bodies.diameter(row);
        let segments = PI * diameter / self.options.edge_mm(diameter);
        self.finenesses.nearest(segments * self.model.bodies.mean_stretch(row))
    }

    /// Triangles of an ellipsoid that is divided evenly, where nothing is close; none of other grains.
    pub(super) fn even_triangles(&self, row: usize) -> Option<usize> {
        let (diameter, image) = (self.model.bodies.diameter(row), self.model.bodies.image(row));
        let ball = Ball { radius: diameter / 2.0, image, facing: Vec::new() };
        let edge_mm = EVEN_EDGE * self.options.edge_mm(diameter);
        let made = image.is_stretched().then(|| ball.even_surface(edge_mm, MOST_EVEN_TRIANGLES))?;
        Some(made.map_or(MOST_EVEN_TRIANGLES, |surface| surface.triangles.len()))
    }

    /// How far a grain sees what it faces.
    pub(super) fn reach_mm(&self, row: usize) -> f64 {
        let bodies = &self.model.bodies;
        self.options.edge_mm(bodies.diameter(row)) / EDGE_PER_GAP * bodies.most_stretch(row)
    }

    /// Calls `visit` with what a grain faces within a reach.
    pub(super) fn for_each_facing(&self, row: usize, reach: f64, mut visit: impl FnMut(Faced<'a>)) {
        let bodies: &'a Bodies<'a> = &self.model.bodies;
        let center = bodies.center(row);
        self.near.for_each(Some(row), center, bodies.outer(row), reach, |other, of_spheres| {
            let Between { gap, toward, own } = bodies.facing(row, other, of_spheres);
            // The spheres around ellipsoids may be closer than that.
            if gap < reach || gap == of_spheres {
                visit(Faced { other: bodies.other(other, center), row: Some(other), gap, toward, own });
            }
        });
        for at_wall in self.model.walls(row) {
            if at_wall.gap < reach {
                let (other, toward) = (at_wall.wall.about(center), at_wall.toward);
                visit(Faced { other, row: None, gap: at_wall.gap, toward, own: at_wall.own });
            }
        }
    }

    /// The surface of a grain about its centre, and whether it has the volume asked for; `None` when that
    /// would take more than `most_triangles`.
    pub(super) fn surface(&mut self, row: usize, most_triangles: usize) -> Option<(Surface, bool)> {
        let model = self.model;
        if let Some(polyhedron) = model.bodies.polyhedron(row) {
            let (angular, placed) = self.placed(row, &polyhedron);
            return angular.surface(&polyhedron, &placed, most_triangles);
        }
        let (diameter, image) = (model.bodies.diameter(row), model.bodies.image(row));
        // By a trifle, so that rounding brings no vertex out of the sphere.
        let radius = diameter / 2.0 * (1.0 - 4.0 * f64::EPSILON);
        let mut ball = Ball { radius, image, facing: Vec::new() };
        let mut surface = if image.is_stretched() {
            ball.even_surface(EVEN_EDGE * self.options.edge_mm(diameter), most_triangles)?
        } else {
            let fineness = self.fineness(row);
            if fineness.triangles() > most_triangles as u64 {
                return None;
            }
            let template = self.templates.entry(fineness).or_insert_with(|| fineness.polyhedron());
            ball.image_of(template)
        };
        let floor_mm = self.options.floor_mm(diameter);
        let corrects = self.options.volume_correction == VolumeCorrection::Scaled;
        let reach = self.reach_mm(row);
        let seen = if corrects { ROOM_REACH * reach } else { reach };
        let mut obstacles = Vec::new();
        self.for_each_facing(row, seen, |Faced { other, gap, toward, .. }| {
            if gap < reach {
                ball.facing.push(Facing { other, at: image.point(toward, radius), floor_mm });
            }
            let support = image.support(toward, radius);
            obstacles.push(Obstacle { other, toward, support, gap: gap.max(0.0) });
        });
        if self.options.size_field && !surface.refine(&mut ball, most_triangles) {
            return None;
        }
        if !self.options.size_field && image.is_balanced() {
            surface.flip(&ball);
        }
        let mut full = true;
        if corrects {
            let room = Room { ball: &ball, obstacles, most_mm: GAP_SHARE / 2.0 * seen };
            full = room.fill(&mut surface, diameter);
            // A dent that came of unequal steps is turned into a ridge, whose volume is taken back, which may leave a
            // smaller dent.
            for _ in 0..MOST_ROUNDS {
                if !surface.flip(&ball) {
                    break;
                }
                full = room.fill(&mut surface, diameter);
            }
        }
        surface.points.iter_mut().for_each(|p| *p = ball.place(*p));
        Some((surface, full))
    }
}

impl<'a> Grains<'a> {
    /// How the surface of a polyhedron is to be meshed, what is around it, and its facets.
    pub(super) fn placed(&mut self, row: usize, grain: &PlacedPolyhedron<'_>) -> (Angular<'a>, Placed) {
        let angular = self.angular(row, grain);
        // Facets are those of all grains of a template with about the same edges over their diameters.
        let step = (EDGE_STEPS * ln(angular.edge_mm / grain.shape.scale_mm)).round() as i64;
        let levels = Facets::levels(grain.template);
        let all_faces = self.options.faces == FaceChoice::Exact;
        let first = if all_faces && grain.template.rounding == 0.0 { levels - 1 } else { 0 };
        let of_level = |level: usize| {
            let form = FacetsForm { step, level, all_faces };
            let made = || self.all_facets.facets(grain.template, form);
            self.facets.entry((grain.number, form)).or_insert_with(made).clone()
        };
        let placed = Placed::fitting(grain, &angular, first..levels, of_level);
        (angular, placed)
    }

    /// How the surface of a polyhedron is to be meshed, and what is around it.
    fn angular(&self, row: usize, grain: &PlacedPolyhedron<'_>) -> Angular<'a> {
        let d = grain.shape.scale_mm;
        let corrects = self.options.volume_correction == VolumeCorrection::Scaled;
        let reach = self.reach_mm(row);
        let seen = if corrects { ROOM_REACH * reach } else { reach };
        let floor_mm = self.options.floor_mm(d);
        let mut angular = Angular {
            edge_mm: self.options.edge_mm(d),
            target_mm3: corrects.then(|| grain.shape.volume_mm3()),
            facing: Vec::new(),
            obstacles: Vec::new(),
            most_mm: GAP_SHARE / 2.0 * seen,
        };
        self.for_each_facing(row, seen, |Faced { other, row, gap, toward, own }| {
            let at = own.unwrap_or_default();
            if gap < reach && self.options.size_field {
                angular.facing.push(Facing { other, at, floor_mm });
            }
            // The other grain has its own half of the gap; a wall does not move.
            let share = if row.is_some() { GAP_SHARE / 2.0 } else { GAP_SHARE };
            angular.obstacles.push(match other {
                Other::Lateral { axis, radius } => {
                    polyhedron::Obstacle::Cylinder(axis, radius - (1.0 - share) * gap.max(0.0))
                }
                _ => polyhedron::Obstacle::Plane(toward, dot(at, toward) + share * gap.max(0.0)),
            });
        });
        angular
    }
}
