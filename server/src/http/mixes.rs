//! Readings of mixes, as laboratories print them, and blends of stockpiles.

use axum::extract::State;
use axum::response::{IntoResponse as _, Response};
use packstone_engine::blend::Blend;
use packstone_engine::importer::{self, MAX_WORKBOOK_BYTES, MixReading, ReadOptions, Unit};
use packstone_engine::request::BlendRequest;
use packstone_engine::request::decode::FieldError;

use crate::failure::{Failure, FailureCode};
use crate::http::app::{App, LARGE_BODY_BYTES};
use crate::http::body::RequestBody;
use crate::http::params::values::Text;
use crate::http::params::{NoParameters, Query, choices, parameters};
use crate::http::submission::read_apart;
use crate::problem::Problem;
use crate::strict_json;

/// Longest request for a blend: 16 curves of 1000 points take half of it.
const MAX_BLEND_BYTES: u64 = 1 << 20;

choices!(Unit);

/// A name that stands in a table.
type Name = Text<1, 1000>;

parameters! {
    /// What a client has chosen, where a first reading asked.
    #[derive(Debug)]
    pub(crate) struct ReadingParameters {
        /// Sheet of a workbook that is read, by its name; all sheets where it is absent.
        sheet: Option<Name>,
        /// Curve or recipe that is read, by its name.
        curve: Option<Name>,
        /// Column of values that is read, by its head, by its letter in a workbook, or by its number from 1.
        column: Option<Name>,
        /// Unit of the sieves.
        unit: Option<Unit>,
    }
}

impl From<ReadingParameters> for ReadOptions {
    fn from(ReadingParameters { sheet, curve, column, unit }: ReadingParameters) -> Self {
        let text = |name: Option<Name>| name.map(|name| name.0);
        Self {
            sheet: text(sheet),
            curve: text(curve),
            column: text(column),
            unit: unit.map(|unit| unit.name().to_owned()),
        }
    }
}

/// Read a grading or a recipe
///
/// What was understood of a table as laboratories print it: grading curves, limits, recipes, and the part of a request
/// that follows. The body is the file as it stands: a text (CSV, tabs, semicolons, HTML, Markdown, what was pasted) of
/// at most 1 MiB or a workbook (.xlsx, .ods) of at most 4 MiB. What it is, and its encoding, is told by its bytes,
/// whatever its media type. Each body but that of no bytes is answered with 200: `verdict` says whether it has one
/// reading (`ok`, `warn`), whether there is a choice to make (`ask`: each of `candidates` has its `request`), or why
/// nothing was read (`refuse`, with row, reason and remedy in `notes`). Nothing is stored.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/mixes/read", tag = "jobs", operation_id = "read_mix",
    params(ReadingParameters),
    request_body(description = "The file, of any media type", content(
        ("text/plain"),
        ("text/csv"),
        ("text/html"),
        ("application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"),
        ("application/vnd.oasis.opendocument.spreadsheet"),
        ("application/octet-stream"),
    )),
    responses(
        (status = 200, description = "What was understood", body = MixReading),
        crate::http::problems::sets::MixReadingProblems
    )
))]
pub(crate) async fn read(
    State(app): State<App>,
    Query(parameters): Query<ReadingParameters>,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let bytes = body.read_file(MAX_WORKBOOK_BYTES as u64).await?;
    if bytes.is_empty() {
        let faults = vec![FieldError::new("", "is empty: must have a table")];
        return Err(Problem::fields(FailureCode::ValidationError, faults));
    }
    let options = ReadOptions::from(parameters);
    // A workbook unpacks to more than its bytes.
    let is_large = bytes.len() > LARGE_BODY_BYTES || bytes.starts_with(b"PK");
    let work = move || importer::read(&bytes, &options);
    let reading: MixReading = if is_large {
        read_apart(&app, move |_| Ok(work())).await?
    } else {
        app.shared.compute.run(move |_| work()).await?
    };
    Ok(axum::Json(reading).into_response())
}

/// Blend stockpiles
///
/// The shares of stockpiles whose blend comes nearest to a curve or into a band: least squares over the sieves, with
/// shares of at least 0 and a sum of 1. Beside them stand what passes each sieve, the residuals, figures of the blend
/// and the part of a request that has it. Nothing is stored.
#[cfg_attr(test, utoipa::path(
    post, path = "/v1/mixes/blend", tag = "jobs", operation_id = "blend_mix",
    request_body(content = BlendRequest, content_type = "application/json"),
    responses(
        (status = 200, description = "The blend", body = Blend),
        crate::http::problems::sets::MixReadingProblems
    )
))]
pub(crate) async fn blend(
    State(app): State<App>,
    _: Query<NoParameters>,
    mut body: RequestBody,
) -> Result<Response, Problem> {
    let bytes = body.read(MAX_BLEND_BYTES).await?;
    let work = move || -> Result<Blend, Failure> {
        let request = strict_json::parse(&bytes)?;
        let request = BlendRequest::from_json(&request).map_err(Failure::invalid)?;
        Ok(Blend::of(&request))
    };
    Ok(axum::Json(app.shared.compute.run(move |_| work()).await??).into_response())
}
