#![allow(clippy::unwrap_used)]

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

#[test]
fn sorted_grains_are_seen_along_the_field_alone() {
    let found = report(&scattered(3000, 1.0, 1), UP, 1);
    assert!(found.along.difference > 0.4, "{found:?}");
    assert!(found.along.p_value < 0.005, "{found:?}");
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
    // They lie on a line: nothing across the field says how large a difference is large.
    assert!((0.0..=1.0).contains(&found.along.p_value), "{found:?}");
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
fn chance_is_judged_fairly_whether_all_grains_are_dealt_out_or_most_are_summed_up() {
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
    assert!(found.along.difference > 0.5 && found.along.p_value < 0.01, "{found:?}");
    for control in [found.across.x, found.across.y, found.across.z] {
        assert!(control.unwrap().difference.abs() < 0.1, "{found:?}");
    }
}

proptest! {
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
