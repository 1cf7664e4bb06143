//! Exports and pictures of a packing as files, for `packstone run`, `packstone export` and `packstone study`.

use std::fs::File;
use std::io::{BufReader, Write as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use packstone_engine::export::picture::{self, PictureOptions};
use packstone_engine::export::{
    ExportError, ExportEstimate, ExportReport, ExportRequest, ExportType, Model, SurfaceCache,
};
use packstone_engine::request::decode::{At, Faults};
use packstone_engine::request::{Materials, materials};
use packstone_engine::{Checkpoint, Control, FieldError, Limits, PackingRequest, Plan, Progress, Resume};

use super::bar::Bar;
use super::exit::{Exit, Failure, cannot_be};
use super::input::Input;
use super::outputs::{Names, beside};
use crate::atomic_file::write_buffered;
use crate::checkpoints;
use crate::gmsh;
use crate::telemetry::say;

/// The size of a file of this length is announced before the file is made.
const LARGE_BYTES: u64 = 50_000_000;
/// The memory and time of a computation that takes as many seconds are announced before it begins.
const LONG_S: f64 = 10.0;
/// Ending of the name of the checkpoint of an export, beside its file.
const CHECKPOINT: &str = "checkpoint";
/// Name of the picture of a packing.
pub(super) const PICTURE: &str = "result.png";

/// Reads `TYPE[:OPTION=VALUE,...]`, as `mesh` or `voxels:format=raw,cells=200`.
///
/// A comma that no option follows belongs to the value before it. The value of `materials` is JSON, or the name of a
/// file of it.
pub(super) fn parse(text: &str) -> Result<ExportRequest, String> {
    let (name, options) = text.split_once(':').unwrap_or((text, ""));
    let export = ExportType::from_name(name).ok_or_else(|| {
        let names = ExportType::ALL.map(ExportType::name).join(", ");
        format!("{name:?} is not a type of export: must be one of {names}")
    })?;
    let mut pairs: Vec<(String, String)> = Vec::new();
    for piece in options.split(',').filter(|piece| !piece.is_empty()) {
        // Within JSON an equals sign belongs to a name of the user's.
        let option = piece.split_once('=').filter(|(name, _)| !name.contains(['"', '{', '[', ':']));
        match (option, pairs.last_mut()) {
            (Some((name, value)), _) => pairs.push((name.trim().to_owned(), value.to_owned())),
            (None, Some((_, value))) => {
                value.push(',');
                value.push_str(piece);
            }
            (None, None) => return Err(format!("{piece:?} must be OPTION=VALUE")),
        }
    }
    for (name, value) in &mut pairs {
        if name == materials::OPTION && !value.trim_start().starts_with('{') {
            let json = Input::default().json(Path::new(value)).map_err(|error| error.to_string())?;
            *value = json.to_string();
        }
    }
    let pairs = pairs.iter().map(|(name, value)| (name.as_str(), value.as_str()));
    ExportRequest::from_text(export, pairs).map_err(|faults| listed(&faults))
}

/// Materials for exports, in a file.
#[derive(Args)]
pub(super) struct MaterialsFile {
    /// Materials of the phases as JSON, for the exports that compute with materials and whose options name none; they
    /// win over those of the job
    #[arg(long, value_name = "FILE.json")]
    materials: Option<PathBuf>,
}

impl MaterialsFile {
    /// Those of a file.
    #[cfg(test)]
    pub(super) fn of(file: PathBuf) -> Self {
        Self { materials: Some(file) }
    }

    /// The exports with these materials, where they lack their own.
    pub(super) fn given_to<'a>(
        &self,
        exports: impl IntoIterator<Item = &'a ExportRequest>,
        input: &Input,
    ) -> Result<Vec<ExportRequest>, Failure> {
        let exports = exports.into_iter().cloned();
        Ok(match self.read(input)? {
            Some(materials) => exports.map(|export| export.with_materials(&materials)).collect(),
            None => exports.collect(),
        })
    }

    /// The materials, where a file is named.
    pub(super) fn read(&self, input: &Input) -> Result<Option<Materials>, Failure> {
        let Some(file) = &self.materials else { return Ok(None) };
        let document = input.json(file)?;
        let faults = Faults::default();
        let read = Materials::read(&At::root(&document, &faults)).filter(|_| faults.count() == 0);
        let materials = read.ok_or_else(|| {
            let faults = listed(&faults.into_vec());
            Exit::BadInput.because(format_args!("{} is refused:\n  {faults}", file.display()))
        })?;
        Ok(Some(materials))
    }
}

/// An export with the file that it is written to.
pub(super) struct Output {
    pub(super) export: ExportRequest,
    pub(super) file: PathBuf,
}

impl Output {
    /// Exports without repetition, each with its file in a folder.
    pub(super) fn all(exports: impl IntoIterator<Item = ExportRequest>, folder: &Path) -> Vec<Self> {
        let mut names = Names::of("result");
        let mut outputs: Vec<Self> = Vec::new();
        for export in exports {
            if !outputs.iter().any(|output| output.export == export) {
                let file = folder.join(names.of_export(&export));
                outputs.push(Self { export, file });
            }
        }
        outputs
    }

