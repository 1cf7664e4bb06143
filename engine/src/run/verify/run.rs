//! What only the run itself knows of a packing: whether its report agrees with the request and with the method that was
//! used.

use super::error::VerifyError;
use crate::packing::{Grains, MethodUsed, PartialReason, Report, Statistics, Summary};
use crate::request::{Distance, GrowthBy, GrowthStop, Method, OnLimit, PackingRequest};

/// Most points of a growth curve.
const MOST_CURVE_POINTS: usize = 1000;
/// Longest time that a report may state, in s: 30 years.
const MOST_TIME_S: f64 = 1.0e9;

/// Whether a number of a report lies between 0 and its bound.
pub(super) fn within(name: &str, found: f64, most: f64) -> Result<(), VerifyError> {
    if (0.0..=most).contains(&found) {
        return Ok(());
    }
    VerifyError::wrong(format!("{name} is {found}: must be from 0 to {most}"))
}

/// Whether what a result says of the end of its run agrees with the request, of which it has so many grains; `found`
/// are those of the packing.
pub(super) fn judge_kept(
    request: &PackingRequest,
    summary: &Summary,
    found: usize,
    requested: usize,
) -> Result<(), VerifyError> {
    let Some(partial) = summary.partial else {
        if found != requested {
            return VerifyError::wrong(format!("the packing has {found} grains: the seed draws {requested}"));
        }
        let scale = summary.size_scale.unwrap_or(1.0);
        if !(scale > 0.0 && scale.is_finite()) {
            return VerifyError::wrong(format!("summary/size_scale is {scale}: must be above 0"));
        }
        return Ok(());
    };
    let stop = request.method.growth().map_or(GrowthStop::default(), |options| options.stop);
    let (has_time, has_events) = (stop.time_s.is_some(), stop.work().is_some());
    let is_rsa = matches!(request.method, Method::Rsa { .. });
    let keeps = request.on_limit == OnLimit::Keep;
    let is_densest = request.mix.maximizes_volume_fraction();
    let may_be = match partial.reason {
        PartialReason::Finished => true,
        PartialReason::TimedOut => keeps,
        PartialReason::TimeLimit => keeps && has_time && !is_densest,
        PartialReason::EventLimit => keeps && has_events && !is_densest,
        PartialReason::Stalled => keeps && !is_rsa && !is_densest,
        PartialReason::Saturated => keeps && is_rsa,
    };
    if !may_be {
        return VerifyError::wrong("summary/partial/reason: no run of this request ends so");
    }
    let is_missing_some = matches!(
        partial.reason,
        PartialReason::Finished | PartialReason::TimedOut | PartialReason::Saturated
    );
    if found == 0 || found > requested || found < requested && !is_missing_some {
        return VerifyError::wrong(format!("the packing has {found} grains: the seed draws {requested}"));
    }
    let scale = partial.size_scale;
    if !(scale > 0.0 && scale.is_finite() && (scale <= 1.0 || is_densest)) {
        return VerifyError::wrong(format!(
            "summary/partial/size_scale is {scale}: must be above 0, at most 1"
        ));
    }
    let maximizes = matches!(request.distance, Distance::Maximize { .. });
    if scale == 1.0 && found == requested && !maximizes && !is_densest {
        return VerifyError::wrong("summary/partial: the packing has all that is requested");
    }
    Ok(())
}

