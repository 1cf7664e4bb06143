//! `packstone study --slurm-script`: a script that has Slurm run a study as an array of jobs, and then merge it.
//!
//! The script is for both: `bash SCRIPT` submits the array and the merge after it, `sbatch SCRIPT` the array alone.
//! Within a job it becomes `packstone`, so that the signal that Slurm sends before the time limit (`--signal=B:TERM`)
//! reaches it: runs keep a last checkpoint, and the next array goes on. Width, time and memory come from the forecast
//! of the plan; the options of `sbatch` on the command line precede those in the script.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::super::exit::{Exit, Failure, cannot_be};
use super::super::print;
use super::{Options, expand, limits_elsewhere, read_request};
use crate::config::DEFAULT_CHECKPOINT_EVERY_S;
use crate::studies::Study;
use crate::studies::shards::{forecast_ms, longest_ms};

/// The width is chosen so that a task has about so much work for each core, in ms.
const TASK_MS: u64 = 20 * 60_000;
/// Widest array by default; by default Slurm allows 1000 tasks.
const WIDEST: usize = 256;
/// Time that is requested for a forecast of one hour, in hours: estimates err.
const TIME_PER_FORECAST: u64 = 2;
/// What is requested beside it, in minutes.
const MORE_MINUTES: u64 = 10;
/// The time limit is a multiple of this, in minutes.
const STEP_MINUTES: u64 = 10;
/// Longest time limit by default: many clusters grant no more.
const MOST_MINUTES: u64 = 24 * 60;
/// How long before the limit Slurm sends the signal, in s. It may come some 20 s later.
const SIGNAL_BEFORE_S: u64 = 120;
/// Memory of the process beside that of its runs, in MiB.
const MORE_MIB: u64 = 256;
/// The memory is a multiple of this, in MiB.
const STEP_MIB: u64 = 64;

/// The number of tasks of an array.
#[derive(Clone, Copy, Debug)]
pub(super) enum Width {
    ByForecast,
    Tasks(usize),
}

impl FromStr for Width {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::ByForecast),
            digits => {
                digits.parse().map(Self::Tasks).map_err(|_| "must be a number of tasks, or auto".into())
            }
        }
    }
}

pub(super) fn run(options: &Options, width: Width) -> Result<(), Failure> {
    if options.study.as_os_str() == "-" {
        return Err(Exit::BadInput.because("a script needs the file of the study: name it instead of -"));
    }
    let study = expand(options, &read_request(options)?, None, &limits_elsewhere(options))?;
    let points = study.points.len();
    let width = match width {
        Width::ByForecast => None,
        Width::Tasks(tasks) => Some(tasks),
    };
    if let Some(width) = width.filter(|width| !(1..=points).contains(width)) {
        return Err(Exit::BadInput.because(format_args!(
            "an array of {width} tasks is no use: the study has {points} points, and each is run by one task; 1 to \
             {points} are possible"
        )));
    }
    let paths = Paths {
        binary: text(&std::env::current_exe()?)?,
        study: text(&absolute(&options.study)?)?,
        out: text(&absolute(&options.out)?)?,
    };
    let request = Request::of(&study, width, options.workers.unwrap_or(1));
    let titles = if options.no_plot_titles { " --no-plot-titles" } else { "" };
    print(&script(&paths, &study, &request, &more(options), titles))
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|error| cannot_be("found", path, &error))
}

fn text(path: &Path) -> Result<String, Failure> {
    path.to_str().map(quoted).ok_or_else(|| {
        Exit::BadInput.because(format_args!("{} is no UTF-8, which a script needs", path.display()))
    })
}

/// Text as one word of a shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Absolute paths, quoted.
struct Paths {
    binary: String,
    study: String,
    out: String,
}

/// What is requested of Slurm.
#[derive(Debug, PartialEq)]
struct Request {
    width: usize,
    cpus: u16,
    minutes: u64,
    mib_per_cpu: u64,
    /// Work of the study on one core, in ms.
    total_ms: u64,
    /// Time of the fullest task, in ms.
    longest_ms: u64,
}

