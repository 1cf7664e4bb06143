//! Packings of the literature: what was published beside what this engine reaches (`docs/shapes.md`).
//!
//! `cargo run --release -p packstone-engine --features examples --example literature -- CASE [SEEDS [GRAINS [SWEEPS]]]`
//! grows equal grains whose name contains the case until they jam, or so many sweeps of moves are done. `addition-CASE`
//! adds them at random, with ever more attempts for a grain; the path of a request packs that.

use std::path::Path;
use std::time::Instant;

use packstone_engine::distance::DistanceRule;
use packstone_engine::gap::grain::ConvexShape;
use packstone_engine::methods::growth::Outcome;
use packstone_engine::methods::monte_carlo::MonteCarlo;
use packstone_engine::methods::rsa_shapes::{AttemptsIn, ShapeRsa};
use packstone_engine::mix::uniform_orientation;
use packstone_engine::request::{Boundary, Distance, GrowthStop, Specimen};
use packstone_engine::shape::polyhedron::PlatonicSolid;
use packstone_engine::shape::{Ellipsoid, Pose, ScaledPolyhedron};
use packstone_engine::{PackingRequest, Unattended, pack};
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

/// Volume fraction beyond all that random packings reach.
const BEYOND: f64 = 0.85;
/// Sweeps after which a run that still grows is stopped, where no other number is given.
const MOST_SWEEPS: u64 = 15_000;

/// Equal grains of a volume of 1 mm³ in a periodic cube, grown until they jam.
fn jammed<S: ConvexShape>(shape: S, grains: usize, sweeps: u64, seed: u64) -> Option<Outcome<Vec<Pose>>> {
    let shapes = vec![shape; grains];
    let edge = libm::cbrt(grains as f64 * shape.volume_mm3() / BEYOND);
    let specimen = Specimen::Box { size_mm: [edge; 3], boundary: Boundary::Periodic };
    let growth = MonteCarlo {
        shapes: &shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen),
        maximize: None,
        initial_scale: None,
        swap: true,
        stop: GrowthStop { sweeps: Some(sweeps), ..GrowthStop::default() },
        orientation: &uniform_orientation,
        seed,
        preference: None,
        keep_checkpoint: None,
        to_jamming: None,
        keeps_partial: false,
        threads: std::num::NonZeroUsize::MIN,
        target_share: 0.9,
    };
    growth.run(None, &Unattended).ok()
}

/// The largest eigenvalue of the mean of `(3 u u - 1) / 2` over the longest axes: 0 without order, 1 of parallel axes.
fn order(poses: &[Pose], axis: usize) -> f64 {
    let mut tensor = nalgebra::Matrix3::zeros();
    for pose in poses {
        let u = pose.rotation().column(axis).into_owned();
        tensor += (u * u.transpose() * 3.0 - nalgebra::Matrix3::identity()) / (2.0 * poses.len() as f64);
    }
    tensor.symmetric_eigenvalues().max()
}

fn row(
    name: &str,
    published: &str,
    grains: usize,
    seeds: u64,
    run: impl Fn(u64) -> Option<Outcome<Vec<Pose>>>,
) {
    for seed in 1..=seeds {
        let start = Instant::now();
        let Some(outcome) = run(seed) else { continue };
        println!(
            "| {name} | {published} | {grains} | {seed} | {:.4} | {:?} | {} | {:.1} | {:.2} | {:.2} |",
            outcome.volume_fraction,
            outcome.end,
            outcome.statistics.monte_carlo.unwrap_or_default().sweeps,
            start.elapsed().as_secs_f64(),
            order(&outcome.placed, 0),
            order(&outcome.placed, 2),
        );
    }
}

/// Attempts for one grain, after which random addition ends.
const ATTEMPTS: [u64; 4] = [1_000, 10_000, 100_000, 1_000_000];

