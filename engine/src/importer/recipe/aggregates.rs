//! Aggregates of a recipe: their sums, percentages of them, and what the other parts leave.

use super::super::{Note, Refusal};
use super::amounts::{Basis, is_all_percent};
use super::assembly::{Assembly, TOTAL_TOLERANCE, total_fault};
use super::checks::shown;
use super::draft::Entry;
use super::ingredients::{Kind, kind};
use super::parts::{AGGREGATE_KG_M3, Contents, Part, density, stated_density, subject, total_of, volume_m3};
use super::scale::of_air;
use super::sizes::size_mm;
use super::units::{Of, Unit};

/// An aggregate of less than this share of all has its decimal sign in the wrong place.
const LEAST_SHARE: f64 = 0.005;
/// All aggregate is at least this much of the cement.
const LEAST_OF_CEMENT: f64 = 0.02;
/// A row is the sum of others where it misses it by at most this.
const SAME_SUM: f64 = 1.0e-3;

impl<'a> Assembly<'a> {
    pub(super) fn take_aggregates(&mut self, contents: &mut Contents) -> Result<(), Refusal> {
        let mut aggregates = self.parts(|kind| kind == Kind::Aggregate)?;
        let totals = self.parts(|kind| kind == Kind::AllAggregate)?;
        while let Some(at) = subtotal(&aggregates) {
            let total = aggregates.remove(at);
            let text = format!("\"{}\" is the sum of aggregates that stand beside it", total.name);
            self.notes.push(Note::plain(Some(total.line), text));
        }
        if let (Some(total), Some(sum)) = (totals.first(), total_of(&aggregates)) {
            if (total.mass / sum - 1.0).abs() > TOTAL_TOLERANCE {
                return Err(total_fault(total, total.mass, sum, "the aggregates"));
            }
        } else if aggregates.is_empty() && self.percent_aggregates().next().is_none() {
            aggregates = totals;
        }
        if aggregates.is_empty()
            && let Some(entry) = self.entries(|kind| kind == Kind::AggregateCement).next()
            && let Some(cement) = total_of(&contents.cement)
        {
            aggregates.push(Part {
                name: "aggregate".to_owned(),
                mass: entry.value * cement,
                density_kg_m3: density(&entry.label),
                line: entry.line,
                ..Part::default()
            });
        }
        let all = total_of(&aggregates).unwrap_or(0.0);
        let cement = total_of(&contents.cement).unwrap_or(0.0);
        if let Some(part) = aggregates.first().filter(|_| all < LEAST_OF_CEMENT * cement) {
            let text = format!(
                "\"{}\" is {}, and the cement is {}: check its amount, its decimal sign and its unit",
                part.name,
                shown(part.mass),
                shown(cement)
            );
            return Err(Refusal::at(part.line, text));
        }
        if let Some(part) = aggregates.iter().find(|part| part.mass < LEAST_SHARE * all) {
            let text = format!(
                "\"{}\" is {}, and all aggregates are {}: check its amount, its decimal sign and its unit",
                part.name,
                shown(part.mass),
                shown(all)
            );
            return Err(Refusal::at(part.line, text));
        }
        contents.aggregates = aggregates;
        Ok(())
    }

    pub(super) fn percent_aggregates(&self) -> impl Iterator<Item = &'a Entry> + use<'a> {
        let is_all = is_all_percent(self.draft);
        let factor = if is_all { None } else { self.shares() };
        self.entries(|kind| kind == Kind::Aggregate).filter(move |entry| {
            !is_all
                && (matches!(entry.unit, Some(Unit::Percent(_))) || factor.is_some() && entry.unit.is_none())
        })
    }

    /// What makes percentages of the aggregates that have no unit where the other parts have one: 1 where they sum to
    /// 100, and 100 where they sum to 1.
    pub(super) fn shares(&self) -> Option<f64> {
        if self.basis == Basis::Bare {
            return None;
        }
        let is_share = |entry: &&Entry| matches!(entry.unit, None | Some(Unit::Percent(_)));
        let values: Vec<f64> =
            self.entries(|kind| kind == Kind::Aggregate).filter(is_share).map(|entry| entry.value).collect();
        let sum: f64 = values.iter().sum();
        let is_near = |whole: f64| (sum / whole - 1.0).abs() <= TOTAL_TOLERANCE;
        match values.len() {
            0 | 1 => None,
            _ if is_near(1.0) => Some(100.0),
            _ => is_near(100.0).then_some(1.0),
        }
    }

