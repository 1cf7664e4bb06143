//! What each kind of problem means: the answer to a problem's `type`.

use axum::extract::{Path, State};
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;

use crate::http::app::App;
use crate::http::params::{NoParameters, Query};
use crate::problem::{Kind, Problem};

/// A kind of problem.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ProblemKind {
    /// The `type` of its documents.
    #[cfg_attr(test, schema(format = "uri-reference"))]
    r#type: String,
    /// What it is called.
    title: &'static str,
    /// Its usual HTTP status; `null` for the end of a job or an export, which is no response.
    #[cfg_attr(test, schema(required, minimum = 400, maximum = 599))]
    status: Option<u16>,
    /// When it occurs and what to do about it.
    meaning: &'static str,
}

impl ProblemKind {
    fn of(kind: Kind) -> Self {
        Self { r#type: kind.type_uri(), title: kind.title(), status: kind.status(), meaning: kind.meaning() }
    }
}

/// All kinds of problems.
#[derive(Serialize)]
#[cfg_attr(test, derive(utoipa::ToSchema))]
pub(crate) struct ProblemKinds {
    /// The kinds.
    items: Vec<ProblemKind>,
}

/// List the kinds of problems
#[cfg_attr(test, utoipa::path(
    get, path = "/problems", tag = "service", operation_id = "list_problems",
    responses(
        (status = 200, description = "All kinds", body = ProblemKinds),
        crate::http::problems::sets::OpenProblems
    )
))]
pub(crate) async fn list(State(_): State<App>, _: Query<NoParameters>) -> Result<Response, Problem> {
    let items = Kind::ALL.iter().map(|kind| ProblemKind::of(*kind)).collect();
    Ok(axum::Json(ProblemKinds { items }).into_response())
}

/// Explain a kind of problem
#[cfg_attr(test, utoipa::path(
    get, path = "/problems/{kind}", tag = "service", operation_id = "get_problem",
    params(("kind" = String, Path, description = "Last segment of the problem's `type`")),
    responses(
        (status = 200, description = "The kind", body = ProblemKind),
        crate::http::problems::sets::PageProblems
    )
))]
pub(crate) async fn get(
    State(_): State<App>,
    path: Result<Path<String>, axum::extract::rejection::PathRejection>,
    _: Query<NoParameters>,
) -> Result<Response, Problem> {
    let kind = path.ok().and_then(|Path(slug)| Kind::from_slug(&slug));
    let kind = kind.ok_or_else(|| Problem::new(Kind::NotFound, "there is no such kind of problem"))?;
    Ok(axum::Json(ProblemKind::of(kind)).into_response())
}
