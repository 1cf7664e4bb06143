//! Bits that flip in stored files after these were read: the next read finds them, and no damaged byte is sent.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;

use crate::harness::deadline::eventually;
use crate::harness::{Client, DataDir, Launch, Server, holds_every_store, id_of, jobs, packstone};

/// Not longer than the blocks that are verified.
const STEP: usize = 1 << 15;

/// Flips a bit of a file.
fn flip(file: &Path, at: usize) {
    let mut bytes = fs::read(file).unwrap();
    bytes[at] ^= 1;
    fs::write(file, bytes).unwrap();
}

/// The stored file whose name ends so, of the latest attempt.
fn stored(data_dir: &DataDir, ending: &str) -> PathBuf {
    let mut found = data_dir.artifacts();
    found.retain(|file| file.to_str().unwrap().ends_with(ending));
    let attempt =
        |file: &PathBuf| -> Option<u32> { file.file_stem()?.to_str()?.rsplit_once('.')?.1.parse().ok() };
    found.into_iter().max_by_key(attempt).expect("a stored file")
}

/// What a reader gets who takes what comes, and whether the answer came to its end.
async fn read_what_comes(server: &Server, path: &str, field: (&str, &str)) -> (u16, Vec<u8>, bool) {
    let client = reqwest::Client::builder().no_proxy().build().unwrap();
    let url = format!("http://{}{path}", server.address());
    let mut answer = client.get(url).header(field.0, field.1).send().await.unwrap();
    let mut bytes = Vec::new();
    loop {
        match answer.chunk().await {
            Ok(Some(chunk)) => bytes.extend_from_slice(&chunk),
            Ok(None) => return (answer.status().as_u16(), bytes, true),
            Err(_) => return (answer.status().as_u16(), bytes, false),
        }
    }
}

async fn body(client: &Client, path: &str) -> Vec<u8> {
    client.get(path).send().await.expect(200).body.to_vec()
}

#[tokio::test]
async fn a_bit_flipped_in_any_block_of_a_result_is_found_at_its_next_read() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(8000, 1)).await;
    let result = format!("/v1/jobs/{}/result", id_of(&job));
    let formats = ["npy", "csv", "json", "view"].map(|format| format!("{result}?format={format}"));
    let mut whole = Vec::new();
    for path in &formats {
        whole.push(body(&client, path).await);
    }
    let file = stored(&data_dir, ".packstone");
    let good = fs::read(&file).unwrap();
    assert!(good.len() > 6 * STEP, "{}", good.len());
    for at in (0..good.len()).step_by(STEP).chain([good.len() - 1]) {
        flip(&file, at);
        for path in formats.iter().map(String::as_str).chain([&*format!("{result}?format=html")]) {
            client.get(path).send().await.expect_problem(410, "result-damaged");
        }
        let part = client.get(&formats[0]).header("range", "bytes=0-9").send().await;
        part.expect_problem(410, "result-damaged");
        let drawn = client.get(&format!("/v1/jobs/{}/plots/radial", id_of(&job))).send().await;
        drawn.expect_problem(410, "result-damaged");
        fs::write(&file, &good).unwrap();
        for (path, whole) in formats.iter().zip(&whole) {
            assert!(body(&client, path).await == *whole, "{at}");
        }
    }
    eventually("the log to tell of it", || server.log().contains("is not what was stored")).await;
    // Without the database the file is checked by what stands in it.
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("x.packstone");
    for at in [0, 30, STEP, good.len() - 1] {
        fs::write(&copy, &good).unwrap();
        flip(&copy, at);
        let refused = packstone(folder.path(), &["export", "x.packstone", "slice:format=svg"]).await;
        assert_eq!(refused.code, Some(3), "{at}: {refused:?}");
    }
    fs::write(&copy, &good).unwrap();
    let made = packstone(folder.path(), &["export", "x.packstone", "slice:format=svg"]).await;
    assert_eq!(made.code, Some(0), "{made:?}");
    server.stop().await;
}

#[tokio::test]
async fn an_answer_with_a_long_damaged_result_breaks_off_before_the_damage() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::equal_spheres(140_000, 1)).await;
    let result = format!("/v1/jobs/{}/result", id_of(&job));
    let npy = format!("{result}?format=npy");
    let whole = body(&client, &npy).await;
    let csv = body(&client, &format!("{result}?format=csv")).await;
    let file = stored(&data_dir, ".packstone");
    let good = fs::read(&file).unwrap();
    assert!(good.len() > 4 << 20, "{}", good.len());
    let at = good.len() - 10;
    flip(&file, at);
    // A part that lies elsewhere is served, from right blocks.
    let part = client.get(&npy).header("range", "bytes=1000-1999").send().await;
    assert_eq!(part.expect(206).body, whole[1000..2000]);
    let (status, came, is_whole) = read_what_comes(&server, &npy, ("accept", "*/*")).await;
    assert_eq!((status, is_whole), (200, false));
    assert!(came.len() < whole.len() && whole.starts_with(&came), "{} of {}", came.len(), whole.len());
    eventually("the log to tell of it", || server.log().contains("a stored file is damaged")).await;
    client.get(&npy).send().await.expect_problem(410, "result-damaged");
    // An answer of no stated length does not seem to be whole either.
    fs::write(&file, &good).unwrap();
    assert!(body(&client, &npy).await == whole);
    flip(&file, at);
    let gzip = ("accept-encoding", "gzip");
    let (status, came, is_whole) = read_what_comes(&server, &format!("{result}?format=csv"), gzip).await;
    assert_eq!((status, is_whole), (200, false));
    assert!(came.len() < csv.len());
    client.get(&npy).send().await.expect_problem(410, "result-damaged");
    // Packed again, it is the same.
    client.post(&format!("/v1/jobs/{}/retry", id_of(&job))).send().await.expect(200);
    client.finished(id_of(&job)).await;
    assert!(body(&client, &npy).await == whole);
    server.stop().await;
}

