//! Bodies of any length, piece by piece, for a function that blocks its thread.

use std::time::Duration;

use axum::body::Body;
use bytes::Bytes;
use http_body_util::BodyExt as _;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout, timeout_at};

use crate::config::MAX_UPLOADS;
use crate::http::app::App;
use crate::http::body::linger;
use crate::http::client;
use crate::http::pace::Pace;
use crate::problem::{Kind, Problem};
use crate::tasks;

/// How long a file waits for another to be taken in before it is refused.
const TURN: Duration = Duration::from_secs(10);
/// Pieces that may wait for the disk.
const PIECES: usize = 16;

enum Piece {
    Bytes(Bytes),
    /// The body has ended as it should.
    End,
}

/// The pieces of a body.
pub(super) struct Pieces {
    receiver: mpsc::Receiver<Piece>,
    ended: bool,
}

/// The body has ended early.
pub(super) struct EndedEarly;

impl Pieces {
    /// The next piece; `None` at the end.
    pub(super) fn next(&mut self) -> Option<Result<Bytes, EndedEarly>> {
        if self.ended {
            return None;
        }
        match self.receiver.blocking_recv() {
            Some(Piece::Bytes(bytes)) => Some(Ok(bytes)),
            Some(Piece::End) => {
                self.ended = true;
                None
            }
            None => Some(Err(EndedEarly)),
        }
    }
}

/// Gives a body to a function that blocks its thread; what the function returned.
///
/// # Errors
/// `busy`, `request-timeout`, or `malformed-json` where the body ended early.
pub(super) async fn take<T: Send + 'static>(
    app: &App,
    mut body: Body,
    work: impl FnOnce(&mut Pieces) -> T + Send + 'static,
) -> Result<T, Problem> {
    let Ok(turn) = timeout(TURN, app.shared.uploads.wait(&client::current())).await else {
        linger(body);
        let detail = format!(
            "{MAX_UPLOADS} files of workers are being taken in, as many as may, or {} of this address or key",
            MAX_UPLOADS / 2
        );
        return Err(Problem::new(Kind::Busy, detail).with_header("retry-after", "5"));
    };
    let (sender, receiver) = mpsc::channel(PIECES);
    let working = tasks::blocking(move || {
        let _turn = turn;
        work(&mut Pieces { receiver, ended: false })
    });
    let closing = |problem: Problem| problem.with_header("connection", "close");
    let mut fault = None;
    let mut pace = Pace::new();
    loop {
        let piece = match timeout_at(pace.deadline(), body.frame()).await {
            Err(_) => {
                let detail = format!("the body arrives too slowly: it {}", Pace::bound());
                fault = Some(closing(Problem::new(Kind::RequestTimeout, detail)));
                break;
            }
            Ok(Some(Err(error))) => {
                tracing::debug!(%error, "a body ended early");
                fault = Some(closing(Problem::new(Kind::MalformedJson, "the body ended early")));
                break;
            }
            Ok(None) => Piece::End,
            Ok(Some(Ok(frame))) => match frame.into_data() {
                Ok(data) => {
                    pace.arrived(data.len(), false);
                    Piece::Bytes(data)
                }
                // Trailers are no data.
                Err(_) => continue,
            },
        };
        let is_end = matches!(piece, Piece::End);
        let waiting = Instant::now();
        if sender.send(piece).await.is_err() {
            // The function has returned before the end: it has refused the file.
            linger(body);
            break;
        }
        if is_end {
            break;
        }
        // The sender waits for the disk, too.
        pace.postpone(waiting.elapsed());
    }
    drop(sender);
    let value = working.await.map_err(|error| {
        tracing::error!(%error, "taking in a file panicked");
        Problem::internal()
    })?;
    fault.map_or(Ok(value), Err)
}
