//! Meshes of tetrahedra: by the Gmsh of Debian and that of Python, read back and solved, and what is said where Gmsh is
//! missing, fails or hangs.

use std::fs;
use std::path::Path;
use std::process::Command;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::results::json_in as read;
use crate::harness::{DataDir, Launch, Running, id_of, machine, packstone, run};

const CHECK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/tetrahedra.py");
/// The exports that `CHECK` reads: as the command line takes and names them, and their names for it.
const EXPORTS: [(&str, &str, &str); 4] = [
    ("mesh:format=inp,segments=10", "result.tetrahedra.segments-10.inp", "inp.inp"),
    ("mesh:format=inp,segments=10,order=2", "result.tetrahedra.segments-10.order-2.inp", "inp2.inp"),
    ("mesh:format=vtu,segments=10", "result.tetrahedra.segments-10.vtu", "vtu.vtu"),
    ("mesh:elements=tetrahedra,segments=10", "result.tetrahedra.segments-10.msh", "msh.msh"),
];

fn job() -> Value {
    json!({
        "seed": 3,
        "specimen": {"type": "box", "size_mm": [24, 20, 18]},
        "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "d_min_mm": 4, "volume_fraction": 0.5},
        "distance": {"type": "constant", "gap_mm": 0.5}
    })
}

