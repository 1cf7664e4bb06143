//! Exit codes: how scripts tell a bad request from a target that was not reached and from a fault of the machine.

use std::fmt;
use std::io::{self, ErrorKind};
use std::path::Path;

use packstone_engine::PackError;
use packstone_engine::export::ExportError;

/// What a command ends with when it fails: a line for the person at the terminal, and the exit code if the error
/// is an [`Ended`] or an [`io::Error`]; any other has [`Exit::Unexpected`].
pub(super) type Failure = Box<dyn std::error::Error + Send + Sync>;

/// The codes, for `--help`.
pub(super) const HELP: &str = "\
Exit codes:
  0    success
  1    unexpected error
  2    wrong use of the command line
  3    bad input: a request, an option or a file that does not hold
  4    the method ended before its target: not every grain was placed, or growth stopped
  5    a packing, an export or a copy failed its check, which is a defect of Packstone
  6    a fault of the machine: no space, no memory, a disk that fails
  7    a merged study is unfinished: runs are missing
  8    a server refused this worker: another build, other bits, or a key that may not lease jobs
  9    a program that the command starts is missing or failed: CalculiX
  130  stopped by a signal";

/// How a command fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Exit {
    /// Anything else.
    Unexpected = 1,
    /// A request, an option or a file that does not hold.
    BadInput = 3,
    /// The method ended before its target.
    TargetNotReached = 4,
    /// A check failed: a defect.
    CheckFailed = 5,
    /// No space, no memory, a disk that fails.
    Machine = 6,
    /// Runs of a merged study are missing.
    Unfinished = 7,
    /// A server refused a worker.
    Refused = 8,
    /// Another program is missing or failed.
    Program = 9,
    /// A signal.
    Interrupted = 130,
}

impl Exit {
    /// A failure with this code.
    pub(super) fn because(self, text: impl fmt::Display) -> Failure {
        Box::new(Ended { exit: self, text: text.to_string() })
    }

    /// Whether the same command may succeed later: it was stopped, or the machine failed.
    pub(super) fn may_pass(failure: &Failure) -> bool {
        let code = code_of(failure);
        [Self::Unexpected, Self::Machine, Self::Interrupted].into_iter().any(|exit| exit as u8 == code)
    }

    /// The code for an error of the system.
    pub(super) fn of_io(error: &io::Error) -> Self {
        match error.kind() {
            ErrorKind::NotFound
            | ErrorKind::PermissionDenied
            | ErrorKind::AlreadyExists
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::InvalidData
            | ErrorKind::InvalidInput
            | ErrorKind::InvalidFilename
            | ErrorKind::UnexpectedEof => Self::BadInput,
            // The other end of a connection is no fault of this machine.
            ErrorKind::BrokenPipe
            | ErrorKind::Interrupted
            | ErrorKind::ConnectionRefused
            | ErrorKind::ConnectionReset
            | ErrorKind::ConnectionAborted
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::TimedOut => Self::Unexpected,
            _ => Self::Machine,
        }
    }

    /// The code for what ends a run.
    pub(super) fn of_packing(error: &PackError) -> Self {
        match error {
            PackError::Plan(_) => Self::BadInput,
            PackError::Stopped { .. } => Self::Interrupted,
            PackError::TargetNotReached(_) => Self::TargetNotReached,
            PackError::CheckFailed(_) => Self::CheckFailed,
            PackError::OutOfMemory { .. } => Self::Machine,
        }
    }

    /// The code for what ends an export.
    pub(super) fn of_export(error: &ExportError) -> Self {
        match error {
            ExportError::Invalid(_) | ExportError::Unavailable(_) | ExportError::TooLarge(_) => {
                Self::BadInput
            }
            ExportError::CheckFailed(_) => Self::CheckFailed,
            ExportError::Stopped => Self::Interrupted,
            ExportError::OutOfMemory { .. } | ExportError::Mesher(_) => Self::Machine,
            ExportError::Write(error) => Self::of_io(error),
        }
    }
}

/// A failure with its code.
#[derive(Debug)]
struct Ended {
    exit: Exit,
    text: String,
}

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for Ended {}

/// The failure of a file that cannot be `read`, `written`, `made` or `removed`.
pub(super) fn cannot_be(participle: &str, path: &Path, error: &io::Error) -> Failure {
    Exit::of_io(error).because(format_args!("{} cannot be {participle}: {error}", path.display()))
}

/// Whether a failure is that of a stream whose reader has left.
pub(super) fn is_closed_pipe(failure: &Failure) -> bool {
    failure.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// The code of a failure.
pub(super) fn code_of(failure: &Failure) -> u8 {
    let exit = match (failure.downcast_ref::<Ended>(), failure.downcast_ref::<io::Error>()) {
        (Some(ended), _) => ended.exit,
        (None, Some(error)) => Exit::of_io(error),
        (None, None) => Exit::Unexpected,
    };
    exit as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_the_machines_fault_and_a_missing_file_is_not() {
        for (kind, exit) in [
            (ErrorKind::StorageFull, Exit::Machine),
            (ErrorKind::QuotaExceeded, Exit::Machine),
            (ErrorKind::OutOfMemory, Exit::Machine),
            (ErrorKind::NotFound, Exit::BadInput),
            (ErrorKind::PermissionDenied, Exit::BadInput),
        ] {
            let failure = cannot_be("written", Path::new("out"), &io::Error::from(kind));
            assert_eq!(code_of(&failure), exit as u8, "{kind:?}");
            assert_eq!(code_of(&io::Error::from(kind).into()), exit as u8, "{kind:?}");
            assert!(failure.to_string().starts_with("out cannot be written: "), "{failure}");
        }
    }

    #[test]
    fn every_code_is_in_the_help() {
        for exit in [
            Exit::Unexpected,
            Exit::BadInput,
            Exit::TargetNotReached,
            Exit::CheckFailed,
            Exit::Machine,
            Exit::Unfinished,
            Exit::Refused,
            Exit::Program,
            Exit::Interrupted,
        ] {
            let code = exit as u8;
            assert!(HELP.lines().any(|line| line.trim_start().starts_with(&format!("{code} "))), "{code}");
        }
    }
}
