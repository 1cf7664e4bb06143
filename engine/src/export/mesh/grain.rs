//! The surface of one grain: a polyhedron whose edges follow the gaps around it, with the volume of the grain.
//!
//! A polyhedron with its vertices on the sphere has too little volume: `3 h^2 / (8 R^2)` of it is missing for edges `h`
//! (1/2 R times the mean of `h^2/3 - r^2` over an equilateral triangle, `r` from its centroid). So vertices are moved
//! outwards, each in proportion to the area of the triangles around it, which is the `h^2` of that place, until the
//! volume is that of the sphere. No vertex crosses a plane that leaves half of the gap to what it faces, so polyhedra
//! of grains that do not touch stay apart. Of an ellipsoid all of this is done on the sphere that it is an affine image
//! of (`bodies`), with gaps and planes as they are around the ellipsoid. In the finely meshed regions close to contacts
//! there is little to move.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::bodies::{Between, Bodies, Image, MeshModel, PlacedPolyhedron};
use super::near::Near;
use super::options::{SurfaceOptions, VolumeCorrection};
use super::polyhedron::{self, Angular, Placed};
use super::rounded::Facets;
use super::size::{EDGE_PER_GAP, Facing, Other};
use super::sphere::{self, Fineness, Finenesses};
use super::surface::{Shape, Surface, angle, cross, dot};
use crate::arrays::{self, Each as _};
use crate::elementary::{exp, ln};
use crate::gap::linear::{Vector, minus};
use crate::memory::OutOfMemory;

/// Share of the gap between two grains, or a grain and a wall, that a correction of volumes may use up.
pub(super) const GAP_SHARE: f64 = 0.5;
/// How far a correction looks for obstacles, in multiples of how far the size field does.
const ROOM_REACH: f64 = 3.0;
/// Steps of edges over diameters that share their facets, for each factor of e.
const EDGE_STEPS: f64 = 16.0;
/// Times that areas are averaged with those of neighbours.
const AVERAGINGS: usize = 4;
/// Most rounds of turning dents into ridges.
const MOST_ROUNDS: usize = 8;
/// How far the angles opposite to an edge must be from half a turn for it to be clear which diagonal is Delaunay's.
pub(super) const CLEARLY: f64 = PI / 6.0;
/// Largest angle between the normals of its triangles: beyond it a dent would be deep.
const MOST_FOLD: f64 = PI / 6.0;
/// Relative error of a corrected volume.
const VOLUME_TOLERANCE: f64 = 1.0e-13;
/// Most steps of the search for it.
const MOST_STEPS: usize = 60;

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
    /// Facets of templates that were needed so far.
    facets: HashMap<FacetsKey, SharedFacets>,
    /// Those that any of the copies needed.
    all_facets: Arc<Mutex<HashMap<FacetsKey, SharedFacets>>>,
}

/// A template by its number, the step of edges over diameters, and whether it is rounded.
type FacetsKey = (u32, i64, bool);
/// Facets that one copy makes and others wait for; none of templates that are meshed as they are.
type SharedFacets = Arc<OnceLock<Option<Facets>>>;

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
            all_facets: Arc::default(),
        })
    }

    /// The fineness of a grain where nothing is close: its edges have the length asked for in the mean.
    pub(super) fn fineness(&self, row: usize) -> Fineness {
        let diameter = self.model.bodies.diameter(row);
        let segments = PI * diameter / self.options.edge_mm(diameter);
        self.finenesses.nearest(segments * self.model.bodies.mean_stretch(row))
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
            return angular.surface(&placed, most_triangles);
        }
        let (diameter, image) = (self.model.bodies.diameter(row), self.model.bodies.image(row));
        let fineness = self.fineness(row);
        if fineness.triangles() > most_triangles as u64 {
            return None;
        }
        let mut surface = self.templates.entry(fineness).or_insert_with(|| fineness.polyhedron()).clone();
        // By a trifle, so that rounding brings no vertex out of the sphere.
        let radius = diameter / 2.0 * (1.0 - 4.0 * f64::EPSILON);
        surface.points.iter_mut().for_each(|p| *p = image.balanced(*p).each(|x| x * radius));
        let floor_mm = self.options.floor_mm(diameter);
        let is_out_of_balance = image.is_out_of_balance();
        let mut ball = Ball { radius, image, is_out_of_balance, facing: Vec::new() };
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
            let room = Room { radius, image, obstacles, most_mm: GAP_SHARE / 2.0 * seen };
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
        surface.points.iter_mut().for_each(|p| *p = image.place(*p));
        Some((surface, full))
    }
}

