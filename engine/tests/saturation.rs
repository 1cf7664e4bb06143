//! The proof that random sequential addition of Platonic solids is saturated, which `examples/saturation` makes: it
//! finds the poses that are left, and none where the tests of pairs of the engine find none. Its results for all solids
//! are in `docs/shapes.md`.

#[path = "../examples/saturation/saturate.rs"]
mod saturate;
#[path = "../examples/saturation/solid.rs"]
mod solid;

use nalgebra::Vector3;
use packstone_engine::gap::polyhedra::Body;
use packstone_engine::mix::uniform_orientation;
use packstone_engine::shape::polyhedron::PlatonicSolid;
use packstone_engine::shape::{Polyhedron, Pose};
use rand::rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use saturate::{Saturation, moves, orientation};
use solid::Solid;

/// Edge of the cube that cubes of the volume 1 are added to.
const EDGE: f64 = 2.0;

fn point(rng: &mut Xoshiro256PlusPlus, edge: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| edge * (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64)
}

/// A template with the scale at which it has the volume 1.
fn template(kind: PlatonicSolid) -> (Polyhedron, f64) {
    let template = kind.body().unwrap().normalized();
    let scale = 1.0 / libm::cbrt(template.volume());
    (template, scale)
}

/// Distance of the nearest images of two poses, by the engine; minus the depth where they overlap.
fn gap(bodies: &[Body<'_>; 2], shift: impl Fn(u32) -> Vector3<f64>, images: u32) -> f64 {
    let [a, b] = bodies;
    let gaps = (0..images).map(|image| a.with_at(b, b.center_mm + shift(image)).contact().gap_mm);
    gaps.fold(f64::INFINITY, f64::min)
}

fn periods(image: u32) -> Vector3<f64> {
    let along = |by: u32| f64::from(image / by % 3) - 1.0;
    Vector3::new(along(1), along(3), along(9)) * EDGE
}

fn saturated(solid: &Solid, grains: &[Pose], rng: &mut Xoshiro256PlusPlus) -> Vec<Pose> {
    let mut saturation = Saturation::new(solid, EDGE, grains);
    while saturation.cells() > 0 {
        saturation.step(rng);
    }
    let pose = |grain: &solid::Placed| Pose { center_mm: grain.center, orientation: grain.orientation };
    let poses: Vec<Pose> = saturation.grains.iter().map(pose).collect();
    assert!((saturation.fraction() - poses.len() as f64 / EDGE.powi(3)).abs() < 1e-12);
    poses
}

/// Whether a pose overlaps none of the grains, by the engine.
fn fits(new: &Body<'_>, grains: &[Body<'_>]) -> bool {
    grains.iter().all(|other| {
        (0..27).all(|image| {
            let at = other.center_mm + periods(image);
            (at - new.center_mm).norm() >= new.outer_mm + other.outer_mm
                || new.with_at(other, at).decide(0.0).is_apart
        })
    })
}

#[test]
fn every_pose_that_fits_stays_in_a_cell() {
    let kind = PlatonicSolid::Cube;
    let solid = Solid::new(kind).unwrap();
    let (template, scale) = template(kind);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut pose = || Pose { center_mm: point(&mut rng, EDGE), orientation: uniform_orientation(&mut rng) };
    let grain = pose();
    let grains = [Body::new(&template, scale, &grain)];
    let poses = std::iter::repeat_with(&mut pose).take(10_000);
    let fitting: Vec<Pose> = poses.filter(|pose| fits(&Body::new(&template, scale, pose), &grains)).collect();
    assert!(fitting.len() > 20, "{}", fitting.len());
    let mut saturation = Saturation::new(&solid, EDGE, &[grain]);
    saturation.refine();
    let lost = fitting.iter().filter(|pose| !saturation.is_left(pose)).count();
    assert_eq!(lost, 0, "of {} in {} cells", fitting.len(), saturation.cells());
}

/// In the corners of a cell points move as far as is said, or nearly, and nowhere farther.
#[test]
fn points_move_no_farther_than_cells_allow() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(4);
    for _ in 0..200 {
        let middle = point(&mut rng, 1.6) - Vector3::repeat(0.8);
        let half = 0.02 + 0.3 * point(&mut rng, 1.0).x;
        let [by_center, by_rotation] = moves(half, &middle, half, 1.3);
        let mut farthest: f64 = 0.0;
        for i in 0..400_u32 {
            let sign = |axis: u32| f64::from(2 * (i >> axis & 1)) - 1.0;
            let corner = Vector3::new(sign(0), sign(1), sign(2));
            let within =
                if i < 64 { corner } else { 2.0 * point(&mut rng, 1.0) - Vector3::repeat(1.0) } * half;
            let turn = orientation(&middle).rotation_to(&orientation(&(middle + within)));
            // A point of the surface of the sphere around, as far from the axis as it can be.
            let axis = turn.axis().map_or_else(Vector3::x, nalgebra::Unit::into_inner);
            let p = axis.cross(&(point(&mut rng, 1.0) - Vector3::repeat(0.5))).normalize() * 1.3;
            farthest = farthest.max((turn * p - p).norm());
        }
        assert!(farthest <= by_rotation * (1.0 + 1e-12), "{farthest} {by_rotation}");
        assert!(farthest > by_rotation * (1.0 - 1e-6), "{farthest} {by_rotation}");
        assert!((by_center - half * 3.0_f64.sqrt()).abs() < 1e-12);
    }
}

#[test]
fn saturated_packings_have_no_overlap_and_no_room_for_another_grain() {
    let kind = PlatonicSolid::Cube;
    let solid = Solid::new(kind).unwrap();
    let (template, scale) = template(kind);
    let body = |pose: &Pose| Body::new(&template, scale, pose);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
    let grains = saturated(&solid, &[], &mut rng);
    for (i, a) in grains.iter().enumerate() {
        for b in &grains[..i] {
            assert!(gap(&[body(a), body(b)], periods, 27) > -1e-12);
        }
    }
    let bodies: Vec<Body<'_>> = grains.iter().map(body).collect();
    for _ in 0..100_000 {
        let pose = Pose { center_mm: point(&mut rng, EDGE), orientation: uniform_orientation(&mut rng) };
        let new = body(&pose);
        assert!(!fits(&new, &bodies), "{pose:?}");
    }
    // Where a grain is taken out there is room, and it is found.
    let more = saturated(&solid, &grains[1..], &mut rng);
    assert!(more.len() >= grains.len(), "{} of {}", more.len(), grains.len());
}

#[test]
fn depths_of_overlaps_are_those_of_the_engine() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
    for kind in PlatonicSolid::ALL {
        let solid = Solid::new(kind).unwrap();
        let (template, scale) = template(kind);
        for _ in 0..300 {
            let mut pose = |edge: f64| Pose {
                center_mm: point(&mut rng, edge),
                orientation: uniform_orientation(&mut rng),
            };
            let poses = [pose(0.0), pose(1.0)];
            let depth = -gap(&poses.map(|pose| Body::new(&template, scale, &pose)), |_| Vector3::zeros(), 1);
            if depth > 1e-6 {
                let [a, b] = poses.map(|pose| solid.placed(pose.center_mm, pose.orientation));
                assert!(a.keeps(-depth - 1e-9, &b, &Vector3::zeros()), "{kind:?} {poses:?}");
                assert!(!a.keeps(-depth + 1e-9, &b, &Vector3::zeros()), "{kind:?} {poses:?}");
            }
        }
    }
}
