//! Reads the two places, takes their locks, moves the store, and says what was moved.

use std::fmt::Write as _;
use std::fs::File;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::json;

use super::Options;
use crate::cli::bar::Bar;
use crate::cli::check::DATABASE;
use crate::cli::exit::{Exit, cannot_be};
use crate::cli::{Failure, block_on, print};
use crate::jobs::store::Database;
use crate::jobs::store::transfer::{Moved, Progress, Transfer, TransferError};
use crate::service::{StartError, lock};

/// Progress is shown of what takes longer.
const SHOW_AFTER: Duration = Duration::from_secs(1);
/// Digits of a digest in the table.
const DIGITS: usize = 12;

/// Where a store lies.
#[derive(Debug)]
enum Place {
    /// In the file of a data directory.
    Directory(PathBuf),
    /// In PostgreSQL.
    Postgres(Database),
}

impl Place {
    /// Reads an option. What is said of a URL does not repeat it: it may have a password.
    fn read(option: &str, text: &str) -> Result<Self, Failure> {
        if !text.contains("://") {
            return Ok(Self::Directory(text.into()));
        }
        let database = text.parse();
        database.map(Self::Postgres).map_err(|error| Exit::BadInput.because(format_args!("{option} {error}")))
    }

    fn database(&self) -> Database {
        match self {
            Self::Directory(directory) => Database::File(directory.join(DATABASE)),
            Self::Postgres(database) => database.clone(),
        }
    }
}

/// Moves the store.
pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let [from, to] = [Place::read("--from", &options.from)?, Place::read("--to", &options.to)?];
    let transfer = Transfer::new(from.database(), to.database()).map_err(failure)?;
    // Until the end no server uses the directory.
    let _locks = [take(&from, true)?, take(&to, false)?];
    let bar = Bar::new();
    let is_shown = std::io::stderr().is_terminal();
    let moved = block_on(async {
        let show = |progress| {
            if is_shown && bar.elapsed() >= SHOW_AFTER {
                bar.show(fraction(progress), || words(progress));
            }
        };
        transfer.run(options.force, show).await.map_err(failure)
    });
    bar.finish();
    let moved = moved?;
    if options.json { print(&as_json(&transfer, &moved)) } else { print(&as_text(&from, &to, &moved)) }
}

/// Takes the lock of a data directory. The source must have a database; the destination is made where it is missing.
fn take(place: &Place, is_source: bool) -> Result<Option<File>, Failure> {
    let Place::Directory(directory) = place else { return Ok(None) };
    if !is_source {
        std::fs::create_dir_all(directory).map_err(|error| cannot_be("made", directory, &error))?;
    } else if !directory.join(DATABASE).is_file() {
        let directory = directory.display();
        let text = format_args!("{directory} is no data directory: it holds no {DATABASE}");
        return Err(Exit::BadInput.because(text));
    }
    match lock(directory) {
        Ok(lock) => Ok(Some(lock)),
        Err(StartError::DataDir(directory, error)) => Err(cannot_be("locked", &directory, &error)),
        Err(error) => Err(error.into()),
    }
}

fn failure(error: TransferError) -> Failure {
    let exit = match &error {
        TransferError::SameKind { .. } | TransferError::NotEmpty { .. } => Exit::BadInput,
        TransferError::Differs { .. } | TransferError::Schema(_) => Exit::CheckFailed,
        TransferError::Store(error) if error.is_full() => Exit::Machine,
        TransferError::InUse { .. } | TransferError::Store(_) => Exit::Unexpected,
    };
    exit.because(error)
}

fn fraction(progress: Progress) -> f64 {
    let done = (progress.copied + progress.verified) as f64;
    (done / (2.0 * progress.rows as f64)).min(1.0)
}

fn words(progress: Progress) -> String {
    match progress {
        Progress { copied, rows, verified: 0 } => format!("{copied} of {rows} rows copied"),
        Progress { verified, rows, .. } => format!("{verified} of {rows} rows verified"),
    }
}

fn as_json(transfer: &Transfer, moved: &[Moved]) -> String {
    let tables: Vec<_> = moved
        .iter()
        .map(|Moved { table, rows, sha256 }| json!({"table": table, "rows": rows, "sha256": sha256}))
        .collect();
    let (from, to) = (transfer.from().to_string(), transfer.to().to_string());
    format!("{:#}\n", json!({"from": from, "to": to, "tables": tables}))
}

fn as_text(from: &Place, to: &Place, moved: &[Moved]) -> String {
    let width = moved.iter().map(|moved| moved.table.len()).max().unwrap_or(0);
    let mut text = format!("{:width$}  {:>10}  SHA-256\n", "table", "rows");
    for Moved { table, rows, sha256 } in moved {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{table:width$}  {rows:>10}  {}", sha256.get(..DIGITS).unwrap_or(sha256));
    }
    let rows: u64 = moved.iter().map(|moved| moved.rows).sum();
    text + &format!("{rows} rows were moved; both sides have the same digests.\n") + &what_next(from, to)
}

/// Where the files are, and what to start.
fn what_next(from: &Place, to: &Place) -> String {
    let file = |directory: &Path| directory.join(DATABASE).display().to_string();
    match (from, to) {
        (Place::Directory(directory), Place::Postgres(database)) => format!(
            "Results and exports are files: they stay in {0}/artifacts, or where --blobs puts them. The old database is\n\
             still there: move {1} away, so that no server goes on with it by mistake. Start next:\n  \
             packstone serve --data-dir {0} --store '{database}'\n",
            directory.display(),
            file(directory),
        ),
        (_, Place::Directory(directory)) => format!(
            "Results and exports are files and were not moved. If the server had another data directory than {0}, move\n\
             the folder checkpoints of that one there and, without --blobs, the folder artifacts. Start next, without\n\
             --store:\n  packstone serve --data-dir {0}\n",
            directory.display(),
        ),
        // No transfer has these two.
        (Place::Postgres(_), Place::Postgres(_)) => String::new(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_url_is_told_from_a_directory_and_its_password_is_not_repeated() {
        assert!(matches!(Place::read("--from", "data/lab"), Ok(Place::Directory(_))));
        assert!(matches!(Place::read("--from", "postgresql://a@b/c"), Ok(Place::Postgres(_))));
        for url in ["mysql://lab:secret@host/db", "postgres://lab:secret@host:port/db"] {
            let refused = Place::read("--to", url).unwrap_err().to_string();
            assert!(refused.contains("--to") && !refused.contains("secret"), "{refused}");
        }
    }

    #[test]
    fn both_halves_count_in_the_progress() {
        let copied = Progress { copied: 10, verified: 0, rows: 10 };
        assert!((fraction(copied) - 0.5).abs() < 1e-12);
        assert_eq!(words(copied), "10 of 10 rows copied");
        let verified = Progress { verified: 10, ..copied };
        assert!((fraction(verified) - 1.0).abs() < 1e-12);
        assert_eq!(words(verified), "10 of 10 rows verified");
    }
}
