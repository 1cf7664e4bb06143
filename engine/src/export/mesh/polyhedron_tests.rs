//! Surface meshes of polyhedra.

#![allow(clippy::unwrap_used)]

use super::tests::{CUBE, CYLINDER, assert_closed_sphere};
use super::*;
use crate::export::polyhedra_samples::{mixed, packed};
use crate::gap::linear;
use crate::gap::polyhedra::Body;
use crate::geometry::convex::{Convex, Place};
use crate::packing::Solids;
use crate::shape::polyhedron::{TemplateKind, draw_template};
use crate::shape::{Form, Pose, Solid};
use nalgebra::Vector3;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

fn mesh(specimen: &Specimen, grains: &Solids, options: &SurfaceOptions) -> (Mesh, SurfaceReport) {
    Mesh::new(&Model::new(specimen, grains), options, &Limits::default(), &Unattended).unwrap()
}

/// Surfaces are closed, turned outwards, convex but for dents of a share of the diameter, inside of the specimen, and
/// outside of all other grains; the plane
/// that parts a pair parts their surfaces with nearly half of the gap between them.
fn assert_sound(specimen: &Specimen, grains: &Solids, mesh: &Mesh, report: &SurfaceReport, most_dent: f64) {
    let bodies: Vec<Body> = (0..grains.len())
        .map(|row| {
            Body::new(
                grains.shape(row).polyhedron().unwrap().template,
                grains.shapes[row].d_mm(),
                &grains.poses[row],
            )
        })
        .collect();
    let templates = Convex::all(&grains.templates);
    let mut sum = 0.0;
    for row in 0..grains.len() {
        let (points, triangles) = mesh.grain(row);
        assert_closed_sphere(points.len(), triangles);
        let center: [f64; 3] = grains.poses[row].center_mm.into();
        let from = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|a| p[a] - q[a]);
        let d = grains.shapes[row].d_mm();
        for corners in triangles {
            let [a, b, c] = corners.map(|p| points[p as usize]);
            let normal = linear::cross(from(b, a), from(c, a));
            let length = linear::dot(normal, normal).sqrt();
            assert!(length > 1e-9 * d * d, "{row}: a triangle of the area {}", length / 2.0);
            sum += linear::dot(from(a, center), normal) / 6.0;
            let above =
                points.iter().map(|p| linear::dot(normal, from(*p, a))).fold(f64::NEG_INFINITY, f64::max);
            assert!(
                above / length < most_dent * d,
                "{row}: a vertex lies {} above a triangle",
                above / length
            );
        }
        for p in points {
            let inside = match *specimen {
                Specimen::Box { size_mm, .. } => (0..3).all(|a| p[a] > 0.0 && p[a] < size_mm[a]),
                Specimen::Cylinder { diameter_mm, height_mm } => {
                    let radius = diameter_mm / 2.0;
                    p[2] > 0.0 && p[2] < height_mm && (p[0] - radius).hypot(p[1] - radius) < radius
                }
            };
            assert!(inside, "{row}: {p:?} is outside of the specimen");
        }
        for other in (0..grains.len()).filter(|other| *other != row) {
            let (template, place) = (
                &templates[grains.shapes[other].template().unwrap() as usize],
                Place::new(grains.shapes[other].d_mm(), &grains.poses[other]),
            );
            assert!(points.iter().all(|p| template.distance(&place.local(&(*p).into())) > 0.0));
            if row < other {
                let contact = bodies[row].with(&bodies[other]).contact();
                let along = |p: &[f64; 3]| linear::dot(*p, contact.normal.into());
                let high = points.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
                let low = mesh.grain(other).0.iter().map(along).fold(f64::INFINITY, f64::min);
                assert!(high + 0.45 * contact.gap_mm <= low, "{row} {other}: {high} {low} {contact:?}");
            }
        }
    }
    assert!((sum / report.aggregate_volume_mm3 - 1.0).abs() < 1e-9, "{sum} {report:?}");
    assert_closed_sphere(mesh.shell.surface.points.len(), &mesh.shell.surface.triangles);
}

