//! `packstone mix`: mixes as laboratories print them.

mod job;
mod read;
mod text;

use clap::{Args, Subcommand};

use super::exit::Failure;

/// Options of `packstone mix`.
#[derive(Args)]
pub(super) struct Options {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Read a table of gradings or a recipe, and show what was understood
    Read(read::Options),
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    match &options.command {
        Command::Read(options) => read::run(options),
    }
}
