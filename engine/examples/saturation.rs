//! The saturated volume fraction of equal grains added at random, by Feder's law (`docs/shapes.md`).
//!
//! `cargo run --release -p packstone-engine --features examples --example saturation -- CASE [SEEDS [GRAINS [LAST]]]`
//! adds equal Platonic solids whose name contains the case in a periodic cube of the volume of so many grains, and
//! measures the time `t` at which the volume fraction `phi` is reached, up to the last: attempts times volume of a
//! grain over that of the cube. Then it fits `phi(t) = phi_saturated - A t^(-1/d)` (Feder 1980, DOI
//! 10.1016/0022-5193(80)90358-6) with three free parameters.

use std::time::Instant;

use packstone_engine::Unattended;
use packstone_engine::distance::DistanceRule;
use packstone_engine::methods::rsa::End;
use packstone_engine::methods::rsa_shapes::ShapeRsa;
use packstone_engine::mix::uniform_orientation;
use packstone_engine::request::{Boundary, Distance, Specimen};
use packstone_engine::shape::ScaledPolyhedron;
use packstone_engine::shape::polyhedron::PlatonicSolid;
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

/// Attempts for one grain, after which random addition ends.
const MOST_ATTEMPTS: u64 = 1 << 40;
/// First volume fraction whose time is measured, and the step to the next.
const FIRST: f64 = 0.2;
const STEP: f64 = 0.01;

/// The time at which so many grains are placed; none where one of them finds no place.
fn time(shape: ScaledPolyhedron<'_>, grains: usize, cube: usize, seed: u64) -> Option<f64> {
    let edge = libm::cbrt(cube as f64);
    let specimen = Specimen::Box { size_mm: [edge; 3], boundary: Boundary::Periodic };
    let rsa = ShapeRsa {
        shapes: &vec![shape; grains],
        specimen: &specimen,
        rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen),
        attempts_per_grain: Some(MOST_ATTEMPTS),
        orientation: &uniform_orientation,
    };
    let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(seed), &Unattended);
    (outcome.end == End::Complete).then(|| outcome.statistics.attempts as f64 / cube as f64)
}

/// A line `y = a + b x` by least squares, and the sum of the squares that are left.
fn line(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0 / n, sum.1 + p.1 / n));
    let xx: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
    let b = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / xx;
    let a = y - b * x;
    (a, b, points.iter().map(|p| (p.1 - a - b * p.0).powi(2)).sum())
}

/// Feder's law through points of time and volume fraction: `phi_saturated`, `A`, `d` and the root of the mean square.
fn fit(points: &[(f64, f64)]) -> (f64, f64, f64, f64) {
    let of = |d: f64| line(&points.iter().map(|p| (libm::pow(p.0, -1.0 / d), p.1)).collect::<Vec<_>>());
    let exponents = (20..400).map(|tenths| f64::from(tenths) / 10.0);
    let d = exponents.min_by(|&a, &b| of(a).2.total_cmp(&of(b).2)).unwrap_or(f64::NAN);
    let (saturated, slope, squares) = of(d);
    (saturated, -slope, d, (squares / points.len() as f64).sqrt())
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let case = arguments.get(1).map_or("", String::as_str);
    let seeds: u64 = arguments.get(2).and_then(|n| n.parse().ok()).unwrap_or(4);
    let cube: usize = arguments.get(3).and_then(|n| n.parse().ok()).unwrap_or(1000);
    let last: f64 = arguments.get(4).and_then(|n| n.parse().ok()).unwrap_or(0.3);
    for solid in PlatonicSolid::ALL.into_iter().filter(|solid| solid.name().contains(case)) {
        let Some(template) = solid.body().map(|body| body.normalized()) else { continue };
        let shape =
            ScaledPolyhedron { template: &template, scale_mm: libm::cbrt(6.0 / std::f64::consts::PI) };
        let mut points = Vec::new();
        for step in 0.. {
            let fraction = FIRST + f64::from(step) * STEP;
            let grains = (fraction * cube as f64).round() as usize;
            if fraction > last + STEP / 2.0 {
                break;
            }
            let start = Instant::now();
            let times: Option<Vec<f64>> = (1..=seeds).map(|seed| time(shape, grains, cube, seed)).collect();
            let Some(times) = times else { break };
            let log = |t: f64| libm::log(t) / times.len() as f64;
            // The mean of logarithms: times scatter by factors.
            let t = libm::exp(times.iter().copied().map(log).sum::<f64>());
            println!("{} phi {fraction:.3} t {t:.4e} ({:.1} s)", solid.name(), start.elapsed().as_secs_f64());
            points.push((t, grains as f64 / cube as f64));
        }
        for from in 0..points.len().saturating_sub(4) {
            let (saturated, a, d, rms) = fit(&points[from..]);
            println!(
                "{}: from {:.2}: saturated {saturated:.4}, A {a:.3}, d {d:.1}, rms {rms:.5}",
                solid.name(),
                points[from].1
            );
        }
    }
}
