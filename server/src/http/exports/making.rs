//! Waiting for exports, and opening their files. However many requests ask for the same export, it is made once.

use std::io;

use crate::blobs::Blob;
use crate::exports::{ExportRecord, ExportState, StoredFile};
use crate::http::app::App;
use crate::http::conditional::Wait;
use crate::http::exports::address::{Target, file_path};
use crate::http::problems::{of_fault, refused};
use crate::http::waiting;
use crate::jobs::store::{Fault, Retention, StoreError};
use crate::problem::{Kind, Problem};
use crate::tasks;

/// How often an export is requested anew whose file went away before it could be sent: dropped from the cache, or
/// damaged on the disk.
const TRIES: u32 = 3;

/// What became of an export within the time.
#[derive(Debug)]
pub(crate) enum Made {
    /// Its file.
    File(Ready),
    /// It failed.
    Failed(ExportRecord),
    /// It waits, or is being made.
    NotYet(ExportRecord),
}

/// The file of an export, ready to be sent.
#[derive(Debug)]
pub(crate) struct Ready {
    pub(crate) file: Box<dyn Blob>,
    pub(crate) stored: StoredFile,
}

/// Requests an export and waits for it.
///
/// # Errors
/// `not-found` where the job is gone, `queue-full`, or `busy` where the file was dropped as often as it was made.
pub(crate) async fn made(app: &App, target: &Target, wait: Wait) -> Result<Made, Problem> {
    let (store, job) = (&app.shared.store, &target.job);
    for _ in 0..TRIES {
        let asked = store.request_export(job.id, target.new.clone(), Retention::Cached).await;
        let (record, _) = asked.map_err(|error| refused(error, job.id))?;
        let record = match until_finished(app, &record, wait).await {
            Ok(record) => record,
            // Deleted or dropped meanwhile: if its job is there still, it can be made.
            Err(StoreError::NoExport) => continue,
            Err(error) => return Err(error.into()),
        };
        match record.state {
            ExportState::Succeeded => {}
            ExportState::Failed => return Ok(Made::Failed(record)),
            ExportState::Queued | ExportState::Running => return Ok(Made::NotYet(record)),
        }
        if let Some(ready) = open(app, &record).await? {
            return Ok(Made::File(ready));
        }
    }
    Err(Problem::new(Kind::Busy, "the file was dropped as often as it was made")
        .with_header("retry-after", "10"))
}

/// The export as the store has it.
///
/// # Errors
/// `not-found` where nobody has asked for it, or it was removed.
pub(crate) async fn find(app: &App, target: &Target) -> Result<ExportRecord, Problem> {
    let found = app.shared.store.export_of(target.job.seq, &target.new).await?;
    found.ok_or_else(|| {
        let path = file_path(target.job.id, target.export.export_type(), &target.options());
        Problem::new(Kind::NotFound, format!("this export does not exist yet: POST {path} starts it"))
    })
}

/// Opens the file of an export that succeeded; `None` where it is not what was stored, and is made again.
async fn open(app: &App, record: &ExportRecord) -> Result<Option<Ready>, Problem> {
    let Some(stored) = record.file.clone() else {
        tracing::error!(export_id = %record.id, "an export succeeded without a file");
        return Err(Problem::internal());
    };
    let artifacts = app.shared.artifacts.clone();
    let (path, of_storage) = (stored.path.clone(), stored.clone());
    let opened = tasks::blocking(move || artifacts.open_export(&of_storage)).await;
    match opened.unwrap_or_else(|error| Err(io::Error::other(error))) {
        Ok(file) => Ok(Some(Ready { file, stored })),
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::InvalidData) => {
            tracing::warn!(%error, path, export_id = %record.id, "a file is not what was stored; it is made again");
            app.shared.store.requeue_export(record.seq, path).await?;
            Ok(None)
        }
        Err(error) => {
            tracing::error!(%error, path, "a file cannot be read at present");
            Err(of_fault(Fault::Io))
        }
    }
}

/// Waits until an export is finished, the time is over, or the server stops.
pub(crate) async fn until_finished(
    app: &App,
    of: &ExportRecord,
    wait: Wait,
) -> Result<ExportRecord, StoreError> {
    let (store, job, id) = (&app.shared.store, of.job, of.id);
    let read = move || async move { store.export(job, id).await?.ok_or(StoreError::NoExport) };
    waiting::wait_until(app, wait, store.subscribe_export(id), read, |record| record.state.is_finished())
        .await
}
