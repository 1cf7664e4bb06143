//! Kills of servers that share a database and a folder of results, and crashes of the database, at random moments:
//! nothing is lost, and nothing is left over (see [`crash`](crate::crash)).

use std::time::Duration;

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

use crate::crash::{Known, account, order_and_watch};
use crate::harness::deadline::eventually;
use crate::harness::{DataDir, Launch, Postgres};

#[tokio::test]
async fn kills_of_servers_and_their_database_lose_nothing() {
    survive(15, 5).await;
}

#[tokio::test]
#[ignore = "long: cargo test --release -p packstone-server --test e2e five_hundred -- --ignored"]
async fn five_hundred_kills_of_servers_and_their_database_lose_nothing() {
    survive(500, 6).await;
}

async fn survive(kills: usize, seed: u64) {
    let Some(postgres) = Postgres::start() else { return };
    let (store, shared) = (postgres.database("lab"), DataDir::new());
    let data_dirs = [DataDir::new(), DataDir::new()];
    let args = ["--store", &store, "--blobs", shared.path().to_str().unwrap(), "--lease-s", "2"];
    let often = ["--checkpoint-every-s", "0", "--sweep-interval-s", "0.5", "--least-blob-age-s", "5"];
    let launch = |which: usize| Launch::new(&data_dirs[which]).args(&args).args(&often);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut known = Known::of_servers_with_a_database();
    let mut servers = [launch(0).start().await, launch(1).start().await];
    for _ in 0..kills {
        let moment = Duration::from_micros(random.next_u64() % 600_000);
        let client = servers[random.next_u64() as usize % 2].client();
        tokio::select! {
            () = order_and_watch(&client, &mut known, &mut random) => unreachable!("a client goes on for ever"),
            () = tokio::time::sleep(moment) => {}
        }
        match random.next_u64() % 3 {
            2 => {
                postgres.crash();
                // The servers are without it for a while.
                tokio::select! {
                    () = order_and_watch(&client, &mut known, &mut random) => unreachable!("as above"),
                    () = tokio::time::sleep(moment) => {}
                }
                postgres.up();
            }
            i => {
                let which = i as usize;
                let address = servers[which].address().to_string();
                let [one, two] = servers;
                let (killed, other) = if which == 0 { (one, two) } else { (two, one) };
                killed.kill().await;
                let successor = launch(which).listen(&address).start().await;
                servers = if which == 0 { [successor, other] } else { [other, successor] };
            }
        }
    }
    account(&servers[0].client(), &shared, &mut known).await;
    eventually("orphans to be swept", || shared.artifacts().len() == known.accepted.len()).await;
    for server in servers {
        server.stop().await;
    }
    let counted = postgres.ask("lab", "select sum(jobs) from job_counts");
    assert_eq!(counted, postgres.ask("lab", "select count(*) from jobs"));
    let succeeded =
        "select count(*) from jobs join artifacts on artifacts.job = jobs.seq where state = 'succeeded'";
    assert_eq!(postgres.ask("lab", succeeded), counted);
    known.print(kills);
}
