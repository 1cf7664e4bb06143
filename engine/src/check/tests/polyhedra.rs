#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;

use crate::check::region::SpecimenRegion;
use crate::properties::properties;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::Value;

use super::{SIZE, of_pairs, request, rule, specimen};
use crate::Unattended;
use crate::check::body::Polyhedron as Checked;
use crate::check::required::Required;
use crate::check::*;
use crate::gap::polyhedra::Body;
use crate::request::PackingRequest;
use crate::rng::draws::{between, direction};
use crate::rng::{Stream, stream, uniform};
use crate::shape::polyhedron::SievePassage;
use crate::shape::polyhedron::samples::{cuboid, hull, octahedron};
use crate::shape::{Polyhedron, ScaledPolyhedron};
use crate::shape::{Pose, SizeMeasure};

type Rng = Xoshiro256PlusPlus;
type V = Vector3<f64>;

/// A quaternion whose norm is not 1.
fn orientation(rng: &mut Rng) -> UnitQuaternion<f64> {
    let coords = direction(rng).push(between(rng, -1.0, 1.0)) * between(rng, 0.5, 2.0);
    UnitQuaternion::new_unchecked(Quaternion::from(coords))
}

fn template(rng: &mut Rng, n: usize, stretch: f64, rounding: f64) -> Polyhedron {
    let points: Vec<V> =
        (0..n).map(|_| direction(rng).component_mul(&V::new(stretch, 1.0, 1.0 / stretch))).collect();
    let mean = points.iter().sum::<V>() / n as f64;
    let points: Vec<V> = points.iter().map(|point| point - mean).collect();
    hull(&points, rounding).unwrap_or_else(|| template(rng, n, stretch, rounding))
}

#[derive(Clone)]
struct Grain {
    template: Polyhedron,
    scale: f64,
    pose: Pose,
}

impl Grain {
    fn random(rng: &mut Rng, center_mm: V, scale: f64, rounding: f64) -> Self {
        let points = 5 + (uniform(rng) * 14.0) as usize;
        let stretch = between(rng, 1.0, 1.6);
        let template = template(rng, points, stretch, rounding);
        Self { template, scale, pose: Pose { center_mm, orientation: orientation(rng) } }
    }

    fn shape(&self) -> ScaledPolyhedron<'_> {
        ScaledPolyhedron { template: &self.template, scale_mm: self.scale }
    }

    fn body(&self) -> Body<'_> {
        Body::new(&self.template, self.scale, &self.pose)
    }

    fn equivalent_diameter(&self) -> f64 {
        self.template.equivalent_diameter() * self.scale
    }

    fn vertices(&self) -> Vec<V> {
        self.template.world_vertices_mm(self.scale, &self.pose).collect()
    }

    fn corners(&self, face: usize) -> Vec<V> {
        let vertices = self.vertices();
        self.template.faces()[face].iter().map(|&v| vertices[v as usize]).collect()
    }
}

fn request_for(specimen: &Value, distance: &Value, grains: &[Grain]) -> PackingRequest {
    let diameters: Vec<f64> = grains.iter().map(Grain::equivalent_diameter).collect();
    request(specimen, distance, &diameters)
}

fn checked(grains: &[Grain], request: &PackingRequest) -> Result<Check, Fault> {
    let shapes: Vec<_> = grains.iter().map(|grain| grain.shape().into()).collect();
    let poses: Vec<_> = grains.iter().map(|grain| grain.pose).collect();
    check_shapes(&shapes, &poses, request, SizeMeasure::Equivalent, &Unattended)
}

fn gap_of(grains: &[Grain], request: &PackingRequest) -> f64 {
    let required = Required::new(request.distance, SpecimenRegion::new(&request.specimen));
    required.gap_mm(grains[0].equivalent_diameter(), grains[1].equivalent_diameter())
}

