//! A run whose grains are ellipsoids or polyhedra: random sequential addition, hard-particle Monte Carlo, or both.

use std::time::Instant;

use super::spheres::RSA_TIME_EXPONENT;
use super::{
    Growing, PACKING_SHARE, Placed, Short, distance_asked_mm, inserted, kept_insertion, not_grown,
    not_inserted, stopped,
};
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, Part, StopToFinish};
use crate::distance::DistanceRule;
use crate::error::{GrowthEffort, GrowthStopped, PackError, PlanError, TargetNotReached};
use crate::gap::grain::ConvexShape;
use crate::memory::{collected, reserved};
use crate::methods::monte_carlo::{self, Interrupted, MonteCarlo};
use crate::methods::rsa::End;
use crate::methods::rsa_shapes::{AttemptsIn, MOST_DRAWS, MOST_DRAWS_BEFORE_GROWTH, ShapeRsa};
use crate::mix::{GradedMix, draw_orientation};
use crate::packing::{Grains, GrowthEnd, GrowthPoint, MethodUsed, MonteCarloStatistics, Solids, Statistics};
use crate::request::{Distance, FieldError, GrainKind, Method, MonteCarloStop, OnLimit};
use crate::rng::{Stream, stream};
use crate::segregation::Preference;
use crate::shape::{Pose, Solid};

/// A run whose shapes are drawn.
struct Job<'a, S> {
    run: &'a Growing<'a>,
    mix: &'a GradedMix,
    /// By equivalent diameter from the largest down.
    shapes: Vec<S>,
}

/// Grains of which the poses alone are known, in the order of the shapes.
fn poses_alone(poses: Vec<Pose>) -> Grains {
    Grains::Solids(Solids { poses, ..Solids::default() })
}

/// What was placed by its poses alone, with the shapes, templates and aggregates of the grains: of the first of them,
/// where not all were placed.
fn with_shapes(placed: Placed, mut solids: Solids) -> Placed {
    let poses = match placed.grains {
        Grains::Solids(Solids { poses, .. }) => poses,
        Grains::Spheres(_) => Vec::new(),
    };
    solids.shapes.truncate(poses.len());
    solids.aggregate.truncate(poses.len());
    Placed { grains: Grains::Solids(Solids { poses, ..solids }), ..placed }
}

/// Which methods are tried.
enum Route {
    Rsa { attempts_per_grain: Option<u64> },
    MonteCarlo(MonteCarloStop),
    RsaThenMonteCarlo,
}

/// What `auto` amounts to: whichever will be done sooner.
fn route(run: &Growing<'_>) -> Route {
    let request = run.request;
    let grows = run.to_jamming.is_some() || matches!(request.distance, Distance::Maximize { .. });
    match request.method {
        Method::Rsa { attempts_per_grain } => Route::Rsa { attempts_per_grain },
        Method::MonteCarlo { stop } => Route::MonteCarlo(stop),
        Method::Auto {} if run.plan.places_first && !grows => Route::RsaThenMonteCarlo,
        // Reading a request refuses event-driven dynamics for grains with a shape.
        Method::Auto {} | Method::Edmd { .. } => Route::MonteCarlo(MonteCarloStop::default()),
    }
}

/// Packs shaped grains by the method of the request, from a checkpoint where there is one.
///
/// # Errors
/// See [`PackError`].
pub(super) fn place(
    run: &Growing<'_>,
    mix: &GradedMix,
    mut solids: Solids,
    resume: Option<&Resume>,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    // Ellipsoids alone are worth a method of their own, which has no kinds to tell apart.
    if solids.kind() == GrainKind::Ellipsoids {
        let mut shapes = reserved(solids.len())?;
        shapes.extend(solids.shapes.iter().filter_map(Solid::ellipsoid).copied());
        // They are there once.
        solids.shapes = Vec::new();
        let (placed, shapes) = place_shapes(Job { run, mix, shapes }, resume, control)?;
        solids.shapes = collected(shapes.into_iter().map(Solid::Ellipsoid))?;
        return Ok(with_shapes(placed, solids));
    }
    let shapes = collected((0..solids.len()).map(|grain| solids.shape(grain)))?;
    let (placed, _) = place_shapes(Job { run, mix, shapes }, resume, control)?;
    Ok(with_shapes(placed, solids))
}

