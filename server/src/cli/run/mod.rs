//! `packstone run`: one job without a service, its result as files.

mod examples;
mod resume;
mod watch;

use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;
use clap::builder::{ArgPredicate, PossibleValuesParser, TypedValueParser as _};
use packstone_engine::export::tables::{EngineInfo, Head};
use packstone_engine::export::{ExportRequest, Model, Provenance};
use packstone_engine::{FieldError, Grains, Limits, PackError, Packing, PlanError, Resume, TemplateCache};

use super::exit::{Exit, Failure, cannot_be};
use super::exports::{self, MaterialsFile, Output, PICTURE};
use super::input::Input;
use super::signals::stop_on_signals;
use super::solve::Deck;
use super::{print_files, solve};
use crate::atomic_file::write_buffered;
use crate::config::{DEFAULT_CHECKPOINT_EVERY_S, limits_of_one_packing, seconds_or_none};
use crate::exports::distance_kept;
use crate::formats::ResultFormat;
use crate::gmsh::{self, GmshOptions};
use crate::jobs::{JobRequest, request};
use crate::plots::job::{self, JobPlot, JobResult};
use crate::plots::{PlotError, draw};
use crate::telemetry::say;
use examples::Example;
use watch::Watch;

/// Options of `packstone run`.
#[derive(Args)]
pub(super) struct Options {
    /// The job as JSON, as it would be submitted; `-` reads standard input
    #[arg(required = false, required_unless_present = "example")]
    #[arg(default_value_if("example", ArgPredicate::IsPresent, "request.json"))]
    job: PathBuf,
    /// In place of a job: an example of the gallery (docs/gallery.md), which is copied as request.json into the folder
    /// for the result, by default one of its name, and packed with a picture
    #[arg(long, value_name = "NAME", value_parser = examples::parser(), hide_possible_values = true)]
    #[arg(conflicts_with = "job")]
    example: Option<Example>,
    /// Folder for the result; made where it is missing
    #[arg(long, default_value = ".")]
    out: PathBuf,
    /// Formats of the table of grains; html is a page of its own with a viewer, to send by mail
    #[arg(long, value_delimiter = ',', default_value = "json", value_parser = format_parser())]
    format: Vec<ResultFormat>,
    /// An export of the result: mesh, voxels, slice, deck, ldpm, certificates, shapes, quality or properties, with
    /// options, as `voxels:format=raw,cells=200`; may be repeated
    #[arg(long, value_name = "TYPE[:OPTION=VALUE,...]", value_parser = exports::parse)]
    export: Vec<ExportRequest>,
    #[command(flatten)]
    materials: MaterialsFile,
    /// Plots of the result, as SVG
    #[arg(long, value_delimiter = ',', value_parser = plot_parser())]
    plot: Vec<JobPlot>,
    /// Draw plots without their title, for a journal that has it in the caption
    #[arg(long)]
    no_plot_titles: bool,
    /// Render a picture of the packing, as result.png
    #[arg(long)]
    picture: bool,
    /// Overwrite files that exist
    #[arg(long)]
    force: bool,
    /// Most grains of the packing
    #[arg(long, default_value_t = Limits::default().max_grains)]
    max_grains: u64,
    /// Threads that compute the packing, which does not depend on their number [default: `threads` of the job, or one
    /// for each core]
    #[arg(long, value_name = "NUMBER")]
    threads: Option<NonZeroUsize>,
    /// Make a deck with these options, run CalculiX on it, and compute the properties that follow, as
    /// `load=uniaxial_z,cells=60`; may be repeated. Stands for `--export deck:OPTIONS` and `packstone solve`
    #[arg(long, value_name = "OPTION=VALUE,...", num_args = 0..=1, default_missing_value = "", value_parser = solve::parse)]
    solve: Vec<ExportRequest>,
    #[command(flatten)]
    calculix: solve::Calculix,
    #[command(flatten)]
    gmsh: GmshOptions,
    #[command(flatten)]
    input: Input,
    #[command(flatten)]
    earlier: Earlier,
    /// Seconds between two checkpoints; 0 keeps one at every opportunity
    #[arg(long, default_value_t = DEFAULT_CHECKPOINT_EVERY_S, value_parser = seconds_or_none)]
    checkpoint_every_s: f64,
}

