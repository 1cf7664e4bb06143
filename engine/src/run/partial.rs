//! What is kept of a run that ended before its target, and what a result says of it.
//!
//! Grains that grew keep their positions, and all sizes are scaled by the largest factor at which every pair and every
//! wall has its full distance ([`size_scale`](super::size_scale)). Growth scales distances as well, so that this factor
//! is below the scale that growth reached. Random addition keeps the grains that it placed. Where the distance is to be
//! as large as possible, grains that have their sizes keep them, and the distance that was reached is the result.

use super::size_scale::largest_scale;
use super::{Placed, distance_asked_mm};
use crate::check::Extent;
use crate::distance::DistanceRule;
use crate::error::{GrowthStopped, PackError, TargetNotReached};
use crate::mix::GradedMix;
use crate::packing::{Partial, PartialReason, Statistics, Summary};
use crate::plan::Drawing;
use crate::request::{Distance, PackingRequest};

/// Why a run ended before its target, though its packing is kept.
#[derive(Clone, Debug)]
pub(super) struct Short {
    pub(super) reason: PartialReason,
    /// The failure of the run, where no scale of the sizes keeps the distances.
    pub(super) failure: Option<TargetNotReached>,
}

impl Short {
    /// A run that ended with a failure, whose packing is kept for a reason.
    ///
    /// # Errors
    /// The failure, where there is no reason to keep it.
    pub(super) fn new(reason: Option<PartialReason>, failure: TargetNotReached) -> Result<Self, PackError> {
        match reason {
            Some(reason) => Ok(Self { reason, failure: Some(failure) }),
            None => Err(PackError::TargetNotReached(failure)),
        }
    }
}

/// What a run has of what its request asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kept {
    /// The factor on the sizes of all grains.
    pub(super) size_scale: f64,
    /// Why it ended before its target; `None` where all was reached.
    pub(super) reason: Option<PartialReason>,
    pub(super) grains_requested: u64,
    /// Whether the largest distance is requested.
    pub(super) maximizes_distance: bool,
    /// What was drawn, where the volume fraction is to be as large as possible.
    pub(super) drawing: Option<Drawing>,
}

impl Kept {
    /// The extent of a packing of `grains` grains.
    pub(super) fn extent(&self, grains: usize) -> Extent {
        Extent { size_scale: self.size_scale, has_all_grains: grains as u64 == self.grains_requested }
    }

    /// What the summary of a packing says, made by the request that it was checked by.
    pub(super) fn in_summary(&self, summary: Summary, mix: &GradedMix, checked: &PackingRequest) -> Summary {
        let is_densest = self.drawing.is_some();
        let cube = if is_densest { self.size_scale.powi(3) } else { 1.0 };
        let distance_mm = distance_asked_mm(checked);
        let partial = self.reason.map(|reason| Partial {
            reason,
            volume_fraction_requested: (!is_densest).then_some(mix.volume_fraction_effective),
            volume_fraction_reached: summary.volume_fraction_effective,
            distance_mm_requested: distance_mm.filter(|_| !self.maximizes_distance),
            distance_mm_reached: distance_mm,
            size_scale: self.size_scale,
            grains_requested: self.grains_requested,
            grains_placed: summary.grains,
        });
        Summary {
            volume_fraction_mixture: cube * summary.volume_fraction_mixture,
            size_scale: is_densest.then_some(self.size_scale),
            volume_fraction_drawn: match self.drawing {
                Some(Drawing::Fraction(fraction)) => Some(fraction),
                Some(Drawing::List(_)) | None => None,
            },
            partial,
            ..summary
        }
    }

    /// What the summary of a result says that a run has of its request.
    pub(super) fn of_summary(request: &PackingRequest, summary: &Summary, grains_requested: u64) -> Self {
        let size_scale = summary.partial.map(|partial| partial.size_scale).or(summary.size_scale);
        let of_fraction = summary.volume_fraction_drawn.map(Drawing::Fraction);
        Self {
            size_scale: size_scale.unwrap_or(1.0),
            reason: summary.partial.map(|partial| partial.reason),
            grains_requested,
            maximizes_distance: matches!(request.distance, Distance::Maximize { .. }),
            drawing: request
                .mix
                .maximizes_volume_fraction()
                .then(|| of_fraction.unwrap_or(Drawing::List(size_scale.unwrap_or(1.0)))),
        }
    }
}

