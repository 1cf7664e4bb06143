//! Deliveries of webhooks: recorded with the end, due one by one for each host, seen in the job or the study.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use jiff::Timestamp;
use packstone_engine::Limits;
use serde_json::{Value, json};

use super::tests::{fresh, submit, submit_as, succeed};
use super::*;
use crate::accounts::Submitter;
use crate::failure::{Failure, FailureCode};
use crate::studies::{Facts, Study};

const URL: &str = "http://hooks.example/in?token=t";
const MINUTE: Duration = Duration::from_mins(1);

/// What is due of each receiver, first attempts before others.
async fn due(store: &Store) -> Vec<Delivery> {
    let mut waiting = store.waiting_by_receiver().await.unwrap();
    waiting.retain(|delivery| delivery.due_in.is_zero());
    waiting.sort_by_key(|delivery| (delivery.sent_before, delivery.next_at, delivery.seq));
    let mut found = Vec::new();
    for delivery in waiting {
        found.push(store.delivery(delivery.seq).await.unwrap().unwrap());
    }
    found
}

/// The only delivery that is due, and its body.
async fn only_due(store: &Store) -> (Delivery, Value) {
    let mut found = due(store).await;
    assert_eq!(found.len(), 1);
    let delivery = found.remove(0);
    let body = serde_json::from_str(&delivery.body).unwrap();
    (delivery, body)
}

async fn deliver(store: &Store, delivery: &Delivery) {
    store.record_attempt(delivery.seq, Attempt::Delivered { status: 204 }).await.unwrap();
}

async fn claim(store: &Store) -> Lease {
    store.claim().await.unwrap().unwrap().lease
}

async fn submit_study(store: &Store, extra: Value) -> StudyRecord {
    let mut request = json!({
        "template": {
            "specimen": {"type": "box", "size_mm": [50, 50, 50]},
            "mix": {"grading": {"type": "monodisperse", "diameter_mm": 8}, "volume_fraction": 0.2}
        },
        "grid": {"/mix/volume_fraction": [0.2, 0.25]}
    });
    request.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
    let study = Study::read(&request, 1, None, &Limits::default()).unwrap();
    let recorded = study.recorded(&request);
    assert_eq!(recorded.get("webhook_url"), None);
    let new = NewStudy { request: recorded, study, by: Submitter::default(), idempotency_key: None };
    match store.submit_study(new).await.unwrap() {
        SubmittedStudy::Created(study) => study,
        SubmittedStudy::Existing(_) => panic!("a study without a key exists already"),
    }
}

