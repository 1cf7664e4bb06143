//! Exports of results: their files, their options, and those that are kept with their job.

use std::f64::consts::PI;

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Launch, Reply, Server, id_of, jobs, packstone, results};

/// A box of 40 mm with some hundred grains; its result, too.
async fn packed(client: &Client, seed: u64) -> (String, results::Rows) {
    let job = client.succeed(&jobs::quick(seed)).await;
    let id = id_of(&job).to_owned();
    let rows = results::from_json(&client.result(&id).await);
    (id, rows)
}

/// Circles of a plane cut, as anybody would compute them.
fn circles(rows: &results::Rows, axis: usize, at_mm: f64) -> Vec<(usize, f64)> {
    let radius = |row: &[f64; 4]| ((row[3] / 2.0).powi(2) - (row[axis] - at_mm).powi(2)).sqrt();
    rows.iter().enumerate().map(|(i, row)| (i, radius(row))).filter(|(_, radius)| *radius > 0.0).collect()
}

#[tokio::test]
async fn a_slice_is_a_table_a_drawing_a_picture_and_a_script() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let (id, rows) = packed(&client, 1).await;
    let path = |format: &str, query: &str| format!("/v1/jobs/{id}/exports/slice?format={format}{query}");

    for (axis, at_mm) in [("x", 7.5), ("y", 20.0), ("z", 33.25)] {
        let query = format!("&axis={axis}&at_mm={at_mm}");
        let cut = client.get(&path("json", &query)).send().await.expect(200).json();
        let expected = circles(&rows, "xyz".find(axis).unwrap(), at_mm);
        let found = cut["circles"]["rows"].as_array().unwrap();
        assert!(expected.len() > 5, "{} circles show nothing", expected.len());
        assert_eq!(found.len(), expected.len());
        for (grain, radius_mm) in &expected {
            let row = found.iter().find(|row| row[3] == json!(grain)).expect("the grain's circle");
            assert!((row[2].as_f64().unwrap() - radius_mm).abs() < 1e-9);
        }
        let area: f64 = expected.iter().map(|(_, radius)| PI * radius * radius).sum();
        assert!((cut["area_fraction"].as_f64().unwrap() - area / 1600.0).abs() < 1e-9);
    }
    // However a slice is asked for, it is one export.
    let tag = |reply: &Reply| reply.expect(200).header("etag").to_owned();
    let middle = tag(&client.get(&path("svg", "")).send().await);
    for same in ["&axis=z", "&axis=z&at_mm=20", "&at_mm=20.0"] {
        let reply = client.get(&path("svg", same)).send().await;
        // The middle has a name of its own, `at_mm` being absent.
        assert_eq!(tag(&reply) == middle, !same.contains("at"), "{same}");
    }
    assert_eq!(
        tag(&client.get(&path("svg", "&at_mm=20")).send().await),
        tag(&client.get(&path("svg", "&at_mm=20.0")).send().await)
    );
    for (form, media_type, head, disposition) in [
        ("svg", "image/svg+xml", &b"<"[..], "inline"),
        ("png", "image/png", b"\x89PNG\r\n", "inline"),
        ("json", "application/json", b"{", "attachment"),
        ("geo", "text/plain", b"", "attachment"),
    ] {
        let reply = client.get(&path(form, "&at_mm=20")).send().await;
        assert_eq!(reply.expect(200).header("content-type"), media_type);
        assert!(reply.body.starts_with(head) && !reply.body.is_empty(), "{form}");
        assert_eq!(reply.header("content-length"), reply.body.len().to_string());
        let shown = reply.header("content-disposition");
        assert!(
            shown.starts_with(disposition)
                && shown.contains(".slice.at_mm-20")
                && shown.ends_with(&format!(".{form}\"")),
            "{shown}"
        );
        let again = client.get(&path(form, "&at_mm=20")).send().await;
        assert!(again.body == reply.body && again.header("etag") == reply.header("etag"));
    }
    let script = client.get(&path("geo", "")).send().await;
    assert!(String::from_utf8_lossy(&script.body).contains("OpenCASCADE"));
    server.stop().await;
}

/// Voxel labels of a phase, x fastest, as anybody would compute them.
fn labels(rows: &results::Rows, cells: usize, edge_mm: f64) -> Vec<u8> {
    let at = |i: usize| (i as f64 + 0.5) * edge_mm / cells as f64;
    let inside = |p: [f64; 3]| {
        rows.iter().any(|row| (0..3).map(|a| (row[a] - p[a]).powi(2)).sum::<f64>() <= (row[3] / 2.0).powi(2))
    };
    let n = cells;
    (0..n * n * n).map(|i| u8::from(inside([at(i % n), at(i / n % n), at(i / n / n)]))).collect()
}

