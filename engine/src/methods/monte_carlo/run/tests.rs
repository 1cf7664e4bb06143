//! What happens to a packing that jams below its target.

use std::num::NonZeroUsize;

use nalgebra::Vector3;

use super::end::{NEAR_TARGET, STALL_CYCLES};
use super::*;
use crate::control::Unattended;
use crate::distance::DistanceRule;
use crate::gap::spheres::Sphere;
use crate::methods::growth::EXPANSION;
use crate::methods::monte_carlo::USUAL_TARGET_SHARE;
use crate::mix::uniform_orientation;
use crate::request::{Boundary, Distance, GrowthStop, Specimen};
use crate::shape::polyhedron::PlatonicSolid;
use crate::shape::{Ellipsoid, ScaledPolyhedron};

const BOX: Specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };

fn shapes() -> [Ellipsoid; 2] {
    [3.0, 2.0].map(|a| Ellipsoid::new([a, 0.8 * a, 0.6 * a]).unwrap())
}

fn method<S: ConvexShape>(shapes: &[S]) -> MonteCarlo<'_, S> {
    MonteCarlo {
        shapes,
        domain: BOX.domain(),
        rule: DistanceRule::new(&Distance::None { wall_gap_mm: None }, &BOX),
        maximize: None,
        initial_scale: None,
        swap: true,
        stop: GrowthStop::default(),
        orientation: &uniform_orientation,
        seed: 1,
        preference: None,
        keep_checkpoint: None,
        to_jamming: None,
        keeps_partial: false,
        threads: NonZeroUsize::MIN,
        target_share: USUAL_TARGET_SHARE,
    }
}

/// Two grains at this size, which have not grown for as long as tells a stall.
fn jammed(of: &MonteCarlo<'_, Ellipsoid>, size: f64) -> Run<Ellipsoid> {
    let poses = [5.0, 14.0].map(|x| Pose::at(Vector3::new(x, 10.0, 10.0)));
    let mut run = Run::new(of, poses.to_vec(), size, Instant::now()).unwrap();
    jam(&mut run, size);
    run
}

/// The run jams at a size.
fn jam(run: &mut Run<Ellipsoid>, size: f64) {
    run.pushes = Pushes::Light;
    run.system.scale(1.0 / size / run.system.frame.stretch);
    run.mark = (run.size(), run.counted.compression_cycles);
    run.counted.compression_cycles += STALL_CYCLES;
}

#[test]
fn a_packing_that_jams_near_its_target_is_expanded_while_that_helps() {
    let shapes = shapes();
    let of = method(&shapes);
    let mut run = jammed(&of, 0.99);
    run.rate = LEAST_RATE;
    assert_eq!(run.limit_reached(&of), None);
    assert!((run.size() * (1.0 + EXPANSION) / 0.99 - 1.0).abs() < 1e-12, "{}", run.size());
    assert_eq!((run.expansions.number, run.rate), (1, MOST_RATE));
    assert!(run.lists_are_due(run.tighten(false)));
    // Eleven more that gain as much reach the target.
    jam(&mut run, 0.991);
    assert_eq!((run.limit_reached(&of), run.expansions.number), (None, 2));
    jam(&mut run, 0.9905);
    assert_eq!((run.limit_reached(&of), run.expansions.number), (Some(GrowthEnd::Stalled), 2));
}

#[test]
fn a_packing_that_jams_far_below_its_target_or_at_its_largest_gap_ends() {
    let shapes = shapes();
    let of = method(&shapes);
    assert_eq!(jammed(&of, 1.0 - 1.1 * NEAR_TARGET).limit_reached(&of), Some(GrowthEnd::Stalled));
    let mut run = jammed(&of, 0.99);
    run.stage = Stage::Gap;
    run.mark = (run.size(), 0);
    assert_eq!(run.limit_reached(&of), Some(GrowthEnd::Stalled));
}

#[test]
fn a_checkpoint_has_the_expansions() {
    let shapes = shapes();
    let of = method(&shapes);
    let mut run = jammed(&of, 0.99);
    assert_eq!(run.limit_reached(&of), None);
    let mut body = Vec::new();
    run.write(&mut body).unwrap();
    let read = Run::read(&of, &body, Instant::now()).unwrap();
    assert_eq!(read.expansions, run.expansions);
    assert_eq!(
        (read.expansions.number, read.system.frame.stretch, read.mark),
        (1, run.system.frame.stretch, run.mark)
    );
}

