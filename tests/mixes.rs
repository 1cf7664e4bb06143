//! Gradings and recipes as laboratories print them, by HTTP and on the command line.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::harness::{Client, DataDir, Server, packstone, results, run};

const TYPES: [&str; 7] = [
    "text/csv",
    "text/plain; charset=utf-8",
    "text/html",
    "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "application/vnd.oasis.opendocument.spreadsheet",
    "application/octet-stream",
    "application/json",
];

/// A curve with a head, decimal commas and percents; what passes in shares.
const CURVE: &str = "Sieve (mm);Passing (%)\n0,063;1,5\n0,25;8\n1;24\n4;51,5\n8;74\n16;100\n";
const POINTS: [[f64; 2]; 6] =
    [[0.063, 0.015], [0.25, 0.08], [1.0, 0.24], [4.0, 0.515], [8.0, 0.74], [16.0, 1.0]];

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
async fn a_file_is_read_as_it_stands_whatever_its_media_type() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let utf16: Vec<u8> = format!("\u{feff}{CURVE}").encode_utf16().flat_map(u16::to_le_bytes).collect();
    for body in [CURVE.as_bytes().to_vec(), CURVE.replace('\n', "\r\n").into_bytes(), utf16] {
        for media_type in TYPES {
            let request = client.post("/v1/mixes/read").header("content-type", media_type);
            let reading = request.body(body.clone()).send().await.expect(200).json();
            assert_eq!(reading["verdict"], "ok", "{media_type}: {reading:#}");
            assert_eq!(reading["curves"][0]["points"], json!(POINTS), "{media_type}: {reading:#}");
        }
    }
    // Without one, too.
    let reading = client.post("/v1/mixes/read").body(CURVE).send().await.expect(200).json();
    assert_eq!(reading["request"]["mix"]["grading"]["points"], json!(POINTS), "{reading:#}");
    server.stop().await;
}

#[tokio::test]
async fn what_has_two_readings_asks_and_a_parameter_chooses() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let reading = read(&client, "", TWO).await;
    assert_eq!(reading["verdict"], "ask", "{reading:#}");
    assert!(reading.get("request").is_none(), "{reading:#}");
    let candidates = reading["candidates"].as_array().unwrap();
    assert!(candidates.len() >= 2, "{reading:#}");
    for candidate in candidates {
        assert!(candidate["request"]["mix"].is_object(), "{candidate:#}");
    }
    for (column, coarse) in [("2", 0.98), ("3", 0.05)] {
        let chosen = read(&client, &format!("?column={column}"), TWO).await;
        assert!(["ok", "warn"].contains(&chosen["verdict"].as_str().unwrap()), "{chosen:#}");
        let points = chosen["request"]["mix"]["grading"]["points"].as_array().unwrap();
        let of_4 = points.iter().find(|point| point[0] == 4.0).unwrap();
        assert_eq!(of_4[1], coarse, "{chosen:#}");
    }
    server.stop().await;
}

