//! Packing methods: each finds positions for the grains of a mix in a specimen.
//!
//! [`rsa`] inserts grains one after the other at their final size; [`edmd`] lets smaller grains move, collide and
//! grow.

pub mod edmd;
pub mod rsa;
