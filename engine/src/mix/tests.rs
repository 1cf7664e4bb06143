#![allow(clippy::unwrap_used, clippy::needless_pass_by_value)]

use crate::properties::properties;
use proptest::prelude::*;
use serde_json::json;

use super::sampling::sample;
use super::sieve::sieve_classes;
use super::*;
use crate::request::PackingRequest;
use crate::rng::{Stream, stream};

fn mix(grading: serde_json::Value, d_min: f64, fraction: f64, basis: &str) -> Mix {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [150, 150, 150]},
        "mix": {"grading": grading, "d_min_mm": d_min, "volume_fraction": fraction, "volume_fraction_of": basis},
    });
    PackingRequest::from_json(&request, 1).unwrap().mix
}

const CUBE_150: f64 = 150.0 * 150.0 * 150.0;

/// `(curve, cut-off, grains, phi_eff)` of a 150 mm cube with `phi_M` = 0.70, of `docs/method.md`, section 1
/// and the table of expected counts that came with it.
const KNOWN: [(&str, f64, f64, Option<f64>); 14] = [
    ("A16", 0.25, 6_898_165.0, Some(0.679)),
    ("A16", 0.5, 822_630.0, Some(0.644)),
    ("A16", 1.0, 215_076.0, Some(0.616)),
    ("A16", 2.0, 44_202.0, Some(0.553)),
    ("A16", 4.0, 8_603.0, Some(0.448)),
    ("B16", 0.25, 16_633_853.0, Some(0.644)),
    ("B16", 0.5, 2_052_570.0, Some(0.560)),
    ("B16", 1.0, 229_909.0, Some(0.476)),
    ("B16", 2.0, 40_049.0, Some(0.406)),
    ("B16", 4.0, 6_823.0, Some(0.308)),
    ("C16", 0.5, 2_558_221.0, None),
    ("C16", 1.0, 279_896.0, None),
    ("C16", 2.0, 33_077.0, None),
    ("C16", 4.0, 4_598.0, None),
];

/// Shares in closed form: of Fuller's curve to 20 mm with the exponent 1/2 between 5 and 15 mm, and of a curve that is
/// linear in the diameter.
#[test]
fn the_largest_diameter_and_the_law_between_sieves_have_their_shares() {
    let read = |mix: serde_json::Value| {
        let request = json!({"specimen": {"type": "box", "size_mm": [150, 150, 150]}, "mix": mix});
        GradedMix::new(&PackingRequest::from_json(&request, 1).unwrap().mix, CUBE_150)
    };
    let fuller = json!({"type": "fuller", "d_max_mm": 20, "exponent": 0.5});
    let graded = read(json!({"grading": fuller, "d_min_mm": 5, "d_max_mm": 15, "volume_fraction": 0.7}));
    let share = (15.0_f64 / 20.0).sqrt() - (5.0_f64 / 20.0).sqrt();
    assert!((graded.volume_fraction_effective - 0.7 * share).abs() < 1e-14);
    assert_eq!((graded.d_min_mm, graded.d_max_mm), (5.0, 15.0));

    let points = json!([[2, 0], [10, 0.4], [20, 1]]);
    let linear = json!({"type": "sieves", "points": points, "between": "linear"});
    let graded = read(json!({"grading": linear, "d_min_mm": 4, "d_max_mm": 16, "volume_fraction": 0.7}));
    let share = 0.4 * 6.0 / 8.0 + 0.6 * 6.0 / 10.0;
    assert!((graded.volume_fraction_effective - 0.7 * share).abs() < 1e-14);
    // The number of grains of a law F' = const between a and b is V (a^-2 - b^-2) / (2 (b - a)) / (pi/6).
    let class = graded.sieve_classes[0];
    let expected = (4.0_f64.powi(-2) - 10.0_f64.powi(-2)) / (2.0 * 6.0) / std::f64::consts::FRAC_PI_6;
    assert!((class.grains_per_volume() / expected - 1.0).abs() < 1e-12);

    let list = read(json!({"grading": {"type": "diameters", "diameters_mm": [4, 8, 16]}, "d_max_mm": 8}));
    assert_eq!(list.list, Some(vec![8.0, 4.0]));
}

