//! The surface of a sphere or an ellipsoid: a polyhedron whose edges follow the gaps around it, with the volume of the
//! grain.
//!
//! A polyhedron with its vertices on the sphere has too little volume: `3 h^2 / (8 R^2)` of it is missing for edges `h`
//! (1/2 R times the mean of `h^2/3 - r^2` over an equilateral triangle, `r` from its centroid). So vertices are moved
//! outwards, each in proportion to the area of the triangles around it, which is the `h^2` of that place, until the
//! volume is that of the sphere. No vertex crosses a plane that leaves half of the gap to what it faces, so polyhedra
//! of grains that do not touch stay apart. Of an ellipsoid all of this is done on the sphere that it is an affine image
//! of (`bodies`), with gaps and planes as they are around the ellipsoid. In the finely meshed regions close to contacts
//! there is little to move.
//!
//! The triangles of an ellipsoid that is much longer than thick would be stretched as its map stretches them. Such an
//! ellipsoid is divided evenly instead: from the image of an icosahedron, edges are bisected until none is longer than
//! asked for, or than the least radius of curvature allows, and vertices are moved to the middle of their neighbours.

use std::f64::consts::PI;

use super::bodies::Image;
use super::options::GAP_SHARE;
use super::size::{Facing, Other};
use super::sphere::Fineness;
use super::surface::{Shape, Surface, angle};
use crate::arrays::Each as _;
use crate::gap::linear::{Vector, cross, distance2, dot, minus, scaled, sum, unit};

/// Times that areas are averaged with those of neighbours.
const AVERAGINGS: usize = 4;
/// How far the angles opposite to an edge must be from half a turn for it to be clear which diagonal is Delaunay's.
pub(super) const CLEARLY: f64 = PI / 6.0;
/// Largest angle between the normals of its triangles: beyond it a dent would be deep.
const MOST_FOLD: f64 = PI / 6.0;
/// Relative error of a corrected volume.
const VOLUME_TOLERANCE: f64 = 1.0e-13;
/// Most steps of the search for it.
const MOST_STEPS: usize = 60;
/// Edges in multiples of those asked for, from step to step: what is coarse is put in order before it is divided.
const STEPS: [f64; 3] = [4.0, 2.0, 1.0];
/// Times that vertices are moved to the middle of their neighbours, in each step.
const RELAXATIONS: usize = 6;
/// Longest edges of an ellipsoid that is divided evenly, over the least radius of curvature.
const EDGE_PER_RADIUS: f64 = 0.8;
/// Edges of such an ellipsoid that curvature does not make shorter, over its shortest semi-axis.
const EDGE_PER_SEMI_AXIS: f64 = 0.7;

/// A grain about its centre, and what it faces. Vertices lie on the sphere that the grain is an image of, or on the
/// grain itself where it is divided evenly.
pub(super) struct Ball<'a> {
    /// Of the sphere that the grain is an image of.
    pub(super) radius: f64,
    pub(super) image: Image,
    pub(super) facing: Vec<Facing<'a>>,
}

impl Ball<'_> {
    /// Whether the grain is divided evenly.
    fn is_even(&self) -> bool {
        self.image.is_stretched()
    }

    /// The point of the sphere that is mapped to a vertex, or to the point of the grain on the same ray.
    fn on_sphere(&self, p: Vector) -> Vector {
        let p = if self.is_even() { self.image.back(p) } else { p };
        unit(p).each(|x| x * self.radius)
    }

    /// The vertex on the same ray as a point.
    fn on_surface(&self, p: Vector) -> Vector {
        let p = self.on_sphere(p);
        if self.is_even() { self.image.place(p) } else { p }
    }

    /// The image of a polyhedron of the unit sphere.
    pub(super) fn image_of(&self, template: &Surface) -> Surface {
        let mut surface = template.clone();
        surface.points.iter_mut().for_each(|p| *p = self.image.balanced(*p).each(|x| x * self.radius));
        surface
    }

    /// A surface of triangles that are nearly equilateral on the grain; `None` when that would take more than
    /// `most_triangles`.
    pub(super) fn even_surface(&self, edge_mm: f64, most_triangles: usize) -> Option<Surface> {
        let mut surface = Fineness::ICOSAHEDRON.polyhedron();
        surface.points.iter_mut().for_each(|p| *p = self.image.place(scaled(*p, self.radius)));
        let mut even = Even { ball: self, edge_mm, coarse: 1.0 };
        for coarse in STEPS {
            even.coarse = coarse;
            if !surface.refine(&mut even, most_triangles) {
                return None;
            }
            for _ in 0..RELAXATIONS {
                even.relax(&mut surface);
                surface.flip(&even);
            }
        }
        Some(surface)
    }
}

