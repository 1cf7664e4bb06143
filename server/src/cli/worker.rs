//! `packstone worker`: runs jobs of a server on this machine.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use jiff::{SignedDuration, Timestamp};
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinSet;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::block_on;
use super::exit::{Exit, Failure, cannot_be};
use super::process::Process;
use crate::artifacts::Artifacts;
use crate::checkpoints::Checkpoints;
use crate::config::{DEFAULT_CHECKPOINT_EVERY_S, seconds_or_none};
use crate::disk::{Disk, Shortage};
use crate::exports::making::Exports;
use crate::gmsh::{self, GmshOptions};
use crate::memory;
use crate::metrics::Metrics;
use crate::service::{StartError, lock};
use crate::tasks;
use crate::telemetry::{self, LogFormat};
use crate::workers::documents::{MAX_NAME_CHARS, MAX_SLOTS};
use crate::workers::executor::Executor;
use crate::workers::in_slots::InSlots;
use crate::workers::packing::{Packings, Source};
use crate::workers::probe;
use crate::workers::slots::Slots;
use crate::workers::there::{Server, There, WorkerOptions};

/// How long before the end of its time a worker stops: for the last checkpoints, and to send them.
const STOP_BEFORE: Duration = Duration::from_mins(1);
/// Time for the executors to end after that.
const STOP_RUNS: Duration = Duration::from_secs(55);
/// Time between two checkpoints that are sent to the server, by default.
const SEND_CHECKPOINTS_EVERY_S: f64 = 600.0;
/// What a shell reports of a process that an interrupt ended.
const INTERRUPTED: i32 = 130;

/// Options of `packstone worker`.
#[derive(Args)]
pub(super) struct Options {
    /// URL of the server, as `http://10.0.0.5:8080` or `https://packstone.example`
    #[arg(long, env = "PACKSTONE_SERVER", value_name = "URL")]
    server: String,
    /// File with an API key of the role `worker` (see `packstone key`), read again when the server refuses the key;
    /// none where the server asks for no keys
    #[arg(long, env = "PACKSTONE_KEY_FILE", value_name = "FILE")]
    key_file: Option<PathBuf>,
    /// Jobs that run at once, of which one with several threads counts as so many [default: the number of cores, in a
    /// job of Slurm of those that it was given]
    #[arg(long, env = "PACKSTONE_SLOTS", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SLOTS)))]
    slots: Option<u32>,
    /// Name by which the server shows this worker [default: process, host and job of Slurm]
    #[arg(long, env = "PACKSTONE_WORKER_NAME", value_parser = name)]
    name: Option<String>,
    /// Folder for checkpoints, for results until they are sent, and for the files of Gmsh; this worker's alone, emptied
    /// at its start [default: one in the folder for temporary files]
    #[arg(long, env = "PACKSTONE_SCRATCH", value_name = "FOLDER")]
    scratch: Option<PathBuf>,
    /// When this worker must have ended: a time as 2026-11-22T20:00:00Z, a duration from now as 8h or 90m, or `auto`
    /// for the time limit of the job of Slurm; it stops a minute before, and gets no job whose work would be lost then
    #[arg(long, env = "PACKSTONE_UNTIL", value_name = "TIME")]
    until: Option<String>,
    /// End when there was no job for so many seconds
    #[arg(long, env = "PACKSTONE_IDLE_EXIT_S", value_parser = seconds_or_none, value_name = "SECONDS")]
    idle_exit_s: Option<f64>,
    /// Seconds between two checkpoints of a running job on this machine; 0 keeps one at every opportunity
    #[arg(long, env = "PACKSTONE_CHECKPOINT_EVERY_S", default_value_t = DEFAULT_CHECKPOINT_EVERY_S, value_parser = seconds_or_none)]
    checkpoint_every_s: f64,
    /// Seconds between two checkpoints of a running job that are sent to the server, from which it goes on if this
    /// machine dies
    #[arg(long, env = "PACKSTONE_SEND_CHECKPOINTS_EVERY_S", default_value_t = SEND_CHECKPOINTS_EVERY_S, value_parser = seconds_or_none)]
    send_checkpoints_every_s: f64,
    #[command(flatten)]
    gmsh: GmshOptions,
    /// Form of the log lines on standard error
    #[arg(long, env = "PACKSTONE_LOG_FORMAT", value_enum, default_value_t)]
    log_format: LogFormat,
}

