//! Packing methods: each places the grains of a mix in a specimen.

pub mod edmd;
pub mod rsa;
