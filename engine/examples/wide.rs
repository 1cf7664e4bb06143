//! What growth costs per collision, for narrow and for wide mixes: the figures of `docs/edmd.md`.
//!
//!     cargo run --release -p packstone-engine --features examples --example wide -- [--seed N] [--fluid N] CASE ...
//!
//! A case is `CURVE:D_MIN:EDGE:FRACTION[:DISTANCE[:SCALE[:SWAP]]]`: a curve (`fuller`, `A16`, ...), the smallest
//! diameter in mm, the edge of the cube in mm, the volume fraction (of the placed grains for `fuller`, of the mixture
//! otherwise), the distance in mm (0), the scale that growth starts from (0: as without it), and `swap` for swap moves.
//! CPU time is read from `/proc` (Linux). `--fluid N` adds the fluid of N equal spheres at 0.49.

use std::error::Error;
use std::time::Instant;

use packstone_engine::methods::edmd::Fluid;
use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

/// CPU time of this thread in s.
fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).map_or(f64::NAN, |ns| ns * 1e-9)
}

/// The request of a case.
fn request(case: &str) -> Result<Value, Box<dyn Error>> {
    let parts: Vec<&str> = case.split(':').collect();
    let number = |k: usize| parts.get(k).map_or(Ok(0.0), |part| part.parse::<f64>());
    let (curve, d_min, edge, fraction) = (parts[0], number(1)?, number(2)?, number(3)?);
    let mix = if curve == "fuller" {
        json!({"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": d_min,
               "volume_fraction": fraction, "volume_fraction_of": "placed_grains"})
    } else {
        json!({"grading": {"type": "standard", "name": curve}, "d_min_mm": d_min, "volume_fraction": fraction})
    };
    let mut method = json!({"type": "edmd", "swap": parts.get(6) == Some(&"swap")});
    if number(5)? > 0.0 {
        method["initial_scale"] = json!(number(5)?);
    }
    let specimen = json!({"type": "box", "size_mm": [edge, edge, edge]});
    let mut request = json!({"specimen": specimen, "mix": mix, "method": method});
    if number(4)? > 0.0 {
        request["distance"] = json!({"type": "constant", "gap_mm": number(4)?});
    }
    Ok(request)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut seed = 1;
    let mut arguments = std::env::args().skip(1);
    println!(
        "case | grains | CPU s of growth | of all | collisions | us/collision | predictions | rebuilds | cycles | end"
    );
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--seed" => seed = arguments.next().ok_or("--seed needs a number")?.parse()?,
            "--fluid" => {
                let spheres: usize = arguments.next().ok_or("--fluid needs a number")?.parse()?;
                let mut fluid = Fluid::new(spheres, 0.49, seed);
                fluid.run(spheres as u64 * 10);
                let before = cpu_s();
                let figures = fluid.run(spheres as u64 * 50);
                let us = (cpu_s() - before) * 1e6 / figures.collisions as f64;
                println!("fluid of {spheres} | {us:.3} us a collision | {:.2e} per CPU s", 1e6 / us);
            }
            case => {
                let request =
                    PackingRequest::from_json(&request(case)?, seed).map_err(|e| format!("{e:?}"))?;
                let (before, start) = (cpu_s(), Instant::now());
                let report = match pack(&request, &Limits::default(), &Unattended) {
                    Ok(packing) => packing.report,
                    Err(error) => {
                        println!("{case} | {error} | {:.2} s", cpu_s() - before);
                        continue;
                    }
                };
                let (all, wall) = (cpu_s() - before, start.elapsed().as_secs_f64());
                let edmd = report.statistics.edmd.ok_or("no growth")?;
                let events = edmd.events as f64;
                // The share of the clock, for a packing is made on one thread.
                let growth = events / edmd.events_per_s * (all / wall);
                println!(
                    "{case} | {} | {growth:.2} | {all:.2} | {:.3e} | {:.2} | {:.1} | {:.3} | {} | {:?}",
                    report.summary.grains,
                    events,
                    growth / events * 1e6,
                    edmd.predictions as f64 / events,
                    edmd.list_rebuilds as f64 / events,
                    edmd.compression_cycles,
                    edmd.stop,
                );
            }
        }
    }
    Ok(())
}
