//! Models of a packing as files, for `packstone run` and `packstone derive`.
//!
//! Names of files, and what stands around the work at the terminal; what is made is the engine's matter.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use packstone_engine::export::{ExportError, ExportRequest, ExportType, Model};
use packstone_engine::{Control, FieldError, Limits, Progress};

use super::bar::Bar;
use super::{Failure, print};

/// Names of all models, for a list of what there is.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    ExportType::ALL.into_iter().map(ExportType::name)
}

/// Makes each of these in a folder that exists, and prints the name of its file; what there is to know about it stands
/// beside it.
pub(super) fn write_all(
    exports: &[ExportRequest],
    model: &Model<'_>,
    limits: &Limits,
    out: &Path,
    stop: &Arc<AtomicBool>,
) -> Result<(), Failure> {
    let mut names = Names::of("result");
    for export in exports {
        let file = out.join(names.of_model(export));
        let watch = Watch { bar: Bar::new(), what: export.export_type().name(), stop };
        let written = write(export, model, limits, &watch, &file);
        watch.bar.finish();
        written.map_err(|error| format!("{} was not made: {}", file.display(), explained(error)))?;
        print(&format!("{}\n", file.display()))?;
    }
    Ok(())
}

/// What stops a model from being made, as lines for a person.
pub(super) fn explained(error: ExportError) -> String {
    match error {
        ExportError::Invalid(faults) => listed(&faults),
        ExportError::TooLarge(fault) => listed(&[fault]),
        other => other.to_string(),
    }
}

/// Faults of options, one a line.
pub(super) fn listed(faults: &[FieldError]) -> String {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    lines.join("\n  ")
}

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

    /// The next free one for a model.
    pub(super) fn of_model(&mut self, export: &ExportRequest) -> String {
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

/// Makes a model as a file, with what there is to know about it in another beside it, and the script that opens it
/// where its program needs one. Of what fails, nothing is left.
pub(super) fn write(
    export: &ExportRequest,
    model: &Model<'_>,
    limits: &Limits,
    control: &dyn Control,
    file: &Path,
) -> Result<(), ExportError> {
    let written = try_write(export, model, limits, control, file);
    if written.is_err() {
        // A part of a file would be taken for the whole.
        let _ = fs::remove_file(file);
    }
    written
}

fn try_write(
    export: &ExportRequest,
    model: &Model<'_>,
    limits: &Limits,
    control: &dyn Control,
    file: &Path,
) -> Result<(), ExportError> {
    let mut out = BufWriter::with_capacity(1 << 18, File::create(file)?);
    let report = export.write(model, limits, control, &mut out)?;
    out.flush()?;
    let text = serde_json::to_string_pretty(&report).map_err(std::io::Error::from)? + "\n";
    fs::write(beside(file, "report.json"), text)?;
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    if let Some((ending, text)) = export.companion(&name) {
        fs::write(beside(file, ending), text)?;
    }
    Ok(())
}

/// The path with one more ending.
fn beside(file: &Path, ending: &str) -> PathBuf {
    let mut path = file.as_os_str().to_owned();
    path.push(".");
    path.push(ending);
    path.into()
}

struct Watch<'a> {
    bar: Bar,
    what: &'static str,
    stop: &'a Arc<AtomicBool>,
}

impl Control for Watch<'_> {
    fn report(&self, progress: &Progress) {
        self.bar.show(progress.fraction, || format!("{}: {}", self.what, progress.message));
    }

    fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }
}
