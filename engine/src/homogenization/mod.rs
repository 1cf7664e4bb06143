//! Effective properties of a periodic cell of voxels: stiffness, thermal expansion, conductivity.
//!
//! A mean strain is applied to the cell, and the displacements are solved for that leave all stresses in balance
//! (`solve`). The strains of the voxels are those of a `stencil`, their stresses follow from the phases
//! (`material`), and the properties from the energies of pairs of load cases (`measure`): `C_ij = <e_i : C : e_j>`.
//! Moulinec and Suquet (1998, 10.1016/S0045-7825(97)00218-1) began the method; `docs/properties.md` has the
//! mathematics.
//!
//! Voxels and phases are all that the module knows; grains are turned into them elsewhere.
// Forced inlining carries the instruction set into the loops, as in `cpu`.
#![allow(clippy::inline_always)]

mod cases;
mod fields;
mod green;
mod lanes;
mod material;
mod measure;
pub mod moduli;
mod real;
mod solve;
mod stencil;
mod transform;
mod voxels;

use std::num::NonZeroUsize;

use nalgebra::{Matrix3, Matrix6, Vector6};
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use cases::{CaseError, SolvedCase, SolvedCases};
pub use fields::{ConductionFields, ElasticFields};
pub use material::ElasticPhase;
pub use voxels::{CUT, CutVoxel, MAX_PHASES, Voxels};

use self::green::Reference;
use self::material::{Conducting, Elastic, Material};
use self::measure::{Measured, Pairs, measure};
use self::solve::{Field, Goal, Solver, zeros};
use self::stencil::Load;
use self::transform::Transform;
use crate::control::{Control, Progress, Step};
use crate::elementary::ln;
use crate::memory::OutOfMemory;

/// How strains follow from the displacements of the corners of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(rename_all = "lowercase")]
pub enum Scheme {
    /// The strain at the centre of the voxel (Willot 2015): hexahedra with one point of integration.
    Rotated,
    /// Hexahedra with eight Gauss points, which equal C3D8.
    Hexahedra,
}

/// How exactly properties are computed, and by how many threads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How strains follow from displacements.
    pub scheme: Scheme,
    /// Largest relative error of the solver in a property.
    pub tolerance: f64,
    /// Threads that compute; the bits of the result do not depend on them.
    pub threads: NonZeroUsize,
}

/// Why there are no properties.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum HomogenizationError {
    /// It was told to stop.
    #[error("stopped")]
    Stopped,
    /// The system refused memory.
    #[error(transparent)]
    OutOfMemory(#[from] OutOfMemory),
    /// The iterations do not reach the tolerance.
    #[error("the relative error of the solver is {error:.1e} after {iterations} iterations")]
    NotConverged {
        /// Iterations of the load case.
        iterations: usize,
        /// Relative error that is reached, estimated.
        error: f64,
    },
}

/// What the solver did.
#[derive(Clone, Debug, PartialEq)]
pub struct Effort {
    /// Iterations of each load case.
    pub iterations: Vec<u64>,
    /// Largest relative error of the solver in a property, estimated.
    pub error: f64,
    /// Largest relative difference of a diagonal property by energy and by mean flux.
    pub energy_against_work: f64,
}

/// Effective elastic properties; components are in the order xx, yy, zz, yz, xz, xy, shears those of engineering
/// strains.
#[derive(Clone, Debug, PartialEq)]
pub struct Elasticity {
    /// Stiffness in GPa.
    pub stiffness_gpa: Matrix6<f64>,
    /// Pressure that a kelvin takes at no strain in GPa/K, where it was wanted.
    pub thermal_gpa_k: Option<Vector6<f64>>,
    /// What the solver did; the load cases are those of the stiffness, then that of the temperature.
    pub effort: Effort,
}

/// Effective conductivity, or diffusivity.
#[derive(Clone, Debug, PartialEq)]
pub struct Conduction {
    /// Conductivity in the unit of the phases.
    pub conductivity: Matrix3<f64>,
    /// What the solver did.
    pub effort: Effort,
}

/// Bytes that the solver takes at most for a grid, beside its voxels.
#[must_use]
pub fn bytes(shape: [usize; 3], components: usize, cases: usize, threads: usize) -> u64 {
    let [nx, ny, nz] = shape.map(|n| n as u64);
    let voxels = nx.saturating_mul(ny).saturating_mul(nz);
    // Displacements of all cases, residual, direction; spectra have rows that are a little longer.
    let fields = voxels.saturating_mul(4 * components as u64 * (cases as u64 + 2));
    let stride = 2 * (nx / 2 + 1).next_multiple_of(lanes::WIDTH as u64);
    let spectra = stride.saturating_mul(ny).saturating_mul(nz).saturating_mul(4 * components as u64);
    let rows = 16 * components as u64 * ny.saturating_mul(nz);
    let of_threads = threads as u64 * (Transform::bytes_per_thread(shape, components) + 12 * nx * ny * 2);
    [fields, spectra, rows, of_threads].iter().fold(0, |sum, bytes| sum.saturating_add(*bytes))
}

