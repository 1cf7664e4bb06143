//! `packstone export`: exports of a result that lies in a file, without a service.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::Args;
use packstone_engine::export::tables::stored::{Layout, MAGIC_BYTES, is_stored, verify};
use packstone_engine::export::tables::{self, Column, EngineInfo, Table, TemplateRecord};
use packstone_engine::export::{ExportRequest, Model, Provenance};
use packstone_engine::request::Specimen;
use packstone_engine::{Grains, Limits};
use serde::Deserialize;
use serde_json::Value;

use super::exit::{Exit, Failure, cannot_be};
use super::exports::{self, Output, PICTURE};
use super::outputs::refuse_existing;
use super::print_files;
use super::signals::stop_on_signals;
use super::unfinished::Unfinished;
use crate::config::{cores, default_memory_bytes};
use crate::strict_json;

/// Options of `packstone export`.
#[derive(Args)]
pub(super) struct Options {
    /// The result: JSON as `packstone run` or the service give it, or the file in which the service stores it
    result: PathBuf,
    /// What to make of it: mesh, voxels, slice, ldpm, certificates, shapes or quality, with options, as
    /// `voxels:format=raw,cells=200`
    #[arg(value_name = "TYPE[:OPTION=VALUE,...]", value_parser = exports::parse, required_unless_present = "picture")]
    exports: Vec<ExportRequest>,
    /// Render a picture as well, as result.png
    #[arg(long)]
    picture: bool,
    /// Folder for the files; made where it is missing
    #[arg(long, default_value = ".")]
    out: PathBuf,
    /// Overwrite files that exist
    #[arg(long)]
    force: bool,
    /// Threads that write a file, whose bytes do not depend on their number [default: one for each core]
    #[arg(long, value_name = "NUMBER")]
    threads: Option<NonZeroUsize>,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let Packed { specimen, grains, provenance } = read(&options.result)?;
    let export_threads = options.threads.unwrap_or_else(cores);
    let limits = Limits { max_model_bytes: default_memory_bytes(1), export_threads, ..Limits::default() };
    let outputs = Output::all(options.exports.iter().cloned(), &options.out);
    for output in &outputs {
        output.check(&specimen, &limits)?;
    }
    let picture = options.picture.then(|| options.out.join(PICTURE));
    let files: Vec<PathBuf> = outputs.iter().flat_map(Output::files).chain(picture.clone()).collect();
    let Some(first) = files.first() else { return Ok(()) };
    let unfinished = Unfinished::beside(first);
    let record = unfinished.read()?;
    let of_record = |file: &&PathBuf| record.as_ref().is_some_and(|record| record.names(file));
    refuse_existing(files.iter().filter(|file| !of_record(file)), options.force)?;
    std::fs::create_dir_all(&options.out).map_err(|error| cannot_be("made", &options.out, &error))?;
    let stop = stop_on_signals()?;
    unfinished.begin(&files, None)?;
    let model = Model { specimen: &specimen, grains: (&grains).into(), provenance: provenance.as_ref() };
    let written = exports::write_all(&outputs, &model, &limits, &stop).and_then(|()| {
        picture.map_or(Ok(()), |file| exports::write_picture(&model, &file, export_threads, &stop))
    });
    unfinished.ended(written)?;
    print_files(&files)
}

/// What exports need of a result.
pub(super) struct Packed {
    pub(super) specimen: Specimen,
    pub(super) grains: Grains,
    /// Absent for JSON that does not state it.
    pub(super) provenance: Option<Provenance>,
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
    summary: Option<VolumeFractions>,
}

#[derive(Deserialize)]
struct Rows {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct VolumeFractions {
    volume_fraction_mixture: f64,
    volume_fraction_effective: f64,
}

impl Document {
    fn provenance(&self) -> Option<Provenance> {
        let (engine, summary) = (self.engine.as_ref()?, self.summary.as_ref()?);
        Some(Provenance {
            job_id: self.job_id.clone(),
            name: self.request["name"].as_str().map(str::to_owned),
            seed: self.request["seed"].as_u64(),
            engine_version: engine.version.clone(),
            volume_fraction_mixture: summary.volume_fraction_mixture,
            volume_fraction_effective: summary.volume_fraction_effective,
            aggregates: Provenance::aggregates_of(&self.request),
            result_sha256: None,
        })
    }
}

/// Reads what exports need of a result.
pub(super) fn read(file: &Path) -> Result<Packed, Failure> {
    let unread = |error: &dyn std::fmt::Display| {
        Exit::BadInput.because(format_args!("{} cannot be read as a result: {error}", file.display()))
    };
    let mut input = File::open(file)
        .map(|file| BufReader::with_capacity(1 << 18, file))
        .map_err(|error| cannot_be("read", file, &error))?;
    let (request, grains, provenance) = read_either(&mut input).map_err(|error| unread(&error))?;
    let specimen =
        Specimen::from_json(&request["specimen"]).map_err(|faults| unread(&exports::listed(&faults)))?;
    Ok(Packed { specimen, grains, provenance })
}

fn read_either(input: &mut BufReader<File>) -> std::io::Result<(Value, Grains, Option<Provenance>)> {
    let mut magic = [0; MAGIC_BYTES];
    let is_stored = input.read_exact(&mut magic).is_ok() && is_stored(magic);
    input.seek(SeekFrom::Start(0))?;
    if is_stored {
        let layout = Layout::read(input)?;
        input.seek(SeekFrom::Start(0))?;
        verify(input)?;
        input.seek(SeekFrom::Start(layout.columns_offset))?;
        let grains = tables::load(&columns(input, &layout)?.with_templates(layout.templates.clone()))?;
        let provenance = Provenance::from(&layout.head);
        return Ok((layout.head.request, grains, Some(provenance)));
    }
    let document: Document = strict_json::from_file(input)?;
    let provenance = document.provenance();
    let Rows { columns, rows } = document.grains;
    let invalid = |what: &str| std::io::Error::new(std::io::ErrorKind::InvalidData, what.to_owned());
    let columns = Column::of_names(&columns)
        .ok_or_else(|| invalid("the columns of its `grains` are not those of a result"))?;
    if rows.iter().any(|row| row.len() != columns.len()) {
        return Err(invalid("a row of its `grains` has more or fewer values than there are columns"));
    }
    let values = (0..columns.len()).map(|column| rows.iter().map(|row| row[column]).collect()).collect();
    let templates = tables::read_templates(columns, document.templates)?;
    let table = Table::new(columns, values)?.with_templates(templates);
    Ok((document.request, tables::load(&table)?, provenance))
}

fn columns(input: &mut impl std::io::Read, layout: &Layout) -> std::io::Result<Table> {
    let rows = layout.rows;
    let mut column = || -> std::io::Result<Vec<f64>> {
        let mut bytes = Vec::new();
        input.by_ref().take(8 * rows).read_to_end(&mut bytes)?;
        if bytes.len() as u64 != 8 * rows {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        let number = |eight: &[u8]| f64::from_le_bytes(std::array::from_fn(|i| eight[i]));
        Ok(bytes.chunks_exact(8).map(number).collect())
    };
    let values = layout.columns.iter().map(|_| column()).collect::<std::io::Result<_>>()?;
    Table::new(layout.columns, values)
}
