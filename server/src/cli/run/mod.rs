//! `packstone run`: one job without a service, its result as files.

mod resume;
mod watch;

use std::fs::File;
use std::io::{BufWriter, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, builder::PossibleValuesParser, builder::TypedValueParser as _};
use packstone_engine::export::tables::{self, EngineInfo, Format, Head};
use packstone_engine::export::{ExportRequest, ExportType, Model};
use packstone_engine::{FieldError, Limits, PackError, Plan, PlanError};

use super::{Failure, models, print};
use crate::checkpoints;
use crate::config::{DEFAULT_CHECKPOINT_EVERY_S, default_memory_bytes, seconds_or_none};
use crate::jobs::{JobRequest, request};
use crate::plots::draw;
use crate::plots::job::{self, JobPlot, JobResult};
use crate::strict_json;
use watch::Watch;

/// Options of `packstone run`.
#[derive(Args)]
pub(super) struct Options {
    /// The job as JSON, as it would be submitted; `-` reads standard input
    job: PathBuf,
    /// Folder for the result; made where it is missing
    #[arg(long, default_value = ".")]
    out: PathBuf,
    /// Formats of the result; models are made with default options (name others in the job's `postprocess`)
    #[arg(long, value_delimiter = ',', default_value = "json", value_parser = output_parser())]
    format: Vec<Output>,
    /// Plots of the result, as SVG
    #[arg(long, value_delimiter = ',', value_parser = plot_parser())]
    plot: Vec<JobPlot>,
    /// Most grains of the packing
    #[arg(long, default_value_t = Limits::default().max_grains)]
    max_grains: u64,
    /// Go on from the checkpoint of a run that was stopped or killed; it lies in the folder for the result
    #[arg(long)]
    resume: bool,
    /// Discard the checkpoint of an earlier run
    #[arg(long, conflicts_with = "resume")]
    fresh: bool,
    /// Seconds between two checkpoints; 0 keeps one at every opportunity
    #[arg(long, default_value_t = DEFAULT_CHECKPOINT_EVERY_S, value_parser = seconds_or_none)]
    checkpoint_every_s: f64,
}

/// A file of the result.
#[derive(Clone, Debug)]
enum Output {
    Grains(Format),
    Model(ExportRequest),
}

fn output_parser() -> impl clap::builder::TypedValueParser<Value = Output> {
    PossibleValuesParser::new(Format::ALL.map(Format::name).into_iter().chain(models::names())).try_map(
        |name| {
            let model =
                || ExportRequest::from_text(ExportType::from_name(&name)?, []).ok().map(Output::Model);
            Format::from_name(&name).map(Output::Grains).or_else(model).ok_or("no such format")
        },
    )
}

pub(super) fn format_parser() -> impl clap::builder::TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::ALL.map(Format::name))
        .try_map(|name| Format::from_name(&name).ok_or("no such format"))
}

