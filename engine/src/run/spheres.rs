//! Spheres of a run, which are inserted at random, or grow by events or by moves.

use super::Growing;
use super::job::Job;
use super::shaped::grown_by_moves;
use crate::checkpoint::Resume;
use crate::control::{Control, StopToFinish};
use crate::distance::DistanceRule;
use crate::gap::spheres::Sphere;
use crate::memory::{OutOfMemory, collected, copied};
use crate::methods::addition;
use crate::methods::edmd::Edmd;
use crate::methods::growth::{Interrupted, Outcome};
use crate::methods::rsa::{self, Rsa};
use crate::mix::{GradedMix, sphere_volume};
use crate::packing::{Grains, Spheres};
use crate::request::{GrowthBy, GrowthOptions};
use crate::rng::{Stream, stream};
use crate::segregation::Preference;

/// Spheres whose diameters are drawn.
pub(super) struct SphereJob<'a> {
    pub(super) run: Growing<'a>,
    pub(super) mix: &'a GradedMix,
    pub(super) diameters: &'a [f64],
    /// The aggregate of each; empty where the mix names none.
    pub(super) aggregate: &'a [u16],
}

impl<'a> Job<'a> for SphereJob<'a> {
    type Place = [f64; 3];

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
        self.diameters.len()
    }

    fn volume_mm3(&self) -> f64 {
        self.diameters.iter().map(|&d| sphere_volume(d)).sum()
    }

    fn diameter_mm(&self, rank: usize) -> f64 {
        self.diameters[rank]
    }

    fn insert(
        &self,
        attempts_per_grain: Option<u64>,
        _: bool,
        control: &StopToFinish<'_>,
    ) -> Result<addition::Outcome<[f64; 3]>, OutOfMemory> {
        let request = self.run.request;
        let preference = Preference::new(request, self.diameters);
        let rsa = Rsa {
            diameters_mm: self.diameters,
            domain: request.specimen.domain(),
            rule: DistanceRule::new(&request.distance, &request.specimen),
            attempts_per_grain,
            preference: preference.as_ref(),
            threads: self.run.threads,
        };
        Ok(rsa.run(&mut stream(request.seed, Stream::Rsa), control))
    }

    fn most_looks(&self, attempts_per_grain: Option<u64>, _: bool) -> f64 {
        attempts_per_grain.map_or(f64::INFINITY, |most| most as f64 / rsa::DRAWS_PER_LOOK as f64)
    }

    fn grow(
        &mut self,
        options: &GrowthOptions,
        resume: Option<Resume>,
        control: &dyn Control,
    ) -> Result<Outcome<Vec<[f64; 3]>>, Interrupted> {
        if self.by() == GrowthBy::Moves {
            let spheres = collected(self.diameters.iter().map(|&d_mm| Sphere { d_mm }))?;
            let (outcome, _) = grown_by_moves(&self.run, spheres, options, resume.as_ref(), control)?;
            let centers = collected(outcome.placed.iter().map(|pose| pose.center_mm.into()))?;
            return Ok(outcome.with_places(centers));
        }
        let edmd = Edmd {
            request: self.run.request,
            options: *options,
            diameters_mm: self.diameters,
            expected: self.run.plan.growth,
            threads: self.run.threads,
            to_jamming: self.run.to_jamming,
        };
        edmd.run(resume, control)
    }

    fn grains(&self, centers: Vec<[f64; 3]>) -> Result<Grains, OutOfMemory> {
        let column = |a: usize| collected(centers.iter().map(|p| p[a]));
        let placed = centers.len();
        Ok(Spheres {
            x_mm: column(0)?,
            y_mm: column(1)?,
            z_mm: column(2)?,
            d_mm: copied(&self.diameters[..placed])?,
            aggregate: copied(self.aggregate.get(..placed).unwrap_or_default())?,
        }
        .into())
    }

    fn by(&self) -> GrowthBy {
        GrowthBy::of(&self.run.request.method, false)
    }
}
