#![allow(clippy::unwrap_used, clippy::disallowed_methods, clippy::needless_pass_by_value)]

use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};

use super::*;
use crate::mix::sampling::sample;
use crate::mix::sieve::of_law;
use crate::mix::{GradedMix, curve};
use crate::request::{Mix, PackingRequest};
use crate::rng::{Stream, stream};

const CUBE_MM3: f64 = 1.0e6;

fn mix(grading: &Value) -> Mix {
    let request = json!({
        "specimen": {"type": "box", "size_mm": [100, 100, 100]},
        "mix": {"grading": grading, "volume_fraction": 0.5},
    });
    PackingRequest::from_json(&request, 1).unwrap().mix
}

/// The error function by its series (Abramowitz and Stegun, 7.1.5), for small arguments.
fn normal_cdf(z: f64) -> f64 {
    let x = z / std::f64::consts::SQRT_2;
    let (mut term, mut sum) = (x, x);
    for n in 1..200 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    0.5 + sum / std::f64::consts::PI.sqrt()
}

/// Share of the law's own measure that is finer than a diameter, before it is cut off.
fn finer(law: &DistributionLaw, d: f64) -> f64 {
    match *law {
        DistributionLaw::Lognormal { median_mm, sigma } => normal_cdf((d / median_mm).ln() / sigma),
        DistributionLaw::Normal { mean_mm, standard_deviation_mm } => {
            normal_cdf((d - mean_mm) / standard_deviation_mm)
        }
        DistributionLaw::Weibull { scale_mm, shape } => 1.0 - (-(d / scale_mm).powf(shape)).exp(),
    }
}

fn law_of(mix: &Mix) -> Distribution {
    match mix.grading.as_ref().unwrap().form() {
        crate::request::Form::Distribution(law) => law,
        other => panic!("{other:?}"),
    }
}

fn laws(by: &str) -> [Value; 6] {
    [
        json!({"type": "lognormal", "median_mm": 6, "sigma": 0.3, "by": by}),
        json!({"type": "lognormal", "median_mm": 4, "sigma": 0.6, "by": by, "d_min_mm": 1.5, "d_max_mm": 12}),
        json!({"type": "normal", "mean_mm": 6, "standard_deviation_mm": 1, "by": by}),
        json!({"type": "normal", "mean_mm": 5, "standard_deviation_mm": 4, "by": by, "d_min_mm": 2, "d_max_mm": 9}),
        json!({"type": "weibull", "scale_mm": 6, "shape": 4, "by": by}),
        json!({"type": "weibull", "scale_mm": 5, "shape": 0.9, "by": by, "d_min_mm": 2, "d_max_mm": 11}),
    ]
}

#[test]
fn shares_of_the_mass_are_those_of_the_laws_in_closed_form() {
    for grading in laws("mass") {
        let law = law_of(&mix(&grading));
        let (low, high) = (law.d_min_mm, law.d_max_mm);
        let all = finer(&law.law, high) - finer(&law.law, low);
        let whole = mass(&law, low, high);
        for i in 1..40 {
            let d = low + (high - low) * f64::from(i) / 40.0;
            let share = (finer(&law.law, d) - finer(&law.law, low)) / all;
            let found = mass(&law, low, d) / whole;
            assert!((found - share).abs() < 1e-9, "{grading} at {d}: {found} for {share}");
        }
    }
}

