#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::super::decode::{At, Faults};
use super::super::{FieldError, PackingRequest};
use super::*;

fn document(materials: &Value) -> Value {
    let part = |name: &str, share: f64| json!({"name": name, "share": share, "grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}});
    json!({
        "specimen": {"type": "box", "size_mm": [50, 50, 50]},
        "mix": {"aggregates": [part("gravel 8/16", 0.7), part("air", 0.3)], "volume_fraction": 0.4},
        "materials": materials,
    })
}

fn read(materials: &Value) -> Result<PackingRequest, Vec<FieldError>> {
    PackingRequest::from_json(&document(materials), 7)
}

fn faults_of(materials: &Value) -> Vec<String> {
    read(materials).unwrap_err().iter().map(ToString::to_string).collect()
}

#[test]
fn the_materials_of_a_request_have_one_form_whatever_their_order() {
    let stated = json!({
        "air": {"youngs_modulus_gpa": 0},
        "aggregate": {"poissons_ratio": 0.2, "youngs_modulus_gpa": 70, "diffusivity_m2_s": 1e-12},
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": -0.5, "density_kg_m3": 2200,
            "conductivity_w_m_k": 1.8, "expansion_1_k": -1.1e-5},
    });
    let request = read(&stated).unwrap();
    let materials = request.materials.as_ref().unwrap();
    let phases: Vec<&str> = materials.entries().map(|(phase, _)| phase).collect();
    assert_eq!(phases, ["aggregate", "air", "matrix"]);
    assert_eq!(materials.of_matrix().unwrap().expansion_1_k, Some(-1.1e-5));
    assert_eq!(
        materials.of_aggregate(Some("air")).unwrap().poissons_ratio,
        None,
        "its own entry stands alone"
    );
    assert_eq!(materials.of_aggregate(Some("gravel 8/16")).unwrap().youngs_modulus_gpa, Some(70.0));
    assert_eq!(materials.of_aggregate(None).unwrap().youngs_modulus_gpa, Some(70.0));
    assert_eq!(materials.of_aggregate(Some("matrix")).unwrap().youngs_modulus_gpa, Some(70.0));

    let value = serde_json::to_value(&request).unwrap();
    assert_eq!(PackingRequest::from_json(&value, 7).unwrap(), request);
    assert_eq!(request.validate(), Ok(()));
    let example: Value = serde_json::from_str(EXAMPLE).unwrap();
    let example = read(&example).unwrap().materials.unwrap();
    assert_eq!((example.entries().len(), example.digits().len()), (2, 8));
    assert_ne!(example.digits(), materials.digits());
}

#[test]
fn faults_of_materials_name_phase_property_and_bound() {
    assert_eq!(
        faults_of(&json!({
            "matrix": {"youngs_modulus_gpa": -1, "poissons_ratio": 0.5, "density_kg_m3": 0},
            "aggregate": {"conductivity_w_m_k": -0.1, "poissons_ratio": -1, "diffusivity_m2_s": -1e-9, "colour": 1},
        })),
        [
            "/materials/matrix/youngs_modulus_gpa: -1 is out of range: must be at least 0 and at most 1000000 GPa",
            "/materials/matrix/poissons_ratio: 0.5 is out of range: must be greater than -1 and less than 0.5",
            "/materials/matrix/density_kg_m3: 0 is out of range: must be greater than 0 and at most 1000000 kg/m3",
            "/materials/aggregate/poissons_ratio: -1 is out of range: must be greater than -1 and less than 0.5",
            "/materials/aggregate/conductivity_w_m_k: -0.1 is out of range: must be at least 0 and at most 1000000 \
             W/(m K)",
            "/materials/aggregate/diffusivity_m2_s: -1e-9 is out of range: must be at least 0 and at most 1000000 m2/s",
            "/materials/aggregate/colour: unknown field: this object has youngs_modulus_gpa, poissons_ratio, \
             density_kg_m3, conductivity_w_m_k, expansion_1_k, diffusivity_m2_s",
        ]
    );
    assert_eq!(
        faults_of(&json!({"grav/el": {"youngs_modulus_gpa": 1}})),
        [
            "/materials/grav~1el: is no phase of the mix: must be one of \"matrix\", \"aggregate\", \"gravel 8/16\", \
          \"air\""
        ]
    );
    for (value, says) in [
        (json!({}), "/materials: has no phase: must have at least \"matrix\" or \"aggregate\""),
        (json!(5), "/materials: 5 is not an object"),
        (
            json!({"matrix": {}}),
            "/materials/matrix: has no property: must have at least one of youngs_modulus_gpa",
        ),
        (
            json!({"matrix": {"youngs_modulus_gpa": "25"}}),
            "/materials/matrix/youngs_modulus_gpa: \"25\" is not a",
        ),
    ] {
        let found = faults_of(&value);
        assert!(found.len() == 1 && found[0].starts_with(says), "{found:?}");
    }
    let many: serde_json::Map<String, Value> = (0..19).map(|i| (i.to_string(), json!({}))).collect();
    assert_eq!(faults_of(&many.into()), ["/materials: has 19 entries: must have at most 18"]);
}

#[test]
fn the_option_of_an_export_is_read_without_a_mix() {
    let read = |value: Value| {
        let faults = Faults::default();
        let materials = Materials::read_option(&mut At::root(&value, &faults).object().unwrap());
        (materials, faults.into_vec())
    };
    assert_eq!(read(json!({})), (None, vec![]));
    let (materials, faults) = read(json!({"materials": {"basalt": {"youngs_modulus_gpa": 90}}}));
    assert!(faults.is_empty());
    let found = materials.unwrap().unknown_phases("/materials", [Some("granite"), None]);
    assert_eq!(
        found,
        [FieldError::new(
            "/materials/basalt",
            "is no phase of the mix: must be one of \"matrix\", \"aggregate\", \"granite\""
        )]
    );
    let (_, faults) = read(json!({"materials": {"matrix": {"poissons_ratio": 0.6}}}));
    assert_eq!(
        faults.iter().map(|fault| &*fault.pointer).collect::<Vec<_>>(),
        ["/materials/matrix/poissons_ratio"]
    );
}

#[test]
fn materials_change_neither_packing_nor_checkpoints() {
    let plain = read(&Value::Null).unwrap();
    let with = read(&json!({"matrix": {"youngs_modulus_gpa": 25}})).unwrap();
    assert_eq!(with.without_materials(), plain);
    assert_eq!(with.without_limits(), plain.without_limits());
    let limits = crate::Limits::default();
    let grains = |request: &PackingRequest| {
        let packing = crate::pack(request, &limits, &crate::Unattended).unwrap();
        (packing.grains, packing.report.summary)
    };
    assert_eq!(grains(&with), grains(&plain));
    let written = |request: &PackingRequest| {
        let mut bytes = Vec::new();
        crate::Checkpoint::new(request, &|out| out.write_all(b"state")).write_to(&mut bytes).unwrap();
        bytes
    };
    assert_eq!(written(&with), written(&plain));
    assert!(crate::Resume::read_from(&mut written(&plain).as_slice(), &with).is_ok());
    assert!(crate::Resume::read_with_limits(&mut written(&with).as_slice(), &plain).is_ok());
}
