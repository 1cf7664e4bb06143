//! The volume fraction of Platonic solids at saturation of random sequential addition, which is proven
//! (`docs/shapes.md`).
//!
//! `cargo run --release -p packstone-engine --features examples --example saturation -- CASE [EDGE [FIRST [LAST]]]`
//! adds equal Platonic solids of the volume 1 whose name contains the case to a periodic cube of this edge, for each
//! seed from the first to the last.

mod saturate;
mod solid;

use std::time::Instant;

use packstone_engine::shape::polyhedron::PlatonicSolid;
use rand::rand_core::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use saturate::Saturation;
use solid::Solid;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let case = arguments.get(1).map_or("", String::as_str);
    let edge: f64 = arguments.get(2).and_then(|edge| edge.parse().ok()).unwrap_or(4.0);
    let first: u64 = arguments.get(3).and_then(|seed| seed.parse().ok()).unwrap_or(1);
    let last: u64 = arguments.get(4).and_then(|seed| seed.parse().ok()).unwrap_or(first);
    for kind in PlatonicSolid::ALL.into_iter().filter(|kind| kind.name().contains(case)) {
        let Some(solid) = Solid::new(kind) else { continue };
        let mut fractions = Vec::new();
        for seed in first..=last {
            let start = Instant::now();
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
            let mut saturation = Saturation::new(&solid, edge, &[]);
            while saturation.cells() > 0 {
                saturation.step(&mut rng);
                eprintln!(
                    "{} {:.4}, {} cells, {:.0} s",
                    kind.name(),
                    saturation.fraction(),
                    saturation.cells(),
                    start.elapsed().as_secs_f64()
                );
            }
            let fraction = saturation.fraction();
            println!("{} seed {seed}: {fraction:.4}, {:.0} s", kind.name(), start.elapsed().as_secs_f64());
            fractions.push(fraction);
        }
        let n = fractions.len() as f64;
        let mean = fractions.iter().sum::<f64>() / n;
        let squares: f64 = fractions.iter().map(|fraction| (fraction - mean).powi(2)).sum();
        if n > 1.0 {
            let error = (squares / (n * (n - 1.0))).sqrt();
            println!("{} mean {mean:.4}, error {error:.4}", kind.name());
        }
    }
}
