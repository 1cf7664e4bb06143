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
mod state;
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
use crate::methods::rsa::{self, Rsa};
use crate::mix::sphere_volume;
use crate::packing::{EdmdStatistics, GrowthEnd, GrowthPoint, RsaStatistics};
use crate::request::{Distance, EdmdOptions, PackingRequest};
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
/// Attempts per grain of the random placing that growth starts from.
const START_ATTEMPTS: u64 = 20_000;
/// A start that finds no place for a grain is tried again at this share of its size.
const SMALLER_START: f64 = 0.97;
/// Memory of a grain with its lists and events, in bytes.
const BYTES_PER_GRAIN: usize = 300;
/// Starts that are tried.
const STARTS: u32 = 60;

/// What a run of growth is expected to take, from the model of `docs/estimates.md`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Expected {
    /// Volume fraction, coating included, up to which random placing is cheaper than growth.
    pub(crate) start_fraction: f64,
    /// Work of the random placing, in events per grain.
    pub(crate) start_work: f64,
    /// Events per grain that growth from there to the target takes.
    pub(crate) events_per_grain: f64,
}

/// Growth beyond the requested size, as far as it goes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ToJamming {
    /// Ends as soon as it is known that the grains will jam at a scale outside of these bounds.
    pub(crate) within: Option<[f64; 2]>,
}

/// What growth is asked for.
pub(crate) struct Edmd<'a> {
    pub(crate) request: &'a PackingRequest,
    pub(crate) options: EdmdOptions,
    /// Diameters from the largest down, in mm.
    pub(crate) diameters_mm: &'a [f64],
    pub(crate) expected: Expected,
    /// Most threads; the outcome does not depend on their number.
    pub(crate) threads: NonZeroUsize,
    /// Grows the grains beyond their size, until they jam.
    pub(crate) to_jamming: Option<ToJamming>,
}

/// Why it came to no end of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Interrupted {
    /// The control said so.
    Stopped,
    /// The system refused memory.
    OutOfMemory { bytes: u64 },
    /// Random addition found no start, at any of ever smaller sizes.
    NoStart,
}

impl From<OutOfMemory> for Interrupted {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// How it ended.
pub(crate) struct Outcome {
    /// Centres in the order of the diameters; of the first of them alone where the run was to finish while random
    /// placing had not placed all.
    pub(crate) centers_mm: Vec<[f64; 3]>,
    pub(crate) rsa: RsaStatistics,
    pub(crate) statistics: EdmdStatistics,
    /// Constant distance reached, where one was asked for.
    pub(crate) distance_mm: Option<f64>,
    pub(crate) volume_fraction: f64,
    pub(crate) growth_curve: Vec<GrowthPoint>,
    pub(crate) rsa_s: f64,
    pub(crate) edmd_s: f64,
}

impl Edmd<'_> {
    /// Inserts and grows the grains.
    ///
    /// # Errors
    /// When the control stopped it, or the system refused memory.
    pub(crate) fn run(&self, resume: Option<Resume>, control: &dyn Control) -> Result<Outcome, Interrupted> {
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
                Start::Run(run) => *run,
                Start::Finished(outcome) => return Ok(*outcome),
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
                if ended != Ended::As(GrowthEnd::Stalled) || !run.expand(&protocols[0]) {
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
        // With the time before a checkpoint.
        let edmd_s = before_s - run.rsa_s + growing.elapsed().as_secs_f64();
        let growth_curve = std::mem::take(&mut run.curve);
        Ok(Outcome {
            centers_mm: run.centers()?,
            rsa: run.rsa,
            statistics: run.statistics(&frame, end, edmd_s),
            distance_mm: run.distance_mm(&frame),
            volume_fraction: run.volume_fraction(&frame),
            growth_curve,
            rsa_s: run.rsa_s,
            edmd_s,
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

    /// Random placing to grow from.
    fn start(
        &self,
        frame: &Frame<'_>,
        protocols: &[GrowthProtocol; 2],
        rule: &DistanceRule,
        maximize: bool,
    ) -> Result<Start, Interrupted> {
        let protocol = &protocols[0];
        let volume = self.request.specimen.volume_mm3();
        let fraction = protocol.radii_mm.iter().map(|r| sphere_volume(2.0 * r)).sum::<f64>() / volume;
        let mut rng = stream(self.request.seed, Stream::Rsa);
        let quickly = self.expected.start_fraction;
        let mut scale = match self.options.initial_scale {
            Some(scale) => scale,
            // The true diameters, where there is a place for them.
            None if maximize && fraction <= quickly => BEYOND_TARGET,
            None => cbrt(quickly / fraction).min(MOST_START),
        };
        let mut statistics = RsaStatistics::default();
        let share = start_share(&self.expected, CYCLE_EVENTS_PER_GRAIN as f64);
        let part = Part::new(frame.control, 0.0, share);
        let control = StopToFinish::new(&part);
        for _ in 0..STARTS {
            let placing = Rsa {
                diameters_mm: &collected(self.diameters_mm.iter().map(|d| scale * d))?,
                specimen: &self.request.specimen,
                rule: rule.scaled(scale),
                attempts_per_grain: Some(START_ATTEMPTS),
                preference: frame.preference.as_ref(),
                threads: self.threads,
            };
            let outcome = placing.run(&mut rng, &control);
            statistics.attempts += outcome.statistics.attempts;
            statistics.grains_by_subdivision += outcome.statistics.grains_by_subdivision;
            statistics.voxels_tested += outcome.statistics.voxels_tested;
            let rsa_s = frame.started.elapsed().as_secs_f64();
            match outcome.end {
                rsa::End::Complete => {
                    let mut run = if maximize && scale >= BEYOND_TARGET {
                        Run::new(frame, &protocols[1], Stage::Length, 0.0, &outcome.centers_mm)?
                    } else {
                        Run::new(frame, protocol, Stage::Scale, scale, &outcome.centers_mm)?
                    };
                    (run.rsa, run.rsa_s) = (statistics, rsa_s);
                    return Ok(Start::Run(Box::new(run)));
                }
                rsa::End::Stopped if control.finish().is_some() => {
                    return Ok(Start::Finished(Box::new(Outcome {
                        centers_mm: outcome.centers_mm,
                        rsa: statistics,
                        statistics: EdmdStatistics {
                            growth_scale: scale.min(1.0 - f64::EPSILON),
                            stop: GrowthEnd::Finished,
                            ..EdmdStatistics::default()
                        },
                        distance_mm: None,
                        volume_fraction: frame.moments.volume_fraction(0.0) * scale.powi(3),
                        growth_curve: Vec::new(),
                        rsa_s,
                        edmd_s: 0.0,
                    })));
                }
                rsa::End::Stopped => return Err(Interrupted::Stopped),
                rsa::End::OutOfMemory { bytes } => return Err(Interrupted::OutOfMemory { bytes }),
                rsa::End::InsertionFailed { .. } => scale *= SMALLER_START,
            }
        }
        Err(Interrupted::NoStart)
    }
}

/// What growth starts from.
enum Start {
    Run(Box<Run>),
    /// The run was to finish before all grains were placed: the end of it.
    Finished(Box<Outcome>),
}
