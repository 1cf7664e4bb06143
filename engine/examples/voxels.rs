//! What docs/voxels.md says was measured: time of grids and cuts, and the error of volume fractions by resolution.
//!
//!     cargo run --release -p packstone-engine --features examples --example voxels [DIRECTORY]
//!
//! With a directory it writes the files there that the pictures are made of.
#![allow(clippy::unwrap_used)]

use std::fs::File;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use packstone_engine::export::{Export as _, Model};
use packstone_engine::request::decode::{At, Faults, Object};
use packstone_engine::{
    Limits, Packing, PackingRequest, Unattended,
    export::{slice, voxels},
    pack,
};
use serde_json::{Value, json};

/// The mix of the README: DIN 1045-2 A16, grains above 2 mm.
fn a16(size_mm: f64, boundary: &str, volume_fraction: f64, distance_mm: f64) -> (PackingRequest, Packing) {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [size_mm, size_mm, size_mm], "boundary": boundary},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": volume_fraction},
        "distance": {"type": "constant", "gap_mm": distance_mm},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    (request, packing)
}

fn read<T>(options: &Value, read: impl Fn(&mut Object<'_>) -> Option<T>) -> T {
    let faults = Faults::default();
    let mut object = At::root(options, &faults).object().unwrap();
    let options = read(&mut object);
    object.finish();
    assert_eq!(faults.into_vec(), []);
    options.unwrap()
}

/// The least time of three, and what the last said.
fn timed<T>(run: impl Fn() -> T) -> (f64, T) {
    let mut least = f64::INFINITY;
    let mut said = None;
    for _ in 0..3 {
        let start = Instant::now();
        said = Some(run());
        least = least.min(start.elapsed().as_secs_f64());
    }
    (least, said.unwrap())
}

fn grid(
    model: &Model<'_>,
    format: voxels::VoxelFormat,
    options: &Value,
    export_threads: NonZeroUsize,
    out: &mut dyn std::io::Write,
) -> voxels::VoxelReport {
    let options = with_format(options, format);
    let options = read(&options, voxels::VoxelOptions::read);
    let limits = Limits { export_threads, ..Limits::default() };
    options.write(model, &limits, &Unattended, out).unwrap()
}

fn cut(model: &Model<'_>, options: &Value, out: &mut dyn std::io::Write) -> slice::SliceReport {
    let options = read(options, slice::SliceOptions::read);
    options.write(model, &Limits::default(), &Unattended, out).unwrap()
}

fn main() {
    let (request, packing) = a16(150.0, "walls", 0.7, 0.0);
    let model = Model::new(&request.specimen, &packing.grains);
    println!("A16 in 150 mm: {} grains", packing.grains.len());

    println!("\nform, options: time in s, bytes");
    for (format, options) in [
        (voxels::VoxelFormat::Raw, json!({"cells": 400})),
        (voxels::VoxelFormat::Raw, json!({"cells": 400, "label": "grain"})),
        (voxels::VoxelFormat::Vti, json!({"cells": 400, "label": "grain", "fractions": true})),
        (voxels::VoxelFormat::Raw, json!({"cells": 1000})),
        (voxels::VoxelFormat::Inp, json!({"cells": 100})),
    ] {
        let [(one, bytes), (two, _)] = [1, 2].map(|threads| {
            timed(|| {
                let mut count = Count(0);
                grid(&model, format, &options, NonZeroUsize::new(threads).unwrap(), &mut count);
                count.0
            })
        });
        println!("{} {options}: {one:.2} s on one thread, {two:.2} s on two, {bytes}", format.name());
    }
    for options in [
        json!({"format": "svg"}),
        json!({"format": "png"}),
        json!({"format": "png", "pixels": 8192}),
        json!({"format": "json"}),
        json!({"format": "geo"}),
    ] {
        let (time, bytes) = timed(|| {
            let mut count = Count(0);
            cut(&model, &options, &mut count);
            count.0
        });
        println!("slice {options}: {time:.3} s, {bytes}");
    }

    println!(
        "\ncells, voxel in mm, d_min in voxels, grains without voxel; relative error of the volume by labels,"
    );
    println!("by 1, 2, 4, 8 lines per edge");
    for cells in [25, 50, 100, 200, 400, 800] {
        let by = |samples: u32| {
            let options = json!({"cells": cells, "samples": samples});
            grid(&model, voxels::VoxelFormat::Raw, &options, NonZeroUsize::MIN, &mut std::io::sink())
        };
        let reports = [1, 2, 4, 8].map(by);
        let (exact, voxel_mm) = (reports[0].volume_fraction, reports[0].spacing_mm[0]);
        let labels = reports[0].volume_fraction_labels / exact - 1.0;
        let lines = reports.iter().map(|r| format!("{:+.1e}", r.volume_fraction_samples / exact - 1.0));
        println!(
            "{cells} {voxel_mm} {:.1} {} {labels:+.1e} {}",
            2.0 / voxel_mm,
            reports[0].grains_without_voxel,
            lines.collect::<Vec<_>>().join(" ")
        );
    }

    let (small_request, small_packing) = a16(60.0, "walls", 0.7, 0.0);
    let small = Model::new(&small_request.specimen, &small_packing.grains);
    println!(
        "\nroot mean square error of the shares of voxels that a surface cuts (60 mm, 60 cells, against 16 lines):"
    );
    println!("samples per edge, by lines, by points");
    let reference = shares(&small, 16);
    for samples in [1, 2, 4, 8] {
        let lines = deviation(&shares(&small, samples), &reference);
        println!("{samples} {lines:.4} {:.4}", deviation(&points(&small, samples as usize), &reference));
    }

    let Some(directory) = std::env::args().nth(1).map(PathBuf::from) else {
        return;
    };
    let file = |name: &str| File::create(directory.join(name)).unwrap();
    cut(&model, &json!({"format": "geo"}), &mut file("slice-150.geo"));
    for format in slice::SliceFormat::ALL {
        cut(&small, &json!({"format": format}), &mut file(&format!("slice.{}", format.name())));
    }
    let options = json!({"cells": 120, "label": "grain"});
    grid(&small, voxels::VoxelFormat::Vti, &options, NonZeroUsize::MIN, &mut file("voxels.vti"));
    let (request, packing) = a16(100.0, "periodic", 0.7, 0.0);
    let periodic = Model::new(&request.specimen, &packing.grains);
    let report = cut(&periodic, &json!({"format": "geo"}), &mut file("slice-periodic.geo"));
    println!("\nslice-periodic.geo: {} circles", report.circle_count);
    let report = cut(&model, &json!({"format": "svg"}), &mut file("slice-150.svg"));
    for distance_mm in [0.1, 0.25, 0.5, 1.0] {
        let (request, packing) = a16(60.0, "walls", 0.5, distance_mm);
        let apart = Model::new(&request.specimen, &packing.grains);
        cut(&apart, &json!({"format": "geo"}), &mut file(&format!("slice-apart-{distance_mm}.geo")));
    }
    println!("slice-150.geo: {} circles", report.circle_count);
}

/// Cells of the grid whose shares are compared.
const CELLS: usize = 60;

/// Shares by lines.
fn shares(model: &Model<'_>, samples: u32) -> Vec<f64> {
    let mut bytes = Vec::new();
    let options = json!({"cells": CELLS, "fractions": true, "samples": samples});
    grid(model, voxels::VoxelFormat::Vti, &options, NonZeroUsize::MIN, &mut bytes);
    let end = bytes.len() - "\n  </AppendedData>\n</VTKFile>\n".len();
    let array = &bytes[end - 4 * CELLS.pow(3)..end];
    array.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()).into()).collect()
}

