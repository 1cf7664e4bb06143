//! Hard-particle Monte Carlo of growing grains of any shape: shake, swap, grow, push.
//!
//! Compression cycles carry a loose random packing to its target. In each cycle grains of similar size swap
//! positions where they fit (`swap`), every grain makes random moves that keep all gaps (`shake`), and then the
//! specimen shrinks (`scale`) onto the grains, which push each other out of the way (`push`). What the pushes leave is
//! undone in part, so that every cycle ends with a valid packing at its scale.
//!
//! From the inside out: `group` stores planes, `halves` says which grains threads may move at the same time, `system`
//! has the grains, `planes` the test that all moves share, `lists` finds the neighbours and `lay_out` lays the planes
//! between them, `descend` moves grains on several threads, and `run` strings cycles together.

// A call per pair costs more than the test of a pair.
#![allow(clippy::inline_always)]
// Axes and lanes are indexed in several arrays at once.
#![allow(clippy::needless_range_loop)]

mod descend;
mod group;
mod halves;
mod kept;
mod lay_out;
mod lists;
mod own_images;
mod planes;
mod push;
mod run;
mod scale;
mod shake;
mod swap;
mod system;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
mod window;

use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::time::Instant;

use crate::control::{Control, Part, StopToFinish};
use crate::distance::DistanceRule;
use crate::domain::Domain;
use crate::elementary::{cbrt, ln};
use crate::gap::grain::{ConvexShape, Turned};
use crate::geometry::images::Images;
use crate::methods::growth::{Begun, Interrupted, Outcome, START_ATTEMPTS, Started, ToJamming, start};
use crate::methods::image_names::ImageNames;
use crate::methods::rsa_shapes::{AttemptsIn, MOST_DRAWS, Orientation, ShapeRsa};
use crate::mix::sphere_volume;
use crate::packing::{GrowthEnd, MonteCarloStatistics, Statistics};
use crate::request::GrowthStop;
use crate::rng::{Stream, stream};
use crate::segregation::Preference;
use crate::shape::Pose;
pub use group::MAX_GRAINS;
pub(crate) use halves::LEAST_CUT;
pub(crate) use run::time_to;
use run::{MOST_SKIN_OVER_D, Run, start_share};

/// Grains grow to their target times this, so that the check, which rounds differently, finds no overlap.
const BEYOND_TARGET: f64 = 1.0 + 1e-9;
/// Volume fraction, gaps included, that growth starts from where no scale is named: what random addition reaches in no
/// time.
const START_FRACTION: f64 = 0.5;
/// The same for polyhedra.
const START_FRACTION_ANGULAR: f64 = 0.48;
/// The same for grains of one size, and how much it rises with the standard deviation of `ln d` by volume: small grains
/// fit between large ones.
const START_FRACTION_EQUAL: f64 = 0.26;
const START_FRACTION_PER_SPREAD: f64 = 0.6;
/// Volume of a grain over that of the sphere around it below which growth starts looser.
const COMPACT: f64 = 0.25;
/// Largest scale to start from without being told.
const MOST_START: f64 = 0.98;
/// A start that finds no place for a grain is tried again at this share of its size.
const SMALLER_START: f64 = 0.95;
/// Share of the run that lies before the first cycle of grains that grow until they jam, or from a named scale.
const LEAST_START_SHARE: f64 = 0.02;
/// The target over what growth reaches, where nothing is known.
pub(crate) const USUAL_TARGET_SHARE: f64 = 0.9;

/// Most grains of these shapes that can be named beside their images: [`MAX_GRAINS`], or fewer where grains are long
/// against a short edge of a periodic box.
pub(crate) fn most_grains<S: ConvexShape>(shapes: &[S], domain: &Domain, rule: &DistanceRule) -> u64 {
    let reach = |shape: &S| {
        let d = shape.equivalent_diameter_mm();
        shape.outer_mm() + MOST_SKIN_OVER_D * d + rule.gap_mm(d, d) / 2.0
    };
    let longest_mm = shapes.iter().map(reach).fold(0.0, f64::max);
    // The gap that is maximized is at most an edge, and lists hold for a little more than their time.
    let shortest_mm = domain.bounds_mm.into_iter().fold(f64::INFINITY, f64::min);
    let reach_mm = 2.1 * longest_mm + shortest_mm;
    ImageNames::most_grains(&Images::new(domain), reach_mm).min(MAX_GRAINS as u64)
}

