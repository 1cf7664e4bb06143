//! A submission that is sent twice, because the answer to the first was lost, makes one job.

use futures_util::future::join_all;
use serde_json::json;

use crate::harness::{Client, DataDir, Launch, Reply, Server, id_of, jobs};

async fn submit(client: &Client, key: &str, body: String) -> Reply {
    client.post("/v1/jobs").header("idempotency-key", key).text(body).send().await
}

async fn count(client: &Client) -> usize {
    client.get("/v1/jobs?limit=100").send().await.expect(200).json()["items"].as_array().unwrap().len()
}

#[tokio::test]
async fn the_same_key_and_body_give_the_same_job() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let mut job = jobs::quick(1);
    // Without a seed each submission draws one: the second must report that of the first.
    job.as_object_mut().unwrap().remove("seed");

    let first = submit(&client, "order-1", job.to_string()).await;
    let first_job = first.expect(201).json();
    client.finished(id_of(&first_job)).await;
    let second = submit(&client, "order-1", job.to_string()).await;
    let second_job = second.expect(200).json();
    assert_eq!(id_of(&second_job), id_of(&first_job));
    assert_eq!(second_job["seed"], first_job["seed"]);
    assert_eq!(second_job["state"], "succeeded", "the job is answered as it is now");
    assert_eq!(second.header("location"), first.header("location"));

    let other_key = submit(&client, "order-2", job.to_string()).await;
    assert_ne!(id_of(&other_key.expect(201).json()), id_of(&first_job));
    assert_eq!(count(&client).await, 2);
    server.stop().await;
}

#[tokio::test]
async fn another_body_under_the_same_key_is_refused() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    submit(&client, "order-1", jobs::quick(1).to_string()).await.expect(201);
    let refused = submit(&client, "order-1", jobs::quick(2).to_string()).await;
    refused.expect_problem(422, "idempotency-key-reused");
    // A faulty body is refused for its fault, and uses no key up.
    let faulty = jobs::with(jobs::quick(1), "/mix/volume_fraction", json!(-1));
    submit(&client, "order-2", faulty.to_string()).await.expect_problem(422, "validation-error");
    submit(&client, "order-2", jobs::quick(1).to_string()).await.expect(201);
    assert_eq!(count(&client).await, 2);
    server.stop().await;
}

#[tokio::test]
async fn keys_outlive_a_power_cut() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let first = submit(&server.client(), "order-1", jobs::quick(1).to_string()).await.expect(201).json();
    server.kill().await;
    let server = Server::start(&data_dir).await;
    let second = submit(&server.client(), "order-1", jobs::quick(1).to_string()).await.expect(200).json();
    assert_eq!(id_of(&second), id_of(&first));
    server.stop().await;
}

#[tokio::test]
async fn of_many_at_once_one_creates_the_job() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(2).start().await;
    let client = server.client();
    for round in 0..5 {
        let key = format!("round-{round}");
        let body = jobs::quick(round).to_string();
        let replies = join_all((0..20).map(|_| submit(&client, &key, body.clone()))).await;
        let created = replies.iter().filter(|reply| reply.status == 201).count();
        let repeated = replies.iter().filter(|reply| reply.status == 200).count();
        assert_eq!((created, repeated), (1, 19));
        let ids: Vec<_> = replies.iter().map(Reply::json).collect();
        assert!(ids.iter().all(|job| id_of(job) == id_of(&ids[0])));
    }
    assert_eq!(count(&client).await, 5);
    server.stop().await;
}

#[tokio::test]
async fn a_key_that_is_no_key_is_refused() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for key in [String::new(), "k".repeat(256), "with\ttab".to_owned()] {
        let problem =
            submit(&client, &key, jobs::quick(1).to_string()).await.expect_problem(400, "validation-error");
        assert_eq!(problem["errors"][0]["header"], "Idempotency-Key", "{problem:#}");
    }
    submit(&client, &"k".repeat(255), jobs::quick(1).to_string()).await.expect(201);
    server.stop().await;
}
