//! What drawing and measuring the templates of angular grains takes, each the least of some repetitions in ms, and what
//! they are like: `cargo run --release -p packstone-engine --features examples --example templates`.

use std::time::Instant;

use packstone_engine::shape::polyhedron::{TemplateKind, draw_template};
use packstone_engine::shape::{Form, Polyhedron};
use packstone_engine::{Limits, PackingRequest, Plan};
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::json;

const TEMPLATES: u32 = 16;
const REPETITIONS: u64 = 5;

/// The least time of some repetitions in ms, with the last result.
fn timed<T>(mut work: impl FnMut(u64) -> T) -> (f64, T) {
    let mut once = |i| {
        let start = Instant::now();
        let result = work(i);
        (start.elapsed().as_secs_f64() * 1e3, result)
    };
    let first = once(0);
    (1..REPETITIONS).fold(first, |(least, _), i| {
        let (time, result) = once(i);
        (least.min(time), result)
    })
}

fn mean(bodies: &[Polyhedron], of: impl Fn(&Polyhedron) -> f64) -> f64 {
    bodies.iter().map(of).sum::<f64>() / f64::from(TEMPLATES)
}

fn main() {
    let kinds = [
        (TemplateKind::Cuts(6), json!({"faces": 6})),
        (TemplateKind::Cuts(24), json!({"faces": 24})),
        (TemplateKind::Cuts(60), json!({"faces": 60, "rounding": 0.05})),
        (TemplateKind::Cuboid(0.2), json!({"template": "deformed_cuboid"})),
        (TemplateKind::Voronoi, json!({"template": "voronoi"})),
    ];
    let form = Form::of_axes([1.5, 1.2, 1.0]);
    println!("kind: corners, d_eq/D_s; draw, sieve, widths per template; plan of 32, of 128, in ms");
    for (kind, fields) in kinds {
        let (draw, bodies) = timed(|seed| {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
            (0..TEMPLATES).filter_map(|_| draw_template(kind, form, &mut rng)).collect::<Vec<_>>()
        });
        let (sieve, ratio) = timed(|_| mean(&bodies, |body| body.equivalent_diameter() / body.sieve_size()));
        let (widths, _) = timed(|_| mean(&bodies, |body| body.length() / body.thickness()));
        let plan = |count: u32| {
            timed(|seed| {
                let mut shape = fields.clone();
                shape["type"] = json!("polyhedron");
                shape["template_count"] = json!(count);
                shape["template_seed"] = json!(1000 * u64::from(count) + seed);
                shape["ratios"] = json!({"type": "triangle", "k": 0.3});
                let document = json!({"specimen": {"type": "box", "size_mm": [80, 80, 80]}, "mix": {
                    "grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.5, "shape": shape}});
                PackingRequest::from_json(&document, 1)
                    .ok()
                    .and_then(|request| Plan::new(&request, &Limits::default()).ok())
                    .map_or(0.0, |plan| plan.grains)
            })
            .0
        };
        let per = |ms: f64| ms / f64::from(TEMPLATES);
        println!(
            "{kind:?}: {:.1} corners, {ratio:.6}; draw {:.3}, sieve {:.3}, widths {:.3}; plans {:.1}, {:.1}",
            mean(&bodies, |body| body.vertices().len() as f64),
            per(draw),
            per(sieve),
            per(widths),
            plan(32),
            plan(128)
        );
    }
}
