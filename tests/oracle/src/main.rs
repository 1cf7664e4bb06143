//! Compares the gaps of a million random pairs of convex bodies with those of parry3d-f64 (Apache-2.0), which has its
//! own implementation of the algorithm of Gilbert, Johnson and Keerthi and of the expanding polytope.
//!
//! Whatever direction `n` a library finds, `s(n)` is a proven lower bound of the gap, and the gap is the largest of
//! them. So the engine errs wherever the other library's direction proves more than the engine's own, and the other
//! library errs in the opposite case. The program fails if the engine errs once.
//!
//! ```text
//! cargo run --release --manifest-path tests/oracle/Cargo.toml [PAIRS]
//! ```

use std::process::ExitCode;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use packstone_engine::gap::{ellipsoids, polyhedra, solids};
use packstone_engine::shape::polyhedron::{TemplateKind, draw_template};
use packstone_engine::shape::{Ellipsoid, Form, Polyhedron, Pose, ScaledPolyhedron, SolidRef};
use parry3d_f64::math::{Pose as ParryPose, Vector};
use parry3d_f64::query::contact::contact_support_map_support_map;
use parry3d_f64::shape::SupportMap;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

const PAIRS: u64 = 1_000_000;
/// Largest share of the size of a pair by which the engine's gap may be shorter than what another direction proves.
/// Overlap depths of ellipsoids are local optima by definition and are not compared.
const TOLERANCE: f64 = 1e-9;
/// Share of the size of a pair by which gaps differ that count as different.
const DIFFERENT: f64 = 1e-6;

/// A body relative to its centre, in the axes of the specimen.
enum Body {
    Points(Vec<Vector3<f64>>),
    Ellipsoid(nalgebra::Matrix3<f64>),
}

impl Body {
    fn support(&self, n: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Points(points) => {
                let farthest = points.iter().max_by(|p, q| p.dot(n).total_cmp(&q.dot(n)));
                farthest.copied().unwrap_or_default()
            }
            Self::Ellipsoid(matrix) => {
                let along = matrix * n;
                along / n.dot(&along).sqrt()
            }
        }
    }
}

impl SupportMap for Body {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let p = self.support(&Vector3::new(direction.x, direction.y, direction.z));
        Vector::new(p.x, p.y, p.z)
    }
}

/// What both libraries found of a pair.
#[derive(Default)]
struct Tally {
    pairs: u64,
    disjoint: u64,
    /// Pairs for which the other library's direction proves more than the engine's.
    engine_errs: u64,
    /// Pairs for which the engine's direction proves more than the other library's by [`DIFFERENT`].
    other_errs: u64,
    /// Pairs that the other library calls disjoint and the engine overlapping, or the reverse, beyond [`DIFFERENT`].
    verdicts_differ: u64,
    largest_deficit: f64,
}

impl Tally {
    /// Compares a gap of the engine, over the size of the pair, with that of the other library.
    fn count(&mut self, r: Vector3<f64>, bodies: [&Body; 2], gap_mm: f64, compares_depths: bool) {
        let size = bodies[0].support(&r.normalize()).norm() + bodies[1].support(&-r.normalize()).norm();
        self.pairs += 1;
        self.disjoint += u64::from(gap_mm > 0.0);
        let pose = ParryPose::from_translation(Vector::new(r.x, r.y, r.z));
        let Some(contact) = contact_support_map_support_map(&pose, bodies[0], bodies[1], 1e3 * size) else {
            self.other_errs += 1;
            return;
        };
        let n = Vector3::new(contact.normal1.x, contact.normal1.y, contact.normal1.z).normalize();
        let proven = r.dot(&n) - bodies[0].support(&n).dot(&n) + bodies[1].support(&-n).dot(&n);
        if (gap_mm > 0.0 && contact.dist < -DIFFERENT * size) || (gap_mm < 0.0 && contact.dist > DIFFERENT * size) {
            self.verdicts_differ += 1;
        }
        if gap_mm < 0.0 && proven < 0.0 && !compares_depths {
            return;
        }
        let deficit = (proven - gap_mm) / size;
        self.largest_deficit = self.largest_deficit.max(deficit);
        if deficit > TOLERANCE {
            self.engine_errs += 1;
            eprintln!("the gap is {gap_mm:e} mm, and {proven:e} mm proven, of bodies of {size} mm at {r:?}");
        }
        self.other_errs += u64::from(deficit < -DIFFERENT);
    }

    fn print(&self, of: &str) {
        println!(
            "{of}: {} pairs, {} disjoint; the engine errs in {}, parry in {} (verdicts differ in {}); largest deficit \
             of the engine {:.1e} of the size",
            self.pairs, self.disjoint, self.engine_errs, self.other_errs, self.verdicts_differ, self.largest_deficit
        );
    }
}

fn uniform(rng: &mut Xoshiro256PlusPlus) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

fn between(rng: &mut Xoshiro256PlusPlus, low: f64, high: f64) -> f64 {
    low + (high - low) * uniform(rng)
}

fn vector(rng: &mut Xoshiro256PlusPlus) -> Vector3<f64> {
    loop {
        let v = Vector3::from_fn(|_, _| between(rng, -1.0, 1.0));
        if (0.01..1.0).contains(&v.norm()) {
            return v.normalize();
        }
    }
}

fn pose(rng: &mut Xoshiro256PlusPlus) -> Pose {
    let q = Quaternion::new(
        between(rng, -1.0, 1.0),
        between(rng, -1.0, 1.0),
        between(rng, -1.0, 1.0),
        between(rng, 0.1, 1.0),
    );
    Pose { center_mm: Vector3::zeros(), orientation: UnitQuaternion::new_normalize(q) }
}

