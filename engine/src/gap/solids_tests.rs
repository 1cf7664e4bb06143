use std::f64::consts::PI;

use crate::properties::properties;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::polyhedra::WIDER;
use super::*;
use crate::rng::draws::{between, direction};
use crate::rng::{Stream, stream, uniform};
use crate::shape::polyhedron::{PlatonicSolid, TemplateKind, draw_template};
use crate::shape::{Ellipsoid, Form, Polyhedron, ScaledPolyhedron};

type Rng = Xoshiro256PlusPlus;
type V = Vector3<f64>;

fn pose(rng: &mut Rng, center_mm: V) -> Pose {
    let q = Quaternion::from(direction(rng).push(between(rng, -1.0, 1.0)));
    Pose { center_mm, orientation: UnitQuaternion::new_normalize(q) }
}

fn ellipsoid(rng: &mut Rng) -> Ellipsoid {
    let size = 10.0_f64.powf(between(rng, -1.0, 1.0));
    let [b, c] = [(); 2].map(|()| between(rng, 0.15, 1.0));
    Ellipsoid::new([size, size * b, size * b * c]).unwrap()
}

fn template(rng: &mut Rng) -> Polyhedron {
    let kind =
        [TemplateKind::Cuts(14), TemplateKind::Cuboid(0.2), TemplateKind::Cuboid(0.0), TemplateKind::Voronoi]
            [(4.0 * uniform(rng)) as usize];
    let form = Form { elongation: between(rng, 0.4, 1.0), flatness: between(rng, 0.4, 1.0) };
    let body = draw_template(kind, form, rng).unwrap();
    let rounding = if uniform(rng) < 0.5 { 0.0 } else { between(rng, 0.01, 0.2) };
    body.with_relative_rounding(rounding).unwrap().normalized()
}

/// An ellipsoid and a polyhedron by formulas of the tests.
struct Both {
    ellipsoid: (Ellipsoid, Pose),
    /// Vertices relative to the centre.
    corners: Vec<V>,
    rounding: f64,
    r: V,
}

impl Both {
    fn new(ellipsoid: Ellipsoid, of_a: Pose, shape: &ScaledPolyhedron<'_>, of_b: &Pose) -> Self {
        let corners = shape.template.world_vertices_mm(shape.scale_mm, of_b);
        Self {
            ellipsoid: (ellipsoid, of_a),
            corners: corners.map(|corner| corner - of_b.center_mm).collect(),
            rounding: shape.scale_mm * shape.template.rounding(),
            r: of_b.center_mm - of_a.center_mm,
        }
    }

    /// The supports of both towards each other, times the length of the vector.
    fn supports(&self, n: &V) -> [f64; 2] {
        let (ellipsoid, pose) = &self.ellipsoid;
        let of_b = self.corners.iter().map(|corner| -corner.dot(n)).fold(f64::NEG_INFINITY, f64::max);
        [ellipsoid.support_mm(pose, n), of_b + self.rounding * n.norm()]
    }

    /// `s(n)` times the length of the vector, which is concave.
    fn separation(&self, n: &V) -> f64 {
        let [h_a, h_b] = self.supports(n);
        self.r.dot(n) - h_a - h_b
    }

    fn factor(&self, n: &V, gap: f64) -> f64 {
        self.r.dot(n) / self.needed(n, gap)
    }

    fn needed(&self, n: &V, gap: f64) -> f64 {
        let [h_a, h_b] = self.supports(n);
        h_a + h_b + gap * n.norm()
    }
}

/// The largest ratio over all directions of a concave function to a convex positive one, both homogeneous: of many
/// directions the best; where it is positive, the maximum of the concave `of - ratio * to` on a plane of directions
/// around it by nested golden sections, again and again (Dinkelbach 1967).
fn largest(of: impl Fn(&V) -> f64, to: impl Fn(&V) -> f64) -> (f64, V) {
    let most = 3000;
    let directions = (0..most).map(|i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(most);
        let angle = PI * (3.0 - 5.0_f64.sqrt()) * f64::from(i);
        let n = V::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z);
        (of(&n) / to(&n), n)
    });
    let mut best = directions.max_by(|p, q| p.0.total_cmp(&q.0)).unwrap();
    for _ in 0..8 {
        let (ratio, n) = best;
        if ratio <= 0.0 {
            break;
        }
        let axis = if n.x.abs() < 0.6 { V::x() } else { V::y() };
        let u = n.cross(&axis).normalize();
        let v = n.cross(&u);
        let value = |x: f64, y: f64| {
            let m = n + u * x + v * y;
            of(&m) - ratio * to(&m)
        };
        let along = |x: f64| golden(|y| value(x, y));
        let (_, x) = golden(|x| along(x).0);
        let m = (n + u * x + v * along(x).1).normalize();
        let next = of(&m) / to(&m);
        if next <= ratio {
            break;
        }
        best = (next, m);
    }
    best
}

