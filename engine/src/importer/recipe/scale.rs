//! From the unit of a recipe to a cubic metre of concrete.

use super::super::{Note, Refusal};
use super::amounts::{Basis, is_of_yard};
use super::checks::shown;
use super::draft::{Draft, Entry};
use super::parts::{Contents, total_of};
use super::units::{CUBIC_YARD_M3, POUND_KG, Unit};

/// Kilograms without a volume are those of a cubic metre where their parts fill so much, in m³.
const ABOUT_ONE_M3: std::ops::RangeInclusive<f64> = 0.7..=1.3;
/// What parts fill of a cubic metre or yard with the stated air, where their numbers have no unit at all, in m³.
const WHOLE_M3: std::ops::RangeInclusive<f64> = 0.94..=1.03;
/// Cement in larger numbers is no part of a ratio.
const MOST_OF_A_RATIO: f64 = 50.0;
/// A pound in a cubic yard, in kg/m³.
const POUND_YARD: f64 = POUND_KG / CUBIC_YARD_M3;

/// Multiplies masses so that they are those of a cubic metre.
pub(super) fn scale(
    contents: &mut Contents,
    draft: &Draft,
    basis: Basis,
    notes: &mut Vec<Note>,
) -> Result<(), Refusal> {
    let volume = contents.volume_m3();
    let air = contents.air.unwrap_or(0.0);
    match basis {
        Basis::CubicMetre => {
            if draft.entries.iter().any(is_of_yard) {
                notes.push(Note::plain(None, format!("a pound in a cubic yard is {POUND_YARD:.5} kg/m3")));
            }
            Ok(())
        }
        Basis::Batch(Some(m3)) => {
            contents.multiply(1.0 / m3);
            if m3 != 1.0 {
                notes.push(Note::plain(
                    None,
                    format!("the masses are those of {} l of concrete", shown(1000.0 * m3)),
                ));
            }
            Ok(())
        }
        Basis::Batch(None) => {
            let is_kg = |entry: &Entry| entry.unit == Some(Unit::Mass(1.0));
            let has_kg = draft.entries.iter().any(is_kg);
            let is_pound = |entry: &Entry| entry.unit == Some(Unit::Mass(POUND_KG));
            if has_kg && ABOUT_ONE_M3.contains(&volume) {
                let text = "no volume is stated: the masses are read as those of a cubic metre, which they fill in \
                    part or whole";
                notes.push(Note::plain(None, text));
                return Ok(());
            }
            if draft.entries.iter().any(is_pound) && WHOLE_M3.contains(&(volume / CUBIC_YARD_M3 + air)) {
                contents.multiply(1.0 / CUBIC_YARD_M3);
                let text =
                    "no volume is stated: the pounds are read as those of a cubic yard, which they fill";
                notes.push(Note::plain(None, text));
                return Ok(());
            }
            by_volume(contents, volume, "the batch", notes)
        }
        Basis::Bare => {
            let first = contents.cement.first().or(contents.aggregates.first());
            let is_small = first.is_none_or(|part| part.mass <= MOST_OF_A_RATIO);
            let has_parts = draft.by_volume
                || draft.entries.iter().any(|entry| matches!(entry.unit, Some(Unit::Parts { .. })));
            if is_small || has_parts || super::amounts::is_all_percent(draft) {
                return by_volume(contents, volume, "the ratio", notes);
            }
            let readings = [(1.0, "kg/m3"), (POUND_YARD, "lb/yd3")];
            let mut fitting =
                readings.iter().filter(|(factor, _)| WHOLE_M3.contains(&(volume * factor + air)));
            let Some((factor, unit)) = fitting.next() else {
                let line = first.map_or(1, |part| part.line);
                let name = first.map_or("", |part| part.name.as_str());
                return Err(Refusal::at(
                    line,
                    format!(
                        "the amount of \"{name}\" has no unit, and the parts fill {} m3 as kg/m3 and {} m3 as \
                         lb/yd3: name the unit in the head, such as \"kg/m3\"",
                        shown(volume),
                        shown(volume * POUND_YARD)
                    ),
                ));
            };
            contents.multiply(*factor);
            notes.push(Note::warning(
                None,
                format!(
                    "the amounts have no unit: they are read as {unit}, in which they fill {} m3; name the unit in \
                     the head",
                    shown(volume * factor)
                ),
            ));
            Ok(())
        }
    }
}

/// The air of a concrete in words.
pub(super) fn of_air(air: Option<f64>) -> String {
    air.map_or("no air, as none is stated".to_owned(), |air| {
        format!("the stated {} % of air", shown(100.0 * air))
    })
}

/// Multiplies the masses of a batch or the parts of a ratio so that they fill a cubic metre.
fn by_volume(contents: &mut Contents, volume: f64, what: &str, notes: &mut Vec<Note>) -> Result<(), Refusal> {
    if volume <= 0.0 || contents.water.is_none() && contents.cement.is_empty() {
        return Err(Refusal::new(format!(
            "{what} has too few parts: must have cement, water and aggregates"
        )));
    }
    let air = contents.air.unwrap_or(0.0);
    let factor = (1.0 - air) / volume;
    let parts = [&contents.cement, &contents.additions, &contents.aggregates];
    let is_stated =
        contents.air.is_some() && parts.iter().all(|parts| parts.iter().all(|part| part.is_stated));
    let before: Vec<String> = [("cement", total_of(&contents.cement)), ("water", contents.water)]
        .into_iter()
        .chain([("aggregate", total_of(&contents.aggregates))])
        .filter_map(|(name, mass)| Some(format!("{name} {}", shown(mass?))))
        .collect();
    let text = format!(
        "{what} ({}) states no volume: its parts are multiplied by {} so that they fill a cubic metre with {}",
        before.join(", "),
        shown(factor),
        of_air(contents.air)
    );
    notes.push(if is_stated { Note::plain(None, text) } else { Note::warning(None, text) });
    contents.multiply(factor);
    Ok(())
}
