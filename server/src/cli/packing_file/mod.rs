//! Packings that are read from a file, and checked before anything is made of them: results as JSON or in the stored
//! form, and tables of grains with the job that names their specimen.
//!
//! Whoever reads a packing from a file does it here, so that every command finds the same faults and says the same of
//! them. The check is that of the engine, which every packing passes when it is made.

mod csv;

use std::fs::File;
use std::io::{self, BufReader, Read as _, Seek as _, SeekFrom};
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use packstone_engine::check::{Extent, Fault, Inspection};
use packstone_engine::export::tables::stored::{Layout, MAGIC_BYTES, is_stored, verify};
use packstone_engine::export::tables::{self, Column, EngineInfo, GrainSource as _, Table, TemplateRecord};
use packstone_engine::export::{Model, Provenance};
use packstone_engine::packing::{CheckReport, GrainsRef, Summary};
use packstone_engine::request::{MIN_LENGTH_MM, Specimen};
use packstone_engine::{
    Control, Grains, PackingRequest, Progress, TemplateCache, checked_as, compare_stated, inspect,
};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::exit::{Exit, Failure, cannot_be};
use super::exports::listed;
use super::input::Input;
use crate::jobs::JobRequest;
use crate::strict_json;

/// How far figures may differ that a result states and that its grains have.
const ROUNDING: f64 = 1.0e-9;
/// How far columns of a table may differ from what follows from other columns: they may be rounded.
const ROUNDED: f64 = 1.0e-6;

/// What was read of a packing, which passed its check.
pub(super) struct PackingFile {
    /// The conditions that it was checked by: its own, or those of the job that was named beside it. Without a mix the
    /// grading was not judged.
    pub(super) request: PackingRequest,
    pub(super) grains: Grains,
    /// What stands in a result, and in no table.
    pub(super) provenance: Option<Provenance>,
    /// What the check found, with the rows of the file.
    pub(super) found: Inspection,
    /// Whether there is a mix to judge the grading by.
    pub(super) has_mix: bool,
    /// The row in the file of each grain, where the file does not list the largest first.
    rows: Option<Vec<usize>>,
}

/// Goes on until a signal asks to stop.
pub(super) struct UntilStopped<'a>(pub(super) &'a AtomicBool);

