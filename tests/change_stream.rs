//! One stream for all jobs and studies: what changed, for whom it is, and how it resumes.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Event, EventStream, Launch, Server, id_of, jobs};
use crate::users::laboratory;

async fn stream(client: &Client, last_event_id: Option<&str>) -> EventStream {
    let mut request = client.get("/v1/events");
    if let Some(last) = last_event_id {
        request = request.header("last-event-id", last);
    }
    EventStream::new(request.stream().await)
}

/// Reads until an event says that of this item.
async fn until(stream: &mut EventStream, name: &str, id: &str, state: &str) -> Vec<Event> {
    let mut seen = Vec::new();
    loop {
        let event = stream.next().await.expect("a stream that goes on");
        let is_it = event.name == name && event.data["id"] == id && event.data["state"] == state;
        seen.push(event);
        if is_it {
            return seen;
        }
    }
}

fn names(events: &[Event]) -> BTreeSet<&str> {
    events.iter().map(|event| event.name.as_str()).collect()
}

#[tokio::test]
async fn the_stream_tells_of_jobs_and_studies_and_resumes_where_it_was() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut first = stream(&client, None).await;
    let job = client.submit(&jobs::quick(1)).await;
    let seen = until(&mut first, "job", id_of(&job), "succeeded").await;
    assert_eq!(names(&seen), BTreeSet::from(["job"]), "{seen:#?}");
    let last = seen.last().unwrap();
    let version = client.job(id_of(&job)).await;
    let etag = client.get(&format!("/v1/jobs/{}", id_of(&job))).send().await.header("etag").to_owned();
    assert_eq!(format!("\"{}\"", last.data["version"]), etag, "{version:#}");

    let path = format!("/v1/jobs/{}", id_of(&job));
    client.request(reqwest::Method::PATCH, &path).json(&json!({"name": "other"})).send().await.expect(200);
    let seen = until(&mut first, "job", id_of(&job), "succeeded").await;
    let last = seen.last().unwrap().id.clone().unwrap();
    drop(first);
    // What happens while nobody listens is told to who comes back.
    let study = client.submit_study(&json!({"list": [jobs::quick(2), jobs::quick(3)]})).await;
    client.study_finished(id_of(&study)).await;
    client.delete(&path).send().await.expect(204);
    let mut second = stream(&client, Some(&last)).await;
    let seen = until(&mut second, "job", id_of(&job), "deleted").await;
    assert_eq!(seen.last().unwrap().data["version"], Value::Null);
    let of_study = seen.iter().filter(|event| event.name == "study").collect::<Vec<_>>();
    assert_eq!(of_study.len(), 1, "once, however often it changed: {seen:#?}");
    assert_eq!((&of_study[0].data["id"], &of_study[0].data["state"]), (&study["id"], &json!("finished")));
    let ended: BTreeSet<String> =
        client.jobs_of(id_of(&study)).await.iter().map(|job| id_of(job).into()).collect();
    let told = |event: &&Event| event.name == "job" && event.data["state"] == "succeeded";
    let told: BTreeSet<String> =
        seen.iter().filter(told).map(|event| event.data["id"].as_str().unwrap().into()).collect();
    assert_eq!(told, ended);
    assert!(!names(&seen).contains("reset"), "{seen:#?}");
    // The server ends the stream when it stops.
    server.terminate();
    assert_eq!(second.rest().await.len(), 0);
}

#[tokio::test]
async fn after_a_crash_the_client_is_told_that_it_may_have_missed_something() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut first = stream(&client, None).await;
    let job = client.submit(&jobs::endless()).await;
    let seen = until(&mut first, "job", id_of(&job), "running").await;
    let last = seen.last().unwrap().id.clone().unwrap();
    server.kill().await;
    first.drained().await;

    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    for unknown in [last.as_str(), "none", "", "0-0"] {
        let mut second = stream(&client, Some(unknown)).await;
        let reset = second.next().await.unwrap();
        assert_eq!((reset.name.as_str(), &reset.data), ("reset", &json!({})), "{unknown:?}");
        let known = reset.id.unwrap();
        drop(second);
        // From there on nothing is missed.
        let path = format!("/v1/jobs/{}", id_of(&job));
        client.request(reqwest::Method::PATCH, &path).json(&json!({"name": known})).send().await.expect(200);
        let mut third = stream(&client, Some(&known)).await;
        let next = third.next().await.unwrap();
        assert_eq!((next.name.as_str(), &next.data["id"]), ("job", &job["id"]), "{next:?}");
    }
    server.kill().await;
}

#[tokio::test]
async fn each_key_hears_of_what_it_may_see_and_a_withdrawn_one_of_nothing() {
    let keys = laboratory().await;
    let data_dir = DataDir::new();
    let server = keys.launch(&data_dir).start().await;
    let [root, anna, bert, carl, gauge] =
        ["root", "anna", "bert", "carl", "gauge"].map(|name| keys.client(&server, name));
    gauge.get("/v1/events").send().await.expect_problem(403, "forbidden");
    server.client().get("/v1/events").send().await.expect_problem(401, "unauthorized");
    let mut streams = [stream(&root, None).await, stream(&bert, None).await, stream(&carl, None).await];
    let hidden = anna.succeed(&jobs::quick(1)).await;
    let shared = anna.succeed(&jobs::with(jobs::quick(2), "/shared", json!(true))).await;
    let [of_root, of_bert, of_carl] = &mut streams;
    for stream in [of_root, of_bert] {
        until(stream, "job", id_of(&hidden), "succeeded").await;
        until(stream, "job", id_of(&shared), "succeeded").await;
    }
    let seen = until(of_carl, "job", id_of(&shared), "succeeded").await;
    assert!(seen.iter().all(|event| event.data["id"] == shared["id"]), "{seen:#?}");
    // Of an end that it was not told the beginning of, a key hears nothing.
    for job in [&hidden, &shared] {
        anna.delete(&format!("/v1/jobs/{}", id_of(job))).send().await.expect(204);
    }
    let seen = until(of_carl, "job", id_of(&shared), "deleted").await;
    assert!(seen.iter().all(|event| event.data["id"] == shared["id"]), "{seen:#?}");

    let text = std::fs::read_to_string(&keys.file).unwrap();
    let rest: Vec<&str> = text.lines().filter(|line| !line.contains("carl")).collect();
    std::fs::write(&keys.file, rest.join("\n") + "\n").unwrap();
    let [_, _, of_carl] = streams;
    assert_eq!(of_carl.rest().await.len(), 0, "the stream of a withdrawn key ends");
    server.stop().await;
}