#[tokio::test]
async fn voxels_can_be_fetched_in_any_resolution_and_part() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let (id, rows) = packed(&client, 2).await;
    let path = format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=24");
    let whole = client.get(&path).send().await;
    assert_eq!(whole.expect(200).header("content-type"), "application/octet-stream");
    assert!(whole.body == labels(&rows, 24, 40.0), "other labels");
    assert_eq!(whole.header("content-length"), "13824");
    assert!(whole.header("content-disposition").contains(".cells-24.raw"));
    let etag = whole.header("etag").to_owned();
    assert!(etag.starts_with('"'), "{etag} is not strong");

    let part = client.get(&path).header("range", "bytes=100-299").header("if-range", &etag).send().await;
    assert!(part.expect(206).body[..] == whole.body[100..300]);
    assert_eq!(part.header("content-range"), "bytes 100-299/13824");
    let suffix = client.get(&path).header("range", "bytes=-5").send().await;
    assert!(suffix.expect(206).body[..] == whole.body[13819..]);
    let beyond = client.get(&path).header("range", "bytes=13824-").send().await;
    beyond.expect_problem(416, "range-not-satisfiable");
    client.get(&path).header("if-none-match", &etag).send().await.expect(304);
    let head = client.head(&path).send().await;
    for name in ["content-length", "content-type", "etag", "accept-ranges", "content-disposition"] {
        assert_eq!(head.expect(200).header(name), whole.header(name), "{name}");
    }
    assert!(head.body.is_empty());

    let other = client.get(&format!("/v1/jobs/{id}/exports/voxels?format=raw&cells=12")).send().await;
    assert!(other.expect(200).body == labels(&rows, 12, 40.0));
    assert_ne!(other.header("etag"), etag);
    for (format, head) in [("vti", "<?xml"), ("inp", "**")] {
        let reply = client.get(&format!("/v1/jobs/{id}/exports/voxels?format={format}&cells=8")).send().await;
        let text = String::from_utf8_lossy(&reply.expect(200).body[..64]).into_owned();
        assert!(text.starts_with(head), "{format}: {text}");
    }
    server.stop().await;
}

