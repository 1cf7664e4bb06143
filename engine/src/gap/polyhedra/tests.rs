#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use proptest::prelude::*;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::rng::draws::{between, direction, orientation};
use crate::rng::{Stream, stream, uniform};
use crate::shape::Form;
use crate::shape::polyhedron::samples::{cuboid, hull, octahedron};
use crate::shape::polyhedron::{TemplateKind, draw_template};

type Rng = Xoshiro256PlusPlus;
type V = Vector3<f64>;

/// The hull of random points about their mean.
fn template(rng: &mut Rng, n: usize, stretch: f64, rounding: f64) -> Polyhedron {
    let mut points: Vec<V> =
        (0..n).map(|_| direction(rng).component_mul(&V::new(stretch, 1.0, 1.0 / stretch))).collect();
    let mean = points.iter().sum::<V>() / n as f64;
    for point in &mut points {
        *point -= mean;
    }
    hull(&points, rounding).unwrap_or_else(|| template(rng, n, stretch, rounding))
}

/// Vertices, triangles and edges in space.
struct Features {
    vertices: Vec<V>,
    triangles: Vec<[V; 3]>,
    edges: Vec<[V; 2]>,
}

impl Features {
    fn new(template: &Polyhedron, scale: f64, pose: &Pose) -> Self {
        let vertices: Vec<V> = template.world_vertices_mm(scale, pose).collect();
        let fan = |face: &Vec<u32>| {
            let corner = |v: u32| vertices[v as usize];
            face[1..]
                .windows(2)
                .map(|pair| [corner(face[0]), corner(pair[0]), corner(pair[1])])
                .collect::<Vec<_>>()
        };
        let triangles = template.faces().iter().flat_map(fan).collect();
        let edges = template.edges().iter().map(|edge| edge.ends.map(|v| vertices[v as usize])).collect();
        Self { vertices, triangles, edges }
    }

    fn normals(&self) -> impl Iterator<Item = V> {
        self.triangles.iter().map(|[a, b, c]| (b - a).cross(&(c - a)).normalize())
    }

    fn support(&self, n: &V) -> f64 {
        self.vertices.iter().map(|v| v.dot(n)).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Largest `s(n)` over the normals of all faces and of all pairs of edges: the least depth where it is negative.
fn brute_force_axes(a: &Features, b: &Features) -> f64 {
    let crosses =
        a.edges.iter().flat_map(|p| b.edges.iter().map(move |q| (p[1] - p[0]).cross(&(q[1] - q[0]))));
    let crosses = crosses.filter_map(|n| n.try_normalize(1e-9)).flat_map(|n| [n, -n]);
    let all = a.normals().chain(b.normals().map(|n| -n)).chain(crosses);
    all.map(|n| -a.support(&n) - b.support(&-n)).fold(f64::NEG_INFINITY, f64::max)
}

fn to_triangle(p: &V, [a, b, c]: &[V; 3]) -> f64 {
    let n = (b - a).cross(&(c - a));
    let inside =
        [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).cross(&(p - *from)).dot(&n) >= 0.0);
    if inside {
        return (n.normalize().dot(&(p - a))).abs();
    }
    [(a, b), (b, c), (c, a)].iter().map(|(from, to)| to_segment(p, from, to)).fold(f64::INFINITY, f64::min)
}

fn to_segment(p: &V, a: &V, b: &V) -> f64 {
    let along = b - a;
    let t = (along.dot(&(p - a)) / along.norm_squared()).clamp(0.0, 1.0);
    (a + along * t - p).norm()
}

fn between_edges([a, b]: &[V; 2], [c, d]: &[V; 2]) -> f64 {
    let (u, v, w) = (b - a, d - c, c - a);
    let (uu, uv, vv) = (u.dot(&u), u.dot(&v), v.dot(&v));
    let det = uu * vv - uv * uv;
    let (s, t) = ((u.dot(&w) * vv - v.dot(&w) * uv) / det, (u.dot(&w) * uv - v.dot(&w) * uu) / det);
    if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
        (c + v * t - a - u * s).norm()
    } else {
        f64::INFINITY
    }
}

/// Least distance of all vertices from all triangles, and of all edges.
fn brute_force_distance(a: &Features, b: &Features) -> f64 {
    let faces = |p: &Features, q: &Features| {
        let of = |v: &V| q.triangles.iter().map(|t| to_triangle(v, t)).fold(f64::INFINITY, f64::min);
        p.vertices.iter().map(of).fold(f64::INFINITY, f64::min)
    };
    let edges = a.edges.iter().flat_map(|p| b.edges.iter().map(move |q| between_edges(p, q)));
    faces(a, b).min(faces(b, a)).min(edges.fold(f64::INFINITY, f64::min))
}