/// Places the shapes of a job, by their poses alone, and gives them back.
fn place_shapes<S: ConvexShape>(
    job: Job<'_, S>,
    resume: Option<&Resume>,
    control: &dyn Control,
) -> Result<(Placed, Vec<S>), PackError> {
    let most = monte_carlo::most_grains(&job.shapes, &job.run.request.specimen, &job.rule());
    if job.shapes.len() as u64 > most {
        let list = job.mix.list.is_some();
        let pointer = if list { "/mix/grading/diameters_mm" } else { "/mix/d_min_mm" };
        let detail = format!(
            "the mix has {} grains, some of which are longer than an edge of the periodic box: must be at most {most}, \
             for there are many images of each",
            job.shapes.len()
        );
        return Err(PlanError::TooLarge(FieldError { pointer: pointer.into(), detail }).into());
    }
    let share = &Part::new(control, 0.0, PACKING_SHARE);
    match route(job.run) {
        // A checkpoint shows that growth had begun.
        Route::RsaThenMonteCarlo if resume.is_none() => {
            match job.insert(None, MOST_DRAWS_BEFORE_GROWTH, share) {
                Err(PackError::TargetNotReached(_)) => {
                    let rest = Part::new(control, share.reached(), PACKING_SHARE);
                    job.grow(MonteCarloStop::default(), None, &rest).map(after_rsa)
                }
                other => other.map(|placed| (placed, job.shapes)),
            }
        }
        Route::RsaThenMonteCarlo => job.grow(MonteCarloStop::default(), resume, share).map(after_rsa),
        Route::Rsa { attempts_per_grain } => {
            job.insert(attempts_per_grain, MOST_DRAWS, share).map(|placed| (placed, job.shapes))
        }
        Route::MonteCarlo(stop) => job.grow(stop, resume, share),
    }
}

/// Growth that followed a random sequential addition which did not reach the target.
fn after_rsa<S>((placed, shapes): (Placed, Vec<S>)) -> (Placed, Vec<S>) {
    (Placed { method_used: MethodUsed::RsaThenMonteCarlo, ..placed }, shapes)
}

