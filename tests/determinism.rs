//! The same seed gives the same packing, bit for bit: whoever computes it, and beside whatever.

use serde_json::Value;

use crate::harness::{DataDir, Launch, id_of, jobs, packstone};

fn requests() -> Vec<Value> {
    let mut requests: Vec<Value> = (1..=4).map(jobs::quick).collect();
    requests.push(jobs::equal_spheres(30_000, 9));
    requests
}

async fn spheres_with(workers: usize) -> Vec<Vec<u8>> {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(workers).start().await;
    let client = server.client();
    let mut submitted = Vec::new();
    for request in requests() {
        submitted.push(client.submit(&request).await);
    }
    let mut spheres = Vec::new();
    for job in &submitted {
        client.finished(id_of(job)).await;
        spheres.push(client.result_in(id_of(job), "npy").await.to_vec());
    }
    server.stop().await;
    spheres
}

#[tokio::test]
async fn whatever_the_number_of_workers() {
    let alone = spheres_with(1).await;
    assert!(alone == spheres_with(2).await);
    assert!(alone[0] != alone[1], "another seed is another packing");
}

#[tokio::test]
async fn without_a_server_too() {
    let alone = spheres_with(1).await;
    let directory = tempfile::tempdir().unwrap();
    for (request, expected) in requests().iter().zip(alone) {
        std::fs::write(directory.path().join("job.json"), request.to_string()).unwrap();
        let run =
            packstone(directory.path(), &["run", "job.json", "--out", "out", "--format", "npy", "--force"])
                .await;
        assert_eq!(run.code, Some(0), "{run:?}");
        let written = std::fs::read(directory.path().join("out/result.npy")).unwrap();
        assert!(written == expected, "the command gives another packing than the server");
    }
}

#[tokio::test]
async fn after_a_power_cut() {
    let data_dir = DataDir::new();
    let request = jobs::equal_spheres(200_000, 3);
    let server = Launch::new(&data_dir).start().await;
    let job = server.client().submit(&request).await;
    server.client().running(id_of(&job)).await;
    server.kill().await;
    let server = Launch::new(&data_dir).start().await;
    let client = server.client();
    let cut = client.finished(id_of(&job)).await;
    assert_eq!(cut["attempt"], 2, "the cut came after the end");
    let undisturbed = client.succeed(&request).await;
    let (cut, undisturbed) =
        (client.result_in(id_of(&cut), "npy").await, client.result_in(id_of(&undisturbed), "npy").await);
    assert!(cut == undisturbed);
    server.stop().await;
}
