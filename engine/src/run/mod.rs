//! One run from request to checked packing: size sampling, packing, check.

mod shaped;
mod spheres;
mod verify;
mod verify_run;
#[cfg(test)]
mod verify_tests;

use std::num::NonZeroUsize;
use std::time::Instant;

use crate::analysis::{separation, shape_report};
use crate::check::{self, Check, Scope};
use crate::checkpoint::Resume;
use crate::control::{Control, Part, Phase, Progress};
use crate::distance::DistanceRule;
use crate::error::{GrowthStopped, InsertionFailed, PackError, PlanError, TargetNotReached};
use crate::memory::{self, OutOfMemory};
use crate::methods::rsa::End;
use crate::mix::sampling::{Diameters, sample, sample_shaped};
use crate::mix::{GradedMix, deviation, sphere_volume};
use crate::packing::{
    CheckReport, Grains, GrainsRef, GrowthPoint, MethodUsed, Packing, Report, RsaStatistics,
    SegregationReport, ShapeReport, Solids, Statistics, Summary, Timings,
};
use crate::plan::{Limits, Plan, mix_warnings};
use crate::request::{Distance, PackingRequest, Segregation};
use crate::rng::{Stream, stream};
use crate::shape::{Ellipsoid, Solid};

pub use verify::{VerifyError, verify, verify_failure};

/// Share of a run's work that sampling and packing take; the rest is the check.
const PACKING_SHARE: f64 = 0.98;
/// Memory that the statistics of a gradient take for a grain, in bytes; the spheres in place of other grains too.
const SEPARATION_BYTES_PER_GRAIN: usize = 96;

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
    request.validate().map_err(PlanError::Invalid)?;
    let plan = Plan::new(request, limits)?;
    let start = Instant::now();
    let control: &dyn Control = &Part::new(control, 0.0, 1.0);
    control.report(&Progress {
        phase: Phase::Sampling,
        fraction: 0.0,
        done: 0,
        total: 0,
        unit: "grains",
        message: "drawing diameters".into(),
        growth: None,
    });
    let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    let sampled = Sampled::draw(request, &mix, control)?;
    let coarse =
        deviation::judge_volume(&request.mix, &mix, sampled.volume_mm3()).map_err(PlanError::Coarse)?;
    let sampling_s = start.elapsed().as_secs_f64();

    let placed = match sampled {
        Sampled::Spheres(Diameters { d_mm, parts }) => {
            let job = spheres::Job {
                request,
                mix: &mix,
                diameters: &d_mm,
                aggregate: &parts,
                growth: plan.growth,
                threads: limits.threads,
            };
            spheres::place(&job, &plan, resume, control)?
        }
        Sampled::Solids(solids) => shaped::place(request, &mix, solids, &plan, resume.as_ref(), control)?,
    };

    let checked = as_checked(request, placed.distance_mm);
    let checking = Instant::now();
    let check = judged(&placed.grains, &checked, limits.threads, control)?;
    let check_s = checking.elapsed().as_secs_f64();
    let found = (&placed.grains, placed.method_used, check);
    let figures = Figures::new(request, &checked, &mix, coarse, found)?;
    Ok(Packing {
        report: Report {
            summary: figures.summary,
            timings_s: Timings {
                sampling: sampling_s,
                rsa: placed.rsa_s,
                edmd: placed.growth_s.filter(|_| placed.statistics.edmd.is_some()),
                monte_carlo: placed.growth_s.filter(|_| placed.statistics.monte_carlo.is_some()),
                check: check_s,
                total: start.elapsed().as_secs_f64(),
            },
            statistics: placed.statistics,
            check: figures.check,
            warnings: figures.warnings,
            growth_curve: placed.growth_curve,
            segregation: figures.segregation,
            shapes: figures.shapes,
        },
        grains: placed.grains,
    })
}

