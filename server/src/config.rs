//! What the operator decides: the options of `packstone serve`, each also an environment variable.

use std::net::{SocketAddr, ToSocketAddrs as _};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{BoolishValueParser, Resettable};
use clap::{Args, Command};
use packstone_engine::Limits;

use crate::accounts::{Quotas, read_rate};
use crate::base_path::BasePath;
use crate::blobs::Place;
use crate::gmsh::GmshOptions;
use crate::jobs::request::MAX_TIMEOUT_S;
use crate::jobs::store::{Database, NoDatabase};
use crate::jobs::sweeper::SweepRules;
use crate::memory;
use crate::memory_budget::MemoryBudget;
use crate::telemetry::{self, LogFormat};
use crate::webhooks::WebhookRules;
use crate::webhooks::rules::allowed_host;

/// Share of the machine's memory that all packings together may take; the rest is for the store's
/// cache, the results being sent, and the neighbours.
const MEMORY_SHARE: f64 = 0.8;
/// Share of the memory that requests being read and answers being sent may hold, and the most by default.
const REQUEST_MEMORY_SHARE: f64 = 1.0 / 16.0;
const REQUEST_MEMORY_BYTES: u64 = 72 << 20;
/// Files of workers taken in at once: each holds a thread that writes to the disk.
pub(crate) const MAX_UPLOADS: usize = 64;
/// Most connections, or results being sent, that may be set.
const MOST_AT_ONCE: usize = 1_000_000;
/// Threads for readings of the disk that take a moment.
const OTHER_BLOCKING_THREADS: usize = 64;
/// Bytes that files made of results may hold, as long as nobody has asked for them to be kept.
pub(crate) const DEFAULT_DERIVED_CACHE_BYTES: u64 = 10_000_000_000;
/// Longest request that is read, of a body or of a file.
pub(crate) const DEFAULT_MAX_BODY_BYTES: u64 = 16 << 20;
/// Work of this long may be lost to a crash, in s.
pub(crate) const DEFAULT_CHECKPOINT_EVERY_S: f64 = 30.0;
/// Seconds of a day.
const DAY_S: f64 = 86_400.0;
/// Most days after which finished jobs are removed.
const MAX_DAYS: f64 = 36_500.0;
/// A lease outlives a few missed renewals, and a short suspension of the machine.
const DEFAULT_LEASE_S: f64 = 60.0;