#[tokio::test]
async fn a_bit_flipped_in_any_block_of_an_export_is_found_at_its_next_read_and_the_export_made_again() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let job = client.succeed(&jobs::quick(1)).await;
    let export = format!("/v1/jobs/{}/exports/voxels?format=raw&cells=60", id_of(&job));
    let whole = body(&client, &export).await;
    assert!(whole.len() > 6 * STEP);
    for at in (0..whole.len()).step_by(STEP).chain([whole.len() - 1]) {
        flip(&stored(&data_dir, ".export"), at);
        if at % (2 * STEP) == 0 {
            let part = client.get(&export).header("range", "bytes=7-90").send().await;
            assert_eq!(part.expect(206).body, whole[7..91], "{at}");
        }
        assert!(body(&client, &export).await == whole, "{at}");
        assert!(fs::read(stored(&data_dir, ".export")).unwrap() == whole, "{at}");
    }
    eventually("the log to tell of it", || server.log().contains("it is made again")).await;
    // A long one breaks off, and is made again for the next reader.
    let export = format!("/v1/jobs/{}/exports/voxels?format=raw&cells=200", id_of(&job));
    let long = body(&client, &export).await;
    let mut longest = data_dir.artifacts();
    longest.retain(|file| fs::metadata(file).is_ok_and(|found| found.len() == long.len() as u64));
    flip(&longest[0], 5_000_000);
    let (status, came, is_whole) = read_what_comes(&server, &export, ("accept", "*/*")).await;
    assert_eq!((status, is_whole), (200, false));
    assert!(came.len() <= 5_000_000 && long.starts_with(&came));
    assert!(body(&client, &export).await == long);
    server.stop().await;
}

#[tokio::test]
async fn a_file_that_is_replaced_by_another_one_of_the_same_length_and_time_is_not_served() {
    let data_dir = DataDir::new();
    let server = Launch::new(&data_dir).workers(1).start().await;
    let client = server.client();
    let mut results = Vec::new();
    for seed in [1, 2] {
        let job = client.succeed(&jobs::equal_spheres(2000, seed)).await;
        let path = format!("/v1/jobs/{}/result?format=npy", id_of(&job));
        let file = stored(&data_dir, &format!("{}.1.packstone", id_of(&job)));
        results.push((body(&client, &path).await, path, file));
    }
    let (first, second) = (&results[0], &results[1]);
    let (good, other) = (fs::read(&first.2).unwrap(), fs::read(&second.2).unwrap());
    // Whole in itself, and of another job.
    let written = fs::metadata(&first.2).unwrap().modified().unwrap();
    let put = |bytes: &[u8]| {
        fs::write(&first.2, bytes).unwrap();
        fs::File::options().write(true).open(&first.2).unwrap().set_modified(written).unwrap();
    };
    let mut other = other;
    other.resize(good.len(), b' ');
    put(&other);
    client.get(&first.1).send().await.expect_problem(410, "result-damaged");
    put(&good);
    assert!(body(&client, &first.1).await == first.0);
    assert!(body(&client, &second.1).await == second.0);
    server.stop().await;
}

#[tokio::test]
async fn a_check_and_a_backup_name_the_files_that_are_damaged() {
    if holds_every_store() {
        return;
    }
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let postprocess = json!([{"type": "voxels", "format": "raw", "cells": 40}]);
    let job = client.succeed(&jobs::with(jobs::quick(1), "/postprocess", postprocess)).await;
    let export = format!("/v1/jobs/{}/exports/voxels?format=raw&cells=40", id_of(&job));
    client.get(&export).send().await.expect(200);
    let data = data_dir.path().to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let sound = packstone(folder.path(), &["check", data]).await;
    assert_eq!(sound.code, Some(0), "{sound:?}");
    for ending in [".packstone", ".export"] {
        let file = stored(&data_dir, ending);
        let good = fs::read(&file).unwrap();
        flip(&file, good.len() / 2);
        let name = file.file_name().unwrap().to_str().unwrap();
        let found = packstone(folder.path(), &["check", data]).await;
        assert_eq!(found.code, Some(1));
        assert!(found.stdout.contains(name), "{found:?}");
        let copied =
            packstone(folder.path(), &["backup", &format!("copy{ending}"), "--data-dir", data]).await;
        assert_eq!(copied.code, Some(1));
        assert!(copied.stdout.contains(name), "{copied:?}");
        fs::write(&file, &good).unwrap();
    }
    server.stop().await;
}
