//! Lattices of ellipsoids and polyhedra.

use std::sync::Arc;

use crate::grain::PlacedGrains;
use crate::properties::properties;
use proptest::prelude::*;
use serde_json::json;

use super::super::nodes::lay;
use super::super::obstacles::beyond_mm;
use super::super::surface::Surface;
use super::super::tessellation::{Tet, edge_point, face_point};
use super::super::{BoundaryNodes, Lattice, LatticeOptions};
use super::{in_box, in_cylinder};
use crate::export::Model;
use crate::gap::ellipsoids::Body;
use crate::geometry::delaunay::delaunay;
use crate::packing::{Grains as Packed, Solids};
use crate::request::{PackingRequest, Specimen};
use crate::rng::uniform;
use crate::shape::{Ellipsoid, Pose};
use crate::{Limits, Unattended, pack};
use nalgebra::{UnitQuaternion, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

fn packed(specimen: &serde_json::Value) -> (Specimen, Solids) {
    let request = json!({
        "specimen": specimen,
        "mix": {
            "grading": {"type": "fuller", "d_max_mm": 10.0, "exponent": 0.5}, "d_min_mm": 3.0,
            "volume_fraction": 0.4,
            "shape": {"type": "ellipsoid", "ratios": {"type": "constant", "elongation": 0.7, "flatness": 0.6}},
        },
    });
    let request = PackingRequest::from_json(&request, 7).unwrap();
    match pack(&request, &Limits::default(), &Unattended).unwrap().grains {
        Packed::Solids(grains) => (request.specimen, grains),
        Packed::Spheres(_) => panic!("no ellipsoids"),
    }
}

fn specimens() -> [serde_json::Value; 2] {
    [
        json!({"type": "box", "size_mm": [40.0, 35.0, 30.0]}),
        json!({"type": "cylinder", "diameter_mm": 40.0, "height_mm": 30.0}),
    ]
}

/// A shape of equal semi-axes in every place of a sphere.
fn as_ellipsoids(spheres: &crate::packing::Spheres) -> Solids {
    let orientation = UnitQuaternion::from_euler_angles(0.3, 0.4, 0.5);
    Solids::of_ellipsoids(
        spheres.d_mm.iter().map(|d| Ellipsoid::new([d / 2.0; 3]).unwrap()).collect(),
        (0..spheres.len()).map(|i| Pose { center_mm: spheres.center(i).into(), orientation }).collect(),
    )
}

#[test]
fn ellipsoids_with_equal_axes_have_the_lattice_of_spheres() {
    for (specimen, spheres) in [in_box(), in_cylinder()] {
        let options = LatticeOptions::default();
        let ellipsoids = as_ellipsoids(&spheres);
        let models = [Model::new(&specimen, &spheres), Model::new(&specimen, &ellipsoids)];
        let [of_spheres, of_ellipsoids] =
            models.map(|model| Lattice::make(&model, &options, &Limits::default(), &Unattended).unwrap());
        let (one, other) = (of_spheres.report(), of_ellipsoids.report());
        assert_eq!(one.nodes.grains, other.nodes.grains);
        // Nodes on the surface are drawn again where a distance is rounded otherwise.
        let ratio = other.nodes.total as f64 / one.nodes.total as f64;
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
        assert!((one.volume_mm3 / other.volume_mm3 - 1.0).abs() < 1e-3);
        // The same points of edges and faces for the same nodes.
        let nodes = of_ellipsoids.nodes();
        let mut with_radii = nodes.clone();
        with_radii.grains = None;
        for &[a, b, c, d] in of_ellipsoids.tetrahedra() {
            let distance = (edge_point(nodes, a, b) - edge_point(&with_radii, a, b)).norm();
            assert!(distance < 1e-12, "{distance}");
            let distance = (face_point(nodes, [b, c, d]) - face_point(&with_radii, [b, c, d])).norm();
            assert!(distance < 1e-12, "{distance}");
        }
    }
}

/// The points of edges lie in the middle of the gap between the grains, measured along the edge.
#[test]
fn points_of_edges_are_as_far_from_both_grains() {
    for specimen in specimens() {
        let (specimen, grains) = packed(&specimen);
        let model = Model::new(&specimen, &grains);
        let lattice =
            Lattice::make(&model, &LatticeOptions::default(), &Limits::default(), &Unattended).unwrap();
        let checks = &lattice.report().checks;
        assert_eq!((checks.overlapping_grains, checks.grains_outside, checks.overlapping_edges), (0, 0, 0));
        assert_eq!(checks.crowded_nodes, 0);
        let nodes = lattice.nodes();
        let is_in = |node: u32, p: Vector3<f64>| {
            let grain = node as usize - nodes.boundary;
            let (shape, pose) = (&grains.shapes[grain], &grains.poses[grain]);
            let local = pose.rotation().transpose() * (p - pose.center_mm);
            local.component_div(&shape.ellipsoid().unwrap().semi_axes_mm()).norm() <= 1.0
        };
        // How far a grain reaches along a line, by halving.
        let reach = |node: u32, towards: Vector3<f64>| {
            let center = Vector3::from(nodes.points_mm[node as usize]);
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if is_in(node, center + middle * (towards - center)) { low = middle } else { high = middle }
            }
            low * (towards - center).norm()
        };
        let mut seen = 0;
        for tet in lattice.tetrahedra() {
            let [a, b] = [tet[0], tet[1]];
            if (a.min(b) as usize) < nodes.boundary {
                continue;
            }
            seen += 1;
            let [p, q] = [a, b].map(|node| Vector3::from(nodes.points_mm[node as usize]));
            let e = edge_point(nodes, a, b);
            let to_a = (e - p).norm() - reach(a, q);
            let to_b = (e - q).norm() - reach(b, p);
            assert!((to_a - to_b).abs() < 1e-9 && to_a >= 0.0, "{to_a} {to_b}");
        }
        assert!(seen > 100, "{seen}");
        assert!(delaunay(&nodes.points_mm, &Unattended).is_ok());
    }
}

