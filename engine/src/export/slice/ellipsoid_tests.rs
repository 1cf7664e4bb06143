//! Slices through ellipsoids.

#![allow(clippy::unwrap_used)]

use std::num::NonZeroUsize;

use crate::properties::properties;
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::tests::{cube, decoded, read};
use super::*;
use crate::Unattended;
use crate::distance::DistanceRule;
use crate::methods::rsa_shapes::{AttemptsIn, ShapeRsa};
use crate::mix::uniform_orientation;
use crate::packing::Solids;
use crate::request::{Boundary, Distance};
use crate::shape::{Ellipsoid, Pose, Solid};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

fn one(center: [f64; 3], axes: [f64; 3], angles: [f64; 3]) -> Solids {
    let orientation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
    Solids::of_ellipsoids(
        vec![Ellipsoid::new(axes).unwrap()],
        vec![Pose { center_mm: center.into(), orientation }],
    )
}

fn packed(specimen: &Specimen) -> Solids {
    let shapes: Vec<Ellipsoid> = (0..70)
        .map(|i| {
            let d = 5.5 * 0.35_f64.powf(f64::from(i) / 69.0);
            Ellipsoid::new([0.75 * d, 0.5 * d, d / 3.0]).unwrap()
        })
        .collect();
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::Constant { gap_mm: 0.2, wall_gap_mm: None }, specimen),
        attempts_per_grain: Some(100_000),
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(3), &Unattended);
    assert_eq!(outcome.placed.len(), shapes.len());
    Solids::of_ellipsoids(shapes, outcome.placed)
}

fn specimens() -> [Specimen; 3] {
    [
        Specimen::Box { size_mm: [25.0, 22.0, 20.0], boundary: Boundary::Walls },
        Specimen::Box { size_mm: [20.0, 22.0, 20.0], boundary: Boundary::Periodic },
        Specimen::Cylinder { diameter_mm: 24.0, height_mm: 25.0 },
    ]
}

fn written(specimen: &Specimen, grains: &Solids, options: &Value) -> (SliceReport, Vec<u8>) {
    let mut bytes = Vec::new();
    let model = Model::new(specimen, grains);
    let options = read(options).unwrap();
    let report = options.write(&model, &Limits::default(), &Unattended, &mut bytes).unwrap();
    (report, bytes)
}

#[test]
fn rows_of_ellipses_are_those_of_the_plane() {
    // Turned about z by 30 degrees and cut through its centre across z; the semi-axes there are 3 and 2.
    let grains = one([4.0, 5.0, 6.0], [3.0, 2.0, 1.0], [0.0, 0.0, 30.0_f64.to_radians()]);
    let (report, bytes) =
        written(&cube(Boundary::Walls), &grains, &json!({"axis": "z", "at_mm": 6.5, "format": "json"}));
    let value: Value = serde_json::from_slice(&bytes).unwrap();
    assert_eq!(
        value["ellipses"]["columns"],
        json!(["u_mm", "v_mm", "a_mm", "b_mm", "angle_deg", "grain", "diameter_mm", "area_mm2"])
    );
    assert!(value.get("circles").is_none());
    let row: Vec<f64> = serde_json::from_value(value["ellipses"]["rows"][0].clone()).unwrap();
    let scale = 0.75_f64.sqrt();
    let expected = [
        4.0,
        5.0,
        3.0 * scale,
        2.0 * scale,
        30.0,
        0.0,
        2.0 * libm::cbrt(6.0_f64),
        std::f64::consts::PI * 6.0 * 0.75,
    ];
    for (found, expected) in row.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{row:?}");
    }
    assert_eq!((report.circle_count, report.ellipse_count), (0, Some(1)));
    assert_eq!((&value["circle_count"], &value["ellipse_count"]), (&json!(0), &json!(1)));
    assert!((report.aggregate_area_mm2 - row[7]).abs() < 1e-15);
    // Tilted, so that the section is not above the centre.
    let tilted = one([4.0, 5.0, 6.0], [2.0, 1.0, 1.0], [0.0, -45.0_f64.to_radians(), 0.0]);
    let (_, bytes) =
        written(&cube(Boundary::Walls), &tilted, &json!({"axis": "z", "at_mm": 6.5, "format": "json"}));
    let value: Value = serde_json::from_slice(&bytes).unwrap();
    // A_zz = 2.5, A_xz = 1.5 of the semi-axes 2 and 1 at 45 degrees.
    assert!((value["ellipses"]["rows"][0][0].as_f64().unwrap() - (4.0 + 1.5 / 2.5 * 0.5)).abs() < 1e-12);
}

