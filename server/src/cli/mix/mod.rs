//! `packstone mix`: mixes as laboratories print them.

mod blend;
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
    /// Find the shares of stockpiles whose blend comes nearest to a curve or into a band
    Blend(blend::Options),
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    match &options.command {
        Command::Read(options) => read::run(options),
        Command::Blend(options) => blend::run(options),
    }
}
