//! Columns of recipes: which have amounts, densities, volumes and units, and the amounts of their rows.

use super::super::number::Decimal;
use super::super::values::is_blank;
use super::super::words::{fold, has};
use super::super::{Note, Refusal};
use super::MAX_RECIPES;
use super::draft::{DENSITY_KG_M3, Draft, Entry};
use super::grid::{Grid, amount, is_amount};
use super::ingredients::{Kind, has_density};
use super::labels::{Label, density_of};
use super::sizes::size_mm;
use super::titles::{key, says_volume, title_name};
use super::units::{Unit, batch_m3, unit, unit_in};

/// Most rows of a recipe.
const MAX_PARTS: usize = 100;

/// What a column has.
#[derive(Clone, Debug, PartialEq)]
enum Role {
    Amount {
        name: Option<String>,
        unit: Option<Unit>,
        rank: u32,
    },
    Unit,
    Density(Option<Unit>),
    /// Volumes of the parts, in this unit.
    Volume(Unit),
    Absorption,
    Moisture,
    /// Part of the name.
    Detail,
    None,
}

/// The columns that speak of the amounts of a column.
struct Beside {
    /// That of densities, and their unit.
    density: Option<(usize, Option<Unit>)>,
    /// That of volumes, and their unit in m³.
    volume_m3: Option<(usize, f64)>,
    absorption: Option<usize>,
    moisture: Option<usize>,
    unit: Option<usize>,
    /// Those that are part of the names.
    details: Vec<usize>,
}

impl Beside {
    /// Those behind a column of amounts and before the next amounts, or else the first.
    fn of(column: usize, roles: &[Role]) -> Self {
        let nearest = |is: &dyn Fn(&Role) -> bool| {
            let after = (column + 1..roles.len()).find(|&at| is(&roles[at]));
            let is_own = |&at: &usize| !(column + 1..at).any(|at| matches!(roles[at], Role::Amount { .. }));
            after.filter(is_own).or_else(|| (0..roles.len()).find(|&at| is(&roles[at])))
        };
        let density = nearest(&|role| matches!(role, Role::Density(_)));
        let volume = nearest(&|role| matches!(role, Role::Volume(_)));
        Self {
            density: density.map(|at| (at, if let Role::Density(unit) = roles[at] { unit } else { None })),
            volume_m3: volume.map(|at| match roles[at] {
                Role::Volume(Unit::Share(factor) | Unit::Volume(factor)) => (at, factor),
                _ => (at, 1.0),
            }),
            absorption: nearest(&|role| *role == Role::Absorption),
            moisture: nearest(&|role| *role == Role::Moisture),
            unit: nearest(&|role| *role == Role::Unit),
            details: (0..roles.len()).filter(|&at| roles[at] == Role::Detail).collect(),
        }
    }
}

/// The rows of one recipe, or of several side by side.
pub(super) struct Block<'a> {
    pub(super) grid: &'a Grid,
    pub(super) labels: &'a [Label],
    pub(super) rows: Vec<usize>,
    pub(super) heads: &'a [usize],
    pub(super) titles: &'a [String],
    pub(super) decimal: Decimal,
}

