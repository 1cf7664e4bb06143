//! One packing, or one export of a packing, in a process of its own: how it ended, what it took, and how true its
//! progress was.

use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

use packstone_engine::export::{ExportError, ExportRequest, Model};
use packstone_engine::{
    Control, Limits, PackError, PackingRequest, Progress, TargetNotReached, Unattended, pack,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::super::super::exit::Failure;
use super::super::meter::{Stopwatch, Taken, median, peak_mb};
use crate::remaining_time::RemainingTime;

/// Looks at the progress that are kept.
const LOOKS: usize = 2000;
/// The part of a run in which progress is judged.
const JUDGED: [f64; 2] = [0.2, 0.9];

/// What a process packs.
#[derive(Serialize, Deserialize)]
pub(super) struct Task {
    pub(super) request: Value,
    pub(super) seed: u64,
    pub(super) most_cpu_s: f64,
    /// An export to make of the packing, whose figures are those of the export.
    #[serde(default)]
    pub(super) export: Option<Value>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum End {
    Succeeded,
    Short,
    Refused,
    /// The benchmark gave it no more time.
    Cut,
}

/// What a run took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Outcome {
    pub(super) end: End,
    /// CPU time; of an export, which may wait for a program that makes its mesh, the time on the clock.
    pub(super) cpu_s: f64,
    pub(super) peak_mb: f64,
    /// Operations: events, moves, or attempts and voxels of random addition.
    pub(super) operations: u64,
    /// Of grains that jammed, the share of the volume that was asked for.
    pub(super) reached: Option<f64>,
    pub(super) progress: Option<Followed>,
}

/// Progress against the clock from 20 to 90 % of a run.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Followed {
    /// Median of the difference between the fraction and the share of time.
    pub(super) off: f64,
    /// Longest share of the whole run without a new fraction.
    pub(super) standstill: f64,
    /// Median factor of the remaining time, and the share of looks without one.
    pub(super) eta_factor: Option<f64>,
    pub(super) eta_null: f64,
}

