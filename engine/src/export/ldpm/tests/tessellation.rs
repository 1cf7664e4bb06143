use crate::properties::properties;
use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;

use super::super::nodes::Nodes;
use super::super::tessellation::{Point, Tet, boundary_facets, point, triangle_area};
use crate::Unattended;
use crate::geometry::delaunay::delaunay;

fn nodes(points: &[[f64; 3]], radii: &[f64]) -> Nodes<'static> {
    Nodes { points_mm: points.to_vec(), radii_mm: radii.to_vec(), d_min_mm: 1.0, ..Nodes::default() }
}

fn assert_near(found: Point, expected: [f64; 3]) {
    assert!((found - point(expected)).norm() < 1e-9, "{found:?}, expected {expected:?}");
}

/// T14: the tetrahedron whose facets the workbench of Project Chrono wrote with ten digits; the radii are those that
/// reproduce all of them.
#[test]
fn the_reference_tetrahedron_has_the_reference_facets() {
    let corners = [[1.0, 0.0, 0.0], [2.0, 1.5, 3.0], [-1.0, 0.5, 0.0], [0.5, 2.0, 1.0]];
    let tet = Tet::new(&nodes(&corners, &[0.3, 0.45, 0.5, 0.6]), [0, 1, 2, 3]);
    assert_near(tet.middle, [0.665_594_755, 0.922_911_841_4, 1.015_951_51]);
    assert_near(tet.edges[0], [1.478_571_429, 0.717_857_142_9, 1.435_714_286]);
    let facet = tet.facet(0);
    assert!((facet.unsigned_volume() - 0.092_121_339_58).abs() < 1e-9);
    assert!((facet.projected_area().abs() - 0.078_961_148_21).abs() < 1e-9);
    assert_near(facet.vertices[2], [1.478_571_429, 0.717_857_142_9, 1.435_714_286]);
}

/// Equal radii and edges leave nothing but centroids.
#[test]
fn a_regular_tetrahedron_falls_into_24_equal_pieces() {
    let corners = [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]];
    for order in [[0, 1, 2, 3], [1, 0, 2, 3]] {
        let tet = Tet::new(&nodes(&corners, &[0.4; 4]), order);
        assert_near(tet.middle, [0.0; 3]);
        for facet in tet.facets() {
            for piece in facet.volumes {
                assert!((piece - tet.volume() / 24.0).abs() < 1e-15, "{piece}");
            }
        }
    }
}

fn tetrahedra() -> impl Strategy<Value = ([[f64; 3]; 4], [f64; 4])> {
    let coordinate = || -10.0..10.0_f64;
    let corner = move || [coordinate(), coordinate(), coordinate()];
    ([corner(), corner(), corner(), corner()], [0.0..2.0_f64, 0.0..2.0_f64, 0.0..2.0_f64, 0.0..2.0_f64])
}

properties! {
    /// T1, whatever the shape, the radii and the order of nodes.
    #[test]
    fn pieces_add_up((corners, radii) in tetrahedra(), order in Just([0_u32, 1, 2, 3]).prop_shuffle()) {
        let tet = Tet::new(&nodes(&corners, &radii), order);
        let longest = (0..6).map(|e| {
            let [i, j] = super::super::tessellation::EDGES[e];
            (tet.corners[i] - tet.corners[j]).norm()
        }).fold(0.0, f64::max);
        let pieces: f64 = tet.facets().map(|f| f.volumes[0] + f.volumes[1]).sum();
        prop_assert!((pieces - tet.volume()).abs() < 1e-13 * longest.powi(3));
    }

    /// Each facet's frame is orthonormal and right-handed, whatever the direction.
    #[test]
    fn frames_are_right_handed((corners, radii) in tetrahedra()) {
        for facet in Tet::new(&nodes(&corners, &radii), [0, 1, 2, 3]).facets() {
            let [q, s] = facet.tangents();
            prop_assert!((q.cross(&s) - facet.normal).norm() < 1e-14);
            prop_assert!((q.norm() - 1.0).abs() < 1e-14 && (s.norm() - 1.0).abs() < 1e-14);
        }
    }

    /// The six parts of a face have its area, and those of a node meet in it.
    #[test]
    fn parts_of_a_face_add_up((corners, radii) in tetrahedra()) {
        let nodes = nodes(&corners, &radii);
        let whole = triangle_area([0, 1, 2].map(|i| point(corners[i])));
        let parts = boundary_facets(&nodes, [0, 1, 2]);
        let sum: Point = parts.iter().map(|&(_, corners)| triangle_area(corners)).sum();
        prop_assert!((sum - whole).norm() < 1e-12 * (1.0 + whole.norm()));
        for (node, part) in parts {
            prop_assert_eq!(part[0], point(corners[node as usize]));
        }
    }
}

/// Projected areas and volumes of all facets, in order of size.
fn sorted_facets(points: &[[f64; 3]], radii: &[f64]) -> Vec<[f64; 2]> {
    let nodes = nodes(points, radii);
    let mut facets: Vec<[f64; 2]> = delaunay(points, &Unattended)
        .unwrap()
        .nodes
        .iter()
        .flat_map(|&tet| {
            let tet = Tet::new(&nodes, tet);
            tet.facets().map(|f| [f.projected_area(), f.volumes[0] + f.volumes[1]]).collect::<Vec<_>>()
        })
        .collect();
    facets.sort_by(|a, b| a[0].total_cmp(&b[0]));
    facets
}

/// T11.
#[test]
fn facets_stay_the_same_when_moved_and_renumbered_and_grow_with_scale() {
    let mut draw = {
        let mut state = 1_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        }
    };
    let points: Vec<[f64; 3]> = (0..200).map(|_| [10.0 * draw(), 10.0 * draw(), 10.0 * draw()]).collect();
    let radii: Vec<f64> = (0..200).map(|_| 0.3 * draw()).collect();
    let original = sorted_facets(&points, &radii);
    let same = |other: &[[f64; 2]], scale: f64| {
        assert_eq!(original.len(), other.len());
        for (a, b) in original.iter().zip(other) {
            assert!((a[0] * scale.powi(2) - b[0]).abs() < 1e-10 * scale.powi(2), "{a:?} {b:?}");
            assert!((a[1] * scale.powi(3) - b[1]).abs() < 1e-9 * scale.powi(3), "{a:?} {b:?}");
        }
    };
    let rotation = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
    let moved: Vec<[f64; 3]> =
        points.iter().map(|&p| (rotation * point(p) + Vector3::new(3.0, -5.0, 8.0)).into()).collect();
    same(&sorted_facets(&moved, &radii), 1.0);
    let reversed: Vec<[f64; 3]> = points.iter().rev().copied().collect();
    let reversed_radii: Vec<f64> = radii.iter().rev().copied().collect();
    same(&sorted_facets(&reversed, &reversed_radii), 1.0);
    let scaled: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| 2.5 * x)).collect();
    let scaled_radii: Vec<f64> = radii.iter().map(|r| 2.5 * r).collect();
    same(&sorted_facets(&scaled, &scaled_radii), 2.5);
}
