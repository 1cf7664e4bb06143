//! How grains that are drawn are placed: at random, by growth, or at random and then by growth.

use std::time::Instant;

use super::insertion::Insertion;
use super::partial::Short;
use super::{
    Growing, PACKING_SHARE, Placed, distance_asked_mm, finish_reason, fraction_of, not_grown, stopped,
};
use crate::checkpoint::Resume;
use crate::control::{Control, Part, Progress, StopToFinish};
use crate::error::{GrowthEffort, GrowthStopped, InsertionFailed, PackError, TargetNotReached};
use crate::memory::OutOfMemory;
use crate::methods::addition::{self, End};
use crate::methods::growth::{Interrupted, Outcome};
use crate::mix::GradedMix;
use crate::packing::{Grains, GrowthEnd, MethodUsed, PartialReason, Statistics};
use crate::plan;
use crate::request::{Distance, GrowthBy, GrowthOptions, Method, OnLimit};

/// Which methods are tried.
enum Route {
    Rsa { attempts_per_grain: Option<u64> },
    Growth(GrowthOptions),
    RsaThenGrowth,
}

/// What the method of the request amounts to: of `auto` whichever will be done sooner.
fn route(run: &Growing<'_>) -> Route {
    let request = run.request;
    let grows = run.to_jamming.is_some() || matches!(request.distance, Distance::Maximize { .. });
    match request.method {
        Method::Rsa { attempts_per_grain } => Route::Rsa { attempts_per_grain },
        Method::Auto {} if run.plan.places_first && !grows => Route::RsaThenGrowth,
        method => Route::Growth(method.growth().copied().unwrap_or_default()),
    }
}

/// Grains of a run that are drawn and have no places yet.
pub(super) trait Job<'a> {
    /// Where a grain lies.
    type Place;

    fn run(&self) -> Growing<'a>;

    /// The mix that the grains are drawn from.
    fn mix(&self) -> &GradedMix;

    /// Volume of the specimen in mm³.
    fn specimen_mm3(&self) -> f64;

    /// The number of grains.
    fn len(&self) -> usize;

    /// Volume of all grains in mm³.
    fn volume_mm3(&self) -> f64;

    /// The diameter of the sphere that has the volume of a grain, by its rank, in mm.
    fn diameter_mm(&self, rank: usize) -> f64;

    /// Inserts the grains at random; `is_alone` where no growth follows a failure.
    ///
    /// # Errors
    /// When the system refuses memory.
    fn insert(
        &self,
        attempts_per_grain: Option<u64>,
        is_alone: bool,
        control: &StopToFinish<'_>,
    ) -> Result<addition::Outcome<Self::Place>, OutOfMemory>;

    /// Looks at the control that random addition takes at most for one grain; infinite where nothing but the proof that
    /// there is no place ends it.
    fn most_looks(&self, attempts_per_grain: Option<u64>, is_alone: bool) -> f64;

    /// Grows the grains.
    ///
    /// # Errors
    /// As [`Interrupted`] says.
    fn grow(
        &mut self,
        options: &GrowthOptions,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Outcome<Vec<Self::Place>>, Interrupted>;

    /// The grains at their places: of the first of them, where not all were placed.
    ///
    /// # Errors
    /// When the system refuses memory.
    fn grains(&self, places: Vec<Self::Place>) -> Result<Grains, OutOfMemory>;

    /// How the grains grow.
    fn by(&self) -> GrowthBy;
}

/// Places the grains of a job by the method of the request, from a checkpoint where there is one.
///
/// # Errors
/// See [`PackError`].
pub(super) fn place<'a>(
    job: &mut impl Job<'a>,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    let share = &Part::new(control, 0.0, PACKING_SHARE);
    match route(&job.run()) {
        // A checkpoint shows that growth had begun.
        Route::RsaThenGrowth if resume.is_none() => match insert(job, None, false, share) {
            Err(PackError::TargetNotReached(_)) => {
                let rest = Part::new(control, share.reached(), PACKING_SHARE);
                grow(job, &GrowthOptions::default(), None, &rest).map(after_rsa)
            }
            other => other,
        },
        Route::RsaThenGrowth => grow(job, &GrowthOptions::default(), resume, share).map(after_rsa),
        Route::Rsa { attempts_per_grain } => insert(job, attempts_per_grain, true, share),
        Route::Growth(options) => grow(job, &options, resume, share),
    }
}

/// Growth that followed a random sequential addition which did not reach the target.
fn after_rsa(placed: Placed) -> Placed {
    let method_used = match placed.method_used {
        MethodUsed::MonteCarlo => MethodUsed::RsaThenMonteCarlo,
        _ => MethodUsed::RsaThenEdmd,
    };
    Placed { method_used, ..placed }
}

