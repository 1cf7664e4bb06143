//! `packstone key`: a fresh API key. Nothing keeps it but whoever reads this output.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;

use super::exit::{Exit, Failure};
use super::{check_output, print};
use crate::accounts::{self, AddError, Role, add_line, checked_name, checked_owner, read_rate};
use crate::telemetry::say;

/// Options of `packstone key`.
#[derive(Args)]
pub(super) struct Options {
    /// Who will use the key; one word or more, without line breaks and equals signs
    #[arg(value_parser = checked_name)]
    name: String,
    /// What the key may do: `read` reads the jobs and studies of its owner, `submit` submits and changes them as well,
    /// `admin` does so with those of all owners; `worker` is for `packstone worker`, which runs jobs of all owners,
    /// and `metrics` for what reads `/metrics`, as Prometheus; these two open nothing else
    #[arg(long, value_enum, default_value_t = Role::Submit)]
    role: Role,
    /// File of keys to which the line of the key is added, and which is made where it is missing; the key alone is
    /// printed then
    #[arg(long, value_name = "FILE")]
    add_to: Option<PathBuf>,
    /// Whose jobs and studies the key is for; several keys may have one owner [default: the name of the key]
    #[arg(long, value_parser = checked_owner)]
    owner: Option<String>,
    /// Most jobs of the owner that wait
    #[arg(long, value_name = "JOBS")]
    max_queued: Option<u64>,
    /// Most jobs of the owner that run at once
    #[arg(long, value_name = "JOBS")]
    max_running: Option<u64>,
    /// Most grains of one packing
    #[arg(long, value_name = "GRAINS")]
    max_grains: Option<u64>,
    /// Most bytes of the owner's results, kept exports and requests
    #[arg(long, value_name = "BYTES")]
    max_stored_bytes: Option<u64>,
    /// Most requests of the key in a second, on average
    #[arg(long, value_name = "REQUESTS", value_parser = read_rate)]
    max_requests_per_second: Option<f64>,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let mut words = vec![format!("role={}", options.role.name())];
    words.extend(options.owner.iter().map(|owner| format!("owner={owner}")));
    let quotas = [
        ("max_queued", options.max_queued),
        ("max_running", options.max_running),
        ("max_grains", options.max_grains),
        ("max_stored_bytes", options.max_stored_bytes),
    ];
    words.extend(quotas.iter().filter_map(|(name, bound)| Some(format!("{name}={}", (*bound)?))));
    words.extend(options.max_requests_per_second.map(|rate| format!("max_requests_per_second={rate}")));
    check_output()
        .map_err(|error| Exit::Machine.because(format_args!("no key was made or added: {error}")))?;
    let (key, line) = accounts::generate(&options.name, &words);
    let Some(file) = &options.add_to else {
        say("The key, shown only now; clients send it as `Authorization: Bearer KEY`:");
        print(&format!("{key}\n"))?;
        say("Its line for the file that --api-keys-file names:");
        return print(&format!("{line}\n"));
    };
    // A key that nobody could read is not added, and one that is printed is added unless the disk fails.
    let show = || {
        say("The key, shown only now; clients send it as `Authorization: Bearer KEY`:");
        let mut out = std::io::stdout().lock();
        out.write_all(format!("{key}\n").as_bytes())?;
        out.flush()
    };
    add_line(file, &line, show).map_err(|error| {
        let exit = match &error {
            AddError::Text(..) | AddError::BadLine(..) | AddError::Owner(..) => Exit::BadInput,
            AddError::Locked(..) => Exit::Unexpected,
            AddError::Unwritten(_, error) | AddError::Before(error) | AddError::Replacement(error) => {
                Exit::of_io(error)
            }
        };
        exit.because(format_args!("no key was added: {error}"))
    })
}
