//! `packstone bench`: the engine's figures on this machine, as a table with their targets.
//!
//! Every case runs in a process of its own, so that its peak of memory is its own. The kernels are
//! measured by `cargo bench -p packstone-engine`.

use std::process::{Command, Stdio};

use clap::Args;
use packstone_engine::{Limits, PackingRequest, Unattended, pack};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Failure, print};

/// Options of `packstone bench`.
#[derive(Args)]
pub(super) struct Options {
    /// Run only the cases whose name contains this
    #[arg(long)]
    only: Option<String>,
    /// Seeds of each case, instead of its own number
    #[arg(long)]
    seeds: Option<u64>,
    /// Print one JSON object per case instead of a table
    #[arg(long)]
    json: bool,
    /// Run one case in this process and print its figures: what the command starts itself with
    #[arg(long, hide = true)]
    case: Option<String>,
}

/// One measured problem.
struct Case {
    name: &'static str,
    request: Value,
    seeds: u64,
    target: &'static str,
}

/// What was measured in a case.
#[derive(Debug, Serialize, Deserialize)]
struct Figures {
    name: String,
    target: String,
    seeds: u64,
    succeeded: u64,
    /// Expected grains of the mix, or those placed with the last seed that succeeded.
    grains: u64,
    /// Of all runs, success or not.
    median_total_s: f64,
    longest_total_s: f64,
    /// Medians over the runs that succeeded.
    median_us_per_grain: f64,
    median_verify_share: f64,
    /// Highest resident memory of the process; where the system tells it.
    peak_mb: Option<f64>,
}

fn cases() -> Vec<Case> {
    let fuller = |phi: f64| {
        json!({
            "specimen": {"type": "box", "size_mm": [80, 80, 80]},
            "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5},
                    "d_min_mm": 2, "volume_fraction": phi, "basis": "effective"},
        })
    };
    let b16 = |size: f64| {
        json!({
            "specimen": {"type": "box", "size_mm": [size, size, size]},
            "mix": {"grading": {"type": "standard", "name": "B16"}, "d_min_mm": 0.5, "volume_fraction": 0.7},
        })
    };
    let case = |name, request, seeds, target| Case { name, request, seeds, target };
    vec![
        case("rsa fuller 2..16 a=80 phi_eff 0.60", fuller(0.60), 5, "0.2 s"),
        case("rsa fuller 2..16 a=80 phi_eff 0.65", fuller(0.65), 5, "1 s"),
        case("rsa fuller 2..16 a=80 phi_eff 0.665", fuller(0.665), 20, "half succeed, 5 s each"),
        case("rsa fuller 2..16 a=80 phi_eff 0.70", fuller(0.70), 5, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=25.5", b16(25.5), 5, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=54.9", b16(54.9), 5, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=118", b16(118.0), 2, ""),
        case("rsa B16 d_min 0.5 phi_M 0.70 a=150", b16(150.0), 2, "40 s, 700 MB, < 2.5 x us/grain of a=25.5"),
    ]
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    if let Some(name) = &options.case {
        let case = cases().into_iter().find(|case| case.name == name).ok_or("no such case")?;
        return print(&format!("{}\n", serde_json::to_string(&measure(&case, options.seeds)?)?));
    }
    if !options.json {
        print(
            "| case | grains | succeeded | median s | longest s | us/grain | check share | peak MB | target |\n\
             |---|---|---|---|---|---|---|---|---|\n",
        )?;
    }
    let wanted = |case: &Case| options.only.as_ref().is_none_or(|part| case.name.contains(part.as_str()));
    for case in cases().iter().filter(|case| wanted(case)) {
        let figures = in_own_process(case, options.seeds)?;
        let line = if options.json { serde_json::to_string(&figures)? } else { row(&figures) };
        print(&format!("{line}\n"))?;
    }
    Ok(())
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

fn measure(case: &Case, seeds: Option<u64>) -> Result<Figures, Failure> {
    let seeds = seeds.unwrap_or(case.seeds).max(1);
    let (mut totals, mut per_grain, mut verify_shares) = (Vec::new(), Vec::new(), Vec::new());
    let mut grains = 0;
    for seed in 1..=seeds {
        let request = PackingRequest::from_json(&case.request, seed)
            .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))?;
        let start = std::time::Instant::now();
        let packed = pack(&request, &Limits::default(), &Unattended);
        totals.push(start.elapsed().as_secs_f64());
        if let Ok(packing) = packed {
            let timings = packing.report.timings_s;
            grains = packing.report.summary.grains;
            per_grain.push(timings.rsa / grains as f64 * 1e6);
            verify_shares.push(timings.verify / timings.total);
        }
    }
    Ok(Figures {
        name: case.name.into(),
        target: case.target.into(),
        seeds,
        succeeded: per_grain.len() as u64,
        grains,
        longest_total_s: totals.iter().copied().fold(0.0, f64::max),
        median_total_s: median(totals),
        median_us_per_grain: median(per_grain),
        median_verify_share: median(verify_shares),
        peak_mb: peak_mb(),
    })
}

fn row(f: &Figures) -> String {
    let peak = f.peak_mb.map_or("-".into(), |mb| format!("{mb:.0}"));
    format!(
        "| {} | {} | {}/{} | {:.3} | {:.3} | {:.2} | {:.1} % | {peak} | {} |",
        f.name,
        f.grains,
        f.succeeded,
        f.seeds,
        f.median_total_s,
        f.longest_total_s,
        f.median_us_per_grain,
        f.median_verify_share * 100.0,
        f.target
    )
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Highest resident memory of this process, from Linux's `/proc`.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}