/// Spheres among ellipsoids are cut as spheres are.
#[test]
fn ellipsoids_with_equal_axes_are_cut_in_circles() {
    let grains = one([3.0, 4.0, 6.0], [2.0; 3], [0.3, 0.4, 0.5]);
    let (specimen, mut spheres) = (cube(Boundary::Walls), crate::packing::Spheres::default());
    spheres.push([3.0, 4.0, 6.0], 4.0);
    for axis in Axis::ALL {
        let [of_ellipsoid, of_sphere] = [Model::new(&specimen, &grains), Model::new(&specimen, &spheres)]
            .map(|model| Cut::new(&model, axis, 3.5).unwrap());
        assert_eq!(of_ellipsoid.sections.len(), of_sphere.sections.len());
        for (one, other) in of_ellipsoid.sections.iter().zip(&of_sphere.sections) {
            assert!((one.area_mm2 - other.area_mm2).abs() < 1e-12);
            let [[_, a], [_, b]] = one.figure.extents_mm();
            assert!(
                (a - other.figure.outer_mm()).abs() < 1e-12 && (b - other.figure.outer_mm()).abs() < 1e-12
            );
        }
    }
}

/// Mean of the area fractions of many cuts: Cavalieri's principle gives the volume fraction.
#[test]
fn cuts_of_ellipsoids_add_up_to_the_volume() {
    for specimen in specimens() {
        let grains = packed(&specimen);
        let model = Model::new(&specimen, &grains);
        let volume: f64 = grains.iter().map(|(shape, _)| shape.volume_mm3()).sum();
        for axis in Axis::ALL {
            const CUTS: usize = 400;
            let step = specimen.bounds_mm()[axis.index()] / CUTS as f64;
            let area =
                |i: usize| Cut::new(&model, axis, (i as f64 + 0.5) * step).unwrap().aggregate_area_mm2();
            let sum: f64 = (0..CUTS).map(|i| area(i) * step).sum();
            assert!((sum / volume - 1.0).abs() < 2e-4, "{specimen:?} {axis:?}: {sum} {volume}");
        }
    }
}

/// A needle that is longer than an edge of its periodic box, turned so that it stays clear of its own images.
#[test]
fn cuts_of_a_grain_longer_than_an_edge_add_up_to_its_volume() {
    let specimen = Specimen::Box { size_mm: [3.0, 30.0, 30.0], boundary: Boundary::Periodic };
    let grains = one([1.0, 15.0, 15.0], [11.0, 1.0, 1.0], [0.0, 0.0, std::f64::consts::FRAC_PI_3]);
    let model = Model::new(&specimen, &grains);
    let volume = 4.0 / 3.0 * std::f64::consts::PI * 11.0;
    for axis in Axis::ALL {
        const CUTS: usize = 1000;
        let step = specimen.bounds_mm()[axis.index()] / CUTS as f64;
        let area = |i: usize| Cut::new(&model, axis, (i as f64 + 0.5) * step).unwrap().aggregate_area_mm2();
        let sum: f64 = (0..CUTS).map(|i| area(i) * step).sum();
        assert!((sum / volume - 1.0).abs() < 2e-4, "{axis:?}: {sum} {volume}");
    }
}

