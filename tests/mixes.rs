//! Gradings and recipes as laboratories print them, by HTTP and on the command line.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::harness::{Client, DataDir, Server, packstone};

/// A curve with a head, decimal commas and percents.
const CURVE: &str = "Sieve (mm);Passing (%)\n0,063;1,5\n0,25;8\n1;24\n4;51,5\n8;74\n16;100\n";

/// Two curves side by side.
const TWO: &str = "Sieve (mm);Sand 0/4, passing %;Gravel 4/16, passing %\n16;100;100\n8;100;40\n4;98;5\n1;55;1\n0,25;12;0\n0,063;0;0\n";

async fn read(client: &Client, query: &str, body: impl Into<reqwest::Body>) -> Value {
    let path = format!("/v1/mixes/read{query}");
    client.post(&path).header("content-type", "text/csv").body(body).send().await.expect(200).json()
}

fn texts(reading: &Value) -> Vec<&str> {
    reading["notes"].as_array().unwrap().iter().map(|note| note["text"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn what_is_no_mix_has_an_answer_and_what_is_no_request_has_none() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    // Each body is answered, that of nothing too; the reason is in the notes.
    let long = "1 2\n".repeat((1 << 20) / 4 + 1);
    for (body, why) in [
        (&b"%PDF-1.7"[..], "PDF"),
        (b"", "empty"),
        (b"PK\x03\x04 and no more", "workbook"),
        (b"Dear sir,\nthe sand was good.\n", ""),
        (long.as_bytes(), "1048576"),
    ] {
        let reading = read(&client, "", body.to_vec()).await;
        assert_eq!(reading["verdict"], "refuse", "{reading:#}");
        let notes = texts(&reading);
        assert!(why.is_empty() || notes.iter().any(|text| text.contains(why)), "{why}: {notes:?}");
    }
    for (query, parameter, says) in [
        ("?colum=2", "colum", "sheet, curve, column, unit"),
        ("?unit=furlong", "unit", "mm, um, in, us_sieve, bs_mesh, tyler_mesh, phi"),
        ("?curve=", "curve", "at least 1"),
        ("?sheet=a&sheet=b", "sheet", "once"),
    ] {
        let reply = client.post(&format!("/v1/mixes/read{query}")).body(CURVE).send().await;
        let problem = reply.expect_problem(400, "validation-error");
        let error = &problem["errors"][0];
        assert_eq!(error["parameter"], parameter, "{problem:#}");
        assert!(error["detail"].as_str().unwrap().contains(says), "{problem:#}");
    }
    let most: usize = 4 << 20;
    let reply = client.post("/v1/mixes/read").body(vec![b'1'; most + 1]).send().await;
    let problem = reply.expect_problem(413, "payload-too-large");
    assert_eq!(problem["max_bytes"], most, "{problem:#}");
    let reply = client.post("/v1/mixes/read").header("content-encoding", "gzip").body(CURVE).send().await;
    reply.expect_problem(415, "unsupported-media-type");
    server.stop().await;
}

fn write(directory: &Path, name: &str, text: &str) {
    fs::write(directory.join(name), text).unwrap();
}

#[tokio::test]
async fn the_command_prints_the_answer_of_the_service() {
    let directory = tempfile::tempdir().unwrap();
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    for (text, query, options) in [
        (CURVE, "", &[][..]),
        (CURVE, "?unit=in", &["--unit", "in"]),
        (TWO, "?column=2", &["--column", "2"]),
        (TWO, "", &[]),
    ] {
        write(directory.path(), "mix.csv", text);
        let ended =
            packstone(directory.path(), &[&["mix", "read", "mix.csv", "--json"], options].concat()).await;
        let printed: Value = serde_json::from_str(&ended.stdout).unwrap();
        assert_eq!(printed, read(&client, query, text).await, "{query}");
        let may_use = ["ok", "warn"].contains(&printed["verdict"].as_str().unwrap());
        assert_eq!(ended.code, Some(if may_use { 0 } else { 3 }), "{printed:#}");
    }
    server.stop().await;
}

#[tokio::test]
async fn the_command_says_why_it_reads_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path();
    write(here, "letter.txt", "Dear sir,\nthe sand was good.\n");
    write(here, "report.pdf", "%PDF-1.7\n");
    for (file, why) in
        [("letter.txt", "letter.txt is refused:"), ("report.pdf", "PDF"), ("none.csv", "none.csv")]
    {
        let ended = packstone(here, &["mix", "read", file]).await;
        assert_eq!(ended.code, Some(3), "{ended:?}");
        assert!(ended.stderr.contains(why), "{ended:?}");
    }
    for wrong in [&["--unit", "furlong"][..], &["--force"], &["--choose", "0"]] {
        let ended = packstone(here, &[&["mix", "read", "letter.txt"], wrong].concat()).await;
        assert_eq!(ended.code, Some(2), "{ended:?}");
    }
}

#[tokio::test]
async fn the_command_reads_standard_input() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path(), "curve.csv", CURVE);
    let named = packstone(directory.path(), &["mix", "read", "curve.csv", "--json"]).await;
    let file = fs::File::open(directory.path().join("curve.csv")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
    command.args(["mix", "read", "-", "--json"]).current_dir(directory.path()).stdin(Stdio::from(file));
    let output = tokio::task::spawn_blocking(move || command.output()).await.unwrap().unwrap();
    assert!(!named.stdout.is_empty(), "{named:?}");
    assert_eq!((String::from_utf8(output.stdout).unwrap(), output.status.code()), (named.stdout, named.code));
}
