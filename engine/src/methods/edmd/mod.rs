//! Event-driven molecular dynamics (EDMD) of growing grains (Lubachevsky and Stillinger 1990, DOI 10.1007/BF01025983;
//! for concrete: Titscher and Unger 2015; `docs/edmd.md` explains the algorithm as built).
//!
//! Grains move on straight lines, collide elastically and grow, until they have the size and gaps that are asked for
//! or can grow no further. Near-neighbour lists bound the pairs that are looked at (Donev, Torquato and Stillinger
//! 2005, DOI 10.1016/j.jcp.2004.08.014).
//!
//! From the inside out: `contact` has the closed forms, `growth` how contact distances change in a compression cycle,
//! `container` the walls, `records` what is kept of a grain; `grid`, `skin`, `shortlist`, `system`, `lists` and `queue`
//! find and order what can happen, `scan` and `events` make it happen, `swap` exchanges grains between cycles, `blocks`
//! lets many grains collide without growth on several threads, `compression_rate` decides how fast to grow,
//! `growth_protocol` what a distance rule grows, `run` strings cycles together, and `exact_fit` ends the growth of
//! grains that fit exactly.

// The event loop is one body of code on purpose: a call per pair or event costs a tenth of the speed.
#![allow(clippy::inline_always)]
// Axes are indexed in several arrays at once.
#![allow(clippy::needless_range_loop)]

mod blocks;
mod compression_rate;
mod contact;
mod container;
mod events;
mod exact_fit;
mod fluid;
mod grid;
mod growth;
mod growth_protocol;
mod lists;
mod queue;
mod records;
mod run;
mod scan;
mod shortlist;
mod skin;
mod swap;
mod system;
#[cfg(test)]
mod tests;
mod tolerances;

use std::io;
use std::num::NonZeroUsize;
use std::time::Instant;

pub(crate) use blocks::LEAST_GRAINS as LEAST_GROWN_IN_BLOCKS;
pub use fluid::{Fluid, FluidFigures};

use crate::checkpoint::Resume;
use crate::control::{Control, Part, StopToFinish};
use crate::distance::DistanceRule;
use crate::elementary::cbrt;
use crate::memory::{self, OutOfMemory, collected};
use crate::methods::growth::{Begun, Interrupted, Outcome, START_ATTEMPTS, Started, ToJamming, start};
use crate::methods::rsa::Rsa;
use crate::mix::sphere_volume;
use crate::packing::{EdmdStatistics, GrowthEnd, Statistics};
use crate::request::{Distance, GrowthOptions, PackingRequest};
use crate::rng::{Stream, stream};
use crate::segregation::Preference;
use growth_protocol::GrowthProtocol;
use run::{CYCLE_EVENTS_PER_GRAIN, Ended, Frame, Moments, Run, Stage, start_share};
pub(crate) use system::MAX_GRAINS;
use tolerances::{BEYOND_TARGET, EXACT_FIT};

/// Components of the initial velocities are uniform in plus minus this, where the request names
/// nothing else.
pub(crate) const INITIAL_VELOCITY_MM_PER_S: f64 = 0.5;
/// Largest scale to start from where the request names none.
pub(crate) const MOST_START: f64 = 0.97;
/// A start that finds no place for a grain is tried again at this share of its size.
const SMALLER_START: f64 = 0.97;
/// Memory of a grain with its lists and events, in bytes.
const BYTES_PER_GRAIN: usize = 300;

/// What a run of growth is expected to take, from the model of `docs/estimates.md`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Expected {
    /// Volume fraction, coating included, up to which random addition is cheaper than growth.
    pub(crate) start_fraction: f64,
    /// Work of the random addition, in events per grain.
    pub(crate) start_work: f64,
    /// Events per grain that growth from there to the target takes.
    pub(crate) events_per_grain: f64,
}

/// What growth is asked for.
pub(crate) struct Edmd<'a> {
    pub(crate) request: &'a PackingRequest,
    pub(crate) options: GrowthOptions,
    /// Diameters from the largest down, in mm.
    pub(crate) diameters_mm: &'a [f64],
    pub(crate) expected: Expected,
    /// Most threads; the outcome does not depend on their number.
    pub(crate) threads: NonZeroUsize,
    /// Grows the grains beyond their size, until they jam.
    pub(crate) to_jamming: Option<ToJamming>,
}