impl Block<'_> {
    /// Its recipes.
    pub(super) fn drafts(&self) -> Result<Vec<Draft>, Refusal> {
        let columns = self.grid.columns();
        if let Some(&row) = self.rows.get(MAX_PARTS) {
            let (count, line) = (self.rows.len(), self.grid.rows[row][0].line);
            return Err(Refusal::at(
                line,
                format!("is row {MAX_PARTS} of the {count} rows of a recipe: must have at most {MAX_PARTS}"),
            ));
        }
        if columns > MAX_RECIPES {
            return Err(Refusal::new(format!(
                "has {columns} recipes: must have at most {MAX_RECIPES}; cut out some"
            )));
        }
        let roles: Vec<Role> = (0..columns).map(|column| self.role(column)).collect();
        let mut amounts: Vec<(usize, Option<String>, Option<Unit>, u32)> = Vec::new();
        let mut notes = Vec::new();
        for (column, role) in roles.iter().enumerate() {
            let Role::Amount { name, unit, rank } = role else { continue };
            // The same amounts in another unit or state.
            let twin = amounts.iter_mut().find(|of| of.1 == *name && (of.3 != *rank || of.2 != *unit));
            let Some(twin) = twin else {
                amounts.push((column, name.clone(), *unit, *rank));
                continue;
            };
            let (kept, left) = if *rank < twin.3 { (column, twin.0) } else { (twin.0, column) };
            notes.push(Note::plain(
                None,
                format!(
                    "the amounts are those of {}; {} is not used",
                    self.column_name(kept),
                    self.column_name(left)
                ),
            ));
            if kept == column {
                *twin = (column, name.clone(), *unit, *rank);
            }
        }
        if amounts.is_empty() {
            // Volumes alone are the amounts.
            let volumes = roles.iter().enumerate().filter_map(|(column, role)| match role {
                Role::Volume(unit) => Some((column, None, Some(*unit), 0)),
                _ => None,
            });
            amounts.extend(volumes);
        }
        let is_single = amounts.len() == 1;
        let mut found = Vec::new();
        for (number, (column, name, unit, _)) in amounts.iter().enumerate() {
            let mut draft = Draft { notes: notes.clone(), ..Draft::default() };
            let title = self.titles.iter().find_map(|title| title_name(title));
            draft.name = match name {
                Some(name) => Some(name.clone()),
                None if is_single => title,
                None => Some(format!("{}", number + 1)),
            };
            draft.batch_m3 =
                self.titles.iter().find_map(|title| batch_m3(title, self.decimal)).or_else(|| {
                    self.heads.iter().find_map(|&row| batch_m3(self.grid.text(row, *column), self.decimal))
                });
            draft.by_volume = self.titles.iter().any(|title| says_volume(title));
            // Above the names stands the unit of all amounts.
            let of_names = self.head(self.grid.labels);
            let title_unit =
                self.titles.iter().chain([&of_names]).find_map(|title| unit_in(title)).map(|(unit, _)| unit);
            self.fill(&mut draft, *column, unit.or(title_unit), &Beside::of(*column, &roles))?;
            found.push(draft);
        }
        Ok(found)
    }

    fn column_name(&self, column: usize) -> String {
        let head = self.head(column);
        if head.is_empty() { format!("column {}", column + 1) } else { format!("\"{head}\"") }
    }

    /// The texts above a column.
    fn head(&self, column: usize) -> String {
        let texts = self.heads.iter().map(|&row| self.grid.text(row, column)).filter(|text| !text.is_empty());
        texts.collect::<Vec<_>>().join(" ")
    }

    fn role(&self, column: usize) -> Role {
        if column <= self.grid.labels {
            return Role::None;
        }
        let cells: Vec<&str> =
            self.rows.iter().map(|&row| self.grid.text(row, column)).filter(|text| !is_blank(text)).collect();
        if cells.is_empty() {
            return Role::None;
        }
        let is_number = |text: &&str| is_amount(text, self.decimal) && !is_size(text);
        let numbers = cells.iter().filter(|text| is_number(text)).count();
        let head = self.head(column);
        let folded = fold(&head);
        if numbers == 0 || 2 * numbers < cells.len() {
            if cells.iter().all(|text| unit(text).is_some() || fold(text).trim() == "1") {
                return Role::Unit;
            }
            let is_first = (self.grid.labels + 1..column).all(|before| {
                !self.rows.iter().any(|&row| {
                    is_amount(self.grid.text(row, before), self.decimal)
                        && !is_size(self.grid.text(row, before))
                })
            });
            return if is_first && numbers == 0 { Role::Detail } else { Role::None };
        }
        let (unit, name) = match unit_in(&head) {
            Some((unit, rest)) => (Some(unit), rest),
            None => (None, head.clone()),
        };
        if has(&folded, "absor|wasseraufnahme|assorb") {
            return Role::Absorption;
        }
        if has(&folded, "moisture content|feucht|eigenfeuchte|humed|humid|umid") {
            return Role::Moisture;
        }
        let is_density = has_density(&folded) && !unit.is_some_and(|unit| matches!(unit, Unit::Mass(_)));
        if is_density || unit.is_some_and(Unit::is_density) {
            return Role::Density(unit);
        }
        if has(&folded, "price|preis|cost|prix|co2|eur|gwp|bulk|schutt|fineness") {
            return Role::None;
        }
        match unit {
            Some(Unit::Volume(_) | Unit::Share(_)) => return Role::Volume(unit.unwrap_or(Unit::Share(1.0))),
            None if has(&folded, "volume|volumen|stoffraum|vol") => {
                return Role::Volume(Unit::Share(1.0));
            }
            None if has(&folded, "ratio|ratios|verhaltnis") && self.has_other_amounts(column) => {
                return Role::None;
            }
            Some(Unit::Percent(_)) if self.has_other_amounts(column) => return Role::None,
            _ => {}
        }
        let is_part =
            |&&row: &&usize| self.labels[row].kind.is_part() || self.labels[row].kind == Kind::Unknown;
        if !self.rows.iter().filter(is_part).any(|&row| is_number(&self.grid.text(row, column))) {
            return Role::None;
        }
        let (name, state) = key(&name);
        let of_unit = match unit {
            Some(Unit::Content(1.0)) => 0,
            Some(Unit::Content(_)) => 1,
            Some(Unit::Mass(_)) => 2,
            None => 3,
            _ => 4,
        };
        Role::Amount { name, unit, rank: 10 * of_unit + state }
    }

    /// Whether a column before this one has amounts.
    fn has_other_amounts(&self, column: usize) -> bool {
        (self.grid.labels + 1..self.grid.columns()).filter(|&other| other != column).any(|other| {
            let unit = unit_in(&self.head(other)).map(|(unit, _)| unit);
            matches!(unit, Some(Unit::Content(_) | Unit::Mass(_)))
        })
    }

    /// The number and the unit of a cell.
    fn number(&self, row: usize, column: usize) -> Option<(f64, Option<Unit>)> {
        amount(self.grid.text(row, column), self.decimal).map(|(value, rest)| (value, unit(&rest)))
    }

    /// The volume of a part in m³, where a column has it.
    fn volume_m3(&self, row: usize, beside: &Beside) -> Option<f64> {
        let (at, factor) = beside.volume_m3?;
        let (value, own) = self.number(row, at)?;
        Some(match own {
            Some(Unit::Share(factor) | Unit::Volume(factor)) => value * factor,
            // Where the head has no unit, a cubic metre is 1 or 1000.
            _ if factor == 1.0 && value > 1.5 => value / 1000.0,
            _ => value * factor,
        })
    }

    /// The density of a part, where a column has it.
    fn density(&self, row: usize, beside: &Beside) -> Result<Option<f64>, Refusal> {
        let Some((at, of_head)) = beside.density else { return Ok(None) };
        let Some((value, own)) = self.number(row, at) else { return Ok(None) };
        let density = match own.or(of_head) {
            Some(Unit::Content(factor)) => value * factor,
            _ => density_of(value),
        };
        let label = &self.labels[row];
        if DENSITY_KG_M3.contains(&density) || !label.kind.is_part() {
            return Ok(Some(density));
        }
        let cell = &self.grid.rows[row][at];
        let text = format!(
            "the density of \"{}\" is {density} kg/m3: must be 300 to 9000 kg/m3, or 0.3 to 9 kg/dm3; or leave it out",
            label.name
        );
        Err(Refusal::at(cell.line, text).in_cell(cell.name.clone()))
    }

    /// Reads the amounts of a column.
    fn fill(
        &self,
        draft: &mut Draft,
        column: usize,
        of_column: Option<Unit>,
        beside: &Beside,
    ) -> Result<(), Refusal> {
        for &row in &self.rows {
            let mut label = self.labels[row].clone();
            for &at in &beside.details {
                let text = self.grid.text(row, at);
                if !is_blank(text) && !fold(&label.name).contains(fold(text).trim()) {
                    label.name = format!("{} {text}", label.name);
                }
            }
            let volume_m3 = self.volume_m3(row, beside);
            let cell = self.grid.rows[row].get(column).cloned().unwrap_or_default();
            let line = if cell.line == 0 { self.grid.rows[row][0].line } else { cell.line };
            let (value, own) = match volume_m3 {
                // Air has a volume and no mass.
                Some(m3) if is_blank(&cell.text) && label.kind == Kind::Air => (m3, Some(Unit::Share(1.0))),
                _ if is_blank(&cell.text) => continue,
                _ => match self
                    .amount(&label, &cell.text)
                    .map_err(|fault| Refusal::at(line, fault).in_cell(cell.name.clone()))?
                {
                    Some(amount) => amount,
                    None => continue,
                },
            };
            let of_row = beside.unit.and_then(|at| unit(self.grid.text(row, at)));
            let unit = match (own, label.unit) {
                // The mass of a bag stands in the label.
                (Some(Unit::Bags { kg: None, in_m3 }), Some(Unit::Bags { kg, .. })) => {
                    Some(Unit::Bags { kg, in_m3 })
                }
                _ => own.or(of_row).or(label.unit).or(of_column),
            };
            let kg = match unit {
                Some(Unit::Content(factor) | Unit::Mass(factor)) => Some(value * factor),
                _ => None,
            };
            let of_volume =
                kg.zip(volume_m3).filter(|(_, volume)| *volume > 0.0).map(|(kg, volume)| kg / volume);
            let stated = label.density_kg_m3.or(self.density(row, beside)?).or(of_volume);
            let share =
                |at: Option<usize>| at.and_then(|at| self.number(row, at)).map(|(value, _)| value / 100.0);
            draft.entries.push(Entry {
                value,
                unit,
                line,
                density_kg_m3: stated.filter(|density| DENSITY_KG_M3.contains(density)),
                absorption: share(beside.absorption),
                moisture: share(beside.moisture),
                label,
                cell: cell.name,
            });
        }
        Ok(())
    }

    /// The number and unit of an amount; `None` where a row that is no part has none, else what is wrong.
    fn amount(&self, label: &Label, text: &str) -> Result<Option<(f64, Option<Unit>)>, String> {
        let name = &label.name;
        let Some((value, rest)) = amount(text, self.decimal) else {
            if label.kind.is_part() {
                return Err(format!("the amount of \"{name}\" is \"{text}\": must be a number with a unit"));
            }
            return Ok(None);
        };
        let own = unit(&rest);
        if own.is_none() && !rest.is_empty() && label.kind.is_part() {
            return Err(format!(
                "the amount of \"{name}\" is \"{text}\": must be one number with a unit, such as 350 kg/m3"
            ));
        }
        if value < 0.0 {
            return Err(format!("the amount of \"{name}\" is {value}: must be at least 0"));
        }
        Ok(Some((value, own)))
    }
}

/// Whether a cell is a size, such as `4/8`, and no amount.
fn is_size(text: &str) -> bool {
    text.contains(['/', '-']) && size_mm(text).is_some()
}