    /// Aggregates in percent of all aggregate: of a stated total, or of what the other parts leave.
    pub(super) fn take_percent_aggregates(&mut self, contents: &mut Contents) -> Result<(), Refusal> {
        let entries: Vec<&Entry> = self.percent_aggregates().filter(|entry| entry.value > 0.0).collect();
        let Some(first) = entries.first() else { return Ok(()) };
        // One aggregate with a mass is what the percentages are of.
        let whole = match contents.aggregates.as_slice() {
            [] => None,
            [whole] if entries.len() > 1 && size_mm(&whole.name).is_none() => Some(whole.mass),
            _ => return Ok(()),
        };
        let factor = self.shares().unwrap_or(1.0);
        let sum: f64 = entries.iter().map(|entry| factor * entry.value).sum();
        if (sum / 100.0 - 1.0).abs() > TOTAL_TOLERANCE {
            let text = format!("the aggregates sum to {} %: must sum to 100 % of all aggregate", shown(sum));
            return Err(Refusal::at(first.line, text));
        }
        let by_volume = entries.iter().any(|entry| entry.unit == Some(Unit::Percent(Of::Volume)));
        let parts = entries.iter().map(|entry| {
            let stated = stated_density(entry, self.draft);
            let density_kg_m3 = stated.unwrap_or_else(|| density(&entry.label));
            let share = factor * entry.value / sum * if by_volume { density_kg_m3 } else { 1.0 };
            Part {
                name: entry.label.name.clone(),
                mass: share,
                density_kg_m3,
                is_stated: stated.is_some(),
                line: entry.line,
                absorption: entry.absorption,
                ..Part::default()
            }
        });
        let mut parts: Vec<Part> = parts.collect();
        let total = total_of(&self.parts(|kind| kind == Kind::AllAggregate)?).or(whole);
        let (factor, from) = match total {
            Some(total) => {
                (total / total_of(&parts).unwrap_or(1.0), "of the stated total of the aggregates".to_owned())
            }
            None if self.basis == Basis::CubicMetre && !contents.cement.is_empty() => {
                let left = 1.0 - contents.volume_m3() - contents.air.unwrap_or(0.0);
                let text = format!(
                    "of the {} m3 that cement, water and additions leave, with {}",
                    shown(left),
                    of_air(contents.air)
                );
                (left / volume_m3(&parts), text)
            }
            None => {
                return Err(Refusal::at(
                    first.line,
                    "the aggregates are percentages without a total: must have a row of all aggregate with its mass",
                ));
            }
        };
        let by = if by_volume { "volume" } else { "mass" };
        self.notes
            .push(Note::plain(Some(first.line), format!("the aggregates are percentages by {by} {from}")));
        for part in &mut parts {
            part.mass *= factor;
        }
        contents.aggregates = parts;
        Ok(())
    }

    /// The aggregate that the other parts leave, where the recipe names it by its density alone.
    pub(super) fn take_what_is_left(&mut self, contents: &mut Contents) {
        let is_whole = !contents.cement.is_empty() && contents.water.is_some();
        if !contents.aggregates.is_empty() || !is_whole || self.basis != Basis::CubicMetre {
            return;
        }
        let of = |entry: &&Entry| kind(&subject(&entry.label.name)) == Kind::Aggregate;
        let Some(entry) = self.entries(|kind| kind == Kind::Density).find(of) else { return };
        let left = 1.0 - contents.volume_m3() - contents.air.unwrap_or(0.0);
        let density_kg_m3 = entry.density().unwrap_or(AGGREGATE_KG_M3);
        if left <= 0.0 {
            return;
        }
        self.notes.push(Note::warning(
            Some(entry.line),
            format!(
                "no amount of aggregate is stated: it is the {} m3 that the other parts leave, with {}",
                shown(left),
                of_air(contents.air)
            ),
        ));
        contents.aggregates = vec![Part {
            name: subject(&entry.label.name),
            mass: left * density_kg_m3,
            density_kg_m3,
            is_stated: true,
            line: entry.line,
            ..Part::default()
        }];
    }
}

/// The aggregate that is the sum of two or more that follow it or stand before it.
fn subtotal(aggregates: &[Part]) -> Option<usize> {
    (0..aggregates.len()).find(|&at| {
        let is_sum = |parts: &mut dyn Iterator<Item = &Part>| {
            let mut sum = 0.0;
            parts.enumerate().any(|(number, part)| {
                sum += part.mass;
                number > 0 && (sum / aggregates[at].mass - 1.0).abs() < SAME_SUM
            })
        };
        is_sum(&mut aggregates[at + 1..].iter()) || is_sum(&mut aggregates[..at].iter().rev())
    })
}
