//! The problems that each route can give, as its part of the interface document.

use std::collections::BTreeMap;

use utoipa::IntoResponses;
use utoipa::openapi::response::{Response, ResponseBuilder};
use utoipa::openapi::{ContentBuilder, Ref, RefOr};

use crate::http::problems::PROBLEM_JSON;
use crate::problem::Kind;

/// Defines the set of problems that a route can give, by kind and status.
macro_rules! problem_sets {
    ($($(#[$doc:meta])* $name:ident: $($kind:ident $status:literal),*;)*) => {$(
        $(#[$doc])*
        pub(crate) struct $name;

        impl IntoResponses for $name {
            fn responses() -> BTreeMap<String, RefOr<Response>> {
                problem_responses(&[$((Kind::$kind, $status)),*])
            }
        }
    )*};
}

problem_sets! {
    /// Of routes about one job.
    JobProblems: ValidationError 400, NotFound 404;
    /// Of submissions.
    SubmitProblems: ValidationError 400, MalformedJson 400, RequestTimeout 408, PayloadTooLarge 413,
        UnsupportedMediaType 415, ValidationError 422, InfeasibleMix 422, CoarseMix 422, TooLarge 422, FormatNotAvailable 422,
        IdempotencyKeyReused 422, QueueFull 429, Busy 503;
    /// Of routes about one study.
    StudyProblems: ValidationError 400, NotFound 404;
    /// Of retries of a study.
    StudyRetryProblems: ValidationError 400, NotFound 404, PreconditionFailed 412, QueueFull 429;
    /// Of tables.
    TableProblems: ValidationError 400, NotFound 404, NotAcceptable 406;
    /// Of listings.
    ListProblems: ValidationError 400;
    /// Of changes of a job.
    PatchProblems: ValidationError 400, MalformedJson 400, NotFound 404, RequestTimeout 408, Conflict 409,
        PreconditionFailed 412, PayloadTooLarge 413, UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of changes of a study.
    StudyPatchProblems: ValidationError 400, MalformedJson 400, NotFound 404, RequestTimeout 408,
        PreconditionFailed 412, PayloadTooLarge 413, UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of actions that a job's state may forbid.
    ActionProblems: ValidationError 400, NotFound 404, Conflict 409, PreconditionFailed 412;
    /// Of retries.
    RetryProblems: ValidationError 400, NotFound 404, Conflict 409, PreconditionFailed 412, QueueFull 429;
    /// Of plans.
    PlanProblems: ValidationError 400, MalformedJson 400, RequestTimeout 408, PayloadTooLarge 413,
        UnsupportedMediaType 415, ValidationError 422, InfeasibleMix 422, TooLarge 422, FormatNotAvailable 422, Busy 503;
    /// Of readings of mixes, and of blends.
    MixReadingProblems: ValidationError 400, MalformedJson 400, RequestTimeout 408, PayloadTooLarge 413,
        UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of results.
    ResultProblems: ValidationError 400, NotFound 404, NotAcceptable 406, ResultNotReady 409, JobFailed 409, ResultDamaged 410,
        RangeNotSatisfiable 416, Busy 503;
    /// Of results without spheres.
    SummaryProblems: ValidationError 400, NotFound 404, ResultNotReady 409, JobFailed 409;
    /// Of the files of exports.
    ExportFileProblems: ValidationError 400, NotFound 404, ResultNotReady 409, JobFailed 409, ExportFailed 409,
        RangeNotSatisfiable 416, FormatNotAvailable 422, TooLarge 422, QueueFull 429, Busy 503;
    /// Of the start of exports.
    ExportStartProblems: ValidationError 400, NotFound 404, ResultNotReady 409, JobFailed 409, Conflict 409,
        UnsupportedMediaType 415, FormatNotAvailable 422, TooLarge 422, QueueFull 429, Busy 503;
    /// Of exports that exist.
    ExportStatusProblems: ValidationError 400, NotFound 404, ResultNotReady 409, JobFailed 409;
    /// Of plots.
    PlotProblems: ValidationError 400, NotFound 404, ResultNotReady 409, JobFailed 409, ResultDamaged 410,
        FormatNotAvailable 422, Busy 503;
    /// Of plots of studies.
    StudyPlotProblems: ValidationError 400, NotFound 404, ResultNotReady 409, FormatNotAvailable 422, Busy 503;
    /// Of requests of workers for jobs, and of renewals.
    LeaseProblems: ValidationError 400, MalformedJson 400, RequestTimeout 408, WorkerRefused 409, WorkerBlocked 409,
        PayloadTooLarge 413, UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of workers that are allowed again.
    AllowProblems: ValidationError 400, MalformedJson 400, NotFound 404, RequestTimeout 408, PayloadTooLarge 413,
        UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of the ends of leases.
    LeaseEndProblems: ValidationError 400, MalformedJson 400, NotFound 404, RequestTimeout 408, LeaseLost 409,
        PayloadTooLarge 413, UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of files that workers send.
    LeaseFileProblems: ValidationError 400, MalformedJson 400, NotFound 404, RequestTimeout 408, LeaseLost 409,
        ValidationError 422, Busy 503;
    /// Of checkpoints that workers fetch.
    CheckpointProblems: ValidationError 400, NotFound 404, LeaseLost 409, Busy 503;
    /// Of the beginnings of sessions.
    SessionProblems: ValidationError 400, MalformedJson 400, RequestTimeout 408, PayloadTooLarge 413,
        UnsupportedMediaType 415, ValidationError 422, Busy 503;
    /// Of routes that ask for nothing.
    OpenProblems: ValidationError 400;
    /// Of explanations.
    PageProblems: ValidationError 400, NotFound 404;
    /// Of the readiness probe.
    ReadyProblems: NotReady 503;
}

fn problem_responses(kinds: &[(Kind, u16)]) -> BTreeMap<String, RefOr<Response>> {
    let mut by_status: BTreeMap<u16, Vec<Kind>> = BTreeMap::new();
    for (kind, status) in kinds {
        by_status.entry(*status).or_default().push(*kind);
    }
    by_status
        .into_iter()
        .map(|(status, kinds)| {
            let lines: Vec<String> = kinds.iter().map(|k| format!("`{}`: {}", k.slug(), k.title())).collect();
            (status.to_string(), problem_response(&lines.join("; ")).into())
        })
        .collect()
}

/// A response that is a problem document.
pub(crate) fn problem_response(description: &str) -> Response {
    let schema = Ref::from_schema_name("Problem");
    ResponseBuilder::new()
        .description(description)
        .content(PROBLEM_JSON, ContentBuilder::new().schema(Some(schema)).build())
        .build()
}
