//! Growth through the public interface. All tests stand in one module, so that `cargo test edmd` runs these
//! and those inside the engine.
#![allow(clippy::unwrap_used)]

mod edmd {
    mod cases;
    mod mixes;
    mod physics;
    mod resume;
    mod stops;
    mod valid;
}
