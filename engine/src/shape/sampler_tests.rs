#![allow(clippy::unwrap_used)]

use super::super::ratios::{DEFAULT_TARGET_ELONGATION, RatioDistribution, RatioLaw};
use super::super::{CaliperSizes, Ellipsoid, flakiness_index, shape_index};
use super::*;
use crate::rng::{Stream, stream};

/// No grading: half of the mass is finer than any sieve.
fn any(_: f64) -> f64 {
    0.5
}

/// Uniform in `ln d` from 4 to 8 mm.
fn from_4_to_8(d: f64) -> f64 {
    ((d / 4.0).ln() / 2.0_f64.ln()).clamp(0.0, 1.0)
}

fn uniform_law(min: f64, max: f64) -> RatioLaw {
    RatioLaw::Distributed(RatioDistribution::Uniform { min, max })
}

fn beta_law(mean: f64, standard_deviation: f64) -> RatioLaw {
    RatioLaw::Distributed(RatioDistribution::Beta { mean, standard_deviation })
}

fn laws() -> Vec<AxisRatios> {
    let table = RatioDistribution::Table { values: vec![0.5, 0.7, 1.0], weights: vec![1.0, 2.0, 1.0] };
    vec![
        AxisRatios::Constant { elongation: 0.8, flatness: 1.0 / 1.2 },
        AxisRatios::Independent { elongation: uniform_law(0.3, 0.9), flatness: uniform_law(0.4, 1.0) },
        AxisRatios::Independent { elongation: beta_law(0.7, 0.1), flatness: beta_law(0.5, 0.15) },
        AxisRatios::Independent { elongation: beta_law(0.4, 0.15), flatness: beta_law(0.3, 0.15) },
        AxisRatios::Independent {
            elongation: RatioLaw::Distributed(table),
            flatness: RatioLaw::Constant(0.6),
        },
        AxisRatios::Triangle { k: 0.2 },
        AxisRatios::Measured { axes: vec![[7.0, 6.0, 3.0], [1.0, 2.0, 1.5]], weights: vec![1.0, 3.0] },
        AxisRatios::Flakiness { index: 0.2, elongation: DEFAULT_TARGET_ELONGATION },
        AxisRatios::ShapeIndex { index: 0.2, elongation: DEFAULT_TARGET_ELONGATION },
    ]
}

#[test]
fn the_mean_volume_is_that_of_the_forms_drawn() {
    let n = 100_000;
    for ratios in laws() {
        let sampler = RatioSampler::new(&ratios, SizeMeasure::Sieve, &any).unwrap();
        let mut rng = stream(3, Stream::Sampling);
        let volumes: Vec<f64> = (0..n).map(|_| sampler.draw(&mut rng).volume_over_sieve_sphere()).collect();
        let mean = volumes.iter().sum::<f64>() / f64::from(n);
        let variance = volumes.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / f64::from(n);
        let error = (mean - sampler.mean_volume_ratio()).abs();
        assert!(error < 4.0 * (variance / f64::from(n)).sqrt() + 1e-9, "{ratios:?}: {error}");
        let least = volumes.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least >= sampler.least_volume_ratio() - 1e-12, "{ratios:?}: {least}");
        let by_volume = RatioSampler::new(&ratios, SizeMeasure::Equivalent, &any).unwrap();
        assert_eq!((by_volume.mean_volume_ratio(), by_volume.least_volume_ratio()), (1.0, 1.0));
    }
    let known = RatioSampler::new(&laws()[0], SizeMeasure::Sieve, &any).unwrap().mean_volume_ratio();
    assert!((known - 1.336).abs() < 1e-3, "{known}");
}

