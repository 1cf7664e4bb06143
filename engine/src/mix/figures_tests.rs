#![allow(clippy::unwrap_used)]

use serde_json::json;

use super::*;
use crate::PackingRequest;

fn mix(mix: &serde_json::Value) -> Mix {
    let request = json!({"specimen": {"type": "box", "size_mm": [300, 300, 300]}, "mix": mix});
    PackingRequest::from_json(&request, 1).unwrap().mix
}

fn of_grading(grading: &serde_json::Value) -> GradingFigures {
    figures(&mix(&json!({"grading": grading, "volume_fraction": 0.4, "d_min_mm": 4}))).unwrap()
}

/// k-values of the curves of DIN 1045-2 as <https://betontechnische-daten.de> prints them.
#[test]
fn curves_of_din_1045_have_their_k_values() {
    for (name, k) in [
        ("A8", 3.64),
        ("B8", 2.89),
        ("C8", 2.27),
        ("A16", 4.61),
        ("B16", 3.66),
        ("C16", 2.75),
        ("A32", 5.48),
        ("B32", 4.20),
        ("C32", 3.30),
    ] {
        let found = of_grading(&json!({"type": "standard", "name": name})).k_value;
        assert!((found - k).abs() < 0.011, "{name}: {found}");
    }
}

/// The sand of the example of ASTM C136: 0, 4, 26, 50, 70, 90 % stay on 4.75, 2.36, 1.18, 0.6, 0.3, 0.15 mm.
#[test]
fn a_fineness_modulus_is_a_sum_of_residues() {
    let points =
        [[0.075, 0.0], [0.15, 10.0], [0.3, 30.0], [0.6, 50.0], [1.18, 74.0], [2.36, 96.0], [4.75, 100.0]];
    let sand =
        json!({"grading": {"type": "sieves", "points": points}, "volume_fraction": 0.4, "d_min_mm": 1});
    let found = figures(&mix(&sand)).unwrap();
    assert!((found.fineness_modulus - 2.40).abs() < 1.0e-12, "{found:?}");
    assert_eq!(found.fines, 0.0);
}

#[test]
fn the_surface_of_spheres_has_its_closed_forms() {
    let equal = of_grading(&json!({"type": "monodisperse", "diameter_mm": 6}));
    assert!((equal.specific_surface_m2_m3 - 1000.0).abs() < 1.0e-9, "{equal:?}");
    // Of a curve that is linear in ln d between a and b: 6 (1 / a - 1 / b) / ln(b / a).
    let even = of_grading(&json!({"type": "sieves", "points": [[2, 0], [8, 1]]}));
    let expected = 6000.0 * (0.5 - 0.125) / 4.0_f64.ln();
    assert!((even.specific_surface_m2_m3 / expected - 1.0).abs() < 1.0e-8, "{even:?}");
    // Fuller's, above 0.063 mm: 6 q / (q - 1) (b^(q-1) - a^(q-1)) / (b^q - a^q).
    let fuller = of_grading(&json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.5}));
    let (a, b) = (0.063_f64, 16.0_f64);
    let expected = -6000.0 * (b.powf(-0.5) - a.powf(-0.5)) / (b.sqrt() - a.sqrt());
    assert!((fuller.specific_surface_m2_m3 / expected - 1.0).abs() < 1.0e-8, "{fuller:?}");
    assert!((fuller.fines - (a / b).sqrt()).abs() < 1.0e-12);
}

#[test]
fn a_list_has_the_figures_of_its_volumes() {
    let list = json!({"grading": {"type": "diameters", "diameters_mm": [8, 8, 2]}});
    let found = figures(&mix(&list)).unwrap();
    let expected = 6000.0 * (2.0 * 64.0 + 4.0) / (2.0 * 512.0 + 8.0);
    assert!((found.specific_surface_m2_m3 / expected - 1.0).abs() < 1.0e-9, "{found:?}");
    // On 0.15 to 1.18 mm all stays, on 2.36 and 4.75 mm the large ones.
    let large = 1024.0 / 1032.0;
    assert!((found.fineness_modulus - (4.0 + 2.0 * large)).abs() < 1.0e-12, "{found:?}");
}

