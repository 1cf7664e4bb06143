//! Failures: why a request cannot be carried out, or why a job or an export ended without a result.
//!
//! Jobs and exports store failures, and retries are decided by [`FailureCode`]. A failure knows no status and no
//! address; the HTTP layer renders it as a problem document (RFC 9457). `layers.rs` tests that this module imports
//! nothing of the service.

use packstone_engine::export::ExportError;
use packstone_engine::packing::GrowthEnd;
use packstone_engine::request::Amount;
use packstone_engine::{FieldError, GrowthEffort, PackError, PlanError, TargetNotReached};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

macro_rules! codes {
    ($($(#[doc = $doc:literal])* $variant:ident $name:literal;)*) => {
        /// The kind of a failure, by which programs decide.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize)]
        #[serde(from = "String")]
        pub(crate) enum FailureCode { $($(#[doc = $doc])* $variant,)* }

        impl FailureCode {
            /// All codes.
            #[cfg(test)]
            pub(crate) const ALL: &[Self] = &[$(Self::$variant,)*];

            /// Name in the store and in the interface.
            pub(crate) fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// The code of that name.
            pub(crate) fn from_name(name: &str) -> Option<Self> {
                match name { $($name => Some(Self::$variant),)* _ => None }
            }
        }
    };
}

codes! {
    /// A text is not JSON.
    MalformedJson "malformed-json";
    /// A field is unknown, missing, of the wrong type or out of its bounds.
    ValidationError "validation-error";
    /// No arrangement of grains reaches the volume fraction.
    InfeasibleMix "infeasible-mix";
    /// Whole grains miss the requested volume by too much.
    CoarseMix "coarse-mix";
    /// More grains, memory, bytes or jobs than the limits allow.
    TooLarge "too-large";
    /// An export does not exist for such a specimen or packing.
    FormatNotAvailable "format-not-available";
    /// The method ended before all grains were placed or had grown to their size and gap.
    TargetNotReached "target-not-reached";
    /// A job ran longer than its `timeout_s`.
    TimedOut "timed-out";
    /// The server stopped during every attempt that was allowed.
    AttemptsExhausted "attempts-exhausted";
    /// The independent check refused the packing or the export.
    CheckFailed "check-failed";
    /// The file system has too little free space.
    InsufficientStorage "insufficient-storage";
    /// A stored result is missing or its contents are damaged.
    ResultDamaged "result-damaged";
    /// The machine failed (file system, file handles, memory): a later attempt can succeed.
    MachineFault "machine-fault";
    /// The system refused memory that a job or an export needs: a later attempt can succeed.
    OutOfMemory "out-of-memory";
    /// A defect of the program, described in its log.
    InternalError "internal-error";
}

impl From<String> for FailureCode {
    /// A code of another version of this program is an internal error: its meaning is unknown.
    fn from(name: String) -> Self {
        Self::from_name(&name).unwrap_or(Self::InternalError)
    }
}

impl Serialize for FailureCode {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl FailureCode {
    /// Whether another attempt with the same input can succeed: after a full disk or a crash it can, and after a
    /// damaged result, which is restored or computed again; after a failure that options or packing decide it cannot.
    pub(crate) fn is_transient(self) -> bool {
        matches!(
            self,
            Self::InternalError
                | Self::AttemptsExhausted
                | Self::InsufficientStorage
                | Self::ResultDamaged
                | Self::MachineFault
                | Self::OutOfMemory
        )
    }
}

/// A failure that occurred.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Failure {
    pub(crate) code: FailureCode,
    /// One sentence on this occurrence.
    pub(crate) detail: String,
    /// Faulty fields of the request, each with its place.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) fields: Vec<FieldError>,
    /// How far a run came.
    #[serde(default)]
    pub(crate) facts: Box<FailureFacts>,
}

/// Figures that belong to a failure: how far a run came, what was missing. Which of them are present depends on the
/// code.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(no_recursion))]
pub(crate) struct FailureFacts {
    /// Number of grains that the packing should have.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) grains: Option<u64>,
    /// Number of grains that were placed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) placed: Option<u64>,
    /// Diameter of the grain for which no position was found, in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) diameter_mm: Option<f64>,
    /// Volume fraction of the grains when the run ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) volume_fraction_reached: Option<f64>,
    /// Volume fraction that the grains should have.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) volume_fraction_asked: Option<f64>,
    /// Gap that all grains kept when the run ended, in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) distance_mm_reached: Option<f64>,
    /// Gap that the grains should keep, in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) distance_mm_asked: Option<f64>,
    /// Ratio of the diameters reached to the final diameters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) scale_reached: Option<f64>,
    /// Number of events of the simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) events: Option<u64>,
    /// Time of the simulated motion, in s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) simulated_time_s: Option<f64>,
    /// Compression cycles of hard-particle Monte Carlo.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) compression_cycles: Option<u64>,
    /// Moves of grains that hard-particle Monte Carlo tried.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) moves: Option<u64>,
    /// Which criterion ended the growth of the grains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) end: Option<GrowthEnd>,
    /// Whether it is proven that no further grain of this diameter can be inserted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) saturation_proven: Option<bool>,
    /// What says how much aggregate the request has, where it is no volume: a number of grains, or a list of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) amount: Option<Amount>,
    /// Number of insertions tried for the grain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) attempts: Option<u64>,
    /// Free space or memory that is needed, in bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) needed_bytes: Option<u64>,
    /// Free space that there is, in bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) free_bytes: Option<u64>,
    /// Progress of the run when it was stopped, from 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false, minimum = 0, maximum = 1))]
    pub(crate) fraction_done: Option<f64>,
    /// Changes of the request of the job with which a run can succeed, the surest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(test, schema(required = false, inline))]
    pub(crate) changes: Vec<Change>,
}

/// A change of a request with which a run can succeed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Change {
    /// What it does, in a few words.
    pub(crate) title: String,
    /// The change as a JSON merge patch (RFC 7396) of the request of the job.
    #[cfg_attr(test, schema(value_type = Object))]
    pub(crate) patch: Value,
}

impl Change {
    /// A change with its title.
    pub(crate) fn new(title: impl Into<String>, patch: Value) -> Self {
        Self { title: title.into(), patch }
    }
}

impl Failure {
    /// A failure with one sentence on this occurrence.
    pub(crate) fn new(code: FailureCode, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), fields: Vec::new(), facts: Box::default() }
    }

    /// A defect of this program. What exactly happened is in the log, not in the failure.
    pub(crate) fn internal() -> Self {
        Self::new(FailureCode::InternalError, "the server could not complete the request; its log says why")
    }

    /// Faulty fields; the detail is the first fault.
    pub(crate) fn fields(code: FailureCode, fields: Vec<FieldError>) -> Self {
        Self { fields, ..Self::new(code, "") }.with_first_as_detail()
    }

    /// A request that breaks its bounds.
    pub(crate) fn invalid(fields: Vec<FieldError>) -> Self {
        Self::fields(FailureCode::ValidationError, fields)
    }

    /// A job that ran longer than its `timeout_s`, with the share of its work that was done.
    pub(crate) fn timed_out(timeout_s: f64, fraction_done: f64) -> Self {
        let done = 100.0 * fraction_done;
        let detail = format!(
            "the run took longer than the {timeout_s} s that it may (timeout_s of the job, or --max-run-s of the server); \
             about {done:.0} % of the work was done; on_limit \"keep\" keeps what was reached"
        );
        let changes = vec![
            Change::new("Keep the packing that is reached within the time", json!({"on_limit": "keep"})),
            Change::new("Allow twice the time", json!({"timeout_s": 2.0 * timeout_s})),
        ];
        let facts = FailureFacts { fraction_done: Some(fraction_done), changes, ..FailureFacts::default() };
        Self::new(FailureCode::TimedOut, detail).with_facts(facts)
    }

    /// The same failure with figures.
    pub(crate) fn with_facts(self, facts: FailureFacts) -> Self {
        Self { facts: Box::new(facts), ..self }
    }

    /// The same failure with the bytes that were refused.
    fn with_needed(self, bytes: u64) -> Self {
        self.with_facts(FailureFacts { needed_bytes: Some(bytes), ..FailureFacts::default() })
    }

    /// The same failure of a document that lies at `place` in another document.
    pub(crate) fn below(mut self, place: &str) -> Self {
        if self.fields.is_empty() {
            self.fields.push(FieldError::new(place, self.detail.clone()));
        } else {
            for field in &mut self.fields {
                *field =
                    FieldError::new(format!("{place}{}", field.pointer), std::mem::take(&mut field.detail));
            }
        }
        self.with_first_as_detail()
    }

    fn with_first_as_detail(mut self) -> Self {
        if let Some(first) = self.fields.first() {
            self.detail = first_of(&first.to_string(), self.fields.len());
        }
        self
    }
}

/// The first of `count` faults, and how many more there are.
pub(crate) fn first_of(first: &str, count: usize) -> String {
    if count > 1 { format!("{first} (and {} more)", count - 1) } else { first.to_owned() }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Invalid(fields) => Self::fields(FailureCode::ValidationError, fields),
            PlanError::TooLarge(field) => Self::fields(FailureCode::TooLarge, vec![field]),
            PlanError::Coarse(field) => Self::fields(FailureCode::CoarseMix, vec![field]),
            PlanError::Infeasible(field) => Self::fields(FailureCode::InfeasibleMix, vec![field]),
        }
    }
}

