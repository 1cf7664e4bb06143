//! From the amounts that are printed to the contents of a cubic metre: water by its kinds, ratios, percentages,
//! batches, totals.

use super::super::answer::{Recipe, RecipeAddition, RecipeAggregate};
use super::super::{Note, Refusal};
use super::amounts::{Assumed, Basis, basis, has_us_bags, mass};
use super::checks::{check, shown};
use super::draft::{Draft, Entry};
use super::ingredients::Kind;
use super::parts::{Contents, Part, density, stated_density, total_of, volume_m3};
use super::scale::scale;
use super::units::{CUBIC_YARD_M3, POUND_KG, Unit};

/// A total may miss the sum of its parts by this much.
pub(super) const TOTAL_TOLERANCE: f64 = 0.01;

/// More water over cement is a table whose columns are not those of its heads.
const MOST_WATER_CEMENT: f64 = 3.0;

/// The contents of a cubic metre; `None` where the draft has no concrete.
///
/// # Errors
/// [`Refusal`] where amounts contradict one another or cannot be read.
pub(super) fn recipe(draft: &Draft, assumed: Assumed) -> Result<Option<Recipe>, Refusal> {
    let with_units;
    let draft = match (basis(draft), draft.batch_m3) {
        (Basis::Bare, Some(m3)) if !draft.by_volume => {
            with_units = in_batch(draft, m3);
            &with_units
        }
        _ => draft,
    };
    let mut assembly = Assembly { draft, assumed, basis: basis(draft), notes: draft.notes.clone() };
    let Some(mut contents) = assembly.contents()? else { return Ok(None) };
    let Assembly { basis, mut notes, .. } = assembly;
    scale(&mut contents, draft, basis, &mut notes)?;
    let volume = contents.volume_m3();
    let aggregate = total_of(&contents.aggregates);
    let cement = total_of(&contents.cement);
    let assumptions: Vec<String> = contents
        .cement
        .iter()
        .chain(&contents.additions)
        .chain(&contents.aggregates)
        .chain(&contents.others)
        .filter(|part| !part.is_stated)
        .map(|part| format!("{} {}", part.name, shown(part.density_kg_m3)))
        .collect();
    if !assumptions.is_empty() {
        let list = assumptions.join(", ");
        notes.push(Note::plain(
            None,
            format!("densities that the recipe does not state are assumed, in kg/m3: {list}"),
        ));
    }
    let recipe = Recipe {
        name: draft.name.clone(),
        cement_kg_m3: cement,
        cement_density_kg_m3: cement.map(|mass| mass / volume_m3(&contents.cement)),
        additions: contents
            .additions
            .iter()
            .map(|part| RecipeAddition {
                name: part.name.clone(),
                mass_kg_m3: part.mass,
                density_kg_m3: part.density_kg_m3,
            })
            .collect(),
        water_kg_m3: contents.water,
        water_cement: contents
            .water
            .zip(cement)
            .map(|(water, cement)| water / cement)
            .or(contents.water_cement),
        air_volume_fraction: contents.air,
        aggregates: contents
            .aggregates
            .iter()
            .map(|part| RecipeAggregate {
                name: part.name.clone(),
                mass_kg_m3: part.mass,
                density_kg_m3: part.is_stated.then_some(part.density_kg_m3),
            })
            .collect(),
        aggregate_volume_fraction: aggregate.map(|_| volume_m3(&contents.aggregates)),
        volume_sum_m3: Some(volume),
        implied_air: Some(1.0 - volume),
        notes: Vec::new(),
    };
    check(&recipe, &mut notes);
    Ok(Some(Recipe { notes, ..recipe }))
}

/// Numbers without a unit, but with the volume of their batch: kilograms, and pounds for a cubic yard.
fn in_batch(draft: &Draft, m3: f64) -> Draft {
    let unit = if m3 == CUBIC_YARD_M3 { Unit::Mass(POUND_KG) } else { Unit::Mass(1.0) };
    let mut draft = draft.clone();
    for entry in draft.entries.iter_mut().filter(|entry| entry.label.kind.is_part()) {
        entry.unit.get_or_insert(unit);
    }
    let name = if m3 == CUBIC_YARD_M3 { "pounds" } else { "kilograms" };
    draft.notes.push(Note::plain(None, format!("amounts without a unit are read as {name}")));
    draft
}

