//! `packstone bench --only forecast`: what plans say of drawn requests against what runs do.
//!
//! `draw` makes the requests, `packing` runs one in a process of its own, and this module looks for what the methods
//! reach: the volume fraction with coating that 90 % of the runs reach, by bisection. Each request has a record, a file
//! of JSON, in the folder that `--resume` names. What was measured stays; what plans say is computed anew, so that a
//! changed model is judged by the same runs. `table` makes the figures; `jobs` follows the progress of jobs of all
//! kinds.

mod draw;
mod jobs;
mod packing;
mod table;

use std::fs;
use std::path::Path;

use packstone_engine::{Limits, PackingRequest, Plan, TemplateCache};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::exit::Failure;
use super::super::print;
use super::meter::Stopwatch;
use crate::telemetry::say;
use draw::{Drawn, draw};
pub(super) use jobs::run as run_jobs;
pub(super) use packing::from_input;
use packing::{End, Outcome, Task, in_own_process};

/// Width of the bracket in which a reach is found.
const PRECISION: f64 = 0.004;
/// Runs at the end of a search: if all of them succeed, the reach is taken to lie above. All of six do with a
/// probability of one half where 89 % succeed.
const RUNS_OF_A_LEVEL: u64 = 6;
/// The same of requests of many grains, whose runs differ less.
const RUNS_OF_MANY: u64 = 2;
/// Budgets of a run that a search, or the runs of a request, may take.
const BUDGETS: f64 = 3.0;
/// Volume fraction at which every request has a plan, whatever its gaps.
const LOOSE: f64 = 0.02;
const MANY_GRAINS: f64 = 20_000.0;
/// First step of the search.
const STEP: f64 = 0.02;
/// Levels at most.
const LEVELS: usize = 14;

/// Options of the benchmark of forecasts.
pub(super) struct Options<'a> {
    pub(super) seed: u64,
    pub(super) count: u64,
    /// Folder of the records.
    pub(super) folder: Option<&'a Path>,
    /// CPU time for each run, in s.
    pub(super) budget_s: f64,
    /// Runs of the request itself, and of what the plan proposes.
    pub(super) runs: u64,
    pub(super) most_grains: f64,
    pub(super) json: bool,
}

impl Options<'_> {
    /// Packs a request in a process of its own.
    fn run(&self, request: &Value, seed: u64) -> Result<Outcome, Failure> {
        in_own_process(&Task { request: request.clone(), seed, most_cpu_s: self.budget_s, export: None })
    }
}

/// What was measured of a request.
#[derive(Serialize, Deserialize)]
struct Record {
    draw: u64,
    number: u64,
    kind: String,
    /// The request that runs of the share had, and the method.
    method: String,
    request: Value,
    /// Volume fraction with coating over that of the grains, and the number of grains at the request's fraction.
    coating: f64,
    share: f64,
    /// The volume fractions, with coating, between which the reach of random addition and of growth lies.
    rsa: Option<[f64; 2]>,
    growth: Option<[f64; 2]>,
    runs: Vec<Run>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Purpose {
    Reach,
    Request,
    Proposal,
}

#[derive(Serialize, Deserialize)]
struct Run {
    purpose: Purpose,
    method: String,
    /// Volume fraction with coating.
    filled: f64,
    #[serde(flatten)]
    outcome: Outcome,
}

impl Record {
    fn of(&self, purpose: Purpose) -> impl Iterator<Item = &Run> {
        self.runs.iter().filter(move |run| run.purpose == purpose)
    }