struct Case {
    templates: [Polyhedron; 2],
    scales: [f64; 2],
    poses: [Pose; 2],
}

impl Case {
    /// Two polyhedra whose spheres overlap more or less.
    fn random(rng: &mut Rng, rounding: f64) -> Self {
        let stretch = between(rng, 1.0, 2.0);
        let points = 4 + (uniform(rng) * 20.0) as usize;
        let templates = [template(rng, points, stretch, rounding), template(rng, 12, stretch, rounding)];
        let scales = [3.0, between(rng, 0.5, 3.0)];
        let center_mm = V::new(40.0, 30.0, 50.0);
        let apart = between(rng, 0.2, 2.2) * 0.5 * (scales[0] + scales[1]);
        let moved = center_mm + direction(rng) * apart;
        let poses = [center_mm, moved].map(|center_mm| Pose { center_mm, orientation: orientation(rng) });
        Self { templates, scales, poses }
    }

    fn bodies(&self) -> [Body<'_>; 2] {
        [0, 1].map(|i| Body::new(&self.templates[i], self.scales[i], &self.poses[i]))
    }

    fn features(&self) -> [Features; 2] {
        [0, 1].map(|i| Features::new(&self.templates[i], self.scales[i], &self.poses[i]))
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(1500))]
    /// Distances and least depths against all features; decisions at gaps just below and above.
    #[test]
    fn random_pairs_agree_with_brute_force(seed in 0_u64..1_000_000_000, rounding in 0.0..0.1_f64, sharp in any::<bool>()) {
        let mut rng = stream(seed, Stream::Sampling);
        let rounding = if sharp { 0.0 } else { rounding };
        let case = Case::random(&mut rng, rounding);
        let (bodies, [p, q]) = (case.bodies(), case.features());
        let pair = bodies[0].with(&bodies[1]);
        let contact = pair.contact();
        let radii = bodies[0].rounding_mm + bodies[1].rounding_mm;
        let axes = brute_force_axes(&p, &q);
        let core = if axes > 0.0 { brute_force_distance(&p, &q) } else { axes };
        prop_assert!((contact.gap_mm + radii - core).abs() < 1e-12, "{contact:?} {core}");
        prop_assert!((pair.separation_mm(&contact.normal) - contact.gap_mm).abs() < 1e-15);
        prop_assert!((contact.normal.norm() - 1.0).abs() < 1e-14);
        // The points lie on the surfaces, as far apart as the gap along the normal.
        let between = pair.r + contact.points_mm[1] - contact.points_mm[0];
        prop_assert!((between - contact.normal * contact.gap_mm).norm() < 1e-6, "{between} {contact:?}");
        for (body, point, sign) in [(&bodies[0], contact.points_mm[0], 1.0), (&bodies[1], contact.points_mm[1], -1.0)] {
            let n = contact.normal * sign;
            prop_assert!((n.dot(&point) - body.support_mm(&n)).abs() < 1e-9);
        }
        for (gap, is_apart) in [(-1e-9, true), (1e-9, false)] {
            let gap = contact.gap_mm + gap;
            if gap + radii >= 0.0 {
                let decision = pair.decide(gap);
                prop_assert_eq!(decision.is_apart, is_apart);
                let again = pair.decide_from(gap, &decision.normal);
                prop_assert_eq!(again.is_apart, is_apart);
                if is_apart {
                    prop_assert!(pair.separation_mm(&decision.normal) >= gap);
                    prop_assert!((again.normal - decision.normal).norm() < 1e-15);
                }
            }
        }
        prop_assert_eq!(pair.factor(&contact.normal, 0.0) >= 1.0, contact.gap_mm >= 0.0);
    }

    /// Contacts at a gap of 1e-9 of the size, with faces, edges and corners of many kinds.
    #[test]
    fn pairs_that_nearly_touch_are_decided(seed in 0_u64..1_000_000_000, exponent in 6.0..12.0_f64) {
        let mut rng = stream(seed, Stream::Sampling);
        let mut case = Case::random(&mut rng, 0.0);
        let d = case.bodies()[0].with(&case.bodies()[1]).contact();
        let gap = 10.0_f64.powf(-exponent);
        // Moved along the normal of the least depth, or of the distance, the pair has that gap.
        case.poses[1].center_mm += d.normal * (gap - d.gap_mm);
        let bodies = case.bodies();
        let pair = bodies[0].with(&bodies[1]);
        prop_assert!((pair.contact().gap_mm - gap).abs() < 1e-13, "{} {gap}", pair.contact().gap_mm);
        prop_assert!(pair.decide(0.5 * gap).is_apart);
        // Past each other corners may be apart along another direction.
        case.poses[1].center_mm -= d.normal * (2.0 * gap);
        let (bodies, [p, q]) = (case.bodies(), case.features());
        let pair = bodies[0].with(&bodies[1]);
        let axes = brute_force_axes(&p, &q);
        prop_assert_eq!(pair.decide(0.0).is_apart, axes >= 0.0);
        let found = pair.contact().gap_mm;
        prop_assert!(axes >= 0.0 || (found - axes).abs() < 1e-13, "{found} {axes}");
    }
}

