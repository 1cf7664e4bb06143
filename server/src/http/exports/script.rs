//! The script that belongs beside the file of an export: Gmsh fills a mesh only where a script tells it to.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};

use crate::http::app::App;
use crate::http::exports::ExportOptions;
use crate::http::exports::address::{ExportPath, Target};
use crate::http::files::FileName;
use crate::http::params::Query;
use crate::http::response::set;
use crate::problem::{Kind, Problem};

/// Get the script of an export
///
/// The script that opens the file of an export in its program: beside a mesh for Gmsh (`format=msh`), under the name
/// that this answer gives it, it makes `gmsh -3 NAME.msh.geo -o model.msh` (or `model.inp`) fill the mesh with
/// tetrahedra. Gmsh ends without an error and without tetrahedra where it is given the mesh alone. Other exports need
/// no script (404).
#[cfg_attr(test, utoipa::path(
    get, path = "/v1/jobs/{id}/exports/{type}/script", tag = "exports", operation_id = "get_export_script",
    params(ExportPath, ExportOptions),
    responses(
        (status = 200, description = "The script", content((String = "text/plain"))),
        crate::http::problems::sets::ExportStatusProblems
    )
))]
pub(crate) async fn get(
    State(app): State<App>,
    path: ExportPath,
    Query(options): Query<ExportOptions>,
) -> Result<Response, Problem> {
    let target = Target::read(&app, path, &options).await?;
    let name = target.file_name().into_ascii();
    let Some((ending, text)) = target.export.companion(&name) else {
        let detail =
            format!("exports {} of the format {} need no script", path.kind.name(), target.export.format());
        return Err(Problem::new(Kind::NotFound, detail));
    };
    let mut response = ([(header::CONTENT_TYPE, "text/plain; charset=utf-8")], text).into_response();
    let name = FileName::plain(format!("{name}.{ending}"));
    set(&mut response, header::CONTENT_DISPOSITION, &name.disposition(false));
    Ok(response)
}
