#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::request::ShapePreset;
use crate::request::{GrainKind, PackingRequest, SizeMeasure};

fn request(fields: &Value) -> Value {
    let mut mix = json!({"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4});
    for (name, value) in fields.as_object().unwrap() {
        mix[name] = value.clone();
    }
    json!({"specimen": {"type": "box", "size_mm": [80, 80, 80]}, "mix": mix})
}

fn faults(fields: &Value) -> Vec<String> {
    match PackingRequest::from_json(&request(fields), 1) {
        Ok(request) => panic!("accepted: {request:?}"),
        Err(faults) => faults.iter().map(ToString::to_string).collect(),
    }
}

/// The mix as it is written after it was read.
fn written(fields: &Value) -> Value {
    let first = PackingRequest::from_json(&request(fields), 1).unwrap();
    let text = serde_json::to_value(&first).unwrap();
    assert_eq!(PackingRequest::from_json(&text, 2).unwrap(), first);
    first.validate().unwrap();
    text["mix"].clone()
}

fn ellipsoid(ratios: &Value) -> Value {
    json!({"type": "ellipsoid", "ratios": ratios})
}

#[test]
fn a_request_without_shapes_is_written_as_before() {
    let read = PackingRequest::from_json(&request(&json!({})), 7).unwrap();
    assert_eq!(
        serde_json::to_string(&read).unwrap(),
        r#"{"seed":7,"specimen":{"type":"box","size_mm":[80.0,80.0,80.0],"boundary":"walls"},"mix":{"grading":{"type":"standard","name":"A16"},"d_min_mm":2.0,"volume_fraction":0.4,"volume_fraction_of":"all_aggregate"},"distance":{"type":"none"},"method":{"type":"auto"}}"#
    );
    assert!(!read.mix.has_shapes());
    let defaults = json!({"size": "sieve", "orientation": {"type": "uniform"}, "shape": null});
    assert_eq!(PackingRequest::from_json(&request(&defaults), 7).unwrap(), read);
}

#[test]
fn every_law_is_written_as_it_is_read_with_its_defaults() {
    let default_elongation = json!({"type": "uniform", "min": 0.5, "max": 0.9});
    let table = json!({"type": "table", "values": [0.5, 0.75], "weights": [1.0, 3.0]});
    for (ratios, known) in [
        (
            json!({"type": "constant", "elongation": 0.8, "flatness": 0.75}),
            json!({"type": "constant", "elongation": 0.8, "flatness": 0.75}),
        ),
        (
            json!({"type": "constant", "b_over_a": 0.5, "c_over_a": 0.25}),
            json!({"type": "constant", "elongation": 0.5, "flatness": 0.5}),
        ),
        (
            json!({"type": "independent", "elongation": 1, "flatness": {"type": "beta", "mean": 0.6, "standard_deviation": 0.1}}),
            json!({"type": "independent", "elongation": 1.0, "flatness": {"type": "beta", "mean": 0.6, "standard_deviation": 0.1}}),
        ),
        (
            json!({"type": "independent", "elongation": table, "flatness": {"type": "uniform", "min": 0.25, "max": 1}}),
            json!({"type": "independent", "elongation": table, "flatness": {"type": "uniform", "min": 0.25, "max": 1.0}}),
        ),
        (json!({"type": "triangle", "k": 0.25}), json!({"type": "triangle", "k": 0.25})),
        (
            json!({"type": "measured", "axes": [[7, 6, 3], [1.5, 1.0, 1.25]]}),
            json!({"type": "measured", "axes": [[7.0, 6.0, 3.0], [1.5, 1.0, 1.25]]}),
        ),
        (
            json!({"type": "flakiness", "index": 0.15}),
            json!({"type": "flakiness", "index": 0.15, "elongation": default_elongation}),
        ),
        (
            json!({"type": "shape_index", "index": 0.15, "elongation": 0.5}),
            json!({"type": "shape_index", "index": 0.15, "elongation": 0.5}),
        ),
    ] {
        assert_eq!(written(&json!({"shape": ellipsoid(&ratios)}))["shape"], ellipsoid(&known));
    }
}

#[test]
fn shapes_by_size_size_and_orientation_are_written_as_they_are_read() {
    let triangle = ellipsoid(&json!({"type": "triangle", "k": 0.5}));
    let mixture = json!({"type": "mixture", "of": [
        {"share": 0.25, "shape": {"type": "sphere"}}, {"share": 0.75, "shape": triangle}]});
    let fine = json!({"above_mm": 0.0, "shape": {"type": "sphere"}});
    let coarse = json!({"above_mm": 8.0, "shape": mixture});
    let orientation = json!({"type": "axis", "axis": "z", "concentration": 4.0});
    let mix = written(&json!({"shapes": [fine, coarse], "size": "equivalent", "orientation": orientation}));
    assert_eq!(mix["shapes"], json!([coarse, fine]));
    assert_eq!((&mix["size"], &mix["orientation"]), (&json!("equivalent"), &orientation));
    let read = PackingRequest::from_json(&request(&json!({"shapes": [coarse, fine]})), 1).unwrap().mix;
    let parts = read.parts();
    let shapes = parts[0].grain_shapes().unwrap();
    assert_eq!(shapes.iter().map(|(above, _)| *above).collect::<Vec<_>>(), [8.0, 0.0]);
    assert_eq!(read.size, SizeMeasure::Sieve);
    // Spheres by another name.
    let spheres = json!({"shape": {"type": "mixture", "of": [{"share": 1, "shape": {"type": "sphere"}}]}});
    let read = PackingRequest::from_json(&request(&spheres), 1).unwrap();
    assert_eq!(read.mix.grain_kind(), GrainKind::Spheres);
}

#[test]
fn every_fault_names_its_place_the_value_and_the_bound() {
    let ratios = |ratios: Value| json!({"shape": ellipsoid(&ratios)});
    let sphere = json!({"type": "sphere"});
    let cases = [
        (
            json!({"shape": {"type": "cube"}}),
            "/mix/shape/type: \"cube\" is unknown: must be one of \"sphere\", \"ellipsoid\", \"polyhedron\", \
             \"preset\", \"mixture\"",
        ),
        (
            json!({"shape": {"type": "mixture", "of": [{"share": 1, "shape": {"type": "mixture"}}]}}),
            "/mix/shape/of/0/shape/type: \"mixture\" is unknown: must be one of \"sphere\", \"ellipsoid\", \
             \"polyhedron\", \"preset\"",
        ),
        (
            json!({"shape": {"type": "mixture", "of": [{"share": 0.5, "shape": sphere}, {"share": 0.4, "shape": sphere}]}}),
            "/mix/shape/of: the shares sum to 0.9: must sum to 1",
        ),
        (
            json!({"shape": sphere, "shapes": []}),
            "/mix/shapes: there is a shape for all sizes too: leave one of the two out",
        ),
        (json!({"shapes": []}), "/mix/shapes: has 0 classes: must have at least 1"),
        (
            json!({"shapes": [{"above_mm": 4, "shape": sphere}]}),
            "/mix/shapes: grains up to 4 mm have no shape: the above_mm of one class must be 0",
        ),
        (
            json!({"shapes": [{"above_mm": 0, "shape": sphere}, {"above_mm": 0, "shape": sphere}]}),
            "/mix/shapes/1: above_mm 0 is that of another class: must differ",
        ),
        (json!({"size": "mesh"}), "/mix/size: \"mesh\" is unknown: must be one of \"sieve\", \"equivalent\""),
        (
            json!({"orientation": {"type": "axis", "axis": "z", "concentration": 5}}),
            "/mix/orientation: spheres have no orientation: must be \"uniform\", or the mix must have a shape",
        ),
        (
            json!({"shape": sphere, "orientation": {"type": "axis", "axis": "z", "concentration": 500}}),
            "/mix/orientation/concentration: 500 is out of range: must be at least -100 and at most 100",
        ),
        (
            ratios(json!({"type": "constant"})),
            "/mix/shape/ratios/elongation: is missing: the field is required",
        ),
        (
            ratios(json!({"type": "constant", "b_over_a": 0.5, "c_over_a": 0.6})),
            "/mix/shape/ratios/c_over_a: 0.6 is out of range: must be at most b_over_a 0.5",
        ),
        (
            ratios(json!({"type": "constant", "b_over_a": 0.5, "elongation": 0.6})),
            "/mix/shape/ratios/elongation: the ratios are given by b_over_a and c_over_a too: leave one of the two \
             pairs out",
        ),
        (
            ratios(json!({"type": "triangle", "k": 0})),
            "/mix/shape/ratios/k: 0 is out of range: must be at least 0.1 and at most 1",
        ),
        (
            ratios(json!({"type": "independent", "elongation": "flat", "flatness": 1})),
            "/mix/shape/ratios/elongation: must be a number, or an object with the type \"uniform\", \"beta\" or \
             \"table\"",
        ),
        (
            ratios(
                json!({"type": "independent", "elongation": 0.2, "flatness": {"type": "uniform", "min": 0.3, "max": 1}}),
            ),
            "/mix/shape/ratios: the smallest elongation times flatness, c/a, is 0.0600: must be at least 0.1",
        ),
        (
            ratios(json!({"type": "flakiness", "index": 15})),
            "/mix/shape/ratios/index: 15 is out of range: must be at least 0 and at most 1",
        ),
        (
            ratios(json!({"type": "triangle", "k": 0.5, "d": 1})),
            "/mix/shape/ratios/d: unknown field: this object has type, k",
        ),
    ];
    for (fields, known) in cases {
        let found = faults(&fields);
        assert_eq!(found[0], known, "{found:?}");
    }
    let several = faults(&ratios(
        json!({"type": "measured", "axes": [[1, 2], [1, 1, 1], [1, "x", 1]], "weights": [1, null, "y"]}),
    ));
    assert_eq!(several.len(), 4, "{several:?}");
}

#[test]
fn a_polyhedron_is_written_with_its_defaults() {
    let equant = json!({"type": "constant", "elongation": 1.0, "flatness": 1.0});
    let with = |fields: Value| {
        let mut shape = json!({"type": "polyhedron", "ratios": equant, "rounding": 0.0, "template_count": 32, "template_seed": 0});
        shape.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        shape
    };
    let triangle = json!({"type": "triangle", "k": 0.25});
    for (given, known) in [
        (json!({}), with(json!({"template": "cuts", "faces": 24}))),
        (
            json!({"faces": 6, "rounding": 0.25}),
            with(json!({"template": "cuts", "faces": 6, "rounding": 0.25})),
        ),
        (
            json!({"template": "deformed_cuboid", "ratios": triangle}),
            with(json!({"template": "deformed_cuboid", "displacement": 0.2, "ratios": triangle})),
        ),
        (
            json!({"template": "deformed_cuboid", "displacement": 0, "template_seed": 7}),
            with(json!({"template": "deformed_cuboid", "displacement": 0.0, "template_seed": 7})),
        ),
        (
            json!({"template": "voronoi", "template_count": 128}),
            with(json!({"template": "voronoi", "template_count": 128})),
        ),
        (json!({"template": "tetrahedron"}), with(json!({"template": "tetrahedron", "template_count": 1}))),
        (
            json!({"template": "icosahedron", "template_count": 4, "ratios": triangle}),
            with(json!({"template": "icosahedron", "template_count": 4, "ratios": triangle})),
        ),
    ] {
        let mut shape = given;
        shape["type"] = json!("polyhedron");
        assert_eq!(written(&json!({"shape": shape}))["shape"], known);
    }
    let half = json!({"share": 0.5, "shape": {"type": "polyhedron"}});
    let mixed = json!({"shapes": [
        {"above_mm": 8, "shape": {"type": "mixture", "of": [half, half]}}, {"above_mm": 0, "shape": {"type": "polyhedron"}}]});
    let read = |fields: &Value| PackingRequest::from_json(&request(fields), 1).unwrap().mix.grain_kind();
    assert_eq!(read(&mixed), GrainKind::Polyhedra);
    assert_eq!(read(&json!({"shape": ellipsoid(&triangle)})), GrainKind::Ellipsoids);
    assert_eq!(read(&json!({"shape": {"type": "sphere"}})), GrainKind::Spheres);
    // Spheres and ellipsoids may be mixed with polyhedra, in one class of size or in several.
    for other in [json!({"type": "sphere"}), ellipsoid(&triangle)] {
        let of = json!([half, {"share": 0.5, "shape": other}]);
        assert_eq!(read(&json!({"shape": {"type": "mixture", "of": of}})), GrainKind::Mixed);
        let by_size =
            json!([{"above_mm": 8, "shape": {"type": "polyhedron"}}, {"above_mm": 0, "shape": other}]);
        assert_eq!(read(&json!({"shapes": by_size})), GrainKind::Mixed);
    }
}

#[test]
fn every_fault_of_polyhedra_names_its_place_the_value_and_the_bound() {
    let shape = |fields: Value| {
        let mut shape = fields;
        shape["type"] = json!("polyhedron");
        json!({"shape": shape})
    };
    let polyhedron = json!({"type": "polyhedron"});
    let cases = [
        (
            shape(json!({"template": "stars"})),
            "/mix/shape/template: \"stars\" is unknown: must be one of \"cuts\", \"deformed_cuboid\", \"voronoi\", \
             \"tetrahedron\", \"cube\", \"octahedron\", \"dodecahedron\", \"icosahedron\""
                .to_owned(),
        ),
        (
            shape(json!({"faces": 5})),
            "/mix/shape/faces: 5 is out of range: must be a whole number from 6 to 60".to_owned(),
        ),
        (
            shape(json!({"template": "voronoi", "faces": 12})),
            "/mix/shape/faces: is a field of the template \"cuts\" alone: leave it out".to_owned(),
        ),
        (
            shape(json!({"template": "cube", "faces": 6})),
            "/mix/shape/faces: is a field of the template \"cuts\" alone: leave it out".to_owned(),
        ),
        (
            shape(json!({"displacement": 0.2})),
            "/mix/shape/displacement: is a field of the template \"deformed_cuboid\" alone: leave it out".to_owned(),
        ),
        (
            shape(json!({"template": "deformed_cuboid", "displacement": 0.5})),
            "/mix/shape/displacement: 0.5 is out of range: must be at least 0 and at most 0.4".to_owned(),
        ),
        (
            shape(json!({"rounding": 0.5})),
            "/mix/shape/rounding: 0.5 is out of range: must be at least 0 and at most 0.4".to_owned(),
        ),
        (
            shape(json!({"template_count": 129})),
            "/mix/shape/template_count: 129 is out of range: must be a whole number from 1 to 128".to_owned(),
        ),
        (
            shape(json!({"template_seed": -1})),
            "/mix/shape/template_seed: -1 is out of range: must be a whole number from 0 to 9007199254740991"
                .to_owned(),
        ),
        (
            shape(json!({"ratios": {"type": "flakiness", "index": 0.2}})),
            "/mix/shape/ratios/type: \"flakiness\" is a law of ellipsoids alone: must be one of \"constant\", \
             \"independent\", \"triangle\", \"measured\" for polyhedra, whose flakiness index and shape index the \
             result reports"
                .to_owned(),
        ),
        (
            shape(json!({"ratios": {"type": "triangle", "k": 0.05}})),
            "/mix/shape/ratios/k: 0.05 is out of range: must be at least 0.1 and at most 1".to_owned(),
        ),
        (
            json!({"shapes": [{"above_mm": 8, "shape": {"type": "polyhedron", "template_count": 100}},
                {"above_mm": 0, "shape": {"type": "mixture", "of": [
                    {"share": 0.5, "shape": {"type": "sphere"}},
                    {"share": 0.5, "shape": {"type": "polyhedron", "template_count": 100}}]}}]}),
            "/mix/shapes: the shapes have 200 templates together: must have at most 128; lower template_count".to_owned(),
        ),
        (
            json!({"shape": {"type": "mixture", "of": [
                {"share": 0.5, "shape": {"type": "polyhedron", "template_count": 100}},
                {"share": 0.5, "shape": {"type": "polyhedron", "template_count": 100}}]}}),
            "/mix/shape: the shapes have 200 templates together: must have at most 128; lower template_count".to_owned(),
        ),
    ];
    for (fields, known) in cases {
        let found = faults(&fields);
        assert_eq!(found, [known]);
    }
    let several = faults(&shape(json!({"faces": 1, "rounding": 1, "template_count": 0, "corners": 3})));
    assert_eq!(several.len(), 4, "{several:?}");
    let edmd = json!({"specimen": {"type": "box", "size_mm": [80, 80, 80]}, "method": {"type": "edmd"}, "mix": {
        "grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4, "shape": polyhedron}});
    let refused = PackingRequest::from_json(&edmd, 1).unwrap_err();
    assert_eq!(refused[0].pointer, "/method/type");
}

fn number() -> impl Strategy<Value = Value> {
    prop_oneof![4 => (0.05..1.1).prop_map(|x: f64| json!(x)), 1 => any::<f64>().prop_map(|x| json!(x)), 1 => Just(json!("x"))]
}

fn law() -> impl Strategy<Value = Value> {
    prop_oneof![
        number(),
        (number(), number()).prop_map(|(min, max)| json!({"type": "uniform", "min": min, "max": max})),
        (number(), number())
            .prop_map(|(mean, sd)| json!({"type": "beta", "mean": mean, "standard_deviation": sd})),
        (prop::collection::vec(number(), 0..4), prop::collection::vec(number(), 0..4))
            .prop_map(|(values, weights)| json!({"type": "table", "values": values, "weights": weights})),
    ]
}

fn ratios() -> impl Strategy<Value = Value> {
    prop_oneof![
        (number(), number()).prop_map(|(b, c)| json!({"type": "constant", "b_over_a": b, "c_over_a": c})),
        (number(), number()).prop_map(|(e, f)| json!({"type": "constant", "elongation": e, "flatness": f})),
        (law(), law()).prop_map(|(e, f)| json!({"type": "independent", "elongation": e, "flatness": f})),
        number().prop_map(|k| json!({"type": "triangle", "k": k})),
        prop::collection::vec([number(), number(), number()], 0..4)
            .prop_map(|axes| json!({"type": "measured", "axes": axes})),
        (number(), law()).prop_map(|(i, e)| json!({"type": "flakiness", "index": i, "elongation": e})),
        (number(), law()).prop_map(|(i, e)| json!({"type": "shape_index", "index": i, "elongation": e})),
    ]
}

properties! {
    #[test]
    fn whatever_is_accepted_is_written_as_it_is_read(ratios in ratios()) {
        let value = request(&json!({"shape": ellipsoid(&ratios)}));
        if let Ok(first) = PackingRequest::from_json(&value, 1) {
            let text = serde_json::to_value(&first).unwrap();
            prop_assert_eq!(PackingRequest::from_json(&text, 2).unwrap(), first);
        }
    }

    #[test]
    fn polyhedra_that_are_accepted_are_written_as_they_are_read(
        template in prop::sample::select(vec!["cuts", "deformed_cuboid", "voronoi", "cube", "octahedron", "ball"]),
        faces in prop::option::of(0_i64..80), displacement in prop::option::of(-0.1..0.6_f64),
        ratios in prop::option::of(ratios()), rounding in prop::option::of(-0.1..0.6_f64),
        count in prop::option::of(-1_i64..200), seed in prop::option::of(any::<u64>()),
    ) {
        let mut shape = json!({"type": "polyhedron", "template": template});
        let fields = [("faces", json!(faces)), ("displacement", json!(displacement)), ("ratios", json!(ratios)),
            ("rounding", json!(rounding)), ("template_count", json!(count)), ("template_seed", json!(seed))];
        for (name, value) in fields {
            if !value.is_null() {
                shape[name] = value;
            }
        }
        if let Ok(first) = PackingRequest::from_json(&request(&json!({"shape": shape})), 1) {
            let text = serde_json::to_value(&first).unwrap();
            prop_assert_eq!(PackingRequest::from_json(&text, 2).unwrap(), first);
        }
    }
}

#[test]
fn presets_are_resolved_on_reading_and_keep_their_names() {
    let preset = |name: &str| json!({"type": "preset", "name": name});
    let elongation = json!({"type": "uniform", "min": 0.5, "max": 0.9});
    let flaky = json!({"type": "flakiness", "index": 0.2, "elongation": elongation});
    let resolved = json!({"type": "ellipsoid", "ratios": flaky, "preset": "fi20"});
    assert_eq!(written(&json!({"shape": preset("fi20")}))["shape"], resolved);
    // What was stored is read again, and a preset stands wherever a shape does.
    assert_eq!(written(&json!({"shape": resolved}))["shape"], resolved);
    let everywhere = written(&json!({"shapes": [
        {"above_mm": 8, "shape": preset("impact_fragments")},
        {"above_mm": 0, "shape": {"type": "mixture", "of": [
            {"share": 0.5, "shape": {"type": "sphere"}}, {"share": 0.5, "shape": preset("fi20")}
        ]}}
    ]}));
    assert_eq!(everywhere["shapes"][1]["shape"]["of"][1]["shape"], resolved);
    let ratios = &everywhere["shapes"][0]["shape"]["ratios"];
    let root = std::f64::consts::FRAC_1_SQRT_2;
    assert_eq!(*ratios, json!({"type": "constant", "elongation": root, "flatness": root}));
    // A law without a name is written without one.
    assert_eq!(written(&json!({"shape": ellipsoid(&flaky)}))["shape"], ellipsoid(&flaky));
}

#[test]
fn presets_that_do_not_exist_and_laws_that_are_not_theirs_are_refused() {
    let found = faults(&json!({"shape": {"type": "preset", "name": "river_gravel"}}));
    assert!(found[0].starts_with("/mix/shape/name: ") && found[0].contains("\"fi15\""), "{found:?}");
    let found = faults(&json!({"shape": {"type": "preset"}}));
    assert_eq!(found, ["/mix/shape/name: is missing: the field is required"]);
    let found = faults(&json!({"shape": {"type": "preset", "name": "fi15", "index": 0.2}}));
    assert!(found[0].starts_with("/mix/shape/index: "), "{found:?}");
    let other = json!({"type": "ellipsoid", "ratios": {"type": "triangle", "k": 0.5}, "preset": "fi15"});
    assert_eq!(
        faults(&json!({"shape": other})),
        ["/mix/shape/preset: the ratios are not those of the preset \"fi15\": leave it out"]
    );
}

#[test]
fn every_preset_names_its_source_and_can_be_drawn() {
    for preset in ShapePreset::ALL {
        assert!(
            !preset.about.is_empty() && preset.source.contains(|c: char| c.is_ascii_digit()),
            "{preset:?}"
        );
        assert_eq!(ShapePreset::of_name(preset.name), Some(&preset));
        let mix = written(&json!({"shape": {"type": "preset", "name": preset.name}}));
        assert_eq!(mix["shape"], serde_json::to_value(preset.shape()).unwrap());
    }
}
