//! The checkpoint of a job or an export, from the attempt before and for the attempt after.

use std::io;

use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

use super::{LeasePath, holds, upload};
use crate::accounts::Caller;
use crate::blobs::Blob as _;
use crate::disk::{Disk, is_full};
use crate::http::app::App;
use crate::http::files::send_file;
use crate::http::params::{NoParameters, Query};
use crate::problem::{Fault, Kind, Problem};
use crate::tasks;

/// Get the checkpoint that earlier attempts of the job or the export have left
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/leases/{task}/{attempt}/checkpoint", tag = "workers", operation_id = "get_checkpoint",
    params(LeasePath),
    responses(
        (status = 200, description = "The checkpoint", content_type = "application/octet-stream"),
        crate::http::problems::sets::CheckpointProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    path: LeasePath,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    holds(&app, &caller.by.key, path).await?;
    let checkpoints = app.shared.checkpoints.clone();
    let opened = tasks::blocking(move || {
        let checkpoint = checkpoints.newest(&path.id.to_string())?;
        let length = checkpoint.length().ok()?;
        Some((Box::new(checkpoint), length))
    });
    let opened = opened.await.map_err(|_| Problem::internal())?;
    let (file, length) =
        opened.ok_or_else(|| Problem::new(Kind::NotFound, "there is no checkpoint of earlier attempts"))?;
    let mut response = send_file(&app, file, 0..length).await?.into_response();
    let fields = response.headers_mut();
    fields.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    fields.insert(header::CONTENT_LENGTH, HeaderValue::from(length));
    Ok(response)
}

/// Leave a checkpoint
///
/// It replaces the earlier ones of the job or the export. The lease goes on. What is no checkpoint, or is damaged,
/// is refused.
#[cfg_attr(test, utoipa::path(
    put, path = "/v1/leases/{task}/{attempt}/checkpoint", tag = "workers", operation_id = "put_checkpoint",
    params(LeasePath),
    request_body(content_type = "application/octet-stream", description = "The checkpoint"),
    responses(
        (status = 204, description = "The checkpoint is kept"),
        crate::http::problems::sets::LeaseFileProblems
    )
))]
pub(crate) async fn put(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    path: LeasePath,
    _: Query<NoParameters>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    holds(&app, &caller.by.key, path).await?;
    let alone = app.receive_alone(format!("checkpoint of {}", path.id))?;
    // Reading it takes as much memory, which a state of the packing does not exceed.
    let room = app.shared.disk.room().min(app.shared.limits.max_memory_bytes);
    check_length(&headers, room)?;
    let (checkpoints, disk) = (app.shared.checkpoints.clone(), app.shared.disk.clone());
    let kept = upload::take(&app, body, move |pieces| {
        // Held until the file is written, also where the worker goes before it has its answer.
        let _alone = alone;
        let id = path.id.to_string();
        let mut file = checkpoints.receive(&id, path.attempt)?;
        let mut bytes = 0;
        while let Some(piece) = pieces.next() {
            let Ok(piece) = piece else { return Ok(()) };
            bytes += piece.len() as u64;
            if bytes > room {
                return Err(io::ErrorKind::StorageFull.into());
            }
            file.write(&piece)?;
        }
        file.finish()?;
        checkpoints.remove(&id, path.attempt - 1);
        checkpoints.share(&id, path.attempt);
        Ok(())
    });
    kept.await?.map_err(|error: io::Error| match error.kind() {
        io::ErrorKind::InvalidData => {
            tracing::warn!(%error, job_id = %path.id, "a checkpoint of a worker was refused");
            let detail = format!("must be a whole checkpoint: {error}");
            Problem::parameters(vec![Fault { pointer: Some(String::new()), detail, ..Fault::default() }])
        }
        _ => of_disk(&error, &disk),
    })?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// Refuses a file that says that it is longer than there is room.
pub(super) fn check_length(headers: &HeaderMap, room: u64) -> Result<(), Problem> {
    let length =
        headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|length| length > room) {
        return Err(no_room().with_header("connection", "close"));
    }
    Ok(())
}

/// A file that the disk, or a quota of the owner, does not take.
pub(super) fn of_disk(error: &io::Error, disk: &Disk) -> Problem {
    tracing::warn!(%error, "a file of a worker was not kept");
    // A quota of the owner says nothing about the disk.
    if error.kind() != io::ErrorKind::QuotaExceeded {
        disk.note_failure(error);
    }
    if is_full(error) {
        return no_room();
    }
    Problem::new(Kind::MachineFault, "the server cannot write its files at present")
        .with_header("retry-after", "5")
}

fn no_room() -> Problem {
    Problem::new(Kind::InsufficientStorage, "the server has no room for the file")
        .with_header("retry-after", "60")
}
