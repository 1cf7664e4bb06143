//! `packstone run`: one job without a service, its result as files.

use std::fs::File;
use std::io::{BufWriter, IsTerminal as _, Read as _, Write as _};
use std::path::{Path, PathBuf};

use clap::{Args, builder::PossibleValuesParser, builder::TypedValueParser as _};
use indicatif::{ProgressBar, ProgressStyle};
use packstone_engine::format::{self, EngineInfo, Format, Head};
use packstone_engine::{Control, FieldError, Limits, PackError, Plan, PlanError, Progress};

use super::{Failure, print};
use crate::config::default_memory_bytes;
use crate::jobs::{JobRequest, request};
use crate::strict_json;

const STEPS: u64 = 1000;

/// Options of `packstone run`.
#[derive(Args)]
pub(super) struct Options {
    /// The job as JSON, as it would be submitted; `-` reads standard input
    job: PathBuf,
    /// Folder for the result; made where it is missing
    #[arg(long, default_value = ".")]
    out: PathBuf,
    /// Formats of the result
    #[arg(long, value_delimiter = ',', default_value = "json", value_parser = format_parser())]
    format: Vec<Format>,
    /// Most grains of the packing
    #[arg(long, default_value_t = Limits::default().max_grains)]
    max_grains: u64,
}

fn format_parser() -> impl clap::builder::TypedValueParser<Value = Format> {
    PossibleValuesParser::new(Format::ALL.map(Format::name))
        .try_map(|name| Format::from_name(&name).ok_or("no such format"))
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let value = strict_json::parse(&read(&options.job)?)
        .map_err(|problem| format!("{} is refused: {}", options.job.display(), problem.detail))?;
    let request = JobRequest::read(&value, request::draw_seed(), None)
        .map_err(|faults| listed(&options.job, &faults))?;
    let packing_request = request.packing();
    let limits = Limits { max_grains: options.max_grains, max_memory_bytes: default_memory_bytes(1) };
    let plan = Plan::new(&packing_request, &limits).map_err(|error| match error {
        PlanError::Invalid(faults) => listed(&options.job, &faults),
        PlanError::TooLarge(fault) | PlanError::Infeasible(fault) => listed(&options.job, &[fault]),
    })?;
    for warning in &plan.warnings {
        eprintln!("warning: {warning}");
    }
    // Before the work, not after it: a folder that cannot be made would waste it.
    std::fs::create_dir_all(&options.out)
        .map_err(|error| format!("{} cannot be made: {error}", options.out.display()))?;
    let bar = Bar::new();
    let packing = packstone_engine::pack(&packing_request, &limits, &bar);
    bar.0.finish_and_clear();
    let packing = packing.map_err(|error| match error {
        PackError::Plan(PlanError::Invalid(faults)) => listed(&options.job, &faults),
        other => other.to_string(),
    })?;
    let summary = &packing.report.summary;
    eprintln!(
        "placed {} grains, volume fraction {:.4}, in {:.2} s (seed {})",
        summary.grains, summary.volume_fraction_effective, packing.report.timings_s.total, request.seed
    );
    let head = Head {
        job_id: None,
        request: serde_json::to_value(&request)?,
        engine: EngineInfo::current(),
        report: packing.report,
    };
    for format in &options.format {
        let file = options.out.join(format!("result.{}", format.name()));
        write(&file, *format, &head, &packing.spheres)
            .map_err(|error| format!("{} cannot be written: {error}", file.display()))?;
        print(&format!("{}\n", file.display()))?;
    }
    Ok(())
}

fn read(job: &Path) -> Result<Vec<u8>, Failure> {
    let mut text = Vec::new();
    let read = if job.as_os_str() == "-" {
        std::io::stdin().lock().read_to_end(&mut text)
    } else {
        File::open(job).and_then(|mut file| file.read_to_end(&mut text))
    };
    read.map_err(|error| format!("{} cannot be read: {error}", job.display()))?;
    Ok(text)
}

fn listed(job: &Path, faults: &[FieldError]) -> String {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    format!("{} is refused:\n  {}", job.display(), lines.join("\n  "))
}

fn write(
    file: &Path,
    format: Format,
    head: &Head,
    spheres: &packstone_engine::Spheres,
) -> std::io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 18, File::create(file)?);
    format::write(format, head, spheres, &mut out)?;
    out.flush()
}

/// The engine's progress as a bar; nothing where standard error is no terminal.
struct Bar(ProgressBar);

impl Bar {
    fn new() -> Self {
        if !std::io::stderr().is_terminal() {
            return Self(ProgressBar::hidden());
        }
        let bar = ProgressBar::new(STEPS);
        if let Ok(style) = ProgressStyle::with_template("{elapsed_precise} [{bar:40}] {percent} % {msg}") {
            bar.set_style(style);
        }
        Self(bar)
    }
}

impl Control for Bar {
    fn report(&self, progress: &Progress) {
        self.0.set_position((progress.fraction * STEPS as f64) as u64);
        if self.0.is_hidden() {
            return;
        }
        self.0.set_message(format!("{}/{} {}", progress.done, progress.total, progress.unit));
    }

    fn should_stop(&self) -> bool {
        false
    }
}
