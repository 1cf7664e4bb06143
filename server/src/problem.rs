//! Problem documents (RFC 9457): the one form in which this service reports errors.
//!
//! [`Kind`] lists every kind of problem that a client can meet, with status, title and meaning. A [`Failure`] of the
//! layers below becomes a problem here; the kinds that only end jobs or exports have no status, because they are
//! shown inside the document of a job or an export and are never a response.

use packstone_engine::export::ExportError;
use packstone_engine::{FieldError, PlanError};
use serde::Serialize;

use crate::advice::can_succeed_again;
use crate::base_path;
use crate::failure::{Failure, FailureCode, FailureFacts, first_of};

/// Stands in the table for the end of a job or an export, which is no response and has no status.
const END: u16 = 0;

macro_rules! kinds {
    ($($variant:ident $slug:literal $status:literal $title:literal $meaning:literal)*) => {
        /// Every kind of problem.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub(crate) enum Kind { $(#[doc = $meaning] $variant,)* }

        impl Kind {
            /// All of them, in the order of the documentation.
            pub(crate) const ALL: &[Self] = &[$(Self::$variant,)*];

            /// Last segment of the `type`.
            pub(crate) fn slug(self) -> &'static str {
                match self { $(Self::$variant => $slug,)* }
            }

            /// HTTP status, unless the place of the fault says otherwise; none for the end of a job or an export.
            pub(crate) fn status(self) -> Option<u16> {
                match self { $(Self::$variant => Some($status).filter(|status| *status != END),)* }
            }

            /// What it is called; the same for every occurrence.
            pub(crate) fn title(self) -> &'static str {
                match self { $(Self::$variant => $title,)* }
            }

            /// When it occurs and what to do about it.
            pub(crate) fn meaning(self) -> &'static str {
                match self { $(Self::$variant => $meaning,)* }
            }
        }
    };
}

