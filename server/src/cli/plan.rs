//! `packstone plan`: what a job amounts to, as `POST /v1/plans` says it.

use std::path::PathBuf;

use clap::Args;
use packstone_engine::{Limits, Plan};

use super::exit::Failure;
use super::run::{read_job, refused, stated_limits};
use super::{print, run};
use crate::jobs::request;

/// Options of `packstone plan`.
#[derive(Args)]
pub(super) struct Options {
    /// The job as JSON, as it would be submitted; `-` reads standard input
    job: PathBuf,
    /// Most grains of the packing
    #[arg(long, default_value_t = Limits::default().max_grains)]
    max_grains: u64,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let job = read_job(&options.job, request::draw_seed())?;
    let packing = job.packing();
    let limits = stated_limits(options.max_grains);
    let plan = Plan::new(&packing, &limits).map_err(|error| refused(&options.job, &error))?;
    run::warn(&plan.warnings);
    let plan = plan.with_proposal(&packing);
    print(&format!("{}\n", serde_json::to_string_pretty(&plan)?))
}