/// Random sequential addition.
fn insert<'a>(
    job: &impl Job<'a>,
    attempts_per_grain: Option<u64>,
    is_alone: bool,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    let start = Instant::now();
    let crowding = plan::crowding(job.run().request, job.mix());
    let insertion = Insertion::new(&crowding, job.most_looks(attempts_per_grain, is_alone));
    let fraction = |progress: &Progress| insertion.fraction(progress);
    let part = Part::new(control, 0.0, 1.0).with_fraction(&fraction);
    let addition::Outcome { placed: places, statistics, end } =
        job.insert(attempts_per_grain, is_alone, &StopToFinish::new(&part))?;
    let placed = places.len();
    let short = kept_insertion(&job.run(), end, placed, control);
    if end == End::Complete || short.is_some() {
        return Ok(Placed {
            grains: job.grains(places)?,
            statistics: Statistics { rsa: Some(statistics), ..Statistics::default() },
            distance_mm: None,
            growth_curve: Vec::new(),
            rsa_s: start.elapsed().as_secs_f64(),
            growth_s: None,
            method_used: MethodUsed::Rsa,
            scale: 1.0,
            short: short.map(|reason| Short { reason, failure: None }),
        });
    }
    Err(not_inserted(job, end, placed))
}

/// Why the grains are kept that random sequential addition placed before it ended, at least one; `None` where they are
/// not.
fn kept_insertion(
    run: &Growing<'_>,
    end: End,
    placed: usize,
    control: &dyn Control,
) -> Option<PartialReason> {
    match end {
        _ if placed == 0 => None,
        // Growth follows where the method leaves the choice.
        End::InsertionFailed { .. } => {
            let is_kept =
                run.request.on_limit == OnLimit::Keep && matches!(run.request.method, Method::Rsa { .. });
            is_kept.then_some(PartialReason::Saturated)
        }
        End::Stopped if control.should_finish().is_some() && !control.should_stop() => {
            Some(finish_reason(control))
        }
        End::Stopped | End::Complete | End::OutOfMemory { .. } => None,
    }
}

/// The end of a random sequential addition that has not inserted all grains.
fn not_inserted<'a>(job: &impl Job<'a>, end: End, placed: usize) -> PackError {
    let fraction = |n: usize| fraction_of(n, |rank| job.diameter_mm(rank), job.specimen_mm3());
    match end {
        End::InsertionFailed { saturation_proven, attempts } => {
            PackError::TargetNotReached(TargetNotReached::InsertionFailed(InsertionFailed {
                placed: placed as u64,
                grains: job.len() as u64,
                diameter_mm: job.diameter_mm(placed),
                volume_fraction_reached: fraction(placed),
                volume_fraction_asked: fraction(job.len()),
                saturation_proven,
                attempts,
                amount: job.run().request.mix.amount(),
            }))
        }
        End::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        End::Stopped | End::Complete => stopped(placed, job.len()),
    }
}

/// Growth.
fn grow<'a>(
    job: &mut impl Job<'a>,
    options: &GrowthOptions,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    let (number, by) = (job.len(), job.by());
    let volume_fraction_asked = job.volume_mm3() / job.specimen_mm3();
    let request = job.run().request;
    let failure = GrowthStopped {
        grains: number as u64,
        volume_fraction_reached: 0.0,
        volume_fraction_asked,
        distance_mm_reached: None,
        distance_mm_asked: distance_asked_mm(request),
        scale_reached: 0.0,
        effort: match by {
            GrowthBy::Events => GrowthEffort::Events { events: 0, simulated_time_s: 0.0 },
            GrowthBy::Moves => GrowthEffort::Cycles { cycles: 0, moves: 0 },
        },
        end: GrowthEnd::NoStart,
        amount: request.mix.amount(),
    };
    let outcome = job.grow(options, resume, control).map_err(|interrupted| match interrupted {
        Interrupted::Stopped => stopped(number, number),
        Interrupted::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        Interrupted::NoStart => not_grown(failure.clone()),
    })?;
    let run = job.run();
    let Statistics { edmd, monte_carlo, .. } = outcome.statistics;
    let short = run.is_short(outcome.scale, outcome.end).then(|| {
        let effort = match (edmd, monte_carlo) {
            (Some(of), _) => {
                GrowthEffort::Events { events: of.events, simulated_time_s: of.simulated_time_s }
            }
            (None, Some(of)) => GrowthEffort::Cycles { cycles: of.compression_cycles, moves: of.moves_tried },
            (None, None) => failure.effort,
        };
        let failure = TargetNotReached::GrowthStopped(GrowthStopped {
            volume_fraction_reached: outcome.volume_fraction,
            distance_mm_reached: outcome.distance_mm,
            scale_reached: outcome.scale,
            effort,
            end: outcome.end,
            ..failure
        });
        Short::new(run.kept_reason(outcome.end, control), failure)
    });
    let maximize = matches!(request.distance, Distance::Maximize { .. });
    Ok(Placed {
        short: short.transpose()?,
        statistics: outcome.statistics,
        distance_mm: outcome.distance_mm.filter(|_| maximize),
        growth_curve: outcome.growth_curve,
        rsa_s: outcome.rsa_s,
        growth_s: Some(outcome.growth_s),
        method_used: match by {
            GrowthBy::Events => MethodUsed::Edmd,
            GrowthBy::Moves => MethodUsed::MonteCarlo,
        },
        scale: outcome.scale,
        grains: job.grains(outcome.placed)?,
    })
}