#[test]
fn sharp_polyhedra_have_their_volume_and_all_faces_where_these_are_asked_for() {
    for specimen in [CUBE, CYLINDER] {
        let grains = packed(&specimen, 24, [5.0, 2.0], 0.05, 0.0);
        let templates = Convex::all(&grains.templates);
        for (size_field, faces) in
            [(false, FaceChoice::Simplified), (true, FaceChoice::Simplified), (true, FaceChoice::Exact)]
        {
            let options = SurfaceOptions { size_field, faces, ..SurfaceOptions::default() };
            let (mesh, report) = mesh(&specimen, &grains, &options);
            assert_sound(&specimen, &grains, &mesh, &report, 1e-8);
            assert!(report.aggregate_volume_error.abs() < 2e-3, "{report:?}");
            let mut exact = 0;
            for row in 0..grains.len() {
                let number = grains.shapes[row].template().unwrap() as usize;
                let place = Place::new(grains.shapes[row].d_mm(), &grains.poses[row]);
                let away = |p: &[f64; 3]| templates[number].distance(&place.local(&(*p).into()));
                let farthest = mesh.grain(row).0.iter().map(away).fold(0.0, f64::max);
                assert!(farthest < 0.05 * grains.shapes[row].d_mm(), "{row}: {farthest}");
                // The vertices of the grains are among those of the mesh, to the last bit but for the sum with the
                // centre, where no face is left out.
                let template = grains.shape(row).polyhedron().unwrap().template;
                let mut vertices = template.world_vertices_mm(grains.shapes[row].d_mm(), &grains.poses[row]);
                exact += usize::from(vertices.all(|vertex| mesh.grain(row).0.contains(&vertex.into())));
            }
            assert!(exact > 0 && (faces == FaceChoice::Simplified) == (exact < grains.len()), "{exact}");
        }
    }
}

/// Polyhedra of all numbers of faces and roundings have their volume, however coarse the edges are and however narrow
/// the gaps.
#[test]
fn polyhedra_have_their_volume_at_all_segments() {
    let specimen = Specimen::Box { size_mm: [30.0; 3], boundary: crate::request::Boundary::Walls };
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
    for rounding in [0.0, 0.05, 0.2, 0.4] {
        let templates = [6, 24, 60].map(|faces| {
            let form = Form { elongation: 0.8, flatness: 0.7 };
            let template = draw_template(TemplateKind::Cuts(faces), form, &mut rng).unwrap();
            template.with_relative_rounding(rounding).unwrap().normalized()
        });
        // In a row, 0.1 mm apart along x and from the lowest wall.
        let mut grains = Solids { templates: templates.to_vec(), ..Solids::default() };
        let mut x = 0.0;
        for (number, template) in (0..).zip(&templates) {
            let d_mm = 7.0 - f64::from(number);
            let along = |axis: usize, side: f64| {
                let heights = template.vertices().iter().map(|v| side * v[axis]);
                d_mm * (heights.fold(f64::NEG_INFINITY, f64::max) + rounding)
            };
            let center_mm = Vector3::new(x + 0.1 + along(0, -1.0), 15.0, 0.1 + along(2, -1.0));
            x = center_mm.x + along(0, 1.0);
            grains.shapes.push(Solid::Polyhedron { template: number, d_mm });
            grains.poses.push(Pose::at(center_mm));
        }
        let exact: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        for segments in [6, 10, 16, 40] {
            let options = SurfaceOptions::default().with_segments(segments);
            let (mesh, report) = mesh(&specimen, &grains, &options);
            assert_sound(&specimen, &grains, &mesh, &report, 1e-7);
            let error = report.aggregate_volume_mm3 / exact - 1.0;
            assert!(error.abs() < 5e-3, "rounding {rounding}, {segments} segments: {error}");
            assert!(report.warnings.is_empty());
            let options = geo::GeoOptions { segments, ..geo::GeoOptions::default() };
            let model = Model::new(&specimen, &grains);
            let script = geo::write(&model, &options, &Limits::default(), &Unattended, &mut std::io::sink());
            let error = script.unwrap().expected_volume_error;
            assert!(error.abs() < 5e-3, "rounding {rounding}, {segments} segments, geo: {error}");
        }
    }
}

