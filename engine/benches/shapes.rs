//! Pair tests of grains that are not spheres, over pairs near contact: `cargo bench -p packstone-engine --bench
//! shapes`.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use packstone_engine::gap::ellipsoids::Body;
use packstone_engine::shape::{Ellipsoid, Pose};
use rand::rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const PAIRS: usize = 4000;

fn symmetric(rng: &mut Xoshiro256PlusPlus) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

fn orientation(rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
    loop {
        let [w, i, j, k] = std::array::from_fn(|_| symmetric(rng));
        let q = Quaternion::new(w, i, j, k);
        if (0.01..=1.0).contains(&q.norm_squared()) {
            return UnitQuaternion::new_normalize(q);
        }
    }
}

/// Ellipsoids 1.5:1.2:1 and others up to four times as large, with `mu²` from `low` to `high`.
fn pairs(low: f64, high: f64) -> Vec<[Body; 2]> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let shape = |size: f64| Ellipsoid::new([1.5 * size, 1.2 * size, size]).unwrap();
    let mut pair = || {
        let size = 4.0_f64.powf(symmetric(&mut rng).abs());
        let a =
            Body::new(&shape(1.0), &Pose { center_mm: Vector3::zeros(), orientation: orientation(&mut rng) });
        let direction = orientation(&mut rng) * Vector3::x();
        let turned = orientation(&mut rng);
        let at = |center_mm: Vector3<f64>| Body::new(&shape(size), &Pose { center_mm, orientation: turned });
        let unit = a.with(&at(direction)).contact().factor2;
        let factor2 = low + (high - low) * symmetric(&mut rng).abs();
        [a, at(direction * (factor2 / unit).sqrt())]
    };
    (0..PAIRS).map(|_| pair()).collect()
}

fn ellipsoids(c: &mut Criterion) {
    let mut group = c.benchmark_group("ellipsoids");
    group.throughput(Throughput::Elements(PAIRS as u64));
    for (name, low, high) in [("broad", 0.5, 2.0), ("near", 0.95, 1.05), ("touching", 1.0, 1.02)] {
        let pairs = pairs(low, high);
        group.bench_function(format!("decision, {name}"), |bench| {
            bench.iter(|| pairs.iter().filter(|[a, b]| black_box(a).with(b).decide(0.0).is_apart).count());
        });
        group.bench_function(format!("decision with a gap, {name}"), |bench| {
            bench.iter(|| pairs.iter().filter(|[a, b]| black_box(a).with(b).decide(0.02).is_apart).count());
        });
        group.bench_function(format!("gap, {name}"), |bench| {
            bench.iter(|| pairs.iter().map(|[a, b]| black_box(a).with(b).gap().gap_mm).sum::<f64>());
        });
        group.bench_function(format!("factor, {name}"), |bench| {
            bench.iter(|| pairs.iter().map(|[a, b]| black_box(a).with(b).contact().factor2).sum::<f64>());
        });
    }
}

criterion_group!(benches, ellipsoids);
criterion_main!(benches);
