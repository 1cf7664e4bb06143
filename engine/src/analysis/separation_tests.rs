#![allow(clippy::unwrap_used)]

use crate::properties::properties;
use proptest::prelude::*;

use super::*;
use crate::request::{Boundary, Distance};

const CUBE: Specimen = Specimen::Box { size_mm: [100.0; 3], boundary: Boundary::Walls };
const UP: GradientField = GradientField::Linear { axis: Axis::Z, direction: FieldDirection::Up };

fn report(spheres: &Spheres, field: GradientField, seed: u64) -> SegregationReport {
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &CUBE);
    separation(spheres, &CUBE, &rule, field, seed)
}

/// Grains of diameters from 4 to 1 mm, scattered at random; their z is put in order by `mix`: at 1 the coarse
/// ones lie above.
fn scattered(n: usize, sorted: f64, seed: u64) -> Spheres {
    let mut rng = stream(seed, Stream::Rsa);
    let mut spheres = Spheres::with_capacity(n);
    for i in 0..n {
        let d = 4.0 - 3.0 * i as f64 / n as f64;
        let mut p: [f64; 3] = std::array::from_fn(|_| d / 2.0 + uniform(&mut rng) * (100.0 - d));
        p[2] = (1.0 - sorted) * p[2] + sorted * (100.0 - d / 2.0 - (i as f64 + 0.5) / n as f64 * (100.0 - d));
        spheres.push(p, d);
    }
    spheres
}

/// The exact p value along the first field: the fraction of all permutations of the sizes whose statistic is at least
/// as large as that of the identity.
fn exact_p_value(spheres: &Spheres, field: GradientField) -> f64 {
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &CUBE);
    let fields: Vec<GradientField> =
        [Some(field), across(field, Axis::X), across(field, Axis::Y), across(field, Axis::Z)]
            .into_iter()
            .flatten()
            .collect();
    let thirds = Thirds::of(&spheres.d_mm);
    let measured: Vec<Measured> =
        fields.iter().map(|&field| Measured::new(spheres, &CUBE, &rule, field, &thirds)).collect();
    let products = Products::new(&fields, &CUBE, thirds.mean_diameter_mm(&spheres.d_mm), &rule);
    let n = spheres.len();
    let mut functions: Vec<Vec<f64>> = measured.iter().map(|field| field.shares.clone()).collect();
    functions.extend(
        products.orders.iter().map(|orders| (0..n).map(|i| Products::at(orders, &measured, i)).collect()),
    );
    let weights: Vec<f64> = (0..n).map(|i| thirds.weight(i)).collect();
    let spread = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / n as f64;
        values.iter().map(|x| (x - mean).powi(2)).sum::<f64>()
    };
    let statistic = |order: &[usize]| {
        let squares: Vec<f64> = functions
            .iter()
            .map(|values| {
                let sum: f64 = order.iter().zip(&weights).map(|(&i, weight)| weight * values[i]).sum();
                let variance = spread(&weights) * spread(values) / (n as f64 - 1.0);
                if variance > 1.0e-20 { sum * sum / variance } else { 0.0 }
            })
            .collect();
        products.statistics(&squares[..fields.len()], &squares[fields.len()..])[0]
    };
    let mut order: Vec<usize> = (0..n).collect();
    let found = statistic(&order);
    let (mut all, mut beyond) = (0_u32, 0_u32);
    each_permutation(&mut order, n, &mut |order| {
        all += 1;
        beyond += u32::from(statistic(order) >= found * (1.0 - 1.0e-9));
    });
    f64::from(beyond) / f64::from(all)
}

/// All permutations of the first `n` items (Heap 1963).
fn each_permutation(items: &mut [usize], n: usize, visit: &mut dyn FnMut(&[usize])) {
    if n <= 1 {
        return visit(items);
    }
    for i in 0..n {
        each_permutation(items, n - 1, visit);
        items.swap(if n.is_multiple_of(2) { i } else { 0 }, n - 1);
    }
}

/// Asserts that reported p values are those of so many random permutations, when the exact p value is `exact`: the mean
/// of 30 independent reports is within 4 standard deviations of a binomial distribution, which has probability 6e-5.
fn assert_p_value(spheres: &Spheres, field: GradientField, exact: f64) {
    const REPORTS: u64 = 30;
    let permutations = f64::from(PERMUTATIONS);
    // The identity is counted as one more permutation (Davison and Hinkley 1997, section 4.3).
    let expected = (permutations * exact + 1.0) / (permutations + 1.0);
    let deviation = (permutations * exact * (1.0 - exact) / REPORTS as f64).sqrt() / (permutations + 1.0);
    let sum: f64 = (1..=REPORTS).map(|seed| report(spheres, field, seed).along.p_value).sum();
    let mean = sum / REPORTS as f64;
    assert!(
        (mean - expected).abs() <= 4.0 * deviation + 1.0e-12,
        "{mean}, expected {expected} +- {deviation}"
    );
}