#[tokio::test]
async fn what_cannot_be_had_is_refused_with_name_value_and_bound() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).args(&["--max-model-mib", "8"]).start().await;
    let client = server.client();
    let (id, _) = packed(&client, 3).await;
    let result = |query: &str| format!("/v1/jobs/{id}/result?{query}");
    let voxels = |query: &str| format!("/v1/jobs/{id}/exports/voxels?{query}");
    let slice = |query: &str| format!("/v1/jobs/{id}/exports/slice?{query}");
    let refused = |reply: &Reply, (status, kind, parameter, says): (u16, &str, &str, &str)| {
        let problem = reply.expect_problem(status, kind);
        let says = |error: &Value| {
            error["parameter"] == parameter && error["detail"].as_str().unwrap().contains(says)
        };
        assert!(problem["errors"].as_array().unwrap().iter().any(says), "{problem:#}");
    };
    for (path, refusal) in [
        (voxels("format=raw&cells=0"), (400, "validation-error", "cells", "0 is out of range")),
        (
            voxels("format=raw&cells=many"),
            (400, "validation-error", "cells", "\"many\" is not a whole number"),
        ),
        (voxels("format=raw&colour=red"), (400, "validation-error", "colour", "unknown option: voxels has")),
        (voxels("format=raw&cells=8&cells=9"), (400, "validation-error", "cells", "more than once")),
        (voxels("format=inp&label=grain"), (400, "validation-error", "label", "unknown option: voxels has")),
        (voxels("format=raw&cells=300"), (422, "too-large", "cells", "MB")),
        (voxels("format=msh"), (400, "validation-error", "format", "must be one of")),
        (slice("axis=w"), (400, "validation-error", "axis", "must be one of")),
        (slice("at_mm=41"), (400, "validation-error", "at_mm", "41 is out of range")),
        (slice("at_mm=-1"), (400, "validation-error", "at_mm", "-1 is out of range")),
    ] {
        refused(&client.get(&path).send().await, refusal);
        refused(&client.post(&path).send().await, refusal);
    }
    refused(
        &client.get(&result("format=csv&cells=8")).send().await,
        (400, "validation-error", "cells", "unknown"),
    );
    let start = voxels("format=raw&keep=maybe");
    refused(&client.post(&start).send().await, (400, "validation-error", "keep", "true or false"));
    refused(
        &client.get(&voxels("keep=true")).send().await,
        (400, "validation-error", "keep", "unknown option"),
    );
    // Options in a body, as earlier versions took them, must not be lost in silence.
    let body = json!({"type": "raw", "cells": 3});
    client.post(&voxels("")).json(&body).send().await.expect_problem(415, "unsupported-media-type");
    let of_job = format!("/v1/jobs/{id}/exports");
    let unknown = client.get(&format!("{of_job}/ball")).send().await.expect_problem(404, "not-found");
    assert!(unknown["detail"].as_str().unwrap().contains("mesh, voxels, slice, deck, ldpm"), "{unknown:#}");
    // Nobody has asked for it: it has no state, and nothing can be deleted.
    client.get(&format!("{of_job}/slice/status")).send().await.expect_problem(404, "not-found");
    client.delete(&format!("{of_job}/slice")).send().await.expect_problem(404, "not-found");
    let none = "01900000-0000-7000-8000-000000000000";
    client.get(&format!("/v1/jobs/{none}/exports/slice")).send().await.expect_problem(404, "not-found");
    client.get(&format!("/v1/jobs/{none}/exports")).send().await.expect_problem(404, "not-found");

    let endless = client.submit(&jobs::endless()).await;
    let endless = id_of(&endless);
    let early = ["result", "exports/voxels?format=raw", "exports/slice"]
        .map(|path| format!("/v1/jobs/{endless}/{path}"));
    for path in &early {
        let reply = client.get(path).send().await;
        reply.expect_problem(409, "result-not-ready");
        assert_eq!(reply.header("retry-after"), "1");
    }
    let post = client.post(&format!("/v1/jobs/{endless}/exports/voxels")).send().await;
    post.expect_problem(409, "result-not-ready");
    client.post(&format!("/v1/jobs/{endless}/cancel")).send().await;
    client.finished(endless).await;
    for path in &early {
        client.get(path).send().await.expect_problem(409, "job-failed");
    }
    let post = client.post(&format!("/v1/jobs/{endless}/exports/voxels")).send().await;
    post.expect_problem(409, "job-failed");
    let known = client.get(&result("format=xlsx")).send().await.expect_problem(406, "not-acceptable");
    let detail = known["detail"].as_str().unwrap();
    assert!(["json", "npy", "csv", "vtp", "vtk"].iter().all(|name| detail.contains(name)), "{detail}");
    server.stop().await;
}

#[tokio::test]
async fn what_does_not_exist_of_a_periodic_box_says_what_to_do_instead() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let periodic = jobs::equal_spheres(100, 1);
    let job = client.succeed(&periodic).await;
    let id = id_of(&job);
    for (kind, format) in [("mesh", "msh"), ("mesh", "geo"), ("mesh", "stl"), ("ldpm", "chrono")] {
        let path = format!("/v1/jobs/{id}/exports/{kind}?format={format}");
        let (by_get, by_post) = (client.get(&path).send().await, client.post(&path).send().await);
        let body = json!({"type": kind, "format": format});
        let beforehand = jobs::with(periodic.clone(), "/postprocess", json!([{"type": "voxels"}, body]));
        let beforehand = client.post("/v1/jobs").json(&beforehand).send().await;
        for reply in [&by_get, &by_post, &beforehand] {
            let problem = reply.expect_problem(422, "format-not-available");
            let detail = problem["detail"].as_str().unwrap();
            assert!(detail.contains("periodic") && detail.contains("walls"), "{kind}: {detail}");
        }
        let problem = beforehand.json();
        assert_eq!(problem["errors"][0]["pointer"], "/postprocess/1", "{problem:#}");
    }
    client.get(&format!("/v1/jobs/{id}/exports/voxels?cells=20")).send().await.expect(200);
    client.get(&format!("/v1/jobs/{id}/exports/slice?format=png")).send().await.expect(200);
    assert_eq!(data_dir.artifacts().len(), 3, "nothing is kept of what was refused");
    server.stop().await;
}

