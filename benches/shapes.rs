//! Pair tests of grains that are not spheres, over pairs near contact: `cargo bench -p packstone-benches --bench
//! shapes`.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use packstone_engine::gap::ellipsoids::Body;
use packstone_engine::gap::polyhedra;
use packstone_engine::shape::polyhedron::{TemplateKind, draw_template};
use packstone_engine::shape::{Ellipsoid, Form, Polyhedron, Pose};
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

/// Polyhedra of 21 cuts, 1.5:1.2:1, and others up to four times as large, with gaps from `low` to `high` of the smaller
/// one's diameter; and the normal of each pair.
fn angular(c: &mut Criterion) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let form = Form { elongation: 1.2 / 1.5, flatness: 1.0 / 1.2 };
    let templates: Vec<Polyhedron> = (0..64)
        .map(|_| draw_template(TemplateKind::Cuts(21), form, &mut rng).unwrap().normalized())
        .collect();
    let mut group = c.benchmark_group("polyhedra");
    group.throughput(Throughput::Elements(PAIRS as u64));
    for (name, low, high) in [("broad", -0.1, 0.5), ("near", -0.02, 0.02), ("apart", 0.001, 0.02)] {
        let pairs: Vec<_> = (0..PAIRS)
            .map(|i| {
                let size = 4.0_f64.powf(symmetric(&mut rng).abs());
                let pose = Pose { center_mm: Vector3::zeros(), orientation: orientation(&mut rng) };
                let a = polyhedra::Body::new(&templates[i % 64], 1.0, &pose);
                let (toward, turned) = (orientation(&mut rng) * Vector3::x(), orientation(&mut rng));
                let at = |center_mm| Pose { center_mm, orientation: turned };
                let body =
                    |center_mm| polyhedra::Body::new(&templates[(7 * i + 3) % 64], size, &at(center_mm));
                let wanted = low + (high - low) * symmetric(&mut rng).abs();
                let mut center_mm = toward * (1.5 * (1.0 + size));
                for _ in 0..20 {
                    let far = body(center_mm);
                    let contact = a.with(&far).contact();
                    center_mm -= toward * ((contact.gap_mm - wanted) / contact.normal.dot(&toward));
                }
                let b = body(center_mm);
                (a, b, a.with(&b).contact().normal)
            })
            .collect();
        group.bench_function(format!("decision, cold, {name}"), |bench| {
            bench.iter(|| pairs.iter().filter(|(a, b, _)| black_box(a).with(b).decide(0.0).is_apart).count());
        });
        group.bench_function(format!("decision, stored normal, {name}"), |bench| {
            let decide = |(a, b, n): &(polyhedra::Body<'_>, polyhedra::Body<'_>, Vector3<f64>)| {
                black_box(a).with(b).decide_from(0.0, n).is_apart
            };
            bench.iter(|| pairs.iter().filter(|pair| decide(pair)).count());
        });
    }
}

criterion_group!(benches, ellipsoids, angular);
criterion_main!(benches);
