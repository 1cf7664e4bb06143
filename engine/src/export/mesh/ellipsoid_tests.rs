//! Surface meshes of ellipsoids.

#![allow(clippy::unwrap_used)]

use std::collections::HashMap;
use std::f64::consts::PI;
use std::num::NonZeroUsize;

use crate::properties::properties;
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

use super::tests::{CUBE, CYLINDER, assert_closed_sphere, smallest_angle};
use super::*;
use crate::distance::DistanceRule;
use crate::gap::ellipsoids::Body;
use crate::gap::linear::{self, dot, minus};
use crate::methods::rsa_shapes::{AttemptsIn, ShapeRsa};
use crate::mix::uniform_orientation;
use crate::packing::{Solids, Spheres};
use crate::request::{Boundary, Distance};
use crate::shape::{Ellipsoid, Pose};

type Row = ([f64; 3], [f64; 3], [f64; 3]);

/// Ellipsoids by centres, semi-axes and Euler angles.
fn ellipsoids(rows: &[Row]) -> Solids {
    let mut grains = Solids::default();
    for &(center, axes, [roll, pitch, yaw]) in rows {
        let orientation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        grains.shapes.push(Ellipsoid::new(axes).unwrap().into());
        grains.poses.push(Pose { center_mm: center.into(), orientation });
    }
    grains
}

/// Two that almost touch, one that almost touches the floor, and a small one beside a large one.
fn crowded() -> Solids {
    let mut grains = ellipsoids(&[
        ([5.0, 8.0, 6.0], [4.0, 3.0, 2.5], [0.4, 0.3, 0.2]),
        ([13.0, 8.0, 6.0], [4.0, 3.0, 2.0], [1.0, 0.6, -0.5]),
        ([9.0, 12.5, 6.5], [1.8, 1.4, 1.0], [0.1, 0.2, 0.9]),
        ([9.0, 4.0, 1.5], [2.0, 1.5, 1.2], [0.3, 0.2, 0.7]),
    ]);
    let bodies = |grains: &Solids| -> Vec<Body> {
        grains.iter().map(|(s, p)| Body::new(&s.ellipsoid().unwrap(), p)).collect()
    };
    // Moved along the shortest way until 0.05 mm are left.
    for _ in 0..20 {
        let all = bodies(&grains);
        let gap = all[0].with(&all[1]).gap();
        grains.poses[1].center_mm -= Vector3::from(gap.normal) * (gap.gap_mm - 0.05);
        let least = all[3].center_mm[2] - all[3].support_mm([0.0, 0.0, 1.0]);
        grains.poses[3].center_mm.z -= least - 0.02;
    }
    let all = bodies(&grains);
    assert!((all[0].with(&all[1]).gap().gap_mm - 0.05).abs() < 1e-9);
    for i in 0..4 {
        for j in i + 1..4 {
            assert!(all[i].with(&all[j]).gap().gap_mm > 0.04, "{i} {j}");
        }
        for specimen in [CUBE, CYLINDER] {
            assert!(all[i].wall_gap_mm(&specimen) > 0.01, "{i} {specimen:?}");
        }
    }
    grains
}

fn packed(specimen: &Specimen, gap_mm: f64) -> Solids {
    let shapes: Vec<Ellipsoid> = (0..70)
        .map(|i| {
            let d = 5.5 * 0.4_f64.powf(f64::from(i) / 69.0);
            Ellipsoid::new([0.75 * d, 0.5 * d, d / 3.0]).unwrap()
        })
        .collect();
    let rsa = ShapeRsa {
        shapes: &shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(&Distance::Constant { gap_mm, wall_gap_mm: None }, specimen),
        attempts_per_grain: Some(100_000),
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(3), &Unattended);
    assert_eq!(outcome.placed.len(), shapes.len());
    Solids::of_ellipsoids(shapes, outcome.placed)
}

fn mesh(specimen: &Specimen, grains: &Solids, options: &SurfaceOptions) -> (Mesh, SurfaceReport) {
    Mesh::new(&Model::new(specimen, grains), options, &Limits::default(), &Unattended).unwrap()
}

/// The value of the quadratic form of an ellipsoid: less than 1 inside.
fn quadratic((shape, pose): (&Ellipsoid, &Pose), p: [f64; 3]) -> f64 {
    let local = pose.rotation().tr_mul(&(Vector3::from(p) - pose.center_mm));
    local.component_div(&shape.semi_axes_mm()).norm_squared()
}

