//! The commands of `README.md`, run as they stand there: every block fenced as `sh`, in one shell, in this order.
//!
//! Left out are lines that begin with `cargo `: the binary under test takes their place. The ports 8080 and 8081
//! are replaced by free ones.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::harness::deadline::within;
use crate::harness::machine::{has_tools_of_scripts, port};

const README: &str = include_str!("../README.md");

/// The lines of all blocks fenced as `sh`.
fn commands() -> String {
    let mut text = String::new();
    for block in README.split("\n```sh\n").skip(1) {
        let block = block.split("\n```").next().unwrap();
        text.extend(block.lines().filter(|line| !line.starts_with("cargo ")).flat_map(|line| [line, "\n"]));
    }
    text
}

#[tokio::test]
async fn the_commands_of_the_readme_run_as_pasted() {
    if !has_tools_of_scripts(&["bash", "curl", "jq"]) {
        return;
    }
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let directory = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(
        root.join("examples").canonicalize().unwrap(),
        directory.path().join("examples"),
    )
    .unwrap();
    let (port, network) = (port(), port());
    let commands = commands();
    for command in ["demo", "plan", "run", "export", "study", "serve", "key"] {
        assert!(commands.contains(&format!("packstone {command}")), "{command} is not in the README");
    }
    let script = format!(
        "set -euo pipefail\ntrap 'kill $(jobs -p) 2>/dev/null' EXIT\n{}",
        commands
            .replace("localhost:8080", &format!("127.0.0.1:{port}"))
            .replace("localhost:8081", &format!("127.0.0.1:{network}"))
            .replace("0.0.0.0:8081", &format!("0.0.0.0:{network}"))
    );
    let binaries = Path::new(env!("CARGO_BIN_EXE_packstone")).parent().unwrap().to_owned();
    let path = format!("{}:{}", binaries.display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("bash");
    shell.args(["-c", &script]).current_dir(directory.path()).env("PATH", path);
    shell.env("PACKSTONE_LISTEN", format!("127.0.0.1:{port}"));
    shell.stdin(Stdio::null());
    let output = tokio::task::spawn_blocking(move || shell.output());
    // Half a minute of computing, on a machine that may build something else meanwhile.
    let output = within(Duration::from_mins(15), "the commands to end", output).await.unwrap().unwrap();
    let [stdout, stderr] =
        [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{}\n{script}\n{stdout}\n{stderr}", output.status);

    for file in [
        "packstone-demo/result.png",
        "a16/result.json",
        "a16/result.vtp",
        "a16/result.png",
        "a16/result.segments-10.msh",
        "a16/result.slice.x.svg",
        "a16/result.ldpm.tets.vtu",
        "small/plot-success.svg",
        "a16.vtp",
    ] {
        assert!(fs::metadata(directory.path().join(file)).is_ok_and(|file| file.len() > 0), "{file}");
    }
    assert!(stdout.contains("\"state\": \"succeeded\""), "{stdout}");
    assert!(stdout.contains("\"name\":\"laboratory\""), "the server on a network knows the key: {stdout}");
}

/// Links to files of the repository lead somewhere.
#[test]
fn the_links_of_the_readme_exist() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    for link in README.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
        assert!(link.starts_with("https://") || root.join(link).exists(), "{link}");
    }
}
