//! Packing methods: each finds positions for the grains of a mix in a specimen.
//!
//! [`rsa`] inserts spheres one after the other at their final size, [`rsa_shapes`] grains of other shapes; [`addition`]
//! has what both share.
//!
//! [`edmd`] lets smaller spheres move, collide and grow, [`monte_carlo`] lets any grains move at random, push each
//! other and grow; [`growth`] has what both share.

pub mod addition;
mod bins;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod brute_force_tests;
mod choice;
pub mod edmd;
pub mod growth;
mod image_names;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod long_grains_tests;
pub mod monte_carlo;
mod morton;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod polyhedra_tests;
pub mod rsa;
pub mod rsa_shapes;
mod swap_pairs;
