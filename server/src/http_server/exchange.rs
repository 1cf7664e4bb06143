//! What a connection and its present request know of each other: whether an answer is under way, and the memory that
//! both hold.

use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};

use axum::body::Body;
use bytes::Bytes;
use hyper::body::{Frame, SizeHint};

use super::BUFFER_BYTES;
use crate::memory_budget::{Exceeded, Reservation};

/// One request and its answer after the other, on one connection.
#[derive(Debug)]
pub(super) struct Exchange {
    is_answering: AtomicBool,
    /// The memory of the head that is being read; of the present request until its answer is handed over.
    head: Mutex<Reservation>,
}

impl Exchange {
    /// Before the first request; `head` is an empty reservation.
    pub(super) fn new(head: Reservation) -> Arc<Self> {
        Arc::new(Self { is_answering: AtomicBool::new(false), head: Mutex::new(head) })
    }

    /// Notes bytes that have arrived. Those of bodies are counted where they are read.
    ///
    /// # Errors
    /// The memory for heads is used up.
    pub(super) fn arrived(&self, bytes: usize) -> Result<(), Exceeded> {
        if self.is_answering() {
            return Ok(());
        }
        let mut head = self.head.lock().unwrap_or_else(PoisonError::into_inner);
        // More is the rest of a body whose request was refused: it is read and dropped.
        let most = (BUFFER_BYTES as u64).saturating_sub(head.bytes());
        head.grow(most.min(bytes as u64))
    }

    /// Whether a part of a head has arrived.
    pub(super) fn has_begun(&self) -> bool {
        self.head.lock().unwrap_or_else(PoisonError::into_inner).bytes() > 0
    }

    /// The head of a request is complete.
    pub(super) fn begin(&self) {
        self.is_answering.store(true, Ordering::Release);
    }

    /// Whether the service answers a request, rather than that one is awaited.
    pub(super) fn is_answering(&self) -> bool {
        self.is_answering.load(Ordering::Acquire)
    }

    fn end(&self) {
        self.head.lock().unwrap_or_else(PoisonError::into_inner).clear();
        self.is_answering.store(false, Ordering::Release);
    }
}

/// The body of an answer. Dropped, it ends the exchange.
pub(super) struct Answer {
    body: Body,
    exchange: Arc<Exchange>,
    memory: Option<Arc<Reservation>>,
}

impl Answer {
    /// The body of an answer; `memory` is freed when its last byte has been given to the system.
    pub(super) fn new(body: Body, exchange: Arc<Exchange>, memory: Option<Reservation>) -> Self {
        Self { body, exchange, memory: memory.map(Arc::new) }
    }
}

impl hyper::body::Body for Answer {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let polled = Pin::new(&mut self.body).poll_frame(context);
        let Some(memory) = &self.memory else { return polled };
        polled.map_ok(|frame| {
            frame.map_data(|bytes| Bytes::from_owner(Counted { bytes, _memory: Arc::clone(memory) }))
        })
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Answer {
    fn drop(&mut self) {
        self.exchange.end();
    }
}

/// Bytes with the memory that is counted for them.
struct Counted {
    bytes: Bytes,
    _memory: Arc<Reservation>,
}

impl AsRef<[u8]> for Counted {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use http_body_util::BodyExt as _;

    use super::*;
    use crate::memory_budget::{MemoryBudget, UNCOUNTED_BYTES};

    #[tokio::test]
    async fn memory_of_an_answer_is_free_when_its_last_byte_is() {
        let budget = MemoryBudget::new(100, 100);
        let exchange = Exchange::new(budget.reservation(None));
        exchange.begin();
        let memory = budget.reserve_answer("192.0.2.1", UNCOUNTED_BYTES + 100).unwrap();
        let mut answer = Answer::new(Body::from("bytes"), Arc::clone(&exchange), Some(memory));
        let sent = answer.frame().await.unwrap().unwrap().into_data().unwrap();
        drop(answer);
        assert!(!exchange.is_answering());
        assert!(budget.reservation(None).grow(UNCOUNTED_BYTES + 1).is_err(), "the bytes wait to be sent");
        drop(sent);
        assert!(budget.reservation(None).grow(UNCOUNTED_BYTES + 1).is_ok());
    }

    #[test]
    fn heads_are_counted_until_the_answer() {
        let exchange = Exchange::new(MemoryBudget::new(10, 10).reservation(None));
        assert!(!exchange.has_begun());
        exchange.arrived(UNCOUNTED_BYTES as usize + 10).unwrap();
        assert!(exchange.has_begun() && exchange.arrived(1).is_err());
        exchange.begin();
        exchange.arrived(1 << 20).unwrap();
        drop(Answer::new(Body::empty(), Arc::clone(&exchange), None));
        assert!(!exchange.has_begun() && !exchange.is_answering());
    }
}