#[test]
fn forms_are_drawn_in_their_bounds_and_the_same_for_the_same_seed() {
    for ratios in laws() {
        let sampler = RatioSampler::new(&ratios, SizeMeasure::Sieve, &any).unwrap();
        let draw = || {
            let mut rng = stream(5, Stream::Sampling);
            (0..10_000).map(|_| sampler.draw(&mut rng)).collect::<Vec<Form>>()
        };
        let forms = draw();
        assert_eq!(forms, draw());
        for form in forms {
            let in_bounds = |ratio: f64| (MIN_RATIO * (1.0 - 1e-12)..=1.0).contains(&ratio);
            assert!(in_bounds(form.elongation) && in_bounds(form.flatness), "{ratios:?}: {form:?}");
            assert!(in_bounds(form.elongation * form.flatness), "{ratios:?}: {form:?}");
        }
    }
}

#[test]
fn the_triangle_has_its_means() {
    let sampler = RatioSampler::new(&AxisRatios::Triangle { k: 0.2 }, SizeMeasure::Sieve, &any).unwrap();
    let mut rng = stream(5, Stream::Sampling);
    let (n, mut b, mut c) = (200_000, 0.0, 0.0);
    for _ in 0..n {
        let form = sampler.draw(&mut rng);
        b += form.elongation / f64::from(n);
        c += form.elongation * form.flatness / f64::from(n);
    }
    assert!((b - 2.2 / 3.0).abs() < 2e-3 && (c - 1.4 / 3.0).abs() < 2e-3, "{b} {c}");
}

/// 1e5 grains from 4 to 8 mm with equal masses in narrow classes.
fn grains(ratios: &AxisRatios, measure: SizeMeasure) -> Vec<Ellipsoid> {
    let sampler = RatioSampler::new(ratios, measure, &from_4_to_8).unwrap();
    let mut rng = stream(9, Stream::Sampling);
    let edge = |i: i32| 4.0 * 2.0_f64.powf(f64::from(i) / 24.0);
    let volume = 2.0e7 / 24.0;
    let mut grains = Vec::new();
    for i in 0..24 {
        let (low, high) = (edge(i), edge(i + 1));
        let mut filled = 0.0;
        while filled < volume {
            let u = uniform(&mut rng);
            let cubes = high.powi(3) * (1.0 - u) + low.powi(3) * u;
            let size = low * high / libm::cbrt(cubes);
            grains.push(measure.ellipsoid(size.clamp(low, high), sampler.draw(&mut rng)));
            filled += grains[grains.len() - 1].volume_mm3();
        }
    }
    assert!(grains.len() > 100_000, "{}", grains.len());
    grains
}

#[test]
fn grains_have_the_indices_asked_for() {
    for index in [0.0, 0.05, 0.15, 0.2, 0.5, 0.8, 1.0] {
        for elongation in [DEFAULT_TARGET_ELONGATION, RatioLaw::Constant(1.0), uniform_law(0.4, 0.6)] {
            let ratios = AxisRatios::Flakiness { index, elongation: elongation.clone() };
            let found =
                flakiness_index(grains(&ratios, SizeMeasure::Sieve).iter().map(CaliperSizes::from)).unwrap();
            assert!((found - index).abs() < 0.005, "{ratios:?}: {found}");
            let ratios = AxisRatios::ShapeIndex { index, elongation };
            let found =
                shape_index(grains(&ratios, SizeMeasure::Sieve).iter().map(CaliperSizes::from)).unwrap();
            assert!((found - index).abs() < 0.005, "{ratios:?}: {found}");
        }
    }
}

#[test]
fn grains_by_equivalent_diameter_come_near_the_indices() {
    for index in [0.1, 0.3, 0.6] {
        let elongation = DEFAULT_TARGET_ELONGATION;
        let ratios = AxisRatios::Flakiness { index, elongation: elongation.clone() };
        let found =
            flakiness_index(grains(&ratios, SizeMeasure::Equivalent).iter().map(CaliperSizes::from)).unwrap();
        assert!((found - index).abs() < 0.05, "{ratios:?}: {found}");
        let ratios = AxisRatios::ShapeIndex { index, elongation };
        let found =
            shape_index(grains(&ratios, SizeMeasure::Equivalent).iter().map(CaliperSizes::from)).unwrap();
        assert!((found - index).abs() < 0.05, "{ratios:?}: {found}");
    }
}

