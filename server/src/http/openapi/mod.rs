//! The interface as an OpenAPI document: what the handlers say of themselves, the problems each can
//! give, and what holds everywhere. Compiled in tests alone.

use packstone_engine::export::slice::SliceDocument;
use packstone_engine::request::BlendRequest;
use packstone_engine::samples::SampleRequest;
use serde_json::{Map, Value, json};
use utoipa::OpenApi as _;
use utoipa::openapi::OpenApi;

use crate::http::problems::sets::problem_response;
use crate::http::router::Documented;
use crate::http::{observe, session};
use crate::jobs::JobRequest;
use crate::problem::{Kind, ProblemDocument};
use crate::studies::Study;

pub(crate) mod strict;
mod webhooks;

const DESCRIPTION: &str = "Packstone turns a concrete mix design into a dense, checked packing of grains: spheres, ellipsoids \
or polyhedra.\n\n\
Submit a job, wait for its end (`Prefer: wait=N`, long polls by tag, or server-sent events), fetch the result and the \
exports that you need. Every length is in mm, every time in s, every fraction from 0 to 1. Objects that have variants \
are tagged by `type`; unknown fields and parameters are refused. Every error is a problem document (RFC 9457) whose \
`type` this server explains. The method is described in `docs/method.md`.\n\n\
Compatibility: addresses begin with the major version, `/v1`. Within it, fields, routes and parameters may be added; \
clients ignore fields that they do not know. What is to be removed is marked `deprecated` in this document and answered \
with a `Deprecation` header (RFC 9745) for at least one minor version before.";

#[derive(utoipa::OpenApi)]
#[openapi(
    servers((url = "/", description = "The server that this document comes from")),
    info(title = "Packstone", license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0")),
    tags(
        (name = "jobs", description = "Packings to compute"),
        (name = "studies", description = "Many packings from one request, and what they came to"),
        (name = "results", description = "What came out"),
        (name = "exports", description = "Meshes, voxel models, slices and lattice models of results"),
        (name = "workers", description = "Leases of jobs by worker processes of the same build"),
        (name = "service", description = "The service about itself"),
    ),
    // What responses that are made by hand refer to is not found by itself.
    components(schemas(
        packstone_engine::request::Amount, ProblemDocument, SliceDocument<'static>
    ))
)]
struct Base;

/// The document.
pub(crate) fn document() -> Value {
    let mut document = Base::openapi();
    document.info.description = Some(DESCRIPTION.into());
    finished(&document.merge_from(Documented::openapi()))
}

/// Adds what holds for every route and every request.
fn finished(document: &OpenApi) -> Value {
    let mut value = serde_json::to_value(document).unwrap_or_default();
    add_everywhere(&mut value);
    add_links(&mut value);
    value["webhooks"] = webhooks::webhooks();
    if let Some(schemas) = value["components"]["schemas"].as_object_mut() {
        strict::apply::<JobRequest>(schemas);
        strict::apply::<Study>(schemas);
        strict::apply::<BlendRequest>(schemas);
        strict::apply::<SampleRequest>(schemas);
        schemas.sort_keys();
    }
    value
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
            if !["get", "head", "post", "put", "patch", "delete"].contains(&method.as_str()) {
                continue;
            }
            let open = observe::OPEN_ROUTES.contains(&path.as_str());
            if open || path == session::ROUTE {
                operation["security"] = json!([]);
            }
            let Some(responses) = operation["responses"].as_object_mut() else { continue };
            responses.insert("500".into(), problem(Kind::InternalError));
            if !open {
                responses.insert("401".into(), problem(Kind::Unauthorized));
                responses.insert("403".into(), problem(Kind::Forbidden));
                responses.entry("503").or_insert_with(|| problem(Kind::NotReady));
                let too_many = problem(Kind::TooManyRequests);
                match responses.get_mut("429").map(|known| &mut known["description"]) {
                    Some(Value::String(known)) => {
                        known.push_str("; ");
                        known.push_str(too_many["description"].as_str().unwrap_or_default());
                    }
                    _ => drop(responses.insert("429".into(), too_many)),
                }
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
        },
        "session": {
            "type": "apiKey",
            "in": "cookie",
            "name": session::COOKIE,
            "description": "The session of a browser, from `POST /session`. Requests that may change something are taken \
                            from pages of this server only."
        }
    });
    document["security"] = json!([{}, {"api_key": []}, {"session": []}]);
}
