#![allow(clippy::unwrap_used, clippy::needless_pass_by_value)]

use serde_json::{Value, json};

use super::super::{GrainKind, PackingRequest};
use super::*;
use crate::request::DEFAULT_D_MIN_MM;

fn mix(mix: &Value) -> Result<Mix, Vec<String>> {
    let request = json!({"specimen": {"type": "box", "size_mm": [100, 100, 100]}, "mix": mix});
    PackingRequest::from_json(&request, 1)
        .map(|request| request.mix)
        .map_err(|faults| faults.iter().map(ToString::to_string).collect())
}

/// Sand, a rounded gravel and a crushed rock.
fn concrete() -> Value {
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.6}});
    json!({
        "d_min_mm": 4.0,
        "volume_fraction": 0.7,
        "aggregates": [
            {"name": "sand 0/4", "share": 0.4, "density_kg_m3": 2650.0,
             "grading": {"type": "sieves", "points": [[0.25, 0.0], [4.0, 1.0]]}},
            {"name": "gravel 4/8", "share": 0.25, "density_kg_m3": 2600.0,
             "grading": {"type": "sieves", "points": [[4.0, 0.0], [8.0, 1.0]]}, "shape": ellipsoid},
            {"share": 0.35, "density_kg_m3": 2800.0,
             "grading": {"type": "fuller", "d_max_mm": 16.0, "exponent": 0.5}, "d_min_mm": 8.0},
        ],
    })
}

fn with(pointer: &str, value: Value) -> Value {
    let mut changed = concrete();
    let (parent, field) = pointer.rsplit_once('/').unwrap();
    let parent = if parent.is_empty() { &mut changed } else { changed.pointer_mut(parent).unwrap() };
    match parent {
        Value::Array(items) => items[field.parse::<usize>().unwrap()] = value,
        parent => parent[field] = value,
    }
    changed
}

