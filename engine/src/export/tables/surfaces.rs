//! Polyhedra in the VTK forms: the surfaces of the grains as polygons, which a viewer shows as they are.
//!
//! A sharp grain has the faces of its template. A rounded one has its plane faces, rectangles around its edges and
//! triangles around its vertices, whose arcs turn by at most 45 degrees at a time. Points are not shared by grains.
//! Arrays of the polygons: `diameter` (float64, mm; of the sphere of equal volume), `sieve` (float64, mm),
//! `sieve_class`, `id` and `aggregate` as in the other forms, `template` (int32).

use std::f64::consts::FRAC_PI_4;
use std::io::{self, Write};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::columns::{POLYHEDRON_ROW, for_each_block, invalid};
use super::vtk::{classifier, provenance_file, title};
use super::{Column, GrainSource, Head, nominal_size};
use crate::export::ExportError;
use crate::export::convex::{Convex, Skin};
use crate::export::vtk_xml::Sink;
use crate::shape::{Polyhedron, Pose};

/// Largest angle between neighbours on an arc.
const MOST_ANGLE: f64 = FRAC_PI_4 + 1e-9;

/// A template with its surface.
struct Surface<'a> {
    template: &'a Polyhedron,
    skin: Skin,
    /// Corners of all polygons.
    corners: usize,
}

/// The surfaces of all grains.
struct Surfaces<'a> {
    grains: &'a dyn GrainSource,
    templates: Vec<Surface<'a>>,
    points: usize,
    polygons: usize,
    corners: usize,
}

impl<'a> Surfaces<'a> {
    fn new(grains: &'a dyn GrainSource) -> io::Result<Self> {
        let surface = |template: &'a Polyhedron| {
            let skin = Skin::new(&Convex::new(template), MOST_ANGLE);
            let corners = skin.polygons.iter().map(|(_, corners)| corners.len()).sum();
            Surface { template, skin, corners }
        };
        let templates = grains.templates().iter().map(surface).collect();
        let mut surfaces = Self { grains, templates, points: 0, polygons: 0, corners: 0 };
        let (mut points, mut polygons, mut corners) = (0, 0, 0);
        surfaces.for_each(|surface, _| {
            points += surface.skin.points.len();
            polygons += surface.skin.polygons.len();
            corners += surface.corners;
            Ok(())
        })?;
        (surfaces.points, surfaces.polygons, surfaces.corners) = (points, polygons, corners);
        Ok(surfaces)
    }

    /// Calls `visit` with the surface and the template of each grain.
    fn for_each(&self, mut visit: impl FnMut(&Surface<'a>, usize) -> io::Result<()>) -> io::Result<()> {
        for_each_block(self.grains, [Column::Template], |[templates]| {
            for &template in templates {
                let found = self.templates.get(template as usize).filter(|_| template >= 0.0);
                let surface = found.ok_or_else(|| invalid(format!("there is no template {template}")))?;
                visit(surface, template as usize)?;
            }
            Ok(())
        })
    }

    /// Calls `visit` with each point of each grain.
    fn for_each_point(&self, mut visit: impl FnMut([f64; 3]) -> io::Result<()>) -> io::Result<()> {
        for_each_block(self.grains, POLYHEDRON_ROW, |columns| {
            for row in 0..columns[0].len() {
                let [x, y, z, d, w, i, j, k, template] = columns.map(|column| column[row]);
                let Surface { template, skin, .. } = &self.templates[template as usize];
                let orientation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
                let pose = Pose { center_mm: Vector3::new(x, y, z), orientation };
                let vertices: Vec<Vector3<f64>> = template.world_vertices_mm(d, &pose).collect();
                let (rotation, radius) = (pose.rotation(), d * template.rounding());
                for point in &skin.points {
                    let vertex = vertices[point.vertex as usize];
                    let p = if radius > 0.0 { vertex + rotation * point.normal * radius } else { vertex };
                    visit(p.into())?;
                }
            }
            Ok(())
        })
    }

    /// Calls `visit` with a value of each grain, as often as it has polygons.
    fn for_each_polygon(
        &self,
        column: Column,
        mut visit: impl FnMut(f64) -> io::Result<()>,
    ) -> io::Result<()> {
        for_each_block(self.grains, [column, Column::Template], |[values, templates]| {
            for (&value, &template) in values.iter().zip(templates) {
                for _ in &self.templates[template as usize].skin.polygons {
                    visit(value)?;
                }
            }
            Ok(())
        })
    }

    /// Calls `visit` with the corners of each polygon, and the number of the first point of its grain.
    fn for_each_corners(&self, mut visit: impl FnMut(&[u32], usize) -> io::Result<()>) -> io::Result<()> {
        let mut first = 0;
        self.for_each(|surface, _| {
            for (_, corners) in &surface.skin.polygons {
                visit(corners, first)?;
            }
            first += surface.skin.points.len();
            Ok(())
        })
    }

    /// Calls `visit` with the number of the grain of each polygon.
    fn for_each_id(&self, mut visit: impl FnMut(i32) -> io::Result<()>) -> io::Result<()> {
        let mut id = 0;
        self.for_each(|surface, _| {
            for _ in &surface.skin.polygons {
                visit(id)?;
            }
            id += 1;
            Ok(())
        })
    }
}

