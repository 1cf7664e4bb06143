//! A run of Gmsh: progress by its lines, and the cause where it fails.

use std::process::ExitStatus;
use std::time::Instant;

use packstone_engine::export::ExportError;
use packstone_engine::{Control, Progress, Step};

use super::find::Program;
use super::folder::Folder;
use crate::programs::{self, ProgramEnd, ProgramLimits};

/// The file in the folder of a run that has what Gmsh prints.
const LOG: &str = "gmsh.log";
/// Lines that are kept.
const MOST_LINES: usize = 1000;
/// Characters of Gmsh's words in a message.
const MOST_WORDS: usize = 300;
/// What programs say that get no memory.
const OUT_OF_MEMORY: [&str; 5] =
    ["bad_alloc", "ut of memory", "annot allocate memory", "emory exhausted", "MemoryError"];
/// Steps of a run by the words of its lines, with the share of the run that is over when a step begins: about those of
/// a million tetrahedra in ellipsoids and the space between them. The algorithm HXT says "Recover" and "GSC", others
/// say "Optimizing".
const STEPS: [(&str, &str, f64); 10] = [
    ("Reading '", "reading the surfaces", 0.0),
    ("Meshing 1D", "preparing the surfaces", 0.01),
    ("Meshing 2D", "meshing surfaces", 0.02),
    ("Meshing 3D", "filling volumes", 0.02),
    ("Recovering", "filling volumes", 0.05),
    ("Recover Delaunay", "filling volumes", 0.13),
    (PASS, "improving elements", FIRST_PASS),
    ("Optimizing", "improving elements", 0.7),
    ("Meshing order 2", "placing mid nodes", 0.93),
    ("Writing '", "writing elements", 0.95),
];
/// A pass over all bad elements, of which there are a few. The first ones take longest: each is taken to need half of
/// the time that is left to all.
const PASS: &str = "(GSC)";
const FIRST_PASS: f64 = 0.27;
const LAST_PASS: f64 = 0.93;

/// Runs Gmsh in a folder; its lines.
///
/// # Errors
/// [`ExportError::Mesher`] with the cause, [`ExportError::Stopped`].
pub(super) fn run(
    program: &Program,
    arguments: &[&str],
    folder: &Folder,
    limits: ProgramLimits,
    control: &dyn Control,
) -> Result<Vec<String>, ExportError> {
    let mut command = program.command();
    command
        .args(arguments)
        .current_dir(folder.path())
        // The settings of whoever runs it do not count.
        .env("GMSH_HOME", folder.path())
        .env("TMPDIR", folder.path());
    let mut output = Output { lines: Vec::new(), step: ("starting Gmsh", 0.0), limits };
    let (began, mut reported) = (Instant::now(), None);
    let look = |lines: Vec<String>| {
        for line in lines {
            output.take(line);
        }
        let now = (began.elapsed().as_secs(), output.step);
        if reported != Some(now) {
            reported = Some(now);
            let (seconds, (step, fraction)) = now;
            control.report(&Progress {
                step: Step::Export,
                fraction,
                done: seconds,
                total: 0,
                unit: "s",
                message: format!("Gmsh: {step} ({seconds} s)"),
                growth: None,
            });
        }
    };
    let log = folder.path().join(LOG);
    let end = programs::run(&mut command, limits, &log, || control.should_stop(), look).map_err(|error| {
        let file = command.get_program().display();
        ExportError::Mesher(format!("Gmsh cannot be started: {file}: {error}"))
    })?;
    match end {
        ProgramEnd::Ended(status) => output.checked(status),
        ProgramEnd::Stopped => Err(ExportError::Stopped),
        ProgramEnd::TimedOut => Err(ExportError::Mesher(format!(
            "Gmsh did not end within {} s (--gmsh-timeout-s) and was stopped while {}; fewer segments, or a larger \
             tet_size_mm, take less time",
            limits.time.unwrap_or_default().as_secs_f64(),
            output.step.0
        ))),
        ProgramEnd::OutOfMemory(bytes) => {
            Err(output.out_of_memory(&format!("it held {} MB", bytes / 1_000_000)))
        }
    }
}

/// What Gmsh has printed.
struct Output {
    /// Its lines, without those in the middle of many.
    lines: Vec<String>,
    /// What it does, and the share of the run that was over when that began.
    step: (&'static str, f64),
    limits: ProgramLimits,
}

impl Output {
    fn take(&mut self, line: String) {
        if line.is_empty() {
            return;
        }
        if let Some((words, what, share)) = STEPS.iter().find(|(words, _, _)| line.contains(words)) {
            let is_later_pass = *words == PASS && self.step.1 >= FIRST_PASS;
            let share = if is_later_pass { 0.5 * (self.step.1 + LAST_PASS) } else { *share };
            if share >= self.step.1 {
                self.step = (what, share);
            }
        }
        if self.lines.len() >= MOST_LINES {
            self.lines.remove(MOST_LINES / 2);
        }
        self.lines.push(line);
    }

    /// The lines of a run that succeeded.
    fn checked(self, status: ExitStatus) -> Result<Vec<String>, ExportError> {
        let says_so = |line: &&String| OUT_OF_MEMORY.iter().any(|words| line.contains(words));
        if let Some(line) = self.lines.iter().find(says_so) {
            return Err(self.out_of_memory(&format!("it says {:?}", shortened(words(line)))));
        }
        let is_error = |line: &&String| line.trim_start().starts_with("Error");
        let errors: Vec<&str> = self.lines.iter().filter(is_error).map(|line| words(line)).collect();
        let cause = programs::cause_of(status);
        if cause.is_none() && errors.is_empty() {
            return Ok(self.lines);
        }
        let says = match (errors.is_empty(), self.lines.last()) {
            (false, _) => errors.join("; "),
            (true, Some(last)) => words(last).to_owned(),
            (true, None) => "it says nothing".into(),
        };
        let cause = cause.map_or_else(String::new, |cause| format!(" ({cause})"));
        Err(ExportError::Mesher(format!("Gmsh failed{cause} while {}: {}", self.step.0, shortened(&says))))
    }

    fn out_of_memory(&self, because: &str) -> ExportError {
        ExportError::Mesher(format!(
            "Gmsh ran out of memory while {}: {because}, and may have {} MB (--gmsh-memory-mib); fewer segments, or \
             a larger tet_size_mm, take less",
            self.step.0,
            self.limits.memory_bytes.unwrap_or_default() / 1_000_000
        ))
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of a run of Gmsh 4.8 by the algorithm HXT.
    #[test]
    fn the_share_of_a_run_rises_with_its_lines() {
        let mut output =
            Output { lines: Vec::new(), step: ("starting Gmsh", 0.0), limits: ProgramLimits::default() };
        let mut shares = Vec::new();
        for line in [
            "Info    : Reading 'surfaces.msh'...",
            "Info    : Meshing 3D...",
            "Info    : Recovering 28070 missing facet(s)",
            "Info    : Recover Delaunay",
            "Info    : Improving      12968 tet. on   1 thrd (GSC)",
            "Info    : Improving      10555 tet. on   1 thrd (GSC)",
            "Info    : Improving      10316 tet. on   1 thrd (GSC)",
            "Info    : Writing 'mesh.msh'...",
        ] {
            output.take(line.to_owned());
            shares.push(output.step.1);
        }
        assert!(shares.is_sorted_by(|a, b| a < b), "{shares:?}");
        output.take("Info    : Improving      10316 tet. on   1 thrd (GSC)".to_owned());
        assert_eq!(output.step, ("writing elements", 0.95));
    }
}
