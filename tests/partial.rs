//! Partial results of `packstone run`: kept at a limit, gone on with by `--resume`, and checked at the sizes that they
//! state by a brute force over all pairs.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::harness::packstone;

fn job(stop: &Value, on_limit: &str) -> Value {
    json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [24, 24, 24]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 6, "exponent": 0.5}, "d_min_mm": 2,
                "volume_fraction": 0.55, "volume_fraction_of": "placed_grains"},
        "distance": {"type": "constant", "gap_mm": 0.1},
        "method": {"type": "edmd", "stop": stop},
        "on_limit": on_limit,
    })
}

fn write(folder: &Path, job: &Value) {
    fs::write(folder.join("job.json"), job.to_string()).unwrap();
}

fn result(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("out/result.json")).unwrap()).unwrap()
}

/// The least gap of all pairs of spheres and to the walls of a box of 24 mm.
fn least_gaps(result: &Value) -> [f64; 2] {
    let rows = result["grains"]["rows"].as_array().unwrap();
    let rows: Vec<[f64; 4]> =
        rows.iter().map(|row| std::array::from_fn(|column| row[column].as_f64().unwrap())).collect();
    let [mut pairs, mut walls] = [f64::INFINITY; 2];
    for (i, [x, y, z, d]) in rows.iter().enumerate() {
        for centre in [x, y, z] {
            walls = walls.min(centre - d / 2.0).min(24.0 - centre - d / 2.0);
        }
        for [u, v, w, e] in &rows[..i] {
            let distance = ((x - u).powi(2) + (y - v).powi(2) + (z - w).powi(2)).sqrt();
            pairs = pairs.min(distance - (d + e) / 2.0);
        }
    }
    [pairs, walls]
}