/// Bounds far from the middle, and cut-offs in a tail: what passes a diameter, as it is drawn, misses the law by less
/// than 2e-4 of what lies between the bounds, and the parts have the mass of the whole.
#[test]
fn tails_are_divided_as_finely_as_they_fall() {
    for grading in [
        json!({"type": "lognormal", "median_mm": 4, "sigma": 0.05, "d_min_mm": 5, "d_max_mm": 8.2}),
        json!({"type": "lognormal", "median_mm": 12, "sigma": 0.1, "d_min_mm": 2, "d_max_mm": 8.1}),
        json!({"type": "normal", "mean_mm": 6, "standard_deviation_mm": 0.5, "d_min_mm": 7.9, "d_max_mm": 9}),
        json!({"type": "weibull", "scale_mm": 4, "shape": 2, "d_min_mm": 7.5, "d_max_mm": 16}),
        json!({"type": "weibull", "scale_mm": 6, "shape": 40, "d_min_mm": 6.2, "d_max_mm": 8.5}),
    ] {
        let law = law_of(&mix(&grading));
        let (low, high) = (law.d_min_mm, law.d_max_mm);
        let parts = of_law(&law, 0.0);
        let whole: f64 = parts.iter().map(|class| class.mass_fraction).sum();
        assert!((whole - 1.0).abs() < 1e-9, "{grading}: {whole}");
        let drawn = curve(&mix(&grading));
        assert_eq!((drawn[0], drawn[drawn.len() - 1]), ([low, 0.0], [high, 1.0]), "{grading}");
        // A sum of many small parts is the integral, whatever the intervals are.
        let steps = 200_000;
        let edge = |i: usize| low * (high / low).powf(i as f64 / f64::from(steps));
        let density = |d: f64| (ln_density(&law, d) - ln_density(&law, law.mode_mm())).exp();
        let masses: Vec<f64> = (0..steps as usize).map(|i| density((edge(i) * edge(i + 1)).sqrt())).collect();
        let all: f64 = masses.iter().sum();
        let (mut passed, mut next) = (0.0, 1);
        for (i, mass) in masses.iter().enumerate() {
            passed += mass / all;
            let d = edge(i + 1);
            while next + 1 < drawn.len() && drawn[next][0] < d {
                next += 1;
            }
            let ([a, below], [b, above]) = (drawn[next - 1], drawn[next]);
            let on_line = below + (above - below) * (d / a).ln() / (b / a).ln();
            assert!((on_line - passed).abs() < 3e-4, "{grading} at {d}: {on_line} for {passed}");
        }
    }
}

/// By number, a lognormal law with the median `m` is one by mass with the median `m exp(3 sigma^2)`.
#[test]
fn a_lognormal_law_by_number_is_one_by_mass_with_another_median() {
    let bounds = (2.0, 20.0);
    let law = |by, median_mm: f64| Distribution {
        law: DistributionLaw::Lognormal { median_mm, sigma: 0.4 },
        by,
        d_min_mm: bounds.0,
        d_max_mm: bounds.1,
    };
    let (number, weight) =
        (law(crate::request::By::Number, 5.0), law(crate::request::By::Mass, 5.0 * (3.0_f64 * 0.16).exp()));
    for d in [2.5, 4.0, 7.0, 11.0, 19.0] {
        let share = |of: &Distribution| mass(of, bounds.0, d) / mass(of, bounds.0, bounds.1);
        assert!((share(&number) - share(&weight)).abs() < 1e-10, "{d}");
    }
}

/// Kolmogorov-Smirnov of the diameters by number, and their mean and standard deviation.
#[test]
fn numbers_of_grains_follow_their_law() {
    for grading in laws("number") {
        let requested = mix(&grading);
        let law = law_of(&requested);
        let graded = GradedMix::new(&requested, 40.0 * CUBE_MM3);
        let mut rng: Xoshiro256PlusPlus = stream(7, Stream::Sampling);
        let mut diameters = sample(&graded, &mut rng, &|| false).unwrap().d_mm;
        diameters.reverse();
        let n = diameters.len() as f64;
        assert!(n > 20_000.0, "{grading}: {n}");
        let (low, high) = (law.d_min_mm, law.d_max_mm);
        let all = finer(&law.law, high) - finer(&law.law, low);
        let cdf = |d: f64| (finer(&law.law, d) - finer(&law.law, low)) / all;
        let farthest = diameters.iter().enumerate().map(|(i, &d)| (cdf(d) - i as f64 / n).abs());
        let farthest = farthest.fold(0.0_f64, f64::max);
        assert!(farthest < 1.63 / n.sqrt() + 1e-3, "{grading}: {farthest} of {n} grains");

        // Moments of the law by the midpoint rule.
        let steps = 20_000;
        let (mut mean, mut square) = (0.0, 0.0);
        for i in 0..steps {
            let edge = |i: i32| low + (high - low) * f64::from(i) / f64::from(steps);
            let (d, share) = (0.5 * (edge(i) + edge(i + 1)), cdf(edge(i + 1)) - cdf(edge(i)));
            mean += d * share;
            square += d * d * share;
        }
        let found = diameters.iter().sum::<f64>() / n;
        let found_square = diameters.iter().map(|d| d * d).sum::<f64>() / n;
        assert!((found / mean - 1.0).abs() < 0.01, "{grading}: {found} for {mean}");
        assert!((found_square / square - 1.0).abs() < 0.01, "{grading}: {found_square} for {square}");
    }
}

