//! Effective properties from a mix to the numbers: the command line and the service.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Server, id_of, packstone};

/// Materials of which the grains are stiffer by a factor.
fn materials(contrast: f64) -> Value {
    json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "expansion_1_k": 1.1e-5,
            "conductivity_w_m_k": 1.8},
        "aggregate": {"youngs_modulus_gpa": 25.0 * contrast, "poissons_ratio": 0.25, "expansion_1_k": 8e-6,
            "conductivity_w_m_k": 3},
    })
}

/// A small cube of mortar with spheres.
fn mix() -> Value {
    json!({
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [24, 24, 24]},
        "mix": {"grading": {"type": "standard", "name": "A8"}, "d_min_mm": 4, "volume_fraction": 0.4,
            "allow_coarse": true},
        "distance": {"type": "constant", "gap_mm": 0.4},
    })
}

fn with_materials() -> Value {
    let mut job = mix();
    job["materials"] = materials(2.8);
    job
}

fn read(file: &Path) -> Value {
    serde_json::from_slice(&fs::read(file).unwrap()).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[tokio::test]
async fn one_command_goes_from_a_mix_to_its_properties() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("mix.json"), with_materials().to_string()).unwrap();
    fs::write(folder.join("hard.json"), materials(28.0).to_string()).unwrap();
    let args = ["run", "mix.json", "--out", "out", "--export", "properties:cells=16"];
    let hard = ["--export", "properties:cells=16,kinds=stiffness,conductivity,materials=hard.json"];
    let run = packstone(folder, &[&args[..], &hard].concat()).await;
    assert_eq!(run.code, Some(0), "{run:?}");
    let soft = read(&folder.join("out/result.properties.cells-16.json"));
    let report = read(&folder.join("out/result.properties.cells-16.json.report.json"));
    assert_eq!(report["type"], "properties");
    assert_eq!(report["stiffness"], soft["stiffness"]);
    assert_eq!(soft["cell"]["kind"], "repeated_box");
    let bounds = &soft["stiffness"]["bounds"];
    let e = number(&soft["stiffness"]["isotropic"]["youngs_modulus_gpa"]);
    let [low, high] = ["reuss", "voigt"].map(|name| number(&bounds[name]["youngs_modulus_gpa"]));
    assert!(low < e && e < high, "{soft:#}");
    let alpha = number(&soft["expansion"]["isotropic_1_k"]);
    assert!((8e-6..1.1e-5).contains(&alpha), "{alpha}");
    assert!((1.8..3.0).contains(&number(&soft["conductivity"]["isotropic"])), "{soft:#}");
    let hard = run.stdout.lines().find(|line| line.contains("kinds-stiffness-conductivity")).unwrap();
    let hard = read(&folder.join(hard));
    assert!(number(&hard["stiffness"]["isotropic"]["youngs_modulus_gpa"]) > 1.05 * e, "{hard:#}");
    assert_eq!(hard.get("expansion"), None);

    let plan = packstone(folder, &["plan", "mix.json", "properties:cells=256"]).await;
    assert_eq!(plan.code, Some(0), "{plan:?}");
    let plan: Value = serde_json::from_str(&plan.stdout).unwrap();
    let estimate = &plan["exports"][0]["estimate"]["computation"];
    let fields = 4.0 * 3.0 * 256_f64.powi(3);
    let memory = number(&estimate["memory_bytes"]);
    assert!(
        memory > 9.0 * fields && memory < 14.0 * fields && number(&estimate["cpu_s"]) > 1.0,
        "{estimate:#}"
    );

    fs::write(folder.join("bare.json"), mix().to_string()).unwrap();
    let bare = ["run", "bare.json", "--out", "bare", "--export", "properties"];
    let refused = packstone(folder, &bare).await;
    assert_eq!((refused.code, folder.join("bare").exists()), (Some(3), false), "{refused:?}");
    assert!(refused.stderr.contains("\"youngs_modulus_gpa\": 25"), "{refused:?}");
}

#[tokio::test]
async fn the_service_makes_the_same_file_and_names_what_is_missing() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client: Client = server.client();
    let job = client.succeed(&with_materials()).await;
    let path = |job: &Value, query: &str| format!("/v1/jobs/{}/exports/properties?{query}", id_of(job));
    let file = client.get(&path(&job, "cells=12&kinds=stiffness")).send().await.expect(200).body.clone();
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("mix.json"), with_materials().to_string()).unwrap();
    let run = packstone(
        folder,
        &["run", "mix.json", "--out", "out", "--export", "properties:cells=12,kinds=stiffness"],
    )
    .await;
    assert_eq!(run.code, Some(0), "{run:?}");
    let of_command = run.stdout.lines().find(|line| line.contains("properties")).unwrap();
    assert_eq!(file, fs::read(folder.join(of_command)).unwrap());

    for (query, pointer) in [("cells=7", "cells"), ("kinds=mass", "kinds"), ("tolerance=0", "tolerance")] {
        let problem = client.get(&path(&job, query)).send().await;
        let problem = problem.expect_problem(400, "validation-error");
        assert!(problem.to_string().contains(pointer), "{query}: {problem:#}");
    }
    let bare = client.succeed(&mix()).await;
    let refused = client.get(&path(&bare, "cells=12")).send().await;
    let problem = refused.expect_problem(422, "validation-error");
    assert!(problem.to_string().contains("youngs_modulus_gpa"), "{problem:#}");
    let mut with_properties = mix();
    with_properties["postprocess"] = json!({"type": "properties", "cells": 12});
    client.post("/v1/jobs").json(&with_properties).send().await.expect_problem(422, "validation-error");
    with_properties["postprocess"]["materials"] = materials(2.8);
    let done = client.succeed(&with_properties).await;
    let options = format!("cells=12&materials={}", urlencode(&materials(2.8).to_string()));
    let file = client.get(&path(&done, &options)).send().await.expect(200).body.clone();
    let file: Value = serde_json::from_slice(&file).unwrap();
    assert!(number(&file["stiffness"]["isotropic"]["youngs_modulus_gpa"]) > 25.0, "{file:#}");
    server.stop().await;
}

/// Text as a value in a query.
pub(crate) fn urlencode(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02X}")).collect::<Vec<_>>().concat()
}
