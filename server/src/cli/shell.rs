//! `packstone completions` and `packstone man`: what a package installs beside the binary.

use std::io::Write as _;
use std::path::PathBuf;

use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;

use super::exit::{Failure, cannot_be};
use super::print;

/// Options of `packstone completions`.
#[derive(Args)]
pub(super) struct CompletionOptions {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Options of `packstone man`.
#[derive(Args)]
pub(super) struct ManOptions {
    /// Folder for the pages of all commands, `packstone-run.1` and so on; without it the page of `packstone` is printed
    #[arg(long)]
    out: Option<PathBuf>,
}

pub(super) fn completions(options: &CompletionOptions, mut command: Command) -> Result<(), Failure> {
    let mut text = Vec::new();
    clap_complete::generate(options.shell, &mut command, "packstone", &mut text);
    let mut out = std::io::stdout().lock();
    out.write_all(&text)?;
    Ok(out.flush()?)
}

pub(super) fn man(options: &ManOptions, command: Command) -> Result<(), Failure> {
    let Some(folder) = &options.out else {
        let mut text = Vec::new();
        Man::new(command).render(&mut text)?;
        return print(&String::from_utf8(text)?);
    };
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command, folder))
        .map_err(|error| cannot_be("written", folder, &error))
}
