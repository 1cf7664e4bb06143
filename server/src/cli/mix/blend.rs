//! `packstone mix blend`: the shares of stockpiles whose blend comes nearest to a curve or into a band.

use std::path::{Path, PathBuf};

use clap::Args;
use packstone_engine::blend::Blend;
use packstone_engine::importer::{self, Curve, Level, MixReading, ReadOptions, Verdict};
use packstone_engine::request::BlendRequest;
use packstone_engine::request::aggregate::MAX_AGGREGATE_NAME;
use packstone_engine::request::standard::GRADINGS;
use serde_json::{Value, json};

use super::super::exit::{Exit, Failure};
use super::super::outputs::refuse_existing;
use super::super::print;
use super::super::run::{listed, warn};
use super::{job, read_table, text};
use crate::strict_json;

/// Likeness of two names, 1 where they are equal, from which on one is likely to be meant by the other.
const LEAST_LIKENESS: f64 = 0.6;

/// Options of `packstone mix blend`.
#[derive(Args)]
pub(super) struct Options {
    /// Tables of the stockpiles, as `mix read` takes them: each curve in them is a stockpile. Or one request as JSON,
    /// as `POST /v1/mixes/blend` takes it
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// What the blend is to meet: a table with a curve or with limits, or a grading of a standard, as `A16` or
    /// `"ASTM C33 57"`, which is a band where it has limits. The limits of the tables where they have some
    #[arg(long, value_name = "FILE or GRADING")]
    target: Option<PathBuf>,
    /// Print the blend as JSON, in the form of the answer to `POST /v1/mixes/blend`
    #[arg(long)]
    json: bool,
    /// File for a job that packs the blend: in a cube of five times the largest grain, with a volume fraction of 0.4
    /// and grains down to an eighth of the largest
    #[arg(long, value_name = "JOB.json")]
    out: Option<PathBuf>,
    /// Overwrite that file
    #[arg(long, requires = "out")]
    force: bool,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    refuse_existing(&options.out, options.force)?;
    let (document, of) = request(options)?;
    let request = BlendRequest::from_json(&document);
    let blend = Blend::of(&request.map_err(|faults| Exit::BadInput.because(listed(of, &faults)))?);
    if options.json {
        print(&format!("{}\n", serde_json::to_string_pretty(&blend)?))?;
    } else {
        print(&text::of_blend(&blend))?;
    }
    warn(&blend.warnings);
    options.out.as_ref().map_or(Ok(()), |out| job::write(&blend.request, out))
}

/// The request, and the file that its faults are those of.
fn request(options: &Options) -> Result<(Value, &Path), Failure> {
    let first = &options.files[0];
    let bytes = read_table(first)?;
    let without_mark = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    if without_mark.trim_ascii_start().starts_with(b"{") {
        if options.files.len() > 1 || options.target.is_some() {
            let text = format!("{} is a whole request: leave other files and --target out", first.display());
            return Err(Exit::BadInput.because(text));
        }
        let document = strict_json::parse(&bytes).map_err(|problem| {
            Exit::BadInput.because(format_args!("{} is refused: {}", first.display(), problem.detail))
        })?;
        return Ok((document, first));
    }
    let mut aggregates = Vec::new();
    let mut bands = Vec::new();
    for file in &options.files {
        let found = curves(file, &if file == first { bytes.clone() } else { read_table(file)? })?;
        let several = found.curves.len() > 1;
        for (number, curve) in found.curves.into_iter().enumerate() {
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            let numbered =
                || if several { format!("{stem} {}", number + 1) } else { stem.clone().into_owned() };
            let name = unused(&curve.name.clone().unwrap_or_else(numbered), &aggregates);
            aggregates.push(json!({"name": name, "grading": grading(&curve)}));
        }
        bands.extend(found.bands);
    }
    let target = match (&options.target, bands.as_slice()) {
        (Some(target), _) => named(target)?,
        (None, [band]) => json!({"type": "band", "points": band.points}),
        (None, bands) => {
            let what = if bands.is_empty() { "no limits" } else { "several limits" };
            let text = format!(
                "the tables have {what}: name what the blend is to meet by --target, as --target A16 or --target \
                 band.csv"
            );
            return Err(Exit::BadInput.because(text));
        }
    };
    if aggregates.is_empty() {
        return Err(Exit::BadInput.because("the tables have limits alone, and no curve of a stockpile"));
    }
    Ok((json!({"aggregates": aggregates, "target": target}), first))
}

