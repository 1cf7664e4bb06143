//! Constitutive laws of a row of voxels: stress of a displacement gradient, heat flux of a temperature gradient.
//!
//! In a voxel that a surface with the normal `n` cuts, both phases have uniform fields whose gradients differ by
//! `a (x) n` and whose fluxes across the surface are equal (laminate rule; Kabel, Merkert and Schneider 2015, Use of
//! composite voxels in FFT-based homogenization, 10.1016/j.cma.2015.06.003). For isotropic phases with shares `f`,
//! `1 - f` and mixed values `m~ = f m_1 + (1 - f) m_2` (share of each times the value of the other), the jump is
//! `a = -(t - (lambda~ + mu~) / (lambda~ + 2 mu~) (n . t) n) / mu~` with `t = n . (C_2 - C_1) : e - (b_2 - b_1) n`,
//! and the stress is `<C> : e - <b> 1 + f (1 - f) (C_2 - C_1) : (n (x) a)`. Without a normal the jump is 0 (Voigt).
//!
//! At the surface of a pore the laminate rule would make a voxel far too soft, as it could bear no force across the
//! surface whatever its share of solid. Such a voxel has the mean stiffness (Voigt), or none where its solid is less
//! than a tenth.

use super::real::{Real, Table};
use super::voxels::{CutVoxel, VoxelRow};

/// Share of solid below which a voxel at the surface of a pore is a pore.
const SOLID_SHARE: f64 = 0.1;

/// Share of the solid in a voxel that the surface of a pore cuts: the phases that have a stiffness of 0 are pores. None
/// where no phase is a pore.
#[inline(always)]
fn solid_share(cut: &CutVoxel, stiffness: [f64; 2]) -> Option<f64> {
    match stiffness.map(|value| value > 0.0) {
        [true, true] => None,
        [true, false] => Some(1.0 - cut.share),
        [false, true] => Some(cut.share),
        [false, false] => Some(0.0),
    }
}

/// Gradient of each component along x, y and z, in a row of voxels; its flux takes its place.
pub(super) type Rows<T, const D: usize> = [[Vec<T>; 3]; D];

/// A linear law between the gradient of `D` components and its flux.
pub(super) trait Material<const D: usize>: Sync {
    /// Sets the two coefficients of each voxel of a row.
    fn coefficients<T: Real>(&self, row: VoxelRow<'_>, coefficients: &mut [Vec<T>; 2]);
    /// Turns gradients into fluxes; with the flux of a unit of temperature at no strain, where there is one.
    fn flux<T: Real>(
        &self,
        row: VoxelRow<'_>,
        coefficients: &[Vec<T>; 2],
        thermal: bool,
        rows: &mut Rows<T, D>,
        of_cuts: &mut Vec<[T; 9]>,
    );
}

/// An isotropic elastic phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticPhase {
    /// First constant of Lamé in GPa.
    pub lambda_gpa: f64,
    /// Shear modulus in GPa.
    pub mu_gpa: f64,
    /// Linear expansion in 1/K.
    pub expansion_1_k: f64,
}

impl ElasticPhase {
    /// The phase with a modulus of Young and a ratio of Poisson.
    #[must_use]
    pub fn new(youngs_modulus_gpa: f64, poissons_ratio: f64, expansion_1_k: f64) -> Self {
        let (e, nu) = (youngs_modulus_gpa, poissons_ratio);
        Self {
            lambda_gpa: e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            mu_gpa: e / (2.0 * (1.0 + nu)),
            expansion_1_k,
        }
    }

    /// Bulk modulus in GPa.
    #[must_use]
    pub fn bulk_gpa(&self) -> f64 {
        self.lambda_gpa + 2.0 / 3.0 * self.mu_gpa
    }

    /// Pressure of a unit of temperature at no strain, in GPa/K.
    #[must_use]
    pub fn thermal_gpa_k(&self) -> f64 {
        3.0 * self.bulk_gpa() * self.expansion_1_k
    }
}

/// Elastic phases, and their pressure of a unit of temperature.
#[derive(Clone, Debug)]
pub(super) struct Elastic {
    lambda: Table,
    mu: Table,
    thermal: Table,
}

