//! The table of the benchmark of forecasts: what plans say of the recorded requests against what was measured.

use std::fmt::Write;

use packstone_engine::Plan;
use serde_json::{Value, json};

use super::super::super::exit::Failure;
use super::super::meter::{largest, median};
use super::draw::Drawn;
use super::packing::End;
use super::{Purpose, Record, Run, planned};

/// Values of one row.
struct Row {
    name: &'static str,
    required: &'static str,
    found: String,
    values: Value,
}

/// What plans and runs say of one quantity.
#[derive(Default)]
struct Found {
    rsa: Vec<f64>,
    growth: Vec<f64>,
    time: Vec<f64>,
    /// Forecast probability and success of each run.
    runs: Vec<(f64, bool)>,
    below: Vec<f64>,
    above: Vec<f64>,
    proposals: Vec<bool>,
    memory: Vec<f64>,
    plans_of_spheres_ms: Vec<f64>,
    plans_of_shapes_ms: Vec<f64>,
    off: Vec<f64>,
    standstill: Vec<f64>,
    eta_factor: Vec<f64>,
    eta_null: Vec<f64>,
}

/// The table as Markdown, or its figures and the errors of every record as JSON.
pub(super) fn table(records: &[(Drawn, Record)], as_json: bool) -> Result<String, Failure> {
    let mut found = Found::default();
    let mut of_records = Vec::new();
    for (drawn, record) in records {
        of_records.push(add(&mut found, drawn, record)?);
    }
    let rows = rows(&found);
    if as_json {
        let rows: Vec<_> = rows.iter().map(|row| json!({"name": row.name, "values": row.values})).collect();
        return Ok(format!("{}\n", json!({"rows": rows, "records": of_records})));
    }
    let mut text = String::from("| quantity | required | found | of |\n|---|---|---|---|\n");
    for row in rows {
        writeln!(text, "| {} | {} | {} | {} |", row.name, row.required, row.found, row.values["of"])?;
    }
    Ok(text)
}

