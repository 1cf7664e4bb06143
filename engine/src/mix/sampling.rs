//! Sampling of diameters, class by class from the coarsest down (Titscher and Unger 2015, Algorithm 1).

use rand_xoshiro::Xoshiro256PlusPlus;

use super::{GradedMix, sphere_volume};
use crate::rng::uniform;

/// Draws between two looks at whether to stop: about a millisecond.
const DRAWS_PER_LOOK: usize = 1 << 14;

/// Draws the diameters of one packing, in mm, from the largest down.
///
/// In each class grains are drawn until its volume is reached; the overshoot of the last grain is
/// taken from the next class, so that the total misses by less than one of the smallest grains.
/// `None` when `should_stop` said so.
pub fn sample(
    mix: &GradedMix,
    rng: &mut Xoshiro256PlusPlus,
    should_stop: &dyn Fn() -> bool,
) -> Option<Vec<f64>> {
    if let Some(list) = &mix.list {
        return Some(list.clone());
    }
    let mut diameters = Vec::with_capacity((mix.expected_grains() * 1.01) as usize + 64);
    let mut overshoot = 0.0;
    for class in mix.classes.iter().rev() {
        let target = mix.class_volume_mm3(class) - overshoot;
        let mut volume = 0.0;
        while volume < target {
            let d = class.diameter(uniform(rng));
            volume += sphere_volume(d);
            diameters.push(d);
            if diameters.len().is_multiple_of(DRAWS_PER_LOOK) && should_stop() {
                return None;
            }
        }
        overshoot = volume - target;
    }
    diameters.sort_unstable_by(|a, b| b.total_cmp(a));
    Some(diameters)
}
