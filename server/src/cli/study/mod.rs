//! `packstone study`: a study without a service, its table and plots as files.
//!
//! `worker_pool` runs the jobs on as many threads as there are workers, `run_log` stores a record of every run that
//! ended, `watch` shows the progress at the terminal, `report` writes and prints the table and the plots. `shards` runs
//! a part of a study beside other processes, `merge` makes the table of all parts, `script` writes the script that has
//! Slurm run them. The study itself and the contents of its table are defined in `crate::studies`.

mod additions;
mod merge;
mod report;
mod run_log;
mod script;
mod shards;
mod summed_lines;
mod watch;
mod worker_pool;

use std::collections::VecDeque;
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

use clap::Args;
use packstone_engine::Limits;

use super::exit::{Exit, Failure, is_closed_pipe};
use super::input::Input;
use super::run::{format_parser, listed};
use super::signals::stop_on_signals;
use super::{print, print_files};
use crate::checkpoints::Checkpoints;
use crate::config::{
    DEFAULT_CHECKPOINT_EVERY_S, cores, default_memory_bytes, seconds_or_none, threads_of_one,
};
use crate::formats::ResultFormat;
use crate::gmsh::{self, GmshOptions};
use crate::jobs::request::draw_seed;
use crate::studies::shards::Shard;
use crate::studies::stop::Tally;
use crate::studies::table::Rest;
use crate::studies::{Outcome, Run, Study, Table};
use crate::telemetry::say;
use additions::Additions;
use run_log::{Folder, RunLog, RunRecord, StudyRecord};
use script::Width;
use shards::claims::Claims;
use shards::files;
use watch::Watch;
use worker_pool::{Ended, Message, SharedState, WorkerPool};

/// Interval of updates of the bar while no run ends.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Options of `packstone study`.
#[derive(Args)]
pub(super) struct Options {
    /// The study as JSON, as it would be submitted; `-` reads standard input
    study: PathBuf,
    /// Folder for the runs, the table and the plots; made where it is missing
    #[arg(long)]
    out: PathBuf,
    /// Packings at once [default: the number of cores]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    workers: Option<u16>,
    /// Threads that compute one packing, which does not depend on their number; a job with `threads` has no more than
    /// these [default: one for each core, shared by the packings at once]
    #[arg(long, value_name = "NUMBER")]
    threads: Option<NonZeroUsize>,
    /// Formats in which every packing is kept below `results`; none is when absent
    #[arg(long = "format", alias = "formats", value_delimiter = ',', value_parser = format_parser())]
    formats: Vec<ResultFormat>,
    #[command(flatten)]
    additions: Additions,
    /// Most grains of one packing
    #[arg(long, default_value_t = Limits::default().max_grains)]
    max_grains: u64,
    /// Go on with a study that was stopped or killed; its runs lie in the folder
    #[arg(long)]
    resume: bool,
    /// Draw plots without their title, for a journal that has it in the caption
    #[arg(long)]
    no_plot_titles: bool,
    /// Discard the runs of an earlier study in the folder
    #[arg(long, conflicts_with = "resume")]
    fresh: bool,
    #[command(flatten)]
    parts: Parts,
    #[command(flatten)]
    gmsh: GmshOptions,
    #[command(flatten)]
    input: Input,
    /// Seconds between two checkpoints of a long run; 0 keeps one at every opportunity
    #[arg(long, default_value_t = DEFAULT_CHECKPOINT_EVERY_S, value_parser = seconds_or_none)]
    checkpoint_every_s: f64,
}

/// A study in parts, instead of as a whole.
#[derive(Args)]
struct Parts {
    /// Run only the points of shard I of N, counted from 0, into a folder that the shards share; goes on where
    /// earlier shards ended
    #[arg(long, value_name = "I/N", conflicts_with_all = ["fresh", "merge", "slurm_script"])]
    shard: Option<Shard>,
    /// Write the table and the plots of a study that shards have run
    #[arg(long, conflicts_with_all = ["fresh", "resume", "slurm_script"])]
    merge: bool,
    /// Print a script that has Slurm run the study as an array of so many jobs and then merge it; without a WIDTH, or
    /// with auto, by the forecast
    #[arg(
        long, value_name = "WIDTH", num_args = 0..=1, default_missing_value = "auto",
        conflicts_with_all = ["fresh", "resume", "materials", "export"]
    )]
    slurm_script: Option<Width>,
}

