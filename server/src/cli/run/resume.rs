//! What an earlier `packstone run` left in the folder of the result: a checkpoint of a packing that was stopped, the
//! record of a result that was not written as a whole, or a complete result.
//!
//! A partial result has its checkpoint and its record beside it. A run goes on from them where only the limits of the
//! job differ (`method.stop`, `timeout_s`, `on_limit`), and replaces the files. The materials may differ wherever a run
//! goes on.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufReader, Read as _, Write};
use std::path::{Path, PathBuf};

use packstone_engine::export::tables::Format;
use packstone_engine::request::materials;
use packstone_engine::{CheckpointError, PackingRequest, Resume, checkpoint};
use serde::Deserialize;
use serde_json::Value;

use super::super::differences::differences;
use super::super::exit::{Exit, Failure, cannot_be};
use super::super::outputs::refuse_existing;
use super::super::unfinished::{Record, Unfinished, remove};
use super::Options;
use crate::atomic_file::partial_of;
use crate::formats::ResultFormat;
use crate::jobs::JobRequest;
use crate::page;

/// Name of the checkpoint in the folder of the result.
const CHECKPOINT: &str = "checkpoint.packstone";

/// What an earlier run left.
pub(super) struct Earlier {
    pub(super) checkpoint: PathBuf,
    pub(super) unfinished: Unfinished,
    /// The request whose run the checkpoint holds, where the run goes on from it.
    stored: Option<PackingRequest>,
    record: Option<Record>,
    /// The request of the result that is there, where the run goes on and a file of the result states it, and whether
    /// the result is partial.
    result: Option<Value>,
    is_partial: bool,
}

/// Files of a complete result that stay as they are.
#[derive(Default)]
pub(super) struct Kept {
    files: HashSet<PathBuf>,
    /// Whether the tables among them must be those of the packing: nothing else tells that they are of this job.
    compared: bool,
}

impl Kept {
    /// Whether a file stays.
    pub(super) fn has(&self, file: &Path) -> bool {
        self.files.contains(file)
    }

    /// Whether all of these stay, and need not be compared.
    pub(super) fn is_all(&self, files: &[PathBuf]) -> bool {
        !self.compared && files.iter().all(|file| self.has(file))
    }

    /// Compares a table that stays with what `write` writes, if that is called for.
    pub(super) fn compare(
        &self,
        file: &Path,
        format: ResultFormat,
        write: impl FnOnce(&mut Comparison) -> io::Result<()>,
    ) -> Result<(), Failure> {
        if !self.compared || !is_reproducible(format) {
            return Ok(());
        }
        let mut comparison = Comparison::with(file).map_err(|error| cannot_be("read", file, &error))?;
        let same = write(&mut comparison).and_then(|()| comparison.is_same());
        if same.map_err(|error| cannot_be("read", file, &error))? {
            return Ok(());
        }
        Err(Exit::BadInput.because(format_args!(
            "{} exists and is of another packing; --force overwrites it, --out names another folder",
            file.display()
        )))
    }
}

/// Whether a format has the same bytes whenever it is written; the others state times.
fn is_reproducible(format: ResultFormat) -> bool {
    !matches!(format, ResultFormat::Table(Format::Json) | ResultFormat::Page)
}

impl Earlier {
    /// What lies in the folder of the result.
    pub(super) fn find(options: &Options) -> Result<Self, Failure> {
        let checkpoint = options.out.join(CHECKPOINT);
        let first = options.format.first().map_or("json", |format| format.name());
        let unfinished = Unfinished::beside(&options.out.join(format!("result.{first}")));
        let record = unfinished.read()?;
        let resumes = options.earlier.resume;
        let stored = (resumes && checkpoint.exists()).then(|| request_of(&checkpoint)).transpose()?;
        let stated = |format: &ResultFormat| {
            let file = options.out.join(format!("result.{}", format.name()));
            request_in(&file, *format)
        };
        let found = if resumes && record.is_none() { options.format.iter().find_map(stated) } else { None };
        let (result, of_result) = found.unzip();
        let is_partial = record.as_ref().map_or(of_result.unwrap_or(false), |record| record.partial);
        Ok(Self { checkpoint, unfinished, stored, record, result, is_partial })
    }

