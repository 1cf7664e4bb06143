//! Mean fluxes and energies of all load cases, in double precision.
//!
//! `C_ij = <e_i : C : e_j>` of the strains of two load cases misses the true value by the product of their errors,
//! while the mean stress misses it by the error itself. Strains come from displacements of single precision, whose
//! differences are computed in double precision.

use std::num::NonZeroUsize;

use super::Scheme;
use super::material::{Material, Rows};
use super::solve::{Field, slices};
use super::stencil::{Load, Stencil, Workspace};
use super::voxels::Voxels;
use crate::cpu::Cpu;
use crate::threads::share;

/// Sums over the voxels, of pairs of load cases and of the mean flux.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measured<const D: usize> {
    /// Means of the product of the gradient of case i and the flux of case j, in the place `i * cases + j`.
    pub(super) energies: Vec<f64>,
    /// Mean flux of each case.
    pub(super) fluxes: Vec<[[f64; 3]; D]>,
}

/// Which pairs of load cases are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pairs {
    /// Each case with itself.
    Equal,
    /// Each case with itself and those after it.
    All,
}

/// Measures load cases with their displacements.
pub(super) fn measure<M: Material<D>, const D: usize>(
    voxels: &Voxels,
    material: &M,
    scheme: Scheme,
    cases: &[(&Load<D>, &Field<D>)],
    pairs: Pairs,
    threads: NonZeroUsize,
) -> Measured<D> {
    let [nx, ny, nz] = voxels.shape;
    let stencil = Stencil::new(voxels, scheme);
    let n = cases.len();
    let empty = Measured { energies: vec![0.0; n * n], fluxes: vec![[[0.0; 3]; D]; n] };
    let mut planes = vec![empty.clone(); nz];
    let cpu = Cpu::detect();
    share(threads, &mut planes, |k, sums| {
        let mut space = Workspace::<f64, D>::new(nx);
        let rows = || -> Rows<f64, D> { [0; D].map(|_| [0; 3].map(|_| vec![0.0; nx])) };
        let mut fields: Vec<[Rows<f64, D>; 2]> = cases.iter().map(|_| [rows(), rows()]).collect();
        cpu.call(|| {
            for j in 0..ny {
                for mode in 0..stencil.modes() {
                    let mut weight = 0.0;
                    for ((load, field), kept) in cases.iter().zip(&mut fields) {
                        weight = stencil.mode(
                            mode,
                            voxels,
                            material,
                            slices(field),
                            load,
                            [j, k],
                            &mut space,
                            kept,
                        );
                    }
                    sums.add(&fields, pairs, mode == 0, weight);
                }
            }
        });
    });
    let mut all = empty;
    let scale = 1.0 / (nx * ny * nz) as f64;
    for plane in planes {
        for (sum, energy) in all.energies.iter_mut().zip(plane.energies) {
            *sum += energy * scale;
        }
        for (sum, flux) in all
            .fluxes
            .as_flattened_mut()
            .as_flattened_mut()
            .iter_mut()
            .zip(plane.fluxes.as_flattened().as_flattened())
        {
            *sum += flux * scale;
        }
    }
    all
}

impl<const D: usize> Measured<D> {
    /// Adds a row of voxels: gradients and fluxes of each case.
    #[inline(always)]
    fn add(&mut self, fields: &[[Rows<f64, D>; 2]], pairs: Pairs, is_mean: bool, weight: f64) {
        let n = fields.len();
        let others = if pairs == Pairs::All { n } else { 1 };
        for (i, [gradients, _]) in fields.iter().enumerate() {
            for (j, [_, fluxes]) in fields.iter().enumerate().skip(i).take(others) {
                let rows = gradients.as_flattened().iter().zip(fluxes.as_flattened());
                self.energies[i * n + j] += weight * rows.map(|(g, f)| dot(g, f)).sum::<f64>();
            }
        }
        if is_mean && pairs == Pairs::All {
            for ([_, fluxes], means) in fields.iter().zip(&mut self.fluxes) {
                for (row, mean) in fluxes.as_flattened().iter().zip(means.as_flattened_mut()) {
                    *mean += total(row);
                }
            }
        }
    }
}

/// The sum of a row.
#[inline(always)]
fn total(row: &[f64]) -> f64 {
    const SUMS: usize = 8;
    let mut sums = [0.0; SUMS];
    let chunks = row.chunks_exact(SUMS);
    let rest: f64 = chunks.remainder().iter().sum();
    for chunk in chunks {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *sum += x;
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// The product of two rows.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const SUMS: usize = 8;
    let mut sums = [0.0; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum::<f64>() + rest
}
