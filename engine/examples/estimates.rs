//! Measures growth anew for the model of `docs/estimates.md`: packs the growth rows of `docs/estimates/data.json`.
//!
//!     cargo run --release -p packstone-engine --features examples --example estimates -- docs/estimates/data.json
//!
//! The program packs every row of method `edmd` with as many seeds as it has runs, and writes the file again with the
//! runs that succeeded, their events per grain and their CPU time. Rows of random sequential addition stay. CPU time is
//! read from `/proc` (Linux), so that other programs on the machine hardly disturb the measurement.

use std::error::Error;
use std::fs;

use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("name the file of the studies")?;
    let mut studies: Value = serde_json::from_str(&fs::read_to_string(&path)?)?;
    for study in studies.as_array_mut().ok_or("no list of studies")? {
        let (case, template) = (study["case"].clone(), study["template"].clone());
        for row in study["rows"].as_array_mut().ok_or("a study without rows")? {
            if row["method"] == "edmd" {
                measure(&template, row)?;
                eprintln!("{case} {row}");
            }
        }
    }
    fs::write(path, laid_out(&studies))?;
    Ok(())
}

/// The studies with one line for each row.
fn laid_out(studies: &Value) -> String {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let of_study = |study: &Value| {
        let rows: Vec<String> = list(&study["rows"]).iter().map(|row| format!("  {row}")).collect();
        format!(
            " {{\"case\": {}, \"fitted\": {}, \"template\": {}, \"rows\": [\n{}\n ]}}",
            study["case"],
            study["fitted"],
            study["template"],
            rows.join(",\n")
        )
    };
    let studies: Vec<String> = list(studies).iter().map(of_study).collect();
    format!("[\n{}\n]\n", studies.join(",\n"))
}

/// Packs a row with the seeds 1, 2 and so on.
fn measure(template: &Value, row: &mut Value) -> Result<(), Box<dyn Error>> {
    let mut request = template.clone();
    request["mix"]["volume_fraction"] = row["volume_fraction"].clone();
    request["method"] = json!({"type": "edmd"});
    let (mut succeeded, mut events_per_grain, mut time_s) = (0_u64, 0.0, 0.0);
    for seed in 1..=row["runs"].as_u64().ok_or("a row without runs")? {
        let request = PackingRequest::from_json(&request, seed).map_err(|faults| format!("{faults:?}"))?;
        let before = cpu_s()?;
        if let Ok(packing) = pack(&request, &Limits::default(), &Unattended) {
            let growth = packing.report.statistics.edmd.ok_or("a packing that did not grow")?;
            succeeded += 1;
            events_per_grain += growth.events as f64 / packing.grains.len() as f64;
            time_s += cpu_s()? - before;
        }
    }
    row["succeeded"] = json!(succeeded);
    for (name, sum, digits) in [("events_per_grain", events_per_grain, 2), ("time_s", time_s, 4)] {
        let shift = 10.0_f64.powi(digits);
        let mean = (sum / succeeded.max(1) as f64 * shift).round() / shift;
        if succeeded > 0 {
            row[name] = json!(mean);
        } else if let Some(fields) = row.as_object_mut() {
            fields.remove(name);
        }
    }
    Ok(())
}

/// CPU time of this thread in s.
fn cpu_s() -> Result<f64, Box<dyn Error>> {
    let figures = fs::read_to_string("/proc/thread-self/schedstat")?;
    let nanoseconds: f64 = figures.split(' ').next().ok_or("an empty file of the kernel")?.parse()?;
    Ok(nanoseconds * 1e-9)
}
