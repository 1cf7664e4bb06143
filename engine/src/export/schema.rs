//! Schemas that no derive makes: of tables that are written row by row, and of objects that are put together.

use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{Array, ArrayBuilder, ArrayItems, Object, ObjectBuilder, Schema, Type};

/// The schema of one object with the properties of all; of those with the same name the last.
pub(crate) fn merged<const N: usize>(parts: [RefOr<Schema>; N]) -> RefOr<Schema> {
    let mut all = Object::new();
    for part in parts {
        if let RefOr::T(Schema::Object(part)) = part {
            all.schema_type = part.schema_type;
            all.additional_properties = all.additional_properties.or(part.additional_properties);
            all.description = all.description.or(part.description);
            all.properties.extend(part.properties);
            all.required.extend(part.required);
        }
    }
    RefOr::T(Schema::Object(all))
}

/// The schema of a table: an object with the names of its `columns` and with `rows` of numbers.
pub(crate) fn table(description: &str, columns: &[&str], row: &str) -> Object {
    ObjectBuilder::new()
        .schema_type(Type::Object)
        .description(Some(description))
        .property("columns", names(columns))
        .required("columns")
        .property("rows", rows(columns.len(), row))
        .required("rows")
        .build()
}

/// The same with a list of points, which are pairs of numbers, as the last member of each row.
pub(crate) fn table_with_points(description: &str, columns: &[&str], row: &str) -> Object {
    let number = || ObjectBuilder::new().schema_type(Type::Number).build();
    let point = ArrayBuilder::new().items(number()).min_items(Some(2)).max_items(Some(2)).build();
    let points = ArrayBuilder::new().items(RefOr::from(Schema::from(point))).build();
    let numbers = columns.iter().skip(1).map(|_| Schema::from(number()));
    let row_of = ArrayBuilder::new()
        .prefix_items(numbers.chain([Schema::from(points)]))
        .items(ArrayItems::False)
        .min_items(Some(columns.len()))
        .max_items(Some(columns.len()));
    ObjectBuilder::new()
        .schema_type(Type::Object)
        .description(Some(description))
        .property("columns", names(columns))
        .required("columns")
        .property(
            "rows",
            ArrayBuilder::new()
                .items(RefOr::from(Schema::from(row_of.build())))
                .description(Some(row))
                .build(),
        )
        .required("rows")
        .build()
}

fn names(columns: &[&str]) -> Array {
    let name = |name: &&str| {
        Schema::from(ObjectBuilder::new().schema_type(Type::String).enum_values(Some([*name])).build())
    };
    ArrayBuilder::new()
        .prefix_items(columns.iter().map(name))
        .items(ArrayItems::False)
        .min_items(Some(columns.len()))
        .max_items(Some(columns.len()))
        .description(Some("Names of the columns."))
        .build()
}

fn rows(width: usize, description: &str) -> Array {
    let number = ObjectBuilder::new().schema_type(Type::Number).build();
    let row = ArrayBuilder::new().items(number).min_items(Some(width)).max_items(Some(width)).build();
    ArrayBuilder::new().items(RefOr::from(Schema::from(row))).description(Some(description)).build()
}
