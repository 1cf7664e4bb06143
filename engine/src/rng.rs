//! The random streams of a run. Their definition is part of what a seed means, so nothing here may
//! change without a new name in [`crate::packing::RNG_NAME`].

use rand::rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// What a stream is used for. Streams of one seed do not overlap (2^128 draws apart), so that a
/// change in one phase leaves the draws of the others as they were.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    /// Diameters.
    Sampling,
    /// Places.
    Rsa,
    /// Velocities and swaps of growing grains.
    Edmd,
    /// The chance that a gradient is compared with.
    Segregation,
    /// Shapes of shaped grains.
    Shape,
}

/// The stream of a seed for one use.
pub(crate) fn stream(seed: u64, stream: Stream) -> Xoshiro256PlusPlus {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    for _ in 0..stream as u32 {
        rng.jump();
    }
    rng
}

/// The stream of one cycle of growing grains. Each cycle has its own, so that a run which goes on from
/// a checkpoint needs no state of a generator.
pub(crate) fn cycle_stream(seed: u64, cycle: u64) -> Xoshiro256PlusPlus {
    numbered_stream(stream(seed, Stream::Edmd).next_u64(), cycle)
}

/// One of the streams that a number drawn from another stream names.
pub(crate) fn numbered_stream(drawn: u64, number: u64) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(drawn ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// A stream of its own that starts with a draw from another.
pub(crate) fn branch(rng: &mut Xoshiro256PlusPlus) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(rng.next_u64())
}

/// A uniform number in `[0, 1)` with 53 bits.
#[inline]
pub(crate) fn uniform(rng: &mut Xoshiro256PlusPlus) -> f64 {
    const STEP: f64 = 1.0 / (1_u64 << 53) as f64;
    (rng.next_u64() >> 11) as f64 * STEP
}

/// Draws that tests share.
#[cfg(test)]
pub(crate) mod draws {
    use std::f64::consts::TAU;

    use nalgebra::{Quaternion, UnitQuaternion, Vector3};

    use super::{Xoshiro256PlusPlus, uniform};

    /// Uniform between two numbers.
    pub(crate) fn between(rng: &mut Xoshiro256PlusPlus, low: f64, high: f64) -> f64 {
        low + (high - low) * uniform(rng)
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(rng: &mut Xoshiro256PlusPlus) -> Vector3<f64> {
        let (z, angle) = (between(rng, -1.0, 1.0), TAU * uniform(rng));
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
    }

    /// Any orientation, not uniformly.
    pub(crate) fn orientation(rng: &mut Xoshiro256PlusPlus) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(Quaternion::from(direction(rng).push(between(rng, -1.0, 1.0))))
    }
}