/// What to do with what an earlier run left.
#[derive(Args)]
struct Earlier {
    /// Go on with a run that was stopped or killed at any moment: from its checkpoint, which lies in the folder for the
    /// result, or with the files that were not written; a run without these starts anew. A partial result is gone on
    /// with and replaced, where only `method.stop`, `timeout_s` or `on_limit` of the job have changed
    #[arg(long)]
    resume: bool,
    /// Discard the checkpoint of an earlier run, and what it wrote of its result before it was killed
    #[arg(long, conflicts_with = "resume")]
    fresh: bool,
}

pub(super) fn format_parser() -> impl clap::builder::TypedValueParser<Value = ResultFormat> {
    PossibleValuesParser::new(ResultFormat::ALL.map(ResultFormat::name))
        .try_map(|name| ResultFormat::from_name(&name).ok_or("no such format"))
}

fn plot_parser() -> impl clap::builder::TypedValueParser<Value = JobPlot> {
    PossibleValuesParser::new(JobPlot::ALL.iter().map(|kind| kind.name()))
        .try_map(|name| JobPlot::ALL.iter().copied().find(|kind| kind.name() == name).ok_or("no such plot"))
}

impl Options {
    /// The same options for a copy of the example that they name, if they do.
    ///
    /// # Errors
    /// The copy cannot be written.
    fn of_example(mut self) -> Result<Self, Failure> {
        let Some(example) = self.example else { return Ok(self) };
        if self.out.as_os_str() == "." {
            self.out = PathBuf::from(example.name);
        }
        self.job = example.copied_to(&self.out)?;
        self.picture = true;
        Ok(self)
    }
}

pub(super) fn run(options: Options) -> Result<(), Failure> {
    let options = &options.of_example()?;
    // A run that was started without a seed goes on with the one that was drawn for it.
    let earlier = resume::Earlier::find(options)?;
    if options.earlier.resume && earlier.is_nothing() {
        say(&format!("there is no checkpoint {}: the run starts anew", earlier.checkpoint.display()));
    }
    let seed = earlier.seed().unwrap_or_else(request::draw_seed);
    let request = read_job(&options.input, &options.job, seed)?;
    let packing_request = request.packing();
    let of_one = limits_of_one_packing(options.max_grains);
    let threads = options.threads.or(request.threads()).unwrap_or(of_one.threads);
    let limits = Limits { threads, ..of_one };
    // The plan and the run draw the templates of angular grains once.
    let templates = TemplateCache::default();
    let plan = templates.plan(&packing_request, &limits).map_err(|error| refused(&options.job, &error))?;
    warn(&plan.warnings);
    gmsh::set(options.gmsh.clone());
    let files = Files::of(options, &request)?;
    for output in &files.exports {
        output.check(&packing_request, &limits)?;
    }
    if !options.solve.is_empty() {
        options.calculix.find()?;
    }
    for (kind, file) in &files.plots {
        job::check(*kind, &packing_request).map_err(|error| not_drawn(file, error))?;
    }
    // Before the work, not after it: a folder that cannot be made would waste it.
    let all = files.all();
    let (resume, kept) = earlier.check(options, &request, &all)?;
    if kept.is_all(&all) {
        say(&format!("the result in {} is complete: nothing is left to do", options.out.display()));
        print_files(&all)?;
        return solve_decks(options, &files.exports, true, None);
    }
    exports::announce_planned(&files.exports, &packing_request, &plan);
    std::fs::create_dir_all(&options.out).map_err(|error| cannot_be("made", &options.out, &error))?;
    if options.earlier.fresh || earlier.is_replaced(options) {
        earlier.discard()?;
    }
    let every = Duration::from_secs_f64(options.checkpoint_every_s);
    let watch = Watch::new(&request, &earlier.checkpoint, every, resume.is_some())?;
    let packing = pack(options, &request, (&limits, &templates), resume, &watch, &earlier)?;
    let is_partial = packing.report.summary.partial.is_some();
    let summary = &packing.report.summary;
    say(&format!(
        "placed {} grains, volume fraction {:.4}, in {:.2} s (seed {})",
        summary.grains, summary.volume_fraction_effective, packing.report.timings_s.total, request.seed
    ));
    // Those of the plan have been printed before the run.
    let new: Vec<String> =
        packing.report.warnings.iter().filter(|warning| !plan.warnings.contains(warning)).cloned().collect();
    warn(&new);
    earlier.unfinished.begin(&all, Some(serde_json::to_value(&request)?))?;
    let undrawn = files.write(&request, packing, &limits, &watch, &kept)?;
    if is_partial {
        // The checkpoint and the record of the files stay: a run with higher limits goes on and replaces them.
        earlier.unfinished.end_partial(&all, Some(serde_json::to_value(&request)?))?;
    } else {
        earlier.discard_checkpoint()?;
        earlier.unfinished.end()?;
    }
    print_files(all.iter().filter(|file| file.exists()))?;
    solve_decks(options, &files.exports, false, Some(watch.stop()))?;
    undrawn.map_or(Ok(()), Err)
}

