//! `packstone mix`: mixes as laboratories print them.

mod blend;
mod job;
mod read;
mod text;

use std::path::Path;

use clap::{Args, Subcommand};
use packstone_engine::importer::MAX_WORKBOOK_BYTES;

use super::exit::{Exit, Failure};
use super::input::read_at_most;

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

/// The bytes of a table.
fn read_table(file: &Path) -> Result<Vec<u8>, Failure> {
    let bytes = read_at_most(file, MAX_WORKBOOK_BYTES as u64)?;
    if bytes.len() > MAX_WORKBOOK_BYTES {
        let text = format!("{} is refused: it has more than {MAX_WORKBOOK_BYTES} bytes", file.display());
        return Err(Exit::BadInput.because(text));
    }
    Ok(bytes)
}
