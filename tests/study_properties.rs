//! Effective properties of the runs of a study: columns, plots and the representative volume, of the service, of worker
//! processes and of the command line.

use std::fs;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::results::json_in as read;
use crate::harness::{Client, DataDir, Launch, Running, id_of, packstone};

const PROPERTIES: [&str; 6] = [
    "youngs_modulus_gpa",
    "poissons_ratio",
    "bulk_modulus_gpa",
    "shear_modulus_gpa",
    "universal_anisotropy",
    "conductivity_w_m_k",
];

fn materials() -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "conductivity_w_m_k": 1.8},
        "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.25, "conductivity_w_m_k": 3.2},
    })
}

/// Cubes of two edges with as many voxels to the mm, three packings each; without materials and properties.
fn bare() -> Value {
    json!({
        "seed": 3, "replicates": 3,
        "template": {
            "specimen": {"type": "box", "size_mm": [12, 12, 12], "boundary": "periodic"},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 5}, "volume_fraction": 0.25,
                "allow_coarse": true},
        },
        "grid": {"/specimen/size_mm": [[12, 12, 12], [18, 18, 18]]},
    })
}

fn study() -> Value {
    let mut study = bare();
    study["template"]["materials"] = materials();
    study["template"]["postprocess"] = json!([{"type": "properties", "cells": 8}]);
    study["grid"] = json!({});
    study["zip"] = json!({
        "/specimen/size_mm": [[12, 12, 12], [18, 18, 18]], "/postprocess/0/cells": [8, 12]
    });
    study
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

/// The columns of properties of each row.
fn of_properties(table: &Value) -> Vec<Vec<Value>> {
    let columns =
        || PROPERTIES.iter().flat_map(|name| ["mean", "std", "count"].map(|of| format!("{name}_{of}")));
    let rows = table["rows"].as_array().unwrap();
    rows.iter().map(|row| columns().map(|column| row[&column].clone()).collect()).collect()
}

/// The table once the properties of all runs are there.
async fn table_of(client: &Client, id: &str, runs: u64) -> Value {
    let is_whole = |table: &Value| {
        table["rows"]
            .as_array()
            .unwrap()
            .iter()
            .all(|row| row["youngs_modulus_gpa_count"] == runs && row["properties_waiting"] == 0)
    };
    client.when(&format!("/v1/studies/{id}/table"), "with all properties", is_whole).await
}

/// The reports of the properties of each job, with the point of the job.
async fn reports(client: &Client, id: &str) -> Vec<(usize, Value)> {
    let mut reports = Vec::new();
    for job in client.jobs_of(id).await {
        let exports =
            client.get(&format!("/v1/jobs/{}/exports", id_of(&job))).send().await.expect(200).json();
        let point = usize::try_from(job["point"].as_u64().unwrap()).unwrap();
        for export in exports["items"].as_array().unwrap() {
            reports.push((point, export["report"].clone()));
        }
    }
    reports
}

#[tokio::test]
async fn a_study_has_its_properties_their_scatter_and_the_representative_volume() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let submitted = client.submit_study(&study()).await;
    let id = id_of(&submitted).to_owned();
    client.study_finished(&id).await;
    let table = table_of(&client, &id, 3).await;

    // Mean and deviation of what the exports report.
    let reports = reports(&client, &id).await;
    assert_eq!(reports.len(), 6);
    for (point, row) in table["rows"].as_array().unwrap().iter().enumerate() {
        let moduli: Vec<f64> = reports
            .iter()
            .filter(|(of, _)| *of == point)
            .map(|(_, report)| number(&report["stiffness"]["isotropic"]["youngs_modulus_gpa"]))
            .collect();
        let mean = moduli.iter().sum::<f64>() / 3.0;
        let squares: f64 = moduli.iter().map(|modulus| (modulus - mean).powi(2)).sum();
        assert!((number(&row["youngs_modulus_gpa_mean"]) - mean).abs() < 1e-9, "{row:#}");
        assert!((number(&row["youngs_modulus_gpa_std"]) - (squares / 2.0).sqrt()).abs() < 1e-9, "{row:#}");
        assert!(number(&row["youngs_modulus_gpa_std"]) > 0.0 && (25.0..70.0).contains(&mean), "{row:#}");
        assert!((1.8..3.2).contains(&number(&row["conductivity_w_m_k_mean"])), "{row:#}");
        assert_eq!(row.get("diffusivity_m2_s_mean"), None, "no material has one");
    }
    // Moduli, expansion has no material, conductivity: of the volumes of 12 and 18 mm.
    let volumes = table["representative_volumes"].as_array().unwrap();
    let names: Vec<&str> = volumes.iter().map(|of| of["property"].as_str().unwrap()).collect();
    assert_eq!(names, PROPERTIES);
    let of_modulus = &volumes[0];
    assert_eq!(of_modulus["values"], json!({}));
    let edges: Vec<f64> =
        of_modulus["volumes"].as_array().unwrap().iter().map(|of| number(&of["edge_mm"])).collect();
    assert!((edges[0] - 12.0).abs() < 1e-9 && (edges[1] - 18.0).abs() < 1e-9, "{of_modulus:#}");
    let fraction: f64 =
        reports.iter().map(|(_, report)| number(&report["phases"][1]["exact_share"])).sum::<f64>() / 6.0;
    let variance = number(&of_modulus["phase_variance"]);
    assert!(
        (variance / (fraction * (1.0 - fraction) * 45.0 * 45.0) - 1.0).abs() < 0.01,
        "{variance} {fraction}"
    );

    let csv = client.get(&format!("/v1/studies/{id}/table?format=csv")).send().await;
    let csv = String::from_utf8(csv.expect(200).body.to_vec()).unwrap();
    let header = csv.lines().next().unwrap();
    assert!(header.ends_with(",conductivity_w_m_k_count,properties_waiting"), "{header}");
    for kind in ["youngs_modulus", "conductivity", "representative_volume"] {
        let plot = client.get(&format!("/v1/studies/{id}/plots/{kind}")).send().await;
        assert!(String::from_utf8_lossy(&plot.expect(200).body).contains("<svg"), "{kind}");
    }
    let none = client.get(&format!("/v1/studies/{id}/plots/diffusivity")).send().await;
    none.expect_problem(422, "format-not-available");

    // What a client requests later is no part of the study; a job that is deleted stays in the table.
    let job = client.jobs_of(&id).await.remove(0);
    let later = format!("/v1/jobs/{}/exports/properties?cells=10", id_of(&job));
    client.get(&later).send().await.expect(200);
    client.delete(&format!("/v1/jobs/{}", id_of(&job))).send().await.expect(204);
    let after = client.get(&format!("/v1/studies/{id}/table")).send().await.expect(200).json();
    assert_eq!(of_properties(&after), of_properties(&table));
    server.stop().await;

    // The command line computes the same numbers.
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("study.json"), study().to_string()).unwrap();
    let ended = packstone(directory.path(), &["study", "study.json", "--out", "out"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let here = read(&directory.path().join("out/table.json"));
    assert_eq!(of_properties(&here), of_properties(&table));
    assert_eq!(here["representative_volumes"], table["representative_volumes"]);
    assert!(ended.stdout.contains("E GPa") && ended.stdout.contains("W/(m K)"), "{}", ended.stdout);
    for kind in ["youngs_modulus", "conductivity", "representative_volume"] {
        assert!(directory.path().join(format!("out/plot-{kind}.svg")).exists(), "{kind}");
    }
}

#[tokio::test]
async fn properties_that_workers_compute_are_those_of_the_study() {
    let (data_dir, folder) = (DataDir::new(), tempfile::tempdir().unwrap());
    let server = Launch::new(&data_dir).workers(0).start().await;
    let client = server.client();
    let url = format!("http://{}", server.address());
    let worker =
        Running::spawn(folder.path(), &["worker", "--server", &url, "--name", "first", "--slots", "2"]);
    let mut two = study();
    two["replicates"] = json!(2);
    let id = id_of(&client.submit_study(&two).await).to_owned();
    client.study_finished(&id).await;
    let table = table_of(&client, &id, 2).await;
    let job = client.jobs_of(&id).await.remove(0);
    let exports = client.get(&format!("/v1/jobs/{}/exports", id_of(&job))).send().await.expect(200).json();
    assert_eq!(exports["items"][0]["worker"], "first", "{exports:#}");
    worker.signal(Signal::TERM);
    assert_eq!(worker.ended().await.code, Some(0));
    server.stop().await;
    // On shards as on one machine.
    fs::write(folder.path().join("study.json"), two.to_string()).unwrap();
    for part in ["--shard=0/2", "--shard=1/2", "--merge"] {
        let ended = packstone(folder.path(), &["study", "study.json", "--out", "out", part]).await;
        assert_eq!(ended.code, Some(0), "{part}: {ended:?}");
    }
    assert_eq!(of_properties(&read(&folder.path().join("out/table.json"))), of_properties(&table));
}

#[tokio::test]
async fn materials_and_exports_are_given_on_the_command_line_and_recorded() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("study.json"), bare().to_string()).unwrap();
    fs::write(folder.join("materials.json"), materials().to_string()).unwrap();
    let mut soft = materials();
    soft["aggregate"]["youngs_modulus_gpa"] = json!(30);
    fs::write(folder.join("soft.json"), soft.to_string()).unwrap();
    let run = async |more: &[&str]| {
        let args = ["study", "study.json", "--out", "out", "--export", "properties:cells=8,kinds=stiffness"];
        packstone(folder, &[&args[..], more].concat()).await
    };
    let refused = run(&[]).await;
    assert_eq!(refused.code, Some(3), "{refused:?}");
    assert!(refused.stderr.contains("/template/postprocess/0/materials"), "{}", refused.stderr);
    assert!(refused.stderr.contains("youngs_modulus_gpa"), "with an example: {}", refused.stderr);
    let given = run(&["--materials", "materials.json"]).await;
    assert_eq!(given.code, Some(0), "{given:?}");
    let table = read(&folder.join("out/table.json"));
    // The fit may name a cube that no grain fits in: the terminal names none below the smallest of the study.
    for volume in table["representative_volumes"].as_array().unwrap() {
        let smallest = number(&volume["volumes"][0]["edge_mm"]);
        let Some(edge) = volume["edge_mm"].as_f64() else { continue };
        let words = format!("{}: one cube of the smallest edge, ", volume["property"].as_str().unwrap());
        assert_eq!(given.stdout.contains(&words), edge < smallest, "{words}: {}", given.stdout);
    }
    let rows = &table["rows"];
    assert_eq!(
        (&rows[0]["youngs_modulus_gpa_count"], rows[0].get("conductivity_w_m_k_mean")),
        (&json!(3), None)
    );
    let recorded = read(&folder.join("out/study.json"))["request"]["template"]["materials"].take();
    let aggregate = &recorded["aggregate"];
    assert_eq!(
        (number(&aggregate["youngs_modulus_gpa"]), number(&aggregate["poissons_ratio"])),
        (70.0, 0.25)
    );
    let other = run(&["--materials", "soft.json", "--resume"]).await;
    assert_eq!(other.code, Some(3), "{other:?}");
    assert!(other.stderr.contains("/template/materials/aggregate/youngs_modulus_gpa"), "{}", other.stderr);
    let missing = run(&["--materials", "none.json", "--fresh"]).await;
    assert!(missing.code != Some(0) && missing.stderr.contains("none.json"), "{missing:?}");
}