/// What is to be packed densely.
#[derive(Clone, Copy)]
pub struct MonteCarlo<'a, S> {
    /// Grains by equivalent diameter from the largest down, [`MAX_GRAINS`] at most.
    pub shapes: &'a [S],
    /// Where they go.
    pub domain: Domain,
    /// The gaps they keep; without gaps where the largest one is requested.
    pub rule: DistanceRule,
    /// Whether, once all grains have their size, the largest constant gap is requested, and if so the gap to walls
    /// where it is not half of it.
    pub maximize: Option<Option<f64>>,
    /// Whether the grains grow beyond their size, until they jam.
    pub to_jamming: Option<ToJamming>,
    /// Share of their size that grains start with; the method chooses if absent.
    pub initial_scale: Option<f64>,
    /// Whether grains of similar size swap positions.
    pub swap: bool,
    /// When to give up.
    pub stop: GrowthStop,
    /// Draws the orientations that growth starts from.
    pub orientation: &'a Orientation<'a>,
    /// What decides all else.
    pub seed: u64,
    /// Which positions grains prefer, in the start and in swaps; `None` without a gradient.
    pub preference: Option<&'a Preference>,
    /// Keeps a checkpoint when the control wants one: it is handed what writes the body.
    pub keep_checkpoint: Option<&'a KeepCheckpoint<'a>>,
    /// Whether the packing is kept that was reached when a limit or a jam ended growth before its target, so that a
    /// last checkpoint may be wanted.
    pub keeps_partial: bool,
    /// Most threads; the outcome does not depend on their number.
    pub threads: NonZeroUsize,
    /// The target over the volume fraction that growth is expected to reach, by which progress is told.
    pub target_share: f64,
}

/// Keeps a checkpoint whose body the argument writes.
pub type KeepCheckpoint<'a> = dyn Fn(&dyn Fn(&mut dyn Write) -> io::Result<()>) + 'a;

