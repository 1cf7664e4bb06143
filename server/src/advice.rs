//! What can be done after a run that failed: whether a second run of the same job can succeed, and changes of its
//! request that can.
//!
//! Runs are deterministic. A second one ends as the first did unless the machine, its speed or its load decided the
//! end.

use packstone_engine::packing::GrowthEnd;
use packstone_engine::request::{GrowthOptions, Method, OnLimit, PackingRequest, VolumeFraction};
use packstone_engine::{Limits, PackError, Plan};
use serde_json::json;

use crate::failure::{Change, Failure, FailureCode, FailureFacts};

/// Share of the volume fraction that a run has reached which another run is likely to reach.
const SAFE_SHARE: f64 = 0.98;
/// A run that has reached this share of its volume fraction may reach all of it with other grains.
const NEAR_SHARE: f64 = 0.97;
/// Least probability of success, by its plan, of a method that is proposed.
const LEAST_PROBABILITY: f64 = 0.5;

/// Whether a second run of the same job can succeed where one has failed so.
pub(crate) fn can_succeed_again(failure: &Failure) -> bool {
    // Limits of time depend on the speed and the load of the machine.
    let by_time = failure.facts.end == Some(GrowthEnd::TimeLimit);
    failure.code.is_transient() || failure.code == FailureCode::TimedOut || by_time
}

/// The failure of a run of this request, with changes that can succeed.
pub(crate) fn failure_of(error: PackError, request: &PackingRequest, limits: &Limits) -> Failure {
    let mut failure = Failure::from(error);
    if failure.code == FailureCode::TargetNotReached {
        failure.facts.changes = after_miss(request, limits, &failure.facts);
    }
    failure
}

/// Changes of the request of a run that did not reach its target, as far as there are any.
fn after_miss(request: &PackingRequest, limits: &Limits, facts: &FailureFacts) -> Vec<Change> {
    let mut changes = Vec::new();
    if request.on_limit == OnLimit::Fail {
        changes.push(Change::new("Keep the packing that is reached", json!({"on_limit": "keep"})));
    }
    changes.extend(longer(request, facts.end));
    changes.extend(growth(request, limits));
    if let (Some(reached), Some(asked)) = (facts.volume_fraction_reached, facts.volume_fraction_asked)
        && asked > 0.0
    {
        changes.extend(lower_fraction(request, reached / asked));
        if reached >= NEAR_SHARE * asked {
            changes.push(Change::new("Draw other grains by another seed", json!({"seed": null})));
        }
    }
    changes
}

/// Twice the limit that ended the growth.
fn longer(request: &PackingRequest, end: Option<GrowthEnd>) -> Option<Change> {
    let stop = serde_json::to_value(request.method).ok()?["stop"].take();
    let (limit, value) = match end? {
        GrowthEnd::TimeLimit => ("time_s", json!(2.0 * stop["time_s"].as_f64()?)),
        GrowthEnd::EventLimit => ("events", json!(stop["events"].as_u64()?.saturating_mul(2))),
        GrowthEnd::SweepLimit => ("sweeps", json!(stop["sweeps"].as_u64()?.saturating_mul(2))),
        _ => return None,
    };
    Some(Change::new(format!("Twice the limit {limit}"), json!({"method": {"stop": {limit: value}}})))
}

/// Growth in place of random addition, where it is likely to reach the target.
fn growth(request: &PackingRequest, limits: &Limits) -> Option<Change> {
    let Method::Rsa { .. } = request.method else { return None };
    let method = Method::Growth { options: GrowthOptions::default() };
    let grown = PackingRequest { method, ..request.clone() };
    let plan = Plan::new(&grown, limits).ok()?;
    (plan.success_probability >= LEAST_PROBABILITY).then(|| {
        let patch = json!({"method": {"type": "growth", "attempts_per_grain": null}});
        Change::new("Grow the grains in place of random addition", patch)
    })
}

/// The share of the requested volume fraction that was reached, and a little less.
fn lower_fraction(request: &PackingRequest, reached: f64) -> Option<Change> {
    let Some(VolumeFraction::Of(asked)) = request.mix.volume_fraction else { return None };
    // Three digits, rounded down.
    let fraction = (asked * reached * SAFE_SHARE * 1000.0).floor() / 1000.0;
    (fraction > 0.0 && fraction < asked).then(|| {
        Change::new(format!("A volume fraction of {fraction}"), json!({"mix": {"volume_fraction": fraction}}))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::Value;

    use super::*;

    fn request(method: &Value) -> PackingRequest {
        let request = json!({
            "seed": 7, "specimen": {"type": "box", "size_mm": [40, 40, 40]},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.5},
            "method": method,
        });
        PackingRequest::from_json(&request, 0).unwrap()
    }

    fn patches(method: &Value, facts: &FailureFacts) -> Vec<Value> {
        let changes = after_miss(&request(method), &Limits::default(), facts);
        changes.into_iter().map(|change| change.patch).collect()
    }

    #[test]
    fn a_second_run_is_offered_only_where_the_machine_decided_the_end() {
        let ended = |end| {
            let facts = FailureFacts { end: Some(end), ..FailureFacts::default() };
            Failure::new(FailureCode::TargetNotReached, "").with_facts(facts)
        };
        assert!(can_succeed_again(&ended(GrowthEnd::TimeLimit)));
        assert!(
            !can_succeed_again(&ended(GrowthEnd::Stalled))
                && !can_succeed_again(&ended(GrowthEnd::EventLimit))
        );
        for code in FailureCode::ALL {
            let again = [
                "internal-error",
                "attempts-exhausted",
                "insufficient-storage",
                "result-damaged",
                "machine-fault",
                "out-of-memory",
                "timed-out",
            ];
            let failure = Failure::new(*code, "");
            assert_eq!(can_succeed_again(&failure), again.contains(&code.name()), "{}", code.name());
        }
    }

    #[test]
    fn changes_follow_from_what_was_reached() {
        let placed = FailureFacts {
            volume_fraction_reached: Some(0.3),
            volume_fraction_asked: Some(0.4),
            saturation_proven: Some(true),
            ..FailureFacts::default()
        };
        assert_eq!(
            patches(&json!({"type": "rsa"}), &placed),
            [
                json!({"on_limit": "keep"}),
                json!({"method": {"type": "growth", "attempts_per_grain": null}}),
                // 0.5 * 0.75 * 0.98 = 0.3675
                json!({"mix": {"volume_fraction": 0.367}}),
            ]
        );
        let near = FailureFacts {
            volume_fraction_reached: Some(0.399),
            volume_fraction_asked: Some(0.4),
            end: Some(GrowthEnd::EventLimit),
            ..FailureFacts::default()
        };
        assert_eq!(
            patches(&json!({"type": "edmd", "stop": {"events": 1000}}), &near),
            [
                json!({"on_limit": "keep"}),
                json!({"method": {"stop": {"events": 2000}}}),
                json!({"mix": {"volume_fraction": 0.488}}),
                json!({"seed": null}),
            ]
        );
    }
}
