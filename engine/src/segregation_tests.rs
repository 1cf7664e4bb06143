#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::json;

use super::*;
use crate::request::{Boundary, Specimen};
use crate::rng::{Stream, stream, uniform};

const CUBOID: Specimen = Specimen::Box { size_mm: [20.0, 30.0, 40.0], boundary: Boundary::Walls };
const CYLINDER: Specimen = Specimen::Cylinder { diameter_mm: 30.0, height_mm: 50.0 };

fn fields(specimen: &Specimen) -> Vec<GradientField> {
    let mut fields = Vec::new();
    for axis in Axis::ALL {
        for direction in [FieldDirection::Up, FieldDirection::Down] {
            fields.push(GradientField::Linear { axis, direction });
        }
    }
    if matches!(specimen, Specimen::Cylinder { .. }) {
        fields.push(GradientField::Face { face: SpecimenFace::Side });
    }
    fields
}

/// Points that are uniform in the region are uniform on every field.
#[test]
fn a_share_of_the_field_is_a_share_of_the_volume() {
    for specimen in [CUBOID, CYLINDER] {
        let region = specimen.center_region(3.0).unwrap();
        for field in fields(&specimen) {
            let mut rng = stream(1, Stream::Rsa);
            let mut shares = Vec::new();
            while shares.len() < 4000 {
                let p = std::array::from_fn(|a| {
                    region.low[a] + uniform(&mut rng) * (region.high[a] - region.low[a])
                });
                if region.contains(p) {
                    shares.push(share_of_field(field, &region, p));
                }
            }
            shares.sort_by(f64::total_cmp);
            let n = shares.len() as f64;
            let gap =
                shares.iter().enumerate().map(|(i, s)| (s - (i as f64 + 0.5) / n).abs()).fold(0.0, f64::max);
            // Kolmogorov: 1.95 has probability 1e-3.
            assert!(gap * n.sqrt() < 1.95, "{specimen:?}, {field:?}: {gap}");
        }
    }
}

#[test]
fn fields_rise_to_where_they_say() {
    let at = |field: &str, specimen: &Specimen, p| {
        let value = match field {
            "up" | "down" => json!({"type": "linear", "axis": "x", "direction": field}),
            face => json!({"type": "face", "face": face}),
        };
        let of_specimen = serde_json::to_value(specimen).unwrap();
        let request = json!({
            "specimen": of_specimen, "mix": {"grading": {"type": "diameters", "diameters_mm": [6]}},
            "segregation": {"type": "gradient", "field": value, "strength": 1},
        });
        let request = PackingRequest::from_json(&request, 1).unwrap();
        let Segregation::Gradient { field, .. } = request.segregation else { panic!("no gradient") };
        share_of_field(field, &specimen.center_region(3.0).unwrap(), p)
    };
    // A centre 3.7, 9 and 20.4 mm from the lower faces, of a grain of 3 mm radius.
    let p = [3.7, 9.0, 20.4];
    for (field, share) in [
        ("up", 0.05),
        ("down", 0.95),
        ("x_min", 0.95),
        ("x_max", 0.05),
        ("y_min", 0.75),
        ("y_max", 0.25),
        ("z_min", 1.0 - 17.4 / 34.0),
        ("z_max", 17.4 / 34.0),
    ] {
        assert!((at(field, &CUBOID, p) - share).abs() < 1e-12, "{field}");
    }
    // On a circle of half the radius of the region of 12 mm.
    assert!((at("side", &CYLINDER, [15.0, 21.0, 9.0]) - 0.25).abs() < 1e-12);
    assert!((at("z_min", &CYLINDER, [15.0, 21.0, 3.0]) - 1.0).abs() < 1e-12);
}

fn preference(strength: f64, diameters: &[f64]) -> Option<Preference> {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [20, 30, 40]},
        "mix": {"grading": {"type": "diameters", "diameters_mm": diameters}},
        "segregation": {
            "type": "gradient", "strength": strength,
            "field": {"type": "linear", "axis": "z", "direction": "up"},
        },
    });
    Preference::new(&PackingRequest::from_json(&request, 1).unwrap(), diameters)
}

#[test]
fn no_strength_is_no_preference() {
    assert!(preference(0.0, &[6.0, 4.0]).is_none());
    assert!(preference(1.0e-9, &[6.0, 4.0]).is_some());
}

#[test]
fn quantiles_are_the_share_of_finer_mass_and_of_half_the_grain_itself() {
    let quantiles = |diameters: &[f64]| -> Vec<f64> {
        preference(1.0, diameters).unwrap().grains.iter().map(|grain| grain.quantile).collect()
    };
    let found = quantiles(&[4.0, 2.0, 2.0]);
    for (found, known) in found.iter().zip([1.0 - 4.0 / 10.0, 1.5 / 10.0, 0.5 / 10.0]) {
        assert!((found - known).abs() < 1e-12, "{found} {known}");
    }
    let all: f64 = quantiles(&[3.0; 100]).iter().sum();
    assert!((all - 50.0).abs() < 1e-9, "equal grains are asked for everywhere alike: {all}");
}

properties! {
    /// Else the gradient would drift with no end.
    #[test]
    fn an_exchange_and_its_reverse_cancel(
        strength in 0.01..1000.0_f64, a in prop::array::uniform3(0.0..40.0_f64), b in prop::array::uniform3(0.0..40.0_f64)
    ) {
        let preference = preference(strength, &[6.0, 5.0, 2.0]).unwrap();
        let there = preference.log_acceptance_ratio([0, 2], [a, b]);
        let back = preference.log_acceptance_ratio([0, 2], [b, a]);
        prop_assert!((there + back).abs() < 1e-9 * strength.max(1.0), "{} {}", there, back);
    }
}

#[test]
fn an_exchange_gains_where_mass_comes_nearer_to_its_place() {
    let preference = preference(10.0, &[6.0, 5.999, 2.0]).unwrap();
    // Of quantiles 0.75, 0.26 and 0.009.
    let at = |z: f64| [10.0, 15.0, z];
    assert!(preference.log_acceptance_ratio([0, 1], [at(10.0), at(30.0)]) > 2.0);
    assert!(preference.log_acceptance_ratio([0, 1], [at(30.0), at(10.0)]) < -2.0);
    // The large one comes to where it wants to be, whatever the small one loses.
    assert!(preference.log_acceptance_ratio([1, 2], [at(20.0), at(14.0)]) > 0.0);
    assert!(preference.log_acceptance_ratio([0, 1], [at(20.0), at(20.0)]).abs() < 1e-12);
}