/// A class of a law and its narrow classes say the same of the numbers of grains.
#[test]
fn a_class_is_the_sum_of_its_narrow_classes() {
    let law = law_of(&mix(&laws("number")[0]));
    for class in of_law(&law, 0.0) {
        let narrow = class.narrow();
        let summed: f64 = narrow.iter().map(|part| part.mass_fraction).sum();
        assert!((summed / class.mass_fraction - 1.0).abs() < 1e-12);
        assert_eq!((narrow[0].low_mm, narrow[narrow.len() - 1].high_mm), (class.low_mm, class.high_mm));
        let middle = class.diameter(0.5);
        assert!(class.low_mm < middle && middle < class.high_mm, "{middle}");
        let (finer, all) = narrow.iter().fold((0.0, 0.0), |(finer, all), part| {
            let grains = part.mass_fraction * part.grains_per_volume();
            (if part.high_mm <= middle { finer + grains } else { finer }, all + grains)
        });
        assert!((finer / all - 0.5).abs() < 0.1, "{finer} of {all}");
        assert!((class.mean_of(&|_| 1.0) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn the_curve_of_a_mix_is_that_of_its_grading() {
    let at = |grading: Value, d: f64| {
        let points = curve(&mix(&grading));
        let next = points.iter().position(|point| point[0] >= d).unwrap();
        let ([a, below], [b, above]) = (points[next - 1], points[next]);
        below + (above - below) * (d / a).ln() / (b / a).ln()
    };
    let fuller = at(json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.5}), 4.0);
    assert!((fuller - 0.5).abs() < 1e-3, "{fuller}");
    let andreasen = json!({"type": "andreasen", "d_min_mm": 1, "d_max_mm": 16, "exponent": 0.5});
    assert!((at(andreasen, 4.0) - 1.0 / 3.0).abs() < 1e-3);
    let bolomey = at(json!({"type": "bolomey", "d_max_mm": 16, "a_percent": 10}), 4.0);
    assert!((bolomey - 0.55).abs() < 1e-3, "{bolomey}");
    // At D / 2 of 20 mm, 50 - sqrt(20) + 2 %; the middle between 5 and 45 mm is 15 mm.
    let dreux = at(json!({"type": "dreux_gorisse", "d_max_mm": 20, "k_percent": 2}), 10.0);
    assert!((dreux - (0.52 - 0.2 * 5.0_f64.sqrt() / 10.0)).abs() < 1e-12, "{dreux}");
    let dreux = at(json!({"type": "dreux_gorisse", "d_max_mm": 45, "k_percent": 0}), 15.0);
    assert!((dreux - (0.5 - 45.0_f64.sqrt() / 100.0)).abs() < 1e-12, "{dreux}");
    let faury =
        json!({"type": "faury", "d_max_mm": 32, "a_percent": 24, "b_percent": 2, "mould_radius_mm": 40});
    assert!((at(faury, 16.0) - 0.62).abs() < 1e-9);
    let rosin = at(json!({"type": "rosin_rammler", "characteristic_mm": 8, "exponent": 2}), 8.0);
    assert!((rosin - (1.0 - (-1.0_f64).exp() - 0.001) / 0.998).abs() < 1e-3, "{rosin}");

    let sizes = json!({"type": "sizes", "by": "number", "sizes": [
        {"diameter_mm": 8, "share": 1}, {"diameter_mm": 4, "share": 8},
    ]});
    assert_eq!(curve(&mix(&sizes)), [[4.0, 0.0], [4.0, 0.5], [8.0, 0.5], [8.0, 1.0]]);
}
