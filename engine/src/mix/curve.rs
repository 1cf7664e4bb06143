//! The grading curve of a mix, as it is drawn.

use super::class::{Class, Law};
use super::classes_above;
use crate::elementary::ln;
use crate::request::{Form, Mix};
use crate::sorting;

/// Part of the largest diameter down to which a curve without a finest diameter is drawn.
const DRAWN: f64 = 1.0e-3;
/// A share of the mass by which sums of it miss 1.
const ROUNDING: f64 = 1.0e-9;
/// Share of a single size below which it is drawn as a rise of the curve, not as a step.
const STEP: f64 = 1.0e-4;
/// Rise of the curve, and length in `ln d`, below which points in between may go: a line misses the curve by less.
const SHORT: f64 = 2.0e-4;
const LONGEST: f64 = 0.1;

/// The share of the mass of all aggregate that passes each diameter: `[diameter in mm, share]` from fine to coarse, as
/// many points as a drawing with a logarithmic axis needs between them. The share rises at a single size, which then
/// has two points. Empty for an explicit list.
pub fn curve(mix: &Mix) -> Vec<[f64; 2]> {
    // Of each class: its ends, its law, and its share of the mass of all.
    let mut classes = Vec::new();
    let mut edges = Vec::new();
    for part in mix.parts() {
        let form = part.grading.form();
        let (low, high) = form.range_mm();
        if matches!(form, Form::List(_)) {
            return Vec::new();
        }
        let drawn_from = if low > 0.0 { low } else { DRAWN * high };
        edges.extend([drawn_from, high]);
        for class in classes_above(&form, drawn_from) {
            let narrow = if class.law == Law::LogUniform { vec![class] } else { class.narrow() };
            for mut class in narrow {
                class.mass_fraction *= part.share;
                edges.extend([class.low_mm, class.high_mm]);
                classes.push(class);
            }
        }
    }
    sorting::ascending(&mut edges);
    edges.dedup();
    // What has no mass at its finest diameter begins with none: sums to 1 miss it by rounding.
    let begins_with = 1.0 - classes.iter().map(|class| class.mass_fraction).sum::<f64>();
    let begins_with = if begins_with < ROUNDING { 0.0 } else { begins_with };
    classes.sort_unstable_by(|a, b| a.low_mm.total_cmp(&b.low_mm));
    let mut points: Vec<[f64; 2]> = Vec::new();
    // Classes that begin below a diameter and end above it, what all those have passed that end below it, and the next.
    let (mut open, mut closed, mut next): (Vec<Class>, f64, usize) = (Vec::new(), begins_with, 0);
    for &d in &edges {
        open.retain(|class| {
            let is_over = class.high_mm <= d;
            closed += if is_over { class.mass_fraction } else { 0.0 };
            !is_over
        });
        let partly = open.iter().map(|class| class.mass_fraction * class.mass_share(class.low_mm, d));
        let before = (closed + partly.sum::<f64>()).min(1.0);
        let mut single = 0.0;
        while let Some(class) = classes.get(next).filter(|class| class.low_mm <= d) {
            if class.law == Law::Single {
                single += class.mass_fraction;
            } else {
                open.push(*class);
            }
            next += 1;
        }
        closed += single;
        add(&mut points, [d, before]);
        if single > STEP {
            points.push([d, (before + single).min(1.0)]);
        }
    }
    if let Some(last) = points.last_mut() {
        last[1] = 1.0;
    }
    points
}

/// Adds a point. The one before it goes where it is close to both that before it and this one.
fn add(points: &mut Vec<[f64; 2]>, point: [f64; 2]) {
    if let [_, .., [a, below], [middle, _]] = points[..]
        && a < middle
        && point[1] - below < SHORT
        && ln(point[0] / a) < LONGEST
    {
        points.pop();
    }
    points.push(point);
}
