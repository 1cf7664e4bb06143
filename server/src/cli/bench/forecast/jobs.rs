//! `packstone bench --only progress`: the progress of jobs of all kinds against their CPU time.
//!
//! Every method packs spheres and other grains at shares of what it is expected to reach, the largest distance and the
//! largest volume fraction are looked for with and without each limit, and exports are made of packings. A job runs in
//! a process of its own, and is judged from 20 to 90 % of its time.

use packstone_engine::{Limits, PackingRequest, Plan};
use serde_json::{Value, json};

use super::super::super::exit::Failure;
use super::super::super::print;
use super::super::meter::median;
use super::packing::{Followed, Task, in_own_process};
use crate::telemetry::say;

/// Shares of what a method is expected to reach, coating included, at which it packs.
const SHARES: [f64; 3] = [0.85, 0.93, 0.98];
/// Time for each job, in s.
const BUDGET_S: f64 = 120.0;

/// Longest share of a job without a new fraction.
const MOST_STANDSTILL: f64 = 0.2;
const HEAD: &str = "| job | CPU s | fraction less share of time | longest standstill \
                    | remaining time: factor | unknown |\n\
                    |---|---|---|---|---|---|\n";

/// A job and its name.
struct Job {
    name: String,
    request: Value,
    /// What is made of its packing, in place of the packing.
    export: Option<Value>,
}

/// Runs all jobs, and prints a line for each, and one of the medians and of the mean of the looks without a remaining
/// time.
pub(in super::super) fn run(seed: u64, as_json: bool) -> Result<(), Failure> {
    let jobs = jobs()?;
    let mut found: Vec<Followed> = Vec::new();
    if !as_json {
        print(HEAD)?;
    }
    for (number, job) in jobs.iter().enumerate() {
        say(&format!("{} of {}: {}", number + 1, jobs.len(), job.name));
        let (request, export) = (job.request.clone(), job.export.clone());
        // An export may need a program that is not installed: the other jobs are followed all the same.
        let outcome = match in_own_process(&Task { request, seed, most_cpu_s: BUDGET_S, export }) {
            Ok(outcome) => outcome,
            Err(fault) if job.export.is_some() => {
                say(&format!("{} was not followed: {fault}", job.name));
                continue;
            }
            Err(fault) => return Err(fault),
        };
        let row = if as_json {
            json!({"job": job.name, "cpu_s": outcome.cpu_s, "progress": outcome.progress}).to_string()
        } else {
            let figures = outcome.progress.map_or_else(|| " | | | |".into(), |of| figures(&of));
            format!("| {} | {:.2} |{figures}", job.name, outcome.cpu_s)
        };
        print(&format!("{row}\n"))?;
        found.extend(outcome.progress);
    }
    let middle = |of: &dyn Fn(&Followed) -> Option<f64>| median(found.iter().filter_map(of).collect());
    let off = middle(&|of| Some(of.off)).unwrap_or(f64::NAN);
    let standing = found.iter().filter(|of| of.standstill > MOST_STANDSTILL).count();
    let eta_factor = middle(&|of| of.eta_factor).unwrap_or(f64::NAN);
    let eta_null = found.iter().map(|of| of.eta_null).sum::<f64>() / found.len().max(1) as f64;
    let judged = found.len();
    print(&if as_json {
        let all = json!({
            "judged": judged, "off": off, "standing": standing, "eta_factor": eta_factor, "eta_null": eta_null,
        });
        format!("{all}\n")
    } else {
        format!(
            "| {judged} of a second | | {off:.3} | {standing} above | {eta_factor:.2} | {eta_null:.2} |\n"
        )
    })
}

/// The cells of a job.
fn figures(of: &Followed) -> String {
    let factor = of.eta_factor.map_or_else(String::new, |factor| format!("{factor:.2}"));
    format!(" {:.3} | {:.2} | {factor} | {:.2} |", of.off, of.standstill, of.eta_null)
}