/// Polyhedra are closed, turned outwards and convex but for what the correction of the volume moves (of ellipsoids more
/// than 2.2 times as long as thick, dented only as [`assert_dents_are_wanted`] says), and keep clear of all other
/// ellipsoids and of the walls. The plane that parts a pair parts their polyhedra with half of the gap
/// between them.
fn assert_sound(specimen: &Specimen, grains: &Solids, mesh: &Mesh, report: &SurfaceReport) {
    let rows: Vec<(&Ellipsoid, &Pose)> =
        grains.shapes.iter().map(|shape| shape.ellipsoid().unwrap()).zip(&grains.poses).collect();
    let bodies: Vec<Body> = rows.iter().map(|(shape, pose)| Body::new(shape, pose)).collect();
    let mut sum = 0.0;
    for row in 0..grains.len() {
        let (points, triangles) = mesh.grain(row);
        assert_closed_sphere(points.len(), triangles);
        let center = bodies[row].center_mm;
        let from = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|a| p[a] - q[a]);
        let longest = bodies[row].outer_mm;
        // What the correction of the volume moves outwards, but for points that would come too close to another grain:
        // so much deeper may these lie than their neighbours.
        let outside = |p: &[f64; 3]| longest * (quadratic(rows[row], *p).sqrt() - 1.0);
        let outside_mm = points.iter().map(outside).fold(0.0, f64::max);
        let is_very_flat =
            rows[row].0.semi_axes_mm().max() > bodies::STRETCHED * rows[row].0.semi_axes_mm().min();
        if is_very_flat {
            assert_dents_are_wanted(points, triangles, outside_mm + 1e-9 * longest);
        }
        for corners in triangles {
            let [a, b, c] = corners.map(|p| points[p as usize]);
            let normal = linear::cross(from(b, a), from(c, a));
            sum += dot(from(a, center), normal) / 6.0;
            if is_very_flat {
                continue;
            }
            let above = points.iter().map(|p| dot(normal, from(*p, a))).fold(f64::NEG_INFINITY, f64::max);
            let height_mm = above / dot(normal, normal).sqrt();
            assert!(
                height_mm <= outside_mm + 1e-9 * longest,
                "{row}: a vertex lies {height_mm} mm above a triangle, {outside_mm}"
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
        for (other, theirs) in rows.iter().enumerate().filter(|(other, _)| *other != row) {
            assert!(points.iter().all(|p| quadratic(*theirs, *p) > 1.0), "{row} reaches into {other}");
            if row < other {
                let gap = bodies[row].with(&bodies[other]).gap();
                let along = |p: &[f64; 3]| dot(*p, gap.normal);
                let high = points.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
                let low = mesh.grain(other).0.iter().map(along).fold(f64::INFINITY, f64::min);
                assert!(high + 0.45 * gap.gap_mm <= low, "{row} {other}: {high} {low} {gap:?}");
            }
        }
    }
    assert!((sum / report.aggregate_volume_mm3 - 1.0).abs() < 1e-9, "{sum} {report:?}");
    assert_closed_sphere(mesh.shell.surface.points.len(), &mesh.shell.surface.triangles);
}

/// Triangles, and the corner of each that is not on an edge, by the edge in the direction of the triangle.
fn across(triangles: &[[u32; 3]]) -> HashMap<[u32; 2], u32> {
    let edges = |[a, b, c]: &[u32; 3]| [([*a, *b], *c), ([*b, *c], *a), ([*c, *a], *b)];
    triangles.iter().flat_map(edges).collect()
}

/// The surface is dented along an edge only where the other diagonal is far from Delaunay's.
fn assert_dents_are_wanted(points: &[[f64; 3]], triangles: &[[u32; 3]], rounding_mm: f64) {
    let beyond = across(triangles);
    for (&[a, b], &c) in &beyond {
        let placed = [a, b, c, beyond[&[b, a]]].map(|p| points[p as usize]);
        let [a, b, c, d] = placed;
        let normal = linear::cross(minus(b, a), minus(c, a));
        let height_mm = dot(normal, minus(d, a)) / dot(normal, normal).sqrt();
        let angles = curved::opposite_angles(placed);
        assert!(
            height_mm <= rounding_mm || angles.is_some_and(|angles| angles < PI - curved::CLEARLY + 1e-6),
            "{height_mm} mm, {angles:?}"
        );
    }
}

/// Of two triangles without a corner in common, whether an edge of one goes through the other.
fn cross(points: &[[f64; 3]], one: [u32; 3], other: [u32; 3]) -> bool {
    let at = |p: u32| points[p as usize];
    let volume = |[a, b, c, d]: [u32; 4]| {
        let [b, c, d] = [b, c, d].map(|p| minus(at(p), at(a)));
        dot(linear::cross(b, c), d)
    };
    let goes_through = |[a, b, c]: [u32; 3], p: u32, q: u32| {
        let sides = [volume([p, q, a, b]), volume([p, q, b, c]), volume([p, q, c, a])];
        volume([a, b, c, p]) * volume([a, b, c, q]) < 0.0
            && (sides.iter().all(|side| *side > 0.0) || sides.iter().all(|side| *side < 0.0))
    };
    let edges = |[a, b, c]: [u32; 3]| [(a, b), (b, c), (c, a)];
    edges(one).into_iter().any(|(p, q)| goes_through(other, p, q))
        || edges(other).into_iter().any(|(p, q)| goes_through(one, p, q))
}

/// Gmsh left hundreds of flat tetrahedra in ellipsoids with a preset's distribution: inside of edges that are far from
/// Delaunay's, and stretched triangles made HXT abort. The surface does not cross itself.
#[test]
fn long_and_flat_ellipsoids_have_triangles_that_are_nearly_equilateral() {
    for axes in [[6.0, 3.2, 1.4], [6.0, 5.0, 1.5], [6.0, 2.0, 1.9], [6.0, 4.0, 0.6]] {
        for (segments, size_field) in [(8, true), (16, true), (16, false), (32, true)] {
            // One that is near, so that there are short and long edges.
            let grains = ellipsoids(&[
                ([8.0, 8.0, 8.0], axes, [0.4, 0.3, 0.2]),
                ([8.0, 8.0, 3.0], [1.0, 1.0, 1.0], [0.0; 3]),
            ]);
            let options = SurfaceOptions { size_field, ..SurfaceOptions::default() }.with_segments(segments);
            let (mesh, _) = mesh(&CUBE, &grains, &options);
            let (points, triangles) = mesh.grain(0);
            assert_closed_sphere(points.len(), triangles);
            let beyond = across(triangles);
            let far = beyond.iter().filter(|&(&[a, b], &c)| {
                let placed = [a, b, c, beyond[&[b, a]]].map(|p| points[p as usize]);
                curved::opposite_angles(placed).is_some_and(|angles| angles > PI + curved::CLEARLY + 1e-6)
            });
            let (far, edges) = (far.count(), beyond.len());
            assert!(20 * far <= edges, "{axes:?} {segments}: {far} of {edges}");
            // Twice the inscribed over the circumscribed radius: 1 of an equilateral triangle.
            let shape = |corners: &[u32; 3]| {
                let [a, b, c] = corners.map(|p| points[p as usize]);
                let [p, q, r] = [minus(a, b), minus(b, c), minus(c, a)].map(|side| dot(side, side).sqrt());
                (q + r - p) * (r + p - q) * (p + q - r) / (p * q * r)
            };
            let mean = triangles.iter().map(shape).sum::<f64>() / triangles.len() as f64;
            println!("{axes:?} {segments} {size_field}: shape {mean}, {far} of {edges}");
            assert!(mean > 0.55, "{axes:?} {segments}: {mean}");
            for (i, one) in triangles.iter().enumerate() {
                for other in &triangles[..i] {
                    let are_apart = one.iter().all(|p| !other.contains(p));
                    assert!(!are_apart || !cross(points, *one, *other), "{axes:?} {segments}");
                }
            }
        }
    }
}

#[test]
fn ellipsoids_are_closed_and_apart_whatever_is_close() {
    let grains = crowded();
    for specimen in [CUBE, CYLINDER] {
        for volume_correction in [VolumeCorrection::None, VolumeCorrection::Scaled] {
            for size_field in [false, true] {
                let options = SurfaceOptions { size_field, volume_correction, ..SurfaceOptions::default() };
                let (mesh, report) = mesh(&specimen, &grains, &options);
                assert_sound(&specimen, &grains, &mesh, &report);
                if volume_correction == VolumeCorrection::None {
                    assert!((-0.08..-0.01).contains(&report.aggregate_volume_error), "{report:?}");
                    let on = |row: usize| mesh.grain(row).0.iter().map(move |p| (row, p));
                    for (row, p) in (0..grains.len()).flat_map(on) {
                        let value =
                            quadratic((grains.shapes[row].ellipsoid().unwrap(), &grains.poses[row]), *p);
                        assert!((value - 1.0).abs() < 1e-12, "{value}");
                    }
                } else if size_field {
                    assert!(report.aggregate_volume_error.abs() < 1e-3, "{report:?}");
                }
            }
        }
    }
}

/// The closed form `4/3 pi a b c`, grain by grain, and the estimate made before.
#[test]
fn ellipsoids_have_their_volume_and_the_triangles_estimated() {
    let cube = Specimen::Box { size_mm: [25.0, 22.0, 20.0], boundary: Boundary::Walls };
    let cylinder = Specimen::Cylinder { diameter_mm: 24.0, height_mm: 25.0 };
    for (specimen, gap_mm) in [(cube, 0.4), (cylinder, 0.1), (cube, 0.02)] {
        let grains = packed(&specimen, gap_mm);
        for options in [
            SurfaceOptions::default(),
            SurfaceOptions::default().with_segments(10),
            SurfaceOptions::default().with_segments(24),
            SurfaceOptions { size_field: false, ..SurfaceOptions::default() },
            SurfaceOptions {
                size_mm: Some(0.8),
                segments: None,
                max_segments: None,
                ..SurfaceOptions::default()
            },
        ] {
            let model = Model::new(&specimen, &grains);
            let (guess, ..) =
                estimate::of_model(&MeshModel::new(&model).unwrap(), &options, &Unattended).unwrap();
            let (mesh, report) = mesh(&specimen, &grains, &options);
            let ratio = guess.triangles as f64 / report.triangles as f64;
            println!("{gap_mm} {options:?}: {ratio} {}", report.triangles);
            assert!(
                (1.0 / 1.5..1.5).contains(&ratio),
                "{gap_mm} {options:?}: {ratio} of {}",
                report.triangles
            );
            let mut met = 0.0;
            for row in 0..grains.len() {
                let (points, triangles) = mesh.grain(row);
                let center = mesh_center(points);
                let six: f64 = triangles
                    .iter()
                    .map(|corners| {
                        let [a, b, c] = corners.map(|p| [0, 1, 2].map(|i| points[p as usize][i] - center[i]));
                        dot(a, linear::cross(b, c))
                    })
                    .sum();
                let [a, b, c] = grains.shapes[row].ellipsoid().unwrap().semi_axes_mm().into();
                let exact = 4.0 / 3.0 * PI * a * b * c;
                met += f64::from(u8::from((six / 6.0 / exact - 1.0).abs() < 1e-9));
                if options.size_field {
                    assert!((six / 6.0 / exact - 1.0).abs() < 1e-3, "{row}: {} of {exact}", six / 6.0);
                }
            }
            let short = grains.len() as f64 - report.grains_short_of_volume as f64;
            assert!((met - short).abs() < 0.5, "{met} {short}");
            assert!(smallest_angle(&mesh.shell.surface.points, &mesh.shell.surface.triangles) > 20.0);
            assert_sound(&specimen, &grains, &mesh, &report);
        }
    }
}

fn mesh_center(points: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|a| points.iter().map(|p| p[a]).sum::<f64>() / points.len() as f64)
}

