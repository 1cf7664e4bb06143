//! Which ends without a result a worker process may report, and what is made of them.
//!
//! A failure is stored in the words of the server: it is made anew from its figures. Figures that follow from the
//! request are verified by [`checks`](super::checks).

use std::time::Duration;

use packstone_engine::{
    FieldError, GrowthEffort, GrowthStopped, InsertionFailed, PackError, PlanError, TargetNotReached,
};

use super::ending::MEMORY_FAULTS;
use crate::failure::{Failure, FailureCode, FailureFacts};

/// Share of `timeout_s` that must have passed by the clock of the server: that of a worker may run faster.
const LEAST_SHARE_OF_TIMEOUT: f64 = 0.5;
/// Longest text of a failure that is stored as it came, in characters.
const MAX_DETAIL_CHARS: usize = 1000;

/// Most faulty fields of a failure that are stored as they came.
const MAX_FIELDS: usize = 100;

/// What is known of an attempt whose end is reported.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Attempt {
    pub(crate) timeout_s: Option<f64>,
    /// Time since its start.
    pub(crate) ran: Duration,
    /// Faults of machines that the job has met.
    pub(crate) faults: i64,
}

/// What is to be done with a reported failure.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Claim {
    /// It is recorded.
    Accepted(Failure),
    /// It is verified first.
    ToVerify(Failure),
    /// It tells of a defect, or of a faulty machine: it counts once no attempt is left.
    Suspected(Failure),
}

/// Judges a failure that a worker process reports.
///
/// # Errors
/// What such a worker cannot know, or what is out of its bounds.
pub(crate) fn checked(failure: Failure, attempt: Attempt) -> Result<Claim, FieldError> {
    let at = |member: &str, detail: String| FieldError::new(format!("/failure/{member}"), detail);
    match failure.code {
        FailureCode::ValidationError
        | FailureCode::InfeasibleMix
        | FailureCode::CoarseMix
        | FailureCode::TooLarge
        | FailureCode::TargetNotReached => match error_of(&failure) {
            Some(error) => Ok(Claim::ToVerify(error.into())),
            None => Err(at("facts", format!("the figures of {:?} are missing", failure.code.name()))),
        },
        FailureCode::TimedOut => {
            let Some(timeout_s) = attempt.timeout_s else {
                return Err(at("code", "the job has no timeout_s".into()));
            };
            let ran_s = attempt.ran.as_secs_f64();
            if ran_s < LEAST_SHARE_OF_TIMEOUT * timeout_s {
                let detail = format!("the attempt began {ran_s} s ago: the job may run for {timeout_s} s");
                return Err(at("code", detail));
            }
            let done = failure.facts.fraction_done.unwrap_or(0.0);
            if !(0.0..=1.0).contains(&done) {
                return Err(at(
                    "facts/fraction_done",
                    format!("{done} is out of range: must be from 0 to 1"),
                ));
            }
            Ok(Claim::Accepted(Failure::timed_out(timeout_s, done)))
        }
        FailureCode::OutOfMemory => {
            if attempt.faults < MEMORY_FAULTS {
                let detail = format!(
                    "the job has met {} faults: the outcome is `faulted` until it has met {MEMORY_FAULTS}",
                    attempt.faults
                );
                return Err(at("code", detail));
            }
            let bytes = failure.facts.needed_bytes.unwrap_or(0);
            if i64::try_from(bytes).is_err() {
                let detail = format!("{bytes} is out of range: must be at most {}", i64::MAX);
                return Err(at("facts/needed_bytes", detail));
            }
            Ok(Claim::Accepted(PackError::OutOfMemory { bytes }.into()))
        }
        FailureCode::CheckFailed | FailureCode::InternalError => {
            let length = failure.detail.chars().count();
            if length > MAX_DETAIL_CHARS || failure.detail.chars().any(char::is_control) {
                let detail =
                    format!("has {length} characters: must be one line of at most {MAX_DETAIL_CHARS}");
                return Err(at("detail", detail));
            }
            Ok(Claim::Suspected(Failure::new(failure.code, failure.detail)))
        }
        FailureCode::MalformedJson
        | FailureCode::FormatNotAvailable
        | FailureCode::AttemptsExhausted
        | FailureCode::InsufficientStorage
        | FailureCode::ResultDamaged
        | FailureCode::MachineFault => {
            Err(at("code", format!("{:?} is not the end of a packing", failure.code.name())))
        }
    }
}

