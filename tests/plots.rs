//! Plots of results and of studies: labels, tags, refusals, and the same bytes from the service and the command line.

use std::fs;

use serde_json::{Value, json};

use crate::harness::{DataDir, Server, id_of, jobs, packstone};

const KINDS: [&str; 7] = ["grading", "distance", "radial", "profile", "zingg", "flakiness", "quality"];

fn text_of(body: &[u8]) -> String {
    String::from_utf8(body.to_vec()).expect("an SVG is text")
}

#[tokio::test]
async fn every_kind_is_a_picture_with_a_tag_of_its_own() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    // Grown, so that it has a distance over time, and with grains enough for a pair correlation function.
    let job = jobs::with(jobs::quick_growth(1), "/mix/d_min_mm", json!(2.0));
    let job = client.succeed(&jobs::with(job, "/name", json!("TB-7 & <others>"))).await;
    let mut tags = Vec::new();
    for (kind, says) in [
        ("grading", "mass passing in %"),
        ("distance", "distance between grains in mm"),
        ("radial", "gap between grains in mm"),
        ("profile", "depth from the wall in mm"),
        ("quality", "distance from the nearest wall in mm"),
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
        let light = client.get(&format!("{path}?theme=light")).send().await;
        assert!(light.expect(200).body == reply.body, "{kind}: light is what is drawn without a word");
        let dark = text_of(&client.get(&format!("{path}?theme=dark")).send().await.expect(200).body);
        assert!(dark.contains("#E5E8EB") && !dark.contains("=\"#FFFFFF\"") && !dark.contains("=\"#000000\""));
        assert!(dark.contains(says) && dark.matches('<').count() == drawn.matches('<').count(), "{dark}");
        let unknown = client.get(&format!("{path}?theme=blue")).send().await;
        unknown.expect_problem(400, "validation-error");
        let again = client.get(&path).header("if-none-match", "\"another\"").send().await;
        assert!(again.expect(200).body == reply.body, "{kind} is drawn anew in other bytes");
        tags.push(etag);
    }
    tags.sort();
    tags.dedup();
    // Spheres have no plots of shapes.
    assert_eq!(tags.len(), KINDS.len() - 2, "kinds share a tag");
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

/// The distance that grains keep while they grow, be it prescribed or the largest.
#[tokio::test]
async fn the_distance_of_grown_grains_is_drawn_over_time() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let largest = jobs::with(jobs::quick_growth(3), "/distance", json!({"type": "maximize"}));
    let largest = jobs::with(largest, "/method/stop", json!({"events": 200_000}));
    for job in [largest, jobs::quick_growth(3)] {
        let job = client.succeed(&job).await;
        let reply = client.get(&format!("/v1/jobs/{}/plots/distance", id_of(&job))).send().await;
        let drawn = text_of(&reply.expect(200).body);
        assert!(drawn.contains("packing time in s") && drawn.contains("<polyline"), "{drawn}");
    }
    server.stop().await;
}

#[tokio::test]
async fn run_draws_what_the_service_draws() {
    let job = jobs::with(jobs::quick(4), "/name", json!("the same"));
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
    // All that do not show times on the clock, which differ from run to run.
    let kinds = ["grading", "radial", "profile"];
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let done: Value = client.succeed(&job).await;
    for (folder, flags, query) in [("out", &[][..], ""), ("bare", &["--no-plot-titles"], "?title=false")] {
        let all = kinds.join(",");
        let args = ["run", "job.json", "--out", folder, "--format", "csv", "--plot", &all];
        let ended = packstone(directory.path(), &[&args[..], flags].concat()).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        for kind in kinds {
            let file = format!("plot-{kind}.svg");
            assert!(ended.stdout.contains(&file), "{}", ended.stdout);
            let written = fs::read(directory.path().join(folder).join(&file)).unwrap();
            let served = client.get(&format!("/v1/jobs/{}/plots/{kind}{query}", id_of(&done))).send().await;
            assert!(served.expect(200).body == written, "{folder}/{file} is another picture");
            let titled = text_of(&written).contains(": the same\n</text>");
            assert_eq!(titled, query.is_empty(), "{folder}/{file}");
        }
    }
    let problem = client.get(&format!("/v1/jobs/{}/plots/radial?title=no", id_of(&done))).send().await;
    assert!(problem.expect_problem(400, "validation-error")["detail"].as_str().unwrap().contains("title"));
    server.stop().await;

    let refused = packstone(directory.path(), &["run", "job.json", "--plot", "pie"]).await;
    assert!(refused.code != Some(0) && refused.stderr.contains("pie") && refused.stderr.contains("radial"));
}

