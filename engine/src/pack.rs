//! One run from request to checked packing: size sampling, packing, check.

use std::time::Instant;

use crate::analysis::separation;
use crate::check;
use crate::checkpoint::Resume;
use crate::control::{Control, Part, Phase, Progress};
use crate::distance::DistanceRule;
use crate::error::{GrowthStopped, InsertionFailed, PackError, PlanError, TargetNotReached};
use crate::memory::{self, OutOfMemory, collected};
use crate::methods::edmd::{Edmd, Interrupted};
use crate::methods::rsa::{End, Rsa};
use crate::mix::{GradedMix, deviation, sampling::sample, sphere_volume};
use crate::packing::{
    Grains, GrowthPoint, MethodUsed, Packing, Report, Spheres, Statistics, Summary, Timings,
};
use crate::plan::{Limits, Plan, mix_warnings};
use crate::request::{Distance, EdmdOptions, Method, PackingRequest, Segregation};
use crate::rng::{Stream, stream};
use crate::segregation::Preference;

/// Share of a run's work that sampling and packing take; the rest is the check.
const PACKING_SHARE: f64 = 0.98;
/// Random sequential addition takes time as this power of the share of grains inserted: the last ones, small and in a
/// crowded specimen, take longest.
const RSA_TIME_EXPONENT: f64 = 1.5;
/// Memory that the statistics of a gradient take for a grain, in bytes.
const SEPARATION_BYTES_PER_GRAIN: usize = 64;

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
    let mut sampling_rng = stream(request.seed, Stream::Sampling);
    let diameters = sample(&mix, &mut sampling_rng, &|| control.should_stop())?;
    let coarse = deviation::judge_total(&request.mix, &mix, &diameters).map_err(PlanError::Coarse)?;
    let sampling_s = start.elapsed().as_secs_f64();

    let job = Job {
        request,
        mix: &mix,
        diameters: &diameters,
        growth_events_per_grain: plan.growth_events_per_grain,
    };
    let share = Part::new(control, 0.0, PACKING_SHARE);
    let placed = match route(request, &plan) {
        // A checkpoint shows that growth had begun.
        Route::RsaThenEdmd if resume.is_none() => match job.place(None, &share) {
            Err(PackError::TargetNotReached(_)) => {
                let rest = Part::new(control, share.reached(), PACKING_SHARE);
                job.grow(EdmdOptions::default(), None, &rest).map(Placed::after_rsa)
            }
            other => other,
        },
        Route::RsaThenEdmd => job.grow(EdmdOptions::default(), resume, &share).map(Placed::after_rsa),
        Route::Rsa { attempts_per_grain } => job.place(attempts_per_grain, &share),
        Route::Edmd(options) => job.grow(options, resume, &share),
    }?;

    let grains = diameters.len() as u64;
    let spheres = columns(&placed.centers_mm, diameters)?;
    // What was found to be the largest distance is checked like one asked for.
    let mut checked = request.clone();
    if let (Distance::Maximize { wall_gap_mm }, Some(mm)) = (request.distance, placed.distance_mm) {
        checked.distance = Distance::Constant { gap_mm: mm, wall_gap_mm };
    }
    let checking = Instant::now();
    let share = Part::new(control, PACKING_SHARE, 1.0);
    let check = check::check_with(&spheres, &checked, &share).map_err(|fault| match fault {
        check::Fault::Stopped => PackError::Stopped { placed: grains, grains },
        check::Fault::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        fault => PackError::CheckFailed(fault.to_string()),
    })?;
    control.report(&Progress {
        phase: Phase::Check,
        fraction: 1.0,
        done: grains,
        total: grains,
        unit: "grains",
        message: "checked".into(),
        growth: None,
    });

    let rule = DistanceRule::new(&checked.distance, &checked.specimen);
    let mut warnings: Vec<String> = coarse.into_iter().collect();
    warnings.extend(mix_warnings(request, &mix));
    if mix.list.is_none() {
        warnings.extend(deviation::class_warning(&check.classes));
    }
    let summary = summary(&spheres, &mix, &rule, &placed, check.classes);
    let segregation = match &request.segregation {
        Segregation::Gradient { field, .. } => {
            memory::probe(SEPARATION_BYTES_PER_GRAIN.saturating_mul(spheres.len()))?;
            Some(separation(&spheres, &request.specimen, &rule, *field, request.seed))
        }
        Segregation::None {} => None,
    };
    Ok(Packing {
        grains: Grains::Spheres(spheres),
        report: Report {
            summary,
            timings_s: Timings {
                sampling: sampling_s,
                rsa: placed.rsa_s,
                edmd: placed.edmd_s,
                check: checking.elapsed().as_secs_f64(),
                total: start.elapsed().as_secs_f64(),
            },
            statistics: placed.statistics,
            check: check.found,
            warnings,
            growth_curve: placed.growth_curve,
            segregation,
        },
    })
}

/// Which methods are tried.
enum Route {
    Rsa { attempts_per_grain: Option<u64> },
    Edmd(EdmdOptions),
    RsaThenEdmd,
}

/// What `auto` amounts to: whichever will be done sooner.
fn route(request: &PackingRequest, plan: &Plan) -> Route {
    match request.method {
        Method::Rsa { attempts_per_grain } => Route::Rsa { attempts_per_grain },
        Method::Edmd { options } => Route::Edmd(options),
        Method::Auto {} if matches!(request.distance, Distance::Maximize { .. }) => {
            Route::Edmd(EdmdOptions::default())
        }
        Method::Auto {} if plan.places_first => Route::RsaThenEdmd,
        Method::Auto {} => Route::Edmd(EdmdOptions::default()),
    }
}

