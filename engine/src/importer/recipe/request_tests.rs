#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};

use super::super::answer::{Curve, Meaning, Recipe, RecipeAddition, RecipeAggregate};
use super::{grading_notes, request};
use crate::{Limits, PackingRequest, Plan};

fn aggregate(name: &str, mass_kg_m3: f64, density_kg_m3: Option<f64>) -> RecipeAggregate {
    RecipeAggregate { name: name.to_owned(), mass_kg_m3, density_kg_m3 }
}

fn recipe(aggregates: Vec<RecipeAggregate>) -> Recipe {
    Recipe {
        cement_kg_m3: Some(310.0),
        cement_density_kg_m3: Some(3100.0),
        additions: vec![RecipeAddition { name: "fly ash".into(), mass_kg_m3: 46.0, density_kg_m3: 2300.0 }],
        water_kg_m3: Some(155.0),
        water_cement: Some(0.5),
        aggregates,
        volume_sum_m3: Some(0.98),
        ..Recipe::default()
    }
}

fn curve(name: &str, points: &[[f64; 2]]) -> Curve {
    Curve {
        name: Some(name.to_owned()),
        column: "passing".into(),
        meaning: Meaning::Passing,
        unit: "mm".into(),
        points_printed: Vec::new(),
        points: points.to_vec(),
        completed: Vec::new(),
        notes: Vec::new(),
    }
}

fn read(mut document: Value) -> PackingRequest {
    document["specimen"] = json!({"type": "box", "size_mm": [100, 100, 100]});
    PackingRequest::from_json(&document, 1).unwrap()
}

#[test]
fn a_recipe_becomes_a_mix_that_is_planned() {
    let recipe = recipe(vec![
        aggregate("Sand 0/4", 800.0, Some(2640.0)),
        aggregate("Kies 4/16", 1060.0, Some(2650.0)),
    ]);
    let curves = [curve("sand  0/4", &[[0.063, 0.01], [0.5, 0.4], [2.0, 0.8], [4.0, 0.97], [8.0, 1.0]])];
    let document = request(&recipe, &curves).unwrap();
    let aggregates = &document["mix"]["aggregates"];
    assert_eq!(aggregates[0]["grading"]["type"], "sieves");
    assert_eq!(
        aggregates[1]["grading"],
        json!({"type": "classes", "classes": [{"d_min_mm": 4.0, "d_max_mm": 16.0, "mass_fraction": 1.0}]})
    );
    let request = read(document);
    // 800/2640 + 1060/2650 of a cubic metre.
    let fraction = request.mix.proportions.as_ref().unwrap().aggregate_fraction();
    assert!((fraction - (800.0 / 2640.0 + 0.4)).abs() < 1e-12, "{fraction}");
    let plan = Plan::new(&request, &Limits::default()).unwrap();
    assert!(plan.grains > 100.0);
    let notes = grading_notes(&recipe, &curves);
    assert!(notes[0].text.contains("is the curve") && notes[1].text.contains("4 to 16 mm"), "{notes:?}");
}

#[test]
fn a_missing_curve_is_left_out_and_named() {
    let recipe = recipe(vec![aggregate("River sand", 800.0, None), aggregate("20 mm Jelly", 1060.0, None)]);
    let document = request(&recipe, &[]).unwrap();
    let aggregates = &document["mix"]["aggregates"];
    assert_eq!(aggregates[0].get("grading"), None);
    assert_eq!(aggregates[0]["density_kg_m3"], 2650.0);
    assert_eq!(aggregates[1]["grading"]["classes"][0]["d_min_mm"], 10.0);
    let notes = grading_notes(&recipe, &[]);
    assert!(notes[0].text.contains("mix.aggregates[0].grading"), "{notes:?}");
}

#[test]
fn curves_belong_to_the_names_that_hold_them() {
    let recipe = recipe(vec![aggregate("Sand", 800.0, None), aggregate("Kies 2/16 (Rhein)", 1060.0, None)]);
    let fine = curve("Sand 0/2", &[[0.25, 0.1], [2.0, 1.0]]);
    let coarse = curve("Kies 2/16", &[[2.0, 0.0], [16.0, 1.0]]);
    let document = request(&recipe, &[coarse, fine]).unwrap();
    let points = |number: usize| document["mix"]["aggregates"][number]["grading"]["points"].clone();
    assert_eq!(points(0), json!([[0.25, 0.1], [2.0, 1.0]]));
    assert_eq!(points(1), json!([[2.0, 0.0], [16.0, 1.0]]));
    read(document.clone());
}

#[test]
fn parts_of_more_than_a_cubic_metre_leave_the_aggregates() {
    let mut of = recipe(vec![
        aggregate("Sand 0/4", 800.0, Some(2640.0)),
        aggregate("Kies 4/16", 1060.0, Some(2650.0)),
    ]);
    of.volume_sum_m3 = Some(1.004);
    let document = request(&of, &[]).unwrap();
    assert_eq!(document["mix"].get("proportions"), None);
    read(document);
    of.aggregates.clear();
    assert_eq!(request(&of, &[]), None);
}