/// The job with materials of one Poisson's ratio.
fn job_with_materials() -> Value {
    let mut job = job();
    job["materials"] = json!({
        "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "expansion_1_k": 1.1e-5},
        "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2, "expansion_1_k": 8e-6}});
    job
}

/// Young's modulus of the bounds of Hashin and Shtrikman (1963, 10.1016/0022-5096(63)90060-7) for the share of stiff
/// spheres in the materials of the job: the matrix around them is the lower one, the other way round the upper one.
fn hashin_shtrikman_gpa(share: f64) -> [f64; 2] {
    let moduli = |e: f64| (e / (3.0 * (1.0 - 0.4)), e / (2.0 * 1.2));
    [(25.0, 70.0, share), (70.0, 25.0, 1.0 - share)].map(|(outer, inner, inside)| {
        let ((k1, g1), (k2, g2)) = (moduli(outer), moduli(inner));
        let k = k1 + inside / (1.0 / (k2 - k1) + 3.0 * (1.0 - inside) / (3.0 * k1 + 4.0 * g1));
        let shear = 6.0 * (1.0 - inside) * (k1 + 2.0 * g1) / (5.0 * g1 * (3.0 * k1 + 4.0 * g1));
        let g = g1 + inside / (1.0 / (g2 - g1) + shear);
        9.0 * k * g / (3.0 * k + g)
    })
}

/// A shell script in Gmsh's place, of version 4.99.
fn fake(folder: &Path, fills: &str) -> String {
    let file = folder.join("fake-gmsh");
    let text = format!("#!/bin/sh\ncase \"$*\" in *--version*) echo 4.99.0; exit 0;; esac\n{fills}\n");
    // Another process writes it: a file that this one has open while another thread starts a program is busy.
    let mut writer = Command::new("sh");
    writer.args(["-c", "printf '%s' \"$2\" >\"$1\" && chmod 755 \"$1\"", "sh"]);
    assert!(writer.arg(&file).arg(text).status().unwrap().success());
    file.to_str().unwrap().to_owned()
}

/// A deck that stretches the box along z, between smooth plates.
const DECK: &str = "*INCLUDE, INPUT=MESH\n*MATERIAL, NAME=mortar\n*ELASTIC\n25000., 0.2\n*MATERIAL, NAME=grain\n*ELASTIC\n\
    70000., 0.2\n*SOLID SECTION, ELSET=matrix, MATERIAL=mortar\n*SOLID SECTION, ELSET=aggregates, MATERIAL=grain\n*STEP\n\
    *STATIC, SOLVER=SPOOLES\n*BOUNDARY\nx_min, 1, 1\ny_min, 2, 2\nz_min, 3, 3\nz_max, 3, 3, 0.018\n\
    *NODE PRINT, NSET=z_min, TOTALS=ONLY\nRF\n*NODE PRINT, NSET=z_max, TOTALS=ONLY\nRF\n*END STEP\n";

/// Solves the deck with a mesh in a folder; Young's modulus in GPa by the reaction of 18 mm on 24 mm x 20 mm.
async fn modulus_gpa(folder: &Path, mesh: &str) -> f64 {
    fs::write(folder.join("deck.inp"), DECK.replace("MESH", mesh)).unwrap();
    let mut command = Command::new("ccx");
    command.arg("deck").current_dir(folder);
    let ended = run(command).await;
    assert!(!ended.stdout.contains("*ERROR") && !ended.stdout.contains("*WARNING"), "{ended:?}");
    let text = fs::read_to_string(folder.join("deck.dat")).unwrap_or_else(|_| panic!("{ended:?}"));
    // Lines of three numbers are the totals of a set.
    let totals = |line: &str| {
        let numbers: Result<Vec<f64>, _> = line.split_whitespace().map(str::parse).collect();
        numbers.ok().filter(|numbers| numbers.len() == 3).map(|numbers| numbers[2])
    };
    let forces: Vec<f64> = text.lines().filter_map(totals).collect();
    let [low, high] = forces[..] else { panic!("{text}") };
    assert!((low + high).abs() < 1e-5 * high, "reactions are out of balance: {low} N and {high} N");
    high / (24.0 * 20.0) / 1e-3 / 1e3
}

#[tokio::test]
async fn tetrahedra_of_each_gmsh_are_read_by_others_and_solved() {
    let Some((python, all)) = machine::gmsh("Tetrahedra were not made.") else { return };
    for gmsh in all {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        fs::write(folder.join("job.json"), job().to_string()).unwrap();
        let mut args = vec!["run", "job.json", "--gmsh", gmsh.to_str().unwrap()];
        args.extend(EXPORTS.iter().flat_map(|(export, _, _)| ["--export", export]));
        let ended = packstone(folder, &args).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        for (_, file, short) in EXPORTS {
            for ending in ["", ".report.json"] {
                fs::rename(folder.join(format!("{file}{ending}")), folder.join(format!("{short}{ending}")))
                    .unwrap();
            }
        }
        let mut command = Command::new(&python);
        command.arg(CHECK).arg(folder);
        let checked = run(command).await;
        assert_eq!(checked.code, Some(0), "{}: {checked:?}", gmsh.display());
        if let Some(missing) = machine::missing(&["ccx"]) {
            return machine::skip("PACKSTONE_PYTHON", &missing, "No deck was solved.");
        }
        // Reuss and Voigt bounds; linear tetrahedra are stiffer than quadratic ones.
        let report: Value =
            serde_json::from_slice(&fs::read(folder.join("inp.inp.report.json")).unwrap()).unwrap();
        let share = report["aggregate_volume_mm3"].as_f64().unwrap() / (24.0 * 20.0 * 18.0);
        let (voigt, reuss) = (25.0 + 45.0 * share, 1.0 / (share / 70.0 + (1.0 - share) / 25.0));
        let (linear, quadratic) =
            (modulus_gpa(folder, "inp.inp").await, modulus_gpa(folder, "inp2.inp").await);
        assert!(
            reuss < quadratic && quadratic < linear && linear < voigt,
            "{reuss} {quadratic} {linear} {voigt}"
        );
    }
}

#[tokio::test]
async fn sizes_growth_and_the_aim_decide_the_number_of_tetrahedra() {
    let Some((_, all)) = machine::gmsh("Tetrahedra were not made.") else { return };
    for gmsh in all {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        fs::write(folder.join("job.json"), job().to_string()).unwrap();
        let exports = [
            ("segments=10", ".segments-10"),
            ("segments=10,tet_size_matrix_mm=0.8", ".segments-10.tet_size_matrix_mm-0.8"),
            ("segments=10,tet_growth=1.3", ".segments-10.tet_growth-1.3"),
            ("segments=10,tet_size_mm=0.9", ".segments-10.tet_size_mm-0.9"),
            ("target_elements=60000", ".target_elements-60000"),
        ];
        let texts = exports.map(|(options, _)| format!("mesh:format=inp,{options}"));
        let mut args = vec!["run", "job.json", "--gmsh", gmsh.to_str().unwrap()];
        args.extend(texts.iter().flat_map(|text| ["--export", text]));
        let ended = packstone(folder, &args).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let reports = exports.map(|(_, name)| {
            let file = folder.join(format!("result.tetrahedra{name}.inp.report.json"));
            let text = fs::read(&file).unwrap_or_else(|_| panic!("{}: {ended:?}", file.display()));
            serde_json::from_slice::<Value>(&text).unwrap()["tetrahedra"].clone()
        });
        let [plain, fine, grown, at_grains, aimed] =
            reports.each_ref().map(|report| report["elements"].as_f64().unwrap());
        assert!(fine > 1.2 * plain && grown < 0.95 * plain && at_grains > 1.5 * plain, "{reports:#?}");
        // An aim is reached by one correction at most; what came out is told.
        assert!((aimed / 60_000.0 - 1.0).abs() < 0.3, "{:#}", reports[4]);
        assert!(reports[4]["runs"].as_u64().unwrap() <= 2 && reports[4]["target_elements"] == 60_000);
        for report in reports {
            assert!(report["smallest_gamma"].as_f64().unwrap() > 0.03, "{report:#}");
            assert!(report["mesher"].as_str().unwrap().starts_with("Gmsh 4."), "{report:#}");
        }
    }
}

/// `gmsh -3 NAME.msh.geo -o model.inp` makes a deck of the surfaces that a solver takes as it is.
#[tokio::test]
async fn the_script_beside_surfaces_makes_a_deck_that_runs() {
    let Some((python, _)) = machine::gmsh("Tetrahedra were not made.") else { return };
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), job().to_string()).unwrap();
    let ended = packstone(folder, &["run", "job.json", "--export", "mesh:segments=10"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    for order in ["1", "2"] {
        const PROGRAM: &str = "import sys, gmsh\ngmsh.initialize(['gmsh'] + sys.argv[1:], run=True)";
        let mut command = Command::new(&python);
        command.args(["-c", PROGRAM, "-3", "result.segments-10.msh.geo", "-order", order, "-o", "model.inp"]);
        command.current_dir(folder);
        let ended = run(command).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let model = fs::read_to_string(folder.join("model.inp")).unwrap();
        let kind = if order == "1" { "C3D4," } else { "C3D10," };
        for line in model.lines().filter(|line| line.to_ascii_uppercase().starts_with("*ELEMENT")) {
            assert!(line.contains(kind), "{line}");
        }
        if let Some(missing) = machine::missing(&["ccx"]) {
            return machine::skip("PACKSTONE_PYTHON", &missing, "No deck was solved.");
        }
        let modulus = modulus_gpa(folder, "model.inp").await;
        assert!((25.0..70.0).contains(&modulus), "{modulus}");
    }
}

#[tokio::test]
async fn the_command_line_names_the_cause_and_leaves_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), job().to_string()).unwrap();
    let hang = fake(folder, "sleep 1000");
    let args =
        ["run", "job.json", "--export", "mesh:format=inp,segments=8", "--out", "hung", "--gmsh", &hang];
    let ended = packstone(folder, &[&args[..], &["--gmsh-timeout-s", "0.5"]].concat()).await;
    assert_eq!(ended.code, Some(6), "{ended:?}");
    assert!(ended.stderr.contains("Gmsh did not end within 0.5 s (--gmsh-timeout-s)"), "{ended:?}");
    let left: Vec<_> =
        fs::read_dir(folder.join("hung")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().contains("tetrahedra")), "{left:?}");
    // A Gmsh that cannot be used is told before the work.
    let ended = packstone(
        folder,
        &["run", "job.json", "--export", "mesh:format=inp", "--out", "none", "--gmsh", "no-gmsh"],
    )
    .await;
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.stderr.contains("apt install gmsh") && ended.stderr.contains("no-gmsh"), "{ended:?}");
    assert!(!folder.join("none").join("result.json").exists());
}

