//! What a result says of a run that ended before its target, and whose packing was kept.

use serde::{Deserialize, Serialize};

/// How far a run came that ended before its target. Sizes and distances of the packing are those stated here.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Partial {
    /// Why the run ended.
    pub reason: PartialReason,
    /// Volume of the grains over that of the specimen (`phi_eff`), as requested; `null` where it was to be as large as
    /// possible.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub volume_fraction_requested: Option<f64>,
    /// The same of the packing.
    pub volume_fraction_reached: f64,
    /// The constant distance requested; `null` where none was, and where it was to be as large as possible.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub distance_mm_requested: Option<f64>,
    /// The constant distance that all grains keep; `null` where it varies from pair to pair.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub distance_mm_reached: Option<f64>,
    /// The factor on the sizes of all grains, the largest at which every pair and every wall keeps its distance, but
    /// at most 1 unless the volume fraction was to be as large as possible.
    pub size_scale: f64,
    /// Number of grains of the mix.
    pub grains_requested: u64,
    /// Number of grains of the packing: fewer where random addition ended early.
    pub grains_placed: u64,
}

/// Why a run ended before its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum PartialReason {
    /// The limit of time of the method.
    TimeLimit,
    /// The limit of events or of sweeps of the method.
    EventLimit,
    /// The grains jammed.
    Stalled,
    /// Random addition found no place for a grain.
    Saturated,
    /// The time limit of the job.
    TimedOut,
    /// A request to finish with what was reached.
    Finished,
}
