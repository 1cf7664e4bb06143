//! A run whose volume fraction is to be as large as possible.
//!
//! Numbers of grains are drawn for the volume fraction that growth is expected to reach ([`Drawing`]). The grains then
//! grow until they jam or a limit of the method ends it, and all sizes are scaled by the largest factor at which every
//! pair and every wall keeps its distance. Where that factor lies outside of [`AS_DRAWN`], grains are drawn once more,
//! for the volume fraction that was reached; the sizes of a list, whose numbers are given, are scaled whatever the
//! factor. Growth ends early where it is clear that it will. The second growth has what the first left of the limits.
//!
//! A checkpoint has a head before the state of growth: which drawing it is of, and what of the limits was used before.

use std::time::Instant;

use super::partial::Kept;
use super::size_scale::unbounded_scale;
use super::{Drawn, Finishing, Growing, Placed, Times, distance_asked_mm, finished, not_grown};
use crate::checkpoint::{Checkpoint, Resume};
use crate::control::{Control, Finish, Progress};
use crate::distance::DistanceRule;
use crate::elementary::cbrt;
use crate::error::{GrowthEffort, GrowthStopped, PackError};
use crate::methods::growth::ToJamming;
use crate::packing::{GrowthEnd, Packing, Summary};
use crate::plan::{Drawing, Limits, Plan};
use crate::request::PackingRequest;
use crate::template_cache::TemplateCache;

/// Factors on all sizes with which grains count as those that were drawn,
const AS_DRAWN: [f64; 2] = [0.97, 1.03];
/// and those that a packing is expected to have, beyond which growth ends early: grains that rearrange jam at a scale
/// that is larger, by half a percent about, than what is expected before.
const EXPECTED: [f64; 2] = [0.966, 1.03];
/// Least share of a limit that is worth a second growth: with less, grains end farther from jamming than the first.
const LEAST_LEFT: f64 = 0.25;
/// Bytes of the head of a checkpoint.
const HEAD_BYTES: usize = 32;

/// One of the drawings of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Attempt {
    drawing: Drawing,
    /// Whether it is the second.
    is_again: bool,
    /// What the attempt before used of the limits: time in s, and events or sweeps.
    used_s: f64,
    used_effort: u64,
}

impl Attempt {
    /// The first attempt of a request.
    fn first(request: &PackingRequest) -> Self {
        // A request that is no such request is none of this module.
        let drawing = Drawing::expected(request).unwrap_or(Drawing::List(1.0));
        Self { drawing, is_again: false, used_s: 0.0, used_effort: 0 }
    }

    /// The head of a checkpoint of growth.
    fn head(&self) -> [u8; HEAD_BYTES] {
        let (is_list, value) = match self.drawing {
            Drawing::Fraction(fraction) => (0, fraction),
            Drawing::List(scale) => (1, scale),
        };
        let words = [
            is_list << 1 | u64::from(self.is_again),
            value.to_bits(),
            self.used_s.to_bits(),
            self.used_effort,
        ];
        let mut head = [0; HEAD_BYTES];
        for (bytes, word) in head.chunks_mut(8).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        head
    }

    /// The attempt of a head, and the state of growth behind it; `None` where it cannot be one of this request.
    fn read(request: &PackingRequest, body: &[u8]) -> Option<(Self, Vec<u8>)> {
        let (head, state) = body.split_at_checked(HEAD_BYTES)?;
        let mut words = head.chunks(8).map(|bytes| bytes.try_into().map(u64::from_le_bytes));
        let mut word = || words.next()?.ok();
        let (flags, value) = (word()?, f64::from_bits(word()?));
        let (used_s, used_effort) = (f64::from_bits(word()?), word()?);
        let is_list = request.mix.listed_diameters_mm().is_some();
        let is_possible =
            value > 0.0 && value.is_finite() && used_s >= 0.0 && flags <= 3 && (flags >> 1 == 1) == is_list;
        let drawing = if is_list { Drawing::List(value) } else { Drawing::Fraction(value) };
        is_possible.then(|| (Self { drawing, is_again: flags & 1 == 1, used_s, used_effort }, state.to_vec()))
    }