#[tokio::test]
async fn a_gmsh_is_named_by_a_path_that_is_relative() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("job.json"), job().to_string()).unwrap();
    fs::create_dir(folder.join("bin")).unwrap();
    fake(&folder.join("bin"), "echo 'Error   : found' >&2; exit 1");
    for named in ["bin/fake-gmsh", "./bin/fake-gmsh"] {
        let args = ["run", "job.json", "--export", "mesh:format=inp,segments=8", "--fresh", "--gmsh", named];
        let ended = packstone(folder, &args).await;
        assert_eq!(ended.code, Some(6), "{ended:?}");
        assert!(ended.stderr.contains("Gmsh failed (exit code 1) while starting Gmsh: found"), "{ended:?}");
    }
}

#[tokio::test]
async fn a_gmsh_ends_with_a_command_or_a_worker_that_is_killed() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let pid = folder.join("pid");
    let started = format!("echo $! > {0}.new; mv {0}.new {0}; wait", pid.display());
    // A process of the program, which its parent alone would not end.
    let hang = fake(folder, &format!("sleep 1000 & {started}"));
    let ends_with = async |running: Running| {
        eventually("Gmsh to start", || pid.exists()).await;
        let number = fs::read_to_string(&pid).unwrap();
        // A process that nobody has waited for yet is dead all the same.
        let is_gone = || {
            let status = fs::read_to_string(format!("/proc/{}/status", number.trim()));
            status.map_or(true, |status| status.contains("State:\tZ"))
        };
        assert!(!is_gone());
        running.signal(Signal::KILL);
        running.ended().await;
        eventually("Gmsh to end", is_gone).await;
        fs::remove_file(&pid).unwrap();
    };
    fs::write(folder.join("job.json"), job().to_string()).unwrap();
    let args = ["run", "job.json", "--export", "mesh:format=inp,segments=8", "--gmsh", &hang];
    ends_with(Running::start(folder, &args).await).await;

    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(0).args(&["--gmsh", &hang]).start().await;
    let mut with_export = job();
    with_export["postprocess"] = json!([{"type": "mesh", "format": "inp", "segments": 8}]);
    server.client().post("/v1/jobs").json(&with_export).send().await.expect(201);
    let url = format!("http://{}", server.address());
    let args = ["worker", "--server", &url, "--slots", "1", "--gmsh", &hang];
    ends_with(Running::start(folder, &args).await).await;
    server.stop().await;
}

