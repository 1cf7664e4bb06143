//! Measures one case in this process.
//!
//! It runs the engine as a library, and tells on standard error how long runs went; it must never
//! print to standard output, which the figures go to.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use packstone_engine::methods::edmd::Fluid;
use packstone_engine::{Limits, PackError, PackingRequest, PlanError, Report, Unattended, pack};
use serde_json::Value;

use super::super::exit::Failure;
use super::Figures;
use super::cases::{Case, Kind, Shows};
use super::ladder::Ladder;
use super::meter::{Stopwatch, Taken, largest, median, peak_mb};
use crate::telemetry::say;

/// Runs that take longer are told of one by one.
const LONG_S: f64 = 1.0;
/// Collisions per grain that let the fluid forget how it was made, and those of a window.
const WARM_UP_PER_GRAIN: u64 = 10;
const WINDOW_PER_GRAIN: u64 = 20;
/// Grains from which on the memory of the program itself is no matter.
const MANY: usize = 1_000_000;
/// Seeds that end this close to the best one have found the same arrangement.
const SAME_FRACTION: f64 = 1e-5;

pub(super) fn measure(case: &Case, seeds: Option<u64>) -> Result<Figures, Failure> {
    let seeds = seeds.unwrap_or(case.seeds).max(1);
    let figures = match &case.kind {
        Kind::Pack { request, shows } => packings(request, *shows, seeds)?,
        Kind::Climb { ladder, request } => highest(*ladder, request, seeds)?,
        Kind::Fluid { spheres, volume_fraction, windows, threads } => {
            fluid(*spheres, *volume_fraction, (*windows, *threads), seeds)
        }
    };
    Ok(Figures {
        name: case.name.into(),
        at_least: case.at_least.into(),
        moonshot: case.moonshot.into(),
        peak_mb: peak_mb(),
        ..figures
    })
}

/// The runs of a case so far.
#[derive(Default)]
struct Runs {
    taken: Vec<Taken>,
    succeeded: Vec<Report>,
}

impl Runs {
    /// Packs once, and returns whether that succeeded. What ends short of its target, or cannot reach
    /// it, is an outcome; anything else is a fault.
    fn pack(&mut self, request: &Value, seed: u64, what: &str) -> Result<bool, Failure> {
        let request = PackingRequest::from_json(request, seed)
            .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))?;
        let watch = Stopwatch::start();
        let packed = pack(&request, &Limits::default(), &Unattended);
        let taken = watch.taken();
        self.taken.push(taken);
        let outcome = match &packed {
            Ok(_) => "succeeded".into(),
            Err(ended @ (PackError::TargetNotReached(_) | PackError::Plan(PlanError::Infeasible(_)))) => {
                ended.to_string()
            }
            Err(fault) => return Err(format!("{what}: {fault}").into()),
        };
        if taken.wall_s >= LONG_S {
            say(&format!("  {what}: {:.1} s, {:.1} s CPU: {outcome}", taken.wall_s, taken.cpu_s));
        }
        let succeeded = packed.is_ok();
        self.succeeded.extend(packed.map(|packing| packing.report));
        Ok(succeeded)
    }

    fn figures(&self) -> Figures {
        let of_reports = |value: fn(&Report) -> f64| median(self.succeeded.iter().map(value).collect());
        Figures {
            runs: self.taken.len() as u64,
            succeeded: self.succeeded.len() as u64,
            grains: self.succeeded.last().map_or(0, |report| report.summary.grains),
            median_us_per_grain: of_reports(|report| {
                let packing_s = report.timings_s.rsa
                    + report.timings_s.edmd.or(report.timings_s.monte_carlo).unwrap_or(0.0);
                packing_s / report.summary.grains as f64 * 1e6
            }),
            median_check_share: of_reports(|report| report.timings_s.check / report.timings_s.total),
            ..times(&self.taken)
        }
    }
}

fn times(taken: &[Taken]) -> Figures {
    let cpu: Vec<f64> = taken.iter().map(|taken| taken.cpu_s).collect();
    let wall: Vec<f64> = taken.iter().map(|taken| taken.wall_s).collect();
    Figures {
        longest_cpu_s: largest(&cpu).unwrap_or(0.0),
        median_cpu_s: median(cpu).unwrap_or(0.0),
        longest_wall_s: largest(&wall).unwrap_or(0.0),
        median_wall_s: median(wall).unwrap_or(0.0),
        ..Figures::default()
    }
}

fn packings(request: &Value, shows: Shows, seeds: u64) -> Result<Figures, Failure> {
    let mut runs = Runs::default();
    for seed in 1..=seeds {
        runs.pack(request, seed, &format!("seed {seed} of {seeds}"))?;
    }
    let figures = runs.figures();
    let (measured, values) = shown(shows, &runs, &figures);
    Ok(Figures { measured, values: named(values), ..figures })
}