    /// Whether the result that is there is partial.
    pub(super) fn is_partial(&self) -> bool {
        self.is_partial
    }

    /// Whether a partial result is replaced, and nothing is left of its run.
    pub(super) fn is_replaced(&self, options: &Options) -> bool {
        self.is_partial && options.force && !options.earlier.resume
    }

    /// Whether there is nothing to go on from.
    pub(super) fn is_nothing(&self) -> bool {
        self.stored.is_none() && self.record.is_none() && self.result.is_none()
    }

    /// The seed of the earlier run, which may have been drawn for it.
    pub(super) fn seed(&self) -> Option<u64> {
        let recorded = self.record.as_ref().and_then(|record| record.request.as_ref());
        let stated = recorded.or(self.result.as_ref()).and_then(|request| request["seed"].as_u64());
        self.stored.as_ref().map(|stored| stored.seed).or(stated)
    }

    /// Judges whether the run may begin; the state to go on from, and the files that stay.
    pub(super) fn check(
        &self,
        options: &Options,
        request: &JobRequest,
        files: &[PathBuf],
    ) -> Result<(Option<Resume>, Kept), Failure> {
        let (resumes, fresh) = (options.earlier.resume, options.earlier.fresh);
        let state = match &self.stored {
            Some(stored) => Some(state(&self.checkpoint, &options.job, &request.packing(), stored)?),
            None => None,
        };
        let left = self.record.as_ref().map(|_| self.unfinished.path());
        let left = left.or(self.checkpoint.exists().then_some(self.checkpoint.as_path()));
        if let Some(left) = left.filter(|_| !resumes && !fresh && !self.is_replaced(options)) {
            let text = if self.is_partial {
                "is of a partial result: go on with it by --resume and a higher limit, or replace it by --force"
            } else {
                "is left from a run that was stopped: go on from it by --resume, or discard it by --fresh"
            };
            return Err(Exit::BadInput.because(format_args!("{} {text}", left.display())));
        }
        let ours = serde_json::to_value(request)?;
        let of_limits = |request: &Value| {
            let mut job = request.clone();
            if let Some(fields) = job.as_object_mut() {
                // The packing does not depend on them.
                fields.remove(materials::OPTION);
            }
            if self.is_partial { without_limits(job) } else { job }
        };
        if let Some(theirs) = self.record.as_ref().and_then(|record| record.request.as_ref())
            && resumes
            && of_limits(theirs) != of_limits(&ours)
        {
            let lines = differences(&of_limits(&ours), "the job", &of_limits(theirs), "the record");
            return Err(other_job(self.unfinished.path(), &options.job, &lines));
        }
        let of_record = |file: &PathBuf| self.record.as_ref().is_some_and(|record| record.names(file));
        let foreign: Vec<PathBuf> = files.iter().filter(|file| !of_record(file)).cloned().collect();
        let mut kept = Kept::default();
        let existing = || foreign.iter().filter(|file| file.exists());
        let goes_on =
            resumes && self.is_partial && self.result.as_ref().map(of_limits) == Some(of_limits(&ours));
        if resumes && self.is_partial && state.is_none() && !options.force {
            return Err(Exit::BadInput.because(format_args!(
                "{} is missing, from which the run of the partial result would go on: a run from the start may reach \
                 less; take another folder by --out, or replace the partial result by --force",
                self.checkpoint.display()
            )));
        }
        if goes_on {
            return Ok((state, kept));
        }
        if resumes && !options.force && self.record.is_none() && existing().next().is_some() {
            let tables = options.format.iter().filter(|format| is_reproducible(**format));
            let is_table = |file: &PathBuf| {
                tables.clone().any(|format| file.ends_with(format!("result.{}", format.name())))
            };
            kept.compared = self.result.is_none() && existing().any(is_table);
            if kept.compared || self.result.as_ref() == Some(&ours) {
                kept.files = existing().cloned().collect();
                return Ok((state, kept));
            }
        }
        refuse_existing(&foreign, options.force)?;
        Ok((state, kept))
    }

    /// Discards what an earlier run left.
    pub(super) fn discard(&self) -> Result<(), Failure> {
        self.discard_checkpoint()?;
        self.record.as_ref().map_or(Ok(()), |record| record.discard(&self.unfinished))
    }