/// Faces of the specimen and grains get finer where they face an ellipsoid, and nowhere else.
#[test]
fn edges_get_shorter_towards_ellipsoids() {
    let grains = crowded();
    let (graded, _) = mesh(&CUBE, &grains, &SurfaceOptions::default());
    let (even, _) = mesh(&CUBE, &grains, &SurfaceOptions { size_field: false, ..SurfaceOptions::default() });
    assert!(graded.grain(0).1.len() as f64 > 1.2 * even.grain(0).1.len() as f64);
    let on_floor = |mesh: &Mesh, x: f64, y: f64| {
        let within = |p: [f64; 3]| p[2] == 0.0 && (p[0] - x).abs() < 1.0 && (p[1] - y).abs() < 1.0;
        mesh.shell.surface.points.iter().filter(|p| within(**p)).count()
    };
    assert!(on_floor(&graded, 9.0, 4.0) > 3 * on_floor(&graded, 17.0, 2.0));
}

/// Ellipsoids with equal semi-axes have as many triangles as spheres where nothing is close, and their volume.
#[test]
fn equal_semi_axes_make_the_mesh_of_a_sphere() {
    let options = SurfaceOptions { size_field: false, ..SurfaceOptions::default() };
    let grains = ellipsoids(&[([5.0, 8.0, 6.0], [3.0; 3], [0.0; 3])]);
    let mut spheres = Spheres::default();
    spheres.push([5.0, 8.0, 6.0], 6.0);
    let (of_ellipsoid, _) = mesh(&CUBE, &grains, &options);
    let (of_sphere, _) =
        Mesh::new(&Model::new(&CUBE, &spheres), &options, &Limits::default(), &Unattended).unwrap();
    assert_eq!(of_ellipsoid.grain(0).1, of_sphere.grain(0).1);
    for (p, q) in of_ellipsoid.grain(0).0.iter().zip(of_sphere.grain(0).0) {
        assert!(linear::distance2(*p, *q).sqrt() < 1e-12);
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Two ellipsoids at any small gap.
    #[test]
    fn polyhedra_of_disjoint_ellipsoids_are_disjoint(
        gap_mm in 1e-6..1.0_f64, axes in prop::array::uniform3(1.5..4.5_f64),
        others in prop::array::uniform3(1.0..4.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
        turn in 0.0..6.3_f64, up in -1.5..1.5_f64, scaled in any::<bool>(),
    ) {
        let first = [20.0; 3];
        let direction = Vector3::new(up.cos() * turn.cos(), up.cos() * turn.sin(), up.sin());
        let second = Vector3::from(first) + direction * 10.0;
        let mut grains = ellipsoids(&[(first, axes, angles), (second.into(), others, [turn, up, 0.3])]);
        for _ in 0..50 {
            let gap = Body::new(grains.shapes[0].ellipsoid().unwrap(), &grains.poses[0])
                .with(&Body::new(grains.shapes[1].ellipsoid().unwrap(), &grains.poses[1]))
                .gap();
            grains.poses[1].center_mm -= Vector3::from(gap.normal) * (gap.gap_mm - gap_mm);
        }
        let specimen = Specimen::Box { size_mm: [40.0; 3], boundary: Boundary::Walls };
        let volume_correction = if scaled { VolumeCorrection::Scaled } else { VolumeCorrection::None };
        let (mesh, report) =
            mesh(&specimen, &grains, &SurfaceOptions { volume_correction, ..SurfaceOptions::default() });
        assert_sound(&specimen, &grains, &mesh, &report);
        prop_assert!(!scaled || report.aggregate_volume_error.abs() < 1e-3, "{:?}", report);
    }
}

/// The maps of a script, by rows.
fn maps(script: &str) -> Vec<[f64; 12]> {
    let numbers = |line: &str| {
        let inner = line.strip_prefix("Affine {")?.split('}').next()?;
        let found: Vec<f64> = inner.split(", ").map(|x| x.parse().unwrap()).collect();
        Some(found.try_into().unwrap())
    };
    script.lines().filter_map(numbers).collect()
}

#[test]
fn the_script_of_solids_enlarges_ellipsoids_as_far_as_gaps_allow() {
    let grains = crowded();
    let model = Model::new(&CUBE, &grains);
    let write = |volume_correction| {
        let options = geo::GeoOptions { segments: 24, volume_correction, ..geo::GeoOptions::default() };
        let mut script = Vec::new();
        let report = geo::write(&model, &options, &Limits::default(), &Unattended, &mut script).unwrap();
        (String::from_utf8(script).unwrap(), report)
    };
    let (script, report) = write(VolumeCorrection::None);
    assert_eq!(report.grains_short_of_volume, 0);
    assert!((-0.035..-0.012).contains(&report.expected_volume_error), "{report:?}");
    let determinant = |map: &[f64; 12]| nalgebra::Matrix3::from_fn(|i, k| map[4 * i + k]).determinant();
    let exact = maps(&script);
    assert_eq!(exact.len(), grains.len());
    for (map, (shape, pose)) in exact.iter().zip(grains.iter()) {
        assert!((determinant(map) * 4.0 / 3.0 * PI / shape.volume_mm3() - 1.0).abs() < 1e-12);
        assert_eq!([map[3], map[7], map[11]], <[f64; 3]>::from(pose.center_mm));
    }
    let (script, report) = write(VolumeCorrection::Scaled);
    let factors: Vec<f64> =
        maps(&script).iter().zip(&exact).map(|(p, q)| libm::cbrt(determinant(p) / determinant(q))).collect();
    assert!(factors.iter().all(|factor| (1.0..1.03).contains(factor)), "{factors:?}");
    // Three of them lie close to another or to the floor.
    assert_eq!(report.grains_short_of_volume, 3);
    assert!((-0.02..-0.003).contains(&report.expected_volume_error), "{report:?}");
    let enlarged = |row: usize| {
        let shape = grains.shapes[row].ellipsoid().unwrap();
        let axes: [f64; 3] = (shape.semi_axes_mm() * factors[row]).into();
        Body::new(&Ellipsoid::new(axes).unwrap(), &grains.poses[row])
    };
    let gap = enlarged(0).with(&enlarged(1)).gap().gap_mm;
    assert!((0.024..0.026).contains(&gap), "{gap}");
    let least = grains.poses[3].center_mm.z - enlarged(3).support_mm([0.0, 0.0, 1.0]);
    assert!((0.014..0.016).contains(&least), "{least}");
}
