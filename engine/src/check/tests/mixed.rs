#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use nalgebra::Vector3;
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};

use super::{SIZE, of_pairs};
use crate::Unattended;
use crate::check::*;
use crate::gap::solids;
use crate::request::PackingRequest;
use crate::rng::draws::{between, direction, orientation};
use crate::rng::{Stream, stream, uniform};
use crate::shape::polyhedron::samples::cuboid;
use crate::shape::polyhedron::{TemplateKind, draw_template};
use crate::shape::{Ellipsoid, Pose, SizeMeasure, SolidRef};
use crate::shape::{Form, Polyhedron, ScaledPolyhedron};

type Rng = Xoshiro256PlusPlus;
type V = Vector3<f64>;

fn templates(rng: &mut Rng) -> Vec<Polyhedron> {
    let kinds =
        [TemplateKind::Cuts(16), TemplateKind::Cuboid(0.2), TemplateKind::Cuboid(0.0), TemplateKind::Voronoi];
    let drawn = kinds.into_iter().flat_map(|kind| {
        let form = Form { elongation: between(rng, 0.5, 1.0), flatness: between(rng, 0.5, 1.0) };
        let body = draw_template(kind, form, rng).unwrap();
        [0.0, 0.08].map(|rounding| body.with_relative_rounding(rounding).unwrap().normalized())
    });
    drawn.collect()
}

fn shape<'a>(rng: &mut Rng, templates: &'a [Polyhedron], d_mm: f64) -> SolidRef<'a> {
    if uniform(rng) < 0.5 {
        let [b, c] = [(); 2].map(|()| between(rng, 0.3, 1.0));
        let form = Form { elongation: b, flatness: c };
        return Ellipsoid::with_equivalent_diameter(d_mm, form).unwrap().into();
    }
    let template = &templates[(uniform(rng) * templates.len() as f64) as usize];
    ScaledPolyhedron { template, scale_mm: d_mm }.into()
}