/// The name, or the name with the first number that no aggregate has.
fn unused(name: &str, aggregates: &[Value]) -> String {
    let name: String = name.chars().take(MAX_AGGREGATE_NAME - " (16)".len()).collect();
    let is_free = |name: &String| aggregates.iter().all(|one| one["name"] != **name);
    let numbered = (2..).map(|number| format!("{name} ({number})"));
    std::iter::once(name.clone()).chain(numbered).find(is_free).unwrap_or_default()
}

fn grading(curve: &Curve) -> Value {
    json!({"type": "sieves", "points": curve.points, "completed_mm": curve.completed})
}

/// The curves and limits of a table. Several curves in columns or sheets of their own are no choice here: all are
/// taken. Limits alone are no curves.
fn curves(file: &Path, bytes: &[u8]) -> Result<MixReading, Failure> {
    let reading = importer::read(bytes, &ReadOptions::default());
    let mut places: Vec<_> = reading.curves.iter().map(|curve| (&curve.name, &curve.column)).collect();
    places.sort_unstable();
    places.dedup();
    let are_apart = places.len() == reading.curves.len();
    let has_any = !(reading.curves.is_empty() && reading.bands.is_empty());
    let are_curves = reading.candidates.iter().all(|candidate| candidate.recipe.is_none());
    if reading.verdict != Verdict::Refuse && are_apart && has_any && are_curves {
        return Ok(reading);
    }
    let file = file.display();
    let faults = reading.notes.iter().filter(|note| note.level == Level::Fault).map(text::of_note);
    let labels = reading.candidates.iter().map(|candidate| candidate.label.clone());
    let found: Vec<String> = faults.chain(labels).collect();
    let what = if reading.verdict == Verdict::Refuse { "is refused" } else { "has several readings" };
    Err(Exit::BadInput.because(format_args!(
        "{file} {what}:\n  {}\nkeep the curve that is meant in a file of its own, or give the blend as JSON; `packstone \
         mix read {file}` shows what was understood",
        found.join("\n  ")
    )))
}

/// The name of a grading of a standard that a text is likely to mean.
fn nearest_name(text: &str) -> Option<String> {
    let text = text.to_lowercase();
    let names = GRADINGS.iter().flat_map(|grading| {
        let standard = grading.standard.name();
        [
            (standard == "DIN 1045-2").then(|| grading.name.to_owned()),
            Some(format!("{standard} {}", grading.name)),
        ]
    });
    let likeness = |name: &String| strsim::normalized_damerau_levenshtein(&text, &name.to_lowercase());
    let nearest = names.flatten().max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
    (likeness(&nearest) >= LEAST_LIKENESS).then_some(nearest)
}

/// The target of an option: a file, or a grading of a standard.
fn named(target: &Path) -> Result<Value, Failure> {
    let name = target.to_string_lossy();
    let is_meant = |standard: &str, grading: &str| {
        let (name, whole) = (name.trim(), format!("{standard} {grading}"));
        name.eq_ignore_ascii_case(&whole) || (standard == "DIN 1045-2" && name.eq_ignore_ascii_case(grading))
    };
    let found = GRADINGS.iter().find(|grading| is_meant(grading.standard.name(), grading.name));
    if let Some(grading) = found {
        let kind = if grading.is_curve() { "standard" } else { "band" };
        return Ok(json!({"type": kind, "standard": grading.standard.name(), "name": grading.name}));
    }
    if !target.exists() {
        let near =
            nearest_name(name.trim()).map_or_else(String::new, |near| format!("; did you mean \"{near}\"?"));
        let text = format!(
            "--target {name}: is no file and no grading of a standard: must be one of both, as A16 or \"ASTM C33 57\" \
             (docs/mixes.md lists them){near}"
        );
        return Err(Exit::BadInput.because(text));
    }
    let reading = curves(target, &read_table(target)?)?;
    match (reading.curves.as_slice(), reading.bands.as_slice()) {
        ([curve], []) => Ok(grading(curve)),
        (_, [band]) => Ok(json!({"type": "band", "points": band.points})),
        (curves, bands) => Err(Exit::BadInput.because(format_args!(
            "--target {name}: has {} curves and {} bands: must have one of both",
            curves.len(),
            bands.len()
        ))),
    }
}
