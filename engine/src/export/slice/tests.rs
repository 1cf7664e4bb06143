#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use ::png::ColorType;

use super::*;
use crate::packing::Spheres;
use crate::request::Boundary;
use crate::request::decode::{At, Faults};
use crate::{PackingRequest, Unattended, pack};

pub(super) fn read(value: &Value) -> Result<SliceOptions, Vec<String>> {
    let faults = Faults::default();
    let mut object = At::root(value, &faults).object().unwrap();
    let options = SliceOptions::read(&mut object);
    object.finish();
    let faults: Vec<String> = faults.into_vec().iter().map(ToString::to_string).collect();
    if faults.is_empty() { Ok(options.unwrap()) } else { Err(faults) }
}

fn written(specimen: &Specimen, spheres: &Spheres, options: &Value) -> (SliceReport, Vec<u8>) {
    let mut bytes = Vec::new();
    let model = Model::new(specimen, spheres);
    let options = read(options).unwrap();
    let report = options.write(&model, &Limits::default(), &Unattended, &mut bytes).unwrap();
    (report, bytes)
}

pub(super) fn cube(boundary: Boundary) -> Specimen {
    Specimen::Box { size_mm: [10.0; 3], boundary }
}

pub(super) fn spheres(rows: &[([f64; 3], f64)]) -> Spheres {
    let mut spheres = Spheres::default();
    for (center, d) in rows {
        spheres.push(*center, *d);
    }
    spheres
}

fn packed(specimen: &Value, volume_fraction: f64) -> (Specimen, Spheres) {
    let request = json!({
        "specimen": specimen,
        "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "volume_fraction": volume_fraction},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    (request.specimen, pack(&request, &Limits::default(), &Unattended).unwrap().into_spheres().unwrap())
}

#[test]
fn options_have_defaults_and_bounds() {
    let options = read(&json!({})).unwrap();
    let cut = CutOptions { format: SliceFormat::Svg, axis: Axis::Z, at_mm: None, pixels: None };
    assert_eq!(options, SliceOptions { cut, triangles: None });
    assert_eq!(read(&json!({"format": "png"})).unwrap().cut.pixels, Some(1000));
    let faults = read(&json!({"format": "gif", "axis": "w", "at_mm": -1, "pixels": 9000, "zoom": 1}));
    assert_eq!(
        faults.unwrap_err(),
        [
            "/format: \"gif\" is unknown: must be one of \"svg\", \"png\", \"json\", \"geo\", \"msh\", \"inp\", \"vtu\"",
            "/axis: \"w\" is unknown: must be one of \"x\", \"y\", \"z\"",
            "/at_mm: -1 is out of range: must be at least 0 and at most 1000000 mm",
            "/pixels: 9000 is out of range: must be a whole number from 16 to 8192",
            "/zoom: unknown field: this object has format, axis, at_mm, pixels",
        ]
    );
    assert_eq!(
        read(&json!({"pixels": 100, "format": "geo"})).unwrap_err(),
        ["/pixels: pixels are for the format \"png\": leave them out"]
    );
}

#[test]
fn a_cut_outside_of_the_specimen_is_refused() {
    let refused = |specimen: &Specimen, options: Value| {
        read(&options).unwrap().check(specimen, &Limits::default()).unwrap_err().to_string()
    };
    let cylinder = Specimen::Cylinder { diameter_mm: 10.0, height_mm: 20.0 };
    assert_eq!(
        refused(&cube(Boundary::Walls), json!({"at_mm": 10.5})),
        "/at_mm: 10.5 is out of range: a cut along z must be at least 0 and at most 10 mm, inside the specimen"
    );
    // A plane that touches the lateral surface has no area.
    assert_eq!(
        refused(&cylinder, json!({"axis": "x", "at_mm": 0})),
        "/at_mm: 0 is out of range: a cut along x must be greater than 0 and less than 10 mm, inside the specimen"
    );
    for options in [json!({"at_mm": 20}), json!({"axis": "y", "at_mm": 9.999}), json!({})] {
        read(&options).unwrap().check(&cylinder, &Limits::default()).unwrap();
    }
}

#[test]
fn axes_radii_and_areas_are_those_of_the_plane() {
    let one = spheres(&[([3.0, 4.0, 6.0], 4.0)]);
    for (axis, at_mm, center) in [("x", 2.0, [4.0, 6.0]), ("y", 3.0, [3.0, 6.0]), ("z", 7.0, [3.0, 4.0])] {
        let (report, bytes) =
            written(&cube(Boundary::Walls), &one, &json!({"axis": axis, "at_mm": at_mm, "format": "json"}));
        let value: Value = serde_json::from_slice(&bytes).unwrap();
        let row = &value["circles"]["rows"][0];
        assert_eq!(row[0], center[0]);
        assert_eq!(row[1], center[1]);
        assert_eq!(row[2], 3.0_f64.sqrt());
        assert_eq!((&row[3], &row[4]), (&json!(0), &json!(4.0)));
        assert!((report.area_fraction - 3.0 * PI / 100.0).abs() < 1e-15);
        // The file says what the report says.
        assert_eq!(value["area_fraction"], report.area_fraction);
        assert_eq!(value["axis"], axis);
    }
    // A plane that touches cuts nothing.
    let (report, _) = written(&cube(Boundary::Walls), &one, &json!({"axis": "x", "at_mm": 5}));
    assert_eq!((report.circle_count, report.area_fraction), (0, 0.0));
}

#[test]
fn images_of_a_corner_grain_make_one_whole_circle() {
    let one = spheres(&[([0.5, 9.5, 9.8], 3.0)]);
    for (at_mm, height) in [(0.3_f64, 0.5_f64), (9.0, 0.8), (0.0, 0.2), (10.0, 0.2)] {
        let (report, _) = written(&cube(Boundary::Periodic), &one, &json!({"at_mm": at_mm}));
        assert_eq!(report.circle_count, 4);
        let whole = PI * (1.5 * 1.5 - height * height);
        assert!((report.aggregate_area_mm2 - whole).abs() < 1e-12, "{at_mm}");
    }
}

/// Images of grains that do not reach the rectangle are no circles of the slice (30 slices of a periodic box had 13 of
/// an area of 1e-15).
#[test]
fn no_circle_of_a_periodic_slice_is_a_ghost() {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [40, 40, 40], "boundary": "periodic"},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2, "volume_fraction": 0.6},
    });
    let request = PackingRequest::from_json(&request, 1).unwrap();
    let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
    let model = Model::new(&request.specimen, packing.spheres().unwrap());
    for axis in Axis::ALL {
        for at_mm in (0..10).map(|i| 4.0 * f64::from(i)) {
            for circle in Cut::new(&model, axis, at_mm).unwrap().sections {
                let outside = circle.center_mm.map(|x| (-x).max(x - 40.0).max(0.0));
                assert!(outside[0].hypot(outside[1]) < circle.figure.outer_mm(), "{circle:?}");
                assert!(circle.area_mm2 > 1e-12, "{circle:?}");
            }
        }
    }
}

