//! The circles, ellipses or polygons and the figures of a cut as one JSON object.

use std::io::{self, Write};

use super::{Cut, Figure, FigureKind, SliceReport};

/// Names of the columns of circles.
const CIRCLE: [&str; 6] = ["u_mm", "v_mm", "radius_mm", "grain", "diameter_mm", "area_mm2"];
/// Names of the columns of ellipses: `a_mm` and `b_mm` are the longer and the shorter semi-axis, `angle_deg` is the
/// angle of the longer one from u towards v, `diameter_mm` that of the sphere with the volume of the grain.
const ELLIPSE: [&str; 8] = ["u_mm", "v_mm", "a_mm", "b_mm", "angle_deg", "grain", "diameter_mm", "area_mm2"];

/// Names of the columns of polygons: `u_mm` and `v_mm` are those of the centroid, `corners_mm` the pairs u, v of the
/// corners, counter-clockwise from u to v.
const POLYGON: [&str; 6] = ["u_mm", "v_mm", "grain", "diameter_mm", "area_mm2", "corners_mm"];

/// A slice as one JSON object: the fields of its report, then the table `circles` of a packing of spheres, `ellipses`
/// of one of ellipsoids, `polygons` of one of polyhedra, or both of these.
#[derive(Clone, Copy, Debug)]
pub struct SliceDocument<'a> {
    /// The figures of the cut.
    pub report: &'a SliceReport,
    /// The circles, ellipses or polygons.
    pub cut: &'a Cut,
}

impl SliceDocument<'_> {
    /// Writes the object.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(self, out: &mut dyn Write) -> io::Result<()> {
        let mut head = serde_json::to_vec(self.report)?;
        // The object is opened again for the table, whose rows are written as they come.
        head.pop();
        out.write_all(&head)?;
        for kind in &self.cut.kinds {
            self.write_table(*kind, out)?;
        }
        out.write_all(b"}\n")
    }

    /// Writes the table of the sections of a kind.
    fn write_table(self, kind: FigureKind, out: &mut dyn Write) -> io::Result<()> {
        let columns: &[&str] = match kind {
            FigureKind::Circle => &CIRCLE,
            FigureKind::Ellipse => &ELLIPSE,
            FigureKind::Polygon => &POLYGON,
        };
        let name = kind.noun();
        write!(out, ",\"{name}\":{{\"columns\":{},\"rows\":[", serde_json::to_string(columns)?)?;
        let mut digits = zmij::Buffer::new();
        for (i, section) in self.cut.of_kind(kind).enumerate() {
            out.write_all(if i == 0 { b"\n[" } else { b",\n[" })?;
            let [u, v] = section.center_mm;
            match &section.figure {
                Figure::Circle { radius_mm } => numbers(out, &mut digits, &[u, v, *radius_mm])?,
                Figure::Polygon(_) => numbers(out, &mut digits, &[u, v])?,
                Figure::Ellipse(ellipse) => {
                    let [a, b] = ellipse.semi_axes_mm;
                    numbers(out, &mut digits, &[u, v, a, b, ellipse.angle_deg()])?;
                }
            }
            write!(out, ",{},", section.grain)?;
            numbers(out, &mut digits, &[section.diameter_mm, section.area_mm2])?;
            if let Figure::Polygon(polygon) = &section.figure {
                for (k, corner) in polygon.corners_mm.iter().enumerate() {
                    out.write_all(if k == 0 { b",[[" } else { b",[" })?;
                    numbers(out, &mut digits, &[u + corner[0], v + corner[1]])?;
                    out.write_all(b"]")?;
                }
                out.write_all(b"]")?;
            }
            out.write_all(b"]")?;
        }
        out.write_all(b"\n]}")
    }
}

/// Numbers with commas between them.
fn numbers(out: &mut dyn Write, digits: &mut zmij::Buffer, all: &[f64]) -> io::Result<()> {
    for (k, &x) in all.iter().enumerate() {
        out.write_all(if k == 0 { b"" } else { b"," })?;
        out.write_all(digits.format_finite(x).as_bytes())?;
    }
    Ok(())
}

#[cfg(feature = "openapi")]
impl utoipa::PartialSchema for SliceDocument<'_> {
    fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
        use utoipa::ToSchema;
        use utoipa::openapi::schema::{AllOfBuilder, AnyOfBuilder, ObjectBuilder, Ref, Schema, Type};

        let with = |name: &str, description: &str, columns: &[&str], row: &str| {
            let table = crate::export::schema::table(description, columns, row);
            ObjectBuilder::new().schema_type(Type::Object).property(name, table).required(name).build()
        };
        let circles =
            with("circles", "The circles of a slice through spheres.", &CIRCLE, "One row a circle.");
        let ellipses = with(
            "ellipses",
            "The ellipses of a slice through ellipsoids: semi-axes, angle of the longer one from u towards v, and the \
             diameter of the sphere with the volume of the grain.",
            &ELLIPSE,
            "One row an ellipse.",
        );
        let corners = crate::export::schema::table_with_points(
            "The polygons of a slice through polyhedra: centroid, grain, diameter of the sphere with the volume of the \
             grain, area inside the outline, and the corners, counter-clockwise from u to v.",
            &POLYGON,
            "One row a polygon; the last member is the list of its corners.",
        );
        let polygons = ObjectBuilder::new()
            .schema_type(Type::Object)
            .property("polygons", corners)
            .required("polygons")
            .build();
        let document = AllOfBuilder::new()
            .item(Ref::from_schema_name(SliceReport::name()))
            .item(Schema::from(AnyOfBuilder::new().item(circles).item(ellipses).item(polygons).build()))
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