impl<'a> Grains<'a> {
    /// A polyhedron with faces that are not too narrow to be meshed, how it is to be meshed, and what is around it.
    pub(super) fn placed<'s>(
        &'s mut self,
        row: usize,
        grain: &PlacedPolyhedron<'s>,
    ) -> (Angular<'a>, Placed<'s>) {
        let angular = self.angular(row, grain);
        let (template, d) = (grain.template, grain.shape.scale_mm);
        // Facets are those of all grains of a template with about the same edges over their diameters.
        let step = (EDGE_STEPS * ln(angular.edge_mm / d)).round();
        let is_rounded = template.rounding > 0.0 && 2.0 * template.rounding * d >= angular.floor_mm;
        let edge = exp(step / EDGE_STEPS);
        let key = (grain.number, step as i64, is_rounded);
        let all_facets = || self.all_facets.lock().unwrap_or_else(PoisonError::into_inner);
        let shared = self.facets.entry(key).or_insert_with(|| all_facets().entry(key).or_default().clone());
        let facets = shared.get_or_init(|| {
            if is_rounded { Some(Facets::new(template, edge)) } else { Facets::of_narrow(template, edge) }
        });
        let placed = match facets {
            Some(facets) => Placed::facets(grain, facets),
            None => Placed::core(grain),
        };
        (angular, placed)
    }

    /// How the surface of a polyhedron is to be meshed, and what is around it.
    fn angular(&self, row: usize, grain: &PlacedPolyhedron<'_>) -> Angular<'a> {
        let d = grain.shape.scale_mm;
        let corrects = self.options.volume_correction == VolumeCorrection::Scaled;
        let reach = self.reach_mm(row);
        let seen = if corrects { ROOM_REACH * reach } else { reach };
        let mut angular = Angular {
            edge_mm: self.options.edge_mm(d),
            floor_mm: self.options.floor_mm(d),
            target_mm3: corrects.then(|| grain.shape.volume_mm3()),
            facing: Vec::new(),
            obstacles: Vec::new(),
            most_mm: GAP_SHARE / 2.0 * seen,
        };
        self.for_each_facing(row, seen, |Faced { other, row, gap, toward, own }| {
            let at = own.unwrap_or_default();
            if gap < reach && self.options.size_field {
                angular.facing.push(Facing { other, at, floor_mm: angular.floor_mm });
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

/// A grain about its centre, and what it faces.
struct Ball<'a> {
    /// Of the sphere that the grain is an image of.
    radius: f64,
    image: Image,
    is_out_of_balance: bool,
    facing: Vec<Facing<'a>>,
}

/// Something that vertices must not come too close to.
struct Obstacle<'a> {
    other: Other<'a>,
    /// Direction of its nearest point from that of the grain.
    toward: [f64; 3],
    /// How far the grain reaches that way.
    support: f64,
    gap: f64,
}

/// Where the vertices of a grain may go.
struct Room<'a> {
    /// Of the sphere that the grain is an image of.
    radius: f64,
    image: Image,
    obstacles: Vec<Obstacle<'a>>,
    /// No vertex moves farther, for what is farther away was not looked at.
    most_mm: f64,
}

impl Room<'_> {
    /// Moves vertices outwards until the polyhedron has the volume of its sphere, and so its image that of the grain;
    /// returns whether the gaps left room for that.
    fn fill(&self, surface: &mut Surface, diameter: f64) -> bool {
        let target = PI / 6.0 * diameter.powi(3);
        let radius = self.radius;
        surface.points.iter_mut().for_each(|p| *p = sphere::unit(*p).each(|x| x * radius));
        let inscribed = surface.points.clone();
        let rooms: Vec<f64> = inscribed.iter().map(|p| self.at(*p)).collect();
        let weights = areas_around(surface);
        let mut miss = |step: f64| {
            for ((p, q), (room, weight)) in
                surface.points.iter_mut().zip(&inscribed).zip(rooms.iter().zip(&weights))
            {
                let scale = 1.0 + (step * weight).min(*room) / radius;
                *p = q.each(|x| x * scale);
            }
            surface.volume_mm3() / target - 1.0
        };
        // Between no step, with too little volume, and one that moves every vertex as far as it may go.
        let farthest = rooms.iter().zip(&weights).map(|(room, weight)| room / weight).fold(0.0, f64::max);
        let (mut low, mut high) = ((0.0, miss(0.0)), (farthest, miss(farthest)));
        if high.1 <= VOLUME_TOLERANCE {
            return high.1 >= -VOLUME_TOLERANCE;
        }
        // False position; the volume is nearly linear in the step, and halving takes over where it is not.
        for turn in 0..MOST_STEPS {
            let share = if turn % 4 == 3 { 0.5 } else { low.1 / (low.1 - high.1) };
            let step = low.0 + share * (high.0 - low.0);
            let found = (step, miss(step));
            if found.1.abs() <= VOLUME_TOLERANCE {
                break;
            }
            if found.1 < 0.0 { low = found } else { high = found }
        }
        true
    }

    /// How far a vertex of the sphere may move outwards.
    fn at(&self, p: [f64; 3]) -> f64 {
        let p = self.image.place(p);
        let stretch = self.image.stretch(p, self.radius);
        let room = |obstacle: &Obstacle<'_>| match obstacle.other {
            Other::Sphere { .. } | Other::Ellipsoid { .. } | Other::Polyhedron(..) => {
                // A plane across the shortest way between both, so that the other grain has its own half of the gap.
                let along = dot(p, obstacle.toward);
                let left = obstacle.support + GAP_SHARE / 2.0 * obstacle.gap - along;
                if along > 0.0 { left * self.radius / along } else { f64::INFINITY }
            }
            Other::Plane(..) | Other::Lateral { .. } => GAP_SHARE * obstacle.other.gap_mm(p) / stretch,
        };
        self.obstacles.iter().map(room).fold(self.most_mm / stretch, f64::min).max(0.0)
    }
}

