//! What the interface document says of the messages that this service sends.
//!
//! Triggers of the database make the messages (`migrations/`); the end-to-end suite holds them against
//! this schema.

use serde_json::{Value, json};

/// The member `webhooks` of the document (OpenAPI 3.1).
pub(super) fn webhooks() -> Value {
    let job = |state: &str, about: &str| {
        let mut data = json!({
            "type": "object",
            "required": ["id", "name", "labels", "state", "links"],
            "properties": {
                "id": {"type": "string", "format": "uuid"},
                "name": {"type": ["string", "null"]},
                "labels": {"type": "object", "additionalProperties": {"type": "string"}},
                "state": {"const": state},
                "links": links("Path of the job.")
            }
        });
        if state == "failed" {
            data["required"] = json!(["id", "name", "labels", "state", "links", "error"]);
            data["properties"]["error"] = json!({
                "type": "object",
                "description": "Why the job failed.",
                "required": ["code", "detail"],
                "properties": {
                    "code": {"type": "string", "description": "The kind of failure, as in `/problems/CODE`."},
                    "detail": {"type": "string", "description": "This occurrence, in one sentence."}
                }
            });
        }
        event(&format!("job.{state}"), about, &data)
    };
    let count = || json!({"type": "integer", "minimum": 0});
    let study = json!({
        "type": "object",
        "required": ["id", "name", "labels", "state", "counts", "links"],
        "properties": {
            "id": {"type": "string", "format": "uuid"},
            "name": {"type": ["string", "null"]},
            "labels": {"type": "object", "additionalProperties": {"type": "string"}},
            "state": {"const": "finished"},
            "counts": {
                "type": "object",
                "description": "Jobs of the study by their ends.",
                "required": ["succeeded", "failed", "cancelled"],
                "properties": {"succeeded": count(), "failed": count(), "cancelled": count()}
            },
            "links": links("Path of the study.")
        }
    });
    json!({
        "job.succeeded": job("succeeded", "A job has ended with a result"),
        "job.failed": job("failed", "A job has ended without a result"),
        "job.cancelled": job("cancelled", "A job was cancelled"),
        "study.finished": event("study.finished", "No job of a study is left to run", &study)
    })
}

fn links(about: &str) -> Value {
    json!({
        "type": "object",
        "required": ["self"],
        "properties": {"self": {"type": "string", "format": "uri-reference", "description": about}}
    })
}

/// A message, whose headers are those of Standard Webhooks.
fn event(name: &str, summary: &str, data: &Value) -> Value {
    let header = |name: &str, about: &str| json!({"name": name, "in": "header", "required": true, "description": about, "schema": {"type": "string"}});
    let schema = json!({
        "type": "object",
        "required": ["type", "timestamp", "data"],
        "properties": {
            "type": {"const": name},
            "timestamp": {"type": "string", "format": "date-time", "description": "When it happened (RFC 3339, UTC)."},
            "data": data
        }
    });
    json!({
        "post": {
            "summary": summary,
            "tags": [if name.starts_with("job") { "jobs" } else { "studies" }],
            "parameters": [
                header("webhook-id", "The same in all attempts to send the message: a known one is a repeat"),
                header("webhook-timestamp", "Time of this attempt, in seconds since the Unix epoch"),
                header(
                    "webhook-signature",
                    "`v1,` and the Base64 of HMAC-SHA256 over `ID.TIMESTAMP.BODY`, for each secret of the server, \
                     separated by spaces (Standard Webhooks)"
                )
            ],
            "requestBody": {"required": true, "content": {"application/json": {"schema": schema}}},
            "responses": {
                "2XX": {"description": "The message is accepted"},
                "410": {"description": "The message is not sent again; any other answer lets it be sent again later"}
            }
        }
    })
}