/// Volume fractions of equal grains added at random in a periodic cube, by attempts.
fn added<S: ConvexShape>(name: &str, published: &str, shape: S, grains: usize, seed: u64) {
    let edge = libm::cbrt(grains as f64 * shape.volume_mm3());
    let specimen = Specimen::Box { size_mm: [edge; 3], boundary: Boundary::Periodic };
    let shapes = vec![shape; grains];
    let fractions = ATTEMPTS.map(|attempts| {
        let rsa = ShapeRsa {
            shapes: &shapes,
            domain: specimen.domain(),
            rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen),
            attempts_per_grain: Some(attempts),
            attempts_in: AttemptsIn::Specimen,
            threads: std::num::NonZeroUsize::MIN,
            orientation: &uniform_orientation,
        };
        let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(seed), &Unattended);
        outcome.placed.len() as f64 / grains as f64
    });
    println!("| {name} | {published} | {grains} | {seed} | {fractions:.4?} |");
}

/// Packs the request of a file.
fn packed(path: &str, seeds: u64) -> Option<()> {
    let mut document: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    // The name is the job's, not the packing's.
    document.as_object_mut()?.remove("name");
    for seed in 1..=seeds {
        let start = Instant::now();
        let found = PackingRequest::from_json(&document, seed).map(|request| {
            pack(&request, &packstone_engine::Limits::default(), &Unattended)
                .map(|packing| packing.report.summary)
        });
        match found {
            Ok(Ok(summary)) => println!(
                "| {path} | {seed} | {} grains | {:.4} | {:.3} s |",
                summary.grains,
                summary.volume_fraction_effective,
                start.elapsed().as_secs_f64()
            ),
            Ok(Err(error)) => println!("| {path} | {seed} | {error} |"),
            Err(faults) => println!("| {path} | {faults:?} |"),
        }
    }
    Some(())
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let case = arguments.get(1).map_or("", String::as_str);
    let seeds = arguments.get(2).and_then(|n| n.parse().ok()).unwrap_or(1);
    let grains = arguments.get(3).and_then(|n| n.parse().ok()).unwrap_or(2000);
    let sweeps = arguments.get(4).and_then(|n| n.parse().ok()).unwrap_or(MOST_SWEEPS);
    if Path::new(case).extension().is_some_and(|extension| extension == "json") {
        if packed(case, seeds).is_none() {
            eprintln!("{case} is no request");
        }
        return;
    }
    let is_addition = case.starts_with("addition-");
    let case = case.trim_start_matches("addition-");
    if is_addition {
        println!("| case | published | grains | seed | volume fractions after {ATTEMPTS:?} attempts |");
        println!("|---|---|---|---|---|");
    } else {
        println!(
            "| case | published | grains | seed | volume fraction | end | sweeps | s | order of long axes | of short |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|");
    }
    let ellipsoids = [
        ("spheres", "0.64", [1.0, 1.0, 1.0]),
        ("oblate 1.6", "0.70", [1.6, 1.6, 1.0]),
        ("prolate 1.5", "0.71", [1.5, 1.0, 1.0]),
        ("triaxial 1.25", "0.735", [1.25, 1.0, 0.8]),
    ];
    for (name, published, axes) in ellipsoids {
        let scale = libm::cbrt(0.75 / std::f64::consts::PI / axes.iter().product::<f64>());
        if let Some(shape) = Ellipsoid::new(axes.map(|axis| axis * scale)).filter(|_| name.contains(case)) {
            if is_addition {
                (1..=seeds).for_each(|seed| added(name, "0.3841 (spheres)", shape, grains, seed));
            } else {
                row(name, published, grains, seeds, |seed| jammed(shape, grains, sweeps, seed));
            }
        }
    }
    let published = [
        "0.64 (dice), 0.763 (jammed)",
        "0.67 (dice)",
        "0.64 (dice), 0.697 (jammed)",
        "0.63 (dice), 0.716 (jammed)",
        "0.59 (dice), 0.707 (jammed)",
    ];
    for (solid, published) in PlatonicSolid::ALL.into_iter().zip(published) {
        let Some(template) =
            solid.body().map(|body| body.normalized()).filter(|_| solid.name().contains(case))
        else {
            continue;
        };
        let shape =
            ScaledPolyhedron { template: &template, scale_mm: libm::cbrt(6.0 / std::f64::consts::PI) };
        if is_addition {
            let published = if solid == PlatonicSolid::Tetrahedron { "0.35635" } else { "" };
            (1..=seeds).for_each(|seed| added(solid.name(), published, shape, grains, seed));
            continue;
        }
        row(solid.name(), published, grains, seeds, |seed| jammed(shape, grains, sweeps, seed));
    }
}
