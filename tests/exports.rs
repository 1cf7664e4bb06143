//! Exports while they are being made: requested by many, cancelled, interrupted by a power cut, dropped from the cache,
//! damaged on the disk.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Reply, Server, holds_every_store, id_of, jobs, machine, run};

/// Seconds of work for the grains of [`packed_for_long`].
const LENGTHY: &str = "voxels?format=raw&cells=320&samples=16";

async fn packed(client: &Client) -> String {
    id_of(&client.succeed(&jobs::quick(1)).await).to_owned()
}

/// Packs polyhedra, whose voxels take a hundred times as long as those of spheres.
async fn packed_for_long(client: &Client) -> String {
    let job = json!({
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {
            "grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.30,
            "shape": {"type": "polyhedron", "template_count": 1},
        },
    });
    id_of(&client.succeed(&job).await).to_owned()
}

/// Starts an export; the path of its document.
async fn start(client: &Client, job: &str, export: &str) -> String {
    let started = client.post(&format!("/v1/jobs/{job}/exports/{export}")).send().await.expect(202).json();
    started["links"]["self"].as_str().unwrap().to_owned()
}

/// The path of the file of an export.
fn file_of(status: &str) -> String {
    status.replace("/status", "")
}

/// Long-polls until it is in that state.
async fn when(client: &Client, path: &str, state: &str) -> Value {
    client.when(path, state, |found| found["state"] == state).await
}

async fn made_so_far(client: &Client, kind: &str) -> u64 {
    let text = String::from_utf8(client.get("/metrics").send().await.expect(200).body.to_vec()).unwrap();
    let series = format!("packstone_export_duration_seconds_count{{type=\"{kind}\",outcome=\"succeeded\"}}");
    text.lines().find_map(|line| line.strip_prefix(&series)).map_or(0, |n| n.trim().parse().unwrap())
}

fn models(data_dir: &DataDir) -> Vec<std::path::PathBuf> {
    let files = data_dir.artifacts().into_iter();
    files.filter(|file| !file.to_string_lossy().ends_with(".packstone")).collect()
}

#[tokio::test]
async fn what_many_ask_for_at_once_is_made_once() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--export-workers", "4"]).start().await;
    let client = server.client();
    let id = packed(&client).await;
    let path = format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=90&samples=8");
    let asking: Vec<_> = (0..8)
        .map(|i| {
            let (client, path) = (client.clone(), path.clone());
            tokio::spawn(async move {
                if i == 3 {
                    client.post(&path).send().await;
                }
                client.get(&path).send().await.expect(200).body.clone()
            })
        })
        .collect();
    let mut bodies = Vec::new();
    for asked in asking {
        bodies.push(asked.await.unwrap());
    }
    assert!(bodies.iter().all(|body| body.len() == 729_000 && *body == bodies[0]));
    assert_eq!(made_so_far(&client, "voxels").await, 1);
    assert_eq!(models(&data_dir).len(), 1);
    server.stop().await;
}

#[tokio::test]
async fn a_slice_does_not_wait_behind_what_takes_long() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = packed_for_long(&client).await;
    let long = start(&client, &id, LENGTHY).await;
    when(&client, &long, "running").await;
    client.get(&format!("/v1/jobs/{id}/exports/slice")).send().await.expect(200);
    let found = client.get(&long).send().await.expect(200).json();
    assert_eq!(found["state"], "running", "what was to be overtaken is over: {found:#}");
    // Whose answer is not held back is told to come again.
    let path = format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=320&samples=16");
    let reply = client.get(&path).header("prefer", "wait=0").send().await;
    let export = reply.expect(202).json();
    assert_eq!((&export["state"], &export["links"]["self"]), (&json!("running"), &json!(long)));
    assert_eq!((reply.header("retry-after"), reply.header("content-location")), ("2", &*long));
    assert!(reply.headers.get("etag").is_none(), "the tag of the file must not be that of its document");
    let head = client.head(&path).header("prefer", "wait=0").send().await;
    assert!(head.expect(202).body.is_empty());
    server.stop().await;
}

