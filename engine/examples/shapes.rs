//! Measures packings of ellipsoids: `cargo run --release -p packstone-engine --example shapes -- [CASE...]`.
//!
//! Prints the CPU time of one thread. Cases: `rsa-60`, `rsa-63`.
#![allow(missing_docs, clippy::unwrap_used)]

use std::f64::consts::PI;

use packstone_engine::Unattended;
use packstone_engine::distance::DistanceRule;
use packstone_engine::methods::rsa_shapes::{EllipsoidRsa, uniform_orientation};
use packstone_engine::request::{Boundary, Distance, Specimen};
use packstone_engine::shape::Ellipsoid;
use rand::rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// CPU time of this thread in s.
fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse::<f64>().unwrap() / 1e9
}

fn uniform(rng: &mut Xoshiro256PlusPlus) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// Equivalent diameters of a Fuller curve `q = 0.5` from 2 to 16 mm, in narrow classes from the coarse down.
fn fuller(volume_mm3: f64, rng: &mut Xoshiro256PlusPlus) -> Vec<f64> {
    let (low, high, classes) = (2.0_f64, 16.0_f64, 36);
    let passing = |d: f64| (d / high).sqrt();
    let (mut diameters, mut carried) = (Vec::new(), 0.0);
    for class in (0..classes).rev() {
        let bound = |i: i32| low * (high / low).powf(f64::from(i) / f64::from(classes));
        let (a, b) = (bound(class), bound(class + 1));
        let share = (passing(b) - passing(a)) / (passing(high) - passing(low));
        let wanted = volume_mm3 * share + carried;
        let mut have = 0.0;
        while have < wanted {
            let s = -2.5;
            let d = (a.powf(s) - uniform(rng) * (a.powf(s) - b.powf(s))).powf(1.0 / s);
            have += PI / 6.0 * d.powi(3);
            diameters.push(d);
        }
        carried = wanted - have;
    }
    diameters
}

/// Ellipsoids with these axis ratios and equivalent diameters, from the largest down.
fn ellipsoids(mut diameters: Vec<f64>, ratios: [f64; 3]) -> Vec<Ellipsoid> {
    diameters.sort_by(|p, q| q.total_cmp(p));
    let unit = ratios.iter().product::<f64>().cbrt();
    diameters.iter().map(|d| Ellipsoid::new(ratios.map(|r| r / unit * d / 2.0)).unwrap()).collect()
}

fn cube(edge: f64) -> Specimen {
    Specimen::Box { size_mm: [edge; 3], boundary: Boundary::Walls }
}

fn rsa(phi: f64, seed: u64) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let specimen = cube(80.0);
    let shapes = ellipsoids(fuller(phi * 80.0_f64.powi(3), &mut rng), [1.5, 1.2, 1.0]);
    let rsa = EllipsoidRsa {
        shapes: &shapes,
        specimen: &specimen,
        rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &specimen),
        attempts_per_grain: Some(10_000_000),
        orientation: &uniform_orientation,
    };
    let started = cpu_s();
    let outcome = rsa.run(&mut rng, &Unattended);
    let volume: f64 = shapes[..outcome.poses.len()].iter().map(Ellipsoid::volume_mm3).sum();
    println!(
        "rsa {phi} seed {seed}: {} of {} grains, fraction {:.4}, {:.2} s, {:?} {:?}",
        outcome.poses.len(),
        shapes.len(),
        volume / 80.0_f64.powi(3),
        cpu_s() - started,
        outcome.statistics,
        outcome.end
    );
}

fn main() {
    let cases: Vec<String> = std::env::args().skip(1).collect();
    let seeds = 1..=2;
    for case in &cases {
        for seed in seeds.clone() {
            match case.as_str() {
                "rsa-55" => rsa(0.55, seed),
                "rsa-60" => rsa(0.60, seed),
                "rsa-63" => rsa(0.63, seed),
                "rsa-65" => rsa(0.65, seed),
                other => println!("no case {other}"),
            }
        }
    }
}