    /// All files that are written for it.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        let name = self.file.file_name().unwrap_or_default().to_string_lossy();
        let companion = self.export.companion(&name).map(|(ending, _)| beside(&self.file, ending));
        [self.file.clone(), beside(&self.file, "report.json")].into_iter().chain(companion)
    }

    /// Checks what can be checked before there are grains.
    pub(super) fn check(&self, request: &PackingRequest, limits: &Limits) -> Result<(), Failure> {
        check(&self.export, request, limits)?;
        gmsh::check(&self.export).map_err(|error| {
            Exit::of_export(&error).because(format_args!("{} is refused:\n  {error}", self.file.display()))
        })
    }
}

/// Checks what can be checked of an export before there are grains.
pub(super) fn check(
    export: &ExportRequest,
    request: &PackingRequest,
    limits: &Limits,
) -> Result<(), Failure> {
    let name = export.export_type().name();
    export.check(&request.specimen, limits).and_then(|()| export.check_materials(request)).map_err(|error| {
        Exit::of_export(&error).because(format_args!("{name} is refused:\n  {}", explained(error)))
    })
}

/// Makes each of these in a folder that exists.
pub(super) fn write_all<'a>(
    outputs: impl IntoIterator<Item = &'a Output>,
    model: &Model<'_>,
    limits: &Limits,
    checkpoint_every: Duration,
    stop: &Arc<AtomicBool>,
) -> Result<(), Failure> {
    for output in outputs {
        let surfaces = SurfaceCache::default();
        let model = &model.with_surfaces(&surfaces);
        // An export that cannot be estimated cannot be made either; `write` gives the reason.
        if let Ok(estimate) = output.export.estimate(model) {
            announce(&output.file.display().to_string(), &estimate);
        }
        let watch = Watch { bar: Bar::new(), what: output.export.export_type().name(), stop };
        let control = Keeping::new(&watch, beside(&output.file, CHECKPOINT), checkpoint_every);
        let resume = output.export.checkpoint_identity(model).and_then(|identity| control.earlier(&identity));
        let written = write(&output.export, model, limits, resume, &control, &output.file)
            .and_then(|_| checkpoints::remove(&control.file).map_err(ExportError::from));
        watch.bar.finish();
        written.map_err(|error| {
            let exit = Exit::of_export(&error);
            exit.because(format_args!("{} was not made: {}", output.file.display(), explained(error)))
        })?;
    }
    Ok(())
}

/// Prints the sizes of large files from the plan of their packing, before the packing is computed.
pub(super) fn announce_planned(outputs: &[Output], request: &PackingRequest, plan: &Plan) {
    for output in outputs {
        if let Ok(estimate) = output.export.estimate_from_plan(request, plan) {
            announce(&output.file.display().to_string(), &estimate);
        }
    }
}

/// Prints the size of a large file before it is made, and warnings.
pub(super) fn announce(name: &str, estimate: &ExportEstimate) {
    for warning in &estimate.warnings {
        say(&format!("warning: {name}: {warning}"));
    }
    if let Some(computation) = estimate.computation.filter(|computation| computation.cpu_s >= LONG_S) {
        let (megabytes, seconds) = (computation.memory_bytes / 1_000_000, computation.cpu_s.round());
        say(&format!("{name}: about {megabytes} MB of memory and {seconds} s of CPU time"));
    }
    if estimate.bytes >= LARGE_BYTES {
        let size = estimate.mesh.map_or_else(String::new, |mesh| match (mesh.tetrahedra, mesh.nodes) {
            (Some(tetrahedra), Some(nodes)) => format!(", {tetrahedra} tetrahedra, {nodes} nodes"),
            _ => format!(", {} triangles", mesh.triangles),
        });
        say(&format!("{name}: about {} MB{size}", estimate.bytes / 1_000_000));
    }
}

/// Renders the picture of a packing.
pub(super) fn write_picture(
    model: &Model<'_>,
    file: &Path,
    threads: NonZeroUsize,
    stop: &Arc<AtomicBool>,
) -> Result<(), Failure> {
    let watch = Watch { bar: Bar::new(), what: "picture", stop };
    let options = PictureOptions { threads: threads.get(), ..PictureOptions::default() };
    let written = write_buffered(file, |out| picture::write(model, &options, &watch, out));
    watch.bar.finish();
    written.map_err(|error| match error {
        ExportError::Write(error) => cannot_be("written", file, &error),
        other => Exit::of_export(&other).because(format_args!("{} was not made: {other}", file.display())),
    })
}

/// What stops an export from being made, as lines for a person.
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

