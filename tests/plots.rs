//! Plots of a result: pictures that name what they show, the same for the same result wherever it is drawn.

use std::fs;

use serde_json::{Value, json};

use crate::harness::{DataDir, Server, id_of, jobs, packstone};

const KINDS: [&str; 4] = ["grading", "distance", "radial", "profile"];

fn text_of(body: &[u8]) -> String {
    String::from_utf8(body.to_vec()).expect("an SVG is text")
}

#[tokio::test]
async fn every_kind_is_a_picture_with_a_tag_of_its_own() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::with(jobs::quick(1), "/name", json!("TB-7 & <others>"))).await;
    let mut tags = Vec::new();
    for (kind, says) in [
        ("grading", "passing by mass in %"),
        ("distance", "prescribed its distance"),
        ("radial", "clear distance between grains in mm"),
        ("profile", "depth from the wall in mm"),
    ] {
        let path = job["links"]["plots"][kind].as_str().unwrap().to_owned();
        assert_eq!(path, format!("/v1/jobs/{}/plots/{kind}", id_of(&job)));
        let reply = client.get(&path).send().await;
        assert_eq!(reply.expect(200).header("content-type"), "image/svg+xml");
        let drawn = text_of(&reply.body);
        assert!(drawn.starts_with("<svg ") && drawn.trim_end().ends_with("</svg>"), "{drawn}");
        assert!(drawn.contains(says), "{kind} does not say {says:?}:\n{drawn}");
        assert!(drawn.contains("TB-7 &amp; &lt;others&gt;") && !drawn.contains("<others>"), "{drawn}");

        let etag = reply.header("etag").to_owned();
        assert!(etag.starts_with('"'), "{etag} is not strong");
        let known = client.get(&path).header("if-none-match", &etag).send().await;
        assert!(known.expect(304).body.is_empty());
        assert_eq!(known.header("etag"), etag);
        let head = client.head(&path).send().await;
        assert!(head.expect(200).body.is_empty());
        assert_eq!(head.header("etag"), etag);
        let again = client.get(&path).header("if-none-match", "\"another\"").send().await;
        assert!(again.expect(200).body == reply.body, "{kind} is drawn anew in other bytes");
        tags.push(etag);
    }
    tags.sort();
    tags.dedup();
    assert_eq!(tags.len(), KINDS.len(), "kinds share a tag");
    server.stop().await;
}

#[tokio::test]
async fn what_cannot_be_plotted_is_refused_with_the_reason() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(2)).await;
    let plots = format!("/v1/jobs/{}/plots", id_of(&job));
    let problem = client.get(&format!("{plots}/pie")).send().await.expect_problem(404, "not-found");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("\"pie\"") && KINDS.iter().all(|kind| detail.contains(kind)), "{detail}");
    let problem = client.get(&format!("{plots}/grading?colour=red")).send().await;
    let problem = problem.expect_problem(400, "validation-error");
    assert!(problem["detail"].as_str().unwrap().contains("colour"), "{problem:#}");
    client.get("/v1/jobs/none/plots/grading").send().await.expect_problem(404, "not-found");

    let failed = client.submit(&jobs::unreachable()).await;
    client.finished(id_of(&failed)).await;
    let path = format!("/v1/jobs/{}/plots/grading", id_of(&failed));
    client.get(&path).send().await.expect_problem(409, "job-failed");
    let running = client.submit(&jobs::endless()).await;
    let path = format!("/v1/jobs/{}/plots/grading", id_of(&running));
    client.get(&path).send().await.expect_problem(409, "result-not-ready");
    server.stop().await;
}

#[tokio::test]
async fn a_largest_distance_is_drawn_over_time() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = jobs::with(jobs::quick_growth(3), "/distance", json!({"type": "maximize"}));
    let job = jobs::with(job, "/method/stop", json!({"events": 200_000}));
    let job = client.succeed(&job).await;
    let reply = client.get(&format!("/v1/jobs/{}/plots/distance", id_of(&job))).send().await;
    let drawn = text_of(&reply.expect(200).body);
    assert!(drawn.contains("packing time in s") && drawn.contains("<polyline"), "{drawn}");
    server.stop().await;
}

#[tokio::test]
async fn run_draws_what_the_service_draws() {
    let job = jobs::with(jobs::quick(4), "/name", json!("the same"));
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
    let all = KINDS.join(",");
    let ended =
        packstone(directory.path(), &["run", "job.json", "--out", "out", "--format", "csv", "--plot", &all])
            .await;
    assert_eq!(ended.code, Some(0), "{ended:?}");

    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let done: Value = client.succeed(&job).await;
    for kind in KINDS {
        let file = format!("plot-{kind}.svg");
        assert!(ended.stdout.contains(&file), "{}", ended.stdout);
        let written = fs::read(directory.path().join("out").join(&file)).unwrap();
        let served = client.get(&format!("/v1/jobs/{}/plots/{kind}", id_of(&done))).send().await;
        assert!(served.expect(200).body == written, "{file} is another picture");
    }
    server.stop().await;

    let refused = packstone(directory.path(), &["run", "job.json", "--plot", "pie"]).await;
    assert!(refused.code != Some(0) && refused.stderr.contains("pie") && refused.stderr.contains("radial"));
}

#[tokio::test]
async fn a_study_is_drawn_against_its_columns() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut template = jobs::quick(1);
    template.as_object_mut().unwrap().remove("seed");
    let study = client
        .submit_study(&json!({
            "name": "<TB-7>", "seed": 7, "template": template,
            "grid": {"/mix/volume_fraction": [0.30, 0.35], "/method": [{"type": "rsa"}, {"type": "edmd"}]}
        }))
        .await;
    let id = id_of(&study).to_owned();
    client.study_finished(&id).await;
    let plots = format!("/v1/studies/{id}/plots");
    let get = async |query: &str| client.get(&format!("{plots}/{query}")).send().await;

    for (query, says) in [
        ("success", "success rate in %"),
        ("time", "time of all runs per success in s"),
        ("distance", "distance in mm"),
        ("curve", "packing time in s"),
        ("volume_fraction", "volume fraction with the coating in %"),
        ("event_time", "time per event in \u{3BC}s"),
        ("success?x=grains&log_x=true", "number of grains N"),
    ] {
        let reply = get(query).await;
        assert_eq!(reply.expect(200).header("content-type"), "image/svg+xml");
        let drawn = text_of(&reply.body);
        assert!(drawn.contains(says), "{query} does not say {says:?}:\n{drawn}");
        assert!(drawn.contains("&lt;TB-7&gt;") && !drawn.contains("<TB-7>"), "{drawn}");
        if !query.contains("curve") {
            // Placing has no events to time.
            let placing = drawn.contains("\nrsa\n") != query.contains("event_time");
            assert!(placing && drawn.contains("\nedmd\n"), "{query} has other series:\n{drawn}");
        }
        let etag = reply.header("etag");
        let known = client.get(&format!("{plots}/{query}")).header("if-none-match", etag).send().await;
        assert!(known.expect(304).body.is_empty());
    }
    for (query, says) in
        [("success?x=/method", "/mix/volume_fraction, grains"), ("success?log_x=maybe", "true or false")]
    {
        let problem = get(query).await.expect_problem(400, "validation-error");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(says), "{query}: {detail}");
    }
    let problem = get("pie").await.expect_problem(404, "not-found");
    assert!(problem["detail"].as_str().unwrap().contains("event_time"), "{problem:#}");
    assert_eq!(study["links"]["plots"]["time"], format!("{plots}/time"));
    client.get("/v1/studies/none/plots/success").send().await.expect_problem(404, "not-found");
    server.stop().await;
}