#[tokio::test]
async fn a_model_is_kept_with_its_job_until_it_or_the_job_is_deleted() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let (id, rows) = packed(&client, 4).await;
    let of_job = format!("/v1/jobs/{id}/exports");
    let before = client.get(&format!("/v1/jobs/{id}")).send().await;
    assert_eq!(before.json()["links"]["exports"], of_job);
    assert_eq!(before.json()["exports"], json!([]));

    let ask = |export: &str| client.post(&format!("{of_job}/{export}")).header("prefer", "wait=60");
    let reply = ask("voxels?format=raw&cells=10").send().await;
    let made = reply.expect(200).json();
    let this = made["links"]["self"].as_str().unwrap();
    let file = made["links"]["file"].as_str().unwrap();
    assert_eq!((reply.header("location"), reply.header("content-location")), (file, this));
    assert_eq!(
        (&made["state"], &made["type"], &made["format"], &made["kept"]),
        (&json!("succeeded"), &json!("voxels"), &json!("raw"), &json!(true))
    );
    assert_eq!(
        made["options"],
        json!({"type": "voxels", "format": "raw", "cells": 10, "label": "phase", "samples": 4})
    );
    let of_file = client.get(file).send().await;
    assert!(of_file.expect(200).body == labels(&rows, 10, 40.0));
    assert_eq!(made["bytes"], of_file.body.len());
    assert_eq!(made["sha256"].as_str().unwrap(), sha256(&of_file.body));
    let spelled_out = format!("{of_job}/voxels?samples=4&cells=10&label=phase&format=raw");
    let spelled_out = client.get(&spelled_out).send().await;
    assert_eq!(spelled_out.header("etag"), of_file.header("etag"), "by either address it is the same");

    let job = client.get(&format!("/v1/jobs/{id}")).send().await;
    assert_ne!(job.header("etag"), before.header("etag"));
    assert_eq!(job.json()["exports"][0]["links"], made["links"]);
    let again = ask("voxels?cells=10.0&format=raw").send().await;
    assert_eq!(again.expect(200).json()["created_at"], made["created_at"]);
    let known = client.get(this).header("if-none-match", reply.header("etag")).send().await;
    known.expect(304);
    // A file of the cache that somebody wants kept is kept from then on.
    client.get(&format!("{of_job}/voxels?cells=6")).send().await.expect(200);
    let list = client.get(&of_job).send().await.expect(200).json();
    let kept: Vec<(&Value, &Value)> =
        list["items"].as_array().unwrap().iter().map(|item| (&item["format"], &item["kept"])).collect();
    assert_eq!(kept, [(&json!("vti"), &json!(false)), (&json!("raw"), &json!(true))]);
    let cached = ask("voxels?cells=6&keep=false").send().await;
    assert_eq!(cached.expect(200).json()["kept"], false);
    assert_eq!(ask("voxels?cells=6").send().await.expect(200).json()["kept"], true);
    let page = client.get(&format!("{of_job}?limit=1")).send().await.expect(200).json();
    let next = page["next_cursor"].as_str().unwrap();
    let rest = client.get(&format!("{of_job}?limit=1&cursor={next}")).send().await.expect(200).json();
    assert_eq!((&rest["items"][0]["links"]["self"], &rest["next_cursor"]), (&json!(this), &Value::Null));

    assert_eq!(data_dir.artifacts().len(), 3);
    client.delete(file).send().await.expect(204);
    client.get(this).send().await.expect_problem(404, "not-found");
    assert_eq!(client.job(&id).await["exports"].as_array().unwrap().len(), 1);
    assert_eq!(data_dir.artifacts().len(), 2);
    client.delete(&format!("/v1/jobs/{id}")).send().await.expect(204);
    assert_eq!(data_dir.artifacts().len(), 0);
    server.stop().await;
}

