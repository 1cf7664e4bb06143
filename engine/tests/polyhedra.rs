//! Requests whose grains are polyhedra: packed, checked, and judged by axes of the test's own.

use nalgebra::Vector3;
use packstone_engine::distance::DistanceRule;
use packstone_engine::packing::GrainsRef;
use packstone_engine::request::{GrowthOptions, Method};
use packstone_engine::{Packing, PackingRequest};
use serde_json::{Value, json};

use crate::ellipsoids::{cube, packed, request};

/// Corners, and the directions that can part two sharp polyhedra, of a grain.
struct Features {
    corners: Vec<Vector3<f64>>,
    normals: Vec<Vector3<f64>>,
    edges: Vec<Vector3<f64>>,
    /// Centre and radius of a ball around all corners.
    ball: (Vector3<f64>, f64),
}

fn features(packing: &Packing) -> Vec<Features> {
    let grains = packing.grains.solids().expect("the grains are no polyhedra");
    let of = |grain: usize| {
        let (shape, pose) = (grains.shape(grain).polyhedron().unwrap(), &grains.poses[grain]);
        let corners: Vec<_> = shape.template.world_vertices_mm(shape.scale_mm, pose).collect();
        let at = |v: u32| corners[v as usize];
        let normal =
            |face: &Vec<u32>| (at(face[1]) - at(face[0])).cross(&(at(face[2]) - at(face[1]))).normalize();
        let edges = shape.template.edges();
        Features {
            normals: shape.template.faces().iter().map(normal).collect(),
            edges: edges.iter().map(|edge| (at(edge.ends[1]) - at(edge.ends[0])).normalize()).collect(),
            ball: (pose.center_mm, farthest(&corners, pose.center_mm)),
            corners,
        }
    };
    (0..grains.len()).map(of).collect()
}

fn farthest(corners: &[Vector3<f64>], from: Vector3<f64>) -> f64 {
    corners.iter().map(|corner| (corner - from).norm()).fold(0.0, f64::max)
}

/// Whether the line of centres, a face of one, or an edge of each parts two bodies, the second moved.
fn are_apart(a: &Features, b: &Features, moved: Vector3<f64>) -> bool {
    let parts = |n: &Vector3<f64>| {
        let range = |of: &Features| {
            let heights = of.corners.iter().map(|p| p.dot(n));
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
        };
        let ((a_low, a_high), (b_low, b_high)) = (range(a), range(b));
        let by = moved.dot(n);
        a_high <= b_low + by || b_high + by <= a_low
    };
    let between = b.ball.0 + moved - a.ball.0;
    between.norm() > a.ball.1 + b.ball.1
        || parts(&between)
        || a.normals.iter().chain(&b.normals).any(parts)
        || a.edges
            .iter()
            .any(|p| b.edges.iter().any(|q| p.cross(q).try_normalize(1e-9).is_some_and(|n| parts(&n))))
}

fn shapes() -> [Value; 3] {
    let ratios = json!({"type": "triangle", "k": 0.4});
    [
        json!({"type": "polyhedron", "faces": 12, "ratios": ratios}),
        json!({"type": "polyhedron", "template": "deformed_cuboid", "template_count": 8}),
        json!({"type": "mixture", "of": [
            {"share": 0.4, "shape": {"type": "polyhedron", "template": "voronoi", "template_count": 8}},
            {"share": 0.6, "shape": {"type": "polyhedron", "rounding": 0.1, "template_count": 8}}]}),
    ]
}

#[test]
fn packings_hold_in_all_specimens_and_under_all_rules() {
    let specimens = [
        cube(30.0, "walls"),
        cube(30.0, "periodic"),
        json!({"type": "cylinder", "diameter_mm": 30, "height_mm": 30}),
    ];
    let rules = [
        json!({"type": "none"}),
        json!({"type": "constant", "gap_mm": 0.4}),
        json!({"type": "proportional", "factor": 0.1}),
        json!({"type": "smaller_diameter", "factor": 0.1}),
    ];
    for (index, specimen) in specimens.iter().enumerate() {
        for rule in &rules {
            let mut request = request(specimen, 0.3, &shapes()[index], rule);
            for method in [
                Method::Rsa { attempts_per_grain: None },
                Method::MonteCarlo { options: GrowthOptions::default() },
            ] {
                request.method = method;
                let packing = packed(&request);
                let found = packing.report.check.min_gap_mm.unwrap();
                let distance = DistanceRule::new(&request.distance, &request.specimen);
                let finest = GrainsRef::from(&packing.grains).diameters_mm().fold(f64::INFINITY, f64::min);
                assert!(found >= distance.gap_mm(finest, finest), "{specimen} {rule} {found}");
                let bodies = features(&packing);
                let period =
                    if request.specimen.is_periodic() { [-30.0, 0.0, 30.0].as_slice() } else { &[0.0] };
                for i in 0..bodies.len() {
                    for j in 0..i {
                        for x in period {
                            for y in period {
                                for z in period {
                                    let moved = Vector3::new(*x, *y, *z);
                                    assert!(
                                        are_apart(&bodies[i], &bodies[j], moved),
                                        "{specimen} {rule} {i} {j}"
                                    );
                                }
                            }
                        }
                    }
                }
                let summary = &packing.report.summary;
                assert!((summary.volume_fraction_effective / 0.3 - 1.0).abs() < 0.05, "{summary:?}");
                let report = packing.report.shapes.unwrap();
                assert!(report.sphericity_mean > 0.6 && report.sphericity_mean < 1.0, "{report:?}");
            }
        }
    }
}

#[test]
fn a_seed_gives_one_packing_and_templates_do_not_depend_on_it() {
    let request = request(&cube(40.0, "walls"), 0.35, &shapes()[0], &json!({"type": "none"}));
    let (first, again) = (packed(&request), packed(&request));
    assert_eq!(first.grains, again.grains);
    let other = packed(&PackingRequest { seed: 8, ..request });
    assert_ne!(first.grains, other.grains);
    let templates = |packing: &Packing| packing.grains.solids().unwrap().templates.clone();
    assert_eq!(templates(&first), templates(&other));
}
