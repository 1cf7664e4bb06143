//! The events of a job: complete, in order, resumable, and ended with the job.

use serde_json::json;

use crate::harness::{DataDir, Event, Launch, Server, id_of, jobs};

#[tokio::test]
async fn events_tell_the_whole_run_and_end() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let job = client.submit(&jobs::equal_spheres(600_000, 1)).await;
    let events = client.events(id_of(&job), None).await.rest().await;

    let end = events.last().expect("events");
    assert_eq!(end.name, "end");
    assert_eq!(end.data["state"], "succeeded", "{events:#?}");
    assert_eq!(events.iter().filter(|event| event.name == "end").count(), 1);
    let known = ["state", "progress", "end"];
    assert!(events.iter().all(|event| known.contains(&event.name.as_str())), "{events:#?}");

    let states: Vec<&str> =
        events.iter().filter(|e| e.name == "state").map(|e| e.data["state"].as_str().unwrap()).collect();
    let order = ["queued", "running", "succeeded"];
    let places: Vec<_> = states.iter().map(|state| order.iter().position(|o| o == state).unwrap()).collect();
    assert!(places.is_sorted(), "{states:?}");
    assert!(states.contains(&"running"), "{states:?}");

    let fractions: Vec<f64> = events
        .iter()
        .filter(|event| event.name == "progress")
        .map(|event| event.data["fraction"].as_f64().unwrap_or_else(|| panic!("{event:?}")))
        .collect();
    assert!(!fractions.is_empty(), "a run of seconds reports progress");
    assert!(fractions.is_sorted(), "progress fell: {fractions:?}");
    assert!(fractions.iter().all(|f| (0.0..=1.0).contains(f)), "{fractions:?}");
    server.stop().await;
}

#[tokio::test]
async fn ids_rise_and_a_stream_resumes_after_the_last_one_seen() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let job = client.submit(&jobs::endless()).await;
    let id = id_of(&job);

    let mut stream = client.events(id, None).await;
    let first = stream.next().await.expect("an event");
    let mut seen = vec![first];
    while seen.iter().filter(|event| event.name == "progress").count() < 2 {
        seen.push(stream.next().await.expect("an endless job goes on"));
    }
    drop(stream);
    let number = |event: &Event| event.id.as_deref().expect("an id").parse::<u64>().expect("a number");
    assert!(seen.windows(2).all(|pair| number(&pair[0]) <= number(&pair[1])), "{seen:#?}");

    let last = seen.last().unwrap();
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    client.finished(id).await;
    let resumed = client.events(id, last.id.as_deref()).await.rest().await;
    assert!(resumed.iter().all(|event| number(event) > number(last)), "{resumed:#?} after {last:?}");
    assert_eq!(resumed.last().map(|event| &event.data["state"]), Some(&json!("cancelled")), "{resumed:#?}");
    server.stop().await;
}

#[tokio::test]
async fn the_events_of_a_finished_job_are_its_end() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let events = client.events(id_of(&job), None).await.rest().await;
    let end = events.last().expect("an end");
    assert_eq!((end.name.as_str(), &end.data["state"]), ("end", &json!("succeeded")));
    // Whoever has seen the end already is told so again rather than left waiting.
    let again = client.events(id_of(&job), end.id.as_deref()).await.rest().await;
    assert!(again.len() <= 1, "{again:#?}");

    for nonsense in ["-1", "abc", "99999999999999999999999"] {
        let reply = client.get(&format!("/v1/jobs/{}/events", id_of(&job))).header("last-event-id", nonsense);
        let reply = reply.send().await;
        assert!(reply.status == 200 || reply.status == 400, "{}", reply.status);
    }
    server.stop().await;
}

#[tokio::test]
async fn every_watcher_sees_the_end() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let job = client.submit(&jobs::endless()).await;
    let id = id_of(&job);
    client.running(id).await;
    let mut watchers = Vec::new();
    for _ in 0..20 {
        watchers.push(client.events(id, None).await);
    }
    client.post(&format!("/v1/jobs/{id}/cancel")).send().await.expect(202);
    for watcher in watchers {
        let events = watcher.rest().await;
        assert_eq!(events.last().map(|event| event.name.as_str()), Some("end"), "{events:#?}");
    }
    server.stop().await;
}