fn sha256(bytes: &[u8]) -> String {
    use sha2::{Digest as _, Sha256};
    use std::fmt::Write as _;
    Sha256::digest(bytes).iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

#[tokio::test]
async fn a_job_may_say_beforehand_what_is_to_be_made_of_it() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let postprocess = json!([
        {"type": "slice", "axis": "x"},
        {"type": "voxels", "format": "raw", "cells": 8}, {"type": "voxels", "format": "raw", "cells": 8}
    ]);
    let job = client.succeed(&jobs::with(jobs::quick(5), "/postprocess", postprocess)).await;
    let request = client.request_of(id_of(&job)).await;
    assert_eq!(request["postprocess"][1]["samples"], 4, "defaults are filled in");
    let made = job["exports"].as_array().unwrap();
    assert_eq!(made.len(), 2, "the same twice is one: {made:#?}");
    for model in made {
        let this = model["links"]["self"].as_str().unwrap();
        let done = client.get(this).header("prefer", "wait=60").send().await.expect(200).json();
        assert_eq!(done["state"], "succeeded", "{done:#}");
        client.get(done["links"]["file"].as_str().unwrap()).send().await.expect(200);
    }
    let one = json!({"type": "slice"});
    let single = client.succeed(&jobs::with(jobs::quick(6), "/postprocess", one)).await;
    let request = client.request_of(id_of(&single)).await;
    assert_eq!(request["postprocess"], json!({"type": "slice", "format": "svg", "axis": "z"}));
    assert_eq!(single["exports"].as_array().unwrap().len(), 1);

    let nine: Vec<Value> = (1..10).map(|cells| json!({"type": "voxels", "cells": cells})).collect();
    for (postprocess, kind, pointer) in [
        (json!({"type": "voxels", "cells": 0}), "validation-error", "/postprocess/cells"),
        (
            json!([{"type": "slice"}, {"type": "voxels", "cells": 0}]),
            "validation-error",
            "/postprocess/1/cells",
        ),
        (json!([{"type": "slice", "at_mm": 41}]), "validation-error", "/postprocess/0/at_mm"),
        (json!({"type": "slice", "at_mm": 41}), "validation-error", "/postprocess/at_mm"),
        (json!([{"type": "voxels", "cells": 8000}]), "too-large", "/postprocess/0/cells"),
        (json!("raw"), "validation-error", "/postprocess"),
        (json!(nine), "validation-error", "/postprocess"),
    ] {
        let job = jobs::with(jobs::quick(7), "/postprocess", postprocess);
        let problem = client.post("/v1/jobs").json(&job).send().await.expect_problem(422, kind);
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem:#}");
        assert!(problem["detail"].as_str().unwrap().starts_with(pointer), "{problem:#}");
        client.post("/v1/plans").json(&job).send().await.expect_problem(422, kind);
    }
    server.stop().await;
}

#[tokio::test]
async fn jobs_of_a_study_have_models_too() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let template =
        jobs::with(template_of(), "/postprocess", json!([{"type": "voxels", "format": "raw", "cells": 8}]));
    let study =
        json!({"seed": 1, "template": template, "grid": {"/postprocess/0/cells": [6, 7]}, "replicates": 2});
    let study = client.submit_study(&study).await;
    client.study_finished(id_of(&study)).await;
    for job in client.jobs_of(id_of(&study)).await {
        let job = client.job(id_of(&job)).await;
        let [model] = &job["exports"].as_array().unwrap()[..] else { panic!("{job:#}") };
        let path = model["links"]["self"].as_str().unwrap();
        let done = client.get(path).header("prefer", "wait=60").send().await.expect(200).json();
        let request = client.request_of(id_of(&job)).await;
        assert_eq!(done["report"]["shape"][0], request["postprocess"][0]["cells"]);
    }
    let wrong = json!({"seed": 1, "template": jobs::with(template_of(), "/postprocess", json!({"type": "slice", "at_mm": 99}))});
    let problem =
        client.post("/v1/studies").json(&wrong).send().await.expect_problem(422, "validation-error");
    assert_eq!(problem["errors"][0]["pointer"], "/template/postprocess/at_mm", "{problem:#}");
    client.delete(&format!("/v1/studies/{}", id_of(&study))).send().await.expect(204);
    crate::harness::deadline::eventually("all files to go", || data_dir.artifacts().is_empty()).await;
    server.stop().await;
}

fn template_of() -> Value {
    let mut template = jobs::quick(0);
    template.as_object_mut().unwrap().remove("seed");
    template
}

