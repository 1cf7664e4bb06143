//! Results with polyhedra in the VTK forms: the surfaces of the grains as polygons, which a viewer shows as they are.
//!
//! A sharp grain has the faces of its template. A rounded one has its plane faces, rectangles around its edges and
//! triangles around its vertices, whose arcs turn by at most 45 degrees at a time. An ellipsoid or sphere among
//! polyhedra has 320 triangles, which turn by at most 18 degrees on the sphere that it is an image of. Surfaces that
//! are not exact are scaled about the centre until they have the volume of the grain. Points are not shared by grains.
//! Arrays of the polygons: `diameter` (float64, mm; of the sphere of equal volume), `sieve` (float64, mm),
//! `sieve_class`, `id` and `aggregate` as in the other forms, `template` (int32; -1 of ellipsoids). Mixtures have
//! `tensor` as ellipsoids have it in the other forms; it is 0 of polyhedra.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_4, PI};
use std::io::{self, Write};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::load::invalid;
use super::source::{OF_ELLIPSOID, for_each_block, for_each_body};
use super::vtk::{BODY, classifier, provenance_file, symmetric, tensor, title};
use super::{Column, GrainSource, Head, nominal_size};
use crate::arrays::Each as _;
use crate::elementary::cbrt;
use crate::export::ExportError;
use crate::export::vtk_xml::Sink;
use crate::geometry::convex::{Convex, Skin, SkinPoint};
use crate::shape::{Polyhedron, Pose, Solid};

/// Times that the triangles of an icosahedron are divided for an ellipsoid, which then has 320.
const BALL_DIVISIONS: u32 = 2;
/// Largest angle between neighbours on an arc.
const MOST_ANGLE: f64 = FRAC_PI_4 + 1e-9;

/// The surface of a form of grains.
struct Surface<'a> {
    points: Points<'a>,
    polygons: Vec<Vec<u32>>,
    /// Corners of all polygons.
    corners: usize,
    /// By what points are scaled about the centre of a grain, so that the polygons enclose its volume.
    scale: f64,
}

/// Where the points of a surface lie.
enum Points<'a> {
    /// On a template.
    Template(&'a Polyhedron, Vec<SkinPoint>),
    /// On the unit sphere that an ellipsoid is an image of.
    Ball(Vec<Vector3<f64>>),
}

impl<'a> Surface<'a> {
    /// A surface that encloses a volume, after it is scaled.
    fn new(points: Points<'a>, polygons: Vec<Vec<u32>>, volume: f64) -> Self {
        let corners = polygons.iter().map(Vec::len).sum();
        let mut surface = Self { points, polygons, corners, scale: 1.0 };
        surface.scale = cbrt(volume / surface.volume());
        surface
    }

    fn of_template(template: &'a Polyhedron) -> Self {
        let skin = Skin::new(&Convex::new(template), MOST_ANGLE);
        let polygons = skin.polygons.into_iter().map(|(_, corners)| corners).collect();
        let surface = Self::new(Points::Template(template, skin.points), polygons, template.volume());
        // Sharp grains are exact to the last bit.
        if template.rounding() == 0.0 { Self { scale: 1.0, ..surface } } else { surface }
    }

    /// Of spheres and ellipsoids.
    fn of_ball() -> Self {
        let (points, triangles) = ball();
        Self::new(Points::Ball(points), triangles, 4.0 / 3.0 * PI)
    }

    /// The points in the units of the template, or of the unit sphere, before they are scaled.
    fn own_points(&self) -> Vec<Vector3<f64>> {
        match &self.points {
            Points::Ball(points) => points.clone(),
            Points::Template(template, points) => {
                let at = |point: &SkinPoint| {
                    template.vertices()[point.vertex as usize] + point.normal * template.rounding()
                };
                points.iter().map(at).collect()
            }
        }
    }

    /// Volume inside, in the units of the template, or of the unit sphere, before it is scaled.
    fn volume(&self) -> f64 {
        let points = self.own_points();
        let at = |p: u32| points[p as usize];
        let fan = |corners: &Vec<u32>| {
            let pairs = corners[1..].windows(2);
            pairs.map(|pair| at(corners[0]).dot(&at(pair[0]).cross(&at(pair[1])))).sum::<f64>() / 6.0
        };
        self.polygons.iter().map(fan).sum()
    }

