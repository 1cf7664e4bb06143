//! What the interface document says of parameters, beside what their types say.

use utoipa::openapi::Required;
use utoipa::openapi::path::{Parameter as Described, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{Object, ObjectBuilder, Schema, SchemaFormat, Type};

use crate::http::params::values::{Parameter, Value};

/// Lets `utoipa::path` name a set of query parameters among its `params`.
macro_rules! described_query {
    ($name:ty) => {
        impl utoipa::IntoParams for $name {
            fn into_params(
                _: impl Fn() -> Option<utoipa::openapi::path::ParameterIn>,
            ) -> Vec<utoipa::openapi::path::Parameter> {
                let mut described = Vec::new();
                <Self as $crate::http::params::ParameterSet>::describe(&mut described);
                described
            }
        }
    };
}
pub(crate) use described_query;

/// One query parameter; `doc` are the lines of its comment.
pub(crate) fn query_parameter<T: Parameter>(name: &str, doc: &[&str]) -> Described {
    let lines: Vec<&str> = doc.iter().map(|line| line.trim()).collect();
    let parameter = ParameterBuilder::new()
        .name(name)
        .parameter_in(ParameterIn::Query)
        .description(Some(lines.join(" ")))
        .required(Required::False);
    T::describe(parameter).build()
}

/// One parameter of a path.
pub(crate) fn path_parameter(name: &str, schema: Object, description: &str) -> Described {
    ParameterBuilder::new()
        .name(name)
        .parameter_in(ParameterIn::Path)
        .description(Some(description))
        .required(Required::True)
        .schema(Some(schema))
        .build()
}

/// The form of the ids of jobs and studies.
pub(crate) fn uuid_schema() -> Object {
    let format = SchemaFormat::Custom("uuid".to_owned());
    ObjectBuilder::new().schema_type(Type::String).format(Some(format)).build()
}

/// The schema of a value that has a default where it is absent.
pub(crate) fn with_default<T: Value>(default: impl Into<serde_json::Value>) -> Schema {
    let mut schema = T::schema();
    schema.default = Some(default.into());
    Schema::Object(schema)
}