impl Elastic {
    pub(super) fn new(phases: &[ElasticPhase]) -> Self {
        Self {
            lambda: Table::new(phases.iter().map(|phase| phase.lambda_gpa)),
            mu: Table::new(phases.iter().map(|phase| phase.mu_gpa)),
            thermal: Table::new(phases.iter().map(ElasticPhase::thermal_gpa_k)),
        }
    }

    /// Stress of a cut voxel.
    #[inline(always)]
    fn of_cut<T: Real>(&self, cut: &CutVoxel, gradient: impl Fn(usize, usize) -> T, thermal: bool) -> [T; 9] {
        let (zero, two) = (T::default(), T::single(2.0));
        let [p, q] = cut.phases.map(usize::from);
        let f = T::double(cut.share);
        let g = T::double(1.0 - cut.share);
        let n = cut.normal.map(T::single);
        let pair = |table: &Table| (T::of(table)[p], T::of(table)[q]);
        let ((l1, l2), (m1, m2)) = (pair(&self.lambda), pair(&self.mu));
        let (b1, b2) = if thermal { pair(&self.thermal) } else { (zero, zero) };
        let strain = |i: usize, j: usize| (gradient(i, j) + gradient(j, i)) / two;
        let e = [0, 1, 2].map(|i| [0, 1, 2].map(|j| strain(i, j)));
        let trace = e[0][0] + e[1][1] + e[2][2];
        let dot = |a: [T; 3], b: [T; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (dl, dm, db) = (l2 - l1, m2 - m1, b2 - b1);
        let t = [0, 1, 2].map(|i| (dl * trace - db) * n[i] + two * dm * dot(e[i], n));
        // The share of each phase times the constant of the other.
        let (l, m) = (g * l2 + f * l1, g * m2 + f * m1);
        let stiffness = cut.phases.map(|phase| f64::of(&self.mu)[usize::from(phase)]);
        let solid = solid_share(cut, stiffness);
        if solid.is_some_and(|share| share < SOLID_SHARE) {
            return [zero; 9];
        }
        let a = if cut.normal == [0.0; 3] || solid.is_some() {
            [zero; 3]
        } else {
            let along = (l + m) / (l + two * m) * dot(n, t);
            [0, 1, 2].map(|i| (along * n[i] - t[i]) / m)
        };
        let (mean_l, mean_m, mean_b) = (g * l1 + f * l2, g * m1 + f * m2, g * b1 + f * b2);
        let fg = f * g;
        let on_diagonal = mean_l * trace - mean_b + fg * dl * dot(n, a);
        let mut stress = [zero; 9];
        for i in 0..3 {
            for j in 0..3 {
                let shear = two * mean_m * e[i][j] + fg * dm * (n[i] * a[j] + n[j] * a[i]);
                stress[3 * i + j] = if i == j { shear + on_diagonal } else { shear };
            }
        }
        stress
    }
}

impl Material<3> for Elastic {
    #[inline(always)]
    fn coefficients<T: Real>(&self, row: VoxelRow<'_>, coefficients: &mut [Vec<T>; 2]) {
        let (lambda, mu) = (T::of(&self.lambda), T::of(&self.mu));
        let [to_lambda, to_mu] = coefficients;
        for ((l, m), phase) in to_lambda.iter_mut().zip(to_mu).zip(row.phase) {
            *l = lambda[usize::from(*phase)];
            *m = mu[usize::from(*phase)];
        }
    }

