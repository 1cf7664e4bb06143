//! The interface as an OpenAPI document: what the handlers say of themselves, the problems each can
//! give, and what holds everywhere.
//!
//! `packstone openapi` prints it, `openapi.yaml` at the root of the repository equals it.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Map, Value, json};
use utoipa::openapi::response::{Response, ResponseBuilder};
use utoipa::openapi::{ContentBuilder, OpenApi, Ref, RefOr};
use utoipa::{IntoResponses, OpenApi as _, ToSchema};

use super::formats::{self, FormatOptions, ResultFormat, SliceDocument};
use super::job_view::Job;
use super::negotiation::TableFormat;
use super::problem::PROBLEM_JSON;
use super::study_list::StateParameter;
use super::{observe, request_schemas, router};
use crate::plots::job::JobPlot;
use crate::plots::study::StudyPlot;
use crate::problem::{Kind, ProblemDocument};
use packstone_engine::Plan;
use packstone_engine::export::ldpm;
use packstone_engine::export::slice;
use packstone_engine::export::tables::EngineInfo;
use packstone_engine::packing::{CheckReport, GrowthPoint, Statistics, Summary, Timings};

use crate::jobs::JobRequest;

const DESCRIPTION: &str = "Packstone turns a concrete mix design into a dense, checked packing of spheres.\n\n\
Submit a job, wait for its end (`Prefer: wait=N`, long-polling by tag, or server-sent events), fetch the result in \
the format you need. Every length is in mm, every time in s, every fraction from 0 to 1. Objects that have variants \
are tagged by `type`; unknown fields and parameters are refused. Every error is a problem document (RFC 9457) whose \
`type` this server explains.";

#[derive(utoipa::OpenApi)]
#[openapi(
    info(title = "Packstone", license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0")),
    tags(
        (name = "jobs", description = "Packings to compute"),
        (name = "studies", description = "Many packings from one request, and what they came to"),
        (name = "results", description = "What came out"),
        (name = "service", description = "The service about itself"),
    ),
    // What only parameters refer to is not found by itself.
    components(schemas(
        ProblemDocument, JobRequest, ResultDocument, JobPlot, StudyPlot, StateParameter, TableFormat,
        ResultFormat, FormatOptions, SliceDocument
    ))
)]
struct Base;

/// The document without its routes.
pub(super) fn base() -> OpenApi {
    let mut document = Base::openapi();
    document.info.description = Some(DESCRIPTION.into());
    document
}

/// The answer of a submission that made no job: the one that there is, or a plan.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
#[allow(dead_code, clippy::large_enum_variant)]
pub(super) enum JobOrPlan {
    /// The job that the same key brought before.
    Job(Job),
    /// With `dry_run=true`: what the job would amount to.
    Plan(Plan),
}

/// A result in JSON.
#[derive(Serialize, ToSchema)]
#[schema(as = ResultDocument)]
#[allow(dead_code)]
pub(super) struct ResultDocument {
    /// The job.
    #[schema(format = "uuid")]
    job_id: String,
    /// The request as submitted, with its defaults filled in.
    request: JobRequest,
    /// What computed the result.
    engine: EngineInfo,
    /// The figures people ask for first.
    summary: Summary,
    /// Wall-clock time of each phase, in s.
    timings_s: Timings,
    /// What the algorithms counted.
    statistics: Statistics,
    /// What the independent check found.
    check: CheckReport,
    /// Packing time in s and distance reached in mm, where the largest distance was asked for; else empty.
    distance_curve: Vec<[f64; 2]>,
    /// The growth of grains over the run; absent for methods that do not grow them.
    #[schema(required = false)]
    growth_curve: Vec<GrowthPoint>,
    /// The grains.
    spheres: SphereTable,
}

/// The grains of a result, largest first; the row number is the grain's id.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(super) struct SphereTable {
    /// Names of the columns.
    #[schema(example = json!(["x_mm", "y_mm", "z_mm", "d_mm"]))]
    columns: [String; 4],
    /// One row a grain.
    rows: Vec<[f64; 4]>,
}

