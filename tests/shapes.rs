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
        let view = get("result?format=view").send().await.expect(200).body.len();
        assert_eq!(view, 64 + 24 * rows.len());
        let voxels =
            get("exports/voxels?format=raw&cells=40&label=grain").send().await.expect(200).body.clone();
        let labelled = voxels.chunks(4).filter(|label| **label != [0; 4]).count() as f64 / 64_000.0;
        let fraction = result["summary"]["volume_fraction_effective"].as_f64().unwrap();
        assert!((labelled / fraction - 1.0).abs() < 0.03, "{labelled} {fraction}");
        let script = get("exports/mesh?format=geo&segments=32").send().await.expect(200).body.clone();
        assert_eq!(String::from_utf8_lossy(&script).matches("Affine {").count(), rows.len());
        assert!(get("exports/ldpm?format=tets").send().await.expect(200).body.len() > 48 * rows.len());
        let slice = get("exports/slice?format=json").send().await.expect(200).json();
        assert!(slice["ellipses"]["rows"].as_array().unwrap().len() > 10, "{slice:#}");
        assert!(!get("exports/mesh?format=msh&segments=8").send().await.expect(200).body.is_empty());
        for plot in ["grading", "radial", "profile", "zingg", "flakiness", "quality"] {
            let drawn = get(&format!("plots/{plot}")).send().await;
            assert!(drawn.expect(200).body.starts_with(b"<svg"), "{plot}");
        }
    }
    server.stop().await;
}

fn polyhedra(fields: Value) -> Value {
    let mut shape = fields;
    shape["type"] = json!("polyhedron");
    jobs::with(jobs::quick(1), "/mix/shape", shape)
}

#[tokio::test]
async fn polyhedra_come_back_in_every_table_and_export_that_has_them() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    for (method, rounding) in [("rsa", 0.0), ("monte_carlo", 0.1)] {
        let shape =
            json!({"rounding": rounding, "template_count": 6, "ratios": {"type": "triangle", "k": 0.5}});
        let finished =
            client.succeed(&jobs::with(polyhedra(shape), "/method", json!({"type": method}))).await;
        let id = id_of(&finished);
        let result = client.result(id).await;
        assert_eq!(result["summary"]["method_used"], method);
        let columns = json!(["x_mm", "y_mm", "z_mm", "d_mm", "sieve_mm", "qw", "qx", "qy", "qz", "template"]);
        assert_eq!(result["grains"]["columns"], columns);
        let rows = result["grains"]["rows"].as_array().unwrap();
        assert_eq!(result["summary"]["grains"], rows.len());
        let templates = result["templates"].as_array().unwrap();
        assert_eq!(templates.len(), 6);
        for row in rows {
            let template = row[9].as_f64().unwrap();
            assert!(template < 6.0 && template.fract() == 0.0 && row[3].as_f64() > Some(0.0), "{row}");
        }
        assert!(result["check"]["min_gap_mm"].as_f64().unwrap() >= 0.2, "{:#}", result["check"]);
        assert!(result["shapes"]["sphericity_mean"].as_f64() < Some(1.0), "{:#}", result["shapes"]);
        let get = |path: &str| client.get(&format!("/v1/jobs/{id}/{path}"));
        let csv = String::from_utf8(get("result?format=csv").send().await.expect(200).body.to_vec()).unwrap();
        assert_eq!(csv.lines().count(), rows.len() + 1);
        for format in ["npy", "vtk", "vtp"] {
            let length = get(&format!("result?format={format}")).send().await.expect(200).body.len();
            assert!(length > 8 * 10 * rows.len(), "{format}: {length}");
        }
        let voxels =
            get("exports/voxels?format=raw&cells=40&label=grain").send().await.expect(200).body.clone();
        let labelled = voxels.chunks(4).filter(|label| **label != [0; 4]).count() as f64 / 64_000.0;
        let fraction = result["summary"]["volume_fraction_effective"].as_f64().unwrap();
        assert!((labelled / fraction - 1.0).abs() < 0.03, "{labelled} {fraction}");
        let slice = get("exports/slice?format=json").send().await.expect(200).json();
        assert!(slice["polygons"]["rows"].as_array().unwrap().len() > 10, "{slice:#}");
        assert!(!get("exports/mesh?format=msh&segments=8").send().await.expect(200).body.is_empty());
        assert!(get("exports/ldpm?format=tets").send().await.expect(200).body.len() > 48 * rows.len());
        for plot in ["grading", "radial", "profile", "zingg", "flakiness", "quality"] {
            let drawn = get(&format!("plots/{plot}")).send().await;
            assert!(drawn.expect(200).body.starts_with(b"<svg"), "{plot}");
        }
        let picture = get("exports/slice?format=png").send().await.expect(200).body.clone();
        assert!(picture.starts_with(b"\x89PNG"));
    }
    server.stop().await;
}

