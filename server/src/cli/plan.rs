//! `packstone plan`: what a job amounts to, with the sizes of its exports, as `POST /v1/plans` says it.

use std::path::PathBuf;

use clap::Args;
use packstone_engine::export::ExportRequest;
use packstone_engine::{Limits, TemplateCache};

use super::exit::Failure;
use super::exports::{self, MaterialsFile};
use super::input::Input;
use super::run::{read_job, refused};
use super::{print, run};
use crate::config::limits_of_one_packing;
use crate::exports::estimates::{JobPlan, PlannedExport, planned};
use crate::jobs::request;
use crate::processor;

/// Options of `packstone plan`.
#[derive(Args)]
pub(super) struct Options {
    /// The job as JSON, as it would be submitted; `-` reads standard input
    job: PathBuf,
    /// Exports to estimate beside those that the job names: mesh, voxels, slice, deck, ldpm, certificates, shapes,
    /// quality or properties, with options, as `voxels:format=raw,cells=200`
    #[arg(value_name = "TYPE[:OPTION=VALUE,...]", value_parser = exports::parse)]
    exports: Vec<ExportRequest>,
    /// Most grains of the packing
    #[arg(long, default_value_t = Limits::default().max_grains)]
    max_grains: u64,
    #[command(flatten)]
    materials: MaterialsFile,
    #[command(flatten)]
    input: Input,
}

pub(super) fn run(options: &Options) -> Result<(), Failure> {
    let job = read_job(&options.input, &options.job, request::draw_seed())?;
    let packing = job.packing();
    let limits = limits_of_one_packing(options.max_grains);
    let templates = TemplateCache::default();
    let packing = templates.attached(&packing);
    let plan = templates.plan(&packing, &limits).map_err(|error| refused(&options.job, &error))?;
    let plan = plan.at_speed(&packing, processor::speed());
    run::warn(&plan.warnings);
    let named = options.materials.given_to(job.exports().chain(&options.exports), &options.input)?;
    for export in &named {
        exports::check(export, &packing, &limits)?;
    }
    let planned = planned(&named, &packing, &plan);
    for PlannedExport { export, estimate } in &planned {
        exports::announce(&format!("{} {}", export.export_type().name(), export.format()), estimate);
    }
    let plan = JobPlan { plan: plan.with_proposal(&packing), exports: planned };
    print(&format!("{}\n", serde_json::to_string_pretty(&plan)?))
}
