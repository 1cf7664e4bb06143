//! `packstone export`: exports of a packing that lies in a file, without a service.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use packstone_engine::Limits;
use packstone_engine::export::ExportRequest;

use super::exit::{Failure, cannot_be};
use super::exports::{self, MaterialsFile, Output, PICTURE};
use super::input::Input;
use super::outputs::refuse_existing;
use super::packing_file;
use super::print_files;
use super::signals::stop_on_signals;
use super::unfinished::Unfinished;
use crate::config::{DEFAULT_CHECKPOINT_EVERY_S, cores, default_memory_bytes, seconds_or_none};
use crate::gmsh::{self, GmshOptions};

/// Options of `packstone export`.
#[derive(Args)]
pub(super) struct Options {
    /// The packing: a result as JSON as `packstone run` or the service give it, the file in which the service stores
    /// it, or a table of grains
    result: PathBuf,
    /// Job by whose specimen and distance the packing is checked; a table of grains needs it
    #[arg(long, value_name = "JOB.json")]
    specimen: Option<PathBuf>,
    /// What to make of it: mesh, voxels, slice, deck, ldpm, certificates, shapes, quality or properties, with
    /// options, as `voxels:format=raw,cells=200`
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
    /// Seconds between two checkpoints of effective properties, from which the same command goes on after it was
    /// killed; 0 keeps one after each load case
    #[arg(long, default_value_t = DEFAULT_CHECKPOINT_EVERY_S, value_parser = seconds_or_none)]
    checkpoint_every_s: f64,
    #[command(flatten)]
    materials: MaterialsFile,
    #[command(flatten)]
    gmsh: GmshOptions,
    #[command(flatten)]
    input: Input,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let export_threads = options.threads.unwrap_or_else(cores);
    gmsh::set(options.gmsh.clone());
    let stop = stop_on_signals()?;
    let packing = packing_file::read(
        &options.result,
        options.specimen.as_deref(),
        &options.input,
        export_threads,
        &stop,
    )?;
    let limits = Limits {
        max_model_bytes: default_memory_bytes(1),
        max_voxel_file_bytes: u64::MAX,
        export_threads,
        ..Limits::default()
    };
    let exports = options.materials.given_to(&options.exports, &options.input)?;
    let outputs = Output::all(exports, &options.out);
    for output in &outputs {
        output.check(packing.request(), &limits)?;
    }
    let picture = options.picture.then(|| options.out.join(PICTURE));
    let files: Vec<PathBuf> = outputs.iter().flat_map(Output::files).chain(picture.clone()).collect();
    let Some(first) = files.first() else { return Ok(()) };
    let unfinished = Unfinished::beside(first);
    let record = unfinished.read()?;
    let of_record = |file: &&PathBuf| record.as_ref().is_some_and(|record| record.names(file));
    refuse_existing(files.iter().filter(|file| !of_record(file)), options.force)?;
    std::fs::create_dir_all(&options.out).map_err(|error| cannot_be("made", &options.out, &error))?;
    unfinished.begin(&files, None)?;
    let every = Duration::from_secs_f64(options.checkpoint_every_s);
    let model = packing.model();
    let written = exports::write_all(&outputs, &model, &limits, every, &stop).and_then(|()| {
        picture.map_or(Ok(()), |file| exports::write_picture(&model, &file, export_threads, &stop))
    });
    unfinished.ended(written)?;
    print_files(&files)
}
