//! What changes, of all jobs and studies that a caller may see, as it happens (server-sent events).
//!
//! Three kinds: `job` and `study` name what has changed and where it stands now, and `reset` says that changes were
//! missed. An event's id is the process and the number of the change in its journal, so that a client that comes back
//! with `Last-Event-ID` gets what is newer, or a `reset`. Changes of one item that follow closely are told once.

use std::collections::HashSet;
use std::convert::Infallible;
use std::sync::LazyLock;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use axum::response::sse::Event;
use futures_util::stream::{self, Stream};
use serde::Serialize;
use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout};

use crate::accounts::Caller;
use crate::hex;
use crate::http::app::App;
use crate::http::event_stream::event_stream;
use crate::http::params::{NoParameters, Query};
use crate::jobs::journal::Changed;
use crate::jobs::store::{Standing, StoreError};
use crate::problem::Problem;

/// Changes are collected for so long.
const COLLECT: Duration = Duration::from_millis(50);
/// Items that are read from the database at once.
const AT_ONCE: usize = 500;
/// How often a stream looks whether its key still opens this server.
const LOOK_EVERY: Duration = Duration::from_secs(5);
/// Longest life of a stream, after which the client comes back with its key or session: either may have ended.
const LONGEST: Duration = Duration::from_hours(1);
/// Time after which a client comes back, as the stream asks it to.
const RETRY: Duration = Duration::from_secs(1);
/// Items of which a stream remembers that it has told of them.
const MOST_TOLD: usize = 10_000;

/// What a process is called in ids of events.
static PROCESS: LazyLock<String> = LazyLock::new(|| hex::encode(&rand::random::<[u8; 8]>()));

/// One event of the stream.
#[derive(Debug)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[expect(dead_code, reason = "it describes what the stream writes")]
pub(crate) struct ChangeEvent {
    /// What the event tells.
    event: ChangeName,
    /// Place in the order of changes, for `Last-Event-ID`.
    id: String,
    /// Of `job` and `study` a `ChangedItem`, of `reset` an empty object; JSON.
    #[cfg_attr(test, schema(content_media_type = "application/json"))]
    data: String,
}

/// What an event tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum ChangeName {
    /// A job has changed.
    Job,
    /// A study has changed.
    Study,
    /// Changes were missed: read again what is shown.
    Reset,
}

impl ChangeName {
    fn name(self) -> &'static str {
        match self {
            Self::Job => "job",
            Self::Study => "study",
            Self::Reset => "reset",
        }
    }
}

/// A job or a study that has changed.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ChangedItem {
    /// ID of the job or the study.
    #[cfg_attr(test, schema(format = "uuid"))]
    id: String,
    /// Its state now; `deleted` where it is gone.
    state: &'static str,
    /// Its version now, as in its tag; `null` where it is gone.
    #[cfg_attr(test, schema(required))]
    version: Option<i64>,
}

