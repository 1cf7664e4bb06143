//! Holds answers against the published contract, `openapi.yaml` at the root of the repository.
//!
//! Knows `OpenAPI` 3.1 and JSON Schema; it must never know what a job is.

use std::collections::HashMap;
use std::fmt::Display;
use std::sync::{Arc, LazyLock, Mutex};

use boon::{Compiler, Draft, SchemaIndex, Schemas};
use serde_json::Value;

const DOCUMENT_URI: &str = "https://packstone.invalid/openapi.json";

/// The contract with its schemas.
pub(crate) struct Contract {
    document: Value,
    validators: Mutex<HashMap<String, Arc<Validator>>>,
}

/// One schema with all that it refers to.
struct Validator {
    schemas: Schemas,
    index: SchemaIndex,
}

static CONTRACT: LazyLock<Contract> = LazyLock::new(|| {
    let document: Value = yaml_serde::from_str(&text()).expect("openapi.yaml is YAML");
    Contract { document, validators: Mutex::default() }
});

/// The contract as it is checked in.
pub(crate) fn text() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../openapi.yaml");
    std::fs::read_to_string(path).expect("openapi.yaml stands at the root of the repository")
}

/// What was answered, as far as the contract speaks of it.
pub(crate) struct Answer<'a> {
    pub(crate) method: &'a str,
    /// Path without the query.
    pub(crate) path: &'a str,
    pub(crate) status: u16,
    pub(crate) content_type: Option<&'a str>,
    /// `None` where the body was not read, as with a stream, or where there is none, as with HEAD.
    pub(crate) body: Option<&'a [u8]>,
}

