#![allow(clippy::unwrap_used)]

use nalgebra::Vector3;
use serde_json::{Value, json};

use super::*;
use crate::export::{ExportRequest, ExportType};
use crate::packing::GrainsRef;
use crate::request::Specimen;
use crate::{Packing, PackingRequest, Unattended, pack};

fn packed(shape: Option<Value>) -> (PackingRequest, Packing) {
    let mut mix = json!({"grading": {"type": "standard", "name": "A8"}, "d_min_mm": 4, "volume_fraction": 0.5,
                         "volume_fraction_of": "placed_grains", "allow_coarse": true});
    if let Some(shape) = shape {
        mix["shape"] = shape;
    }
    let specimen = json!({"type": "box", "size_mm": [30, 30, 30], "boundary": "periodic"});
    let request = json!({"specimen": specimen, "mix": mix, "distance": {"type": "constant", "gap_mm": 0.1}});
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    (request, packing)
}

fn written(model: &Model<'_>, options: &[(&str, &str)]) -> Result<(CertificateReport, String), ExportError> {
    let export = ExportRequest::from_text(ExportType::Certificates, options.iter().copied()).unwrap();
    let ExportRequest::Certificates(options) = export else { panic!() };
    let mut out = Vec::new();
    let report = options.write(model, &Limits::default(), &Unattended, &mut out)?;
    Ok((report, String::from_utf8(out).unwrap()))
}

/// How far a grain reaches from its centre along a vector.
fn support(grains: GrainsRef<'_>, i: usize, n: Vector3<f64>) -> f64 {
    match grains {
        GrainsRef::Spheres(spheres) => spheres.d_mm[i] / 2.0 * n.norm(),
        GrainsRef::Solids(solids) => {
            let local = solids.poses[i].rotation().transpose() * n;
            if let Some(ellipsoid) = solids.shape(i).ellipsoid() {
                ellipsoid.semi_axes_mm().component_mul(&local).norm()
            } else {
                let of = solids.shape(i).polyhedron().unwrap();
                let core = of.template.vertices().iter().map(|v| v.dot(&local)).fold(f64::MIN, f64::max);
                of.scale_mm * (core + of.template.rounding() * n.norm())
            }
        }
    }
}

/// The separation of a row, from the grains alone.
fn separation(specimen: &Specimen, grains: GrainsRef<'_>, row: &[f64]) -> f64 {
    let [first, second] = [row[0] as usize, row[1] as usize];
    let shift = Vector3::from_fn(|k, _| row[2 + k] * specimen.bounds_mm()[k]);
    let n = Vector3::from_column_slice(&row[5..8]);
    let center = |i| Vector3::from(grains.center_mm(i));
    (center(second) + shift - center(first)).dot(&n) - support(grains, first, n) - support(grains, second, -n)
}

#[test]
fn every_certificate_separates_its_pair_by_the_grains_alone() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.5}});
    let polyhedron = json!({"type": "polyhedron", "rounding": 0.1, "template_count": 4});
    for shape in [None, Some(ellipsoid), Some(polyhedron)] {
        let (request, packing) = packed(shape);
        let model = Model::new(&request.specimen, &packing.grains).with_distance(request.distance);
        let (report, text) = written(&model, &[("closer_than_mm", "2")]).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next().unwrap(), COLUMNS.join(","));
        let rows: Vec<Vec<f64>> =
            lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
        assert_eq!((report.pairs, report.closer_than_mm), (rows.len() as u64, 2.0));
        assert!(rows.len() > packing.grains.len(), "{} pairs", rows.len());
        assert!(rows.iter().any(|row| row[2..5] != [0.0; 3]), "no pair through a face of the period");
        for row in &rows {
            let n = Vector3::from_column_slice(&row[5..8]);
            assert!((n.norm() - 1.0).abs() < 1e-12);
            let found = separation(&request.specimen, model.grains, row);
            assert!((found - row[8]).abs() < 1e-11, "{found} {row:?}");
            assert!((0.1 - 1e-12..2.0).contains(&row[8]) && row[9] == 0.1, "{row:?}");
        }
        let least = packing.report.check.min_gap_mm.unwrap();
        assert!((report.min_separation_mm.unwrap() - least).abs() < 1e-9);

        let (_, text) = written(&model, &[("format", "json"), ("closer_than_mm", "2")]).unwrap();
        let document: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(document["columns"], json!(COLUMNS));
        let numbers: Vec<Vec<f64>> = serde_json::from_value(document["rows"].clone()).unwrap();
        assert_eq!(numbers, rows);
    }
}