fn add(found: &mut Found, drawn: &Drawn, record: &Record) -> Result<Value, Failure> {
    let Some(at_request) = record.of(Purpose::Request).next().map(|run| run.filled) else {
        return Ok(Value::Null);
    };
    let (plan, plan_s) = planned(&record.request)?;
    let plans =
        if drawn.has_shapes() { &mut found.plans_of_shapes_ms } else { &mut found.plans_of_spheres_ms };
    plans.push(plan_s * 1e3);
    let is_rsa = record.method == "rsa";
    let p_at = |filled: f64| -> Result<f64, Failure> {
        let (plan, _) = planned(&drawn.at((filled / record.coating).min(1.0), &record.method))?;
        Ok(plan.map_or(0.0, |plan| plan.success_probability))
    };
    let mut errors = [f64::NAN; 2];
    let says =
        |plan: &Plan| [plan.methods.rsa, plan.methods.growth].map(|of| of.volume_fraction_with_coating_reach);
    for (i, method) in ["rsa", "growth"].into_iter().enumerate() {
        // What is refused at the request's volume fraction has a plan below it.
        if let Some(reach) = record.reach(method)
            && let Some(plan) = planned(&drawn.at(0.95 * reach / record.coating, &record.method))?.0
        {
            errors[i] = says(&plan)[i] - reach;
            (if i == 0 { &mut found.rsa } else { &mut found.growth }).push(errors[i]);
        }
    }
    if let Some(reach) = record.reach(if is_rsa { "rsa" } else { "growth" }) {
        found.below.push(p_at(0.92 * reach)?);
        found.above.push(p_at(1.08 * reach)?);
    }
    let probability = match (&plan, drawn.maximizes) {
        (Some(plan), _) => plan.success_probability,
        (None, _) => 0.0,
    };
    let took: Vec<f64> = record.of(Purpose::Request).map(|run| run.outcome.cpu_s).collect();
    let is_whole = |run: &&Run| run.outcome.end != End::Cut;
    let mut factor = None;
    if let (Some(plan), Some(cpu_s)) =
        (&plan, median(took).filter(|_| record.of(Purpose::Request).all(|run| is_whole(&run))))
    {
        // What takes no time has none to foresee.
        const SHORTEST_S: f64 = 0.02;
        if cpu_s > SHORTEST_S {
            factor = Some(plan.estimated_time_s.max(SHORTEST_S / 4.0) / cpu_s);
            found.time.extend(factor);
        }
        let peak = record.of(Purpose::Request).map(|run| run.outcome.peak_mb).fold(0.0, f64::max);
        found.memory.push(plan.memory_bytes as f64 * 1e-6 / peak);
    }
    for run in record.of(Purpose::Request).filter(is_whole) {
        if drawn.maximizes.is_none() {
            found.runs.push((probability, run.outcome.end == End::Succeeded));
        }
        if let Some(progress) = run.outcome.progress {
            found.off.push(progress.off);
            found.standstill.push(progress.standstill);
            found.eta_factor.extend(progress.eta_factor);
            found.eta_null.push(progress.eta_null);
        }
    }
    let proposals = record.of(Purpose::Proposal).filter(is_whole);
    found.proposals.extend(proposals.map(|run| run.outcome.end == End::Succeeded));
    Ok(json!({
        "number": record.number, "kind": record.kind, "method": record.method, "filled": at_request,
        "grains": plan.as_ref().map(|plan| plan.grains),
        "errors": {"rsa": finite(errors[0]), "growth": finite(errors[1])},
        "probability": probability, "time_factor": factor, "shape": drawn.request["mix"]["shape"],
    }))
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn rows(found: &Found) -> Vec<Row> {
    let mut rows = vec![
        spread(
            "reach of random addition: error",
            "0.015 median, 0.03 at 90 %, 0.05 at most",
            &found.rsa,
            0.0,
        ),
        spread("reach of growth: error", "0.012, 0.025, 0.04", &found.growth, 0.0),
    ];
    let factors: Vec<f64> = found.time.iter().map(|factor| libm::exp(libm::log(*factor).abs())).collect();
    rows.push(spread("time: factor", "2, 4, 10", &factors, 1.0));
    rows.extend(calibration(&found.runs));
    let share = |values: &[f64], holds: &dyn Fn(f64) -> bool| {
        values.iter().filter(|value| holds(**value)).count() as f64 / values.len().max(1) as f64
    };
    let single = |name, required, value: f64, of: usize| Row {
        name,
        required,
        found: format!("{value:.3}"),
        values: json!({"value": finite(value), "of": of}),
    };
    let succeeded = found.proposals.iter().filter(|succeeded| **succeeded).count() as f64;
    let at_least = found.memory.iter().copied().fold(f64::INFINITY, f64::min);
    rows.extend([
        single(
            "p above 0.9 at 0.92 of the reach",
            "0.9",
            share(&found.below, &|p| p > 0.9),
            found.below.len(),
        ),
        single(
            "p below 0.1 at 1.08 of the reach",
            "0.9",
            share(&found.above, &|p| p < 0.1),
            found.above.len(),
        ),
        single(
            "runs of proposals that succeed",
            "0.85 to 0.97",
            succeeded / found.proposals.len().max(1) as f64,
            found.proposals.len(),
        ),
        single("memory: least over the peak", "1", at_least, found.memory.len()),
        single(
            "memory: most over the peak",
            "1.3",
            largest(&found.memory).unwrap_or(f64::NAN),
            found.memory.len(),
        ),
        spread("plan of spheres in ms", "1", &found.plans_of_spheres_ms, 0.0),
        spread("plan of shapes in ms", "5", &found.plans_of_shapes_ms, 0.0),
        spread("progress: fraction less share of time", "0.12 median", &found.off, 0.0),
        spread("progress: longest standstill", "0.2 at most", &found.standstill, 0.0),
        spread("remaining time: factor", "1.6 median", &found.eta_factor, 1.0),
        spread("looks without a remaining time", "0.1", &found.eta_null, 0.0),
    ]);
    rows
}

/// Median, 90 % and largest of absolute values.
fn spread(name: &'static str, required: &'static str, values: &[f64], none: f64) -> Row {
    let mut of: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    of.sort_by(f64::total_cmp);
    let at =
        |share: f64| of.get(((of.len() as f64 * share) as usize).min(of.len().saturating_sub(1))).copied();
    let [middle, most, all] = [0.5, 0.9, 1.0].map(|share| at(share).unwrap_or(none));
    Row {
        name,
        required,
        found: format!("{middle:.3} median, {most:.3} at 90 %, {all:.3} at most"),
        values: json!({"median": middle, "at_90": most, "most": all, "of": of.len()}),
    }
}

/// Shares of success in ten bins of the forecast.
fn calibration(runs: &[(f64, bool)]) -> Vec<Row> {
    const NAMES: [&str; 10] = [
        "p 0.0 to 0.1",
        "p 0.1 to 0.2",
        "p 0.2 to 0.3",
        "p 0.3 to 0.4",
        "p 0.4 to 0.5",
        "p 0.5 to 0.6",
        "p 0.6 to 0.7",
        "p 0.7 to 0.8",
        "p 0.8 to 0.9",
        "p 0.9 to 1.0",
    ];
    let share = |name, required, holds: &dyn Fn(f64) -> bool| {
        let within: Vec<_> = runs.iter().filter(|(p, _)| holds(*p)).collect();
        let n = within.len().max(1) as f64;
        let says = within.iter().map(|(p, _)| p).sum::<f64>() / n;
        let does = within.iter().filter(|(_, succeeded)| *succeeded).count() as f64 / n;
        let found =
            if within.is_empty() { "-".into() } else { format!("{says:.3} said, {does:.3} succeeded") };
        let values = json!({"said": says.abs(), "succeeded": does, "of": within.len()});
        Row { name, required, found, values }
    };
    let mut rows: Vec<Row> = NAMES
        .into_iter()
        .enumerate()
        .map(|(bin, name)| {
            share(name, "within 0.1 of 50 runs and more", &|p| ((p * 10.0) as usize).min(9) == bin)
        })
        .collect();
    rows.push(share("p above 0.99", "at least 0.97", &|p| p > 0.99));
    rows.push(share("p below 0.01", "at most 0.03", &|p| p < 0.01));
    rows
}
