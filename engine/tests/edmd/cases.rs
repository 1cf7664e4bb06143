//! Mixes that ask for something special.

use packstone_engine::packing::GrowthEnd;
use packstone_engine::{Limits, PackError, PackingRequest, pack};
use serde_json::json;

use super::valid::{Patience, cube, diameters, grown, job};

#[test]
fn the_largest_distance_in_a_periodic_box_is_kept_from_own_images() {
    let method = json!({"growth_rate": 100.0});
    let grains = diameters(&[9.0, 0.5, 0.5, 0.5]);
    let value = job(&cube(10.0, "periodic"), &grains, &json!({"type": "maximize"}), &method);
    let packing = grown(&value, 0).unwrap();
    let distance = packing.report.summary.distance_mm.unwrap();
    assert!(distance <= 1.0 && distance > 0.99, "{distance}");
}

#[test]
fn one_grain_in_a_periodic_box_keeps_the_largest_distance_from_itself() {
    let value = job(
        &cube(10.0, "periodic"),
        &diameters(&[2.0]),
        &json!({"type": "maximize"}),
        &json!({"growth_rate": 1000.0}),
    );
    let packing = grown(&value, 0).unwrap();
    assert!((packing.report.summary.distance_mm.unwrap() - 8.0).abs() < 1e-4);
}

#[test]
fn wide_grains_in_a_flat_periodic_box_find_their_neighbours() {
    let method = json!({"initial_scale": 0.5, "growth_rate": 0.001});
    let flat = json!({"type": "box", "size_mm": [40, 40, 10], "boundary": "periodic"});
    let rule = json!({"type": "smaller_diameter", "factor": 0.3});
    for seed in 0..3 {
        let ended = grown(&job(&flat, &diameters(&[7.6; 12]), &rule, &method), seed);
        assert!(matches!(ended, Ok(_) | Err(PackError::TargetNotReached(_))), "{ended:?}");
    }
}