/// Moves the second of two grains so that it meets the first at a gap, and returns the normal there: a corner above the
/// inside of a face, two edges that cross, or, for gaps above 0, whatever was nearest.
fn bring_together(rng: &mut Rng, grains: &mut [Grain], gap: f64, kind: u64) -> Option<V> {
    let radii =
        (grains[0].scale * grains[0].template.rounding()) + grains[1].scale * grains[1].template.rounding();
    let (n, from, to) = match kind % 3 {
        0 => {
            let face = (uniform(rng) * grains[0].template.faces().len() as f64) as usize;
            let corners = grains[0].corners(face);
            let n = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
            let vertices = grains[1].vertices();
            let lowest = vertices.into_iter().min_by(|p, q| p.dot(&n).total_cmp(&q.dot(&n))).unwrap();
            (n, (corners[0] + corners[1] + corners[2]) / 3.0, lowest)
        }
        1 => {
            let edges: Vec<Vec<[V; 2]>> = grains[..2]
                .iter()
                .map(|grain| {
                    let vertices = grain.vertices();
                    grain
                        .template
                        .edges()
                        .iter()
                        .map(|edge| edge.ends.map(|v| vertices[v as usize]))
                        .collect()
                })
                .collect();
            let [of_a, of_b] = [grains[0].vertices(), grains[1].vertices()];
            let mut found = None;
            for _ in 0..3000 {
                let pick = |rng: &mut Rng, of: &[[V; 2]]| of[(uniform(rng) * of.len() as f64) as usize];
                let (p, q) = (pick(rng, &edges[0]), pick(rng, &edges[1]));
                let n = (p[1] - p[0]).cross(&(q[1] - q[0])).normalize();
                for n in [n, -n] {
                    let is_top = of_a.iter().all(|v| v.dot(&n) <= p[0].dot(&n) + 1e-12);
                    let is_bottom = of_b.iter().all(|v| v.dot(&n) >= q[0].dot(&n) - 1e-12);
                    if is_top && is_bottom {
                        found = Some((n, (p[0] + p[1]) / 2.0, (q[0] + q[1]) / 2.0));
                    }
                }
                if found.is_some() {
                    break;
                }
            }
            found?
        }
        _ => {
            grains[1].pose.center_mm = grains[0].pose.center_mm + direction(rng) * 12.0;
            let (a, b) = (grains[0].body(), grains[1].body());
            let contact = a.with(&b).contact();
            grains[1].pose.center_mm -= contact.normal * (contact.gap_mm - gap);
            return (gap + radii > 0.0).then_some(contact.normal);
        }
    };
    grains[1].pose.center_mm += from + n * (gap + radii) - to;
    Some(n)
}

#[test]
fn polyhedra_pushed_into_another_by_a_billionth_of_their_size_are_refused() {
    let mut rng = stream(21, Stream::Sampling);
    // Making templates costs more than the check. Those of odd numbers are rounded.
    let templates: Vec<Polyhedron> = (0..40)
        .map(|i| template(&mut rng, 5 + i / 2, 1.0 + 0.015 * i as f64, if i % 2 == 0 { 0.0 } else { 0.05 }))
        .collect();
    let mut cases = 0;
    for case in 0..12_000_u64 {
        let (specimen, distance) = (specimen(case), rule(case / 3));
        let is_periodic = case % 3 == 1;
        let center = V::from(SIZE.map(|l| l * if is_periodic { uniform(&mut rng) } else { 0.5 }));
        let mut grains: Vec<Grain> = (0..2)
            .map(|_| {
                let template =
                    templates[2 * (uniform(&mut rng) * 20.0) as usize + usize::from(case % 2 == 1)].clone();
                let pose = Pose { center_mm: center, orientation: orientation(&mut rng) };
                Grain { template, scale: between(&mut rng, 1.0, 2.5), pose }
            })
            .collect();
        let request = request_for(&specimen, &distance, &grains);
        let gap = gap_of(&grains, &request);
        let Some(n) = bring_together(&mut rng, &mut grains, gap, case / 12) else { continue };
        cases += 1;
        let touching = grains[1].pose.center_mm;
        let step = n * grains[0].equivalent_diameter().min(grains[1].equivalent_diameter());
        for (share, is_valid) in [(1.0e-11, true), (-1.0e-9, false)] {
            let moved = touching + step * share;
            grains[1].pose.center_mm =
                if is_periodic { V::from_fn(|k, _| moved[k].rem_euclid(SIZE[k])) } else { moved };
            let verdict = checked(&grains, &request);
            match verdict {
                Ok(check) => {
                    assert!(is_valid, "case {case}: {check:?}");
                    let excess = check.found.min_excess_gap_mm.unwrap();
                    assert!(excess < 1.0e-10, "case {case}: {excess}");
                }
                Err(Fault::Pair { first: 0, second: 1, .. }) => {
                    assert!(!is_valid, "case {case}: {verdict:?}");
                }
                Err(other) => panic!("case {case}: {other}"),
            }
        }
    }
    assert!(cases >= 10_000, "{cases}");
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(1000))]
    /// The check and the search find directions by different algorithms: they agree on gaps and on overlaps.
    #[test]
    fn random_pairs_are_judged_as_by_the_search(
        seed in 0_u64..1_000_000_000, scale in 0.3..3.0_f64, near in 0.2..2.0_f64, rounding in 0.0..0.1_f64,
        sharp in any::<bool>(),
    ) {
        let mut rng = stream(seed, Stream::Sampling);
        let rounding = if sharp { 0.0 } else { rounding };
        let center = V::new(16.0, 16.0, 17.0);
        let a = Grain::random(&mut rng, center, 3.0, rounding);
        let moved = center + direction(&mut rng) * near * 0.5 * (scale + 3.0);
        let b = Grain::random(&mut rng, moved, scale, rounding);
        let contact = a.body().with(&b.body()).contact();
        match checked(&[a.clone(), b.clone()], &request_for(&specimen(0), &rule(0), &[a, b])) {
            Ok(check) => {
                let gap = check.found.min_gap_mm.unwrap();
                let wall = check.found.min_wall_gap_mm.unwrap();
                prop_assert!(wall > 0.0);
                prop_assert!((gap - contact.gap_mm).abs() < 1e-13, "{gap} {}", contact.gap_mm);
            }
            Err(Fault::Pair { clearance_mm, .. }) => {
                prop_assert!(contact.gap_mm < 1e-13, "{}", contact.gap_mm);
                // Of rounded bodies whose cores are apart the distance says how deep they are.
                prop_assert!((clearance_mm - contact.gap_mm).abs() < 1e-12, "{clearance_mm} {}", contact.gap_mm);
            }
            Err(other) => prop_assert!(false, "{other}"),
        }
    }

    /// The check computes corners in the documented order of operations, to the last bit, and the volume by itself.
    #[test]
    fn corners_are_those_of_the_stored_form(seed in 0_u64..1_000_000_000, rounding in 0.0..0.2_f64) {
        let mut rng = stream(seed, Stream::Sampling);
        let center = direction(&mut rng) * 50.0;
        let scale = between(&mut rng, 0.1, 9.0);
        let grain = Grain::random(&mut rng, center, scale, rounding);
        let body = Checked::new(&grain.shape(), &grain.pose).unwrap();
        prop_assert_eq!(&body.points, &grain.vertices());
        // Digits are lost where a small grain lies far from the origin, and in angles between faces that are almost
        // parallel: 1e-12 was exceeded once in some hundred thousand grains.
        let error = body.volume / (grain.template.volume() * scale.powi(3)) - 1.0;
        prop_assert!(error.abs() < 1e-10, "{error:e}");
        prop_assert_eq!(body.edges().count(), grain.template.edges().len());
    }
}