#[tokio::test]
async fn what_is_no_mix_has_an_answer_and_what_is_no_request_has_none() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    // The body of a file is answered whatever it has; the reason is in the notes.
    let long = "1 2\n".repeat((1 << 20) / 4 + 1);
    for (body, why) in [
        (&b"%PDF-1.7"[..], "PDF"),
        (b" \r\n", "empty"),
        (b"PK\x03\x04 and no more", "workbook"),
        (b"Dear sir,\nthe sand was good.\n", ""),
        (long.as_bytes(), "1048576"),
    ] {
        let reading = read(&client, "", body.to_vec()).await;
        assert_eq!(reading["verdict"], "refuse", "{reading:#}");
        let notes = texts(&reading);
        assert!(why.is_empty() || notes.iter().any(|text| text.contains(why)), "{why}: {notes:?}");
    }
    let nothing = client.post("/v1/mixes/read").send().await.expect_problem(422, "validation-error");
    assert!(nothing["detail"].as_str().unwrap().contains("is empty"), "{nothing:#}");
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
async fn the_command_shows_what_was_understood_and_writes_a_job_that_packs() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path();
    write(here, "curve.csv", CURVE);
    let ended = packstone(here, &["mix", "read", "curve.csv", "--out", "job.json"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    for row in [&["0.063", "1.5"][..], &["4", "51.5"], &["16", "100"]] {
        let is_shown = ended.stdout.lines().any(|line| line.split_whitespace().eq(row.iter().copied()));
        assert!(is_shown, "{row:?}: {}", ended.stdout);
    }
    assert!(ended.stdout.ends_with("job.json\n"), "{}", ended.stdout);
    for said in ["mix.volume_fraction is 0.4", "mix.d_min_mm is", "a cube of 80 mm", "chance of success"] {
        assert!(ended.stderr.contains(said), "{said}: {}", ended.stderr);
    }
    let job = results::json_in(&here.join("job.json"));
    assert_eq!(job["mix"]["grading"]["points"], json!(POINTS), "{job:#}");
    assert_eq!((&job["mix"]["volume_fraction"], &job["mix"]["d_min_mm"]), (&json!(0.4), &json!(4.0)));
    let packed = packstone(here, &["run", "job.json", "--out", "made"]).await;
    assert_eq!(packed.code, Some(0), "{packed:?}");
    // What is there is kept, before anything is read.
    let again = packstone(here, &["mix", "read", "curve.csv", "--out", "job.json"]).await;
    assert!(again.code == Some(3) && again.stderr.contains("--force"), "{again:?}");
    assert_eq!(
        packstone(here, &["mix", "read", "curve.csv", "--out", "job.json", "--force"]).await.code,
        Some(0)
    );
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
async fn candidates_are_numbered_with_what_chooses_each() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path();
    write(here, "two.csv", TWO);
    let ended = packstone(here, &["mix", "read", "two.csv", "--out", "job.json"]).await;
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.stderr.contains("choose one") && !here.join("job.json").exists(), "{ended:?}");
    let json = packstone(here, &["mix", "read", "two.csv", "--json"]).await;
    let reading: Value = serde_json::from_str(&json.stdout).unwrap();
    let candidates = reading["candidates"].as_array().unwrap();
    for (i, candidate) in candidates.iter().enumerate() {
        let number = (i + 1).to_string();
        let line = ended.stdout.lines().find(|line| line.split_whitespace().next() == Some(&*number));
        let line = line.unwrap_or_else(|| panic!("{number}: {}", ended.stdout));
        let choice = &line[line.rfind("  --").expect("an option")..];
        // As a shell takes it.
        let command = format!("\"$0\" mix read two.csv --json {choice}");
        let mut shell = Command::new("sh");
        shell.args(["-c", &command, env!("CARGO_BIN_EXE_packstone")]).current_dir(here);
        let chosen = run(shell).await;
        assert_eq!(chosen.code, Some(0), "{choice}: {chosen:?}");
        let chosen: Value = serde_json::from_str(&chosen.stdout).unwrap();
        assert_eq!(chosen["request"], candidate["request"], "{choice}");
        let by_number = packstone(here, &["mix", "read", "two.csv", "--json", "--choose", &number]).await;
        let by_number: Value = serde_json::from_str(&by_number.stdout).unwrap();
        assert_eq!(by_number["request"], candidate["request"]);
    }
    let beyond = packstone(here, &["mix", "read", "two.csv", "--choose", "99"]).await;
    assert!(beyond.code == Some(3) && beyond.stderr.contains("must be at most"), "{beyond:?}");
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

const SAND: &str = "Sieve mm;Passing %\n0.125;2\n0.5;35\n1;60\n2;85\n4;100\n";
const GRAVEL: &str = "Sieve mm;Passing %\n2;0\n4;8\n8;55\n16;100\n";

fn blend_request() -> Value {
    let sieves = |points: Value| json!({"type": "sieves", "points": points});
    json!({
        "aggregates": [
            {"name": "sand", "grading": sieves(json!([[0.125, 2], [0.5, 35], [1, 60], [2, 85], [4, 100]]))},
            {"name": "gravel", "grading": sieves(json!([[2, 0], [4, 8], [8, 55], [16, 100]]))},
        ],
        "target": {"type": "standard", "name": "B16"},
    })
}

#[tokio::test]
async fn a_blend_is_answered_with_a_request_that_packs() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client = server.client();
    let answer = client.post("/v1/mixes/blend").json(&blend_request()).send().await.expect(200).json();
    let shares: Vec<f64> =
        answer["aggregates"].as_array().unwrap().iter().map(|one| one["share"].as_f64().unwrap()).collect();
    assert!((shares[0] + shares[1] - 1.0).abs() < 1.0e-12 && shares[0] > 0.3, "{answer:#}");
    // The one share that is free, by the normal equation at the sieves of B16.
    let (mut above, mut below) = (0.0, 0.0);
    let at = |points: &[[f64; 2]], mm: f64| {
        let next = points.partition_point(|point| point[0] < mm);
        match (next.checked_sub(1).map(|before| points[before]), points.get(next)) {
            (None, _) => {
                if points[0][0] == mm {
                    points[0][1]
                } else {
                    0.0
                }
            }
            (Some([a, fa]), Some([b, fb])) => fa + (fb - fa) * (mm / a).ln() / (b / a).ln(),
            (Some(_), None) => 1.0,
        }
    };
    let sand = [[0.063, 0.0], [0.125, 0.02], [0.5, 0.35], [1.0, 0.6], [2.0, 0.85], [4.0, 1.0]];
    let gravel = [[2.0, 0.0], [4.0, 0.08], [8.0, 0.55], [16.0, 1.0]];
    for sieve in answer["sieves"].as_array().unwrap() {
        let mm = sieve["sieve_mm"].as_f64().unwrap();
        let (s, g) = (if mm < 0.125 { 0.02 } else { at(&sand, mm) }, at(&gravel, mm));
        let target = sieve["target_low"].as_f64().unwrap();
        above += (s - g) * (target - g);
        below += (s - g) * (s - g);
    }
    assert!((shares[0] - above / below).abs() < 1.0e-9, "{} {answer:#}", above / below);
    let mut mix = answer["request"]["mix"].clone();
    mix["volume_fraction"] = json!(0.3);
    mix["d_min_mm"] = json!(4);
    let job = json!({"specimen": {"type": "box", "size_mm": [80, 80, 80]}, "mix": mix});
    let plan = client.post("/v1/plans").json(&job).send().await.expect(200).json();
    assert_eq!(plan["figures"]["k_value"], answer["figures"]["k_value"]);
    let query = client.post("/v1/mixes/blend?sheet=a").json(&blend_request()).send().await;
    query.expect_problem(400, "validation-error");
    let problem = client.post("/v1/mixes/blend").json(&json!({"aggregates": []})).send().await;
    let problem = problem.expect_problem(422, "validation-error");
    assert_eq!(problem["errors"].as_array().unwrap().len(), 2, "{problem:#}");
    server.stop().await;
}

