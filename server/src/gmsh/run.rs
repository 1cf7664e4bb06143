//! A run of Gmsh in a process group of its own: progress by its lines, limits of time and memory, and the cause where
//! it fails.

use std::fs;
use std::io::{BufRead as _, BufReader, Read};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

use packstone_engine::export::ExportError;
use packstone_engine::{Control, Phase, Progress};
use rustix::process::{Pid, Signal, kill_process_group};

use super::find::Program;
use super::folder::Folder;

/// Time between two looks at the process.
const LOOK: Duration = Duration::from_millis(40);
/// Time for the last lines of a process that has ended.
const LAST_LINES: Duration = Duration::from_millis(500);
/// Longest line that is read, in bytes.
const MOST_LINE_BYTES: u64 = 1 << 14;
/// Lines that are kept.
const MOST_LINES: usize = 1000;
/// Characters of Gmsh's words in a message.
const MOST_WORDS: usize = 300;
/// What programs say that get no memory.
const OUT_OF_MEMORY: [&str; 5] =
    ["bad_alloc", "ut of memory", "annot allocate memory", "emory exhausted", "MemoryError"];
/// Steps of a run by the words of its lines, with the share of the run that is over when a step begins.
const STEPS: [(&str, &str, f64); 6] = [
    ("Reading '", "reading the surfaces", 0.0),
    ("Meshing 1D", "preparing the surfaces", 0.05),
    ("Meshing 3D", "filling volumes", 0.1),
    ("Optimizing", "improving tetrahedra", 0.7),
    ("Meshing order 2", "placing mid nodes", 0.8),
    ("Writing '", "writing tetrahedra", 0.9),
];

/// What a run may take.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) time: Duration,
    /// Resident memory of all its processes, where the system tells it.
    pub(super) memory_bytes: u64,
}

/// Runs a program in a folder; its lines.
///
/// # Errors
/// [`ExportError::Mesher`] with the cause, [`ExportError::Stopped`].
pub(super) fn run(
    program: &Program,
    arguments: &[&str],
    folder: &Folder,
    limits: &Limits,
    control: &dyn Control,
) -> Result<Vec<String>, ExportError> {
    let mut command = program.command();
    command
        .args(arguments)
        .current_dir(folder.path())
        // The settings of whoever runs it do not count.
        .env("GMSH_HOME", folder.path())
        .env("TMPDIR", folder.path())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0);
    let child = command.spawn().map_err(|error| {
        ExportError::Mesher(format!("Gmsh cannot be started: {}: {error}", command.get_program().display()))
    })?;
    let mut process = Process::new(child, *limits);
    let status = process.attend(control)?;
    process.judged(status)
}

/// A process, which ends with this.
struct Process {
    child: Child,
    limits: Limits,
    began: Instant,
    lines: Receiver<String>,
    /// The lines that were read, without those in the middle of many.
    kept: Vec<String>,
    step: (&'static str, f64),
}

impl Process {
    fn new(mut child: Child, limits: Limits) -> Self {
        let (sender, lines) = mpsc::channel();
        if let Some(output) = child.stdout.take() {
            read_lines(output, sender.clone());
        }
        if let Some(output) = child.stderr.take() {
            read_lines(output, sender);
        }
        let step = ("starting Gmsh", 0.0);
        Self { child, limits, began: Instant::now(), lines, kept: Vec::new(), step }
    }

    /// Waits for the end.
    fn attend(&mut self, control: &dyn Control) -> Result<ExitStatus, ExportError> {
        let mut reported = None;
        loop {
            match self.lines.recv_timeout(LOOK) {
                Ok(line) => self.take(line),
                Err(RecvTimeoutError::Timeout) => {}
                // It has closed its output and may live on.
                Err(RecvTimeoutError::Disconnected) => thread::sleep(LOOK),
            }
            if let Some(status) = self.child.try_wait()? {
                let until = Instant::now() + LAST_LINES;
                while let Ok(line) = self.lines.recv_timeout(until.saturating_duration_since(Instant::now()))
                {
                    self.take(line);
                }
                return Ok(status);
            }
            if control.should_stop() {
                return Err(ExportError::Stopped);
            }
            let seconds = self.began.elapsed().as_secs();
            if self.began.elapsed() > self.limits.time {
                return Err(ExportError::Mesher(format!(
                    "Gmsh did not end within {} s (--gmsh-timeout-s) and was stopped while {}; fewer segments, or a larger \
                     tet_size_mm, take less time",
                    self.limits.time.as_secs_f64(),
                    self.step.0
                )));
            }
            if let Some(bytes) = self.memory_bytes().filter(|bytes| *bytes > self.limits.memory_bytes) {
                return Err(self.out_of_memory(&format!("it held {} MB", bytes / 1_000_000)));
            }
            if reported != Some((seconds, self.step.0)) {
                reported = Some((seconds, self.step.0));
                control.report(&Progress {
                    phase: Phase::Export,
                    fraction: self.step.1,
                    done: seconds,
                    total: 0,
                    unit: "s",
                    message: format!("Gmsh: {} ({seconds} s)", self.step.0),
                    growth: None,
                });
            }
        }
    }

