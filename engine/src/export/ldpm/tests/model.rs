use std::num::NonZeroUsize;
use std::sync::Mutex;

use serde_json::json;

use super::super::checks;
use super::super::measured::Mesh;
use super::super::topology::Topology;
use super::super::{BoundaryNodes, Lattice, LatticeFormat, LatticeOptions};
use super::{in_box, in_cylinder, with_clearance};
use crate::control::{Control, Progress, Unattended};
use crate::export::steps::Steps;
use crate::export::{Export as _, ExportError, Model};
use crate::geometry::delaunay::NONE;
use crate::packing::Spheres;
use crate::plan::Limits;
use crate::request::decode::{At, Faults};
use crate::request::{Boundary, Specimen};

fn lattice<'a>(
    specimen: &'a Specimen,
    spheres: &'a Spheres,
    options: &LatticeOptions,
) -> Result<Lattice<'a>, ExportError> {
    Lattice::make(&Model::new(specimen, spheres), options, &Limits::default(), &Unattended)
}

#[test]
fn a_box_is_filled_by_its_cells() {
    let (specimen, spheres) = with_clearance();
    let made = lattice(&specimen, &spheres, &LatticeOptions::default()).unwrap();
    let report = made.report();
    let checks = &report.checks;
    let sum: f64 = made.cells().iter().map(|cell| cell.volume_mm3).sum();
    assert!((sum - 64_000.0).abs() < 64_000.0 * 1e-12, "{sum}");
    assert!((report.volume_over_specimen - 1.0).abs() < 1e-12);
    assert!(checks.tetrahedron_volume_error < 1e-12);
    assert!(checks.cell_volume_error < 1e-12);
    assert!(checks.closure_error < 1e-12);
    assert!(checks.fabric_trace_error < 1e-12);
    assert!((0..3).all(|a| (checks.fabric[a] - 1.0 / 3.0).abs() < 0.05), "{:?}", checks.fabric);
    assert_eq!(checks.cells_not_positive, 0);
    assert_eq!((checks.crowded_nodes, checks.overlapping_edges), (0, 0));
    assert_eq!(report.facets, 12 * report.tetrahedra);
    assert_eq!(report.edges, checks.rings_closed + checks.rings_open);
    assert_eq!(report.nodes.grains, spheres.len() as u64);
    assert_eq!(report.nodes.total, made.nodes().len() as u64);
}

/// Grains that touch walls come near vertices at most.
#[test]
fn any_packing_becomes_a_lattice() {
    for (specimen, spheres) in [in_box(), in_cylinder()] {
        for boundary_nodes in [BoundaryNodes::PoissonDisk, BoundaryNodes::Random] {
            for surface_radius in [0.0, 0.55] {
                let options = LatticeOptions { boundary_nodes, surface_radius, ..LatticeOptions::default() };
                let report = lattice(&specimen, &spheres, &options).unwrap().report;
                assert_eq!(report.checks.cells_not_positive, 0);
                assert!(report.checks.crowded_nodes <= 8);
                let least = report.nodes.smallest_spacing_mm.unwrap();
                assert!(least >= report.nodes.spacing_mm * (1.0 - 1e-12));
            }
        }
    }
}

#[test]
fn a_cylinder_becomes_a_polyhedron_a_little_smaller() {
    let (specimen, spheres) = in_cylinder();
    let coarse = lattice(&specimen, &spheres, &LatticeOptions::default()).unwrap().report;
    let fine = lattice(&specimen, &spheres, &LatticeOptions { spacing: 1.1, ..LatticeOptions::default() })
        .unwrap()
        .report;
    assert!(coarse.volume_over_specimen > 0.97 && coarse.volume_over_specimen < 1.0);
    assert!(fine.volume_over_specimen > coarse.volume_over_specimen && fine.volume_over_specimen < 1.0);
    assert!(fine.checks.cell_volume_error < 1e-12);
}

/// One grain is enough, and so is one that fills its box.
#[test]
fn few_grains_are_enough() {
    let specimen = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Walls };
    for d in [1.0, 10.0] {
        let mut spheres = Spheres::default();
        spheres.push([5.0; 3], d);
        let made = lattice(&specimen, &spheres, &LatticeOptions::default()).unwrap();
        assert!((made.report().volume_mm3 - 1000.0).abs() < 1e-9);
    }
}