#[tokio::test]
async fn the_end_of_a_job_records_one_message_and_the_request_has_no_url() {
    let (_folder, store) = fresh().await;
    let job = submit(&store, json!({"webhook_url": URL, "name": "n", "labels": {"a": "b"}})).await;
    submit(&store, json!({})).await;
    assert_eq!(store.request(job.seq).await.unwrap().get("webhook_url"), None);
    let before = store.webhook_of_job(job.seq).await.unwrap().unwrap();
    assert_eq!((before.url.as_str(), before.state, before.attempts), (URL, DeliveryState::Waiting, 0));
    assert_eq!(before.next_attempt_at, None);
    let lease = claim(&store).await;
    assert_eq!(store.waiting_by_receiver().await.unwrap(), []);
    succeed(&store, lease).await;
    let without = claim(&store).await;
    succeed(&store, without).await;
    let (delivery, body) = only_due(&store).await;
    assert_eq!((delivery.url.as_str(), delivery.host.as_str(), delivery.attempts), (URL, "hooks.example", 0));
    let ended = store.get(job.id).await.unwrap().unwrap();
    let time = Timestamp::from_microsecond(ended.finished_at.unwrap()).unwrap();
    assert_eq!(body["timestamp"].as_str().unwrap().parse::<Timestamp>().unwrap(), time);
    let expected = json!({
        "id": job.id.to_string(), "name": "n", "labels": {"a": "b"}, "state": "succeeded",
        "links": {"self": format!("/v1/jobs/{}", job.id)}
    });
    assert_eq!((&body["type"], &body["data"]), (&json!("job.succeeded"), &expected));

    // An attempt is a change that clients see.
    let mut changes = store.subscribe(job.id);
    let failed = Attempt::Again { error: "no answer".into(), status: Some(503), pause: MINUTE };
    store.record_attempt(delivery.seq, failed).await.unwrap();
    changes.changed().await;
    assert_eq!(store.get(job.id).await.unwrap().unwrap().version, ended.version + 1);
    let seen = store.webhook_of_job(job.seq).await.unwrap().unwrap();
    assert_eq!((seen.state, seen.attempts, seen.last_status), (DeliveryState::Waiting, 1, Some(503)));
    assert_eq!(seen.last_error.as_deref(), Some("no answer"));
    assert_eq!((due(&store).await.len(), store.waiting_deliveries().await.unwrap()), (0, 1));
    let [WaitingDelivery { sent_before: true, due_in: pause, .. }] =
        store.waiting_by_receiver().await.unwrap()[..]
    else {
        panic!("one delivery waits")
    };
    assert!(pause <= MINUTE && pause > MINUTE / 2, "{pause:?}");

    deliver(&store, &delivery).await;
    let seen = store.webhook_of_job(job.seq).await.unwrap().unwrap();
    assert_eq!((seen.state, seen.attempts, seen.last_status), (DeliveryState::Delivered, 2, Some(204)));
    assert!(seen.last_error.is_none() && seen.next_attempt_at.is_none() && seen.delivered_at.is_some());
    // What has arrived stays so.
    let late = Attempt::Failed { error: "late".into(), status: None };
    store.record_attempt(delivery.seq, late).await.unwrap();
    assert_eq!(store.webhook_of_job(job.seq).await.unwrap().unwrap(), seen);
    assert_eq!(store.waiting_deliveries().await.unwrap(), 0);
}

#[tokio::test]
async fn every_end_has_its_message_and_a_retried_job_sends_again() {
    let (_folder, store) = fresh().await;
    let job = submit(&store, json!({"webhook_url": URL})).await;
    let failure = Failure::new(FailureCode::TimedOut, "it took too long");
    store.fail(claim(&store).await, &failure, Facts::default()).await.unwrap();
    let (first, body) = only_due(&store).await;
    assert_eq!((&body["type"], &body["data"]["name"]), (&json!("job.failed"), &Value::Null));
    assert_eq!(body["data"]["error"], json!({"code": "timed-out", "detail": "it took too long"}));
    deliver(&store, &first).await;

    store.retry(job.id, None).await.unwrap();
    store.cancel(job.id).await.unwrap();
    let (second, body) = only_due(&store).await;
    assert_eq!((&body["type"], body["data"].get("error")), (&json!("job.cancelled"), None));
    assert_ne!(first.id, second.id);
    assert!(second.id.starts_with("msg_") && second.id.len() == 36, "{}", second.id);
    let seen = store.webhook_of_job(job.seq).await.unwrap().unwrap();
    assert_eq!((seen.state, seen.attempts), (DeliveryState::Waiting, 0));
    deliver(&store, &second).await;

    // A server that stops takes the job back, and ends it when no attempt is left.
    store.retry(job.id, None).await.unwrap();
    for attempt in 1..=3 {
        claim(&store).await;
        assert_eq!(due(&store).await.len(), 0, "{attempt}");
        store.recover(Vec::new()).await.unwrap();
    }
    let (third, body) = only_due(&store).await;
    assert_eq!(body["data"]["error"]["code"], "attempts-exhausted");

    // A deleted job takes its messages along; one on its way is not recorded.
    store.delete(job.id).await.unwrap();
    deliver(&store, &third).await;
    let mut left = BTreeSet::new();
    for table in ["select count(*) from webhooks", "select count(*) from webhook_deliveries"] {
        left.insert(db::query(table).scalar::<i64>(store.readers()).await.unwrap());
    }
    assert_eq!(left, BTreeSet::from([0]));
}