#[test]
fn faces_edges_and_corners_that_touch_exactly_pass_and_the_last_digit_of_an_overlap_fails() {
    let (cube, diamond) = (cuboid([1.0; 3], 0.0), octahedron(1.0));
    let round = cuboid([0.75; 3], 0.25);
    let at = |template: &Polyhedron, center: [f64; 3]| Grain {
        template: template.clone(),
        scale: 1.0,
        pose: Pose::at(V::from(center)),
    };
    for (a, b, moved, is_free_to_slide) in [
        (&cube, &cube, [2.0, 0.0, 0.0], false),
        (&cube, &cube, [2.0, 0.5, -0.25], false),
        (&cube, &cube, [2.0, 2.0, 0.0], true),
        (&cube, &cube, [2.0, 2.0, 2.0], true),
        (&cube, &diamond, [2.0, 0.0, 0.0], false),
        (&cube, &diamond, [2.0, 0.875, 0.5], false),
        (&diamond, &diamond, [2.0, 0.0, 0.0], false),
        (&diamond, &diamond, [1.0, 1.0, 0.0], false),
        (&round, &round, [2.0, 0.0, 0.0], false),
        (&round, &cube, [2.0, 0.5, 0.5], false),
    ] {
        let center = [8.0, 9.0, 10.0];
        let mut grains = vec![at(a, center), at(b, [0, 1, 2].map(|k| center[k] + moved[k]))];
        for kind in 0..3 {
            let request = request_for(&specimen(kind), &rule(0), &grains);
            let found = checked(&grains, &request).unwrap().found;
            assert!(found.min_gap_mm.unwrap().abs() < 1e-14, "{moved:?} {found:?}");
            let x = grains[1].pose.center_mm.x;
            grains[1].pose.center_mm.x = x - 4.0 * f64::EPSILON * x;
            let verdict = checked(&grains, &request);
            assert_eq!(verdict.is_ok(), is_free_to_slide, "{moved:?} {verdict:?}");
            grains[1].pose.center_mm.x = x;
        }
    }
}

