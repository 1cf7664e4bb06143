//! Media types of the files of exports, and what the interface document says of them.

use std::collections::{BTreeMap, BTreeSet};

use packstone_engine::export::{ExportRequest, ExportType, slice};
use serde::Serialize;
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::header::HeaderBuilder;
use utoipa::openapi::response::{Response, ResponseBuilder};
use utoipa::openapi::schema::{ArrayBuilder, ArrayItems, ObjectBuilder, Schema, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{IntoResponses, ToSchema};

const JSON: &str = "application/json";
const CIRCLE_COLUMNS: [&str; 6] = ["u_mm", "v_mm", "radius_mm", "grain", "diameter_mm", "area_mm2"];

/// The media type of a format with its default options.
pub(crate) fn media_type(kind: ExportType, format: &str) -> &'static str {
    let plain = ExportRequest::from_text(kind, [("format", format)]);
    plain.map_or("application/octet-stream", |export| export.media_type())
}

/// The answers that carry a file.
pub(crate) struct FileResponses;

impl IntoResponses for FileResponses {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        let tag = HeaderBuilder::new().description(Some("Strong tag of the file")).build();
        let part = HeaderBuilder::new().description(Some("Which part, and of how much")).build();
        let whole = with_files("The file").header("ETag", tag).build();
        let part = with_files("A part of the file").header("Content-Range", part).build();
        let known = ResponseBuilder::new().description("The file is as known").build();
        [("200", whole), ("206", part), ("304", known)]
            .map(|(status, response)| (status.to_owned(), response.into()))
            .into()
    }
}

fn with_files(description: &str) -> ResponseBuilder {
    let media_types: BTreeSet<&str> = ExportType::ALL
        .into_iter()
        .flat_map(|kind| kind.formats().iter().map(move |format| media_type(kind, format)))
        .collect();
    let mut response = ResponseBuilder::new().description(description);
    for media_type in media_types {
        let schema = if media_type == JSON {
            RefOr::from(Ref::from_schema_name("SliceDocument"))
        } else {
            let file = ObjectBuilder::new().schema_type(Type::String).content_media_type(media_type);
            RefOr::from(Schema::from(file.build()))
        };
        response = response.content(media_type, ContentBuilder::new().schema(Some(schema)).build());
    }
    response
}

/// A slice in JSON.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct SliceDocument {
    #[serde(flatten)]
    report: slice::SliceReport,
    circles: CircleTable,
}

/// The circles of a slice.
#[derive(Serialize, ToSchema)]
#[allow(dead_code)]
pub(crate) struct CircleTable {
    /// Names of the columns.
    #[schema(schema_with = circle_columns)]
    columns: [String; 6],
    /// One row a circle.
    #[schema(schema_with = circle_rows)]
    rows: Vec<[f64; 6]>,
}

fn circle_columns() -> Schema {
    let name = |name: &str| {
        Schema::from(ObjectBuilder::new().schema_type(Type::String).enum_values(Some([name])).build())
    };
    let columns = ArrayBuilder::new().prefix_items(CIRCLE_COLUMNS.map(name)).items(ArrayItems::False);
    columns.min_items(Some(6)).max_items(Some(6)).build().into()
}

fn circle_rows() -> Schema {
    let number = Schema::from(ObjectBuilder::new().schema_type(Type::Number).build());
    let row = ArrayBuilder::new().items(RefOr::from(number)).min_items(Some(6)).max_items(Some(6)).build();
    ArrayBuilder::new().items(RefOr::from(Schema::from(row))).build().into()
}
