#![allow(clippy::unwrap_used)]

mod ellipsoids;
mod mixed;
mod polyhedra;
mod threads;

use crate::check::region::SpecimenRegion;
use crate::properties::properties;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::check::required::Required;
use crate::distance::DistanceRule;
use crate::packing::Spheres;
use crate::request::PackingRequest;
use crate::rng::{Stream, stream, uniform};
use crate::{Limits, Unattended, pack};

/// Edges of the box in which bodies are checked.
const SIZE: [f64; 3] = [30.0, 32.0, 34.0];

fn request(specimen: &Value, distance: &Value, diameters: &[f64]) -> PackingRequest {
    let value = json!({
        "specimen": specimen, "distance": distance,
        "mix": {"grading": {"type": "diameters", "diameters_mm": diameters}},
    });
    PackingRequest::from_json(&value, 1).unwrap()
}

/// The certificates of pairs, without those of walls.
fn of_pairs(list: Vec<SeparationCertificate>) -> Vec<SeparationCertificate> {
    list.into_iter().filter(|certificate| certificate.second.is_some()).collect()
}

fn specimen(kind: u64) -> Value {
    match kind % 3 {
        0 => json!({"type": "box", "size_mm": SIZE}),
        1 => json!({"type": "box", "size_mm": SIZE, "boundary": "periodic"}),
        _ => json!({"type": "cylinder", "diameter_mm": 32, "height_mm": 34}),
    }
}

fn rule(kind: u64) -> Value {
    match kind % 4 {
        0 => json!({"type": "none"}),
        1 => json!({"type": "constant", "gap_mm": 0.7}),
        2 => json!({"type": "proportional", "factor": 0.1}),
        _ => json!({"type": "smaller_diameter", "factor": 0.05, "wall_gap_mm": 0.2}),
    }
}

fn spheres(rows: &[[f64; 4]]) -> Spheres {
    let mut spheres = Spheres::default();
    for &[x, y, z, d] in rows {
        spheres.push([x, y, z], d);
    }
    spheres
}

fn walls() -> Value {
    json!({"type": "box", "size_mm": [20, 20, 20]})
}

fn periodic() -> Value {
    json!({"type": "box", "size_mm": [20, 20, 20], "boundary": "periodic"})
}

fn none() -> Value {
    json!({"type": "none"})
}

#[test]
fn two_touching_grains_pass_and_the_last_digit_of_an_overlap_fails() {
    let request = request(&walls(), &none(), &[4.0, 4.0]);
    let found = check(&spheres(&[[4.0, 5.0, 5.0, 4.0], [8.0, 5.0, 5.0, 4.0]]), &request).unwrap().found;
    assert_eq!(found.min_gap_mm, Some(0.0));
    assert_eq!(found.min_wall_gap_mm, Some(2.0));
    let overlapping = spheres(&[[4.0, 5.0, 5.0, 4.0], [8.0_f64.next_down(), 5.0, 5.0, 4.0]]);
    assert!(matches!(check(&overlapping, &request), Err(Fault::Pair { first: 0, second: 1, .. })));
}

#[test]
fn distances_of_every_rule_are_demanded_of_pairs_and_walls() {
    // Diameters 6 and 4 at a clear distance of 1 mm; the walls are 3 mm away.
    let rows = spheres(&[[6.0, 10.0, 10.0, 6.0], [12.0, 10.0, 10.0, 4.0]]);
    for (rule, kept) in [
        (json!({"type": "constant", "gap_mm": 1.0}), true),
        (json!({"type": "constant", "gap_mm": 1.001}), false),
        (json!({"type": "constant", "gap_mm": 0.5, "wall_gap_mm": 3.001}), false),
        (json!({"type": "proportional", "factor": 0.2}), true),
        (json!({"type": "proportional", "factor": 0.201}), false),
        (json!({"type": "smaller_diameter", "factor": 0.25}), true),
        (json!({"type": "smaller_diameter", "factor": 0.251}), false),
    ] {
        let verdict = check(&rows, &request(&walls(), &rule, &[6.0, 4.0]));
        assert_eq!(verdict.is_ok(), kept, "{rule}: {verdict:?}");
    }
}

#[test]
fn a_grain_through_a_wall_is_found_in_every_specimen() {
    let cylinder = json!({"type": "cylinder", "diameter_mm": 20, "height_mm": 20});
    for (specimen, row, kept) in [
        (walls(), [2.0, 5.0, 5.0, 4.0], true),
        (walls(), [1.999, 5.0, 5.0, 4.0], false),
        (walls(), [5.0, 5.0, 18.001, 4.0], false),
        (cylinder.clone(), [10.0, 2.0, 5.0, 4.0], true),
        (cylinder.clone(), [10.0, 1.999, 5.0, 4.0], false),
        // Inside the square around the circle, outside the circle.
        (cylinder.clone(), [3.0, 3.0, 5.0, 4.0], false),
        (cylinder, [10.0, 10.0, 1.9, 4.0], false),
        (periodic(), [0.0, 20.0, 5.0, 4.0], true),
        (periodic(), [-0.1, 5.0, 5.0, 4.0], false),
    ] {
        let verdict = check(&spheres(&[row]), &request(&specimen, &none(), &[4.0]));
        assert_eq!(verdict.is_ok(), kept, "{specimen} {row:?}: {verdict:?}");
    }
}