#[test]
fn aggregates_have_gradings_shapes_and_cut_offs_of_their_own() {
    let read = mix(&concrete()).unwrap();
    assert_eq!(
        (read.grading.is_none(), read.aggregates.len(), read.grain_kind()),
        (true, 3, GrainKind::Ellipsoids)
    );
    let parts = read.parts();
    let cut_offs: Vec<Option<f64>> = parts.iter().map(|part| part.d_min_mm).collect();
    assert_eq!(cut_offs, [Some(4.0), Some(4.0), Some(8.0)]);
    let are_spheres: Vec<bool> = parts.iter().map(|part| part.grain_shapes().is_none()).collect();
    assert_eq!(are_spheres, [true, false, true]);
    let angular = with("/aggregates/2/shape", json!({"type": "polyhedron"}));
    assert_eq!(mix(&angular).unwrap().grain_kind(), GrainKind::Mixed);
    let mean = mean_density_kg_m3(&read.aggregates).unwrap();
    assert!((mean - (0.4 * 2650.0 + 0.25 * 2600.0 + 0.35 * 2800.0)).abs() < 1e-9);

    // A mix without aggregates is one part.
    let plain =
        mix(&json!({"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.5})).unwrap();
    let [part] = plain.parts()[..] else { panic!() };
    assert_eq!((part.share, part.d_min_mm), (1.0, Some(DEFAULT_D_MIN_MM)));
}

#[test]
fn what_is_written_is_read_again() {
    let request = json!({"specimen": {"type": "box", "size_mm": [100, 100, 100]}, "mix": concrete()});
    let read = PackingRequest::from_json(&request, 1).unwrap();
    read.validate().unwrap();
    let value = serde_json::to_value(&read.mix).unwrap();
    let mut expected = concrete()["aggregates"].clone();
    let ratios = json!({"type": "constant", "elongation": 0.8, "flatness": 0.6 / 0.8});
    expected[1]["shape"]["ratios"] = ratios;
    assert_eq!(value["aggregates"], expected);
    assert!(value.get("grading").is_none());
}

#[test]
fn the_default_cut_off_of_a_curve_is_that_of_its_aggregate() {
    let mut no_cut_off = with("/aggregates/2/d_min_mm", Value::Null);
    no_cut_off.as_object_mut().unwrap().remove("d_min_mm");
    no_cut_off["aggregates"][2].as_object_mut().unwrap().remove("d_min_mm");
    let read = mix(&no_cut_off).unwrap();
    let cut_offs: Vec<Option<f64>> = read.parts().iter().map(|part| part.d_min_mm).collect();
    assert_eq!(cut_offs, [None, None, Some(DEFAULT_D_MIN_MM)]);
}

#[test]
fn mass_ratios_take_the_mean_density_of_the_aggregates() {
    let proportions = json!({"cement_kg_m3": 350.0, "water_cement": 0.5, "aggregate_cement": 5.0});
    let mut by_mass = with("/proportions", proportions);
    by_mass.as_object_mut().unwrap().remove("volume_fraction");
    let read = mix(&by_mass).unwrap();
    let mean = mean_density_kg_m3(&read.aggregates).unwrap();
    assert!((read.requested_fraction().unwrap() - 5.0 * 350.0 / mean).abs() < 1e-12);

    by_mass["proportions"]["aggregate_density_kg_m3"] = json!(2500.0);
    let faults = mix(&by_mass).unwrap_err();
    assert!(
        faults[0].starts_with("/mix/proportions/aggregate_density_kg_m3: the aggregates have a mean"),
        "{faults:?}"
    );
}

/// The same by kilograms in a cubic metre: 830 kg of sand of 2600 kg/m³ and 950 kg of gravel of 2700 kg/m³.
fn by_mass() -> Value {
    json!({
        "d_min_mm": 4.0,
        "aggregates": [
            {"name": "sand", "mass_kg_m3": 830, "density_kg_m3": 2600,
             "grading": {"type": "sieves", "points": [[0.25, 0.0], [4.0, 1.0]]}},
            {"name": "gravel", "mass_kg_m3": 950, "density_kg_m3": 2700,
             "grading": {"type": "sieves", "points": [[4.0, 0.0], [8.0, 1.0]]}},
        ],
    })
}

#[test]
fn kilograms_in_a_cubic_metre_give_shares_and_the_volume_fraction() {
    let (sand, gravel) = (830.0 / 2600.0, 950.0 / 2700.0);
    let read = mix(&by_mass()).unwrap();
    let shares: Vec<f64> = read.aggregates.iter().map(|aggregate| aggregate.share).collect();
    assert!(
        (shares[0] - sand / (sand + gravel)).abs() < 1e-15 && (shares[1] + shares[0] - 1.0).abs() < 1e-15
    );
    assert!((read.requested_fraction().unwrap() - (sand + gravel)).abs() < 1e-15);
    // What is stored is read again.
    let value = serde_json::to_value(&read).unwrap();
    assert_eq!(mix(&value).unwrap(), read);

    // Beside the paste the air is what all parts leave.
    let mut with_paste = by_mass();
    with_paste["proportions"] = json!({"cement_kg_m3": 330, "water_cement": 0.55});
    let read = mix(&with_paste).unwrap();
    assert!((read.requested_fraction().unwrap() - (sand + gravel)).abs() < 1e-12);
    assert_eq!((read.proportions.as_ref().unwrap().air, read.volume_fraction), (None, None));
    assert_eq!(mix(&serde_json::to_value(&read).unwrap()).unwrap(), read);
}

#[test]
fn masses_that_fit_no_cubic_metre_or_nothing_else_are_refused() {
    let changed = |pointer: &str, value: Value| {
        let mut changed = by_mass();
        match pointer.rsplit_once('/').unwrap() {
            ("", field) => changed[field] = value,
            (parent, field) => changed.pointer_mut(parent).unwrap()[field] = value,
        }
        mix(&changed).unwrap_err()
    };
    for (pointer, value, expected) in [
        ("/volume_fraction", json!(0.6), "/mix/volume_fraction: follows from the mass_kg_m3"),
        ("/aggregates/0/share", json!(0.4), "/mix/aggregates/0/share: follows from mass_kg_m3"),
        ("/aggregates/0/mass_kg_m3", Value::Null, "/mix/aggregates/0/share: is missing"),
        ("/aggregates/1/density_kg_m3", Value::Null, "/mix/aggregates/1/density_kg_m3: is null"),
        (
            "/aggregates/0/mass_kg_m3",
            json!(2600),
            "/mix/aggregates: the masses of a cubic metre fill 1.3519 m3",
        ),
        (
            "/proportions",
            json!({"cement_kg_m3": 330, "water_cement": 0.5, "air": 0.02}),
            "/mix/proportions/air: with aggregate_cement, or the mass_kg_m3",
        ),
        (
            "/proportions",
            json!({"cement_kg_m3": 330, "water_cement": 0.5, "aggregate_cement": 5}),
            "/mix/proportions/aggregate_cement: follows from the mass_kg_m3",
        ),
        (
            "/proportions",
            json!({"cement_kg_m3": 1, "water_cement": 0.5}),
            "/mix/proportions: 1780 kg of aggregate and 1 kg of cement",
        ),
    ] {
        let faults = changed(pointer, value);
        assert!(faults[0].starts_with(expected), "{faults:?} instead of {expected}");
    }
}

#[test]
fn every_fault_names_field_value_and_bound() {
    let list = json!({"type": "diameters", "diameters_mm": [8.0]});
    for (changed, expected) in [
        (with("/aggregates", json!([])), "/mix/aggregates: has 0 aggregates: must have at least 1"),
        (
            with("/grading", json!({"type": "standard", "name": "A16"})),
            "/mix/grading: the mix has aggregates, each with its own: leave this field out",
        ),
        (
            with("/shape", json!({"type": "sphere"})),
            "/mix/shape: the mix has aggregates, each with its own: leave this field out",
        ),
        (with("/aggregates/0/share", json!(0.5)), "/mix/aggregates: the shares sum to 1.1: must sum to 1"),
        (
            with("/aggregates/0/share", json!(0.0)),
            "/mix/aggregates/0/share: 0 is out of range: must be greater than 0 and at most 1",
        ),
        (
            with("/aggregates/1/name", json!("sand 0/4")),
            "/mix/aggregates/1/name: is the name of another aggregate: must differ",
        ),
        (
            with("/aggregates/1/name", json!("")),
            "/mix/aggregates/1/name: has 0 characters: must have 1 to 64",
        ),
        (
            with("/aggregates/1/name", json!("a\tb")),
            "/mix/aggregates/1/name: has a control character: must be printable",
        ),
        (
            with("/aggregates/1/density_kg_m3", json!(2.6)),
            "/mix/aggregates/1/density_kg_m3: 2.6 is out of range: must be at least 100 and at most 30000 kg/m3",
        ),
        (
            with("/aggregates/1/grading", list),
            "/mix/aggregates/1/grading: an explicit list of diameters prescribes the volume of the whole mix",
        ),
        (
            with("/aggregates/1/d_min_mm", json!(9.0)),
            "/mix/aggregates/1/d_min_mm: 9 is out of range: must be less than the largest diameter 8 mm",
        ),
        (with("/aggregates/1/colour", json!("red")), "/mix/aggregates/1/colour: unknown field"),
        (with("/orientation", json!("flat")), "/mix/orientation: \"flat\" is not an object"),
    ] {
        let faults = mix(&changed).unwrap_err();
        assert!(faults.iter().any(|fault| fault.starts_with(expected)), "{expected}: {faults:?}");
    }
    let mut without_density = concrete();
    without_density["aggregates"][1].as_object_mut().unwrap().remove("density_kg_m3");
    let faults = mix(&without_density).unwrap_err();
    assert_eq!(
        faults,
        ["/mix/aggregates: 2 of 3 aggregates have a density_kg_m3: must be given for all or for none"]
    );
    // The third aggregate alone reaches above 8 mm.
    let mut above_all = with("/d_min_mm", json!(8.0));
    above_all["aggregates"][2].as_object_mut().unwrap().remove("d_min_mm");
    assert_eq!(mix(&above_all).unwrap().parts().len(), 3);
    above_all["d_min_mm"] = json!(16.0);
    let expected =
        "/mix/aggregates: no aggregate has grains above the d_min_mm 16 of the mix: must have one that does";
    assert_eq!(mix(&above_all).unwrap_err(), [expected]);
}
