//! Reads the points of a sieve curve, in any order, as fractions or in percent, and completes a curve that ends a
//! sieve too early.
//!
//! What has one reading is taken; what has two is refused, and the fault states both.

use super::MAX_CURVE_POINTS;
use super::decode::{At, Bound, rounded};
use super::lengths::{LENGTH, MAX_LENGTH_MM, MIN_LENGTH_MM};
use crate::elementary::log10;
use crate::sorting;

/// A fraction, or in percent.
const PASSING: Bound = Bound::closed(0.0, 100.0, "(0 to 1, or percent)");
/// Least passing of the last sieve of a curve that is completed: a coarse aggregate of EN 12620, category GC90/15, may
/// have 10 % above its upper sieve.
pub(crate) const LEAST_TOP: f64 = 0.9;
/// Most passing of the first sieve of a curve that is completed: a coarse aggregate of EN 12620, category GC85/20, may
/// have 20 % below its lower sieve.
pub(crate) const MOST_UNDERSIZE: f64 = 0.2;

/// Principal sizes of the series R20 (ISO 565) between 1 and 10, which repeat in every decade.
const R20: [f64; 20] =
    [1.0, 1.12, 1.25, 1.4, 1.6, 1.8, 2.0, 2.24, 2.5, 2.8, 3.15, 3.55, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1, 8.0, 9.0];
/// Sieves of ASTM E11 in mm that no series of ISO 565 has with these steps.
const ASTM: [f64; 18] = [
    0.075, 0.15, 0.3, 0.6, 1.18, 2.36, 4.75, 9.5, 12.5, 19.0, 25.0, 37.5, 50.0, 63.0, 75.0, 90.0, 100.0,
    125.0,
];
/// A sieve is that of a series within this share of its size.
const SAME: f64 = 0.03;

/// The points of a curve, from the finest sieve to the coarsest.
pub(super) struct SieveCurve {
    /// Sieves in mm with the share of the mass that passes them.
    pub(super) points: Vec<[f64; 2]>,
    /// The sieves among them that were added, in mm.
    pub(super) completed_mm: Vec<f64>,
}

/// Reads the points of a curve.
///
/// `None` means that faults were reported.
pub(super) fn read_sieves(at: &At<'_>) -> Option<SieveCurve> {
    let items = at.array()?;
    if items.len() < 2 {
        at.fault(format!("has {} points: must have at least 2", items.len()));
        return None;
    }
    if items.len() > MAX_CURVE_POINTS {
        at.fault(format!("has {} points: must have at most {MAX_CURVE_POINTS}", items.len()));
        return None;
    }
    // With the place of each in the document.
    let mut rows: Vec<([f64; 2], usize)> = Vec::with_capacity(items.len());
    for (row, item) in items.iter().enumerate() {
        let [d, passing] = item.array_of()?;
        rows.push(([d.number(LENGTH)?, passing.number(PASSING)?], row));
    }
    sorting::by_number(&mut rows, |([d, _], _)| *d);
    for pair in rows.windows(2) {
        let ([d, _], row) = pair[1];
        if d == pair[0].0[0] {
            items.at(row).fault(format!("the sieve {d} mm stands in two points: must stand in one"));
            return None;
        }
    }
    let mut passing: Vec<f64> = rows.iter().map(|([_, passing], _)| *passing).collect();
    if are_percents(at, &[&passing])? {
        for p in &mut passing {
            *p /= 100.0;
        }
    }
    for (number, pair) in passing.windows(2).enumerate() {
        if pair[1] < pair[0] {
            let (([d_before, before], _), ([d, after], row)) = (rows[number], rows[number + 1]);
            items.at(row).fault(format!(
                "passing must not fall towards coarser sieves: {after} passes {d} mm, and {before} passes \
                 {d_before} mm"
            ));
            return None;
        }
    }
    let mut points: Vec<[f64; 2]> = rows.iter().zip(&passing).map(|(([d, _], _), &p)| [*d, p]).collect();
    if points[0][1] >= 1.0 {
        let fault = "passing 1 is out of range: the finest sieve must hold some mass back, so its passing must be less than 1";
        items.at(rows[0].1).fault(fault);
        return None;
    }
    let mut completed_mm = Vec::new();
    let [coarsest, last] = points[points.len() - 1];
    if last < 1.0 {
        let next = next_sieve(points[points.len() - 2][0], coarsest);
        if last < LEAST_TOP || next > MAX_LENGTH_MM {
            items.at(rows[rows.len() - 1].1).fault(format!(
                "passing {last} is out of range: all mass must pass the coarsest sieve, so its passing must be 1; add \
                 the coarser sieves (from {LEAST_TOP} on, the next sieve of the series is added, here {next} mm)"
            ));
            return None;
        }
        points.push([next, 1.0]);
        completed_mm.push(next);
    }
    Some(SieveCurve { points, completed_mm })
}

