//! What concrete can be: the sum of the volumes, the air that it implies, and usual contents.

use super::super::Note;
use super::super::answer::Recipe;
use super::units::CUBIC_YARD_M3;

/// Sums of volumes without a warning, in m³.
const FULL_M3: std::ops::RangeInclusive<f64> = 0.97..=1.005;
/// A sum of volumes this near to a cubic yard is one.
const YARD_TOLERANCE: f64 = 0.015;
/// Most air without a warning.
const MOST_AIR: f64 = 0.10;

/// A number in a message: four digits.
pub(super) fn shown(value: f64) -> String {
    let size = value.abs();
    let text = if size >= 100.0 {
        format!("{value:.1}")
    } else if size >= 1.0 {
        format!("{value:.3}")
    } else {
        format!("{value:.4}")
    };
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Warns of sums of volumes and contents that no concrete has.
pub(super) fn check(recipe: &Recipe, notes: &mut Vec<Note>) {
    if let Some(sum) = recipe.volume_sum_m3 {
        check_volume(recipe, sum, notes);
    }
    let aggregate: f64 = recipe.aggregates.iter().map(|aggregate| aggregate.mass_kg_m3).sum();
    let aggregate = (!recipe.aggregates.is_empty()).then_some(aggregate);
    for (field, value, low, high, unit) in [
        ("cement_kg_m3", recipe.cement_kg_m3, 100.0, 900.0, " kg/m3"),
        ("water_kg_m3", recipe.water_kg_m3, 80.0, 300.0, " kg/m3"),
        ("water_cement", recipe.water_cement, 0.2, 1.2, ""),
        ("all aggregates", aggregate, 800.0, 2600.0, " kg/m3"),
    ] {
        if let Some(value) = value.filter(|value| !(low..=high).contains(value)) {
            notes.push(Note::warning(
                None,
                format!(
                    "{field} is {}{unit}: concretes have {low} to {high}{unit}; check the amounts and their \
                    unit",
                    shown(value)
                ),
            ));
        }
    }
}

fn check_volume(recipe: &Recipe, sum: f64, notes: &mut Vec<Note>) {
    let implied = 1.0 - sum;
    let with_air = recipe.air_volume_fraction.map(|air| sum + air);
    let is_full = FULL_M3.contains(&with_air.unwrap_or(sum));
    if (sum / CUBIC_YARD_M3 - 1.0).abs() <= YARD_TOLERANCE
        || with_air.is_some_and(|sum| (sum / CUBIC_YARD_M3 - 1.0).abs() <= YARD_TOLERANCE)
    {
        let of = |mass: Option<f64>| mass.map_or("none".to_owned(), |mass| shown(mass / CUBIC_YARD_M3));
        let aggregates: Vec<String> = recipe
            .aggregates
            .iter()
            .map(|aggregate| format!("{} {}", aggregate.name, shown(aggregate.mass_kg_m3 / CUBIC_YARD_M3)))
            .collect();
        notes.push(Note::warning(
            None,
            format!(
                "the parts fill {} m3, which is a cubic yard (0.7646 m3): if the masses are those of a cubic yard, \
                 divide them by 0.7646, which gives in kg/m3 cement {}, water {}, {}; read as a cubic metre they \
                 leave {} % of air",
                shown(sum),
                of(recipe.cement_kg_m3),
                of(recipe.water_kg_m3),
                aggregates.join(", "),
                shown(100.0 * implied)
            ),
        ));
    } else if !is_full {
        let stated = match (recipe.air_volume_fraction, with_air) {
            (Some(air), Some(with_air)) => {
                format!(", and {} m3 with the stated {} % of air", shown(with_air), shown(100.0 * air))
            }
            _ => String::new(),
        };
        notes.push(Note::warning(
            None,
            format!("the parts of a cubic metre fill {} m3 without air{stated}: must fill 0.97 to 1.005 m3; check \
                the amounts, their unit and the densities", shown(sum)),
        ));
    }
    if implied > MOST_AIR {
        notes.push(Note::warning(
            None,
            format!("the volumes leave {} % of air: concretes have at most 10 %", shown(100.0 * implied)),
        ));
    }
    notes.push(Note::plain(
        None,
        format!(
            "the parts fill {} m3 without air: the implied air is {} %",
            shown(sum),
            shown(100.0 * implied)
        ),
    ));
}