/// Spheres below 4 mm, ellipsoids and polyhedra above.
fn mixed() -> Value {
    let polyhedron = json!({"type": "polyhedron", "rounding": 0.05, "template_count": 5});
    let ratios = json!({"type": "triangle", "k": 0.4});
    jobs::with(
        jobs::quick(3),
        "/mix/shapes",
        json!([
            {"above_mm": 4, "shape": {"type": "mixture", "of": [
                {"share": 0.5, "shape": polyhedron},
                {"share": 0.5, "shape": {"type": "ellipsoid", "ratios": ratios}}]}},
            {"above_mm": 0, "shape": {"type": "sphere"}}
        ]),
    )
}

#[tokio::test]
async fn spheres_ellipsoids_and_polyhedra_are_packed_together() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    let dense = jobs::with(
        jobs::with(mixed(), "/mix/volume_fraction", json!(0.5)),
        "/method",
        json!({"type": "monte_carlo"}),
    );
    for (job, method) in [(mixed(), "rsa"), (dense, "monte_carlo")] {
        let planned = client.post("/v1/plans").json(&job).send().await.expect(200).json();
        assert!(planned["estimated_time_s"].as_f64() > Some(0.0), "{planned:#}");
        let finished = client.succeed(&job).await;
        let id = id_of(&finished);
        let result = client.result(id).await;
        assert_eq!(result["summary"]["method_used"], method);
        let columns = json!([
            "x_mm", "y_mm", "z_mm", "d_mm", "sieve_mm", "qw", "qx", "qy", "qz", "a_mm", "b_mm", "c_mm",
            "template"
        ]);
        assert_eq!(result["grains"]["columns"], columns);
        let rows = result["grains"]["rows"].as_array().unwrap();
        assert_eq!(result["summary"]["grains"], rows.len());
        assert_eq!(result["templates"].as_array().unwrap().len(), 5);
        let (mut spheres, mut ellipsoids, mut polyhedra) = (0, 0, 0);
        for row in rows {
            let row: Vec<f64> = row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
            let [d, sieve, a, b, c, template] = [3, 4, 9, 10, 11, 12].map(|i| row[i]);
            if template >= 0.0 {
                polyhedra += 1;
                assert!(template < 5.0 && template.fract() == 0.0 && [a, b, c] == [0.0; 3], "{row:?}");
                assert!(sieve > 4.0, "{row:?}");
                continue;
            }
            assert_eq!(template, -1.0, "{row:?}");
            assert!((d.powi(3) / (8.0 * a * b * c) - 1.0).abs() < 1e-12 && a >= b && b >= c, "{row:?}");
            if sieve <= 4.0 {
                spheres += 1;
                assert!(a == c, "{row:?}");
            } else {
                ellipsoids += 1;
            }
        }
        assert!(spheres > 50 && ellipsoids > 5 && polyhedra > 5, "{spheres} {ellipsoids} {polyhedra}");
        assert!(result["check"]["min_gap_mm"].as_f64().unwrap() >= 0.2, "{:#}", result["check"]);
        let shapes = &result["shapes"];
        assert!(
            shapes["sphericity_mean"].as_f64() < Some(1.0) && shapes["surface_mm2"].as_f64() > Some(1e4),
            "{shapes:#}"
        );
        let get = |path: &str| client.get(&format!("/v1/jobs/{id}/{path}"));
        let csv = String::from_utf8(get("result?format=csv").send().await.expect(200).body.to_vec()).unwrap();
        assert_eq!(csv.lines().count(), rows.len() + 1);
        let npy = get("result?format=npy").send().await.expect(200).body.len();
        assert_eq!((npy - 128) / (8 * 13), rows.len());
        for format in ["vtk", "vtp"] {
            // Each sphere and ellipsoid has 42 points.
            let length = get(&format!("result?format={format}")).send().await.expect(200).body.len();
            assert!(length > 24 * 42 * (spheres + ellipsoids), "{format}: {length}");
        }
        let voxels =
            get("exports/voxels?format=raw&cells=40&label=grain").send().await.expect(200).body.clone();
        let labelled = voxels.chunks(4).filter(|label| **label != [0; 4]).count() as f64 / 64_000.0;
        let fraction = result["summary"]["volume_fraction_effective"].as_f64().unwrap();
        assert!((labelled / fraction - 1.0).abs() < 0.03, "{labelled} {fraction}");
        let slice = get("exports/slice?format=json").send().await.expect(200).json();
        for (table, count) in [("ellipses", "ellipse_count"), ("polygons", "polygon_count")] {
            let found = slice[table]["rows"].as_array().unwrap().len();
            assert!(found > 3 && slice[count] == found, "{slice:#}");
        }
        for format in ["svg", "png", "geo"] {
            assert!(!get(&format!("exports/slice?format={format}")).send().await.expect(200).body.is_empty());
        }
        for format in ["msh", "stl"] {
            let path = format!("exports/mesh?format={format}&segments=8");
            assert!(!get(&path).send().await.expect(200).body.is_empty());
        }
        let script = get("exports/mesh?format=geo&segments=32").send().await.expect(200).body.clone();
        let script = String::from_utf8_lossy(&script);
        assert!(script.contains("Affine {") && script.contains("Plane Surface"), "{script}");
        assert!(get("exports/ldpm?format=tets").send().await.expect(200).body.len() > 48 * rows.len());
        assert!(get("plots/grading").send().await.expect(200).body.starts_with(b"<svg"));
    }
    server.stop().await;
}

