//! Bits that flip in the database: no answer is wrong, each damage is named, and all else is served.

use std::fs::{self, File};
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;

use serde_json::Value;

use crate::harness::deadline::{eventually, patiently};
use crate::harness::{DataDir, Server, holds_every_store, id_of, jobs, packstone};

/// Length of a page of the database.
const PAGE: usize = 4096;

/// A data directory with so many jobs that have ended, and the path of its database.
async fn filled(seeds: std::ops::Range<u64>) -> (DataDir, PathBuf, Vec<String>) {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let mut ids = Vec::new();
    for seed in seeds {
        ids.push(id_of(&server.client().succeed(&jobs::quick(seed)).await).to_owned());
    }
    server.stop().await;
    let database = data_dir.path().join("packstone.sqlite");
    (data_dir, database, ids)
}

/// The place of the last occurrence of a text.
fn last(bytes: &[u8], text: &str) -> usize {
    bytes.windows(text.len()).rposition(|part| part == text.as_bytes()).expect("the text is stored")
}

fn flip(file: &PathBuf, at: usize, bit: u8) {
    let mut bytes = fs::read(file).unwrap();
    bytes[at] ^= bit;
    fs::write(file, bytes).unwrap();
}

#[tokio::test]
async fn a_bit_that_flips_in_a_row_is_named_and_all_other_rows_are_served() {
    if holds_every_store() {
        return;
    }
    let (data_dir, database, ids) = filled(0..8).await;
    let good = fs::read(&database).unwrap();
    // A document that is none any more, and a figure of a report that has another value.
    for (place, bit) in [(last(&good, r#"{"csv":"#), 0x20), (last(&good, r#""summary":{"grains":"#) + 20, 1)]
    {
        flip(&database, place, bit);
        let checked = packstone(data_dir.path(), &["check", data_dir.path().to_str().unwrap()]).await;
        assert!(checked.stdout.contains(" 1 faults") && checked.stdout.contains("jobs "), "{checked:?}");
        let server = Server::start(&data_dir).await;
        let client = server.client();
        let page = client.get("/v1/jobs?limit=100").send().await.expect(200).json();
        assert_eq!(page["items"].as_array().unwrap().len(), ids.len() - 1, "{page:#}");
        let damaged = page["damaged"].as_array().unwrap();
        let id = damaged[0]["id"].as_str().unwrap();
        assert!(damaged.len() == 1 && ids.iter().any(|known| known == id), "{page:#}");
        let own = client.get(&format!("/v1/jobs/{id}")).send().await.expect_problem(503, "not-ready");
        assert!(own["detail"].as_str().unwrap().contains("damaged"), "{own:#}");
        for other in ids.iter().filter(|other| *other != id) {
            client.get(&format!("/v1/jobs/{other}")).send().await.expect(200);
        }
        client.get("/readyz").send().await.expect(200);
        server.stop().await;
        fs::write(&database, &good).unwrap();
    }
}

/// A flipped bit is found by `packstone check`, or it lies where nothing is read, as in what a row was before: then all
/// answers are as before.
#[tokio::test]
async fn a_bit_that_flips_in_any_page_gives_no_wrong_document() {
    if holds_every_store() {
        return;
    }
    let (data_dir, database, ids) = filled(0..3).await;
    let good = fs::read(&database).unwrap();
    let path = data_dir.path().to_str().unwrap().to_owned();
    let answers = answers(&data_dir, &ids).await;
    let documents = |text: &str| {
        let mut places = Vec::new();
        for (at, part) in good.windows(text.len()).enumerate() {
            if part == text.as_bytes() {
                places.push(at + text.len() - 1);
            }
        }
        places
    };
    // One bit in each report, in each request, and in each page that has one of them.
    let mut places = documents(r#""volume_fraction":0"#);
    places.extend(documents(r#""timings_s":{"#));
    let mut pages: Vec<usize> = places.iter().map(|at| at / PAGE).collect();
    pages.sort_unstable();
    pages.dedup();
    assert!(pages.len() >= 2 && places.len() >= 2 * ids.len(), "{places:?}");
    let mut found = 0;
    for place in places {
        flip(&database, place, 1);
        let checked = packstone(data_dir.path(), &["check", &path]).await;
        if checked.code == Some(0) {
            assert_eq!(self::answers(&data_dir, &ids).await, answers, "the bit at {place} was not found");
        } else {
            found += 1;
        }
        fs::write(&database, &good).unwrap();
    }
    assert!(found >= 2 * ids.len(), "{found}");
}

/// The documents of these jobs and their requests.
async fn answers(data_dir: &DataDir, ids: &[String]) -> Vec<Value> {
    let server = Server::start(data_dir).await;
    let mut answers = Vec::new();
    for target in ids.iter().flat_map(|id| [format!("/v1/jobs/{id}"), format!("/v1/jobs/{id}/request")]) {
        answers.push(server.client().get(&target).send().await.expect(200).json());
    }
    server.stop().await;
    answers
}

/// Numbers, names and moments of a record are found as documents are.
#[tokio::test]
async fn a_bit_that_flips_anywhere_in_a_record_is_found() {
    if holds_every_store() {
        return;
    }
    let (data_dir, database, ids) = filled(0..2).await;
    let good = fs::read(&database).unwrap();
    let path = data_dir.path().to_str().unwrap().to_owned();
    // From the first values of the record to those of its copy.
    let first = last(&good, &format!("{}succeeded", ids[0]));
    let copy = last(&good, &format!("'{}' 'succeeded'", ids[0]));
    assert!((first + 200..first + PAGE).contains(&copy), "{first} {copy}");
    for place in (first..copy + 400).step_by(37) {
        flip(&database, place, 1 << (place % 7));
        let checked = packstone(data_dir.path(), &["check", &path]).await;
        assert_ne!(checked.code, Some(0), "the bit at {place} was not found: {}", checked.stdout);
        fs::write(&database, &good).unwrap();
    }
}

#[tokio::test]
async fn damaged_pages_make_the_service_not_ready_until_the_database_is_restored() {
    if holds_every_store() {
        return;
    }
    let (data_dir, database, _) = filled(0..20).await;
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let good = fs::read(&database).unwrap();
    let file = File::options().write(true).open(&database).unwrap();
    for page in (4..good.len() / PAGE).step_by(3) {
        file.write_all_at(&[0; PAGE], (page * PAGE) as u64).unwrap();
    }
    let list = client.get("/v1/jobs?limit=100").send().await;
    assert!([200, 503].contains(&list.status.as_u16()), "{:?}", list.body);
    let not_ready = async {
        loop {
            client.get("/v1/jobs?limit=100").send().await;
            let ready = client.get("/readyz").send().await;
            if ready.status.as_u16() == 503 {
                return ready.json();
            }
        }
    };
    let why: Value = patiently("the service to be not ready", not_ready).await;
    assert!(why["detail"].as_str().unwrap().contains("damaged"), "{why:#}");
    let is_logged = || server.log().contains("the store fails; the service is not ready");
    eventually("the log to say so", is_logged).await;
    server.kill().await;
    // The operator restores the database.
    fs::write(&database, &good).unwrap();
    for log in ["packstone.sqlite-wal", "packstone.sqlite-shm"] {
        fs::remove_file(database.with_file_name(log)).unwrap();
    }
    let server = Server::start(&data_dir).await;
    server.client().get("/readyz").send().await.expect(200);
    server.client().get("/v1/jobs?limit=100").send().await.expect(200);
    server.stop().await;
}
