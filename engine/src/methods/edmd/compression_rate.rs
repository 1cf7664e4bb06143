//! The compression rate: how fast grains grow, from the pressure and the target.
//!
//! The rate is that of the growth of the mean radius over the thermal velocity (Lubachevsky and Stillinger 1990, DOI
//! 10.1007/BF01025983). It is constant while grains are loose. Then the pressure `Z` tells how far the packing is from
//! jamming in its present structure, and the distance to jamming is compared with the growth that the target still
//! needs. Where it is longer, growth remains fast. Where it is not, the product of rate and pressure is low, and the
//! lower the further the target lies beyond jamming: grains rearrange and are swapped faster than they grow, and the
//! volume fraction of jamming rises. While the pressure is so high that hardly anything rearranges, gaps are closed at
//! a constant rate.
//!
//! Without a target there is a number of collisions instead, after which the packing should have jammed. At a rate
//! `gamma`, some `1 / gamma` collisions per grain raise the pressure by a factor of e, so that a rate of `0.7 / n` with
//! `n` collisions per grain left makes the pressure rise as `n^-0.7`: most of the collisions take place while grains
//! can rearrange, and the last ones close the gaps.

use crate::elementary::cbrt;

/// Compression rate while grains are loose, where the request names none.
pub(crate) const LOOSE_RATE: f64 = 0.1;
/// Pressure up to which they are.
const LOOSE: f64 = 40.0;
/// Product of rate and pressure where the packing jams just at its target.
const SLOW: f64 = 0.3;
/// How steeply the product rises with the distance to jamming,
const DISTANCE_EXPONENT: i32 = 12;
/// and the least share of it where the target lies far beyond jamming: slower growth would take long to give up.
const LEAST_SLOW: f64 = 0.15;
/// Fewer grains than this have fewer ways to rearrange: they grow more slowly in proportion, and by its
/// square while they are loose and without a target, for it is then that they order;
const MANY_GRAINS: f64 = 500.0;
/// down to so few.
const FEW_GRAINS: f64 = 27.0;
/// Share of the loose rate at which equal grains grow to the largest distance: swaps
/// change nothing among them, and order is all that makes them denser.
const EQUAL_GRAINS: f64 = 0.02;
/// Rate towards the largest distance, times the collisions per grain that are left. Less is better where many are left,
/// more where few are (`docs/edmd.md`).
const COLLISION_RATE: f64 = 0.7;
/// Pressure above which hardly anything rearranges,
const FROZEN: f64 = 1500.0;
/// and the least rate there, at which gaps close.
const CLOSING_RATE: f64 = 0.01;

/// Chooses the rate from the pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CompressionRate {
    loose: f64,
    most: f64,
    slow: f64,
}

impl CompressionRate {
    /// The rate of `grains` grains towards a target, `loose` while they are loose.
    pub(crate) fn new(loose: f64, grains: usize) -> Self {
        Self { loose, most: loose, slow: SLOW * few(grains) }
    }

    /// The rate of loose grains that grow to the largest distance and may be all equal.
    pub(crate) fn without_target(self, grains: usize, equal: bool) -> Self {
        let few = few(grains).powi(2);
        Self { loose: self.loose * if equal { few.min(EQUAL_GRAINS) } else { few }, ..self }
    }

    /// The rate while grains are loose.
    pub(crate) fn loose(&self) -> f64 {
        self.loose
    }

    /// The rate for the next cycle towards the largest distance, with so many collisions per grain left.
    pub(crate) fn paced(&self, reduced_pressure: f64, collisions_left: f64) -> f64 {
        let rate = self.most.min(COLLISION_RATE / collisions_left.max(COLLISION_RATE / self.most));
        if reduced_pressure < LOOSE { self.loose.max(rate) } else { rate }
    }

