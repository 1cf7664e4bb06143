//! The checkpoint of `packstone run`: which run it belongs to, and what to do with it.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use packstone_engine::{CheckpointError, PackingRequest, Resume, checkpoint};

use super::super::differences::differences;
use super::super::exit::{Exit, Failure};

/// Name of the file in the folder of the result.
pub(super) const FILE: &str = "checkpoint.packstone";

/// The request whose run the checkpoint holds, with the seed that may have been drawn for it.
pub(super) fn request_of(file: &Path) -> Result<PackingRequest, Failure> {
    open(file)
        .and_then(|mut input| checkpoint::read_request(&mut input))
        .map_err(|error| Exit::BadInput.because(explain(file, &error)))
}

/// The state to go on from. `stored` is what [`request_of`] said.
pub(super) fn state(
    file: &Path,
    job: &Path,
    request: &PackingRequest,
    stored: &PackingRequest,
) -> Result<Resume, Failure> {
    open(file).and_then(|mut input| Resume::read_from(&mut input, request)).map_err(|error| match error {
        CheckpointError::OtherRequest => {
            let lines = differences(
                &serde_json::to_value(request).unwrap_or_default(),
                "the job",
                &serde_json::to_value(stored).unwrap_or_default(),
                "the checkpoint",
            );
            Exit::BadInput.because(format_args!(
                "{} belongs to another job than {}:\n  {}\nChange the job back, or take another folder by --out, or \
                 discard the checkpoint by --fresh instead of --resume",
                file.display(),
                job.display(),
                lines.join("\n  ")
            ))
        }
        other => Exit::BadInput.because(explain(file, &other)),
    })
}

fn open(file: &Path) -> Result<BufReader<File>, CheckpointError> {
    Ok(BufReader::with_capacity(1 << 18, File::open(file)?))
}

fn explain(file: &Path, error: &CheckpointError) -> String {
    format!(
        "{}: {error}; no run can go on from it: discard it by --fresh instead of --resume",
        file.display()
    )
}