#[test]
fn one_grain_with_walls_at_a_distance_of_their_own_has_no_distance_to_maximize() {
    let maximize = json!({"type": "maximize", "wall_gap_mm": 0.0});
    let value =
        job(&cube(10.0, "walls"), &diameters(&[2.0]), &maximize, &json!({"growth_rate": 1000.0, "stop": {}}));
    match grown(&value, 0) {
        // Either is a clear answer; one longer than the specimen's diagonal is none.
        Err(PackError::Plan(_)) => {}
        Ok(packing) => assert!(packing.report.summary.distance_mm.unwrap() <= 10.0 * 3.0_f64.sqrt()),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn grains_do_not_stall_because_they_are_fast_or_small() {
    let mix =
        |mm: f64| json!({"grading": {"type": "monodisperse", "diameter_mm": mm}, "volume_fraction": 0.45});
    let none = json!({"type": "none"});
    let stop = json!({"stop": {"events": 200_000}});
    let slow = grown(&job(&cube(80.0, "walls"), &mix(8.0), &none, &stop), 0).unwrap();
    let mut fast = stop.clone();
    fast["initial_velocity"] = json!(1e6);
    let fast = grown(&job(&cube(80.0, "walls"), &mix(8.0), &none, &fast), 0).unwrap();
    let small = grown(&job(&cube(8e-5, "walls"), &mix(8e-6), &none, &stop), 0).unwrap();
    for packing in [slow, fast, small] {
        assert_eq!(packing.report.statistics.edmd.unwrap().stop, GrowthEnd::Target);
    }
}

#[test]
fn the_smallest_numbers_a_request_may_have_are_refused_or_served() {
    for method in [json!({"initial_velocity": 1e-200}), json!({"growth_rate": 5e-324})] {
        let value =
            job(&cube(20.0, "walls"), &diameters(&[8.0, 6.0, 5.0]), &json!({"type": "none"}), &method);
        let Ok(request) = PackingRequest::from_json(&value, 0) else { continue };
        let ended = pack(&request, &Limits::default(), &Patience::new(100_000));
        assert!(matches!(ended, Ok(_) | Err(PackError::TargetNotReached(_))), "{method}: {ended:?}");
    }
}

/// Small grains of 0.5 mm, thousands of them, among few that are 32 times as wide.
#[test]
fn grains_of_very_different_sizes_grow_valid() {
    let fuller = json!({"type": "fuller", "d_max_mm": 16.0, "exponent": 0.5});
    let mix = json!({"grading": fuller, "d_min_mm": 0.5, "volume_fraction": 0.6, "volume_fraction_of": "placed_grains"});
    let method = json!({"initial_scale": 0.97, "stop": {"events": 2_000_000}});
    for specimen in [cube(20.0, "walls"), cube(20.0, "periodic")] {
        let packing =
            grown(&job(&specimen, &mix, &json!({"type": "smaller_diameter", "factor": 0.05}), &method), 1)
                .unwrap();
        let summary = packing.report.summary;
        assert!(summary.grains > 3000 && summary.d_max_mm > 20.0 * summary.d_min_mm, "{summary:?}");
        assert_eq!(packing.report.statistics.edmd.unwrap().stop, GrowthEnd::Target);
    }
}

/// The usual mixture that does not crystallise, 1 to 1.4; jams at 0.64 to 0.65 where there are no walls.
#[test]
fn a_bidisperse_mixture_jams_at_random_close_packing() {
    let mm: Vec<f64> = (0..80).map(|i| if i < 40 { 1.4 } else { 1.0 }).collect();
    let method = json!({"stop": {"stall_dt_s": 1e-7}});
    let value = job(&cube(10.0, "periodic"), &diameters(&mm), &json!({"type": "maximize"}), &method);
    let packing = grown(&value, 2).unwrap();
    let end = packing.report.statistics.edmd.unwrap();
    assert_eq!(end.stop, GrowthEnd::Stalled);
    assert!(end.reduced_pressure > 1e6, "{}", end.reduced_pressure);
    // The same length is added to all, so that the ratio of sizes shrinks.
    let fraction = packing.report.summary.volume_fraction_with_coating;
    assert!(fraction > 0.61 && fraction < 0.67, "{fraction}");
}

/// The grains of a crowded cube of 20 mm.
const CROWDED_MM: [f64; 13] = [10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0];

#[test]
fn growth_that_gets_nowhere_is_valid_all_the_same() {
    let method = json!({"initial_scale": 1.0, "growth_rate": 1e-6, "stop": {"events": 1}});
    let value = job(&cube(20.0, "walls"), &diameters(&CROWDED_MM), &json!({"type": "maximize"}), &method);
    for seed in 0..40 {
        let ended = grown(&value, seed);
        assert!(matches!(ended, Ok(_) | Err(PackError::TargetNotReached(_))), "{ended:?}");
    }
}

#[test]
fn a_target_is_reached_with_its_margin_or_not_at_all() {
    let method = json!({"initial_scale": 1.0, "growth_rate": 1e-6, "stop": {"events": 1}});
    let value = job(&cube(20.0, "walls"), &diameters(&CROWDED_MM), &json!({"type": "none"}), &method);
    for seed in 0..40 {
        if let Ok(packing) = grown(&value, seed) {
            assert_eq!(packing.report.statistics.edmd.unwrap().stop, GrowthEnd::Target);
        }
    }
}

#[test]
fn the_largest_distance_leaves_the_walls_theirs() {
    let mix = json!({"grading": {"type": "monodisperse", "diameter_mm": 3.0}, "volume_fraction": 0.3});
    let value = job(&cube(20.0, "walls"), &mix, &json!({"type": "maximize", "wall_gap_mm": 0.3}), &json!({}));
    for seed in 0..60 {
        grown(&value, seed).unwrap();
    }
}
