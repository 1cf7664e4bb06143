//! Packings in the process of a caller, without a service: what the Python package calls.
//!
//! Requests, plans, reports and refusals are JSON texts of the same form as those of the service, and files have the
//! same bytes; only what a service adds to a job (its ID, its state, its times) is missing.
//!
//! ```
//! use packstone_server::local::{Ended, Job, Run};
//!
//! let job = Job::read(
//!     r#"{"specimen": {"type": "box", "size_mm": [40, 40, 40]}, "seed": 1,
//!         "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4}}"#,
//!     None,
//!     None,
//! )?;
//! let packed = job.pack(&Run::default())?;
//! let mut file = Vec::new();
//! packed.write_table("csv", &mut file)?;
//! assert!(file.starts_with(b"x_mm,y_mm,z_mm,d_mm"));
//! # Ok::<(), Ended>(())
//! ```

pub(crate) mod calculix;
mod packed;
mod run;
mod study;

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use packstone_engine::blend::Blend;
use packstone_engine::export::ExportError;
use packstone_engine::importer::{self, ReadOptions, Unit};
use packstone_engine::request::BlendRequest;
use packstone_engine::{
    CheckpointError, FieldError, Limits, PackError, PackingRequest, Resume, TemplateCache, checkpoint,
};
use serde::Serialize;

use crate::advice::failure_of;
use crate::config::limits_of_one_packing;
use crate::exports::estimates::{JobPlan, planned};
use crate::failure::{Failure, FailureCode};
use crate::jobs::{JobRequest, request};
use crate::plots::PlotError;
use crate::problem::FailureDocument;
use crate::processor;
use crate::strict_json;

pub use packed::{Packed, companion};
pub use run::Run;
pub use study::{Study, run_of_study};

/// Names the Python that this process runs in, whose module `gmsh` makes tetrahedra where no other Gmsh is named.
pub fn set_interpreter(python: PathBuf) {
    crate::gmsh::set_interpreter(python);
}

/// The templates of angular grains of all jobs and studies of the process.
static TEMPLATES: LazyLock<TemplateCache> = LazyLock::new(TemplateCache::default);

/// How a call ends that does not give what was asked for.
#[derive(Debug, thiserror::Error)]
pub enum Ended {
    /// The request is refused, or the run failed; the text is a problem document as JSON.
    #[error("{0}")]
    Refused(String),
    /// [`Run::stop`] was called.
    #[error("the run was stopped")]
    Stopped,
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl From<Failure> for Ended {
    fn from(failure: Failure) -> Self {
        // A document of texts and numbers can always be written.
        Self::Refused(serde_json::to_string(&FailureDocument::from(&failure)).unwrap_or_default())
    }
}

impl From<PackError> for Ended {
    fn from(error: PackError) -> Self {
        match error {
            PackError::Stopped { .. } => Self::Stopped,
            ended => Failure::from(ended).into(),
        }
    }
}

impl From<ExportError> for Ended {
    fn from(error: ExportError) -> Self {
        match error {
            ExportError::Stopped => Self::Stopped,
            ExportError::Write(error) => Self::Io(error),
            ended => Failure::from(ended).into(),
        }
    }
}

impl From<PlotError> for Ended {
    fn from(error: PlotError) -> Self {
        match error {
            PlotError::NotAvailable(reason) => Failure::new(FailureCode::FormatNotAvailable, reason).into(),
            PlotError::Failed(error) => Self::Io(error),
        }
    }
}

/// What was understood of a grading or a recipe, in the form of the answer to `POST /v1/mixes/read`, as JSON.
///
/// # Errors
/// [`Ended::Refused`] where the unit has no such name.
pub fn read_mix(
    table: &[u8],
    sheet: Option<String>,
    curve: Option<String>,
    column: Option<String>,
    unit: Option<String>,
) -> Result<String, Ended> {
    if let Some(unit) = &unit {
        named(&Unit::ALL, Unit::name, "unit", unit)?;
    }
    to_json(&importer::read(table, &ReadOptions { sheet, curve, column, unit }))
}

/// A blend of stockpiles, in the form of the answer to `POST /v1/mixes/blend`, as JSON.
///
/// # Errors
/// [`Ended::Refused`] with all faults of the request.
pub fn blend_mix(request: &str) -> Result<String, Ended> {
    let request = strict_json::parse(request.as_bytes())?;
    let request = BlendRequest::from_json(&request).map_err(Failure::invalid)?;
    to_json(&Blend::of(&request))
}

/// A job that was read.
#[derive(Clone, Debug)]
pub struct Job {
    request: JobRequest,
    limits: Limits,
    /// Where checkpoints are kept.
    checkpoint: Option<PathBuf>,
}

impl Job {
    /// Reads a job in the form of `POST /v1/jobs`.
    ///
    /// A job of more than `max_grains`, or of more than the default of [`Limits`], is refused when it is planned or
    /// packed. A job without `threads` has one for each core. With a `checkpoint`, a run goes on from the file of that
    /// name where there is one. A job without a seed has that of the checkpoint, or one that is drawn.
    ///
    /// # Errors
    /// [`Ended::Refused`] with all faults of the request, or where no run of the job can go on from the checkpoint;
    /// [`Ended::Io`] where the checkpoint cannot be read.
    pub fn read(text: &str, max_grains: Option<u64>, checkpoint: Option<&Path>) -> Result<Self, Ended> {
        let value = strict_json::parse(text.as_bytes())?;
        let stored = checkpoint.map(stored_request).transpose()?.flatten();
        let seed = stored.as_ref().map_or_else(request::draw_seed, |stored| stored.seed);
        let request = JobRequest::read(&value, seed, None).map_err(Failure::invalid)?;
        let of_one = limits_of_one_packing(max_grains.unwrap_or(Limits::default().max_grains));
        let limits = Limits { threads: request.threads().unwrap_or(of_one.threads), ..of_one };
        request.check_postprocess(&limits)?;
        Ok(Self { request, limits, checkpoint: checkpoint.map(Path::to_owned) })
    }