pub(super) struct Assembly<'a> {
    pub(super) draft: &'a Draft,
    pub(super) assumed: Assumed,
    pub(super) basis: Basis,
    pub(super) notes: Vec<Note>,
}

impl<'a> Assembly<'a> {
    pub(super) fn entries<F: Fn(Kind) -> bool>(&self, is: F) -> impl Iterator<Item = &'a Entry> + use<'a, F> {
        self.draft.entries.iter().filter(move |entry| is(entry.label.kind))
    }

    /// The parts of a kind that have a mass.
    pub(super) fn parts(&self, is: impl Fn(Kind) -> bool) -> Result<Vec<Part>, Refusal> {
        let mut found = Vec::new();
        let has_shares = self.shares().is_some();
        for entry in self.entries(is) {
            if has_shares && entry.label.kind == Kind::Aggregate && entry.unit.is_none() {
                continue;
            }
            let stated = stated_density(entry, self.draft);
            let density_kg_m3 = stated.unwrap_or_else(|| density(&entry.label));
            if let Some(mass) =
                mass(entry, self.draft, self.basis, self.assumed, density_kg_m3)?.filter(|&kg| kg > 0.0)
            {
                found.push(Part {
                    name: entry.label.name.clone(),
                    mass,
                    density_kg_m3,
                    is_stated: stated.is_some(),
                    absorption: entry.absorption,
                    moisture: entry.moisture,
                    is_dry: entry.label.is_dry,
                    line: entry.line,
                });
            }
        }
        Ok(found)
    }

    fn contents(&mut self) -> Result<Option<Contents>, Refusal> {
        let mut contents = Contents { air: self.air()?, ..Contents::default() };
        contents.cement = self.parts(|kind| kind == Kind::Cement)?;
        contents.additions = self.parts(|kind| matches!(kind, Kind::Addition(_)))?;
        contents.others = self.parts(|kind| kind == Kind::Fibre)?;
        contents
            .others
            .extend(self.parts(|kind| kind == Kind::Admixture)?.into_iter().filter(|part| part.is_stated));
        self.take_binder(&mut contents)?;
        self.take_percent_additions(&mut contents);
        self.take_aggregates(&mut contents)?;
        self.take_water(&mut contents)?;
        self.take_percent_aggregates(&mut contents)?;
        self.take_what_is_left(&mut contents);
        let line = self.draft.entries.first().map_or(1, |entry| entry.line);
        let has_water = contents.water.is_some();
        match (contents.cement.is_empty(), contents.aggregates.is_empty()) {
            (true, true) => return Ok(None),
            (false, true) if !has_water || self.basis != Basis::CubicMetre => return Ok(None),
            (true, false) if !has_water => return Ok(None),
            (true, false) => {
                return Err(Refusal::at(
                    line,
                    "the recipe has water and aggregates and no cement: add the cement or another binder",
                ));
            }
            (false, false) if !has_water => {
                let line = contents.cement[0].line;
                return Err(Refusal::at(
                    line,
                    "the recipe has no water: add the water, or the ratio of water to cement",
                ));
            }
            _ => {}
        }
        if let (Some(water), Some(cement)) = (contents.water, total_of(&contents.cement))
            && water > MOST_WATER_CEMENT * cement
        {
            let text = format!(
                "the water is {} and the cement is {}: must be at most {MOST_WATER_CEMENT} times the cement; check \
                 that the amounts stand under their heads",
                shown(water),
                shown(cement)
            );
            return Err(Refusal::at(contents.cement[0].line, text));
        }
        self.check_total(&contents)?;
        self.say_unused(&contents);
        let has_open_bag = |entry: &Entry| matches!(entry.unit, Some(Unit::Bags { kg: None, .. }));
        if has_us_bags(self.draft) && self.draft.entries.iter().any(has_open_bag) {
            let text = "sacks are read as those of 94 lb, as the other parts are in pounds";
            self.notes.push(Note::warning(None, text));
        }
        Ok(Some(contents))
    }

