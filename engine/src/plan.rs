//! The plan of a run: what a request amounts to, before a single grain is drawn.
//!
//! Expected counts in closed form, volume fractions, memory, and whether the mix can fit at all.
//! It knows the mix, the specimen and the distance rule; it must never draw a random number.

use serde::Serialize;

use crate::error::PlanError;
use crate::request::PackingRequest;

/// What a run may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most grains of one packing.
    pub max_grains: u64,
    /// Most memory of one packing, in bytes.
    pub max_memory_bytes: u64,
}

impl Default for Limits {
    /// 20 million grains, 8 GB.
    fn default() -> Self {
        Self { max_grains: 20_000_000, max_memory_bytes: 8_000_000_000 }
    }
}

/// What a request amounts to.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Plan {
    /// Expected number of grains.
    pub grains: f64,
    /// Volume of the specimen.
    pub specimen_volume_mm3: f64,
    /// Volume of all aggregate over that of the specimen (`phi_M`).
    pub volume_fraction_mixture: f64,
    /// Volume of the grains to place over that of the specimen (`phi_eff`).
    pub volume_fraction_effective: f64,
    /// The same with each grain enlarged by half the distance it keeps from its own kind.
    pub volume_fraction_with_coating: f64,
    /// Memory that the run will use at its peak.
    pub memory_bytes: u64,
    /// CPU time that the run is likely to take; a rough guess.
    pub estimated_time_s: f64,
    /// Expected grains by size class, from fine to coarse.
    pub classes: Vec<ClassPlan>,
    /// What is likely to go wrong, in words.
    pub warnings: Vec<String>,
}

/// Expected grains of one size class.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ClassPlan {
    /// Lower sieve.
    pub d_min_mm: f64,
    /// Upper sieve.
    pub d_max_mm: f64,
    /// Expected number of grains.
    pub grains: f64,
    /// Volume that the grading curve asks for.
    pub volume_mm3: f64,
}

impl Plan {
    /// Plans a request.
    ///
    /// # Errors
    /// When a grain does not fit into the specimen, when there are more grains than `limits`
    /// allow, or when no arrangement of spheres reaches the volume fraction.
    pub fn new(request: &PackingRequest, limits: &Limits) -> Result<Self, PlanError> {
        let _ = (request, limits);
        unimplemented!()
    }
}