#[test]
fn rounded_polyhedra_are_closed_convex_and_apart() {
    for (specimen, rounding) in [(CUBE, 0.1), (CYLINDER, 0.04), (CUBE, 0.01)] {
        let grains = packed(&specimen, 24, [5.0, 2.0], 0.05, rounding);
        for (volume_correction, size_fields) in [
            (VolumeCorrection::None, [rounding > 0.05].as_slice()),
            (VolumeCorrection::Scaled, &[false, true]),
        ] {
            for &size_field in size_fields {
                let options = SurfaceOptions { size_field, volume_correction, ..SurfaceOptions::default() };
                let (mesh, report) = mesh(&specimen, &grains, &options);
                println!("{rounding} {volume_correction:?} {size_field} {report:?}");
                // Facets are flat but for rounding.
                assert_sound(&specimen, &grains, &mesh, &report, 1e-8);
                if volume_correction == VolumeCorrection::None {
                    assert!((-0.16..-1e-2).contains(&report.aggregate_volume_error), "{report:?}");
                    let templates = Convex::all(&grains.templates);
                    for row in 0..grains.len() {
                        let (template, place) = (
                            &templates[grains.shapes[row].template().unwrap() as usize],
                            Place::new(grains.shapes[row].d_mm(), &grains.poses[row]),
                        );
                        let reach = |p: &[f64; 3]| template.distance(&place.local(&(*p).into()));
                        assert!(mesh.grain(row).0.iter().all(|p| reach(p) < 1e-12), "{row}");
                    }
                } else if report.grains_short_of_volume == 0 {
                    assert!(report.aggregate_volume_error.abs() < 1e-12, "{report:?}");
                } else if rounding > 0.02 {
                    assert!(report.aggregate_volume_error.abs() < 5e-3, "{report:?}");
                }
            }
        }
    }
}

/// Where there is room, rounded grains have the volume of Steiner's formula.
#[test]
fn rounded_polyhedra_have_their_volume_where_there_is_room() {
    let specimen = Specimen::Box { size_mm: [30.0; 3], boundary: crate::request::Boundary::Walls };
    for rounding in [0.01, 0.05, 0.2] {
        let grains = packed(&specimen, 12, [6.0, 3.0], 1.0, rounding);
        let (_, report) = mesh(&specimen, &grains, &SurfaceOptions::default());
        let exact: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        assert!((report.aggregate_volume_mm3 / exact - 1.0).abs() < 1e-12, "{report:?}");
        assert_eq!(report.grains_short_of_volume, 0);
    }
}

/// Ellipsoids and polyhedra in one mesh: closed surfaces that have the volumes of the grains and keep clear of each
/// other, and an estimate that holds.
#[test]
fn ellipsoids_and_polyhedra_are_meshed_together() {
    for (specimen, rounding) in [(CUBE, 0.0), (CYLINDER, 0.05)] {
        let grains = mixed(&specimen, 24, [5.0, 2.0], 0.2, rounding);
        let options = SurfaceOptions::default().with_segments(12);
        let (mesh, report) = mesh(&specimen, &grains, &options);
        let mut volume = 0.0;
        for row in 0..grains.len() {
            let (points, triangles) = mesh.grain(row);
            assert_closed_sphere(points.len(), triangles);
            let center: [f64; 3] = grains.poses[row].center_mm.into();
            for corners in triangles {
                let [a, b, c] = corners.map(|p| [0, 1, 2].map(|k| points[p as usize][k] - center[k]));
                volume += linear::dot(a, linear::cross(b, c)) / 6.0;
            }
            for other in (0..grains.len()).filter(|other| *other != row) {
                let body = crate::gap::solids::Body::new(grains.shape(other), &grains.poses[other]);
                for p in points {
                    let at_point = crate::shape::Ellipsoid::sphere(0.02).unwrap();
                    let at_point = crate::gap::solids::Body::new(at_point.into(), &Pose::at((*p).into()));
                    assert!(at_point.is_apart(&body, 0.0), "a vertex of {row} lies at {other}");
                }
            }
        }
        assert!((volume / report.aggregate_volume_mm3 - 1.0).abs() < 1e-9, "{report:?}");
        let exact: f64 = (0..grains.len()).map(|row| grains.shape(row).volume_mm3()).sum();
        assert!((volume / exact - 1.0).abs() < 5e-3, "{report:?}");
        let model = Model::new(&specimen, &grains);
        let (guess, ..) =
            estimate::of_model(&MeshModel::new(&model).unwrap(), &options, &Unattended).unwrap();
        let ratio = guess.triangles as f64 / report.triangles as f64;
        assert!((1.0 / 1.1..1.1).contains(&ratio), "{ratio} of {}", report.triangles);
    }
}

