#![allow(clippy::unwrap_used)]

use std::collections::HashMap;
use std::f64::consts::PI;
use std::io::sink;

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::control::Unattended;
use crate::gap::linear::{cross, distance2, dot};
use crate::packing::Spheres;
use crate::request::decode::{At, Faults};
use crate::request::{Boundary, Specimen};

pub(super) const CUBE: Specimen = Specimen::Box { size_mm: [20.0, 16.0, 12.0], boundary: Boundary::Walls };
pub(super) const CYLINDER: Specimen = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 14.0 };

fn spheres(rows: &[([f64; 3], f64)]) -> Spheres {
    let mut spheres = Spheres::with_capacity(rows.len());
    for &(center, d) in rows {
        spheres.push(center, d);
    }
    spheres
}

/// Two grains that almost touch, one that almost touches a wall, and a small one beside a large one.
fn crowded() -> Spheres {
    spheres(&[
        ([5.0, 8.0, 6.0], 8.0),
        ([13.05, 8.0, 6.0], 8.0),
        ([9.0, 12.5, 6.0], 3.0),
        ([9.0, 4.0, 1.51], 3.0),
    ])
}

fn mesh(specimen: &Specimen, spheres: &Spheres, options: &SurfaceOptions) -> (Mesh, SurfaceReport) {
    Mesh::new(&Model::new(specimen, spheres), options, &Limits::default(), &Unattended).unwrap()
}

/// Every edge is met once in each direction, and vertices, edges and triangles make a sphere.
pub(super) fn assert_closed_sphere(points: usize, triangles: &[[u32; 3]]) {
    let mut edges: HashMap<(u32, u32), (u32, u32)> = HashMap::new();
    for corners in triangles {
        for edge in 0..3 {
            let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
            let met = edges.entry((a.min(b), a.max(b))).or_default();
            if a < b { met.0 += 1 } else { met.1 += 1 }
        }
    }
    assert!(
        edges.values().all(|met| *met == (1, 1)),
        "an edge is not that of two triangles that turn the same way"
    );
    assert_eq!(points + triangles.len(), edges.len() + 2, "not a sphere");
}

pub(super) fn smallest_angle(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> f64 {
    let mut least = f64::INFINITY;
    for corners in triangles {
        for k in 0..3 {
            let [a, b, c] = [0, 1, 2].map(|i| points[corners[(k + i) % 3] as usize]);
            let from_a = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] - a[i]);
            let (p, q) = (from_a(b), from_a(c));
            let normal = cross(p, q);
            least = least.min(dot(normal, normal).sqrt().atan2(dot(p, q)));
        }
    }
    least.to_degrees()
}

#[test]
fn spheres_have_about_the_segments_asked_for_and_their_vertices_on_the_sphere() {
    let mut met_before = 0;
    for segments in 6..=64 {
        let fineness = sphere::Finenesses::new().nearest(f64::from(segments));
        let sphere = fineness.polyhedron();
        assert_eq!(sphere.triangles.len() as u64, fineness.triangles());
        // In small steps: each of these once was that of 13 segments from 8 to 13.
        let off = (fineness.segments() / f64::from(segments) - 1.0).abs();
        assert!(off < if segments < 8 { 0.30 } else { 0.15 }, "{segments}: {}", fineness.segments());
        assert!(sphere.triangles.len() >= met_before);
        met_before = sphere.triangles.len();
        assert_closed_sphere(sphere.points.len(), &sphere.triangles);
        assert!(sphere.points.iter().all(|p| (dot(*p, *p) - 1.0).abs() < 1e-14));
        let (shortest, longest) = sphere.edges_mm();
        let edge = std::f64::consts::TAU / f64::from(segments);
        assert!(
            shortest > edge / 1.7 && longest < edge * 1.7,
            "{segments}: {shortest} to {longest} around {edge}"
        );
        assert!(sphere.volume_mm3() > 0.0, "inside out");
    }
}

#[test]
fn grains_are_closed_inscribed_and_turned_outwards() {
    let packing = crowded();
    for specimen in [CUBE, CYLINDER] {
        let options =
            SurfaceOptions { volume_correction: VolumeCorrection::None, ..SurfaceOptions::default() };
        let (mesh, report) = mesh(&specimen, &packing, &options);
        assert_eq!(mesh.grains(), packing.len());
        let mut volume = 0.0;
        for row in 0..mesh.grains() {
            let (points, triangles) = mesh.grain(row);
            assert_closed_sphere(points.len(), triangles);
            let (center, radius) = (packing.center(row), packing.d_mm[row] / 2.0);
            assert!(points.iter().all(|p| (distance2(*p, center).sqrt() - radius).abs() < 1e-12 * radius));
            for corners in triangles {
                let [a, b, c] = corners.map(|p| points[p as usize]);
                let from_center = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] - center[i]);
                volume += dot(from_center(a), cross(from_center(b), from_center(c))) / 6.0;
            }
            assert!(smallest_angle(points, triangles) > 20.0, "{}", smallest_angle(points, triangles));
        }
        assert!((volume / report.aggregate_volume_mm3 - 1.0).abs() < 1e-12);
        assert!((-0.08..-0.01).contains(&report.aggregate_volume_error), "{report:?}");
    }
}