    /// What a method reaches, where its runs tell: the end is not one of their time.
    fn reach(&self, method: &str) -> Option<f64> {
        let is_rsa = method == "rsa";
        let [low, high] = if is_rsa { self.rsa? } else { self.growth? };
        let mut at_high =
            self.of(Purpose::Reach).filter(|run| (run.method == "rsa") == is_rsa && run.filled == high);
        let is_cut = at_high.any(|run| run.outcome.end == End::Cut);
        (high - low < 4.0 * PRECISION && !is_cut).then_some((low + high) / 2.0)
    }
}

/// What a plan says of a request, and the CPU time that it took without the templates, in s.
fn planned(request: &Value) -> Result<(Option<Plan>, f64), Failure> {
    let request = PackingRequest::from_json(request, 1).map_err(|faults| format!("{faults:?}"))?;
    let cache = TemplateCache::default();
    let request = cache.attached(&request);
    // The first makes what is kept of templates.
    let _ = cache.plan(&request, &Limits::default());
    let watch = Stopwatch::start();
    let plan = cache.plan(&request, &Limits::default());
    let cpu_s = watch.taken().cpu_s;
    Ok((plan.ok(), cpu_s))
}

/// Runs the benchmark.
pub(super) fn run(options: &Options<'_>) -> Result<(), Failure> {
    let mut records = Vec::new();
    for number in 0..options.count {
        let file = options.folder.map(|folder| folder.join(format!("{}-{number}.json", options.seed)));
        let kept = match &file {
            Some(file) if file.exists() => Some(serde_json::from_slice::<Record>(&fs::read(file)?)?),
            _ => None,
        };
        let drawn = draw(options.seed, number, options.most_grains);
        let is_new = kept.is_none();
        let mut record = match kept {
            Some(record) => record,
            None => measure(&drawn, options, number)?,
        };
        let is_changed = try_proposal(&drawn, options, &mut record)?;
        if let Some(file) = file.filter(|_| is_new || is_changed) {
            let unfinished = file.with_extension("unfinished");
            fs::create_dir_all(options.folder.unwrap_or(Path::new(".")))?;
            fs::write(&unfinished, serde_json::to_string(&record)?)?;
            fs::rename(unfinished, file)?;
        }
        if is_new {
            let cpu_s: f64 = record.runs.iter().map(|run| run.outcome.cpu_s).sum();
            let reach = |method| record.reach(method).map_or("-".into(), |reach| format!("{reach:.3}"));
            say(&format!(
                "{} of {}: {}, reach of random addition {}, of growth {}, {cpu_s:.1} s",
                number + 1,
                options.count,
                record.kind,
                reach("rsa"),
                reach("growth"),
            ));
        }
        records.push((drawn, record));
    }
    print(&table::table(&records, options.json)?)
}

/// Runs of a request: the search for the reach of both methods, and those of the request itself.
fn measure(drawn: &Drawn, options: &Options<'_>, number: u64) -> Result<Record, Failure> {
    let (plan, _) = planned(&drawn.at(LOOSE, "auto"))?;
    let growth = if drawn.has_shapes() { "monte_carlo" } else { "edmd" };
    let mut record = Record {
        draw: options.seed,
        number,
        kind: drawn.kind.into(),
        method: if drawn.is_random && drawn.maximizes.is_none() { "rsa".into() } else { growth.into() },
        request: Value::Null,
        coating: plan
            .as_ref()
            .map_or(1.0, |plan| plan.volume_fraction_with_coating / plan.volume_fraction_effective),
        share: drawn.share,
        rsa: None,
        growth: None,
        runs: Vec::new(),
    };
    // Grains that do not fit have no plan, and no runs.
    let Some(plan) = plan else { return Ok(record) };
    if drawn.maximizes.is_none() {
        let first = plan.methods.rsa.volume_fraction_with_coating_reach;
        record.rsa = search(drawn, options, &mut record, "rsa", first)?;
        let first = plan.methods.growth.volume_fraction_with_coating_reach;
        record.growth = search(drawn, options, &mut record, growth, first)?;
    }
    let is_rsa = record.method == "rsa";
    let middle = |of: Option<[f64; 2]>| of.map(|[low, high]| (low + high) / 2.0);
    let reach = middle(if is_rsa { record.rsa } else { record.growth });
    if let Some(filled) = reach.map(|reach| reach * drawn.share).or(drawn.maximizes.map(|_| 0.4)) {
        record.request = drawn.at(filled / record.coating, &record.method);
        if drawn.maximizes == Some("volume_fraction") && drawn.of_list.is_none() {
            record.request["mix"]["volume_fraction"] = "maximize".into();
            if let Some(fields) = record.request["mix"].as_object_mut() {
                fields.remove("volume_fraction_of");
            }
        }
        repeat(drawn, options, &mut record, Purpose::Request, filled)?;
    }
    Ok(record)
}

/// The volume fractions with coating between which a method ceases to succeed. Single runs find where, and all runs of
/// a level are made at the lower one in the end: if one of them fails, it becomes the higher one.
fn search(
    drawn: &Drawn,
    options: &Options<'_>,
    record: &mut Record,
    method: &str,
    first: f64,
) -> Result<Option<[f64; 2]>, Failure> {
    // The lower one, with the runs that succeeded there.
    let (mut low, mut high): (Option<(f64, u64)>, Option<f64>) = (None, None);
    let (mut filled, mut step, mut spent_s) = (first, STEP, 0.0);
    for level in 0..LEVELS {
        let volume_fraction = filled / record.coating;
        if volume_fraction >= 1.0 {
            high = Some(record.coating);
        }
        let request = drawn.at(volume_fraction.min(0.999), method);
        let grains = planned(&request)?.0.map_or(0.0, |plan| plan.grains);
        let all = if grains > MANY_GRAINS { RUNS_OF_MANY } else { RUNS_OF_A_LEVEL };
        let is_narrow = |low: f64| high.is_some_and(|high| high - low <= PRECISION);
        let before = low.filter(|(low, _)| *low == filled).map_or(0, |(_, runs)| runs);
        let (mut runs, mut jammed) = (before, None);
        let mut succeeds = true;
        while succeeds && runs < if is_narrow(filled) { all } else { 1 } {
            let outcome = options.run(&request, 1 + runs + 100 * level as u64)?;
            spent_s += outcome.cpu_s;
            succeeds = outcome.end == End::Succeeded;
            jammed = outcome.reached.map(|share| share * filled);
            record.runs.push(Run { purpose: Purpose::Reach, method: method.into(), filled, outcome });
            runs += 1;
        }
        if succeeds {
            low = Some((filled, runs));
        } else {
            high = Some(filled);
            low = low.filter(|(low, _)| *low < filled);
            if before > 0 {
                step = PRECISION;
            }
        }
        filled = match (low, high) {
            (Some((low, runs)), Some(high)) if high - low <= PRECISION => {
                if runs >= all {
                    break;
                }
                low
            }
            (Some((low, _)), Some(high)) => (low + high) / 2.0,
            (Some((low, _)), None) => low + step,
            // Grains that jammed tell where.
            (None, Some(high)) => {
                jammed.map_or(high - step, |at| (at - PRECISION / 2.0).min(high - PRECISION))
            }
            (None, None) => break,
        };
        step *= 1.7;
        if spent_s > BUDGETS * options.budget_s || filled <= 0.0 {
            break;
        }
    }
    Ok(low.zip(high).map(|((low, _), high)| [low, high]))
}

/// Runs at one volume fraction with coating by the method of the record; fewer of many grains, and within the budget.
fn repeat(
    drawn: &Drawn,
    options: &Options<'_>,
    record: &mut Record,
    purpose: Purpose,
    filled: f64,
) -> Result<(), Failure> {
    let request = match purpose {
        Purpose::Request => record.request.clone(),
        _ => drawn.at((filled / record.coating).min(1.0), &record.method),
    };
    let mut spent_s = 0.0;
    for run in 0..options.runs {
        let outcome = options.run(&request, 1001 + run)?;
        spent_s += outcome.cpu_s;
        let method = record.method.clone();
        record.runs.push(Run { purpose, method, filled, outcome });
        if spent_s > BUDGETS * options.budget_s {
            break;
        }
    }
    Ok(())
}

/// Runs of the volume fraction that the plan proposes, where the record has none of it; returns whether it has changed.
fn try_proposal(drawn: &Drawn, options: &Options<'_>, record: &mut Record) -> Result<bool, Failure> {
    let reach = record.reach(if record.method == "rsa" { "rsa" } else { "growth" });
    let (Some(_), None, None) = (reach, drawn.maximizes, drawn.of_list) else { return Ok(false) };
    let request = PackingRequest::from_json(&record.request, 1).map_err(|faults| format!("{faults:?}"))?;
    let Ok(plan) = Plan::new(&request, &Limits::default()) else { return Ok(false) };
    let Some(proposed) = plan.with_proposal(&request).proposal.and_then(|of| of.volume_fraction) else {
        return Ok(false);
    };
    let filled = proposed * record.coating;
    if record.of(Purpose::Proposal).any(|run| (run.filled - filled).abs() < 1e-9) {
        return Ok(false);
    }
    record.runs.retain(|run| run.purpose != Purpose::Proposal);
    repeat(drawn, options, record, Purpose::Proposal, filled)?;
    Ok(true)
}