impl Edmd<'_> {
    /// Inserts and grows the grains.
    ///
    /// # Errors
    /// When the control stopped it, or the system refused memory.
    pub(crate) fn run(
        &self,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Outcome<Vec<[f64; 3]>>, Interrupted> {
        memory::probe(BYTES_PER_GRAIN.saturating_mul(self.diameters_mm.len()))?;
        let frame = Frame {
            request: self.request,
            options: self.options,
            diameters_mm: self.diameters_mm,
            control,
            expected: self.expected,
            preference: Preference::new(self.request, self.diameters_mm),
            threads: self.threads,
            to_jamming: self.to_jamming,
            moments: Moments::new(self.diameters_mm, self.request.specimen.volume_mm3()),
            started: Instant::now(),
        };
        let distance = &self.request.distance;
        let rule = DistanceRule::new(distance, &self.request.specimen);
        let maximize = match *distance {
            Distance::Maximize { wall_gap_mm } => Some(wall_gap_mm),
            _ => None,
        };
        let protocols = [
            GrowthProtocol::scaled(self.diameters_mm, &rule),
            GrowthProtocol::lengthened(self.diameters_mm, maximize.flatten()),
        ];
        let earlier = match resume.map(|resume| Run::read(&frame, &protocols, &resume.body)) {
            Some(Err(error)) if error.kind() == io::ErrorKind::OutOfMemory => {
                return Err(Interrupted::OutOfMemory {
                    bytes: (BYTES_PER_GRAIN * self.diameters_mm.len()) as u64,
                });
            }
            read => read.and_then(Result::ok),
        };
        let mut run = if let Some(run) = earlier {
            run
        } else {
            match self.start(&frame, &protocols, &rule, maximize.is_some())? {
                Begun::Run(run) => *run,
                Begun::Finished(outcome) => return Ok(*outcome),
            }
        };
        let before_s = run.elapsed_s(&frame);
        let growing = Instant::now();
        let mut ended = Ended::As(GrowthEnd::Target);
        if run.stage == Stage::Scale {
            loop {
                ended = run.grow(&frame, &protocols[0]);
                if frame.to_jamming.is_some() {
                    break;
                }
                if matches!(ended, Ended::As(_)) && self.settle_exactly(&mut run, &protocols[0], &rule)? {
                    ended = Ended::As(GrowthEnd::Target);
                }
                let is_stalled = ended == Ended::As(GrowthEnd::Stalled);
                if !is_stalled || !(run.expand(&protocols[0]) || run.grow_again(&frame, &protocols[0])?) {
                    break;
                }
            }
            if maximize.is_some() && ended == Ended::As(GrowthEnd::Target) {
                run.lengthen(&frame, &protocols[1]);
            }
        }
        if run.stage == Stage::Length {
            ended = run.grow(&frame, &protocols[1]);
        }
        let end = match ended {
            Ended::As(end) => end,
            Ended::Stopped => return Err(Interrupted::Stopped),
            Ended::OutOfMemory(refused) => return Err(refused.into()),
        };
        run.keep_last(&frame, end);
        run.go_back(&protocols[0]);
        // With the time before a checkpoint.
        let edmd_s = before_s - run.rsa_s + growing.elapsed().as_secs_f64();
        let counted = run.statistics(&frame, end, edmd_s);
        Ok(Outcome {
            placed: run.centers()?,
            end,
            scale: counted.growth_scale,
            distance_mm: run.distance_mm(&frame),
            volume_fraction: run.volume_fraction(&frame),
            statistics: Statistics { rsa: Some(run.rsa), edmd: Some(counted), ..Statistics::default() },
            rsa_s: run.rsa_s,
            growth_s: edmd_s,
            growth_curve: run.curve.into_points(),
        })
    }

    /// Lets grains that jammed just before their target settle where they fit exactly; says whether they do.
    fn settle_exactly(
        &self,
        run: &mut Run,
        protocol: &GrowthProtocol,
        rule: &DistanceRule,
    ) -> Result<bool, OutOfMemory> {
        if run.size >= BEYOND_TARGET || run.size < 1.0 - EXACT_FIT {
            return Ok(false);
        }
        let settled = exact_fit::settle(&run.centers()?, self.diameters_mm, &self.request.specimen, rule);
        if let Some(centers) = &settled {
            run.settle(protocol, centers);
        }
        Ok(settled.is_some())
    }

    /// Random addition to grow from.
    fn start(
        &self,
        frame: &Frame<'_>,
        protocols: &[GrowthProtocol; 2],
        rule: &DistanceRule,
        maximize: bool,
    ) -> Result<Begun<Run, Vec<[f64; 3]>>, Interrupted> {
        let protocol = &protocols[0];
        let volume = self.request.specimen.volume_mm3();
        let fraction = protocol.radii_mm.iter().map(|r| sphere_volume(2.0 * r)).sum::<f64>() / volume;
        let mut rng = stream(self.request.seed, Stream::Rsa);
        let quickly = self.expected.start_fraction;
        let scale = match self.options.initial_scale {
            Some(scale) => scale,
            // The true diameters, where there is a place for them.
            None if maximize && fraction <= quickly => BEYOND_TARGET,
            None => cbrt(quickly / fraction).min(MOST_START),
        };
        let share = start_share(&self.expected, CYCLE_EVENTS_PER_GRAIN as f64);
        let part = Part::new(frame.control, 0.0, share);
        let control = StopToFinish::new(&part);
        let started = start(scale, SMALLER_START, &control, |scale| {
            let addition = Rsa {
                diameters_mm: &collected(self.diameters_mm.iter().map(|d| scale * d))?,
                domain: self.request.specimen.domain(),
                rule: rule.scaled(scale),
                attempts_per_grain: Some(START_ATTEMPTS),
                preference: frame.preference.as_ref(),
                threads: self.threads,
            };
            Ok(addition.run(&mut rng, &control))
        })?;
        let rsa_s = frame.started.elapsed().as_secs_f64();
        if !started.is_complete {
            let volume_fraction = frame.moments.volume_fraction(0.0);
            return Ok(Begun::Finished(Box::new(Outcome::unfinished(
                started,
                volume_fraction,
                rsa_s,
                |rsa, growth_scale| Statistics {
                    rsa: Some(rsa),
                    edmd: Some(EdmdStatistics {
                        growth_scale,
                        stop: GrowthEnd::Finished,
                        ..EdmdStatistics::default()
                    }),
                    ..Statistics::default()
                },
            ))));
        }
        let Started { placed, scale, statistics, .. } = started;
        let mut run = if maximize && scale >= BEYOND_TARGET {
            Run::new(frame, &protocols[1], Stage::Length, 0.0, &placed)?
        } else {
            Run::new(frame, protocol, Stage::Scale, scale, &placed)?
        };
        (run.rsa, run.rsa_s) = (statistics, rsa_s);
        Ok(Begun::Run(Box::new(run)))
    }
}