    fn len(&self) -> usize {
        match &self.points {
            Points::Template(_, points) => points.len(),
            Points::Ball(points) => points.len(),
        }
    }

    /// Calls `visit` with the points of a grain with this surface.
    fn for_each_point(
        &self,
        pose: &Pose,
        d_mm: f64,
        semi_axes_mm: &Vector3<f64>,
        visit: &mut dyn FnMut([f64; 3]) -> io::Result<()>,
    ) -> io::Result<()> {
        let rotation = pose.rotation();
        match &self.points {
            Points::Ball(points) => {
                for point in points {
                    let from_center = rotation * point.component_mul(semi_axes_mm) * self.scale;
                    visit((pose.center_mm + from_center).into())?;
                }
            }
            Points::Template(template, points) => {
                let vertices: Vec<Vector3<f64>> = template.world_vertices_mm(d_mm, pose).collect();
                let radius = d_mm * template.rounding();
                for point in points {
                    let vertex = vertices[point.vertex as usize];
                    if radius == 0.0 {
                        visit(vertex.into())?;
                        continue;
                    }
                    let from_center = vertex + rotation * point.normal * radius - pose.center_mm;
                    visit((pose.center_mm + from_center * self.scale).into())?;
                }
            }
        }
        Ok(())
    }
}

/// The unit sphere by points and triangles, counter-clockwise as seen from outside: an icosahedron whose triangles are
/// divided into four.
pub(super) fn ball() -> (Vec<Vector3<f64>>, Vec<Vec<u32>>) {
    let g = f64::midpoint(1.0, 5.0_f64.sqrt());
    let signs = [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
    let corners = signs.iter().flat_map(|[p, q]| {
        let (x, y) = (*p, q * g);
        [[0.0, x, y], [x, y, 0.0], [y, 0.0, x]].each(|corner| Vector3::from(corner).normalize())
    });
    let Some(hull) = Polyhedron::hull_of(&corners.collect::<Vec<_>>()) else { return Default::default() };
    let mut points: Vec<Vector3<f64>> = hull.vertices().iter().map(Vector3::normalize).collect();
    let mut triangles = hull.faces().to_vec();
    for _ in 0..BALL_DIVISIONS {
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let mut divided = |corners: &Vec<u32>| {
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [vec![a, ab, ca], vec![b, bc, ab], vec![c, ca, bc], vec![ab, bc, ca]]
        };
        triangles = triangles.iter().flat_map(&mut divided).collect();
    }
    (points, triangles)
}

/// The surface of a grain: its points in mm, and its polygons by them, counter-clockwise as seen from outside.
pub(crate) struct GrainSurface {
    pub(crate) points: Vec<[f64; 3]>,
    pub(crate) polygons: Vec<Vec<u32>>,
}

/// The surface of one grain; `None` where there is no such template.
pub(crate) fn surface_of(solid: &Solid, templates: &[Polyhedron], pose: &Pose) -> Option<GrainSurface> {
    let (surface, semi_axes_mm) = match solid.template() {
        None => (Surface::of_ball(), solid.ellipsoid()?.semi_axes_mm()),
        Some(template) => (Surface::of_template(templates.get(template as usize)?), Vector3::zeros()),
    };
    let mut points = Vec::with_capacity(surface.len());
    let mut keep = |point| {
        points.push(point);
        Ok(())
    };
    surface.for_each_point(pose, solid.d_mm(), &semi_axes_mm, &mut keep).ok()?;
    Some(GrainSurface { points, polygons: surface.polygons })
}

/// The surfaces of all grains.
struct Surfaces<'a> {
    grains: &'a dyn GrainSource,
    templates: Vec<Surface<'a>>,
    ball: Surface<'a>,
    points: usize,
    polygons: usize,
    corners: usize,
}

impl<'a> Surfaces<'a> {
    fn new(grains: &'a dyn GrainSource) -> io::Result<Self> {
        let templates = grains.templates().iter().map(Surface::of_template).collect();
        let ball = Surface::of_ball();
        let mut surfaces = Self { grains, templates, ball, points: 0, polygons: 0, corners: 0 };
        let (mut points, mut polygons, mut corners) = (0, 0, 0);
        surfaces.for_each(&mut |surface| {
            points += surface.len();
            polygons += surface.polygons.len();
            corners += surface.corners;
            Ok(())
        })?;
        (surfaces.points, surfaces.polygons, surfaces.corners) = (points, polygons, corners);
        Ok(surfaces)
    }

