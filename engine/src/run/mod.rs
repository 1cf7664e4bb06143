//! One run from request to checked packing: size sampling, packing, check.
//!
//! A run that ends before its target may keep its packing ([`partial`]): all sizes are then scaled by one factor
//! ([`size_scale`]). Where the volume fraction is to be as large as possible ([`densest`]) they always are.

mod coating;
mod densest;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod densest_tests;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod growth_tests;
mod insertion;
mod job;
mod kept;
mod own;
mod partial;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod partial_tests;
mod shaped;
mod size_scale;
mod spheres;
mod verify;

use std::num::NonZeroUsize;
use std::time::Instant;

use crate::analysis::{separation, shape_report};
use crate::check::{self, Check, Extent, Scope};
use crate::checkpoint::Resume;
use crate::control::{Control, Finish, Part, Progress, Step};
use crate::distance::DistanceRule;
use crate::error::{GrowthStopped, PackError, PlanError, TargetNotReached};
use crate::memory::{self, OutOfMemory};
use crate::methods::growth::ToJamming;
use crate::mix::sampling::{Diameters, sample, sample_shaped};
use crate::mix::{GradedMix, deviation, sphere_volume};
use crate::packing::{
    CheckReport, Grains, GrainsRef, GrowthEnd, GrowthPoint, MethodUsed, Packing, PartialReason, Report,
    SegregationReport, ShapeReport, Spheres, Statistics, Summary, Timings,
};
use crate::plan::{Limits, Plan, mix_warnings};
use crate::request::{Distance, OnLimit, PackingRequest, Segregation};
use crate::rng::{Stream, stream};
use crate::template_cache::TemplateCache;
use partial::{Kept, Short};

pub use own::{OwnError, OwnMix, OwnPacking, pack_with};
pub use verify::{VerifyError, checked_as, compare_stated, verify, verify_failure};

/// Share of a run's work that sampling and packing take; the rest is the check.
const PACKING_SHARE: f64 = 0.98;
/// Memory that the statistics of a gradient take for a grain, in bytes; the spheres in place of other grains too.
const SEPARATION_BYTES_PER_GRAIN: usize = 96;

/// Computes a packing.
///
/// # Errors
/// See [`PackError`]; a packing that fails its own check is never returned.
pub fn pack(request: &PackingRequest, limits: &Limits, control: &dyn Control) -> Result<Packing, PackError> {
    pack_or_resume(request, limits, &TemplateCache::default(), None, control)
}

/// Computes a packing with the templates that earlier runs drew and measured, from a checkpoint of an earlier run of
/// the same request where there is one.
///
/// The packing is that of a run without templates which was never interrupted, to the last bit.
///
/// # Errors
/// As [`pack`].
pub fn pack_or_resume(
    request: &PackingRequest,
    limits: &Limits,
    templates: &TemplateCache,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Packing, PackError> {
    request.validate().map_err(PlanError::Invalid)?;
    let request: &PackingRequest = &templates.attached(request);
    let plan = templates.plan_attached(request, limits)?;
    let started = Instant::now();
    let control: &dyn Control = &Part::new(control, 0.0, 1.0);
    if request.mix.maximizes_volume_fraction() {
        return densest::pack(request, &plan, (limits, templates), resume, control, started);
    }
    let drawn = Drawn::new(request, control)?;
    let coarse = deviation::judge_volume(&request.mix, &drawn.mix, volume_mm3(&drawn.sampled))
        .map_err(PlanError::Coarse)?;
    let sampling_s = started.elapsed().as_secs_f64();
    let Drawn { mix, sampled } = drawn;
    let grains_requested = sampled.len() as u64;
    let run = Growing { request, plan: &plan, to_jamming: None, threads: limits.threads };
    let mut placed = run.place(&mix, sampled, resume, control)?;
    let kept = partial::sized(request, &mut placed, grains_requested)?;
    kept::set_distance(&mut placed, &request.distance, &request.specimen)?;
    let checked = as_checked(request, placed.distance_mm);
    let times = Times { started, sampling_s };
    finished(
        placed,
        &Finishing { checked: &checked, mix: &mix, coarse, kept, times, limits, templates },
        control,
    )
}

/// When a run began, and the time of sampling in s.
#[derive(Clone, Copy)]
struct Times {
    started: Instant,
    sampling_s: f64,
}

/// What the report of grains that are placed follows from besides them.
struct Finishing<'a> {
    /// The request with the volume fraction that was drawn and the distance that was reached.
    checked: &'a PackingRequest,
    mix: &'a GradedMix,
    coarse: Option<String>,
    kept: Kept,
    times: Times,
    limits: &'a Limits,
    templates: &'a TemplateCache,
}