/// Judges a failure that a worker process reports of an export which has met so many faults of machines. Its words are
/// those of the engine on that machine, so that they are kept, as one line of a bounded length.
///
/// # Errors
/// What such a worker cannot know.
pub(crate) fn of_export(failure: Failure, faults: i64) -> Result<Claim, FieldError> {
    let code = failure.code;
    let line = |text: String| {
        text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MAX_DETAIL_CHARS).collect::<String>()
    };
    let fields = failure.fields.into_iter().take(MAX_FIELDS);
    let fields = fields.map(|field| FieldError::new(line(field.pointer), line(field.detail))).collect();
    let kept = Failure { fields, ..Failure::new(code, line(failure.detail)) };
    match code {
        FailureCode::ValidationError
        | FailureCode::TooLarge
        | FailureCode::FormatNotAvailable
        | FailureCode::InsufficientStorage
        // Gmsh failed, or met its limit of time or memory.
        | FailureCode::MachineFault => Ok(Claim::Accepted(kept)),
        FailureCode::OutOfMemory if faults >= MEMORY_FAULTS => Ok(Claim::Accepted(kept)),
        FailureCode::CheckFailed | FailureCode::InternalError => Ok(Claim::Suspected(kept)),
        FailureCode::OutOfMemory
        | FailureCode::InfeasibleMix
        | FailureCode::CoarseMix
        | FailureCode::TargetNotReached
        | FailureCode::TimedOut
        | FailureCode::MalformedJson
        | FailureCode::AttemptsExhausted
        | FailureCode::ResultDamaged => {
            let detail = format!("{:?} is not the end of an export", code.name());
            Err(FieldError::new("/failure/code", detail))
        }
    }
}

/// The error of the engine that a failure tells of; `None` where its figures are missing.
pub(crate) fn error_of(failure: &Failure) -> Option<PackError> {
    let only_field = || match failure.fields.as_slice() {
        [field] => Some(field.clone()),
        _ => None,
    };
    match failure.code {
        FailureCode::ValidationError => Some(PackError::Plan(PlanError::Invalid(failure.fields.clone()))),
        FailureCode::InfeasibleMix => only_field().map(|field| PackError::Plan(PlanError::Infeasible(field))),
        FailureCode::CoarseMix => only_field().map(|field| PackError::Plan(PlanError::Coarse(field))),
        FailureCode::TooLarge => only_field().map(|field| PackError::Plan(PlanError::TooLarge(field))),
        FailureCode::TargetNotReached => not_reached(&failure.facts).map(PackError::TargetNotReached),
        _ => None,
    }
}

