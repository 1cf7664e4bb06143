//! Which requests the audit log tells of, and what of them.

use std::sync::Arc;

use axum::http::{Method, header};
use axum::response::Response;
use jiff::Timestamp;

use crate::accounts::Caller;
use crate::audit::{AuditEntry, AuditLog};
use crate::http::access::COMPUTING_ROUTES;
use crate::http::app::App;
use crate::http::session;

/// What a request that may change something does; `None` for all others. A route that is added has the name that its
/// path gives until it is named here. Workers run what others have submitted: the log tells of them, and not this.
fn action(method: &Method, route: &str) -> Option<String> {
    let reads =
        [Method::GET, Method::HEAD, Method::OPTIONS].contains(method) || COMPUTING_ROUTES.contains(&route);
    if reads || route == "/v1/leases" || route.starts_with("/v1/leases/") {
        return None;
    }
    let named = match (method.as_str(), route) {
        ("POST", session::ROUTE) => "begin_session",
        ("DELETE", session::ROUTE) => "end_session",
        ("POST", "/v1/jobs") => "submit_job",
        ("PATCH", "/v1/jobs/{id}") => "patch_job",
        ("DELETE", "/v1/jobs") => "delete_jobs",
        ("DELETE", "/v1/jobs/{id}") => "delete_job",
        ("POST", "/v1/jobs/{id}/cancel") => "cancel_job",
        ("POST", "/v1/jobs/{id}/finish") => "finish_job",
        ("POST", "/v1/jobs/{id}/retry") => "retry_job",
        ("POST", "/v1/jobs/{id}/exports/{type}") => "start_export",
        ("DELETE", "/v1/jobs/{id}/exports/{type}") => "delete_export",
        ("POST", "/v1/studies") => "submit_study",
        ("PATCH", "/v1/studies/{id}") => "patch_study",
        ("DELETE", "/v1/studies/{id}") => "delete_study",
        ("POST", "/v1/studies/{id}/cancel") => "cancel_study",
        ("POST", "/v1/studies/{id}/retry") => "retry_study",
        ("POST", "/v1/workers/allow") => "allow_worker",
        _ => return Some(format!("{method} {route}")),
    };
    Some(named.to_owned())
}

/// A request as the audit log will tell of it. Dropped before the answer, because the client has hung up, it is told
/// without a status: what was begun goes on.
pub(crate) struct Audited {
    log: Arc<AuditLog>,
    entry: Option<AuditEntry>,
}

impl Audited {
    /// Begins to tell of a request; `None` where there is no audit log, or the request changes nothing.
    pub(crate) fn begin(
        app: &App,
        (method, route, path): (&Method, &str, &str),
        request_id: &str,
        address: &str,
        caller: &Caller,
    ) -> Option<Self> {
        let log = app.shared.audit.clone()?;
        let action = action(method, route)?;
        let id = if route.contains("/{id}") { path.split('/').nth(3).map(str::to_owned) } else { None };
        let entry = AuditEntry {
            time: Timestamp::now().to_string(),
            request_id: request_id.to_owned(),
            key: caller.by.key.clone(),
            owner: caller.by.owner.clone(),
            address: address.to_owned(),
            action,
            id,
            path: path.to_owned(),
            status: None,
        };
        Some(Self { log, entry: Some(entry) })
    }

    /// Tells of the answer, which is sent when this has ended: the line is written then, unless the audit log hangs.
    pub(crate) fn answered(mut self, response: &Response) -> Option<impl Future<Output = ()> + use<>> {
        let mut entry = self.entry.take()?;
        entry.status = Some(response.status().as_u16());
        if let Some(session::Begun(by)) = response.extensions().get() {
            entry.key.clone_from(&by.key);
            entry.owner.clone_from(&by.owner);
        } else if entry.path == session::ROUTE && entry.key.is_empty() {
            // Nobody who is known, and nothing has changed.
            return None;
        }
        if entry.id.is_none() {
            let location = response.headers().get(header::LOCATION).and_then(|path| path.to_str().ok());
            entry.id = location.and_then(|path| path.rsplit('/').next()).map(str::to_owned);
        }
        let log = Arc::clone(&self.log);
        Some(async move { log.append_and_wait(&entry).await })
    }
}

impl Drop for Audited {
    fn drop(&mut self) {
        if let Some(entry) = self.entry.take() {
            // Nobody waits for it.
            drop(self.log.append(&entry));
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use axum::response::IntoResponse as _;

    use super::*;

    #[tokio::test]
    async fn a_request_whose_client_hangs_up_is_told_without_a_status() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let log = Arc::new(AuditLog::open(path.clone(), Arc::default()).unwrap());
        let begin = |action: &str| Audited {
            log: Arc::clone(&log),
            entry: Some(AuditEntry {
                time: String::new(),
                request_id: String::new(),
                key: "lab".into(),
                owner: "lab".into(),
                address: String::new(),
                action: action.into(),
                id: None,
                path: "/v1/jobs".into(),
                status: None,
            }),
        };
        drop(begin("gone"));
        let mut response = axum::http::StatusCode::CREATED.into_response();
        crate::http::response::set(&mut response, header::LOCATION, "/v1/jobs/abc");
        begin("answered").answered(&response).unwrap().await;
        log.close();
        let told = std::fs::read_to_string(path).unwrap();
        let told: Vec<serde_json::Value> =
            told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(told.len(), 2, "each is told once");
        assert_eq!((&told[0]["action"], &told[0]["status"]), (&"gone".into(), &serde_json::Value::Null));
        assert_eq!((&told[1]["id"], &told[1]["status"]), (&"abc".into(), &201.into()));
    }

    #[test]
    fn what_changes_something_is_told() {
        for (method, route, expected) in [
            (Method::GET, "/v1/jobs", None),
            (Method::HEAD, "/v1/jobs/{id}/result", None),
            (Method::POST, "/v1/plans", None),
            (Method::POST, "/v1/mixes/read", None),
            (Method::POST, "/v1/mixes/blend", None),
            (Method::POST, "/v1/jobs", Some("submit_job")),
            (Method::DELETE, "/v1/studies/{id}", Some("delete_study")),
            (Method::PUT, "/v1/new", Some("PUT /v1/new")),
        ] {
            assert_eq!(action(&method, route).as_deref(), expected, "{method} {route}");
        }
    }
}
