//! What the interface document says of a result in JSON.

use packstone_engine::export::tables::{GrainTable, Head, TemplateRecord};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AllOfBuilder, ArrayBuilder, ObjectBuilder, Ref, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use crate::jobs::JobRequest;

/// A result in JSON, as the engine writes it: its head, whose request is that of the job, and its grains.
pub(crate) struct ResultDocument;

impl PartialSchema for ResultDocument {
    fn schema() -> RefOr<Schema> {
        let templates = ArrayBuilder::new().items(Ref::from_schema_name(TemplateRecord::name())).description(
            Some("What the column `template` of polyhedra counts, from 0; absent of other grains."),
        );
        let of_job = ObjectBuilder::new()
            .schema_type(Type::Object)
            .property("request", Ref::from_schema_name(JobRequest::name()))
            .property("templates", templates)
            .property("grains", Ref::from_schema_name(GrainTable::name()))
            .required("job_id")
            .required("request")
            .required("grains");
        let document = AllOfBuilder::new()
            .item(Ref::from_schema_name(Head::name()))
            .item(of_job)
            .description(Some("A result in JSON: its figures, its request and its grains."));
        Schema::from(document.build()).into()
    }
}

impl ToSchema for ResultDocument {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((Head::name().into_owned(), Head::schema()));
        Head::schemas(schemas);
        schemas.push((TemplateRecord::name().into_owned(), TemplateRecord::schema()));
        TemplateRecord::schemas(schemas);
        schemas.push((GrainTable::name().into_owned(), GrainTable::schema()));
        schemas.push((JobRequest::name().into_owned(), JobRequest::schema()));
        JobRequest::schemas(schemas);
    }
}