    /// What the job amounts to, in the form of the answer to `POST /v1/plans`, as JSON.
    ///
    /// # Errors
    /// [`Ended::Refused`], as a submission is.
    pub fn plan(&self) -> Result<String, Ended> {
        let packing = self.request.packing();
        let packing = TEMPLATES.attached(&packing);
        let plan = TEMPLATES.plan(&packing, &self.limits).map_err(Failure::from)?;
        let plan = plan.at_speed(&packing, processor::speed()).with_proposal(&packing);
        let exports = planned(self.request.exports(), &packing, &plan);
        to_json(&JobPlan { plan, exports })
    }

    /// Packs, on this thread and as many as the job has beside it. The checkpoint is removed when there is a packing
    /// that is not partial, and when going on from it would only repeat the same end. A job with other limits
    /// (`method.stop`, `timeout_s`, `on_limit`) goes on from it, too.
    ///
    /// # Errors
    /// [`Ended::Refused`] where the job cannot be planned, its target is not reached in the time that it has, a check
    /// fails, or the system refuses memory; [`Ended::Stopped`]; [`Ended::Io`] where the checkpoint cannot be read or
    /// removed.
    pub fn pack(&self, run: &Run) -> Result<Packed, Ended> {
        let packed = self.packed(run)?;
        match packed {
            Ok(packed) => Ok(packed),
            Err(PackError::Stopped { .. }) => {
                Err(run.timed_out(self.request.timeout_s).map_or(Ended::Stopped, Ended::from))
            }
            Err(error) => Err(failure_of(error, &self.request.packing(), &self.limits).into()),
        }
    }

    /// Packs; what the engine ended with.
    fn packed(&self, run: &Run) -> Result<Result<Packed, PackError>, Ended> {
        let packing_request = self.request.packing();
        let resume = match &self.checkpoint {
            Some(file) => resume(file, &packing_request)?,
            None => None,
        };
        let (timeout_s, on_limit) = (self.request.timeout_s, self.request.on_limit);
        run.begin(self.checkpoint.as_deref(), resume.is_some(), timeout_s, on_limit);
        let packed =
            packstone_engine::pack_or_resume(&packing_request, &self.limits, &TEMPLATES, resume, run);
        // A partial packing can be gone on with.
        let is_final = match &packed {
            Ok(packing) => packing.report.summary.partial.is_none(),
            Err(error) => matches!(error, PackError::TargetNotReached(_) | PackError::CheckFailed(_)),
        };
        if let (Some(file), true) = (&self.checkpoint, is_final) {
            crate::checkpoints::remove(file)?;
        }
        let request = serde_json::to_value(&self.request).map_err(io::Error::from)?;
        Ok(packed.map(|packing| Packed::new(request, packing, self.limits)))
    }
}

/// The state that a run goes on from, where there is a checkpoint.
fn resume(file: &Path, request: &PackingRequest) -> Result<Option<Resume>, Ended> {
    let Some(mut input) = open(file)? else { return Ok(None) };
    Ok(Some(Resume::read_with_limits(&mut input, request).map_err(|error| no_checkpoint(file, error))?))
}

/// The request of a checkpoint, where there is one.
fn stored_request(file: &Path) -> Result<Option<PackingRequest>, Ended> {
    let Some(mut input) = open(file)? else { return Ok(None) };
    Ok(Some(checkpoint::read_request(&mut input).map_err(|error| no_checkpoint(file, error))?))
}

fn open(file: &Path) -> io::Result<Option<BufReader<File>>> {
    match File::open(file) {
        Ok(file) => Ok(Some(BufReader::with_capacity(1 << 18, file))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// A checkpoint that no run of the job can go on from.
fn no_checkpoint(file: &Path, error: CheckpointError) -> Ended {
    match error {
        CheckpointError::Io(error) => Ended::Io(error),
        other => {
            let detail = format!("{}: {other}; remove the file or name another checkpoint", file.display());
            Failure::new(FailureCode::ValidationError, detail).into()
        }
    }
}

/// The item of that name.
fn named<T: Copy>(all: &[T], name: impl Fn(T) -> &'static str, what: &str, asked: &str) -> Result<T, Ended> {
    let found = all.iter().copied().find(|item| name(*item) == asked);
    found.ok_or_else(|| unknown(what, asked, &all.iter().map(|item| name(*item)).collect::<Vec<_>>()))
}

fn unknown(what: &str, asked: &str, known: &[&str]) -> Ended {
    refused(&format!("/{what}"), format!("{asked:?} must be one of {}", known.join(", ")))
}

fn refused(pointer: &str, detail: String) -> Ended {
    Failure::fields(FailureCode::ValidationError, vec![FieldError::new(pointer, detail)]).into()
}

fn to_json(value: &impl Serialize) -> Result<String, Ended> {
    Ok(serde_json::to_string(value).map_err(io::Error::from)?)
}

#[cfg(test)]
mod tests;
