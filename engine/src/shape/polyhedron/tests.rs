//! Closed forms of cuboid and tetrahedron, refusals, random templates.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion};

use super::*;
use crate::rng::{Stream, stream};
use crate::shape::Form;

fn close(found: f64, known: f64, tolerance: f64) {
    assert!((found - known).abs() < tolerance * known.abs().max(1.0), "{found} for {known}");
}

fn cuboid(edges: [f64; 3]) -> Polyhedron {
    let corner = |i: usize| Vector3::from_fn(|axis, _| if i >> axis & 1 == 1 { edges[axis] } else { 0.0 });
    Polyhedron::hull_of(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
}

/// Euler's formula, planar and convex faces, closed surface, centroid at the origin.
fn assert_sound(body: &Polyhedron) {
    let edges = body.edges();
    assert_eq!(body.vertices().len() + body.faces().len(), edges.len() + 2);
    assert_eq!(body.faces().iter().map(Vec::len).sum::<usize>(), 2 * edges.len());
    let size = body.length();
    for (index, face) in body.faces().iter().enumerate() {
        let (normal, offset) = body.plane(index);
        assert!(offset > 0.0);
        for vertex in body.vertices() {
            assert!(vertex.dot(&normal) < offset + 1e-7 * size);
        }
        for &vertex in face {
            assert!((body.vertices()[vertex as usize].dot(&normal) - offset).abs() < 1e-7 * size);
        }
    }
    assert!(
        (0..body.faces().len()).map(|face| body.double_area(face)).sum::<Vector3<f64>>().norm()
            < 1e-9 * size * size
    );
    let moment: Vector3<f64> =
        body.triangles().map(|[p, q, r]| p.dot(&q.cross(&r)) / 24.0 * (p + q + r)).sum();
    assert!(moment.norm() < 1e-9 * size.powi(4), "{moment}");
}

#[test]
fn roundness_is_the_rounding_over_the_inscribed_radius() {
    let core = cuboid([3.0, 2.0, 1.0]);
    assert_eq!(core.roundness(), 0.0);
    for r in [0.05, 0.3, 5.0] {
        let body = Polyhedron::of_parts(core.vertices.clone(), core.faces.clone(), r);
        close(body.inscribed_radius(), 0.5 + r, 1e-12);
        close(body.roundness(), r / (0.5 + r), 1e-12);
    }
    // Half of a cube along its diagonals: the largest sphere is not about the centroid.
    let corners = [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()];
    let body = Polyhedron::hull_of(&corners).unwrap();
    close(body.inscribed_radius(), 1.0 / (3.0 + 3_f64.sqrt()), 1e-12);
    assert!(body.inner_radius() < body.inscribed_radius() - 0.01);
}

#[test]
fn a_cuboid_is_a_parallelepiped_and_other_bodies_of_six_faces_are_not() {
    let body = cuboid([3.0, 2.0, 1.0]);
    let shear = |v: &Vector3<f64>| Vector3::new(v.x + 0.4 * v.y, v.y, v.z - 0.2 * v.x);
    let sheared: Vec<Vector3<f64>> = body.vertices().iter().map(shear).collect();
    assert!(body.is_parallelepiped() && Polyhedron::hull_of(&sheared).unwrap().is_parallelepiped());
    let frustum = |v: &Vector3<f64>| Vector3::new(v.x * (2.0 + v.z), v.y * (2.0 + v.z), v.z);
    let cut: Vec<Vector3<f64>> = body.vertices().iter().map(frustum).collect();
    let cut = Polyhedron::hull_of(&cut).unwrap();
    assert!(cut.faces().len() == 6 && !cut.is_parallelepiped());
    assert!(!samples::octahedron(1.0).is_parallelepiped());
}

#[test]
fn a_cuboid_has_its_closed_forms() {
    let [a, b, c] = [3.0, 2.0, 1.0];
    let body = cuboid([a, b, c]);
    assert_sound(&body);
    assert_eq!((body.vertices().len(), body.faces().len(), body.edges().len()), (8, 6, 12));
    close(body.volume(), a * b * c, 1e-14);
    close(body.surface(), 2.0 * (a * b + a * c + b * c), 1e-14);
    close(body.mean_curvature(), PI * (a + b + c), 1e-14);
    let r = 0.3;
    let rounded = a * b * c + 22.0 * r + PI * (a + b + c) * r * r + 4.0 / 3.0 * PI * r.powi(3);
    close(Polyhedron::of_parts(body.vertices.clone(), body.faces.clone(), r).volume(), rounded, 1e-14);
    let surface = 22.0 + 2.0 * PI * (a + b + c) * r + 4.0 * PI * r * r;
    close(Polyhedron::of_parts(body.vertices.clone(), body.faces.clone(), r).surface(), surface, 1e-14);
    let inertia = Matrix3::from_diagonal(&Vector3::new(b * b + c * c, a * a + c * c, a * a + b * b))
        * (a * b * c / 12.0);
    assert!((body.core_inertia() - inertia).norm() < 1e-12);
    close(body.length(), 14.0_f64.sqrt(), 1e-14);
    close(body.thickness(), c, 1e-14);
    close(body.support(&Vector3::x()), 1.5, 1e-14);
}

#[test]
fn a_tetrahedron_has_its_closed_forms() {
    let points =
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vector3::from);
    let body = Polyhedron::hull_of(&points).unwrap();
    assert_sound(&body);
    let edge = 8.0_f64.sqrt();
    close(body.volume(), edge.powi(3) / 72.0_f64.sqrt(), 1e-14);
    close(body.surface(), edge * edge * 3.0_f64.sqrt(), 1e-14);
    close(body.mean_curvature(), 3.0 * edge * (PI - (1.0_f64 / 3.0).acos()), 1e-14);
    assert!((body.core_inertia() - Matrix3::identity() * body.volume() * edge * edge / 20.0).norm() < 1e-12);
    // Across two opposite edges.
    close(body.thickness(), 2.0, 1e-14);
    // The same body as four half-spaces.
    let planes = points.map(|point| (-point.normalize(), 1.0 / 3.0_f64.sqrt()));
    let cut = Polyhedron::of_half_spaces(&planes).unwrap();
    assert_sound(&cut);
    close(cut.volume(), body.volume(), 1e-13);
}

