//! Whether a packing, or the failure of a run, that another process reports answers its request.
//!
//! The sizes and shapes of the grains are drawn again from the request and its seed and must be equal in every bit,
//! which takes time proportional to the grains. The independent check ([`check`]) judges the positions. Every figure of
//! the report that follows from the grains is computed again and must be equal; of the others, which only the run
//! itself knows, the bounds and their agreement with the method are checked.

mod difference;
mod error;
mod run;
mod stated;
#[cfg(test)]
mod tests;

use std::num::NonZeroUsize;

use super::partial::Kept;
use super::size_scale::{largest_scale, unbounded_scale};
use super::{Drawn, Figures, as_checked, distance_asked_mm, fraction_of, volume_mm3};
use crate::check::{self, Scope};
use crate::control::Control;
use crate::distance::DistanceRule;
use crate::error::{GrowthEffort, GrowthStopped, InsertionFailed, PackError, PlanError, TargetNotReached};
use crate::export::tables::{self, GrainSource};
use crate::mix::{GradedMix, deviation};
use crate::packing::{Grains, GrainsRef, GrowthEnd, Report};
use crate::plan::{Drawing, Limits};
use crate::request::{GrowthBy, Method, PackingRequest};
use crate::shape::Polyhedron;
use crate::template_cache::TemplateCache;
use difference::{ROUNDING, equal};
use run::{judge_kept, judge_run, within};

pub use error::VerifyError;
pub use stated::{checked_as, compare_stated};

/// How far the length of the quaternion of an orientation may be from 1.
const UNIT_TOLERANCE: f64 = 1.0e-6;

/// Verifies a packing that was computed elsewhere: its grains are those that the seed draws, they keep their gaps, and
/// its report is theirs. Templates that earlier runs drew and measured are not drawn again. With
/// [`Scope::WithoutPairs`] the gaps between grains are left out.
///
/// # Errors
/// See [`VerifyError`].
pub fn verify(
    request: &PackingRequest,
    report: &Report,
    source: &dyn GrainSource,
    scope: Scope,
    templates: &TemplateCache,
    control: &dyn Control,
) -> Result<(), VerifyError> {
    let request: &PackingRequest = &templates.attached(request);
    let of_result = drawn_by(request, report)?;
    let mut drawn = drawn(&of_result, control)?;
    let (requested, drawn_mm3) = (drawn.len(), volume_mm3(&drawn.sampled));
    let kept = Kept::of_summary(request, &report.summary, requested as u64);
    judge_kept(request, &report.summary, source.len(), requested)?;
    drawn.sampled.truncate(source.len());
    let grains = drawn.grains_of(source, kept.size_scale)?;
    let (method_used, distance_mm) = judge_run(request, report, &grains)?;
    let checked = as_checked(&of_result, distance_mm);
    let extent = kept.extent(grains.len());
    let (sizes, threads) = (templates.sieve_sizes(), NonZeroUsize::MIN);
    let check = check::check_grains(&grains, &checked, extent, scope, sizes, threads, control);
    let check = check.map_err(|fault| match fault {
        check::Fault::Stopped => VerifyError::Stopped,
        check::Fault::OutOfMemory { bytes } => VerifyError::OutOfMemory { bytes },
        fault => VerifyError::Wrong(fault.to_string()),
    })?;
    if scope == Scope::All && kept.size_scale != 1.0 {
        drawn.judge_scale(request, &grains, kept.size_scale)?;
    }
    // What is scaled until it jams has no volume to miss.
    let coarse = if kept.drawing.is_some() {
        None
    } else {
        deviation::judge_volume(&request.mix, &drawn.mix, drawn_mm3)
            .map_err(|field| VerifyError::Wrong(field.to_string()))?
    };
    let mut figures = Figures::new(&checked, &drawn.mix, coarse, (&grains, method_used, check), &kept)?;
    if scope == Scope::WithoutPairs {
        // What the pairs alone would tell.
        let told = &report.check;
        if [told.min_gap_mm, told.min_excess_gap_mm].into_iter().flatten().any(|gap| gap < 0.0) {
            return VerifyError::wrong("check: the report tells of grains that overlap or keep no distance");
        }
        figures.check.min_gap_mm = told.min_gap_mm;
        figures.check.min_excess_gap_mm = told.min_excess_gap_mm;
        figures.check.pairs_checked = told.pairs_checked;
    }
    equal("summary", &report.summary, &figures.summary, 0.0)?;
    equal("check", &report.check, &figures.check, 0.0)?;
    equal("warnings", &report.warnings, &figures.warnings, 0.0)?;
    equal("segregation", &report.segregation, &figures.segregation, 0.0)?;
    equal("shapes", &report.shapes, &figures.shapes, 0.0)
}

