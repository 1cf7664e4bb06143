//! Decks from a mix to the answer of a solver: `packstone run --solve`, `packstone solve`, and the export over HTTP.
//!
//! CalculiX is the one that `PACKSTONE_CCX` names, else `ccx` on PATH; without it the tests that need it say so.
//! Programs in its place show what becomes of one that fails, hangs or answers nothing.

use std::fs;
use std::io::{Cursor, Read as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::deadline::eventually;
use crate::harness::results::json_in as read;
use crate::harness::{Client, DataDir, Running, Server, id_of, machine, packstone};

const CCX: &str = "PACKSTONE_CCX";

/// CalculiX, if it is installed.
fn ccx() -> Option<PathBuf> {
    let named = std::env::var_os(CCX).filter(|value| !value.is_empty()).map(PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = named.or_else(|| {
        std::env::split_paths(&path).map(|folder| folder.join("ccx")).find(|file| file.is_file())
    });
    if found.is_none() {
        machine::skip(CCX, "no ccx", "Install calculix-ccx; no deck was solved.");
    }
    found
}

/// A small cube of mortar with spheres, and its materials.
fn mix() -> Value {
    json!({
        "seed": 1,
        "specimen": {"type": "box", "size_mm": [24, 24, 24]},
        "mix": {"grading": {"type": "standard", "name": "A8"}, "d_min_mm": 4, "volume_fraction": 0.4,
            "allow_coarse": true},
        "distance": {"type": "constant", "gap_mm": 0.4},
        "materials": {
            "matrix": {"youngs_modulus_gpa": 25, "poissons_ratio": 0.2, "expansion_1_k": 1.1e-5},
            "aggregate": {"youngs_modulus_gpa": 70, "poissons_ratio": 0.2, "expansion_1_k": 8e-6}},
    })
}

fn without_materials() -> Value {
    let mut job = mix();
    job.as_object_mut().unwrap().remove("materials");
    job
}

/// The files of a zip by name.
fn unzipped(bytes: &[u8]) -> Vec<(String, String)> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    (0..archive.len())
        .map(|i| {
            let mut file = archive.by_index(i).unwrap();
            let mut text = String::new();
            file.read_to_string(&mut text).unwrap();
            (file.name().unwrap().into_owned(), text)
        })
        .collect()
}

#[tokio::test]
async fn one_command_goes_from_a_mix_to_the_modulus() {
    let Some(ccx) = ccx() else { return };
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    fs::write(folder.join("mix.json"), mix().to_string()).unwrap();
    let ccx = ccx.to_str().unwrap();
    let args =
        ["run", "mix.json", "--out", "out", "--solve", "cells=12", "--solve", "load=temperature,cells=12"];
    let run = packstone(folder, &[&args[..], &["--ccx", ccx]].concat()).await;
    assert_eq!(run.code, Some(0), "{run:?}");
    let deck = folder.join("out/result.deck.cells-12");
    let figures = read(&deck.join("deck.json"));
    let share = |phase: usize| figures["phases"][phase]["volume_mm3"].as_f64().unwrap() / 24.0_f64.powi(3);
    let (matrix, grains) = (share(0), share(1));
    assert!((matrix + grains - 1.0).abs() < 1e-12 && grains > 0.1, "{figures:#}");
    let solution = read(&deck.join("solution.json"));
    let e = solution["youngs_modulus_gpa"].as_f64().unwrap();
    let (reuss, voigt) = (1.0 / (matrix / 25.0 + grains / 70.0), matrix * 25.0 + grains * 70.0);
    assert!(e > reuss && e < voigt, "{reuss} < {e} < {voigt}");
    assert!(run.stdout.contains(&format!("Young's modulus along z     {e:.5} GPa")), "{run:?}");
    for ratio in solution["poissons_ratios"].as_array().unwrap() {
        assert!((0.17..0.23).contains(&ratio.as_f64().unwrap()), "{solution:#}");
    }
    assert!(solution["imbalance"].as_f64().unwrap() < 1e-6, "{solution:#}");
    assert!(solution["stray_stress"].as_f64().unwrap() < 1e-6, "{solution:#}");
    let heated = read(&folder.join("out/result.deck.temperature.cells-12/solution.json"));
    for alpha in heated["expansion_1_k"].as_array().unwrap() {
        assert!((8e-6..1.1e-5).contains(&alpha.as_f64().unwrap()), "{heated:#}");
    }

    // The zip is the same deck; its results are not overwritten.
    let zip = ["solve", "out/result.deck.cells-12.zip", "--ccx", ccx];
    let refused = packstone(folder, &zip).await;
    assert_eq!(refused.code, Some(3), "{refused:?}");
    assert!(refused.stderr.contains("--force overwrites them"), "{refused:?}");
    let again = packstone(folder, &[&zip[..], &["--out", "again", "--json"]].concat()).await;
    assert_eq!(again.code, Some(0), "{again:?}");
    // Threads of CalculiX round the last digits otherwise from run to run.
    let is_same = |other: &Value| (other["youngs_modulus_gpa"].as_f64().unwrap() / e - 1.0).abs() < 1e-6;
    assert!(is_same(&serde_json::from_str(&again.stdout).unwrap()), "{again:?}");
    // What a user changes in a folder counts: a matrix of half the stiffness.
    let materials = folder.join("again/materials.inp");
    let softer = fs::read_to_string(&materials).unwrap().replace("25000.0, 0.2", "12500.0, 0.2");
    fs::write(&materials, softer).unwrap();
    let softer = packstone(folder, &["solve", "again", "--force", "--json", "--ccx", ccx]).await;
    assert_eq!(softer.code, Some(0), "{softer:?}");
    let softer: Value = serde_json::from_str(&softer.stdout).unwrap();
    let modulus = softer["youngs_modulus_gpa"].as_f64().unwrap();
    assert!(modulus < 0.7 * e && modulus > 0.5 * e, "{modulus}");
    // A run that is complete solves what has no results.
    fs::remove_file(deck.join("solution.json")).unwrap();
    let resumed = packstone(folder, &[&args[..], &["--ccx", ccx, "--resume"]].concat()).await;
    assert_eq!(resumed.code, Some(0), "{resumed:?}");
    assert!(is_same(&read(&deck.join("solution.json"))));
}

/// A program in place of CalculiX.
fn program(folder: &Path, script: &str) -> String {
    let file = folder.join("fake-ccx");
    fs::write(&file, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).unwrap();
    file.to_str().unwrap().to_owned()
}

/// Packs the mix and makes a deck of it.
async fn deck(folder: &Path, options: &str) -> String {
    fs::write(folder.join("mix.json"), mix().to_string()).unwrap();
    let export = format!("deck:cells=6,{options}");
    let run = packstone(folder, &["run", "mix.json", "--out", "out", "--export", &export]).await;
    assert_eq!(run.code, Some(0), "{run:?}");
    run.stdout.lines().find(|line| line.rsplit('.').next() == Some("zip")).unwrap().to_owned()
}

#[tokio::test]
async fn a_solver_that_is_missing_or_fails_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let zip = deck(folder, "").await;
    let out = ["--out", "solved", "--force"];
    let missing = packstone(folder, &[&["solve", &zip, "--ccx", "/nowhere/ccx"], &out[..]].concat()).await;
    assert_eq!(missing.code, Some(9), "{missing:?}");
    assert!(missing.stderr.contains("no file /nowhere/ccx; install it"), "{missing:?}");
    // Before the packing, where it is known that CalculiX is to run.
    let run = ["run", "mix.json", "--out", "other", "--solve", "--ccx", "/nowhere/ccx"];
    let missing = packstone(folder, &run).await;
    assert_eq!((missing.code, folder.join("other").exists()), (Some(9), false), "{missing:?}");
    for (script, code, says) in [
        (
            "echo ' *ERROR reading *MATERIAL: no name'; echo '        is given'; exit 201",
            9,
            "CalculiX failed (exit code 201):\n  *ERROR reading *MATERIAL: no name is given\n",
        ),
        ("exit 0", 9, "it ended without an answer"),
        ("kill -9 $$", 9, "it was killed (signal 9), as the system does where memory is short"),
        ("echo ' Job finished'", 3, "model.dat cannot be read"),
        ("echo ' Job finished'; echo > model.dat; echo > model.frd", 9, "model.dat has no displacements"),
    ] {
        let ccx = program(folder, script);
        let failed = packstone(folder, &[&["solve", &zip, "--ccx", &ccx], &out[..]].concat()).await;
        assert_eq!(failed.code, Some(code), "{failed:?}");
        assert!(failed.stderr.contains(says), "{failed:?}");
        assert!(!folder.join("solved/solution.json").exists());
        // What failed may be run again without being asked.
        assert!(folder.join("solved/solution.json.unfinished").exists());
    }
}

