//! How well the reported progress follows the time that a run takes: the table of `docs/estimates.md`.
//!
//!     cargo run --release -p packstone-engine --features examples --example progress -- \
//!         [--seeds N] [--samples DIR] [--requests FILE] [CASE ...]
//!
//! The program packs every case with several seeds and samples the reported fraction and the CPU time of the thread. It
//! prints, for each case, the median and the largest difference between the fraction and the share of time, and the
//! median factor between the predicted and the true remaining time, over the samples between 20 and 90 % of the time.
//! CPU time is read from `/proc` (Linux), so other programs on the machine do not disturb the measurement. With
//! `--samples`, all samples of each run are written as CSV. With `--requests`, the cases are those of a file that has
//! one `{"name": …, "request": …}` a line.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use packstone_engine::{Checkpoint, Control, Limits, PackError, PackingRequest, Progress, pack};
use serde_json::{Value, json};

/// Share of the time of a run within which progress is judged.
const JUDGED: std::ops::RangeInclusive<f64> = 0.2..=0.9;

fn main() -> Result<(), Box<dyn Error>> {
    let mut seeds = 5;
    let mut samples: Option<PathBuf> = None;
    let mut requests: Option<PathBuf> = None;
    let mut wanted: Vec<String> = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--seeds" => seeds = arguments.next().ok_or("--seeds needs a number")?.parse()?,
            "--samples" => samples = Some(arguments.next().ok_or("--samples needs a folder")?.into()),
            "--requests" => requests = Some(arguments.next().ok_or("--requests needs a file")?.into()),
            _ => wanted.push(argument),
        }
    }
    println!("case               seed  end       time, s  median |f - s|  largest  median ETA factor");
    let cases = match &requests {
        Some(file) => fs::read_to_string(file)?.lines().map(case).collect::<Result<_, _>>()?,
        None => cases(),
    };
    for (name, request) in cases {
        if !wanted.is_empty() && !wanted.iter().any(|w| name.contains(w.as_str())) {
            continue;
        }
        let (mut differences, mut factors) = (Vec::new(), Vec::new());
        for seed in 0..seeds {
            let run = run(&request, seed)?;
            if let Some(folder) = &samples {
                fs::create_dir_all(folder)?;
                fs::write(folder.join(format!("{name}-{seed}.csv")), run.csv())?;
            }
            let (difference, factor) = (run.differences(), run.eta_factors());
            println!(
                "{name:18} {seed:4}  {:8} {:8.2}  {:14.3}  {:7.3}  {:17.2}",
                run.end,
                run.seconds,
                median(&difference),
                difference.iter().copied().fold(0.0, f64::max),
                median(&factor)
            );
            differences.extend(difference);
            factors.extend(factor);
        }
        println!(
            "{name:18}  all                    {:14.3}  {:7.3}  {:17.2}",
            median(&differences),
            differences.iter().copied().fold(0.0, f64::max),
            median(&factors)
        );
    }
    Ok(())
}

/// A case of a line of JSON: its `name` and its `request`.
fn case(line: &str) -> Result<(String, Value), Box<dyn Error>> {
    let mut value: Value = serde_json::from_str(line)?;
    Ok((value["name"].as_str().ok_or("a case needs a name")?.into(), value["request"].take()))
}

/// The cases with their names.
fn cases() -> Vec<(String, Value)> {
    let cube = |edge: f64| json!({"type": "box", "size_mm": [edge, edge, edge]});
    let fuller = |edge: f64, phi: f64, method: Value| {
        json!({
            "specimen": cube(edge),
            "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2,
                    "volume_fraction": phi, "volume_fraction_of": "placed_grains"},
            "method": method,
        })
    };
    let a16 = |edge: f64, phi: f64, distance: Value, method: Value| {
        json!({
            "specimen": cube(edge),
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": phi},
            "distance": distance,
            "method": method,
        })
    };
    let edmd = || json!({"type": "edmd"});
    let rsa = || json!({"type": "rsa"});
    let apart = || json!({"type": "constant", "gap_mm": 1.0});
    let maximize = || json!({"type": "maximize"});
    [
        ("fuller-0.66", fuller(80.0, 0.66, edmd())),
        ("fuller-0.70", fuller(80.0, 0.70, edmd())),
        ("fuller-0.725", fuller(80.0, 0.725, edmd())),
        ("a16-1mm", a16(80.0, 0.535, apart(), edmd())),
        ("a16-1mm-150", a16(150.0, 0.52, apart(), edmd())),
        ("fuller-150-0.70", fuller(150.0, 0.70, edmd())),
        ("rsa-0.60", fuller(150.0, 0.60, rsa())),
        ("rsa-0.66", fuller(80.0, 0.66, rsa())),
        ("auto-0.62", fuller(100.0, 0.62, json!({"type": "auto"}))),
        ("fuller-0.76", fuller(60.0, 0.76, edmd())),
        ("maximize", a16(50.0, 0.7, maximize(), edmd())),
        ("equal-0.60", {
            let mut value = fuller(30.0, 0.60, edmd());
            value["mix"]["grading"] = json!({"type": "monodisperse", "diameter_mm": 2.0});
            value["mix"]["d_min_mm"] = Value::Null;
            value
        }),
    ]
    .map(|(name, request)| (name.into(), request))
    .into()
}

