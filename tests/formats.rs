//! Every form of a result holds the same numbers, and is found by name or by media type.

use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde_json::json;

use crate::harness::{Client, DataDir, Server, id_of, jobs, results};

const MEDIA_TYPES: [(&str, &str); 7] = [
    ("json", "application/json"),
    ("csv", "text/csv"),
    ("vtk", "application/vnd.vtk.legacy"),
    ("vtp", "application/vnd.vtk.polydata+xml"),
    ("npy", "application/x-npy"),
    ("view", "application/vnd.packstone.view"),
    ("html", "text/html"),
];

#[tokio::test]
async fn all_formats_agree_to_the_last_bit() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(11)).await;
    let id = id_of(&job);

    let expected = results::from_json(&client.result(id).await);
    assert!(expected.len() > 100, "{} spheres are too few to show anything", expected.len());
    // Equality of f64 would take 0.0 for -0.0.
    let bits = |rows: &results::Rows| rows.iter().map(|row| row.map(f64::to_bits)).collect::<Vec<_>>();
    for (format, read) in [
        ("csv", results::from_csv as fn(&[u8]) -> results::Rows),
        ("npy", results::from_npy),
        ("vtp", results::from_vtp),
        ("vtk", results::from_vtk),
    ] {
        let rows = read(&client.result_in(id, format).await);
        assert!(bits(&rows) == bits(&expected), "{format} differs from json");
    }
    let listed: Vec<&str> = job["result"]["formats"].as_array().unwrap().iter().map(format_name).collect();
    assert_eq!(listed.len(), MEDIA_TYPES.len());
    for (format, _) in MEDIA_TYPES {
        assert!(listed.contains(&format), "{format} is not among {listed:?}");
    }
    server.stop().await;
}

/// The job's `result.formats` names its formats, be it as text or as objects.
fn format_name(format: &serde_json::Value) -> &str {
    format.as_str().or_else(|| format["name"].as_str()).expect("a format has a name")
}

#[tokio::test]
async fn a_format_is_chosen_by_query_then_by_accept() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(12)).await;
    let path = format!("/v1/jobs/{}/result", id_of(&job));

    for (format, media_type) in MEDIA_TYPES {
        let by_name =
            client.get(&format!("{path}?format={format}")).header("accept", "image/png").send().await;
        let by_accept = client.get(&path).header("accept", media_type).send().await;
        for reply in [&by_name, &by_accept] {
            let content_type = reply.expect(200).header("content-type");
            assert_eq!(content_type.split(';').next(), Some(media_type));
            assert_eq!(reply.header("content-length"), reply.body.len().to_string());
        }
        assert_eq!(by_name.body, by_accept.body);
        let disposition = by_name.header("content-disposition");
        assert!(disposition.contains(&format!(".{format}")), "{disposition}");
    }
    for (accept, expected) in [
        ("*/*", "application/json"),
        ("text/*", "text/csv"),
        ("text/csv;q=0.4, application/x-npy;q=0.8", "application/x-npy"),
        ("image/png, application/json;q=0.1", "application/json"),
        ("application/json;q=0, */*", "text/csv, application/vnd.vtk.legacy, application/x-npy"),
    ] {
        let reply = client.get(&path).header("accept", accept).send().await;
        let content_type = reply.expect(200).header("content-type").split(';').next().unwrap();
        assert!(content_type == expected || accept.contains("q=0,"), "{accept} gave {content_type}");
        assert!(!accept.contains("json;q=0,") || content_type != "application/json");
    }
    nothing_acceptable(&client, &path).await;
    server.stop().await;
}

async fn nothing_acceptable(client: &Client, path: &str) {
    let problem =
        client.get(path).header("accept", "image/png").send().await.expect_problem(406, "not-acceptable");
    let detail = problem["detail"].as_str().unwrap();
    for (format, _) in MEDIA_TYPES {
        assert!(detail.contains(format), "{detail}");
    }
    let reply = client.get(&format!("{path}?format=xlsx")).send().await;
    let problem = reply.expect_problem(406, "not-acceptable");
    assert!(problem["detail"].as_str().unwrap().contains("xlsx"), "{problem:#}");
}

