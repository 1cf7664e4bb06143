//! A run whose grains are spheres: random sequential addition, event-driven molecular dynamics, or both.

use std::time::Instant;

use super::{
    Growing, PACKING_SHARE, Placed, Short, distance_asked_mm, inserted, kept_insertion, not_grown,
    not_inserted, stopped,
};
use crate::checkpoint::Resume;
use crate::control::{Control, Part, StopToFinish};
use crate::distance::DistanceRule;
use crate::error::{GrowthEffort, GrowthStopped, PackError, TargetNotReached};
use crate::memory::{OutOfMemory, collected, copied};
use crate::methods::edmd::{Edmd, Interrupted};
use crate::methods::rsa::{End, Rsa};
use crate::mix::{GradedMix, sphere_volume};
use crate::packing::{Grains, GrowthEnd, MethodUsed, Spheres, Statistics};
use crate::request::{Distance, EdmdOptions, Method};
use crate::rng::{Stream, stream};
use crate::segregation::Preference;

/// Random sequential addition takes time as this power of the share of grains inserted: the last ones, small and in a
/// crowded specimen, take longest.
pub(super) const RSA_TIME_EXPONENT: f64 = 1.5;

/// Which methods are tried.
enum Route {
    Rsa { attempts_per_grain: Option<u64> },
    Edmd(EdmdOptions),
    RsaThenEdmd,
}

/// What `auto` amounts to: whichever will be done sooner.
fn route(run: &Growing<'_>) -> Route {
    let request = run.request;
    let grows = run.to_jamming.is_some() || matches!(request.distance, Distance::Maximize { .. });
    match request.method {
        Method::Rsa { attempts_per_grain } => Route::Rsa { attempts_per_grain },
        Method::Edmd { options } => Route::Edmd(options),
        Method::Auto {} if grows => Route::Edmd(EdmdOptions::default()),
        Method::Auto {} if run.plan.places_first => Route::RsaThenEdmd,
        // Reading a request refuses hard-particle Monte Carlo for spheres.
        Method::Auto {} | Method::MonteCarlo { .. } => Route::Edmd(EdmdOptions::default()),
    }
}

/// A run whose diameters are drawn.
pub(super) struct Job<'a> {
    pub(super) run: Growing<'a>,
    pub(super) mix: &'a GradedMix,
    pub(super) diameters: &'a [f64],
    /// The aggregate of each; empty where the mix names none.
    pub(super) aggregate: &'a [u16],
}

/// Packs spheres of these diameters by the method of the request, from a checkpoint where there is one.
///
/// # Errors
/// See [`PackError`].
pub(super) fn place(
    job: &Job<'_>,
    resume: Option<Resume>,
    control: &dyn Control,
) -> Result<Placed, PackError> {
    let share = &Part::new(control, 0.0, PACKING_SHARE);
    match route(&job.run) {
        // A checkpoint shows that growth had begun.
        Route::RsaThenEdmd if resume.is_none() => match job.place(None, share) {
            Err(PackError::TargetNotReached(_)) => {
                let rest = Part::new(control, share.reached(), PACKING_SHARE);
                job.grow(EdmdOptions::default(), None, &rest).map(Placed::after_rsa)
            }
            other => other,
        },
        Route::RsaThenEdmd => job.grow(EdmdOptions::default(), resume, share).map(Placed::after_rsa),
        Route::Rsa { attempts_per_grain } => job.place(attempts_per_grain, share),
        Route::Edmd(options) => job.grow(options, resume, share),
    }
}

