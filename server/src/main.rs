//! Packstone's binary.
fn main() {}
