//! The grading curve of a mix, as it is drawn.

use super::class::Law;
use super::classes_above;
use crate::request::{Form, Mix};
use crate::sorting;

/// Part of the largest diameter down to which a curve without a finest diameter is drawn.
const DRAWN: f64 = 1.0e-3;

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
        for class in classes_above(&form, low.max(DRAWN * high)) {
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
    // What is coarser than a diameter, with or without the grains that have it.
    let coarser = |d: f64, with_equal: bool| -> f64 {
        let of_class = |class: &super::Class| match class.law {
            Law::Single => f64::from(class.low_mm > d || (with_equal && class.low_mm == d)),
            _ if class.low_mm >= d => 1.0,
            _ if class.high_mm <= d => 0.0,
            _ => class.mass_share(d, class.high_mm),
        };
        classes.iter().map(|class| class.mass_fraction * of_class(class)).sum()
    };
    let mut points = Vec::with_capacity(edges.len());
    for &d in &edges {
        let (before, after) = (1.0 - coarser(d, true), 1.0 - coarser(d, false));
        if before != after {
            points.push([d, before.max(0.0)]);
        }
        points.push([d, after.clamp(0.0, 1.0)]);
    }
    points
}