/// Options of `packstone serve`.
// Each `bool` is an option of its own.
#[allow(clippy::struct_excessive_bools)]
#[derive(Args, Clone, Debug)]
pub(crate) struct ServeOptions {
    /// Address and port to listen on, as `127.0.0.1:8080`, `localhost:8080`, or `:8080` for all addresses; port 0 takes
    /// a free one
    #[arg(long, env = "PACKSTONE_LISTEN", default_value = "127.0.0.1:8080", value_parser = address)]
    pub(crate) listen: SocketAddr,
    /// Directory of the database and the results; made where it is missing
    #[arg(long, env = "PACKSTONE_DATA_DIR", default_value = "packstone-data")]
    pub(crate) data_dir: PathBuf,
    /// Where jobs are kept: a database of PostgreSQL, as `postgres://user@host/database`, which several servers may
    /// share [default: the file `packstone.sqlite` of the data directory]
    #[arg(long, env = "PACKSTONE_STORE", value_name = "URL", hide_env_values = true)]
    pub(crate) store: Option<String>,
    /// Where results and exports are kept: a folder, which other servers may share, or `s3://BUCKET/PREFIX` with
    /// credentials and endpoint from the usual variables AWS_* [default: the data directory]
    #[arg(long, env = "PACKSTONE_BLOBS", value_name = "FOLDER-OR-URL", value_parser = Place::read)]
    pub(crate) blobs: Option<Place>,
    /// Answer requests for the files of exports with a URL of the bucket of --blobs, valid for 5 minutes, in place of
    /// the file: clients must reach the bucket
    #[arg(long, env = "PACKSTONE_BLOBS_REDIRECT", value_parser = BoolishValueParser::new())]
    pub(crate) blobs_redirect: bool,
    /// Seconds for which a file in a shared place is left alone that the database does not know
    #[arg(long, hide = true, default_value_t = 3600.0, value_parser = seconds_or_none)]
    pub(crate) least_blob_age_s: f64,
    /// Jobs that run at once, of which one with several threads counts as so many [default: the number of cores]
    #[arg(long, env = "PACKSTONE_WORKERS", value_parser = clap::value_parser!(u16).range(0..=1024))]
    pub(crate) workers: Option<u16>,
    /// Exports (meshes, voxels, lattices) that are made at once, beside the jobs; slices, which take a moment, have one
    /// worker more
    #[arg(long, env = "PACKSTONE_EXPORT_WORKERS", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub(crate) export_workers: u16,
    /// Threads that write one export, whose bytes do not depend on their number [default: one for each core, shared by
    /// the exports that are made at once]
    #[arg(long, env = "PACKSTONE_EXPORT_THREADS")]
    pub(crate) export_threads: Option<NonZeroUsize>,
    #[command(flatten)]
    pub(crate) gmsh: GmshOptions,
    /// Most bytes of exports that were made for a download only; beyond, those used longest ago are removed, and made
    /// again when they are requested
    #[arg(long, env = "PACKSTONE_EXPORT_CACHE_BYTES", default_value_t = DEFAULT_DERIVED_CACHE_BYTES)]
    pub(crate) export_cache_bytes: u64,
    /// File with one line per API key: its SHA-256 in hexadecimal, a name and its role (see `packstone key --add-to`);
    /// read again when it changes
    #[arg(long, env = "PACKSTONE_API_KEYS_FILE")]
    pub(crate) api_keys_file: Option<PathBuf>,
    /// File to which a line of JSON is appended for each request that changes something [default: none]
    #[arg(long, env = "PACKSTONE_AUDIT_LOG", value_name = "FILE")]
    pub(crate) audit_log: Option<PathBuf>,
    /// Listen beyond this machine without API keys
    #[arg(long, env = "PACKSTONE_INSECURE", value_parser = BoolishValueParser::new())]
    pub(crate) insecure: bool,
    /// Path below which clients find this server, as `/packstone`, where a proxy serves it below a path of its host;
    /// requests are taken with and without it
    #[arg(long, env = "PACKSTONE_BASE_PATH", value_name = "PATH", default_value = "/")]
    pub(crate) base_path: BasePath,
    /// Trust `X-Forwarded-For` for the client's address in the log, and `X-Forwarded-Host` and `X-Forwarded-Proto` for
    /// the address in the browser: the server is behind a proxy that sets them
    #[arg(long, env = "PACKSTONE_TRUST_PROXY", value_parser = BoolishValueParser::new())]
    pub(crate) trust_proxy: bool,
    /// Name that clients may use for this server in `Host`, beside localhost; counts where it listens on loopback
    /// without API keys (may be repeated)
    #[arg(long, env = "PACKSTONE_ALLOWED_HOST", value_name = "NAME", value_delimiter = ',', value_parser = allowed_host)]
    pub(crate) allowed_host: Vec<String>,
    /// Folder from which the files of the web page are read at each request, in place of those of the program: for its
    /// development
    #[arg(long, env = "PACKSTONE_WEB_DIR", value_name = "FOLDER", conflicts_with = "no_web")]
    pub(crate) web_dir: Option<PathBuf>,
    /// Serve no web page
    #[arg(long, env = "PACKSTONE_NO_WEB", value_parser = BoolishValueParser::new())]
    pub(crate) no_web: bool,
    /// File with one secret a line (see `packstone webhook-secret`), by which webhooks are signed; without it none are
    /// sent
    #[arg(long, env = "PACKSTONE_WEBHOOK_SECRET_FILE", value_name = "FILE")]
    pub(crate) webhook_secret_file: Option<PathBuf>,
    /// Host to which webhooks may be sent although its address is not public (may be repeated)
    #[arg(long, env = "PACKSTONE_WEBHOOK_ALLOWED_HOST", value_name = "NAME", value_delimiter = ',', value_parser = allowed_host)]
    pub(crate) webhook_allowed_host: Vec<String>,
    /// Seconds between the first two attempts to send a webhook
    #[arg(long, hide = true, default_value_t = 5.0, value_parser = seconds)]
    pub(crate) webhook_first_pause_s: f64,
    /// Form of the log lines on standard error
    #[arg(long, env = "PACKSTONE_LOG_FORMAT", value_enum, default_value_t)]
    pub(crate) log_format: LogFormat,
    /// Most grains of one packing
    #[arg(long, env = "PACKSTONE_MAX_GRAINS", default_value_t = Limits::default().max_grains)]
    pub(crate) max_grains: u64,
    /// Most memory of one packing, in MiB [default: four fifths of the machine's, or of the limit
    /// of the control group, shared by the jobs and exports that may run at once, and at most 8 GB]
    #[arg(long, env = "PACKSTONE_MAX_MEMORY_MIB", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) max_memory_mib: Option<u64>,
    /// Most memory of one model of a result, and longest file of one, in MiB [default: as for a packing]
    #[arg(long, env = "PACKSTONE_MAX_MODEL_MIB", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) max_model_mib: Option<u64>,
    /// Most jobs that wait
    #[arg(long, env = "PACKSTONE_MAX_QUEUED", default_value_t = 100_000)]
    pub(crate) max_queued: u64,
    /// Longest body of a request, in bytes
    #[arg(long, env = "PACKSTONE_MAX_BODY_BYTES", default_value_t = DEFAULT_MAX_BODY_BYTES)]
    pub(crate) max_body_bytes: u64,
    /// Most memory that requests being read and answers being sent hold together, in bytes; one client address may hold
    /// half of it. It is never less than --max-body-bytes [default: a sixteenth of the memory, at most 72 MiB]
    #[arg(long, env = "PACKSTONE_REQUEST_MEMORY_BYTES")]
    pub(crate) request_memory_bytes: Option<u64>,
    /// Most open connections
    #[arg(long, env = "PACKSTONE_MAX_CONNECTIONS", default_value_t = 1024, value_parser = number)]
    pub(crate) max_connections: usize,
    /// Most open connections of one client address [default: half of --max-connections; all of them with --trust-proxy]
    #[arg(long, env = "PACKSTONE_MAX_CONNECTIONS_PER_CLIENT")]
    pub(crate) max_connections_per_client: Option<NonZeroUsize>,
    /// Seconds after which a connection is closed whose client takes less than 64 KiB of an answer in that time
    #[arg(long, hide = true, default_value_t = 60.0, value_parser = seconds)]
    pub(crate) stalled_reader_s: f64,
    /// Most results being sent at once; one client address may have half of them
    #[arg(long, env = "PACKSTONE_MAX_DOWNLOADS", default_value_t = 64, value_parser = number)]
    pub(crate) max_downloads: usize,
    /// Free space of the data directory's file system, in bytes, below which nothing is accepted [default: 1 GiB, at
    /// most 5 % of the file system]
    #[arg(long, env = "PACKSTONE_MIN_FREE_BYTES")]
    pub(crate) min_free_bytes: Option<u64>,
    /// Most bytes of results, kept exports and cached exports together [default: as much as the disk has]
    #[arg(long, env = "PACKSTONE_MAX_STORED_BYTES")]
    pub(crate) max_stored_bytes: Option<u64>,
    /// Most bytes of results, kept exports and requests of one owner of API keys [default: no bound]
    #[arg(long, env = "PACKSTONE_MAX_STORED_BYTES_PER_KEY")]
    pub(crate) max_stored_bytes_per_key: Option<u64>,
    /// Most jobs of one owner of API keys that wait [default: no bound but --max-queued]
    #[arg(long, env = "PACKSTONE_MAX_QUEUED_PER_KEY")]
    pub(crate) max_queued_per_key: Option<u64>,
    /// Most jobs of one owner of API keys that run at once [default: no bound but --workers]
    #[arg(long, env = "PACKSTONE_MAX_RUNNING_PER_KEY")]
    pub(crate) max_running_per_key: Option<u64>,
    /// Most grains of one packing of an owner of API keys [default: no bound but --max-grains]
    #[arg(long, env = "PACKSTONE_MAX_GRAINS_PER_KEY")]
    pub(crate) max_grains_per_key: Option<u64>,
    /// Most requests of one API key in a second, on average; without keys those of all clients [default: no bound]
    #[arg(long, env = "PACKSTONE_MAX_REQUESTS_PER_SECOND_PER_KEY", value_parser = read_rate)]
    pub(crate) max_requests_per_second_per_key: Option<f64>,
    /// Most requests of one API key at once, where their rate is bounded [default: those of two seconds, at least 10]
    #[arg(long, env = "PACKSTONE_REQUEST_BURST_PER_KEY", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) request_burst_per_key: Option<u32>,
    /// Start although results lie in the data directory that the database does not know, and move them to its folder
    /// `quarantine`
    #[arg(long, env = "PACKSTONE_ADOPT_ORPHANS", value_parser = BoolishValueParser::new())]
    pub(crate) adopt_orphans: bool,
    /// Days after which files in the folder `quarantine` are removed
    #[arg(long, env = "PACKSTONE_QUARANTINE_DAYS", default_value_t = 7)]
    pub(crate) quarantine_days: u32,
    /// Days after which finished jobs and studies without `expires_at` are removed with their results [default: never]
    #[arg(long, env = "PACKSTONE_EXPIRE_AFTER_DAYS", value_name = "DAYS", value_parser = days)]
    pub(crate) expire_after_days: Option<f64>,
    /// Most seconds of one run of a job, here and on other machines; the `timeout_s` of a job may be shorter [default:
    /// no bound]
    #[arg(long, env = "PACKSTONE_MAX_RUN_S", value_name = "SECONDS", value_parser = run_seconds)]
    pub(crate) max_run_s: Option<f64>,
    /// Seconds between two sweeps for expired jobs and files left over
    #[arg(long, env = "PACKSTONE_SWEEP_INTERVAL_S", default_value_t = 300.0, value_parser = seconds)]
    pub(crate) sweep_interval_s: f64,
    /// Seconds for which a worker holds a job without a sign of life; then the job goes to another
    #[arg(long, env = "PACKSTONE_LEASE_S", default_value_t = DEFAULT_LEASE_S, value_parser = lease)]
    pub(crate) lease_s: f64,
    /// Share of the results of worker processes whose grains the server checks pair by pair, from 0 to 1; numbers,
    /// sizes, walls and figures are checked in any case
    #[arg(long, env = "PACKSTONE_VERIFY_RESULTS", default_value_t = 1.0, value_parser = share)]
    pub(crate) verify_results: f64,
    /// Seconds between two checkpoints of a running job, from which it goes on after a crash; 0 keeps one at
    /// every opportunity
    #[arg(long, env = "PACKSTONE_CHECKPOINT_EVERY_S", default_value_t = DEFAULT_CHECKPOINT_EVERY_S, value_parser = seconds_or_none)]
    pub(crate) checkpoint_every_s: f64,
}

