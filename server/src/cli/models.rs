//! Models of a packing as files, for `packstone run` and `packstone derive`.
//!
//! Names of files, and what stands around the work at the terminal; what is made is the engine's matter.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use packstone_engine::derived::{Derivation, DerivationKind, DerivedError, Model};
use packstone_engine::{Control, FieldError, Limits, Progress};

use super::bar::Bar;
use super::{Failure, print};

/// Names of all models, for a list of what there is.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    DerivationKind::ALL.iter().map(|kind| kind.name())
}

/// Makes each of these in a folder that exists, and prints the name of its file; what there is to know about it stands
/// beside it.
pub(super) fn write_all(
    derivations: &[Derivation],
    model: &Model<'_>,
    limits: &Limits,
    out: &Path,
    stop: &Arc<AtomicBool>,
) -> Result<(), Failure> {
    let mut taken = HashSet::new();
    for derivation in derivations {
        let name = free_name(derivation, &mut taken);
        let file = out.join(&name);
        let watch = Watch { bar: Bar::new(), what: derivation.kind().name(), stop };
        let written = write(derivation, model, limits, &watch, &file);
        watch.bar.finish();
        let report = written.map_err(|error| {
            // A part of a file would be taken for the whole.
            let _ = fs::remove_file(&file);
            format!("{} was not made: {}", file.display(), explained(error))
        })?;
        let beside = out.join(format!("{name}.report.json"));
        fs::write(&beside, report)
            .map_err(|error| format!("{} cannot be written: {error}", beside.display()))?;
        print(&format!("{}\n", file.display()))?;
    }
    Ok(())
}

/// What stops a model from being made, as lines for a person.
pub(super) fn explained(error: DerivedError) -> String {
    match error {
        DerivedError::Invalid(faults) => listed(&faults),
        DerivedError::TooLarge(fault) => listed(&[fault]),
        other => other.to_string(),
    }
}

/// Faults of options, one a line.
pub(super) fn listed(faults: &[FieldError]) -> String {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    lines.join("\n  ")
}

/// `result.msh`, or `result-2.msh` where there is one.
fn free_name(derivation: &Derivation, taken: &mut HashSet<String>) -> String {
    let (kind, extension) = (derivation.kind().name(), derivation.file_extension());
    let ending = if kind == extension { kind.to_owned() } else { format!("{kind}.{extension}") };
    let mut name = format!("result.{ending}");
    let mut n = 2;
    while !taken.insert(name.clone()) {
        name = format!("result-{n}.{ending}");
        n += 1;
    }
    name
}

fn write(
    derivation: &Derivation,
    model: &Model<'_>,
    limits: &Limits,
    watch: &Watch<'_>,
    file: &Path,
) -> Result<String, DerivedError> {
    let mut out = BufWriter::with_capacity(1 << 18, File::create(file)?);
    let report = derivation.write(model, limits, watch, &mut out)?;
    out.flush()?;
    Ok(serde_json::to_string_pretty(&report).map_err(std::io::Error::from)? + "\n")
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