#[test]
fn a_periodic_box_has_neighbours_across_its_faces() {
    let rows = spheres(&[[1.0, 1.0, 1.0, 4.0], [19.0, 19.0, 19.0, 4.0]]);
    assert!(matches!(check(&rows, &request(&periodic(), &none(), &[4.0, 4.0])), Err(Fault::Pair { .. })));
    let rows = spheres(&[[1.0, 1.0, 1.0, 4.0], [17.0, 1.0, 1.0, 4.0]]);
    let found = check(&rows, &request(&periodic(), &none(), &[4.0, 4.0])).unwrap().found;
    assert_eq!(found.min_gap_mm, Some(0.0));
    assert_eq!(found.min_wall_gap_mm, None);
}

#[test]
fn a_far_pair_still_gives_the_smallest_clearance() {
    let rows = spheres(&[[1.0, 1.0, 1.0, 1.0], [19.0, 1.0, 1.0, 1.0]]);
    let found = check(&rows, &request(&walls(), &none(), &[1.0, 1.0])).unwrap().found;
    assert_eq!(found.min_gap_mm, Some(17.0));
}

#[test]
fn other_grains_than_those_of_the_mix_are_found() {
    let list = request(&walls(), &none(), &[4.0, 3.0]);
    let rows = |d: f64| spheres(&[[4.0, 5.0, 5.0, 4.0], [12.0, 5.0, 5.0, d]]);
    assert!(check(&rows(3.0), &list).is_ok());
    assert!(matches!(check(&rows(3.5), &list), Err(Fault::Grading(_))));
    assert!(matches!(check(&spheres(&[[4.0, 5.0, 5.0, 4.0]]), &list), Err(Fault::Grading(_))));
    let curve = PackingRequest::from_json(
        &json!({"specimen": {"type": "box", "size_mm": [60, 60, 60]},
                "mix": {"grading": {"type": "standard", "name": "A16"}, "volume_fraction": 0.4}}),
        3,
    )
    .unwrap();
    let packing = pack(&curve, &Limits::default(), &Unattended).unwrap();
    let mut fewer = packing.spheres().unwrap().clone();
    for column in [&mut fewer.x_mm, &mut fewer.y_mm, &mut fewer.z_mm, &mut fewer.d_mm] {
        column.remove(0);
    }
    assert!(matches!(check(&fewer, &curve), Err(Fault::Grading(_))));
    let mut broken = packing.into_spheres().unwrap();
    broken.x_mm[3] = f64::NAN;
    assert_eq!(check(&broken, &curve), Err(Fault::NotANumber { grain: 3 }));
}