#[test]
fn grains_are_convex_so_that_no_dent_is_left_to_the_mesher() {
    let (mesh, _) = mesh(&CUBE, &crowded(), &SurfaceOptions::default());
    for row in 0..mesh.grains() {
        let (points, triangles) = mesh.grain(row);
        for corners in triangles {
            let [a, b, c] = corners.map(|p| points[p as usize]);
            let from_a = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] - a[i]);
            let normal = cross(from_a(b), from_a(c));
            let above = points.iter().map(|p| dot(normal, from_a(*p))).fold(f64::NEG_INFINITY, f64::max);
            assert!(above < 1e-4, "a vertex lies {above} above a triangle");
        }
    }
}

#[test]
fn edges_get_shorter_towards_what_is_close_and_nowhere_else() {
    let packing = crowded();
    let length_at = |mesh: &Mesh, row: usize, p: [f64; 3]| {
        let (points, triangles) = mesh.grain(row);
        let near = triangles.iter().min_by(|s, t| {
            let apart =
                |corners: &[u32; 3]| corners.iter().map(|&c| distance2(points[c as usize], p)).sum::<f64>();
            apart(s).total_cmp(&apart(t))
        });
        let [a, b, _] = near.unwrap().map(|c| points[c as usize]);
        distance2(a, b).sqrt()
    };
    let (graded, _) = mesh(&CUBE, &packing, &SurfaceOptions::default());
    let (even, _) = mesh(&CUBE, &packing, &SurfaceOptions { size_field: false, ..SurfaceOptions::default() });
    // The two large grains are 0.05 mm apart; their far sides face nothing.
    for (row, toward, away) in
        [(0, [9.0, 8.0, 6.0], [5.0, 8.0, 10.0]), (1, [9.05, 8.0, 6.0], [13.05, 8.0, 10.0])]
    {
        assert!(length_at(&graded, row, toward) < 0.5 * length_at(&even, row, toward));
        assert!((length_at(&graded, row, away) / length_at(&even, row, away) - 1.0).abs() < 0.3);
    }
    // The specimen's face below the grain that almost touches it is finer than elsewhere.
    let on_floor = |mesh: &Mesh, x: f64, y: f64| {
        let surface = &mesh.shell.surface;
        let within = |p: [f64; 3]| p[2] == 0.0 && (p[0] - x).abs() < 1.0 && (p[1] - y).abs() < 1.0;
        surface.points.iter().filter(|p| within(**p)).count()
    };
    assert!(on_floor(&graded, 9.0, 4.0) > 3 * on_floor(&graded, 16.0, 13.0));
}

#[test]
fn shells_are_closed_and_their_faces_lie_where_they_should() {
    for (specimen, packing) in [(CUBE, crowded()), (CYLINDER, crowded()), (CUBE, Spheres::default())] {
        let (mesh, report) = mesh(&specimen, &packing, &SurfaceOptions::default());
        let shell = &mesh.shell;
        assert_closed_sphere(shell.surface.points.len(), &shell.surface.triangles);
        assert!(report.specimen_volume_error.abs() < 2e-3, "{report:?}");
        let bounds = specimen.bounds_mm();
        for corners in &shell.surface.triangles {
            let name = shell.names[shell.face_of(*corners)];
            for p in corners.map(|p| shell.surface.points[p as usize]) {
                let at = |axis: usize, x: f64| assert_eq!(p[axis], x, "{name}");
                match name {
                    "x_min" => at(0, 0.0),
                    "x_max" => at(0, bounds[0]),
                    "y_min" => at(1, 0.0),
                    "y_max" => at(1, bounds[1]),
                    "z_min" => at(2, 0.0),
                    "z_max" => at(2, bounds[2]),
                    "side" => assert!(((p[0] - 10.0).hypot(p[1] - 10.0) - 10.0).abs() < 0.05),
                    other => panic!("{other}"),
                }
            }
        }
        assert!(smallest_angle(&shell.surface.points, &shell.surface.triangles) > 20.0);
    }
}