/// A plot without data is refused, by the service and by the command line with the same reason, instead of an empty
/// frame.
#[tokio::test]
async fn a_plot_that_a_packing_does_not_have_is_refused_with_the_packings_that_have_it() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let directory = tempfile::tempdir().unwrap();
    let touching = json!({"type": "none"});
    let growing = jobs::quick_growth(5);
    let cases = [
        // The method `auto` inserts these grains at random: that is known only when they are packed.
        ("distance", jobs::quick(5), "random sequential addition", true),
        (
            "distance",
            jobs::with(jobs::quick(5), "/method", json!({"type": "rsa"})),
            "random sequential addition",
            false,
        ),
        ("distance", jobs::with(growing, "/distance", touching), "no distance between grains", false),
        ("profile", jobs::equal_spheres(200, 5), "a periodic box has no walls", false),
        ("zingg", jobs::quick(5), "all grains are spheres", false),
        ("flakiness", jobs::quick(5), "all grains are spheres", false),
    ];
    for (kind, job, says, packs) in cases {
        let done = client.succeed(&job).await;
        let path = format!("/v1/jobs/{}/plots/{kind}", id_of(&done));
        let problem = client.get(&path).send().await.expect_problem(422, "format-not-available");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(says) && detail.contains(&format!("a `{kind}`")), "{detail}");
        client.head(&path).send().await.expect(422);

        fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
        let both = format!("{kind},grading");
        let args = ["run", "job.json", "--out", "out", "--force", "--plot", &both];
        let ended = packstone(directory.path(), &args).await;
        assert_eq!(ended.code, Some(3), "{ended:?}");
        let line = format!("out/plot-{kind}.svg was not made: {detail}");
        assert!(ended.stderr.contains(&line), "{line:?} is not in {}", ended.stderr);
        let out = directory.path().join("out");
        assert!(!out.join(format!("plot-{kind}.svg")).exists());
        // Refused before the work where that is possible; else after all that could be written.
        for file in ["result.json", "plot-grading.svg"] {
            assert_eq!(out.join(file).exists(), packs, "{file} of {job}");
        }
        let _ = fs::remove_dir_all(out);
    }
    server.stop().await;
}