#[test]
fn cylinders_are_cut_into_discs_and_rectangles() {
    let (specimen, spheres) = packed(&json!({"type": "cylinder", "diameter_mm": 30, "height_mm": 40}), 0.4);
    let (across, _) = written(&specimen, &spheres, &json!({"at_mm": 11}));
    assert_eq!(across.outline, Outline::Disc { center_mm: [15.0; 2], radius_mm: 15.0 });
    assert!((across.area_mm2 - 225.0 * PI).abs() < 1e-9);
    let (along, _) = written(&specimen, &spheres, &json!({"axis": "x", "at_mm": 3}));
    assert_eq!(along.outline, Outline::Rectangle { u_mm: [6.0, 24.0], v_mm: [0.0, 40.0] });
    assert!((0.05..0.6).contains(&across.area_fraction) && (0.05..0.6).contains(&along.area_fraction));
}

/// Mean of the area fractions of many cuts: Cavalieri's principle gives the volume fraction.
#[test]
fn cuts_add_up_to_the_volume() {
    let specimens = [
        json!({"type": "box", "size_mm": [30, 25, 20]}),
        json!({"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"}),
        json!({"type": "cylinder", "diameter_mm": 25, "height_mm": 30}),
    ];
    for specimen in &specimens {
        let (specimen, spheres) = packed(specimen, 0.45);
        let model = Model::new(&specimen, &spheres);
        let volume: f64 = spheres.d_mm.iter().map(|d| PI / 6.0 * d * d * d).sum();
        for axis in Axis::ALL {
            const CUTS: usize = 400;
            let length = specimen.bounds_mm()[axis.index()];
            let step = length / CUTS as f64;
            let sum: f64 = (0..CUTS)
                .map(|i| Cut::new(&model, axis, (i as f64 + 0.5) * step).unwrap().aggregate_area_mm2() * step)
                .sum();
            assert!((sum / volume - 1.0).abs() < 1e-4, "{specimen:?} {axis:?}: {sum} {volume}");
        }
    }
}