#[tokio::test]
async fn a_service_tells_why_it_has_no_tetrahedra() {
    let directory = tempfile::tempdir().unwrap();
    let data_dir = DataDir::new();
    let failing = fake(directory.path(), "echo 'Error   : volume 7 cannot be filled' >&2; exit 1");
    let server = Launch::new(&data_dir).args(&["--gmsh", &failing]).start().await;
    let client = server.client();
    let id = id_of(&client.succeed(&job()).await).to_owned();
    let path = format!("/v1/jobs/{id}/exports/mesh?format=inp&segments=8");
    let problem = client.get(&path).send().await.expect_problem(409, "export-failed");
    assert!(problem.to_string().contains("Gmsh failed (exit code 1)"), "{problem:#}");
    assert!(problem.to_string().contains("volume 7 cannot be filled"), "{problem:#}");
    let left = data_dir.artifacts();
    assert!(left.iter().all(|file| file.to_string_lossy().ends_with(".packstone")), "{left:?}");
    server.stop().await;

    // Without Gmsh a request is refused, in a job too, and says how to get it.
    let server = Launch::new(&data_dir).env("PATH", "/nowhere").start().await;
    let client = server.client();
    let problem = client.get(&path).send().await.expect_problem(422, "format-not-available");
    assert!(problem["detail"].as_str().unwrap().contains("apt install gmsh"), "{problem:#}");
    let mut with_export = job();
    with_export["postprocess"] = json!([{"type": "mesh", "format": "vtu"}]);
    let problem =
        client.post("/v1/jobs").json(&with_export).send().await.expect_problem(422, "format-not-available");
    assert!(problem.to_string().contains("PACKSTONE_GMSH"), "{problem:#}");
    server.stop().await;
}

