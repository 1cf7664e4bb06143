//! `packstone bench`: the engine's figures on this machine, as a table beside what they should be.
//!
//! Every case runs in a process of its own, so that its peak of memory is its own. The kernels are measured by `cargo
//! bench -p packstone-engine`. `forecast` compares plans, and progress, with runs. `cases` lists what is measured,
//! `measure` measures it, `ladder` finds the highest amount that is reached, `meter` reads the clocks. The table knows
//! problems and how they ended; it must never know how they are computed.

mod cases;
mod forecast;
mod ladder;
mod measure;
mod meter;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use clap::Args;
use serde::{Deserialize, Serialize};

use super::exit::Failure;
use super::print;
use crate::telemetry::say;
use cases::{Case, cases};

/// Options of `packstone bench`.
#[derive(Args)]
pub(super) struct Options {
    /// Run only the cases whose name contains this (`rsa`, `edmd` and `shapes` are the groups), or the one case
    /// of exactly this name; `forecast` compares forecasts with runs instead, `progress` the progress of jobs of all
    /// kinds with their time
    #[arg(long)]
    only: Option<String>,
    /// Seeds of each case, instead of its own number
    #[arg(long)]
    seeds: Option<u64>,
    /// Print one JSON object per case instead of a table
    #[arg(long)]
    json: bool,
    /// Seed of the requests that `--only forecast` draws
    #[arg(long, default_value_t = 1)]
    draw: u64,
    /// Requests that `--only forecast` draws
    #[arg(long, default_value_t = 200)]
    count: u64,
    /// Folder of the records of `--only forecast`, which are not measured twice
    #[arg(long, value_name = "FOLDER")]
    resume: Option<PathBuf>,
    /// CPU seconds that `--only forecast` gives a run; a reach that is decided by one that takes longer is left out
    #[arg(long, value_name = "S", default_value_t = 200.0)]
    budget: f64,
    /// Most grains of the requests that `--only forecast` draws
    #[arg(long, default_value_t = 100_000.0)]
    most_grains: f64,
    /// Pack the request of standard input: what `--only forecast` starts itself with
    #[arg(long, hide = true)]
    packing: bool,
    /// Run one case in this process and print its figures: what the command starts itself with
    #[arg(long, hide = true)]
    case: Option<String>,
}

/// What was measured in a case.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
struct Figures {
    name: String,
    /// What the case is about, in words.
    measured: String,
    at_least: String,
    moonshot: String,
    /// What the case is about, in numbers.
    values: BTreeMap<String, f64>,
    /// Runs, and those that reached what was asked for.
    runs: u64,
    succeeded: u64,
    /// Grains placed in the last run that succeeded.
    grains: u64,
    /// Of all runs, success or not.
    median_cpu_s: f64,
    longest_cpu_s: f64,
    median_wall_s: f64,
    longest_wall_s: f64,
    /// Medians over the runs that succeeded: wall-clock time of placing and growing over the number of
    /// grains, and the independent check's part of the whole run.
    median_us_per_grain: Option<f64>,
    median_check_share: Option<f64>,
    /// Highest resident memory of the process, where the system tells it.
    peak_mb: Option<f64>,
}

const HEAD: &str = "| case | measured | at least | moonshot | grains | succeeded | median CPU s | longest CPU s \
                    | median wall s | us/grain | check share | peak MB |\n\
                    |---|---|---|---|---|---|---|---|---|---|---|---|\n";

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    if options.packing {
        return print(&forecast::from_input()?);
    }
    if options.only.as_deref() == Some("forecast") {
        return forecast::run(&forecast::Options {
            seed: options.draw,
            count: options.count,
            folder: options.resume.as_deref(),
            budget_s: options.budget,
            runs: options.seeds.unwrap_or(10),
            most_grains: options.most_grains,
            json: options.json,
        });
    }
    if options.only.as_deref() == Some("progress") {
        return forecast::run_jobs(options.draw, options.json);
    }
    let cases = cases();
    if let Some(name) = &options.case {
        // Without the others: their lists of diameters are memory, which is measured.
        let case = cases.into_iter().find(|case| case.name == name).ok_or("no such case")?;
        return print(&format!("{}\n", serde_json::to_string(&measure::measure(&case, options.seeds)?)?));
    }
    let wanted = wanted(&cases, options.only.as_deref());
    if wanted.is_empty() {
        return Err("no case has such a name".into());
    }
    if !options.json {
        print(HEAD)?;
    }
    let start = Instant::now();
    for (i, case) in wanted.iter().enumerate() {
        say(&format!(
            "[{:.0} s] {} of {}: {}",
            start.elapsed().as_secs_f64(),
            i + 1,
            wanted.len(),
            case.name
        ));
        let figures = in_own_process(case, options.seeds)?;
        let line = if options.json { serde_json::to_string(&figures)? } else { row(&figures) };
        print(&format!("{line}\n"))?;
    }
    Ok(())
}

/// The case of exactly this name, or else all whose name contains it.
fn wanted<'a>(cases: &'a [Case], only: Option<&str>) -> Vec<&'a Case> {
    let Some(only) = only else { return cases.iter().collect() };
    if let Some(case) = cases.iter().find(|case| case.name == only) {
        return vec![case];
    }
    cases.iter().filter(|case| case.name.contains(only)).collect()
}

fn in_own_process(case: &Case, seeds: Option<u64>) -> Result<Figures, Failure> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["bench", "--case", case.name]);
    if let Some(seeds) = seeds {
        command.args(["--seeds", &seeds.to_string()]);
    }
    let output = command.stderr(Stdio::inherit()).output()?;
    if !output.status.success() {
        return Err(format!("case {:?} ended with {}", case.name, output.status).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn row(f: &Figures) -> String {
    let or_dash = |value: Option<f64>, digits: usize, unit: &str| {
        value.map_or("-".into(), |value| format!("{value:.digits$}{unit}"))
    };
    format!(
        "| {} | {} | {} | {} | {} | {}/{} | {:.3} | {:.3} | {:.3} | {} | {} | {} |",
        f.name,
        f.measured,
        f.at_least,
        f.moonshot,
        f.grains,
        f.succeeded,
        f.runs,
        f.median_cpu_s,
        f.longest_cpu_s,
        f.median_wall_s,
        or_dash(f.median_us_per_grain, 2, ""),
        or_dash(f.median_check_share.map(|share| share * 100.0), 1, " %"),
        or_dash(f.peak_mb, 0, ""),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_is_chosen_by_its_prefix_and_a_case_by_its_name() {
        let cases = cases();
        for group in ["rsa", "edmd", "shapes"] {
            let wanted = wanted(&cases, Some(group));
            assert!(wanted.len() > 5, "{group}");
            assert!(wanted.iter().all(|case| case.name.starts_with(group)), "{group}");
        }
        assert_eq!(wanted(&cases, None).len(), cases.len());
        let names = |only| wanted(&cases, Some(only)).iter().map(|case| case.name).collect::<Vec<_>>();
        assert_eq!(names("edmd jammed N=1"), ["edmd jammed N=1"]);
        assert!(names("edmd jammed").len() > 5);
        assert!(names("no such case").is_empty());
    }

    #[test]
    fn a_row_has_as_many_cells_as_the_head() {
        let head = HEAD.lines().next().unwrap_or_default().matches('|').count();
        let f = Figures { name: "case".into(), median_cpu_s: 1.25, peak_mb: None, ..Figures::default() };
        let row = row(&f);
        assert_eq!(row.matches('|').count(), head, "{row}");
        assert!(row.contains("| 1.250 |") && row.ends_with("| - |"), "{row}");
    }
}