/// Something that vertices must not come too close to.
pub(super) struct Obstacle<'a> {
    pub(super) other: Other<'a>,
    /// Direction of its nearest point from that of the grain.
    pub(super) toward: [f64; 3],
    /// How far the grain reaches that way.
    pub(super) support: f64,
    pub(super) gap: f64,
}

/// Where the vertices of a grain may go.
pub(super) struct Room<'a> {
    pub(super) ball: &'a Ball<'a>,
    pub(super) obstacles: Vec<Obstacle<'a>>,
    /// No vertex moves farther, for what is farther away was not looked at.
    pub(super) most_mm: f64,
}

impl Room<'_> {
    /// Moves vertices outwards until the polyhedron has the volume of its sphere, and so its image that of the grain;
    /// returns whether the gaps left room for that.
    pub(super) fn fill(&self, surface: &mut Surface, diameter: f64) -> bool {
        let ball = self.ball;
        surface.points.iter_mut().for_each(|p| *p = ball.on_sphere(*p));
        let full = self.fill_sphere(surface, diameter);
        if ball.is_even() {
            surface.points.iter_mut().for_each(|p| *p = ball.image.place(*p));
        }
        full
    }

    /// The same of a surface with its vertices on the sphere.
    fn fill_sphere(&self, surface: &mut Surface, diameter: f64) -> bool {
        let target = PI / 6.0 * diameter.powi(3);
        let radius = self.ball.radius;
        let inscribed = surface.points.clone();
        let rooms: Vec<f64> = inscribed.iter().map(|p| self.at(*p)).collect();
        let weights = around(surface, if self.ball.is_even() { longest2_of } else { area_of });
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
        let p = self.ball.image.place(p);
        let stretch = self.ball.image.stretch(p, self.ball.radius);
        let room = |obstacle: &Obstacle<'_>| match obstacle.other {
            Other::Sphere { .. } | Other::Ellipsoid { .. } | Other::Polyhedron(..) => {
                // A plane across the shortest way between both, so that the other grain has its own half of the gap.
                let along = dot(p, obstacle.toward);
                let left = obstacle.support + GAP_SHARE / 2.0 * obstacle.gap - along;
                if along > 0.0 { left * self.ball.radius / along } else { f64::INFINITY }
            }
            Other::Plane(..) | Other::Lateral { .. } => GAP_SHARE * obstacle.other.gap_mm(p) / stretch,
        };
        self.obstacles.iter().map(room).fold(self.most_mm / stretch, f64::min).max(0.0)
    }
}

/// Mean of a measure of the triangles around each vertex, averaged with those of its neighbours: where edges become
/// shorter, vertices are then moved by lengths that change gradually, which leaves no dents.
fn around(surface: &Surface, measure: fn([Vector; 3]) -> f64) -> Vec<f64> {
    let mut around = vec![(0.0, 0.0); surface.points.len()];
    for corners in &surface.triangles {
        let measure = measure(corners.each(|p| surface.points[p as usize]));
        for &p in corners {
            let sum = &mut around[p as usize];
            *sum = (sum.0 + measure, sum.1 + 1.0);
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

/// Area of a triangle.
fn area_of([a, b, c]: [Vector; 3]) -> f64 {
    let normal = cross(minus(b, a), minus(c, a));
    dot(normal, normal).sqrt() / 2.0
}

/// Square of the longest edge of a triangle.
fn longest2_of([a, b, c]: [Vector; 3]) -> f64 {
    distance2(a, b).max(distance2(b, c)).max(distance2(c, a))
}

impl Shape for Ball<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[Vector]) -> Vector {
        let (p, q) = (points[a as usize], points[b as usize]);
        self.on_surface(sum(p, q))
    }

    fn place(&self, p: Vector) -> Vector {
        if self.is_even() { p } else { self.image.place(p) }
    }

    fn wants_shorter(&self, centroid: Vector, longest_mm: f64) -> bool {
        self.facing.iter().any(|facing| facing.wants_shorter(centroid, longest_mm, 1.0))
    }

    /// Whether the surface is dented along ab: d lies above the plane of abc, and by more than rounding.
    ///
    /// Of long and flat ellipsoids that counts only where it is not clear which diagonal is Delaunay's on the
    /// ellipsoid. The mesher's tetrahedra are Delaunay's: inside of an edge that is far from it they are flat, while
    /// beyond a dent along the other diagonal they are not.
    fn is_wrong(&self, [a, b]: [u32; 2], [c, d]: [u32; 2], points: &[Vector]) -> bool {
        let [a, b, c, d] = [a, b, c, d].each(|p| points[p as usize]);
        if self.is_even() {
            // Every ray from the centre meets the surface once, before and after.
            if dot(a, cross(d, c)) <= 0.0 || dot(d, cross(b, c)) <= 0.0 {
                return false;
            }
            let angles = opposite_angles([a, b, c, d]).filter(|angles| (angles - PI).abs() > CLEARLY);
            if let Some(angles) = angles {
                return angles > PI;
            }
        }
        dot(cross(minus(b, a), minus(c, a)), minus(d, a)) > 1e-12 * self.radius.powi(3)
    }
}

/// An ellipsoid that is divided evenly.
struct Even<'a> {
    ball: &'a Ball<'a>,
    edge_mm: f64,
    coarse: f64,
}