#[tokio::test]
async fn a_service_makes_tetrahedra_and_remembers_by_which_gmsh() {
    let Some((python, _)) = machine::gmsh("Tetrahedra were not made.") else { return };
    let directory = tempfile::tempdir().unwrap();
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--gmsh", python.to_str().unwrap()]).start().await;
    let client = server.client();
    let id = id_of(&client.succeed(&job()).await).to_owned();
    let path = format!("/v1/jobs/{id}/exports/mesh?format=inp&segments=8");
    let first = client.get(&path).send().await.expect(200).body.clone();
    let status = client.get(&path.replace("mesh?", "mesh/status?")).send().await.expect(200).json();
    let report = &status["report"]["tetrahedra"];
    assert!(report["mesher"].as_str().unwrap().starts_with("Gmsh 4.") && report["runs"] == 1, "{status:#}");
    assert!(report["mesher_options"][0] == "Mesh.Algorithm3D = 10", "{status:#}");
    assert!(first.starts_with(b"** Packstone "));
    server.stop().await;
    // Another version of Gmsh makes another file.
    let failing = fake(directory.path(), "exit 1");
    let server = Launch::new(&data_dir).args(&["--gmsh", &failing]).start().await;
    server.client().get(&path).send().await.expect_problem(409, "export-failed");
    server.stop().await;
    let server = Launch::new(&data_dir).args(&["--gmsh", python.to_str().unwrap()]).start().await;
    assert_eq!(server.client().get(&path).send().await.expect(200).body, first);
    server.stop().await;
}

/// The fields of the answer have all elements, and a displacement of the moved plate alone at its nodes.
const FIELDS: &str = "import sys, meshio, numpy\nmesh = meshio.read(sys.argv[1])\n\
    u, z = mesh.point_data['displacement'], mesh.points[:, 2]\n\
    assert mesh.cells[0].type == 'tetra10' and len(mesh.cells[0].data) == int(sys.argv[2])\n\
    assert numpy.allclose(u[z > 17.999, 2], 0.0018, rtol=1e-5) and numpy.allclose(u[z < 1e-3, 2], 0)\n\
    assert set(mesh.cell_data['phase'][0]) == {0, 1} and numpy.isfinite(mesh.point_data['stress']).all()\n";

