//! Whether the report of a computation of properties that a worker process sends with its file can be right.
//!
//! What must hold follows from the packing and the materials, without computing again: effective properties lie between
//! bounds that are computed here.

use nalgebra::Matrix6;

use super::phases::of_material;
use super::report::PropertyReport;
use crate::homogenization::ElasticPhase;
use crate::homogenization::moduli::{
    IsotropicModuli, conduction_bounds, elastic_bounds, isotropic_projection,
};
use crate::request::{Material, Materials};

/// Largest difference of two sums of the same volumes in another order, relative to the specimen.
const ROUNDING: f64 = 1e-9;

/// A property of a material, where it has it.
type Property = fn(&Material) -> Option<f64>;

/// The phases have the materials that are given and the volumes of the packing, the stiffness is symmetric, and the
/// properties lie between the bounds of Voigt and Reuss for the shares of the voxels, within the tolerance of the
/// solver.
pub(super) fn check_properties(
    volume_fraction: f64,
    materials: Option<&Materials>,
    report: &PropertyReport,
) -> Result<(), String> {
    let is_given = |material: &Material| {
        materials.is_some_and(|given| given.entries().any(|(_, known)| known == material))
    };
    if let Some(phase) = report.phases.iter().find(|phase| !is_given(&phase.material)) {
        return Err(format!("the phase {:?} has a material that no request stated", phase.name));
    }
    let shares: Vec<f64> = report.phases.iter().map(|phase| phase.share).collect();
    let sum: f64 = shares.iter().sum();
    if (sum - 1.0).abs() > ROUNDING || shares.iter().any(|share| !(0.0..=1.0).contains(share)) {
        return Err(format!("the shares of the voxels are {shares:?}: must be at least 0 with the sum 1"));
    }
    let exact: f64 = report.phases.iter().skip(1).map(|phase| phase.exact_share).sum();
    if (exact - volume_fraction).abs() > ROUNDING {
        return Err(format!("the aggregates have the share {exact}: must be {volume_fraction}"));
    }
    let slack = 1e-6 + report.tolerance;
    let is_between =
        |value: f64, low: f64, high: f64| value >= low * (1.0 - slack) && value <= high * (1.0 + slack);
    if let Some(found) = &report.stiffness {
        let matrix = &found.stiffness_gpa;
        let most = matrix.iter().flatten().fold(0.0_f64, |most, value| most.max(value.abs()));
        if (0..6).any(|i| (0..i).any(|j| (matrix[i][j] - matrix[j][i]).abs() > slack * most)) {
            return Err("the stiffness is not symmetric".into());
        }
        let phases: Vec<ElasticPhase> =
            report.phases.iter().map(|phase| of_material(&phase.material)).collect();
        let bounds = elastic_bounds(&shares, &phases);
        let (low, high) = (bounds.reuss, bounds.voigt);
        let mean = isotropic_projection(&Matrix6::from_fn(|i, j| matrix[i][j]));
        for (name, modulus) in [
            ("bulk modulus", (|of| of.bulk_modulus_gpa) as fn(&IsotropicModuli) -> f64),
            ("shear modulus", |of| of.shear_modulus_gpa),
        ] {
            let (value, low, high) = (modulus(&mean), modulus(&low), modulus(&high));
            if !is_between(value, low, high) {
                return Err(format!("the {name} is {value} GPa: must be at least {low} and at most {high}"));
            }
        }
    }
    let conductions: [(_, Property); 2] = [
        (&report.conductivity, |material| material.conductivity_w_m_k),
        (&report.diffusivity, |material| material.diffusivity_m2_s),
    ];
    for (found, property) in conductions {
        let Some(found) = found else { continue };
        let values: Option<Vec<f64>> = report.phases.iter().map(|phase| property(&phase.material)).collect();
        let bounds = conduction_bounds(&shares, &values.ok_or("a phase has no conductivity")?);
        for axis in 0..3 {
            let value = found.matrix[axis][axis];
            if !is_between(value, bounds.reuss, bounds.voigt) {
                return Err(format!(
                    "a conductivity is {value}: must be at least {} and at most {}",
                    bounds.reuss, bounds.voigt
                ));
            }
        }
    }
    Ok(())
}
