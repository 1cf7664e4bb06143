//! Commands of the binary that end by themselves.

use std::path::Path;
use std::process::{Command, Stdio};

use super::deadline::patiently;

/// How a command ended.
#[derive(Debug)]
pub(crate) struct Finished {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// Runs `packstone` with `args` in `directory` until it ends.
pub(crate) async fn packstone(directory: &Path, args: &[&str]) -> Finished {
    let mut command = Command::new(env!("CARGO_BIN_EXE_packstone"));
    command.args(args).current_dir(directory);
    run(command).await
}

/// Runs a command until it ends.
pub(crate) async fn run(mut command: Command) -> Finished {
    command.stdin(Stdio::null());
    let output = tokio::task::spawn_blocking(move || command.output());
    let output = patiently("a command to end", output).await.unwrap().expect("the command starts");
    Finished {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}