/// The request by which a packing is checked: what was found to be the largest distance is checked like one that is
/// requested.
fn as_checked(request: &PackingRequest, distance_mm: Option<f64>) -> PackingRequest {
    let mut checked = request.clone();
    if let (Distance::Maximize { wall_gap_mm }, Some(mm)) = (request.distance, distance_mm) {
        checked.distance = Distance::Constant { gap_mm: mm, wall_gap_mm };
    }
    checked
}

/// What follows from the grains of a packing and its request: all of a report but times and what a method counted.
struct Figures {
    summary: Summary,
    check: CheckReport,
    warnings: Vec<String>,
    segregation: Option<SegregationReport>,
    shapes: Option<ShapeReport>,
}

impl Figures {
    /// Of grains that were drawn with the warning `coarse`, and passed their check by the request `checked`.
    fn new(
        request: &PackingRequest,
        checked: &PackingRequest,
        mix: &GradedMix,
        coarse: Option<String>,
        (grains, method_used, check): (&Grains, MethodUsed, Check),
    ) -> Result<Self, OutOfMemory> {
        let rule = DistanceRule::new(&checked.distance, &checked.specimen);
        let mut warnings: Vec<String> = coarse.into_iter().collect();
        warnings.extend(mix_warnings(request, mix));
        if mix.list.is_none() {
            warnings.extend(deviation::class_warning(&check.classes));
            warnings.extend(deviation::aggregate_warning(&check.aggregates));
        }
        let segregation = match &request.segregation {
            Segregation::Gradient { field, .. } => {
                memory::probe(SEPARATION_BYTES_PER_GRAIN.saturating_mul(grains.len()))?;
                Some(separation(grains, &request.specimen, &rule, *field, request.seed))
            }
            Segregation::None {} => None,
        };
        let found = check.found;
        Ok(Self {
            summary: summary(mix, &rule, grains, method_used, check),
            check: found,
            warnings,
            segregation,
            shapes: grains.solids().and_then(shape_report),
        })
    }
}

/// The grains of a mix before they have positions, from the largest down.
enum Sampled {
    Spheres(Diameters),
    Solids(Solids),
}

impl Sampled {
    fn draw(request: &PackingRequest, mix: &GradedMix, control: &dyn Control) -> Result<Self, PackError> {
        let mut sizes = stream(request.seed, Stream::Sampling);
        let should_stop = || control.should_stop();
        if mix.shapes.is_none() {
            return sample(mix, &mut sizes, &should_stop).map(Self::Spheres);
        }
        let mut forms = stream(request.seed, Stream::Shape);
        sample_shaped(mix, &mut sizes, &mut forms, &should_stop).map(|drawn| Self::Solids(drawn.grains))
    }

    fn volume_mm3(&self) -> f64 {
        match self {
            Self::Spheres(diameters) => diameters.d_mm.iter().map(|&d| sphere_volume(d)).sum(),
            Self::Solids(solids) => solids.shapes.iter().map(shape_volume).sum(),
        }
    }
}

/// Volume of a grain in mm³.
fn shape_volume(shape: &Solid) -> f64 {
    shape.ellipsoid().map_or_else(|| sphere_volume(shape.d_mm()), Ellipsoid::volume_mm3)
}

/// Grains with their positions.
struct Placed {
    grains: Grains,
    statistics: Statistics,
    /// The constant distance reached, where the largest one is requested.
    distance_mm: Option<f64>,
    growth_curve: Vec<GrowthPoint>,
    rsa_s: f64,
    growth_s: Option<f64>,
    method_used: MethodUsed,
}

impl Placed {
    /// Growth that followed a random sequential addition which did not reach the target.
    fn after_rsa(self) -> Self {
        Self { method_used: MethodUsed::RsaThenEdmd, ..self }
    }
}