impl ServeOptions {
    /// Where jobs are kept. A URL is read here and not as the option is, whose errors would print a password.
    ///
    /// # Errors
    /// The URL names no database that this program can use.
    pub(crate) fn database(&self) -> Result<Database, NoDatabase> {
        match &self.store {
            Some(url) => url.parse(),
            None => Ok(Database::File(self.data_dir.join("packstone.sqlite"))),
        }
    }

    /// Threads for what blocks them: each takes 2 MiB of address space. Downloads, uploads and jobs may hold one for
    /// long, jobs and exports a few more in a moment.
    pub(crate) fn blocking_threads(&self) -> usize {
        let jobs = self.workers() + usize::from(self.export_workers);
        self.max_downloads + MAX_UPLOADS + 4 * jobs + OTHER_BLOCKING_THREADS
    }

    /// Jobs that run at once.
    pub(crate) fn workers(&self) -> usize {
        self.workers.map_or_else(|| cores().get(), usize::from)
    }

    /// Open connections that one client address may have. A trusted proxy brings all clients from one address.
    pub(crate) fn max_connections_per_client(&self) -> usize {
        let default = if self.trust_proxy { self.max_connections } else { self.max_connections.div_ceil(2) };
        self.max_connections_per_client.map_or(default, NonZeroUsize::get)
    }