/// The six strains of a unit, and the temperature of a unit.
fn elastic_loads(thermal: bool) -> Vec<Load<3>> {
    let strain = |i: usize, j: usize| {
        let mut mean = [[0.0; 3]; 3];
        mean[i][j] += 0.5;
        mean[j][i] += 0.5;
        Load { mean, thermal: false }
    };
    let mut loads: Vec<_> =
        [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)].map(|(i, j)| strain(i, j)).into();
    if thermal {
        loads.push(Load { thermal: true, ..Load::NONE });
    }
    loads
}

/// The three gradients of a unit.
fn conduction_loads() -> Vec<Load<1>> {
    let load = |axis: usize| {
        let mut mean = [[0.0; 3]];
        mean[0][axis] = 1.0;
        Load { mean, thermal: false }
    };
    [0, 1, 2].map(load).into()
}

/// The homogeneous medium whose Green operator preconditions, and the least stiffness over its own.
fn reference(least: [f64; 2], most: [f64; 2], has_pores: bool) -> (Reference, f64) {
    let [bulk, shear] = [0, 1].map(|i| (least[i] * most[i]).sqrt());
    let stiffness = (least[0] / bulk).min(least[1] / shear);
    let reference = Reference { lambda: bulk - 2.0 / 3.0 * shear, mu: shear };
    (reference, if has_pores { 0.0 } else { stiffness })
}

/// Computes the effective stiffness of a cell, and on demand the pressure of a temperature. Load cases that were solved
/// before are taken as they are; `on_case` is called with all after each that is solved.
///
/// # Errors
/// See [`HomogenizationError`].
pub fn elasticity(
    voxels: &Voxels,
    phases: &[ElasticPhase],
    thermal: bool,
    settings: &Settings,
    cases: &mut SolvedCases<3>,
    on_case: &mut dyn FnMut(&SolvedCases<3>),
    control: &dyn Control,
) -> Result<Elasticity, HomogenizationError> {
    let shares = voxels.shares(phases.len());
    let mut bounds = [[f64::INFINITY; 2], [0.0_f64; 2]];
    let mut has_pores = false;
    let mut thermal_energy = 0.0;
    for (phase, share) in phases.iter().zip(&shares).filter(|(_, share)| **share > 0.0) {
        if phase.mu_gpa <= 0.0 {
            has_pores = true;
            continue;
        }
        thermal_energy += share * phase.thermal_gpa_k().powi(2) / phase.bulk_gpa();
        for (i, value) in [phase.bulk_gpa(), phase.mu_gpa].into_iter().enumerate() {
            bounds[0][i] = bounds[0][i].min(value);
            bounds[1][i] = bounds[1][i].max(value);
        }
    }
    let (reference, least_stiffness) = reference(bounds[0], bounds[1], has_pores);
    let material = Elastic::new(phases);
    let problem =
        Cases { voxels, material: &material, reference, least_stiffness, thermal_energy, settings, control };
    let (measured, effort) = problem.solve(&elastic_loads(thermal), cases, on_case)?;
    let cases = effort.iterations.len();
    let energy = |i: usize, j: usize| measured.energies[i.min(j) * cases + i.max(j)];
    Ok(Elasticity {
        stiffness_gpa: Matrix6::from_fn(energy),
        thermal_gpa_k: thermal.then(|| Vector6::from_fn(|i, _| -measured.energies[i * cases + 6])),
        effort,
    })
}

/// Computes the effective conductivity of a cell, or its diffusivity, of those of the phases; with load cases as for
/// [`elasticity`].
///
/// # Errors
/// See [`HomogenizationError`].
pub fn conduction(
    voxels: &Voxels,
    conductivities: &[f64],
    settings: &Settings,
    cases: &mut SolvedCases<1>,
    on_case: &mut dyn FnMut(&SolvedCases<1>),
    control: &dyn Control,
) -> Result<Conduction, HomogenizationError> {
    let shares = voxels.shares(conductivities.len());
    let (mut least, mut most, mut has_pores) = (f64::INFINITY, 0.0_f64, false);
    for (value, _) in conductivities.iter().zip(&shares).filter(|(_, share)| **share > 0.0) {
        if *value > 0.0 {
            (least, most) = (least.min(*value), most.max(*value));
        } else {
            has_pores = true;
        }
    }
    let mu = (least * most).sqrt();
    let material = Conducting::new(conductivities);
    let problem = Cases {
        voxels,
        material: &material,
        reference: Reference { lambda: 0.0, mu },
        least_stiffness: if has_pores { 0.0 } else { least / mu },
        thermal_energy: 0.0,
        settings,
        control,
    };
    let (measured, effort) = problem.solve(&conduction_loads(), cases, on_case)?;
    let conductivity = Matrix3::from_fn(|i, j| measured.energies[i.min(j) * 3 + i.max(j)]);
    Ok(Conduction { conductivity, effort })
}