impl Job<'_> {
    /// Grains at these centres: as many as there are, from the largest down.
    fn spheres(&self, centers: &[[f64; 3]]) -> Result<Grains, OutOfMemory> {
        let column = |a: usize| collected(centers.iter().map(|p| p[a]));
        let placed = centers.len();
        Ok(Grains::Spheres(Spheres {
            x_mm: column(0)?,
            y_mm: column(1)?,
            z_mm: column(2)?,
            d_mm: copied(&self.diameters[..placed])?,
            aggregate: copied(self.aggregate.get(..placed).unwrap_or_default())?,
        }))
    }

    fn volume_fraction(&self, diameters: &[f64]) -> f64 {
        diameters.iter().map(|&d| sphere_volume(d)).sum::<f64>() / self.mix.specimen_volume_mm3
    }

    /// Random sequential addition.
    fn place(&self, attempts_per_grain: Option<u64>, control: &dyn Control) -> Result<Placed, PackError> {
        let start = Instant::now();
        let request = self.run.request;
        let preference = Preference::new(request, self.diameters);
        let rsa = Rsa {
            diameters_mm: self.diameters,
            specimen: &request.specimen,
            rule: DistanceRule::new(&request.distance, &request.specimen),
            attempts_per_grain,
            preference: preference.as_ref(),
            threads: self.run.threads,
        };
        let part = Part::new(control, 0.0, 1.0).with_exponent(RSA_TIME_EXPONENT);
        let control = StopToFinish::new(&part);
        let outcome = rsa.run(&mut stream(request.seed, Stream::Rsa), &control);
        let placed = outcome.centers_mm.len();
        let short = kept_insertion(&self.run, outcome.end, placed, &part);
        if outcome.end == End::Complete || short.is_some() {
            return Ok(inserted(self.spheres(&outcome.centers_mm)?, outcome.statistics, start, short));
        }
        let of = (self.mix.specimen_volume_mm3, self.run.amount());
        Err(not_inserted(outcome.end, [placed, self.diameters.len()], |i| self.diameters[i], of))
    }

    /// Event-driven molecular dynamics.
    fn grow(
        &self,
        options: EdmdOptions,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Placed, PackError> {
        let request = self.run.request;
        let edmd = Edmd {
            request,
            options,
            diameters_mm: self.diameters,
            expected: self.run.plan.growth,
            threads: self.run.threads,
            to_jamming: self.run.to_jamming,
        };
        let outcome = edmd.run(resume, control).map_err(|interrupted| match interrupted {
            Interrupted::Stopped => stopped(self.diameters.len(), self.diameters.len()),
            Interrupted::OutOfMemory { bytes } => PackError::OutOfMemory { bytes },
            Interrupted::NoStart => not_grown(GrowthStopped {
                grains: self.diameters.len() as u64,
                volume_fraction_reached: 0.0,
                volume_fraction_asked: self.volume_fraction(self.diameters),
                distance_mm_reached: None,
                distance_mm_asked: distance_asked_mm(request),
                scale_reached: 0.0,
                effort: GrowthEffort::Events { events: 0, simulated_time_s: 0.0 },
                end: GrowthEnd::NoStart,
                amount: self.run.amount(),
            }),
        })?;
        let statistics = outcome.statistics;
        let maximize = matches!(request.distance, Distance::Maximize { .. });
        let is_short = self.run.is_short(statistics.growth_scale, statistics.stop);
        let short = is_short.then(|| {
            let failure = TargetNotReached::GrowthStopped(GrowthStopped {
                grains: self.diameters.len() as u64,
                volume_fraction_reached: outcome.volume_fraction,
                volume_fraction_asked: self.volume_fraction(self.diameters),
                distance_mm_reached: outcome.distance_mm,
                distance_mm_asked: distance_asked_mm(request),
                scale_reached: statistics.growth_scale,
                effort: GrowthEffort::Events {
                    events: statistics.events,
                    simulated_time_s: statistics.simulated_time_s,
                },
                end: statistics.stop,
                amount: self.run.amount(),
            });
            Short::new(self.run.kept_reason(statistics.stop, control), failure)
        });
        let short = short.transpose()?;
        Ok(Placed {
            grains: self.spheres(&outcome.centers_mm)?,
            statistics: Statistics {
                rsa: Some(outcome.rsa),
                edmd: Some(statistics),
                ..Statistics::default()
            },
            distance_mm: outcome.distance_mm.filter(|_| maximize),
            growth_curve: outcome.growth_curve,
            rsa_s: outcome.rsa_s,
            growth_s: Some(outcome.edmd_s),
            method_used: MethodUsed::Edmd,
            scale: statistics.growth_scale,
            short,
        })
    }
}
