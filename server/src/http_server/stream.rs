//! The bytes of a connection, on their way between the system and the HTTP library.
//!
//! Three things are done here, because the library does not do them: heads are counted in the budget of memory, clients
//! that take too little of an answer are given up, and the bare error answers that the library writes by itself are
//! kept back, so that a problem document can be written in their place.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use hyper::StatusCode;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Sleep, sleep};

use super::exchange::Exchange;
use crate::memory_budget::Exceeded;

/// Bytes that a client must take in the time of a stalled reader, while more wait.
const LEAST_TAKEN: usize = 64 << 10;

/// A connection below HTTP.
pub(super) struct Stream {
    tcp: TcpStream,
    exchange: Arc<Exchange>,
    stalled_after: Duration,
    /// Runs while the system takes no more bytes.
    stalled: Option<Pin<Box<Sleep>>>,
    /// Bytes taken since it runs.
    taken: usize,
    /// Why the service, or the library by itself, refuses the request.
    refusal: Option<Refusal>,
}

/// Why a request gets no answer of the router.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// The status with which the library would have answered.
    Library(StatusCode),
    /// There is no memory for its head.
    Memory(Exceeded),
}

impl Stream {
    pub(super) fn new(tcp: TcpStream, exchange: Arc<Exchange>, stalled_after: Duration) -> Self {
        Self { tcp, exchange, stalled_after, stalled: None, taken: 0, refusal: None }
    }

    /// The connection of the system, and why its last request was refused.
    pub(super) fn into_parts(self) -> (TcpStream, Option<Refusal>) {
        (self.tcp, self.refusal)
    }

    /// Keeps a bare answer of the library back; whether it is one.
    fn keep_back(&mut self, bytes: &[u8]) -> bool {
        if self.exchange.is_answering() {
            return false;
        }
        let status = status_of_bare_answer(bytes);
        self.refusal = status.map(Refusal::Library).or(self.refusal);
        status.is_some()
    }

    /// What came of an attempt to write, unless the client has taken too little for too long.
    fn note_progress(
        &mut self,
        context: &mut Context<'_>,
        offered: usize,
        written: Poll<io::Result<usize>>,
    ) -> Poll<io::Result<usize>> {
        match written {
            Poll::Pending => {
                let limit = self.stalled_after;
                let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(limit)));
                ready!(stalled.as_mut().poll(context));
                let seconds = limit.as_secs_f64();
                tracing::info!(
                    taken = self.taken,
                    seconds,
                    "a client that takes too little of its answer is given up"
                );
                Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
            }
            Poll::Ready(Ok(taken)) => {
                self.taken += taken;
                if taken == offered || self.taken >= LEAST_TAKEN {
                    (self.stalled, self.taken) = (None, 0);
                }
                Poll::Ready(Ok(taken))
            }
            failed @ Poll::Ready(Err(_)) => failed,
        }
    }
}

/// The status of an answer that the library has written by itself: it has an error status, no content, and none of the
/// fields that every answer of the service has.
fn status_of_bare_answer(bytes: &[u8]) -> Option<StatusCode> {
    let text = str::from_utf8(bytes).ok()?.strip_suffix("\r\n\r\n")?;
    let mut lines = text.split("\r\n");
    let status: StatusCode = lines.next()?.strip_prefix("HTTP/1.")?.get(2..5)?.parse().ok()?;
    let is_bare = lines.all(|line| {
        let name = line.split(':').next().unwrap_or_default().to_ascii_lowercase();
        ["connection", "content-length", "date"].contains(&name.as_str())
    });
    (status.is_client_error() && is_bare).then_some(status)
}

impl AsyncRead for Stream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.tcp).poll_read(context, buffer))?;
        let read = buffer.filled().len() - before;
        if let Err(exceeded) = self.exchange.arrived(read) {
            self.refusal = Some(Refusal::Memory(exceeded));
            return Poll::Ready(Err(io::Error::other(exceeded)));
        }
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for Stream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        if self.keep_back(bytes) {
            return Poll::Ready(Ok(bytes.len()));
        }
        let written = Pin::new(&mut self.tcp).poll_write(context, bytes);
        self.note_progress(context, bytes.len(), written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let mut filled = slices.iter().filter(|slice| !slice.is_empty());
        if let (Some(bytes), None) = (filled.next(), filled.next())
            && self.keep_back(bytes)
        {
            return Poll::Ready(Ok(bytes.len()));
        }
        let offered = slices.iter().map(|slice| slice.len()).sum();
        let written = Pin::new(&mut self.tcp).poll_write_vectored(context, slices);
        self.note_progress(context, offered, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.tcp.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.tcp).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        if self.refusal.is_some() {
            // The answer is yet to be written.
            return Poll::Ready(Ok(()));
        }
        Pin::new(&mut self.tcp).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_answers_of_the_library_are_bare() {
        let bare =
            b"HTTP/1.1 431 Request Header Fields Too Large\r\nconnection: close\r\ncontent-length: 0\r\n\
                     date: Thu, 31 Jan 2030 12:00:00 GMT\r\n\r\n";
        assert_eq!(status_of_bare_answer(bare), Some(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE));
        for other in [
            &b"HTTP/1.1 404 Not Found\r\nx-request-id: 1\r\ncontent-length: 0\r\n\r\n"[..],
            b"HTTP/1.1 304 Not Modified\r\ndate: Thu, 31 Jan 2030 12:00:00 GMT\r\n\r\n",
            b"HTTP/1.1 400 Bad Request\r\ncontent-length: 2\r\n\r\n{}",
            b"{}",
            b"",
        ] {
            assert_eq!(status_of_bare_answer(other), None, "{}", String::from_utf8_lossy(other));
        }
    }
}