/// Rows of walls show how far a grain is from the planes and the lateral surface, by the grains alone.
#[test]
fn walls_have_rows_with_the_gap_that_their_rule_asks_for() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.7, "flatness": 0.5}});
    let polyhedron = json!({"type": "polyhedron", "rounding": 0.1, "template_count": 4});
    for specimen in [
        json!({"type": "box", "size_mm": [24, 25, 26]}),
        json!({"type": "cylinder", "diameter_mm": 25, "height_mm": 26}),
    ] {
        for shape in [json!({"type": "sphere"}), ellipsoid.clone(), polyhedron.clone()] {
            let mix = json!({"grading": {"type": "monodisperse", "diameter_mm": 5}, "volume_fraction": 0.25,
                "allow_coarse": true, "shape": shape});
            let distance = json!({"type": "constant", "gap_mm": 0.2, "wall_gap_mm": 0.3});
            let request = json!({"specimen": specimen, "mix": mix, "distance": distance});
            let request = PackingRequest::from_json(&request, 1).unwrap();
            let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
            let model = Model::new(&request.specimen, &packing.grains).with_distance(request.distance);
            let (report, text) = written(&model, &[("closer_than_mm", "3")]).unwrap();
            let rows = text.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect());
            let rows: Vec<Vec<f64>> = rows.collect();
            let walls: Vec<&Vec<f64>> = rows.iter().filter(|row| row[1] == -1.0).collect();
            assert_eq!((report.walls, report.pairs), (walls.len() as u64, (rows.len() - walls.len()) as u64));
            assert!(walls.len() > 6 && walls.iter().all(|row| row[9] == 0.3 && row[8] >= 0.3 - 1e-12));
            assert!(rows.iter().all(|row| row[1] == -1.0 || row[9] == 0.2));
            // Points of the grain's surface by many directions: none is nearer to a wall than its row says.
            let bounds = request.specimen.bounds_mm();
            for row in walls {
                let n = Vector3::from_column_slice(&row[5..8]);
                let axis = Vector3::new(bounds[0] / 2.0, bounds[1] / 2.0, 0.0);
                let is_plane = n.iter().filter(|x| x.abs() > 1e-9).count() == 1
                    && (n.z != 0.0 || matches!(request.specimen, Specimen::Box { .. }));
                let distance = |n: &Vector3<f64>| {
                    let wall = if is_plane {
                        (0..3).map(|k| if n[k] > 0.5 { bounds[k] } else { 0.0 }).sum::<f64>()
                    } else {
                        bounds[0] / 2.0 + axis.dot(n)
                    };
                    let grain = row[0] as usize;
                    let center = Vector3::from(model.grains.center_mm(grain));
                    wall - center.dot(n) - support(model.grains, grain, *n)
                };
                assert!((distance(&n) - row[8]).abs() < 1e-9, "{row:?}: {}", distance(&n));
                if !is_plane {
                    for step in 0..360 {
                        let angle = f64::from(step).to_radians();
                        let other = Vector3::new(angle.cos(), angle.sin(), 0.0);
                        assert!(distance(&other) > row[8] - 1e-9, "{row:?}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_pair_that_misses_its_gap_is_refused_with_both_numbers() {
    let (request, packing) = packed(None);
    let wide = json!({"type": "constant", "gap_mm": 0.15});
    let wide = PackingRequest::from_json(
        &json!({"specimen": {"type": "box", "size_mm": [30, 30, 30], "boundary": "periodic"}, "distance": wide,
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 5}, "volume_fraction": 0.1}}),
        1,
    )
    .unwrap();
    let model = Model::new(&request.specimen, &packing.grains).with_distance(wide.distance);
    let fault = written(&model, &[]).unwrap_err().to_string();
    assert!(fault.contains("mm apart: their rule asks for 0.15 mm"), "{fault}");
}

#[test]
fn distances_beyond_neighbours_and_overlaps_are_refused() {
    let (request, packing) = packed(None);
    let model = Model::new(&request.specimen, &packing.grains);
    let fault = written(&model, &[("closer_than_mm", "9")]).unwrap_err().to_string();
    assert!(fault.starts_with("/closer_than_mm: 9 is out of range: must be at most 4"), "{fault}");
    let mut spheres = packing.into_spheres().unwrap();
    spheres.x_mm[1] = spheres.x_mm[0];
    spheres.y_mm[1] = spheres.y_mm[0];
    spheres.z_mm[1] = spheres.z_mm[0];
    let overlapping = Model::new(&request.specimen, &spheres);
    assert!(matches!(written(&overlapping, &[]), Err(ExportError::CheckFailed(_))));
}
