//! Reads the laws of the ratios of the axes.

use crate::request::decode::{At, Bound, Object, all, bounded};
use crate::shape::ratios::{
    AxisRatios, DEFAULT_TARGET_ELONGATION, MAX_MEASURED_GRAINS, MAX_TABLE_VALUES, MIN_RATIO,
    RatioDistribution, RatioLaw,
};

/// Any number; its bounds are those of the law.
const ANY: Bound = Bound::closed(f64::MIN, f64::MAX, "");
const RATIO: Bound = Bound::closed(MIN_RATIO, 1.0, "");

/// Reads the law of the axis ratios, whose numbers are judged together at the end.
pub(super) fn read_ratios(at: &At<'_>) -> Option<AxisRatios> {
    #[derive(Clone, Copy)]
    enum Kind {
        Constant,
        Independent,
        Triangle,
        Measured,
        Flakiness,
        ShapeIndex,
    }
    let mut object = at.object()?;
    let kind = object.variant(&[
        ("constant", Kind::Constant),
        ("independent", Kind::Independent),
        ("triangle", Kind::Triangle),
        ("measured", Kind::Measured),
        ("flakiness", Kind::Flakiness),
        ("shape_index", Kind::ShapeIndex),
    ])?;
    let ratios =
        match kind {
            Kind::Constant => read_constant(&mut object),
            Kind::Independent => {
                let elongation = object.required("elongation").and_then(|at| read_law(&at));
                let flatness = object.required("flatness").and_then(|at| read_law(&at));
                elongation
                    .zip(flatness)
                    .map(|(elongation, flatness)| AxisRatios::Independent { elongation, flatness })
            }
            Kind::Triangle => number(&mut object, "k").map(|k| AxisRatios::Triangle { k }),
            Kind::Measured => {
                let axes = object.required("axes").and_then(|at| {
                    at.array()?;
                    let triples = bounded(&at, "triples", MAX_MEASURED_GRAINS)?;
                    all(triples.iter().map(|item| {
                        let [a, b, c] = item.array_of()?.map(|at| at.number(ANY));
                        Some([a?, b?, c?])
                    }))
                });
                let weights = read_weights(&mut object, MAX_MEASURED_GRAINS);
                axes.zip(weights).map(|(axes, weights)| AxisRatios::Measured { axes, weights })
            }
            Kind::Flakiness => read_target(&mut object)
                .map(|(index, elongation)| AxisRatios::Flakiness { index, elongation }),
            Kind::ShapeIndex => read_target(&mut object)
                .map(|(index, elongation)| AxisRatios::ShapeIndex { index, elongation }),
        };
    object.finish();
    let ratios = ratios?;
    match ratios.validate() {
        Ok(()) => Some(ratios),
        Err(faults) => {
            for fault in faults {
                at.fault_below(&fault.field, fault.detail);
            }
            None
        }
    }
}

/// Constant ratios by `elongation` and `flatness`, or by `b_over_a` and `c_over_a`.
fn read_constant(object: &mut Object<'_>) -> Option<AxisRatios> {
    let b_at = object.optional("b_over_a");
    let c_at = object.optional("c_over_a");
    if b_at.is_none() && c_at.is_none() {
        let (elongation, flatness) = (number(object, "elongation"), number(object, "flatness"));
        return Some(AxisRatios::Constant { elongation: elongation?, flatness: flatness? });
    }
    for name in ["elongation", "flatness"] {
        if let Some(at) = object.optional(name) {
            at.fault("the ratios are given by b_over_a and c_over_a too: leave one of the two pairs out");
            return None;
        }
    }
    let b = object.required("b_over_a").and_then(|at| at.number(RATIO));
    let c = object.required("c_over_a").and_then(|at| at.number(RATIO));
    let (b, c) = (b?, c?);
    if c > b {
        c_at?.fault(format!("{c} is out of range: must be at most b_over_a {b}"));
        return None;
    }
    Some(AxisRatios::Constant { elongation: b, flatness: c / b })
}

fn read_target(object: &mut Object<'_>) -> Option<(f64, RatioLaw)> {
    let index = number(object, "index");
    let elongation = match object.optional("elongation") {
        Some(at) => read_law(&at),
        None => Some(DEFAULT_TARGET_ELONGATION),
    };
    index.zip(elongation)
}

/// Reads the law of one ratio: a number or a distribution.
fn read_law(at: &At<'_>) -> Option<RatioLaw> {
    #[derive(Clone, Copy)]
    enum Kind {
        Uniform,
        Beta,
        Table,
    }
    if at.value().is_number() {
        return at.number(ANY).map(RatioLaw::Constant);
    }
    if !at.value().is_object() {
        at.fault("must be a number, or an object with the type \"uniform\", \"beta\" or \"table\"");
        return None;
    }
    let mut object = at.object()?;
    let kind = object.variant(&[("uniform", Kind::Uniform), ("beta", Kind::Beta), ("table", Kind::Table)])?;
    let law = match kind {
        Kind::Uniform => {
            let (min, max) = (number(&mut object, "min"), number(&mut object, "max"));
            min.zip(max).map(|(min, max)| RatioDistribution::Uniform { min, max })
        }
        Kind::Beta => {
            let (mean, deviation) = (number(&mut object, "mean"), number(&mut object, "standard_deviation"));
            mean.zip(deviation)
                .map(|(mean, standard_deviation)| RatioDistribution::Beta { mean, standard_deviation })
        }
        Kind::Table => {
            let values =
                object.required("values").and_then(|at| read_numbers(&at, "values", MAX_TABLE_VALUES));
            let weights = read_weights(&mut object, MAX_TABLE_VALUES);
            values.zip(weights).map(|(values, weights)| RatioDistribution::Table { values, weights })
        }
    };
    object.finish();
    law.map(RatioLaw::Distributed)
}

fn number(object: &mut Object<'_>, name: &'static str) -> Option<f64> {
    object.required(name)?.number(ANY)
}

/// Weights; none where the field is absent.
fn read_weights(object: &mut Object<'_>, max: usize) -> Option<Vec<f64>> {
    match object.optional("weights") {
        Some(at) => read_numbers(&at, "weights", max),
        None => Some(Vec::new()),
    }
}

fn read_numbers(at: &At<'_>, what: &str, max: usize) -> Option<Vec<f64>> {
    // A table of one value is a constant: it must be meant.
    at.array()?;
    all(bounded(at, what, max)?.iter().map(|item| item.number(ANY)))
}
