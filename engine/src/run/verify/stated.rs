//! What a result states of its packing: by which request it is checked, and whether its figures are those of the
//! grains.

use super::super::partial::Kept;
use super::super::{as_checked, summary as summary_of};
use super::difference::{ROUNDING, equal};
use super::error::VerifyError;
use super::run::judge_kept;
use crate::check::{Check, Extent};
use crate::distance::DistanceRule;
use crate::mix::GradedMix;
use crate::packing::{CheckReport, Grains, MethodUsed, Summary};
use crate::request::PackingRequest;

/// The request by which the packing of a result is checked, and what it has of the grains of that request: of a request
/// whose volume fraction or distance is to be as large as possible the one with those of the result.
///
/// # Errors
/// [`VerifyError::Wrong`] where no run of the request ends with such a summary.
pub fn checked_as(
    request: &PackingRequest,
    summary: &Summary,
) -> Result<(PackingRequest, Extent), VerifyError> {
    let grains_requested = summary.partial.map_or(summary.grains, |partial| partial.grains_requested);
    judge_kept(request, summary, summary.grains as usize, grains_requested as usize)?;
    let kept = Kept::of_summary(request, summary, grains_requested);
    let drawn = kept.drawing.map_or_else(|| request.clone(), |drawing| drawing.numbers_of(request));
    Ok((as_checked(&drawn, summary.distance_mm), kept.extent(summary.grains as usize)))
}

/// Compares what a result states of a packing, its summary and the figures of its check, with its grains, which passed
/// the check `found` by the request of [`checked_as`]. The numbers may differ by rounding, for
/// another build may have computed them; how many pairs were looked at is its own.
///
/// # Errors
/// [`VerifyError::Wrong`] with the first figure that differs.
pub fn compare_stated(
    request: &PackingRequest,
    (summary, check): (&Summary, &CheckReport),
    grains: &Grains,
    mut found: Check,
) -> Result<(), VerifyError> {
    let (checked, _) = checked_as(request, summary)?;
    let mix = GradedMix::new(&checked.mix, checked.specimen.volume_mm3());
    let requested = summary.partial.map_or(grains.len() as u64, |partial| partial.grains_requested);
    let kept = Kept::of_summary(request, summary, requested);
    let rule = DistanceRule::new(&checked.distance, &checked.specimen);
    found.found.pairs_checked = check.pairs_checked;
    equal("check", check, &found.found, ROUNDING)?;
    let method_used = summary.method_used.unwrap_or(MethodUsed::Rsa);
    let expected = summary_of(&mix, &rule, grains, method_used, found);
    let expected = Summary { method_used: summary.method_used, ..kept.in_summary(expected, &mix, &checked) };
    equal("summary", summary, &expected, ROUNDING)
}