/// Runs CalculiX on the decks of `--solve`; on those that have no results yet where the run was complete before.
fn solve_decks(
    options: &Options,
    outputs: &[Output],
    only_unsolved: bool,
    stop: Option<&Arc<AtomicBool>>,
) -> Result<(), Failure> {
    let decks = outputs.iter().filter(|output| options.solve.contains(&output.export));
    let decks: Vec<Deck> = decks.map(|output| Deck::at(&output.file, None)).collect();
    let due: Vec<&Deck> = decks.iter().filter(|deck| !(only_unsolved && deck.is_solved())).collect();
    if due.is_empty() {
        return Ok(());
    }
    let stop = stop.map_or_else(stop_on_signals, |stop| Ok(Arc::clone(stop)))?;
    for deck in due {
        // A run that goes on replaces the results of the packing that it replaced.
        let force = options.force || options.earlier.resume;
        deck.solve(&options.calculix, force, &stop)?.print()?;
    }
    Ok(())
}

/// Packs, and removes the checkpoint where going on from it would only repeat the answer.
fn pack(
    options: &Options,
    job: &JobRequest,
    (limits, templates): (&Limits, &TemplateCache),
    resume: Option<Resume>,
    watch: &Watch,
    earlier: &resume::Earlier,
) -> Result<Packing, Failure> {
    let packing = packstone_engine::pack_or_resume(&job.packing(), limits, templates, resume, watch);
    watch.finish();
    packing.or_else(|error| {
        let exit = Exit::of_packing(&error);
        let timed_out = watch.timed_out(job).filter(|_| matches!(error, PackError::Stopped { .. }));
        if let Some(failure) = timed_out {
            let more = if earlier.checkpoint.exists() {
                format!("; with more time it goes on from {} by --resume", earlier.checkpoint.display())
            } else {
                String::new()
            };
            return Err(Exit::TargetNotReached.because(failure.detail + &more));
        }
        match error {
            PackError::Stopped { placed, grains } => {
                Err(exit.because(stopped(&earlier.checkpoint, placed, grains)))
            }
            PackError::Plan(error) => Err(refused(&options.job, &error)),
            ended => {
                // That of a partial result stays: a run with other limits goes on from it.
                if !earlier.is_partial() {
                    earlier.discard_checkpoint()?;
                }
                Err(exit.because(ended))
            }
        }
    })
}

/// The files that a run writes.
struct Files {
    grains: Vec<(ResultFormat, PathBuf)>,
    exports: Vec<Output>,
    plots: Vec<(JobPlot, PathBuf)>,
    plot_titles: bool,
    picture: Option<PathBuf>,
}

impl Files {
    /// Those that the options ask for, then those that the job asks for.
    fn of(options: &Options, request: &JobRequest) -> Result<Self, Failure> {
        let exports = options
            .materials
            .given_to(options.export.iter().chain(&options.solve).chain(request.exports()), &options.input)?;
        let named = |name: String| options.out.join(name);
        Ok(Self {
            grains: options.format.iter().map(|&f| (f, named(format!("result.{}", f.name())))).collect(),
            exports: Output::all(exports, &options.out),
            plots: options
                .plot
                .iter()
                .map(|&plot| (plot, named(format!("plot-{}.svg", plot.name()))))
                .collect(),
            plot_titles: !options.no_plot_titles,
            picture: options.picture.then(|| named(PICTURE.into())),
        })
    }

    fn all(&self) -> Vec<PathBuf> {
        let grains = self.grains.iter().map(|(_, file)| file.clone());
        let plots = self.plots.iter().map(|(_, file)| file.clone());
        grains
            .chain(self.exports.iter().flat_map(Output::files))
            .chain(plots)
            .chain(self.picture.clone())
            .collect()
    }

