//! Sampling of diameters, class by class from the coarsest down (Titscher and Unger 2015, Algorithm 1).

use rand_xoshiro::Xoshiro256PlusPlus;

use super::{GradedMix, sphere_volume};
use crate::error::PackError;
use crate::memory::{copied, make_room, reserved};
use crate::rng::uniform;

/// Draws between two looks at whether to stop: about a millisecond.
const DRAWS_PER_LOOK: usize = 1 << 14;

/// Draws the diameters of one packing, in mm, from the largest down.
///
/// In each class grains are drawn until its volume is reached; the overshoot of the last grain is
/// taken from the next class, so that the total misses by less than one of the smallest grains.
///
/// # Errors
/// [`PackError::Stopped`] when `should_stop` said so, [`PackError::OutOfMemory`].
pub fn sample(
    mix: &GradedMix,
    rng: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Result<Vec<f64>, PackError> {
    if let Some(list) = &mix.list {
        return Ok(copied(list)?);
    }
    let mut diameters = reserved((mix.expected_grains() * 1.01) as usize + DRAWS_PER_LOOK)?;
    let mut overshoot = 0.0;
    for class in mix.classes.iter().rev() {
        let target = mix.class_volume_mm3(class) - overshoot;
        let mut volume = 0.0;
        while volume < target {
            let d = class.diameter(uniform(rng));
            volume += sphere_volume(d);
            diameters.push(d);
            if diameters.len().is_multiple_of(DRAWS_PER_LOOK) {
                if should_stop() {
                    return Err(PackError::Stopped { placed: 0, grains: mix.expected_grains() as u64 });
                }
                make_room(&mut diameters, DRAWS_PER_LOOK)?;
            }
        }
        overshoot = volume - target;
    }
    diameters.sort_unstable_by(|a, b| b.total_cmp(a));
    Ok(diameters)
}