#[test]
fn polyhedra_pushed_through_a_wall_by_a_billionth_of_their_size_are_refused() {
    let mut rng = stream(22, Stream::Sampling);
    for case in 0..1000_u64 {
        let is_cylinder = case % 2 == 1;
        let (specimen, distance) = (specimen(if is_cylinder { 2 } else { 0 }), rule(case / 2));
        let scale = between(&mut rng, 1.0, 3.0);
        let mut grain = Grain::random(&mut rng, V::new(16.0, 16.0, 17.0), scale, 0.03);
        let request = request_for(&specimen, &distance, std::slice::from_ref(&grain));
        let required = Required::new(request.distance, SpecimenRegion::new(&request.specimen));
        let gap = required.wall_gap_mm(grain.equivalent_diameter()) + 0.03 * scale;
        let angle = TAU * uniform(&mut rng);
        let (m, room) = match case / 2 % 3 {
            0 | 1 if is_cylinder => (V::new(angle.cos(), angle.sin(), 0.0), 16.0),
            2 => (V::z(), 17.0),
            _ => (-V::y(), 16.0),
        };
        let vertices = grain.vertices();
        let farthest = vertices.iter().max_by(|p, q| p.dot(&m).total_cmp(&q.dot(&m))).unwrap();
        // That corner on the ray from the axis; others may be farther from it than that one.
        let at = if is_cylinder && m.z == 0.0 {
            V::new(16.0, 16.0, farthest.z) + m * (room - gap)
        } else {
            farthest + m * (room - gap - m.dot(&(farthest - grain.pose.center_mm)))
        };
        let touching = grain.pose.center_mm + at - farthest;
        for (share, is_valid) in [(-1.0e-11, true), (1.0e-9, false)] {
            grain.pose.center_mm = touching + m * (share * grain.equivalent_diameter());
            let reach = grain.vertices().iter().map(|p| (p.x - 16.0).hypot(p.y - 16.0)).fold(0.0, f64::max);
            let is_valid = is_valid && (m.z != 0.0 || !is_cylinder || reach <= 16.0 - gap);
            let verdict = checked(std::slice::from_ref(&grain), &request);
            match verdict {
                Ok(_) => assert!(is_valid, "case {case}: {verdict:?}"),
                Err(Fault::Wall { .. }) => assert!(!is_valid, "case {case}: {verdict:?}"),
                Err(other) => panic!("case {case}: {other}"),
            }
        }
    }
}

#[test]
fn every_certificate_of_polyhedra_can_be_evaluated_again() {
    let mut rng = stream(23, Stream::Sampling);
    for kind in 0..2 {
        let mut grains: Vec<Grain> = Vec::new();
        for _ in 0..600 {
            let center = V::from(SIZE.map(|l| l * uniform(&mut rng)));
            grains.push(Grain::random(&mut rng, center, 2.5, 0.02));
            if checked(&grains, &request_for(&specimen(kind), &rule(1), &grains)).is_err() {
                grains.pop();
            }
        }
        let request = request_for(&specimen(kind), &rule(1), &grains);
        let shapes: Vec<_> = grains.iter().map(|grain| grain.shape().into()).collect();
        let poses: Vec<_> = grains.iter().map(|grain| grain.pose).collect();
        let list = of_pairs(certify_shapes(&shapes, &poses, &request, 1.5, &Unattended).unwrap());
        assert!(list.len() > 50, "{}", list.len());
        for c in &list {
            let n = V::from(c.normal).normalize();
            let shift = V::from_fn(|k, _| f64::from(c.image[k]) * SIZE[k]);
            let (a, b) = (grains[c.first].body(), grains[c.second.unwrap()].body());
            let s = a.with_at(&b, b.center_mm + shift).separation_mm(&n);
            assert!((s - c.separation_mm).abs() < 1e-12 && (0.7..1.5).contains(&s), "{c:?} {s}");
        }
        let least = list.iter().map(|c| c.separation_mm).fold(f64::INFINITY, f64::min);
        let found = checked(&grains, &request).unwrap().found;
        assert!((found.min_gap_mm.unwrap() - least).abs() < 1e-13);
        if kind == 0 {
            let bodies: Vec<Body> = grains.iter().map(Grain::body).collect();
            let closer =
                |i: usize| (0..i).filter(|&j| bodies[i].with(&bodies[j]).contact().gap_mm < 1.5).count();
            assert_eq!((0..bodies.len()).map(closer).sum::<usize>(), list.len());
        }
    }
}

/// A size that is not the least, one that the body does not pass, and directions that do not show it are refused.
#[test]
fn sieve_sizes_that_are_not_proven_are_refused() {
    let body = cuboid([3.0, 1.0, 0.8], 0.0);
    let found = body.sieve_passage();
    let known = 2.0_f64;
    let sizes = SieveSizes::default();
    assert!((sizes.proven(&body).unwrap() - known).abs() < 1e-9);
    let sides = found.sides;
    for (size, sides) in [
        (known * (1.0 + 1e-8), sides),
        (known * (1.0 - 1e-8), sides),
        (known * 1.01, [sides[1], sides[0]]),
        (known, [V::x(), V::y()]),
        (known, [sides[0] * 0.9, sides[1]]),
        (known, [sides[0], sides[0]]),
        (f64::NAN, sides),
    ] {
        let refused = sizes.proven(&body.with_passage(SievePassage { size, sides }));
        assert!(matches!(refused, Err(Fault::SieveSize { .. })), "{size} {sides:?}: {refused:?}");
    }
    assert_eq!(sizes.len(), 1, "the proof is the same for all");
}
