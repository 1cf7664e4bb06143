use packstone_engine::shape::{CaliperSizes, Form};
use serde_json::json;

use super::*;
use crate::jobs::JobRequest;

fn grain(elongation: f64, flatness: f64, sieve_mm: f64, thickness_mm: f64, volume_mm3: f64) -> MeasuredGrain {
    let sizes = CaliperSizes { volume_mm3, sieve_mm, length_mm: 20.0, thickness_mm };
    MeasuredGrain { form: Form { elongation, flatness }, sizes }
}

fn request(shapes: &serde_json::Value) -> PackingRequest {
    let mut job = json!({
        "specimen": {"type": "box", "size_mm": [50, 50, 50]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 2, "volume_fraction": 0.3}
    });
    job["mix"].as_object_mut().unwrap().extend(shapes.as_object().unwrap().clone());
    JobRequest::read(&job, 0, None).unwrap().packing()
}

fn flaky(index: f64) -> serde_json::Value {
    json!({"type": "ellipsoid", "ratios": {"type": "flakiness", "index": index}})
}

#[test]
fn grains_of_one_form_share_a_disc_of_their_volume() {
    let grains = [
        grain(0.8, 0.5, 5.0, 2.0, 1.0),
        grain(0.6, 0.9, 5.0, 2.0, 10.0),
        grain(0.8, 0.5, 5.0, 2.0, 3.0),
        grain(0.801, 0.5, 5.0, 2.0, 4.0),
    ];
    let chart = zingg(&request(&json!({"shape": flaky(0.2)})), &grains, None);
    let discs = &chart.series.last().unwrap().points;
    assert_eq!(discs.len(), 2);
    // The largest is drawn first, and the mean form is one by volume.
    assert_eq!((discs[0].x, discs[0].y, discs[0].area), (0.9, 0.6, 1.0));
    assert!((discs[1].area - 0.8).abs() < 1e-12 && (discs[1].y - 0.8005).abs() < 1e-12, "{discs:?}");
    // A disc of 8 of 18 mm³, a rod of 10.
    let notes: Vec<&str> = chart.layout.notes.iter().map(|note| note.text.as_str()).collect();
    assert_eq!(notes, ["disc 44.4 %", "equant 0.0 %", "blade 0.0 %", "rod 55.6 %"]);
    assert!(chart.layout.is_square && !chart.is_empty());
}

#[test]
fn millions_of_grains_are_no_more_than_some_thousand_discs() {
    let grains: Vec<MeasuredGrain> = (0..200_000)
        .map(|i| {
            let ratio = |i: u32| 0.1 + 0.9 * f64::from(i % 447) / 447.0;
            grain(ratio(i), ratio(i / 447), 5.0, 2.0, 1.0)
        })
        .collect();
    let discs = joined(&grains);
    assert!(discs.len() <= 10_000, "{}", discs.len());
    assert!((discs.iter().map(|disc| disc.volume_mm3).sum::<f64>() - 200_000.0).abs() < 1e-6);
}

#[test]
fn flaky_mass_is_drawn_by_particle_size_fraction() {
    let grains = [
        grain(0.8, 0.5, 4.5, 2.4, 1.0),
        grain(0.8, 0.5, 4.5, 2.6, 3.0),
        grain(0.8, 0.5, 9.0, 6.0, 4.0),
        grain(0.8, 0.5, 3.0, 0.5, 9.0),
    ];
    let chart = flakiness(&request(&json!({"shape": flaky(0.2)})), &grains, None);
    let shown = |series: &Series| -> Vec<[f64; 2]> {
        series.points.iter().filter(|point| chart.shows(point)).map(|point| [point.x, point.y]).collect()
    };
    let labels: Vec<&str> = chart.series.iter().filter_map(|series| series.label.as_deref()).collect();
    assert_eq!(labels, ["requested index, 20 %", "all grains, 12.5 %", "particle size fractions"]);
    assert_eq!(shown(&chart.series[0]), [[4.0, 20.0], [10.0, 20.0]]);
    assert_eq!(shown(&chart.series[1]), [[4.0, 12.5], [10.0, 12.5]]);
    assert_eq!(shown(&chart.series[2]), [[4.0, 25.0], [5.0, 25.0], [8.0, 0.0], [10.0, 0.0]]);
    assert_eq!(chart.x.ticks, [4.0, 5.0, 8.0, 10.0]);
    // Finer grains have no flakiness index.
    assert!(flakiness(&request(&json!({"shape": flaky(0.2)})), &grains[3..], None).is_empty());
}

#[test]
fn requested_indices_are_those_of_the_shapes_that_state_one() {
    let constant =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.8, "flatness": 0.8}});
    let by_size = json!({"shapes": [
        {"above_mm": 8, "shape": flaky(0.3)}, {"above_mm": 4, "shape": constant},
        {"above_mm": 0, "shape": {"type": "mixture", "of": [
            {"share": 0.25, "shape": {"type": "sphere"}}, {"share": 0.75, "shape": flaky(0.2)}
        ]}}
    ]});
    let found = requested(&request(&by_size));
    assert_eq!(found.len(), 2);
    assert_eq!(found[0], (8.0, f64::INFINITY, 0.3));
    assert_eq!((found[1].0, found[1].1), (0.0, 4.0));
    assert!((found[1].2 - 0.15).abs() < 1e-12);
    assert_eq!(requested(&request(&json!({"shape": constant}))), []);
    assert_eq!(requested(&request(&json!({"shape": {"type": "polyhedron"}}))), []);
}