/// Follow all jobs and studies
///
/// An event `job` or `study` tells that one which the caller may see has changed, and in which state it is now; get it
/// for the rest. The jobs of a study are told of when they move, not when the study is submitted. To miss nothing, open
/// the stream first and read lists then. `Last-Event-ID` resumes a stream; where the changes since are not known any
/// more, as after a start of the server, the event `reset` says so: read again what is shown. A deletion is told to
/// administrators, and to others where the stream has told of the job or study before. A stream ends after an hour,
/// when its key is withdrawn, and when the server stops.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/events", tag = "jobs", operation_id = "get_events",
    params(("Last-Event-ID" = Option<String>, Header, description = "Id of the last event seen")),
    responses(
        (status = 200, description = "Events until the client leaves", content((ChangeEvent = "text/event-stream"))),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn events(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let journal = app.shared.store.journal();
    let changes = journal.subscribe();
    let last = journal.last();
    let asked = headers.get("last-event-id").map(|value| value.to_str().unwrap_or_default());
    let resumed = asked.map(|id| number_of(id).filter(|number| journal.after(*number, 1).is_some()));
    // A block without data sets the id from which the client resumes, and is no event.
    let mut queue = vec![Event::default().id(id_of(last)).retry(RETRY)];
    let seen = match resumed {
        None => last,
        Some(Some(number)) => {
            queue = vec![Event::default().id(id_of(number)).retry(RETRY)];
            number
        }
        Some(None) => {
            queue = vec![reset(last).retry(RETRY)];
            last
        }
    };
    let following = Following {
        app,
        caller,
        changes,
        seen,
        told: HashSet::new(),
        queue,
        ends_at: Instant::now() + LONGEST,
        ended: false,
    };
    Ok(event_stream(follow(following)))
}

fn id_of(number: u64) -> String {
    format!("{}-{number}", *PROCESS)
}

/// The number of an event of this process.
fn number_of(id: &str) -> Option<u64> {
    let (process, number) = id.trim().split_once('-')?;
    if process == *PROCESS { number.parse().ok() } else { None }
}

fn reset(last: u64) -> Event {
    Event::default().event(ChangeName::Reset.name()).id(id_of(last)).data("{}")
}

struct Following {
    app: App,
    caller: Caller,
    changes: watch::Receiver<u64>,
    /// Number of the last change that was looked at.
    seen: u64,
    /// What the client has been told of, and may hear the end of.
    told: HashSet<Changed>,
    /// Events that are due, last first.
    queue: Vec<Event>,
    ends_at: Instant,
    ended: bool,
}

fn follow(following: Following) -> impl Stream<Item = Result<Event, Infallible>> + Send {
    stream::unfold(following, |mut following| async move {
        loop {
            if let Some(event) = following.queue.pop() {
                return Some((Ok(event), following));
            }
            if following.ended || Instant::now() >= following.ends_at || !following.may_go_on() {
                return None;
            }
            if following.seen == following.app.shared.store.journal().last() {
                tokio::select! {
                    changed = timeout(LOOK_EVERY, following.changes.changed()) => match changed {
                        Ok(Ok(())) => sleep(COLLECT).await,
                        Ok(Err(_)) => following.ended = true,
                        Err(_) => {}
                    },
                    () = following.app.shared.shutdown.cancelled() => {
                        following.ended = true;
                        return Some((Ok(Event::default().comment("the server stops")), following));
                    }
                }
            }
            if let Err(error) = following.look().await {
                tracing::error!(%error, "a stream of changes ends early");
                following.ended = true;
            }
        }
    })
}

impl Following {
    /// Whether the key of the caller still opens this server for the same.
    fn may_go_on(&self) -> bool {
        self.app.shared.accounts.keys().is_none_or(|keys| keys.has(&self.caller))
    }

    /// Queues what has changed since.
    async fn look(&mut self) -> Result<(), StoreError> {
        let store = self.app.shared.store.clone();
        let Some(changes) = store.journal().after(self.seen, AT_ONCE) else {
            self.seen = store.journal().last();
            self.queue.push(reset(self.seen));
            return Ok(());
        };
        let Some((last, _)) = changes.last() else { return Ok(()) };
        self.seen = *last;
        let items: Vec<Changed> = changes.iter().map(|(_, changed)| *changed).collect();
        let standings = store.standings(&items).await?;
        for (number, changed) in changes {
            let event = self.event(number, changed, standings.get(&changed));
            self.queue.extend(event);
        }
        self.queue.reverse();
        Ok(())
    }

    /// The event of a change, where the caller may hear of it.
    fn event(&mut self, number: u64, changed: Changed, standing: Option<&Standing>) -> Option<Event> {
        let sees_only = self.caller.sees_only();
        let may_hear = match (standing, &sees_only) {
            (_, None) => true,
            (Some(standing), Some(owner)) => standing.holder.shared || standing.holder.owner == *owner,
            (None, Some(_)) => self.told.contains(&changed),
        };
        if !may_hear {
            return None;
        }
        if standing.is_none() {
            self.told.remove(&changed);
        } else if sees_only.is_some() && self.told.len() < MOST_TOLD {
            self.told.insert(changed);
        }
        let (name, id) = match changed {
            Changed::Job(id) => (ChangeName::Job, id.to_string()),
            Changed::Study(id) => (ChangeName::Study, id.to_string()),
        };
        let state = standing.map_or("deleted", |standing| standing.state);
        let item = ChangedItem { id, state, version: standing.map(|standing| standing.version) };
        let data = serde_json::to_string(&item).unwrap_or_default();
        Some(Event::default().event(name.name()).id(id_of(number)).data(data))
    }
}
