//! Names of the files that a command writes, and the rule that it overwrites none unless it is told to.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use packstone_engine::export::ExportRequest;

use super::exit::{Exit, Failure};

/// Names of files that begin alike, none of them twice: `result.msh`, then `result-2.msh`.
pub(super) struct Names {
    stem: String,
    taken: HashSet<String>,
}

impl Names {
    /// Names that begin so.
    pub(super) fn of(stem: &str) -> Self {
        Self { stem: stem.to_owned(), taken: HashSet::new() }
    }

    /// The next free one for an export.
    pub(super) fn of_export(&mut self, export: &ExportRequest) -> String {
        let ending = export.file_ending();
        let mut name = format!("{}.{ending}", self.stem);
        let mut n = 2;
        while !self.taken.insert(name.clone()) {
            name = format!("{}-{n}.{ending}", self.stem);
            n += 1;
        }
        name
    }
}

/// The path with one more ending.
pub(super) fn beside(file: &Path, ending: &str) -> PathBuf {
    let mut path = file.as_os_str().to_owned();
    path.push(".");
    path.push(ending);
    path.into()
}

/// Refuses files that exist, unless `force` is set. Asked before the work, so that none of it is wasted.
///
/// # Errors
/// The names of at most ten of them, with exit code 3.
pub(super) fn refuse_existing<'a>(
    files: impl IntoIterator<Item = &'a PathBuf>,
    force: bool,
) -> Result<(), Failure> {
    const NAMED: usize = 10;
    if force {
        return Ok(());
    }
    let existing: Vec<String> =
        files.into_iter().filter(|file| file.exists()).map(|file| file.display().to_string()).collect();
    if existing.is_empty() {
        return Ok(());
    }
    let more = existing.len().saturating_sub(NAMED);
    let more = if more > 0 { format!("\n  and {more} more") } else { String::new() };
    let named = existing[..existing.len().min(NAMED)].join("\n  ");
    Err(Exit::BadInput.because(format_args!(
        "these files exist; --force overwrites them, --out names another place:\n  {named}{more}"
    )))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_exists_is_named_and_kept() {
        let directory = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = (0..13).map(|i| directory.path().join(format!("{i}.csv"))).collect();
        assert!(refuse_existing(&files, false).is_ok());
        for file in &files[1..] {
            std::fs::write(file, "kept").unwrap();
        }
        let refused = refuse_existing(&files, false).unwrap_err().to_string();
        assert!(refused.contains("--force") && refused.contains("1.csv"), "{refused}");
        assert!(!refused.contains("/0.csv") && refused.ends_with("and 2 more"), "{refused}");
        assert!(refuse_existing(&files, true).is_ok());
    }
}
