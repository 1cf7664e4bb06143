//! Against closed forms: points at random, lattices, single spheres, and sums that must come out.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use serde_json::json;

use super::*;
use crate::distance::DistanceRule;
use crate::mix::{GradedMix, sphere_volume};
use crate::packing::Spheres;
use crate::request::{Boundary, Distance, PackingRequest, Specimen};
use crate::rng::{Stream, stream, uniform};

const TOUCHING: Distance = Distance::None { wall_gap_mm: None };

fn cube(edge: f64, boundary: Boundary) -> Specimen {
    Specimen::Box { size_mm: [edge; 3], boundary }
}

/// Spheres anywhere that the walls let them, through one another.
fn ideal_gas(specimen: &Specimen, d_mm: &[f64], seed: u64) -> Spheres {
    let mut rng = stream(seed, Stream::Rsa);
    let mut spheres = Spheres::default();
    for &d in d_mm {
        let region = specimen.center_region(d / 2.0).unwrap();
        let center = loop {
            let p =
                std::array::from_fn(|a| region.low[a] + uniform(&mut rng) * (region.high[a] - region.low[a]));
            if region.contains(p) {
                break p;
            }
        };
        spheres.push(center, d);
    }
    spheres
}

fn options(upper_mm: &[f64], max_gap_mm: f64, bins: usize) -> RadialOptions<'_> {
    RadialOptions { upper_mm, min_gap_mm: 0.0, max_gap_mm, bins, max_references: 20_000 }
}

fn correlations(spheres: &Spheres, specimen: &Specimen, options: &RadialOptions<'_>) -> Vec<PairCorrelation> {
    radial(spheres, specimen, &DistanceRule::new(&TOUCHING, specimen), options).unwrap()
}

#[test]
fn points_at_random_are_not_correlated_at_any_distance_in_any_specimen() {
    let d_mm: Vec<f64> = (0..6000).map(|i| if i < 400 { 2.0 } else { 0.5 }).collect();
    for specimen in [
        cube(30.0, Boundary::Periodic),
        cube(30.0, Boundary::Walls),
        Specimen::Box { size_mm: [20.0, 30.0, 60.0], boundary: Boundary::Walls },
        Specimen::Cylinder { diameter_mm: 30.0, height_mm: 40.0 },
    ] {
        let spheres = ideal_gas(&specimen, &d_mm, 7);
        let found = correlations(&spheres, &specimen, &options(&[1.0, 2.0], 6.0, 24));
        assert_eq!(found.len(), 2);
        for class in &found {
            let mut seen = 0;
            let mut chi2 = 0.0;
            for ((&pairs, &expected), g) in class.pairs.iter().zip(&class.expected).zip(&class.correlation) {
                if expected < 50.0 {
                    continue;
                }
                seen += 1;
                // Pairs of one class are counted from both sides: twice the variance of a count.
                let error = (pairs as f64 - expected) / (2.0 * expected).sqrt();
                assert!(error.abs() < 5.0, "{specimen:?} {:?}: {pairs} instead of {expected}", class.class);
                assert!((g.unwrap() - pairs as f64 / expected).abs() < 1e-12);
                chi2 += error * error;
            }
            assert!(seen >= 18, "{specimen:?} {:?}: {seen} bins only", class.class);
            assert!(chi2 / f64::from(seen) < 2.5, "{specimen:?} {:?}: {chi2} in {seen} bins", class.class);
        }
    }
}

/// A simple cubic lattice of `n` to the third spheres.
fn lattice(n: usize, constant: f64, d: f64) -> Spheres {
    let mut spheres = Spheres::default();
    for i in 0..n * n * n {
        let at = [i % n, i / n % n, i / n / n];
        spheres.push(at.map(|k| (k as f64 + 0.5) * constant), d);
    }
    spheres
}