impl Request {
    fn of(study: &Study, width: Option<usize>, cpus: u16) -> Self {
        let work = forecast_ms(study);
        let total_ms = work.iter().fold(0_u64, |sum, ms| sum.saturating_add(*ms));
        let most = study.points.len().clamp(1, WIDEST);
        let by_work = total_ms.div_ceil(TASK_MS * u64::from(cpus.max(1)));
        let width = width.unwrap_or_else(|| usize::try_from(by_work).unwrap_or(most).clamp(1, most));
        // However many cores a task has, a run has one.
        let run_ms = work.iter().max().map_or(0, |ms| ms / study.replicates.max(1) as u64);
        let longest_ms = (longest_ms(&work, width) / u64::from(cpus.max(1))).max(run_ms);
        let minutes = longest_ms.saturating_mul(TIME_PER_FORECAST).div_ceil(60_000) + MORE_MINUTES;
        let bytes = study.points.iter().map(|point| point.memory_bytes).max().unwrap_or(0);
        Self {
            width,
            cpus,
            minutes: minutes.next_multiple_of(STEP_MINUTES).min(MOST_MINUTES),
            mib_per_cpu: ((bytes >> 20) * 5 / 4 + MORE_MIB).next_multiple_of(STEP_MIB),
            total_ms,
            longest_ms,
        }
    }
}

/// Options of the command that the shards need too.
fn more(options: &Options) -> String {
    let mut more = String::new();
    if !options.formats.is_empty() {
        let names: Vec<&str> = options.formats.iter().map(|format| format.name()).collect();
        // Writing to a string cannot fail.
        let _ = write!(more, " --format {}", names.join(","));
    }
    if options.max_grains != packstone_engine::Limits::default().max_grains {
        let _ = write!(more, " --max-grains {}", options.max_grains);
    }
    if let Some(threads) = options.threads {
        let _ = write!(more, " --threads {threads}");
    }
    if options.checkpoint_every_s.to_bits() != DEFAULT_CHECKPOINT_EVERY_S.to_bits() {
        let _ = write!(more, " --checkpoint-every-s {}", options.checkpoint_every_s);
    }
    more
}

fn script(paths: &Paths, study: &Study, request: &Request, more: &str, titles: &str) -> String {
    let Paths { binary, study: file, out } = paths;
    let Request { width, cpus, minutes, mib_per_cpu, total_ms, longest_ms } = request;
    let (points, replicates) = (study.points.len(), study.replicates);
    let (total, longest) = (duration(*total_ms), duration(*longest_ms));
    let last = width - 1;
    let name = job_name(study.name.as_deref());
    let arrays = match longest_ms / (MOST_MINUTES * 60_000) {
        0 => String::new(),
        n => format!("# The limit is shorter than that: about {} arrays are needed.\n", n + 1),
    };
    let forecast = format!(
        "Forecast: {points} points of {replicates} runs, {total} on one core, {longest} in the longest task, without \
         stop rules."
    );
    let limits = format!(
        "The time limit is {TIME_PER_FORECAST} times the longest task and {MORE_MINUTES} min, at most {} h; the memory \
         is that of the plan.",
        MOST_MINUTES / 60
    );
    let limit = format!("{:02}:{:02}:00", minutes / 60, minutes % 60);
    format!(
        r#"#!/bin/bash
# A study on Slurm, without a service. This script was printed by packstone study --slurm-script.
#
#   bash THIS_FILE [OPTIONS OF SBATCH]     submits the array, and after it the merge that writes table and plots
#   sbatch [OPTIONS OF SBATCH] THIS_FILE   submits the array alone, of any width by --array=0-(N-1)
#
# Do the same again where an array was cut: the next one takes up what is left, of any width.
#
# {forecast}
# {limits}
{arrays}#SBATCH --job-name={name}
#SBATCH --array=0-{last}
#SBATCH --cpus-per-task={cpus}
#SBATCH --mem-per-cpu={mib_per_cpu}M
#SBATCH --time={limit}
#SBATCH --signal=B:TERM@{SIGNAL_BEFORE_S}

packstone={binary}
study={file}
out={out}

if [ "${{1:-}}" = merge ]; then
    exec "$packstone" study "$study" --out "$out" --merge{titles}
fi
if [ -n "${{SLURM_ARRAY_TASK_ID:-}}" ]; then
    # The process of this script becomes packstone, which the signal must reach.
    exec "$packstone" study "$study" --out "$out" --workers "${{SLURM_CPUS_PER_TASK:-1}}"{more} \
        --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT"
fi
array=$(sbatch --parsable "$@" "$0") || exit
array=${{array%%;*}}
merge=$(sbatch --parsable "$@" --array=0 --cpus-per-task=1 --time=00:10:00 \
    --dependency="afterany:$array" "$0" merge) || exit
echo "array $array, then merge ${{merge%%;*}}"
"#,
    )
}

