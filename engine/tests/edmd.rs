//! Growth through the public interface. The module has the name of the one inside the engine, so that
//! `cargo test edmd` runs both.

mod cases;
mod mixes;
mod physics;
mod resume;
mod stops;
mod threads;
mod valid;

pub(crate) use resume::{Killer, resume as resume_from};