#[tokio::test]
async fn a_power_cut_or_a_stop_meanwhile_loses_nothing() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = packed_for_long(&client).await;
    let long = start(&client, &id, LENGTHY).await;
    let behind = start(&client, &id, "voxels?format=raw&cells=9").await;
    when(&client, &long, "running").await;
    server.kill().await;

    let server = Server::start(&data_dir).await;
    when(&server.client(), &long, "running").await;
    server.terminate();
    let status = server.ends_within(Duration::from_secs(10)).await;
    assert!(status.success(), "{status}");
    assert!(models(&data_dir).is_empty(), "a stop leaves no half a file");

    let server = Server::start(&data_dir).await;
    let client = server.client();
    let done = when(&client, &long, "succeeded").await;
    assert_eq!(done["bytes"], 320_u64.pow(3));
    when(&client, &behind, "succeeded").await;
    assert_eq!(client.get(&file_of(&behind)).send().await.expect(200).body.len(), 729);
    assert_eq!(models(&data_dir).len(), 2);
    server.stop().await;
}

#[tokio::test]
async fn who_deletes_calls_off_what_is_being_made() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = packed_for_long(&client).await;
    let long = start(&client, &id, LENGTHY).await;
    when(&client, &long, "running").await;
    client.delete(&file_of(&long)).send().await.expect(204);
    // Its place is free: had it not been called off, this would wait for it.
    let next = start(&client, &id, "voxels?format=raw&cells=5").await;
    when(&client, &next, "succeeded").await;
    eventually("half a file to go", || models(&data_dir).len() == 1).await;

    let long = start(&client, &id, LENGTHY).await;
    when(&client, &long, "running").await;
    let waiting = tokio::spawn({
        let (client, id) = (client.clone(), id.clone());
        async move {
            client.get(&format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=320&samples=16")).send().await
        }
    });
    client.delete(&format!("/v1/jobs/{id}")).send().await.expect(204);
    waiting.await.unwrap().expect_problem(404, "not-found");
    client.get(&long).send().await.expect_problem(404, "not-found");
    eventually("all files to go", || data_dir.artifacts().is_empty()).await;
    let other = packed(&client).await;
    client.get(&format!("/v1/jobs/{other}/exports/voxels?format=raw&cells=5")).send().await.expect(200);
    server.stop().await;
}

#[tokio::test]
async fn the_cache_is_bounded_and_what_it_dropped_is_made_again() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--export-cache-bytes", "20000"]).start().await;
    let client = server.client();
    let id = packed(&client).await;
    let get = |cells: u32| client.get(&format!("/v1/jobs/{id}/exports/voxels?format=raw&cells={cells}"));
    // 8 000 bytes each, and one that is kept.
    let first = get(20).send().await;
    let kept = format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=22");
    let kept = client.post(&kept).header("prefer", "wait=60").send().await;
    let kept = kept.expect(200).json()["links"]["file"].as_str().unwrap().to_owned();
    get(21).send().await.expect(200);
    get(19).send().await.expect(200);
    eventually("the oldest to be dropped", || models(&data_dir).len() == 3).await;
    let list = client.get(&format!("/v1/jobs/{id}/exports")).send().await.expect(200).json();
    let shown: Vec<&Value> =
        list["items"].as_array().unwrap().iter().map(|i| &i["options"]["cells"]).collect();
    assert_eq!(shown, [19, 21, 22], "{list:#}");
    client.get(&kept).send().await.expect(200);
    let again = get(20).send().await;
    assert!(again.expect(200).body == first.body && again.header("etag") == first.header("etag"));
    server.stop().await;
}

#[tokio::test]
async fn a_missing_or_damaged_model_is_made_again() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = packed(&client).await;
    let path = start(&client, &id, "voxels?format=raw&cells=20").await;
    when(&client, &path, "succeeded").await;
    let format = format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=20");
    let whole = client.get(&format).send().await.expect(200).body.clone();
    let [file] = &models(&data_dir)[..] else { panic!("one model has one file") };
    fs::remove_file(file).unwrap();
    assert!(client.get(&format).send().await.expect(200).body == whole);
    let [file] = &models(&data_dir)[..] else { panic!("one model has one file") };
    fs::write(file, &whole[..100]).unwrap();
    assert!(client.get(&file_of(&path)).send().await.expect(200).body == whole);
    server.stop().await;
}

