//! Slices through polyhedra.

#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use nalgebra::Vector3;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::tests::{cube, decoded, read};
use super::*;
use crate::Unattended;
use crate::export::polyhedra_samples::packed;
use crate::geometry::convex::{Convex, Place};
use crate::packing::Solids;
use crate::request::Boundary;
use crate::shape::polyhedron::samples::cuboid;
use crate::shape::{Pose, Solid};

fn specimens() -> [Specimen; 3] {
    [
        Specimen::Box { size_mm: [18.0, 16.0, 14.0], boundary: Boundary::Walls },
        Specimen::Box { size_mm: [14.0, 15.0, 14.0], boundary: Boundary::Periodic },
        Specimen::Cylinder { diameter_mm: 18.0, height_mm: 16.0 },
    ]
}

fn grains(specimen: &Specimen, rounding: f64) -> Solids {
    packed(specimen, 24, [5.0, 2.0], 0.2, rounding)
}

fn written(specimen: &Specimen, grains: &Solids, options: &Value) -> (SliceReport, Vec<u8>) {
    let mut bytes = Vec::new();
    let model = Model::new(specimen, grains);
    let options = read(options).unwrap();
    let report = options.write(&model, &Limits::default(), &Unattended, &mut bytes).unwrap();
    (report, bytes)
}

/// A cuboid with the edges 4, 2 and 1 over their common factor, so that its volume is that of a ball of the diameter.
fn one(center: [f64; 3], d_mm: f64, rounding: f64) -> Solids {
    let template = cuboid([2.0, 1.0, 0.5], 0.0).with_relative_rounding(rounding).unwrap().normalized();
    Solids {
        templates: vec![template],
        shapes: vec![Solid::Polyhedron { template: 0, d_mm }],
        poses: vec![Pose::at(center.into())],
        aggregate: Vec::new(),
    }
}

#[test]
fn rows_of_polygons_are_those_of_the_plane() {
    let grains = one([4.0, 5.0, 6.0], 3.0, 0.0);
    let half = grains.templates[0].vertices()[7] * 3.0;
    let options = json!({"axis": "y", "at_mm": 5.2, "format": "json"});
    let (report, bytes) = written(&cube(Boundary::Walls), &grains, &options);
    let value: Value = serde_json::from_slice(&bytes).unwrap();
    assert_eq!(
        value["polygons"]["columns"],
        json!(["u_mm", "v_mm", "grain", "diameter_mm", "area_mm2", "corners_mm"])
    );
    assert!(value.get("circles").is_none() && value.get("ellipses").is_none());
    let row = &value["polygons"]["rows"][0];
    let corners: Vec<[f64; 2]> = serde_json::from_value(row[5].clone()).unwrap();
    let expected = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[u, v]| [4.0 + u * half.x, 6.0 + v * half.z]);
    assert_eq!(corners.len(), 4);
    for (found, expected) in corners.iter().zip(expected) {
        assert!((0..2).all(|a| (found[a] - expected[a]).abs() < 1e-12), "{corners:?}");
    }
    let area = 4.0 * half.x * half.z;
    for (at, expected) in [(0, 4.0), (1, 6.0), (2, 0.0), (3, 3.0), (4, area)] {
        assert!((row[at].as_f64().unwrap() - expected).abs() < 1e-12, "{row}");
    }
    assert_eq!((report.circle_count, report.ellipse_count, report.polygon_count), (0, None, Some(1)));
    assert!((report.aggregate_area_mm2 - area).abs() < 1e-12);
}

