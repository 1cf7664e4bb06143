//! `packstone migrate-store`: moves what a store holds from a data directory to PostgreSQL, or back.

mod moving;

use clap::Args;

use super::Failure;

/// Options of `packstone migrate-store`.
#[derive(Args)]
#[command(
    after_help = "A PLACE is a data directory, for the file packstone.sqlite in it, or a database of PostgreSQL as \
    postgres://user@host/database. One of the two is a data directory and the other is PostgreSQL. No server may use \
    either of them. The destination must be empty; a data directory that is missing is made. The source is not changed. \
    Results and exports are files and stay where they are."
)]
pub(super) struct Options {
    /// The source
    #[arg(long, value_name = "PLACE")]
    from: String,
    /// The destination
    #[arg(long, value_name = "PLACE")]
    to: String,
    /// Move a database of PostgreSQL although other connections of packstone are open. What a server writes afterwards
    /// is not in the copy
    #[arg(long)]
    force: bool,
    /// Print the tables with their rows and digests as JSON
    #[arg(long)]
    json: bool,
}

/// Moves the store.
pub(super) fn run(options: &Options) -> Result<(), Failure> {
    moving::run(options)
}