fn not_reached(facts: &FailureFacts) -> Option<TargetNotReached> {
    let (grains, volume_fraction_reached) = (facts.grains?, facts.volume_fraction_reached?);
    let volume_fraction_asked = facts.volume_fraction_asked?;
    if let Some(placed) = facts.placed {
        return Some(TargetNotReached::InsertionFailed(InsertionFailed {
            placed,
            grains,
            diameter_mm: facts.diameter_mm?,
            volume_fraction_reached,
            volume_fraction_asked,
            saturation_proven: facts.saturation_proven?,
            attempts: facts.attempts.filter(|attempts| i64::try_from(*attempts).is_ok())?,
            amount: facts.amount.unwrap_or_default(),
        }));
    }
    let is_count = |count: &u64| i64::try_from(*count).is_ok();
    let effort = match facts.events.filter(is_count) {
        Some(events) => {
            GrowthEffort::Events { events, simulated_time_s: facts.simulated_time_s.filter(|s| *s >= 0.0)? }
        }
        None => GrowthEffort::Cycles {
            cycles: facts.compression_cycles.filter(is_count)?,
            moves: facts.moves.filter(is_count)?,
        },
    };
    Some(TargetNotReached::GrowthStopped(GrowthStopped {
        grains,
        volume_fraction_reached,
        volume_fraction_asked,
        distance_mm_reached: facts.distance_mm_reached,
        distance_mm_asked: facts.distance_mm_asked,
        scale_reached: facts.scale_reached?,
        effort,
        end: facts.end?,
        amount: facts.amount.unwrap_or_default(),
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use packstone_engine::packing::GrowthEnd;
    use packstone_engine::request::Amount;

    use super::*;

    const ATTEMPT: Attempt = Attempt { timeout_s: None, ran: Duration::from_secs(10), faults: 0 };

    fn refused(failure: Failure, attempt: Attempt) -> String {
        checked(failure, attempt).unwrap_err().pointer
    }

    #[test]
    fn codes_that_no_worker_can_know_are_refused() {
        for code in FailureCode::ALL {
            let found = checked(Failure::new(*code, "why"), ATTEMPT);
            let is_suspected = matches!(code, FailureCode::CheckFailed | FailureCode::InternalError);
            let is_plan = *code == FailureCode::ValidationError;
            assert_eq!(found.is_ok(), is_suspected || is_plan, "{code:?}: {found:?}");
        }
    }

    #[test]
    fn a_timeout_needs_a_limit_that_has_passed() {
        let failure = Failure::timed_out(15.0, 0.25);
        assert_eq!(refused(failure.clone(), ATTEMPT), "/failure/code");
        let attempt = Attempt { timeout_s: Some(15.0), ..ATTEMPT };
        let mut with_text = failure.clone();
        with_text.detail = "x".repeat(1 << 20);
        assert_eq!(checked(with_text, attempt).unwrap(), Claim::Accepted(failure.clone()));
        assert_eq!(refused(failure.clone(), Attempt { timeout_s: Some(21.0), ..ATTEMPT }), "/failure/code");
        assert_eq!(refused(Failure::timed_out(15.0, 1.5), attempt), "/failure/facts/fraction_done");
    }

    #[test]
    fn memory_is_believed_after_faults_and_texts_are_bounded() {
        let failure = Failure::from(PackError::OutOfMemory { bytes: 7 });
        assert_eq!(refused(failure.clone(), ATTEMPT), "/failure/code");
        let attempt = Attempt { faults: MEMORY_FAULTS, ..ATTEMPT };
        assert_eq!(checked(failure.clone(), attempt).unwrap(), Claim::Accepted(failure));
        for text in ["x".repeat(1001), "two\nlines".to_owned()] {
            assert_eq!(refused(Failure::new(FailureCode::CheckFailed, text), ATTEMPT), "/failure/detail");
        }
    }

    #[test]
    fn of_an_export_only_what_its_maker_can_know_is_taken_and_its_text_is_one_line() {
        for code in FailureCode::ALL {
            let found = of_export(Failure::new(*code, "why"), 0);
            let is_final = matches!(
                code,
                FailureCode::ValidationError
                    | FailureCode::TooLarge
                    | FailureCode::FormatNotAvailable
                    | FailureCode::InsufficientStorage
                    | FailureCode::MachineFault
            );
            let is_suspected = matches!(code, FailureCode::CheckFailed | FailureCode::InternalError);
            assert_eq!(matches!(found, Ok(Claim::Accepted(_))), is_final, "{code:?}: {found:?}");
            assert_eq!(matches!(found, Ok(Claim::Suspected(_))), is_suspected, "{code:?}: {found:?}");
        }
        let memory = Failure::new(FailureCode::OutOfMemory, "out of memory");
        assert_eq!(of_export(memory.clone(), MEMORY_FAULTS).unwrap(), Claim::Accepted(memory));
        // A program that is missing on the machine of the worker: the words of the engine there are what helps.
        let long = Failure::new(FailureCode::FormatNotAvailable, format!("no Gmsh:\n{}", "x".repeat(2000)));
        let Ok(Claim::Accepted(kept)) = of_export(long, 0) else { panic!("it is requeued for ever") };
        assert_eq!(kept.detail, format!("no Gmsh: {}", "x".repeat(991)));
    }

    #[test]
    fn a_failure_reads_back_as_the_error_that_it_came_from() {
        let stopped = GrowthStopped {
            grains: 7,
            volume_fraction_reached: 0.5,
            volume_fraction_asked: 0.6,
            distance_mm_reached: Some(0.1),
            distance_mm_asked: Some(0.2),
            scale_reached: 0.9,
            effort: GrowthEffort::Cycles { cycles: 3, moves: 12 },
            end: GrowthEnd::Stalled,
            amount: Amount::List,
        };
        let failed = InsertionFailed {
            placed: 3,
            grains: 7,
            diameter_mm: 2.0,
            volume_fraction_reached: 0.1,
            volume_fraction_asked: 0.2,
            saturation_proven: true,
            attempts: 9,
            amount: Amount::Volume,
        };
        let events = GrowthEffort::Events { events: 5, simulated_time_s: 0.5 };
        for reached in [
            TargetNotReached::GrowthStopped(stopped.clone()),
            TargetNotReached::GrowthStopped(GrowthStopped { effort: events, ..stopped }),
            TargetNotReached::InsertionFailed(failed),
        ] {
            let error = PackError::TargetNotReached(reached);
            let failure = Failure::from(error.clone());
            assert_eq!(error_of(&failure), Some(error));
            assert_eq!(checked(failure.clone(), ATTEMPT).unwrap(), Claim::ToVerify(failure));
        }
        let field = FieldError::new("/mix/volume_fraction", "too much");
        let error = PackError::Plan(PlanError::Infeasible(field));
        assert_eq!(error_of(&Failure::from(error.clone())), Some(error));
    }
}
