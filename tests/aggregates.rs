//! Mixes of several aggregates, as a client asks for them and finds them in results, tables and refusals.

use serde_json::{Value, json};

use crate::harness::{DataDir, Launch, id_of, jobs};

/// Gravel of this shape, equal beads, and sand that is finer than the cut-off.
fn job(shape: Option<Value>) -> Value {
    let mut gravel = json!({
        "name": "gravel", "share": 0.6, "density_kg_m3": 2600.0,
        "grading": {"type": "sieves", "points": [[4.0, 0.0], [8.0, 0.4], [12.0, 1.0]]},
    });
    if let Some(shape) = shape {
        gravel["shape"] = shape;
    }
    let mix = json!({
        "d_min_mm": 3.0, "volume_fraction": 0.4,
        "aggregates": [
            gravel,
            {"name": "beads", "share": 0.2, "density_kg_m3": 2500.0,
             "grading": {"type": "monodisperse", "diameter_mm": 5.0}},
            {"name": "sand", "share": 0.2, "density_kg_m3": 2650.0,
             "grading": {"type": "sieves", "points": [[0.1, 0.0], [2.0, 1.0]]}},
        ],
    });
    jobs::with(jobs::quick(1), "/mix", mix)
}

#[tokio::test]
async fn the_aggregate_of_every_grain_stands_in_every_table() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let ellipsoid =
        json!({"type": "ellipsoid", "ratios": {"type": "constant", "b_over_a": 0.8, "c_over_a": 0.5}});
    for shape in [None, Some(ellipsoid)] {
        let finished = client.succeed(&job(shape.clone())).await;
        let id = id_of(&finished);
        let result = client.result(id).await;
        let columns = result["grains"]["columns"].as_array().unwrap();
        assert_eq!(columns.last().unwrap(), "aggregate", "{columns:?}");
        let rows = result["grains"]["rows"].as_array().unwrap();
        let reported = result["summary"]["aggregates"].as_array().unwrap();
        assert_eq!(reported.len(), 3);
        for (index, aggregate) in reported.iter().enumerate() {
            let own = rows.iter().filter(|row| row.as_array().unwrap().last().unwrap() == index);
            assert_eq!(aggregate["grains"], own.clone().count(), "{aggregate:#}");
            let volume_mm3: f64 =
                own.map(|row| std::f64::consts::FRAC_PI_6 * row[3].as_f64().unwrap().powi(3)).sum();
            let reported_mm3 = aggregate["volume_mm3"].as_f64().unwrap();
            assert!((volume_mm3 - reported_mm3).abs() <= 1e-9 * volume_mm3, "{volume_mm3} {aggregate:#}");
            let mass_kg = aggregate["mass_kg"].as_f64().unwrap();
            let density = [2600.0, 2500.0, 2650.0][index];
            assert!((mass_kg - density * 1e-9 * reported_mm3).abs() <= 1e-12, "{aggregate:#}");
        }
        assert_eq!((&reported[1]["name"], &reported[2]["grains"]), (&json!("beads"), &json!(0)));
        assert_eq!((&reported[0]["share"], &reported[2]["mass_kg"]), (&json!(0.6), &json!(0.0)));
        let get = |path: &str| client.get(&format!("/v1/jobs/{id}/{path}"));
        let csv = String::from_utf8(get("result?format=csv").send().await.expect(200).body.to_vec()).unwrap();
        assert!(csv.lines().next().unwrap().ends_with(",aggregate"));
        assert!(csv.lines().nth(1).unwrap().ends_with(",0"), "{csv}");
        for format in ["vtk", "vtp"] {
            let body = get(&format!("result?format={format}")).send().await.expect(200).body.clone();
            assert!(body.windows(9).any(|bytes| bytes == b"aggregate"), "{format}");
        }
        let npy = get("result?format=npy").send().await.expect(200).body.len();
        assert!(npy > 8 * columns.len() * rows.len());
        assert!(get("plots/grading").send().await.expect(200).body.starts_with(b"<svg"));
        assert!(!get("exports/mesh?format=msh&segments=8").send().await.expect(200).body.is_empty());
    }
    server.stop().await;
}

#[tokio::test]
async fn plans_count_all_aggregates_and_faults_name_their_place() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let plan = client.post("/v1/plans").json(&job(None)).send().await.expect(200).json();
    let edges: Vec<f64> =
        plan["classes"].as_array().unwrap().iter().map(|class| class["d_max_mm"].as_f64().unwrap()).collect();
    assert_eq!(edges, [5.0, 8.0, 12.0], "{plan:#}");
    assert!((plan["volume_fraction_effective"].as_f64().unwrap() - 0.32).abs() < 1e-12, "{plan:#}");

    let faulty = jobs::with(job(None), "/mix/aggregates/1/share", json!(0.3));
    let refused = client.post("/v1/jobs").json(&faulty).send().await;
    let problem = refused.expect_problem(422, "validation-error");
    assert_eq!(problem["errors"][0]["pointer"], "/mix/aggregates", "{problem:#}");
    assert_eq!(problem["errors"][0]["detail"], "the shares sum to 1.1: must sum to 1", "{problem:#}");
    server.stop().await;
}
