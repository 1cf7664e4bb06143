//! Voxels made in pieces on several threads.

#![allow(clippy::unwrap_used)]

use std::io;

use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::layers::{Part, Sweep};
use super::tests::read;
use super::*;
use crate::Unattended;
use crate::export::polyhedra_samples::{mixed, packed};
use crate::packing::{GrainsRef, Solids, Spheres};
use crate::request::Boundary;
use crate::shape::{Ellipsoid, Pose};

fn specimens() -> [Specimen; 3] {
    [
        Specimen::Box { size_mm: [18.0, 16.0, 14.0], boundary: Boundary::Walls },
        Specimen::Box { size_mm: [14.0, 15.0, 14.0], boundary: Boundary::Periodic },
        Specimen::Cylinder { diameter_mm: 18.0, height_mm: 16.0 },
    ]
}

/// Grains of each kind in a specimen, of three aggregates of which one has no grain.
struct Samples {
    spheres: Spheres,
    ellipsoids: Solids,
    polyhedra: Solids,
    mixed: Solids,
}

impl Samples {
    fn new(specimen: &Specimen) -> Self {
        let rounded = packed(specimen, 24, [5.0, 2.0], 0.1, 0.04);
        let mut spheres = Spheres::default();
        let (mut axes, mut poses) = (Vec::new(), Vec::new());
        for grain in 0..rounded.len() {
            let place = rounded.poses[grain].center_mm;
            let d = rounded.shapes[grain].d_mm();
            spheres.push(place.into(), 0.7 * d);
            axes.push(Ellipsoid::new([0.3 * d, 0.35 * d, 0.4 * d]).unwrap());
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.7, 0.1 * grain as f64));
            poses.push(Pose { center_mm: place, orientation: turn });
        }
        let of = |count: usize| (0..count).map(|row| if row % 3 == 0 { 2 } else { 0 }).collect();
        spheres.aggregate = of(spheres.len());
        let mut ellipsoids = Solids::of_ellipsoids(axes, poses);
        ellipsoids.aggregate = of(ellipsoids.len());
        let mut mixed = mixed(specimen, 24, [5.0, 2.0], 0.1, 0.05);
        mixed.aggregate = of(mixed.len());
        let polyhedra = packed(specimen, 24, [5.0, 2.0], 0.1, 0.0);
        Self { spheres, ellipsoids, polyhedra, mixed }
    }

    fn all(&self) -> [GrainsRef<'_>; 4] {
        [(&self.spheres).into(), (&self.ellipsoids).into(), (&self.polyhedra).into(), (&self.mixed).into()]
    }
}

/// Grids of many small layers, of which a piece has a part, and of few.
fn options() -> Vec<(VoxelFormat, Value)> {
    vec![
        (VoxelFormat::Raw, json!({"label": "phase", "cells": 45, "samples": 1})),
        (VoxelFormat::Raw, json!({"label": "grain", "cells": 9})),
        (VoxelFormat::Raw, json!({"label": "aggregate", "cells": 31})),
        (VoxelFormat::Vti, json!({"label": "grain", "cells": 31, "fractions": true, "samples": 3})),
        (VoxelFormat::Vti, json!({"label": "aggregate", "voxel_mm": 0.2})),
        (VoxelFormat::Vti, json!({"cells": 1, "fractions": true})),
        (VoxelFormat::Inp, json!({"cells": 23})),
        (VoxelFormat::Inp, json!({"cells": 2})),
        (VoxelFormat::Npy, json!({"label": "grain", "cells": 31})),
        (VoxelFormat::Npy, json!({"for": "automesh", "label": "aggregate", "cells": 23})),
        (VoxelFormat::Vti, json!({"for": "damask", "label": "grain", "cells": 31})),
        (VoxelFormat::Vtk, json!({"for": "amitex", "cells": 23})),
    ]
}

fn limits(threads: usize) -> Limits {
    Limits { export_threads: threads.try_into().unwrap(), ..Limits::default() }
}

#[test]
fn bytes_and_reports_do_not_depend_on_the_threads() {
    for specimen in specimens() {
        let samples = Samples::new(&specimen);
        for grains in samples.all() {
            let model = Model::new(&specimen, grains);
            for (format, options) in options() {
                let options = read(format, &options).unwrap();
                let written = |threads: usize| {
                    let mut bytes = Vec::new();
                    let report = options.write(&model, &limits(threads), &Unattended, &mut bytes).unwrap();
                    (report, bytes)
                };
                let one = written(1);
                assert!(!one.1.is_empty());
                for threads in [2, 3, 8] {
                    assert!(written(threads) == one, "{threads} threads, {options:?}, {specimen:?}");
                }
            }
        }
    }
}