impl<S: ConvexShape> Job<'_, S> {
    fn volume_fraction(&self) -> f64 {
        self.shapes.iter().map(ConvexShape::volume_mm3).sum::<f64>() / self.mix.specimen_volume_mm3
    }

    fn rule(&self) -> DistanceRule {
        DistanceRule::new(&self.run.request.distance, &self.run.request.specimen)
    }

    /// The gradient of the request, where it has one.
    fn preference(&self) -> Result<Option<Preference>, PackError> {
        if self.run.request.segregation.is_none() {
            return Ok(None);
        }
        let diameters = collected(self.shapes.iter().map(ConvexShape::equivalent_diameter_mm))?;
        Ok(Preference::new(self.run.request, &diameters))
    }

    /// Random sequential addition, with a bound on the draws for a grain where the attempts have none.
    fn insert(
        &self,
        attempts_per_grain: Option<u64>,
        most_draws: u64,
        control: &dyn Control,
    ) -> Result<Placed, PackError> {
        let start = Instant::now();
        let request = self.run.request;
        let orientation = request.mix.orientation;
        let rsa = ShapeRsa {
            shapes: &self.shapes,
            specimen: &request.specimen,
            rule: self.rule(),
            attempts_per_grain,
            attempts_in: AttemptsIn::Specimen,
            orientation: &|rng| draw_orientation(&orientation, rng),
        };
        let part = Part::new(control, 0.0, 1.0).with_exponent(RSA_TIME_EXPONENT);
        let control = StopToFinish::new(&part);
        let preference = self.preference()?;
        let mut rng = stream(request.seed, Stream::Rsa);
        let outcome = rsa.run_with(None, preference.as_ref(), most_draws, &mut rng, &control);
        let placed = outcome.poses.len();
        let short = kept_insertion(self.run, outcome.end, placed, &part);
        if outcome.end == End::Complete || short.is_some() {
            return Ok(inserted(poses_alone(outcome.poses), outcome.statistics, start, short));
        }
        let diameter_mm = |i: usize| self.shapes[i].equivalent_diameter_mm();
        let of = (self.mix.specimen_volume_mm3, self.run.amount());
        Err(not_inserted(outcome.end, [placed, self.shapes.len()], diameter_mm, of))
    }

    /// Hard-particle Monte Carlo.
    fn grow(
        self,
        stop: MonteCarloStop,
        resume: Option<&Resume>,
        control: &dyn Control,
    ) -> Result<(Placed, Vec<S>), PackError> {
        let (number, volume_fraction_asked) = (self.shapes.len(), self.volume_fraction());
        let (run, request) = (self.run, self.run.request);
        let orientation = request.mix.orientation;
        let maximize = match request.distance {
            Distance::Maximize { wall_gap_mm } => Some(wall_gap_mm),
            _ => None,
        };
        let preference = self.preference()?;
        let method = MonteCarlo {
            shapes: &[],
            specimen: &request.specimen,
            rule: self.rule(),
            maximize,
            to_jamming: run.to_jamming.map(|to| monte_carlo::ToJamming { within: to.within }),
            initial_scale: None,
            swap: true,
            limits: monte_carlo::Limits { time_s: stop.time_s, sweeps: stop.sweeps },
            orientation: &|rng| draw_orientation(&orientation, rng),
            seed: request.seed,
            preference: preference.as_ref(),
            keep_checkpoint: Some(&|write| control.keep_checkpoint(&Checkpoint::new(request, write))),
            keeps_partial: request.on_limit == OnLimit::Keep,
        };
        let distance_mm_asked = distance_asked_mm(request);
        let body = resume.map(|resume| resume.body.as_slice());
        let ran = method.run_with_own(self.shapes, body, control);
        let (outcome, shapes) = ran.map_err(|interrupted| match interrupted {
            Interrupted::Stopped => stopped(number, number),
            Interrupted::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
            Interrupted::NoStart => not_grown(GrowthStopped {
                grains: number as u64,
                volume_fraction_reached: 0.0,
                volume_fraction_asked,
                distance_mm_reached: None,
                distance_mm_asked,
                scale_reached: 0.0,
                effort: GrowthEffort::Cycles { cycles: 0, moves: 0 },
                end: GrowthEnd::NoStart,
                amount: run.amount(),
            }),
        })?;
        let end = growth_end(outcome.end);
        let counted = outcome.statistics;
        let short = run.is_short(outcome.scale, end).then(|| {
            let failure = TargetNotReached::GrowthStopped(GrowthStopped {
                grains: number as u64,
                volume_fraction_reached: outcome.volume_fraction,
                volume_fraction_asked,
                distance_mm_reached: outcome.gap_mm,
                distance_mm_asked,
                scale_reached: outcome.scale,
                effort: GrowthEffort::Cycles { cycles: counted.cycles, moves: counted.moves_tried },
                end,
                amount: run.amount(),
            });
            Short::new(run.kept_reason(end, control), failure)
        });
        let short = short.transpose()?;
        let growth_curve = outcome.growth_curve.iter().map(|point| GrowthPoint {
            packing_time_s: point.packing_time_s,
            simulated_time_s: None,
            events: point.moves,
            volume_fraction: point.volume_fraction,
            distance_mm: point.gap_mm,
            reduced_pressure: None,
        });
        let placed = Placed {
            growth_curve: growth_curve.collect(),
            statistics: Statistics {
                rsa: Some(outcome.rsa),
                monte_carlo: Some(MonteCarloStatistics {
                    compression_cycles: counted.cycles,
                    sweeps: counted.sweeps,
                    moves_tried: counted.moves_tried,
                    moves_accepted: counted.moves_accepted,
                    pushes: counted.pushes,
                    swaps_tried: counted.swaps_tried,
                    swaps_accepted: counted.swaps_accepted,
                    list_rebuilds: counted.list_builds,
                    expansions: counted.expansions,
                    resumes: counted.resumes,
                    growth_scale: outcome.scale,
                    stop: end,
                }),
                ..Statistics::default()
            },
            distance_mm: outcome.gap_mm.filter(|_| maximize.is_some()),
            rsa_s: outcome.rsa_s,
            growth_s: Some(outcome.growth_s),
            method_used: MethodUsed::MonteCarlo,
            scale: outcome.scale,
            short,
            grains: poses_alone(outcome.poses),
        };
        Ok((placed, shapes))
    }
}

fn growth_end(end: monte_carlo::End) -> GrowthEnd {
    match end {
        monte_carlo::End::Target => GrowthEnd::Target,
        monte_carlo::End::Stalled => GrowthEnd::Stalled,
        monte_carlo::End::TimeLimit => GrowthEnd::TimeLimit,
        monte_carlo::End::SweepLimit => GrowthEnd::SweepLimit,
        monte_carlo::End::Finished => GrowthEnd::Finished,
    }
}