/// Corners lie on the body, and edges keep within the tolerance of its boundary.
#[test]
fn polygons_of_rounded_grains_are_inscribed_within_the_tolerance() {
    for specimen in specimens() {
        let grains = grains(&specimen, 0.08);
        let templates = Convex::all(&grains.templates);
        let model = Model::new(&specimen, &grains);
        for (axis, at_mm) in [(Axis::X, 6.2), (Axis::Y, 8.1), (Axis::Z, 9.9)] {
            let cut = Cut::new(&model, axis, at_mm).unwrap();
            assert!(cut.sections.len() > 2);
            let [u, v] = axis.plane().map(Axis::index);
            for section in &cut.sections {
                let (row, Figure::Polygon(polygon)) = (section.grain, &section.figure) else { panic!() };
                let template = &templates[grains.shapes[row].template().unwrap() as usize];
                // The grain or that image of it which the section is of.
                let bounds = specimen.bounds_mm();
                let distance = |p: [f64; 2]| {
                    let at = |x: f64, y: f64, z: f64| {
                        let mut place = Place::new(grains.shapes[row].d_mm(), &grains.poses[row]);
                        place.center += Vector3::new(x * bounds[0], y * bounds[1], z * bounds[2]);
                        let mut q = Vector3::zeros();
                        (q[u], q[v], q[axis.index()]) = (p[0], p[1], at_mm);
                        template.distance(&place.local(&q))
                    };
                    let shift = |i: i32| f64::from(i.rem_euclid(3) - 1);
                    (0..27).map(|i| at(shift(i), shift(i / 3), shift(i / 9))).fold(f64::INFINITY, f64::min)
                };
                let corners: Vec<[f64; 2]> =
                    polygon.corners_mm.iter().map(|p| [0, 1].map(|a| p[a] + section.center_mm[a])).collect();
                for (i, p) in corners.iter().enumerate() {
                    let q = corners[(i + 1) % corners.len()];
                    assert!(distance(*p).abs() < 1e-9, "{}", distance(*p));
                    let middle = [0, 1].map(|a| (p[a] + q[a]) / 2.0);
                    assert!((-TOLERANCE..1e-9).contains(&distance(middle)), "{}", distance(middle));
                }
            }
        }
    }
}

/// Cavalieri's principle gives the volume, of rounded grains nearly.
#[test]
fn cuts_of_polyhedra_add_up_to_the_volume() {
    for specimen in specimens() {
        for (rounding, cuts, least) in [(0.0, 400, -2e-4), (0.08, 150, -8e-4)] {
            let grains = grains(&specimen, rounding);
            let model = Model::new(&specimen, &grains);
            let volume: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
            for axis in [Axis::X, Axis::Z] {
                let step = specimen.bounds_mm()[axis.index()] / f64::from(cuts);
                let area = |i: i32| {
                    Cut::new(&model, axis, (f64::from(i) + 0.5) * step).unwrap().aggregate_area_mm2()
                };
                let sum: f64 = (0..cuts).map(|i| area(i) * step).sum();
                let error = sum / volume - 1.0;
                println!("{specimen:?} {rounding} {error:e}");
                assert!((least..2e-4).contains(&error), "{specimen:?} {axis:?}: {error}");
            }
        }
    }
}

/// The same of ellipsoids and polyhedra; in JSON each kind has its own table.
#[test]
fn cuts_of_ellipsoids_and_polyhedra_add_up_to_the_volume() {
    for specimen in specimens() {
        let grains = crate::export::polyhedra_samples::mixed(&specimen, 30, [5.0, 2.0], 0.1, 0.0);
        let model = Model::new(&specimen, &grains);
        let volume: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        let step = specimen.bounds_mm()[2] / 400.0;
        let area =
            |i: i32| Cut::new(&model, Axis::Z, (f64::from(i) + 0.5) * step).unwrap().aggregate_area_mm2();
        let error = (0..400).map(|i| area(i) * step).sum::<f64>() / volume - 1.0;
        assert!(error.abs() < 5e-4, "{specimen:?}: {error}");
        let (report, bytes) = written(&specimen, &grains, &json!({"format": "json"}));
        let value: Value = serde_json::from_slice(&bytes).unwrap();
        let tables = [("ellipses", report.ellipse_count, 7), ("polygons", report.polygon_count, 4)];
        for (table, count, area) in tables {
            let rows = value[table]["rows"].as_array().unwrap();
            assert_eq!(Some(rows.len() as u64), count);
            assert!(rows.iter().all(|row| row[area].as_f64() > Some(0.0)), "{rows:?}");
        }
        assert_eq!((report.circle_count, value.get("circles")), (0, None));
        for format in ["svg", "geo"] {
            assert!(!written(&specimen, &grains, &json!({"format": format})).1.is_empty());
        }
    }
}