/// From an export of the service, from `postprocess` and from the command line alike.
#[tokio::test]
async fn the_quality_is_a_document_of_the_result() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = jobs::with(jobs::quick_growth(4), "/postprocess", json!({"type": "quality"}));
    let done = client.succeed(&job).await;
    let path = format!("/v1/jobs/{}/exports/quality", id_of(&done));
    let reply = client.get(&path).send().await;
    let quality = reply.expect(200).json();
    let summary = client.result(id_of(&done)).await["summary"].clone();
    assert_eq!(quality["grains"], summary["grains"]);
    let of_class = |name: &'static str| {
        let classes = quality["classes"].as_array().unwrap().iter();
        classes.map(move |class| class[name].as_f64().unwrap()).sum::<f64>()
    };
    assert!(
        (of_class("volume_share") - 1.0).abs() < 1e-9 && of_class("grains") == summary["grains"],
        "{quality:#}"
    );
    let volume: f64 = quality["walls"]["layers"]
        .as_array()
        .unwrap()
        .iter()
        .chain([&quality["walls"]["core"]])
        .map(|layer| {
            let fractions = layer["volume_fraction"].as_array().unwrap().iter();
            layer["volume_mm3"].as_f64().unwrap() * fractions.map(|x| x.as_f64().unwrap()).sum::<f64>()
        })
        .sum();
    let known = summary["volume_fraction_effective"].as_f64().unwrap() * 40.0_f64.powi(3);
    assert!((volume / known - 1.0).abs() < 1e-3, "{volume} {known}");
    for part in ["gaps", "contacts", "bond_order", "blocks"] {
        assert!(quality[part].is_object(), "{part}: {quality:#}");
    }

    let status = client.get(&format!("{path}/status")).send().await.expect(200).json();
    assert_eq!((&status["kept"], &status["report"]["grains"]), (&json!(true), &quality["grains"]));
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
    let ended = packstone(directory.path(), &["run", "job.json", "--out", "out"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let written = std::fs::read(directory.path().join("out/result.quality.json")).unwrap();
    assert!(reply.body == written, "the command line measures another quality");
    client.get(&format!("{path}?format=csv")).send().await.expect_problem(400, "validation-error");
    server.stop().await;
}

#[tokio::test]
async fn capabilities_and_metrics_tell_of_models() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let capabilities = client.get("/v1/capabilities").send().await.expect(200).json();
    let exports = capabilities["exports"].as_array().unwrap();
    let (id, _) = packed(&client, 8).await;
    let stone = json!({"youngs_modulus_gpa": 70, "poissons_ratio": 0.2});
    let materials = json!({"matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2}, "aggregate": stone});
    let materials = crate::properties::urlencode(&materials.to_string());
    let mut seen = 0;
    for export in exports {
        let kind = export["type"].as_str().unwrap();
        for format in export["formats"].as_array().unwrap() {
            let options = format["options"].as_array().unwrap();
            // A table of shapes and the quality have no options beside their format.
            assert_eq!(options.is_empty(), ["shapes", "quality"].contains(&kind), "{kind} {format:#}");
            assert!(!options.contains(&json!("format")), "{kind} {format:#}");
            let name = format["name"].as_str().unwrap();
            seen += 1;
            let of_gmsh =
                if kind == "slice" { &["msh", "inp", "vtu"][..] } else { &["inp", "vtu", "med"][..] };
            if ["mesh", "slice"].contains(&kind) && of_gmsh.contains(&name) {
                // Gmsh makes these, where there is one: `tetrahedra` and `plane_models` test them.
                continue;
            }
            // A format for one program needs its name, and says so.
            let programs = format["programs"].as_array().unwrap();
            assert_eq!(programs.is_empty(), !options.contains(&json!("for")), "{kind} {format:#}");
            let path = format!("/v1/jobs/{id}/exports/{kind}?format={name}");
            if format["needs_program"] == true {
                let problem = client.get(&path).send().await.expect_problem(400, "validation-error");
                assert!(problem.to_string().contains("must have for="), "{problem:#}");
            }
            for program in programs {
                let fast = if program == "fans" { format!("&materials={materials}") } else { String::new() };
                let path = format!("{path}&for={}&cells=8{fast}", program.as_str().unwrap());
                let reply = client.head(&path).send().await;
                assert_eq!(reply.expect(200).header("content-type"), format["media_type"].as_str().unwrap());
            }
            if format["needs_program"] == true {
                continue;
            }
            let fast = match kind {
                "voxels" => "&cells=8".to_owned(),
                // What needs materials.
                "properties" | "deck" => format!("&cells=8&materials={materials}"),
                _ => String::new(),
            };
            let reply = client.head(&format!("{path}{fast}")).send().await;
            assert_eq!(reply.expect(200).header("content-type"), format["media_type"].as_str().unwrap());
        }
    }
    assert_eq!(seen, 31);
    let metrics = String::from_utf8(client.get("/metrics").send().await.expect(200).body.to_vec()).unwrap();
    // Four formats alone, and those of four programs.
    let counted = "packstone_export_duration_seconds_count{type=\"voxels\",outcome=\"succeeded\"} 8";
    assert!(metrics.lines().any(|line| line == counted), "{metrics}");
    assert!(metrics.lines().any(|line| line == "packstone_exports{state=\"failed\"} 0"), "{metrics}");
    server.stop().await;
}