impl Options {
    fn checkpoints(&self) -> PathBuf {
        self.out.join("checkpoints")
    }

    fn results(&self) -> PathBuf {
        self.out.join("results")
    }

    fn workers(&self) -> usize {
        self.workers.map_or_else(|| cores().get(), usize::from)
    }
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    gmsh::set(options.gmsh.clone());
    match (options.parts.shard, options.parts.slurm_script) {
        (Some(shard), _) => shards::run(options, shard),
        (None, Some(width)) => script::run(options, width),
        (None, None) if options.parts.merge => merge::run(options),
        (None, None) => run_all(options),
    }
}

fn run_all(options: &Options) -> Result<(), Failure> {
    let request = read_request(options)?;
    let folder = Folder(&options.out);
    let stored = if options.fresh { None } else { folder.record()? };
    let shards = options.out.join(files::FOLDER);
    match (&stored, options.resume) {
        _ if !options.fresh && shards.exists() => {
            return Err(Exit::BadInput.because(format_args!(
                "{} holds the runs of shards: go on with them by --shard 0/1, make their table by --merge, or discard \
                 them by --fresh",
                options.out.display()
            )));
        }
        (Some(_), false) => {
            return Err(Exit::BadInput.because(format_args!(
                "{} holds the runs of a study: go on with it by --resume, or discard them by --fresh",
                options.out.display()
            )));
        }
        // Stopped before the study was recorded, or never begun.
        (None, true) => say(&format!("there is no study in {}: it starts anew", options.out.display())),
        _ => {}
    }
    let limits = limits(options);
    let study = expand(options, &request, stored.as_ref(), &limits)?;
    let record = StudyRecord::new(&study, &request)?;
    if let Some(stored) = &stored {
        stored.check(&record, &options.out, &options.study)?;
    }
    if options.fresh {
        discard_checkpoints(&options.checkpoints())?;
        discard_shards(&shards)?;
    }
    let (log, records) = folder.open(&study, &record, options.fresh)?;
    let mut done = Done::new(&study, Log::OfStudy(log), records);
    let queue = done.queue();
    let ended = done.run_rest(options, queue, options.workers().min(study.jobs()), limits);
    // The results are written and printed also where the study was stopped.
    done.log.sync()?;
    let table = done.table();
    let written = report::write(&options.out, &study, &table, &done.records, !options.no_plot_titles)?;
    let stopped = ended?;
    let waiting: u64 = table.rows.iter().map(|row| row.cells.waiting).sum();
    if waiting == 0 {
        // Of runs that were killed, and that a stop rule has made superfluous since.
        discard_checkpoints(&options.checkpoints())?;
    }
    print_table(&table, &written)?;
    if stopped && waiting > 0 {
        return Err(Exit::Interrupted.because(format_args!(
            "stopped on request with {waiting} of {} jobs not done; go on by --resume",
            study.jobs()
        )));
    }
    Ok(())
}

/// Prints the table and the names of the files. A reader that has left does not make the command fail.
fn print_table(table: &Table, files: &[PathBuf]) -> Result<(), Failure> {
    match print(&report::table(table)) {
        Err(failure) if is_closed_pipe(&failure) => Ok(()),
        printed => printed.and_then(|()| print_files(files)),
    }
}

/// Reads the study, with what the command line adds to its jobs.
fn read_request(options: &Options) -> Result<serde_json::Value, Failure> {
    let mut request = options.input.json(&options.study)?;
    options.additions.add_to(&mut request, &options.input)?;
    Ok(request)
}

fn limits(options: &Options) -> Limits {
    let max_memory_bytes = default_memory_bytes(options.workers());
    let shared = threads_of_one(options.workers());
    Limits {
        max_grains: options.max_grains,
        max_memory_bytes,
        max_model_bytes: max_memory_bytes,
        max_voxel_file_bytes: u64::MAX,
        threads: options.threads.unwrap_or(shared),
        export_threads: shared,
    }
}