kinds! {
    MalformedJson "malformed-json" 400 "Malformed JSON"
        "The body is not JSON. `errors` points to the place where reading stopped."
    MalformedRequest "malformed-request" 400 "Not a request of HTTP/1.1"
        "The request line, a header field or the framing of the body is not that of HTTP/1.1, so that no route was \
         asked. The connection is closed. Look at what is between the client and this server: it may speak HTTP/2 or \
         TLS, or cut requests."
    HeadTooLarge "head-too-large" 431 "The head of the request is too large"
        "The request line and the header fields together have more bytes, or more fields, than this server reads. Send \
         fewer or shorter cookies, filters and fields."
    ValidationError "validation-error" 422 "Invalid field"
        "A field of the body (422), or a parameter or header (400), is unknown, missing, of the wrong type or out of \
         its bounds. `errors` lists every such fault with its place, the value found and the bound."
    InfeasibleMix "infeasible-mix" 422 "The mix cannot fit"
        "No arrangement of spheres reaches the requested volume fraction. Lower it, shorten the distance, or raise \
         the smallest diameter."
    CoarseMix "coarse-mix" 422 "Whole grains miss the volume of the mix"
        "The requested volume is so small for its grains that whole grains miss it by more than 5 %. Take a larger \
         specimen, a larger volume fraction or a smaller largest grain, list the diameters, or set \
         `mix.allow_coarse`; the deviation is then a warning. As the end of a job: the grains that were sampled for \
         its seed miss the volume."
    TooLarge "too-large" 422 "The packing, the study or the export is too large"
        "The request needs more grains, more memory, or more jobs of a study, than this server allows; \
         `/v1/capabilities` tells the limits. Raise the smallest diameter, take a smaller specimen, or divide the \
         study. For an export, `errors` names the option and the memory or bytes that it would take; choose a \
         coarser one."
    FormatNotAvailable "format-not-available" 422 "Not available for this packing"
        "This format or export does not exist for such a specimen or packing, for example a surface mesh for a \
         periodic box; `detail` says what to do instead."
    Unauthorized "unauthorized" 401 "Unauthorized"
        "The request carries no known API key. Send `Authorization: Bearer KEY`."
    Forbidden "forbidden" 403 "Not allowed"
        "The role of the API key does not allow this, the job or study belongs to another owner who shares it for reading \
         only, or the request comes from a page of another site; `detail` says which. `GET /v1/key` tells the role of a \
         key."
    NotFound "not-found" 404 "Not found"
        "There is no such route, job, study or export; what has expired is deleted too."
    ResultNotReady "result-not-ready" 409 "No result yet"
        "The job has not finished. Ask again after `Retry-After`, wait for its end with `Prefer: wait=N` on the job, \
         or follow its events."
    MethodNotAllowed "method-not-allowed" 405 "Method not allowed"
        "The route does not know this method; `Allow` names the methods it knows."
    NotAcceptable "not-acceptable" 406 "Not acceptable"
        "A result or a table has no format that `Accept` or `format` names; `formats` lists the formats it has."
    RequestTimeout "request-timeout" 408 "The request took too long"
        "The body arrived with too long a pause, or too slowly. Send it again without pauses."
    Conflict "conflict" 409 "The state of the job or study forbids it"
        "The job or study is in a state in which this cannot be done: a finished one cannot be cancelled, an \
         unfinished one cannot be deleted, only a failed or cancelled job can be retried, and a job keeps a bounded \
         number of exports."
    JobFailed "job-failed" 409 "The job has no result"
        "The job failed or was cancelled, so that there never will be a result; `job_error` says why. Retry it, or \
         submit another."
    ExportFailed "export-failed" 409 "The export failed"
        "The file could not be made of the result; `export_error` says why. Delete the export, or request it with \
         other options."
    LeaseLost "lease-lost" 409 "The lease was lost"
        "A worker renews or ends the lease of a job that is another attempt's by now, or gone. Nothing is changed; the \
         worker drops its attempt."
    WorkerRefused "worker-refused" 409 "The worker does not fit the server"
        "The worker is another build than the server, or packs other bits, so that its results could differ; `detail` \
         says which. Start the same build."
    WorkerBlocked "worker-blocked" 409 "The worker is blocked"
        "The worker process has sent three wrong results, so that its machine or its program is at fault. It gets no job \
         until an administrator allows it again: on the page of the service, or by `POST /v1/workers/allow`."
    PayloadTooLarge "payload-too-large" 413 "The body is too large"
        "The body is longer than this server reads; `/v1/capabilities` tells the limit."
    UnsupportedMediaType "unsupported-media-type" 415 "Unsupported media type"
        "Bodies are JSON (`Content-Type: application/json`) without content encoding."
    RangeNotSatisfiable "range-not-satisfiable" 416 "The range lies beyond the end"
        "The first requested byte does not exist; `Content-Range` tells the length."
    IdempotencyKeyReused "idempotency-key-reused" 422 "Idempotency key reused"
        "The key was used before with another body. Take a new key for a new job or study."
    QueueFull "queue-full" 429 "The queue is full"
        "More jobs, or more exports, would wait than this server allows. Try again after `Retry-After`."
    TooManyRequests "too-many-requests" 429 "Too many requests"
        "The API key sends more requests than it may; `detail` tells the rate. Send the next one after `Retry-After`. \
         Hold an answer back with `Prefer: wait=N`, or follow the events of a job, instead of asking again and again."
    Busy "busy" 503 "Busy"
        "The server already sends as many results, draws as many plots, computes as many plans, serves as many \
         connections, or holds as many bytes of requests and answers in memory as it is configured for. Try again after \
         `Retry-After`."
    PreconditionFailed "precondition-failed" 412 "The resource has changed"
        "`If-Match` names another state than the present one, so nothing was changed. Get the resource again, and \
         repeat the request with its present `ETag` if the change is still needed."
    InsufficientStorage "insufficient-storage" 507 "No space is left"
        "The disk of the server, or a quota, has no space for what this needs; `detail` has the figures. Delete \
         jobs, studies or exports, or ask again after `Retry-After`."
    MachineFault "machine-fault" 503 "A fault of the machine"
        "The file system, the database or another resource of the machine failed. Jobs wait and are tried again; \
         repeat the request after `Retry-After`."
    OutOfMemory "out-of-memory" 503 "Out of memory"
        "The end of a job or of an export: the system refused memory that it needs, in each of six attempts. Take \
         fewer grains or a coarser export, give the server more memory, or lower `--workers`."
    NotReady "not-ready" 503 "Not ready"
        "The server is starting or stopping, or cannot write to its data directory; or its database does not answer, \
         is damaged, or was moved or replaced. `detail` says which."
    ResultDamaged "result-damaged" 410 "The stored result is damaged"
        "The file of the result is missing, or is not what was stored. Retry the job: it packs the same spheres again."
    InternalError "internal-error" 500 "Internal error"
        "A fault of this server, recorded in its log under the request's or the job's id."
    TargetNotReached "target-not-reached" 0 "The packing was not reached"
        "The end of a job: the method ended before all grains were inserted, or before they had grown to their size \
         and distance. The document tells how far it came. Another seed, a lower volume fraction or another method \
         may succeed; `on_limit` \"keep\" keeps the packing that is reached."
    TimedOut "timed-out" 0 "The job timed out"
        "The end of a job: it ran longer than its `timeout_s`. `on_limit` \"keep\" keeps the packing that is reached."
    AttemptsExhausted "attempts-exhausted" 0 "Too many attempts"
        "The end of a job or of an export: the server stopped while it ran, as often as its `max_attempts` allows \
         (three times for an export). The task itself may be what stops the server, for example by the memory it \
         needs."
    CheckFailed "check-failed" 0 "The packing or the export failed its check"
        "The end of a job or of an export: the independent check refused the packing or the file. This is a defect \
         of the program; please report it with the request."
}