/// Verifies that a run of a request ended as another process reports: a plan that cannot be made is planned again, and
/// the figures of a target that was not reached must agree with the grains that the seed draws. The run itself is not
/// repeated.
///
/// # Errors
/// See [`VerifyError`].
pub fn verify_failure(
    request: &PackingRequest,
    limits: &Limits,
    told: &PackError,
    templates: &TemplateCache,
    control: &dyn Control,
) -> Result<(), VerifyError> {
    let request: &PackingRequest = &templates.attached(request);
    match told {
        PackError::Plan(told) => {
            let found = if let Err(found) = templates.plan_attached(request, limits) {
                Some(found)
            } else {
                let drawn = drawn(request, control)?;
                let judged = deviation::judge_volume(&request.mix, &drawn.mix, volume_mm3(&drawn.sampled));
                judged.err().map(PlanError::Coarse)
            };
            match found {
                Some(found) if found == *told => Ok(()),
                Some(found) => {
                    VerifyError::wrong(format!("the plan of the request fails otherwise: {found}"))
                }
                None => VerifyError::wrong("the request can be planned"),
            }
        }
        PackError::TargetNotReached(TargetNotReached::InsertionFailed(told)) => {
            drawn(request, control)?.judge_insertion(request, told)
        }
        PackError::TargetNotReached(TargetNotReached::GrowthStopped(told)) => {
            drawn(request, control)?.judge_growth(request, told)
        }
        PackError::OutOfMemory { .. } | PackError::CheckFailed(_) | PackError::Stopped { .. } => Ok(()),
    }
}

/// The request by which the grains of a result were drawn: that of the result's own volume fraction, where it was to be
/// as large as possible.
fn drawn_by(request: &PackingRequest, report: &Report) -> Result<PackingRequest, VerifyError> {
    let summary = &report.summary;
    let is_list = request.mix.listed_diameters_mm().is_some();
    let is_densest = request.mix.maximizes_volume_fraction();
    if summary.size_scale.is_some() != is_densest
        || summary.volume_fraction_drawn.is_some() != (is_densest && !is_list)
    {
        return VerifyError::wrong(
            "summary/size_scale, summary/volume_fraction_drawn: those of another request",
        );
    }
    if !is_densest {
        return Ok(request.clone());
    }
    let drawing = summary.volume_fraction_drawn.map_or(Drawing::List(1.0), Drawing::Fraction);
    let drawn = drawing.numbers_of(request);
    // It bounds how many grains are drawn.
    let mix = GradedMix::new(&drawn.mix, drawn.specimen.volume_mm3());
    let is_fraction = mix.volume_fraction_effective > 0.0 && mix.volume_fraction_effective <= 1.0;
    if !(is_list || is_fraction) {
        return VerifyError::wrong("summary/volume_fraction_drawn is out of range: no grains fill so much");
    }
    Ok(drawn)
}

/// The grains that a valid request draws.
fn drawn(request: &PackingRequest, control: &dyn Control) -> Result<Drawn, VerifyError> {
    // That of a result may name a fraction of all aggregate that no request may.
    if request.mix.requested_fraction().is_none_or(|fraction| fraction <= 1.0) {
        request.validate().map_err(|fields| PackError::Plan(PlanError::Invalid(fields)))?;
    }
    Ok(Drawn::new(request, control)?)
}

