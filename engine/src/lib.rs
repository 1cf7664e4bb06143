//! Packstone's engine: from a concrete mix design to a dense, checked packing of spheres.
//!
//! Data passes one way: [`request`] (what is asked for) -> [`mix`] and [`specimen`] -> [`plan`]
//! (what to expect, and whether it can fit) -> [`rsa`], [`edmd`] -> [`verify`] -> [`packing`] -> [`mod@format`].
//! The engine is pure: it computes, reports through [`control`], and writes to writers that it is
//! handed. It knows no files, no network, no other clock than to state how long a phase took.
// Allowed in `edmd::prefetch` alone.
#![deny(unsafe_code)]

pub mod analysis;
pub mod checkpoint;
pub mod control;
pub mod delaunay;
pub mod derived;
pub mod distance;
pub mod edmd;
pub mod error;
pub mod format;
pub mod ldpm;
pub mod mesh;
pub mod mix;
mod pack;
pub mod packing;
mod placement;
pub mod plan;
pub mod request;
mod rng;
pub mod rsa;
pub mod slice;
pub mod specimen;
pub mod verify;
pub mod voxels;

pub use checkpoint::{Checkpoint, CheckpointError, Resume};
pub use control::{Control, Growth, Phase, Progress, Unattended};
pub use error::{NoPlace, NotGrown, NotReached, PackError, PlanError};
pub use pack::{pack, pack_or_resume};
pub use packing::{Packing, Report, Spheres};
pub use plan::{Limits, Plan};
pub use request::{FieldError, PackingRequest};

/// Version of the engine, recorded in every result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
