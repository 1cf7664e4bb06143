#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::*;

fn faults(request: &Value) -> Vec<String> {
    BlendRequest::from_json(request).unwrap_err().iter().map(ToString::to_string).collect()
}

#[test]
fn faults_name_the_field_and_what_to_change() {
    let pile = json!({"grading": {"type": "monodisperse", "diameter_mm": 8}});
    let of_target = |target: Value| faults(&json!({"aggregates": [pile], "target": target}));
    assert_eq!(faults(&json!({"aggregates": [], "sieves_mm": [0], "target": {"type": "bund"}})).len(), 3);
    assert_eq!(
        of_target(json!({"type": "band"})),
        ["/target: must have either points, or the name of a grading with its standard"]
    );
    assert_eq!(
        of_target(json!({"type": "band", "points": [[1, 0.5, 0.4]]})),
        ["/target/points/0: the least 0.5 is above the most 0.4: must not be"]
    );
    assert_eq!(
        of_target(json!({"type": "band", "points": [[2, 50, 60], [1, 55, 70]]})),
        ["/target/points/0: the limits fall from 1 mm to 2 mm: must rise towards coarser sieves"]
    );
    assert_eq!(
        of_target(json!({"type": "band", "points": [[2, 50, 60], [2, 55, 70]]})),
        ["/target/points/1: the sieve 2 mm stands in two points: must stand in one"]
    );
    assert_eq!(
        of_target(json!({"type": "band", "name": "A16"})),
        ["/target/name: A16 is one curve and no band: set the type to \"standard\""]
    );
    assert_eq!(
        of_target(json!({"type": "diameters", "diameters_mm": [1, 2]})),
        ["/target/type: \"diameters\" lists the grains of one packing: must be a curve or a law"]
    );
    assert!(
        of_target(json!({"type": "band", "points": [[1, 0.2, 0.3], [4, 40, 60]]}))[0]
            .contains("all fractions (0 to 1) or all percents")
    );
    let band = json!({"type": "band", "points": [[1, 0, 1], [4, 1, 1]]});
    let outside = json!({"aggregates": [pile], "sieves_mm": [2, 8], "target": band});
    assert_eq!(faults(&outside), ["/sieves_mm/1: 8 is out of range: the band has limits from 1 to 4 mm"]);
    let piles = json!([
        {"name": "a", "density_kg_m3": 2600, "grading": pile["grading"]},
        {"name": "a", "grading": pile["grading"]},
    ]);
    assert_eq!(
        faults(&json!({"aggregates": piles, "target": {"type": "standard", "name": "A16"}})),
        ["/aggregates/1/name: is the name of another aggregate: must differ"]
    );
}

#[test]
fn limits_are_read_in_percent_and_in_any_order() {
    let request = json!({
        "aggregates": {"grading": {"type": "monodisperse", "diameter_mm": 8}},
        "target": {"type": "band", "points": [[8, 60, 100], [2, 0, 5]]},
        "packing_model": {"compaction_index": 6.7},
    });
    let read = BlendRequest::from_json(&request).unwrap();
    assert_eq!(read.target, Target::Band(vec![[2.0, 0.0, 0.05], [8.0, 0.6, 1.0]]));
    assert_eq!(read.packing_model, PackingModel { compaction_index: 6.7, residual_packing_density: 0.64 });
}