/// The largest value of a concave function between -0.7 and 0.7, and where.
fn golden(of: impl Fn(f64) -> f64) -> (f64, f64) {
    let share = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut low, mut high) = (-0.7, 0.7);
    let inner = |low: f64, high: f64| [high - share * (high - low), low + share * (high - low)];
    let mut at = inner(low, high);
    let mut values = at.map(&of);
    for _ in 0..60 {
        if values[0] > values[1] {
            high = at[1];
            at = inner(low, high);
            values = [of(at[0]), values[0]];
        } else {
            low = at[0];
            at = inner(low, high);
            values = [values[1], of(at[1])];
        }
    }
    if values[0] > values[1] { (values[0], at[0]) } else { (values[1], at[1]) }
}

/// An ellipsoid and a polyhedron whose gap is about a share of the smaller one's size.
fn pair(rng: &mut Rng, template: &Polyhedron, gap_share: f64) -> (Ellipsoid, Pose, f64, Pose) {
    let a = ellipsoid(rng);
    let scale = a.semi_axes_mm().x * 5.0_f64.powf(between(rng, -1.0, 1.0));
    let [center, way] = [direction(rng) * 30.0, direction(rng)];
    let of_a = pose(rng, center);
    let of_b = pose(rng, center + way);
    let shape = ScaledPolyhedron { template, scale_mm: scale };
    let both = Both::new(a, of_a, &shape, &of_b);
    let n = both.r.normalize();
    let [h_a, h_b] = both.supports(&n);
    let center_mm = of_a.center_mm + n * (h_a + h_b + gap_share * scale.min(a.semi_axes_mm().z));
    (a, of_a, scale, Pose { center_mm, ..of_b })
}