/// Nodes on the surface keep their clearance from all ellipsoids.
#[test]
fn nodes_on_the_surface_keep_clear_of_ellipsoids() {
    for specimen in specimens() {
        let (specimen, grains) = packed(&specimen);
        for boundary_nodes in [BoundaryNodes::PoissonDisk, BoundaryNodes::Random] {
            let options = LatticeOptions { boundary_nodes, ..LatticeOptions::default() };
            let placed = Arc::new(PlacedGrains::new(&grains).unwrap());
            let nodes = lay(&specimen, &placed, &options, &Unattended).unwrap();
            let clear = options.fictitious_diameter * nodes.d_min_mm / 2.0;
            let vertices = Surface::of(&specimen).vertices.len();
            for &p in &nodes.points_mm[vertices..nodes.boundary] {
                let ball = Ellipsoid::new([clear; 3]).unwrap();
                let ball = Body::new(&ball, &Pose::at(p.into()));
                for (shape, pose) in grains.iter() {
                    let gap = Body::new(&shape.ellipsoid().unwrap(), pose).with(&ball).gap().gap_mm;
                    assert!(gap >= -1e-9 * clear, "{gap}");
                }
            }
        }
    }
}

properties! {
    /// Beyond the surface by the distance to the nearest of many of its points; inside, no more than that.
    #[test]
    fn distances_of_points_are_those_of_the_surface(
        axes in prop::array::uniform3(0.4..2.0_f64), angles in prop::array::uniform3(-3.0..3.0_f64),
        p in prop::array::uniform3(-3.0..3.0_f64),
    ) {
        let orientation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
        let pose = Pose { center_mm: Vector3::new(5.0, 5.0, 5.0), orientation };
        let shape = Ellipsoid::new(axes).unwrap();
        let ellipsoids = Solids::of_ellipsoids(vec![shape], vec![pose]);
        let grains = PlacedGrains::new(&ellipsoids).unwrap();
        let p = Vector3::from(p) + pose.center_mm;
        let found = beyond_mm(&grains, 0, p.into());
        let (mut nearest, steps) = (f64::INFINITY, 120_u32);
        for i in 0..steps {
            for j in 0..2 * steps {
                let (sin_t, cos_t) = (std::f64::consts::PI * f64::from(i) / f64::from(steps)).sin_cos();
                let (sin_f, cos_f) = (std::f64::consts::PI * f64::from(j) / f64::from(steps)).sin_cos();
                let unit = Vector3::new(sin_t * cos_f, sin_t * sin_f, cos_t);
                let on = pose.center_mm + pose.rotation() * unit.component_mul(&shape.semi_axes_mm());
                nearest = nearest.min((p - on).norm());
            }
        }
        let local = pose.rotation().transpose() * (p - pose.center_mm);
        if local.component_div(&shape.semi_axes_mm()).norm() > 1.0 {
            prop_assert!(found <= nearest + 1e-9 && found >= nearest - 0.05, "{found} {nearest}");
        } else {
            prop_assert!(found <= 1e-12 && -found <= nearest + 1e-9, "{found} {nearest}");
        }
    }
}