/// Packs in a process of its own.
pub(super) fn in_own_process(task: &Task) -> Result<Outcome, Failure> {
    let mut command = Command::new(std::env::current_exe()?);
    let mut child =
        command.args(["bench", "--packing"]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
    if let Some(mut input) = child.stdin.take() {
        input.write_all(serde_json::to_string(task)?.as_bytes())?;
    }
    let output = child.wait_with_output()?;
    if !output.status.success() {
        return Err(format!("a packing ended with {}: {}", output.status, task.request).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// Packs what standard input says, and returns the outcome as JSON.
pub(in super::super) fn from_input() -> Result<String, Failure> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let task: Task = serde_json::from_str(&text)?;
    Ok(serde_json::to_string(&run(&task)?)?)
}

fn run(task: &Task) -> Result<Outcome, Failure> {
    let request = PackingRequest::from_json(&task.request, task.seed)
        .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))?;
    if let Some(export) = &task.export {
        return exported(&request, export, task.most_cpu_s);
    }
    let follower = Follower::start(|taken| taken.cpu_s, task.most_cpu_s);
    let packed = pack(&request, &Limits::default(), &follower);
    let cpu_s = follower.taken_s();
    let (mut operations, mut reached) = (0, None);
    let end = match &packed {
        Ok(packing) => {
            let of = &packing.report.statistics;
            operations = of.rsa.map_or(0, |rsa| rsa.attempts + rsa.voxels_tested)
                + of.edmd.map_or(0, |edmd| edmd.events)
                + of.monte_carlo.map_or(0, |moves| moves.moves_tried);
            End::Succeeded
        }
        Err(PackError::TargetNotReached(TargetNotReached::GrowthStopped(stopped))) => {
            reached = Some(stopped.scale_reached.powi(3));
            End::Short
        }
        Err(PackError::TargetNotReached(_)) => End::Short,
        Err(PackError::Plan(_)) => End::Refused,
        Err(PackError::Stopped { .. }) => End::Cut,
        Err(fault) => return Err(fault.to_string().into()),
    };
    Ok(Outcome {
        end,
        cpu_s,
        peak_mb: peak_mb().unwrap_or(0.0),
        operations,
        reached,
        progress: follower.followed(end, cpu_s),
    })
}

/// Packs, and makes an export of the packing, which is followed.
fn exported(request: &PackingRequest, export: &Value, most_cpu_s: f64) -> Result<Outcome, Failure> {
    let export = ExportRequest::from_json(export).map_err(|faults| format!("{faults:?}"))?;
    let packing = pack(request, &Limits::default(), &Unattended)?;
    let model = Model::new(&request.specimen, &packing.grains).with_mesher(&crate::gmsh::Installed);
    let follower = Follower::start(|taken| taken.wall_s, most_cpu_s);
    let end = match export.write(&model, &Limits::default(), &follower, &mut std::io::sink()) {
        Ok(_) => End::Succeeded,
        Err(ExportError::Stopped) => End::Cut,
        Err(fault) => return Err(fault.to_string().into()),
    };
    let cpu_s = follower.taken_s();
    Ok(Outcome {
        end,
        cpu_s,
        peak_mb: peak_mb().unwrap_or(0.0),
        operations: 0,
        reached: None,
        progress: follower.followed(end, cpu_s),
    })
}

/// Follows the progress of a run by its time, and stops it when that is over.
struct Follower {
    watch: Stopwatch,
    /// The time that counts.
    clock: fn(Taken) -> f64,
    most_s: f64,
    looks: Mutex<Looks>,
}

struct Looks {
    remaining: RemainingTime,
    /// One of so many calls is kept.
    every: usize,
    calls: usize,
    /// Time, fraction, remaining time.
    kept: Vec<(f64, f64, Option<f64>)>,
}

impl Control for Follower {
    fn report(&self, progress: &Progress) {
        let elapsed = self.taken_s();
        let Ok(mut looks) = self.looks.lock() else { return };
        let now = Duration::from_secs_f64(elapsed.max(0.0));
        looks.remaining.follow(progress, now);
        looks.calls += 1;
        if looks.calls.is_multiple_of(looks.every) {
            let look = (elapsed, looks.remaining.fraction(), looks.remaining.eta_s(now));
            looks.kept.push(look);
        }
        if looks.kept.len() >= LOOKS {
            looks.every *= 2;
            let mut is_kept = false;
            looks.kept.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
        }
    }

    fn should_stop(&self) -> bool {
        self.taken_s() > self.most_s
    }
}

impl Follower {
    fn start(clock: fn(Taken) -> f64, most_s: f64) -> Self {
        let looks = Looks { remaining: RemainingTime::default(), every: 1, calls: 0, kept: Vec::new() };
        Self { watch: Stopwatch::start(), clock, most_s, looks: Mutex::new(looks) }
    }

    fn taken_s(&self) -> f64 {
        (self.clock)(self.watch.taken())
    }

    /// Progress against the clock; `None` of runs that are too short to show any, or whose end was not seen.
    fn followed(&self, end: End, total_s: f64) -> Option<Followed> {
        const SHORTEST_S: f64 = 1.0;
        let looks = self.looks.lock().ok()?;
        if total_s < SHORTEST_S || end == End::Cut {
            return None;
        }
        let of = |share: f64| looks.kept.partition_point(|(at, ..)| *at < share * total_s);
        let judged = looks.kept.get(of(JUDGED[0])..of(JUDGED[1])).filter(|of| !of.is_empty())?;
        let off = median(judged.iter().map(|(at, fraction, _)| (fraction - at / total_s).abs()).collect())?;
        let factors = judged.iter().filter_map(|(at, _, eta_s)| {
            let off = libm::log(eta_s.as_ref()?.max(0.05) / (total_s - at).max(0.05));
            Some(libm::exp(off.abs()))
        });
        let (mut since, mut last, mut standstill) = (JUDGED[0] * total_s, f64::NAN, 0.0_f64);
        for (at, fraction, _) in judged {
            if (*fraction - last).abs() > 1e-6 || last.is_nan() {
                (since, last) = (*at, *fraction);
            }
            standstill = standstill.max((at - since) / total_s);
        }
        let unknown = judged.iter().filter(|(.., eta_s)| eta_s.is_none()).count();
        Some(Followed {
            off,
            standstill,
            eta_factor: median(factors.collect()),
            eta_null: unknown as f64 / judged.len() as f64,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_grain_that_fits_nowhere_is_refused_and_ends_no_benchmark() {
        let needle =
            json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.12, "c_over_a": 0.1}});
        let request = json!({
            "specimen": {"type": "box", "size_mm": [24, 24, 24]},
            "mix": {
                "grading": {"type": "diameters", "diameters_mm": [9, 4]},
                "allow_coarse": true,
                "shape": needle,
                "size": "equivalent",
            },
            "distance": {"type": "constant", "gap_mm": 2.5},
            "method": {"type": "monte_carlo"},
        });
        let task = Task { request, seed: 1, most_cpu_s: 1.0, export: None };
        assert_eq!(run(&task).unwrap().end, End::Refused);
    }
}