    /// The memory of requests being read and answers being sent. The longest body fits in the share of a client.
    pub(crate) fn memory_budget(&self) -> MemoryBudget {
        let by_default = || {
            let share = memory::total_bytes().map(|total| (total as f64 * REQUEST_MEMORY_SHARE) as u64);
            share.unwrap_or(u64::MAX).min(REQUEST_MEMORY_BYTES)
        };
        let most = self.request_memory_bytes.unwrap_or_else(by_default).max(self.max_body_bytes);
        MemoryBudget::new(most, (most / 2).max(self.max_body_bytes))
    }

    /// What one packing may use.
    pub(crate) fn limits(&self) -> Limits {
        let max_memory_bytes = match self.max_memory_mib {
            Some(mib) => mib.saturating_mul(1 << 20),
            None => default_memory_bytes(self.workers() + usize::from(self.export_workers)),
        };
        let max_model_bytes = self.max_model_mib.map_or(max_memory_bytes, |mib| mib.saturating_mul(1 << 20));
        let shared = || threads_of_one(usize::from(self.export_workers));
        let export_threads = self.export_threads.unwrap_or_else(shared);
        Limits {
            max_grains: self.max_grains,
            max_memory_bytes,
            max_model_bytes,
            max_voxel_file_bytes: max_model_bytes,
            threads: NonZeroUsize::MIN,
            export_threads,
        }
    }

