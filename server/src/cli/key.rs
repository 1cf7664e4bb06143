//! `packstone key`: a fresh API key. Nothing keeps it but whoever reads this output.

use clap::Args;

use super::exit::Failure;
use super::print;
use crate::http::auth;

/// Options of `packstone key`.
#[derive(Args)]
pub(super) struct Options {
    /// Who will use the key; one word or more, without line breaks
    #[arg(value_parser = name)]
    name: String,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let (key, line) = auth::generate(&options.name);
    eprintln!("The key, shown only now; clients send it as `Authorization: Bearer KEY`:");
    print(&format!("{key}\n"))?;
    eprintln!("Its line for the file that --api-keys-file names:");
    print(&format!("{line}\n"))
}

fn name(text: &str) -> Result<String, String> {
    let name = text.trim();
    if name.is_empty() || name.chars().any(char::is_control) {
        return Err("must be one line of text".into());
    }
    Ok(name.to_owned())
}