/// Scales the grains of a run that ended before its target, if it did, so that they keep their distances. It has so
/// many grains of its mix.
///
/// # Errors
/// The failure of the run, where there is no such scale; when the system refuses memory.
pub(super) fn sized(
    request: &PackingRequest,
    placed: &mut Placed,
    grains_requested: u64,
) -> Result<Kept, PackError> {
    let maximizes_distance = matches!(request.distance, Distance::Maximize { .. });
    let mut kept =
        Kept { size_scale: 1.0, reason: None, grains_requested, maximizes_distance, drawing: None };
    let Some(short) = placed.short.take() else { return Ok(kept) };
    let has_all_grains = placed.grains.len() as u64 == grains_requested;
    if placed.scale < 1.0 {
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        kept.size_scale = largest_scale(&placed.grains, &request.specimen, &rule, 1.0)?;
        if maximizes_distance {
            placed.distance_mm = Some(0.0);
        }
    }
    if let (true, Some(failure)) = (kept.size_scale <= 0.0, short.failure) {
        return Err(PackError::TargetNotReached(without_value(failure)));
    }
    let is_whole = kept.size_scale == 1.0 && has_all_grains && !maximizes_distance;
    kept.reason = (!is_whole).then_some(short.reason);
    if is_whole {
        // The grains stand so that they have their sizes already.
        let Statistics { edmd, monte_carlo, .. } = &mut placed.statistics;
        let scales = [edmd.as_mut().map(|edmd| &mut edmd.growth_scale)];
        let scales =
            scales.into_iter().chain([monte_carlo.as_mut().map(|counted| &mut counted.growth_scale)]);
        scales.flatten().for_each(|scale| *scale = 1.0);
    }
    placed.grains.scale(kept.size_scale);
    Ok(kept)
}

/// A failure of growth of which nothing can be kept.
fn without_value(failure: TargetNotReached) -> TargetNotReached {
    match failure {
        TargetNotReached::GrowthStopped(stopped) => {
            TargetNotReached::GrowthStopped(GrowthStopped { volume_fraction_reached: 0.0, ..stopped })
        }
        other @ TargetNotReached::InsertionFailed(_) => other,
    }
}

/// What a user should know of a packing that is partial, in one sentence.
pub(super) fn warning(summary: &Summary) -> Option<String> {
    let partial = summary.partial.as_ref()?;
    let ended_by = match partial.reason {
        PartialReason::TimeLimit => "the limit of time of the method",
        PartialReason::EventLimit => "the limit of events or sweeps of the method",
        PartialReason::Stalled => "a jam of the grains",
        PartialReason::Saturated => "random addition, which found no place for a grain,",
        PartialReason::TimedOut => "the time limit of the job",
        PartialReason::Finished => "a request to finish",
    };
    let reached = match partial.volume_fraction_requested {
        Some(requested) => format!("{:.4} of {requested:.4}", partial.volume_fraction_reached),
        None => format!("{:.4}", partial.volume_fraction_reached),
    };
    let missing = if partial.grains_placed < partial.grains_requested {
        format!(
            "; {} of {} grains are placed, and the finest are missing: those of {:.4} mm and less",
            partial.grains_placed, partial.grains_requested, summary.d_min_mm
        )
    } else {
        String::new()
    };
    let scaled = if partial.size_scale == 1.0 {
        String::new()
    } else {
        format!(
            "; all sizes are scaled by {:.6}, the largest factor at which the grains keep their distances",
            partial.size_scale
        )
    };
    let distance = match (partial.distance_mm_requested, partial.distance_mm_reached) {
        (None, Some(mm)) => format!("; the distance reached is {mm:.4} mm"),
        _ => String::new(),
    };
    Some(format!(
        "the packing is partial: {ended_by} ended the run at a volume fraction of {reached}{missing}{scaled}{distance}"
    ))
}