impl Control for UntilStopped<'_> {
    fn report(&self, _: &Progress) {}

    fn should_stop(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// A packing before its check.
struct Unchecked {
    request: Option<Value>,
    table: Table,
    /// The columns that stand in the file; others follow from them.
    stated: Vec<Column>,
    provenance: Option<Provenance>,
    /// What a result states of its grains.
    stated_figures: Option<(Summary, CheckReport)>,
    is_result: bool,
}

/// The members of a result in JSON that are needed here.
#[derive(Deserialize)]
struct Document {
    request: Value,
    grains: Rows,
    /// Of polyhedra.
    templates: Option<Vec<TemplateRecord>>,
    job_id: Option<String>,
    engine: Option<EngineInfo>,
    /// Of another version, it may not be one that is read.
    #[serde(default)]
    summary: Value,
    #[serde(default)]
    check: Value,
}

#[derive(Deserialize)]
struct Rows {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Document {
    fn provenance(&self) -> Option<Provenance> {
        let engine = self.engine.as_ref()?;
        let fraction = |name: &str| self.summary[name].as_f64();
        Some(Provenance {
            job_id: self.job_id.clone(),
            name: self.request["name"].as_str().map(str::to_owned),
            seed: self.request["seed"].as_u64(),
            engine_version: engine.version.clone(),
            volume_fraction_mixture: fraction("volume_fraction_mixture")?,
            volume_fraction_effective: fraction("volume_fraction_effective")?,
            aggregates: Provenance::aggregates_of(&self.request),
            result_sha256: None,
        })
    }
}

/// Reads a packing and checks it. `job` is a job, or its specimen and distance alone, by which it is checked in place
/// of its own; a table needs one.
///
/// # Errors
/// [`Exit::BadInput`] where the file is none of a packing, or its packing does not pass the check: with the pair or the
/// row, counted from 0.
pub(super) fn read(
    file: &Path,
    job: Option<&Path>,
    input: &Input,
    threads: NonZeroUsize,
    stop: &AtomicBool,
) -> Result<PackingFile, Failure> {
    let unread = |error: &dyn std::fmt::Display| {
        Exit::BadInput.because(format_args!("{} cannot be read as a packing: {error}", file.display()))
    };
    let mut unchecked = {
        let mut input = File::open(file)
            .map(|file| BufReader::with_capacity(1 << 18, file))
            .map_err(|error| cannot_be("read", file, &error))?;
        read_any(&mut input).map_err(|error| match error.kind() {
            io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => unread(&error),
            _ => cannot_be("read", file, &error),
        })?
    };
    let (conditions, of_job) = match (job, unchecked.request.take()) {
        (Some(job), _) => (input.json(job)?, Some(job)),
        (None, Some(request)) => (request, None),
        (None, None) => {
            return Err(unread(
                &"it is a table of grains: name the job of its specimen with --specimen JOB.json",
            ));
        }
    };
    let (mut request, has_mix) = conditions_of(&conditions).map_err(|faults| match of_job {
        Some(job) => Exit::BadInput.because(format_args!("{} is refused: {faults}", job.display())),
        None => unread(&faults),
    })?;
    let of_file = request.clone();
    let mut extent = Extent::WHOLE;
    if let (None, Some((summary, _))) = (of_job, &unchecked.stated_figures) {
        (request, extent) = checked_as(&request, summary).map_err(|fault| unread(&fault))?;
    }
    let templates = TemplateCache::default();
    let (grains, rows) =
        grains_of((unchecked.table, &*unchecked.stated), &request, &templates, unchecked.is_result)
            .map_err(|error| unread(&error))?;
    let invalid = |what: &dyn std::fmt::Display| {
        Exit::BadInput.because(format_args!("{} is no valid packing: {what}", file.display()))
    };
    let found =
        inspect(&grains, (&request, extent), &templates, threads, &UntilStopped(stop)).map_err(|fault| {
            match fault {
                Fault::Stopped => Exit::Interrupted.because(fault),
                Fault::OutOfMemory { .. } => Exit::Machine.because(fault),
                fault => invalid(&in_file(fault, rows.as_deref())),
            }
        })?;
    if unchecked.is_result && of_job.is_none() {
        match (&found.grading, &unchecked.stated_figures) {
            (Err(fault), _) if has_mix => return Err(invalid(fault)),
            (Ok(check), Some((summary, stated))) => {
                compare_stated(&of_file, (summary, stated), &grains, check.clone())
                    .map_err(|fault| invalid(&fault))?;
            }
            _ => {}
        }
    }
    Ok(PackingFile { request, grains, provenance: unchecked.provenance, found, has_mix, rows })
}

impl PackingFile {
    /// The row of a grain in the file.
    pub(super) fn row(&self, grain: usize) -> usize {
        self.rows.as_ref().map_or(grain, |rows| rows[grain])
    }

    /// The conditions that it was checked by; without a job its mix is made up.
    pub(super) fn request(&self) -> &PackingRequest {
        &self.request
    }

    pub(super) fn specimen(&self) -> &Specimen {
        &self.request.specimen
    }

    /// The packing as exports take it.
    pub(super) fn model(&self) -> Model<'_> {
        let model = Model::new(&self.request.specimen, &self.grains)
            .with_distance(self.request.distance)
            .with_materials(self.request.materials.as_ref())
            .with_mesher(&crate::gmsh::Installed);
        Model { provenance: self.provenance.as_ref(), ..model }
    }
}

/// The conditions of a packing: a whole job, or the specimen and the distance alone. Whether there is a mix.
fn conditions_of(job: &Value) -> Result<(PackingRequest, bool), String> {
    if !job["mix"].is_null() {
        let request = JobRequest::read(job, 0, None).map_err(|faults| listed(&faults))?;
        return Ok((request.packing(), true));
    }
    let grading = json!({"type": "monodisperse", "diameter_mm": 1});
    let mut stand_in =
        json!({"specimen": job["specimen"], "mix": {"grading": grading, "volume_fraction": 0.1}});
    for field in ["distance", "materials"] {
        if !job[field].is_null() {
            stand_in[field] = job[field].clone();
        }
    }
    let request = PackingRequest::from_json(&stand_in, 0).map_err(|faults| listed(&faults))?;
    Ok((request, false))
}

fn read_any(input: &mut BufReader<File>) -> io::Result<Unchecked> {
    let mut first = [0; MAGIC_BYTES];
    let read = input.read(&mut first)?;
    input.seek(SeekFrom::Start(0))?;
    if read == MAGIC_BYTES && is_stored(first) {
        return read_stored(input);
    }
    let text = first[..read].strip_prefix(b"\xef\xbb\xbf").unwrap_or(&first[..read]);
    if text.trim_ascii_start().first() == Some(&b'{') {
        return read_json(input);
    }
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes)?;
    if [&b"\xff\xfe"[..], b"\xfe\xff"].iter().any(|mark| bytes.starts_with(mark)) {
        return Err(invalid("it is text in UTF-16: save it in UTF-8".into()));
    }
    let text = String::from_utf8(bytes).map_err(|error| {
        invalid(format!(
            "it is no result as JSON, no stored result, and no table of text in UTF-8 (byte {} is of another encoding)",
            error.utf8_error().valid_up_to()
        ))
    })?;
    let (table, stated) = csv::read(&text)?;
    Ok(Unchecked { request: None, table, stated, provenance: None, stated_figures: None, is_result: false })
}

fn read_stored(input: &mut BufReader<File>) -> io::Result<Unchecked> {
    let layout = Layout::read(input)?;
    input.seek(SeekFrom::Start(0))?;
    verify(input)?;
    input.seek(SeekFrom::Start(layout.columns_offset))?;
    let table = columns(input, &layout)?.with_templates(layout.templates.clone());
    let provenance = Some(Provenance::from(&layout.head));
    let report = &layout.head.report;
    let stated_figures = Some((report.summary.clone(), report.check));
    let stated = layout.columns.to_vec();
    Ok(Unchecked {
        request: Some(layout.head.request),
        table,
        stated,
        provenance,
        stated_figures,
        is_result: true,
    })
}

