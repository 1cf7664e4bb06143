//! A job's events as they happen (server-sent events).
//!
//! Three kinds: `state` (the job, without its request, whenever it moves), `progress`, and `end`,
//! after which the stream closes. An event's id is the version of the job, so a client that comes
//! back with `Last-Event-ID` gets what is newer. Each stream sleeps until its job changes; what
//! changed in between is told once, as it stands then.

use std::convert::Infallible;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use axum::response::sse::Event;
use futures_util::stream::{self, Stream};
use serde::Serialize;
use serde_json::Value;

use crate::http::app::App;
use crate::http::event_stream::event_stream;
use crate::http::jobs::view::JobSummary;
use crate::http::params::{IdPath, JobPath, NoParameters, Query};
use crate::http::problems::refused;
use crate::jobs::notifications::Subscription;
use crate::jobs::store::StoreError;
use crate::jobs::{self, JobId, JobRecord};
use crate::problem::Problem;

/// One event of the stream.
#[derive(Debug)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct JobEvent {
    /// What the event tells.
    event: EventName,
    /// Version of the job, for `Last-Event-ID`.
    #[cfg_attr(test, schema(pattern = "^[0-9]+$"))]
    id: String,
    /// The job without its request, or its progress; JSON.
    #[cfg_attr(test, schema(content_media_type = "application/json"))]
    data: String,
}

/// What an event tells.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub(crate) enum EventName {
    /// The job moved.
    State,
    /// A running job came on.
    Progress,
    /// The job ended; the stream closes.
    End,
}

impl EventName {
    fn name(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Progress => "progress",
            Self::End => "end",
        }
    }
}

impl From<JobEvent> for Event {
    fn from(event: JobEvent) -> Self {
        Self::default().event(event.event.name()).id(event.id).data(event.data)
    }
}

/// Follow a job
///
/// Events `state` and `end` carry the job without its request, `progress` its progress. The stream
/// ends after `end`; it may end earlier when the server stops, and is resumed by `Last-Event-ID`.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/events", tag = "jobs", operation_id = "get_job_events",
    params(
        JobPath,
        ("Last-Event-ID" = Option<String>, Header, description = "Id of the last event seen"),
    ),
    responses(
        (status = 200, description = "Events until the job ends", body = JobEvent, content_type = "text/event-stream"),
        crate::http::problems::sets::JobProblems
    )
))]
pub(crate) async fn events(
    State(app): State<App>,
    IdPath(id): JobPath,
    _: Query<NoParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let changes = app.shared.store.subscribe(id);
    // Known to exist before the stream begins: afterwards there is no status left to say so.
    let found = app.shared.store.get(id).await.and_then(|job| job.ok_or(StoreError::NoJob));
    found.map_err(|error| refused(error, id))?;
    let last_seen = headers
        .get("last-event-id")
        .and_then(|value| value.to_str().ok())
        .and_then(|value| value.trim().parse().ok())
        .unwrap_or(0);
    let following = Following {
        app,
        id,
        changes,
        told: Told { version: last_seen, ..Told::default() },
        queue: Vec::new(),
        ended: false,
    };
    Ok(event_stream(follow(following)))
}

/// State, attempt, requests to cancel and to finish, and until when it is not started: a job has moved where one of
/// them differs.
type Moved = (jobs::State, i64, bool, bool, Option<i64>);

fn moved(job: &JobRecord) -> Moved {
    (job.state, job.attempt, job.cancel_requested, job.finish_requested, job.not_before)
}

/// What a stream has told its client.
#[derive(Debug, Default)]
struct Told {
    version: i64,
    state: Option<Moved>,
    progress: Option<Value>,
}

struct Following {
    app: App,
    id: JobId,
    changes: Subscription<JobId>,
    told: Told,
    /// Events that are due, last first.
    queue: Vec<Event>,
    ended: bool,
}

fn follow(following: Following) -> impl Stream<Item = Result<Event, Infallible>> {
    stream::unfold((following, true), |(mut following, mut look)| async move {
        loop {
            if let Some(event) = following.queue.pop() {
                return Some((Ok(event), (following, look)));
            }
            if following.ended {
                return None;
            }
            if !look {
                tokio::select! {
                    () = following.changes.changed() => {}
                    () = following.app.shared.shutdown.cancelled() => {
                        following.ended = true;
                        return Some((Ok(Event::default().comment("the server stops")), (following, look)));
                    }
                }
            }
            look = false;
            match following.app.shared.store.get(following.id).await {
                Ok(Some(job)) => {
                    following.ended = job.state.is_finished();
                    match JobSummary::of_one(&following.app, &job).await {
                        Ok(summary) => following.queue = following.told.news(&job, &summary),
                        Err(error) => {
                            tracing::error!(%error, "an event stream ends early");
                            following.ended = true;
                        }
                    }
                    following.queue.reverse();
                }
                Ok(None) => following.ended = true,
                Err(error) => {
                    tracing::error!(%error, "an event stream ends early");
                    following.ended = true;
                }
            }
        }
    })
}

impl Told {
    /// The events that tell a client what it does not know yet.
    fn news(&mut self, job: &JobRecord, summary: &JobSummary) -> Vec<Event> {
        let whole = serde_json::to_value(summary).unwrap_or_default();
        let mut events = Vec::new();
        let mut tell = |event, data: &Value| {
            let event = JobEvent { event, id: job.version.to_string(), data: data.to_string() };
            events.push(event.into());
        };
        if job.version > self.version {
            if self.state != Some(moved(job)) {
                tell(EventName::State, &whole);
            }
            if job.progress.is_some() && job.progress != self.progress {
                tell(EventName::Progress, job.progress.as_ref().unwrap_or(&Value::Null));
            }
        }
        // A client that missed the end must see it, whatever it saw before.
        if job.state.is_finished() {
            tell(EventName::End, &whole);
        }
        self.version = self.version.max(job.version);
        self.state = Some(moved(job));
        self.progress.clone_from(&job.progress);
        events
    }
}
