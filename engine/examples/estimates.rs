//! Adds to rows of `docs/estimates/fit.py`, from standard input, what the model of `docs/estimates.md` sees of their
//! requests ([`ModelInputs`]):
//!
//!     cargo run --release -p packstone-engine --features examples --example estimates < rows.jsonl > inputs.jsonl

use std::error::Error;
use std::io::stdin;

use packstone_engine::PackingRequest;
use packstone_engine::plan::ModelInputs;
use serde_json::Value;

fn main() -> Result<(), Box<dyn Error>> {
    for line in stdin().lines() {
        let mut row: Value = serde_json::from_str(&line?)?;
        let request =
            PackingRequest::from_json(&row["request"], 1).map_err(|faults| format!("{faults:?}"))?;
        row["inputs"] = serde_json::to_value(ModelInputs::of(&request))?;
        println!("{row}");
    }
    Ok(())
}