/// A name that needs no quotes.
fn job_name(name: Option<&str>) -> String {
    const LONGEST: usize = 40;
    let plain = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' };
    let name: String = name.unwrap_or_default().chars().map(plain).take(LONGEST).collect();
    let name = name.trim_matches('-');
    if name.is_empty() { "packstone".into() } else { name.into() }
}

/// A duration in the unit that fits.
fn duration(ms: u64) -> String {
    let s = ms as f64 / 1e3;
    match s {
        _ if s < 90.0 => format!("{s:.0} s"),
        _ if s < 5400.0 => format!("{:.0} min", s / 60.0),
        _ => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use packstone_engine::Limits;
    use serde_json::json;

    use super::*;

    /// Points whose jobs are expected to take so long.
    fn study(forecasts_s: &[f64], replicates: usize) -> Study {
        let request = json!({
            "seed": 1, "replicates": replicates,
            "template": {
                "specimen": {"type": "box", "size_mm": [50, 50, 50]},
                "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
            },
            "grid": {"/priority": (0..forecasts_s.len()).map(|i| i % 10).collect::<Vec<_>>()}
        });
        let mut study = Study::read(&request, 1, None, &Limits::default()).unwrap();
        for (point, forecast_s) in study.points.iter_mut().zip(forecasts_s) {
            (point.forecast_s, point.memory_bytes) = (*forecast_s, 100 << 20);
        }
        study
    }

    #[test]
    fn width_and_time_follow_from_the_forecast() {
        let hour = 3600.0;
        let request = Request::of(&study(&[1.0, 1.0], 5), None, 1);
        assert_eq!((request.width, request.minutes, request.mib_per_cpu), (1, 20, 384));
        // Ten hours: ten tasks would do, but there are four points, the longest of four hours.
        let request = Request::of(&study(&[4.0 * hour, 2.0 * hour, 2.0 * hour, 2.0 * hour], 1), None, 1);
        assert_eq!((request.width, request.longest_ms), (4, 4 * 3_600_000));
        assert_eq!(request.minutes, 490);
        // Two cores halve the runs of a point, but not a run.
        let request = Request::of(&study(&[4.0 * hour, 2.0 * hour], 2), Some(1), 2);
        assert_eq!((request.width, request.longest_ms), (1, 6 * 3_600_000));
        let request = Request::of(&study(&[4.0 * hour], 1), None, 2);
        assert_eq!((request.width, request.longest_ms), (1, 4 * 3_600_000));
        let request = Request::of(&study(&[1000.0 * hour], 1), None, 1);
        assert_eq!((request.width, request.minutes), (1, MOST_MINUTES));
    }

    #[test]
    fn words_are_quoted_and_names_are_plain() {
        assert_eq!(quoted("it's $HOME"), r"'it'\''s $HOME'");
        assert_eq!(job_name(Some("A16 \n#SBATCH --x; rm")), "A16---SBATCH---x--rm");
        assert_eq!(job_name(Some("\u{e4}\u{f6}")), "packstone");
        assert_eq!(job_name(None), "packstone");
        assert_eq!([1_000, 600_000, 36_000_000].map(duration), ["1 s", "10 min", "10.0 h"]);
    }
}