/// A gap to aim at along a direction, in sizes of the pair: mostly near touching, on either side.
fn aim(rng: &mut Xoshiro256PlusPlus) -> f64 {
    let magnitude = 10_f64.powf(between(rng, -9.0, 0.0));
    if uniform(rng) < 0.6 { magnitude } else { -0.5 * magnitude }
}

/// The vector between the centres for which two bodies are about `aim` sizes apart along it.
fn placed(rng: &mut Xoshiro256PlusPlus, bodies: [&Body; 2]) -> Vector3<f64> {
    let n = vector(rng);
    let (of_a, of_b) = (bodies[0].support(&n), bodies[1].support(&-n));
    let touching = of_a - of_b;
    let size = of_a.norm() + of_b.norm();
    touching + n * (aim(rng) * size)
}

fn of_polyhedra(pairs: u64, rng: &mut Xoshiro256PlusPlus) -> Tally {
    let mut templates: Vec<Polyhedron> = Vec::new();
    for i in 0..120_u32 {
        let kind = match i % 3 {
            0 => TemplateKind::Cuts(6 + i / 3),
            1 => TemplateKind::Cuboid(0.25),
            _ => TemplateKind::Voronoi,
        };
        let form = Form { elongation: between(rng, 0.4, 1.0), flatness: between(rng, 0.4, 1.0) };
        templates.extend(draw_template(kind, form, rng).map(|template| template.normalized()));
    }
    let mut tally = Tally::default();
    for _ in 0..pairs {
        let pick = |rng: &mut Xoshiro256PlusPlus| {
            let template = &templates[(uniform(rng) * templates.len() as f64) as usize];
            (template, between(rng, 0.5, 4.0), pose(rng))
        };
        let (a, b) = (pick(rng), pick(rng));
        let points = |of: &(&Polyhedron, f64, Pose)| Body::Points(of.0.world_vertices_mm(of.1, &of.2).collect());
        let bodies = [&points(&a), &points(&b)];
        let r = placed(rng, bodies);
        if r.norm() == 0.0 {
            continue;
        }
        let one = polyhedra::Body::new(a.0, a.1, &a.2);
        let other = polyhedra::Body::new(b.0, b.1, &b.2);
        tally.count(r, bodies, one.with_at(&other, r).contact().gap_mm, true);
    }
    tally
}

fn of_ellipsoids(pairs: u64, rng: &mut Xoshiro256PlusPlus) -> Tally {
    let mut tally = Tally::default();
    for _ in 0..pairs {
        let pick = |rng: &mut Xoshiro256PlusPlus| {
            let axes: [f64; 3] = std::array::from_fn(|_| between(rng, 0.3, 3.0));
            Ellipsoid::new(axes).map(|shape| (shape, pose(rng)))
        };
        let (Some(a), Some(b)) = (pick(rng), pick(rng)) else { continue };
        let bodies = [&Body::Ellipsoid(a.0.matrix_mm2(&a.1)), &Body::Ellipsoid(b.0.matrix_mm2(&b.1))];
        let r = placed(rng, bodies);
        let (one, other) = (ellipsoids::Body::new(&a.0, &a.1), ellipsoids::Body::new(&b.0, &b.1));
        tally.count(r, bodies, one.with_at(&other, r.into()).gap().gap_mm, false);
    }
    tally
}

/// Pairs of an ellipsoid and a polyhedron, in turn the one or the other first.
fn of_both(pairs: u64, rng: &mut Xoshiro256PlusPlus) -> Tally {
    let templates: Vec<Polyhedron> = (0..60_u32)
        .filter_map(|i| {
            let form = Form { elongation: between(rng, 0.4, 1.0), flatness: between(rng, 0.4, 1.0) };
            let kind = if i % 2 == 0 { TemplateKind::Cuts(6 + i / 2) } else { TemplateKind::Cuboid(0.25) };
            draw_template(kind, form, rng).map(|template| template.normalized())
        })
        .collect();
    let mut tally = Tally::default();
    for pair in 0..pairs {
        let template = &templates[(uniform(rng) * templates.len() as f64) as usize];
        let polyhedron = ScaledPolyhedron { template, scale_mm: between(rng, 0.5, 4.0) };
        let axes: [f64; 3] = std::array::from_fn(|_| between(rng, 0.3, 3.0));
        let Some(ellipsoid) = Ellipsoid::new(axes) else { continue };
        let mut poses = [pose(rng), pose(rng)];
        let round = Body::Ellipsoid(ellipsoid.matrix_mm2(&poses[0]));
        let angular = Body::Points(template.world_vertices_mm(polyhedron.scale_mm, &poses[1]).collect());
        let mut shapes = [SolidRef::from(ellipsoid), polyhedron.into()];
        let mut bodies = [&round, &angular];
        if pair % 2 == 1 {
            (shapes.swap(0, 1), bodies.swap(0, 1), poses.swap(0, 1));
        }
        let r = placed(rng, bodies);
        if r.norm() == 0.0 {
            continue;
        }
        poses[1].center_mm = r;
        let [one, other] = [0, 1].map(|i| solids::Body::new(shapes[i], &poses[i]));
        tally.count(r, bodies, one.contact(&other).gap_mm, false);
    }
    tally
}

fn main() -> ExitCode {
    let pairs = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(PAIRS) / 3;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let polyhedra = of_polyhedra(pairs, &mut rng);
    polyhedra.print("polyhedra");
    let ellipsoids = of_ellipsoids(pairs, &mut rng);
    ellipsoids.print("ellipsoids");
    let both = of_both(pairs, &mut rng);
    both.print("ellipsoids and polyhedra");
    if polyhedra.engine_errs + ellipsoids.engine_errs + both.engine_errs == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