/// The measured figure in words and in numbers.
fn shown(shows: Shows, runs: &Runs, figures: &Figures) -> (String, Vec<(&'static str, f64)>) {
    let time = format!("{:.3} s", figures.median_cpu_s);
    match shows {
        Shows::Time => (format!("{}/{}, {time}", figures.succeeded, figures.runs), vec![]),
        Shows::TimeAndMemory => {
            let memory = peak_mb().map_or(String::new(), |mb| format!(", {mb:.0} MB"));
            (format!("{}/{}, {time}{memory}", figures.succeeded, figures.runs), vec![])
        }
        Shows::Distance => {
            let distances = runs.succeeded.iter().filter_map(|report| report.summary.distance_mm).collect();
            match median(distances).zip(median(coated(&runs.succeeded))) {
                Some((distance_mm, fraction)) => (
                    format!("{distance_mm:.3} mm ({fraction:.4} with the coating)"),
                    vec![("distance_mm", distance_mm), ("volume_fraction_with_coating", fraction)],
                ),
                None => ("nothing packed".into(), vec![]),
            }
        }
        Shows::BestFraction => {
            let fractions = coated(&runs.succeeded);
            let Some(best) = largest(&fractions) else { return ("nothing packed".into(), vec![]) };
            let same = fractions.iter().filter(|&&fraction| best - fraction < SAME_FRACTION).count();
            let all = fractions.len();
            (
                if all > 1 { format!("{best:.6} ({same} of {all} seeds)") } else { format!("{best:.6}") },
                vec![("best_volume_fraction", best), ("seeds_with_the_best", same as f64)],
            )
        }
    }
}

fn coated(reports: &[Report]) -> Vec<f64> {
    reports.iter().map(|report| report.summary.volume_fraction_with_coating).collect()
}

fn highest(ladder: Ladder, request: &dyn Fn(f64) -> Value, seeds: u64) -> Result<Figures, Failure> {
    let mut runs = Runs::default();
    let climb = ladder.climb(seeds, |rung, seed| {
        let amount = f64::from(rung) / 1000.0;
        runs.pack(&request(amount), seed, &format!("{amount:.3}, seed {seed} of {seeds}"))
    })?;
    let mut measured = climb.to_string();
    let mut values = Vec::new();
    if let Some(top) = climb.top() {
        values.push(("volume_fraction", top.fraction()));
        // The runs of the rung above that succeeded are the last ones.
        let above = climb.missed().map_or(0, |rung| rung.succeeded) as usize;
        let at_top = coated(&runs.succeeded[..runs.succeeded.len() - above]);
        if let (Some(&coated), true) = (at_top.last(), request(top.fraction()).get("distance").is_some()) {
            measured = format!("{measured}, {coated:.4} with the coating");
            values.push(("volume_fraction_with_coating", coated));
        }
    }
    Ok(Figures { measured, values: named(values), ..runs.figures() })
}

/// Collisions per second in windows after growth and a warm-up, and the median of them: of CPU time, or of wall-clock
/// time on several threads.
fn fluid(
    spheres: usize,
    volume_fraction: f64,
    (windows, threads): (u64, NonZeroUsize),
    seeds: u64,
) -> Figures {
    let (mut taken, mut rates, mut pressures) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 1..=seeds {
        let watch = Stopwatch::start();
        let mut fluid = Fluid::new(spheres, volume_fraction, seed).with_threads(threads);
        fluid.run(WARM_UP_PER_GRAIN * spheres as u64);
        say(&format!("  seed {seed} of {seeds}: grown and warm after {:.1} s", watch.taken().wall_s));
        for window in 1..=windows {
            let watch = Stopwatch::start();
            let figures = fluid.run(WINDOW_PER_GRAIN * spheres as u64);
            let took = watch.taken();
            let seconds = if threads == NonZeroUsize::MIN { took.cpu_s } else { took.wall_s };
            let rate = figures.collisions as f64 / seconds;
            if took.wall_s >= LONG_S {
                say(&format!(
                    "  window {window} of {windows}: {:.1} s, {:.1} s CPU: {rate:.3e} collisions/s",
                    took.wall_s, took.cpu_s
                ));
            }
            rates.push(rate);
            pressures.push(figures.reduced_pressure);
            taken.push(took);
        }
    }
    let mut values = Vec::new();
    let mut measured = String::new();
    if let (Some(rate), Some(pressure)) = (median(rates), median(pressures)) {
        measured = format!("{rate:.3e} collisions/s");
        values = vec![("collisions_per_s", rate), ("reduced_pressure", pressure)];
    }
    // All that is resident at the peak: the program, random placing and the growth before as well.
    let memory = peak_mb().map(|mb| mb * 1e6 / spheres as f64);
    if let Some(bytes) = memory.filter(|_| spheres >= MANY) {
        measured = format!("{measured}, {bytes:.0} bytes/grain");
        values.push(("peak_bytes_per_grain", bytes));
    }
    Figures {
        measured,
        values: named(values),
        runs: taken.len() as u64,
        succeeded: taken.len() as u64,
        grains: spheres as u64,
        ..times(&taken)
    }
}

fn named(values: Vec<(&'static str, f64)>) -> BTreeMap<String, f64> {
    values.into_iter().map(|(name, value)| (name.into(), value)).collect()
}
