//! Shaped grains of a run, which are inserted at random, or grow by moves.

use super::job::{Job, place as place_job};
use super::{Growing, Placed};
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, StopToFinish};
use crate::distance::DistanceRule;
use crate::error::{PackError, PlanError};
use crate::gap::grain::ConvexShape;
use crate::memory::{OutOfMemory, collected, reserved};
use crate::methods::addition;
use crate::methods::growth::{Interrupted, Outcome};
use crate::methods::monte_carlo::{self, MonteCarlo};
use crate::methods::rsa_shapes::{self, AttemptsIn, MOST_DRAWS, MOST_DRAWS_BEFORE_GROWTH, ShapeRsa};
use crate::mix::{GradedMix, draw_orientation};
use crate::packing::{Grains, Solids};
use crate::request::{Distance, FieldError, GrowthBy, GrowthOptions, OnLimit, PackingRequest};
use crate::rng::{Stream, stream};
use crate::segregation::Preference;
use crate::shape::{Pose, Solid};

/// Grains whose shapes are drawn.
struct ShapeJob<'a, S> {
    run: Growing<'a>,
    mix: &'a GradedMix,
    /// By equivalent diameter from the largest down; none while they grow.
    shapes: Vec<S>,
}

/// Packs shaped grains by the method of the request, from a checkpoint where there is one.
///
/// # Errors
/// See [`PackError`].
pub(super) fn place(
    run: &Growing<'_>,
    mix: &GradedMix,
    mut solids: Solids,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    // Ellipsoids alone are worth a method of their own, which has no kinds to tell apart.
    if !solids.kind().has_templates() {
        let mut shapes = reserved(solids.len())?;
        shapes.extend(solids.shapes.iter().filter_map(Solid::ellipsoid).copied());
        // The shapes are not stored twice.
        solids.shapes = Vec::new();
        let mut job = ShapeJob { run: *run, mix, shapes };
        let placed = place_shapes(&mut job, resume, control)?;
        solids.shapes = collected(job.shapes.into_iter().map(Solid::from))?;
        return Ok(with_shapes(placed, solids));
    }
    let shapes = collected((0..solids.len()).map(|grain| solids.shape(grain)))?;
    let placed = place_shapes(&mut ShapeJob { run: *run, mix, shapes }, resume, control)?;
    Ok(with_shapes(placed, solids))
}

/// What was placed by its poses alone, with the shapes, templates and aggregates of the grains: of the first of them,
/// where not all were placed.
fn with_shapes(placed: Placed, mut solids: Solids) -> Placed {
    solids.poses = placed.grains.into_solids().map_or_else(|_| Vec::new(), |of| of.poses);
    solids.shapes.truncate(solids.poses.len());
    solids.aggregate.truncate(solids.poses.len());
    Placed { grains: solids.into(), ..placed }
}

/// Places the shapes of a job, by their poses alone.
fn place_shapes<S: ConvexShape>(
    job: &mut ShapeJob<'_, S>,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    check_number(job.run.request, &job.shapes, job.mix.list.is_some())?;
    place_job(job, resume, control)
}

/// Draws for one grain; `is_alone` where no growth follows a failure.
fn most_draws(is_alone: bool) -> u64 {
    if is_alone { MOST_DRAWS } else { MOST_DRAWS_BEFORE_GROWTH }
}

/// Refuses more grains than can be named beside their images.
fn check_number<S: ConvexShape>(
    request: &PackingRequest,
    shapes: &[S],
    is_list: bool,
) -> Result<(), PackError> {
    let rule = DistanceRule::new(&request.distance, &request.specimen);
    let most = monte_carlo::most_grains(shapes, &request.specimen.domain(), &rule);
    if shapes.len() as u64 <= most {
        return Ok(());
    }
    let pointer = if is_list { "/mix/grading/diameters_mm" } else { "/mix/d_min_mm" };
    let detail = format!(
        "the mix has {} grains, some of which are longer than an edge of the periodic box: must be at most {most}, for \
         there are many images of each",
        shapes.len()
    );
    Err(PlanError::TooLarge(FieldError { pointer: pointer.into(), detail }).into())
}

