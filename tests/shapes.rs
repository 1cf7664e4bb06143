//! Grains that are not spheres, as a client asks for them and finds them in results, exports and refusals.

use serde_json::{Value, json};

use crate::harness::{DataDir, Launch, id_of, jobs};

fn shaped(seed: u64) -> Value {
    let ratios = json!({"type": "constant", "b_over_a": 0.8, "c_over_a": 0.5});
    jobs::with(jobs::quick(seed), "/mix/shape", json!({"type": "ellipsoid", "ratios": ratios}))
}

#[tokio::test]
async fn ellipsoids_come_back_in_every_table_and_export_that_has_them() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    for method in ["rsa", "monte_carlo", "auto"] {
        let job = jobs::with(shaped(5), "/method", json!({"type": method}));
        let finished = client.succeed(&job).await;
        let id = id_of(&finished);
        let result = client.result(id).await;
        let used = result["summary"]["method_used"].as_str().unwrap();
        assert_eq!(used, if method == "auto" { "rsa" } else { method });
        let columns = json!([
            "x_mm", "y_mm", "z_mm", "d_mm", "sieve_mm", "qw", "qx", "qy", "qz", "a_mm", "b_mm", "c_mm"
        ]);
        assert_eq!(result["grains"]["columns"], columns);
        let rows = result["grains"]["rows"].as_array().unwrap();
        assert_eq!(result["summary"]["grains"], rows.len());
        for row in rows {
            let row: Vec<f64> = row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
            let [d, sieve, a, b, c] = [3, 4, 9, 10, 11].map(|i| row[i]);
            assert!((b / a - 0.8).abs() < 1e-12 && (c / a - 0.5).abs() < 1e-12, "{row:?}");
            assert!((d.powi(3) / (8.0 * a * b * c) - 1.0).abs() < 1e-12, "{row:?}");
            assert!((sieve.powi(2) / (2.0 * (b * b + c * c)) - 1.0).abs() < 1e-12, "{row:?}");
            // The 0.2 mm between grains are 0.1 mm to the walls.
            assert!(row[..3].iter().all(|x| *x > 0.1 + c && *x < 39.9 - c), "{row:?}");
        }
        assert!(result["check"]["min_gap_mm"].as_f64().unwrap() >= 0.2, "{:#}", result["check"]);
        assert_eq!(result["shapes"]["zingg"]["disc"], 1.0, "{:#}", result["shapes"]);
        let get = |path: &str| client.get(&format!("/v1/jobs/{id}/{path}"));
        let csv = String::from_utf8(get("result?format=csv").send().await.expect(200).body.to_vec()).unwrap();
        assert_eq!(csv.lines().count(), rows.len() + 1);
        for format in ["npy", "vtk", "vtp"] {
            let length = get(&format!("result?format={format}")).send().await.expect(200).body.len();
            assert!(length > 8 * 12 * rows.len(), "{format}: {length}");
        }
        let voxels =
            get("exports/voxels?format=raw&cells=40&label=grain").send().await.expect(200).body.clone();
        let labelled = voxels.chunks(4).filter(|label| **label != [0; 4]).count() as f64 / 64_000.0;
        let fraction = result["summary"]["volume_fraction_effective"].as_f64().unwrap();
        assert!((labelled / fraction - 1.0).abs() < 0.03, "{labelled} {fraction}");
        let refused = get("exports/mesh?format=geo").send().await.expect(422).json();
        assert_eq!(refused["type"], "/problems/format-not-available", "{refused:#}");
        assert!(refused["detail"].as_str().unwrap().contains("spheres alone"), "{refused:#}");
        assert!(get("exports/ldpm?format=tets").send().await.expect(200).body.len() > 48 * rows.len());
        let slice = get("exports/slice?format=json").send().await.expect(200).json();
        assert!(slice["ellipses"]["rows"].as_array().unwrap().len() > 10, "{slice:#}");
        assert!(!get("exports/mesh?format=msh&segments=8").send().await.expect(200).body.is_empty());
        assert!(get("plots/grading").send().await.expect(200).body.starts_with(b"<svg"));
    }
    server.stop().await;
}

#[tokio::test]
async fn what_cannot_be_packed_is_refused_with_its_place() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let ratios = |ratios: Value| {
        jobs::with(jobs::quick(1), "/mix/shape", json!({"type": "ellipsoid", "ratios": ratios}))
    };
    for (job, pointer) in [
        (jobs::with(shaped(1), "/method", json!({"type": "edmd"})), "/method/type"),
        (jobs::with(jobs::quick(1), "/method", json!({"type": "monte_carlo"})), "/method/type"),
        (jobs::with(jobs::quick(1), "/mix/shape", json!({"type": "polyhedron"})), "/mix/shape/type"),
        (jobs::with(jobs::quick(1), "/mix/shape", json!({"type": "cube"})), "/mix/shape/type"),
        (
            ratios(json!({"type": "constant", "b_over_a": 0.01, "c_over_a": 0.5})),
            "/mix/shape/ratios/b_over_a",
        ),
        (ratios(json!({"type": "triangle", "k": 2})), "/mix/shape/ratios/k"),
        (jobs::with(jobs::quick(1), "/mix/shapes", json!([])), "/mix/shapes"),
    ] {
        let refused = client.post("/v1/jobs").json(&job).send().await.expect(422).json();
        let pointers: Vec<&Value> =
            refused["errors"].as_array().unwrap().iter().map(|e| &e["pointer"]).collect();
        assert!(pointers.contains(&&json!(pointer)), "{pointer}: {refused:#}");
    }
    server.stop().await;
}
