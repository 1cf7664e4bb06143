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
    let report = write(model, &options, &Limits::default(), &Unattended, &mut out)?;
    Ok((report, String::from_utf8(out).unwrap()))
}

/// The separation of a row, from the grains alone.
fn separation(specimen: &Specimen, grains: GrainsRef<'_>, row: &[f64]) -> f64 {
    let [first, second] = [row[0] as usize, row[1] as usize];
    let shift = Vector3::from_fn(|k, _| row[2 + k] * specimen.bounds_mm()[k]);
    let n = Vector3::from_column_slice(&row[5..8]);
    let center = |i| Vector3::from(grains.center_mm(i));
    let support = |i: usize, n: Vector3<f64>| match grains {
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
    };
    (center(second) + shift - center(first)).dot(&n) - support(first, n) - support(second, -n)
}

#[test]
fn every_certificate_separates_its_pair_by_the_grains_alone() {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.5}});
    let polyhedron = json!({"type": "polyhedron", "rounding": 0.1, "template_count": 4});
    for shape in [None, Some(ellipsoid), Some(polyhedron)] {
        let (request, packing) = packed(shape);
        let model = Model::new(&request.specimen, &packing.grains);
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
            assert!((0.1 - 1e-12..2.0).contains(&row[8]), "{row:?}");
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