impl Kind {
    /// The `type` of the document: a reference that this server answers.
    pub(crate) fn type_uri(self) -> String {
        base_path::absolute(&format!("/problems/{}", self.slug()))
    }

    /// The kind of that slug.
    pub(crate) fn from_slug(slug: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|k| k.slug() == slug)
    }
}

/// One fault: in the body (`pointer`), the query (`parameter`) or the header section (`header`).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct Fault {
    /// RFC 6901 pointer into the body; empty for the body itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) pointer: Option<String>,
    /// Name of the query parameter.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) parameter: Option<String>,
    /// Name of the header field.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    pub(crate) header: Option<String>,
    /// What is wrong: the value found and the bound it breaks.
    pub(crate) detail: String,
}

impl Fault {
    /// A fault in a query parameter.
    pub(crate) fn parameter(name: &str, detail: impl Into<String>) -> Self {
        Self { parameter: Some(name.into()), detail: detail.into(), ..Self::default() }
    }

    /// A fault in a header field.
    pub(crate) fn header(name: &str, detail: impl Into<String>) -> Self {
        Self { header: Some(name.into()), detail: detail.into(), ..Self::default() }
    }

    fn place(&self) -> &str {
        match (&self.pointer, &self.parameter, &self.header) {
            (Some(p), _, _) if p.is_empty() => "document",
            (Some(place), _, _) | (_, Some(place), _) | (_, _, Some(place)) => place,
            _ => "request",
        }
    }
}

impl From<FieldError> for Fault {
    fn from(error: FieldError) -> Self {
        Self { pointer: Some(error.pointer), detail: error.detail, ..Self::default() }
    }
}

/// What problems of some kinds tell besides.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Members {
    /// State of the job or study that forbids the request.
    pub(crate) state: Option<&'static str>,
    /// Formats that there are, with `not-acceptable`.
    pub(crate) formats: Option<Vec<KnownFormat>>,
    /// Longest body in bytes, with `payload-too-large`.
    pub(crate) max_bytes: Option<u64>,
    /// Why the job failed, with `job-failed`.
    pub(crate) job_error: Option<FailureDocument>,
    /// Why the export failed, with `export-failed`.
    pub(crate) export_error: Option<FailureDocument>,
    /// Figures.
    pub(crate) facts: FailureFacts,
}