/// The jobs.
fn jobs() -> Result<Vec<Job>, Failure> {
    let mut jobs = Vec::new();
    for (kind, size_mm, shape) in kinds() {
        for method in ["rsa", "edmd", "monte_carlo", "auto"] {
            if method == "edmd" && !shape.is_null() {
                continue;
            }
            for share in SHARES {
                let loose = request(size_mm, 0.02, &shape, method);
                let filled = share * reach(&loose, method)?;
                jobs.push(Job {
                    name: format!("{kind} by {method} at {share} of its reach"),
                    request: request(size_mm, filled, &shape, method),
                    export: None,
                });
            }
        }
    }
    for (kind, shape, method) in
        [("spheres", Value::Null, "edmd"), ("ellipsoids", ellipsoid(), "monte_carlo")]
    {
        let most = if method == "edmd" { json!({"events": 6_000_000}) } else { json!({"sweeps": 2000}) };
        for (limit, stop) in
            [("no limit", Value::Null), ("a limit of work", most), ("a limit of time", json!({"time_s": 4}))]
        {
            for what in ["distance", "volume fraction"] {
                let mut request = request(40.0, 0.4, &shape, method);
                if what == "distance" {
                    request["distance"] = json!({"type": "maximize"});
                } else {
                    request["mix"]["volume_fraction"] = "maximize".into();
                    request["mix"]["volume_fraction_of"] = Value::Null;
                }
                if !stop.is_null() {
                    request["method"]["stop"] = stop.clone();
                }
                let name = format!("largest {what} of {kind} with {limit}");
                jobs.push(Job { name, request: without_nulls(request), export: None });
            }
        }
    }
    for (kind, shape) in [("spheres", Value::Null), ("ellipsoids", ellipsoid())] {
        for (export, size_mm) in exports() {
            let kind_of = export["type"].as_str().unwrap_or_default();
            let format = export["format"].as_str().or(export["elements"].as_str()).unwrap_or_default();
            jobs.push(Job {
                name: format!("{kind_of} {format} of {kind}"),
                request: request(size_mm, 0.35, &shape, "rsa"),
                export: Some(export.clone()),
            });
        }
    }
    Ok(jobs)
}

/// Kinds of grains, with the edge of the specimen.
fn kinds() -> [(&'static str, f64, Value); 4] {
    [
        ("spheres", 120.0, Value::Null),
        ("ellipsoids", 70.0, ellipsoid()),
        ("polyhedra", 50.0, json!({"type": "polyhedron", "faces": 20})),
        ("equal spheres", 60.0, json!("equal")),
    ]
}

fn ellipsoid() -> Value {
    json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}})
}

/// Exports that take a while, with the edge of the specimen.
fn exports() -> [(Value, f64); 10] {
    let materials = json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2},
        "aggregate": {"youngs_modulus_gpa": 60, "poissons_ratio": 0.2},
    });
    [
        (json!({"type": "mesh", "format": "stl"}), 100.0),
        (json!({"type": "mesh", "format": "vtu"}), 45.0),
        (json!({"type": "voxels", "format": "raw", "cells": 1000}), 100.0),
        (json!({"type": "voxels", "format": "vti", "cells": 800}), 100.0),
        (json!({"type": "slice", "format": "svg"}), 150.0),
        (json!({"type": "deck", "cells": 160, "materials": materials}), 60.0),
        (json!({"type": "ldpm"}), 150.0),
        (json!({"type": "certificates"}), 150.0),
        (json!({"type": "quality"}), 100.0),
        (json!({"type": "properties", "cells": 128, "materials": materials}), 60.0),
    ]
}

/// A request of Fuller's curve 2..16 mm, or of equal spheres.
fn request(size_mm: f64, volume_fraction: f64, shape: &Value, method: &str) -> Value {
    let is_equal = shape == "equal";
    let grading = if is_equal {
        json!({"type": "monodisperse", "diameter_mm": 3})
    } else {
        json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.5})
    };
    without_nulls(json!({
        "specimen": {"type": "box", "size_mm": [size_mm, size_mm, size_mm]},
        "mix": {
            "grading": grading,
            "d_min_mm": if is_equal { 3 } else { 2 },
            "volume_fraction": volume_fraction,
            "volume_fraction_of": "placed_grains",
            "allow_coarse": true,
            "shape": if is_equal { &Value::Null } else { shape },
        },
        "method": {"type": method},
    }))
}

/// The request without the fields of its mix that are null.
fn without_nulls(mut request: Value) -> Value {
    if let Some(mix) = request["mix"].as_object_mut() {
        mix.retain(|_, value| !value.is_null());
    }
    request
}

/// Volume fraction that a method is expected to reach.
fn reach(request: &Value, method: &str) -> Result<f64, Failure> {
    let request = PackingRequest::from_json(request, 1).map_err(|faults| format!("{faults:?}"))?;
    let methods = Plan::new(&request, &Limits::default())?.methods;
    let of = if method == "rsa" { methods.rsa } else { methods.growth };
    Ok(of.volume_fraction_with_coating_reach)
}

#[cfg(test)]
mod tests {
    use packstone_engine::export::ExportRequest;

    use super::*;

    #[test]
    fn jobs_of_all_kinds_are_valid() {
        let jobs = jobs().unwrap_or_else(|fault| panic!("{fault}"));
        assert!(jobs.len() >= 60, "{}", jobs.len());
        for Job { name, request, export } in jobs {
            let request =
                PackingRequest::from_json(&request, 1).unwrap_or_else(|faults| panic!("{name}: {faults:?}"));
            let plan = Plan::new(&request, &Limits::default());
            plan.unwrap_or_else(|fault| panic!("{name}: {fault}"));
            if let Some(export) = export {
                ExportRequest::from_json(&export).unwrap_or_else(|faults| panic!("{name}: {faults:?}"));
            }
        }
    }
}
