//! The checkpoint of `packstone run`: which run it belongs to, and what to do with it.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use packstone_engine::{CheckpointError, PackingRequest, Resume, checkpoint};
use serde_json::Value;

use super::super::Failure;

/// Name of the file in the folder of the result.
pub(super) const FILE: &str = "checkpoint.packstone";
/// More differences than this are another job.
const DIFFERENCES_SHOWN: usize = 5;

/// The request whose run the checkpoint holds, with the seed that may have been drawn for it.
pub(super) fn request_of(file: &Path) -> Result<PackingRequest, Failure> {
    open(file)
        .and_then(|mut input| checkpoint::read_request(&mut input))
        .map_err(|error| explain(file, &error).into())
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
            let mut lines = Vec::new();
            differences(
                "",
                &serde_json::to_value(request).unwrap_or_default(),
                &serde_json::to_value(stored).unwrap_or_default(),
                &mut lines,
            );
            let more = lines.len().saturating_sub(DIFFERENCES_SHOWN);
            lines.truncate(DIFFERENCES_SHOWN);
            if more > 0 {
                lines.push(format!("and {more} more"));
            }
            format!(
                "{} belongs to another job than {}:\n  {}\nChange the job back, or take another folder by --out, or \
                 discard the checkpoint by --fresh instead of --resume",
                file.display(),
                job.display(),
                lines.join("\n  ")
            )
            .into()
        }
        other => explain(file, &other).into(),
    })
}

fn open(file: &Path) -> Result<BufReader<File>, CheckpointError> {
    Ok(BufReader::with_capacity(1 << 18, File::open(file)?))
}

fn explain(file: &Path, error: &CheckpointError) -> String {
    match error {
        CheckpointError::Io(error) if error.kind() == io::ErrorKind::NotFound => {
            format!(
                "there is no checkpoint {} to go on from: leave --resume out, or name the folder of the run by --out",
                file.display()
            )
        }
        error => {
            format!(
                "{}: {error}; it cannot be gone on from: discard it by --fresh instead of --resume",
                file.display()
            )
        }
    }
}

/// Every field in which two documents differ, with both values.
fn differences(pointer: &str, job: &Value, checkpoint: &Value, found: &mut Vec<String>) {
    match (job, checkpoint) {
        (Value::Object(ours), Value::Object(theirs)) => {
            let names = ours.keys().chain(theirs.keys().filter(|name| !ours.contains_key(*name)));
            for name in names {
                let of =
                    |object: &serde_json::Map<String, Value>| object.get(name).cloned().unwrap_or_default();
                differences(&format!("{pointer}/{name}"), &of(ours), &of(theirs), found);
            }
        }
        _ if job != checkpoint => found.push(format!(
            "{pointer} is {} in the job and {} in the checkpoint",
            shown(job),
            shown(checkpoint)
        )),
        _ => {}
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::Null => "absent".into(),
        Value::Array(items) if items.len() > 3 => format!("a list of {}", items.len()),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn differences_name_field_and_values() {
        let mut found = Vec::new();
        let job = json!({"seed": 1, "mix": {"volume_fraction": 0.5, "d_min_mm": 2.0, "mm": [1, 2, 3, 4]}});
        let checkpoint =
            json!({"seed": 1, "mix": {"volume_fraction": 0.6, "mm": [1, 2, 3]}, "distance": {"mm": 1}});
        differences("", &job, &checkpoint, &mut found);
        assert_eq!(
            found,
            [
                "/mix/volume_fraction is 0.5 in the job and 0.6 in the checkpoint",
                "/mix/d_min_mm is 2.0 in the job and absent in the checkpoint",
                "/mix/mm is a list of 4 in the job and [1,2,3] in the checkpoint",
                "/distance is absent in the job and {\"mm\":1} in the checkpoint",
            ]
        );
    }
}