    /// The rate for the next cycle towards a target, at a [`distance_to_jamming`].
    pub(crate) fn next(&self, reduced_pressure: f64, distance_to_jamming: f64) -> f64 {
        if reduced_pressure < LOOSE {
            return self.loose;
        }
        let by_distance = distance_to_jamming.max(0.0).powi(DISTANCE_EXPONENT).max(LEAST_SLOW);
        let slow = self.slow * by_distance / reduced_pressure;
        self.loose.min(if reduced_pressure > FROZEN { slow.max(CLOSING_RATE) } else { slow })
    }
}

/// What few grains grow more slowly by.
fn few(grains: usize) -> f64 {
    ((grains as f64).max(FEW_GRAINS) / MANY_GRAINS).min(1.0)
}

/// Volume fraction at which a packing jams as it is: near jamming at `phi_j` it has
/// `Z = 3 / (1 - phi / phi_j)` (free volume; Salsburg and Wood 1962).
fn jamming(now: f64, reduced_pressure: f64) -> f64 {
    now / (1.0 - 3.0 / reduced_pressure.max(3.5))
}

/// Scale at which a packing jams as it is, which has a pressure at a scale.
pub(crate) fn scale_at_jamming(scale: f64, reduced_pressure: f64) -> f64 {
    scale * cbrt(jamming(1.0, reduced_pressure))
}

/// Growth up to jamming over the growth up to the target, in volume fraction; 1 and less where the packing would jam
/// first.
pub(crate) fn distance_to_jamming(now: f64, target: f64, reduced_pressure: f64) -> f64 {
    if now >= target { 1.0 } else { (jamming(now, reduced_pressure) - now) / (target - now) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn growth_slows_down_with_pressure() {
        let rate = CompressionRate::new(0.1, 10_000);
        assert_eq!(rate.next(2.0, 1.0), 0.1);
        assert!((rate.next(1000.0, 1.0) - SLOW / 1000.0).abs() < 1e-12);
        assert!((rate.next(1000.0, 0.98) - SLOW * 0.98_f64.powi(DISTANCE_EXPONENT) / 1000.0).abs() < 1e-12);
        assert!((rate.next(1000.0, 0.1) - SLOW * LEAST_SLOW / 1000.0).abs() < 1e-12);
        assert!(rate.next(1000.0, 1.5) > 10.0 * rate.next(1000.0, 1.0));
        assert_eq!(rate.next(1000.0, 1e9), 0.1);
        assert_eq!(rate.next(1e4, 1.0), CLOSING_RATE);
        // A structure that yields again is given time again.
        assert!(rate.next(1000.0, 0.5) < CLOSING_RATE);
    }

    #[test]
    fn growth_to_the_largest_distance_is_paced_by_the_collisions_left() {
        let rate = CompressionRate::new(0.1, 10_000).without_target(10_000, false);
        assert_eq!(rate.paced(2.0, 4000.0), 0.1);
        assert!((rate.paced(100.0, 4000.0) - COLLISION_RATE / 4000.0).abs() < 1e-12);
        assert!((rate.paced(1e5, 20.0) - COLLISION_RATE / 20.0).abs() < 1e-12);
        for left in [5.0, 0.0, -1.0] {
            assert_eq!(rate.paced(1e5, left), 0.1);
        }
        // Few grains order while they are loose, but not beyond the limit.
        let few = CompressionRate::new(0.1, 50).without_target(50, false);
        assert!(few.paced(2.0, 4000.0) < 0.0011);
        assert_eq!(few.paced(2.0, 1.0), 0.1);
    }

    #[test]
    fn the_distance_to_jamming_is_relative_to_that_to_the_target() {
        let pressure = 3.0 / (1.0 - 0.6 / 0.7);
        assert!((distance_to_jamming(0.6, 0.65, pressure) - 2.0).abs() < 1e-9);
        assert!((distance_to_jamming(0.6, 0.7, pressure) - 1.0).abs() < 1e-9);
        assert_eq!(distance_to_jamming(0.7, 0.7, pressure), 1.0);
    }
}