/// Mean area of the triangles around each vertex, averaged with those of its neighbours: where edges become
/// shorter, vertices are then moved by lengths that change gradually, which leaves no dents.
fn areas_around(surface: &Surface) -> Vec<f64> {
    let mut around = vec![(0.0, 0.0); surface.points.len()];
    for corners in &surface.triangles {
        let [a, b, c] = corners.each(|p| surface.points[p as usize]);
        let from_a = |p: [f64; 3]| [0, 1, 2].each(|i| p[i] - a[i]);
        let normal = cross(from_a(b), from_a(c));
        let area = dot(normal, normal).sqrt() / 2.0;
        for &p in corners {
            let sum = &mut around[p as usize];
            *sum = (sum.0 + area, sum.1 + 1.0);
        }
    }
    let mut means: Vec<f64> = around.iter().map(|(sum, n)| sum / n).collect();
    for _ in 0..AVERAGINGS {
        let mut smooth: Vec<(f64, f64)> = means.iter().map(|mean| (*mean, 1.0)).collect();
        for corners in &surface.triangles {
            for k in 0..3 {
                let (own, next) = (corners[k] as usize, corners[(k + 1) % 3] as usize);
                smooth[own].0 += means[next];
                smooth[own].1 += 1.0;
            }
        }
        means = smooth.into_iter().map(|(sum, n)| sum / n).collect();
    }
    means
}

impl Shape for Ball<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[[f64; 3]]) -> [f64; 3] {
        let (p, q) = (points[a as usize], points[b as usize]);
        sphere::unit(arrays::from_fn(|i| p[i] + q[i])).each(|x| x * self.radius)
    }

    fn place(&self, p: [f64; 3]) -> [f64; 3] {
        self.image.place(p)
    }

    fn wants_shorter(&self, centroid: [f64; 3], longest_mm: f64) -> bool {
        self.facing.iter().any(|facing| facing.wants_shorter(centroid, longest_mm, 1.0))
    }

    /// Whether the surface is dented along ab: d lies above the plane of abc, and by more than rounding.
    ///
    /// Of very flat ellipsoids that counts only where it is not clear which diagonal is Delaunay's on the ellipsoid.
    /// The mesher's tetrahedra are Delaunay's: inside of an edge that is far from it they are flat, while beyond a dent
    /// along the other diagonal they are not.
    fn is_wrong(&self, [a, b]: [u32; 2], [c, d]: [u32; 2], points: &[[f64; 3]]) -> bool {
        if self.is_out_of_balance
            && let Some(is_far) = self.is_far_from_delaunay([a, b, c, d], points)
        {
            return is_far;
        }
        let from_a = |p: u32| [0, 1, 2].each(|i| points[p as usize][i] - points[a as usize][i]);
        dot(cross(from_a(b), from_a(c)), from_a(d)) > 1e-12 * self.radius.powi(3)
    }
}

impl Ball<'_> {
    /// Whether ab is the wrong diagonal of the triangles abc and bad, where it is clear which is Delaunay's.
    #[cold]
    fn is_far_from_delaunay(&self, corners: [u32; 4], points: &[Vector]) -> Option<bool> {
        let angles = opposite_angles(corners.each(|p| self.image.place(points[p as usize])))?;
        ((angles - PI).abs() > CLEARLY).then_some(angles > PI)
    }
}

/// The sum of the angles opposite to ab in the triangles abc and bad, where these are nearly in one plane.
pub(super) fn opposite_angles([a, b, c, d]: [Vector; 4]) -> Option<f64> {
    let normals = [cross(minus(b, a), minus(c, a)), cross(minus(d, a), minus(b, a))];
    let are_flat = angle(normals) < MOST_FOLD;
    are_flat.then(|| angle([minus(a, c), minus(b, c)]) + angle([minus(a, d), minus(b, d)]))
}