#[test]
fn the_shells_of_a_cubic_lattice_have_6_12_and_8_neighbours() {
    // Gaps of neighbours: 0.5, 1.62, 2.46, and from 3.5 on.
    for boundary in [Boundary::Periodic, Boundary::Walls] {
        let specimen = cube(24.0, boundary);
        let found = correlations(&lattice(8, 3.0, 2.5), &specimen, &options(&[2.5], 3.0, 30));
        let [class] = &found[..] else { panic!("{} classes", found.len()) };
        assert_eq!(class.class, SizeRange { d_min_mm: 2.5, d_max_mm: 2.5 });
        for (bin, &pairs) in class.pairs.iter().enumerate() {
            let neighbours = match bin {
                5 | 4 if pairs > 0 => 6,
                17 => 12,
                26 => 8,
                _ => 0,
            };
            if neighbours == 0 {
                assert_eq!(pairs, 0, "{boundary:?}, bin {bin}");
                continue;
            }
            assert_eq!(pairs % neighbours, 0, "{boundary:?}, bin {bin}");
            // Between walls only the inner grains see so far.
            let seen = pairs / neighbours;
            let expected = if boundary == Boundary::Periodic { 512..=512 } else { 8..=511 };
            assert!(expected.contains(&seen), "{boundary:?}, bin {bin}: {pairs} pairs");
        }
        assert_eq!(class.pairs.iter().filter(|pairs| **pairs > 0).count(), 3, "{boundary:?}");
    }
    // Expected of 511 others: the volume of a shell over that of the box.
    let specimen = cube(24.0, Boundary::Periodic);
    let class = &correlations(&lattice(8, 3.0, 2.5), &specimen, &options(&[2.5], 3.0, 1))[0];
    let shell = 4.0 * PI / 3.0 * (5.5_f64.powi(3) - 2.5_f64.powi(3));
    assert!((class.expected[0] / (512.0 * 511.0 * shell / 24.0_f64.powi(3)) - 1.0).abs() < 1e-12);
}

#[test]
fn distances_that_are_kept_show_as_an_edge() {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [40, 40, 40]},
        "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 2.0, "volume_fraction": 0.4},
        "distance": {"type": "constant", "gap_mm": 0.5}
    });
    let request = PackingRequest::from_json(&request, 3).unwrap();
    let packing = crate::pack(&request, &crate::Limits::default(), &crate::Unattended).unwrap();
    let rule = DistanceRule::new(&request.distance, &request.specimen);
    let found =
        radial(packing.spheres().unwrap(), &request.specimen, &rule, &options(&[4.0, 8.0, 16.0], 3.0, 12))
            .unwrap();
    assert!(found.len() >= 2, "{} classes", found.len());
    for class in &found {
        assert_eq!(class.pairs[..2], [0, 0], "{:?} come closer than 0.5 mm", class.class);
    }
    assert!(found[0].pairs[2] > 0 && found[0].correlation[2].unwrap() > 1.0, "{:?}", found[0].correlation);
}