#[tokio::test]
async fn a_solver_that_hangs_is_stopped_with_what_it_started() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let zip = deck(folder, "").await;
    // A child of the program that its stop must reach too.
    let ccx = program(folder, "sleep 600 &\necho $! >> started.pid\nmv started.pid pid\nwait");
    let pid = folder.join("solved/pid");
    let is_gone = || {
        let Ok(number) = fs::read_to_string(&pid) else { return true };
        // A process that nobody has waited for yet is dead all the same.
        let status = fs::read_to_string(format!("/proc/{}/status", number.trim()));
        status.map_or(true, |status| status.contains("State:\tZ"))
    };
    let args = ["solve", &zip, "--out", "solved", "--force", "--ccx", &ccx];
    let running = Running::start(folder, &args).await;
    eventually("the program to start", || pid.exists()).await;
    running.signal(Signal::INT);
    let ended = running.ended().await;
    assert_eq!(ended.code, Some(130), "{ended:?}");
    eventually("its child to end", is_gone).await;
    fs::remove_file(&pid).unwrap();
    let late = packstone(folder, &[&args[..], &["--ccx-timeout-s", "0.5"]].concat()).await;
    assert_eq!(late.code, Some(4), "{late:?}");
    assert!(late.stderr.contains("--ccx-timeout-s gives it more"), "{late:?}");
    eventually("its child to end", is_gone).await;
    fs::remove_file(&pid).unwrap();
    // A command that is killed stops it, too.
    let running = Running::start(folder, &args).await;
    eventually("the program to start", || pid.exists()).await;
    assert!(!is_gone());
    running.signal(Signal::KILL);
    running.ended().await;
    eventually("its child to end", is_gone).await;
}