    /// The stated air, over the volume of the concrete.
    fn air(&self) -> Result<Option<f64>, Refusal> {
        let Some(entry) = self.entries(|kind| kind == Kind::Air).next() else { return Ok(None) };
        let value = entry.value;
        let air = match entry.unit {
            // Less than 0.2 % of air is none: it is a fraction.
            Some(Unit::Percent(_)) if value >= 0.2 || value == 0.0 => value / 100.0,
            Some(Unit::Percent(_)) => value,
            Some(Unit::Share(factor)) => value * factor,
            Some(Unit::Volume(factor)) => match self.basis {
                Basis::Batch(Some(m3)) => value * factor / m3,
                _ => value * factor,
            },
            // In a column of masses air is in percent, or a fraction where it is as small as one.
            _ if value < 0.2 => value,
            _ => value / 100.0,
        };
        if air >= 0.9 {
            return Err(Refusal::at(
                entry.line,
                format!("the air is {value}: must be a percentage of the volume, or litres in a cubic metre (l/m3)"),
            )
            .in_cell(entry.cell.clone()));
        }
        Ok(Some(air))
    }

    /// Cement with its additions: a total where the cement stands beside it, else the cement.
    fn take_binder(&mut self, contents: &mut Contents) -> Result<(), Refusal> {
        let binder = self.parts(|kind| kind == Kind::Binder)?;
        let Some(first) = binder.first() else { return Ok(()) };
        let additions = total_of(&contents.additions).unwrap_or(0.0);
        if let Some(cement) = total_of(&contents.cement) {
            let (sum, total) = (cement + additions, first.mass);
            if (total / sum - 1.0).abs() > TOTAL_TOLERANCE && (total / cement - 1.0).abs() > TOTAL_TOLERANCE {
                return Err(total_fault(first, total, sum, "cement and additions"));
            }
            return Ok(());
        }
        let mass = total_of(&binder).unwrap_or(0.0) - additions;
        if mass <= 0.0 {
            let text = format!(
                "\"{}\" is {}: must be more than its additions, {}",
                first.name,
                shown(first.mass),
                shown(additions)
            );
            return Err(Refusal::at(first.line, text));
        }
        let text = format!(
            "\"{}\" is read as the cement{}",
            first.name,
            if additions > 0.0 { " with its additions" } else { "" }
        );
        self.notes.push(Note::plain(Some(first.line), text));
        contents.cement = vec![Part { mass, ..first.clone() }];
        Ok(())
    }

    /// Additions in percent of the cement.
    fn take_percent_additions(&mut self, contents: &mut Contents) {
        let Some(cement) = total_of(&contents.cement) else { return };
        if super::amounts::is_all_percent(self.draft) {
            return;
        }
        let entries: Vec<&Entry> = self
            .entries(|kind| matches!(kind, Kind::Addition(_)))
            .filter(|entry| matches!(entry.unit, Some(Unit::Percent(_))) && entry.value > 0.0)
            .collect();
        for entry in entries {
            let name = &entry.label.name;
            self.notes.push(Note::plain(
                Some(entry.line),
                format!("\"{name}\" is {} % of the mass of the cement, on top of it", shown(entry.value)),
            ));
            let stated = stated_density(entry, self.draft);
            contents.additions.push(Part {
                name: name.clone(),
                mass: cement * entry.value / 100.0,
                density_kg_m3: stated.unwrap_or_else(|| density(&entry.label)),
                is_stated: stated.is_some(),
                line: entry.line,
                ..Part::default()
            });
        }
    }