/// Grains that random sequential addition inserted, all of them.
fn inserted(grains: Grains, statistics: RsaStatistics, started: Instant) -> Placed {
    Placed {
        grains,
        statistics: Statistics { rsa: Some(statistics), ..Statistics::default() },
        distance_mm: None,
        growth_curve: Vec::new(),
        rsa_s: started.elapsed().as_secs_f64(),
        growth_s: None,
        method_used: MethodUsed::Rsa,
    }
}

/// The end of a random sequential addition that has not inserted all grains. `diameter_mm` is the diameter of the
/// sphere
/// that has the volume of a grain, by its rank.
fn not_inserted(
    end: End,
    [placed, grains]: [usize; 2],
    diameter_mm: impl Fn(usize) -> f64,
    specimen_mm3: f64,
) -> PackError {
    let fraction = |n: usize| fraction_of(n, &diameter_mm, specimen_mm3);
    match end {
        End::InsertionFailed { saturation_proven, attempts } => {
            PackError::TargetNotReached(TargetNotReached::InsertionFailed(InsertionFailed {
                placed: placed as u64,
                grains: grains as u64,
                diameter_mm: diameter_mm(placed),
                volume_fraction_reached: fraction(placed),
                volume_fraction_asked: fraction(grains),
                saturation_proven,
                attempts,
            }))
        }
        End::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        End::Stopped | End::Complete => stopped(placed, grains),
    }
}

/// Volume of the first grains over that of the specimen, by the diameters of the spheres of equal volume.
fn fraction_of(grains: usize, diameter_mm: impl Fn(usize) -> f64, specimen_mm3: f64) -> f64 {
    (0..grains).map(|i| sphere_volume(diameter_mm(i))).sum::<f64>() / specimen_mm3
}

fn not_grown(stopped: GrowthStopped) -> PackError {
    PackError::TargetNotReached(TargetNotReached::GrowthStopped(stopped))
}

/// The constant distance of a request.
fn distance_asked_mm(request: &PackingRequest) -> Option<f64> {
    match request.distance {
        Distance::Constant { gap_mm, .. } => Some(gap_mm),
        _ => None,
    }
}

fn stopped(placed: usize, grains: usize) -> PackError {
    PackError::Stopped { placed: placed as u64, grains: grains as u64 }
}

/// Checks the grains by formulas of the check's own.
fn judged(
    grains: &Grains,
    request: &PackingRequest,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Check, PackError> {
    let share = Part::new(control, PACKING_SHARE, 1.0);
    let checked = check::check_grains(grains, request, Scope::All, threads, &share);
    let number = grains.len() as u64;
    let checked = checked.map_err(|fault| match fault {
        check::Fault::Stopped => PackError::Stopped { placed: number, grains: number },
        check::Fault::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        fault => PackError::CheckFailed(fault.to_string()),
    })?;
    control.report(&Progress {
        phase: Phase::Check,
        fraction: 1.0,
        done: number,
        total: number,
        unit: "grains",
        message: "checked".into(),
        growth: None,
    });
    Ok(checked)
}

fn summary(
    mix: &GradedMix,
    rule: &DistanceRule,
    grains: &Grains,
    method_used: MethodUsed,
    Check { classes, aggregates, .. }: Check,
) -> Summary {
    let grains = GrainsRef::from(grains);
    let total = |size: &dyn Fn(f64) -> f64| {
        grains.diameters_mm().map(|d| sphere_volume(size(d))).sum::<f64>() / mix.specimen_volume_mm3
    };
    Summary {
        grains: grains.len() as u64,
        method_used: Some(method_used),
        specimen_volume_mm3: mix.specimen_volume_mm3,
        volume_fraction_mixture: mix.volume_fraction_mixture,
        volume_fraction_effective: total(&|d| d),
        volume_fraction_with_coating: total(&|d| d + rule.gap_mm(d, d)),
        distance_mm: rule.constant_mm(),
        d_min_mm: grains.diameters_mm().last().unwrap_or(0.0),
        d_max_mm: grains.diameters_mm().next().unwrap_or(0.0),
        classes,
        aggregates,
    }
}