fn name(text: &str) -> Result<String, String> {
    let length = text.chars().count();
    if length == 0 || length > MAX_NAME_CHARS || text.chars().any(char::is_control) {
        return Err(format!("must be one line of 1 to {MAX_NAME_CHARS} characters"));
    }
    Ok(text.to_owned())
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    telemetry::start(options.log_format, "info");
    let server = Server::new(&options.server, options.key_file.as_deref())
        .map_err(|fault| Exit::BadInput.because(fault))?;
    let until = options.until.as_deref().map(end_of_time).transpose()?;
    let slots = options.slots.unwrap_or_else(cores);
    let name = options
        .name
        .clone()
        .unwrap_or_else(|| Process::current().to_string().chars().take(MAX_NAME_CHARS).collect());
    let temporary = if options.scratch.is_none() { Some(Temporary::make()?) } else { None };
    let scratch = options.scratch.clone().or_else(|| Some(temporary.as_ref()?.0.clone())).unwrap_or_default();
    std::fs::create_dir_all(&scratch).map_err(|error| cannot_be("made", &scratch, &error))?;
    let _lock = lock(&scratch).map_err(|error| match error {
        StartError::Locked(folder) => {
            let text = format!("{} is in use by another worker: name another --scratch", folder.display());
            Exit::BadInput.because(text)
        }
        error => error.into(),
    })?;
    let of_gmsh = scratch.join("gmsh");
    remove_left_over(&of_gmsh)?;
    std::fs::create_dir_all(&of_gmsh).map_err(|error| cannot_be("made", &of_gmsh, &error))?;
    gmsh::set(options.gmsh.clone());
    gmsh::set_folder(of_gmsh);
    let mesher = gmsh::version();
    let bits = probe::bits()?;
    let send_checkpoints_every = Duration::from_secs_f64(options.send_checkpoints_every_s.max(0.1));
    let worker = WorkerOptions {
        name,
        bits,
        mesher,
        send_checkpoints_every,
        until,
        idle: options.idle_exit_s.map(Duration::from_secs_f64),
    };
    let every = Duration::from_secs_f64(options.checkpoint_every_s);
    block_on(work(server, worker, &scratch, every, slots))
}

/// Runs jobs until the process is asked to stop, its time is over, or the server refuses it.
async fn work(
    server: Server,
    options: WorkerOptions,
    scratch: &Path,
    checkpoint_every: Duration,
    slots: u32,
) -> Result<(), Failure> {
    let made = |error: std::io::Error| cannot_be("made", scratch, &error);
    let (results, checkpoints) = (scratch.join("artifacts"), scratch.join("checkpoints"));
    for left_over in [&results, &checkpoints] {
        remove_left_over(left_over)?;
    }
    let artifacts = Artifacts::scratch(scratch).map_err(made)?;
    let checkpoints = Checkpoints::open(checkpoints, checkpoint_every).map_err(made)?;
    let shutdown = CancellationToken::new();
    stop_on_signals(shutdown.clone())?;
    let mesher = options.mesher.as_deref().unwrap_or("none");
    tracing::info!(name = options.name, slots, scratch = %scratch.display(), mesher, "working");
    let until = options.until;
    let disk = Disk::new(scratch.to_owned(), None, Shortage::default());
    let there = There::new(server, options, artifacts.clone(), checkpoints.clone(), disk.clone());
    let (source, metrics) = (Source::There(there.clone()), Arc::new(Metrics::default()));
    let exports = Exports::in_slots(
        source.clone(),
        artifacts.clone(),
        checkpoints.clone(),
        disk.clone(),
        Arc::clone(&metrics),
        0,
    );
    let packings = Packings { source, artifacts, checkpoints, disk, metrics, templates: Arc::default() };
    let kind = InSlots { packings, exports, slots: Slots::new(slots as usize) };
    let executor = Executor { kind, shutdown: shutdown.clone() };
    tasks::spawn(memory::release_regularly(shutdown.clone()));
    tasks::spawn(there.clone().keep_renewing());
    tasks::spawn(there.clone().keep_sending_checkpoints());
    let mut executors: JoinSet<()> = JoinSet::new();
    for _ in 0..slots {
        let run: tasks::Boxed<()> = Box::pin(executor.clone().work());
        executors.spawn(run);
    }
    let ended = async {
        while let Some(ended) = executors.join_next().await {
            if let Err(error) = ended {
                tracing::error!(%error, "a slot ended by a defect of this program");
            }
        }
    };
    let stopped = async {
        tokio::select! {
            () = shutdown.cancelled() => {}
            () = over(until) => {
                tracing::info!("the time of this worker is over");
                shutdown.cancel();
            }
        }
        tokio::time::sleep(STOP_RUNS).await;
    };
    tokio::select! {
        () = ended => {}
        () = stopped => tracing::error!("a run did not stop in time; its lease runs out"),
    }
    if let Some(refusal) = there.refusal() {
        return Err(Exit::Refused.because(refusal));
    }
    tracing::info!("ended");
    Ok(())
}

/// Removes a folder that an earlier worker has left.
fn remove_left_over(folder: &Path) -> Result<(), Failure> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(cannot_be("removed", folder, &error))
        }
        _ => Ok(()),
    }
}

/// The cores that this process may use.
fn cores() -> u32 {
    let of_machine = std::thread::available_parallelism().map_or(1, |cores| cores.get() as u32);
    let of_slurm = std::env::var("SLURM_CPUS_ON_NODE").ok().and_then(|cores| cores.parse().ok());
    of_machine.min(of_slurm.unwrap_or(of_machine)).clamp(1, MAX_SLOTS)
}

async fn over(until: Option<Instant>) {
    match until {
        Some(until) => tokio::time::sleep_until(until).await,
        None => std::future::pending().await,
    }
}