/// The limits where other machines pack, whose memory is not known.
fn limits_elsewhere(options: &Options) -> Limits {
    const MEMORY_BYTES: u64 = 1 << 50;
    Limits { max_memory_bytes: MEMORY_BYTES, max_model_bytes: MEMORY_BYTES, ..limits(options) }
}

/// Expands a request. A study that was started without a seed goes on with the one that was drawn for it.
fn expand(
    options: &Options,
    request: &serde_json::Value,
    stored: Option<&StudyRecord>,
    limits: &Limits,
) -> Result<Study, Failure> {
    let seed = stored.and_then(StudyRecord::seed).unwrap_or_else(draw_seed);
    Study::read(request, seed, None, limits)
        .map_err(|refusal| Exit::BadInput.because(listed(&options.study, &refusal.fields)))
}

/// Removes the logs of shards.
fn discard_shards(folder: &Path) -> io::Result<()> {
    if folder.exists() { std::fs::remove_dir_all(folder) } else { Ok(()) }
}

/// Removes the checkpoints of a study that is over, or of another one, and their folder. Nothing else in the folder is
/// touched.
fn discard_checkpoints(folder: &Path) -> io::Result<()> {
    if folder.exists() {
        for found in Checkpoints::open(folder.to_owned(), Duration::ZERO)?.list()? {
            Checkpoints::remove_found(&found)?;
        }
        let _ = std::fs::remove_dir(folder);
    }
    Ok(())
}

/// Where the runs are recorded.
enum Log<'a> {
    OfStudy(RunLog),
    OfShard(&'a Claims<'a>),
    /// Nowhere: they have been recorded.
    Merged,
}

impl Log<'_> {
    fn add(&mut self, record: &RunRecord) -> io::Result<()> {
        match self {
            Self::OfStudy(log) => log.add(record),
            Self::OfShard(claims) => claims.add(record),
            Self::Merged => Ok(()),
        }
    }

    fn sync(&mut self) -> io::Result<()> {
        match self {
            Self::OfStudy(log) => log.sync(),
            Self::OfShard(_) | Self::Merged => Ok(()),
        }
    }

    fn claims(&self) -> Option<&Claims<'_>> {
        match self {
            Self::OfShard(claims) => Some(claims),
            Self::OfStudy(_) | Self::Merged => None,
        }
    }
}

/// A study with the runs of it that have ended.
struct Done<'a> {
    study: &'a Study,
    log: Log<'a>,
    /// In the order in which they ended.
    records: Vec<RunRecord>,
    tallies: Vec<Tally>,
    /// Points that other processes run, and these processes.
    taken: Vec<(usize, String)>,
}

impl<'a> Done<'a> {
    /// Runs that do not count are repeated.
    fn new(study: &'a Study, log: Log<'a>, mut records: Vec<RunRecord>) -> Self {
        records.retain(|record| record.outcome != Outcome::Void);
        Self::with_void(study, log, records)
    }

    /// With runs that do not count, and are not to be repeated.
    fn with_void(study: &'a Study, log: Log<'a>, records: Vec<RunRecord>) -> Self {
        let mut tallies = vec![Tally::default(); study.points.len()];
        for record in &records {
            tallies[record.point].ended(record.outcome, &study.stop_when);
        }
        Self { study, log, records, tallies, taken: Vec::new() }
    }

    /// The jobs that are still to run, in their order.
    fn queue(&self) -> VecDeque<(usize, usize)> {
        let ended: std::collections::HashSet<(usize, usize)> =
            self.records.iter().map(|record| (record.point, record.replicate)).collect();
        let waits = |job: &(usize, usize)| !ended.contains(job) && !self.tallies[job.0].stopped;
        self.study.order().filter(waits).collect()
    }