#[test]
fn the_sieve_size_of_a_cuboid_is_that_of_its_smallest_face() {
    // Upright, or turned by 45 degrees where that needs less.
    for [b, c] in [[1.0, 1.0], [1.0, 0.8], [1.0, 0.5], [1.0, 0.3], [1.0, 0.1_f64]] {
        let known = f64::min(b, (b + c) / 2.0_f64.sqrt());
        close(cuboid([3.0, b, c]).sieve_size(), known, 1e-5);
    }
    close(cuboid([1.0; 3]).sieve_size(), 1.0, 1e-5);
}

#[test]
fn points_in_a_plane_and_open_bodies_are_refused() {
    assert_eq!(Polyhedron::hull_of(&[]), None);
    let flat: Vec<Vector3<f64>> = (0..8).map(|i| Vector3::new(f64::from(i), f64::from(i * i), 0.0)).collect();
    assert_eq!(Polyhedron::hull_of(&flat), None);
    assert_eq!(Polyhedron::hull_of(&[Vector3::repeat(f64::NAN); 4]), None);
    let open = [Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::x(), -Vector3::y()].map(|n| (n, 1.0));
    assert_eq!(Polyhedron::of_half_spaces(&open), None);
    assert_eq!(Polyhedron::of_half_spaces(&open[..2]), None);
    assert_eq!(cuboid([1.0; 3]).stretched(Vector3::new(1.0, 0.0, 1.0)), None);
}

#[test]
fn templates_are_sound_and_the_same_for_the_same_seed() {
    let form = Form::of_axes([1.5, 1.2, 1.0]);
    for kind in [
        TemplateKind::Cuts(6),
        TemplateKind::Cuts(21),
        TemplateKind::Cuts(60),
        TemplateKind::Cuboid(0.15),
        TemplateKind::Voronoi,
    ] {
        let mut rng = stream(3, Stream::Shape);
        let mut again = stream(3, Stream::Shape);
        for _ in 0..5 {
            let body = draw_template(kind, form, &mut rng).unwrap();
            assert_sound(&body);
            assert_eq!(Some(&body), draw_template(kind, form, &mut again).as_ref());
            let thickness = body.thickness();
            let sieve = body.sieve_size();
            assert!(thickness <= sieve && sieve <= body.length(), "{kind:?}: {thickness} {sieve}");
        }
    }
    let mut rng = stream(3, Stream::Shape);
    assert_eq!(draw_template(TemplateKind::Cuts(3), form, &mut rng), None);
    assert_eq!(draw_template(TemplateKind::Cuboid(0.5), form, &mut rng), None);
}

