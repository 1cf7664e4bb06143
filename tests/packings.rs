//! The physics of what is returned, checked by brute force: every pair, every wall, every class.
//!
//! The program checks its packings itself; this check shares no code with it and takes O(N^2).

use std::f64::consts::PI;

use serde_json::{Value, json};

use crate::harness::{DataDir, Launch, id_of, results};

/// Rounding of one distance: coordinates of up to 100 mm have 1e-14 mm between neighbours.
const ROUNDING_MM: f64 = 1.0e-11;

fn cases() -> Vec<(&'static str, Value)> {
    let a16 =
        json!({"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.45});
    let cube = |boundary: &str| json!({"type": "box", "size_mm": [50, 50, 50], "boundary": boundary});
    let cylinder = json!({"type": "cylinder", "diameter_mm": 50, "height_mm": 100});
    vec![
        ("walls, touching", json!({"specimen": cube("walls"), "mix": a16})),
        (
            "walls, constant",
            json!({"specimen": cube("walls"), "mix": a16, "distance": {"type": "constant", "gap_mm": 0.4}}),
        ),
        (
            "walls, a wall distance of its own",
            json!({"specimen": cube("walls"), "mix": a16, "distance": {"type": "constant", "gap_mm": 0.2, "wall_gap_mm": 1.5}}),
        ),
        (
            "periodic, proportional",
            json!({"specimen": cube("periodic"), "mix": a16, "distance": {"type": "proportional", "factor": 0.05}}),
        ),
        (
            "cylinder, smaller diameter",
            json!({"specimen": cylinder, "mix": a16, "distance": {"type": "smaller_diameter", "factor": 0.1}}),
        ),
        (
            "a flat box, Fuller, effective",
            json!({
                "specimen": {"type": "box", "size_mm": [100, 60, 20]},
                "mix": {"grading": {"type": "fuller", "d_max_mm": 16, "exponent": 0.5}, "d_min_mm": 1.5,
                        "volume_fraction": 0.40, "volume_fraction_of": "placed_grains"}
            }),
        ),
        (
            "sieves, cut off inside a class",
            json!({
                "specimen": cube("periodic"),
                "mix": {"grading": {"type": "sieves", "points": [[1, 0.1], [4, 0.5], [10, 1.0]]},
                        "d_min_mm": 2.2, "volume_fraction": 0.5}
            }),
        ),
        (
            "classes with a gap",
            json!({
                "specimen": cube("walls"),
                "mix": {"grading": {"type": "classes", "classes": [
                            {"d_min_mm": 8, "d_max_mm": 11, "mass_fraction": 0.5},
                            {"d_min_mm": 2, "d_max_mm": 4, "mass_fraction": 0.3}]},
                        "volume_fraction": 0.45}
            }),
        ),
        (
            "equal spheres by exhaustive search",
            json!({
                "specimen": {"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"},
                "mix": {"grading": {"type": "monodisperse", "diameter_mm": 2}, "volume_fraction": 0.36},
                "method": {"type": "rsa"}
            }),
        ),
        (
            "explicit diameters by plain attempts",
            json!({
                "specimen": cube("walls"),
                "mix": {"grading": {"type": "diameters", "diameters_mm": [3, 20, 7, 7, 12.5]}},
                "method": {"type": "rsa", "attempts_per_grain": 100_000}
            }),
        ),
    ]
}

#[tokio::test]
async fn no_two_grains_overlap_and_none_leaves_the_specimen() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let mut submitted = Vec::new();
    for (name, mut job) in cases() {
        job["seed"] = json!(5);
        job["name"] = json!(name);
        submitted.push((name, client.submit(&job).await));
    }
    for (name, job) in submitted {
        let finished = client.finished(id_of(&job)).await;
        assert_eq!(finished["state"], "succeeded", "{name}: {finished:#}");
        let result = client.result(id_of(&job)).await;
        let rows = results::from_json(&result);
        check_clearances(name, &result, &rows);
        check_volumes(name, &result, &rows);
    }
    server.stop().await;
}

/// The distance that two grains of these diameters keep.
fn demanded_mm(distance: &Value, d_a: f64, d_b: f64) -> f64 {
    let number = |field: &str| distance[field].as_f64().unwrap_or_else(|| panic!("no {field} in {distance}"));
    match distance["type"].as_str().unwrap() {
        "none" => 0.0,
        "constant" => number("gap_mm"),
        "proportional" => number("factor") * (d_a + d_b) / 2.0,
        "smaller_diameter" => number("factor") * d_a.min(d_b),
        other => panic!("an unknown rule {other}"),
    }
}

fn check_clearances(name: &str, result: &Value, rows: &results::Rows) {
    let (specimen, distance) = (&result["request"]["specimen"], &result["request"]["distance"]);
    let size = specimen["size_mm"].as_array().map(|s| [0, 1, 2].map(|k| s[k].as_f64().unwrap()));
    let period = size.filter(|_| specimen["boundary"] == "periodic");

    let (mut least_mm, mut least_slack_mm) = (f64::INFINITY, f64::INFINITY);
    for (i, a) in rows.iter().enumerate() {
        for b in &rows[i + 1..] {
            let squared: f64 = (0..3)
                .map(|k| {
                    let apart = (a[k] - b[k]).abs();
                    // The nearest image; grains are smaller than half the box.
                    period.map_or(apart, |size| apart.min(size[k] - apart)).powi(2)
                })
                .sum();
            let clearance = squared.sqrt() - f64::midpoint(a[3], b[3]);
            least_mm = least_mm.min(clearance);
            least_slack_mm = least_slack_mm.min(clearance - demanded_mm(distance, a[3], b[3]));
        }
    }
    assert!(least_slack_mm >= -ROUNDING_MM, "{name}: a pair is {least_slack_mm} mm short of its distance");
    let reported = &result["check"];
    close(name, "min_gap_mm", &reported["min_gap_mm"], least_mm);
    close(name, "min_excess_gap_mm", &reported["min_excess_gap_mm"], least_slack_mm);

    if let (Some(size), Some(_)) = (size, period) {
        assert!(reported["min_wall_gap_mm"].is_null(), "{name}: a periodic box has no walls");
        assert!(
            rows.iter().all(|row| (0..3).all(|k| (0.0..=size[k]).contains(&row[k]))),
            "{name}: out of the box"
        );
        return;
    }
    let mut least_wall_mm = f64::INFINITY;
    for row in rows {
        let clearance = wall_clearance_mm(specimen, size, row);
        let demanded =
            distance["wall_gap_mm"].as_f64().unwrap_or_else(|| demanded_mm(distance, row[3], row[3]) / 2.0);
        assert!(
            clearance >= demanded - ROUNDING_MM,
            "{name}: {row:?} is {clearance} mm from a wall, not {demanded}"
        );
        least_wall_mm = least_wall_mm.min(clearance);
    }
    close(name, "min_wall_gap_mm", &reported["min_wall_gap_mm"], least_wall_mm);
}

fn wall_clearance_mm(specimen: &Value, size: Option<[f64; 3]>, row: &[f64; 4]) -> f64 {
    let r = row[3] / 2.0;
    if let Some(size) = size {
        return (0..3).map(|k| row[k].min(size[k] - row[k]) - r).fold(f64::INFINITY, f64::min);
    }
    let (diameter, height) =
        (specimen["diameter_mm"].as_f64().unwrap(), specimen["height_mm"].as_f64().unwrap());
    let from_axis = (row[0] - diameter / 2.0).hypot(row[1] - diameter / 2.0);
    (diameter / 2.0 - from_axis - r).min(row[2] - r).min(height - row[2] - r)
}

fn check_volumes(name: &str, result: &Value, rows: &results::Rows) {
    let (specimen, mix, summary) =
        (&result["request"]["specimen"], &result["request"]["mix"], &result["summary"]);
    let specimen_mm3 = match specimen["size_mm"].as_array() {
        Some(size) => size.iter().map(|edge| edge.as_f64().unwrap()).product(),
        None => {
            specimen["diameter_mm"].as_f64().unwrap().powi(2) * PI / 4.0
                * specimen["height_mm"].as_f64().unwrap()
        }
    };
    let volume = |d: f64| PI / 6.0 * d.powi(3);
    let grains_mm3: f64 = rows.iter().map(|row| volume(row[3])).sum();
    close(name, "specimen_volume_mm3", &summary["specimen_volume_mm3"], specimen_mm3);
    close(
        name,
        "volume_fraction_effective",
        &summary["volume_fraction_effective"],
        grains_mm3 / specimen_mm3,
    );
    let smallest = rows.iter().map(|row| row[3]).fold(f64::INFINITY, f64::min);
    let largest = rows.iter().map(|row| row[3]).fold(0.0, f64::max);
    close(name, "d_min_mm", &summary["d_min_mm"], smallest);
    close(name, "d_max_mm", &summary["d_max_mm"], largest);
    assert_eq!(summary["grains"], rows.len(), "{name}");

    // Drawing ends where the volume is reached: it misses by less than the last grain drawn, which is of the
    // smallest of the narrow classes, twelve to an octave.
    if let (Some(fraction), true) =
        (mix["volume_fraction"].as_f64(), mix["volume_fraction_of"] == "placed_grains")
    {
        let missed = (grains_mm3 - fraction * specimen_mm3).abs();
        assert!(missed <= volume(1.06 * smallest), "{name}: the volume is missed by {missed} mm3");
    }
    let classes = summary["classes"].as_array().unwrap();
    let counted: u64 = classes.iter().map(|class| class["grains"].as_u64().unwrap()).sum();
    assert_eq!(counted, rows.len() as u64, "{name}: the classes do not hold every grain");
    // From the largest down, what is drawn so far misses by less than one of the largest grains of its class; a class
    // that begins inside one of the narrow classes of the drawing, by a part of that one too.
    let mut excess_mm3 = 0.0;
    for class in classes.iter().rev().filter(|class| class["grains"] != 0) {
        let (low, high) = (class["d_min_mm"].as_f64().unwrap(), class["d_max_mm"].as_f64().unwrap());
        let target = class["target_volume_mm3"].as_f64().unwrap();
        let inside = |d: &f64| (low..high).contains(d) || *d == largest && largest == high;
        let held: f64 = rows.iter().map(|row| row[3]).filter(inside).map(volume).sum();
        close(name, "volume_mm3", &class["volume_mm3"], held);
        excess_mm3 += held - target;
        let allowed = volume(high) + target / 6.0;
        assert!(
            excess_mm3.abs() <= allowed,
            "{name}: above {low} mm the volume is missed by {excess_mm3} mm3"
        );
    }
}

#[track_caller]
fn close(case: &str, field: &str, reported: &Value, counted: f64) {
    let reported =
        reported.as_f64().unwrap_or_else(|| panic!("{case}: {field} is {reported}, counted {counted}"));
    let error = (reported - counted).abs();
    assert!(
        error <= 1.0e-9 * counted.abs().max(1.0),
        "{case}: {field} is reported as {reported}, counted as {counted}"
    );
}

#[tokio::test]
async fn volume_fractions_follow_from_the_grading() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    // A16 has 21 % below 2 mm (DIN 1045-2).
    let job = json!({
        "seed": 2,
        "specimen": {"type": "box", "size_mm": [60, 60, 60], "boundary": "periodic"},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.40}
    });
    let job = client.succeed(&job).await;
    let summary = &job["result"]["summary"];
    // The last grain drawn is of the class 2..4 mm.
    let last_grain = PI / 6.0 * 64.0 / 216_000.0;
    assert!((summary["volume_fraction_mixture"].as_f64().unwrap() - 0.40).abs() < 1.0e-9, "{summary:#}");
    let effective = summary["volume_fraction_effective"].as_f64().unwrap();
    assert!((effective - 0.40 * 0.79).abs() < last_grain, "{summary:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_mix_that_whole_grains_miss_is_refused_or_warned_of() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let job = |fraction: f64, seed: u64, coarse: bool| {
        json!({
            "seed": seed,
            "specimen": {"type": "box", "size_mm": [100, 100, 100]},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": fraction,
                    "allow_coarse": coarse}
        })
    };
    // One grain of 15 mm has 2300 times this volume.
    let problem =
        client.post("/v1/jobs").json(&job(1e-6, 1, false)).send().await.expect_problem(422, "coarse-mix");
    assert_eq!(problem["errors"][0]["pointer"], "/mix/volume_fraction", "{problem:#}");
    let said = |warnings: &Value, what: &str| {
        warnings.as_array().unwrap().iter().any(|warning| warning.as_str().unwrap().contains(what))
    };
    let submitted = client.submit(&job(1e-6, 1, true)).await;
    assert!(said(&submitted["warnings"], "where 7.9e-7 is requested"), "{submitted:#}");
    let finished = client.finished(id_of(&submitted)).await;
    assert!(said(&finished["warnings"], "volume fraction of 0.00"), "{finished:#}");
    assert!(said(&finished["warnings"], "size classes"), "{finished:#}");
    let summary =
        client.get(&format!("/v1/jobs/{}/result/summary", id_of(&submitted))).send().await.expect(200).json();
    assert_eq!(summary["warnings"], finished["warnings"]);
    assert_eq!(summary["summary"]["method_used"], "rsa");

    // One grain or a little more: whether it misses the volume depends on its size, so that it is the end of the job.
    let mut ends = Vec::new();
    for seed in 0..12 {
        let ended = client.finished(id_of(&client.submit(&job(0.00234, seed, false)).await)).await;
        ends.push(ended["error"]["type"].as_str().map(str::to_owned));
    }
    assert!(ends.contains(&Some("/problems/coarse-mix".into())), "{ends:?}");

    let ample = client.succeed(&job(0.4, 1, false)).await;
    assert_eq!(ample["warnings"], json!([]));
    server.stop().await;
}
