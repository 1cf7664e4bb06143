//! Grains that are longer than an edge of their periodic box: all pairs of packings with all images that can matter, by
//! a loop of the test's own.

use std::num::NonZeroUsize;

use nalgebra::{UnitQuaternion, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use serde_json::{Value, json};

use super::addition::End;
use super::monte_carlo::{self, MonteCarlo};
use super::rsa_shapes::{AttemptsIn, ShapeRsa};
use crate::PackingRequest;
use crate::control::Unattended;
use crate::distance::DistanceRule;
use crate::gap::grain::ConvexShape;
use crate::gap::solids::Body;
use crate::mix::uniform_orientation;
use crate::request::{Boundary, Distance, GrowthStop, Specimen};
use crate::shape::polyhedron::{TemplateKind, draw_template};
use crate::shape::{Ellipsoid, Form, Polyhedron, Pose, ScaledPolyhedron, SolidRef};

const NONE: Distance = Distance::None { wall_gap_mm: None };
const GAP: Distance = Distance::Constant { gap_mm: 0.15, wall_gap_mm: None };
const NEEDLE: Form = Form { elongation: 0.1, flatness: 1.0 };
const DISC: Form = Form { elongation: 1.0, flatness: 0.12 };

fn periodic(size_mm: [f64; 3]) -> Specimen {
    Specimen::Box { size_mm, boundary: Boundary::Periodic }
}

/// Templates of an equivalent diameter of 1.
fn templates(form: Form) -> Vec<Polyhedron> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
    let mut one = || draw_template(TemplateKind::Cuts(16), form, &mut rng).unwrap().normalized();
    (0..3).map(|_| one()).collect()
}

fn ellipsoid<'a>(d_mm: f64, form: Form) -> SolidRef<'a> {
    Ellipsoid::with_equivalent_diameter(d_mm, form).unwrap().into()
}

fn polyhedron(templates: &[Polyhedron], i: usize, scale_mm: f64) -> SolidRef<'_> {
    ScaledPolyhedron { template: &templates[i % templates.len()], scale_mm }.into()
}

