//! Packstone's engine: from a concrete mix design to a dense, checked packing of spheres.
//!
//! Data passes one way: [`request`] (what is asked for) -> [`mix`] and [`domain`] -> [`plan`] (what to expect, and
//! whether it can fit) -> [`methods`] -> [`check`] -> [`packing`] -> [`export`]. Imports between the modules point
//! down; `tests/layers.rs` holds their order. The engine computes, reports through [`control`], and writes to writers
//! that it is handed; it opens no files and no connections, and reads the clock only to time its steps and to obey a
//! limit of time.
//!
//! ```
//! use packstone_engine::{Limits, PackingRequest, Plan, Unattended, pack};
//! use serde_json::json;
//!
//! let request = PackingRequest::from_json(&json!({
//!     "specimen": {"type": "box", "size_mm": [40, 40, 40]},
//!     "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4},
//! }), 1).unwrap();
//! assert!(Plan::new(&request, &Limits::default()).is_ok());
//! let packing = pack(&request, &Limits::default(), &Unattended)?;
//! assert_eq!(packing.grains.len() as u64, packing.report.summary.grains);
//! # Ok::<(), packstone_engine::PackError>(())
//! ```
// Allowed in `cpu` and `memory::pages` alone.
#![deny(unsafe_code)]
// Tests compare with the functions of the standard library.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod analysis;
mod arrays;
mod bayes;
pub mod blend;
pub mod check;
pub mod checkpoint;
pub mod control;
mod cpu;
pub mod distance;
pub mod domain;
mod elementary;
pub mod error;
pub mod export;
pub mod gap;
pub mod geometry;
mod grain;
pub mod homogenization;
pub mod importer;
mod memory;
pub mod methods;
pub mod mix;
pub mod packing;
pub mod plan;
#[cfg(test)]
mod properties;
pub mod request;
mod rng;
mod run;
pub mod samples;
pub mod segregation;
pub mod shape;
pub mod solution;
mod sorting;
mod summed;
mod template_cache;
mod threads;

/// The name by which `analysis` still finds the region of centres.
pub use checkpoint::{Checkpoint, CheckpointError, Resume};
pub use control::{Control, Finish, Growth, Progress, Step, Unattended};
pub use error::{GrowthEffort, GrowthStopped, InsertionFailed, PackError, PlanError, TargetNotReached};
pub use memory::OutOfMemory;
pub use packing::{Grains, Packing, Report, Solids, Spheres};
pub use plan::{Limits, Plan};
pub use request::{FieldError, PackingRequest};
pub use run::{
    OwnError, OwnMix, OwnPacking, VerifyError, checked_as, compare_stated, inspect, pack, pack_or_resume,
    pack_with, verify, verify_failure,
};
pub use template_cache::TemplateCache;

/// Version of the engine, recorded in every result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