#[test]
fn a_box_has_twelve_edges_and_a_cylinder_two_rims() {
    for (specimen, corners, curves) in [(CUBE, 8, 12), (CYLINDER, 2, 2)] {
        let (mesh, _) = mesh(&specimen, &crowded(), &SurfaceOptions::default());
        let outline = outline::Outline::new(&mesh.shell);
        assert_eq!((outline.corners.len(), outline.curves.len()), (corners, curves));
        for curve in &outline.curves {
            // One face turns with it, the other against it.
            assert_eq!(curve.forward.len(), 2);
            assert_ne!(curve.forward[0].1, curve.forward[1].1);
            assert_ne!(curve.forward[0].0, curve.forward[1].0);
        }
        let on_curves: usize = outline.curves.iter().map(|curve| curve.chain.len() - 2).sum();
        let within: usize = outline.within.iter().map(Vec::len).sum();
        assert_eq!(corners + on_curves + within, mesh.shell.surface.points.len());
    }
}

#[test]
fn the_facets_of_a_lateral_surface_cut_into_no_grain_that_touches_it() {
    let packing = spheres(&[([10.0 + 7.0, 10.0, 7.0], 6.0)]);
    for segments in [6, 16] {
        let options = SurfaceOptions::default().with_segments(segments);
        let (mesh, _) = mesh(&CYLINDER, &packing, &options);
        let surface = &mesh.shell.surface;
        for corners in surface.triangles.iter().filter(|corners| mesh.shell.face_of(**corners) == 0) {
            let [a, b, c] = corners.map(|p| surface.points[p as usize]);
            for (u, v) in
                (0..=10).flat_map(|i| (0..=10 - i).map(move |j| (f64::from(i) / 10.0, f64::from(j) / 10.0)))
            {
                let p = [0, 1].map(|i| a[i] + u * (b[i] - a[i]) + v * (c[i] - a[i]));
                let from_axis = (p[0] - 10.0).hypot(p[1] - 10.0);
                assert!(from_axis > 10.0 * (1.0 - 1e-14), "{from_axis}");
            }
        }
    }
}

#[test]
fn corrected_volumes_are_those_of_spheres_and_half_of_every_clearance_is_left() {
    let options = SurfaceOptions::default();
    let far = spheres(&[([5.0, 8.0, 6.0], 6.0), ([14.0, 8.0, 6.0], 6.0)]);
    let (_, report) = mesh(&CUBE, &far, &options);
    assert!(report.aggregate_volume_error.abs() < 1e-12 && report.grains_short_of_volume == 0, "{report:?}");
    // 0.02 mm apart: away from the contact there is room for what is lacking.
    let near = spheres(&[([5.0, 8.0, 6.0], 6.0), ([11.02, 8.0, 6.0], 6.0)]);
    let (mesh_of_near, report) = mesh(&CUBE, &near, &options);
    assert!(report.aggregate_volume_error.abs() < 1e-12 && report.grains_short_of_volume == 0, "{report:?}");
    let reach = |row: usize| {
        let toward = if row == 0 { 1.0 } else { -1.0 };
        let x = near.x_mm[row];
        mesh_of_near.grain(row).0.iter().map(|p| toward * (p[0] - x)).fold(0.0, f64::max)
    };
    assert!(reach(0) > 3.0 && reach(0) + reach(1) <= 6.01 + 1e-12, "{} {}", reach(0), reach(1));
    // Without a size field there is nothing fine near the contact, which holds large triangles back.
    let (_, report) = mesh(&CUBE, &near, &SurfaceOptions { size_field: false, ..options });
    assert!(report.aggregate_volume_error > -0.03, "{report:?}");
    assert_eq!(report.grains_short_of_volume, if report.aggregate_volume_error < -1e-9 { 2 } else { 0 });
}