impl Drawn {
    fn len(&self) -> usize {
        self.sampled.len()
    }

    /// Diameter of the sphere of equal volume of a grain, by its rank.
    fn d_mm(&self, grain: usize) -> f64 {
        GrainsRef::from(&self.sampled).d_mm(grain)
    }

    /// Reads the grains of a source, which must be as many and of the same sizes at this scale, shapes and aggregates.
    fn grains_of(&self, source: &dyn GrainSource, scale: f64) -> Result<Grains, VerifyError> {
        // Before anything is read: the drawn grains bound the memory.
        let (found, drawn) = (source.len(), self.len());
        if found != drawn {
            return VerifyError::wrong(format!("the packing has {found} grains: the seed draws {drawn}"));
        }
        if source.columns() != self.sampled.columns() {
            return VerifyError::wrong("the packing has columns of another kind of grains than the mix");
        }
        let mut grains = tables::load(source)?;
        let same = |(found, drawn): (&Polyhedron, &Polyhedron)| {
            found.vertices() == drawn.vertices()
                && found.faces() == drawn.faces()
                && same_bits(found.rounding(), drawn.rounding())
        };
        let templates = GrainsRef::from(&self.sampled).templates();
        let found_templates = GrainsRef::from(&grains).templates();
        if found_templates.len() != templates.len() || !found_templates.iter().zip(templates).all(same) {
            return VerifyError::wrong("the templates of the packing are not those that the seed draws");
        }
        // They are equal, and measured.
        grains.set_templates(templates);
        let of_source = GrainsRef::from(&grains);
        let differs = |grain: &usize| !of_source.is_scaled(*grain, (&self.sampled).into(), scale);
        if let Some(grain) = (0..found).find(differs) {
            let (has, draws) = (of_source.d_mm(grain), scale * self.d_mm(grain));
            return VerifyError::wrong(format!(
                "grain {grain} has the diameter {has} mm: the seed draws {draws} mm, or another shape or aggregate"
            ));
        }
        let has_unit =
            |pose: &crate::shape::Pose| (pose.orientation.quaternion().norm() - 1.0).abs() <= UNIT_TOLERANCE;
        let poses = grains.solids().map_or(&[][..], |solids| &solids.poses);
        if let Some(grain) = poses.iter().position(|pose| !has_unit(pose)) {
            return VerifyError::wrong(format!(
                "grain {grain} has an orientation that is no unit quaternion"
            ));
        }
        same_columns(source, &grains)?;
        Ok(grains)
    }

    /// Whether a scale is the largest at which these grains, at the positions of a packing, keep their distances.
    fn judge_scale(&self, request: &PackingRequest, found: &Grains, scale: f64) -> Result<(), VerifyError> {
        let Some(drawn) = found.with_sizes_of(&self.sampled) else {
            return VerifyError::wrong("the packing has another kind of grains than the mix");
        };
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let largest = if request.mix.maximizes_volume_fraction() {
            unbounded_scale(&drawn, &request.specimen, &rule, scale)?
        } else {
            largest_scale(&drawn, &request.specimen, &rule, 1.0)?
        };
        if (scale / largest - 1.0).abs() > ROUNDING {
            return VerifyError::wrong(format!(
                "size_scale is {scale}: the largest at these positions is {largest}"
            ));
        }
        Ok(())
    }

