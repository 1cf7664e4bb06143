use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::Unattended;
use crate::packing::Solids;
use crate::request::Boundary;
use crate::rng::{Stream, stream, uniform};
use crate::shape::{Ellipsoid, Pose};

const CUBE: Specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };

fn spheres(grains: &[([f64; 3], f64)]) -> Spheres {
    let mut sorted = grains.to_vec();
    sorted.sort_by(|p, q| q.1.total_cmp(&p.1));
    let mut spheres = Spheres::default();
    for (center, d) in sorted {
        spheres.push(center, d);
    }
    spheres
}

/// Grains of three sizes on a lattice of 10 x 10 x 10, dealt out at random.
fn dealt() -> Vec<([f64; 3], f64)> {
    let mut rng = stream(7, Stream::Sampling);
    (0..1000)
        .map(|i| {
            let at = [i % 10, i / 10 % 10, i / 100].map(|x| 2.0 * f64::from(x) + 1.0);
            (at, [0.8, 1.2, 1.9][(3.0 * uniform(&mut rng)) as usize])
        })
        .collect()
}

fn report(grains: &[([f64; 3], f64)], specimen: &Specimen) -> QualityReport {
    quality(&spheres(grains), specimen, &Unattended).unwrap()
}

#[test]
fn classes_are_thirds_of_the_volume() {
    let grains: Vec<([f64; 3], f64)> = (0..900).map(|i| ([10.0; 3], 1.0 + f64::from(i) / 900.0)).collect();
    let found = classes::classes(&spheres(&grains).d_mm);
    assert_eq!(found.len(), 3);
    assert_eq!(found.iter().map(|class| class.grains).sum::<u64>(), 900);
    for (i, class) in found.iter().enumerate() {
        assert!((class.volume_share - 1.0 / 3.0).abs() < 0.01, "{class:?}");
        assert_eq!(classes::class_of(&found, class.d_min_mm), i);
        assert_eq!(classes::class_of(&found, class.d_max_mm), i);
    }
    // Two sizes of which one has nearly all of the volume, and one size.
    let found = classes::classes(&[2.0, 2.0, 2.0, 0.5]);
    assert_eq!(found.iter().map(|class| class.grains).collect::<Vec<_>>(), [1, 3]);
    assert_eq!(classes::classes(&[3.0; 5]).len(), 1);
    assert_eq!(classes::classes(&[]), []);
}

/// Fine grains in the outer layer, coarse ones in the core: the profile of the walls and the blocks show both.
#[test]
fn a_packing_in_layers_shows_them() {
    let layered: Vec<([f64; 3], f64)> = dealt()
        .into_iter()
        .map(|(center, _)| {
            let is_outer = center.iter().any(|x| !(2.0..18.0).contains(x));
            (center, if is_outer { 0.8 } else { 1.9 })
        })
        .collect();
    let found = report(&layered, &CUBE);
    let walls = found.walls.as_ref().unwrap();
    let depths: Vec<f64> = walls.layers.iter().map(|layer| layer.to_mm).collect();
    assert_eq!(depths, [0.4, 0.95, 0.8 * 1.5, 1.9, 1.5 * 1.9]);
    assert!(walls.core.volume_fraction[0] == 0.0 && walls.core.volume_fraction[1] > 0.4, "{walls:?}");
    // Fine grains lie between 0.6 and 1.4 mm from the walls, coarse ones from 2.05 mm on.
    assert_eq!(walls.layers[0].volume_fraction, [0.0, 0.0]);
    assert!(walls.layers[1].volume_fraction[0] > 0.02 && walls.layers[1].volume_fraction[1] == 0.0);
    assert!(walls.layers[3].volume_fraction[0] > 0.0 && walls.layers[3].volume_fraction[1] == 0.0);
    assert_eq!(walls.layers[4].volume_fraction[0], 0.0);
    // All layers together hold the volume of the grains.
    for (class, of_class) in found.classes.iter().enumerate() {
        let layers = walls.layers.iter().chain([&walls.core]);
        let volume: f64 = layers.map(|layer| layer.volume_fraction[class] * layer.volume_mm3).sum();
        let d = of_class.d_max_mm;
        let known = of_class.grains as f64 * std::f64::consts::PI / 6.0 * d * d * d;
        assert!((volume - known).abs() < 1e-3 * known, "{volume} {known}");
    }
    let blocks = found.blocks.unwrap();
    assert_eq!((blocks.blocks, blocks.edge_mm), (1000, [2.0; 3]));
    assert!(blocks.fine_coarse_correlation.unwrap() < -0.99, "{blocks:?}");
}

#[test]
fn sizes_dealt_out_at_random_vary_as_chance_has_it() {
    // Every grain is alone in its block: the volumes are those of independent draws.
    let found = report(&dealt(), &CUBE);
    let blocks = found.blocks.unwrap();
    let is_fine = |d: f64| d <= found.classes[0].d_max_mm;
    let mut fine = Moments::default();
    for (_, d) in dealt() {
        fine.add(if is_fine(d) { crate::mix::sphere_volume(d) } else { 0.0 }, 1.0);
    }
    let known = fine.variance().sqrt() / fine.mean();
    assert!((blocks.fine_variation - known).abs() < 1e-9, "{blocks:?} {known}");
    // Poisson's law adds to that as grains that may share a block.
    assert!((1.2..1.8).contains(&(blocks.fine_variation_independent / known)), "{blocks:?}");
    assert!(blocks.fine_coarse_correlation.unwrap() < -0.5, "{blocks:?}");
    let contacts = found.contacts.unwrap();
    // The smallest gap is that of two grains of 1.9 mm; other pairs are farther.
    assert_eq!((contacts.like_share, contacts.mark_correlation), (1.0, None));
}

