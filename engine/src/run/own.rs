//! Packings of grains and domains of one's own, which requests do not name: [`pack_with`].
//!
//! The methods ask a grain for [`ConvexShape`] and [`Turned`](crate::gap::grain::Turned), and a domain for its faces.
//! The check asks for [`check::Body`] and [`check::Region`], which whoever makes a kind writes a second time: nothing
//! that the methods computed is believed.
//! `engine/tests/own_kinds.rs` is a whole example: capsules in a hexagonal prism.

use std::io::Write;
use std::num::NonZeroUsize;

use thiserror::Error;

use crate::check::{self, Body, Fault, Gaps, Region};
use crate::control::Control;
use crate::distance::DistanceRule;
use crate::domain::Domain;
use crate::export::{ExportError, Writes};
use crate::gap::grain::ConvexShape;
use crate::memory::OutOfMemory;
use crate::methods::addition::End;
use crate::methods::growth::Interrupted;
use crate::methods::monte_carlo::{self, MonteCarlo};
use crate::methods::rsa_shapes::{AttemptsIn, MOST_DRAWS, Orientation, ShapeRsa};
use crate::packing::{GrowthEnd, MethodUsed};
use crate::plan::Limits;
use crate::request::{Distance, GrowthOptions, Method};
use crate::rng::{Stream, stream};
use crate::shape::Pose;

/// What [`pack_with`] packs.
pub struct OwnMix<'a, G> {
    /// The grains by diameter of equal volume, from the largest down.
    pub shapes: &'a [G],
    /// Where they go.
    pub domain: &'a Domain,
    /// The gaps that they keep. The largest distance cannot be asked for.
    pub distance: Distance,
    /// [`Method::Rsa`], [`Method::Growth`] or [`Method::MonteCarlo`]; with [`Method::Auto`] the first, and where it
    /// fails the second.
    pub method: Method,
    /// Draws orientations; [`uniform_orientation`](crate::mix::uniform_orientation) prefers none.
    pub orientation: &'a Orientation<'a>,
    /// What decides all that is random.
    pub seed: u64,
}

/// Grains in their places that have passed the check.
#[derive(Clone, Debug)]
pub struct OwnPacking<'a, G> {
    /// The grains.
    pub shapes: &'a [G],
    /// Where they are, in the same order.
    pub poses: Vec<Pose>,
    /// What they lie in.
    pub domain: &'a Domain,
    /// The smallest gaps that the check found.
    pub gaps: Gaps,
    /// Which method placed them.
    pub method_used: MethodUsed,
}