pub(super) fn write_legacy(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let surfaces = Surfaces::new(grains)?;
    let (class, size) = (classifier(head), nominal_size(head, grains));
    let mut out = io::BufWriter::with_capacity(1 << 16, out);
    write!(out, "# vtk DataFile Version 3.0\n{}\nBINARY\nDATASET POLYDATA\n", title(head))?;
    writeln!(out, "POINTS {} double", surfaces.points)?;
    surfaces.for_each_point(|p| p.iter().try_for_each(|x| out.write_all(&x.to_be_bytes())))?;
    let n = surfaces.polygons;
    writeln!(out, "\nPOLYGONS {n} {}", n + surfaces.corners)?;
    surfaces.for_each_corners(|corners, first| {
        out.write_all(&(corners.len() as i32).to_be_bytes())?;
        corners
            .iter()
            .try_for_each(|&corner| out.write_all(&((first + corner as usize) as i32).to_be_bytes()))
    })?;
    writeln!(out, "\nCELL_DATA {n}\nSCALARS diameter double 1\nLOOKUP_TABLE default")?;
    surfaces.for_each_polygon(Column::Diameter, |d| out.write_all(&d.to_be_bytes()))?;
    let arrays = 4 + i32::from(grains.has_aggregates());
    writeln!(out, "\nFIELD arrays {arrays}\nsieve 1 {n} double")?;
    surfaces.for_each_polygon(Column::Sieve, |size| out.write_all(&size.to_be_bytes()))?;
    writeln!(out, "\nsieve_class 1 {n} int")?;
    surfaces.for_each_polygon(size, |d| out.write_all(&class(d).to_be_bytes()))?;
    writeln!(out, "\ntemplate 1 {n} int")?;
    surfaces
        .for_each_polygon(Column::Template, |template| out.write_all(&(template as i32).to_be_bytes()))?;
    if grains.has_aggregates() {
        writeln!(out, "\naggregate 1 {n} int")?;
        surfaces.for_each_polygon(Column::Aggregate, |k| out.write_all(&(k as i32).to_be_bytes()))?;
    }
    writeln!(out, "\nid 1 {n} int")?;
    surfaces.for_each_id(|id| out.write_all(&id.to_be_bytes()))?;
    writeln!(out)?;
    out.flush()
}

pub(super) fn write_xml(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let surfaces = &Surfaces::new(grains)?;
    let (class, size) = (classifier(head), nominal_size(head, grains));
    let (points, n) = (surfaces.points, surfaces.polygons);
    let mut file = provenance_file(head, [points, 0, n]);
    file.section("Points", None);
    file.fill::<[f64; 3]>("Points", points, |sink| put(sink, |put| surfaces.for_each_point(|p| put.put(p))));
    file.section("CellData", Some("diameter"));
    for (name, column) in [("diameter", Column::Diameter), ("sieve", Column::Sieve)] {
        file.fill::<f64>(name, n, move |sink| {
            put(sink, |put| surfaces.for_each_polygon(column, |value| put.put(value)))
        });
    }
    file.fill::<i32>("sieve_class", n, move |sink| {
        put(sink, |put| surfaces.for_each_polygon(size, |d| put.put(class(d))))
    });
    file.fill::<i32>("template", n, |sink| {
        put(sink, |put| surfaces.for_each_polygon(Column::Template, |template| put.put(template as i32)))
    });
    if grains.has_aggregates() {
        file.fill::<i32>("aggregate", n, |sink| {
            put(sink, |put| surfaces.for_each_polygon(Column::Aggregate, |k| put.put(k as i32)))
        });
    }
    file.fill::<i32>("id", n, |sink| put(sink, |put| surfaces.for_each_id(|id| put.put(id))));
    file.section("Polys", None);
    file.fill::<i64>("connectivity", surfaces.corners, |sink| {
        put(sink, |put| {
            surfaces.for_each_corners(|corners, first| {
                corners.iter().try_for_each(|&corner| put.put((first + corner as usize) as i64))
            })
        })
    });
    file.fill::<i64>("offsets", n, |sink| {
        let mut end = 0;
        put(sink, |put| {
            surfaces.for_each_corners(|corners, _| {
                end += corners.len() as i64;
                put.put(end)
            })
        })
    });
    file.write(out, &mut |_| Ok(())).map_err(|error| match error {
        ExportError::Write(error) => error,
        other => io::Error::other(other),
    })
}

/// A sink whose faults are those of writers.
struct Put<'a, 'b>(&'a mut Sink<'b>);

impl Put<'_, '_> {
    fn put(&mut self, value: impl crate::export::vtk_xml::Value) -> io::Result<()> {
        self.0.put(value).map_err(|error| match error {
            ExportError::Write(error) => error,
            other => io::Error::other(other),
        })
    }
}

fn put(
    sink: &mut Sink<'_>,
    fill: impl FnOnce(&mut Put<'_, '_>) -> io::Result<()>,
) -> Result<(), ExportError> {
    fill(&mut Put(sink)).map_err(ExportError::Write)
}
