//! Uniform orientations.

use std::f64::consts::TAU;

use nalgebra::{Quaternion, UnitQuaternion};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::rng::uniform;

/// An orientation that is uniform on the rotation group (Shoemake 1992, Graphics Gems III, "Uniform random rotations").
#[must_use]
pub fn uniform_orientation(rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
    let (u, first, second) = (uniform(rng), TAU * uniform(rng), TAU * uniform(rng));
    let (p, q) = ((1.0 - u).sqrt(), u.sqrt());
    let q = Quaternion::new(q * second.cos(), p * first.sin(), p * first.cos(), q * second.sin());
    UnitQuaternion::new_normalize(q)
}