fn refused(specimen: &Specimen, spheres: &Spheres, limits: &Limits) -> ExportError {
    Lattice::make(&Model::new(specimen, spheres), &LatticeOptions::default(), limits, &Unattended)
        .unwrap_err()
}

#[test]
fn what_cannot_be_made_is_refused_with_a_reason() {
    let periodic = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Periodic };
    let error = LatticeOptions::default().check(&periodic, &Limits::default()).unwrap_err();
    assert!(error.to_string().contains("\"boundary\": \"walls\""), "{error}");

    let walls = Specimen::Box { size_mm: [10.0; 3], boundary: Boundary::Walls };
    LatticeOptions::default().check(&walls, &Limits::default()).unwrap();
    let empty = refused(&walls, &Spheres::default(), &Limits::default());
    assert!(matches!(empty, ExportError::Unavailable(_)), "{empty}");

    let mut spheres = Spheres::default();
    spheres.push([5.0; 3], 0.1);
    let limits = Limits { max_memory_bytes: 1_000_000, ..Limits::default() };
    let ExportError::TooLarge(fault) = refused(&walls, &spheres, &limits) else { panic!("it fits") };
    assert_eq!(fault.pointer, "/spacing");
    assert!(fault.detail.contains("GB of memory"), "{fault}");

    spheres.push([5.04, 5.0, 5.0], 0.1);
    let overlap = refused(&walls, &spheres, &Limits::default());
    assert!(overlap.to_string().contains("T13: 1 pairs of grains overlap"), "{overlap}");

    let mut outside = Spheres::default();
    outside.push([5.0, 5.0, 9.8], 1.0);
    let error = refused(&walls, &outside, &Limits::default());
    assert!(error.to_string().contains("1 grains reach beyond"), "{error}");
}

/// Nodes farther apart than the radius make a rim of fewer than six corners.
#[test]
fn a_cylinder_that_would_lose_its_shape_is_refused() {
    let specimen = Specimen::Cylinder { diameter_mm: 10.0, height_mm: 40.0 };
    let mut spheres = Spheres::default();
    spheres.push([5.0, 5.0, 30.0], 9.0);
    spheres.push([5.0, 5.0, 10.0], 9.0);
    let error = refused(&specimen, &spheres, &Limits::default());
    assert!(error.to_string().contains("smaller \"spacing\""), "{error}");
}

#[test]
fn a_lattice_with_a_fault_does_not_pass() {
    let (specimen, spheres) = in_box();
    let made = lattice(&specimen, &spheres, &LatticeOptions::default()).unwrap();
    let Lattice { nodes, tets, neighbors, .. } = made;
    let judged = |tets: &[[u32; 4]], neighbors: &[[u32; 4]]| {
        let topology = Topology::new(nodes.len(), tets, neighbors, &Unattended).unwrap();
        let steps = Steps { control: &Unattended, total: 0, unit: "", message: "" };
        let mesh = Mesh { nodes: &nodes, tets, neighbors };
        let found = checks::check(&mesh, &topology, NonZeroUsize::MIN, &steps);
        found.map(|_| ()).map_err(|e| e.to_string())
    };
    judged(&tets, &neighbors).unwrap();

    // A tetrahedron turned inside out.
    let mut flipped = (tets.clone(), neighbors.clone());
    flipped.0[7].swap(2, 3);
    flipped.1[7].swap(2, 3);
    assert!(judged(&flipped.0, &flipped.1).unwrap_err().contains("T3"));

    // One left out, from inside: a void.
    let inside = (0..tets.len()).rev().find(|&t| neighbors[t].iter().all(|&other| other != NONE)).unwrap();
    let mut fewer = (tets.clone(), neighbors.clone());
    fewer.0.remove(inside);
    fewer.1.remove(inside);
    for other in fewer.1.as_flattened_mut() {
        *other = match *other {
            o if o == inside as u32 => NONE,
            o if o != NONE && o > inside as u32 => o - 1,
            o => o,
        };
    }
    let error = judged(&fewer.0, &fewer.1).unwrap_err();
    assert!(error.contains("T6") || error.contains("T5"), "{error}");

    // Two neighbours that do not know of each other.
    let mut torn = neighbors.clone();
    let other = torn[inside][0];
    torn[inside][0] = NONE;
    assert!(judged(&tets, &torn).is_err(), "{other}");
}

struct Impatient;

impl Control for Impatient {
    fn report(&self, _: &Progress) {}
    fn should_stop(&self) -> bool {
        true
    }
}

