//! Angular grains packed by both methods, checked and timed: Fuller 2..16 mm by equivalent diameter, in a box of 80 mm
//! with walls, 64 templates of 21 cuts stretched 1.5:1.2:1.
//!
//! `cargo run --release -p packstone-engine --example polyhedra [METHOD FRACTION [SEED]]`, where the method is `rsa` or
//! `monte_carlo`. Times are those of the wall clock of one thread, and of its processor where the system tells.

use std::error::Error;
use std::time::Instant;

use packstone_engine::check::check_polyhedra;
use packstone_engine::distance::DistanceRule;
use packstone_engine::methods::monte_carlo::{Limits, MonteCarlo};
use packstone_engine::methods::rsa_shapes::ShapeRsa;
use packstone_engine::mix::sampling::sample;
use packstone_engine::mix::{GradedMix, uniform_orientation};
use packstone_engine::shape::polyhedron::{TemplateKind, draw_template};
use packstone_engine::shape::{Form, Polyhedron, Pose, ScaledPolyhedron};
use packstone_engine::{PackingRequest, Unattended};
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::json;

const EDGE: f64 = 80.0;
const TEMPLATES: usize = 64;
const CUTS: u32 = 21;
const LIMIT_S: f64 = 600.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seed = arguments.get(2).map_or(Ok(1), |seed| seed.parse())?;
    if let [method, fraction, ..] = arguments.as_slice() {
        return case(method, fraction.parse()?, seed);
    }
    for (method, fraction) in [("rsa", 0.50), ("rsa", 0.55), ("monte_carlo", 0.60), ("monte_carlo", 0.65)] {
        case(method, fraction, seed)?;
    }
    Ok(())
}

/// Seconds of the processor that this process has used, where the system tells; else 0.
fn processor_s() -> f64 {
    let read = || {
        let text = std::fs::read_to_string("/proc/self/schedstat").ok()?;
        Some(text.split(' ').next()?.parse::<f64>().ok()? * 1e-9)
    };
    read().unwrap_or(0.0)
}

fn case(method: &str, fraction: f64, seed: u64) -> Result<(), Box<dyn Error>> {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [EDGE, EDGE, EDGE]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
                "volume_fraction": fraction, "volume_fraction_of": "placed_grains"},
    });
    let request = PackingRequest::from_json(&request, seed).map_err(|faults| format!("{faults:?}"))?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    let diameters = sample(&mix, &mut rng, &|| false)?;
    let form = Form { elongation: 1.2 / 1.5, flatness: 1.0 / 1.2 };
    let drawn = (0..TEMPLATES).filter_map(|_| draw_template(TemplateKind::Cuts(CUTS), form, &mut rng));
    let templates: Vec<Polyhedron> = drawn.map(|template| template.normalized()).collect();
    let shapes: Vec<ScaledPolyhedron> = diameters
        .iter()
        .enumerate()
        .map(|(i, &scale_mm)| ScaledPolyhedron { template: &templates[i % templates.len()], scale_mm })
        .collect();
    let vertices = templates.iter().map(|template| template.vertices().len()).sum::<usize>();
    let mean = vertices as f64 / templates.len() as f64;
    println!("{method} {fraction}: {} grains, {mean:.1} vertices", shapes.len());
    let (before, start) = (processor_s(), Instant::now());
    let rule = DistanceRule::new(&request.distance, &request.specimen);
    let poses =
        if method == "rsa" { add(&shapes, &request, rule, &mut rng) } else { grow(&shapes, &request, rule)? };
    println!(
        "  packed in {:.2} s, {:.2} s of processor",
        start.elapsed().as_secs_f64(),
        processor_s() - before
    );
    if poses.len() < shapes.len() {
        println!("  {} grains were placed", poses.len());
        return Ok(());
    }
    let before = processor_s();
    let check = check_polyhedra(&shapes, &poses, None, &request, &Unattended)?;
    println!("  checked in {:.2} s of processor: {:?}", processor_s() - before, check.found);
    Ok(())
}

/// Random sequential addition.
fn add(
    shapes: &[ScaledPolyhedron<'_>],
    request: &PackingRequest,
    rule: DistanceRule,
    rng: &mut Xoshiro256PlusPlus,
) -> Vec<Pose> {
    let rsa = ShapeRsa {
        shapes,
        specimen: &request.specimen,
        rule,
        attempts_per_grain: Some(100_000_000),
        orientation: &uniform_orientation,
    };
    let outcome = rsa.run(rng, &Unattended);
    println!("  {:?}, {:?}", outcome.end, outcome.statistics);
    outcome.poses
}

/// Monte Carlo; no poses where the target is not reached.
fn grow(
    shapes: &[ScaledPolyhedron<'_>],
    request: &PackingRequest,
    rule: DistanceRule,
) -> Result<Vec<Pose>, Box<dyn Error>> {
    let method = MonteCarlo {
        shapes,
        specimen: &request.specimen,
        rule,
        maximize: None,
        initial_scale: None,
        swap: true,
        limits: Limits { time_s: Some(LIMIT_S), sweeps: None },
        orientation: &uniform_orientation,
        seed: request.seed,
        keep_checkpoint: None,
    };
    let outcome = method.run(None, &Unattended).map_err(|end| format!("{end:?}"))?;
    println!(
        "  {:?}, volume fraction {:.4}, start {:.2} s, {:?}",
        outcome.end, outcome.volume_fraction, outcome.rsa_s, outcome.statistics
    );
    Ok(if outcome.scale < 1.0 { Vec::new() } else { outcome.poses })
}
