//! Large results go to many clients at once without going through memory.

use futures_util::{StreamExt, future::join_all};

use crate::harness::{Client, DataDir, Launch, Server, id_of, jobs};

const CLIENTS: usize = 8;

#[tokio::test]
async fn eight_clients_cost_less_than_their_results() {
    // Eight results of some 30 MB would be 240 MB if they were held.
    let grown = growth_while_streaming(400_000).await;
    assert!(grown < 100 << 20, "8 clients cost {grown} bytes of memory");
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e two_million -- --ignored --nocapture"]
async fn two_million_spheres_to_eight_clients_stay_below_250_mb() {
    let grown = growth_while_streaming(2_000_000).await;
    println!("2 million spheres to 8 clients at once: {} MB beyond the idle server", grown >> 20);
    assert!(grown < 250 << 20, "8 clients cost {grown} bytes of memory");
}

/// How much the server's memory grows over that of an idle one, at most, while eight clients read.
async fn growth_while_streaming(grains: u32) -> u64 {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let job = server.client().succeed(&jobs::equal_spheres(grains, 1)).await;
    // A fresh process: what the packing has left in the allocator must not hide anything.
    server.stop().await;
    let server = Server::start(&data_dir).await;
    server.client().get("/readyz").send().await.expect(200);
    let idle = server.resident_bytes();
    let formats = ["json", "csv", "vtp", "json", "npy", "json", "vtk", "csv"];
    let reads = formats.map(|format| read_all(server.client(), id_of(&job), format, &server));
    assert_eq!(reads.len(), CLIENTS);
    let most = join_all(reads).await.into_iter().max().unwrap();
    server.stop().await;
    most.saturating_sub(idle)
}

/// Reads a whole result chunk by chunk; returns the most memory that the server used meanwhile.
async fn read_all(client: Client, id: &str, format: &str, server: &Server) -> u64 {
    let response = client.get(&format!("/v1/jobs/{id}/result?format={format}")).stream().await;
    let announced = response.content_length().expect("a length");
    let (mut read, mut looked_at, mut most) = (0_u64, 0, 0);
    let mut chunks = response.bytes_stream();
    while let Some(chunk) = chunks.next().await {
        read += chunk.expect("an unbroken stream").len() as u64;
        if read - looked_at > 1 << 20 {
            looked_at = read;
            most = most.max(server.resident_bytes());
        }
    }
    assert_eq!(read, announced, "{format} is not as long as announced");
    most
}