/// A format that a result or a table has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct KnownFormat {
    /// Its name in `?format=`.
    pub(crate) format: &'static str,
    /// Its media type, for `Accept`.
    pub(crate) media_type: &'static str,
}

/// A problem that occurred.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Problem {
    pub(crate) kind: Kind,
    pub(crate) status: u16,
    pub(crate) detail: String,
    pub(crate) errors: Vec<Fault>,
    /// What problems of some kinds tell besides.
    pub(crate) members: Box<Members>,
    /// Header fields that the response needs, as `Allow`.
    pub(crate) headers: Vec<(&'static str, String)>,
}

impl Problem {
    /// A problem of a kind, with one sentence on this occurrence.
    pub(crate) fn new(kind: Kind, detail: impl Into<String>) -> Self {
        Self {
            kind,
            status: kind.status().unwrap_or(500),
            detail: detail.into(),
            errors: Vec::new(),
            members: Box::default(),
            headers: Vec::new(),
        }
    }

    /// A fault of this server. What exactly is for the log, not for the client.
    pub(crate) fn internal() -> Self {
        Self::new(Kind::InternalError, "the server could not complete the request; its log says why")
    }

    /// There is no such job.
    pub(crate) fn no_job(id: &str) -> Self {
        let shown: String = id.chars().take(64).collect();
        Self::new(Kind::NotFound, format!("there is no job {shown:?}"))
    }

    /// There is no such study.
    pub(crate) fn no_study(id: &str) -> Self {
        let shown: String = id.chars().take(64).collect();
        Self::new(Kind::NotFound, format!("there is no study {shown:?}"))
    }

    /// The job of that ID does not have the export any more.
    pub(crate) fn no_export(id: &str) -> Self {
        let shown: String = id.chars().take(64).collect();
        Self::new(Kind::NotFound, format!("the job {shown:?} has no such export any more"))
    }

    /// Faulty fields of the body.
    pub(crate) fn fields(code: FailureCode, faults: Vec<FieldError>) -> Self {
        Failure::fields(code, faults).into()
    }

    /// Faulty parameters or header fields.
    pub(crate) fn parameters(faults: Vec<Fault>) -> Self {
        let mut problem = Self::new(Kind::ValidationError, "").with_errors(faults);
        problem.status = 400;
        problem
    }

    /// Takes the faults, and their first one as the detail.
    fn with_errors(mut self, faults: Vec<Fault>) -> Self {
        if let Some(first) = faults.first() {
            self.detail = first_of(&format!("{}: {}", first.place(), first.detail), faults.len());
        }
        self.errors = faults;
        self
    }

    /// The same of fields that came as parameters: each named by the first segment of its pointer, as whoever asked
    /// calls it. Faults of the request make it a bad one.
    pub(crate) fn of_parameters(mut self, called: impl Fn(&str) -> String) -> Self {
        let faults: Vec<Fault> = std::mem::take(&mut self.errors)
            .into_iter()
            .map(|fault| {
                let Some(pointer) = fault.pointer else { return fault };
                let mut segments = pointer.trim_start_matches('/').splitn(2, '/');
                let name = called(&segments.next().unwrap_or_default().replace("~1", "/").replace("~0", "~"));
                let detail = match segments.next() {
                    Some(inner) => format!("/{inner}: {}", fault.detail),
                    None => fault.detail,
                };
                Fault::parameter(&name, detail)
            })
            .collect();
        if self.kind == Kind::ValidationError {
            self.status = 400;
        }
        if faults.is_empty() { self } else { self.with_errors(faults) }
    }

    /// The same where the request is right by itself, but its parameters do not fit what it names.
    pub(crate) fn of_unfit_parameters(self, called: impl Fn(&str) -> String) -> Self {
        let status = self.status;
        Self { status, ..self.of_parameters(called) }
    }

    /// Tells more than the kind and the detail.
    pub(crate) fn with(mut self, tell: impl FnOnce(&mut Members)) -> Self {
        tell(&mut self.members);
        self
    }

    /// Adds a header field to the response.
    pub(crate) fn with_header(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.headers.push((name, value.into()));
        self
    }