/// The volume asked for is met whatever the gaps, and finer meshes have more triangles.
#[test]
fn packings_have_their_volume_and_more_segments_mean_more_triangles() {
    for gap_mm in [0.1, 0.4] {
        let request = serde_json::json!({
            "specimen": {"type": "box", "size_mm": [30, 30, 30]}, "distance": {"type": "constant", "gap_mm": gap_mm},
            "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.5},
        });
        let request = PackingRequest::from_json(&request, 1).unwrap();
        let packing = crate::pack(&request, &Limits::default(), &Unattended).unwrap();
        let mut before = 0;
        for segments in [8, 10, 12, 16, 20, 24] {
            let options = SurfaceOptions::default().with_segments(segments);
            let (_, report) = mesh(&request.specimen, packing.spheres().unwrap(), &options);
            assert!(report.aggregate_volume_error.abs() < 1e-3, "{segments}: {report:?}");
            assert!(report.triangles > before, "{segments}: {report:?} after {before}");
            before = report.triangles;
            let model = Model::new(&request.specimen, packing.spheres().unwrap());
            let (guess, ..) =
                estimate::of_model(&MeshModel::new(&model).unwrap(), &options, &Unattended).unwrap();
            let ratio = guess.triangles as f64 / report.triangles as f64;
            assert!(
                (1.0 / 1.5..1.5).contains(&ratio),
                "{gap_mm} {segments}: {} of {}",
                guess.triangles,
                report.triangles
            );
        }
    }
}

#[test]
fn the_same_model_is_the_same_bytes() {
    let packing = crowded();
    let bytes = |specimen: &Specimen| {
        let (mut msh, mut stl, mut geo) = (Vec::new(), Vec::new(), Vec::new());
        let model = Model::new(specimen, &packing);
        let limits = Limits::default();
        msh::write(&model, &SurfaceOptions::default(), &limits, &Unattended, &mut msh).unwrap();
        stl::write(&model, &SurfaceOptions::default(), &limits, &Unattended, &mut stl).unwrap();
        let options = geo::GeoOptions { segments: 24, ..geo::GeoOptions::default() };
        geo::write(&model, &options, &limits, &Unattended, &mut geo).unwrap();
        [msh, stl, geo]
    };
    assert_eq!(bytes(&CUBE), bytes(&CUBE));
    assert_eq!(bytes(&CYLINDER), bytes(&CYLINDER));
    assert_ne!(bytes(&CUBE), bytes(&CYLINDER));
}

/// Gmsh's triangles lack 14 / n² of the volume of spheres, and touching spheres leave no room to enlarge them.
#[test]
fn a_mesh_that_lacks_much_volume_is_refused_and_one_that_lacks_little_warns() {
    let packing = spheres(&[([5.0, 8.0, 6.0], 8.0), ([13.0, 8.0, 6.0], 8.0)]);
    let model = Model::new(&CUBE, &packing);
    let write = |segments: u32, volume_correction: VolumeCorrection| {
        let options = geo::GeoOptions { segments, volume_correction, ..geo::GeoOptions::default() };
        geo::write(&model, &options, &Limits::default(), &Unattended, &mut sink())
    };
    let refused = write(16, VolumeCorrection::Scaled).unwrap_err();
    assert!(matches!(refused, ExportError::Unavailable(_)));
    let text = refused.to_string();
    assert!(text.contains("lack 5.5 % of their volume, more than 2 %: the gaps around 2 grains"), "{text}");
    assert!(text.contains("segments=32, ") && text.contains("volume_correction=none"), "{text}");
    let report = write(32, VolumeCorrection::Scaled).unwrap();
    assert!((-0.015..-0.012).contains(&report.expected_volume_error), "{report:?}");
    let warning =
        "the meshed grains lack 1.4 % of their volume: the gaps around 2 grains leave no room for it";
    assert_eq!(MeshReport::Geo(report).warnings(), [warning]);
    assert!(write(64, VolumeCorrection::Scaled).unwrap().warnings.is_empty());
    let report = write(16, VolumeCorrection::None).unwrap();
    assert_eq!(report.warnings, ["the meshed grains lack 5.5 % of their volume"]);
}

#[test]
fn periodic_boxes_and_meshes_beyond_the_limit_say_what_to_do() {
    let periodic = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Periodic };
    let limits = Limits::default();
    let refused = check(&periodic).unwrap_err();
    assert!(refused.to_string().contains("walls, or ask for voxels"), "{refused}");
    let packing = crowded();
    let model = Model::new(&CUBE, &packing);
    for max_memory_bytes in [1_000, 30_000, 60_000] {
        let limits = Limits { max_memory_bytes, ..limits };
        let refused =
            msh::write(&model, &SurfaceOptions::default(), &limits, &Unattended, &mut sink()).unwrap_err();
        let ExportError::TooLarge(fault) = refused else { panic!("{refused}") };
        assert_eq!(fault.pointer, "/segments");
        assert!(fault.detail.contains("lower segments"), "{}", fault.detail);
    }
}