#[tokio::test]
async fn polyhedra_have_plans() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let capabilities = client.get("/v1/capabilities").send().await.expect(200).json();
    assert!(capabilities["shapes"].as_array().unwrap().contains(&json!("polyhedron")), "{capabilities:#}");
    for preset in capabilities["shape_presets"].as_array().unwrap() {
        assert!(preset["source"].as_str().unwrap().len() > 20, "{preset:#}");
        let by_name = json!({"type": "preset", "name": preset["name"]});
        let roomy = jobs::with(jobs::quick(1), "/specimen/size_mm", json!([60, 60, 60]));
        let loose = jobs::with(roomy, "/mix/volume_fraction", json!(0.2));
        let job = client.succeed(&jobs::with(loose, "/mix/shape", by_name)).await;
        assert_eq!(client.request_of(id_of(&job)).await["mix"]["shape"], preset["shape"]);
    }
    let plan = async |job: Value| client.post("/v1/plans").json(&job).send().await.expect(200).json();
    let spheres = plan(jobs::quick(1)).await;
    for fields in [
        json!({}),
        json!({"faces": 60, "rounding": 0.1, "ratios": {"type": "triangle", "k": 0.3}}),
        json!({"template": "deformed_cuboid"}),
        json!({"template": "voronoi", "template_count": 4, "template_seed": 3}),
    ] {
        for method in ["rsa", "monte_carlo", "auto"] {
            let job = jobs::with(polyhedra(fields.clone()), "/method", json!({"type": method}));
            let planned = plan(job).await;
            let number = |plan: &Value, name: &str| plan[name].as_f64().unwrap();
            // A grain has more volume than a sphere that passes the same sieve.
            let ratio = number(&spheres, "grains") / number(&planned, "grains");
            assert!(ratio > 1.0 && ratio < 2.5, "{fields} {method}: {planned:#}");
            let fraction = number(&planned, "volume_fraction_effective");
            assert!(
                (fraction / number(&spheres, "volume_fraction_effective") - 1.0).abs() < 1e-12,
                "{planned:#}"
            );
            assert!(number(&planned, "estimated_time_s") > 0.0, "{planned:#}");
            assert_eq!(planned["extrapolations"], json!([]), "mixes like it were measured: {planned:#}");
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn grains_grow_in_the_way_that_is_for_them_or_that_is_asked_for() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    for (job, method, used) in [
        (jobs::quick(1), "growth", "edmd"),
        (jobs::quick(1), "monte_carlo", "monte_carlo"),
        (shaped(1), "growth", "monte_carlo"),
    ] {
        let finished = client.succeed(&jobs::with(job, "/method", json!({"type": method}))).await;
        let result = client.result(id_of(&finished)).await;
        assert_eq!(result["summary"]["method_used"], used);
        assert!(!result["statistics"][used].is_null() && !result["timings_s"][used].is_null());
        assert!(result["check"]["min_gap_mm"].as_f64().unwrap() >= 0.2, "{:#}", result["check"]);
        // Grains keep more and more of the constant distance while they grow.
        let plot = format!("/v1/jobs/{}/plots/distance", id_of(&finished));
        client.get(&plot).send().await.expect(200);
    }
    let listed = client.get("/v1/jobs?method=growth").send().await.expect(200).json();
    assert_eq!(listed["items"].as_array().unwrap().len(), 2, "{listed:#}");
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
        (
            jobs::with(shaped(1), "/method", json!({"type": "growth", "growth_rate": 0.1})),
            "/method/growth_rate",
        ),
        (
            jobs::with(jobs::quick(1), "/method", json!({"type": "growth", "stop": {"sweeps": 5}})),
            "/method/stop/sweeps",
        ),
        (polyhedra(json!({"faces": 3})), "/mix/shape/faces"),
        (polyhedra(json!({"template": "voronoi", "displacement": 0.1})), "/mix/shape/displacement"),
        (polyhedra(json!({"rounding": 0.6})), "/mix/shape/rounding"),
        (polyhedra(json!({"template_count": 1000})), "/mix/shape/template_count"),
        (polyhedra(json!({"ratios": {"type": "shape_index", "index": 0.2}})), "/mix/shape/ratios/type"),
        (jobs::with(polyhedra(json!({})), "/method", json!({"type": "edmd"})), "/method/type"),
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