/// Shares by points: the labels of a finer grid.
fn points(model: &Model<'_>, samples: usize) -> Vec<f64> {
    let mut fine = Vec::new();
    grid(model, voxels::VoxelFormat::Raw, &json!({"cells": CELLS * samples}), NonZeroUsize::MIN, &mut fine);
    let mut shares = vec![0.0; CELLS.pow(3)];
    let n = CELLS * samples;
    for (at, label) in fine.iter().enumerate() {
        let [x, y, z] = [at % n, at / n % n, at / n / n].map(|i| i / samples);
        shares[x + CELLS * (y + CELLS * z)] += f64::from(*label) / (samples as f64).powi(3);
    }
    shares
}

/// Root mean square difference where the reference is neither 0 nor 1.
fn deviation(shares: &[f64], reference: &[f64]) -> f64 {
    let cut = shares.iter().zip(reference).filter(|(_, r)| **r > 0.0 && **r < 1.0);
    let (sum, n) = cut.fold((0.0, 0), |(sum, n), (s, r)| (sum + (s - r).powi(2), n + 1));
    (sum / f64::from(n)).sqrt()
}

/// Counts what is written.
struct Count(u64);

impl std::io::Write for Count {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn with_format(options: &Value, format: voxels::VoxelFormat) -> Value {
    let mut options = options.clone();
    options["format"] = json!(format);
    options
}
