//! Programs of others, such as CalculiX and Gmsh: run in a process of their own with limits, watched, and stopped.
//!
//! The process leads a group, so that a stop reaches what it starts itself; an interrupt at the terminal reaches it
//! through this process alone. Its output goes to a file, from which progress and faults are read. Where this process
//! is killed, the group is killed too.

use std::env;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};

/// Time between two looks at the limits, the output and requests to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Most bytes of the output that are read at a look.
const MOST_READ_BYTES: u64 = 1 << 20;
/// A line is divided after this number of bytes.
const MOST_LINE_BYTES: usize = 1 << 14;
/// The shell, which runs [`GUARD`].
const SHELL: &str = "/bin/sh";
/// Reads the number of a process group, waits for the end of its input, and kills the group.
const GUARD: &str = "read -r group && { read -r _; kill -s KILL -- \"-$group\"; }";

/// What a program may use.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ProgramLimits {
    /// Longest time, where there is a limit.
    pub(crate) time: Option<Duration>,
    /// Most resident memory of all its processes in bytes, where there is a limit and the system tells it (Linux).
    pub(crate) memory_bytes: Option<u64>,
}

/// How a program ended.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ProgramEnd {
    /// By itself, or by a signal of the system.
    Ended(ExitStatus),
    /// It was stopped on request.
    Stopped,
    /// It was stopped at its limit of time.
    TimedOut,
    /// It was stopped at its limit of memory, with these bytes.
    OutOfMemory(u64),
}

/// The programs of that name in the folders of `PATH`.
pub(crate) fn on_path(name: &OsStr) -> Vec<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    let is_program = |file: &PathBuf| {
        file.metadata().is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o111 != 0)
    };
    let folders = env::split_paths(&path).filter(|folder| folder.is_absolute());
    folders.map(|folder| folder.join(name)).filter(is_program).collect()
}

/// Why a program with this status has failed, in words; `None` where it ended with 0.
pub(crate) fn cause_of(status: ExitStatus) -> Option<String> {
    match (status.code(), status.signal()) {
        (Some(0), _) => None,
        (Some(code), _) => Some(format!("exit code {code}")),
        (None, Some(9)) => {
            Some("it was killed (signal 9), as the system does where memory is short".to_owned())
        }
        (None, signal) => Some(format!("signal {}", signal.unwrap_or_default())),
    }
}

/// Runs a program to its end, and stops it where `should_stop` says so or a limit is met. Its output and errors go to
/// the file `log`. `look` is called ten times a second and after the end, with the lines that were added.
///
/// # Errors
/// It cannot be started, or its log cannot be written or read.
pub(crate) fn run(
    command: &mut Command,
    limits: ProgramLimits,
    log: &Path,
    should_stop: impl Fn() -> bool,
    mut look: impl FnMut(Vec<String>),
) -> io::Result<ProgramEnd> {
    let out = File::create(log)?;
    let errors = out.try_clone()?;
    let mut lines = NewLines { file: File::open(log)?, begun: Vec::new() };
    command.stdin(Stdio::null()).stdout(out).stderr(errors).process_group(0);
    let mut guard = Guard::start();
    let start = Instant::now();
    let mut child = command.spawn()?;
    let pid = Pid::from_child(&child);
    guard.watch(pid);
    let (send, ended) = channel();
    let waiting = thread::spawn(move || {
        // The other end is gone only where this process ends.
        let _ = send.send(child.wait());
    });
    let mut cause = None;
    let status = loop {
        let status = match ended.recv_timeout(LOOK_EVERY) {
            Ok(status) => Some(status),
            Err(RecvTimeoutError::Disconnected) => Some(Err(io::Error::other("the program was lost"))),
            Err(RecvTimeoutError::Timeout) => None,
        };
        look(lines.read(status.is_some())?);
        if let Some(status) = status {
            break status;
        }
        if cause.is_none() {
            cause = if should_stop() {
                Some(ProgramEnd::Stopped)
            } else if limits.time.is_some_and(|most| start.elapsed() >= most) {
                Some(ProgramEnd::TimedOut)
            } else {
                limits.memory_bytes.and_then(|most| {
                    resident_bytes(pid).filter(|held| *held > most).map(ProgramEnd::OutOfMemory)
                })
            };
            if cause.is_some() {
                // It keeps nothing that a gentler signal would save.
                let _ = kill_process_group(pid, Signal::KILL);
            }
        }
    };
    let _ = waiting.join();
    let status = status?;
    Ok(cause.unwrap_or(ProgramEnd::Ended(status)))
}

/// Kills the group of a program where this process ends first without a word, as by SIGKILL: a shell in a group of its
/// own, whose input this process alone holds open. That reaches all of the group, on every Unix, where the signal that
/// Linux sends at the death of a parent reaches one process, and has to be asked for between `fork` and `exec`. Without
/// a shell, programs have no guard.
struct Guard(Option<Child>);

impl Guard {
    fn start() -> Self {
        let mut command = Command::new(SHELL);
        command.args(["-c", GUARD]).current_dir("/").process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let started = command.spawn();
        if let Err(error) = &started {
            tracing::warn!(%error, "no shell: a program outlives this process where that is killed");
        }
        Self(started.ok())
    }

    fn watch(&mut self, group: Pid) {
        if let Some(input) = self.0.as_mut().and_then(|shell| shell.stdin.as_mut()) {
            // It fails where something has killed the shell.
            let _ = writeln!(input, "{}", group.as_raw_nonzero());
        }
    }
}

impl Drop for Guard {
    /// Ends the shell before its input ends, so that it kills nothing.
    fn drop(&mut self) {
        if let Some(shell) = &mut self.0 {
            let _ = shell.kill();
            let _ = shell.wait();
        }
    }
}

/// The lines that are added to a file.
struct NewLines {
    file: File,
    /// The line that is not complete.
    begun: Vec<u8>,
}

impl NewLines {
    /// The lines since the last time; at the end also the last one, complete or not.
    fn read(&mut self, is_end: bool) -> io::Result<Vec<String>> {
        let mut bytes = std::mem::take(&mut self.begun);
        let most = if is_end { u64::MAX } else { MOST_READ_BYTES };
        (&mut self.file).take(most).read_to_end(&mut bytes)?;
        let mut lines = Vec::new();
        let mut rest = bytes.as_slice();
        loop {
            let end = rest.iter().position(|byte| *byte == b'\n');
            let (line, after) = match end {
                Some(end) => (&rest[..end], &rest[end + 1..]),
                None if rest.len() > MOST_LINE_BYTES || (is_end && !rest.is_empty()) => {
                    (rest, &rest[rest.len()..])
                }
                None => break,
            };
            lines.push(String::from_utf8_lossy(line).trim_end().to_owned());
            rest = after;
        }
        self.begun = rest.to_vec();
        Ok(lines)
    }
}

/// Resident memory of a process group, where the system has the files of Linux.
fn resident_bytes(group: Pid) -> Option<u64> {
    let group = group.as_raw_nonzero().get();
    let pages = fs::read_dir("/proc").ok()?.flatten().filter_map(|entry| {
        let folder = entry.path();
        entry.file_name().to_str()?.parse::<u32>().ok()?;
        let stat = fs::read_to_string(folder.join("stat")).ok()?;
        // The name of the program, in parentheses, may have any characters.
        let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
        (fields.nth(2)?.parse::<i32>().ok()? == group).then_some(())?;
        fs::read_to_string(folder.join("statm")).ok()?.split_whitespace().nth(1)?.parse::<u64>().ok()
    });
    Some(pages.sum::<u64>() * rustix::param::page_size() as u64)
}
