//! The circles and the figures of a cut as one JSON object.

use std::io::{self, Write};

use super::{Cut, SliceReport};

/// Names of the columns of the circles.
const COLUMNS: [&str; 6] = ["u_mm", "v_mm", "radius_mm", "grain", "diameter_mm", "area_mm2"];

/// A slice as one JSON object: the fields of its report, then its circles as a table.
#[derive(Clone, Copy, Debug)]
pub struct SliceDocument<'a> {
    /// The figures of the cut.
    pub report: &'a SliceReport,
    /// The circles.
    pub cut: &'a Cut,
}

impl SliceDocument<'_> {
    /// Writes the object.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(self, out: &mut dyn Write) -> io::Result<()> {
        let mut head = serde_json::to_vec(self.report)?;
        // The object is opened again for the circles, which are written as they come.
        head.pop();
        out.write_all(&head)?;
        write!(out, ",\"circles\":{{\"columns\":{},\"rows\":[", serde_json::to_string(&COLUMNS)?)?;
        let mut digits = zmij::Buffer::new();
        for (i, circle) in self.cut.circles.iter().enumerate() {
            out.write_all(if i == 0 { b"\n[" } else { b",\n[" })?;
            for x in [circle.center_mm[0], circle.center_mm[1], circle.radius_mm] {
                out.write_all(digits.format_finite(x).as_bytes())?;
                out.write_all(b",")?;
            }
            write!(out, "{},", circle.grain)?;
            out.write_all(digits.format_finite(circle.diameter_mm).as_bytes())?;
            out.write_all(b",")?;
            out.write_all(digits.format_finite(circle.area_mm2).as_bytes())?;
            out.write_all(b"]")?;
        }
        out.write_all(b"\n]}}\n")
    }
}

#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for SliceDocument<'_> {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        use utoipa::ToSchema;
        use utoipa::openapi::schema::{AllOfBuilder, ObjectBuilder, Ref, Schema, Type};

        let circles =
            crate::export::schema::table("The circles of the slice.", &COLUMNS, "One row a circle.");
        let table = ObjectBuilder::new().schema_type(Type::Object);
        let document = AllOfBuilder::new()
            .item(Ref::from_schema_name(SliceReport::name()))
            .item(table.property("circles", circles).required("circles"))
            .description(Some("A slice in JSON."));
        Schema::from(document.build()).into()
    }
}

#[cfg(feature = "openapi")]
impl utoipa::ToSchema for SliceDocument<'_> {
    fn name() -> std::borrow::Cow<'static, str> {
        "SliceDocument".into()
    }

    fn schemas(schemas: &mut Vec<(String, utoipa::openapi::RefOr<utoipa::openapi::Schema>)>) {
        use utoipa::PartialSchema;

        schemas.push((SliceReport::name().into_owned(), SliceReport::schema()));
        SliceReport::schemas(schemas);
    }
}
