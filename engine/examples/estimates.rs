//! Adds to rows of `docs/estimates/measure.py`, from standard input, what the model of `docs/estimates.md` sees of
//! them:
//!
//!     cargo run --release -p packstone-engine --features examples --example estimates < rows.jsonl > data.jsonl
//!
//! `sizes` has the diameter, the number, and the surface and mean width over those of a sphere, coating included;
//! `walls` is their surface over the volume in 1/mm.

use std::error::Error;
use std::io::stdin;

use packstone_engine::PackingRequest;
use packstone_engine::plan::model_inputs;
use serde_json::{Value, json};

fn main() -> Result<(), Box<dyn Error>> {
    for line in stdin().lines() {
        let mut row: Value = serde_json::from_str(&line?)?;
        let request =
            PackingRequest::from_json(&row["request"], 1).map_err(|faults| format!("{faults:?}"))?;
        let (sizes, walls_per_mm) = model_inputs(&request);
        row["sizes"] = json!(sizes);
        row["walls"] = json!(walls_per_mm);
        println!("{row}");
    }
    Ok(())
}
