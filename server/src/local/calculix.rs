//! CalculiX on a deck that lies in a folder.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::Command;

use packstone_engine::export::deck::MODEL;
use thiserror::Error;

use crate::programs::{self, ProgramEnd, ProgramLimits};

/// Name of the program.
pub(crate) const CCX: &str = "ccx";
/// The file in the folder of a deck that has what CalculiX prints.
pub(crate) const LOG: &str = "ccx.log";
/// Most bytes of the end of the log that are read.
const END_BYTES: u64 = 1 << 16;
/// Most faults that are named.
const MAX_NAMED: usize = 5;
/// What it prints at the end of a job that it could solve.
const FINISHED: &str = "Job finished";
/// Files that it begins in the course of its work, with the share of the time that has passed by experience: what it
/// prints comes at its end, where it writes to a file.
const STEPS: [(&str, f64, &str); 2] =
    [("spooles.out", 0.1, "solving the equations"), ("", 0.0, "reading the deck")];

/// Why CalculiX has no answer.
#[derive(Debug, Error)]
pub(crate) enum CalculixError {
    /// There is no such program.
    #[error(
        "CalculiX is not found: {}; install it (Debian and Ubuntu: apt-get install calculix-ccx; others: \
         https://www.calculix.de), or name the program by --ccx",
        .0.as_ref().map_or_else(|| "no program ccx on PATH".to_owned(), |named| format!("no file {}", named.display()))
    )]
    Missing(Option<PathBuf>),
    /// It could not be started, or its output could not be written.
    #[error("CalculiX cannot be started: {0}")]
    NotStarted(#[from] io::Error),
    /// It ended before its end; with what it says of that.
    #[error("CalculiX failed ({how}):\n  {}\nits output is {}", .faults.join("\n  "), .log.display())]
    Failed {
        /// How the process ended.
        how: String,
        /// Its messages.
        faults: Vec<String>,
        /// Where all of its output is.
        log: PathBuf,
    },
    /// It was stopped on request.
    #[error("CalculiX was stopped")]
    Stopped,
    /// It was stopped at its limit of time.
    #[error("CalculiX was stopped after {0} s: --ccx-timeout-s gives it more")]
    TimedOut(u64),
    /// It was stopped at its limit of memory.
    #[error(
        "CalculiX was stopped with {0} MB of memory: --ccx-memory-mib gives it more; fewer cells take less"
    )]
    OutOfMemory(u64),
}

/// Finds CalculiX.
///
/// # Errors
/// [`CalculixError::Missing`].
pub(crate) fn find(named: Option<&Path>) -> Result<PathBuf, CalculixError> {
    let found = match named {
        Some(file) if file.components().count() > 1 => Some(file.to_owned()).filter(|file| file.is_file()),
        // A name without a folder is looked for, as shells do.
        _ => programs::on_path(named.map_or(CCX.as_ref(), Path::as_os_str)).into_iter().next(),
    };
    found.ok_or_else(|| CalculixError::Missing(named.map(Path::to_owned)))
}

/// Runs CalculiX on the deck of a folder. `progress` hears what it does, with the share of the work that is done.
///
/// # Errors
/// [`CalculixError`].
pub(crate) fn run(
    ccx: &Path,
    folder: &Path,
    threads: NonZeroUsize,
    limits: ProgramLimits,
    should_stop: impl Fn() -> bool,
    progress: impl Fn(f64, &str),
) -> Result<(), CalculixError> {
    let ccx = std::path::absolute(ccx)?;
    let log = folder.join(LOG);
    let mut command = Command::new(ccx);
    command.arg(MODEL).current_dir(folder).env("OMP_NUM_THREADS", threads.to_string());
    let look = |_| {
        if let Some((_, fraction, step)) = STEPS.iter().find(|(file, ..)| folder.join(file).exists()) {
            progress(*fraction, step);
        }
    };
    match programs::run(&mut command, limits, &log, should_stop, look)? {
        ProgramEnd::Stopped => Err(CalculixError::Stopped),
        ProgramEnd::TimedOut => Err(CalculixError::TimedOut(limits.time.map_or(0, |most| most.as_secs()))),
        ProgramEnd::OutOfMemory(bytes) => Err(CalculixError::OutOfMemory(bytes / 1_000_000)),
        ProgramEnd::Ended(status) => {
            let text = end_of(&log)?;
            if status.success() && text.contains(FINISHED) {
                return Ok(());
            }
            let how = programs::cause_of(status).unwrap_or_else(|| "it ended without an answer".to_owned());
            Err(CalculixError::Failed { how, faults: faults(&text), log })
        }
    }
}

/// The end of a file as text.
fn end_of(file: &Path) -> io::Result<String> {
    let mut file = File::open(file)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(END_BYTES)))?;
    let mut bytes = Vec::new();
    file.take(END_BYTES).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// The messages that begin with `*ERROR`, each with its further lines; where there are none, the last lines.
fn faults(log: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut lines = log.lines().map(str::trim).peekable();
    while let Some(line) = lines.next() {
        if line.starts_with("*ERROR") {
            let mut fault = line.to_owned();
            while let Some(more) = lines.next_if(|line| !line.is_empty() && !line.starts_with('*')) {
                fault.push(' ');
                fault.push_str(more);
            }
            if !found.contains(&fault) {
                found.push(fault);
            }
        } else if line.contains("fatal error") || line.contains("alloc") {
            // SPOOLES, where the system refuses memory.
            found.push(line.to_owned());
        }
    }
    if found.is_empty() {
        let last: Vec<&str> = log.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        let from = last.len().saturating_sub(MAX_NAMED);
        found = last[from..].iter().map(|line| (*line).to_owned()).collect();
    }
    if found.is_empty() {
        found.push("it printed nothing".into());
    }
    found.truncate(MAX_NAMED);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_found_with_all_their_lines() {
        let log = "\n *WARNING in x\n\n *ERROR reading *MATERIAL: the name\n        is too long\n        *ELASTIC\n\n\
                   *ERROR reading *MATERIAL: the name\n        is too long\n\n Total CalculiX Time: 0.1\n";
        assert_eq!(faults(log), ["*ERROR reading *MATERIAL: the name is too long"]);
        assert_eq!(faults("a\nb\n\n"), ["a", "b"]);
        assert_eq!(
            faults(" fatal error in A2_init\n malloc failure"),
            ["fatal error in A2_init", "malloc failure"]
        );
        assert_eq!(faults(""), ["it printed nothing"]);
    }
}
