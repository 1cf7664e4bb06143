#![allow(clippy::unwrap_used)]

use nalgebra::Vector3;
use serde_json::Value;

use super::*;
use crate::Unattended;
use crate::analysis::shape_report;
use crate::export::polyhedra_samples::mixed;
use crate::export::{ExportRequest, ExportType};
use crate::packing::{Solids, Spheres};
use crate::plan::Limits;
use crate::request::{Boundary, Specimen};
use crate::shape::{Ellipsoid, Pose};

const CUBE: Specimen = Specimen::Box { size_mm: [30.0; 3], boundary: Boundary::Walls };

fn written(grains: GrainsRef<'_>, format: &str) -> String {
    let export = ExportRequest::from_text(ExportType::Shapes, [("format", format)]).unwrap();
    let mut out = Vec::new();
    export.write(&Model::new(&CUBE, grains), &Limits::default(), &Unattended, &mut out).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn rows_are_the_figures_of_the_grains() {
    let ellipsoid = Ellipsoid::new([4.0, 3.0, 1.5]).unwrap();
    let grains = Solids::of_ellipsoids(vec![ellipsoid], vec![Pose::at(Vector3::zeros())]);
    let text = written((&grains).into(), "csv");
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    assert_eq!(lines.next().unwrap(), COLUMNS);
    let row = lines.next().unwrap();
    assert_eq!((row[..3].to_vec(), row[13]), (vec!["0", "ellipsoid", ""], "disc"));
    let known = [
        2.0 * libm::cbrt(18_f64),
        (2.0 * (9.0 + 2.25_f64)).sqrt(),
        8.0,
        3.0,
        24.0 * std::f64::consts::PI,
        ellipsoid.surface_mm2(),
        0.75,
        0.5,
        ellipsoid.sphericity(),
        0.375,
    ];
    for (found, known) in row[3..13].iter().map(|x| x.parse::<f64>().unwrap()).zip(known) {
        assert!((found - known).abs() < 1e-12 * known, "{found} {known}");
    }
    assert_eq!(lines.next(), None);

    let mut spheres = Spheres::default();
    spheres.push([5.0; 3], 2.0);
    let surface = 4.0 * std::f64::consts::PI;
    let row = format!(
        "0,sphere,,2.0,2.0,2.0,2.0,{:?},{surface:?},1.0,1.0,1.0,1.0,equant",
        std::f64::consts::PI / 6.0 * 8.0
    );
    assert_eq!(written((&spheres).into(), "csv").lines().nth(1).unwrap(), row);
}

#[test]
fn both_formats_hold_the_same_and_their_means_are_those_of_the_report() {
    let grains = mixed(&CUBE, 20, [5.0, 3.0], 0.1, 0.1);
    let report = shape_report(&grains).unwrap();
    let document: Value = serde_json::from_str(&written((&grains).into(), "json")).unwrap();
    assert_eq!(document["columns"], serde_json::json!(COLUMNS));
    let rows = document["rows"].as_array().unwrap();
    assert_eq!(rows.len(), grains.len());
    let text = written((&grains).into(), "csv");
    for (row, line) in rows.iter().zip(text.lines().skip(1)) {
        let cells: Vec<String> = row
            .as_array()
            .unwrap()
            .iter()
            .map(|cell| match cell {
                Value::Null => String::new(),
                Value::String(word) => word.clone(),
                Value::Number(number) if number.is_f64() => format!("{:?}", number.as_f64().unwrap()),
                other => other.to_string(),
            })
            .collect();
        assert_eq!(cells.join(","), line);
    }
    let column = |name: &str| COLUMNS.iter().position(|column| *column == name).unwrap();
    let sum = |of: &dyn Fn(&Value) -> f64| rows.iter().map(of).sum::<f64>();
    let number = |row: &Value, name: &str| row[column(name)].as_f64().unwrap();
    let volume = sum(&|row| number(row, "volume_mm3"));
    let mean = |name: &str| sum(&|row| number(row, name) * number(row, "volume_mm3")) / volume;
    let of_class = |class: &str| {
        sum(&|row| if row[column("zingg")] == class { number(row, "volume_mm3") } else { 0.0 }) / volume
    };
    for (found, known) in [
        (mean("elongation"), report.elongation_mean),
        (mean("flatness"), report.flatness_mean),
        (mean("sphericity"), report.sphericity_mean),
        (mean("roundness"), report.roundness_mean.unwrap()),
        (of_class("disc"), report.zingg.disc),
        (of_class("rod"), report.zingg.rod),
        (sum(&|row| number(row, "surface_mm2")), report.surface_mm2),
    ] {
        assert!((found - known).abs() < 1e-9 * (1.0 + known), "{found} {known}");
    }
    let kinds: std::collections::BTreeSet<&str> =
        rows.iter().map(|row| row[column("shape")].as_str().unwrap()).collect();
    assert_eq!(kinds.into_iter().collect::<Vec<_>>(), ["ellipsoid", "polyhedron"]);
}
