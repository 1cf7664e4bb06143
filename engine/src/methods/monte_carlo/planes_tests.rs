//! Planes keep the gap between neighbours whatever their rounding, and lists name each other's places.

use nalgebra::Vector3;
use proptest::prelude::*;
use rand_xoshiro::rand_core::SeedableRng as _;

use super::super::group::{LONGEST, NO_NEIGHBOR, SHORTEST};
use super::super::halves::Halves;
use super::super::lists::Lists;
use super::super::system::System;
use super::*;
use crate::distance::DistanceRule;
use crate::mix::uniform_orientation;
use crate::properties::properties;
use crate::request::{Boundary, Distance, Specimen};
use crate::rng::uniform;
use crate::shape::{Ellipsoid, Pose};

/// Ellipsoids anywhere in a box, some of them in one another, with their lists; every second time in eight leaves.
fn system(seed: u64, is_periodic: bool) -> System<Ellipsoid> {
    let rng = &mut rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
    let boundary = if is_periodic { Boundary::Periodic } else { Boundary::Walls };
    let specimen = Specimen::Box { size_mm: [20.0, 16.0, 12.0], boundary };
    let distance = Distance::Proportional { factor: 0.1, wall_gap_mm: None };
    let (mut shapes, mut poses) = (Vec::new(), Vec::new());
    for _ in 0..40 {
        let a = 0.5 + 2.5 * uniform(rng);
        shapes.push(Ellipsoid::new([a, (0.6 + 0.4 * uniform(rng)) * a, 0.6 * a]).unwrap());
        let center_mm = Vector3::from_fn(|axis, _| specimen.bounds_mm()[axis] * uniform(rng));
        poses.push(Pose { center_mm, orientation: uniform_orientation(rng) });
    }
    let rule = DistanceRule::new(&distance, &specimen);
    let mut system = System::new(&specimen.domain(), rule, &shapes, poses).unwrap();
    if seed.is_multiple_of(2) {
        system.halves = Halves::with_least(shapes.len(), 5);
    }
    system.cold.iter_mut().for_each(|cold| cold.skin = 0.3);
    Lists::default().build(&mut system, 0.98, 0.05).unwrap();
    system
}

/// Holds every plane against that of its neighbour, or the wall; returns by how much two planes are farther apart than
/// their gap at most, in mm, and whether a pair that keeps its gap along its normal always crosses its planes.
fn held(system: &mut System<Ellipsoid>) -> (f64, bool) {
    let (mut widest, mut is_open) = (0.0_f64, false);
    let system = system.part();
    for i in system.hot.range() {
        let cold = &system.cold[i];
        let groups = cold.list.groups();
        for (group, lane) in groups.flat_map(|group| (0..LANES).map(move |lane| (group, lane))) {
            let planes = &system.groups[group];
            let (neighbor, n) = (planes.neighbors[lane], planes.normal(lane));
            if neighbor == NO_NEIGHBOR {
                continue;
            }
            let offset = f64::from(planes.offsets[lane]) + dot(cold.listed_center, n);
            if is_wall(neighbor) {
                assert!(offset <= UNIT * system.frame.wall_plane(neighbor - WALL, system.hot[i].d).1 + 1e-9);
                continue;
            }
            let (j, image) = system.frame.names.read(neighbor);
            let place = system.place_of(j, system.frame.names.name(i, system.frame.names.opposite(image)));
            assert_eq!(u32::from(planes.mirrors[lane]), place);
            let (there, other) = (place as usize, &system.cold[j]);
            let mirror = &system.groups[other.list.first as usize + there / LANES];
            assert_eq!(mirror.normal(there % LANES), n.each(|c| -c));
            if planes.offsets[lane] < -1e29 {
                assert!(mirror.offsets[there % LANES] < -1e29);
                let r = minus(sum(system.hot[j].center, system.frame.shift(image)), system.hot[i].center);
                let gap = system.frame.gap(system.hot[i].d, system.hot[j].d);
                is_open |=
                    along(&system.hot[i], &system.hot[j], r, gap, planes.stored_normal(lane)).slack >= 0.0;
                continue;
            }
            // Across the two planes, seen from this grain.
            let other_offset = f64::from(mirror.offsets[there % LANES]) - dot(other.listed_center, n);
            let apart = dot(system.frame.shift(image), n) - offset - other_offset;
            let more = apart / norm(n) - system.frame.gap(system.hot[i].d, system.hot[j].d);
            assert!(more >= -1e-12, "{more} mm");
            widest = widest.max(more);
        }
    }
    (widest, is_open)
}