#[test]
fn lengths_scale_and_places_in_a_periodic_box_are_equal() {
    let periodic = |size: f64| Specimen::Box { size_mm: [size; 3], boundary: Boundary::Periodic };
    let mut rng = stream(9, Stream::Sampling);
    // Moved a little, so that gaps differ.
    let jiggled: Vec<([f64; 3], f64)> =
        dealt().into_iter().map(|(at, d)| (at.map(|x| x + 0.05 * (uniform(&mut rng) - 0.5)), d)).collect();
    let known = report(&jiggled, &periodic(20.0));
    assert!(known.walls.is_none() && known.blocks.is_some() && known.bond_order.is_some());
    let shifted: Vec<_> = jiggled
        .iter()
        .map(|(at, d)| ([at[0] + 7.3, at[1], at[2] - 3.1].map(|x: f64| x.rem_euclid(20.0)), *d))
        .collect();
    let scaled: Vec<_> = jiggled.iter().map(|(at, d)| (at.map(|x| 3.0 * x), 3.0 * d)).collect();
    let turned: Vec<_> = jiggled.iter().map(|([x, y, z], d)| ([*z, *x, *y], *d)).collect();
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(1e-3);
    for (grains, size, scale) in [(shifted, 20.0, 1.0), (scaled, 60.0, 3.0), (turned, 20.0, 1.0)] {
        let found = report(&grains, &periodic(size));
        let (a, b) = (known.gaps.unwrap(), found.gaps.unwrap());
        assert!(close(a.median_mm * scale, b.median_mm) && close(a.median_excess, b.median_excess));
        let (a, b) = (known.contacts.as_ref().unwrap(), found.contacts.as_ref().unwrap());
        assert_eq!((a.near_per_grain, a.like_share), (b.near_per_grain, b.like_share));
        let (a, b) = (known.bond_order.as_ref().unwrap(), found.bond_order.as_ref().unwrap());
        assert!(close(a.q6, b.q6), "{a:?} {b:?}");
        assert_eq!(a.share_by_coherent_bonds, b.share_by_coherent_bonds);
    }
}

#[test]
fn grains_that_are_no_spheres_have_volumes_and_no_pairs() {
    let grains = dealt();
    let shapes = grains.iter().map(|(_, d)| Ellipsoid::new([*d, *d, *d]).unwrap()).collect();
    let poses = grains.iter().map(|(center, _)| Pose::at((*center).into())).collect();
    let found = quality(&Solids::of_ellipsoids(shapes, poses), &CUBE, &Unattended).unwrap();
    let doubled: Vec<_> = grains.iter().map(|(at, d)| (*at, 2.0 * d)).collect();
    let known = report(&doubled, &CUBE);
    assert_eq!((found.gaps, found.contacts, found.bond_order), (None, None, None));
    let (a, b) = (found.walls.unwrap(), known.walls.unwrap());
    for (a, b) in a.layers.iter().zip(&b.layers) {
        for (a, b) in a.volume_fraction.iter().zip(&b.volume_fraction) {
            assert!((a - b).abs() < 1e-9);
        }
    }
}

#[test]
fn cylinders_and_packings_of_few_grains_are_measured() {
    let cylinder = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 20.0 };
    let inside: Vec<_> =
        dealt().into_iter().filter(|(at, _)| (at[0] - 10.0).hypot(at[1] - 10.0) < 9.0).collect();
    let found = report(&inside, &cylinder);
    let walls = found.walls.unwrap();
    let all: f64 = walls
        .layers
        .iter()
        .chain([&walls.core])
        .map(|layer| layer.volume_fraction.iter().sum::<f64>() * layer.volume_mm3)
        .sum();
    let known: f64 = inside.iter().map(|(_, d)| crate::mix::sphere_volume(*d)).sum();
    assert!((all - known).abs() < 1e-3 * known, "{all} {known}");
    assert!((8..1000).contains(&found.blocks.unwrap().blocks));

    let none = report(&[], &CUBE);
    assert_eq!((none.grains, none.gaps, none.walls, none.blocks), (0, None, None, None));
    let one = report(&[([10.0; 3], 5.0)], &CUBE);
    assert_eq!((one.gaps, one.contacts, one.bond_order), (None, None, None));
    assert_eq!(one.classes.len(), 1);
}

/// Progress never falls, ends at 1, and a stop is obeyed at the next look.
#[test]
fn work_is_reported_and_stopped() {
    struct Watcher {
        fractions: Mutex<Vec<f64>>,
        looks_left: AtomicUsize,
    }
    impl Control for Watcher {
        fn report(&self, progress: &Progress) {
            self.fractions.lock().unwrap().push(progress.fraction);
        }
        fn should_stop(&self) -> bool {
            let left = |looks: usize| looks.checked_sub(1);
            self.looks_left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, left).is_err()
        }
    }
    let watcher = |looks| Watcher { fractions: Mutex::default(), looks_left: AtomicUsize::new(looks) };
    let grains = spheres(&dealt());
    let patient = watcher(usize::MAX);
    let found = quality(&grains, &CUBE, &patient).unwrap();
    assert_eq!(found, quality(&grains, &CUBE, &Unattended).unwrap());
    let fractions = patient.fractions.lock().unwrap().clone();
    assert!(fractions.is_sorted() && fractions.last() == Some(&1.0), "{fractions:?}");
    for looks in 0..6 {
        assert_eq!(quality(&grains, &CUBE, &watcher(looks)), Err(QualityError::Stopped), "{looks}");
    }
}