/// Long tetrahedra and ellipsoids: points of their difference often lie nearly in one plane, where rounding could tear
/// the polytope of the search, which asserts that it is whole.
#[test]
fn depths_of_long_bodies_are_found() {
    let rng = &mut stream(5, Stream::Shape);
    for _ in 0..2000 {
        let form = Form { elongation: between(rng, 0.2, 1.0), flatness: between(rng, 0.2, 1.0) };
        let template = draw_template(TemplateKind::Platonic(PlatonicSolid::Tetrahedron), form, rng)
            .unwrap()
            .normalized();
        let share = -10.0_f64.powf(between(rng, -3.0, 0.0));
        let (a, of_a, scale_mm, of_b) = pair(rng, &template, share);
        let shape = ScaledPolyhedron { template: &template, scale_mm };
        let both = Both::new(a, of_a, &shape, &of_b);
        let contact = Body::new(a.into(), &of_a).contact(&Body::new(shape.into(), &of_b));
        let size = a.semi_axes_mm().x + scale_mm;
        assert!((both.separation(&contact.normal) - contact.gap_mm).abs() < 1e-12 * size);
        for _ in 0..100 {
            let other = both.separation(&direction(rng));
            assert!(contact.gap_mm > other - 1e-9 * size, "{} {other} {size}", contact.gap_mm);
        }
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Gaps are those of brute force, and every one that is not longer is proven by a direction, whichever comes first.
    #[test]
    fn decisions_are_those_of_brute_force(seed in 0_u64..1 << 40, share in -0.5..0.5_f64, first in 0_u32..3) {
        let rng = &mut stream(seed, Stream::Shape);
        let template = template(rng);
        let (a, of_a, scale_mm, of_b) = pair(rng, &template, share);
        let shape = ScaledPolyhedron { template: &template, scale_mm };
        let both = Both::new(a, of_a, &shape, &of_b);
        let (gap, at) = largest(|n| both.separation(n), V::norm);
        let size = a.semi_axes_mm().x + scale_mm;
        let turned = [SolidRef::from(a).turned(&SolidRef::from(a).rows(&of_a)),
            SolidRef::from(shape).turned(&SolidRef::from(shape).rows(&of_b))];
        let start: V = [both.r, at, direction(rng)][first as usize];
        // Rounding in nearly flat triangles of the search ends it before the gap: by more than 1e-11 of the size in
        // one of 2000 pairs, by more than 1e-10 in one of 100 000 (150 000 pairs that lie apart).
        for (required, apart) in [
            (gap - 1e-9 * size, true), (gap + 1e-9 * size, false), (gap / 2.0, true), (gap + 0.1 * size, false),
        ] {
            if required < 0.0 {
                continue;
            }
            let r = Vector::from(both.r);
            let found = turned[0].decide(&turned[1], r, required, start.into());
            prop_assert_eq!(found.is_apart, apart, "{} {} {}", gap, required, size);
            let back = turned[1].decide(&turned[0], opposite(r), required, opposite(start.into()));
            prop_assert_eq!(back.is_apart, apart);
            if apart {
                for n in [V::from(found.normal), -V::from(back.normal)] {
                    prop_assert!(both.separation(&n.normalize()) >= required - 1e-14 * size);
                }
            }
        }
        if gap < -1e-3 * size {
            // The depth is that of the best of many directions, not of the very best.
            let found = turned[0].decide(&turned[1], both.r.into(), 0.0, start.into());
            let proven = both.separation(&V::from(found.normal).normalize()) >= -1e-14 * size;
            prop_assert!(!found.is_apart || proven);
            prop_assert!(!found.is_apart || gap > -0.1 * size);
        }
    }

    /// The contact of bodies has the gap of brute force, and points of the surfaces that lie so far apart. The least
    /// depth of an overlap is no more than a local one.
    #[test]
    fn contacts_are_those_of_brute_force(seed in 0_u64..1 << 40, share in -0.6..0.6_f64) {
        let rng = &mut stream(seed, Stream::Shape);
        let template = template(rng);
        let (a, of_a, scale_mm, of_b) = pair(rng, &template, share);
        let shape = ScaledPolyhedron { template: &template, scale_mm };
        let both = Both::new(a, of_a, &shape, &of_b);
        let (gap, _) = largest(|n| both.separation(n), V::norm);
        let size = a.semi_axes_mm().x + scale_mm;
        let bodies = [Body::new(a.into(), &of_a), Body::new(shape.into(), &of_b)];
        let contact = bodies[0].contact(&bodies[1]);
        prop_assert!((both.separation(&contact.normal) - contact.gap_mm).abs() < 1e-12 * size);
        // Of overlapping bodies the test knows a direction of small depth alone, not that of the least.
        prop_assert!(contact.gap_mm > gap - 1e-9 * size, "{} {} {}", contact.gap_mm, gap, size);
        prop_assert!(gap <= 0.0 || contact.gap_mm < gap + 1e-10 * size, "{} {} {}", contact.gap_mm, gap, size);
        let back = bodies[1].contact(&bodies[0]);
        prop_assert!((back.gap_mm - contact.gap_mm).abs() < 1e-6 * size);
        prop_assert_eq!(bodies[0].is_apart(&bodies[1], 0.0), contact.gap_mm >= 0.0);
        if gap > 1e-6 * size {
            let between = both.r + contact.points_mm[1] - contact.points_mm[0];
            prop_assert!((between.norm() - gap).abs() < 1e-6 * size, "{} {}", between.norm(), gap);
        }
    }

    /// Bodies that are too close push each other along a direction that is no worse than the line of the centres, and,
    /// where the search is not cut short, as near the least widening as its step lets it come.
    #[test]
    fn bodies_push_along_the_least_widening(seed in 0_u64..1 << 40, share in -0.4..0.0_f64) {
        let rng = &mut stream(seed, Stream::Shape);
        let template = template(rng);
        let (a, of_a, scale_mm, of_b) = pair(rng, &template, share);
        let shape = ScaledPolyhedron { template: &template, scale_mm };
        let both = Both::new(a, of_a, &shape, &of_b);
        let size = a.semi_axes_mm().x + scale_mm;
        let gap = 0.01 * a.semi_axes_mm().z.min(scale_mm);
        let (most, best) = largest(|n| both.r.dot(n), |n| both.needed(n, gap));
        prop_assume!(most < 1.0);
        let [one, other] = [(SolidRef::from(a), of_a), (SolidRef::from(shape), of_b)]
            .map(|(shape, pose)| shape.turned(&shape.rows(&pose)));
        let r: Vector = both.r.into();
        let n = scaled(r, 1.0 / norm(r));
        for turns in [3, 50] {
            let pushes = [one.contact(&other, r, gap, n, turns), {
                let back = other.contact(&one, opposite(r), gap, opposite(n), turns);
                let ([h_b, h_a], [arm_b, arm_a]) = (back.supports_mm, back.arms_mm);
                PushContact { normal: opposite(back.normal), supports_mm: [h_a, h_b], arms_mm: [arm_a, arm_b] }
            }];
            for PushContact { normal, supports_mm, arms_mm } in pushes {
                let n = V::from(normal);
                prop_assert!((n.norm() - 1.0).abs() < 1e-12);
                let found = both.factor(&n, gap);
                let start = both.factor(&both.r.normalize(), gap);
                prop_assert!(found >= start - 1e-12 && found <= most * (1.0 + 1e-9), "{} {} {}", start, found, most);
                // Where the search ends by itself, no direction has a larger `w r . n / found - needed(n)`, `w` how
                // much wider than by the factor found the centres lie: along the best direction a bound on the factor.
                let least = WIDER - (WIDER - 1.0) * both.r.norm() / both.r.dot(&best);
                prop_assert!(turns == 3 || found > (least - 1e-3) * most, "{} {} {}", found, most, least);
                let expected = both.supports(&n);
                for k in 0..2 {
                    let sign = if k == 0 { 1.0 } else { -1.0 };
                    let reach = sign * n.dot(&V::from(arms_mm[k]));
                    prop_assert!((supports_mm[k] - expected[k]).abs() < 1e-12 * size);
                    prop_assert!(reach <= expected[k] + 1e-9 * size && reach > expected[k] - 0.1 * size);
                }
            }
        }
    }

    /// Pairs of one kind are what they are without the other.
    #[test]
    fn pairs_of_one_kind_are_decided_as_by_themselves(seed in 0_u64..1 << 40, share in -0.3..0.3_f64) {
        let rng = &mut stream(seed, Stream::Shape);
        let template = template(rng);
        let (a, of_a, scale_mm, of_b) = pair(rng, &template, share);
        let shape = ScaledPolyhedron { template: &template, scale_mm };
        let r: Vector = (of_b.center_mm - of_a.center_mm).into();
        let gap = 0.01 * scale_mm;
        let (p, q) = (a.turned(&a.rows(&of_a)), a.turned(&a.rows(&of_b)));
        let (of_p, of_q) = (TurnedSolid::Ellipsoid(p), TurnedSolid::Ellipsoid(q));
        prop_assert_eq!(of_p.decide(&of_q, r, gap, r), p.decide(&q, r, gap, r));
        let (p, q) = (shape.turned(&shape.rows(&of_a)), shape.turned(&shape.rows(&of_b)));
        let (of_p, of_q) = (TurnedSolid::Polyhedron(p), TurnedSolid::Polyhedron(q));
        prop_assert_eq!(of_p.decide(&of_q, r, gap, r), p.decide(&q, r, gap, r));
        prop_assert_eq!(of_p.contact(&of_q, r, gap, scaled(r, 1.0 / norm(r)), 3),
            p.contact(&q, r, gap, scaled(r, 1.0 / norm(r)), 3));
        prop_assert!(SolidRef::from(a).is_similar(&a.into()) && !SolidRef::from(a).is_similar(&shape.into()));
        prop_assert!(SolidRef::from(shape).is_same(&shape.into()) && !SolidRef::from(shape).is_same(&a.into()));
    }
}

/// The three turns that methods take suffice for most.
#[test]
fn most_bodies_push_along_nearly_the_least_widening() {
    let (mut near, mut all) = (0, 0);
    for seed in 0..60 {
        let rng = &mut stream(seed, Stream::Shape);
        let template = template(rng);
        let (a, of_a, scale_mm, of_b) = pair(rng, &template, -0.2);
        let shape = ScaledPolyhedron { template: &template, scale_mm };
        let both = Both::new(a, of_a, &shape, &of_b);
        let gap = 0.01 * a.semi_axes_mm().z.min(scale_mm);
        let (most, _) = largest(|n| both.r.dot(n), |n| both.needed(n, gap));
        if most >= 1.0 {
            continue;
        }
        let [one, other] = [(SolidRef::from(a), of_a), (SolidRef::from(shape), of_b)]
            .map(|(shape, pose)| shape.turned(&shape.rows(&pose)));
        let r: Vector = both.r.into();
        let push = one.contact(&other, r, gap, scaled(r, 1.0 / norm(r)), 3);
        all += 1;
        near += u32::from(both.factor(&V::from(push.normal), gap) > 0.98 * most);
    }
    assert!(all >= 15 && 10 * near >= 9 * all, "{near} of {all}");
}
