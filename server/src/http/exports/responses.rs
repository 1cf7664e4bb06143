//! What the interface document says of the files of exports.

use std::collections::{BTreeMap, BTreeSet};

use packstone_engine::analysis::QualityReport;
use packstone_engine::export::{ExportType, properties, slice};
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::header::HeaderBuilder;
use utoipa::openapi::response::{Response, ResponseBuilder};
use utoipa::openapi::schema::{AnyOfBuilder, ArrayBuilder, ObjectBuilder, Schema, SchemaType, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{IntoResponses, ToSchema};

use crate::http::exports::media::media_type;

const JSON: &str = "application/json";

/// The answers that carry a file.
pub(crate) struct FileResponses;

impl IntoResponses for FileResponses {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        let tag = HeaderBuilder::new().description(Some("Strong tag of the file")).build();
        let part = HeaderBuilder::new().description(Some("Which part, and of how much")).build();
        let whole = with_files("The file").header("ETag", tag).build();
        let part = with_files("A part of the file").header("Content-Range", part).build();
        let known = ResponseBuilder::new().description("The file is as known").build();
        let url = HeaderBuilder::new().description(Some("URL of the file, valid for 5 minutes")).build();
        let elsewhere = ResponseBuilder::new()
            .description("The storage of the server has the file")
            .header("Location", url)
            .build();
        [("200", whole), ("206", part), ("304", known), ("307", elsewhere)]
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
            let documents =
                [slice::SliceDocument::name(), QualityReport::name(), properties::PropertyReport::name()];
            let any = documents
                .into_iter()
                .fold(AnyOfBuilder::new(), |any, name| any.item(Ref::from_schema_name(name)));
            RefOr::from(Schema::from(any.item(table()).build()))
        } else {
            let file = ObjectBuilder::new().schema_type(Type::String).content_media_type(media_type);
            RefOr::from(Schema::from(file.build()))
        };
        response = response.content(media_type, ContentBuilder::new().schema(Some(schema)).build());
    }
    response
}

/// A table as JSON: `certificates` and `shapes`.
fn table() -> ObjectBuilder {
    let names = ArrayBuilder::new().items(ObjectBuilder::new().schema_type(Type::String));
    let values = ArrayBuilder::new().items(ObjectBuilder::new().schema_type(SchemaType::AnyValue));
    let rows = ArrayBuilder::new().items(values);
    ObjectBuilder::new()
        .description(Some("A table: what each column is, and one list of values for each row"))
        .property("columns", names)
        .required("columns")
        .property("rows", rows)
        .required("rows")
}