    /// What the jobs of an owner may take for whom the file of keys says nothing.
    pub(crate) fn quotas(&self) -> Quotas {
        Quotas {
            queued: self.max_queued_per_key,
            running: self.max_running_per_key,
            grains: self.max_grains_per_key,
            stored_bytes: self.max_stored_bytes_per_key,
        }
    }

    /// To whom webhooks may be sent.
    pub(crate) fn webhook_rules(&self) -> WebhookRules {
        WebhookRules::new(self.webhook_secret_file.is_some(), &self.webhook_allowed_host)
    }

    /// Time between the first two attempts to send a webhook.
    pub(crate) fn webhook_first_pause(&self) -> Duration {
        Duration::from_secs_f64(self.webhook_first_pause_s)
    }

    /// Time in which the client of a connection must take some of its answer.
    pub(crate) fn stalled_reader(&self) -> Duration {
        Duration::from_secs_f64(self.stalled_reader_s)
    }

    /// Time between two checkpoints of a running job.
    pub(crate) fn checkpoint_every(&self) -> Duration {
        Duration::from_secs_f64(self.checkpoint_every_s)
    }

    /// How long a lease lasts without being renewed.
    pub(crate) fn lease(&self) -> Duration {
        Duration::from_secs_f64(self.lease_s)
    }

    /// What is swept.
    pub(crate) fn sweep_rules(&self) -> SweepRules {
        SweepRules {
            quarantine_days: self.quarantine_days,
            least_age: Duration::from_secs_f64(self.least_blob_age_s),
            expire_after: self.expire_after_days.map(|days| Duration::from_secs_f64(days * DAY_S)),
        }
    }

    /// Time between two sweeps.
    pub(crate) fn sweep_interval(&self) -> Duration {
        Duration::from_secs_f64(self.sweep_interval_s)
    }
}

/// Cores that this process may use.
pub(crate) fn cores() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// Threads that check the results of worker processes: half of the cores, so that requests never wait for them.
pub(crate) fn check_threads() -> usize {
    (cores().get() / 2).max(1)
}

/// Threads of one piece of work by default, when so many may run at once.
pub(crate) fn threads_of_one(workers: usize) -> NonZeroUsize {
    NonZeroUsize::new(cores().get() / workers.max(1)).unwrap_or(NonZeroUsize::MIN)
}

/// What one packing may use by default, when `workers` of them may run at once.
pub(crate) fn default_memory_bytes(workers: usize) -> u64 {
    let most = Limits::default().max_memory_bytes;
    match memory::total_bytes() {
        Some(total) => most.min((total as f64 * MEMORY_SHARE / workers.max(1) as f64) as u64),
        None => most,
    }
}

/// The limits of one packing that has the machine to itself; the disk limits its files of voxels.
pub(crate) fn limits_of_one_packing(max_grains: u64) -> Limits {
    let max_memory_bytes = default_memory_bytes(1);
    Limits {
        max_grains,
        max_memory_bytes,
        max_model_bytes: max_memory_bytes,
        max_voxel_file_bytes: u64::MAX,
        threads: cores(),
        export_threads: cores(),
    }
}

/// The command line, in which a variable of the environment that is empty counts as not set: `compose.yaml` sets such.
pub(crate) fn without_empty_variables(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let empty = arg.get_env().and_then(std::env::var_os).is_some_and(|value| value.is_empty());
        if empty { arg.env(Resettable::Reset) } else { arg }
    });
    command.mut_subcommands(without_empty_variables)
}