/// Load cases of one material.
struct Cases<'a, M> {
    voxels: &'a Voxels,
    material: &'a M,
    reference: Reference,
    least_stiffness: f64,
    /// Energy that the error of the temperature is compared with, a mean over the voxels.
    thermal_energy: f64,
    settings: &'a Settings,
    control: &'a dyn Control,
}

impl<M> Cases<'_, M> {
    fn solve<const D: usize>(
        &self,
        loads: &[Load<D>],
        cases: &mut SolvedCases<D>,
        on_case: &mut dyn FnMut(&SolvedCases<D>),
    ) -> Result<(Measured<D>, Effort), HomogenizationError>
    where
        M: Material<D>,
    {
        let (voxels, settings) = (self.voxels, self.settings);
        let total = loads.len();
        let of_all = |cases: &[(&Load<D>, &Field<D>)], pairs: Pairs| {
            measure(voxels, self.material, settings.scheme, cases, pairs, settings.threads)
        };
        let own = |measured: &Measured<D>, case: usize| measured.energies[case * (total + 1)];
        if cases.0.len() < total {
            self.go_on()?;
            let none = zeros(voxels.len())?;
            let first = of_all(&loads.iter().map(|load| (load, &none)).collect::<Vec<_>>(), Pairs::Equal);
            drop(none);
            self.go_on()?;
            let mut solver = Solver::new(voxels, self.material, self.reference, settings)?;
            for (number, load) in loads.iter().enumerate().skip(cases.0.len()) {
                let mean = if load.thermal { self.thermal_energy } else { own(&first, number) };
                let goal = Goal {
                    tolerance: settings.tolerance,
                    energy: mean * voxels.len() as f64,
                    decreases: !load.thermal,
                    least_stiffness: self.least_stiffness,
                };
                let mut distance = None;
                let mut displacement = zeros(voxels.len())?;
                let solved = solver.solve(&mut displacement, load, &goal, |error| {
                    self.go_on()?;
                    let of_case = if error.is_finite() {
                        let left = ln(error.max(1.0));
                        1.0 - left / distance.get_or_insert(left.max(1.0)).max(left)
                    } else {
                        0.0
                    };
                    self.report(number, total, of_case);
                    Ok(())
                })?;
                let (iterations, error) = (solved.iterations as u64, solved.error);
                cases.0.push(SolvedCase { displacement, iterations, error });
                on_case(cases);
                self.go_on()?;
                self.report(number + 1, total, 0.0);
            }
        }
        let solved = &cases.0[..total];
        let fields = loads.iter().zip(solved).map(|(load, case)| (load, &case.displacement));
        let measured = of_all(&fields.collect::<Vec<_>>(), Pairs::All);
        let mut effort = Effort {
            iterations: solved.iter().map(|case| case.iterations).collect(),
            error: solved.iter().map(|case| case.error).fold(0.0, f64::max),
            energy_against_work: 0.0,
        };
        for (number, load) in loads.iter().enumerate().filter(|(_, load)| !load.thermal) {
            let fluxes = measured.fluxes[number].as_flattened();
            let work: f64 = load.mean.as_flattened().iter().zip(fluxes).map(|(e, s)| e * s).sum();
            let energy = own(&measured, number);
            if energy > 0.0 {
                let difference = (work - energy).abs() / energy;
                effort.energy_against_work = effort.energy_against_work.max(difference);
            }
        }
        Ok((measured, effort))
    }

    fn go_on(&self) -> Result<(), HomogenizationError> {
        if self.control.should_stop() { Err(HomogenizationError::Stopped) } else { Ok(()) }
    }

    fn report(&self, done: usize, total: usize, of_case: f64) {
        let fraction = ((done as f64 + of_case) / total as f64).clamp(0.0, 1.0);
        let counted = Progress::counted(Step::Export, done, total, "load cases", "");
        self.control.report(&Progress { fraction, ..counted });
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
