//! How far sizes are apart by strength of the gradient and method: the table of `docs/gradient.md`.
//!
//! `cargo run --release -p packstone-engine --features examples --example gradient [DIR]`; with a folder, the packings
//! of its picture are written there as CSV.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use packstone_engine::packing::{EdmdStatistics, Spheres};
use packstone_engine::{Limits, PackError, Packing, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

const SEEDS: u64 = 5;
const STRENGTHS: [f64; 7] = [0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0];

fn main() -> Result<(), Box<dyn Error>> {
    if let Some(dir) = std::env::args().nth(1) {
        return write_packings(Path::new(&dir));
    }
    println!("phi    method          strength  placed  difference     p > 0.05  time, s  swaps");
    for phi in [0.50, 0.65, 0.70] {
        let methods = [
            ("rsa", json!({"type": "rsa"})),
            ("edmd", json!({"type": "edmd"})),
            ("edmd, no swap", json!({"type": "edmd", "swap": false, "stop": {"events": 20_000_000}})),
        ];
        for (name, method) in &methods {
            for strength in STRENGTHS {
                row(phi, name, method, strength)?;
            }
        }
    }
    Ok(())
}

fn request(phi: f64, method: &Value, strength: f64, seed: u64) -> Result<PackingRequest, Box<dyn Error>> {
    let value = json!({
        "specimen": {"type": "box", "size_mm": [60, 60, 60]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
                "volume_fraction": phi, "volume_fraction_of": "placed_grains"},
        "method": method,
        "segregation": {"type": "gradient", "field": {"type": "linear", "axis": "z"}, "strength": strength},
    });
    PackingRequest::from_json(&value, seed).map_err(|faults| format!("{faults:?}").into())
}

fn row(phi: f64, name: &str, method: &Value, strength: f64) -> Result<(), Box<dyn Error>> {
    let mut found: Vec<Packing> = Vec::new();
    for seed in 0..SEEDS {
        match pack(&request(phi, method, strength, seed)?, &Limits::default(), &Unattended) {
            Ok(packing) => found.push(packing),
            Err(PackError::TargetNotReached(_)) => {}
            Err(other) => return Err(other.into()),
        }
    }
    let mean = |of: &dyn Fn(&Packing) -> f64| found.iter().map(of).sum::<f64>() / found.len() as f64;
    let difference = |p: &Packing| p.report.segregation.as_ref().map_or(0.0, |found| found.along.difference);
    let by_chance = found
        .iter()
        .filter(|p| p.report.segregation.as_ref().is_some_and(|found| found.along.p_value > 0.05));
    let accepted = |edmd: EdmdStatistics| edmd.swaps_accepted as f64 / edmd.swaps_tried.max(1) as f64;
    println!(
        "{phi:.2}   {name:<14} {strength:>9}  {:>2} of {SEEDS}  {:>10.3}  {:>7} of {}  {:>7.2}  {:.2}",
        found.len(),
        mean(&difference),
        by_chance.count(),
        found.len(),
        mean(&|p| p.report.timings_s.total),
        mean(&|p| p.report.statistics.edmd.map_or(0.0, accepted)),
    );
    Ok(())
}

fn write_packings(dir: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(dir)?;
    for (name, phi, method, strength) in [
        ("random", 0.50, json!({"type": "rsa"}), 0.0),
        ("rsa", 0.50, json!({"type": "rsa"}), 30.0),
        ("edmd", 0.65, json!({"type": "edmd"}), 30.0),
    ] {
        let packing = pack(&request(phi, &method, strength, 1)?, &Limits::default(), &Unattended)?;
        println!("{name}: {:?}", packing.report.segregation);
        fs::write(dir.join(format!("{name}.csv")), csv(packing.spheres().ok_or("the grains are spheres")?)?)?;
    }
    Ok(())
}

fn csv(spheres: &Spheres) -> Result<String, std::fmt::Error> {
    let mut text = String::from("x_mm,y_mm,z_mm,d_mm\n");
    for i in 0..spheres.len() {
        let [x, y, z] = spheres.center(i);
        writeln!(text, "{x},{y},{z},{}", spheres.d_mm[i])?;
    }
    Ok(text)
}