#[test]
fn paste_fills_the_voids_first() {
    let with_aggregate = |fraction: f64| {
        let mix =
            mix(&json!({"grading": {"type": "monodisperse", "diameter_mm": 6}, "volume_fraction": fraction}));
        let graded = GradedMix::new(&mix, 300.0_f64.powi(3));
        figures_in_specimen(&mix, &graded, true).unwrap()
    };
    let found = with_aggregate(0.288);
    let paste = found.paste.unwrap();
    // 0.64 / (1 + 1/9) is 0.576, of which half is filled.
    assert!((found.packing_density - 0.576).abs() < 1.0e-12);
    assert_eq!(found.packing_density_placed, Some(found.packing_density));
    assert!(
        (paste.volume_fraction - 0.712).abs() < 1.0e-12
            && (paste.excess_volume_fraction - 0.5).abs() < 1.0e-12
    );
    // One mm2 of surface for each mm3 of grains.
    assert!((paste.film_thickness_mm - 0.5 / 0.288).abs() < 1.0e-9, "{paste:?}");
    assert!((paste.maximum_thickness_mm - 6.0 * (2.0_f64.cbrt() - 1.0)).abs() < 1.0e-9, "{paste:?}");
    let dense = with_aggregate(0.6).paste.unwrap();
    assert!(dense.excess_volume_fraction < 0.0);
    assert_eq!((dense.film_thickness_mm, dense.maximum_thickness_mm), (0.0, 0.0));
}

#[test]
fn fines_have_no_figures() {
    let dust = json!({"grading": {"type": "monodisperse", "diameter_mm": 0.05}, "volume_fraction": 0.4});
    let request = json!({"specimen": {"type": "box", "size_mm": [1, 1, 1]}, "mix": dust});
    assert_eq!(figures(&PackingRequest::from_json(&request, 1).unwrap().mix), None);
}

#[test]
fn the_parameters_of_the_packing_model_are_those_of_the_request() {
    let grading = json!({"type": "monodisperse", "diameter_mm": 8});
    let model = json!({"compaction_index": 4.0, "residual_packing_density": 0.6});
    let found = figures(&mix(&json!({"grading": grading, "volume_fraction": 0.4, "packing_model": model})));
    assert!((found.unwrap().packing_density - 0.6 * 0.8).abs() < 1.0e-12);
}

/// Filler of which half passes 0.063 mm, and stone: by the masses of what is coarser.
#[test]
fn the_surface_over_the_mass_is_that_of_the_coarser_rest() {
    let filler = json!({"type": "sieves", "points": [[0.01, 0.0], [0.063, 0.5], [0.125, 1.0]]});
    let stone = json!({"type": "sieves", "points": [[4, 0], [8, 1]]});
    let found = figures(&mix(&json!({
        "aggregates": [
            {"share": 0.5, "density_kg_m3": 2000, "grading": filler},
            {"share": 0.5, "density_kg_m3": 4000, "grading": stone},
        ],
        "volume_fraction": 0.3,
        "d_min_mm": 4,
    })))
    .unwrap();
    let density = (0.25 * 2000.0 + 0.5 * 4000.0) / 0.75;
    let per_kg = found.specific_surface_m2_kg.unwrap();
    assert!((per_kg * density / found.specific_surface_m2_m3 - 1.0).abs() < 1.0e-12, "{found:?}");
}

/// What passes by the classes that are made once, and by those of each sieve.
#[test]
fn what_passes_a_law_is_what_its_classes_hold() {
    let law = json!({"type": "weibull", "scale_mm": 6, "shape": 1.1, "by": "number", "d_min_mm": 0.5, "d_max_mm": 40});
    let mix = mix(&json!({"grading": law, "volume_fraction": 0.3, "d_min_mm": 4}));
    let parts = mix.parts();
    let passing = Passing::of(parts[0].grading);
    for mm in [0.2, 0.5, 1.3, 8.0, 11.2, 39.0, 40.0, 63.0] {
        let by_sieve = 1.0 - sum(&classes_of(&mix, mm));
        assert!((passing.share(mm) - by_sieve).abs() < 3.0e-4, "{mm}: {} {by_sieve}", passing.share(mm));
    }
    assert!(passing.share(0.5) < 1.0e-12 && passing.share(40.0) == 1.0);
}