#[test]
fn expected_counts_are_the_published_ones() {
    for (name, d_min, grains, effective) in KNOWN {
        let graded = GradedMix::new(
            &mix(json!({"type": "standard", "name": name}), d_min, 0.70, "all_aggregate"),
            CUBE_150,
        );
        assert!(
            (graded.expected_grains() - grains).abs() <= 0.5,
            "{name} {d_min}: {}",
            graded.expected_grains()
        );
        if let Some(effective) = effective {
            assert!((graded.volume_fraction_effective - effective).abs() < 6e-4, "{name} {d_min}");
        }
        assert!((graded.volume_fraction_mixture - 0.70).abs() < 1e-15);
    }
    let fuller = json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.5});
    let graded = GradedMix::new(&mix(fuller, 2.0, 0.70, "placed_grains"), 80.0 * 80.0 * 80.0);
    assert!((graded.expected_grains() - 9307.0).abs() < 0.5, "{}", graded.expected_grains());
}

#[test]
fn a_basis_is_the_other_through_the_cut_off() {
    let grading = || json!({"type": "standard", "name": "A16"});
    let by_mixture = GradedMix::new(&mix(grading(), 2.0, 0.70, "all_aggregate"), CUBE_150);
    let by_effective =
        GradedMix::new(&mix(grading(), 2.0, by_mixture.volume_fraction_effective, "placed_grains"), CUBE_150);
    assert!((by_effective.volume_fraction_mixture - 0.70).abs() < 1e-12);
}

#[test]
fn a_cut_off_inside_a_class_splits_it() {
    let classes = |d_min| {
        GradedMix::new(&mix(json!({"type": "standard", "name": "A16"}), d_min, 0.7, "all_aggregate"), 1.0)
            .sieve_classes
    };
    let (whole, cut) = (classes(2.0), classes(2.0_f64.sqrt() * 2.0));
    assert_eq!(whole.len(), cut.len());
    assert!((cut[0].mass_fraction - whole[0].mass_fraction / 2.0).abs() < 1e-12);
    assert_eq!(&whole[1..], &cut[1..]);
}

#[test]
fn enlarged_volumes_agree_with_direct_integration() {
    // At factor 1 and offset 0 the mean volume is the class's volume over its count.
    for grading in [
        json!({"type": "standard", "name": "B16"}),
        json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.35}),
    ] {
        let graded = GradedMix::new(&mix(grading, 0.5, 0.5, "all_aggregate"), CUBE_150);
        let volume = graded.expected_coated_volume_mm3(1.0, 0.0);
        assert!((volume / (graded.volume_fraction_effective * CUBE_150) - 1.0).abs() < 1e-9, "{volume}");
        assert!(graded.expected_coated_volume_mm3(1.0, 1.0) > volume);
    }
}

#[test]
fn drawn_numbers_scatter_around_the_expected_ones() {
    let graded =
        GradedMix::new(&mix(json!({"type": "standard", "name": "A16"}), 2.0, 0.7, "all_aggregate"), CUBE_150);
    let seeds = 8;
    let drawn: usize = (0..seeds)
        .map(|seed| sample(&graded, &mut stream(seed, Stream::Sampling), &|| false).unwrap().d_mm.len())
        .sum();
    // Given its volume, the count of a class scatters less than a Poisson number.
    let expected = graded.expected_grains() * seeds as f64;
    assert!((drawn as f64 - expected).abs() < 4.0 * expected.sqrt(), "{drawn} of {expected}");
}

#[test]
fn the_take_of_a_sieve_curve_misses_by_less_than_one_of_the_smallest_grains() {
    for name in ["A16", "B16", "C32"] {
        let volume = 100.0_f64.powi(3);
        let graded = GradedMix::new(
            &mix(json!({"type": "standard", "name": name}), 2.0, 0.6, "all_aggregate"),
            volume,
        );
        for seed in 0..20 {
            let drawn = sample(&graded, &mut stream(seed, Stream::Sampling), &|| false).unwrap().d_mm;
            let asked = graded.volume_fraction_effective * volume;
            let miss = drawn.iter().map(|&d| sphere_volume(d)).sum::<f64>() - asked;
            assert!(miss > -1e-6 && miss < sphere_volume(2.0 * 2.0_f64.powf(1.0 / 12.0)), "{name}: {miss}");
        }
    }
}

