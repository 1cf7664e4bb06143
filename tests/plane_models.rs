//! Plane models: triangles of cuts by the Gmsh of Debian and that of Python, read by meshio, and decks of them, solved
//! by CalculiX.

use std::fs;
use std::process::Command;

use serde_json::{Value, json};

use crate::harness::results::json_in as read;
use crate::harness::{DataDir, Launch, id_of, machine, packstone, run};

const CHECK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/triangles.py");

/// The exports that `CHECK` reads.
const EXPORTS: [&str; 4] = [
    "slice:format=json,axis=x",
    "slice:format=inp,axis=x",
    "slice:format=vtu,axis=x,order=2,plane=strain",
    "slice:elements=triangles,axis=x",
];

/// Two aggregates between walls, or one in a periodic box.
fn job(is_periodic: bool) -> Value {
    let mut job = json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [24, 20, 18]},
        "mix": {"volume_fraction": 0.6, "d_min_mm": 3, "allow_coarse": true},
        "distance": {"type": "constant", "gap_mm": 0.5},
        "materials": {
            "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "expansion_1_k": 1.1e-5},
            "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2, "expansion_1_k": 8e-6}},
    });
    let grading = json!({"type": "fuller", "d_max_mm": 8, "exponent": 0.5});
    if is_periodic {
        job["specimen"]["boundary"] = json!("periodic");
        job["mix"]["grading"] = grading;
    } else {
        job["mix"]["aggregates"] = json!([
            {"name": "basalt", "share": 0.6, "grading": grading},
            {"name": "gravel", "share": 0.4, "grading": grading}]);
    }
    job
}

#[tokio::test]
async fn triangles_of_each_gmsh_have_the_sections_of_the_grains() {
    let Some((python, all)) = machine::gmsh("Triangles were not made.") else { return };
    for gmsh in all {
        for is_periodic in [false, true] {
            let directory = tempfile::tempdir().unwrap();
            let folder = directory.path();
            fs::write(folder.join("job.json"), job(is_periodic).to_string()).unwrap();
            let mut args = vec!["run", "job.json", "--gmsh", gmsh.to_str().unwrap()];
            args.extend(EXPORTS.iter().flat_map(|export| ["--export", export]));
            let ended = packstone(folder, &args).await;
            assert_eq!(ended.code, Some(0), "{ended:?}");
            let mut command = Command::new(&python);
            command.arg(CHECK).arg(folder);
            let checked = run(command).await;
            assert_eq!(checked.code, Some(0), "{}: {checked:?}", gmsh.display());
            let report = read(&folder.join("result.slice.x.inp.report.json"));
            let triangles = &report["triangles"];
            assert!(triangles["area_error"].as_f64().unwrap().abs() < 1e-9, "{report:#}");
            assert!(triangles["aggregate_area_error"].as_f64().unwrap().abs() < 5e-3, "{report:#}");
            assert!(triangles["smallest_gamma"].as_f64().unwrap() > 0.1, "{report:#}");
            assert!(triangles["mesher"].as_str().unwrap().starts_with("Gmsh 4."), "{report:#}");
        }
    }
}