fn request(boundary: &str, gap_mm: f64, shapes: &[SolidRef<'_>]) -> PackingRequest {
    let diameters: Vec<f64> = shapes.iter().map(SolidRef::equivalent_diameter_mm).collect();
    let distance: Value = json!({"type": "constant", "gap_mm": gap_mm, "wall_gap_mm": 0});
    super::request(&json!({"type": "box", "size_mm": SIZE, "boundary": boundary}), &distance, &diameters)
}

fn checked(boundary: &str, gap_mm: f64, shapes: &[SolidRef<'_>], poses: &[Pose]) -> Result<Check, Fault> {
    let request = request(boundary, gap_mm, shapes);
    check_shapes(shapes, poses, &request, SizeMeasure::Equivalent, &Unattended)
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    /// A grain that keeps its gap to one of the other kind is accepted and one that lies a billionth of its size closer
    /// is refused, in either order, through the boundary of a periodic box, and for gaps from 0.
    #[test]
    fn a_grain_in_one_of_the_other_kind_is_refused(
        seed in 0_u64..1 << 40, gap_kind in 0..3_u32, is_first in any::<bool>(), across in any::<bool>(),
    ) {
        let rng = &mut stream(seed, Stream::Shape);
        let gap = [0.0, 0.05, 1.5][gap_kind as usize];
        let templates = templates(rng);
        let template = &templates[(uniform(rng) * templates.len() as f64) as usize];
        let [b, c] = [(); 2].map(|()| between(rng, 0.5, 1.0));
        let d_mm = between(rng, 2.0, 3.5);
        let ellipsoid = Ellipsoid::with_equivalent_diameter(d_mm, Form { elongation: b, flatness: c }).unwrap();
        let scale_mm = d_mm * between(rng, 0.4, 1.2);
        let polyhedron = ScaledPolyhedron { template, scale_mm };
        let boundary = if across { "periodic" } else { "walls" };
        let middle = if across { V::new(0.1, 0.2, 0.1) } else { V::from(SIZE) / 2.0 };
        let mut poses = [Pose { center_mm: middle, orientation: orientation(rng) },
            Pose { center_mm: middle, orientation: orientation(rng) }];
        let mut shapes = [SolidRef::from(ellipsoid), polyhedron.into()];
        let way = direction(rng);
        // Along the normal of the gap until the gap is the requested one.
        poses[1].center_mm += way * (ellipsoid.semi_axes_mm().x + scale_mm * template.outer_radius() + gap + 0.2);
        let mut normal = way;
        for _ in 0..60 {
            let [one, other] = [0, 1].map(|i| solids::Body::new(shapes[i], &poses[i]));
            let contact = one.contact(&other);
            normal = contact.normal;
            poses[1].center_mm -= normal * (contact.gap_mm - gap);
        }
        // Gaps along the normal are exact to some units of rounding, but for nearly flat triangles of the search: the
        // tests of the gap itself have the same bound and say why.
        let size = ellipsoid.semi_axes_mm().x + scale_mm * template.outer_radius();
        let moved = |poses: &[Pose; 2], by: f64| {
            let mut poses = *poses;
            poses[1].center_mm += normal * by;
            for pose in &mut poses {
                if across {
                    pose.center_mm = pose.center_mm.zip_map(&V::from(SIZE), f64::rem_euclid);
                }
            }
            if is_first { poses } else { [poses[1], poses[0]] }
        };
        if !is_first {
            shapes.swap(0, 1);
        }
        let apart = checked(boundary, gap, &shapes, &moved(&poses, 2e-13 * 40.0));
        prop_assert!(apart.is_ok(), "{apart:?}");
        let found = apart.unwrap().found;
        prop_assert!((found.min_gap_mm.unwrap() - gap).abs() < 1e-9 * size, "{:?}", found);
        let closer = checked(boundary, gap, &shapes, &moved(&poses, -1e-9 * size));
        prop_assert!(matches!(closer, Err(Fault::Pair { .. })), "{:?}", closer);
        let inside = checked(boundary, gap, &shapes, &moved(&poses, -gap - 0.1 * size));
        prop_assert!(matches!(inside, Err(Fault::Pair { .. })), "{:?}", inside);
    }
}

/// A ball that touches the face of a cube keeps a gap of 0; one that lies deeper by units of rounding does not.
#[test]
fn bodies_that_touch_exactly_keep_a_gap_of_zero() {
    let cube = cuboid([2.0, 2.0, 2.0], 0.0).normalized();
    let half = cube.vertices()[7].x.abs();
    let shapes = [
        Ellipsoid::new([1.5, 1.5, 1.5]).unwrap().into(),
        ScaledPolyhedron { template: &cube, scale_mm: 4.0 }.into(),
    ];
    let edge = 4.0 * half;
    let at = |x: f64| [Pose::at(V::new(10.0, 10.0, 10.0)), Pose::at(V::new(x, 10.25, 9.5))];
    // The corners are those of the stored numbers.
    let mut x = 10.0 + 1.5 + edge;
    let least = |x: f64| cube.world_vertices_mm(4.0, &at(x)[1]).map(|v| v.x).fold(f64::INFINITY, f64::min);
    while least(x) < 11.5 {
        x = x.next_up();
    }
    while least(x) > 11.5 {
        x = x.next_down();
    }
    assert_eq!(least(x), 11.5);
    assert!(checked("walls", 0.0, &shapes, &at(x)).is_ok());
    let closer = at(x - 1e-14);
    assert!(cube.world_vertices_mm(4.0, &closer[1]).any(|v| v.x < 11.5));
    assert!(matches!(checked("walls", 0.0, &shapes, &closer), Err(Fault::Pair { .. })));
}

/// In crowds of both kinds the check accepts what the gaps of the packing methods allow, and its certificates hold.
#[test]
fn certificates_show_the_gaps_of_both_kinds() {
    for boundary in ["walls", "periodic"] {
        let rng = &mut stream(5, Stream::Shape);
        let templates = templates(rng);
        let (mut shapes, mut poses): (Vec<SolidRef<'_>>, Vec<Pose>) = (Vec::new(), Vec::new());
        for _ in 0..500 {
            let d_mm = between(rng, 2.0, 4.0);
            shapes.push(shape(rng, &templates, d_mm));
            let center_mm = V::from(SIZE.map(|l| l * uniform(rng)));
            poses.push(Pose { center_mm, orientation: orientation(rng) });
            if checked(boundary, 0.3, &shapes, &poses).is_err() {
                shapes.pop();
                poses.pop();
            }
        }
        let request = request(boundary, 0.3, &shapes);
        let list = of_pairs(certify_shapes(&shapes, &poses, &request, 1.5, &Unattended).unwrap());
        let bodies: Vec<_> =
            shapes.iter().zip(&poses).map(|(shape, pose)| solids::Body::new(*shape, pose)).collect();
        let is_mixed = |c: &&SeparationCertificate| {
            shapes[c.first].ellipsoid().is_some() != shapes[c.second.unwrap()].ellipsoid().is_some()
        };
        assert!(list.iter().filter(is_mixed).count() > 20, "{}", list.len());
        for c in &list {
            let n = V::from(c.normal).normalize();
            let shift = V::from_fn(|k, _| f64::from(c.image[k]) * SIZE[k]);
            let second = c.second.unwrap();
            let moved = Pose { center_mm: poses[second].center_mm + shift, ..poses[second] };
            let contact = bodies[c.first].contact(&solids::Body::new(shapes[second], &moved));
            assert!((contact.gap_mm - c.separation_mm).abs() < 1e-9, "{c:?} {contact:?}");
            assert!((contact.normal - n).norm() < 1e-3, "{c:?} {contact:?}");
        }
        let least = list.iter().map(|c| c.separation_mm).fold(f64::INFINITY, f64::min);
        let found = checked(boundary, 0.3, &shapes, &poses).unwrap().found;
        assert!((found.min_gap_mm.unwrap() - least).abs() < 1e-12);
        if boundary == "walls" {
            let closer = |i: usize| (0..i).filter(|&j| bodies[i].contact(&bodies[j]).gap_mm < 1.5).count();
            assert_eq!((0..bodies.len()).map(closer).sum::<usize>(), list.len());
        }
    }
}

/// Sizes of polyhedra are known to 2e-9, those of ellipsoids exactly, in one packing.
#[test]
fn a_size_is_as_exact_as_its_kind() {
    let cube = cuboid([1.0, 1.0, 1.0], 0.0).normalized();
    let ball = |d: f64| SolidRef::from(Ellipsoid::sphere(d).unwrap());
    let angular =
        |size: f64| SolidRef::from(ScaledPolyhedron { template: &cube, scale_mm: size / cube.sieve_size() });
    let poses = [Pose::at(V::new(8.0, 8.0, 8.0)), Pose::at(V::new(20.0, 20.0, 20.0))];
    let value = json!({"specimen": {"type": "box", "size_mm": SIZE},
        "mix": {"grading": {"type": "diameters", "diameters_mm": [5, 4]}}});
    let request = PackingRequest::from_json(&value, 1).unwrap();
    let judged =
        |shapes: [SolidRef<'_>; 2]| check_shapes(&shapes, &poses, &request, SizeMeasure::Sieve, &Unattended);
    assert!(judged([ball(5.0), angular(4.0)]).is_ok());
    assert!(judged([angular(5.0 * (1.0 + 1e-9)), ball(4.0)]).is_ok());
    assert!(matches!(judged([ball(5.0 * (1.0 - 1e-9)), angular(4.0)]), Err(Fault::Grading(_))));
    assert!(matches!(judged([ball(5.0), angular(4.0 * (1.0 + 1e-8))]), Err(Fault::Grading(_))));
}