#[tokio::test]
async fn orphans_are_swept_and_models_kept() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = packed(&client).await;
    let path = start(&client, &id, "voxels?format=raw&cells=5").await;
    when(&client, &path, "succeeded").await;
    server.kill().await;
    let [file] = &models(&data_dir)[..] else { panic!("one model has one file") };
    let orphans = [
        "01900000-0000-7000-8000-0000000000aa.1.export",
        "01900000-0000-7000-8000-0000000000aa.2.export.tmp",
    ];
    let orphans = orphans.map(|name| file.with_file_name(name));
    for orphan in &orphans {
        fs::write(orphan, "left over").unwrap();
    }
    let server = Server::start(&data_dir).await;
    eventually("orphans to be swept", || !orphans.iter().any(|orphan| orphan.exists())).await;
    assert!(file.exists());
    server.client().get(&file_of(&path)).send().await.expect(200);
    server.stop().await;
}

/// Opens a file with Gmsh and lets it fill all volumes; the number of tetrahedra.
async fn tetrahedra(python: &Path, file: &Path) -> usize {
    const FILL: &str = "import gmsh, sys; gmsh.initialize(); gmsh.option.setNumber('General.Terminal', 0); \
        gmsh.open(sys.argv[1]); gmsh.model.mesh.generate(3); print(len(gmsh.model.mesh.getElementsByType(4)[0]))";
    let mut command = Command::new(python);
    command.args(["-c", FILL]).arg(file);
    let ended = run(command).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    ended.stdout.trim().parse().unwrap_or_else(|_| panic!("{ended:?}"))
}

#[tokio::test]
async fn a_mesh_comes_with_the_script_that_lets_gmsh_fill_it() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let coarse = jobs::with(jobs::quick(3), "/mix/d_min_mm", json!(8));
    let id = id_of(&client.succeed(&jobs::with(coarse, "/name", json!("W\u{fc}rfel"))).await).to_owned();
    let ask =
        |export: &str| client.post(&format!("/v1/jobs/{id}/exports/{export}")).header("prefer", "wait=60");
    let made = ask("mesh?format=msh&segments=8").send().await.expect(200).json();
    let get = |link: &str| client.get(made["links"][link].as_str().unwrap());
    let (mesh, script) = (get("file").send().await, get("script").send().await);
    let name_of = |reply: &Reply| {
        let disposition = reply.expect(200).header("content-disposition").to_owned();
        // Whichever name a client takes, the script names it.
        assert!(!disposition.contains("filename*"), "{disposition}");
        disposition.split('"').nth(1).unwrap().to_owned()
    };
    let (mesh_name, script_name) = (name_of(&mesh), name_of(&script));
    assert_eq!(script_name, format!("{mesh_name}.geo"));
    let listed = client.get(&format!("/v1/jobs/{id}/exports")).send().await.expect(200).json();
    assert_eq!(listed["items"][0]["links"]["script"], made["links"]["script"]);
    let of_job = client.get(&format!("/v1/jobs/{id}")).send().await.expect(200).json();
    assert_eq!(of_job["exports"][0]["links"]["script"], made["links"]["script"]);
    // What its program opens as it is has none.
    for kind in ["mesh?format=stl&segments=8", "mesh?format=geo&segments=32", "voxels?cells=8", "slice"] {
        let other = ask(kind).send().await.expect(200).json();
        assert!(other["links"].get("script").is_none(), "{other:#}");
    }
    let none = client.get(&format!("/v1/jobs/{id}/exports/mesh/script?format=stl")).send().await;
    none.expect_problem(404, "not-found");
    let unknown = client.get(&format!("/v1/jobs/{id}/exports/mesh/script?format=msh&cells=8")).send().await;
    unknown.expect_problem(400, "validation-error");

    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(&mesh_name), &mesh.body).unwrap();
    fs::write(folder.path().join(&script_name), &script.body).unwrap();
    server.stop().await;
    let Some(python) = machine::python("The script was not run by Gmsh.") else { return };
    assert_eq!(tetrahedra(&python, &folder.path().join(mesh_name)).await, 0, "what the script is for");
    let filled = tetrahedra(&python, &folder.path().join(script_name)).await;
    assert!(filled > 1000, "{filled}");
}