/// Two octahedra at this size, which have grown by this share since the mark, so many cycles ago.
fn angular<'a>(
    of: &MonteCarlo<'_, ScaledPolyhedron<'a>>,
    size: f64,
    growth: f64,
) -> Run<ScaledPolyhedron<'a>> {
    let poses = [5.0, 14.0].map(|x| Pose::at(Vector3::new(x, 10.0, 10.0)));
    let mut run = Run::new(of, poses.to_vec(), size, Instant::now()).unwrap();
    grown(&mut run, growth, STALL_CYCLES);
    run
}

/// The run has grown by this share in so many cycles.
fn grown<S: ConvexShape>(run: &mut Run<S>, growth: f64, cycles: u64) {
    run.mark = (run.size() / (1.0 + growth), run.counted.compression_cycles);
    run.counted.compression_cycles += cycles;
}

#[test]
fn grains_are_pushed_hard_until_that_brings_them_no_further() {
    let template = PlatonicSolid::Octahedron.body().unwrap().normalized();
    let shapes = [3.0, 2.0].map(|scale_mm| ScaledPolyhedron { template: &template, scale_mm });
    let of = method(&shapes);
    let mut run = angular(&of, 0.9, 1e-4);
    assert_eq!((run.limit_reached(&of), run.pushes), (None, Pushes::Hard));
    grown(&mut run, 0.0, STALL_CYCLES);
    assert_eq!((run.limit_reached(&of), run.pushes), (None, Pushes::Light));
    let mut body = Vec::new();
    run.write(&mut body).unwrap();
    assert_eq!(Run::read(&of, &body, Instant::now()).unwrap().pushes, Pushes::Light);
    grown(&mut run, 1e-4, STALL_CYCLES);
    assert_eq!((run.limit_reached(&of), run.pushes), (None, Pushes::Light));
    grown(&mut run, 0.0, STALL_CYCLES);
    assert_eq!(run.limit_reached(&of), Some(GrowthEnd::Stalled));
}

#[test]
fn spheres_alone_are_pushed_lightly() {
    let shapes = [3.0, 2.0].map(|d_mm| Sphere { d_mm });
    let of = method(&shapes);
    let poses = [5.0, 14.0].map(|x| Pose::at(Vector3::new(x, 10.0, 10.0)));
    let run = Run::new(&of, poses.to_vec(), 0.9, Instant::now()).unwrap();
    assert_eq!(run.pushes, Pushes::Light);
}

/// Lists hold for grains that stay in their skins: through moves, pushes, and swaps after both.
#[test]
fn grains_stay_in_the_skins_that_their_lists_hold_for() {
    let shapes: Vec<Ellipsoid> = (0..150)
        .map(|i| 3.0 - 0.012 * f64::from(i))
        .map(|a| Ellipsoid::new([a, 0.8 * a, 0.6 * a]).unwrap())
        .collect();
    for seed in 1..5 {
        let of = MonteCarlo { seed, ..method(&shapes) };
        let packed = of.run(None, &Unattended).unwrap();
        // Once more, from grains of less size at the same places.
        let mut run = Run::new(&of, packed.placed, 0.85, Instant::now()).unwrap();
        let mut most = 0.0_f64;
        while !run.is_full_size() && run.counted.compression_cycles < 1000 {
            let by = run.tighten(false);
            if run.lists_are_due(by) {
                run.build_lists().unwrap();
            }
            assert!(run.cycle(&of, by, &Unattended).unwrap());
            let all = run.system.part();
            for i in all.hot.range() {
                let (hot, cold) = (&all.hot[i], &all.cold[i]);
                most = most.max(all.skin_used(i, hot.center, cold.orientation) / cold.skin);
            }
        }
        assert!(run.is_full_size() && run.counted().swaps_accepted > 1000);
        // Where a cycle is undone in part, all places move apart, those of the lists as well.
        assert!(most < 1.0 + MOST_RATE, "{most} of a skin are used");
    }
}
