//! Problems as responses.
//!
//! A handler answers with the bare status and leaves the problem in the response's extensions;
//! [`crate::http::observe`] writes the document, because only it knows the request's id.

use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

use packstone_engine::FieldError;

use crate::failure::Failure;
use crate::jobs::store::{Fault, StoreError, Unusable};
use crate::problem::{Kind, Problem};

/// Media type of the documents.
pub(crate) const PROBLEM_JSON: &str = "application/problem+json";

/// A problem waiting in a response's extensions to be written.
#[derive(Clone)]
pub(crate) struct Unwritten(pub(crate) Box<Problem>);

impl IntoResponse for Problem {
    fn into_response(mut self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = status.into_response();
        for (name, value) in std::mem::take(&mut self.headers) {
            if let Ok(value) = HeaderValue::try_from(value) {
                response.headers_mut().insert(HeaderName::from_static(name), value);
            }
        }
        response.extensions_mut().insert(Unwritten(Box::new(self)));
        response
    }
}

/// What the store refused, as the client sees it; `id` is the job or study it asked for.
pub(crate) fn refused(error: StoreError, id: impl std::fmt::Display) -> Problem {
    match error {
        StoreError::NoJob => Problem::no_job(&id.to_string()),
        StoreError::NoStudy => Problem::no_study(&id.to_string()),
        StoreError::NoExport => Problem::no_export(&id.to_string()),
        StoreError::StudyForbidden(state) => {
            Problem::new(Kind::Conflict, format!("the study {id} is {}, which forbids this", state.name()))
                .with(|members| members.state = Some(state.name()))
        }
        StoreError::Forbidden(state) => Problem::new(
            Kind::Conflict,
            format!("the state of job {id} is {}, which forbids this", state.name()),
        )
        .with(|members| members.state = Some(state.name())),
        StoreError::NothingReached(state, why) => {
            Problem::new(Kind::Conflict, format!("nothing can be kept of job {id}: {why}"))
                .with(|members| members.state = Some(state.name()))
        }
        other => other.into(),
    }
}

/// What a client learns of a fault of the machine: it passes, and the same request may succeed then.
pub(crate) fn of_fault(fault: Fault) -> Problem {
    let (kind, detail) = match fault {
        Fault::NoSpace => (Kind::InsufficientStorage, "the disk of the server is full"),
        Fault::Locked => (Kind::NotReady, "another program holds a lock on the database of the server"),
        Fault::Busy => (
            Kind::NotReady,
            "no connection to the database was free in time: as many requests read it as may at once, or it does not \
             answer",
        ),
        Fault::NoMemory => (Kind::NotReady, "the server has no memory left"),
        Fault::Damaged => (
            Kind::NotReady,
            "the database of the server is damaged: the operator has to restore it (docs/operation.md)",
        ),
        Fault::Io => (Kind::NotReady, "the server cannot read or write its files at present"),
    };
    Problem::new(kind, detail).with_header("retry-after", "5")
}

/// The answer where the store is not the one that was opened, or is silent.
pub(crate) fn unusable(why: &Unusable) -> Problem {
    Problem::new(Kind::NotReady, why.to_string()).with_header("retry-after", "5")
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::QueueFull { .. }
            | StoreError::OwnerQueueFull { .. }
            | StoreError::TooManyWait { .. } => {
                Self::new(Kind::QueueFull, error.to_string()).with_header("retry-after", "30")
            }
            StoreError::VersionDiffers => {
                Self::new(Kind::PreconditionFailed, "If-Match names another version than the present one")
            }
            StoreError::TooManyLabels { .. } => {
                Failure::invalid(vec![FieldError::new("/labels", error.to_string())]).into()
            }
            StoreError::KeyReused => {
                Self::new(Kind::IdempotencyKeyReused, "the Idempotency-Key came before with another body")
            }
            StoreError::WorkerBlocked { .. } => {
                Self::new(Kind::WorkerBlocked, error.to_string()).with_header("retry-after", "30")
            }
            StoreError::TooManyKept { .. } => Self::new(Kind::Conflict, error.to_string()),
            StoreError::NoExport => Self::new(Kind::NotFound, "it has been deleted meanwhile"),
            StoreError::NoJob => Self::new(Kind::NotFound, "there is no such job any more"),
            StoreError::NoStudy => Self::new(Kind::NotFound, "there is no such study any more"),
            other => {
                tracing::error!(error = %other, "the store failed");
                if let StoreError::Row(fault) = &other {
                    let detail = format!(
                        "a record of the database is damaged: {fault}. Other records can be read; the operator runs \
                         `packstone check`"
                    );
                    return Self::new(Kind::NotReady, detail).with_header("retry-after", "60");
                }
                if let StoreError::Unusable(why) = &other {
                    return unusable(why);
                }
                match other.fault() {
                    Some(fault) => of_fault(fault),
                    None => Self::internal(),
                }
            }
        }
    }
}