#[test]
fn it_stops_when_told_to() {
    let (specimen, spheres) = in_box();
    let model = Model::new(&specimen, &spheres);
    let made = lattice(&specimen, &spheres, &LatticeOptions::default()).unwrap();
    let error =
        Lattice::make(&model, &LatticeOptions::default(), &Limits::default(), &Impatient).unwrap_err();
    assert!(matches!(error, ExportError::Stopped), "{error}");
    for file in [LatticeFormat::Chrono, LatticeFormat::Tets, LatticeFormat::Facets, LatticeFormat::Cells] {
        let options = LatticeOptions { format: file, ..LatticeOptions::default() };
        let error =
            made.write(&options, None, NonZeroUsize::MIN, &Impatient, &mut std::io::sink()).unwrap_err();
        assert!(matches!(error, ExportError::Stopped), "{error}");
    }
}

#[test]
fn files_do_not_depend_on_the_threads() {
    for (specimen, spheres) in [in_box(), in_cylinder()] {
        let model = Model::new(&specimen, &spheres);
        for file in [LatticeFormat::Chrono, LatticeFormat::Tets, LatticeFormat::Facets, LatticeFormat::Cells]
        {
            let options = LatticeOptions { format: file, ..LatticeOptions::default() };
            let [first, others @ ..] = [1, 2, 3, 8].map(|threads| {
                let export_threads = NonZeroUsize::new(threads).unwrap();
                let limits = Limits { export_threads, ..Limits::default() };
                let mut bytes = Vec::new();
                let report = options.write(&model, &limits, &Unattended, &mut bytes).unwrap();
                (report, bytes)
            });
            assert!(others.iter().all(|other| *other == first), "{file:?}");
        }
    }
}

/// Keeps the fractions that it is told.
#[derive(Default)]
struct Listening(Mutex<Vec<f64>>);

impl Control for Listening {
    fn report(&self, progress: &Progress) {
        self.0.lock().unwrap().push(progress.fraction);
    }
    fn should_stop(&self) -> bool {
        false
    }
}

#[test]
fn progress_rises_from_0_to_1() {
    let (specimen, spheres) = in_box();
    for file in [LatticeFormat::Chrono, LatticeFormat::Tets, LatticeFormat::Facets, LatticeFormat::Cells] {
        let heard = Listening::default();
        let options = LatticeOptions { format: file, ..LatticeOptions::default() };
        let model = Model::new(&specimen, &spheres);
        options.write(&model, &Limits::default(), &heard, &mut std::io::sink()).unwrap();
        let heard = heard.0.into_inner().unwrap();
        assert!(heard.len() >= 3 && heard.is_sorted(), "{heard:?}");
        assert!(heard.iter().all(|fraction| (0.0..=1.0).contains(fraction)), "{heard:?}");
    }
}

fn read(value: &serde_json::Value) -> Result<LatticeOptions, Vec<String>> {
    let faults = Faults::default();
    let mut object = At::root(value, &faults).object().unwrap();
    let options = LatticeOptions::read(&mut object);
    object.finish();
    let found = faults.into_vec();
    if found.is_empty() { Ok(options.unwrap()) } else { Err(found.iter().map(ToString::to_string).collect()) }
}

#[test]
fn options_have_defaults_and_bounds() {
    assert_eq!(read(&json!({})).unwrap(), LatticeOptions::default());
    let all = json!({"spacing": 2, "fictitious_diameter": 0.5, "boundary_nodes": "random", "seed": 3, "format": "cells"});
    let read_all = read(&all).unwrap();
    assert_eq!(read_all.surface_radius, 0.25);
    assert_eq!(read(&serde_json::to_value(&read_all).unwrap()).unwrap(), read_all);
    assert_eq!(read(&json!({"surface_radius": 0})).unwrap().surface_radius, 0.0);

    let faults =
        read(&json!({"spacing": 0, "boundary_nodes": "even", "seed": -1, "format": "zip"})).unwrap_err();
    let starts = [
        "/spacing: 0 is out",
        "/boundary_nodes: \"even\" is unknown",
        "/seed: -1",
        "/format: \"zip\" is unknown",
    ];
    for (fault, start) in faults.iter().zip(starts) {
        assert!(fault.starts_with(start), "{fault}");
    }
    assert_eq!(faults.len(), 4);
    let faults = read(&json!({"spacing": 1.0})).unwrap_err();
    assert!(faults[0].starts_with("/spacing: nodes 1 d_min apart overlap"), "{faults:?}");
}