/// Bodies with faces of more than three corners, whose difference has many corners in a plane.
#[test]
fn least_depths_of_random_templates_agree_with_brute_force() {
    let mut rng = stream(1, Stream::Shape);
    let templates: Vec<Polyhedron> = (0..60_u32)
        .map(|i| {
            let kind = match i % 3 {
                0 => TemplateKind::Cuts(6 + i / 6),
                1 => TemplateKind::Cuboid(0.25),
                _ => TemplateKind::Voronoi,
            };
            let (elongation, flatness) = (between(&mut rng, 0.4, 1.0), between(&mut rng, 0.4, 1.0));
            draw_template(kind, Form { elongation, flatness }, &mut rng).unwrap().normalized()
        })
        .collect();
    for case in 0..4000 {
        let mut pick = || {
            let template = &templates[(uniform(&mut rng) * 60.0) as usize];
            let pose = Pose { center_mm: V::zeros(), orientation: orientation(&mut rng) };
            (template, between(&mut rng, 0.5, 4.0), pose)
        };
        let (a, mut b) = (pick(), pick());
        // Past touching by 1e-9 to 0.5 of their size along a direction.
        let n = direction(&mut rng);
        let bodies = [&a, &b].map(|(template, scale, pose)| Body::new(template, *scale, pose));
        let (of_a, of_b) = (bodies[0].core_support(&n).1, bodies[1].core_support(&-n).1);
        let depth = 0.5 * 10.0_f64.powf(between(&mut rng, -9.0, 0.0)) * (a.1 + b.1);
        b.2.center_mm = of_a - of_b - n * depth;
        let other = Body::new(b.0, b.1, &b.2);
        let [p, q] = [&a, &b].map(|(template, scale, pose)| Features::new(template, *scale, pose));
        let (axes, found) = (brute_force_axes(&p, &q), bodies[0].with(&other).contact().gap_mm);
        assert!((found - axes).abs() < 1e-10 || axes > 0.0, "case {case}: {found} {axes}");
    }
}

/// A body by its corners, and the size that its rounding is taken of.
#[derive(Clone, Copy)]
struct Corners {
    corners: [V; 4],
    size_mm: f64,
}

impl Core for Corners {
    const IS_SMOOTH: bool = false;

    fn core_support(&self, n: &V) -> (f64, V) {
        let heights = self.corners.map(|corner| (corner.dot(n), corner));
        heights.into_iter().max_by(|p, q| p.0.total_cmp(&q.0)).unwrap()
    }

    fn core_height_mm(&self, n: &V) -> f64 {
        self.core_support(n).0
    }

    fn rounding_mm(&self) -> f64 {
        0.0
    }

    fn size_mm(&self) -> f64 {
        self.size_mm
    }

    fn attaining(&self, n: &V, tolerance: f64) -> Vec<V> {
        let least = self.core_height_mm(n) - tolerance;
        self.corners.into_iter().filter(|corner| corner.dot(n) >= least).collect()
    }
}

/// A long ellipsoid and a long tetrahedron of a mix that grew: with all faces that see a new point, rounding tore the
/// polytope, whose faces grew in number until the search did not end.
#[test]
fn the_search_ends_where_rounding_could_tear_the_polytope() {
    let ellipsoid = Symmetric([
        332.826_208_557_913_73,
        -360.589_129_004_125_9,
        307.872_143_042_627_9,
        639.633_918_901_848_2,
        -428.006_425_575_516_8,
        400.933_091_866_435_86,
    ]);
    let corners = [
        V::new(-30.601_251_474_539_62, -39.872_033_512_869_53, -40.282_213_189_676_2),
        V::new(2.702_638_961_018_397_6, -60.549_536_713_732_8, -21.801_873_637_754_99),
        V::new(-3.501_313_282_673_329_8, 47.320_299_703_567_95, 43.559_182_602_282_704),
        V::new(31.399_925_796_194_555, 53.101_270_523_034_38, 18.524_904_225_148_486),
    ];
    let tetrahedron = Corners { corners, size_mm: 105.0 };
    let r = V::new(39.056_119_507_333_65, -6.129_929_975_337_127, 24.055_294_411_368_823);
    let pair = Pair { a: &ellipsoid, b: &tetrahedron, r };
    let known = [
        (V::new(17.386_553_096_300_63, -15.943_175_658_730_302, 12.824_902_297_493_251), corners[2]),
        (V::new(17.386_561_813_601_855, -15.943_207_033_705_681, 12.824_926_134_727_445), corners[0]),
    ]
    .map(|(of_a, of_b)| Difference { w: (r + of_b) - of_a, of_a, of_b });
    let normal = penetration::least_depth(&pair, &known).unwrap();
    let (found, _) = pair.core_separation(&normal);
    let mut rng = stream(1, Stream::Shape);
    for _ in 0..10_000 {
        let (other, _) = pair.core_separation(&direction(&mut rng));
        assert!(found >= other, "{found} {other}");
    }
}