/// Whether what passes the sieves, from the finest to the coarsest, is in percent: in one column, or in those of
/// limits.
///
/// `None` means that the values rise both as percents and with those up to 1 as fractions, which was reported.
pub(super) fn are_percents(at: &At<'_>, columns: &[&[f64]]) -> Option<bool> {
    if columns.iter().all(|column| column.iter().all(|&p| p <= 1.0)) {
        return Some(false);
    }
    let as_percent = |&p: &f64| if p > 1.0 { p } else { 100.0 * p };
    let rises = |column: &&[f64]| column.is_sorted() && column.iter().map(as_percent).is_sorted();
    let is_fraction = |p: &f64| *p > 0.0 && *p < 1.0;
    let values = columns.iter().flat_map(|column| column.iter());
    if !values.clone().any(is_fraction) || !columns.iter().all(rises) {
        return Some(true);
    }
    let fine: Vec<f64> = values.copied().filter(|&p| p <= 1.0).collect();
    let percents: Vec<f64> = fine.iter().map(|&p| rounded(100.0 * p)).collect();
    at.fault(format!(
        "the passings {} can be fractions among percents, {} %, or percents, {} %: must be all fractions (0 to 1) or \
         all percents",
        listed(&fine),
        listed(&percents),
        listed(&fine),
    ));
    None
}

/// Adds the next finer sieve, which nothing passes, to a curve whose finest sieve some mass passes; `None` where too
/// much does, or no sieve is finer.
pub(super) fn complete_below(points: &mut Vec<[f64; 2]>, completed_mm: &mut Vec<f64>) -> Option<f64> {
    let [finest, passing] = points[0];
    let next = next_sieve(points[1][0], finest);
    if passing > MOST_UNDERSIZE || next < MIN_LENGTH_MM {
        return None;
    }
    points.insert(0, [next, 0.0]);
    completed_mm.insert(0, next);
    Some(next)
}

/// The sieve that continues a series after these two, coarser or finer as the second is than the first: of R20 or of
/// ASTM E11 where both belong to it, else with the same ratio.
pub(crate) fn next_sieve(before: f64, last: f64) -> f64 {
    let place = |d: f64| {
        let number = (20.0 * log10(d)).round();
        let size = of_r20(number);
        ((d / size - 1.0).abs() < SAME).then_some(number)
    };
    let of_astm = |d: f64| ASTM.iter().position(|&size| (d / size - 1.0).abs() < 1.0e-3);
    if let (Some(first), Some(second)) = (of_astm(before), of_astm(last)) {
        let next = if second > first { second.checked_add(1) } else { second.checked_sub(1) };
        if let Some(&size) = next.and_then(|next| ASTM.get(next)) {
            return size;
        }
    }
    match (place(before), place(last)) {
        (Some(first), Some(second)) if first != second => of_r20(second + (second - first)),
        _ => last * (last / before),
    }
}

/// Size of that number in the series R20, in mm; number 0 is 1 mm.
fn of_r20(number: f64) -> f64 {
    let decade = (number / 20.0).floor();
    let size = R20[(number - 20.0 * decade) as usize];
    // Powers of ten by division, so that 0.063 is the number that is typed.
    let power = crate::elementary::powf(10.0, decade.abs()).round();
    if decade < 0.0 { size / power } else { size * power }
}