#[tokio::test]
async fn a_partial_result_is_gone_on_with_where_only_limits_have_changed() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let run = ["run", "job.json", "--out", "out", "--format", "json,csv"];
    let resume = [&run[..], &["--resume"]].concat();

    // By default it fails, names what was reached, and offers to keep it.
    write(folder, &job(&json!({"events": 2000}), "fail"));
    let failed = packstone(folder, &run).await;
    assert_eq!(failed.code, Some(4), "{failed:?}");
    assert!(
        failed.stderr.contains("volume fraction 0.") && failed.stderr.contains("on_limit \"keep\""),
        "{failed:?}"
    );

    write(folder, &job(&json!({"events": 2000}), "keep"));
    let kept = packstone(folder, &run).await;
    assert_eq!(kept.code, Some(0), "{kept:?}");
    assert!(kept.stderr.contains("warning: the packing is partial"), "{kept:?}");
    let first = result(folder);
    let partial = &first["summary"]["partial"];
    assert_eq!(partial["reason"], "event_limit");
    assert_eq!(partial["volume_fraction_requested"], 0.55);
    assert_eq!(partial["distance_mm_reached"], 0.1);
    assert!(partial["size_scale"].as_f64().unwrap() < 1.0, "{partial}");
    let [pairs, walls] = least_gaps(&first);
    assert!(pairs >= 0.1 - 1e-12 && walls >= 0.05 - 1e-12, "{pairs} {walls}");
    assert!(pairs < 0.1 + 1e-9 || walls < 0.05 + 1e-9, "a larger scale would do: {pairs} {walls}");
    assert!(folder.join("out/checkpoint.packstone").exists());

    // Its files are not overwritten by chance, and another job does not go on from it.
    let refused = packstone(folder, &run).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("partial result"), "{refused:?}");
    let mut other = job(&json!({"events": 4000}), "keep");
    other["mix"]["volume_fraction"] = json!(0.56);
    write(folder, &other);
    let refused = packstone(folder, &resume).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("another job"), "{refused:?}");
    assert_eq!(result(folder), first);

    // A higher limit goes on and replaces the files; at last without a limit to the end.
    write(folder, &job(&json!({"events": 4000}), "keep"));
    let more = packstone(folder, &resume).await;
    assert_eq!(more.code, Some(0), "{more:?}");
    let second = result(folder);
    let reached = |result: &Value| result["summary"]["volume_fraction_effective"].as_f64().unwrap();
    assert!(reached(&second) > reached(&first), "{} {}", reached(&second), reached(&first));
    assert_eq!(second["statistics"]["edmd"]["resumes"], 1);
    let classes = second["summary"]["classes"].as_array().unwrap();
    let counted: u64 = classes.iter().map(|class| class["grains"].as_u64().unwrap()).sum();
    assert_eq!(counted, second["summary"]["grains"], "at the sizes that they have");

    // A run that fails costs nothing of what was reached, and none starts anew in its place.
    let checkpoint = folder.join("out/checkpoint.packstone");
    write(folder, &job(&json!({"events": 4001}), "fail"));
    let failed = packstone(folder, &resume).await;
    assert_eq!((failed.code, checkpoint.exists()), (Some(4), true), "{failed:?}");
    write(folder, &job(&json!({"events": 300}), "keep"));
    fs::rename(&checkpoint, folder.join("elsewhere")).unwrap();
    let refused = packstone(folder, &resume).await;
    assert!(refused.code == Some(3) && refused.stderr.contains("may reach less"), "{refused:?}");
    assert_eq!(result(folder), second);
    fs::rename(folder.join("elsewhere"), &checkpoint).unwrap();

    let mut whole = job(&json!({}), "fail");
    whole["timeout_s"] = json!(600);
    write(folder, &whole);
    let ended = packstone(folder, &resume).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let last = result(folder);
    assert!(last["summary"].get("partial").is_none() && last["statistics"]["edmd"]["resumes"] == 2);
    let mut left: Vec<String> = fs::read_dir(folder.join("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(left, ["result.csv", "result.json"]);
}

#[tokio::test]
async fn the_time_limit_of_a_job_keeps_what_was_reached() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let run = ["run", "job.json", "--out", "out"];
    let mut slow = job(&json!({}), "keep");
    slow["mix"]["volume_fraction"] = json!(0.74);
    slow["distance"] = json!({"type": "none"});
    slow["timeout_s"] = json!(1.5);
    write(folder, &slow);
    let kept = packstone(folder, &run).await;
    assert_eq!(kept.code, Some(0), "{kept:?}");
    assert_eq!(result(folder)["summary"]["partial"]["reason"], "timed_out");

    slow["on_limit"] = json!("fail");
    write(folder, &slow);
    let failed = packstone(folder, &[&run[..], &["--force"]].concat()).await;
    assert!(failed.code == Some(4) && failed.stderr.contains("longer than the 1.5 s"), "{failed:?}");
}

#[tokio::test]
async fn a_list_of_diameters_is_kept_and_its_failure_gives_advice_that_fits() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let diameters: Vec<f64> = (0..100).map(|i| 1.0 + 0.02 * f64::from(i)).collect();
    let volume: f64 = diameters.iter().map(|d| std::f64::consts::PI / 6.0 * d.powi(3)).sum();
    let edge = (volume / 0.68).cbrt();
    let mut list = json!({
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [edge, edge, edge], "boundary": "periodic"},
        "mix": {"grading": {"type": "diameters", "diameters_mm": diameters}},
    });
    write(folder, &list);
    let run = ["run", "job.json", "--out", "out"];
    let failed = packstone(folder, &run).await;
    assert_eq!(failed.code, Some(4), "{failed:?}");
    assert!(!failed.stderr.contains("lower the volume fraction"), "{failed:?}");
    assert!(failed.stderr.contains("list fewer or smaller diameters"), "{failed:?}");
    list["on_limit"] = json!("keep");
    write(folder, &list);
    let kept = packstone(folder, &run).await;
    assert_eq!(kept.code, Some(0), "{kept:?}");
    let summary = &result(folder)["summary"];
    assert_eq!(summary["partial"]["reason"], "stalled");
    assert!(summary["volume_fraction_effective"].as_f64().unwrap() > 0.6, "{summary}");
}