/// The packing of grains that are placed, at their final sizes, once they have passed the check.
fn finished(placed: Placed, of: &Finishing<'_>, control: &dyn Control) -> Result<Packing, PackError> {
    let checking = Instant::now();
    let check = judged(&placed.grains, of, control)?;
    let check_s = checking.elapsed().as_secs_f64();
    let found = (&placed.grains, placed.method_used, check);
    let figures = Figures::new(of.checked, of.mix, of.coarse.clone(), found, &of.kept)?;
    Ok(Packing {
        report: Report {
            summary: figures.summary,
            timings_s: Timings {
                sampling: of.times.sampling_s,
                rsa: placed.rsa_s,
                edmd: placed.growth_s.filter(|_| placed.statistics.edmd.is_some()),
                monte_carlo: placed.growth_s.filter(|_| placed.statistics.monte_carlo.is_some()),
                check: check_s,
                total: of.times.started.elapsed().as_secs_f64(),
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

/// How grains that are drawn are placed.
#[derive(Clone, Copy)]
struct Growing<'a> {
    request: &'a PackingRequest,
    plan: &'a Plan,
    /// Growth beyond the requested size.
    to_jamming: Option<ToJamming>,
    threads: NonZeroUsize,
}

impl Growing<'_> {
    fn place(
        &self,
        mix: &GradedMix,
        sampled: Grains,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Placed, PackError> {
        match sampled.into_solids() {
            Err(Spheres { d_mm, aggregate, .. }) => {
                let mut job = spheres::SphereJob { run: *self, mix, diameters: &d_mm, aggregate: &aggregate };
                job::place(&mut job, resume, control)
            }
            Ok(solids) => shaped::place(self, mix, solids, resume, control),
        }
    }

    /// Whether growth that reached a scale fell short of what is requested: its size, or, where it is to go as far as
    /// it goes, the end that it comes to by itself.
    fn is_short(&self, scale: f64, end: GrowthEnd) -> bool {
        end == GrowthEnd::Finished || scale < 1.0 && self.to_jamming.is_none()
    }

    /// Why a packing is kept of growth that ended so; `None` where it is not.
    fn kept_reason(&self, end: GrowthEnd, control: &dyn Control) -> Option<PartialReason> {
        match end {
            GrowthEnd::Finished => Some(finish_reason(control)),
            _ if self.request.on_limit == OnLimit::Fail => None,
            GrowthEnd::TimeLimit => Some(PartialReason::TimeLimit),
            GrowthEnd::EventLimit | GrowthEnd::SweepLimit => Some(PartialReason::EventLimit),
            GrowthEnd::Stalled | GrowthEnd::Target | GrowthEnd::NoStart => Some(PartialReason::Stalled),
        }
    }
}

/// Why a run was to finish.
fn finish_reason(control: &dyn Control) -> PartialReason {
    match control.should_finish() {
        Some(Finish::TimedOut) => PartialReason::TimedOut,
        Some(Finish::Requested) | None => PartialReason::Finished,
    }
}

/// The grains that a seed draws, and the mix that they are of.
struct Drawn {
    mix: GradedMix,
    /// From the largest down; they have no positions.
    sampled: Grains,
}

impl Drawn {
    fn new(request: &PackingRequest, control: &dyn Control) -> Result<Self, PackError> {
        control.report(&Progress::counted(Step::Sampling, 0, 0, "grains", "drawing diameters"));
        let mix = GradedMix::new(&request.mix, request.specimen.volume_mm3());
        let sampled = sampled(request, &mix, control)?;
        Ok(Self { mix, sampled })
    }
}

/// Checks a packing that was read from a file, by the request and the extent of [`checked_as`] or by others: see
/// [`check::inspect`].
///
/// # Errors
/// The first fault found but for a grading that is not that of the mix.
pub fn inspect(
    grains: &Grains,
    (request, extent): (&PackingRequest, Extent),
    templates: &TemplateCache,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<check::Inspection, check::Fault> {
    check::inspect(grains, request, extent, templates.sieve_sizes(), threads, control)
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
        checked: &PackingRequest,
        mix: &GradedMix,
        coarse: Option<String>,
        (grains, method_used, check): (&Grains, MethodUsed, Check),
        kept: &Kept,
    ) -> Result<Self, OutOfMemory> {
        let rule = DistanceRule::new(&checked.distance, &checked.specimen);
        let mut warnings: Vec<String> = coarse.into_iter().collect();
        warnings.extend(mix_warnings(checked, mix, kept.drawing.is_some()));
        if mix.list.is_none() && kept.extent(grains.len()) == Extent::WHOLE {
            warnings.extend(deviation::class_warning(&check.classes));
            warnings.extend(deviation::aggregate_warning(&check.aggregates));
        }
        let segregation = match &checked.segregation {
            Segregation::Gradient { field, .. } => {
                memory::probe(SEPARATION_BYTES_PER_GRAIN.saturating_mul(grains.len()))?;
                Some(separation(grains, &checked.specimen, &rule, *field, checked.seed))
            }
            Segregation::None {} => None,
        };
        let found = check.found;
        let summary = kept.in_summary(summary(mix, &rule, grains, method_used, check), mix, checked);
        warnings.extend(densest::scale_warning(&summary));
        warnings.extend(partial::warning(&summary));
        Ok(Self {
            summary,
            check: found,
            warnings,
            segregation,
            shapes: grains.solids().and_then(shape_report),
        })
    }
}

/// The grains of a mix before they have positions.
fn sampled(request: &PackingRequest, mix: &GradedMix, control: &dyn Control) -> Result<Grains, PackError> {
    let mut sizes = stream(request.seed, Stream::Sampling);
    let should_stop = || control.should_stop();
    if mix.shapes.is_none() {
        let Diameters { d_mm, parts } = sample(mix, &mut sizes, &should_stop)?;
        return Ok(Spheres { d_mm, aggregate: parts, ..Spheres::default() }.into());
    }
    let mut forms = stream(request.seed, Stream::Shape);
    Ok(sample_shaped(mix, &mut sizes, &mut forms, &should_stop)?.grains.into())
}

/// Volume of all grains in mm³.
fn volume_mm3(grains: &Grains) -> f64 {
    (0..grains.len()).map(|grain| GrainsRef::from(grains).volume_mm3(grain)).sum()
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
    /// Size that growth reached over the requested one; 1 without growth.
    scale: f64,
    /// Why the run ended before its target, where its packing is kept all the same.
    short: Option<Short>,
}

/// Volume of the first grains over that of the specimen, by the diameters of the spheres of equal volume.
fn fraction_of(grains: usize, diameter_mm: impl Fn(usize) -> f64, specimen_mm3: f64) -> f64 {
    // The sum of no numbers is minus zero.
    (0..grains).map(|i| sphere_volume(diameter_mm(i))).fold(0.0, |sum, volume| sum + volume) / specimen_mm3
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
fn judged(grains: &Grains, of: &Finishing<'_>, control: &dyn Control) -> Result<Check, PackError> {
    let share = Part::new(control, PACKING_SHARE, 1.0);
    let extent = of.kept.extent(grains.len());
    let (sieve_sizes, threads) = (of.templates.sieve_sizes(), of.limits.threads);
    let checked = check::check_grains(grains, of.checked, extent, Scope::All, sieve_sizes, threads, &share);
    let number = grains.len() as u64;
    let checked = checked.map_err(|fault| match fault {
        check::Fault::Stopped => PackError::Stopped { placed: number, grains: number },
        check::Fault::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        fault => PackError::CheckFailed(fault.to_string()),
    })?;
    let counted = Progress::counted(Step::Check, grains.len(), grains.len(), "grains", "checked");
    control.report(&Progress { fraction: 1.0, ..counted });
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
        grains.diameters_mm().fold(0.0, |sum, d| sum + sphere_volume(size(d))) / mix.specimen_volume_mm3
    };
    Summary {
        grains: grains.len() as u64,
        method_used: Some(method_used),
        specimen_volume_mm3: mix.specimen_volume_mm3,
        volume_fraction_mixture: mix.volume_fraction_mixture,
        volume_fraction_effective: total(&|d| d),
        volume_fraction_with_coating: coating::volume_mm3(grains, rule) / mix.specimen_volume_mm3,
        distance_mm: rule.constant_mm(),
        d_min_mm: grains.diameters_mm().last().unwrap_or(0.0),
        d_max_mm: grains.diameters_mm().next().unwrap_or(0.0),
        classes,
        aggregates,
        size_scale: None,
        volume_fraction_drawn: None,
        partial: None,
    }
}
