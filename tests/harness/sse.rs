//! Reads server-sent events as a browser would (HTML standard, section 9.2.6).

use bytes::Bytes;
use futures_util::StreamExt;
use futures_util::stream::BoxStream;
use serde_json::Value;

use super::deadline::patiently;

/// One event.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Event {
    pub(crate) id: Option<String>,
    pub(crate) name: String,
    pub(crate) data: Value,
}

/// The events of a job, in their order.
pub(crate) struct EventStream {
    chunks: BoxStream<'static, reqwest::Result<Bytes>>,
    unread: Vec<u8>,
}

impl EventStream {
    pub(crate) fn new(response: reqwest::Response) -> Self {
        Self { chunks: response.bytes_stream().boxed(), unread: Vec::new() }
    }

    /// The next event; `None` when the server has closed the stream in good order.
    pub(crate) async fn next(&mut self) -> Option<Event> {
        patiently("the next event", async {
            loop {
                while let Some(end) = self.unread.windows(2).position(|pair| pair == b"\n\n") {
                    let block: Vec<u8> = self.unread.drain(..end + 2).collect();
                    if let Some(event) = parse(std::str::from_utf8(&block).expect("UTF-8 events")) {
                        return Some(event);
                    }
                }
                match self.chunks.next().await {
                    Some(chunk) => self.unread.extend_from_slice(&chunk.expect("an unbroken stream")),
                    None => return None,
                }
            }
        })
        .await
    }

    /// All events to the end of the stream.
    pub(crate) async fn rest(mut self) -> Vec<Event> {
        let mut events = Vec::new();
        while let Some(event) = self.next().await {
            events.push(event);
        }
        events
    }

    /// Reads on until the stream ends in whatever way.
    pub(crate) async fn drained(mut self) {
        while let Some(Ok(_)) = self.chunks.next().await {}
    }
}

/// An event, or nothing where a block holds comments only.
fn parse(block: &str) -> Option<Event> {
    let (mut id, mut name, mut data) = (None, String::from("message"), Vec::new());
    for line in block.lines() {
        let (field, value) = line.split_once(':').unwrap_or((line, ""));
        let value = value.strip_prefix(' ').unwrap_or(value);
        match field {
            "id" => id = Some(value.to_owned()),
            "event" => value.clone_into(&mut name),
            "data" => data.push(value),
            _ => {}
        }
    }
    if data.is_empty() {
        return None;
    }
    let data = serde_json::from_str(&data.join("\n")).expect("events carry JSON");
    Some(Event { id, name, data })
}