#[test]
fn estimates_of_polyhedra_are_what_the_mesh_has() {
    let cube = Specimen::Box { size_mm: [25.0, 22.0, 20.0], boundary: crate::request::Boundary::Walls };
    let grains = packed(&cube, 300, [3.0, 1.0], 0.05, 0.05);
    for options in [SurfaceOptions::default(), SurfaceOptions::default().with_segments(8)] {
        let model = Model::new(&cube, &grains);
        let (guess, ..) =
            estimate::of_model(&MeshModel::new(&model).unwrap(), &options, &Unattended).unwrap();
        let (_, report) = mesh(&cube, &grains, &options);
        let ratio = guess.triangles as f64 / report.triangles as f64;
        assert!((1.0 / 1.1..1.1).contains(&ratio), "{ratio} of {}", report.triangles);
    }
}

#[test]
fn the_script_of_solids_has_the_bodies_of_the_mesh() {
    for rounding in [0.0, 0.05] {
        let grains = packed(&CUBE, 12, [5.0, 2.5], 0.3, rounding);
        let model = Model::new(&CUBE, &grains);
        for volume_correction in [VolumeCorrection::Scaled, VolumeCorrection::None] {
            let options = geo::GeoOptions { volume_correction, ..geo::GeoOptions::default() };
            let mut script = Vec::new();
            let of_geo = geo::write(&model, &options, &Limits::default(), &Unattended, &mut script).unwrap();
            let options =
                SurfaceOptions { size_field: false, volume_correction, ..SurfaceOptions::default() };
            let (mesh, report) = mesh(&CUBE, &grains, &options);
            assert!((of_geo.expected_volume_error - report.aggregate_volume_error).abs() < 1e-12);
            assert_eq!(of_geo.grains_short_of_volume, report.grains_short_of_volume);
            let script = String::from_utf8(script).unwrap();
            let points = script.lines().filter_map(|line| line.strip_prefix("Point(")?.split_once('{'));
            let mut found = 0;
            for (_, coordinates) in points {
                let x: Vec<f64> =
                    coordinates.trim_end_matches("};").split(", ").map(|x| x.parse().unwrap()).collect();
                let nearest = mesh.grain_points().iter().map(|p| linear::distance2(*p, [x[0], x[1], x[2]]));
                assert!(nearest.fold(f64::INFINITY, f64::min).sqrt() < 1e-12);
                found += 1;
            }
            assert!(found > 8 * grains.len());
        }
    }
}

#[test]
fn surfaces_do_not_depend_on_the_threads() {
    let (grains, options) = (packed(&CUBE, 60, [3.0, 1.0], 0.05, 0.05), SurfaceOptions::default());
    let written = |threads: usize| {
        let limits = Limits { export_threads: threads.try_into().unwrap(), ..Limits::default() };
        let mut file = Vec::new();
        let model = Model::new(&CUBE, &grains);
        let report = msh::write(&model, &options, &limits, &Unattended, &mut file).unwrap();
        (report, file)
    };
    let one = written(1);
    for threads in [2, 3, 8] {
        assert!(written(threads) == one, "{threads} threads");
    }
}

/// The estimate of a mesh makes the surfaces of templates that the mesh needs, and the mesh makes none of them again.
#[test]
fn estimate_and_mesh_share_the_surfaces_of_templates() {
    for rounding in [0.0, 0.2] {
        let grains = packed(&CUBE, 30, [3.0, 2.0], 0.3, rounding);
        let request = MeshRequest::Stl(SurfaceOptions::default());
        let written = |model: &Model<'_>| {
            let mut file = Vec::new();
            request.write_or_resume(model, &Limits::default(), None, &Unattended, &mut file).unwrap();
            file
        };
        let (alone, surfaces) = (Model::new(&CUBE, &grains), SurfaceCache::default());
        let sharing = alone.with_surfaces(&surfaces);
        request.estimate(&Expected::Packed(&sharing)).unwrap();
        let made = surfaces.len();
        assert!(made >= grains.templates.len());
        assert!(written(&sharing) == written(&alone));
        assert!(surfaces.len() == made);
        // Other templates have their own.
        let others = packed(&CUBE, 30, [3.0, 2.0], 0.3, rounding + 0.1);
        let others = Model::new(&CUBE, &others);
        assert!(written(&others.with_surfaces(&surfaces)) == written(&others));
        assert!(surfaces.len() > made);
    }
}