    #[inline(always)]
    fn flux<T: Real>(
        &self,
        row: VoxelRow<'_>,
        coefficients: &[Vec<T>; 2],
        thermal: bool,
        rows: &mut Rows<T, 3>,
        of_cuts: &mut Vec<[T; 9]>,
    ) {
        of_cuts.clear();
        for cut in row.cuts {
            let x = usize::from(cut.x);
            of_cuts.push(self.of_cut(cut, |i, j| rows[i][j][x], thermal));
        }
        let nx = row.phase.len();
        let [lambda, mu] = coefficients;
        let (lambda, mu) = (&lambda[..nx], &mu[..nx]);
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = rows;
        let (xx, xy, xz) = (&mut xx[..nx], &mut xy[..nx], &mut xz[..nx]);
        let (yx, yy, yz) = (&mut yx[..nx], &mut yy[..nx], &mut yz[..nx]);
        let (zx, zy, zz) = (&mut zx[..nx], &mut zy[..nx], &mut zz[..nx]);
        for x in 0..nx {
            let (l, m) = (lambda[x], mu[x]);
            let on_diagonal = l * (xx[x] + yy[x] + zz[x]);
            let twice = m + m;
            xx[x] = on_diagonal + twice * xx[x];
            yy[x] = on_diagonal + twice * yy[x];
            zz[x] = on_diagonal + twice * zz[x];
            xy[x] = m * (xy[x] + yx[x]);
            yz[x] = m * (yz[x] + zy[x]);
            xz[x] = m * (xz[x] + zx[x]);
            yx[x] = xy[x];
            zy[x] = yz[x];
            zx[x] = xz[x];
        }
        if thermal {
            let pressure = T::of(&self.thermal);
            for (x, phase) in row.phase.iter().enumerate() {
                let b = pressure[usize::from(*phase)];
                xx[x] = xx[x] - b;
                yy[x] = yy[x] - b;
                zz[x] = zz[x] - b;
            }
        }
        for (cut, stress) in row.cuts.iter().zip(of_cuts) {
            let x = usize::from(cut.x);
            for (i, of_component) in rows.iter_mut().enumerate() {
                for (j, along) in of_component.iter_mut().enumerate() {
                    along[x] = stress[3 * i + j];
                }
            }
        }
    }
}

/// Phases that conduct heat, or through which something diffuses.
#[derive(Clone, Debug)]
pub(super) struct Conducting {
    conductivity: Table,
}

impl Conducting {
    pub(super) fn new(conductivities: &[f64]) -> Self {
        Self { conductivity: Table::new(conductivities.iter().copied()) }
    }
}

impl Material<1> for Conducting {
    #[inline(always)]
    fn coefficients<T: Real>(&self, row: VoxelRow<'_>, coefficients: &mut [Vec<T>; 2]) {
        let conductivity = T::of(&self.conductivity);
        for (k, phase) in coefficients[0].iter_mut().zip(row.phase) {
            *k = conductivity[usize::from(*phase)];
        }
    }

    #[inline(always)]
    fn flux<T: Real>(
        &self,
        row: VoxelRow<'_>,
        coefficients: &[Vec<T>; 2],
        _thermal: bool,
        rows: &mut Rows<T, 1>,
        of_cuts: &mut Vec<[T; 9]>,
    ) {
        let [along] = rows;
        of_cuts.clear();
        let table = T::of(&self.conductivity);
        for cut in row.cuts {
            let x = usize::from(cut.x);
            let [k1, k2] = cut.phases.map(|phase| table[usize::from(phase)]);
            let (f, g) = (T::double(cut.share), T::double(1.0 - cut.share));
            let n = cut.normal.map(T::single);
            let gradient = [along[0][x], along[1][x], along[2][x]];
            let across = n[0] * gradient[0] + n[1] * gradient[1] + n[2] * gradient[2];
            let values = cut.phases.map(|phase| f64::of(&self.conductivity)[usize::from(phase)]);
            let solid = solid_share(cut, values);
            if solid.is_some_and(|share| share < SOLID_SHARE) {
                of_cuts.push([T::default(); 9]);
                continue;
            }
            let jump = if cut.normal != [0.0; 3] && solid.is_none() {
                (k2 - k1) * across / (g * k2 + f * k1)
            } else {
                T::default()
            };
            let mean = g * k1 + f * k2;
            let mut flux = [T::default(); 9];
            for i in 0..3 {
                flux[i] = mean * gradient[i] - f * g * (k2 - k1) * jump * n[i];
            }
            of_cuts.push(flux);
        }
        let nx = row.phase.len();
        let k = &coefficients[0][..nx];
        for row in along.iter_mut() {
            for (flux, k) in row[..nx].iter_mut().zip(k) {
                *flux = *k * *flux;
            }
        }
        for (cut, flux) in row.cuts.iter().zip(of_cuts) {
            for (row, flux) in along.iter_mut().zip(flux) {
                row[usize::from(cut.x)] = *flux;
            }
        }
    }
}