    /// Writes all of them but those that stay. Returns why a plot was not drawn, if one was not.
    ///
    /// # Errors
    /// A file cannot be written, or one that stays is of another packing.
    fn write(
        &self,
        request: &JobRequest,
        packing: Packing,
        limits: &Limits,
        watch: &Watch,
        kept: &resume::Kept,
    ) -> Result<Option<Failure>, Failure> {
        let head = Head {
            job_id: None,
            request: serde_json::to_value(request)?,
            engine: EngineInfo::current(),
            report: packing.report,
        };
        for (format, file) in self.grains.iter().filter(|(_, file)| kept.has(file)) {
            kept.compare(file, *format, |with| format.write(&head, &packing.grains, with))?;
        }
        for (format, file) in self.grains.iter().filter(|(_, file)| !kept.has(file)) {
            write(file, *format, &head, &packing.grains)
                .map_err(|error| cannot_be("written", file, &error))?;
        }
        let provenance = Provenance::from(&head);
        let model = Model::new(&request.specimen, &packing.grains)
            .with_distance(distance_kept(&head))
            .with_provenance(&provenance)
            .with_materials(request.materials.as_ref())
            .with_mesher(&gmsh::Installed);
        if let Some(file) = self.picture.as_ref().filter(|file| !kept.has(file)) {
            exports::write_picture(&model, file, limits.export_threads, watch.stop())?;
        }
        let exports = self.exports.iter().filter(|output| !output.files().all(|file| kept.has(&file)));
        exports::write_all(exports, &model, limits, watch.checkpoint_every(), watch.stop())?;
        // The plots that the packing has are written before one that it does not have ends the command.
        let mut undrawn = None;
        for (kind, file) in self.plots.iter().filter(|(_, file)| !kept.has(file)) {
            let result = JobResult { head: &head, grains: &packing.grains };
            match plot(*kind, &result, self.plot_titles, file) {
                Ok(()) => {}
                Err(error @ PlotError::NotAvailable(_)) => undrawn = undrawn.or(Some(not_drawn(file, error))),
                Err(error) => return Err(not_drawn(file, error)),
            }
        }
        Ok(undrawn)
    }
}

fn stopped(checkpoint: &Path, placed: u64, grains: u64) -> String {
    if checkpoint.exists() {
        format!("stopped on request; go on from {} by --resume", checkpoint.display())
    } else {
        format!("stopped on request before the first checkpoint, after {placed} of {grains} grains")
    }
}

/// Reads a job; `seed` is for one that states none.
pub(super) fn read_job(input: &Input, job: &Path, seed: u64) -> Result<JobRequest, Failure> {
    JobRequest::read(&input.json(job)?, seed, None)
        .map_err(|faults| Exit::BadInput.because(listed(job, &faults)))
}

/// Tells of what is likely to go wrong.
pub(super) fn warn(warnings: &[String]) {
    for warning in warnings {
        say(&format!("warning: {warning}"));
    }
}

/// The failure of a job that cannot be planned.
pub(super) fn refused(job: &Path, error: &PlanError) -> Failure {
    let text = match error {
        PlanError::Invalid(faults) => listed(job, faults),
        PlanError::TooLarge(fault) | PlanError::Infeasible(fault) | PlanError::Coarse(fault) => {
            listed(job, std::slice::from_ref(fault))
        }
    };
    Exit::BadInput.because(text)
}

pub(super) fn listed(job: &Path, faults: &[FieldError]) -> String {
    let lines: Vec<String> = faults.iter().map(ToString::to_string).collect();
    format!("{} is refused:\n  {}", job.display(), lines.join("\n  "))
}

pub(super) fn write(file: &Path, format: ResultFormat, head: &Head, grains: &Grains) -> std::io::Result<()> {
    write_buffered(file, |out| format.write(head, grains, out))
}

fn plot(kind: JobPlot, result: &JobResult<'_>, heading: bool, file: &Path) -> Result<(), PlotError> {
    let chart = job::chart(kind, result)?;
    let drawn = draw::svg(&chart, heading)?;
    Ok(write_buffered(file, |out| out.write_all(drawn.as_bytes()))?)
}

fn not_drawn(file: &Path, error: PlotError) -> Failure {
    match error {
        PlotError::NotAvailable(reason) => {
            Exit::BadInput.because(format_args!("{} was not made: {reason}", file.display()))
        }
        PlotError::Failed(error) => cannot_be("written", file, &error),
    }
}
