//! A whole job of a mix: what the table of a laboratory does not say has a default here.

use std::io::{self, Write as _};
use std::path::Path;

use packstone_engine::{Limits, Plan};
use serde_json::{Value, json};

use super::super::exit::{Exit, Failure, cannot_be};
use super::super::print_files;
use super::super::run::{listed, refused, warn};
use crate::atomic_file::write_buffered;
use crate::config::limits_of_one_packing;
use crate::jobs::{JobRequest, request};
use crate::telemetry::say;

/// Edge of the cube over the largest grain. EN 12390-1 asks for 3.5 of a specimen.
const EDGE_PER_GRAIN: f64 = 5.0;
/// Largest grain over the finest that is placed.
const PLACED_RANGE: f64 = 8.0;
/// Volume of aggregate over that of the specimen.
const VOLUME_FRACTION: f64 = 0.4;

/// Largest grain where the table has no size: that of most concretes.
const UNKNOWN_LARGEST_MM: f64 = 32.0;

/// Writes a job of the mix of a request, and says what the request did not.
pub(super) fn write(request: &Value, out: &Path) -> Result<(), Failure> {
    let (job, said) = of_mix(request);
    let read = JobRequest::read(&job, request::draw_seed(), None);
    let read = read.map_err(|faults| Exit::BadInput.because(listed(out, &faults)))?;
    let limits = limits_of_one_packing(Limits::default().max_grains);
    let plan = Plan::new(&read.packing(), &limits).map_err(|error| refused(out, &error))?;
    warn(&plan.warnings);
    for line in &said {
        say(line);
    }
    say(&format!(
        "it packs about {:.0} grains, with a chance of success of {:.0} %",
        plan.grains,
        100.0 * plan.success_probability
    ));
    let text = format!("{}\n", serde_json::to_string_pretty(&job)?);
    write_buffered(out, |to| to.write_all(text.as_bytes()))
        .map_err(|error: io::Error| cannot_be("written", out, &error))?;
    print_files([out])
}

/// A job of the mix of a request, and a sentence for each of its values that the request does not have.
pub(super) fn of_mix(request: &Value) -> (Value, Vec<String>) {
    let mut mix = request["mix"].clone();
    let mut said = Vec::new();
    let sieves = sieves(&mix);
    let d_max = largest(&mix, &sieves);
    if mix.get("d_min_mm").is_none() && !sieves.is_empty() {
        let least = d_max / PLACED_RANGE;
        let of_table = sieves.iter().copied().filter(|&mm| least <= mm && mm < d_max);
        let d_min = of_table.reduce(f64::min).unwrap_or(least);
        mix["d_min_mm"] = json!(d_min);
        said.push(format!("mix.d_min_mm is {d_min}: finer grains count as mortar and are not placed"));
    }
    if !has_amount(&mix) {
        mix["volume_fraction"] = json!(VOLUME_FRACTION);
        said.push(format!("mix.volume_fraction is {VOLUME_FRACTION}: the table says no amount of aggregate"));
    }
    let edge = rounded_up(EDGE_PER_GRAIN * d_max);
    said.push(format!(
        "specimen is a cube of {edge} mm: {EDGE_PER_GRAIN} times the largest grain, {d_max} mm"
    ));
    (json!({"specimen": {"type": "box", "size_mm": [edge, edge, edge]}, "mix": mix}), said)
}

/// Whether a mix says how much aggregate there is.
fn has_amount(mix: &Value) -> bool {
    let has = |of: &Value, name: &str| of.get(name).is_some();
    ["volume_fraction", "proportions", "count"].iter().any(|name| has(mix, name))
        || gradings(mix, |aggregate| has(aggregate, "mass_kg_m3").then_some(())).next().is_some()
}

/// What is found in the one aggregate that a mix is, or in each of those that it has.
fn gradings<'a, T: 'a>(
    mix: &'a Value,
    find: impl Fn(&'a Value) -> Option<T> + 'a,
) -> impl Iterator<Item = T> + 'a {
    let several = mix.get("aggregates").and_then(Value::as_array);
    let all: Vec<&Value> = several.map_or_else(|| vec![mix], |several| several.iter().collect());
    all.into_iter().filter_map(find)
}

/// The points of each curve, as sieve in mm and share that passes.
fn points(mix: &Value) -> impl Iterator<Item = Vec<[f64; 2]>> {
    gradings(mix, |aggregate| {
        let points = aggregate.pointer("/grading/points")?.as_array()?;
        points.iter().map(|point| Some([point.get(0)?.as_f64()?, point.get(1)?.as_f64()?])).collect()
    })
}