    fn take(&mut self, line: String) {
        if let Some((_, what, share)) = STEPS.iter().find(|(words, _, _)| line.contains(words))
            && *share >= self.step.1
        {
            self.step = (what, *share);
        }
        if self.kept.len() >= MOST_LINES {
            self.kept.remove(MOST_LINES / 2);
        }
        self.kept.push(line);
    }

    /// What the end means.
    fn judged(&mut self, status: ExitStatus) -> Result<Vec<String>, ExportError> {
        let is_error = |line: &&String| line.trim_start().starts_with("Error");
        let errors: Vec<&str> = self.kept.iter().filter(is_error).map(|line| words(line)).collect();
        if let Some(line) =
            self.kept.iter().find(|line| OUT_OF_MEMORY.iter().any(|words| line.contains(words)))
        {
            return Err(self.out_of_memory(&format!("it says {:?}", shortened(words(line)))));
        }
        if status.success() && errors.is_empty() {
            return Ok(std::mem::take(&mut self.kept));
        }
        let says = match (errors.is_empty(), self.kept.last()) {
            (false, _) => errors.join("; "),
            (true, Some(last)) => words(last).to_owned(),
            (true, None) => "it says nothing".into(),
        };
        let ended = match (status.code(), status.signal()) {
            (Some(0), _) => "failed".to_owned(),
            (Some(code), _) => format!("failed with exit code {code}"),
            (None, Some(9)) => "was killed (signal 9), as the system does where memory runs out".to_owned(),
            (None, signal) => format!("was ended by signal {}", signal.unwrap_or_default()),
        };
        Err(ExportError::Mesher(format!("Gmsh {ended} while {}: {}", self.step.0, shortened(&says))))
    }

    fn out_of_memory(&self, because: &str) -> ExportError {
        ExportError::Mesher(format!(
            "Gmsh ran out of memory while {}: {because}, and may have {} MB (--gmsh-memory-mib); fewer segments, or a larger \
             tet_size_mm, take less",
            self.step.0,
            self.limits.memory_bytes / 1_000_000
        ))
    }

    /// Resident memory of the process group, where the system has the files of Linux.
    fn memory_bytes(&self) -> Option<u64> {
        let group = self.child.id();
        let pages = fs::read_dir("/proc").ok()?.flatten().filter_map(|entry| {
            let folder = entry.path();
            entry.file_name().to_str()?.parse::<u32>().ok()?;
            let stat = fs::read_to_string(folder.join("stat")).ok()?;
            // The name of the program, in parentheses, may have any characters.
            let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
            (fields.nth(2)?.parse::<u32>().ok()? == group).then_some(())?;
            fs::read_to_string(folder.join("statm")).ok()?.split_whitespace().nth(1)?.parse::<u64>().ok()
        });
        Some(pages.sum::<u64>() * rustix::param::page_size() as u64)
    }
}

impl Drop for Process {
    /// Ends the process and all that it has started.
    fn drop(&mut self) {
        let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
        let _ = self.child.wait();
    }
}

/// Sends the lines of an output from a thread of its own.
fn read_lines(output: impl Read + Send + 'static, lines: Sender<String>) {
    thread::spawn(move || {
        let mut output = BufReader::new(output);
        loop {
            let mut bytes = Vec::new();
            let read = (&mut output).take(MOST_LINE_BYTES).read_until(b'\n', &mut bytes);
            if !matches!(read, Ok(count) if count > 0) {
                return;
            }
            let line = String::from_utf8_lossy(&bytes).trim_end().to_owned();
            if !line.is_empty() && lines.send(line).is_err() {
                return;
            }
        }
    });
}

/// A line without the words at its beginning that say what kind it is.
fn words(line: &str) -> &str {
    match line.split_once(':') {
        Some((kind, rest)) if ["Error", "Warning", "Info"].contains(&kind.trim()) => rest.trim(),
        _ => line.trim(),
    }
}

fn shortened(text: &str) -> String {
    if text.chars().count() <= MOST_WORDS {
        return text.to_owned();
    }
    text.chars().take(MOST_WORDS).chain(['\u{2026}']).collect()
}