#[tokio::test]
async fn one_command_goes_from_a_mix_to_the_modulus_of_tetrahedra() {
    let Some((python, all)) = machine::gmsh("Tetrahedra were not made.") else { return };
    if let Some(missing) = machine::missing(&["ccx"]) {
        return machine::skip("PACKSTONE_PYTHON", &missing, "No deck was solved.");
    }
    for gmsh in all {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path();
        fs::write(folder.join("job.json"), job_with_materials().to_string()).unwrap();
        // One command for each, so that none is long on a busy machine.
        for (name, options) in [
            ("segments-10", ""),
            ("segments-10.order-2", ",order=2"),
            ("shear_xy.segments-10.order-2", ",order=2,load=shear_xy"),
            ("temperature.segments-10.order-2", ",order=2,load=temperature"),
        ] {
            let text = format!("elements=tetrahedra,segments=10{options}");
            let gmsh = gmsh.to_str().unwrap();
            let args = ["run", "job.json", "--out", name, "--gmsh", gmsh, "--solve", &text];
            let ended = packstone(folder, &args).await;
            assert_eq!(ended.code, Some(0), "{ended:?}");
        }
        let of = |name: &str, file: &str| folder.join(format!("{name}/result.deck.tetrahedra.{name}/{file}"));
        let solution = |name: &str| {
            let solution = read(&of(name, "solution.json"));
            assert!(solution["imbalance"].as_f64().unwrap() < 1e-6, "{solution:#}");
            assert!(solution["stray_stress"].as_f64().unwrap_or_default() < 1e-6, "{solution:#}");
            solution
        };
        let figures = read(&of("segments-10.order-2", "deck.json"));
        assert_eq!((&figures["elements"], &figures["element_type"]), (&json!("tetrahedra"), &json!("C3D10")));
        assert!(figures["tetrahedra"]["mesher"].as_str().unwrap().starts_with("Gmsh 4."), "{figures:#}");
        let volume = |phase: usize| figures["phases"][phase]["volume_mm3"].as_f64().unwrap();
        assert!((volume(0) + volume(1) - 24.0 * 20.0 * 18.0).abs() < 1e-5, "{figures:#}");
        let share = volume(1) / (24.0 * 20.0 * 18.0);
        let [lower, upper] = hashin_shtrikman_gpa(share);
        let quadratic = solution("segments-10.order-2");
        let e = quadratic["youngs_modulus_gpa"].as_f64().unwrap();
        let linear = solution("segments-10")["youngs_modulus_gpa"].as_f64().unwrap();
        assert!(lower < e && e < upper && e < linear, "{lower} {e} {upper} {linear}");
        for ratio in quadratic["poissons_ratios"].as_array().unwrap() {
            assert!((ratio.as_f64().unwrap() - 0.2).abs() < 0.01, "{quadratic:#}");
        }
        let g = solution("shear_xy.segments-10.order-2")["shear_modulus_gpa"].as_f64().unwrap();
        // An isotropic solid with Poisson's ratio of both phases has it too, nearly.
        assert!((e / (2.4 * g) - 1.0).abs() < 0.03, "{e} {g}");
        for alpha in solution("temperature.segments-10.order-2")["expansion_1_k"].as_array().unwrap() {
            assert!((8e-6..1.1e-5).contains(&alpha.as_f64().unwrap()));
        }
        let mut command = Command::new(&python);
        command.args(["-c", FIELDS]).arg(of("segments-10.order-2", "solution.vtu"));
        command.arg(figures["number_of_elements"].to_string());
        let ended = run(command).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
}

/// A cylinder of one material has its constants exactly, whatever grains divide its mesh.
#[tokio::test]
async fn a_cylinder_of_one_material_has_its_constants() {
    let Some((python, _)) = machine::gmsh("Tetrahedra were not made.") else { return };
    if let Some(missing) = machine::missing(&["ccx"]) {
        return machine::skip("PACKSTONE_PYTHON", &missing, "No deck was solved.");
    }
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let mut job = job_with_materials();
    job["specimen"] = json!({"type": "cylinder", "diameter_mm": 18, "height_mm": 20});
    job["mix"]["volume_fraction"] = json!(0.4);
    job["mix"]["allow_coarse"] = json!(true);
    job["materials"]["aggregate"] = job["materials"]["matrix"].clone();
    fs::write(folder.join("job.json"), job.to_string()).unwrap();
    let mut args = vec!["run", "job.json", "--gmsh", python.to_str().unwrap()];
    let options = "elements=tetrahedra,order=2,target_elements=4000";
    let heated = format!("{options},load=temperature");
    args.extend(["--solve", options, "--solve", &heated]);
    let ended = packstone(folder, &args).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let solution = |name: &str| {
        read(&folder.join(format!("result.deck.tetrahedra.{name}order-2.target_elements-4000/solution.json")))
    };
    let near = |value: &Value, expected: f64, tolerance: f64| {
        assert!((value.as_f64().unwrap() / expected - 1.0).abs() < tolerance, "{value}, not {expected}");
    };
    // The triangles of the lateral surface are no prism: its sections differ along the height.
    let stretched = solution("");
    near(&stretched["youngs_modulus_gpa"], 25.0, 1e-3);
    near(&stretched["poissons_ratios"][0], 0.2, 1e-2);
    // It expands freely, whatever its form.
    for alpha in solution("temperature.")["expansion_1_k"].as_array().unwrap() {
        near(alpha, 1.1e-5, 1e-6);
    }
    let sheared = ["run", "job.json", "--out", "sheared", "--solve", "elements=tetrahedra,load=shear_xy"];
    let refused = packstone(folder, &sheared).await;
    assert_eq!((refused.code, folder.join("sheared").exists()), (Some(3), false), "{refused:?}");
    assert!(refused.stderr.contains("shear_xy is no load of a cylinder"), "{refused:?}");
}

#[tokio::test]
async fn the_service_makes_decks_of_tetrahedra_and_refuses_those_that_cannot_be() {
    let Some((python, _)) = machine::gmsh("Tetrahedra were not made.") else { return };
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--gmsh", python.to_str().unwrap()]).start().await;
    let client = server.client();
    let mut job = job_with_materials();
    job["postprocess"] =
        json!([{"type": "deck", "elements": "tetrahedra", "segments": 8, "solver": "abaqus"}]);
    let done = client.succeed(&job).await;
    let path = format!("/v1/jobs/{}/exports/deck?elements=tetrahedra&solver=abaqus", id_of(&done));
    let zip = client.get(&format!("{path}&segments=8")).send().await.expect(200).body.clone();
    let status = client.get(&format!("{path}&segments=8").replace("deck?", "deck/status?")).send().await;
    assert_eq!(status.expect(200).json()["kept"], true);
    fs::write(folder.join("job.json"), job_with_materials().to_string()).unwrap();
    let export = "deck:elements=tetrahedra,segments=8,solver=abaqus";
    let gmsh = ["--gmsh", python.to_str().unwrap()];
    let ended = packstone(folder, &[&["run", "job.json", "--export", export], &gmsh[..]].concat()).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    // The head states the digest of the stored result, which a file of the command does not have.
    let of_command = fs::read(folder.join("result.deck.tetrahedra.abaqus.segments-8.zip")).unwrap();
    let mesh = |zip: &[u8]| {
        let mut archive = zip::ZipArchive::new(std::io::Cursor::new(zip)).unwrap();
        let mut text = String::new();
        std::io::Read::read_to_string(&mut archive.by_name("mesh.inp").unwrap(), &mut text).unwrap();
        text.lines().filter(|line| !line.contains("Packing: seed")).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(mesh(&zip), mesh(&of_command));
    assert!(mesh(&zip).iter().any(|line| line.starts_with("*ELEMENT, TYPE=C3D4, ELSET=aggregates")));
    for (option, parameter) in [("cells=9", "cells"), ("order=3", "order"), ("tet_growth=2", "tet_growth")] {
        let problem =
            client.get(&format!("{path}&{option}")).send().await.expect_problem(400, "validation-error");
        assert_eq!(problem["errors"][0]["parameter"], parameter, "{problem:#}");
    }
    let mut periodic = job_with_materials();
    periodic["specimen"]["boundary"] = json!("periodic");
    periodic["postprocess"] = json!([{"type": "deck", "elements": "tetrahedra"}]);
    let problem =
        client.post("/v1/jobs").json(&periodic).send().await.expect_problem(422, "format-not-available");
    assert!(problem.to_string().contains("ask for voxels"), "{problem:#}");
    server.stop().await;
}