    /// The surface of grains with this template.
    fn of(&self, template: f64) -> io::Result<&Surface<'a>> {
        let found = if template == OF_ELLIPSOID && self.grains.has(Column::A) {
            Some(&self.ball)
        } else {
            self.templates.get(template as usize).filter(|_| template >= 0.0)
        };
        found.ok_or_else(|| invalid(format!("there is no template {template}")))
    }

    /// Calls `visit` with the surface of each grain.
    fn for_each(&self, visit: &mut dyn FnMut(&Surface<'a>) -> io::Result<()>) -> io::Result<()> {
        for_each_block(self.grains, [Column::Template], |[templates]| {
            templates.iter().try_for_each(|&template| visit(self.of(template)?))
        })
    }

    /// Calls `visit` with each point of each grain.
    fn for_each_point(&self, visit: &mut dyn FnMut([f64; 3]) -> io::Result<()>) -> io::Result<()> {
        for_each_body(self.grains, &mut |row| {
            let [w, i, j, k] = row.quaternion;
            let orientation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
            let pose = Pose { center_mm: row.center_mm.into(), orientation };
            let surface = self.of(row.template.unwrap_or(OF_ELLIPSOID))?;
            surface.for_each_point(&pose, row.d_mm, &row.semi_axes_mm.into(), visit)
        })
    }

    /// Calls `visit` with a value of each grain, as often as it has polygons.
    fn for_each_polygon(
        &self,
        column: Column,
        visit: &mut dyn FnMut(f64) -> io::Result<()>,
    ) -> io::Result<()> {
        for_each_block(self.grains, [column, Column::Template], |[values, templates]| {
            for (&value, &template) in values.iter().zip(templates) {
                for _ in &self.of(template)?.polygons {
                    visit(value)?;
                }
            }
            Ok(())
        })
    }

    /// Calls `visit` with the tensor of each grain, as often as it has polygons; 0 of polyhedra.
    fn for_each_tensor(&self, visit: &mut dyn FnMut(&Matrix3<f64>) -> io::Result<()>) -> io::Result<()> {
        let [w, i, j, k, a, b, c] = BODY;
        for_each_block(self.grains, [w, i, j, k, a, b, c, Column::Template], |columns| {
            for row in 0..columns[0].len() {
                let [w, i, j, k, a, b, c, template] = columns.each(|column| column[row]);
                let tensor = tensor([w, i, j, k, a, b, c]);
                for _ in &self.of(template)?.polygons {
                    visit(&tensor)?;
                }
            }
            Ok(())
        })
    }

    /// Calls `visit` with the corners of each polygon, and the number of the first point of its grain.
    fn for_each_corners(&self, visit: &mut dyn FnMut(&[u32], usize) -> io::Result<()>) -> io::Result<()> {
        let mut first = 0;
        self.for_each(&mut |surface| {
            for corners in &surface.polygons {
                visit(corners, first)?;
            }
            first += surface.len();
            Ok(())
        })
    }

    /// Calls `visit` with the number of the grain of each polygon.
    fn for_each_id(&self, visit: &mut dyn FnMut(i32) -> io::Result<()>) -> io::Result<()> {
        let mut id = 0;
        self.for_each(&mut |surface| {
            for _ in &surface.polygons {
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
    surfaces.for_each_point(&mut |p| p.iter().try_for_each(|x| out.write_all(&x.to_be_bytes())))?;
    let n = surfaces.polygons;
    writeln!(out, "\nPOLYGONS {n} {}", n + surfaces.corners)?;
    surfaces.for_each_corners(&mut |corners, first| {
        out.write_all(&(corners.len() as i32).to_be_bytes())?;
        corners
            .iter()
            .try_for_each(|&corner| out.write_all(&((first + corner as usize) as i32).to_be_bytes()))
    })?;
    writeln!(out, "\nCELL_DATA {n}\nSCALARS diameter double 1\nLOOKUP_TABLE default")?;
    surfaces.for_each_polygon(Column::Diameter, &mut |d| out.write_all(&d.to_be_bytes()))?;
    if grains.has(Column::A) {
        writeln!(out, "\nTENSORS tensor double")?;
        // Symmetric, so that the order of rows and columns does not matter.
        surfaces
            .for_each_tensor(&mut |tensor| tensor.iter().try_for_each(|x| out.write_all(&x.to_be_bytes())))?;
    }
    let arrays = 4 + i32::from(grains.has(Column::Aggregate));
    writeln!(out, "\nFIELD arrays {arrays}\nsieve 1 {n} double")?;
    surfaces.for_each_polygon(Column::Sieve, &mut |size| out.write_all(&size.to_be_bytes()))?;
    writeln!(out, "\nsieve_class 1 {n} int")?;
    surfaces.for_each_polygon(size, &mut |d| out.write_all(&class(d).to_be_bytes()))?;
    writeln!(out, "\ntemplate 1 {n} int")?;
    surfaces.for_each_polygon(Column::Template, &mut |template| {
        out.write_all(&(template as i32).to_be_bytes())
    })?;
    if grains.has(Column::Aggregate) {
        writeln!(out, "\naggregate 1 {n} int")?;
        surfaces.for_each_polygon(Column::Aggregate, &mut |k| out.write_all(&(k as i32).to_be_bytes()))?;
    }
    writeln!(out, "\nid 1 {n} int")?;
    surfaces.for_each_id(&mut |id| out.write_all(&id.to_be_bytes()))?;
    writeln!(out)?;
    out.flush()
}

pub(super) fn write_xml(head: &Head, grains: &dyn GrainSource, out: &mut dyn Write) -> io::Result<()> {
    let surfaces = &Surfaces::new(grains)?;
    let (class, size) = (classifier(head), nominal_size(head, grains));
    let (points, n) = (surfaces.points, surfaces.polygons);
    let mut file = provenance_file(head, [points, 0, n]);
    file.section("Points", None);
    file.fill::<[f64; 3]>("Points", points, |sink| {
        put(sink, &mut |put| surfaces.for_each_point(&mut |p| put.put(p)))
    });
    file.section("CellData", Some("diameter"));
    for (name, column) in [("diameter", Column::Diameter), ("sieve", Column::Sieve)] {
        file.fill::<f64>(name, n, move |sink| {
            put(sink, &mut |put| surfaces.for_each_polygon(column, &mut |value| put.put(value)))
        });
    }
    if grains.has(Column::A) {
        file.fill::<[f64; 6]>("tensor", n, |sink| {
            put(sink, &mut |put| surfaces.for_each_tensor(&mut |tensor| put.put(symmetric(tensor))))
        });
    }
    file.fill::<i32>("sieve_class", n, move |sink| {
        put(sink, &mut |put| surfaces.for_each_polygon(size, &mut |d| put.put(class(d))))
    });
    file.fill::<i32>("template", n, |sink| {
        put(sink, &mut |put| {
            surfaces.for_each_polygon(Column::Template, &mut |template| put.put(template as i32))
        })
    });
    if grains.has(Column::Aggregate) {
        file.fill::<i32>("aggregate", n, |sink| {
            put(sink, &mut |put| surfaces.for_each_polygon(Column::Aggregate, &mut |k| put.put(k as i32)))
        });
    }
    file.fill::<i32>("id", n, |sink| put(sink, &mut |put| surfaces.for_each_id(&mut |id| put.put(id))));
    file.section("Polys", None);
    file.fill::<i64>("connectivity", surfaces.corners, |sink| {
        put(sink, &mut |put| {
            surfaces.for_each_corners(&mut |corners, first| {
                corners.iter().try_for_each(|&corner| put.put((first + corner as usize) as i64))
            })
        })
    });
    file.fill::<i64>("offsets", n, |sink| {
        let mut end = 0;
        put(sink, &mut |put| {
            surfaces.for_each_corners(&mut |corners, _| {
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
    fill: &mut dyn FnMut(&mut Put<'_, '_>) -> io::Result<()>,
) -> Result<(), ExportError> {
    fill(&mut Put(sink)).map_err(ExportError::Write)
}