/// Numbers for a message.
fn listed(values: &[f64]) -> String {
    let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
    texts.join(", ")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::decode::Faults;
    use super::*;
    use serde_json::{Value, json};

    fn read(points: &Value) -> Result<(Vec<[f64; 2]>, Vec<f64>), String> {
        let faults = Faults::default();
        match read_sieves(&At::root(points, &faults)) {
            Some(curve) => Ok((curve.points, curve.completed_mm)),
            None => Err(faults.into_vec()[0].to_string()),
        }
    }

    #[test]
    fn any_order_and_percents_are_read() {
        let expected = Ok((vec![[2.0, 0.005], [4.0, 0.03], [8.0, 0.08], [16.0, 1.0]], Vec::new()));
        for points in [
            json!([[2, 0.5], [4, 3], [8, 8], [16, 100]]),
            json!([[16, 100], [8, 8], [4, 3], [2, 0.5]]),
            json!([[8, 8], [16, 100], [2, 0.5], [4, 3]]),
            json!([[2, 0.005], [4, 0.03], [8, 0.08], [16, 1]]),
        ] {
            assert_eq!(read(&points), expected, "{points}");
        }
        // A percent, whatever stands beside it: 1 among percents is no whole.
        let curve = read(&json!([[1, 0], [2, 1], [4, 40], [8, 100]])).unwrap().0;
        assert_eq!(curve, [[1.0, 0.0], [2.0, 0.01], [4.0, 0.4], [8.0, 1.0]]);
    }

    #[test]
    fn two_readings_are_refused_with_both() {
        let fault =
            read(&json!([[0.125, 0.03], [0.5, 0.14], [2, 0.31], [4, 48], [8, 71], [16, 100]])).unwrap_err();
        assert!(fault.contains("0.03, 0.14, 0.31 can be fractions among percents"), "{fault}");
        assert!(fault.contains("3, 14, 31 %"), "{fault}");
    }

    #[test]
    fn a_curve_that_ends_early_gets_the_next_sieve_of_its_series() {
        for (before, last, next) in [
            (8.0, 16.0, 31.5),
            (16.0, 31.5, 63.0),
            (2.0, 4.0, 8.0),
            (11.2, 16.0, 22.4),
            (9.5, 12.5, 19.0),
            (19.0, 25.0, 37.5),
            (4.75, 9.5, 12.5),
            (0.5, 0.3, 0.18),
            (16.0, 8.0, 4.0),
            (0.25, 0.125, 0.063),
            (4.0, 5.0, 6.3),
            (10.0, 13.0, 16.9),
        ] {
            let found = next_sieve(before, last);
            assert!((found / next - 1.0).abs() < 1e-12, "{before}, {last}: {found}");
        }
        let (points, completed) = read(&json!([[4, 0.2], [8, 0.7], [16, 0.97]])).unwrap();
        assert_eq!((points.last(), completed), (Some(&[31.5, 1.0]), vec![31.5]));
        let fault = read(&json!([[4, 20], [8, 70], [16, 89]])).unwrap_err();
        assert!(fault.starts_with("/2: passing 0.89") && fault.contains("31.5 mm"), "{fault}");
    }

    #[test]
    fn curves_that_fall_or_stand_twice_are_refused_at_their_point() {
        let fault = read(&json!([[8, 0.5], [4, 0.6], [16, 1]])).unwrap_err();
        assert!(fault.starts_with("/0: passing must not fall"), "{fault}");
        assert!(read(&json!([[8, 0.5], [8, 0.6], [16, 1]])).unwrap_err().contains("stands in two points"));
        assert!(read(&json!([[8, 100], [16, 100]])).unwrap_err().starts_with("/0: passing 1"));
        assert!(read(&json!([[8, 0.5], [16, 101]])).unwrap_err().contains("at most 100"));
    }
}
