#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use serde_json::json;

use super::least_squares::{Limits, shares};
use super::*;

fn blend(request: &Value) -> Blend {
    Blend::of(&BlendRequest::from_json(request).unwrap())
}

fn sieves(points: &[[f64; 2]]) -> Value {
    json!({"type": "sieves", "points": points})
}

const SAND: [[f64; 2]; 5] = [[0.125, 0.0], [0.5, 0.4], [1.0, 0.7], [2.0, 0.95], [4.0, 1.0]];
const GRAVEL: [[f64; 2]; 4] = [[2.0, 0.0], [4.0, 0.1], [8.0, 0.9], [16.0, 1.0]];
const STONE: [[f64; 2]; 3] = [[4.0, 0.0], [8.0, 0.05], [16.0, 1.0]];

fn three(target: &Value) -> Value {
    json!({
        "aggregates": [
            {"name": "sand", "grading": sieves(&SAND), "density_kg_m3": 2600},
            {"name": "gravel", "grading": sieves(&GRAVEL), "density_kg_m3": 2700},
            {"name": "stone", "grading": sieves(&STONE), "density_kg_m3": 2900},
        ],
        "target": target,
    })
}

/// A curve that is a blend of the stockpiles has its shares back.
#[test]
fn a_blend_is_found_again() {
    let shares = [0.37, 0.18, 0.45];
    let at = |points: &[[f64; 2]], mm: f64| {
        let grading = Grading::Sieves {
            points: points.to_vec(),
            completed_mm: Vec::new(),
            between: crate::request::Between::Log,
        };
        Passing::of(&grading).share(mm)
    };
    let points: Vec<[f64; 2]> = [0.125, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0]
        .iter()
        .map(|&mm| [mm, shares[0] * at(&SAND, mm) + shares[1] * at(&GRAVEL, mm) + shares[2] * at(&STONE, mm)])
        .collect();
    let found = blend(&three(&sieves(&points)));
    for (aggregate, share) in found.aggregates.iter().zip(shares) {
        assert!((aggregate.share - share).abs() < 1.0e-12, "{found:?}");
    }
    assert!(found.largest_residual < 1.0e-12 && found.warnings.is_empty(), "{found:?}");
    let masses = [0.37 * 2600.0, 0.18 * 2700.0, 0.45 * 2900.0];
    let of_sand = found.aggregates[0].mass_share.unwrap();
    assert!((of_sand - masses[0] / masses.iter().sum::<f64>()).abs() < 1.0e-12);
    assert_eq!(found.curve.last(), Some(&[16.0, 1.0]));
    let request = json!({
        "specimen": {"type": "box", "size_mm": [80, 80, 80]},
        "mix": {"aggregates": found.request["mix"]["aggregates"], "volume_fraction": 0.4, "d_min_mm": 2},
    });
    crate::PackingRequest::from_json(&request, 1).unwrap();
}

#[test]
fn a_stockpile_that_does_not_help_has_no_share_and_is_not_in_the_request() {
    let found = blend(&three(&sieves(&SAND)));
    let shares: Vec<f64> = found.aggregates.iter().map(|aggregate| aggregate.share).collect();
    assert_eq!(shares, [1.0, 0.0, 0.0]);
    assert_eq!(found.request["mix"]["aggregates"].as_array().unwrap().len(), 1);
    assert_eq!(found.warnings.len(), 2, "{found:?}");
    assert!(found.warnings[0].contains("gravel"), "{found:?}");
}

#[test]
fn a_blend_lies_in_a_band_where_one_can() {
    let band = json!({"type": "band", "points": [[0.5, 5, 20], [2, 30, 42], [8, 55, 75], [16, 100, 100]]});
    let found = blend(&three(&band));
    assert!(found.largest_residual < 2.0e-6, "{found:?}");
    assert_eq!(found.sieves.len(), 4);
    let narrow = json!({"type": "band", "points": [[0.5, 0.05, 0.06], [2, 0.5, 0.51], [8, 0.52, 0.53]]});
    let found = blend(&three(&narrow));
    assert!(found.largest_residual > 0.05, "{found:?}");
    assert!(found.warnings.iter().any(|warning| warning.contains("% are asked for")), "{found:?}");
}

#[test]
fn the_band_of_a_standard_is_named() {
    let found = blend(&three(&json!({"type": "band", "standard": "BS 882", "name": "all-in 10 mm"})));
    assert!(found.sieves.iter().any(|sieve| sieve.target_low < sieve.target_high), "{found:?}");
    // The middle curve of the same grading, as a curve.
    let curve = blend(&three(&json!({"type": "standard", "standard": "BS 882", "name": "all-in 10 mm"})));
    assert!(curve.sieves.iter().all(|sieve| sieve.target_low == sieve.target_high), "{curve:?}");
}

#[test]
fn laws_are_met_at_the_standard_sieves_and_at_those_that_are_named() {
    let mut request = three(&json!({"type": "fuller", "d_max_mm": 16, "exponent": 0.5}));
    let found = blend(&request);
    let at: Vec<f64> = found.sieves.iter().map(|sieve| sieve.sieve_mm).collect();
    assert_eq!(at, [0.063, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0]);
    request["sieves_mm"] = json!([8, 2, 4]);
    let found = blend(&request);
    assert_eq!(found.sieves.iter().map(|sieve| sieve.sieve_mm).collect::<Vec<_>>(), [2.0, 4.0, 8.0]);
    assert!((found.sieves[0].target_low - 0.125_f64.sqrt()).abs() < 1.0e-12);
}