/// The first signal stops in good order, the second at once.
fn stop_on_signals(shutdown: CancellationToken) -> Result<(), Failure> {
    let (mut interrupt, mut terminate) = (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
    tasks::spawn(async move {
        loop {
            let name = tokio::select! {
                _ = interrupt.recv() => "SIGINT",
                _ = terminate.recv() => "SIGTERM",
            };
            if shutdown.is_cancelled() {
                telemetry::flush();
                std::process::exit(INTERRUPTED);
            }
            tracing::info!(signal = name, "stopping");
            shutdown.cancel();
        }
    });
    Ok(())
}

/// When this worker is to stop, by the time at which it must have ended.
fn end_of_time(text: &str) -> Result<Instant, Failure> {
    let now = Timestamp::now();
    let end = if text == "auto" {
        end_of_slurm_job()?
    } else {
        let from_now = text.parse::<SignedDuration>().ok().and_then(|left| now.checked_add(left).ok());
        from_now.or_else(|| text.parse().ok()).ok_or_else(|| {
            let text = format!("--until {text:?}: must be a time as 2026-11-22T20:00:00Z, 8h, 90m or auto");
            Exit::BadInput.because(text)
        })?
    };
    let left = Duration::try_from(end.duration_since(now)).unwrap_or_default();
    let Some(work) = left.checked_sub(STOP_BEFORE).filter(|work| !work.is_zero()) else {
        let text = format!(
            "--until: {end} is less than {} s from now, in which nothing could be packed",
            STOP_BEFORE.as_secs()
        );
        return Err(Exit::BadInput.because(text));
    };
    Ok(Instant::now() + work)
}

/// The time limit of the job of Slurm that this process is part of. Slurm 22.05 does not set `SLURM_JOB_END_TIME`.
fn end_of_slurm_job() -> Result<Timestamp, Failure> {
    let of_seconds = |text: &str| text.trim().parse().ok().and_then(|s| Timestamp::from_second(s).ok());
    if let Some(end) = std::env::var("SLURM_JOB_END_TIME").ok().as_deref().and_then(of_seconds) {
        return Ok(end);
    }
    let job = std::env::var("SLURM_JOB_ID")
        .map_err(|_| Exit::BadInput.because("--until auto: this process is part of no job of Slurm"))?;
    let told =
        Command::new("scontrol").args(["show", "job", &job]).env("SLURM_TIME_FORMAT", "%s").output()?;
    let text = String::from_utf8_lossy(&told.stdout);
    let end = text.split_whitespace().find_map(|word| word.strip_prefix("EndTime=")).and_then(of_seconds);
    end.ok_or_else(|| {
        let text = format!("--until auto: scontrol tells no end of the job {job}: {}", text.trim());
        Exit::BadInput.because(text)
    })
}

/// What the name of a folder of a worker begins with; it ends with the mark of the process.
const TEMPORARY: &str = "packstone-worker-";

/// A folder of this process alone, which goes with it.
struct Temporary(PathBuf);

impl Temporary {
    /// Makes one. Those of workers that were killed are removed.
    fn make() -> Result<Self, Failure> {
        let folder = std::env::temp_dir();
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let mark = name.to_str().and_then(|name| name.strip_prefix(TEMPORARY)?.rsplit('.').next());
            if mark.and_then(Process::is_alive_by) == Some(false) {
                // That of another user stays.
                let _ = std::fs::remove_dir_all(entry.path());
            }
        }
        let mark = Process::current().mark().unwrap_or_default();
        let folder = folder.join(format!("{TEMPORARY}{}.{mark}", uuid::Uuid::now_v7().simple()));
        std::fs::create_dir(&folder).map_err(|error| cannot_be("made", &folder, &error))?;
        Ok(Self(folder))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_a_dead_worker_is_removed_by_the_next() {
        let first = Temporary::make().unwrap();
        let name = first.0.file_name().unwrap().to_str().unwrap().to_owned();
        let (id, mark) = name.split_once('.').unwrap();
        let (pid, rest) = mark.split_once('-').unwrap();
        // Another process had the number before.
        let dead = first.0.with_file_name(format!("{id}.{pid}-1{rest}"));
        std::fs::create_dir(&dead).unwrap();
        std::fs::write(dead.join("result"), "half").unwrap();
        let second = Temporary::make().unwrap();
        assert!(!dead.exists() && first.0.exists() && second.0.exists());
    }

    #[test]
    fn a_time_leaves_time_to_stop() {
        let after = |s: i64| (Timestamp::now() + Duration::from_secs(s.unsigned_abs())).to_string();
        let stop = end_of_time(&after(3600)).unwrap().saturating_duration_since(Instant::now());
        assert!((3535..=3540).contains(&stop.as_secs()), "{stop:?}");
        for (text, least_s) in [("2h", 7135), ("90m", 5335), ("1h30m", 5335)] {
            let stop = end_of_time(text).unwrap().saturating_duration_since(Instant::now());
            assert!((least_s..=least_s + 5).contains(&stop.as_secs()), "{text}: {stop:?}");
        }
        for bad in ["", "soon", "2020-01-01T00:00:00Z", &after(30), "30s", "-2h", "8"] {
            assert!(end_of_time(bad).is_err(), "{bad}");
        }
    }
}
