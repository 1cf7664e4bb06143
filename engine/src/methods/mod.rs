//! Packing methods: each finds positions for the grains of a mix in a specimen.
//!
//! [`rsa`] inserts spheres one after the other at their final size, [`rsa_shapes`] ellipsoids; [`edmd`] lets smaller
//! spheres move, collide and grow.

pub mod edmd;
pub mod rsa;
pub mod rsa_shapes;