/// A run that ended without a packing. [`PackError::Stopped`] is not an end of its own: the caller that stopped the run
/// knows the reason.
impl From<PackError> for Failure {
    fn from(error: PackError) -> Self {
        let detail = error.to_string();
        match error {
            PackError::Plan(plan) => plan.into(),
            PackError::TargetNotReached(reached) => {
                Self::new(FailureCode::TargetNotReached, detail).with_facts(reached.into())
            }
            PackError::CheckFailed(_) => Self::new(FailureCode::CheckFailed, detail),
            PackError::OutOfMemory { bytes } => {
                Self::new(FailureCode::OutOfMemory, detail).with_needed(bytes)
            }
            PackError::Stopped { .. } => Self::new(FailureCode::InternalError, detail),
        }
    }
}

impl FailureFacts {
    fn of_effort(effort: GrowthEffort) -> Self {
        match effort {
            GrowthEffort::Events { events, simulated_time_s } => {
                Self { events: Some(events), simulated_time_s: Some(simulated_time_s), ..Self::default() }
            }
            GrowthEffort::Cycles { cycles, moves } => {
                Self { compression_cycles: Some(cycles), moves: Some(moves), ..Self::default() }
            }
        }
    }
}

impl From<TargetNotReached> for FailureFacts {
    fn from(reached: TargetNotReached) -> Self {
        match reached {
            TargetNotReached::GrowthStopped(reached) => Self {
                grains: Some(reached.grains),
                volume_fraction_reached: Some(reached.volume_fraction_reached),
                volume_fraction_asked: Some(reached.volume_fraction_asked),
                distance_mm_reached: reached.distance_mm_reached,
                distance_mm_asked: reached.distance_mm_asked,
                scale_reached: Some(reached.scale_reached),
                end: Some(reached.end),
                amount: Some(reached.amount).filter(|amount| *amount != Amount::Volume),
                ..Self::of_effort(reached.effort)
            },
            TargetNotReached::InsertionFailed(reached) => Self {
                placed: Some(reached.placed),
                grains: Some(reached.grains),
                diameter_mm: Some(reached.diameter_mm),
                volume_fraction_reached: Some(reached.volume_fraction_reached),
                volume_fraction_asked: Some(reached.volume_fraction_asked),
                saturation_proven: Some(reached.saturation_proven),
                attempts: Some(reached.attempts),
                amount: Some(reached.amount).filter(|amount| *amount != Amount::Volume),
                ..Self::default()
            },
        }
    }
}