#[tokio::test]
async fn the_command_blends_tables_and_requests() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path();
    write(here, "sand.csv", SAND);
    write(here, "gravel.csv", GRAVEL);
    write(here, "blend.json", &blend_request().to_string());
    let tables = ["mix", "blend", "sand.csv", "gravel.csv", "--target", "B16"];
    let text = packstone(here, &[&tables[..], &["--out", "job.json"]].concat()).await;
    assert_eq!(text.code, Some(0), "{text:?}");
    for words in ["volume %", "sand", "residual: at most", "k-value"] {
        assert!(text.stdout.contains(words), "{words}: {text:?}");
    }
    assert!(text.stderr.contains("specimen is a cube of 80 mm"), "{text:?}");
    let job: Value = serde_json::from_slice(&fs::read(here.join("job.json")).unwrap()).unwrap();
    assert_eq!(job["mix"]["aggregates"][1]["name"], "gravel");
    let of_tables = packstone(here, &[&tables[..], &["--json"]].concat()).await;
    let of_request = packstone(here, &["mix", "blend", "blend.json", "--json"]).await;
    assert_eq!(of_tables.stdout, of_request.stdout, "{of_request:?}");

    // Two stockpiles in the columns of one table, and a band in another.
    write(here, "two.csv", TWO);
    write(here, "band.csv", "Sieve mm;min;max\n16;90;100\n8;60;75\n4;40;60\n1;20;40\n");
    let ended = packstone(here, &["mix", "blend", "two.csv", "--target", "band.csv"]).await;
    assert_eq!(ended.code, Some(0), "{ended:?}");
    for words in ["Sand 0/4", "Gravel 4/16", "least %", "outside %"] {
        assert!(ended.stdout.contains(words), "{words}: {ended:?}");
    }
    let named = packstone(here, &["mix", "blend", "two.csv", "--target", "BS 882 all-in 20 mm"]).await;
    assert!(named.code == Some(0) && named.stdout.contains("most %"), "{named:?}");

    // Limits among the tables are what is met, and no stockpile.
    let limits = packstone(here, &["mix", "blend", "two.csv", "band.csv"]).await;
    assert!(limits.code == Some(0) && limits.stdout.contains("least %"), "{limits:?}");
    assert!(!limits.stdout.contains("middle"), "{limits:?}");
    let sheets = tables_of_tests().join("g84-two-sheets.xlsx");
    let sheets = packstone(here, &["mix", "blend", sheets.to_str().unwrap(), "--target", "A16"]).await;
    assert!(sheets.code == Some(0) && sheets.stdout.contains("Sand"), "{sheets:?}");
    let twice = packstone(here, &["mix", "blend", "sand.csv", "sand.csv", "--target", "A16"]).await;
    assert!(twice.code == Some(0) && twice.stdout.contains("sand (2)"), "{twice:?}");

    for (arguments, words) in [
        (&["two.csv"][..], "name what the blend is to meet by --target"),
        (&["band.csv", "--target", "A16"], "no curve of a stockpile"),
        (&["two.csv", "--target", "ASTM C33 No. 75"], "did you mean \"ASTM C33"),
        (&["two.csv", "--target", "A17"], "did you mean \"A16\"?"),
        (&["blend.json", "two.csv"], "leave other files and --target out"),
        (&["none.csv", "--target", "A16"], "none.csv"),
    ] {
        let ended = packstone(here, &[&["mix", "blend"][..], arguments].concat()).await;
        assert!(ended.code == Some(3) && ended.stderr.contains(words), "{words}: {ended:?}");
    }
}

fn tables_of_tests() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/mixes")
}