impl Even<'_> {
    /// Longest edges near a point: shorter where the surface is curved.
    fn most_mm(&self, p: Vector) -> f64 {
        let semi_axes = self.ball.image.semi_axes(self.ball.radius);
        let shortest = semi_axes.into_iter().fold(f64::INFINITY, f64::min);
        let curved = EDGE_PER_RADIUS * least_radius(semi_axes, unit(self.ball.on_sphere(p)));
        self.edge_mm.min(curved.max(EDGE_PER_SEMI_AXIS * shortest))
    }

    /// Moves vertices to the middle of their neighbours on the surface, where no triangle turns over by that.
    fn relax(&self, surface: &mut Surface) {
        let n = surface.points.len();
        let mut ends = vec![0_usize; n + 1];
        surface.triangles.iter().flatten().for_each(|p| ends[*p as usize + 1] += 1);
        (0..n).for_each(|p| ends[p + 1] += ends[p]);
        let mut next = ends.clone();
        let mut opposite = vec![[0_u32; 2]; ends[n]];
        for &[a, b, c] in &surface.triangles {
            for [own, p, q] in [[a, b, c], [b, c, a], [c, a, b]] {
                opposite[next[own as usize]] = [p, q];
                next[own as usize] += 1;
            }
        }
        for own in 0..n {
            let edges = &opposite[ends[own]..ends[own + 1]];
            let at = |p: u32| surface.points[p as usize];
            let total = edges.iter().fold([0.0; 3], |total, [p, _]| sum(total, at(*p)));
            let (old, new) = (surface.points[own], self.ball.on_surface(total));
            let normal = |center: Vector, [p, q]: [u32; 2]| cross(minus(at(p), center), minus(at(q), center));
            let keeps = edges.iter().all(|&edge| {
                let (before, after) = (normal(old, edge), normal(new, edge));
                // Every ray from the centre still meets the surface once.
                dot(before, after) > 0.05 * dot(before, before) && dot(new, after) > 0.0
            });
            if keeps {
                surface.points[own] = new;
            }
        }
    }
}

impl Shape for Even<'_> {
    fn between(&mut self, a: u32, b: u32, points: &[Vector]) -> Vector {
        self.ball.on_surface(sum(points[a as usize], points[b as usize]))
    }

    fn wants_shorter(&self, centroid: Vector, longest_mm: f64) -> bool {
        longest_mm > self.coarse * self.most_mm(centroid)
    }

    fn is_wrong(&self, edge: [u32; 2], beside: [u32; 2], points: &[Vector]) -> bool {
        self.ball.is_wrong(edge, beside, points)
    }
}

/// Least radius of curvature of an ellipsoid at the image of a point of the unit sphere.
///
/// With `g = q / axes` and the normal `n = g / |g|` the sum of the curvatures is `(tr D - n D n) / |g|` for
/// `D = diag(1 / axes²)`, and their product `1 / (abc |g|²)²`.
fn least_radius(semi_axes: Vector, q: Vector) -> f64 {
    let [a, b, c] = semi_axes;
    let g = [q[0] / a, q[1] / b, q[2] / c];
    let d = semi_axes.each(|axis| 1.0 / (axis * axis));
    let g2 = dot(g, g);
    let along = (0..3).map(|k| g[k] * g[k] * d[k]).sum::<f64>() / g2;
    let both = (d[0] + d[1] + d[2] - along) / g2.sqrt();
    let product = 1.0 / (a * b * c * g2).powi(2);
    2.0 / (both + (both * both - 4.0 * product).max(0.0).sqrt())
}

/// The sum of the angles opposite to ab in the triangles abc and bad, where these are nearly in one plane.
pub(super) fn opposite_angles([a, b, c, d]: [Vector; 4]) -> Option<f64> {
    let normals = [cross(minus(b, a), minus(c, a)), cross(minus(d, a), minus(b, a))];
    let are_flat = angle(normals) < MOST_FOLD;
    are_flat.then(|| angle([minus(a, c), minus(b, c)]) + angle([minus(a, d), minus(b, d)]))
}
