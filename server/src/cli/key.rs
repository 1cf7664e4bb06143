//! `packstone key`: a fresh API key. Nothing keeps it but whoever reads this output.

use clap::Args;

use super::exit::Failure;
use super::print;
use crate::accounts::{self, Role, checked_name, checked_owner, read_rate};

/// Options of `packstone key`.
#[derive(Args)]
pub(super) struct Options {
    /// Who will use the key; one word or more, without line breaks and equals signs
    #[arg(value_parser = checked_name)]
    name: String,
    /// What the key may do: `read` reads the jobs and studies of its owner, `submit` submits and changes them as well,
    /// `admin` does so with those of all owners; `worker` is for `packstone worker`, which runs jobs of all owners,
    /// and `metrics` for what reads `/metrics`, as Prometheus; these two open nothing else
    #[arg(long, value_enum, default_value_t)]
    role: Role,
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
    /// Most bytes of the owner's results and kept exports
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
    let (key, line) = accounts::generate(&options.name, &words);
    eprintln!("The key, shown only now; clients send it as `Authorization: Bearer KEY`:");
    print(&format!("{key}\n"))?;
    eprintln!("Its line for the file that --api-keys-file names:");
    print(&format!("{line}\n"))
}
