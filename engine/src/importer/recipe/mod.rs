//! Reads recipes of concrete: rows of cement, water, additions, air and aggregates, in the units of laboratories.
//!
//! A table becomes rows of parts whichever way it is printed (`grid`), these become the recipes that are printed
//! (`layout`) or a ratio (`ratio`), and these the contents of a cubic metre (`amounts`, `assembly`, `scale`). The
//! volumes of all parts are summed by their densities, so that a mass in a wrong unit shows (`checks`). What a recipe
//! leaves open, the mass of a bag or a bulk density, is asked.

mod aggregates;
mod amounts;
mod assembly;
mod checks;
mod columns;
mod draft;
mod grid;
mod ingredients;
mod labels;
mod layout;
mod lines;
mod parts;
mod ratio;
mod request;
mod scale;
mod sizes;
mod titles;
mod units;
mod water;

#[cfg(test)]
mod request_tests;
#[cfg(test)]
mod tests;

use super::Refusal;
use super::answer::Recipe;
use super::number::Decimal;
use super::table::Table;
use amounts::{Assumed, Open, US_BAG_KG, open};
use draft::Draft;
use layout::drafts;

pub(super) use request::{grading_notes, request};

/// Most recipes of an input.
const MAX_RECIPES: usize = 2000;
/// Most rows of a table of recipes.
const MAX_ROWS: usize = 3000;
/// Rows that tell whether a longer table is one of recipes.
const MAX_HEAD_ROWS: usize = 100;
/// Masses of bags of cement, in kg, and what they are called.
const BAGS: [(f64, &str); 5] = [
    (25.0, "bags of 25 kg"),
    (35.0, "bags of 35 kg"),
    (42.5, "bags of 42.5 kg"),
    (50.0, "bags of 50 kg"),
    (US_BAG_KG, "bags of 94 lb (42.64 kg)"),
];
/// Bulk densities of cement, sand and gravel, in kg/m³.
const BULK: [([f64; 3], &str); 2] = [
    ([1200.0, 1450.0, 1400.0], "loose: bulk densities of cement 1200, sand 1450, gravel 1400 kg/m3"),
    ([1440.0, 1600.0, 1550.0], "compacted: bulk densities of cement 1440, sand 1600, gravel 1550 kg/m3"),
];

/// The recipes of an input.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Recipes {
    /// It has none.
    None,
    /// Each has one reading.
    Read(Vec<Recipe>),
    /// One recipe with several readings, each with what distinguishes it.
    Ask(Vec<(String, Recipe)>),
    /// It has one that cannot be read.
    Refused(Refusal),
}

/// Reads the recipes of tables.
pub(super) fn read(tables: &[Table], decimal: Decimal) -> Recipes {
    match try_read(tables, decimal) {
        Ok(recipes) => recipes,
        Err(refusal) => Recipes::Refused(refusal),
    }
}

fn try_read(tables: &[Table], decimal: Decimal) -> Result<Recipes, Refusal> {
    let cells = || tables.iter().flat_map(|table| &table.rows).flat_map(|row| &row.cells);
    let names = tables.iter().filter_map(|table| table.name.as_ref());
    // Most inputs are gradings.
    if !cells().chain(names).any(|text| ingredients::may_be_concrete(text)) {
        return Ok(Recipes::None);
    }
    let mut all: Vec<Draft> = Vec::new();
    for table in tables {
        // What is longer is no recipe, or more of them than are read.
        if table.rows.len() > MAX_ROWS {
            let first = Table {
                rows: table.rows[..MAX_HEAD_ROWS].to_vec(),
                is_spaced: table.is_spaced,
                ..Table::default()
            };
            if grid::grid(&first, decimal).is_some_and(|grid| layout::has_concrete(&grid, decimal)) {
                let rows = table.rows.len();
                return Err(Refusal::new(format!(
                    "has {rows} rows: recipes must have at most {MAX_ROWS}; cut out some"
                )));
            }
            continue;
        }
        if let Some(mut grid) = grid::grid(table, decimal) {
            grid.titles.splice(0..0, table.name.clone().filter(|_| !table.is_sheet));
            if !layout::has_concrete(&grid, decimal) {
                continue;
            }
            all.append(&mut drafts(&grid, decimal)?);
            if all.len() > MAX_RECIPES {
                let count = all.len();
                return Err(Refusal::new(format!(
                    "has {count} recipes: must have at most {MAX_RECIPES}; cut out some"
                )));
            }
        }
    }
    let rows: usize = tables.iter().map(|table| table.rows.len()).sum();
    if rows <= MAX_ROWS
        && !all.iter().any(ratio::has_aggregates)
        && let Some(draft) = ratio::draft(tables, &all, decimal)
    {
        all = vec![draft];
    }
    let mut recipes = Vec::new();
    let mut asked = Vec::new();
    for draft in &all {
        match open(draft, Assumed::default()) {
            None => recipes.extend(assembly::recipe(draft, Assumed::default())?),
            Some(_) => asked.extend(choices(draft)?),
        }
    }
    Ok(match (recipes.is_empty(), asked.is_empty()) {
        (_, false) => Recipes::Ask(asked),
        (false, true) => Recipes::Read(recipes),
        (true, true) => Recipes::None,
    })
}

/// The readings of a recipe that leaves something open.
fn choices(draft: &Draft) -> Result<Vec<(String, Recipe)>, Refusal> {
    let mut found = Vec::new();
    let mut pending = vec![(Vec::<&str>::new(), Assumed::default())];
    while let Some((labels, assumed)) = pending.pop() {
        let with = |label: &'static str| [labels.clone(), vec![label]].concat();
        match open(draft, assumed) {
            // The last one is taken first.
            Some(Open::Bag) => pending.extend(
                BAGS.iter().rev().map(|&(kg, label)| (with(label), Assumed { bag_kg: Some(kg), ..assumed })),
            ),
            Some(Open::Bulk) => pending.extend(
                BULK.iter()
                    .rev()
                    .map(|&(bulk, label)| (with(label), Assumed { bulk_kg_m3: Some(bulk), ..assumed })),
            ),
            None => {
                let named = draft.name.iter().map(String::as_str);
                let label = named.chain(labels.iter().copied()).collect::<Vec<_>>().join(", ");
                found.extend(assembly::recipe(draft, assumed)?.map(|recipe| (label, recipe)));
            }
        }
    }
    Ok(found)
}