/// Grey values of a picture, with opacity where it has any.
pub(super) fn decoded(bytes: &[u8]) -> (::png::OutputInfo, ::png::Info<'static>, Vec<u8>) {
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    (frame, reader.info().clone(), pixels)
}

#[test]
fn the_grey_of_a_picture_is_its_area_fraction() {
    let (specimen, spheres) = packed(&json!({"type": "box", "size_mm": [40, 30, 20]}), 0.5);
    for axis in ["x", "y", "z"] {
        let (report, bytes) =
            written(&specimen, &spheres, &json!({"format": "png", "axis": axis, "pixels": 333}));
        let (frame, info, pixels) = decoded(&bytes);
        assert_eq!(report.image.unwrap().pixels, [frame.width, frame.height]);
        assert_eq!(frame.width.max(frame.height), 333);
        let mean = pixels.iter().map(|&p| f64::from(255 - p) / 127.0).sum::<f64>() / pixels.len() as f64;
        // Greys are rounded to 1/127 on the edges of circles alone, evenly to both sides.
        assert!((mean - report.area_fraction).abs() < 2e-4, "{mean} {}", report.area_fraction);
        let per_metre = 1000.0 / report.image.unwrap().pixel_mm[0];
        assert_eq!(info.pixel_dims.unwrap().xppu, per_metre.round() as u32);
    }
}

#[test]
fn pictures_of_periodic_and_round_cuts_keep_the_area_too() {
    let (specimen, spheres) =
        packed(&json!({"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"}), 0.5);
    let (report, bytes) =
        written(&specimen, &spheres, &json!({"format": "png", "at_mm": 0.1, "pixels": 256}));
    let (_, _, pixels) = decoded(&bytes);
    let mean = pixels.iter().map(|&p| f64::from(255 - p) / 127.0).sum::<f64>() / pixels.len() as f64;
    assert!((mean - report.area_fraction).abs() < 2e-4, "{mean} {}", report.area_fraction);

    let (specimen, spheres) = packed(&json!({"type": "cylinder", "diameter_mm": 30, "height_mm": 40}), 0.5);
    let (report, bytes) = written(&specimen, &spheres, &json!({"format": "png", "pixels": 256}));
    let (frame, _, pixels) = decoded(&bytes);
    assert_eq!(frame.color_type, ColorType::GrayscaleAlpha);
    let (mut aggregate, mut inside) = (0.0, 0.0);
    for pair in pixels.chunks(2) {
        let opacity = f64::from(pair[1]) / 255.0;
        inside += opacity;
        aggregate += f64::from(255 - pair[0]) / 127.0 * opacity;
    }
    assert!((inside / (256.0 * 256.0) - PI / 4.0).abs() < 1e-4);
    assert!((aggregate / inside - report.area_fraction).abs() < 2e-4);
    assert_eq!(pixels[1], 0, "the corner is transparent");
}

#[test]
fn the_script_of_a_cut_has_all_groups() {
    let (specimen, spheres) = packed(&json!({"type": "box", "size_mm": [20, 20, 20]}), 0.4);
    let text = |options: Value| String::from_utf8(written(&specimen, &spheres, &options).1).unwrap();
    let script = text(json!({"format": "geo", "axis": "y"}));
    for group in ["matrix", "aggregates", "itz", "x_min", "x_max", "z_min", "z_max"] {
        assert_eq!(script.matches(&format!("\"{group}\"")).count(), 1, "{group}");
    }
    let (report, _) = written(&specimen, &spheres, &json!({"axis": "y"}));
    assert_eq!(script.matches("Call Enlarge;\nCircle(").count() as u64, report.circle_count);
    // Nothing is cut at the wall: no group is empty, which Gmsh would complain of.
    let empty = text(json!({"format": "geo", "at_mm": 0}));
    assert!(empty.contains("\"matrix\"") && !empty.contains("\"aggregates\""));
}

properties! {
    #[test]
    fn clipped_areas_add_up_to_whole_circles(
        center in prop::array::uniform3(0.0..10.0_f64), d in 0.1..10.0_f64, at_mm in 0.0..10.0_f64,
    ) {
        let one = spheres(&[(center, d)]);
        let specimen = cube(Boundary::Periodic);
        let cut = Cut::new(&Model::new(&specimen, &one), Axis::Z, at_mm).unwrap();
        let height = (center[2] - at_mm).abs();
        let height = height.min(10.0 - height);
        let whole = PI * (d * d / 4.0 - height * height).max(0.0);
        prop_assert!((cut.aggregate_area_mm2() - whole).abs() < 1e-11);
    }
}