    /// Runs jobs. Returns whether a signal stopped it.
    fn run_rest(
        &mut self,
        options: &Options,
        queue: VecDeque<(usize, usize)>,
        workers: usize,
        limits: Limits,
    ) -> Result<bool, Failure> {
        if queue.is_empty() {
            return Ok(false);
        }
        let (results, checkpoints) = (options.results(), options.checkpoints());
        if !options.formats.is_empty() {
            worker_pool::make_folder(&results)?;
        }
        let claims = match self.log {
            Log::OfShard(claims) => Some(claims),
            Log::OfStudy(_) | Log::Merged => None,
        };
        let stop = stop_on_signals()?;
        let pool = WorkerPool {
            study: self.study,
            limits,
            templates: packstone_engine::TemplateCache::default(),
            state: Mutex::new(SharedState::new(queue, self.tallies.clone())),
            stop: &stop,
            fractions: (0..workers).map(|_| AtomicU64::default()).collect(),
            checkpoints: Checkpoints::open(
                checkpoints.clone(),
                Duration::from_secs_f64(options.checkpoint_every_s),
            )?,
            results,
            formats: &options.formats,
            claims,
            stopped: OnceLock::new(),
        };
        let received = self.supervise(&pool, workers, &stop);
        // Not empty where runs were stopped, and then kept. Other shards may be about to write into it.
        if claims.is_none() {
            let _ = std::fs::remove_dir(checkpoints);
        }
        received?;
        Ok(stop.load(Ordering::Acquire))
    }

    /// Starts the threads and records the runs that they send until the last one has ended.
    fn supervise(&mut self, pool: &WorkerPool<'_>, workers: usize, stop: &AtomicBool) -> io::Result<()> {
        let mut watch = Watch::new(self.records.len());
        let (sender, receiver) = mpsc::channel();
        let mut result = Ok(());
        std::thread::scope(|scope| {
            for thread in 0..workers {
                let sender = sender.clone();
                scope.spawn(move || pool.work(thread, &sender));
            }
            drop(sender);
            loop {
                let received = match receiver.recv_timeout(LOOK_EVERY) {
                    Ok(received) => received.and_then(|message| self.receive(message, pool, &mut watch)),
                    Err(RecvTimeoutError::Timeout) => Ok(()),
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if let Err(error) = received
                    && result.is_ok()
                {
                    // No further run could be recorded either.
                    stop.store(true, Ordering::Release);
                    result = Err(error);
                }
                for point in self.log.claims().map(Claims::beat).unwrap_or_default() {
                    pool.leave(point);
                }
                watch.show(self.records.len(), self.successes(), pool);
            }
        });
        watch.finish();
        result
    }

    fn receive(&mut self, message: Message, pool: &WorkerPool<'_>, watch: &mut Watch) -> io::Result<()> {
        match message {
            Message::Ended(ended) => {
                pool.note_end();
                self.record(*ended, watch)
            }
            Message::Found(runs) => {
                watch.found(runs.len());
                for run in runs {
                    self.count(run);
                }
                Ok(())
            }
            Message::Taken { point, by } => {
                watch.say(&format!("point {point} is left to {by}, which runs it"));
                self.taken.push((point, by));
                Ok(())
            }
        }
    }

    fn record(&mut self, ended: Ended, watch: &Watch) -> io::Result<()> {
        let Ended { record, fault, is_last } = ended;
        if let Some(fault) = fault {
            watch.say(&format!(
                "warning: point {}, replicate {} does not count: {fault}",
                record.point, record.replicate
            ));
        }
        self.log.add(&record)?;
        if is_last && let Some(claims) = self.log.claims() {
            claims.release(record.point)?;
        }
        self.count(record);
        Ok(())
    }

    /// Counts a run, in the order in which the worker pool counted it.
    fn count(&mut self, record: RunRecord) {
        self.tallies[record.point].ended(record.outcome, &self.study.stop_when);
        self.records.push(record);
    }

    fn successes(&self) -> u64 {
        self.tallies.iter().map(|tally| tally.successes).sum()
    }

    fn table(&self) -> Table {
        let runs: Vec<Run> = self.records.iter().map(RunRecord::run).collect();
        let mut ended = vec![0; self.study.points.len()];
        for run in &runs {
            ended[run.point] += 1;
        }
        let rest = ended.iter().zip(&self.tallies).map(|(ended, tally)| {
            let left = self.study.replicates as u64 - ended;
            if tally.stopped {
                Rest { waiting: 0, stopped_early: left }
            } else {
                Rest { waiting: left, stopped_early: 0 }
            }
        });
        Table::new(&self.study.keys(), &runs, &rest.collect::<Vec<_>>())
    }
}