/// Whether what only the run knows agrees with the request; the method that was used, and the largest distance, where
/// that was requested.
pub(super) fn judge_run(
    request: &PackingRequest,
    report: &Report,
    grains: &Grains,
) -> Result<(MethodUsed, Option<f64>), VerifyError> {
    let Some(used) = report.summary.method_used else {
        return VerifyError::wrong("summary/method_used is missing");
    };
    let (grown, grown_after_rsa) = match GrowthBy::of(&request.method, grains.spheres().is_none()) {
        GrowthBy::Events => (MethodUsed::Edmd, MethodUsed::RsaThenEdmd),
        GrowthBy::Moves => (MethodUsed::MonteCarlo, MethodUsed::RsaThenMonteCarlo),
    };
    let may_be = match request.method {
        Method::Rsa { .. } => used == MethodUsed::Rsa,
        Method::Auto {} => [MethodUsed::Rsa, grown, grown_after_rsa].contains(&used),
        Method::Growth { .. } | Method::Edmd { .. } | Method::MonteCarlo { .. } => used == grown,
    };
    if !may_be {
        return VerifyError::wrong("summary/method_used is not a method of the request");
    }
    judge_statistics(used, report)?;
    let timings = &report.timings_s;
    for (name, found) in [
        ("timings_s/sampling", timings.sampling),
        ("timings_s/rsa", timings.rsa),
        ("timings_s/edmd", timings.edmd.unwrap_or(0.0)),
        ("timings_s/monte_carlo", timings.monte_carlo.unwrap_or(0.0)),
        ("timings_s/check", timings.check),
        ("timings_s/total", timings.total),
    ] {
        within(name, found, MOST_TIME_S)?;
    }
    if report.growth_curve.len() > MOST_CURVE_POINTS {
        let found = report.growth_curve.len();
        return VerifyError::wrong(format!(
            "growth_curve has {found} points: must have at most {MOST_CURVE_POINTS}"
        ));
    }
    for point in &report.growth_curve {
        within("growth_curve/packing_time_s", point.packing_time_s, MOST_TIME_S)?;
        within("growth_curve/volume_fraction", point.volume_fraction, f64::MAX)?;
        within("growth_curve/simulated_time_s", point.simulated_time_s.unwrap_or(0.0), f64::MAX)?;
    }
    let Distance::Maximize { .. } = request.distance else { return Ok((used, None)) };
    match report.summary.distance_mm {
        Some(mm) => within("summary/distance_mm", mm, f64::MAX).map(|()| (used, Some(mm))),
        None => VerifyError::wrong("summary/distance_mm is missing: the largest distance is requested"),
    }
}

/// Whether the counts are those of the method that was used, and of a run that reached its target.
fn judge_statistics(used: MethodUsed, report: &Report) -> Result<(), VerifyError> {
    let Statistics { rsa, edmd, monte_carlo } = report.statistics;
    let is_edmd = matches!(used, MethodUsed::Edmd | MethodUsed::RsaThenEdmd);
    let is_monte_carlo = matches!(used, MethodUsed::MonteCarlo | MethodUsed::RsaThenMonteCarlo);
    let agrees = rsa.is_some()
        && edmd.is_some() == is_edmd
        && monte_carlo.is_some() == is_monte_carlo
        && (is_edmd || report.timings_s.edmd.is_none())
        && (is_monte_carlo || report.timings_s.monte_carlo.is_none())
        && (is_edmd || is_monte_carlo || report.growth_curve.is_empty());
    if !agrees {
        return VerifyError::wrong("statistics, times or growth curve are those of another method");
    }
    if let Some(edmd) = edmd {
        for (name, found) in [
            ("predictions_per_event", edmd.predictions_per_event),
            ("events_per_s", edmd.events_per_s),
            ("simulated_time_s", edmd.simulated_time_s),
            ("energy", edmd.energy),
            ("reduced_pressure", edmd.reduced_pressure),
        ] {
            within(name, found, f64::MAX)?;
        }
    }
    if report.summary.partial.is_some() || report.summary.size_scale.is_some() {
        // They grew to another size.
        return Ok(());
    }
    let scales = [edmd.map(|edmd| edmd.growth_scale), monte_carlo.map(|counted| counted.growth_scale)];
    if let Some(scale) = scales.into_iter().flatten().find(|scale| *scale < 1.0) {
        return VerifyError::wrong(format!(
            "growth_scale is {scale}: the grains of a packing have grown to their size"
        ));
    }
    Ok(())
}