#[test]
fn the_grey_of_a_picture_of_polygons_is_their_area_fraction() {
    for specimen in specimens() {
        for rounding in [0.0, 0.08] {
            let grains = grains(&specimen, rounding);
            let center = grains.poses[0].center_mm;
            for (axis, at_mm) in [("x", center.x), ("z", center.z)] {
                let options = json!({"format": "png", "axis": axis, "at_mm": at_mm, "pixels": 200});
                let (report, bytes) = written(&specimen, &grains, &options);
                let (frame, _, pixels) = decoded(&bytes);
                let (mut aggregate, mut inside) = (0.0, 0.0);
                for pixel in pixels.chunks(frame.color_type.samples()) {
                    let opacity = pixel.get(1).map_or(1.0, |opacity| f64::from(*opacity) / 255.0);
                    inside += opacity;
                    aggregate += f64::from(255 - pixel[0]) / 127.0 * opacity;
                }
                let mean = aggregate / inside;
                assert!((mean - report.area_fraction).abs() < 2e-4, "{mean} {}", report.area_fraction);
                assert!(report.area_fraction > 0.0);
            }
        }
    }
}

#[test]
fn drawings_scripts_and_estimates_have_every_polygon() {
    let specimen = &specimens()[0];
    for rounding in [0.0, 0.08] {
        let grains = grains(specimen, rounding);
        let text = |format: &str| {
            let (report, bytes) = written(specimen, &grains, &json!({"format": format, "axis": "y"}));
            (report.polygon_count.unwrap() as usize, String::from_utf8(bytes).unwrap())
        };
        let (count, svg) = text("svg");
        assert!(count > 2 && svg.contains(&format!("<desc>{count} polygons")));
        assert_eq!((svg.matches("<polygon ").count(), svg.matches("<circle ").count()), (count, 0));
        let (count, script) = text("geo");
        assert_eq!(script.matches("p = newp; c = newc;").count(), count);
        for group in ["matrix", "aggregates", "itz", "x_min", "x_max", "z_min", "z_max"] {
            assert_eq!(script.matches(&format!("\"{group}\"")).count(), 1, "{group}");
        }
        let sum_mm: f64 = grains.shapes.iter().map(Solid::d_mm).sum();
        for format in ["svg", "json", "geo"] {
            let (mut bytes, mut expected) = (0, 0);
            for at_mm in [4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0] {
                let options = json!({"format": format, "at_mm": at_mm});
                bytes += written(specimen, &grains, &options).1.len();
                expected +=
                    expected_bytes(specimen, &read(&options).unwrap(), sum_mm, GrainKind::Polyhedra) as usize;
            }
            println!("{rounding} {format} {expected} {bytes}");
            // Rounded sections have many more corners, and which grains are rounded is not known before.
            assert!(
                (0.2..6.0).contains(&(expected as f64 / bytes as f64)),
                "{format}: {expected} of {bytes}"
            );
        }
    }
}

properties! {
    #[test]
    fn clipped_polygons_add_up_to_whole_ones(
        center in prop::array::uniform3(0.0..10.0_f64), at_mm in 0.0..10.0_f64, rounded in any::<bool>(),
    ) {
        let area = |center: [f64; 3], at_mm| {
            let grains = one(center, 4.0, if rounded { 0.1 } else { 0.0 });
            Cut::new(&Model::new(&cube(Boundary::Periodic), &grains), Axis::Z, at_mm).unwrap().aggregate_area_mm2()
        };
        let clipped = area(center, at_mm);
        // The same grain in the middle, cut at the same height above it.
        let height = at_mm - center[2];
        let whole = area([5.0; 3], (5.0 + height).rem_euclid(10.0));
        prop_assert!((clipped - whole).abs() < 1e-9, "{clipped} {whole}");
    }
}