    /// Whether random sequential addition may have ended so.
    fn judge_insertion(&self, request: &PackingRequest, told: &InsertionFailed) -> Result<(), VerifyError> {
        let grains = self.len();
        if !matches!(request.method, Method::Rsa { .. }) {
            return VerifyError::wrong("the method of the request does not end because an insertion failed");
        }
        if told.grains != grains as u64 || told.placed >= told.grains {
            let InsertionFailed { placed, grains: all, .. } = told;
            return VerifyError::wrong(format!(
                "{placed} of {all} grains were placed: fewer than the {grains} that the seed draws must be"
            ));
        }
        if told.amount != request.mix.amount() {
            return VerifyError::wrong("amount is not that of the request");
        }
        let placed = told.placed as usize;
        let fraction = |n: usize| fraction_of(n, |i| self.d_mm(i), self.mix.specimen_volume_mm3);
        for (name, found, expected) in [
            ("diameter_mm", told.diameter_mm, self.d_mm(placed)),
            ("volume_fraction_reached", told.volume_fraction_reached, fraction(placed)),
            ("volume_fraction_asked", told.volume_fraction_asked, fraction(grains)),
        ] {
            if !same_bits(found, expected) {
                return VerifyError::wrong(format!("{name} is {found}: the seed draws {expected}"));
            }
        }
        Ok(())
    }

    /// Whether growth may have ended so.
    fn judge_growth(&self, request: &PackingRequest, told: &GrowthStopped) -> Result<(), VerifyError> {
        let grains = self.len();
        if told.grains != grains as u64 {
            return VerifyError::wrong(format!(
                "{} grains are told of: the seed draws {grains}",
                told.grains
            ));
        }
        let is_of_spheres = self.sampled.spheres().is_some();
        let has_limit = |end: GrowthEnd| match (end, request.method) {
            (GrowthEnd::Stalled | GrowthEnd::Target | GrowthEnd::NoStart, method) => {
                !matches!(method, Method::Rsa { .. })
            }
            (GrowthEnd::TimeLimit, method) => method.growth().is_some_and(|of| of.stop.time_s.is_some()),
            (GrowthEnd::EventLimit, method) => method.growth().is_some_and(|of| of.stop.events.is_some()),
            (GrowthEnd::SweepLimit, method) => method.growth().is_some_and(|of| of.stop.sweeps.is_some()),
            (GrowthEnd::Finished, _) => false,
        };
        let by_events = GrowthBy::of(&request.method, !is_of_spheres) == GrowthBy::Events;
        if !has_limit(told.end) || by_events != matches!(told.effort, GrowthEffort::Events { .. }) {
            return VerifyError::wrong("the method of the request does not end like that");
        }
        let asked = volume_mm3(&self.sampled) / self.mix.specimen_volume_mm3;
        if (told.volume_fraction_asked - asked).abs() > ROUNDING * asked {
            return VerifyError::wrong(format!(
                "volume_fraction_asked is {}: the seed draws {asked}",
                told.volume_fraction_asked
            ));
        }
        if told.amount != request.mix.amount() {
            return VerifyError::wrong("amount is not that of the request");
        }
        if told.distance_mm_asked != distance_asked_mm(request) {
            return VerifyError::wrong("distance_mm_asked is another than that of the request");
        }
        let time_s = match told.effort {
            GrowthEffort::Events { simulated_time_s, .. } => simulated_time_s,
            GrowthEffort::Cycles { .. } => 0.0,
        };
        for (name, found, most) in [
            ("volume_fraction_reached", told.volume_fraction_reached, f64::MAX),
            ("scale_reached", told.scale_reached, 1.0),
            ("simulated_time_s", time_s, f64::MAX),
        ] {
            within(name, found, most)?;
        }
        if told.scale_reached >= 1.0 {
            return VerifyError::wrong("scale_reached is 1: the grains have grown to their size");
        }
        Ok(())
    }
}

fn same_bits(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits()
}

/// Whether the columns of a source are those that its grains would be stored with: some follow from others.
fn same_columns(source: &dyn GrainSource, grains: &Grains) -> Result<(), VerifyError> {
    match tables::difference(source, source.columns(), grains, 0.0)? {
        None => Ok(()),
        Some(tables::Difference { grain, column, found, expected }) => VerifyError::wrong(format!(
            "grain {grain} has {found} in the column {}: must be {expected}",
            column.name()
        )),
    }
}