/// The gradient of a request for grains of these shapes, where it has one.
fn preference<S: ConvexShape>(
    request: &PackingRequest,
    shapes: &[S],
) -> Result<Option<Preference>, OutOfMemory> {
    if request.segregation.is_none() {
        return Ok(None);
    }
    let diameters = collected(shapes.iter().map(ConvexShape::equivalent_diameter_mm))?;
    Ok(Preference::new(request, &diameters))
}

/// Grows grains of any shape by moves, and gives their shapes back.
///
/// # Errors
/// As [`Interrupted`] says.
pub(super) fn grown_by_moves<S: ConvexShape>(
    run: &Growing<'_>,
    shapes: Vec<S>,
    options: &GrowthOptions,
    resume: Option<&Resume>,
    control: &dyn Control,
) -> Result<(Outcome<Vec<Pose>>, Vec<S>), Interrupted> {
    let request = run.request;
    let orientation = request.mix.orientation;
    let preference = preference(request, &shapes)?;
    let method = MonteCarlo {
        shapes: &[],
        domain: request.specimen.domain(),
        rule: DistanceRule::new(&request.distance, &request.specimen),
        maximize: match request.distance {
            Distance::Maximize { wall_gap_mm } => Some(wall_gap_mm),
            _ => None,
        },
        to_jamming: run.to_jamming,
        initial_scale: options.initial_scale,
        swap: options.swap != Some(false),
        stop: options.stop,
        orientation: &|rng| draw_orientation(&orientation, rng),
        seed: request.seed,
        preference: preference.as_ref(),
        keep_checkpoint: Some(&|write| control.keep_checkpoint(&Checkpoint::new(request, write))),
        keeps_partial: request.on_limit == OnLimit::Keep,
        threads: run.threads,
        target_share: run.plan.target_share_of_moves,
    };
    method.run_with_own(shapes, resume.map(|resume| resume.body.as_slice()), control)
}

impl<'a, S: ConvexShape> Job<'a> for ShapeJob<'a, S> {
    type Place = Pose;

    fn run(&self) -> Growing<'a> {
        self.run
    }

    fn mix(&self) -> &GradedMix {
        self.mix
    }

    fn specimen_mm3(&self) -> f64 {
        self.mix.specimen_volume_mm3
    }

    fn len(&self) -> usize {
        self.shapes.len()
    }

    fn volume_mm3(&self) -> f64 {
        self.shapes.iter().map(ConvexShape::volume_mm3).sum()
    }

    fn diameter_mm(&self, rank: usize) -> f64 {
        self.shapes[rank].equivalent_diameter_mm()
    }

    fn insert(
        &self,
        attempts_per_grain: Option<u64>,
        is_alone: bool,
        control: &StopToFinish<'_>,
    ) -> Result<addition::Outcome<Pose>, OutOfMemory> {
        let request = self.run.request;
        let orientation = request.mix.orientation;
        let rsa = ShapeRsa {
            shapes: &self.shapes,
            domain: request.specimen.domain(),
            rule: DistanceRule::new(&request.distance, &request.specimen),
            attempts_per_grain,
            attempts_in: AttemptsIn::Specimen,
            threads: self.run.threads,
            orientation: &|rng| draw_orientation(&orientation, rng),
        };
        let preference = preference(request, &self.shapes)?;
        let most_draws = most_draws(is_alone);
        let mut rng = stream(request.seed, Stream::Rsa);
        Ok(rsa.run_with(None, preference.as_ref(), most_draws, &mut rng, control))
    }

    fn most_looks(&self, attempts_per_grain: Option<u64>, is_alone: bool) -> f64 {
        let most = attempts_per_grain.unwrap_or_else(|| most_draws(is_alone));
        most as f64 / rsa_shapes::DRAWS_PER_LOOK as f64
    }

    fn grow(
        &mut self,
        options: &GrowthOptions,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Outcome<Vec<Pose>>, Interrupted> {
        let shapes = std::mem::take(&mut self.shapes);
        let (outcome, shapes) = grown_by_moves(&self.run, shapes, options, resume.as_ref(), control)?;
        self.shapes = shapes;
        Ok(outcome)
    }

    /// By their poses alone.
    fn grains(&self, poses: Vec<Pose>) -> Result<Grains, OutOfMemory> {
        Ok(Solids { poses, ..Solids::default() }.into())
    }

    fn by(&self) -> GrowthBy {
        GrowthBy::Moves
    }
}