    /// A total must be the sum of its parts.
    fn check_total(&mut self, contents: &Contents) -> Result<(), Refusal> {
        let is_mass = |entry: &Entry| {
            matches!(entry.unit, Some(Unit::Content(_) | Unit::Mass(_)))
                || self.basis == Basis::Bare && entry.unit.is_none()
        };
        let Some(entry) = self.entries(|kind| kind == Kind::Total).find(|entry| is_mass(entry)) else {
            return Ok(());
        };
        let factor = match entry.unit {
            Some(Unit::Content(factor) | Unit::Mass(factor)) => factor,
            _ => 1.0,
        };
        let total = entry.value * factor;
        let parts = [&contents.cement, &contents.additions, &contents.aggregates];
        let mut sum: f64 =
            parts.iter().filter_map(|parts| total_of(parts)).sum::<f64>() + contents.water.unwrap_or(0.0);
        for part in self.parts(|kind| matches!(kind, Kind::Admixture | Kind::Fibre))? {
            sum += part.mass;
        }
        // What is left out may be in the total.
        let left_out: f64 = self.parts(|kind| kind == Kind::Unknown)?.iter().map(|part| part.mass).sum();
        if (total / (sum + left_out) - 1.0).abs() <= TOTAL_TOLERANCE {
            sum += left_out;
        }
        if total > 0.0 && (total / sum - 1.0).abs() > TOTAL_TOLERANCE {
            let part =
                Part { name: entry.label.name.clone(), mass: total, line: entry.line, ..Part::default() };
            return Err(total_fault(&part, total, sum, "the parts").in_cell(entry.cell.clone()));
        }
        if total > 0.0 && (total / sum - 1.0).abs() > 1.0e-3 {
            let text = format!("the total is {}, and the parts sum to {}", shown(total), shown(sum));
            self.notes.push(Note::plain(Some(entry.line), text));
        }
        Ok(())
    }

    /// Says which rows do not count.
    fn say_unused(&mut self, contents: &Contents) {
        let mut unused = Vec::new();
        for entry in self.entries(|kind| kind == Kind::Admixture) {
            if !contents.others.iter().any(|part| part.name == entry.label.name) {
                unused.push(format!("\"{}\"", entry.label.name));
            }
        }
        if !unused.is_empty() {
            let text = format!("admixtures are not counted in the volumes: {}", unused.join(", "));
            self.notes.push(Note::plain(None, text));
        }
        let parts = [&contents.cement, &contents.additions, &contents.aggregates];
        let sum: f64 =
            parts.iter().filter_map(|parts| total_of(parts)).sum::<f64>() + contents.water.unwrap_or(0.0);
        let mut found = Vec::new();
        for entry in self.entries(|kind| kind == Kind::Unknown).filter(|entry| entry.value > 0.0) {
            let (name, line) = (&entry.label.name, Some(entry.line));
            let counts = match entry.unit {
                Some(Unit::Content(factor) | Unit::Mass(factor)) => Some(entry.value * factor),
                Some(Unit::Share(_) | Unit::Volume(_)) => Some(0.0),
                _ => None,
            };
            match counts {
                Some(kg) if kg > 0.9 * sum => {
                    found.push(Note::plain(
                        line,
                        format!("\"{name}\" is as much as all parts, and is no part"),
                    ));
                }
                Some(_) => found.push(Note::warning(
                    line,
                    format!(
                        "\"{name}\" is no part of concrete that is known, and is left out: name it, such as \
                        sand or filler"
                    ),
                )),
                None => {}
            }
        }
        self.notes.extend(found);
        if let Some(entry) = self.entries(|kind| matches!(kind, Kind::Absorption | Kind::Moisture)).next() {
            let text = format!(
                "\"{}\" is not used: the water is read as the one that counts for the ratio",
                entry.label.name
            );
            self.notes.push(Note::plain(Some(entry.line), text));
        }
    }
}

pub(super) fn total_fault(part: &Part, total: f64, sum: f64, of: &str) -> Refusal {
    let (name, difference) = (&part.name, 100.0 * (total / sum - 1.0).abs());
    Refusal::at(
        part.line,
        format!(
            "\"{name}\" is {}, and {of} sum to {}: the difference of {} % must be at most 1 %; check the rows, or \
             leave the total out",
            shown(total),
            shown(sum),
            shown(difference)
        ),
    )
}