properties! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn neighbours_between_their_planes_keep_their_gaps(seed in any::<u64>(), is_periodic in any::<bool>()) {
        let mut system = system(seed, is_periodic);
        prop_assert!(system.groups.iter().flat_map(|group| group.neighbors).any(|neighbor| neighbor < WALL));
        // Single precision rounds lengths of 10 mm by 1e-6 mm.
        let (widest, is_open) = held(&mut system);
        prop_assert!(widest < 3e-6 && !is_open);
        for factor in [0.99, 1.004, 0.999] {
            system.scale(factor);
            held(&mut system);
        }
        for by in [0.03, -0.04, 0.02] {
            system.widen_gaps(by);
            held(&mut system);
        }
    }

    #[test]
    fn grains_have_their_neighbours_in_the_ranges_that_they_belong_to(seed in any::<u64>()) {
        let system = system(seed & !1, false);
        let leaf = |site: usize| system.halves.leaves() + system.halves.leaf_of(site);
        let mut seen = [0, 0];
        for (i, cold) in system.cold.iter().enumerate() {
            let range = system.halves.range_of(i);
            let groups = &system.groups[cold.list.groups()];
            let neighbors = groups.iter().flat_map(|group| group.neighbors).filter(|&neighbor| neighbor < WALL);
            let sites = neighbors.map(|neighbor| system.frame.names.read(neighbor).0).chain([i]);
            // A number and those that it came from by halving.
            let is_within = |site: usize, range: usize| (0..4).any(|level| leaf(site) >> level == range);
            let halves = [2 * range, 2 * range + 1];
            let mut reached = [false; 2];
            for site in sites {
                prop_assert!(is_within(site, range));
                for (reached, half) in reached.iter_mut().zip(halves) {
                    *reached |= is_within(site, half);
                }
            }
            let is_leaf = range >= system.halves.leaves();
            prop_assert!(is_leaf || reached == [true; 2], "a smaller range has them all");
            seen[usize::from(is_leaf)] += 1;
        }
        prop_assert_eq!(seen[0] + seen[1], system.len());
    }

    #[test]
    fn all_planes_that_are_crossed_are_laid_anew(seed in any::<u64>(), is_periodic in any::<bool>()) {
        let mut system = system(seed, is_periodic);
        for group in &mut system.groups {
            for lane in (0..LANES).filter(|&lane| group.neighbors[lane] < WALL) {
                // Every grain crosses it, wherever it is in its skin.
                group.offsets[lane] = below(f64::from(group.offsets[lane]) - 100.0 * UNIT);
            }
        }
        // Some grains lie in one another.
        prop_assert!(!system.is_clear());
        let (widest, is_open) = held(&mut system);
        prop_assert!(widest < 3e-6 && !is_open);
    }

    #[test]
    fn normals_and_offsets_are_rounded_as_planes_need_it(seed in any::<u64>(), offset in -1e7..1e7_f64) {
        let rng = &mut rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
        let n: Vector = (uniform_orientation(rng) * Vector3::x()).into();
        let rounded = normal(n).each(f64::from);
        prop_assert!((SHORTEST..=LONGEST).contains(&norm(rounded)));
        prop_assert!(minus(rounded, scaled(n, UNIT)).iter().all(|c| c.abs() <= 0.5));
        let below = f64::from(below(offset));
        prop_assert!(below <= offset && offset - below <= 1.3e-7 * offset.abs());
    }
}

#[test]
fn pairs_whose_gap_the_rounded_normal_does_not_show_are_always_decided() {
    let specimen = Specimen::Box { size_mm: [20.0; 3], boundary: Boundary::Walls };
    let none = Distance::None { wall_gap_mm: None };
    let rng = &mut rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(1);
    for _ in 0..50 {
        let n = uniform_orientation(rng) * Vector3::x();
        let poses = [Vector3::repeat(10.0), Vector3::repeat(10.0) + n * (2.0 + 1e-13)];
        let poses = poses.map(|center_mm| Pose { center_mm, orientation: uniform_orientation(rng) });
        let sphere = Ellipsoid::new([1.0; 3]).unwrap();
        let rule = DistanceRule::new(&none, &specimen);
        let mut system = System::new(&specimen.domain(), rule, &[sphere; 2], poses.to_vec()).unwrap();
        system.cold.iter_mut().for_each(|cold| cold.skin = 0.3);
        Lists::default().build(&mut system, 1.0, 0.0).unwrap();
        assert!(system.is_clear());
        for i in 0..2 {
            let group = &system.groups[system.cold[i].list.first as usize];
            let along = dot(group.unit(0), n.into()).abs();
            // A direction that is exact shows the gap.
            assert!(group.offsets[0] == -NEVER || 1.0 - along < 1e-13, "{:?}", group.offsets);
        }
    }
}

#[test]
fn a_place_beyond_sixteen_bits_is_looked_for() {
    let mut group = Group::EMPTY;
    group.enter(0, 7, 65_534);
    group.enter(1, 8, 65_535);
    group.enter(2, 9, 70_000);
    assert_eq!(group.mirrors, [65_534, FAR, FAR, FAR]);
    let mut system = system(1, true);
    let found = |system: &mut System<Ellipsoid>| -> Vec<u32> {
        let system = &system.part();
        let pairs =
            system.hot.range().flat_map(|i| system.cold[i].list.groups().map(move |group| (i, group)));
        pairs
            .filter_map(|(i, group)| {
                let is_pair = system.groups[group].neighbors[0] < WALL;
                is_pair.then(|| system.decide(i, &system.hot[i], group, 0))
            })
            .filter_map(|decided| match decided {
                Decided::Apart(planes) => Some(planes.mirror),
                Decided::TooClose(_) => None,
            })
            .collect()
    };
    let named = found(&mut system);
    system.groups.iter_mut().for_each(|group| group.mirrors = [FAR; LANES]);
    assert!(named.len() > 10);
    assert_eq!(found(&mut system), named);
}
