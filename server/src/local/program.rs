//! Programs of others, such as CalculiX: found, run in a process of their own with limits, watched, and stopped.
//!
//! The process leads a group, so that a stop reaches what it starts itself; an interrupt at the terminal reaches it
//! through this process alone. Its output goes to a file, from which progress and faults are read.

use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process_group, prlimit};

/// Time between two looks at the limits, the output and requests to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// What a program may use.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ProgramLimits {
    /// Longest time, where there is a limit.
    pub(crate) time: Option<Duration>,
    /// Most memory (address space) in bytes, where there is a limit.
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
}

/// Finds a program: the file that is named, else the first of that name in the folders of `PATH`.
pub(crate) fn find(name: &str, named: Option<&Path>) -> Option<PathBuf> {
    // A name without a folder is looked for, as shells do.
    let name = match named {
        Some(file) if file.components().count() > 1 => return file.is_file().then(|| file.to_owned()),
        Some(file) => file.as_os_str(),
        None => OsStr::new(name),
    };
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}

/// Runs a program to its end, and stops it where `should_stop` says so or a limit is met. Its output and errors go to
/// the file `log`. `look` is called ten times a second.
///
/// # Errors
/// It cannot be started, or its log cannot be written.
pub(crate) fn run(
    command: &mut Command,
    limits: ProgramLimits,
    log: &Path,
    should_stop: impl Fn() -> bool,
    mut look: impl FnMut(),
) -> io::Result<ProgramEnd> {
    let out = File::create(log)?;
    let errors = out.try_clone()?;
    command.stdin(Stdio::null()).stdout(out).stderr(errors).process_group(0);
    let start = Instant::now();
    let mut child = command.spawn()?;
    let pid = Pid::from_child(&child);
    if let Some(bytes) = limits.memory_bytes {
        let limit = Rlimit { current: Some(bytes), maximum: Some(bytes) };
        // It may have ended already.
        let _ = prlimit(Some(pid), Resource::As, limit);
    }
    let (send, ended) = channel();
    let waiting = thread::spawn(move || {
        // The other end is gone only where this process ends.
        let _ = send.send(child.wait());
    });
    let mut cause = None;
    let status = loop {
        match ended.recv_timeout(LOOK_EVERY) {
            Ok(status) => break status,
            Err(RecvTimeoutError::Disconnected) => break Err(io::Error::other("the program was lost")),
            Err(RecvTimeoutError::Timeout) => {}
        }
        look();
        if cause.is_none() {
            cause = if should_stop() {
                Some(ProgramEnd::Stopped)
            } else if limits.time.is_some_and(|most| start.elapsed() >= most) {
                Some(ProgramEnd::TimedOut)
            } else {
                None
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