/// Every grain keeps its gap to every image of every grain whose centre comes within the radii and the gap; as many are
/// tried along each axis as can, and more.
fn assert_all_images_apart(
    specimen: &Specimen,
    rule: &DistanceRule,
    shapes: &[SolidRef<'_>],
    poses: &[Pose],
) -> usize {
    let bounds = specimen.bounds_mm();
    let mut looked_at = 0;
    for (i, pose) in poses.iter().enumerate() {
        let (shape, body) = (&shapes[i], Body::new(shapes[i], pose));
        assert!((0..3).all(|a| (0.0..bounds[a]).contains(&pose.center_mm[a])), "{:?}", pose.center_mm);
        for (j, other_pose) in poses.iter().enumerate().skip(i) {
            let other = &shapes[j];
            let gap_mm = rule.gap_mm(shape.equivalent_diameter_mm(), other.equivalent_diameter_mm());
            let far = shape.outer_mm() + other.outer_mm() + gap_mm;
            let [x, y, z] = bounds.map(|length| (far / length).ceil() as i32 + 2);
            for (k, l, m) in
                (-x..=x).flat_map(|k| (-y..=y).flat_map(move |l| (-z..=z).map(move |m| (k, l, m))))
            {
                let offset = Vector3::new(
                    bounds[0] * f64::from(k),
                    bounds[1] * f64::from(l),
                    bounds[2] * f64::from(m),
                );
                let center_mm = other_pose.center_mm + offset;
                if (i == j && offset.norm() == 0.0) || (center_mm - pose.center_mm).norm() >= far {
                    continue;
                }
                looked_at += 1;
                let image = Body::new(*other, &Pose { center_mm, ..*other_pose });
                assert!(body.is_apart(&image, gap_mm), "{i}, {j} at {k}, {l}, {m} in {specimen:?}");
            }
        }
    }
    looked_at
}

fn inserted(specimen: &Specimen, distance: &Distance, shapes: &[SolidRef<'_>]) -> Vec<Pose> {
    let rsa = ShapeRsa {
        shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(distance, specimen),
        attempts_per_grain: Some(2_000_000),
        attempts_in: AttemptsIn::Specimen,
        threads: NonZeroUsize::MIN,
        orientation: &uniform_orientation,
    };
    let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(5), &Unattended);
    assert_eq!(outcome.end, End::Complete, "{specimen:?}, {} of {}", outcome.placed.len(), shapes.len());
    outcome.placed
}

fn grown(specimen: &Specimen, distance: &Distance, shapes: &[SolidRef<'_>]) -> Vec<Pose> {
    let outcome = MonteCarlo {
        shapes,
        domain: specimen.domain(),
        rule: DistanceRule::new(distance, specimen),
        maximize: None,
        initial_scale: None,
        swap: true,
        // Few grains make many sweeps in a compression cycle.
        stop: GrowthStop { sweeps: Some(4000 + 2_000_000 / shapes.len() as u64), ..GrowthStop::default() },
        orientation: &uniform_orientation,
        seed: 2,
        preference: None,
        keep_checkpoint: None,
        to_jamming: None,
        keeps_partial: false,
        threads: NonZeroUsize::MIN,
        target_share: monte_carlo::USUAL_TARGET_SHARE,
    }
    .run(None, &Unattended)
    .unwrap();
    assert_eq!((outcome.end, outcome.scale), (crate::packing::GrowthEnd::Target, 1.0), "{specimen:?}");
    outcome.placed
}

/// Needles, discs and both among rounder grains, in boxes with one and two short edges.
#[test]
fn grains_longer_than_an_edge_keep_their_gaps_to_all_images() {
    let (needles, discs) = (&templates(NEEDLE), &templates(DISC));
    // 28 mm long in an edge of 8 mm.
    let of_needles: Vec<SolidRef<'_>> =
        (0..14).map(|i| ellipsoid(6.03 - 0.05 * f64::from(i), NEEDLE)).collect();
    let of_discs: Vec<SolidRef<'_>> = (0..14).map(|i| ellipsoid(6.0 - 0.1 * f64::from(i), DISC)).collect();
    let angular: Vec<SolidRef<'_>> = (0..12).map(|i| polyhedron(needles, i, 2.6)).collect();
    let flat: Vec<SolidRef<'_>> = (0..10).map(|i| polyhedron(discs, i, 3.0)).collect();
    let mut mixed = vec![ellipsoid(4.0, NEEDLE), ellipsoid(3.9, DISC), polyhedron(needles, 0, 3.6)];
    mixed.extend((0..12).map(|i| polyhedron(discs, i, 2.0)));
    mixed.extend((0..12).map(|_| ellipsoid(1.5, Form::SPHERE)));
    for (name, size_mm, shapes) in [
        ("needles", [60.0, 60.0, 8.0], &of_needles),
        ("discs", [30.0, 9.0, 30.0], &of_discs),
        ("angular needles", [3.0, 30.0, 30.0], &angular),
        ("angular needles, two short edges", [5.0, 60.0, 6.0], &angular),
        ("angular discs", [4.0, 25.0, 25.0], &flat),
        ("mixed", [6.0, 30.0, 24.0], &mixed),
    ] {
        let specimen = periodic(size_mm);
        for distance in [&NONE, &GAP] {
            let rule = DistanceRule::new(distance, &specimen);
            for poses in [inserted(&specimen, distance, shapes), grown(&specimen, distance, shapes)] {
                assert_eq!(poses.len(), shapes.len());
                let looked_at = assert_all_images_apart(&specimen, &rule, shapes, &poses);
                assert!(looked_at > 0, "{name}");
            }
        }
    }
}

/// Requests with such grains are packed by every method, and pass the check, which has a loop over images of its own.
#[test]
fn requests_with_grains_longer_than_an_edge_are_packed() {
    let needles = json!({"type": "constant", "elongation": 0.1, "flatness": 1});
    let discs = json!({"type": "constant", "elongation": 1, "flatness": 0.15});
    let ellipsoid = |ratios: &Value| json!({"type": "ellipsoid", "ratios": ratios});
    let polyhedron = |ratios: &Value| json!({"type": "polyhedron", "ratios": ratios, "template_count": 4});
    let mixture = json!({"type": "mixture", "of": [
        {"share": 0.4, "shape": polyhedron(&needles)}, {"share": 0.3, "shape": ellipsoid(&discs)},
        {"share": 0.3, "shape": {"type": "sphere"}}]});
    let growth = json!({"type": "monte_carlo", "stop": {"sweeps": 40_000}});
    let rsa = json!({"type": "rsa", "attempts_per_grain": 3_000_000});
    for (size_mm, diameter_mm, fraction, shape) in [
        ([3.0, 30.0, 30.0], 2.5, 0.1, polyhedron(&needles)),
        ([60.0, 60.0, 8.0], 6.0, 0.2, ellipsoid(&needles)),
        ([60.0, 60.0, 8.0], 6.0, 0.1, polyhedron(&needles)),
        ([20.0, 20.0, 6.0], 5.0, 0.2, ellipsoid(&discs)),
        ([25.0, 25.0, 5.0], 4.0, 0.15, mixture),
    ] {
        for (seed, gap_mm, method) in [(5, 0.0, &growth), (6, 0.2, &growth), (7, 0.0, &rsa), (8, 0.1, &rsa)] {
            let by_growth = method["type"] == "monte_carlo";
            let value = json!({
                "specimen": {"type": "box", "size_mm": size_mm, "boundary": "periodic"},
                "mix": {"grading": {"type": "monodisperse", "diameter_mm": diameter_mm}, "allow_coarse": true,
                    "size": "equivalent", "volume_fraction": if by_growth { fraction } else { 0.5 * fraction },
                    "shape": shape},
                "distance": {"type": "constant", "gap_mm": gap_mm},
                "method": method,
            });
            let request = PackingRequest::from_json(&value, seed).unwrap();
            let packing = crate::pack(&request, &crate::Limits::default(), &Unattended);
            let packing = packing.unwrap_or_else(|error| panic!("{value}, seed {seed}: {error}"));
            assert!(packing.report.check.min_gap_mm.unwrap() >= gap_mm);
        }
    }
}

/// One needle in a box that it is five times as long as: most orientations bring it onto an image of its own.
#[test]
fn one_grain_longer_than_its_box_is_turned_clear_of_itself() {
    let specimen = periodic([8.0, 30.0, 30.0]);
    let shapes = [ellipsoid(8.6, NEEDLE)];
    assert!(2.0 * shapes[0].outer_mm() > 39.0);
    for distance in [&NONE, &GAP] {
        let rule = DistanceRule::new(distance, &specimen);
        for poses in [inserted(&specimen, distance, &shapes), grown(&specimen, distance, &shapes)] {
            assert!(assert_all_images_apart(&specimen, &rule, &shapes, &poses) > 0);
        }
    }
}

#[test]
fn fewer_grains_can_be_named_the_more_images_they_have() {
    let shapes = |d_mm: f64| [ellipsoid(d_mm, NEEDLE)];
    let rule = DistanceRule::new(&NONE, &periodic([8.0, 60.0, 60.0]));
    let most =
        |d_mm: f64, specimen: &Specimen| monte_carlo::most_grains(&shapes(d_mm), &specimen.domain(), &rule);
    assert_eq!(most(0.5, &periodic([8.0, 60.0, 60.0])), monte_carlo::MAX_GRAINS as u64);
    // 2.1 (14 + 1.6 6) + 8 is less than 58 mm: |k| < 1 + 58 / 8 and two more axes of one step, or three.
    let few = most(6.03, &periodic([8.0, 60.0, 60.0]));
    assert!((1 << 23..=1 << 24).contains(&few), "{few}");
    let walls = Specimen::Box { size_mm: [8.0, 60.0, 60.0], boundary: Boundary::Walls };
    assert_eq!(most(6.03, &walls), monte_carlo::MAX_GRAINS as u64);
}

/// A ball and a needle that are wider than the box in every orientation have no place, which is proven at once.
#[test]
fn what_meets_its_own_image_in_every_orientation_is_proven_to_have_no_place() {
    let specimen = periodic([8.0, 30.0, 30.0]);
    for (d_mm, form, distance) in [
        (8.01, Form::SPHERE, &NONE),
        (7.9, Form::SPHERE, &GAP),
        // With b = c = a / 10 the thickness 2 c is d / (10 cbrt(1 / 100)).
        (80.1 * libm::cbrt(0.01), NEEDLE, &NONE),
    ] {
        let shapes = [ellipsoid(d_mm, form)];
        let rsa = ShapeRsa {
            shapes: &shapes,
            domain: specimen.domain(),
            rule: DistanceRule::new(distance, &specimen),
            attempts_per_grain: None,
            attempts_in: AttemptsIn::Specimen,
            threads: NonZeroUsize::MIN,
            orientation: &|_: &mut Xoshiro256PlusPlus| UnitQuaternion::identity(),
        };
        let outcome = rsa.run(&mut Xoshiro256PlusPlus::seed_from_u64(5), &Unattended);
        assert_eq!(outcome.end, End::InsertionFailed { saturation_proven: true, attempts: 0 });
    }
}
