//! Packstone's engine: from a concrete mix design to a dense, checked packing of spheres.
//!
//! Data passes one way: [`request`] (what is asked for) -> [`mix`] and [`specimen`] -> [`plan`]
//! (what to expect, and whether it can fit) -> [`methods`] -> [`check`] -> [`packing`] -> [`export`].
//! The engine is pure: it computes, reports through [`control`], and writes to writers that it is
//! handed. It knows no files, no network, no other clock than to state how long a phase took.
// Allowed in `cpu` alone.
#![deny(unsafe_code)]

pub mod analysis;
pub mod check;
pub mod checkpoint;
pub mod control;
mod cpu;
pub mod distance;
pub mod error;
pub mod export;
pub mod geometry;
mod memory;
pub mod methods;
pub mod mix;
mod pack;
pub mod packing;
pub mod plan;
pub mod request;
mod rng;
mod segregation;
pub mod specimen;

pub use checkpoint::{Checkpoint, CheckpointError, Resume};
pub use control::{Control, Growth, Phase, Progress, Unattended};
pub use error::{GrowthStopped, InsertionFailed, PackError, PlanError, TargetNotReached};
pub use pack::{pack, pack_or_resume};
pub use packing::{Packing, Report, Spheres};
pub use plan::{Limits, Plan};
pub use request::{FieldError, PackingRequest};

/// Version of the engine, recorded in every result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