#[test]
fn platonic_solids_have_their_faces_volumes_and_sieve_sizes() {
    // Faces, corners, edges, and the volume of the solid of edge 1 (Euclid, book XIII).
    let root = 5.0_f64.sqrt();
    let known = [
        (4, 4, 6, 1.0 / (6.0 * 2.0_f64.sqrt())),
        (6, 8, 12, 1.0),
        (8, 6, 12, 2.0_f64.sqrt() / 3.0),
        (12, 20, 30, (15.0 + 7.0 * root) / 4.0),
        (20, 12, 30, 5.0 * (3.0 + root) / 12.0),
    ];
    for (solid, (faces, corners, edges, volume)) in PlatonicSolid::ALL.into_iter().zip(known) {
        let body = draw_template(TemplateKind::Platonic(solid), Form::SPHERE, &mut stream(1, Stream::Shape))
            .unwrap();
        assert_sound(&body);
        let found = body.edges();
        assert_eq!(
            (body.faces().len(), body.vertices().len(), found.len()),
            (faces, corners, edges),
            "{solid:?}"
        );
        let lengths = found.iter().map(|edge| {
            let [p, q] = edge.ends.map(|end| body.vertices()[end as usize]);
            (p - q).norm()
        });
        let lengths: Vec<f64> = lengths.collect();
        for length in &lengths {
            close(*length, lengths[0], 1e-12);
        }
        close(body.volume() / lengths[0].powi(3), volume, 1e-12);
        close(body.form().elongation, 1.0, 1e-9);
        close(body.form().flatness, 1.0, 1e-9);
        // A cube passes an opening of its own size, a tetrahedron one of its edge over the root of two, across the
        // axis through the middles of two edges that do not meet.
        match solid {
            PlatonicSolid::Cube => close(body.sieve_size() / lengths[0], 1.0, 1e-6),
            PlatonicSolid::Tetrahedron => close(body.sieve_size() / lengths[0], 0.5_f64.sqrt(), 1e-6),
            _ => assert!(body.sieve_size() >= body.thickness()),
        }
    }
}

#[test]
fn no_template_is_a_needle() {
    let mut rng = stream(11, Stream::Shape);
    for kind in
        [TemplateKind::Cuts(6), TemplateKind::Cuts(8), TemplateKind::Cuboid(0.4), TemplateKind::Voronoi]
    {
        for _ in 0..50 {
            let body = draw_template(kind, Form::SPHERE, &mut rng).unwrap();
            assert_sound(&body);
            assert!(body.length() / body.thickness() <= 4.0, "{kind:?}");
        }
    }
}

#[test]
fn the_form_is_that_of_the_ellipsoid_of_equal_inertia() {
    let form = cuboid([3.0, 1.0, 2.0]).form();
    close(form.elongation, 2.0 / 3.0, 1e-12);
    close(form.flatness, 0.5, 1e-12);
    let turn = UnitQuaternion::new_normalize(Quaternion::new(0.3, 0.5, -0.2, 0.7)).to_rotation_matrix();
    let corners: Vec<_> = cuboid([3.0, 1.0, 2.0]).vertices.iter().map(|vertex| turn * vertex).collect();
    let turned = Polyhedron::hull_of(&corners).unwrap();
    let axes = turned.principal_axes();
    close(axes.determinant(), 1.0, 1e-12);
    for (i, known) in [Vector3::x(), Vector3::z(), Vector3::y()].into_iter().enumerate() {
        close(axes.column(i).dot(&(turn * known)).abs(), 1.0, 1e-12);
    }
    let upright = turned.on_principal_axes();
    assert_sound(&upright);
    for (axis, width) in [(Vector3::x(), 3.0), (Vector3::y(), 2.0), (Vector3::z(), 1.0)] {
        close(upright.width(&axis), width, 1e-12);
    }
    // Stretched templates have the form on average.
    let form = Form::of_axes([2.0, 1.4, 1.0]);
    let mut rng = stream(13, Stream::Shape);
    let n = 40;
    let forms: Vec<Form> =
        (0..n).map(|_| draw_template(TemplateKind::Cuts(24), form, &mut rng).unwrap().form()).collect();
    let mean = |of: &dyn Fn(&Form) -> f64| forms.iter().map(of).sum::<f64>() / f64::from(n);
    close(mean(&|f| f.elongation), form.elongation, 0.02);
    close(mean(&|f| f.flatness), form.flatness, 0.02);
}