/// What was reported at one moment.
struct Sample {
    cpu_s: f64,
    fraction: f64,
    step: String,
    done: u64,
    volume_fraction: f64,
    pressure: f64,
}

#[derive(Default)]
struct Recorder {
    samples: Mutex<Vec<Sample>>,
}

impl Control for Recorder {
    fn report(&self, progress: &Progress) {
        let growth = progress.growth;
        self.samples.lock().unwrap_or_else(PoisonError::into_inner).push(Sample {
            cpu_s: cpu_s(),
            fraction: progress.fraction,
            step: format!("{:?}", progress.step).to_lowercase(),
            done: progress.done,
            volume_fraction: growth.map_or(0.0, |grown| grown.volume_fraction),
            pressure: growth.and_then(|grown| grown.reduced_pressure).unwrap_or(0.0),
        });
    }

    fn should_stop(&self) -> bool {
        false
    }

    fn keep_checkpoint(&self, _: &Checkpoint<'_>) {}
}

/// A sampled run; times count from its start.
struct Run {
    samples: Vec<Sample>,
    seconds: f64,
    end: &'static str,
}

fn run(request: &Value, seed: u64) -> Result<Run, Box<dyn Error>> {
    let request = PackingRequest::from_json(request, seed).map_err(|faults| format!("{faults:?}"))?;
    let recorder = Recorder::default();
    let start = cpu_s();
    let end = match pack(&request, &Limits::default(), &recorder) {
        Ok(_) => "packed",
        Err(PackError::TargetNotReached(_)) => "missed",
        Err(other) => return Err(other.into()),
    };
    let seconds = cpu_s() - start;
    let mut samples = recorder.samples.into_inner().unwrap_or_else(PoisonError::into_inner);
    for sample in &mut samples {
        sample.cpu_s -= start;
    }
    Ok(Run { samples, seconds, end })
}

impl Run {
    /// Shares of the time in steps of one percent, each with the last sample before it.
    fn judged(&self) -> Vec<(f64, &Sample)> {
        (0..=100)
            .map(|percent| f64::from(percent) / 100.0)
            .filter(|share| JUDGED.contains(share))
            .filter_map(|share| {
                let before = self.samples.partition_point(|sample| sample.cpu_s <= share * self.seconds);
                Some((share, self.samples.get(before.checked_sub(1)?)?))
            })
            .collect()
    }

    fn differences(&self) -> Vec<f64> {
        self.judged().iter().map(|(share, sample)| (sample.fraction - share).abs()).collect()
    }

    /// Factors, at least 1, between the remaining time by the fraction and the true one.
    fn eta_factors(&self) -> Vec<f64> {
        self.judged()
            .iter()
            .map(|(share, sample)| {
                let predicted = share * (1.0 - sample.fraction) / sample.fraction;
                let factor = predicted / (1.0 - share);
                if factor > 0.0 { factor.max(1.0 / factor) } else { f64::INFINITY }
            })
            .collect()
    }

    fn csv(&self) -> String {
        let mut text = String::from("share,fraction,step,done,volume_fraction,pressure,seconds\n");
        for s in &self.samples {
            let share = s.cpu_s / self.seconds;
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{share},{},{},{},{},{},{}",
                s.fraction, s.step, s.done, s.volume_fraction, s.pressure, s.cpu_s
            );
        }
        text
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// CPU time of this thread in s; 0 where `/proc` does not tell it.
fn cpu_s() -> f64 {
    let stat = fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds: u64 = stat.split(' ').next().and_then(|first| first.parse().ok()).unwrap_or(0);
    nanoseconds as f64 * 1e-9
}