/// The same of polyhedra: reach, clearance and the checks of the lattice.
#[test]
fn lattices_of_polyhedra_pass_their_checks() {
    for (specimen, rounding) in specimens().into_iter().zip([0.0, 0.1]) {
        let specimen: Specimen = PackingRequest::from_json(
            &json!({"specimen": specimen, "mix": {"grading": {"type": "diameters", "diameters_mm": [5.0]}}}),
            1,
        )
        .unwrap()
        .specimen;
        let grains = crate::export::polyhedra_samples::packed(&specimen, 150, [7.0, 3.0], 0.2, rounding);
        let model = Model::new(&specimen, &grains);
        let lattice =
            Lattice::make(&model, &LatticeOptions::default(), &Limits::default(), &Unattended).unwrap();
        let checks = &lattice.report().checks;
        assert_eq!((checks.overlapping_grains, checks.grains_outside, checks.overlapping_edges), (0, 0, 0));
        assert_eq!(checks.crowded_nodes, 0);
        let nodes = lattice.nodes();
        let placed = PlacedGrains::new(&grains).unwrap();
        for grain in 0..grains.len() {
            let (shape, pose) = (grains.shape(grain).polyhedron().unwrap(), &grains.poses[grain]);
            let radius = shape.scale_mm * shape.template.rounding();
            for corner in shape.template.world_vertices_mm(shape.scale_mm, pose) {
                let along = corner - pose.center_mm;
                let reach = nodes.reach_mm(nodes.boundary + grain, &along);
                assert!(reach >= (along.norm() + radius) * (1.0 - 1e-12), "{reach} {along} {radius}");
                let end = pose.center_mm + along.normalize() * reach;
                assert!(beyond_mm(&placed, grain as u32, end.into()).abs() < 1e-9 * shape.scale_mm);
            }
        }
    }
}

/// Ellipsoids and polyhedra in one lattice.
#[test]
fn lattices_of_ellipsoids_and_polyhedra_pass_their_checks() {
    for specimen in [
        Specimen::Box { size_mm: [30.0, 28.0, 26.0], boundary: crate::request::Boundary::Walls },
        Specimen::Cylinder { diameter_mm: 30.0, height_mm: 26.0 },
    ] {
        let grains = crate::export::polyhedra_samples::mixed(&specimen, 100, [7.0, 3.0], 0.2, 0.05);
        let model = Model::new(&specimen, &grains);
        let lattice =
            Lattice::make(&model, &LatticeOptions::default(), &Limits::default(), &Unattended).unwrap();
        let checks = &lattice.report().checks;
        assert_eq!((checks.overlapping_grains, checks.grains_outside, checks.overlapping_edges), (0, 0, 0));
        assert_eq!(checks.crowded_nodes, 0);
        // Two grains in one place overlap, of whichever kind.
        let mut overlapping = grains.clone();
        let kind = |grain: usize| overlapping.shapes[grain].template().is_some();
        let [one, other] =
            [false, true].map(|of| (0..grains.len()).find(|&grain| kind(grain) == of).unwrap());
        overlapping.poses[other].center_mm = overlapping.poses[one].center_mm;
        let grains = PlacedGrains::new(&overlapping).unwrap();
        assert!(grains.overlap([one, other], 1e-6) && grains.overlap([other, one], 1e-6));
    }
}

/// Random points of all facets, each held against all grains.
#[test]
fn the_share_of_facets_in_grains_is_that_of_random_points() {
    let box_ = json!({"type": "box", "size_mm": [40.0, 35.0, 30.0]});
    let (specimen, ellipsoids) = packed(&box_);
    let (_, spheres) = in_box();
    let spheres = as_ellipsoids(&spheres);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    for grains in [&ellipsoids, &spheres] {
        let model = Model::new(&specimen, grains);
        let lattice =
            Lattice::make(&model, &LatticeOptions::default(), &Limits::default(), &Unattended).unwrap();
        let is_inside = |p: Vector3<f64>| {
            (0..grains.len()).any(|grain| {
                let pose = &grains.poses[grain];
                let local = pose.rotation().tr_mul(&(p - pose.center_mm));
                let axes = grains.shapes[grain].ellipsoid().unwrap().semi_axes_mm();
                local.component_div(&axes).norm_squared() < 1.0
            })
        };
        let (mut inside, mut all) = (0.0, 0.0);
        for tet in lattice.tetrahedra() {
            for facet in Tet::new(lattice.nodes(), *tet).facets() {
                let [a, b, c] = facet.vertices;
                let (mut s, mut t) = (uniform(&mut rng), uniform(&mut rng));
                if s + t > 1.0 {
                    (s, t) = (1.0 - s, 1.0 - t);
                }
                let area = (b - a).cross(&(c - a)).norm();
                inside += area * f64::from(u8::from(is_inside(a + (b - a) * s + (c - a) * t)));
                all += area;
            }
        }
        let (found, expected) = (lattice.report().facet_area_in_grains, inside / all);
        assert!(expected > 0.02 && (found - expected).abs() < 0.01, "{found}, {expected}");
    }
}