#[test]
fn voronoi_cells_have_their_mean_volume_and_number_of_faces() {
    // Poisson-Voronoi: the volume per seed and 15.535 faces on average (Meijering 1953).
    let mut rng = stream(5, Stream::Shape);
    let n = 60;
    let (mut volume, mut faces) = (0.0, 0.0);
    for _ in 0..n {
        let cell = draw_template(TemplateKind::Voronoi, Form::SPHERE, &mut rng).unwrap();
        volume += cell.volume() / (4.0 / 3.0 * PI) / f64::from(n);
        faces += cell.faces().len() as f64 / f64::from(n);
    }
    // Standard deviations 0.42 and 3.3 of one cell.
    assert!((volume - 1.0).abs() < 0.2 && (faces - 15.535).abs() < 1.5, "{volume} {faces}");
}

#[test]
fn cuts_have_the_ratio_of_diameters_that_was_measured() {
    // 21 cuts, stretched 1.5:1.2:1: 1.074 +- 0.026 for one template.
    let form = Form::of_axes([1.5, 1.2, 1.0]);
    let mut rng = stream(7, Stream::Shape);
    let n = 20;
    let mean: f64 = (0..n)
        .map(|_| draw_template(TemplateKind::Cuts(21), form, &mut rng).unwrap())
        .map(|body| body.equivalent_diameter() / body.sieve_size() / f64::from(n))
        .sum();
    assert!((mean - 1.074).abs() < 0.03, "{mean}");
}

#[test]
fn a_rounded_body_keeps_its_volume_and_has_the_radius_that_was_named() {
    let body = cuboid([3.0, 2.0, 1.0]);
    for share in [0.0, 1e-3, 0.05, 0.3, 0.45] {
        let rounded = body.with_relative_rounding(share).unwrap();
        close(rounded.volume(), 6.0, 1e-12);
        close(rounded.rounding() / rounded.equivalent_diameter(), share, 1e-12);
        close(rounded.normalized().equivalent_diameter(), 1.0, 1e-14);
    }
    assert_eq!(body.with_relative_rounding(0.5), None);
    assert_eq!(body.with_relative_rounding(-0.1), None);
    let nearly_a_sphere = body.with_relative_rounding(0.4999).unwrap().normalized();
    close(nearly_a_sphere.surface(), PI, 1e-4);
}

#[test]
fn open_inverted_and_dented_surfaces_are_refused() {
    let cube = samples::cuboid([1.0; 3], 0.0);
    let (vertices, faces) = (cube.vertices().to_vec(), cube.faces().to_vec());
    let new = |v: &[Vector3<f64>], f: &[Vec<u32>]| Polyhedron::new(v.to_vec(), f.to_vec(), 0.0);
    assert!(matches!(new(&vertices, &faces[1..]), Err(PolyhedronFault::Edge { .. })));
    let inverted: Vec<Vec<u32>> = faces.iter().map(|f| f.iter().rev().copied().collect()).collect();
    assert!(matches!(new(&vertices, &inverted), Err(PolyhedronFault::NotConvex { .. })));
    let mut dented = vertices.clone();
    dented[7] = Vector3::new(0.5, 0.5, 0.5);
    assert!(matches!(new(&dented, &faces), Err(PolyhedronFault::NotConvex { .. })));
    dented[7].x = f64::NAN;
    assert_eq!(new(&dented, &faces), Err(PolyhedronFault::NotANumber));
    let mut wrong = faces.clone();
    wrong[2][1] = 8;
    assert_eq!(new(&vertices, &wrong), Err(PolyhedronFault::Face { face: 2 }));
}

#[test]
fn world_vertices_are_turned_scaled_and_moved() {
    let q = UnitQuaternion::new_unchecked(Quaternion::new(0.3, 0.1, -0.7, 0.2));
    let pose = Pose { center_mm: Vector3::new(5.0, 6.0, 7.0), orientation: q };
    let cube = samples::cuboid([1.0, 2.0, 3.0], 0.0);
    let turned = UnitQuaternion::new_normalize(*q.quaternion());
    for (w, v) in cube.world_vertices_mm(2.5, &pose).zip(cube.vertices()) {
        assert!((w - (pose.center_mm + turned * (v * 2.5))).norm() < 1e-14);
    }
}