#[test]
fn a_run_that_should_stop_stops() {
    struct Stop;
    impl Control for Stop {
        fn report(&self, _: &Progress) {}
        fn should_stop(&self) -> bool {
            true
        }
    }
    let packing = crowded();
    let model = Model::new(&CUBE, &packing);
    let limits = Limits::default();
    let stopped = msh::write(&model, &SurfaceOptions::default(), &limits, &Stop, &mut sink());
    assert!(matches!(stopped, Err(ExportError::Stopped)));
    let stopped = geo::write(&model, &geo::GeoOptions::default(), &limits, &Stop, &mut sink());
    assert!(matches!(stopped, Err(ExportError::Stopped)));
}

fn read(value: &Value) -> (Option<SurfaceOptions>, Vec<String>) {
    let faults = Faults::default();
    let mut object = At::root(value, &faults).object().unwrap();
    let options = SurfaceOptions::read(&mut object);
    object.finish();
    (options, faults.into_vec().iter().map(ToString::to_string).collect())
}

#[test]
fn options_have_defaults_and_bounds() {
    assert_eq!(read(&json!({})), (Some(SurfaceOptions::default()), vec![]));
    let (options, _) = read(&json!({"segments": 100, "size_field": false, "volume_correction": "none"}));
    let expected = SurfaceOptions {
        size_field: false,
        volume_correction: VolumeCorrection::None,
        ..SurfaceOptions::default().with_segments(100)
    };
    assert_eq!(options, Some(expected));
    let (options, faults) =
        read(&json!({"size_mm": 0.5, "min_size_mm": 0.1, "max_size_mm": 2, "max_bytes": 7}));
    assert_eq!(faults, Vec::<String>::new());
    let options = options.unwrap();
    assert_eq!((options.segments, options.max_segments, options.size_mm), (None, None, Some(0.5)));
    assert_eq!(
        (options.edge_mm(16.0), options.edge_mm(0.4), options.floor_mm(16.0)),
        (0.5, PI * 0.4 / 6.0, 0.125)
    );
    let (options, faults) = read(&json!({"segments": 5, "volume_correction": "best", "size": 1}));
    assert_eq!(options, None);
    assert_eq!(
        faults,
        [
            "/segments: 5 is out of range: must be a whole number from 6 to 256",
            "/volume_correction: \"best\" is unknown: must be one of \"none\", \"scaled\"",
            "/size: unknown field: this object has segments, size_mm, min_size_mm, max_size_mm, size_field, \
             max_segments, volume_correction, faces, max_bytes",
        ]
    );
    let (_, faults) = read(&json!({"segments": 20, "max_segments": 10}));
    assert_eq!(faults, ["/max_segments: 10 is out of range: must be at least segments, which is 20"]);
    let (_, faults) =
        read(&json!({"segments": 20, "size_mm": 1, "max_segments": 40, "min_size_mm": 3, "max_size_mm": 2}));
    assert_eq!(
        faults,
        [
            "/size_mm: segments and size_mm say the same: leave one of them out",
            "/max_segments: max_segments goes with segments: with size_mm give min_size_mm instead",
            "/max_size_mm: 2 is out of range: must be at least min_size_mm, which is 3 mm",
        ]
    );
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever stands around a grain, its polyhedron is closed, inside its sphere and beside its
    /// neighbour's.
    #[test]
    fn polyhedra_of_disjoint_spheres_are_disjoint(
        gap in 1e-6..2.0_f64, d in 2.0..9.0_f64, turn in 0.0..6.3_f64, up in -1.5..1.5_f64, scaled in any::<bool>(),
    ) {
        let first = [20.0, 20.0, 20.0];
        let apart = 4.0 + d / 2.0 + gap;
        let direction = [up.cos() * turn.cos(), up.cos() * turn.sin(), up.sin()];
        let second = [0, 1, 2].map(|a| first[a] + apart * direction[a]);
        let packing = spheres(&[(first, 8.0), (second, d)]);
        let specimen = Specimen::Box { size_mm: [40.0; 3], boundary: Boundary::Walls };
        let volume_correction = if scaled { VolumeCorrection::Scaled } else { VolumeCorrection::None };
        let (mesh, _) = mesh(&specimen, &packing, &SurfaceOptions { volume_correction, ..SurfaceOptions::default() });
        for row in 0..2 {
            let (points, triangles) = mesh.grain(row);
            assert_closed_sphere(points.len(), triangles);
        }
        // A plane between them has either on its side.
        let along = |p: &[f64; 3]| [0, 1, 2].map(|a| (p[a] - first[a]) * direction[a]).iter().sum::<f64>();
        let highest = mesh.grain(0).0.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
        let lowest = mesh.grain(1).0.iter().map(along).fold(f64::INFINITY, f64::min);
        prop_assert!(highest + 0.4 * gap <= lowest, "{} {}", highest, lowest);
    }
}
