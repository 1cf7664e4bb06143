//! Random templates of angular grains: half-space cuts, deformed cuboids, Poisson-Voronoi cells.
//!
//! Each is drawn with a radius of about 1 and then stretched to ratios of its axes.

use std::sync::{Arc, OnceLock};

use nalgebra::Vector3;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::{PlatonicSolid, Polyhedron, hull::intersection};
use crate::elementary::{cbrt, ln};
use crate::rng::uniform;
use crate::shape::Form;

/// Largest cosine between the normals of two cuts.
const LARGEST_COSINE: f64 = 0.85;
/// Draws of a normal after which a larger cosine is allowed.
const DRAWS: usize = 200;
/// Distances of the cuts from the centre.
const CUT_DISTANCES: [f64; 2] = [0.9, 1.1];
/// Seeds that are added around a Voronoi cell at a time, until those beyond cannot reach it.
const SEEDS: usize = 40;
/// Attempts to draw a body that is bounded and no needle.
const ATTEMPTS: usize = 1000;
/// Largest radius over the smallest, both about the centroid, before a body is stretched: that of a tetrahedron is 3.
/// Few cuts may leave splinters of any length.
const SLENDEREST: f64 = 4.0;

/// The templates of a shape, once they are drawn. They follow from the rest of what states the shape, so that any two
/// are equal; copies of one share them.
#[derive(Clone, Debug, Default)]
pub struct DrawnTemplates(Arc<OnceLock<Vec<Polyhedron>>>);

impl PartialEq for DrawnTemplates {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl DrawnTemplates {
    /// The templates, which are drawn when they are first asked for.
    pub fn get_or_draw(&self, draw: impl FnOnce() -> Vec<Polyhedron>) -> &[Polyhedron] {
        self.0.get_or_init(draw)
    }

    /// The templates that were drawn; none before.
    #[must_use]
    pub fn bodies(&self) -> &[Polyhedron] {
        self.0.get().map_or(&[], Vec::as_slice)
    }
}

/// How templates are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TemplateKind {
    /// A ball cut by so many half-spaces `u_i . x <= t_i`, with `t_i` uniform in 0.9..1.1 and normals that keep apart.
    Cuts(u32),
    /// The hull of the corners of a cube of edge 2, each displaced by up to this share of the edge along every axis
    /// (Titscher and Unger 2015, figure 12b).
    Cuboid(f64),
    /// The cell of a point among random points (Poisson-Voronoi).
    Voronoi,
    /// A Platonic solid, which nothing is drawn of.
    Platonic(PlatonicSolid),
}

/// Draws a template of a kind and stretches it to the ratios of its axes along x, y and z; `None` for numbers that make
/// no body: fewer than 4 cuts, a displacement that is not in 0..0.5, ratios that are not positive.
pub fn draw_template(kind: TemplateKind, form: Form, rng: &mut Xoshiro256PlusPlus) -> Option<Polyhedron> {
    if matches!(kind, TemplateKind::Cuboid(displacement) if !(0.0..0.5).contains(&displacement)) {
        return None;
    }
    let draw = |rng: &mut Xoshiro256PlusPlus| match kind {
        TemplateKind::Cuts(cuts) => Polyhedron::of_half_spaces(&half_spaces(cuts, rng)),
        TemplateKind::Cuboid(displacement) => Polyhedron::hull_of(&corners(displacement, rng)),
        TemplateKind::Voronoi => voronoi_cell(rng),
        TemplateKind::Platonic(solid) => solid.body(),
    };
    let is_compact = |body: &Polyhedron| body.outer_radius() <= SLENDEREST * body.inner_radius();
    let body = (0..ATTEMPTS).find_map(|_| draw(rng).filter(is_compact))?;
    body.stretched(Vector3::new(1.0, form.elongation, form.elongation * form.flatness))
}

/// A point of the unit sphere, by rejection from the cube.
fn direction(rng: &mut Xoshiro256PlusPlus) -> Vector3<f64> {
    loop {
        let point = Vector3::new(uniform(rng), uniform(rng), uniform(rng)) * 2.0 - Vector3::repeat(1.0);
        let square = point.norm_squared();
        if square > 1e-6 && square <= 1.0 {
            return point / square.sqrt();
        }
    }
}

fn half_spaces(cuts: u32, rng: &mut Xoshiro256PlusPlus) -> Vec<(Vector3<f64>, f64)> {
    let mut planes: Vec<(Vector3<f64>, f64)> = Vec::new();
    let (mut largest, mut draws) = (LARGEST_COSINE, 0);
    while planes.len() < cuts as usize {
        let normal = direction(rng);
        draws += 1;
        if planes.iter().all(|(other, _)| other.dot(&normal) < largest) {
            let [from, to] = CUT_DISTANCES;
            planes.push((normal, from + (to - from) * uniform(rng)));
            draws = 0;
        } else if draws >= DRAWS {
            // More cuts than fit with that cosine.
            largest = (1.0 + largest) / 2.0;
            draws = 0;
        }
    }
    planes
}

fn corners(displacement: f64, rng: &mut Xoshiro256PlusPlus) -> Vec<Vector3<f64>> {
    let mut corners = Vec::with_capacity(8);
    for i in 0..8 {
        let corner = Vector3::from_fn(|axis, _| if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
        let shift = Vector3::from_fn(|_, _| 2.0 * displacement * (2.0 * uniform(rng) - 1.0));
        corners.push(corner + shift);
    }
    corners
}

/// The cell of the origin among random points, one per volume of the unit ball.
fn voronoi_cell(rng: &mut Xoshiro256PlusPlus) -> Option<Polyhedron> {
    // The ball up to the k-th nearest point of a Poisson process has a volume that is a sum of k exponential numbers.
    let (mut volume, mut planes) = (0.0_f64, Vec::new());
    for _ in 0..ATTEMPTS {
        for _ in 0..SEEDS {
            volume -= ln(1.0 - uniform(rng));
            planes.push((direction(rng), cbrt(volume) / 2.0));
        }
        let (vertices, faces) = intersection(&planes);
        let reach = vertices.iter().map(Vector3::norm).fold(0.0, f64::max);
        if reach > 0.0 && reach <= cbrt(volume) / 2.0 {
            return Polyhedron::centered(&vertices, faces);
        }
    }
    None
}