impl Contract {
    /// The one contract.
    pub(crate) fn get() -> &'static Self {
        &CONTRACT
    }

    /// The document.
    pub(crate) fn document(&self) -> &Value {
        &self.document
    }

    /// Panics unless the contract has this answer.
    pub(crate) fn check(&self, answer: &Answer<'_>) {
        if let Err(why) = self.judge(answer) {
            let body = answer.body.map(|body| {
                let text = String::from_utf8_lossy(body);
                text.chars().take(600).collect::<String>()
            });
            panic!(
                "{} {} answered {} ({:?}), against openapi.yaml: {why}\n{body:?}",
                answer.method, answer.path, answer.status, answer.content_type
            );
        }
    }

    fn judge(&self, answer: &Answer<'_>) -> Result<(), String> {
        let Some(responses) = self.responses(answer) else {
            // What is not in the contract (an unknown route, another method) is answered with a
            // problem document all the same, and never with success.
            return match answer.status {
                // The document does not describe itself.
                200 if answer.path == "/openapi.json" => Ok(()),
                // The web page is no part of it.
                200 | 304 if is_of_pages(answer.path) => Ok(()),
                // A browser gets a page.
                404 if answer.content_type.is_some_and(|kind| essence(kind) == "text/html") => Ok(()),
                404 | 405 => self.judge_problem(answer),
                _ => Err("neither this path nor this method is documented".into()),
            };
        };
        let mut pointer = format!("{responses}/{}", answer.status);
        let Some(mut response) = self.document.pointer(&pointer) else {
            return Err("this status is not documented".into());
        };
        if let Some(target) = response.get("$ref").and_then(Value::as_str) {
            pointer = target.trim_start_matches('#').to_owned();
            response = self.document.pointer(&pointer).ok_or("a response refers to nothing")?;
        }
        let documented = response.get("content").and_then(Value::as_object);
        let Some(documented) = documented.filter(|content| !content.is_empty()) else {
            return match answer.body {
                Some(body) if !body.is_empty() => Err("a body where none is documented".into()),
                _ => Ok(()),
            };
        };
        let media_type = essence(answer.content_type.ok_or("no content type")?);
        if !documented.contains_key(media_type) {
            let known: Vec<_> = documented.keys().collect();
            return Err(format!("{media_type} is not documented, only {known:?}"));
        }
        match answer.body {
            // A part of a document is none.
            Some(body) if is_json(media_type) && answer.status != 206 => {
                self.judge_body(&format!("{pointer}/content/{}/schema", escaped(media_type)), body)
            }
            _ => Ok(()),
        }
    }

    /// Pointer to the responses of the operation that answered. HEAD is answered as GET is.
    fn responses(&self, answer: &Answer<'_>) -> Option<String> {
        let paths = self.document.get("paths")?.as_object()?;
        let fits = |template: &&String| {
            let (mut given, mut known) = (answer.path.split('/'), template.split('/'));
            loop {
                match (given.next(), known.next()) {
                    (None, None) => return true,
                    (Some(g), Some(k)) if g == k || (k.starts_with('{') && !g.is_empty()) => {}
                    _ => return false,
                }
            }
        };
        // A path without parameters wins, as `/v1/jobs/new` would over `/v1/jobs/{id}`.
        let template = paths.keys().filter(fits).min_by_key(|t| t.matches('{').count())?;
        let operations = paths[template].as_object()?;
        let method = answer.method.to_lowercase();
        let method = match method.as_str() {
            "head" if !operations.contains_key("head") => "get",
            other => other,
        };
        operations.contains_key(method).then(|| format!("/paths/{}/{method}/responses", escaped(template)))
    }

    fn judge_problem(&self, answer: &Answer<'_>) -> Result<(), String> {
        if answer.content_type.map(essence) != Some("application/problem+json") {
            return Err("an error that is no problem document".into());
        }
        match answer.body {
            Some(body) => self.judge_body("/components/schemas/Problem", body),
            None => Ok(()),
        }
    }

    fn judge_body(&self, schema: &str, body: &[u8]) -> Result<(), String> {
        let instance: Value =
            serde_json::from_slice(body).map_err(|e| format!("the body is no JSON: {e}"))?;
        self.judge_value(schema, &instance)
    }

    /// Why a value is not what the schema at a pointer into the document says.
    pub(crate) fn judge_value(&self, schema: &str, value: &Value) -> Result<(), String> {
        let Validator { schemas, index } = &*self.validator(schema);
        schemas.validate(value, *index).map_err(|error| format!("{error:#}"))
    }

    fn validator(&self, pointer: &str) -> Arc<Validator> {
        let mut validators = self.validators.lock().unwrap();
        let compiled = validators.entry(pointer.to_owned()).or_insert_with(|| {
            // A pointer in a fragment is percent-encoded; templates hold braces.
            let fragment = pointer.replace('{', "%7B").replace('}', "%7D");
            let mut schemas = Schemas::new();
            let mut compiler = Compiler::new();
            compiler.set_default_draft(Draft::V2020_12);
            compiler.enable_format_assertions();
            let unusable =
                |why: &dyn Display| -> ! { panic!("the schema at {pointer} cannot be used: {why:#}") };
            let document = self.document.clone();
            compiler.add_resource(DOCUMENT_URI, document).unwrap_or_else(|why| unusable(&why));
            let index = compiler.compile(&format!("{DOCUMENT_URI}#{fragment}"), &mut schemas);
            let index = index.unwrap_or_else(|why| unusable(&why));
            Arc::new(Validator { schemas, index })
        });
        Arc::clone(compiled)
    }
}

/// The media type without its parameters.
pub(crate) fn essence(content_type: &str) -> &str {
    content_type.split(';').next().unwrap_or_default().trim()
}

/// Whether a path is one of the web page, outside the interface.
fn is_of_pages(path: &str) -> bool {
    let page = path.split('/').nth(1).unwrap_or_default();
    ["", "jobs", "studies", "service", "assets", "docs"].contains(&page)
}

fn is_json(media_type: &str) -> bool {
    media_type == "application/json" || media_type.ends_with("+json")
}

fn escaped(segment: &str) -> String {
    segment.replace('~', "~0").replace('/', "~1")
}