/// Makes an export as a file, with its report in another beside it, and the script that opens it where its program
/// needs one. Returns the report.
pub(super) fn write(
    export: &ExportRequest,
    model: &Model<'_>,
    limits: &Limits,
    resume: Option<Resume>,
    control: &dyn Control,
    file: &Path,
) -> Result<ExportReport, ExportError> {
    let report = write_buffered(file, |out| export.write_or_resume(model, limits, resume, control, out))?;
    let text = serde_json::to_string_pretty(&report).map_err(std::io::Error::from)? + "\n";
    for warning in report.warnings() {
        say(&format!("warning: {}: {warning}", file.display()));
    }
    write_buffered(&beside(file, "report.json"), |out| out.write_all(text.as_bytes()))?;
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    if let Some((ending, text)) = export.companion(&name) {
        write_buffered(&beside(file, ending), |out| out.write_all(text.as_bytes()))?;
    }
    Ok(report)
}

/// Keeps checkpoints of an export in a file beside it, from which the same command goes on after it was killed.
struct Keeping<'a> {
    watch: &'a Watch<'a>,
    file: PathBuf,
    schedule: checkpoints::Schedule,
}

impl<'a> Keeping<'a> {
    fn new(watch: &'a Watch<'a>, file: PathBuf, every: Duration) -> Self {
        Self { watch, file, schedule: checkpoints::Schedule::new(every) }
    }

    /// The state that an earlier command has left of an export with this identity. One of another export, or that
    /// cannot be read, is replaced.
    fn earlier(&self, identity: &[u8]) -> Option<Resume> {
        let mut file = BufReader::new(File::open(&self.file).ok()?);
        let read = Resume::of_export(&mut file, identity);
        match &read {
            Ok(_) => say(&format!("{}: going on from it", self.file.display())),
            Err(error) => say(&format!("warning: {} is not used: {error}", self.file.display())),
        }
        read.ok()
    }
}

impl Control for Keeping<'_> {
    fn report(&self, progress: &Progress) {
        self.watch.report(progress);
    }

    fn should_stop(&self) -> bool {
        self.watch.should_stop()
    }

    fn wants_checkpoint(&self) -> bool {
        self.schedule.is_due()
    }

    fn keep_checkpoint(&self, checkpoint: &Checkpoint<'_>) {
        let start = Instant::now();
        if let Err(error) = checkpoints::write(&self.file, checkpoint) {
            say(&format!("warning: {} cannot be written: {error}", self.file.display()));
        }
        self.schedule.tried(start.elapsed());
    }
}

/// Shows how far a file is made, and passes requests to stop on.
pub(super) struct Watch<'a> {
    pub(super) bar: Bar,
    pub(super) what: &'static str,
    pub(super) stop: &'a Arc<AtomicBool>,
}

impl Control for Watch<'_> {
    fn report(&self, progress: &Progress) {
        self.bar.show(progress.fraction, || format!("{}: {}", self.what, words(progress)));
    }

    fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }
}

/// How far the work is, in words.
fn words(progress: &Progress) -> String {
    if progress.message.is_empty() {
        format!("{} of {} {}", progress.done, progress.total, progress.unit)
    } else {
        progress.message.clone()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_export_is_a_type_with_options() {
        let with = |options: &[(&str, &str)]| {
            ExportRequest::from_text(ExportType::Voxels, options.iter().copied()).unwrap()
        };
        assert_eq!(parse("voxels"), Ok(with(&[])));
        assert_eq!(parse("voxels:"), Ok(with(&[])));
        assert_eq!(parse("voxels:format=raw,cells=12"), Ok(with(&[("format", "raw"), ("cells", "12")])));
        // What looks like an option within JSON is none.
        let materials =
            r#"{"matrix":{"youngs_modulus_gpa":25,"poissons_ratio":0.2},"a=b":{"youngs_modulus_gpa":0}}"#;
        let read = ExportRequest::from_text(
            ExportType::Voxels,
            [("for", "fans"), ("materials", materials), ("cells", "9")],
        );
        assert_eq!(parse(&format!("voxels:for=fans,materials={materials},cells=9")), Ok(read.unwrap()));
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("materials.json");
        std::fs::write(&file, materials).unwrap();
        let of_file = parse(&format!("voxels:for=fans,materials={},cells=9", file.display()));
        assert_eq!(of_file, parse(&format!("voxels:for=fans,cells=9,materials={materials}")));
        let missing = parse("voxels:for=fans,materials=no-such-file.json").unwrap_err();
        assert!(missing.contains("no-such-file.json"), "{missing}");
        for (text, says) in [
            (
                "cube",
                "must be one of mesh, voxels, slice, deck, ldpm, certificates, shapes, quality, properties",
            ),
            ("voxels:raw", "must be OPTION=VALUE"),
            ("voxels:cells=0", "/cells: 0 is out of range"),
            ("voxels:colour=red", "/colour: unknown option"),
        ] {
            let refused = parse(text).unwrap_err();
            assert!(refused.contains(says), "{text}: {refused}");
        }
    }

    #[test]
    fn progress_without_words_counts() {
        let message = |message: &str| Progress {
            step: packstone_engine::Step::Export,
            fraction: 0.5,
            done: 3,
            total: 6,
            unit: "load cases",
            message: message.into(),
            growth: None,
        };
        assert_eq!(words(&message("")), "3 of 6 load cases");
        assert_eq!(words(&message("Gmsh: filling volumes (2 s)")), "Gmsh: filling volumes (2 s)");
    }
}