fn plot_parser() -> impl clap::builder::TypedValueParser<Value = JobPlot> {
    PossibleValuesParser::new(JobPlot::ALL.iter().map(|kind| kind.name()))
        .try_map(|name| JobPlot::from_name(&name).ok_or("no such plot"))
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let value = strict_json::parse(&read(&options.job)?)
        .map_err(|problem| format!("{} is refused: {}", options.job.display(), problem.detail))?;
    let checkpoint = options.out.join(resume::FILE);
    // A run that was started without a seed goes on with the one that was drawn for it.
    let stored = options.resume.then(|| resume::request_of(&checkpoint)).transpose()?;
    let seed = stored.as_ref().map_or_else(request::draw_seed, |stored| stored.seed);
    let request = JobRequest::read(&value, seed, None).map_err(|faults| listed(&options.job, &faults))?;
    let packing_request = request.packing();
    let max_memory_bytes = default_memory_bytes(1);
    let limits =
        Limits { max_grains: options.max_grains, max_memory_bytes, max_model_bytes: max_memory_bytes };
    let plan = Plan::new(&packing_request, &limits).map_err(|error| refused(&options.job, error))?;
    for warning in &plan.warnings {
        eprintln!("warning: {warning}");
    }
    let models = models_of(options, &request);
    for model in &models {
        let named =
            |error| format!("{} is refused:\n  {}", model.export_type().name(), models::explained(error));
        model.check(&request.specimen, &limits).map_err(named)?;
    }
    let resume = stored
        .map(|stored| resume::state(&checkpoint, &options.job, &packing_request, &stored))
        .transpose()?;
    if resume.is_none() && !options.fresh && checkpoint.exists() {
        return Err(format!(
            "{} is left from a run that was stopped: go on from it by --resume, or discard it by --fresh",
            checkpoint.display()
        )
        .into());
    }
    // Before the work, not after it: a folder that cannot be made would waste it.
    std::fs::create_dir_all(&options.out)
        .map_err(|error| format!("{} cannot be made: {error}", options.out.display()))?;
    if options.fresh {
        discard(&checkpoint)?;
    }
    let watch = Watch::new(
        checkpoint.clone(),
        Duration::from_secs_f64(options.checkpoint_every_s),
        resume.is_some(),
    )?;
    let packing = packstone_engine::pack_or_resume(&packing_request, &limits, resume, &watch);
    watch.finish();
    let packing = match packing {
        Ok(packing) => packing,
        Err(PackError::Stopped { placed, grains }) => {
            return Err(stopped(&checkpoint, placed, grains).into());
        }
        Err(PackError::Plan(error)) => return Err(refused(&options.job, error).into()),
        Err(ended) => {
            // An answer, which going on would only repeat.
            discard(&checkpoint)?;
            return Err(ended.to_string().into());
        }
    };
    let summary = &packing.report.summary;
    eprintln!(
        "placed {} grains, volume fraction {:.4}, in {:.2} s (seed {})",
        summary.grains, summary.volume_fraction_effective, packing.report.timings_s.total, request.seed
    );
    // Those of the plan have been printed before the run.
    for warning in packing.report.warnings.iter().filter(|warning| !plan.warnings.contains(warning)) {
        eprintln!("warning: {warning}");
    }
    let head = Head {
        job_id: None,
        request: serde_json::to_value(&request)?,
        engine: EngineInfo::current(),
        report: packing.report,
    };
    let formats = options.format.iter().filter_map(|output| match output {
        Output::Grains(format) => Some(format),
        Output::Model(_) => None,
    });
    for format in formats {
        let file = options.out.join(format!("result.{}", format.name()));
        write(&file, *format, &head, &packing.spheres)
            .map_err(|error| format!("{} cannot be written: {error}", file.display()))?;
        print(&format!("{}\n", file.display()))?;
    }
    let model = Model { specimen: &request.specimen, spheres: &packing.spheres };
    models::write_all(&models, &model, &limits, &options.out, watch.stop())?;
    for kind in &options.plot {
        let file = options.out.join(format!("plot-{}.svg", kind.name()));
        let result = JobResult { head: &head, spheres: &packing.spheres };
        plot(*kind, &result, &file)
            .map_err(|error| format!("{} cannot be written: {error}", file.display()))?;
        print(&format!("{}\n", file.display()))?;
    }
    discard(&checkpoint)
}

/// What is to be made of the packing: by the command's formats, then by the job.
fn models_of(options: &Options, request: &JobRequest) -> Vec<ExportRequest> {
    let by_format = options.format.iter().filter_map(|output| match output {
        Output::Grains(_) => None,
        Output::Model(export) => Some(export.clone()),
    });
    let by_job = request.postprocess.items().into_iter().map(|(_, export)| export.clone());
    let mut models: Vec<ExportRequest> = Vec::new();
    for model in by_format.chain(by_job) {
        if !models.contains(&model) {
            models.push(model);
        }
    }
    models
}

fn stopped(checkpoint: &Path, placed: u64, grains: u64) -> String {
    if checkpoint.exists() {
        format!("stopped on request; go on from {} by --resume", checkpoint.display())
    } else {
        format!("stopped on request before the first checkpoint, after {placed} of {grains} grains")
    }
}

fn discard(checkpoint: &Path) -> Result<(), Failure> {
    checkpoints::remove(checkpoint)
        .map_err(|error| format!("{} cannot be removed: {error}", checkpoint.display()).into())
}

fn refused(job: &Path, error: PlanError) -> String {
    match error {
        PlanError::Invalid(faults) => listed(job, &faults),
        PlanError::TooLarge(fault) | PlanError::Infeasible(fault) | PlanError::Coarse(fault) => {
            listed(job, &[fault])
        }
    }
}

pub(super) fn read(job: &Path) -> Result<Vec<u8>, Failure> {
    let mut text = Vec::new();
    let read = if job.as_os_str() == "-" {
        std::io::stdin().lock().read_to_end(&mut text)
    } else {
        File::open(job).and_then(|mut file| file.read_to_end(&mut text))
    };
    read.map_err(|error| format!("{} cannot be read: {error}", job.display()))?;
    Ok(text)
}

pub(super) fn listed(job: &Path, faults: &[FieldError]) -> String {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    format!("{} is refused:\n  {}", job.display(), lines.join("\n  "))
}

pub(super) fn write(
    file: &Path,
    format: Format,
    head: &Head,
    spheres: &packstone_engine::Spheres,
) -> std::io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, File::create(file)?);
    tables::write(format, head, spheres, &mut out)?;
    out.flush()
}

fn plot(kind: JobPlot, result: &JobResult<'_>, file: &Path) -> std::io::Result<()> {
    let chart = job::chart(kind, result)?;
    std::fs::write(file, draw::svg(&chart).map_err(std::io::Error::other)?)
}