/// Zingg's diagram and the flakiness by size, from the service and the command line alike.
#[tokio::test]
async fn grains_that_are_no_spheres_have_plots_of_their_shapes() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let directory = tempfile::tempdir().unwrap();
    let flaky = json!({"type": "ellipsoid", "ratios": {"type": "flakiness", "index": 0.25}});
    let angular = json!({"type": "polyhedron", "template_count": 3});
    for (shape, disc, requested) in
        [(flaky, "\ngrain, area", true), (angular, "\ngrains of a template, area", false)]
    {
        let job = json!({
            "seed": 1, "specimen": {"type": "box", "size_mm": [40, 40, 40]}, "method": {"type": "rsa"},
            "mix": {
                "grading": {"type": "fuller", "d_max_mm": 10, "exponent": 0.5}, "d_min_mm": 3, "volume_fraction": 0.25, "shape": shape,
                "volume_fraction_of": "placed_grains"
            }
        });
        let done = client.succeed(&job).await;
        fs::write(directory.path().join("job.json"), job.to_string()).unwrap();
        let args = ["run", "job.json", "--out", "out", "--force", "--plot", "zingg,flakiness"];
        let ended = packstone(directory.path(), &args).await;
        assert_eq!(ended.code, Some(0), "{ended:?}");
        for (kind, says) in [("zingg", disc), ("flakiness", "\nall grains, ")] {
            let reply = client.get(&format!("/v1/jobs/{}/plots/{kind}", id_of(&done))).send().await;
            let drawn = text_of(&reply.expect(200).body);
            assert!(drawn.contains(says), "{kind} does not say {says:?}:\n{drawn}");
            let written = fs::read(directory.path().join(format!("out/plot-{kind}.svg"))).unwrap();
            assert!(reply.body == written, "{kind} is another picture");
            if kind == "zingg" {
                for class in ["disc", "equant", "blade", "rod"] {
                    assert!(drawn.contains(&format!("\n{class} ")), "{class}:\n{drawn}");
                }
            } else {
                assert_eq!(drawn.contains("\nrequested index, 25 %\n"), requested, "{drawn}");
                // The ticks are the sieves of the fractions that have grains.
                assert!(drawn.contains("\n6.3\n") && !drawn.contains("\n16\n"), "{drawn}");
            }
        }
    }
    server.stop().await;
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
        ("time", "time per success in s"),
        ("distance", "median distance between grains in mm"),
        ("curve", "packing time in s"),
        ("volume_fraction", "volume fraction with coating in %"),
        ("event_time", "time per event in \u{3BC}s"),
        ("success?x=grains&log_x=true", "number of grains N"),
        ("success?title=false", "success rate in %"),
        ("success?theme=dark", "success rate in %"),
    ] {
        let reply = get(query).await;
        assert_eq!(reply.expect(200).header("content-type"), "image/svg+xml");
        let drawn = text_of(&reply.body);
        assert!(drawn.contains(says), "{query} does not say {says:?}:\n{drawn}");
        assert!(drawn.contains("&lt;TB-7&gt;") && !drawn.contains("<TB-7>"), "{drawn}");
        assert_eq!(
            drawn.contains("&lt;TB-7&gt;\n</text>"),
            query != "success?title=false",
            "{query}: {drawn}"
        );
        if !query.contains("curve") {
            // Random sequential addition has no events.
            let inserted = drawn.contains("\nRSA\n") != query.contains("event_time");
            assert!(inserted && drawn.contains("\nEDMD\n"), "{query} has other series:\n{drawn}");
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

/// While runs are waiting their data may still come; afterwards they do not.
#[tokio::test]
async fn a_plot_that_no_run_of_a_study_has_is_refused() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let open = client.submit_study(&json!({"list": [jobs::endless()]})).await;
    let plots = format!("/v1/studies/{}/plots", id_of(&open));
    let problem =
        client.get(&format!("{plots}/success")).send().await.expect_problem(409, "result-not-ready");
    assert!(problem["detail"].as_str().unwrap().contains("no run has ended"), "{problem:#}");
    client.post(&format!("/v1/studies/{}/cancel", id_of(&open))).send().await.expect(202);

    let inserted = client.submit_study(&json!({"list": [jobs::quick(6)]})).await;
    client.study_finished(id_of(&inserted)).await;
    let plots = format!("/v1/studies/{}/plots", id_of(&inserted));
    for (kind, says) in [
        ("curve", "(method `growth`) with a constant or the largest distance"),
        ("event_time", "runs by `edmd` have events"),
    ] {
        let reply = client.get(&format!("{plots}/{kind}")).send().await;
        let problem = reply.expect_problem(422, "format-not-available");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(says), "{kind}: {detail}");
    }
    client.get(&format!("{plots}/success?x=grains")).send().await.expect(200);
    server.stop().await;
}
