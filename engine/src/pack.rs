//! One run from request to checked packing: take, place, verify.

use std::time::Instant;

use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, Phase, Progress};
use crate::distance::DistanceRule;
use crate::error::{NoPlace, NotReached, PackError, PlanError};
use crate::mix::{GradedMix, sphere_volume, take::take};
use crate::packing::{Packing, Report, Spheres, Statistics, Summary, Timings};
use crate::plan::{Limits, Plan};
use crate::request::{Distance, FieldError, Method, PackingRequest};
use crate::rng::{Stream, stream};
use crate::rsa::{End, Rsa};
use crate::verify;

/// Share of a run's progress that placing takes; the rest is the check.
const PLACING_SHARE: f64 = 0.95;

/// Computes a packing.
///
/// # Errors
/// See [`PackError`]; a packing that fails its own check is never returned.
pub fn pack(request: &PackingRequest, limits: &Limits, control: &dyn Control) -> Result<Packing, PackError> {
    pack_or_resume(request, limits, None, control)
}

/// Computes a packing, from a checkpoint of an earlier run of the same request where there is one.
///
/// The packing is that of a run which was never interrupted, to the last bit.
///
/// # Errors
/// As [`pack`].
pub fn pack_or_resume(
    request: &PackingRequest,
    limits: &Limits,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Packing, PackError> {
    // Placing at random keeps no checkpoints, so there is nothing to go on from.
    drop(resume);
    Plan::new(request, limits)?;
    let attempts_per_grain = attempts_per_grain(request)?;
    let start = Instant::now();
    let mut timings = Timings::default();
    control.report(&Progress {
        phase: Phase::Take,
        fraction: 0.0,
        done: 0,
        total: 0,
        unit: "grains",
        message: "drawing diameters".into(),
        growth: None,
    });
    let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    let mut take_rng = stream(request.seed, Stream::Take);
    let Some(diameters) = take(&mix, &mut take_rng, &|| control.should_stop()) else {
        return Err(PackError::Stopped { placed: 0, grains: mix.expected_grains() as u64 });
    };
    timings.take = start.elapsed().as_secs_f64();

    let rule = DistanceRule::new(&request.distance, &request.specimen);
    let placing = Instant::now();
    let rsa = Rsa { diameters_mm: &diameters, specimen: &request.specimen, rule, attempts_per_grain };
    let outcome =
        rsa.run(&mut stream(request.seed, Stream::Rsa), &Share { of: control, from: 0.0, to: PLACING_SHARE });
    timings.rsa = placing.elapsed().as_secs_f64();

    let grains = diameters.len() as u64;
    let placed = outcome.centers_mm.len();
    match outcome.end {
        End::Complete => {}
        End::Stopped => return Err(PackError::Stopped { placed: placed as u64, grains }),
        End::NoPlace { proven, attempts } => {
            let volume =
                |d: &[f64]| d.iter().map(|&d| sphere_volume(d)).sum::<f64>() / mix.specimen_volume_mm3;
            return Err(PackError::NotReached(NotReached::NoPlace(NoPlace {
                placed: placed as u64,
                grains,
                diameter_mm: diameters[placed],
                volume_fraction_reached: volume(&diameters[..placed]),
                volume_fraction_asked: volume(&diameters),
                proven,
                attempts,
            })));
        }
    }
    let spheres = columns(&outcome.centers_mm, diameters);

    let checking = Instant::now();
    let share = Share { of: control, from: PLACING_SHARE, to: 1.0 };
    let check = verify::verify_controlled(&spheres, request, &share).map_err(|fault| match fault {
        verify::Fault::Stopped => PackError::Stopped { placed: grains, grains },
        fault => PackError::CheckFailed(fault.to_string()),
    })?;
    timings.verify = checking.elapsed().as_secs_f64();
    timings.total = start.elapsed().as_secs_f64();
    control.report(&Progress {
        phase: Phase::Verify,
        fraction: 1.0,
        done: grains,
        total: grains,
        unit: "grains",
        message: "checked".into(),
        growth: None,
    });

    let summary = summary(&spheres, &mix, &rule, check.classes);
    Ok(Packing {
        spheres,
        report: Report {
            summary,
            timings_s: timings,
            statistics: Statistics { rsa: outcome.statistics, edmd: None },
            verification: check.found,
            distance_curve: Vec::new(),
        },
    })
}

/// Attempts of random sequential addition, which is all there is to run so far.
fn attempts_per_grain(request: &PackingRequest) -> Result<Option<u64>, PlanError> {
    let not_yet = |pointer: &str, what: &str| {
        let detail = format!("{what} is not available yet");
        Err(PlanError::Invalid(vec![FieldError { pointer: pointer.into(), detail }]))
    };
    if let Distance::Maximize { .. } = request.distance {
        return not_yet("/distance/type", "\"maximize\"");
    }
    match request.method {
        Method::Auto {} => Ok(None),
        Method::Rsa { attempts_per_grain } => Ok(attempts_per_grain),
        Method::Edmd { .. } => not_yet("/method/type", "\"edmd\""),
    }
}

fn columns(centers: &[[f64; 3]], d_mm: Vec<f64>) -> Spheres {
    let column = |a: usize| centers.iter().map(|p| p[a]).collect();
    Spheres { x_mm: column(0), y_mm: column(1), z_mm: column(2), d_mm }
}

fn summary(
    spheres: &Spheres,
    mix: &GradedMix,
    rule: &DistanceRule,
    classes: Vec<crate::packing::ClassReport>,
) -> Summary {
    let total = |size: &dyn Fn(f64) -> f64| {
        spheres.d_mm.iter().map(|&d| sphere_volume(size(d))).sum::<f64>() / mix.specimen_volume_mm3
    };
    Summary {
        grains: spheres.len() as u64,
        specimen_volume_mm3: mix.specimen_volume_mm3,
        volume_fraction_mixture: mix.volume_fraction_mixture,
        volume_fraction_effective: total(&|d| d),
        volume_fraction_with_coating: total(&|d| d + rule.gap_mm(d, d)),
        distance_mm: rule.constant_mm(),
        d_min_mm: spheres.d_mm.last().copied().unwrap_or(0.0),
        d_max_mm: spheres.d_mm.first().copied().unwrap_or(0.0),
        classes,
    }
}

/// Passes progress on as a part of the whole run's.
struct Share<'a> {
    of: &'a dyn Control,
    from: f64,
    to: f64,
}

impl Control for Share<'_> {
    fn report(&self, progress: &Progress) {
        let fraction = self.from + (self.to - self.from) * progress.fraction;
        self.of.report(&Progress { fraction, ..progress.clone() });
    }

    fn should_stop(&self) -> bool {
        self.of.should_stop()
    }

    fn wants_checkpoint(&self) -> bool {
        self.of.wants_checkpoint()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        self.of.keep_checkpoint(checkpoint);
    }
}