#[test]
fn references_are_chosen_evenly_where_there_are_many() {
    let specimen = cube(30.0, Boundary::Periodic);
    let spheres = ideal_gas(&specimen, &vec![0.5; 5000], 1);
    let few = RadialOptions { max_references: 500, ..options(&[1.0], 4.0, 8) };
    let (few, all) = (
        correlations(&spheres, &specimen, &few).remove(0),
        correlations(&spheres, &specimen, &options(&[1.0], 4.0, 8)).remove(0),
    );
    assert_eq!((few.references, all.references), (500, 5000));
    for (few, all) in few.expected.iter().zip(&all.expected) {
        assert!((few * 10.0 / all - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_grain_alone_has_no_neighbours_and_too_little_room_shows_none() {
    for (specimen, d) in [(cube(30.0, Boundary::Periodic), 3.0), (cube(10.0, Boundary::Walls), 10.0)] {
        let mut spheres = Spheres::default();
        spheres.push([5.0; 3], d);
        for class in correlations(&spheres, &specimen, &options(&[16.0], 4.0, 8)) {
            assert_eq!(class.pairs, [0; 8]);
            assert!(class.correlation.iter().all(|g| g.is_none_or(|g| g == 0.0)), "{class:?}");
        }
    }
}

#[test]
fn one_sphere_is_cut_in_circles() {
    let specimen = Specimen::Box { size_mm: [20.0, 20.0, 20.0], boundary: Boundary::Walls };
    let mut spheres = Spheres::default();
    spheres.push([10.0, 10.0, 4.0], 6.0);
    let profiles = depth_profiles(&spheres, &specimen, 10.0, 1000).unwrap();
    let [profile] = &profiles[..] else { panic!("{} profiles", profiles.len()) };
    assert_eq!(profile.surface, Surface::Faces);
    for (&depth, &share) in profile.depth_mm.iter().zip(&profile.volume_fraction) {
        let circle = |off: f64| PI * (9.0 - off * off).max(0.0) / 400.0;
        // From z = 0 and z = 20, and from the four sides whose middle it lies in.
        let expected = (circle(depth - 4.0) + circle(depth - 16.0) + 4.0 * circle(depth - 10.0)) / 6.0;
        assert!((share - expected).abs() < 1e-12, "{depth}: {share} instead of {expected}");
    }
}

#[test]
fn profiles_add_up_to_the_volume_of_the_grains() {
    let d_mm: Vec<f64> = (0..300).map(|i| 1.0 + f64::from(i % 40) / 10.0).collect();
    let volume: f64 = d_mm.iter().map(|&d| sphere_volume(d)).sum();
    let (diameter, height) = (40.0, 60.0);
    let cylinder = Specimen::Cylinder { diameter_mm: diameter, height_mm: height };
    let spheres = ideal_gas(&cylinder, &d_mm, 5);
    let found = depth_profiles(&spheres, &cylinder, f64::INFINITY, 2000).unwrap();
    assert_eq!(found.iter().map(|p| p.surface).collect::<Vec<_>>(), [Surface::Ends, Surface::Lateral]);
    let step = |p: &DepthProfile| p.depth_mm[1] - p.depth_mm[0];
    let ends: f64 = found[0].volume_fraction.iter().sum::<f64>() * step(&found[0]) * 2.0;
    let base = PI / 4.0 * diameter * diameter;
    assert!((ends * base / volume - 1.0).abs() < 1e-4, "{} mm3 instead of {volume}", ends * base);
    let lateral = &found[1];
    let shells = lateral.depth_mm.iter().zip(&lateral.volume_fraction);
    let sum: f64 = shells.map(|(t, share)| share * 2.0 * PI * (diameter / 2.0 - t) * height).sum();
    let sum = sum * step(lateral);
    assert!((sum / volume - 1.0).abs() < 1e-3, "{sum} mm3 instead of {volume}");

    let walls = Specimen::Box { size_mm: [40.0; 3], boundary: Boundary::Walls };
    let spheres = ideal_gas(&walls, &d_mm, 6);
    let faces = &depth_profiles(&spheres, &walls, f64::INFINITY, 2000).unwrap()[0];
    let mean = faces.volume_fraction.iter().sum::<f64>() / 2000.0;
    assert!((mean * 64_000.0 / volume - 1.0).abs() < 1e-4, "{mean}");
    assert_eq!(depth_profiles(&spheres, &cube(40.0, Boundary::Periodic), 10.0, 10).unwrap(), []);
}

#[test]
fn a_sphere_far_from_the_axis_is_cut_nearly_as_by_a_plane() {
    // The arcs against an integral in ten thousand steps.
    let (radius, from_axis, r) = (50.0, 30.0, 4.0);
    let cylinder = Specimen::Cylinder { diameter_mm: 2.0 * radius, height_mm: 20.0 };
    let mut spheres = Spheres::default();
    spheres.push([radius + from_axis, radius, 10.0], 2.0 * r);
    let lateral = &depth_profiles(&spheres, &cylinder, radius, 500).unwrap()[1];
    for (&depth, &share) in lateral.depth_mm.iter().zip(&lateral.volume_fraction) {
        let at = radius - depth;
        let step = 2.0 * r / 10_000.0;
        let arc = |k: u32| {
            let t = -r + (f64::from(k) + 0.5) * step;
            let cosine = (at * at + from_axis * from_axis - (r * r - t * t)) / (2.0 * at * from_axis);
            2.0 * cosine.clamp(-1.0, 1.0).acos() * at * step
        };
        let expected = (0..10_000).map(arc).sum::<f64>() / (2.0 * PI * at * 20.0);
        assert!((share - expected).abs() < 1e-6, "{depth}: {share} instead of {expected}");
    }
}

#[test]
fn a_sphere_on_the_axis_is_cut_by_coaxial_cylinders() {
    let cylinder = Specimen::Cylinder { diameter_mm: 20.0, height_mm: 20.0 };
    let mut spheres = Spheres::default();
    spheres.push([10.0, 10.0, 10.0], 10.0);
    let lateral = &depth_profiles(&spheres, &cylinder, 10.0, 100).unwrap()[1];
    for (&depth, &share) in lateral.depth_mm.iter().zip(&lateral.volume_fraction) {
        let radius = 10.0 - depth;
        let expected = 2.0 * (25.0 - radius * radius).max(0.0).sqrt() / 20.0;
        // Here the arc is whole over the height of the cut: the one case in which equal steps err.
        assert!((share - expected).abs() < 2e-3, "{depth}: {share} instead of {expected}");
    }
}

fn mix(grading: &serde_json::Value, volume_fraction: Option<f64>, d_min: Option<f64>) -> GradedMix {
    let mut mix = json!({"grading": grading});
    if let Some(fraction) = volume_fraction {
        mix["volume_fraction"] = json!(fraction);
    }
    if let Some(d_min) = d_min {
        mix["d_min_mm"] = json!(d_min);
    }
    let request = json!({"specimen": {"type": "box", "size_mm": [100, 100, 100]}, "mix": mix});
    let request = PackingRequest::from_json(&request, 1).unwrap();
    GradedMix::new(&request.mix, request.specimen.volume_mm3())
}

fn sized(spheres: &Spheres) -> Vec<SizedGrain> {
    spheres.d_mm.iter().map(|&d_mm| SizedGrain::sphere(d_mm)).collect()
}

fn taken(mix: &GradedMix) -> Spheres {
    let d_mm = crate::mix::sampling::sample(mix, &mut stream(2, Stream::Sampling), &|| false).unwrap().d_mm;
    Spheres { d_mm, ..Spheres::default() }
}

#[test]
fn the_target_is_the_standard_and_the_grains_drawn_follow_it() {
    let mix = mix(&json!({"type": "standard", "name": "A16"}), Some(0.6), Some(2.0));
    let found = grading(sized(&taken(&mix)), &mix);
    let sieves: Vec<(f64, f64)> = found.sieves.iter().map(|p| (p.d_mm, p.target)).collect();
    for ((d, target), (expected_d, expected)) in
        sieves.iter().zip([(2.0, 0.21), (4.0, 0.36), (8.0, 0.60), (16.0, 1.0)])
    {
        assert!(*d == expected_d && (target - expected).abs() < 1e-12, "{sieves:?}");
    }
    for point in &found.curve {
        assert!((point.target - point.achieved).abs() < 0.02, "{point:?}");
    }
    let rising =
        |value: fn(&GradingPoint) -> f64| found.curve.windows(2).all(|w| value(&w[0]) <= value(&w[1]));
    assert!(rising(|p| p.d_mm) && rising(|p| p.target) && rising(|p| p.achieved));
    // Between the sieves the standard is linear in the logarithm.
    let middle = found.curve.iter().min_by_key(|p| ((p.d_mm / 32.0_f64.sqrt()).ln().abs() * 1e9) as u64);
    let middle = middle.unwrap();
    let expected = 0.36 + 0.24 * (middle.d_mm / 4.0).log2();
    assert!((middle.target - expected).abs() < 1e-12, "{middle:?}");
}

#[test]
fn equal_grains_and_lists_are_steps() {
    let equal = mix(&json!({"type": "monodisperse", "diameter_mm": 5.0}), Some(0.3), None);
    let listed = mix(&json!({"type": "diameters", "diameters_mm": [5.0, 5.0, 5.0]}), None, None);
    for mix in [equal, listed] {
        let found = grading(sized(&taken(&mix)), &mix);
        for point in &found.curve {
            let expected = if point.d_mm < 5.0 { 0.0 } else { 1.0 };
            assert!((point.target - expected).abs() < 1e-12, "{point:?}");
            assert!((point.achieved - expected).abs() < 1e-3, "{point:?}");
        }
        assert_eq!(found.sieves.len(), 1);
        assert!(found.curve.iter().any(|p| p.d_mm < 5.0) && found.curve.iter().any(|p| p.d_mm > 5.0));
    }
}