/// Variables of the environment that look like options of this program and are none: misspelled ones, which would leave
/// an option with its default without a word.
pub(crate) fn unknown_variables(command: &Command) -> Vec<String> {
    let mut known: Vec<String> = vec![telemetry::FILTER_VARIABLE.into()];
    let commands = std::iter::once(command).chain(command.get_subcommands());
    let variables = commands.flat_map(Command::get_arguments).filter_map(clap::Arg::get_env);
    known.extend(variables.filter_map(|name| name.to_str().map(str::to_owned)));
    let set = std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value)));
    let unknown = set.filter(|(name, value)| {
        // Kubernetes sets variables that describe services by their names.
        let of_kubernetes = name.contains("_SERVICE_HOST")
            || name.contains("_SERVICE_PORT")
            || name.contains("_PORT_")
            || value.to_str().is_some_and(|value| value.starts_with("tcp://"));
        name.starts_with("PACKSTONE_")
            && !name.starts_with("PACKSTONE_TEST_")
            && !known.contains(name)
            && !of_kubernetes
    });
    unknown.map(|(name, _)| name).collect()
}

/// An address to listen on: numbers, a name, or a port alone for all addresses.
fn address(text: &str) -> Result<SocketAddr, String> {
    let wanted = if text.starts_with(':') { format!("0.0.0.0{text}") } else { text.to_owned() };
    let found: Vec<SocketAddr> = wanted
        .to_socket_addrs()
        .map_err(|error| format!("{error}; write it as 127.0.0.1:8080, localhost:8080 or :8080"))?
        .collect();
    let first = found.iter().find(|address| address.is_ipv4()).or(found.first());
    first.copied().ok_or_else(|| "the name has no address".to_owned())
}

/// Shorter, a busy machine would lose its leases; longer, the job of a dead one would wait in vain.
fn lease(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (2.0..=3600.0).contains(&s) => Ok(s),
        _ => Err("must be a number of seconds from 2 to 3600".into()),
    }
}

/// A number of connections or downloads at once.
fn number(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(number) if (1..=MOST_AT_ONCE).contains(&number) => Ok(number),
        _ => Err(format!("must be a whole number from 1 to {MOST_AT_ONCE}")),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("must be a number from 0 to 1".into()),
    }
}

fn days(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(days) if days > 0.0 && days <= MAX_DAYS => Ok(days),
        _ => Err(format!("must be a number of days above 0 and at most {MAX_DAYS}")),
    }
}

fn run_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s <= MAX_TIMEOUT_S => Ok(s),
        _ => Err(format!("must be a number of seconds above 0 and at most {MAX_TIMEOUT_S}")),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (0.05..=86_400.0).contains(&s) => Ok(s),
        _ => Err("must be a number of seconds from 0.05 to 86400".into()),
    }
}

/// An interval that may be zero.
pub(crate) fn seconds_or_none(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (0.0..=86_400.0).contains(&s) => Ok(s),
        _ => Err("must be a number of seconds from 0 to 86400".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_numbers_names_or_ports() {
        for (text, found) in [
            ("127.0.0.1:80", "127.0.0.1:80"),
            ("localhost:8080", "127.0.0.1:8080"),
            (":8080", "0.0.0.0:8080"),
            ("[::1]:1", "[::1]:1"),
        ] {
            assert_eq!(address(text).map(|address| address.to_string()), Ok(found.to_owned()));
        }
        for bad in ["", "8080", "127.0.0.1", ":http"] {
            assert!(address(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn intervals_are_bounded() {
        assert_eq!((days("0.5"), run_seconds("0.5")), (Ok(0.5), Ok(0.5)));
        for bad in ["0", "-1", "NaN", "inf", "soon", "1e9"] {
            assert!(days(bad).is_err() && run_seconds(bad).is_err(), "{bad}");
        }
        assert_eq!(number("1"), Ok(1));
        for bad in ["0", "-1", "", "1.5", "18446744073709551615"] {
            assert!(number(bad).is_err(), "{bad}");
        }
        assert_eq!(seconds("0.5"), Ok(0.5));
        for bad in ["0", "-1", "NaN", "inf", "soon", "100000"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
        assert_eq!((share("0"), share("0.25"), share("1")), (Ok(0.0), Ok(0.25), Ok(1.0)));
        for bad in ["-0.1", "1.1", "NaN", "all", ""] {
            assert!(share(bad).is_err(), "{bad}");
        }
        assert_eq!(seconds_or_none("0"), Ok(0.0));
        for bad in ["-1", "NaN", "inf", "soon", "100000"] {
            assert!(seconds_or_none(bad).is_err(), "{bad}");
        }
    }
}
