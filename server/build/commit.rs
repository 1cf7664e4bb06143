//! The commit that the binary is built from: `PACKSTONE_COMMIT` where the environment has it (images and packages are
//! built from a copy without `.git`), else what Git says, else `unknown`.
//!
//! Only builds that are optimised ask Git again after a commit: a rebuild of the whole server is too much for a test.

use std::process::Command;

/// Hands the commit to the compiler.
pub(crate) fn state() {
    println!("cargo:rerun-if-env-changed=PACKSTONE_COMMIT");
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release")
        && let Some(log) = git(&["rev-parse", "--path-format=absolute", "--git-path", "logs/HEAD"])
    {
        println!("cargo:rerun-if-changed={log}");
    }
    let given = std::env::var("PACKSTONE_COMMIT").ok().filter(|commit| !commit.trim().is_empty());
    let commit = given.or_else(|| git(&["rev-parse", "--short=12", "HEAD"]));
    println!("cargo:rustc-env=PACKSTONE_COMMIT={}", commit.as_deref().unwrap_or("unknown"));
}

/// The first line that Git prints, if it succeeds.
fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.lines().next().map(str::to_owned)
}