#[test]
fn a_flakiness_without_a_grading_is_that_of_the_closed_form() {
    use super::super::target::flaky_share;
    assert!((flaky_share(0.378, &any) - 1.0).abs() < 2e-3);
    assert_eq!(flaky_share(0.3, &any), 1.0);
    assert_eq!(flaky_share(0.494, &any), 0.0);
    let closed = flaky_share(0.43, &any);
    let of_fractions = flaky_share(0.43, &|d| (d / 4.0).ln() / 25.0_f64.ln());
    assert!((closed - of_fractions).abs() < 0.05, "{closed} {of_fractions}");
}

#[test]
fn every_fault_names_field_value_and_bound() {
    let faults = |ratios: AxisRatios| {
        let faults = RatioSampler::new(&ratios, SizeMeasure::Sieve, &any).unwrap_err();
        faults.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let table = |values: Vec<f64>, weights: Vec<f64>| {
        RatioLaw::Distributed(RatioDistribution::Table { values, weights })
    };
    let independent = |elongation, flatness| AxisRatios::Independent { elongation, flatness };
    let one = || RatioLaw::Constant(1.0);
    let cases = [
        (
            AxisRatios::Constant { elongation: 0.05, flatness: 2.0 },
            vec![
                "/elongation: 0.05 is out of range: must be at least 0.1 and at most 1",
                "/flatness: 2 is out of range: must be at least 0.1 and at most 1",
            ],
        ),
        (
            AxisRatios::Constant { elongation: 0.2, flatness: 0.2 },
            vec![": the smallest elongation times flatness, c/a, is 0.0400: must be at least 0.1"],
        ),
        (
            independent(uniform_law(0.8, 0.5), one()),
            vec!["/elongation/min: 0.8 is out of range: must be at most max 0.5"],
        ),
        (
            independent(one(), beta_law(0.5, 0.4)),
            vec![
                "/flatness/standard_deviation: 0.4 is out of range: must be at least 0.001 and at most 0.3535",
            ],
        ),
        (
            independent(one(), beta_law(f64::NAN, 0.1)),
            vec!["/flatness/mean: NaN is out of range: must be at least 0.15 and at most 0.99"],
        ),
        (
            independent(table(vec![0.5, 1.5], vec![1.0]), one()),
            vec![
                "/elongation/values/1: 1.5 is out of range: must be at least 0.1 and at most 1",
                "/elongation/weights: has 1 weights for 2 values: must have as many",
            ],
        ),
        (
            independent(table(vec![], vec![]), table(vec![0.5], vec![0.0])),
            vec![
                "/elongation/values: has 0 values: must have at least 1",
                "/flatness/weights: the weights sum to 0: one at least must be greater",
            ],
        ),
        (AxisRatios::Triangle { k: 0.0 }, vec!["/k: 0 is out of range: must be at least 0.1 and at most 1"]),
        (
            AxisRatios::Measured {
                axes: vec![[1.0, 2.0, 3.0], [1.0, -2.0, 3.0], [20.0, 2.0, 1.0]],
                weights: vec![],
            },
            vec![
                "/axes/1: [1.0, -2.0, 3.0] is out of range: axes must be positive and at most 1e6",
                "/axes/2: [20.0, 2.0, 1.0] has c/a = 0.0500: must be at least 0.1",
            ],
        ),
        (
            AxisRatios::Flakiness { index: 1.5, elongation: RatioLaw::Constant(0.3) },
            vec![
                "/index: 1.5 is out of range: must be at least 0 and at most 1",
                "/elongation: 0.3 is out of range: must be at least 0.4 and at most 1",
            ],
        ),
    ];
    for (ratios, known) in cases {
        assert_eq!(faults(ratios), known);
    }
}