/// The form for viewers is shorter and coarser than the others; any prefix of it holds the largest grains.
#[tokio::test]
async fn the_form_for_viewers_holds_the_grains_and_is_sent_in_parts() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(13)).await;
    let id = id_of(&job);
    let size = client.request_of(id).await["specimen"]["size_mm"].clone();
    let size: Vec<f64> = size.as_array().unwrap().iter().map(|edge| edge.as_f64().unwrap()).collect();
    let rows = results::from_json(&client.result(id).await);
    let view = client.result_in(id, "view").await;
    assert_eq!((&view[..8], view.len()), (&b"PKSTVIEW"[..], 64 + 8 * rows.len()));
    let number = |at: usize| f64::from(u16::from_le_bytes([view[at], view[at + 1]])) / 65_535.0;
    let largest = f64::from(f32::from_le_bytes(view[32..36].try_into().unwrap()));
    for (i, row) in rows.iter().enumerate() {
        let at = 64 + 8 * i;
        for axis in 0..3 {
            let place = number(at + 2 * axis) * size[axis];
            assert!((place - row[axis]).abs() < size[axis] / 65_535.0, "grain {i}: {place} of {row:?}");
        }
        let d = number(at + 6) * largest;
        assert!((d - row[3]).abs() < largest / 65_535.0, "grain {i}: {d} of {row:?}");
    }
    let path = format!("/v1/jobs/{id}/result?format=view");
    let etag = client.head(&path).send().await.header("etag").to_owned();
    let first = client.get(&path).header("range", "bytes=0-143").header("if-range", &etag).send().await;
    assert_eq!(first.expect(206).body, view[..144]);
    let rest = client.get(&path).header("range", "bytes=144-").header("if-range", &etag).send().await;
    assert_eq!(rest.expect(206).body, view[144..]);
    client.get(&path).header("if-none-match", &etag).send().await.expect(304);
    server.stop().await;
}

/// The page holds the grains of the form for viewers, and does not change between two requests.
#[tokio::test]
async fn the_page_holds_the_grains_and_is_sent_in_parts() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let id = id_of(&client.succeed(&jobs::quick(14)).await).to_owned();
    let page = client.result_in(&id, "html").await;
    let text = std::str::from_utf8(&page).unwrap();
    let grains = BASE64_STANDARD.encode(client.result_in(&id, "view").await);
    assert!(text.starts_with("<!doctype html>") && text.contains(&format!(">{grains}<")));
    assert!(text.contains(&format!("\"job_id\":\"{id}\"")), "the result is there without its grains");
    let path = format!("/v1/jobs/{id}/result?format=html");
    let head = client.head(&path).send().await;
    assert_eq!(head.header("content-length"), page.len().to_string());
    assert!(head.header("content-disposition").starts_with("attachment;"), "a page of a job is not run here");
    let etag = head.header("etag").to_owned();
    let rest = client.get(&path).header("range", "bytes=15-").header("if-range", &etag).send().await;
    assert_eq!(rest.expect(206).body, page[15..]);
    client.get(&path).header("if-none-match", &etag).send().await.expect(304);
    server.stop().await;
}

#[tokio::test]
async fn a_packing_of_one_grain_has_every_format() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = json!({
        "seed": 1,
        "specimen": {"type": "cylinder", "diameter_mm": 20, "height_mm": 20},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [10]}}
    });
    let job = client.succeed(&job).await;
    let id = id_of(&job);
    let result = client.result(id).await;
    assert!(result["check"]["min_gap_mm"].is_null(), "one grain has no neighbour");
    let expected = results::from_json(&result);
    assert_eq!(expected.len(), 1);
    assert_eq!(results::from_csv(&client.result_in(id, "csv").await), expected);
    assert_eq!(results::from_npy(&client.result_in(id, "npy").await), expected);
    assert_eq!(results::from_vtp(&client.result_in(id, "vtp").await), expected);
    assert_eq!(results::from_vtk(&client.result_in(id, "vtk").await), expected);
    assert_eq!(client.result_in(id, "view").await.len(), 72);
    server.stop().await;
}