fn read_json(input: &mut BufReader<File>) -> io::Result<Unchecked> {
    let document: Document = strict_json::from_file(input)?;
    let provenance = document.provenance();
    let stated_figures = Some((member("summary", document.summary)?, member("check", document.check)?));
    let Rows { columns, rows } = document.grains;
    let columns = Column::of_names(&columns)
        .ok_or_else(|| invalid("the columns of its `grains` are not those of a result".into()))?;
    if let Some(row) = rows.iter().position(|row| row.len() != columns.len()) {
        let (found, wanted) = (rows[row].len(), columns.len());
        return Err(invalid(format!("row {row} of its `grains` has {found} values: must have {wanted}")));
    }
    let values = (0..columns.len()).map(|column| rows.iter().map(|row| row[column]).collect()).collect();
    let templates = tables::read_templates(columns, document.templates)?;
    let table = Table::new(columns, values)?.with_templates(templates);
    let (request, stated) = (Some(document.request), columns.to_vec());
    Ok(Unchecked { request, table, stated, provenance, stated_figures, is_result: true })
}

/// A member of a result that states figures of its grains.
fn member<T: DeserializeOwned>(name: &str, value: Value) -> io::Result<T> {
    if value.is_null() {
        return Err(invalid(format!("its member `{name}` is missing, as every result has it")));
    }
    serde_json::from_value(value).map_err(|error| invalid(format!("its member `{name}`: {error}")))
}

fn columns(input: &mut impl io::Read, layout: &Layout) -> io::Result<Table> {
    let bytes = layout.rows.checked_mul(8).ok_or_else(|| invalid("it states too many grains".into()))?;
    let mut column = || -> io::Result<Vec<f64>> {
        let mut column = Vec::new();
        input.by_ref().take(bytes).read_to_end(&mut column)?;
        if column.len() as u64 != bytes {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let number = |eight: &[u8]| f64::from_le_bytes(std::array::from_fn(|i| eight[i]));
        Ok(column.chunks_exact(8).map(number).collect())
    };
    let values = layout.columns.iter().map(|_| column()).collect::<io::Result<_>>()?;
    Table::new(layout.columns, values)
}

/// The grains of a table, from the largest down, with the row of each where the table has another order.
fn grains_of(
    (table, stated): (Table, &[Column]),
    request: &PackingRequest,
    templates: &TemplateCache,
    is_result: bool,
) -> io::Result<(Grains, Option<Vec<usize>>)> {
    let needs_templates = table.columns().contains(&Column::Template) && table.templates().is_empty();
    let table = if needs_templates { table.with_templates(templates.of_request(request)) } else { table };
    let mut grains = tables::load(&table)?;
    let tolerance = if is_result { ROUNDING } else { ROUNDED };
    if let Some(tables::Difference { grain, column, found, expected }) =
        tables::difference(&table, stated, &grains, tolerance)?
    {
        return Err(invalid(format!(
            "grain {grain} has {found} in the column {}: by its other columns it must have {expected}",
            column.name()
        )));
    }
    // A request names no smaller grain, and ratios of lengths would leave the range of numbers.
    let least =
        GrainsRef::from(&grains).diameters_mm().enumerate().find(|(_, d)| *d > 0.0 && *d < MIN_LENGTH_MM);
    if let (false, Some((grain, d))) = (is_result, least) {
        return Err(invalid(format!(
            "grain {grain} has a diameter of {d:e} mm: must be at least {MIN_LENGTH_MM:e} mm"
        )));
    }
    let order = tables::descending(&table)?;
    if let Some(rows) = &order {
        if is_result {
            let place = (0..rows.len()).find(|&row| rows[row] != row).unwrap_or(0);
            return Err(invalid(format!(
                "grain {place} is smaller than a grain behind it: the largest come first"
            )));
        }
        grains = tables::load(&table.reordered(rows))?;
    }
    Ok((grains, order))
}

/// A fault with the rows of the file in place of the grains.
fn in_file(fault: Fault, rows: Option<&[usize]>) -> Fault {
    let Some(rows) = rows else { return fault };
    let row = |grain: usize| rows.get(grain).copied().unwrap_or(grain);
    match fault {
        Fault::NotANumber { grain } => Fault::NotANumber { grain: row(grain) },
        Fault::NotABody { grain } => Fault::NotABody { grain: row(grain) },
        Fault::Pair { first, second, clearance_mm, required_mm } => {
            let (first, second) = (row(first), row(second));
            Fault::Pair { first: first.min(second), second: first.max(second), clearance_mm, required_mm }
        }
        Fault::Wall { grain, clearance_mm, required_mm } => {
            Fault::Wall { grain: row(grain), clearance_mm, required_mm }
        }
        other => other,
    }
}

fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}
