//! Whether the report that a worker process sends with its file can be right.
//!
//! What must hold follows from the packing, the options and the materials, without making the export again: grids and
//! volumes are compared, and effective properties lie between bounds that are computed here.

use nalgebra::Matrix6;

use super::properties::{PropertyReport, of_material};
use super::voxels::{VoxelFormat, VoxelGrid, VoxelOptions, VoxelReport};
use crate::homogenization::ElasticPhase;
use crate::homogenization::moduli::{
    IsotropicModuli, conduction_bounds, elastic_bounds, isotropic_projection,
};
use crate::request::{Material, Materials, Specimen};

/// Largest difference of two sums of the same volumes in another order, relative to the specimen.
const ROUNDING: f64 = 1e-9;

/// A property of a material, where it has it.
type Property = fn(&Material) -> Option<f64>;

/// The grid, the length of a file of labels alone and the exact volume fraction follow from specimen, options and
/// packing.
pub(super) fn check_voxels(
    specimen: &Specimen,
    options: &VoxelOptions,
    volume_fraction: f64,
    report: &VoxelReport,
    bytes: u64,
) -> Result<(), String> {
    let grid = VoxelGrid::new(specimen, options);
    let expected = grid.voxels().saturating_mul(options.label.bytes());
    if options.format == VoxelFormat::Raw && options.reader.is_none() && bytes != expected {
        return Err(format!("the file has {bytes} bytes: must have {expected}"));
    }
    let shape = grid.shape.map(|n| n as u64);
    if report.shape != shape {
        return Err(format!("the grid has {:?} voxels: must have {shape:?}", report.shape));
    }
    let found = report.volume_fraction;
    if (found - volume_fraction).abs() > ROUNDING {
        return Err(format!("the grains have the volume fraction {found}: must be {volume_fraction}"));
    }
    let labels = report.aggregate_voxels as f64 / report.inside_voxels as f64;
    if report.aggregate_voxels > report.inside_voxels
        || (report.volume_fraction_labels - labels).abs() > ROUNDING
    {
        return Err(format!(
            "{} of {} voxels lie in grains, a fraction of {}",
            report.aggregate_voxels, report.inside_voxels, report.volume_fraction_labels
        ));
    }
    Ok(())
}

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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::Unattended;
    use crate::export::Model;
    use crate::export::{ExportReport, ExportRequest};
    use crate::packing::Spheres;
    use crate::plan::Limits;
    use crate::request::Boundary;

    const SIZE_MM: f64 = 10.0;

    type Change = fn(&mut Value);

    /// What a worker sends of one ball in a cube, with one place of the report changed.
    fn checked(options: &Value, change: impl FnOnce(&mut Value)) -> Result<(), String> {
        let specimen = Specimen::cuboid([SIZE_MM; 3], Boundary::Periodic);
        let mut ball = Spheres::default();
        ball.push([5.0; 3], 6.0);
        let export = ExportRequest::from_json(options).unwrap();
        let mut bytes = Vec::new();
        let report =
            export.write(&Model::new(&specimen, &ball), &Limits::default(), &Unattended, &mut bytes).unwrap();
        let mut report = serde_json::to_value(report).unwrap();
        change(&mut report);
        let report: ExportReport = serde_json::from_value(report).unwrap();
        let volume_fraction = std::f64::consts::PI / 6.0 * 216.0 / SIZE_MM.powi(3);
        export.check_report(&specimen, volume_fraction, None, &report, bytes.len() as u64)
    }

    fn options() -> Value {
        let of = |e, k| json!({"youngs_modulus_gpa": e, "poissons_ratio": 0.2, "conductivity_w_m_k": k});
        json!({"type": "properties", "cells": 12, "materials": {"matrix": of(25.0, 1.8), "aggregate": of(70.0, 3.2)}})
    }

    #[test]
    fn properties_outside_of_their_bounds_and_volumes_are_refused() {
        checked(&options(), |_| {}).unwrap();
        let changes: [(&str, Change); 8] = [
            ("is not symmetric", |report| report["stiffness"]["stiffness_gpa"][0][1] = json!(99)),
            ("the bulk modulus", |report| {
                for axis in 0..3 {
                    report["stiffness"]["stiffness_gpa"][axis][axis] = json!(75);
                }
            }),
            ("the shear modulus", |report| {
                for axis in 3..6 {
                    report["stiffness"]["stiffness_gpa"][axis][axis] = json!(1);
                }
            }),
            ("a conductivity is 3.3", |report| report["conductivity"]["matrix"][2][2] = json!(3.3)),
            ("that no request stated", |report| {
                report["phases"][1]["material"]["youngs_modulus_gpa"] = json!(700);
            }),
            ("the sum 1", |report| report["phases"][0]["share"] = json!(0.5)),
            ("the aggregates have the share", |report| report["phases"][1]["exact_share"] = json!(0.2)),
            ("must be of \"properties\"", |report| {
                let quality = ExportRequest::from_json(&json!({"type": "quality"})).unwrap();
                let specimen = Specimen::cuboid([SIZE_MM; 3], Boundary::Periodic);
                let mut balls = Spheres::default();
                for x in [1.0, 4.0, 7.0] {
                    balls.push([x, 5.0, 5.0], 2.0);
                }
                let model = Model::new(&specimen, &balls);
                let made = quality.write(&model, &Limits::default(), &Unattended, &mut Vec::new()).unwrap();
                *report = serde_json::to_value(made).unwrap();
            }),
        ];
        for (says, change) in changes {
            let fault = checked(&options(), change).unwrap_err();
            assert!(fault.contains(says), "{says}: {fault}");
        }
    }

    #[test]
    fn voxels_of_another_grid_or_packing_are_refused() {
        let options = json!({"type": "voxels", "format": "raw", "cells": 10});
        checked(&options, |_| {}).unwrap();
        let changes: [(&str, Change); 3] = [
            ("the grid has", |report| report["shape"][0] = json!(11)),
            ("must be", |report| report["volume_fraction"] = json!(0.2)),
            ("lie in grains", |report| report["aggregate_voxels"] = json!(1)),
        ];
        for (says, change) in changes {
            let fault = checked(&options, change).unwrap_err();
            assert!(fault.contains(says), "{says}: {fault}");
        }
    }
}