#[test]
fn drawn_diameters_follow_the_law_of_their_class() {
    for law in [Law::LogUniform, Law::Fuller { exponent: 0.5 }] {
        let class = Class { law, low_mm: 2.0, high_mm: 4.0, mass_fraction: 1.0, volume_ratio: 1.0, part: 0 };
        let mut rng = stream(7, Stream::Sampling);
        let n = 200_000;
        let drawn: Vec<f64> = (0..n).map(|_| class.diameter(crate::rng::uniform(&mut rng))).collect();
        assert!(drawn.iter().all(|&d| (2.0..=4.0).contains(&d)));
        // Mass passing 3 mm, against the law itself.
        let mass = |from: f64, to: f64| -> f64 {
            drawn.iter().filter(|&&d| d >= from && d < to).map(|&d| sphere_volume(d)).sum()
        };
        let share = mass(2.0, 3.0) / mass(2.0, 4.1);
        assert!((share - class.mass_share(2.0, 3.0)).abs() < 0.005, "{law:?} {share}");
        let mean = drawn.iter().sum::<f64>() / f64::from(n);
        assert!((mean - class.mean_of(&|d| d)).abs() < 0.01, "{law:?} {mean}");
    }
}

#[test]
fn sieve_classes_hold_the_whole_volume() {
    for grading in [
        json!({"type": "standard", "name": "C32"}),
        json!({"type": "fuller", "d_max_mm": 20, "exponent": 0.5}),
        json!({"type": "classes", "classes": [
            {"d_min_mm": 8, "d_max_mm": 16, "mass_fraction": 0.5}, {"d_min_mm": 2, "d_max_mm": 4, "mass_fraction": 0.3}]}),
        json!({"type": "monodisperse", "diameter_mm": 5}),
    ] {
        let graded = GradedMix::new(&mix(grading, 2.5, 0.4, "all_aggregate"), CUBE_150);
        let classes = sieve_classes(&graded);
        let volume: f64 = classes.iter().map(|c| c.volume_mm3).sum();
        let grains: f64 = classes.iter().map(|c| c.grains).sum();
        assert!((volume / (graded.volume_fraction_effective * CUBE_150) - 1.0).abs() < 1e-12);
        assert!((grains / graded.expected_grains() - 1.0).abs() < 1e-9);
    }
}

properties! {
    #[test]
    fn the_take_misses_by_less_than_one_grain_and_stays_in_range(
        exponent in 0.05..1.0_f64, ratio in 1.2..20.0_f64, fraction in 0.05..0.6_f64, seed in 0_u64..1000,
    ) {
        let d_max = 16.0;
        let grading = json!({"type": "fuller", "d_max_mm": d_max, "exponent": exponent});
        let volume = 60.0 * 60.0 * 60.0;
        let graded = GradedMix::new(&mix(grading, d_max / ratio, fraction, "placed_grains"), volume);
        let drawn = sample(&graded, &mut stream(seed, Stream::Sampling), &|| false).unwrap().d_mm;
        prop_assert!(drawn.windows(2).all(|pair| pair[0] >= pair[1]));
        prop_assert!(drawn.iter().all(|&d| d >= graded.d_min_mm && d <= d_max));
        let miss = drawn.iter().map(|&d| sphere_volume(d)).sum::<f64>() - fraction * volume;
        // The last grain comes from the finest of at least 12 classes per octave that still drew.
        prop_assert!(miss > -1e-6 && miss < sphere_volume(drawn[0]), "{}", miss);
        if drawn.len() > 1000 {
            prop_assert!(miss < sphere_volume(1.07 * graded.d_min_mm), "{}", miss);
        }
    }
}

properties! {
    #[test]
    fn sizes_of_a_list_keep_its_grains_and_their_volume(
        mut mm in prop::collection::vec(0.1..50.0_f64, 1..3000),
        same in 1_usize..20,
    ) {
        let first = mm[0];
        mm.extend(std::iter::repeat_n(first, same));
        let grading = json!({"type": "diameters", "diameters_mm": mm});
        let value = json!({"specimen": {"type": "box", "size_mm": [150, 150, 150]}, "mix": {"grading": grading}});
        let mix = GradedMix::new(&PackingRequest::from_json(&value, 1).unwrap().mix, CUBE_150);
        let sizes = mix.expected_sizes();
        prop_assert!(sizes.len() <= 1001 && sizes.is_sorted_by(|a, b| a.0 < b.0));
        let grains: f64 = sizes.iter().map(|(_, number)| number).sum();
        prop_assert_eq!(grains, mm.len() as f64);
        let volume: f64 = sizes.iter().map(|(d, number)| number * sphere_volume(*d)).sum();
        let expected = mix.expected_coated_volume_mm3(1.0, 0.0);
        prop_assert!((volume / expected - 1.0).abs() < 1e-9);
    }
}
