//! The part of a request that follows from a recipe.

use serde_json::{Map, Value, json};

use super::super::Note;
use super::super::answer::{Curve, Recipe, RecipeAggregate};
use super::super::words::fold;
use super::parts::AGGREGATE_KG_M3;
use super::sizes::size_mm;
use crate::request::aggregate::MAX_AGGREGATE_NAME;
use crate::request::{DEFAULT_D_MIN_MM, MAX_AGGREGATES, MOST_UNDERSIZE};

/// Finest grain of a class that begins at 0, in mm: the sieve between sand and fines.
const FINES_MM: f64 = 0.063;

/// Where the grading of an aggregate is from.
enum Source<'a> {
    Curve(&'a Curve),
    /// The sizes in its name, in mm.
    Sizes(f64, f64),
    None,
}

/// `{"mix": {…}}` of a recipe: its aggregates by their masses, its cement, water and additions. An aggregate has the
/// curve of its name, else one class of the sizes in its name, else no grading. `None` where the recipe has no
/// aggregate or more than a request takes.
pub(in super::super) fn request(recipe: &Recipe, curves: &[Curve]) -> Option<Value> {
    if recipe.aggregates.is_empty() || recipe.aggregates.len() > MAX_AGGREGATES {
        return None;
    }
    let sources: Vec<Source<'_>> =
        recipe.aggregates.iter().map(|aggregate| source(aggregate, recipe, curves)).collect();
    let mut names: Vec<String> = Vec::new();
    for aggregate in &recipe.aggregates {
        let limit = MAX_AGGREGATE_NAME - 4;
        let plain: String = aggregate.name.chars().filter(|c| !c.is_control()).take(limit).collect();
        let plain = if plain.is_empty() { "aggregate".to_owned() } else { plain };
        let same =
            names.iter().filter(|name| **name == plain || name.starts_with(&format!("{plain} ("))).count();
        names.push(if same == 0 { plain } else { format!("{plain} ({})", same + 1) });
    }
    let aggregates = recipe.aggregates.iter().zip(&sources).zip(names).map(|((aggregate, source), name)| {
        let mut value = Map::new();
        value.insert("name".into(), json!(name));
        value.insert("mass_kg_m3".into(), json!(aggregate.mass_kg_m3));
        value.insert("density_kg_m3".into(), json!(aggregate.density_kg_m3.unwrap_or(AGGREGATE_KG_M3)));
        match source {
            Source::Curve(curve) => {
                value.insert("grading".into(), json!({"type": "sieves", "points": curve.points}));
            }
            Source::Sizes(low, high) => {
                let class = json!({"d_min_mm": low, "d_max_mm": high, "mass_fraction": 1.0});
                value.insert("grading".into(), json!({"type": "classes", "classes": [class]}));
            }
            Source::None => {}
        }
        Value::Object(value)
    });
    let mut mix = Map::new();
    mix.insert("aggregates".into(), aggregates.collect());
    mix.insert("d_min_mm".into(), json!(cut_off_mm(&sources)));
    // Where the parts fill more than a cubic metre, the aggregates alone say their volume.
    if let (Some(cement), Some(ratio), true) =
        (recipe.cement_kg_m3, recipe.water_cement, recipe.volume_sum_m3.is_some_and(|sum| sum <= 1.0))
    {
        let mut proportions = Map::new();
        proportions.insert("cement_kg_m3".into(), json!(cement));
        proportions.insert("water_cement".into(), json!(ratio));
        if let Some(density) = recipe.cement_density_kg_m3 {
            proportions.insert("cement_density_kg_m3".into(), json!(density));
        }
        if !recipe.additions.is_empty() {
            let additions = recipe.additions.iter().map(|addition| {
                json!({"mass_kg_m3": addition.mass_kg_m3, "density_kg_m3": addition.density_kg_m3})
            });
            proportions.insert("additions".into(), additions.collect());
        }
        mix.insert("proportions".into(), Value::Object(proportions));
    }
    Some(json!({"mix": mix}))
}

/// What there is to say about the gradings of the request: which are from names, and which are missing.
pub(in super::super) fn grading_notes(recipe: &Recipe, curves: &[Curve]) -> Vec<Note> {
    let mut notes = Vec::new();
    for (number, aggregate) in recipe.aggregates.iter().enumerate() {
        let name = &aggregate.name;
        match source(aggregate, recipe, curves) {
            Source::Curve(curve) => {
                let of = curve.name.as_deref().unwrap_or(&curve.column);
                notes.push(Note::plain(None, format!("the grading of \"{name}\" is the curve \"{of}\"")));
            }
            Source::Sizes(low, high) => notes.push(Note::plain(
                None,
                format!("the grading of \"{name}\" is one class from {low} to {high} mm, by its name: put its sieve \
                    curve in its place (mix.aggregates[{number}].grading)"),
            )),
            Source::None => notes.push(Note::plain(
                None,
                format!("the sieve curve of \"{name}\" is missing: paste it beside the recipe under the same name, \
                    or put it in mix.aggregates[{number}].grading"),
            )),
        }
    }
    notes
}

fn source<'a>(aggregate: &RecipeAggregate, recipe: &Recipe, curves: &'a [Curve]) -> Source<'a> {
    if let Some(curve) = curve_of(aggregate, curves) {
        return Source::Curve(curve);
    }
    if let ([curve], [_]) = (curves, recipe.aggregates.as_slice()) {
        return Source::Curve(curve);
    }
    match size_mm(&aggregate.name) {
        Some((Some(low), high)) => {
            Source::Sizes(if low > 0.0 { low } else { FINES_MM.min(high / 2.0) }, high)
        }
        // Grains of one nominal size lie between it and half of it.
        Some((None, high)) => Source::Sizes(high / 2.0, high),
        None => Source::None,
    }
}

/// The curve that is named as the aggregate is: the same name before one that contains the other.
fn curve_of<'a>(aggregate: &RecipeAggregate, curves: &'a [Curve]) -> Option<&'a Curve> {
    let folded = |text: &str| fold(text).split_whitespace().collect::<Vec<_>>().join(" ");
    let own = folded(&aggregate.name);
    let named = || curves.iter().map(|curve| (folded(curve.name.as_deref().unwrap_or(&curve.column)), curve));
    let same = named().find(|(name, _)| *name == own);
    let alike = || {
        let mut found = named().filter(|(name, _)| {
            name.len() > 2 && own.len() > 2 && (own.contains(name.as_str()) || name.contains(own.as_str()))
        });
        // Two that are alike are none.
        found.next().filter(|_| found.next().is_none())
    };
    same.or_else(alike).map(|(_, curve)| curve)
}

/// The cut-off of the mix: 2 mm, less for mortars, and not below what a curve describes.
fn cut_off_mm(sources: &[Source<'_>]) -> f64 {
    let mut high = 0.0_f64;
    let mut least = 0.0_f64;
    for source in sources {
        match source {
            Source::Curve(curve) => {
                high = high.max(curve.points.last().map_or(0.0, |point| point[0]));
                // More undersize than a request completes by the next sieve.
                if let Some(finest) = curve.points.first().filter(|point| point[1] > MOST_UNDERSIZE) {
                    least = least.max(finest[0]);
                }
            }
            Source::Sizes(_, of) => high = high.max(*of),
            Source::None => {}
        }
    }
    let usual = if high == 0.0 || high >= 4.0 * DEFAULT_D_MIN_MM { DEFAULT_D_MIN_MM } else { high / 4.0 };
    usual.max(least)
}
