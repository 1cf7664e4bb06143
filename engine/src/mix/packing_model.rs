//! How dense grains of many sizes get when they are compacted: the compressible packing model.
//!
//! Source: de Larrard (1999), Concrete Mixture Proportioning: A Scientific Approach, E & FN Spon, chapter 1. Of `n`
//! sizes `d_i` with shares `y_i` of the volume, each alone would get as dense as `beta` (the residual packing density).
//! Where size `i` carries the mixture, it could get as dense as
//!
//! ```text
//! gamma_i = beta / (1 - sum over coarser j of (1 - beta + b_ij beta (1 - 1 / beta)) y_j
//!                     - sum over finer j of (1 - a_ij) y_j)
//! a_ij = sqrt(1 - (1 - d_j / d_i)^1.02)    finer grains push coarser ones apart
//! b_ij = 1 - (1 - d_i / d_j)^1.50          coarser grains disturb finer ones like a wall
//! ```
//!
//! A real packing is looser. Its density `phi` solves `K = sum of (y_i / beta) / (1 / phi - 1 / gamma_i)`, where the
//! compaction index `K` stands for how grains are compacted.

use std::collections::BTreeMap;

use crate::elementary::{exp2, log2, powf};
use crate::request::PackingModel;

/// Most sizes that the model computes with one by one: its cost is that of all pairs.
const MOST_SIZES: usize = 64;
/// Sizes per octave where there are more.
const SIZES_PER_OCTAVE: f64 = 6.0;
/// Steps that halve the interval of the packing density.
const HALVINGS: usize = 60;

/// The packing density of grains with these diameters in mm and volumes in any unit; `None` where there are none.
pub(super) fn packing_density(sizes: &[(f64, f64)], model: PackingModel) -> Option<f64> {
    let sizes = gathered(sizes);
    let PackingModel { compaction_index, residual_packing_density: beta } = model;
    let virtual_density = |&(d, _): &(f64, f64)| {
        let taken = |&(other, share): &(f64, f64)| {
            if other > d {
                let wall = 1.0 - powf(1.0 - d / other, 1.50);
                (1.0 - beta + wall * beta * (1.0 - 1.0 / beta)) * share
            } else if other < d {
                let loosening = (1.0 - powf(1.0 - other / d, 1.02)).sqrt();
                (1.0 - loosening) * share
            } else {
                0.0
            }
        };
        beta / (1.0 - sizes.iter().map(taken).sum::<f64>())
    };
    let densities: Vec<f64> = sizes.iter().map(virtual_density).collect();
    let index = |phi: f64| -> f64 {
        let of_size = |(&(_, share), gamma): (&(f64, f64), &f64)| share / beta / (1.0 / phi - 1.0 / gamma);
        sizes.iter().zip(&densities).map(of_size).sum()
    };
    let (mut low, mut high) = (0.0, densities.iter().copied().reduce(f64::min)?);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        *(if index(middle) < compaction_index { &mut low } else { &mut high }) = middle;
    }
    Some(low)
}

