//! `packstone mix read`: what was understood of a table of gradings or of a recipe, and a job that packs it.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::{Args, builder::PossibleValuesParser};
use packstone_engine::importer::{self, Candidate, Level, MixReading, ReadOptions, Unit, Verdict};

use super::super::exit::{Exit, Failure};
use super::super::outputs::refuse_existing;
use super::super::print;
use super::{job, read_table, text};

/// Longest input for whose candidates the options are looked for by reading it again.
const MOST_READ_AGAIN_BYTES: usize = 64 << 10;
/// Most candidates that are looked at in this way.
const MOST_READ_AGAIN: usize = 16;

/// Options of `packstone mix read`.
#[derive(Args)]
pub(super) struct Options {
    /// The table: a text (CSV, tabs, semicolons, HTML, Markdown, what was copied out of a document) or a workbook
    /// (.xlsx, .ods); `-` reads standard input
    file: PathBuf,
    /// Sheet of a workbook to read, by its name
    #[arg(long, value_name = "NAME")]
    sheet: Option<String>,
    /// Curve or recipe to read, by its name
    #[arg(long, value_name = "NAME")]
    curve: Option<String>,
    /// Column of values to read, by its head, by its letter in a workbook, or by its number from 1
    #[arg(long)]
    column: Option<String>,
    /// Unit of the sieves
    #[arg(long, value_parser = PossibleValuesParser::new(Unit::ALL.map(Unit::name)))]
    unit: Option<String>,
    /// Of several readings that fit, the one with this number
    #[arg(long, value_name = "NUMBER")]
    choose: Option<NonZeroUsize>,
    /// Print what was understood as JSON, in the form of the answer to `POST /v1/mixes/read`
    #[arg(long)]
    json: bool,
    /// File for a job that packs the mix: in a cube of five times the largest grain, and with a volume fraction of 0.4
    /// and grains down to an eighth of the largest where the table says nothing of them
    #[arg(long, value_name = "JOB.json")]
    out: Option<PathBuf>,
    /// Overwrite that file
    #[arg(long, requires = "out")]
    force: bool,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    refuse_existing(&options.out, options.force)?;
    let file = &options.file;
    let bytes = read_table(file)?;
    let given = ReadOptions {
        sheet: options.sheet.clone(),
        curve: options.curve.clone(),
        column: options.column.clone(),
        unit: options.unit.clone(),
    };
    let mut reading = importer::read(&bytes, &given);
    if let Some(number) = options.choose {
        reading = chosen(reading, number, file)?;
    }
    if options.json {
        print(&format!("{}\n", serde_json::to_string_pretty(&reading)?))?;
    } else {
        let choices = choices(&bytes, &given, &reading.candidates);
        print(&text::of_reading(file, &reading, &choices))?;
    }
    match reading.verdict {
        Verdict::Ok | Verdict::Warn => options.out.as_ref().map_or(Ok(()), |out| write(&reading, out, file)),
        Verdict::Ask => {
            let (file, count) = (file.display(), reading.candidates.len());
            Err(Exit::BadInput.because(format_args!(
                "{file} has {count} readings: choose one by its option (--curve, --column, --unit, --sheet) or by its \
                 number (--choose 1 to {count})"
            )))
        }
        Verdict::Refuse => {
            let faults = reading.notes.iter().filter(|note| note.level == Level::Fault);
            let lines: Vec<String> = faults.map(text::of_note).collect();
            Err(Exit::BadInput.because(format_args!(
                "{} is refused:\n  {}",
                file.display(),
                lines.join("\n  ")
            )))
        }
    }
}

/// The reading with one of its candidates in place of the choice.
fn chosen(reading: MixReading, number: NonZeroUsize, file: &Path) -> Result<MixReading, Failure> {
    let count = reading.candidates.len();
    let Some(candidate) = reading.candidates.into_iter().nth(number.get() - 1) else {
        let (file, number) = (file.display(), number.get());
        let text = match count {
            0 => format!("--choose {number}: {file} has no readings to choose from: leave it out"),
            _ => format!("--choose {number}: must be at most {count}, for {file} has {count} readings"),
        };
        return Err(Exit::BadInput.because(text));
    };
    let Candidate { curve, recipe, request, .. } = candidate;
    let (curves, recipes): (Vec<_>, Vec<_>) = (curve.into_iter().collect(), recipe.into_iter().collect());
    let mut all = curves
        .iter()
        .flat_map(|curve| &curve.notes)
        .chain(recipes.iter().flat_map(|recipe| &recipe.notes))
        .chain(&reading.notes);
    let verdict = if all.any(|note| note.level == Level::Warning) { Verdict::Warn } else { Verdict::Ok };
    Ok(MixReading {
        verdict,
        curves,
        recipes,
        candidates: Vec::new(),
        request: Some(request),
        bands: reading.bands,
        notes: reading.notes,
    })
}

/// The option that chooses each candidate: one with which the same bytes are read as this candidate, else its number.
fn choices(bytes: &[u8], given: &ReadOptions, candidates: &[Candidate]) -> Vec<String> {
    let by_number = |i: usize| format!("--choose {}", i + 1);
    let are_tried = bytes.len() <= MOST_READ_AGAIN_BYTES && candidates.len() <= MOST_READ_AGAIN;
    let choice = |(i, candidate): (usize, &Candidate)| {
        let found = are_tried.then(|| choice_by_name(bytes, given, candidate)).flatten();
        found.unwrap_or_else(|| by_number(i))
    };
    candidates.iter().enumerate().map(choice).collect()
}

fn choice_by_name(bytes: &[u8], given: &ReadOptions, candidate: &Candidate) -> Option<String> {
    let of_curve = candidate.curve.as_ref();
    let name = of_curve.map_or_else(|| candidate.recipe.as_ref()?.name.clone(), |curve| curve.name.clone());
    let column = of_curve.map(|curve| curve.column.clone());
    let unit = of_curve.map(|curve| curve.unit.clone());
    let ways = [("curve", name), ("column", column), ("unit", unit)];
    ways.into_iter().find_map(|(option, value)| {
        let value = value?;
        let mut options = given.clone();
        let field = match option {
            "curve" => &mut options.curve,
            "column" => &mut options.column,
            _ => &mut options.unit,
        };
        *field = Some(value.clone());
        let reading = importer::read(bytes, &options);
        (reading.request.as_ref() == Some(&candidate.request))
            .then(|| format!("--{option} {}", text::quoted(&value)))
    })
}

/// Writes a job that packs the mix.
fn write(reading: &MixReading, out: &Path, file: &Path) -> Result<(), Failure> {
    let Some(request) = &reading.request else {
        let text = format!(
            "{}: no request follows from limits alone: {} is not written",
            file.display(),
            out.display()
        );
        return Err(Exit::BadInput.because(text));
    };
    job::write(request, out)
}