    /// The request that grains are drawn and grown by, with what is left of its limits.
    fn request(&self, request: &PackingRequest) -> PackingRequest {
        let mut drawn = self.drawing.of(request);
        let left_s = |limit: Option<f64>| limit.map(|most| (most - self.used_s).max(f64::MIN_POSITIVE));
        let left = |limit: Option<u64>| limit.map(|most| most.saturating_sub(self.used_effort).max(1));
        if let Some(options) = drawn.method.growth_mut() {
            options.stop.time_s = left_s(options.stop.time_s);
            options.stop.events = left(options.stop.events);
            options.stop.sweeps = left(options.stop.sweeps);
        }
        drawn
    }

    /// The second attempt after this one, which reached a scale of the sizes; `None` where none is called for.
    fn again(&self, request: &PackingRequest, placed: &Placed, size_scale: f64) -> Option<Self> {
        let as_drawn = size_scale / self.drawing.scale();
        if self.is_again || placed.short.is_some() || (AS_DRAWN[0]..=AS_DRAWN[1]).contains(&as_drawn) {
            return None;
        }
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let has_fixed_gaps = rule.gap_mm(0.0, 0.0) > 0.0 || rule.wall_gap_mm(0.0) > 0.0;
        // Without such gaps a list grows in the same way whatever its sizes are.
        if matches!(self.drawing, Drawing::List(_)) && !has_fixed_gaps {
            return None;
        }
        let (effort, at_jamming) = match (placed.statistics.edmd, placed.statistics.monte_carlo) {
            (Some(edmd), _) => (edmd.events, 1.0 / cbrt(1.0 - 3.0 / edmd.reduced_pressure.max(30.0))),
            (None, Some(counted)) => (counted.sweeps, 1.0),
            (None, None) => (0, 1.0),
        };
        let next = Self {
            drawing: self.drawing.at_scale(size_scale * at_jamming),
            is_again: true,
            used_s: self.used_s + placed.rsa_s + placed.growth_s.unwrap_or(0.0),
            used_effort: self.used_effort + effort,
        };
        let has_left_s = |limit: Option<f64>| limit.is_none_or(|most| most - next.used_s > LEAST_LEFT * most);
        let has_left = |limit: Option<u64>| {
            limit.is_none_or(|most| most.saturating_sub(next.used_effort) as f64 > LEAST_LEFT * most as f64)
        };
        let is_worth = request
            .method
            .growth()
            .is_none_or(|options| has_left_s(options.stop.time_s) && has_left(options.stop.work()));
        is_worth.then_some(next)
    }
}

/// Packs as densely as the method does, from a checkpoint where there is one.
///
/// # Errors
/// See [`PackError`].
pub(super) fn pack(
    request: &PackingRequest,
    plan: &Plan,
    (limits, templates): (&Limits, &TemplateCache),
    resume: Option<Resume>,
    control: &dyn Control,
    started: Instant,
) -> Result<Packing, PackError> {
    let earlier = resume.and_then(|resume| Attempt::read(request, &resume.body));
    let (mut attempt, mut state) = match earlier {
        Some((attempt, body)) => (attempt, Some(Resume { body })),
        None => (Attempt::first(request), None),
    };
    loop {
        let drawn_by = attempt.request(request);
        let sampling = Instant::now();
        let Drawn { mix, sampled } = Drawn::new(&drawn_by, control)?;
        let sampling_s = sampling.elapsed().as_secs_f64();
        let grains_requested = sampled.len() as u64;
        let scale = attempt.drawing.scale();
        let to_jamming =
            ToJamming { within: (!attempt.is_again).then(|| EXPECTED.map(|bound| bound * scale)) };
        let run = Growing { request: &drawn_by, plan, to_jamming: Some(to_jamming), threads: limits.threads };
        let headed = Headed { control, request, head: attempt.head() };
        let mut placed = run.place(&mix, sampled, state.take(), &headed)?;
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let size_scale = unbounded_scale(&placed.grains, &request.specimen, &rule, placed.scale)?;
        if size_scale <= 0.0 {
            return Err(not_grown(GrowthStopped {
                grains: grains_requested,
                volume_fraction_reached: 0.0,
                volume_fraction_asked: mix.volume_fraction_effective,
                distance_mm_reached: None,
                distance_mm_asked: distance_asked_mm(request),
                scale_reached: placed.scale.min(1.0),
                effort: GrowthEffort::Cycles { cycles: 0, moves: 0 },
                end: GrowthEnd::Stalled,
                amount: request.mix.amount(),
            }));
        }
        if let Some(again) = attempt.again(request, &placed, size_scale) {
            attempt = again;
            continue;
        }
        placed.grains.scale(size_scale);
        let kept = Kept {
            size_scale,
            reason: placed.short.take().map(|short| short.reason),
            grains_requested,
            maximizes_distance: false,
            drawing: Some(attempt.drawing),
        };
        let checked = attempt.drawing.numbers_of(request);
        let times = Times { started, sampling_s };
        let finishing =
            Finishing { checked: &checked, mix: &mix, coarse: None, kept, times, limits, templates };
        return finished(placed, &finishing, control);
    }
}