/// A run whose diameters are drawn.
struct Job<'a> {
    request: &'a PackingRequest,
    mix: &'a GradedMix,
    diameters: &'a [f64],
    growth_events_per_grain: f64,
}

/// Grains with their places.
struct Placed {
    centers_mm: Vec<[f64; 3]>,
    statistics: Statistics,
    /// The constant distance reached, where the largest one was asked for.
    distance_mm: Option<f64>,
    growth_curve: Vec<GrowthPoint>,
    rsa_s: f64,
    edmd_s: Option<f64>,
    method_used: MethodUsed,
}

impl Placed {
    /// Growth that followed a random sequential addition which did not reach the target.
    fn after_rsa(self) -> Self {
        Self { method_used: MethodUsed::RsaThenEdmd, ..self }
    }
}

impl Job<'_> {
    fn volume_fraction(&self, diameters: &[f64]) -> f64 {
        diameters.iter().map(|&d| sphere_volume(d)).sum::<f64>() / self.mix.specimen_volume_mm3
    }

    fn stopped(&self, placed: usize) -> PackError {
        PackError::Stopped { placed: placed as u64, grains: self.diameters.len() as u64 }
    }

    /// Random sequential addition.
    fn place(&self, attempts_per_grain: Option<u64>, control: &dyn Control) -> Result<Placed, PackError> {
        let start = Instant::now();
        let preference = Preference::new(self.request, self.diameters);
        let rsa = Rsa {
            diameters_mm: self.diameters,
            specimen: &self.request.specimen,
            rule: DistanceRule::new(&self.request.distance, &self.request.specimen),
            attempts_per_grain,
            preference: preference.as_ref(),
        };
        let control = Part::new(control, 0.0, 1.0).with_exponent(RSA_TIME_EXPONENT);
        let outcome = rsa.run(&mut stream(self.request.seed, Stream::Rsa), &control);
        let placed = outcome.centers_mm.len();
        match outcome.end {
            End::Complete => Ok(Placed {
                centers_mm: outcome.centers_mm,
                statistics: Statistics { rsa: Some(outcome.statistics), edmd: None },
                distance_mm: None,
                growth_curve: Vec::new(),
                rsa_s: start.elapsed().as_secs_f64(),
                edmd_s: None,
                method_used: MethodUsed::Rsa,
            }),
            End::Stopped => Err(self.stopped(placed)),
            End::OutOfMemory { bytes } => Err(PackError::OutOfMemory { bytes }),
            End::InsertionFailed { saturation_proven, attempts } => {
                Err(PackError::TargetNotReached(TargetNotReached::InsertionFailed(InsertionFailed {
                    placed: placed as u64,
                    grains: self.diameters.len() as u64,
                    diameter_mm: self.diameters[placed],
                    volume_fraction_reached: self.volume_fraction(&self.diameters[..placed]),
                    volume_fraction_asked: self.volume_fraction(self.diameters),
                    saturation_proven,
                    attempts,
                })))
            }
        }
    }

    /// Event-driven molecular dynamics.
    fn grow(
        &self,
        options: EdmdOptions,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Placed, PackError> {
        let edmd = Edmd {
            request: self.request,
            options,
            diameters_mm: self.diameters,
            expected_events_per_grain: self.growth_events_per_grain,
        };
        let outcome = edmd.run(resume, control).map_err(|interrupted| match interrupted {
            Interrupted::Stopped => self.stopped(self.diameters.len()),
            Interrupted::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
        })?;
        let statistics = outcome.statistics;
        let maximize = matches!(self.request.distance, Distance::Maximize { .. });
        if statistics.growth_scale < 1.0 {
            return Err(PackError::TargetNotReached(TargetNotReached::GrowthStopped(GrowthStopped {
                grains: self.diameters.len() as u64,
                volume_fraction_reached: outcome.volume_fraction,
                volume_fraction_asked: self.volume_fraction(self.diameters),
                distance_mm_reached: outcome.distance_mm,
                distance_mm_asked: match self.request.distance {
                    Distance::Constant { gap_mm: mm, .. } => Some(mm),
                    _ => None,
                },
                scale_reached: statistics.growth_scale,
                events: statistics.events,
                simulated_time_s: statistics.simulated_time_s,
                end: statistics.stop,
            })));
        }
        Ok(Placed {
            centers_mm: outcome.centers_mm,
            statistics: Statistics { rsa: Some(outcome.rsa), edmd: Some(statistics) },
            distance_mm: outcome.distance_mm.filter(|_| maximize),
            growth_curve: outcome.growth_curve,
            rsa_s: outcome.rsa_s,
            edmd_s: Some(outcome.edmd_s),
            method_used: MethodUsed::Edmd,
        })
    }
}

fn columns(centers: &[[f64; 3]], d_mm: Vec<f64>) -> Result<Spheres, OutOfMemory> {
    let column = |a: usize| collected(centers.iter().map(|p| p[a]));
    Ok(Spheres { x_mm: column(0)?, y_mm: column(1)?, z_mm: column(2)?, d_mm })
}

fn summary(
    spheres: &Spheres,
    mix: &GradedMix,
    rule: &DistanceRule,
    placed: &Placed,
    classes: Vec<crate::packing::ClassReport>,
) -> Summary {
    let total = |size: &dyn Fn(f64) -> f64| {
        spheres.d_mm.iter().map(|&d| sphere_volume(size(d))).sum::<f64>() / mix.specimen_volume_mm3
    };
    Summary {
        grains: spheres.len() as u64,
        method_used: Some(placed.method_used),
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