impl<S: ConvexShape> MonteCarlo<'_, S> {
    /// Inserts and grows the grains, or goes on from the body of a checkpoint; one that is none of this request is
    /// ignored.
    ///
    /// # Errors
    /// When the control stopped it, or the system refused memory.
    pub fn run(
        &self,
        resume: Option<&[u8]>,
        control: &dyn Control,
    ) -> Result<Outcome<Vec<Pose>>, Interrupted> {
        let mut run = match self.begin(resume, control)? {
            Begun::Run(run) => run,
            Begun::Finished(outcome) => return Ok(*outcome),
        };
        let end = run.grow(self, control)?;
        run.forget_lists();
        run.outcome(self, end)
    }

    /// The same for shapes of its own, whatever `self` has, which it returns as well. They are given up while the
    /// grains grow: each grain has its shape then.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub(crate) fn run_with_own(
        self,
        shapes: Vec<S>,
        resume: Option<&[u8]>,
        control: &dyn Control,
    ) -> Result<(Outcome<Vec<Pose>>, Vec<S>), Interrupted> {
        let of = Self { shapes: &[], ..self };
        let mut run = match (MonteCarlo { shapes: &shapes, ..self }).begin(resume, control)? {
            Begun::Run(run) => run,
            Begun::Finished(outcome) => return Ok((*outcome, shapes)),
        };
        drop(shapes);
        let end = run.grow(&of, control)?;
        run.forget_lists();
        let shapes = run.shapes()?;
        Ok((run.outcome(&of, end)?, shapes))
    }

    /// The run as it begins, or as it was at a checkpoint. From here on the shapes are those of its grains.
    fn begin(
        &self,
        resume: Option<&[u8]>,
        control: &dyn Control,
    ) -> Result<Begun<Run<S>, Vec<Pose>>, Interrupted> {
        let started = Instant::now();
        let earlier = match resume.map(|body| Run::read(self, body, started)) {
            Some(Err(error)) if error.kind() == io::ErrorKind::OutOfMemory => {
                return Err(Interrupted::OutOfMemory {
                    bytes: (size_of::<Pose>() * self.shapes.len()) as u64,
                });
            }
            read => read.and_then(Result::ok),
        };
        earlier.map_or_else(|| self.start(started, control), |run| Ok(Begun::Run(Box::new(run))))
    }

    /// Random addition to grow from.
    fn start(
        &self,
        started: Instant,
        control: &dyn Control,
    ) -> Result<Begun<Run<S>, Vec<Pose>>, Interrupted> {
        let with_gap = |shape: &S| {
            let d = shape.equivalent_diameter_mm();
            sphere_volume(d + self.rule.gap_mm(d, d))
        };
        let fraction = self.shapes.iter().map(with_gap).sum::<f64>() / self.domain.volume_mm3;
        let most = if self.maximize.is_some() { BEYOND_TARGET } else { MOST_START };
        let first = start_fraction(self.shapes);
        let scale = self.initial_scale.unwrap_or(cbrt(first / fraction).min(most));
        let mut rng = stream(self.seed, Stream::Rsa);
        let part = Part::new(control, 0.0, self.start_share());
        let control = StopToFinish::new(&part);
        let begun = start(scale, SMALLER_START, &control, |scale| {
            let rsa = ShapeRsa {
                shapes: self.shapes,
                domain: self.domain,
                rule: self.rule.scaled(scale),
                attempts_per_grain: Some(START_ATTEMPTS),
                attempts_in: AttemptsIn::Reach,
                threads: self.threads,
                orientation: self.orientation,
            };
            Ok(rsa.run_with(Some(scale), self.preference, MOST_DRAWS, &mut rng, &control))
        })?;
        let rsa_s = started.elapsed().as_secs_f64();
        if !begun.is_complete {
            let volume: f64 = self.shapes.iter().map(S::volume_mm3).sum();
            let volume_fraction = volume / self.domain.volume_mm3;
            return Ok(Begun::Finished(Box::new(Outcome::unfinished(
                begun,
                volume_fraction,
                rsa_s,
                |rsa, growth_scale| Statistics {
                    rsa: Some(rsa),
                    monte_carlo: Some(MonteCarloStatistics {
                        growth_scale,
                        stop: GrowthEnd::Finished,
                        ..MonteCarloStatistics::default()
                    }),
                    ..Statistics::default()
                },
            ))));
        }
        let Started { placed, scale, statistics, .. } = begun;
        let mut run = Run::new(self, placed, scale, started)?;
        (run.rsa, run.rsa_s) = (statistics, rsa_s);
        run.fraction = self.start_share();
        Ok(Begun::Run(Box::new(run)))
    }
}

impl<S> MonteCarlo<'_, S> {
    /// Share of the run that is expected to lie before the first cycle.
    fn start_share(&self) -> f64 {
        if self.maximize.is_some() || self.to_jamming.is_some() || self.initial_scale.is_some() {
            LEAST_START_SHARE
        } else {
            start_share(self.target_share)
        }
    }
}

/// Volume fraction, gaps included, up to which random addition of these shapes takes no time: less where they have one
/// size, so that none fits between the others, and where they fill little of the spheres around them. The packings of
/// spheres keep the start that they had.
fn start_fraction<S: ConvexShape>(shapes: &[S]) -> f64 {
    if S::Turned::IS_SPHERE {
        return START_FRACTION;
    }
    let most = if S::Turned::IS_ELLIPSOID { START_FRACTION } else { START_FRACTION_ANGULAR };
    let compactness = by_volume(shapes, &|shape| shape.volume_mm3() / sphere_volume(2.0 * shape.outer_mm()));
    let by_shape = (compactness / COMPACT).min(1.0).sqrt();
    (START_FRACTION_EQUAL + START_FRACTION_PER_SPREAD * spread(shapes)).min(most) * by_shape
}

/// Standard deviation of `ln d` by volume.
fn spread<S: ConvexShape>(shapes: &[S]) -> f64 {
    let size = |shape: &S| ln(shape.equivalent_diameter_mm());
    let mean = by_volume(shapes, &size);
    by_volume(shapes, &|shape| (size(shape) - mean).powi(2)).sqrt()
}

/// A mean by volume.
fn by_volume<S: ConvexShape>(shapes: &[S], of: &dyn Fn(&S) -> f64) -> f64 {
    let volume = shapes.iter().map(S::volume_mm3).sum::<f64>();
    shapes.iter().map(|shape| shape.volume_mm3() * of(shape)).sum::<f64>() / volume
}