#[tokio::test]
async fn what_is_no_deck_for_calculix_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let folder = directory.path();
    let zip = deck(folder, "solver=abaqus").await;
    let ccx = program(folder, "exit 1");
    fs::write(folder.join("text.zip"), "no zip").unwrap();
    fs::create_dir(folder.join("empty")).unwrap();
    for (deck, says) in [
        (zip.as_str(), "it is for Abaqus; its README says how to run it"),
        ("text.zip", "text.zip is refused"),
        ("empty", "it has no deck.json: it is no deck of Packstone"),
        ("nothing.zip", "nothing.zip cannot be read"),
    ] {
        let refused = packstone(folder, &["solve", deck, "--out", "solved", "--ccx", &ccx]).await;
        assert_eq!(refused.code, Some(3), "{refused:?}");
        assert!(refused.stderr.contains(says), "{refused:?}");
        assert!(!folder.join("solved").exists());
    }
    let abaqus = packstone(folder, &["run", "mix.json", "--solve", "solver=abaqus"]).await;
    assert_eq!(abaqus.code, Some(2), "{abaqus:?}");
    fs::write(folder.join("bare.json"), without_materials().to_string()).unwrap();
    let bare = packstone(folder, &["run", "bare.json", "--out", "bare", "--solve", "--ccx", &ccx]).await;
    assert_eq!((bare.code, folder.join("bare").exists()), (Some(3), false), "{bare:?}");
    assert!(bare.stderr.contains("\"youngs_modulus_gpa\": 25"), "{bare:?}");
}

#[tokio::test]
async fn the_service_makes_the_same_deck() {
    let data_dir = DataDir::new();
    let server = Server::start(&data_dir).await;
    let client: Client = server.client();
    let job = client.succeed(&mix()).await;
    let path = |query: &str| format!("/v1/jobs/{}/exports/deck?{query}", id_of(&job));
    let zip = client.get(&path("cells=6&load=shear_yz")).send().await;
    let files = unzipped(&zip.expect(200).body);
    let directory = tempfile::tempdir().unwrap();
    deck(directory.path(), "load=shear_yz").await;
    let of_command = fs::read(directory.path().join("out/result.deck.shear_yz.cells-6.zip")).unwrap();
    // The head states the digest of the stored result, which a file of the command does not have.
    for ((name, text), (_, other)) in files.iter().zip(unzipped(&of_command)) {
        let lines = |text: &str| -> Vec<String> {
            text.lines().filter(|line| !line.contains("Packing: seed")).map(str::to_owned).collect()
        };
        assert_eq!(lines(text), lines(&other), "{name}");
    }
    let cylinder_load = client.get(&path("load=bending")).send().await;
    cylinder_load.expect_problem(400, "validation-error");
    let bare = client.succeed(&without_materials()).await;
    let refused = client.get(&format!("/v1/jobs/{}/exports/deck", id_of(&bare))).send().await;
    let problem = refused.expect_problem(422, "validation-error");
    assert!(problem.to_string().contains("youngs_modulus_gpa"), "{problem:#}");
    let mut with_deck = without_materials();
    with_deck["postprocess"] = json!({"type": "deck", "cells": 6});
    let refused = client.post("/v1/jobs").json(&with_deck).send().await;
    refused.expect_problem(422, "validation-error");
    with_deck["postprocess"]["materials"] = mix()["materials"].clone();
    client.succeed(&with_deck).await;
    server.stop().await;
}
