//! `packstone derive`: a model of a result that lies in a file, without a service.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use packstone_engine::export::tables::stored::{Layout, MAGIC};
use packstone_engine::export::{ExportRequest, ExportType, Model};
use packstone_engine::request::Specimen;
use packstone_engine::{Limits, Spheres};
use serde::Deserialize;
use serde_json::Value;

use super::Failure;
use super::models;
use super::signals::stop_on_signals;
use crate::config::default_memory_bytes;

/// Options of `packstone derive`.
#[derive(Args)]
pub(super) struct Options {
    /// The result: JSON as `packstone run` or the service give it, or the form in which the service stores it
    result: PathBuf,
    /// What to make of it
    #[arg(long = "type", value_parser = kind_parser())]
    kind: ExportType,
    /// An option, as `--option axis=x`; may be repeated
    #[arg(long = "option", value_name = "NAME=VALUE", value_parser = pair)]
    pairs: Vec<(String, String)>,
    /// Folder for the file; made where it is missing
    #[arg(long, default_value = ".")]
    out: PathBuf,
}

fn kind_parser() -> impl clap::builder::TypedValueParser<Value = ExportType> {
    PossibleValuesParser::new(models::names())
        .try_map(|name| ExportType::from_name(&name).ok_or("no such type"))
}

fn pair(text: &str) -> Result<(String, String), String> {
    text.split_once('=')
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .ok_or_else(|| "must be NAME=VALUE".into())
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let pairs = options.pairs.iter().map(|(name, value)| (name.as_str(), value.as_str()));
    let export = ExportRequest::from_text(options.kind, pairs)
        .map_err(|faults| format!("the options are refused:\n  {}", models::listed(&faults)))?;
    let (specimen, spheres) = read(&options.result)
        .map_err(|error| format!("{} cannot be read as a result: {error}", options.result.display()))?;
    let limits = Limits { max_model_bytes: default_memory_bytes(1), ..Limits::default() };
    export
        .check(&specimen, &limits)
        .map_err(|error| format!("{} is refused:\n  {}", options.kind.name(), models::explained(error)))?;
    std::fs::create_dir_all(&options.out)
        .map_err(|error| format!("{} cannot be made: {error}", options.out.display()))?;
    let model = Model { specimen: &specimen, spheres: &spheres };
    models::write_all(&[export], &model, &limits, &options.out, &stop_on_signals()?)
}

/// What a result in JSON has that matters here.
#[derive(Deserialize)]
struct Document {
    request: Value,
    spheres: Rows,
}

#[derive(Deserialize)]
struct Rows {
    rows: Vec<[f64; 4]>,
}

fn read(file: &Path) -> Result<(Specimen, Spheres), Failure> {
    let mut input = BufReader::with_capacity(1 << 18, File::open(file)?);
    let mut magic = [0; MAGIC.len()];
    let is_stored = input.read_exact(&mut magic).is_ok() && magic == MAGIC;
    input.seek(SeekFrom::Start(0))?;
    let (request, spheres) = if is_stored {
        let layout = Layout::read(&mut input)?;
        input.seek(SeekFrom::Start(layout.columns_offset))?;
        let spheres = columns(&mut input, layout.rows as usize)?;
        (layout.head.request, spheres)
    } else {
        let document: Document = serde_json::from_reader(input)?;
        let mut spheres = Spheres::with_capacity(document.spheres.rows.len());
        for [x, y, z, d] in document.spheres.rows {
            spheres.push([x, y, z], d);
        }
        (document.request, spheres)
    };
    let specimen = Specimen::from_json(&request["specimen"]).map_err(|faults| models::listed(&faults))?;
    Ok((specimen, spheres))
}

fn columns(input: &mut impl std::io::Read, rows: usize) -> std::io::Result<Spheres> {
    let mut column = || -> std::io::Result<Vec<f64>> {
        let mut bytes = Vec::new();
        input.by_ref().take(8 * rows as u64).read_to_end(&mut bytes)?;
        if bytes.len() != 8 * rows {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        let number = |eight: &[u8]| f64::from_le_bytes(std::array::from_fn(|i| eight[i]));
        Ok(bytes.chunks_exact(8).map(number).collect())
    };
    Ok(Spheres { x_mm: column()?, y_mm: column()?, z_mm: column()?, d_mm: column()? })
}