/// An export that was not made. [`ExportError::Stopped`] is not an end of its own either; why a file could not be
/// written is in the log.
impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Self {
        let detail = error.to_string();
        match error {
            ExportError::Invalid(fields) => Self::fields(FailureCode::ValidationError, fields),
            ExportError::Unavailable(_) => Self::new(FailureCode::FormatNotAvailable, detail),
            ExportError::TooLarge(field) => Self::fields(FailureCode::TooLarge, vec![field]),
            ExportError::CheckFailed(_) => Self::new(FailureCode::CheckFailed, detail),
            ExportError::Mesher(_) => Self::new(FailureCode::MachineFault, detail),
            ExportError::Stopped => Self::new(FailureCode::InternalError, detail),
            ExportError::OutOfMemory { bytes } => {
                Self::new(FailureCode::OutOfMemory, detail).with_needed(bytes)
            }
            ExportError::Write(error) => {
                Self::new(FailureCode::InternalError, format!("it could not be written: {}", error.kind()))
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn fault(pointer: &str) -> FieldError {
        FieldError::new(pointer, "9 is too much")
    }

    #[test]
    fn a_stored_failure_reads_back() {
        let facts = FailureFacts { grains: Some(7), scale_reached: Some(0.1), ..FailureFacts::default() };
        for code in FailureCode::ALL {
            let failure =
                Failure::fields(*code, vec![fault("/cells"), fault("/mix/air")]).with_facts(facts.clone());
            let stored = serde_json::to_string(&failure).unwrap();
            assert_eq!(serde_json::from_str::<Failure>(&stored).unwrap(), failure, "{stored}");
        }
        let unknown: Failure = serde_json::from_str(r#"{"code": "from-the-future", "detail": "x"}"#).unwrap();
        assert_eq!(unknown.code, FailureCode::InternalError);
    }

    #[test]
    fn only_failures_of_machine_and_program_are_transient() {
        for code in FailureCode::ALL {
            let transient = [
                "internal-error",
                "attempts-exhausted",
                "insufficient-storage",
                "result-damaged",
                "machine-fault",
                "out-of-memory",
            ];
            assert_eq!(code.is_transient(), transient.contains(&code.name()), "{}", code.name());
        }
    }

    #[test]
    fn refused_memory_has_a_code_and_a_figure() {
        for failure in [
            Failure::from(PackError::OutOfMemory { bytes: 7_000_000 }),
            Failure::from(ExportError::OutOfMemory { bytes: 7_000_000 }),
        ] {
            assert_eq!(
                (failure.code, failure.facts.needed_bytes),
                (FailureCode::OutOfMemory, Some(7_000_000))
            );
            assert!(failure.detail.contains("7 MB"), "{}", failure.detail);
        }
    }

    #[test]
    fn faults_of_a_part_get_the_place_of_the_part() {
        let below =
            Failure::fields(FailureCode::TooLarge, vec![fault("/cells"), fault("")]).below("/postprocess/0");
        assert_eq!(below.fields[0].pointer, "/postprocess/0/cells");
        assert_eq!(below.fields[1].pointer, "/postprocess/0");
        assert_eq!(below.detail, "/postprocess/0/cells: 9 is too much (and 1 more)");
        let without_place = Failure::new(FailureCode::FormatNotAvailable, "no").below("/postprocess");
        assert_eq!(without_place.detail, "/postprocess: no");
        assert_eq!(without_place.fields[0].pointer, "/postprocess");
    }
}