/// What a row becomes depends on the row alone: parts of layers that some sweeps make are those that one makes of
/// whole layers.
#[test]
fn parts_of_layers_are_those_of_whole_layers() {
    for specimen in specimens() {
        let samples = Samples::new(&specimen);
        for grains in samples.all() {
            let model = Model::new(&specimen, grains);
            let placed = PlacedGrains::new(grains).unwrap();
            let grid = VoxelGrid::new(&specimen, &read(VoxelFormat::Raw, &json!({"cells": 29})).unwrap());
            let bodies = Bodies::new(&model, &placed, &grid).unwrap();
            let [nx, ny, nz] = grid.shape;
            let made = |rows_of_part: usize, sweeps: usize| {
                let (mut labels, mut shares) = (vec![0_u32; nx * ny * nz], vec![0.0_f32; nx * ny * nz]);
                let mut sweeps: Vec<[Sweep; 2]> = (0..sweeps).map(|_| Default::default()).collect();
                let parts = (0..nz).flat_map(|k| (0..ny).step_by(rows_of_part).map(move |j| (k, j)));
                for (number, (k, j)) in parts.enumerate() {
                    let rows = j..ny.min(j + rows_of_part);
                    let voxels = nx * (rows.start + ny * k)..nx * (rows.end + ny * k);
                    let count = sweeps.len();
                    let [of_labels, of_shares] = &mut sweeps[number % count];
                    let part = Part { k, rows };
                    let label = |grain: usize| grain as u32 + 1;
                    bodies.fill(of_labels, &part, &mut labels[voxels.clone()], &label).unwrap();
                    bodies.add_shares(of_shares, &part, 3, &mut shares[voxels]).unwrap();
                }
                let missing = bodies.grains_without_voxel(&sweeps.iter().map(|[of_labels, _]| of_labels));
                (labels, shares, missing)
            };
            let whole = made(ny, 1);
            assert!(whole.0.iter().any(|label| *label > 0) && whole.1.iter().any(|share| *share > 0.0));
            for (rows_of_part, sweeps) in [(1, 1), (1, 5), (3, 2), (7, 4), (ny, 3)] {
                assert!(made(rows_of_part, sweeps) == whole, "{rows_of_part} rows, {sweeps} sweeps");
            }
        }
    }
}

/// Takes so many bytes and then fails.
struct Full {
    left: usize,
}

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.left == 0 {
            return Err(io::Error::new(io::ErrorKind::StorageFull, "no space is left here"));
        }
        let taken = bytes.len().min(self.left);
        self.left -= taken;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn an_error_of_the_writer_ends_the_work_with_that_error() {
    let specimen = &specimens()[0];
    let grains = mixed(specimen, 24, [5.0, 2.0], 0.1, 0.05);
    let model = Model::new(specimen, &grains);
    for (format, options) in [
        (VoxelFormat::Raw, json!({"voxel_mm": 0.1, "samples": 1})),
        (VoxelFormat::Vti, json!({"voxel_mm": 0.1, "samples": 1, "fractions": true})),
        (VoxelFormat::Inp, json!({"cells": 60, "samples": 1})),
        (VoxelFormat::Vti, json!({"for": "damask", "cells": 60, "samples": 1})),
        (
            VoxelFormat::Zip,
            json!({"for": "fans", "voxel_mm": 0.1, "samples": 1, "materials": {
                "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}, "aggregate": {"youngs_modulus_gpa": 0}}}),
        ),
    ] {
        let options = read(format, &options).unwrap();
        let mut all = Vec::new();
        options.write(&model, &limits(2), &Unattended, &mut all).unwrap();
        for threads in [1, 2, 8] {
            for left in [0, all.len() / 3, all.len() / 3 * 2, all.len() - 1] {
                let mut out = Full { left };
                let failed = options.write(&model, &limits(threads), &Unattended, &mut out).unwrap_err();
                assert!(
                    matches!(&failed, ExportError::Write(error) if error.kind() == io::ErrorKind::StorageFull),
                    "{failed}"
                );
                assert_eq!((failed.to_string().as_str(), out.left), ("no space is left here", 0));
            }
        }
    }
}