/// Equal grains as a target: what is finer must not pass the sieve below.
#[test]
fn equal_grains_are_met_by_equal_grains() {
    let equal = |mm: f64| json!({"type": "monodisperse", "diameter_mm": mm});
    let piles = json!([{"name": "4", "grading": equal(4.0)}, {"name": "8", "grading": equal(8.0)}]);
    let found = blend(&json!({"aggregates": piles, "target": equal(8.0)}));
    assert_eq!(found.aggregates[1].share, 1.0, "{found:?}");
}

/// A curve that ends above its lowest sieve is completed as a job completes it.
#[test]
fn the_curves_of_a_blend_are_those_of_its_job() {
    let gravel = sieves(&[[4.0, 0.15], [8.0, 0.4], [16.0, 1.0]]);
    let piles = json!([{"name": "sand", "grading": sieves(&SAND)}, {"name": "gravel", "grading": gravel}]);
    let found = blend(&json!({"aggregates": piles, "target": {"type": "standard", "name": "A16"}}));
    assert!(found.warnings.iter().any(|words| words.contains("the sieve 2 mm was added")), "{found:?}");
    let mut request = found.request.clone();
    request["specimen"] = json!({"type": "box", "size_mm": [80, 80, 80]});
    request["mix"]["volume_fraction"] = json!(0.3);
    request["mix"]["d_min_mm"] = json!(1);
    let request = crate::PackingRequest::from_json(&request, 1).unwrap();
    assert_eq!(figures(&request.mix), found.figures);
    let half = sieves(&[[4.0, 0.5], [8.0, 0.6], [16.0, 1.0]]);
    let piles = json!([{"name": "sand", "grading": sieves(&SAND)}, {"name": "half", "grading": half}]);
    let found = blend(&json!({"aggregates": piles, "target": {"type": "standard", "name": "A16"}}));
    assert!(found.warnings.iter().any(|words| words.contains("50 % of it passes its finest")), "{found:?}");
}

/// The gradient of the function that the shares minimise.
fn gradient(columns: &[Vec<f64>], limits: &[Limits], x: &[f64]) -> Vec<f64> {
    let by_row = |row: usize, limit: &Limits| {
        let passing: f64 = columns.iter().zip(x).map(|(column, x)| column[row] * x).sum();
        let middle = 0.5 * (limit.low + limit.high);
        passing - passing.clamp(limit.low, limit.high) + 1.0e-6 * (passing - middle)
    };
    let rows: Vec<f64> = limits.iter().enumerate().map(|(row, limit)| by_row(row, limit)).collect();
    columns.iter().map(|column| column.iter().zip(&rows).map(|(value, row)| value * row).sum()).collect()
}

/// Columns of what passes 4 to 12 sieves of 1 to 6 stockpiles, and limits at each.
fn problem() -> impl Strategy<Value = (Vec<Vec<f64>>, Vec<Limits>)> {
    (1_usize..14, 4_usize..60).prop_flat_map(|(count, rows)| {
        let column = proptest::collection::vec(0.0..1.0_f64, rows).prop_map(|mut column| {
            column.sort_by(f64::total_cmp);
            column
        });
        let columns = proptest::collection::vec(column.clone(), count);
        let width = prop_oneof![Just(0.0), 0.0..0.3_f64];
        (columns, column, width).prop_map(|(columns, middle, width)| {
            let limit =
                |&m: &f64| Limits { sieve_mm: 1.0, low: (m - width).max(0.0), high: (m + width).min(1.0) };
            let limits = middle.iter().map(limit).collect();
            (columns, limits)
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Karush, Kuhn and Tucker: the derivative is the same in every share above 0, and not below it in the others.
    #[test]
    fn shares_meet_the_conditions_of_an_optimum((columns, limits) in problem()) {
        let x = shares(&columns, &limits);
        prop_assert!((x.iter().sum::<f64>() - 1.0).abs() < 1.0e-12, "{x:?}");
        prop_assert!(x.iter().all(|share| *share >= 0.0));
        let gradient = gradient(&columns, &limits, &x);
        let level: f64 = gradient.iter().zip(&x).map(|(g, x)| g * x).sum();
        for (derivative, share) in gradient.iter().zip(&x) {
            prop_assert!(derivative - level > -1.0e-9, "{x:?} {gradient:?}");
            prop_assert!(*share == 0.0 || (derivative - level).abs() < 1.0e-9, "{x:?} {gradient:?}");
        }
    }

    /// The same for stockpiles that are blends of one another.
    #[test]
    fn stockpiles_that_are_blends_of_others_do_no_harm((mut columns, limits) in problem()) {
        let mean = (0..limits.len()).map(|row| {
            columns.iter().map(|column| column[row]).sum::<f64>() / columns.len() as f64
        });
        let mean: Vec<f64> = mean.collect();
        columns.push(columns[0].clone());
        columns.push(mean);
        let x = shares(&columns, &limits);
        let gradient = gradient(&columns, &limits, &x);
        let level: f64 = gradient.iter().zip(&x).map(|(g, x)| g * x).sum();
        for (derivative, share) in gradient.iter().zip(&x) {
            prop_assert!(derivative - level > -1.0e-9, "{x:?} {gradient:?}");
            prop_assert!(*share == 0.0 || (derivative - level).abs() < 1.0e-9, "{x:?} {gradient:?}");
        }
    }
}
