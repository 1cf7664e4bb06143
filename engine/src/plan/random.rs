//! What random sequential addition reaches, from the numbers of the grains by size.
//!
//! Grains are added from the largest down. Of each size the last grain finds a place while the larger ones, and those
//! of its own size, leave some:
//!
//! ```text
//! sum over d_i >= d_k of phi_i h(d_i / d_k) <= (1 - WALLS (S/V) d_k) (1 - FEW / sqrt(N_k)),
//! h(x) = 1 + g (NEAR x^-NEAR_POWER + CLOSE x^-CLOSE_POWER)
//! ```
//!
//! with the volume fractions `phi_i`, the surface of the walls over the volume `S/V`, and the number `N_k` of grains
//! that are at least as large. A much larger grain takes its own volume, `h = 1`; one of the same size takes `1 /
//! 0.384`, the saturation of equal spheres. The size for which the sum is largest ends the addition. `g` is 1 for
//! spheres and grows with the surface and the mean width of other grains, by which their excluded volume grows.
//!
//! Fitted in `docs/estimates/fit.py`; `docs/estimates.md` has the errors.

use super::grains::Size;
use crate::elementary::{exp, ln};

/// Saturation of equal spheres (Torquato, Uche and Stillinger 2006, 10.1103/PhysRevE.74.061308: 0.3841).
const EQUAL: f64 = 0.384;
/// What a grain of the same size and a little larger takes beside its volume,
const NEAR: f64 = 1.25;
/// and by which power of the ratio of sizes this falls off.
const NEAR_POWER: f64 = 1.21;
/// The rest of `1 / EQUAL - 1` falls off faster.
const CLOSE: f64 = 1.0 / EQUAL - 1.0 - NEAR;
const CLOSE_POWER: f64 = 3.5;
/// Layer at a wall that is lost to a grain, over its diameter.
const WALLS: f64 = 0.163;
/// Few grains differ from run to run.
const FEW: f64 = 0.2;
/// ln of `g`: of round grains that are a little longer or flatter, which find places more easily,
const ASPHERICAL: f64 = -0.3;
/// reached at about this ln of surface times width; of angular ones there is less of it;
const SMALL: f64 = 0.08;
const ANGULAR: f64 = 0.27;
/// and per ln of the surface and of the mean width.
const SURFACE: f64 = 0.88;
const WIDTH: f64 = 0.67;
/// Least share that is left to few grains between walls: nothing is known of fewer.
const LEAST: f64 = 0.3;

/// How random sequential addition ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach {
    /// Volume fraction, coating included, that nine of ten runs reach; 0 where there are no grains.
    pub(super) volume_fraction: f64,
    /// Share of the number of grains that are at least as large as those that end the addition: finer ones still find
    /// places easily.
    pub(super) ending_share: f64,
}

/// How full a specimen is for grains of one size when the first and when the last of them is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crowding {
    /// Number of the grains that are at least as large.
    pub(crate) number: f64,
    /// The sum above over what its right side leaves: the last grain for which it is 1 just finds a place.
    pub(crate) first: f64,
    pub(crate) last: f64,
}

/// The reach for the proportions of these sizes, from fine to coarse, a share of them angular.
pub(super) fn reach(sizes: &[Size], walls_per_mm: f64, angular: f64) -> Reach {
    let (mut largest, mut ending, mut number) = (0.0, 0.0, 0.0);
    for_each_size(sizes, walls_per_mm, angular, |crowding| {
        number = crowding.number;
        if crowding.last > largest {
            (largest, ending) = (crowding.last, number);
        }
    });
    if largest > 0.0 {
        Reach { volume_fraction: 1.0 / largest, ending_share: ending / number }
    } else {
        Reach { volume_fraction: 0.0, ending_share: 1.0 }
    }
}