#[tokio::test]
async fn decks_of_cuts_are_solved() {
    let Some((python, _)) = machine::gmsh("Triangles were not made.") else { return };
    if let Some(missing) = machine::missing(&["ccx"]) {
        return machine::skip("PACKSTONE_PYTHON", &missing, "No deck was solved.");
    }
    for is_periodic in [false, true] {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        fs::write(folder.join("job.json"), job(is_periodic).to_string()).unwrap();
        let decks =
            ["", ",order=2", ",order=2,plane=strain", ",order=2,load=shear_xy", ",order=2,load=temperature"];
        let texts = decks.map(|options| format!("elements=triangles{options}"));
        let mut args = vec!["run", "job.json", "--gmsh", python.to_str().unwrap()];
        args.extend(texts.iter().flat_map(|text| ["--solve", text]));
        let ended = packstone(folder, &args).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert!(ended.stdout.contains("Young's modulus along y"), "{ended:?}");
        let of = |name: &str, file: &str| read(&folder.join(format!("result.deck.triangles{name}/{file}")));
        let solution = |name: &str| {
            let solution = of(name, "solution.json");
            assert!(solution["imbalance"].as_f64().unwrap() < 1e-6, "{solution:#}");
            assert!(solution["stray_stress"].as_f64().unwrap_or_default() < 1e-6, "{solution:#}");
            solution
        };
        let figures = of(".order-2", "deck.json");
        assert_eq!((&figures["element_type"], &figures["plane"]["at_mm"]), (&json!("CPS6"), &json!(9.0)));
        assert_eq!(of(".order-2.plane-strain", "deck.json")["element_type"], "CPE6");
        let areas: Vec<f64> = figures["phases"]
            .as_array()
            .unwrap()
            .iter()
            .map(|phase| phase["volume_mm3"].as_f64().unwrap() / (24.0 * 20.0))
            .collect();
        assert!(
            (areas.iter().sum::<f64>() - 1.0).abs() < 1e-9 && areas.len() == if is_periodic { 2 } else { 3 }
        );
        let share = 1.0 - areas[0];
        // Bounds of Reuss and Voigt of a plane; linear triangles are stiffer than quadratic ones.
        let (reuss, voigt) = (1.0 / (share / 70.0 + (1.0 - share) / 25.0), 25.0 + 45.0 * share);
        let modulus = |name: &str| solution(name)["youngs_modulus_gpa"].as_f64().unwrap();
        let (linear, quadratic, strain) =
            (modulus(""), modulus(".order-2"), modulus(".order-2.plane-strain"));
        assert!(
            reuss < quadratic && quadratic < linear && linear < voigt,
            "{reuss} {quadratic} {linear} {voigt}"
        );
        // Both phases have one Poisson's ratio: E / (1 - nu^2), nearly.
        assert!((strain * 0.96 / quadratic - 1.0).abs() < 0.01, "{strain} {quadratic}");
        let g = solution(".shear_xy.order-2")["shear_modulus_gpa"].as_f64().unwrap();
        assert!((quadratic / (2.4 * g) - 1.0).abs() < 0.1, "{quadratic} {g}");
        let heated = solution(".temperature.order-2");
        let expansion = heated["expansion_1_k"].as_array().unwrap();
        assert!(
            expansion.len() == 2
                && expansion.iter().all(|alpha| (8e-6..1.1e-5).contains(&alpha.as_f64().unwrap()))
        );
        let fields = fs::read(folder.join("result.deck.triangles.order-2/solution.vtu")).unwrap();
        assert!(String::from_utf8_lossy(&fields).contains("Name=\"stress\""));
    }
}

#[tokio::test]
async fn the_service_makes_plane_models_and_refuses_those_that_cannot_be() {
    let Some((python, _)) = machine::gmsh("Triangles were not made.") else { return };
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--gmsh", python.to_str().unwrap()]).start().await;
    let client = server.client();
    let mut with_deck = job(false);
    with_deck["postprocess"] = json!([{"type": "deck", "elements": "triangles"}]);
    let done = client.succeed(&with_deck).await;
    let path = |kind: &str| format!("/v1/jobs/{}/exports/{kind}", id_of(&done));
    let inp = client.get(&path("slice?format=inp&axis=x")).send().await.expect(200).body.clone();
    let status = client.get(&path("slice/status?format=inp&axis=x")).send().await.expect(200).json();
    assert_eq!(status["report"]["triangles"]["element_type"], "CPS3", "{status:#}");
    let deck = client.get(&path("deck/status?elements=triangles")).send().await.expect(200).json();
    assert_eq!((&deck["kept"], &deck["options"]["load"]), (&json!(true), &json!("uniaxial_y")), "{deck:#}");
    fs::write(folder.join("job.json"), job(false).to_string()).unwrap();
    let export = ["--export", "slice:format=inp,axis=x", "--gmsh", python.to_str().unwrap()];
    let ended = packstone(folder, &[&["run", "job.json"], &export[..]].concat()).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(inp == fs::read(folder.join("result.slice.x.inp")).unwrap());
    for (query, parameter) in [
        ("slice?order=2", "order"),
        ("slice?format=vtu&segments=5", "segments"),
        ("deck?elements=triangles&load=uniaxial_z", "load"),
        ("deck?elements=triangles&tet_growth=1.2", "tet_growth"),
        ("deck?plane=strain", "plane"),
    ] {
        let problem = client.get(&path(query)).send().await.expect_problem(400, "validation-error");
        assert!(problem["errors"].to_string().contains(parameter), "{problem:#}");
    }
    let mut cylinder = job(true);
    cylinder["specimen"] = json!({"type": "cylinder", "diameter_mm": 24, "height_mm": 20});
    cylinder["postprocess"] =
        json!([{"type": "deck", "elements": "triangles", "axis": "x", "load": "uniaxial_z"}]);
    let problem =
        client.post("/v1/jobs").json(&cylinder).send().await.expect_problem(422, "validation-error");
    assert!(problem.to_string().contains("/postprocess/0/elements"), "{problem:#}");
    server.stop().await;
}
