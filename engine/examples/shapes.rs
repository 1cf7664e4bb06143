//! Measures packings of ellipsoids: `cargo run --release -p packstone-engine --example shapes -- [CASE...]`.
//!
//! Prints the CPU time of one thread; checks every packing that reaches its target. Cases: `60`, `65`, `70`, `73`,
//! `flat-70`, `150-60`, `150-70`, `a16-50`, `a16-535`, `equal`, and `rsa-60` with other percentages. `SEEDS` is how
//! many seeds are tried, 2 by default.
#![allow(missing_docs, clippy::unwrap_used)]

use std::f64::consts::PI;

use packstone_engine::Unattended;
use packstone_engine::distance::DistanceRule;
use packstone_engine::gap::ellipsoids::Body;
use packstone_engine::methods::monte_carlo::{End, Limits, MonteCarlo};
use packstone_engine::methods::rsa_shapes::{EllipsoidRsa, uniform_orientation};
use packstone_engine::request::{Boundary, Distance, Specimen};
use packstone_engine::shape::{Ellipsoid, Pose};
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

/// Diameters of the standard curve A16 from 2 mm, for this share of aggregate of all sizes in a volume.
fn a16(volume_mm3: f64, rng: &mut Xoshiro256PlusPlus) -> Vec<f64> {
    let (mut diameters, mut carried) = (Vec::new(), 0.0);
    for (low, high, share) in [(8.0_f64, 16.0_f64, 0.40), (4.0, 8.0, 0.24), (2.0, 4.0, 0.15)] {
        let wanted = volume_mm3 * share + carried;
        let mut have = 0.0;
        while have < wanted {
            let u = uniform(rng);
            let d = low * high / (high.powi(3) * (1.0 - u) + low.powi(3) * u).cbrt();
            have += PI / 6.0 * d.powi(3);
            diameters.push(d);
        }
        carried = wanted - have;
    }
    diameters
}

/// The smallest gap of all pairs and to the walls, by all pairs near each other.
fn least_gaps(shapes: &[Ellipsoid], poses: &[Pose], specimen: &Specimen) -> (f64, f64) {
    let bodies: Vec<Body> = shapes.iter().zip(poses).map(|(shape, pose)| Body::new(shape, pose)).collect();
    let (mut least, mut least_wall) = (f64::INFINITY, f64::INFINITY);
    for (i, a) in bodies.iter().enumerate() {
        least_wall = least_wall.min(a.wall_gap_mm(specimen));
        for b in &bodies[..i] {
            let pair = a.with(b);
            let far = a.outer_mm + b.outer_mm + least.min(5.0);
            if pair.r.iter().map(|x| x * x).sum::<f64>() < far * far {
                least = least.min(pair.gap().gap_mm);
            }
        }
    }
    (least, least_wall)
}

struct Case {
    shapes: Vec<Ellipsoid>,
    specimen: Specimen,
    gap_mm: f64,
    time_s: f64,
}

fn dense(name: &str, case: &Case, seed: u64) {
    let Case { shapes, specimen, gap_mm, time_s } = case;
    let distance = Distance::Constant { gap_mm: *gap_mm, wall_gap_mm: None };
    let packing = MonteCarlo {
        shapes,
        specimen,
        rule: DistanceRule::new(&distance, specimen),
        maximize: None,
        initial_scale: None,
        swap: true,
        limits: Limits { time_s: Some(*time_s), sweeps: None },
        orientation: &uniform_orientation,
        seed,
        keep_checkpoint: None,
    };
    let started = cpu_s();
    let outcome = packing.run(None, &Unattended).unwrap();
    let seconds = cpu_s() - started;
    let gaps = if outcome.end == End::Target {
        let (pairs, walls) = least_gaps(shapes, &outcome.poses, specimen);
        assert!(pairs >= *gap_mm && (walls >= gap_mm / 2.0));
        format!("gaps {pairs:.9} and {walls:.9} mm")
    } else {
        String::new()
    };
    println!(
        "{name} seed {seed}: {:?} at {:.4} of {} grains in {seconds:.2} s {gaps} {:?}",
        outcome.end,
        outcome.volume_fraction,
        shapes.len(),
        outcome.statistics
    );
}

const TEST_RATIOS: [f64; 3] = [1.5, 1.2, 1.0];

fn case(name: &str, seed: u64) -> Option<Case> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut fuller_of = |phi: f64, edge: f64, ratios: [f64; 3], time_s: f64| Case {
        shapes: ellipsoids(fuller(phi * edge.powi(3), &mut rng), ratios),
        specimen: cube(edge),
        gap_mm: 0.0,
        time_s,
    };
    Some(match name {
        "60" => fuller_of(0.60, 80.0, TEST_RATIOS, 60.0),
        "65" => fuller_of(0.65, 80.0, TEST_RATIOS, 60.0),
        "70" => fuller_of(0.70, 80.0, TEST_RATIOS, 120.0),
        "73" => fuller_of(0.73, 80.0, TEST_RATIOS, 240.0),
        "75" => fuller_of(0.75, 80.0, TEST_RATIOS, 240.0),
        "flat-70" => fuller_of(0.70, 80.0, [2.0, 2.0_f64.sqrt(), 1.0], 120.0),
        "150-60" => fuller_of(0.60, 150.0, TEST_RATIOS, 120.0),
        "150-70" => fuller_of(0.70, 150.0, TEST_RATIOS, 600.0),
        "a16-50" | "a16-535" => {
            let phi = if name == "a16-50" { 0.50 } else { 0.535 };
            let shapes = ellipsoids(a16(phi * 80.0_f64.powi(3), &mut rng), TEST_RATIOS);
            Case { shapes, specimen: cube(80.0), gap_mm: 1.0, time_s: 120.0 }
        }
        "equal" => {
            let d = (0.66 * 80.0_f64.powi(3) / 2000.0 * 6.0 / PI).cbrt();
            let shapes = ellipsoids(vec![d; 2000], [1.25, 1.0, 0.8]);
            Case { shapes, specimen: cube(80.0), gap_mm: 0.0, time_s: 120.0 }
        }
        _ => return None,
    })
}

fn main() {
    for name in std::env::args().skip(1) {
        let seeds = std::env::var("SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(2);
        for seed in 1..=seeds {
            match (name.strip_prefix("rsa-"), case(&name, seed)) {
                (Some(percent), _) => rsa(percent.parse::<f64>().unwrap() / 100.0, seed),
                (None, Some(case)) => dense(&name, &case, seed),
                (None, None) => println!("no case {name}"),
            }
        }
    }
}