    /// The document of a response to the request `instance`.
    pub(crate) fn document(&self, instance: Option<String>) -> ProblemDocument {
        let Members { state, formats, max_bytes, job_error, export_error, facts } = (*self.members).clone();
        ProblemDocument {
            r#type: self.kind.type_uri(),
            title: self.kind.title(),
            status: self.status,
            detail: self.detail.clone(),
            instance,
            errors: self.errors.clone(),
            state,
            formats,
            max_bytes,
            job_error,
            export_error,
            facts,
        }
    }
}

impl From<FailureCode> for Kind {
    fn from(code: FailureCode) -> Self {
        match code {
            FailureCode::MalformedJson => Self::MalformedJson,
            FailureCode::ValidationError => Self::ValidationError,
            FailureCode::InfeasibleMix => Self::InfeasibleMix,
            FailureCode::CoarseMix => Self::CoarseMix,
            FailureCode::TooLarge => Self::TooLarge,
            FailureCode::FormatNotAvailable => Self::FormatNotAvailable,
            FailureCode::TargetNotReached => Self::TargetNotReached,
            FailureCode::TimedOut => Self::TimedOut,
            FailureCode::AttemptsExhausted => Self::AttemptsExhausted,
            FailureCode::CheckFailed => Self::CheckFailed,
            FailureCode::InsufficientStorage => Self::InsufficientStorage,
            FailureCode::ResultDamaged => Self::ResultDamaged,
            FailureCode::MachineFault => Self::MachineFault,
            FailureCode::OutOfMemory => Self::OutOfMemory,
            FailureCode::InternalError => Self::InternalError,
        }
    }
}

impl From<Failure> for Problem {
    fn from(failure: Failure) -> Self {
        let mut problem = Self::new(failure.code.into(), failure.detail);
        problem.errors = failure.fields.into_iter().map(Fault::from).collect();
        problem.members.facts = *failure.facts;
        if matches!(problem.kind, Kind::InsufficientStorage | Kind::MachineFault | Kind::OutOfMemory) {
            problem.headers.push(("retry-after", "30".into()));
        }
        problem
    }
}

impl From<PlanError> for Problem {
    fn from(error: PlanError) -> Self {
        Failure::from(error).into()
    }
}

impl From<ExportError> for Problem {
    fn from(error: ExportError) -> Self {
        Failure::from(error).into()
    }
}

/// The problem document as clients see it (RFC 9457).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = Problem))]
pub(crate) struct ProblemDocument {
    /// Which kind of problem; a reference that this server answers with an explanation.
    #[cfg_attr(test, schema(format = "uri-reference", example = "/problems/validation-error"))]
    r#type: String,
    /// What the kind is called.
    title: &'static str,
    /// HTTP status.
    #[cfg_attr(test, schema(minimum = 400, maximum = 599))]
    status: u16,
    /// This occurrence, in one sentence.
    detail: String,
    /// The request in which it occurred; the server's log knows it by this id.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(format = "uri-reference", required = false, nullable = false))]
    instance: Option<String>,
    /// Every fault, each at its place; at most 100, and one more entry that counts the others.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(test, schema(required = false))]
    errors: Vec<Fault>,
    /// State of the job or study that forbids the request.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    state: Option<&'static str>,
    /// Formats that there are, with `not-acceptable`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    formats: Option<Vec<KnownFormat>>,
    /// Longest body in bytes, with `payload-too-large`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    max_bytes: Option<u64>,
    /// Why the job failed, with `job-failed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    job_error: Option<FailureDocument>,
    /// Why the export failed, with `export-failed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schema(required = false, nullable = false))]
    export_error: Option<FailureDocument>,
    #[serde(flatten)]
    facts: FailureFacts,
}