/// Why [`pack_with`] made no packing.
#[derive(Debug, Error)]
pub enum OwnError {
    /// A grain is larger than the one before it.
    #[error(
        "grain {grain} is larger than the one before it: must be in the order of their volume, largest first"
    )]
    Order {
        /// Row of the grain.
        grain: usize,
    },
    /// More grains than can be named beside their images.
    #[error("{grains} grains: must be at most {most} in this domain")]
    TooMany {
        /// Number of the grains.
        grains: usize,
        /// Most grains.
        most: u64,
    },
    /// The method or the distance is none of those that grains of any kind have.
    #[error("{0}")]
    NotOffered(&'static str),
    /// Random addition found no place for a grain.
    #[error("found no place for grain {placed}, after {attempts} attempts")]
    NoPlace {
        /// Grains that are placed, which is the row of the one that is not.
        placed: usize,
        /// Attempts spent on it.
        attempts: u64,
    },
    /// Growth ended before the grains had their size.
    #[error("growth ended at {scale} of the size: {end:?}")]
    NotGrown {
        /// Size reached over that asked for; 0 where random addition found no start.
        scale: f64,
        /// Why it ended.
        end: GrowthEnd,
    },
    /// The control asked to stop.
    #[error("stopped on request")]
    Stopped,
    /// The system refused memory.
    #[error("out of memory: {} MB more are needed", .bytes.div_ceil(1_000_000))]
    OutOfMemory {
        /// Bytes of the allocation that was refused.
        bytes: u64,
    },
    /// The packing did not pass the check.
    #[error("the packing failed its check: {0}")]
    Check(#[from] Fault),
    /// The packing could not be written.
    #[error("the packing could not be written: {0}")]
    Export(#[from] ExportError),
}

impl From<OutOfMemory> for OwnError {
    fn from(OutOfMemory { bytes }: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes }
    }
}

/// Packs grains of any convex kind in any domain, checks the packing with the bodies and the region that the caller
/// makes of them, and writes it.
///
/// # Errors
/// See [`OwnError`]; a packing that fails the check is neither returned nor written.
pub fn pack_with<'a, G, R, B, E>(
    mix: &OwnMix<'a, G>,
    (region, body): (R, impl Fn(&G, &Pose) -> B),
    (export, out): (&E, &mut dyn Write),
    limits: &Limits,
    control: &dyn Control,
) -> Result<(OwnPacking<'a, G>, E::Report), OwnError>
where
    G: ConvexShape,
    R: Region,
    B: Body<R> + Clone,
    E: Writes<OwnPacking<'a, G>>,
{
    let rule = DistanceRule::new(&mix.distance, mix.domain);
    accept(mix, &rule)?;
    let (poses, method_used) = place(mix, rule, limits.threads, control)?;
    let bodies: Vec<B> = mix.shapes.iter().zip(&poses).map(|(shape, pose)| body(shape, pose)).collect();
    let gaps = check::check_bodies(&bodies, region, mix.distance, limits.threads, control)?;
    let packing = OwnPacking { shapes: mix.shapes, poses, domain: mix.domain, gaps, method_used };
    let report = export.write(&packing, limits, control, out)?;
    Ok((packing, report))
}

fn accept<G: ConvexShape>(mix: &OwnMix<'_, G>, rule: &DistanceRule) -> Result<(), OwnError> {
    if matches!(mix.distance, Distance::Maximize { .. }) {
        return Err(OwnError::NotOffered("a largest distance is offered by requests alone"));
    }
    if matches!(mix.method, Method::Edmd { .. }) {
        return Err(OwnError::NotOffered("growth by events is offered to spheres alone"));
    }
    let d_mm = |grain: usize| mix.shapes[grain].equivalent_diameter_mm();
    if let Some(grain) = (1..mix.shapes.len()).find(|&grain| d_mm(grain) > d_mm(grain - 1)) {
        return Err(OwnError::Order { grain });
    }
    let most = monte_carlo::most_grains(mix.shapes, mix.domain, rule);
    let grains = mix.shapes.len();
    if grains as u64 > most { Err(OwnError::TooMany { grains, most }) } else { Ok(()) }
}

fn place<G: ConvexShape>(
    mix: &OwnMix<'_, G>,
    rule: DistanceRule,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<(Vec<Pose>, MethodUsed), OwnError> {
    match mix.method {
        Method::Rsa { attempts_per_grain } => {
            insert(mix, rule, attempts_per_grain, threads, control).map(|poses| (poses, MethodUsed::Rsa))
        }
        Method::Auto {} => match insert(mix, rule, None, threads, control) {
            Err(OwnError::NoPlace { .. }) => grow(mix, rule, &GrowthOptions::default(), threads, control)
                .map(|poses| (poses, MethodUsed::RsaThenMonteCarlo)),
            inserted => inserted.map(|poses| (poses, MethodUsed::Rsa)),
        },
        Method::Growth { options } | Method::MonteCarlo { options } | Method::Edmd { options } => {
            grow(mix, rule, &options, threads, control).map(|poses| (poses, MethodUsed::MonteCarlo))
        }
    }
}

fn insert<G: ConvexShape>(
    mix: &OwnMix<'_, G>,
    rule: DistanceRule,
    attempts_per_grain: Option<u64>,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Vec<Pose>, OwnError> {
    let rsa = ShapeRsa {
        shapes: mix.shapes,
        domain: *mix.domain,
        rule,
        attempts_per_grain,
        attempts_in: AttemptsIn::Specimen,
        threads,
        orientation: mix.orientation,
    };
    let outcome = rsa.run_with(None, None, MOST_DRAWS, &mut stream(mix.seed, Stream::Rsa), control);
    match outcome.end {
        End::Complete => Ok(outcome.placed),
        End::InsertionFailed { attempts, .. } => {
            Err(OwnError::NoPlace { placed: outcome.placed.len(), attempts })
        }
        End::Stopped => Err(OwnError::Stopped),
        End::OutOfMemory { bytes } => Err(OwnError::OutOfMemory { bytes }),
    }
}

fn grow<G: ConvexShape>(
    mix: &OwnMix<'_, G>,
    rule: DistanceRule,
    options: &GrowthOptions,
    threads: NonZeroUsize,
    control: &dyn Control,
) -> Result<Vec<Pose>, OwnError> {
    let method = MonteCarlo {
        shapes: mix.shapes,
        domain: *mix.domain,
        rule,
        maximize: None,
        to_jamming: None,
        initial_scale: options.initial_scale,
        swap: options.swap != Some(false),
        stop: options.stop,
        orientation: mix.orientation,
        seed: mix.seed,
        preference: None,
        keep_checkpoint: None,
        keeps_partial: false,
        threads,
        target_share: monte_carlo::USUAL_TARGET_SHARE,
    };
    let outcome = method.run(None, control).map_err(|interrupted| match interrupted {
        Interrupted::Stopped => OwnError::Stopped,
        Interrupted::OutOfMemory { bytes } => OwnError::OutOfMemory { bytes },
        Interrupted::NoStart => OwnError::NotGrown { scale: 0.0, end: GrowthEnd::NoStart },
    })?;
    if outcome.scale < 1.0 {
        return Err(OwnError::NotGrown { scale: outcome.scale, end: outcome.end });
    }
    Ok(outcome.placed)
}