#[tokio::test]
async fn a_study_sends_one_message_when_it_is_finished() {
    let (_folder, store) = fresh().await;
    let study = submit_study(&store, json!({"webhook_url": URL, "name": "s"})).await;
    let first = claim(&store).await;
    succeed(&store, first).await;
    assert_eq!(due(&store).await.len(), 0);
    let second = claim(&store).await;
    let failure = Failure::new(FailureCode::TimedOut, "it took too long");
    store.fail(second, &failure, Facts::default()).await.unwrap();
    let (delivery, body) = only_due(&store).await;
    let expected = json!({
        "id": study.id.to_string(), "name": "s", "labels": {}, "state": "finished",
        "counts": {"succeeded": 1, "failed": 1, "cancelled": 0},
        "links": {"self": format!("/v1/studies/{}", study.id)}
    });
    assert_eq!((&body["type"], &body["data"]), (&json!("study.finished"), &expected));
    let finished = store.study(study.id).await.unwrap().unwrap();
    deliver(&store, &delivery).await;
    assert_eq!(store.study(study.id).await.unwrap().unwrap().version, finished.version + 1);
    let seen = store.webhook_of_study(study.seq).await.unwrap().unwrap();
    assert_eq!((seen.state, seen.url.as_str()), (DeliveryState::Delivered, URL));

    store.retry_study(study.id, vec![State::Failed]).await.unwrap();
    assert_eq!(due(&store).await.len(), 0);
    store.cancel_study(study.id).await.unwrap();
    let (_, body) = only_due(&store).await;
    assert_eq!(body["data"]["counts"], json!({"succeeded": 1, "failed": 0, "cancelled": 1}));
    store.delete_study(study.id).await.unwrap();
    assert_eq!(store.waiting_deliveries().await.unwrap(), 0);
}

#[tokio::test]
async fn one_message_of_each_receiver_is_due_the_oldest_first() {
    let (_folder, store) = fresh().await;
    let submit_ended = async |owner: &str, url: &str| {
        let job = submit_as(&store, owner, json!({"webhook_url": url})).await.unwrap();
        store.cancel(job.id).await.unwrap();
    };
    for url in [
        "http://dead.example/1",
        "http://dead.example/2",
        "http://dead.example:81/3",
        "http://live.example/4",
    ] {
        submit_ended("a", url).await;
    }
    submit_ended("b", "http://dead.example/5").await;
    let urls =
        async || -> Vec<String> { due(&store).await.into_iter().map(|delivery| delivery.url).collect() };
    let of_b = "http://dead.example/5";
    assert_eq!(urls().await, ["http://dead.example/1", "http://live.example/4", of_b]);
    let first = due(&store).await.remove(0);
    let again = Attempt::Again { error: "no".into(), status: None, pause: MINUTE };
    store.record_attempt(first.seq, again).await.unwrap();
    assert_eq!(urls().await, ["http://dead.example/2", "http://live.example/4", of_b]);
    // What was sent before is apart from the rest.
    let soon = Attempt::Again { error: "no".into(), status: None, pause: Duration::ZERO };
    let live = due(&store).await.remove(1);
    store.record_attempt(live.seq, soon).await.unwrap();
    assert_eq!(urls().await, ["http://dead.example/2", of_b, "http://live.example/4"]);
    let repeat = due(&store).await.remove(2);
    assert_eq!(repeat, Delivery { attempts: 1, age: repeat.age, ..live });
    let receivers = store.waiting_by_receiver().await.unwrap();
    assert_eq!(receivers.len(), 4, "both of the first host, one of each other");
}