/// What a user should know of sizes that are not those of the mix, in one sentence: where no drawing of grains for a
/// volume fraction that is to be as large as possible had them.
pub(super) fn scale_warning(summary: &Summary) -> Option<String> {
    let scale = summary.size_scale.filter(|_| summary.volume_fraction_drawn.is_some())?;
    (!(AS_DRAWN[0]..=AS_DRAWN[1]).contains(&scale)).then(|| {
        format!(
            "all sizes are scaled by {scale:.4} to fit, so that they are not those of the mix: grains are drawn twice at \
             most, and once where the limits of the method leave too little for a second time; raise method.stop, or \
             take a larger specimen or another seed"
        )
    })
}

/// Control of growth whose checkpoints are those of the request, with a head before the state.
struct Headed<'a> {
    control: &'a dyn Control,
    request: &'a PackingRequest,
    head: [u8; HEAD_BYTES],
}

impl Control for Headed<'_> {
    fn report(&self, progress: &Progress) {
        self.control.report(progress);
    }

    fn should_stop(&self) -> bool {
        self.control.should_stop()
    }

    fn should_finish(&self) -> Option<Finish> {
        self.control.should_finish()
    }

    fn wants_last_checkpoint(&self) -> bool {
        self.control.wants_last_checkpoint()
    }

    fn wants_checkpoint(&self) -> bool {
        self.control.wants_checkpoint()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let write = |out: &mut dyn std::io::Write| {
            out.write_all(&self.head)?;
            checkpoint.write_body(out)
        };
        self.control.keep_checkpoint(&Checkpoint::new(self.request, &write));
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn request(mix: &serde_json::Value) -> PackingRequest {
        let value = json!({"specimen": {"type": "box", "size_mm": [20, 20, 20]}, "mix": mix});
        match PackingRequest::from_json(&value, 1) {
            Ok(request) => request,
            Err(faults) => panic!("{faults:?}"),
        }
    }

    #[test]
    fn the_head_of_a_checkpoint_reads_back_and_others_are_refused() {
        let equal =
            json!({"grading": {"type": "monodisperse", "diameter_mm": 3}, "volume_fraction": "maximize"});
        let list =
            json!({"grading": {"type": "diameters", "diameters_mm": [3, 2]}, "volume_fraction": "maximize"});
        for (mix, other) in [(&equal, &list), (&list, &equal)] {
            let first = Attempt::first(&request(mix));
            let again = Attempt { is_again: true, used_s: 1.5, used_effort: 77, ..first };
            for attempt in [first, again] {
                let mut body = attempt.head().to_vec();
                body.extend(b"state");
                assert_eq!(Attempt::read(&request(mix), &body), Some((attempt, b"state".to_vec())));
                assert_eq!(Attempt::read(&request(other), &body), None);
                assert_eq!(Attempt::read(&request(mix), &body[..HEAD_BYTES - 1]), None);
            }
        }
    }
}
