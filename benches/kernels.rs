//! The engine's kernels, one group each: `cargo bench -p packstone-benches`. Whole problems with
//! their targets are the business of `packstone bench`.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;
use std::io::Write;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use packstone_engine::export::tables::{self, EngineInfo, Format, Head};
use packstone_engine::geometry::delaunay::delaunay;
use packstone_engine::methods::edmd::Fluid;
use packstone_engine::{Limits, Packing, PackingRequest, Plan, Unattended, check, pack};
use serde_json::{Value, json};

fn fuller(phi: f64) -> Value {
    fuller_in(80.0, phi)
}

fn fuller_in(size: f64, phi: f64) -> Value {
    json!({
        "specimen": {"type": "box", "size_mm": [size, size, size]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "volume_fraction": phi, "volume_fraction_of": "placed_grains"},
    })
}

fn b16(size: f64) -> Value {
    json!({
        "specimen": {"type": "box", "size_mm": [size, size, size]},
        "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": 0.5, "volume_fraction": 0.7},
    })
}

fn packed(value: &Value) -> (PackingRequest, Packing) {
    let request = PackingRequest::from_json(value, 1).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    (request, packing)
}

/// Placing, per grain: loose, crowded, at the limit, and many small grains.
fn rsa(c: &mut Criterion) {
    let mut group = c.benchmark_group("rsa");
    group.sample_size(10);
    for (name, mut value) in [
        ("fuller 0.50", fuller(0.50)),
        ("fuller 0.60", fuller(0.60)),
        ("fuller 0.665", fuller(0.665)),
        ("b16 1e4 grains", b16(25.5)),
        ("b16 1e5 grains", b16(54.9)),
    ] {
        value["method"] = json!({"type": "rsa"});
        let (request, packing) = packed(&value);
        group.throughput(Throughput::Elements(packing.spheres().unwrap().len() as u64));
        group.bench_function(name, |b| b.iter(|| pack(black_box(&request), &Limits::default(), &Unattended)));
    }
}

/// Collisions of equal spheres, and grains that grow, each with the random placing it starts from.
fn edmd(c: &mut Criterion) {
    /// Collisions between two renewals of everything in the fluid.
    const PER_GRAIN: u64 = 25;
    let mut group = c.benchmark_group("edmd");
    group.sample_size(10);
    let mut fluid = Fluid::new(10_000, 0.49, 1);
    let collisions = PER_GRAIN * 10_000;
    fluid.run(collisions);
    group.throughput(Throughput::Elements(collisions));
    group.bench_function("fluid 0.49 1e4 spheres", |b| b.iter(|| fluid.run(black_box(collisions))));
    let mut value = fuller_in(40.0, 0.65);
    value["method"] = json!({"type": "edmd"});
    let (request, packing) = packed(&value);
    group.throughput(Throughput::Elements(packing.spheres().unwrap().len() as u64));
    group.bench_function("fuller 0.65 a=40", |b| {
        b.iter(|| pack(black_box(&request), &Limits::default(), &Unattended));
    });
}

fn check(c: &mut Criterion) {
    let mut group = c.benchmark_group("check");
    group.sample_size(20);
    for (name, value) in [("fuller 0.60", fuller(0.60)), ("b16 1e5 grains", b16(54.9))] {
        let (request, packing) = packed(&value);
        group.throughput(Throughput::Elements(packing.spheres().unwrap().len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| check::check(black_box(packing.spheres().unwrap()), &request));
        });
    }
}

/// Swallows what is written, as fast as memory can be read.
struct Sink(u64);

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 += black_box(bytes).len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn formats(c: &mut Criterion) {
    let mut group = c.benchmark_group("format");
    group.sample_size(20);
    let value = b16(54.9);
    let (_, packing) = packed(&value);
    let head =
        Head { job_id: None, request: value, engine: EngineInfo::current(), report: packing.report.clone() };
    for format in Format::ALL {
        group.throughput(Throughput::Bytes(
            tables::length(format, &head, packing.spheres().unwrap()).unwrap(),
        ));
        group.bench_function(format.name(), |b| {
            b.iter(|| tables::write(format, &head, packing.spheres().unwrap(), &mut Sink(0)));
        });
    }
}

fn plan(c: &mut Criterion) {
    let request = PackingRequest::from_json(&fuller(0.6), 1).unwrap();
    c.bench_function("plan", |b| b.iter(|| Plan::new(black_box(&request), &Limits::default())));
}

/// Tetrahedra from the centres of a packing and as many nodes on the faces as its surface asks for, per point.
fn tetrahedra(c: &mut Criterion) {
    let mut group = c.benchmark_group("delaunay");
    group.sample_size(10);
    let (_, packing) = packed(&b16(54.9));
    let spheres = packing.spheres().unwrap();
    let grains: Vec<[f64; 3]> =
        (0..spheres.len()).map(|i| [spheres.x_mm[i], spheres.y_mm[i], spheres.z_mm[i]]).collect();
    // Every tenth moved to a face: flat parts of the hull.
    let mut with_faces = grains.clone();
    for (i, p) in with_faces.iter_mut().enumerate().step_by(10) {
        p[i / 10 % 3] = if i / 30 % 2 == 0 { 0.0 } else { 54.9 };
    }
    group.throughput(Throughput::Elements(grains.len() as u64));
    for (name, points) in [("1e5 grains", grains), ("1e5, a tenth on the faces", with_faces)] {
        group.bench_function(name, |b| b.iter(|| delaunay(black_box(&points), &Unattended)));
    }
}

criterion_group!(kernels, rsa, edmd, check, formats, plan, tetrahedra);
criterion_main!(kernels);