/// Why a job or an export failed: a problem document (RFC 9457) without `status`, because it is no response.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
#[cfg_attr(test, schema(as = Failure))]
pub(crate) struct FailureDocument {
    /// The kind of failure; a reference that this server answers with an explanation.
    #[cfg_attr(test, schema(format = "uri-reference", example = "/problems/target-not-reached"))]
    r#type: String,
    /// What the kind is called.
    title: &'static str,
    /// This occurrence, in one sentence.
    detail: String,
    /// Every fault of the request, each at its place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(test, schema(required = false))]
    errors: Vec<Fault>,
    /// Whether a second run with the same request can succeed: where the machine or its load decided the end.
    can_retry: bool,
    #[serde(flatten)]
    facts: FailureFacts,
}

impl From<&Failure> for FailureDocument {
    fn from(failure: &Failure) -> Self {
        let kind = Kind::from(failure.code);
        Self {
            r#type: kind.type_uri(),
            title: kind.title(),
            detail: failure.detail.clone(),
            errors: failure.fields.iter().cloned().map(Fault::from).collect(),
            can_retry: can_succeed_again(failure),
            facts: (*failure.facts).clone(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn slugs_are_unique_and_statuses_are_errors() {
        let slugs: std::collections::HashSet<_> = Kind::ALL.iter().map(|k| k.slug()).collect();
        assert_eq!(slugs.len(), Kind::ALL.len());
        for &kind in Kind::ALL {
            assert_eq!(Kind::from_slug(kind.slug()), Some(kind));
            assert!(kind.status().is_none_or(|status| (400..600).contains(&status)), "{}", kind.slug());
            assert!(kind.meaning().ends_with('.') && !kind.title().is_empty(), "{}", kind.slug());
        }
    }

    #[test]
    fn a_document_names_every_fault_and_details_the_first() {
        let faults = vec![
            FieldError { pointer: "/mix/d_min_mm".into(), detail: "-1 is out of range".into() },
            FieldError { pointer: String::new(), detail: "no".into() },
        ];
        let document = Problem::fields(FailureCode::ValidationError, faults).document(None);
        let document = serde_json::to_value(document).unwrap();
        assert_eq!(document["type"], "/problems/validation-error");
        assert_eq!(document["status"], 422);
        assert_eq!(document["detail"], "/mix/d_min_mm: -1 is out of range (and 1 more)");
        assert_eq!(document["errors"][1], json!({"pointer": "", "detail": "no"}));
    }

    #[test]
    fn every_failure_has_its_kind_and_ends_have_no_status() {
        for &code in FailureCode::ALL {
            assert_eq!(Kind::from(code).slug(), code.name());
        }
        let facts = FailureFacts { grains: Some(7), ..FailureFacts::default() };
        let failure = Failure::new(FailureCode::TargetNotReached, "stopped").with_facts(facts);
        let shown = serde_json::to_value(FailureDocument::from(&failure)).unwrap();
        assert_eq!(
            shown,
            json!({"type": "/problems/target-not-reached", "title": Kind::TargetNotReached.title(),
                "detail": "stopped", "can_retry": false, "grains": 7})
        );
    }

    #[test]
    fn a_problem_of_fields_can_be_told_of_parameters() {
        let fault = |pointer: &str| FieldError::new(pointer, "9 is too much");
        let problem = Problem::fields(FailureCode::TooLarge, vec![fault("/cells"), fault("/mix/air")]);
        let asked = problem.of_parameters(|name| name.replace("cells", "n"));
        assert_eq!((asked.status, asked.detail.as_str()), (422, "n: 9 is too much (and 1 more)"));
        assert_eq!(asked.errors[1], Fault::parameter("mix", "/air: 9 is too much"));
        let invalid =
            Problem::fields(FailureCode::ValidationError, vec![fault("/a~1b")]).of_parameters(str::to_owned);
        assert_eq!((invalid.status, invalid.errors[0].parameter.as_deref()), (400, Some("a/b")));
    }

    #[test]
    fn faulty_parameters_are_bad_requests() {
        let document =
            Problem::parameters(vec![Fault::parameter("limit", "0 is out of range")]).document(None);
        let document = serde_json::to_value(document).unwrap();
        assert_eq!(document["status"], 400);
        assert_eq!(document["errors"], json!([{"parameter": "limit", "detail": "0 is out of range"}]));
    }
}
