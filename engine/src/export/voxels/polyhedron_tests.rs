//! Voxels of polyhedra.

#![allow(clippy::unwrap_used)]

use nalgebra::{UnitQuaternion, Vector3};
use serde_json::json;

use super::tests::written;
use super::*;
use crate::export::polyhedra_samples::{mixed, packed};
use crate::geometry::convex::{Convex, Place};
use crate::packing::Solids;
use crate::request::Boundary;
use crate::shape::{Ellipsoid, Pose};

/// Voxels have the label of the grain that their centre lies in, and the volume is that of Steiner's formula.
#[test]
fn voxels_of_polyhedra_are_those_whose_centres_lie_inside() {
    for (specimen, rounding) in [
        (Specimen::Box { size_mm: [18.0, 16.0, 14.0], boundary: Boundary::Walls }, 0.0),
        (Specimen::Box { size_mm: [14.0, 15.0, 14.0], boundary: Boundary::Periodic }, 0.1),
        (Specimen::Cylinder { diameter_mm: 18.0, height_mm: 16.0 }, 0.03),
    ] {
        let grains = packed(&specimen, 24, [5.0, 2.0], 0.1, rounding);
        let templates = Convex::all(&grains.templates);
        let model = Model::new(&specimen, &grains);
        let (report, bytes) = written(&model, VoxelFormat::Raw, &json!({"label": "grain", "cells": 31}));
        let shifts: &[f64] = if specimen.is_periodic() { &[-1.0, 0.0, 1.0] } else { &[0.0] };
        let bounds = Vector3::from(specimen.bounds_mm());
        let [nx, ny, _] = report.shape.map(|n| n as usize);
        let mut compared = 0;
        for (at, label) in bytes.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).enumerate() {
            let cell = [at % nx, at / nx % ny, at / nx / ny];
            let p = Vector3::from_fn(|a, _| (cell[a] as f64 + 0.5) * report.spacing_mm[a]);
            if label == u32::MAX {
                continue;
            }
            let mut found = 0;
            for row in 0..grains.len() {
                let (template, place) = (
                    &templates[grains.shapes[row].template().unwrap() as usize],
                    Place::new(grains.shapes[row].d_mm(), &grains.poses[row]),
                );
                let outer = grains.templates[grains.shapes[row].template().unwrap() as usize].outer_radius()
                    * place.scale;
                for x in shifts {
                    for y in shifts {
                        for z in shifts {
                            let moved = p + Vector3::new(*x, *y, *z).component_mul(&bounds);
                            // Farther points are not inside.
                            let is_near = (moved - place.center).norm() <= outer;
                            if is_near && template.distance(&place.local(&moved)) < 0.0 {
                                found = row as u32 + 1;
                            }
                        }
                    }
                }
            }
            assert_eq!(label, found, "{specimen:?} at {p:?}");
            compared += 1;
        }
        assert_eq!(compared, report.inside_voxels);
        let exact: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        assert!((report.volume_fraction - exact / specimen.volume_mm3()).abs() < 1e-12);
        let (report, _) =
            written(&model, VoxelFormat::Vti, &json!({"cells": 40, "fractions": true, "samples": 4}));
        let error = report.volume_fraction_samples / report.volume_fraction - 1.0;
        assert!(error.abs() < 1e-3, "{error}");
        assert_eq!(report.grains_without_voxel, 0);
    }
}

/// Ellipsoids and polyhedra have their exact volume, and shares of voxels that add up to it.
#[test]
fn voxels_of_ellipsoids_and_polyhedra_have_their_volume() {
    for specimen in [
        Specimen::Box { size_mm: [14.0, 15.0, 14.0], boundary: Boundary::Periodic },
        Specimen::Cylinder { diameter_mm: 18.0, height_mm: 16.0 },
    ] {
        let grains = mixed(&specimen, 24, [5.0, 2.0], 0.1, 0.05);
        let model = Model::new(&specimen, &grains);
        let (report, _) =
            written(&model, VoxelFormat::Vti, &json!({"cells": 40, "fractions": true, "samples": 4}));
        let exact: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        assert!((report.volume_fraction - exact / specimen.volume_mm3()).abs() < 1e-12);
        let error = report.volume_fraction_samples / report.volume_fraction - 1.0;
        assert!(error.abs() < 2e-3, "{error}");
        assert_eq!(report.grains_without_voxel, 0);
    }
}

/// A needle that is longer than an edge of its periodic box, turned so that it stays clear of its own images.
#[test]
fn voxels_of_a_grain_longer_than_an_edge_have_its_volume() {
    let specimen = Specimen::Box { size_mm: [3.0, 30.0, 30.0], boundary: Boundary::Periodic };
    let orientation = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_3);
    let grains = Solids::of_ellipsoids(
        vec![Ellipsoid::new([11.0, 1.0, 1.0]).unwrap()],
        vec![Pose { center_mm: Vector3::new(1.0, 15.0, 15.0), orientation }],
    );
    let (report, bytes) =
        written(&Model::new(&specimen, &grains), VoxelFormat::Raw, &json!({"label": "phase", "cells": 300}));
    let inside: f64 = bytes.iter().map(|label| f64::from(u8::from(*label == 1))).sum();
    let volume = inside * report.spacing_mm.iter().product::<f64>();
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 11.0;
    assert!((volume / exact - 1.0).abs() < 5e-3, "{volume} {exact}");
}