    /// Removes the checkpoint, a whole one and one that was being written.
    pub(super) fn discard_checkpoint(&self) -> Result<(), Failure> {
        let removed = remove(&partial_of(&self.checkpoint)).and_then(|()| remove(&self.checkpoint));
        removed.map_err(|error| cannot_be("removed", &self.checkpoint, &error))
    }
}

/// The request that a complete file of a result states, and whether the result is partial; `None` where there is no
/// such file, or its format has none.
fn request_in(file: &Path, format: ResultFormat) -> Option<(Value, bool)> {
    #[derive(Deserialize)]
    struct Document {
        request: Value,
        summary: Summary,
    }
    #[derive(Deserialize)]
    struct Summary {
        partial: Option<serde::de::IgnoredAny>,
    }
    let document: Document = match format {
        ResultFormat::Table(Format::Json) => {
            let input = BufReader::with_capacity(1 << 18, File::open(file).ok()?);
            serde_json::from_reader(input).ok()?
        }
        ResultFormat::Page => {
            let page = std::fs::read_to_string(file).ok()?;
            serde_json::from_value(page::result_in(&page)?).ok()?
        }
        ResultFormat::Table(_) => return None,
    };
    Some((document.request, document.summary.partial.is_some()))
}

/// A job without what bounds its run.
fn without_limits(mut job: Value) -> Value {
    if let Some(fields) = job.as_object_mut() {
        fields.remove("timeout_s");
        fields.remove("on_limit");
        if let Some(method) = fields.get_mut("method").and_then(Value::as_object_mut) {
            method.remove("stop");
        }
    }
    job
}

/// The request whose run the checkpoint holds, with the seed that may have been drawn for it.
fn request_of(file: &Path) -> Result<PackingRequest, Failure> {
    open(file)
        .and_then(|mut input| checkpoint::read_request(&mut input))
        .map_err(|error| Exit::BadInput.because(explain(file, &error)))
}

/// The state to go on from. `stored` is what [`request_of`] said.
fn state(
    file: &Path,
    job: &Path,
    request: &PackingRequest,
    stored: &PackingRequest,
) -> Result<Resume, Failure> {
    open(file).and_then(|mut input| Resume::read_with_limits(&mut input, request)).map_err(
        |error| match error {
            CheckpointError::OtherRequest => {
                let document = |request: &PackingRequest| {
                    serde_json::to_value(request.without_limits()).unwrap_or_default()
                };
                let lines = differences(&document(request), "the job", &document(stored), "the checkpoint");
                other_job(file, job, &lines)
            }
            other => Exit::BadInput.because(explain(file, &other)),
        },
    )
}

fn other_job(left: &Path, job: &Path, lines: &[String]) -> Failure {
    Exit::BadInput.because(format_args!(
        "{} belongs to another job than {}:\n  {}\nChange the job back, or take another folder by --out, or discard \
         what is left of the earlier run by --fresh instead of --resume",
        left.display(),
        job.display(),
        lines.join("\n  ")
    ))
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

/// Compares what is written with the content of a file.
pub(super) struct Comparison {
    file: BufReader<File>,
    is_same: bool,
}

impl Comparison {
    fn with(file: &Path) -> io::Result<Self> {
        Ok(Self { file: BufReader::with_capacity(1 << 18, File::open(file)?), is_same: true })
    }

    /// Whether all was the same, and the file has nothing more.
    fn is_same(&mut self) -> io::Result<bool> {
        let mut more = [0];
        Ok(self.is_same && self.file.read(&mut more)? == 0)
    }
}

impl Write for Comparison {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_same {
            let mut found = vec![0; bytes.len()];
            self.is_same = match self.file.read_exact(&mut found) {
                Ok(()) => found == bytes,
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => false,
                Err(error) => return Err(error),
            };
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_compared_to_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "one two").unwrap();
        for (written, same) in [
            (&["one", " two"][..], true),
            (&["one two"], true),
            (&["one"], false),
            (&["one two!"], false),
            (&["two one"], false),
        ] {
            let mut comparison = Comparison::with(&file).unwrap();
            for bytes in written {
                comparison.write_all(bytes.as_bytes()).unwrap();
            }
            assert_eq!(comparison.is_same().unwrap(), same, "{written:?}");
        }
    }
}
