//! Changes of a job by PATCH, conditions by If-Match, and the filters of listings that changes are seen in.

use reqwest::Method;
use serde_json::json;

use crate::harness::{Client, DataDir, Reply, Server, id_of, jobs};

async fn patch(client: &Client, id: &str, body: &str, tag: Option<&str>) -> Reply {
    let mut request = client.request(Method::PATCH, &format!("/v1/jobs/{id}"));
    if let Some(tag) = tag {
        request = request.header("if-match", tag);
    }
    request.header("content-type", "application/merge-patch+json").body(body.to_owned()).send().await
}

#[tokio::test]
async fn a_job_is_changed_by_a_merge_patch() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let running = client.submit(&jobs::endless()).await;
    client.running(id_of(&running)).await;
    let waiting = jobs::with(jobs::quick(1), "/labels", json!({"series": "a", "run:1": "x"}));
    let waiting = client.submit(&waiting).await;
    let id = id_of(&waiting);

    let body = r#"{"name": "beam", "priority": 7, "labels": {"series": "b", "run:1": null}, "expires_at": "2999-01-01T00:00:00Z"}"#;
    let reply = patch(&client, id, body, None).await;
    let changed = reply.expect(200).json();
    assert_eq!((&changed["name"], &changed["priority"]), (&json!("beam"), &json!(7)));
    assert_eq!(changed["labels"], json!({"series": "b"}));
    assert_eq!(changed["expires_at"], "2999-01-01T00:00:00Z");
    let cleared =
        patch(&client, id, r#"{"name": null, "expires_at": null}"#, Some(reply.header("etag"))).await;
    assert!(cleared.expect(200).json()["name"].is_null() && cleared.json()["expires_at"].is_null());

    patch(&client, id, r#"{"seed": 1}"#, None).await.expect_problem(422, "validation-error");
    patch(&client, id_of(&running), r#"{"priority": 1}"#, None).await.expect_problem(409, "conflict");
    patch(&client, id_of(&running), r#"{"name": "long"}"#, None).await.expect(200);
    patch(&client, "00000000-0000-7000-8000-000000000000", "{}", None).await.expect_problem(404, "not-found");
}

#[tokio::test]
async fn nothing_is_done_to_what_has_changed_since() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let path = format!("/v1/jobs/{}", id_of(&job));
    for tag in ["\"999\"", "W/\"1\"", "nonsense"] {
        let refused = client.delete(&path).header("if-match", tag).send().await;
        refused.expect_problem(412, "precondition-failed");
        let refused = client.post(&format!("{path}/cancel")).header("if-match", tag).send().await;
        refused.expect_problem(412, "precondition-failed");
        patch(&client, id_of(&job), "{}", Some(tag)).await.expect_problem(412, "precondition-failed");
    }
    let tag = client.get(&path).send().await.expect(200).header("etag").to_owned();
    client.delete(&path).header("if-match", &tag).send().await.expect(204);

    let study = client.submit_study(&json!({"list": [jobs::quick(1)]})).await;
    let path = format!("/v1/studies/{}", id_of(&study));
    client.study_finished(id_of(&study)).await;
    let refused = client.delete(&path).header("if-match", "\"999\"").send().await;
    refused.expect_problem(412, "precondition-failed");
    client.delete(&path).header("if-match", "*").send().await.expect(204);
}

#[tokio::test]
async fn listings_are_filtered_and_sorted() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    client.submit(&jobs::endless()).await;
    let mut ids = Vec::new();
    for (name, method) in [("beam 1", "rsa"), ("beam 2", "auto"), ("slab", "rsa")] {
        let job = jobs::with(jobs::quick(1), "/name", json!(name));
        let job = jobs::with(job, "/method", json!({"type": method}));
        ids.push(id_of(&client.submit(&job).await).to_owned());
    }
    let listed = async |query: &str| -> Vec<String> {
        let page = client.get(&format!("/v1/jobs?{query}")).send().await.expect(200).json();
        page["items"].as_array().unwrap().iter().map(|job| id_of(job).to_owned()).collect()
    };
    assert_eq!(listed("name=beam").await, [ids[1].clone(), ids[0].clone()]);
    assert_eq!(listed("name=BEAM").await, [ids[1].clone(), ids[0].clone()], "in any case");
    // What jobs pack is said where it is asked for, and all that fit are counted on any page.
    let page =
        client.get("/v1/jobs?name=beam&overview=true&totals=true&limit=1").send().await.expect(200).json();
    let totals = &page["totals"];
    assert_eq!((&totals["jobs"], &totals["more"]), (&json!(2), &json!(false)));
    assert!(totals["bytes"].is_u64(), "{totals}");
    let overview = &page["items"][0]["overview"];
    assert_eq!((&overview["curve"], &overview["shape"]), (&json!("A16"), &json!("spheres")));
    let of_job = client.get(&format!("/v1/jobs/{}?overview=true", ids[1])).send().await.expect(200).json();
    assert_eq!(&of_job["overview"], overview);
    // A job without a name is found by the title that it is listed with.
    let unnamed = client.submit(&jobs::with(jobs::quick(1), "/mix/volume_fraction", json!(0.3))).await;
    assert_eq!(listed("name=a16,%2030%20%25,").await, [id_of(&unnamed)]);
    let plain = client.get("/v1/jobs?name=beam").send().await.expect(200).json();
    assert!(plain.get("totals").is_none() && plain["items"][0].get("overview").is_none(), "{plain:#}");
    assert_eq!(listed("name=beam&sort=created").await, [ids[0].clone(), ids[1].clone()]);
    assert_eq!(listed("name=beam&method=auto").await, [ids[1].clone()]);
    assert_eq!(listed("created_after=2999-01-01T00:00:00Z").await.len(), 0);
    assert_eq!(listed("created_before=2999-01-01T00:00:00Z&name=slab").await, [ids[2].clone()]);
    // A cursor goes on in the same direction.
    let first = client.get("/v1/jobs?name=beam&sort=created&limit=1").send().await.expect(200).json();
    assert_eq!(id_of(&first["items"][0]), ids[0]);
    let cursor = first["next_cursor"].as_str().unwrap();
    assert_eq!(listed(&format!("name=beam&sort=created&limit=1&cursor={cursor}")).await, [ids[1].clone()]);
    for bad in ["sort=size", "method=x", "created_after=today", "name=", "label=a:b", "overview=2"] {
        client.get(&format!("/v1/jobs?{bad}")).send().await.expect_problem(400, "validation-error");
    }
}
