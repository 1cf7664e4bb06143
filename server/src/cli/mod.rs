//! The command line: one subcommand per file.
//!
//! `exit` has the exit codes, `outputs` the names of files and the rule that none is overwritten, `exports` the making
//! of exports and pictures, which `run`, `export` and `study` share.

mod backup;
mod bar;
mod bench;
mod check;
mod check_packing;
mod demo;
mod differences;
mod exit;
mod export;
mod exports;
mod health;
mod http_client;
mod input;
mod key;
mod migrate_store;
mod mix;
mod openapi;
mod outputs;
mod packing_file;
mod plan;
mod process;
mod run;
mod serve;
mod shell;
mod signals;
mod solve;
mod study;
mod unfinished;
mod webhook_secret;
mod worker;

use std::ffi::OsString;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use exit::Failure;

/// Version and commit, as `--version` tells them.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("PACKSTONE_COMMIT"), ")");

/// Turns a concrete mix design into a packing of spheres, ellipsoids or polyhedra
#[derive(Parser)]
#[command(name = "packstone", version = VERSION, about, after_help = exit::HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run jobs of a service on this machine
    Worker(Box<worker::Options>),
    /// Run the service
    Serve(Box<crate::config::ServeOptions>),
    /// Run the service, submit an example, and fetch its result and a picture of it
    Demo(demo::Options),
    /// Run one job without a service
    Run(run::Options),
    /// Make meshes, voxels, slices, decks, lattice models or a picture of a result
    Export(export::Options),
    /// Run CalculiX on a deck, and compute the properties that follow
    Solve(Box<solve::Options>),
    /// Run a study without a service: many packings and the table of how they ended
    Study(Box<study::Options>),
    /// Say what a job amounts to: grains, memory, time, chance of success
    Plan(plan::Options),
    /// Read mixes as laboratories print them: gradings and recipes
    Mix(mix::Options),
    /// Print the HTTP interface as an OpenAPI document
    Openapi,
    /// Measure the engine on this machine
    Bench(bench::Options),
    /// Copy the data directory of a service, running or not
    Backup(backup::Options),
    /// Check a packing in a file, or every file of a data directory against the database
    Check(check::Options),
    /// Move what a store holds from a data directory to PostgreSQL, or back
    MigrateStore(migrate_store::Options),
    /// Ask a service whether it takes jobs
    Health(health::Options),
    /// Make an API key and its line for the file of keys
    Key(key::Options),
    /// Make a secret by which a service signs webhooks, a line for the file that --webhook-secret-file names
    WebhookSecret,
    /// Print the completions of a shell
    Completions(shell::CompletionOptions),
    /// Print the manual page, or write one for each command
    Man(shell::ManOptions),
}

/// Runs the command line of this process.
#[inline(never)] // Nothing of it may run before the processor has been looked at.
/// Runs a command line, of which the first is the name of the program; its exit code. Wrong use of it ends the process.
pub(crate) fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let command = crate::config::without_empty_variables(Cli::command());
    let matches = command.get_matches_from(arguments);
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let ended = match cli.command {
        Command::Serve(options) => serve::run(*options, &crate::config::unknown_variables(&Cli::command())),
        Command::Worker(options) => worker::run(&options),
        Command::Demo(options) => demo::run(&options),
        Command::Run(options) => run::run(options),
        Command::Export(options) => export::run(&options),
        Command::Solve(options) => solve::run(&options),
        Command::Study(options) => study::run(&options),
        Command::Plan(options) => plan::run(&options),
        Command::Mix(options) => mix::run(&options),
        Command::Openapi => openapi::run(),
        Command::Bench(options) => bench::run(&options),
        Command::Backup(options) => backup::run(&options),
        Command::Check(options) => check::run(&options),
        Command::MigrateStore(options) => migrate_store::run(&options),
        Command::Health(options) => health::run(&options),
        Command::Key(options) => key::run(&options),
        Command::WebhookSecret => webhook_secret::run(),
        Command::Completions(options) => shell::completions(&options, Cli::command()),
        Command::Man(options) => shell::man(&options, Cli::command()),
    };
    let code = match ended {
        Ok(()) => 0,
        Err(failure) => {
            crate::telemetry::say(&format!("packstone: {failure}"));
            exit::code_of(&failure)
        }
    };
    crate::telemetry::flush();
    code
}

/// Runs a future on a runtime of its own, and does not wait at the end for threads that block: a
/// run that did not see the signal to stop must not keep the process alive.
fn block_on<T>(future: impl Future<Output = Result<T, Failure>>) -> Result<T, Failure> {
    block_on_threads(512, future)
}

/// The same with at most so many threads for what blocks them.
fn block_on_threads<T>(
    most_blocking: usize,
    future: impl Future<Output = Result<T, Failure>>,
) -> Result<T, Failure> {
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let runtime = runtime.max_blocking_threads(most_blocking).enable_all().build()?;
    let ended = runtime.block_on(future);
    runtime.shutdown_background();
    ended
}

/// Prints the names of files that are written. A reader that has left does not make the command fail.
fn print_files(files: impl IntoIterator<Item: AsRef<std::path::Path>>) -> Result<(), Failure> {
    let mut lines: Vec<String> = files.into_iter().map(|file| file.as_ref().display().to_string()).collect();
    lines.push(String::new());
    match print(&lines.join("\n")) {
        Err(failure) if exit::is_closed_pipe(&failure) => Ok(()),
        printed => printed,
    }
}

/// Makes sure that somebody can read standard output, for a secret that is shown once. The runtime of Rust opens
/// `/dev/null` to read and write where a process begins with a closed standard output, and what a program prints there
/// is taken without an error. `> /dev/null` of a shell opens it to write alone: who says so has decided it.
fn check_output() -> std::io::Result<()> {
    use std::os::unix::fs::MetadataExt as _;
    let out = std::io::stdout();
    let device = |found: u64, mode: u32| (found, mode & 0o170_000);
    let null = std::fs::metadata("/dev/null")?;
    let found = rustix::fs::fstat(&out)?;
    let is_null = device(found.st_rdev, found.st_mode) == device(null.rdev(), null.mode());
    if is_null && rustix::fs::fcntl_getfl(&out)?.contains(rustix::fs::OFlags::RDWR) {
        let what = "standard output is closed, or /dev/null: nobody can read what is shown only now";
        return Err(std::io::Error::other(what));
    }
    Ok(())
}

/// Prints to standard output; a reader that has left ends the command.
fn print(text: &str) -> Result<(), Failure> {
    use std::io::Write as _;
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes())?;
    Ok(out.flush()?)
}