fn sieves(mix: &Value) -> Vec<f64> {
    points(mix).flatten().map(|[mm, _]| mm).collect()
}

/// The finest sieve that all grains pass.
fn largest(mix: &Value, sieves: &[f64]) -> f64 {
    let of_curve = |points: Vec<[f64; 2]>| {
        let all = points.iter().filter(|[_, passing]| *passing >= 1.0).map(|[mm, _]| *mm);
        all.reduce(f64::min)
    };
    let of_curves = points(mix).filter_map(of_curve).reduce(f64::max);
    let of_classes = gradings(mix, |of| {
        let classes = of.pointer("/grading/classes")?.as_array()?;
        classes.iter().filter_map(|class| class["d_max_mm"].as_f64()).reduce(f64::max)
    });
    let found = of_curves
        .or_else(|| sieves.iter().copied().reduce(f64::max))
        .into_iter()
        .chain(of_classes)
        .reduce(f64::max)
        .unwrap_or(UNKNOWN_LARGEST_MM);
    mix.get("d_max_mm").and_then(Value::as_f64).map_or(found, |most| most.min(found))
}

/// A length with at most two digits, not below this one.
fn rounded_up(mm: f64) -> f64 {
    let mut digit = 1.0;
    while digit * 100.0 < mm {
        digit *= 10.0;
    }
    while digit * 10.0 > mm && digit > 1.0e-3 {
        digit /= 10.0;
    }
    (mm / digit).ceil() * digit
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn curve(points: &[[f64; 2]]) -> Value {
        json!({"type": "sieves", "points": points})
    }

    #[test]
    fn what_the_table_does_not_say_has_a_default_and_is_said() {
        let points = [[0.063, 0.0], [1.0, 0.2], [2.0, 0.36], [4.0, 0.6], [16.0, 1.0], [31.5, 1.0]];
        let (job, said) = of_mix(&json!({"mix": {"grading": curve(&points)}}));
        assert_eq!(
            job["specimen"]["size_mm"],
            json!([80.0, 80.0, 80.0]),
            "the finest sieve that all pass is 16 mm"
        );
        assert_eq!((&job["mix"]["d_min_mm"], &job["mix"]["volume_fraction"]), (&json!(2.0), &json!(0.4)));
        assert_eq!(said.len(), 3, "{said:?}");
    }

    #[test]
    fn what_the_table_says_stays() {
        let aggregate = |points: &[[f64; 2]]| json!({"name": "a", "mass_kg_m3": 900, "density_kg_m3": 2650, "grading": curve(points)});
        let aggregates = [
            aggregate(&[[0.063, 0.02], [0.125, 0.1], [1.0, 0.6], [4.0, 1.0]]),
            aggregate(&[[4.0, 0.0], [8.0, 0.3], [11.2, 1.0]]),
        ];
        let mix = json!({"d_min_mm": 1.0, "d_max_mm": 8.0, "aggregates": aggregates});
        let (job, said) = of_mix(&json!({"mix": mix}));
        assert_eq!(job["mix"], mix);
        assert_eq!(job["specimen"]["size_mm"][0], 40.0);
        assert_eq!(said.len(), 1, "{said:?}");
    }

    /// Curves of sands, of ballast, and with two sieves alone.
    #[test]
    fn the_job_of_each_curve_is_read_and_planned() {
        for points in [
            &[[0.063, 0.01], [0.125, 0.1], [0.25, 0.4], [0.5, 0.7], [1.0, 1.0]][..],
            &[[22.4, 0.0], [31.5, 0.2], [40.0, 0.6], [50.0, 0.9], [63.0, 1.0]],
            &[[4.0, 0.0], [8.0, 1.0]],
            &[[0.075, 0.0], [0.15, 0.03], [9.5, 1.0]],
        ] {
            let (job, _) = of_mix(&json!({"mix": {"grading": curve(points)}}));
            let read = JobRequest::read(&job, 1, None).unwrap();
            let plan = Plan::new(&read.packing(), &Limits::default()).unwrap();
            assert!(plan.success_probability > 0.9 && plan.grains < 1.0e6, "{job}: {plan:?}");
        }
    }

    #[test]
    fn lengths_are_rounded_up_to_two_digits() {
        for (mm, rounded) in
            [(80.0, 80.0), (157.5, 160.0), (2.5, 2.5), (313.0, 320.0), (0.123, 0.13), (100.0, 100.0)]
        {
            assert!((rounded_up(mm) - rounded).abs() < 1.0e-9, "{mm}: {}", rounded_up(mm));
        }
    }
}