/// The sizes with shares that sum to 1; many of them in a few steps of an octave each, with the mean of the logarithm
/// within a step.
fn gathered(sizes: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let whole: f64 = sizes.iter().map(|size| size.1).sum();
    if sizes.len() <= MOST_SIZES && whole > 0.0 {
        return sizes.iter().filter(|size| size.1 > 0.0).map(|&(d, volume)| (d, volume / whole)).collect();
    }
    let mut steps = BTreeMap::new();
    for &(d, volume) in sizes.iter().filter(|size| size.1 > 0.0) {
        let octave = log2(d);
        let step: &mut (f64, f64) = steps.entry((octave * SIZES_PER_OCTAVE).floor() as i64).or_default();
        step.0 += volume * octave;
        step.1 += volume;
    }
    let all: f64 = steps.values().map(|step| step.1).sum();
    steps.values().map(|&(octaves, volume)| (exp2(octaves / volume), volume / all)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(compaction_index: f64) -> PackingModel {
        PackingModel { compaction_index, ..PackingModel::default() }
    }

    fn density(sizes: &[(f64, f64)], compaction_index: f64) -> f64 {
        packing_density(sizes, model(compaction_index)).unwrap_or(f64::NAN)
    }

    /// `phi = beta / (1 + 1 / K)`.
    #[test]
    fn equal_grains_are_looser_than_their_residual_density_by_the_index() {
        for index in [1.0, 4.12, 9.0, 1.0e3] {
            assert!((density(&[(8.0, 3.0)], index) - 0.64 * index / (1.0 + index)).abs() < 1.0e-12);
        }
        assert_eq!(packing_density(&[], PackingModel::default()), None);
    }

    /// Fine grains of no size in the voids of coarse ones, and coarse grains among them: the lower of
    /// `beta / y_1` and `beta / (1 - (1 - beta) y_1)`.
    #[test]
    fn grains_of_far_sizes_are_as_dense_as_the_voids_allow() {
        for coarse in [0.3, 0.5, 0.64, 0.7, 0.735_294, 0.8, 0.95] {
            let of_coarse: f64 = 0.64 / coarse;
            let of_fine = 0.64 / (1.0 - 0.36 * coarse);
            let found = density(&[(1.0e6, coarse), (1.0e-6, 1.0 - coarse)], 1.0e9);
            assert!((found - of_coarse.min(of_fine)).abs() < 1.0e-5, "{coarse}: {found}");
        }
    }

    /// The equation of the model, in its own form, at the density that was found.
    #[test]
    fn three_sizes_solve_the_equation_of_the_model() {
        let (d, y) = ([16.0, 4.0, 0.5], [0.5, 0.2, 0.3]);
        let phi = density(&[(d[0], y[0]), (d[1], y[1]), (d[2], y[2])], 9.0);
        let a = |i: usize, j: usize| (1.0 - (1.0_f64 - d[j] / d[i]).powf(1.02)).sqrt();
        let b = |i: usize, j: usize| 1.0 - (1.0_f64 - d[i] / d[j]).powf(1.5);
        let (beta, k) = (0.64, |i: usize, j: usize| 1.0 - 0.64 + b(i, j) * 0.64 * (1.0 - 1.0 / 0.64));
        let gamma = [
            beta / (1.0 - (1.0 - a(0, 1)) * y[1] - (1.0 - a(0, 2)) * y[2]),
            beta / (1.0 - k(1, 0) * y[0] - (1.0 - a(1, 2)) * y[2]),
            beta / (1.0 - k(2, 0) * y[0] - k(2, 1) * y[1]),
        ];
        let index: f64 = (0..3).map(|i| y[i] / beta / (1.0 / phi - 1.0 / gamma[i])).sum();
        assert!((index - 9.0).abs() < 1.0e-6, "{index}");
        assert!(phi > 0.75 && phi < 0.85, "{phi}");
    }

    /// Two sizes that are nearly one: the model as it stands, without steps.
    #[test]
    fn close_sizes_are_told_apart() {
        let dense = |ratio: f64| density(&[(8.0, 0.5), (8.0 * ratio, 0.5)], 9.0);
        assert!(dense(1.1125) > 0.583 && dense(1.1125) < dense(1.2), "{} {}", dense(1.1125), dense(1.2));
    }

    #[test]
    fn more_sizes_per_octave_change_a_curve_by_less_than_a_thousandth() {
        let fuller = |per_octave: usize| -> Vec<(f64, f64)> {
            let n = 8 * per_octave;
            let edge = |i: usize| 16.0 * (0.5_f64).powf(i as f64 / per_octave as f64);
            (0..n).map(|i| ((edge(i) * edge(i + 1)).sqrt(), edge(i).sqrt() - edge(i + 1).sqrt())).collect()
        };
        let (coarse, fine) = (density(&fuller(6), 9.0), density(&fuller(60), 9.0));
        assert!((coarse - fine).abs() < 1.0e-3, "{coarse} {fine}");
        assert!(coarse > 0.75 && coarse < 0.85, "{coarse}");
    }
}