/// Few grains have few permutations, so that the exact p value is known.
#[test]
fn p_values_of_few_grains_are_those_of_all_permutations() {
    let mut found = Vec::new();
    for (n, seed) in [(3, 1), (4, 2), (5, 3), (6, 4), (6, 5), (6, 6), (7, 7)] {
        for sorted in [0.0, 0.9] {
            let spheres = scattered(n, sorted, seed);
            let exact = exact_p_value(&spheres, UP);
            assert_p_value(&spheres, UP, exact);
            found.push(exact);
        }
    }
    found.sort_by(f64::total_cmp);
    assert!(
        found[0] < 0.15 && found[found.len() - 1] > 0.9,
        "the cases cover small and large p values: {found:?}"
    );
}

#[test]
fn sorted_grains_are_seen_along_the_field_alone() {
    let found = report(&scattered(3000, 1.0, 1), UP, 1);
    assert!(found.along.difference > 0.4, "{found:?}");
    // The smallest p value that 999 permutations can give: the statistic is above 500, and of the order of 1 in them.
    assert_eq!(found.along.p_value, 1.0 / 1000.0);
    assert!((found.along.coarsest_third - found.along.finest_third - found.along.difference).abs() < 1e-15);
    assert_eq!((found.permutations, found.across.z), (999, None));
    for control in [found.across.x.unwrap(), found.across.y.unwrap()] {
        assert!(control.p_value > 0.01 && control.difference.abs() < 0.05, "{found:?}");
    }
    let down = GradientField::Linear { axis: Axis::Z, direction: FieldDirection::Down };
    let turned = report(&scattered(3000, 1.0, 1), down, 1);
    assert!((turned.along.difference + found.along.difference).abs() < 1e-12, "{turned:?}");
}

#[test]
fn three_grains_are_weighed_by_hand() {
    // Of equal volume, so that each is a third; 0.25, 0.5 and 1 of the way between the walls.
    let mut spheres = Spheres::default();
    for z in [25.0, 50.0, 99.9999] {
        spheres.push([50.0, 50.0, z], 1.0e-9 + 2.0e-4);
    }
    // Diameters that differ by nothing that matters, so that the grains have an order.
    (spheres.d_mm[0], spheres.d_mm[2]) = (2.000_000_02e-4, 2.0e-4);
    let found = report(&spheres, UP, 1);
    assert!((found.along.coarsest_third - 0.25).abs() < 1e-5, "{found:?}");
    assert!((found.along.finest_third - 1.0).abs() < 1e-5, "{found:?}");
    // They lie on a line along the field, so that no sum across the field scales the difference. Of the six
    // permutations two have a difference of 0.75 or -0.75, and the others a smaller one.
    assert_eq!(exact_p_value(&spheres, UP), 1.0 / 3.0);
    assert_p_value(&spheres, UP, 1.0 / 3.0);
}

#[test]
fn equal_grains_cannot_be_apart() {
    let mut spheres = scattered(500, 1.0, 1);
    spheres.d_mm.fill(2.0);
    let found = report(&spheres, UP, 1);
    assert!(found.along.difference.abs() < 1e-12, "{found:?}");
    assert_eq!(found.along.p_value, 1.0);
}

#[test]
fn p_values_without_a_gradient_are_uniform_for_few_and_for_many_grains() {
    const RUNS: usize = 100;
    for n in [300, 3 * DEALT] {
        let mut p_values: Vec<f64> =
            (0..RUNS as u64).map(|seed| report(&scattered(n, 0.0, seed), UP, seed).along.p_value).collect();
        p_values.sort_by(f64::total_cmp);
        let gap = p_values
            .iter()
            .enumerate()
            .map(|(i, p)| (p - (i as f64 + 0.5) / RUNS as f64).abs())
            .fold(0.0, f64::max);
        // Kolmogorov: 1.95 has probability 1e-3.
        assert!(gap * (RUNS as f64).sqrt() < 1.95, "{n} grains: {gap}");
    }
}

#[test]
fn a_lateral_surface_is_a_field_with_three_controls() {
    let cylinder = Specimen::Cylinder { diameter_mm: 100.0, height_mm: 100.0 };
    let rule = DistanceRule::new(&Distance::None { wall_gap_mm: None }, &cylinder);
    let mut spheres = Spheres::default();
    for i in 0..200 {
        let (d, angle) = (4.0 - f64::from(i) / 100.0, f64::from(i));
        let r = (50.0 - d / 2.0) * (1.0 - f64::from(i) / 200.0).sqrt();
        spheres.push([50.0 + r * angle.cos(), 50.0 + r * angle.sin(), 50.0], d);
    }
    let found = separation(&spheres, &cylinder, &rule, GradientField::Face { face: SpecimenFace::Side }, 1);
    assert!(found.along.difference > 0.5 && found.along.p_value == 1.0 / 1000.0, "{found:?}");
    for control in [found.across.x, found.across.y, found.across.z] {
        assert!(control.unwrap().difference.abs() < 0.1, "{found:?}");
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn thirds_have_a_third_of_the_mass_each(sizes in prop::collection::vec(1..6_u8, 1..60)) {
        let mut d: Vec<f64> = sizes.into_iter().map(f64::from).collect();
        d.sort_by(|a, b| b.total_cmp(a));
        let thirds = Thirds::of(&d);
        for weights in [&thirds.coarsest, &thirds.finest] {
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
        }
        let mean = |weights: &[f64]| weights.iter().zip(&d).map(|(weight, d)| weight * d).sum::<f64>();
        prop_assert!(mean(&thirds.coarsest) >= mean(&thirds.finest) - 1e-12);
    }
}