/// Crowding by size, from coarse to fine, at a volume fraction with coating.
pub(super) fn crowding(sizes: &[Size], walls_per_mm: f64, angular: f64, filled: f64) -> Vec<Crowding> {
    let mut all = Vec::new();
    for_each_size(sizes, walls_per_mm, angular, |Crowding { number, first, last }| {
        all.push(Crowding { number, first: filled * first, last: filled * last });
    });
    all
}

/// The crowding of each size, from coarse to fine, where the grains fill all of the volume.
fn for_each_size(sizes: &[Size], walls_per_mm: f64, angular: f64, mut see: impl FnMut(Crowding)) {
    let all: f64 = sizes.iter().map(|size| size.number * size.diameter.powi(3)).sum();
    let (mut volume, mut near, mut close, mut number) = (0.0, 0.0, 0.0, 0.0);
    for size in sizes.iter().rev() {
        let share = size.number * size.diameter.powi(3) / all;
        let [surface, width] = [size.surface, size.width].map(ln);
        let aspherical = 1.0 - exp(-(surface + width) / SMALL);
        let shape = exp((ASPHERICAL + ANGULAR * angular) * aspherical + SURFACE * surface + WIDTH * width);
        let [to_near, to_close] = [NEAR_POWER, CLOSE_POWER].map(|power| exp(power * ln(size.diameter)));
        let before = volume + NEAR * near * to_near + CLOSE * close * to_close;
        volume += share;
        near += share * shape / to_near;
        close += share * shape / to_close;
        number += size.number;
        let taken = volume + NEAR * near * to_near + CLOSE * close * to_close;
        let left =
            (1.0 - WALLS * walls_per_mm * size.diameter).max(LEAST) * (1.0 - FEW / number.max(1.0).sqrt());
        see(Crowding { number, first: before / left, last: taken / left });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fraction(of: &[(f64, f64)], walls_per_mm: f64) -> f64 {
        reach(&sizes(of), walls_per_mm, 0.0).volume_fraction
    }

    fn sizes(of: &[(f64, f64)]) -> Vec<Size> {
        of.iter().map(|&(diameter, number)| Size { diameter, number, surface: 1.0, width: 1.0 }).collect()
    }

    /// The saturation of equal spheres, and sizes in parts.
    #[test]
    fn many_grains_reach_what_was_measured() {
        assert!((fraction(&[(3.0, 1e8)], 0.0) - EQUAL).abs() < 1e-3);
        assert_eq!(fraction(&[], 0.0), 0.0);
        // A part of a size is as good as the whole.
        let [whole, parts] = [&[(1.0, 8e6), (4.0, 1e6)][..], &[(1.0, 3e6), (1.0, 5e6), (4.0, 1e6)]];
        assert!((fraction(whole, 0.0) - fraction(parts, 0.0)).abs() < 1e-9);
    }

    #[test]
    fn fine_grains_beside_coarse_ones_fill_voids_and_walls_take_room() {
        let coarse_alone = fraction(&[(8.0, 1e6)], 0.0);
        let some_fine = fraction(&[(1.0, 1e8), (8.0, 1e6)], 0.0);
        // Fine grains of a tenth of the volume do not hinder the coarse ones, which end the addition.
        let few_fine = fraction(&[(1.0, 0.1 / 0.9 * 512e6), (8.0, 1e6)], 0.0);
        // They find places easily, while where they fill most of the room they end it.
        let ending = |of: &[(f64, f64)]| reach(&sizes(of), 0.0, 0.0).ending_share;
        assert!(ending(&[(1.0, 0.1 / 0.9 * 512e6), (8.0, 1e6)]) < 0.02);
        assert_eq!(ending(&[(1.0, 1e10), (8.0, 1e6)]), 1.0);
        assert!(some_fine > coarse_alone + 0.05, "{some_fine}");
        assert!((few_fine - coarse_alone / 0.9).abs() < 0.01, "{few_fine}");
        assert!(fraction(&[(8.0, 1e6)], 0.05) < coarse_alone - 0.02);
    }
}