/// Defines the set of problems that a route can give, by kind and status.
macro_rules! problem_sets {
    ($($(#[$doc:meta])* $name:ident: $($kind:ident $status:literal),*;)*) => {$(
        $(#[$doc])*
        pub(super) struct $name;

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
        UnsupportedMediaType 415, ValidationError 422, InfeasibleMix 422, TooLarge 422, FormatNotAvailable 422,
        IdempotencyKeyReused 422, QueueFull 429;
    /// Of routes about one study.
    StudyProblems: ValidationError 400, NotFound 404;
    /// Of retries of a study.
    StudyRetryProblems: ValidationError 400, NotFound 404, QueueFull 429;
    /// Of tables.
    TableProblems: ValidationError 400, NotFound 404, NotAcceptable 406;
    /// Of listings.
    ListProblems: ValidationError 400;
    /// Of actions that a job's state may forbid.
    ActionProblems: ValidationError 400, NotFound 404, Conflict 409;
    /// Of retries.
    RetryProblems: ValidationError 400, NotFound 404, Conflict 409, QueueFull 429;
    /// Of results.
    ResultProblems: ValidationError 400, NotFound 404, ResultNotReady 404, FormatNotReady 404, NotAcceptable 406,
        JobFailed 409, RangeNotSatisfiable 416, FormatNotAvailable 422, TooLarge 422, QueueFull 429, Busy 503;
    /// Of cuts.
    SliceProblems: ValidationError 400, NotFound 404, ResultNotReady 404, FormatNotReady 404, JobFailed 409,
        RangeNotSatisfiable 416, FormatNotAvailable 422, TooLarge 422, QueueFull 429, Busy 503;
    /// Of what is to be made of a result.
    ExportProblems: ValidationError 400, MalformedJson 400, NotFound 404, ResultNotReady 404, RequestTimeout 408,
        JobFailed 409, Conflict 409, PayloadTooLarge 413, UnsupportedMediaType 415, ValidationError 422,
        FormatNotAvailable 422, TooLarge 422, QueueFull 429;
    /// Of the files of what was made.
    ExportFileProblems: ValidationError 400, NotFound 404, ResultNotReady 404, ExportFailed 409,
        RangeNotSatisfiable 416, Busy 503;
    /// Of results without spheres.
    SummaryProblems: ValidationError 400, NotFound 404, ResultNotReady 404, JobFailed 409;
    /// Of plots.
    PlotProblems: ValidationError 400, NotFound 404, ResultNotReady 404, JobFailed 409, Busy 503;
    /// Of plots of studies.
    StudyPlotProblems: ValidationError 400, NotFound 404, Busy 503;
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

fn problem_response(description: &str) -> Response {
    let schema = Ref::from_schema_name("Problem");
    ResponseBuilder::new()
        .description(description)
        .content(PROBLEM_JSON, ContentBuilder::new().schema(Some(schema)).build())
        .build()
}

/// Adds what holds for every route, and what the derives cannot say.
pub(super) fn finished(document: &OpenApi) -> Value {
    let mut value = serde_json::to_value(document).unwrap_or_default();
    add_everywhere(&mut value);
    add_media_types(&mut value);
    add_links(&mut value);
    request_schemas::polish(&mut value);
    value
}

/// The document as YAML.
pub(crate) fn yaml() -> Result<String, yaml_serde::Error> {
    let text = yaml_serde::to_string(&router::document())?;
    // A letter that older YAML reads as yes or no.
    let quoted = |line: &str| match line.trim_start() {
        "- y" | "- n" => line.replace("- y", "- 'y'").replace("- n", "- 'n'"),
        _ => line.to_owned(),
    };
    Ok(text.lines().map(|line| quoted(line) + "\n").collect())
}

/// Says in which media types models come: as many as there are of them.
fn add_media_types(document: &mut Value) {
    let cuts = slice::Format::ALL.map(slice::Format::media_type);
    let lattice = ldpm::Format::Cells.media_type();
    let models: Vec<_> = formats::models().map(formats::media_type).chain([lattice]).collect();
    let file = "/v1/jobs/{id}/exports/{export_id}/file";
    for (path, media_types) in [("/v1/jobs/{id}/result", &models), (file, &[&cuts[..], &models].concat())] {
        for status in ["200", "206"] {
            let content = &mut document["paths"][path]["get"]["responses"][status]["proportions"];
            for media_type in media_types {
                let schema = if *media_type == "application/json" {
                    json!({"$ref": "#/components/schemas/SliceDocument"})
                } else {
                    json!({"type": "string", "contentMediaType": media_type})
                };
                content[*media_type] = json!({ "schema": schema });
            }
        }
    }
}

/// Says which routes take the id of what was submitted.
fn add_links(document: &mut Value) {
    for resource in ["/v1/jobs", "/v1/studies"] {
        document["paths"][resource]["post"]["responses"]["201"]["links"] = links(document, resource).into();
    }
}

fn links(document: &Value, resource: &str) -> Map<String, Value> {
    let mut links = Map::new();
    for (path, item) in document["paths"].as_object().into_iter().flatten() {
        for operation in item.as_object().into_iter().flatten().map(|(_, operation)| operation) {
            if let Some(id) = operation["operationId"].as_str()
                && path.strip_prefix(resource).is_some_and(|rest| rest.starts_with("/{id}"))
            {
                let link = json!({"operationId": id, "parameters": {"id": "$response.body#/id"}});
                links.insert(id.to_owned(), link);
            }
        }
    }
    links
}

fn add_everywhere(document: &mut Value) {
    let problem = |kind: Kind| {
        let description = format!("`{}`: {}", kind.slug(), kind.title());
        serde_json::to_value(problem_response(&description)).unwrap_or_default()
    };
    let Some(paths) = document["paths"].as_object_mut() else { return };
    for (path, item) in paths {
        let Some(operations) = item.as_object_mut() else { continue };
        for (method, operation) in operations {
            if !["get", "post", "delete"].contains(&method.as_str()) {
                continue;
            }
            let open = observe::OPEN_ROUTES.contains(&path.as_str());
            if open {
                operation["security"] = json!([]);
            }
            let Some(responses) = operation["responses"].as_object_mut() else { continue };
            responses.insert("500".into(), problem(Kind::InternalError));
            if !open {
                responses.insert("401".into(), problem(Kind::Unauthorized));
            }
            responses.sort_keys();
        }
    }
    document["components"]["securitySchemes"] = json!({
        "api_key": {
            "type": "http",
            "scheme": "bearer",
            "description": "An API key, where the server was given any; without them it listens to its own machine only."
        }
    });
    document["security"] = json!([{}, {"api_key": []}]);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_checked_in_document_is_this_one() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../openapi.yaml");
        let checked_in = std::fs::read_to_string(file).unwrap_or_default();
        assert!(
            checked_in == yaml().unwrap(),
            "openapi.yaml is not what the code says: run `cargo run -- openapi > openapi.yaml`"
        );
    }

    #[test]
    fn every_reference_leads_somewhere() {
        fn references<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
            match value {
                Value::Object(members) => {
                    found.extend(members.get("$ref").and_then(Value::as_str));
                    members.values().for_each(|member| references(member, found));
                }
                Value::Array(items) => items.iter().for_each(|item| references(item, found)),
                _ => {}
            }
        }
        let document = router::document();
        let mut found = Vec::new();
        references(&document, &mut found);
        assert!(found.len() > 100, "{}", found.len());
        for reference in found {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(document.pointer(pointer).is_some(), "{reference}");
        }
    }

    #[test]
    fn finishing_loses_nothing() {
        let value = router::document();
        assert_eq!(value["components"]["schemas"]["JobRequest"]["additionalProperties"], false);
        assert_eq!(
            value["paths"]["/v1/jobs"]["post"]["responses"]["500"]["proportions"][PROBLEM_JSON]["schema"]["$ref"],
            "#/components/schemas/Problem"
        );
        assert_eq!(value["components"]["securitySchemes"]["api_key"]["scheme"], "bearer");
    }
}