/// All pairs, one by one: the oracle of the tables.
fn brute_force(spheres: &Spheres, rule: &DistanceRule, period: Option<[f64; 3]>) -> (f64, f64) {
    let mut least = (f64::INFINITY, f64::INFINITY);
    for i in 0..spheres.len() {
        for j in 0..i {
            let (p, q) = (spheres.center(i), spheres.center(j));
            let d2: f64 = (0..3)
                .map(|a| {
                    let mut way = p[a] - q[a];
                    if let Some(period) = period {
                        way -= period[a] * (way / period[a]).round();
                    }
                    way * way
                })
                .sum();
            let clearance = d2.sqrt() - (spheres.d_mm[i] + spheres.d_mm[j]) / 2.0;
            least.0 = least.0.min(clearance);
            least.1 = least.1.min(clearance - rule.gap_mm(spheres.d_mm[i], spheres.d_mm[j]));
        }
    }
    least
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    /// Points thrown anywhere: the check must agree with all pairs on whether they overlap, and on
    /// the smallest distances where they do not.
    #[test]
    fn the_table_sees_what_all_pairs_see(
        seed in 0_u64..1_000_000, n in 2_usize..60, octaves in 0.0..5.0_f64, scale in 0.02..0.6_f64,
        is_periodic in any::<bool>(), kind in 0..3, flat in any::<bool>(),
    ) {
        let mut rng = stream(seed, Stream::Sampling);
        let size = [20.0, 20.0, if flat { 5.0 } else { 20.0 }];
        let boundary = if is_periodic { "periodic" } else { "walls" };
        let specimen = json!({"type": "box", "size_mm": size, "boundary": boundary});
        let distance = match kind {
            0 => none(),
            1 => json!({"type": "proportional", "factor": 0.1, "wall_gap_mm": 0}),
            _ => json!({"type": "smaller_diameter", "factor": 0.3, "wall_gap_mm": 0}),
        };
        let mut rows = Spheres::default();
        for _ in 0..n {
            let d = scale * 4.0 / (uniform(&mut rng) * octaves).exp2();
            rows.push(size.map(|l| if is_periodic { uniform(&mut rng) * l } else { d / 2.0 + uniform(&mut rng) * (l - d) }), d);
        }
        let request = request(&specimen, &distance, &rows.d_mm);
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let period = is_periodic.then_some(size);
        let (clearance, slack) = brute_force(&rows, &rule, period);
        match check(&rows, &request) {
            Ok(check) => {
                prop_assert!(slack >= 0.0);
                let own = if is_periodic { size[2] - rows.d_mm.iter().copied().fold(0.0, f64::max) } else { f64::INFINITY };
                prop_assert!((check.found.min_gap_mm.unwrap() - clearance.min(own)).abs() < 1e-12);
                prop_assert!(check.found.min_excess_gap_mm.unwrap() <= slack + 1e-12);
            }
            Err(Fault::Pair { clearance_mm, required_mm, .. }) => {
                prop_assert!(slack < 0.0 && clearance_mm < required_mm);
            }
            // Rounding of `d / 2 + u (l - d)` may leave the box in the last digit.
            Err(Fault::Wall { clearance_mm, .. }) => prop_assert!(clearance_mm > -1e-12),
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

properties! {
    /// The check's own formulas of gaps and those that packings are made by say the same.
    #[test]
    fn required_gaps_are_those_of_the_distance_rule(
        kind in 0..4, value in 0.0..2.0_f64, wall in prop::option::of(0.0..3.0_f64), a in 0.1..20.0_f64, b in 0.1..20.0_f64,
    ) {
        let mut distance = match kind {
            0 => none(),
            1 => json!({"type": "constant", "gap_mm": value}),
            2 => json!({"type": "proportional", "factor": value}),
            _ => json!({"type": "smaller_diameter", "factor": value}),
        };
        if let Some(wall) = wall {
            distance["wall_gap_mm"] = json!(wall);
        }
        let request = request(&json!({"type": "box", "size_mm": [100, 100, 100]}), &distance, &[a, b]);
        let rule = DistanceRule::new(&request.distance, &request.specimen);
        let required = Required::new(request.distance, SpecimenRegion::new(&request.specimen));
        prop_assert!((required.gap_mm(a, b) - rule.gap_mm(a, b)).abs() <= 1e-14 * rule.gap_mm(a, b));
        prop_assert!((required.wall_gap_mm(a) - rule.wall_gap_mm(a)).abs() <= 1e-14 * rule.wall_gap_mm(a));
    }
}

/// The classes and volumes that the check asks for are those that sizes were sampled for.
#[test]
fn classes_of_every_grading_are_those_of_the_mix() {
    use crate::mix::{GradedMix, sieve::sieve_classes};
    let gradings = [
        json!({"grading": {"type": "standard", "name": "B16"}, "d_min_mm": 0.7, "volume_fraction": 0.3}),
        json!({"grading": {"type": "standard", "name": "A32"}, "volume_fraction": 0.2, "volume_fraction_of": "placed_grains"}),
        json!({"grading": {"type": "fuller", "d_max_mm": 20, "exponent": 0.4}, "d_min_mm": 1.5, "volume_fraction": 0.3}),
        json!({"grading": {"type": "sieves", "points": [[1.0, 0.1], [4.0, 0.1], [8.0, 1.0]]}, "volume_fraction": 0.3}),
        json!({"grading": {"type": "classes", "classes": [
            {"d_min_mm": 2, "d_max_mm": 4, "mass_fraction": 0.3}, {"d_min_mm": 6, "d_max_mm": 9, "mass_fraction": 0.5}]},
            "d_min_mm": 3, "volume_fraction": 0.3}),
        json!({"grading": {"type": "monodisperse", "diameter_mm": 5}, "volume_fraction": 0.2}),
        json!({"grading": {"type": "diameters", "diameters_mm": [3.0, 9.0, 1.0, 4.5, 8.0]}}),
    ];
    for mix in gradings {
        let value =
            json!({"specimen": {"type": "cylinder", "diameter_mm": 120, "height_mm": 100}, "mix": mix});
        let request = PackingRequest::from_json(&value, 1).unwrap();
        let packing = pack(&request, &Limits::default(), &Unattended).unwrap();
        let expected = sieve_classes(&GradedMix::new(&request.mix, request.specimen.volume_mm3()));
        let found = check(packing.spheres().unwrap(), &request).unwrap().classes;
        assert_eq!(found.len(), expected.len(), "{mix}");
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!((found.d_min_mm, found.d_max_mm), (expected.low_mm, expected.high_mm), "{mix}");
            assert!((found.target_volume_mm3 / expected.volume_mm3 - 1.0).abs() < 1e-12, "{mix}");
        }
    }
}
