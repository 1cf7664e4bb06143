//! Water of a recipe: effective, added or total, and its stated ratio.

use super::super::{Note, Refusal};
use super::assembly::Assembly;
use super::checks::shown;
use super::draft::Entry;
use super::ingredients::{Kind, Water};
use super::parts::{CEMENT_KG_M3, Contents, Part, total_of};

/// A stated ratio of water may differ from that of the masses by this much without a word, as it is rounded.
const ROUNDED: f64 = 0.006;
/// The same of the ratio itself.
const RATIO_TOLERANCE: f64 = 0.02;
/// What differs by more contradicts the masses.
const FAR_OFF: f64 = 0.05;

impl Assembly<'_> {
    pub(super) fn take_water(&mut self, contents: &mut Contents) -> Result<(), Refusal> {
        let of = |which: Water| -> Result<Option<f64>, Refusal> {
            Ok(total_of(&self.parts(move |kind| kind == Kind::Water(which))?))
        };
        let (effective, total, added, any) =
            (of(Water::Effective)?, of(Water::Total)?, of(Water::Added)?, of(Water::Any)?);
        let taken: Option<f64> =
            contents.aggregates.iter().map(|part| Some(part.mass * part.absorption?)).sum();
        let held: Option<f64> = contents
            .aggregates
            .iter()
            .map(|part| Some(part.mass * (part.moisture? - part.absorption?) / (1.0 + part.moisture?)))
            .sum();
        let has_aggregate = !contents.aggregates.is_empty();
        contents.water = effective.or(any);
        if let (None, Some(total)) = (contents.water, total) {
            let absorbed = taken.filter(|_| has_aggregate);
            contents.water = Some(total - absorbed.unwrap_or(0.0));
            let text = match absorbed {
                Some(absorbed) => format!(
                    "the effective water is the total of {} less {} that the dry aggregates \
                    take up",
                    shown(total),
                    shown(absorbed)
                ),
                None => {
                    "the total water is read as the effective water: the absorption of the aggregates is not \
                    stated"
                        .to_owned()
                }
            };
            self.notes.push(Note::plain(None, text));
        }
        if let (None, Some(added)) = (contents.water, added) {
            let held = held.filter(|_| has_aggregate);
            contents.water = Some(added + held.unwrap_or(0.0));
            let text = match held {
                Some(held) => format!("the effective water is the added {} and {} on the surface of the \
                    aggregates", shown(added), shown(held)),
                None => "the added water is read as the effective water: moisture and absorption of the aggregates \
                    are not stated".to_owned(),
            };
            self.notes.push(Note::plain(None, text));
        }
        self.take_ratio(contents)
    }

    /// The stated ratio of water: it gives the water, or the cement, or is compared.
    fn take_ratio(&mut self, contents: &mut Contents) -> Result<(), Refusal> {
        let value = |entry: &Entry| if entry.value > 10.0 { entry.value / 100.0 } else { entry.value };
        let simple = self.entries(|kind| kind == Kind::WaterCement).next();
        let to_binder = self.entries(|kind| matches!(kind, Kind::WaterBinder(_))).next();
        let additions = total_of(&contents.additions).unwrap_or(0.0);
        let of_row = self.entries(|kind| kind == Kind::KValue).next().map(|entry| entry.value);
        let (entry, k) = match (simple, to_binder) {
            (Some(entry), _) => (entry, 0.0),
            (None, Some(entry)) => {
                let of_label = if let Kind::WaterBinder(k) = entry.label.kind { k } else { None };
                (entry, of_label.or(of_row).unwrap_or(1.0))
            }
            (None, None) => return Ok(()),
        };
        let ratio = value(entry);
        let counted = k * additions;
        match (contents.water, total_of(&contents.cement)) {
            (None, Some(cement)) => {
                contents.water = Some(ratio * (cement + counted));
                let with =
                    if counted > 0.0 { format!(" and {k} times the additions") } else { String::new() };
                let text = format!("the water is {} times the cement{with}", shown(ratio));
                self.notes.push(Note::plain(Some(entry.line), text));
            }
            (Some(water), None) if ratio > 0.0 && water / ratio > counted => {
                let text = format!("the cement follows from the water and the ratio {}", shown(ratio));
                self.notes.push(Note::plain(Some(entry.line), text));
                let mass = water / ratio - counted;
                let density_kg_m3 = CEMENT_KG_M3;
                contents.cement = vec![Part {
                    name: "cement".into(),
                    mass,
                    density_kg_m3,
                    line: entry.line,
                    ..Part::default()
                }];
            }
            (Some(water), Some(cement)) => {
                let of_k = |k: f64| water / (cement + k * additions);
                let fits = |k: f64| {
                    (of_k(k) / ratio - 1.0).abs() <= RATIO_TOLERANCE || (of_k(k) - ratio).abs() <= ROUNDED
                };
                if fits(k) {
                    return Ok(());
                }
                let other = [0.0, 0.4, 1.0].into_iter().find(|&k| additions > 0.0 && fits(k));
                let Some(other) = other else {
                    let text = format!(
                        "the ratio of water is stated as {}, and the masses give {} ({} of water, {} of cement): \
                         correct the ratio, the water or the cement",
                        shown(ratio),
                        shown(of_k(k)),
                        shown(water),
                        shown(cement)
                    );
                    if (of_k(k) / ratio - 1.0).abs() > FAR_OFF {
                        return Err(Refusal::at(entry.line, text).in_cell(entry.cell.clone()));
                    }
                    self.notes.push(Note::warning(Some(entry.line), text));
                    return Ok(());
                };
                let text = format!(
                    "the stated ratio {} counts {other} times the additions; water over cement is {}",
                    shown(ratio),
                    shown(of_k(0.0))
                );
                self.notes.push(Note::plain(Some(entry.line), text));
            }
            (None | Some(_), None) => contents.water_cement = (k == 0.0).then_some(ratio),
        }
        Ok(())
    }
}