#[test]
fn the_grey_of_a_picture_of_ellipses_is_their_area_fraction() {
    for specimen in specimens() {
        let grains = packed(&specimen);
        // Through the largest grain, near a wall, and through the largest grain again.
        let center = grains.poses[0].center_mm;
        for (axis, at_mm) in [("x", center.x), ("y", 0.4), ("z", center.z)] {
            let options = json!({"format": "png", "axis": axis, "at_mm": at_mm, "pixels": 256});
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
            assert!(report.area_fraction > 0.0 || axis == "y");
        }
    }
}

#[test]
fn drawings_and_scripts_have_every_ellipse() {
    let specimen = &specimens()[0];
    let grains = packed(specimen);
    let text = |format: &str| {
        let (report, bytes) = written(specimen, &grains, &json!({"format": format, "axis": "y"}));
        (report.ellipse_count.unwrap() as usize, String::from_utf8(bytes).unwrap())
    };
    let (count, svg) = text("svg");
    assert!(count > 5 && svg.contains(&format!("<desc>{count} ellipses")));
    assert_eq!((svg.matches("<ellipse ").count(), svg.matches("<circle ").count()), (count, 0));
    let (count, script) = text("geo");
    assert_eq!(script.matches("Call Polygon;\n").count(), count);
    for group in ["matrix", "aggregates", "itz", "x_min", "x_max", "z_min", "z_max"] {
        assert_eq!(script.matches(&format!("\"{group}\"")).count(), 1, "{group}");
    }
}

#[test]
fn files_of_ellipses_are_about_as_long_as_estimated() {
    let specimen = &specimens()[0];
    let grains = packed(specimen);
    let sum_mm: f64 = grains.shapes.iter().map(Solid::d_mm).sum();
    for format in ["svg", "json", "geo"] {
        let (mut bytes, mut expected) = (0, 0);
        for at_mm in [5.0, 7.0, 9.0, 11.0, 13.0, 15.0] {
            let options = json!({"format": format, "at_mm": at_mm});
            bytes += written(specimen, &grains, &options).1.len();
            expected +=
                expected_bytes(specimen, &read(&options).unwrap(), sum_mm, GrainKind::Ellipsoids) as usize;
        }
        assert!(
            (1.0 / 1.5..1.5).contains(&(expected as f64 / bytes as f64)),
            "{format}: {expected} of {bytes}"
        );
    }
}

properties! {
    #[test]
    fn clipped_ellipses_add_up_to_whole_ones(
        center in prop::array::uniform3(0.0..10.0_f64), axes in prop::array::uniform3(0.2..4.0_f64),
        angles in prop::array::uniform3(-3.0..3.0_f64), at_mm in 0.0..10.0_f64,
    ) {
        let grains = one(center, axes, angles);
        let specimen = cube(Boundary::Periodic);
        let cut = Cut::new(&Model::new(&specimen, &grains), Axis::Z, at_mm).unwrap();
        let shape = grains.shapes[0].ellipsoid().unwrap().matrix_mm2(&grains.poses[0]);
        let block = shape.fixed_view::<2, 2>(0, 0).into_owned()
            - shape.fixed_view::<2, 1>(0, 2) * shape.fixed_view::<1, 2>(2, 0) / shape.m33;
        let height = (center[2] - at_mm).abs();
        let height = height.min(10.0 - height);
        let scale = (1.0 - height * height / shape.m33).max(0.0);
        let whole = std::f64::consts::PI * scale * block.determinant().max(0.0).sqrt();
        prop_assert!((cut.aggregate_area_mm2() - whole).abs() < 1e-9, "{} {whole}", cut.aggregate_area_mm2());
        for section in &cut.sections {
            prop_assert!(section.area_mm2 > 0.0);
            // Its area is not that of rounding: a point of it lies inside.
            let inside = section.center_mm.map(|x| x.clamp(0.0, 10.0));
            let away = Vector3::new(inside[0] - section.center_mm[0], inside[1] - section.center_mm[1], 0.0);
            prop_assert!(away.norm() < section.figure.outer_mm());
        }
    }
}