/// Parallel faces and edges, corner against corner, equal bodies at the same place: where simplices are flat.
#[test]
fn regular_bodies_in_regular_positions() {
    let cube = cuboid([1.0; 3], 0.0);
    let diamond = octahedron(1.0);
    for (a, b, moved, gap) in [
        (&cube, &cube, [2.5, 0.0, 0.0], 0.5),
        (&cube, &cube, [2.5, 0.3, -0.7], 0.5),
        (&cube, &cube, [2.5, 2.5, 0.0], 0.5_f64.sqrt()),
        (&cube, &cube, [2.5, 2.5, 2.5], 0.75_f64.sqrt()),
        (&cube, &cube, [1.5, 0.0, 0.0], -0.5),
        (&cube, &cube, [1.5, 1.25, 0.0], -0.5),
        (&cube, &cube, [0.0, 0.0, 0.0], -2.0),
        (&cube, &cube, [2.0, 0.0, 0.0], 0.0),
        (&cube, &cube, [2.0, 2.0, 0.0], 0.0),
        (&cube, &cube, [2.0, 2.0, 2.0], 0.0),
        (&cube, &diamond, [2.5, 0.0, 0.0], 0.5),
        (&cube, &diamond, [2.0, 0.0, 0.0], 0.0),
        (&cube, &diamond, [1.9, 0.2, 0.1], -0.1),
        (&diamond, &diamond, [2.0, 0.0, 0.0], 0.0),
        (&diamond, &diamond, [1.0, 1.0, 0.0], 0.0),
        (&diamond, &diamond, [1.0, 1.0, 1.0], 1.0 / 3.0_f64.sqrt()),
        (&diamond, &diamond, [0.0, 0.0, 0.0], -2.0 / 3.0_f64.sqrt()),
    ] {
        for scale in [1.0, 1.0e-6, 1.0e6] {
            let bodies = [(a, [0.0; 3]), (b, moved)]
                .map(|(template, at)| Body::new(template, scale, &Pose::at(V::from(at) * scale)));
            let pair = bodies[0].with(&bodies[1]);
            let contact = pair.contact();
            assert!((contact.gap_mm / scale - gap).abs() < 1e-14, "{moved:?} {scale}: {contact:?} {gap}");
            if gap != 0.0 {
                assert_eq!(pair.decide(0.0).is_apart, gap > 0.0, "{moved:?} {scale}");
            }
        }
    }
}

#[test]
fn the_support_is_that_of_the_vertices_in_space() {
    let mut rng = stream(3, Stream::Sampling);
    let shape = template(&mut rng, 13, 1.3, 0.1);
    let pose = Pose { center_mm: direction(&mut rng), orientation: orientation(&mut rng) };
    let body = Body::new(&shape, 2.0, &pose);
    for _ in 0..100 {
        let n = direction(&mut rng);
        let vertices = shape.world_vertices_mm(2.0, &pose).map(|v| (v - pose.center_mm).dot(&n));
        let h = vertices.fold(f64::NEG_INFINITY, f64::max) + 0.2;
        assert!((body.support_mm(&n) - h).abs() < 1e-14);
        assert!(h <= body.outer_mm + 1e-14 && h >= body.inner_mm - 1e-14);
    }
}

/// Pairs of which rounding ends the search before a direction is known that parts them by nearly their distance.
#[test]
fn rounding_of_a_distance_loses_no_direction() {
    for (seed, exponent) in [(421_287_876, 11.168_729_108_441_251), (198_594_882, 11.790_357_637_268_892)] {
        let mut case = Case::random(&mut stream(seed, Stream::Sampling), 0.0);
        let apart = case.bodies()[0].with(&case.bodies()[1]).contact();
        let gap = 10.0_f64.powf(-exponent);
        case.poses[1].center_mm += apart.normal * (gap - apart.gap_mm);
        let bodies = case.bodies();
        let pair = bodies[0].with(&bodies[1]);
        let found = pair.contact().gap_mm;
        assert!((found - gap).abs() < 1e-14, "{found} {gap}");
        assert!(pair.decide(0.5 * gap).is_apart);
    }
}
