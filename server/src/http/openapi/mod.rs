//! The interface as an OpenAPI document: what the handlers say of themselves, the problems each can
//! give, and what holds everywhere.
//!
//! `packstone openapi` prints it, `openapi.yaml` at the root of the repository equals it.

pub(crate) mod request_schemas;

use serde::Serialize;
use serde_json::{Map, Value, json};
use utoipa::openapi::OpenApi;
use utoipa::{OpenApi as _, ToSchema};

use crate::http::exports::formats::{self, FormatOptions, ResultFormat, SliceDocument};
use crate::http::jobs::view::Job;
use crate::http::negotiation::TableFormat;
use crate::http::observe;
use crate::http::problems::sets::problem_response;
use crate::http::studies::list::StateParameter;
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
pub(crate) fn base() -> OpenApi {
    let mut document = Base::openapi();
    document.info.description = Some(DESCRIPTION.into());
    document
}

/// The answer of a submission that made no job: the one that there is, or a plan.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
#[allow(dead_code, clippy::large_enum_variant)]
pub(crate) enum JobOrPlan {
    /// The job that the same key brought before.
    Job(Job),
    /// With `dry_run=true`: what the job would amount to.
    Plan(Plan),
}

/// A result in JSON.
#[derive(Serialize, ToSchema)]
#[schema(as = ResultDocument)]
#[allow(dead_code)]
pub(crate) struct ResultDocument {
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
    /// What a user should know about this packing, one sentence each; empty where there is nothing.
    warnings: Vec<String>,
    /// The growth of grains over the run; absent for methods that do not grow them.
    #[schema(required = false)]
    growth_curve: Vec<GrowthPoint>,
    /// The grains.
    spheres: SphereTable,
}

/// The grains of a result, largest first; the row number is the grain's id.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct SphereTable {
    /// Names of the columns.
    #[schema(example = json!(["x_mm", "y_mm", "z_mm", "d_mm"]))]
    columns: [String; 4],
    /// One row a grain.
    rows: Vec<[f64; 4]>,
}

/// Adds what holds for every route, and what the derives cannot say.
pub(crate) fn finished(document: &OpenApi) -> Value {
    let mut value = serde_json::to_value(document).unwrap_or_default();
    add_everywhere(&mut value);
    add_media_types(&mut value);
    add_links(&mut value);
    request_schemas::polish(&mut value);
    value
}

/// Says in which media types models come: as many as there are of them.
fn add_media_types(document: &mut Value) {
    let cuts = slice::SliceFormat::ALL.map(slice::SliceFormat::media_type);
    let lattice = ldpm::LatticeFormat::Cells.media_type();
    let models: Vec<_> = formats::models().map(formats::media_type).chain([lattice]).collect();
    let file = "/v1/jobs/{id}/exports/{export_id}/file";
    for (path, media_types) in [("/v1/jobs/{id}/result", &models), (file, &[&cuts[..], &models].concat())] {
        for status in ["200", "206"] {
            let content = &mut document["paths"][path]["get"]["responses"][status]["content"];
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
                responses.entry("503").or_insert_with(|| problem(Kind::NotReady));
                responses.insert("507".into(), problem(Kind::InsufficientStorage));
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
