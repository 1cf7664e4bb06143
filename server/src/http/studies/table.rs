//! What the runs of a study came to.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};

use crate::http::app::App;
use crate::http::conditional;
use crate::http::negotiation::{self, TableFormat};
use crate::http::params::values::Named;
use crate::http::params::{Choice as _, IdPath, Query, StudyPath, parameters};
use crate::http::problems::refused;
use crate::http::response::{SHORT_LIST, json, set};
use crate::jobs::store::StoreError;
use crate::problem::Problem;

parameters! {
    /// How a table is wanted.
    #[derive(Debug)]
    pub(crate) struct TableParameters {
        /// Format of the table; wins over `Accept`.
        format: Option<Named<TableFormat>>,
    }
}

/// Get the table of a study
///
/// One row per point, in the order of the study: the values of its columns (for a list the job's index and name), then
/// what its runs came to so far. The CSV has the same columns under one header line.
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/studies/{id}/table", tag = "studies", operation_id = "get_study_table",
    params(
        StudyPath,
        TableParameters,
        ("If-None-Match" = Option<String>, Header, description = "Tag of the table as known"),
    ),
    responses(
        (status = 200, description = "The table", headers(("ETag" = String, description = "Tag of the table")),
            content((crate::studies::table::Table = "application/json"), (String = "text/csv"))),
        (status = 304, description = "The table is as known"),
        crate::http::problems::sets::TableProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    IdPath(id): StudyPath,
    Query(query): Query<TableParameters>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let format = negotiation::table_format(query.format.as_ref(), &headers)?;
    let store = &app.shared.store;
    let study = store.study(id).await?.ok_or_else(|| refused(StoreError::NoStudy, id))?;
    // Read before its runs: what ends meanwhile may be in the table already, and the tag is of before.
    let etag = format!("\"{}-{}\"", study.version, format.name());
    if conditional::none_match_fails(&headers, &etag) {
        let mut response = StatusCode::NOT_MODIFIED.into_response();
        set(&mut response, header::ETAG, &etag);
        return Ok(response);
    }
    let table = store.study_table(&study).await?;
    let mut response = match format {
        TableFormat::Json => json(&app, StatusCode::OK, table, study.points as usize > SHORT_LIST).await,
        TableFormat::Csv => {
            let mut response = app.shared.documents.run(move |_| table.to_csv()).await?.into_response();
            let csv = HeaderValue::from_static("text/csv; charset=utf-8; header=present");
            response.headers_mut().insert(header::CONTENT_TYPE, csv);
            response
        }
    };
    set(&mut response, header::ETAG, &etag);
    set(&mut response, header::VARY, "accept");
    Ok(response)
}
