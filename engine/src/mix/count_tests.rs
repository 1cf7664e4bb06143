#![allow(clippy::unwrap_used, clippy::needless_pass_by_value)]

use serde_json::{Value, json};

use super::*;
use crate::request::PackingRequest;
use crate::{Limits, Packing, PlanError, Unattended, pack};

fn request(mix: &Value, specimen: Value, method: &str) -> PackingRequest {
    let value = json!({"specimen": specimen, "mix": mix, "method": {"type": method}});
    PackingRequest::from_json(&value, 3).unwrap()
}

fn cube(mm: f64) -> Value {
    json!({"type": "box", "size_mm": [mm, mm, mm]})
}

fn packed(mix: &Value, edge_mm: f64) -> Packing {
    pack(&request(mix, cube(edge_mm), "auto"), &Limits::default(), &Unattended).unwrap()
}

#[test]
fn as_many_grains_are_placed_as_are_counted() {
    let polyhedra = json!({"type": "polyhedron", "faces": 12, "template_count": 4});
    let aggregates = json!([
        {"share": 0.6, "grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}},
        {"share": 0.4, "grading": {"type": "monodisperse", "diameter_mm": 9}},
    ]);
    for (mix, edge_mm) in [
        (json!({"grading": {"type": "standard", "name": "A16"}, "count": 1}), 60.0),
        (json!({"grading": {"type": "standard", "name": "A16"}, "count": 777}), 60.0),
        (json!({"grading": {"type": "monodisperse", "diameter_mm": 5}, "count": 300}), 60.0),
        (
            json!({"grading": {"type": "lognormal", "median_mm": 5, "sigma": 0.3, "by": "number"}, "count": 400}),
            60.0,
        ),
        (json!({"grading": {"type": "standard", "name": "B8"}, "count": 250, "shape": polyhedra}), 40.0),
        (json!({"aggregates": aggregates, "d_min_mm": 2, "count": 900}), 60.0),
    ] {
        let packing = packed(&mix, edge_mm);
        let summary = &packing.report.summary;
        assert_eq!(summary.grains, mix["count"].as_u64().unwrap(), "{mix}");
        let phi = summary.volume_fraction_effective;
        let plan = crate::Plan::new(&request(&mix, cube(edge_mm), "auto"), &Limits::default()).unwrap();
        assert!((plan.grains - summary.grains as f64).abs() < 1e-6 * plan.grains, "{mix}");
        if summary.grains > 100 {
            assert!(
                (phi / plan.volume_fraction_effective - 1.0).abs() < 0.05,
                "{mix}: {phi}, {}",
                plan.volume_fraction_effective
            );
        }
    }
}

/// The mean over seeds of the volume is that of so many mean grains.
#[test]
fn the_volume_of_counted_grains_is_that_of_their_law() {
    let mix = json!({"grading": {"type": "standard", "name": "A16"}, "count": 5000});
    let request = request(&mix, cube(150.0), "auto");
    let graded = GradedMix::new(&request.mix, request.specimen.volume_mm3());
    assert_eq!(graded.numbers.iter().sum::<u64>(), 5000);
    let asked = graded.volume_fraction_effective * graded.specimen_volume_mm3;
    let volumes: Vec<f64> = (0..20)
        .map(|seed| {
            let mut rng = crate::rng::stream(seed, crate::rng::Stream::Sampling);
            let diameters = sampling::sample(&graded, &mut rng, &|| false).unwrap().d_mm;
            assert_eq!(diameters.len(), 5000);
            diameters.iter().map(|&d| sphere_volume(d)).sum()
        })
        .collect();
    let mean = volumes.iter().sum::<f64>() / volumes.len() as f64;
    // Of the largest grains, half a one may be missing or too many.
    assert!((mean - asked).abs() < sphere_volume(16.0), "{mean} of {asked}");
    assert!(volumes.iter().all(|volume| (volume - mean).abs() < sphere_volume(16.0)));
}

#[test]
fn too_many_grains_are_refused_with_how_many_fit() {
    let mix = json!({"grading": {"type": "monodisperse", "diameter_mm": 10}, "count": 2000});
    let refused = crate::Plan::new(&request(&mix, cube(100.0), "auto"), &Limits::default());
    let Err(PlanError::Infeasible(fault)) = refused else { panic!("{refused:?}") };
    assert_eq!(fault.pointer, "/mix/count");
    assert!(fault.detail.contains("must be at most 1909"), "{}", fault.detail);
    let dense = json!({"grading": {"type": "monodisperse", "diameter_mm": 10}, "count": 1800});
    let refused = crate::Plan::new(&request(&dense, cube(100.0), "auto"), &Limits::default());
    let Err(PlanError::Infeasible(fault)) = refused else { panic!("{refused:?}") };
    assert!(fault.pointer == "/mix/count" && fault.detail.contains("lower the count"), "{fault}");
}

#[test]
fn a_count_stands_alone() {
    let fault = |mix: Value| {
        let value = json!({"specimen": cube(100.0), "mix": mix});
        PackingRequest::from_json(&value, 3).unwrap_err()[0].to_string()
    };
    let a16 = json!({"type": "standard", "name": "A16"});
    for (mix, says) in [
        (json!({"grading": a16, "count": 10, "volume_fraction": 0.4}), "/mix/volume_fraction"),
        (json!({"grading": a16, "count": 0}), "/mix/count"),
        (json!({"grading": a16, "count": 1.5}), "/mix/count"),
        (json!({"grading": {"type": "diameters", "diameters_mm": [4]}, "count": 1}), "list of diameters"),
        (
            json!({"aggregates": {"mass_kg_m3": 1800, "density_kg_m3": 2650, "grading": a16}, "count": 9}),
            "mass_kg_m3 of the aggregates",
        ),
    ] {
        let said = fault(mix);
        assert!(said.contains(says), "{says}: {said}");
    }
}
