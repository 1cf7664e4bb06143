//! Puts the readings of an input together: the ways to split it, to read its numbers and to turn its tables, and what
//! gradings and recipes each of them has.

use serde_json::{Value, json};

use super::block::{Block, blocks, blocks_of, has_sieve_head, possible_sieves};
use super::grading::{Outcome, outcomes};
use super::number::{Decimal, decimals};
use super::openings::Unit;
use super::recipe::{self, Recipes};
use super::source::{Source, source};
use super::split;
use super::table::{Table, check_limits, column_name};
use super::words::fold;
use super::{Band, Candidate, Curve, Level, MixReading, Note, ReadOptions, Recipe, Refusal, Verdict};
use crate::request::{LEAST_TOP, next_sieve};

/// Most combinations of readings that are looked at.
const MAX_WHOLES: usize = 64;

/// Reads gradings and recipes out of a text or a workbook. Every input has an answer.
#[must_use]
pub fn read(bytes: &[u8], options: &ReadOptions) -> MixReading {
    match try_read(bytes, options) {
        Ok(reading) => reading,
        Err(refusal) => MixReading::refused(vec![refusal.note()]),
    }
}

fn try_read(bytes: &[u8], options: &ReadOptions) -> Result<MixReading, Refusal> {
    let unit = match options.unit.as_deref() {
        None => None,
        Some(name) => Some(Unit::named(name).ok_or_else(|| {
            Refusal::new(format!(
                "\"{name}\" is no unit of sieves: must be mm, um, in, us_sieve, bs_mesh, tyler_mesh or phi"
            ))
        })?),
    };
    let (splits, notes) = match source(bytes, options.sheet.as_deref())? {
        Source::Text(text) => (split::readings(&text), Vec::new()),
        Source::Workbook(tables, notes) => (vec![tables], notes),
    };
    let mut found = Found { notes, ..Found::default() };
    for tables in &splits {
        check_limits(tables)?;
        let cells = tables.iter().flat_map(|table| &table.rows).flat_map(|row| &row.cells);
        for decimal in decimals(cells.map(String::as_str)) {
            let recipes = recipe::read(tables, decimal);
            let has_recipe = matches!(recipes, Recipes::Read(_) | Recipes::Ask(_));
            found.add_recipes(recipes);
            found.add_gradings(gradings(tables, decimal, unit, options), has_recipe);
        }
    }
    if let Some(name) = &options.curve {
        found.choose(name)?;
    }
    found.answer()
}

/// What the readings of an input have found.
#[derive(Default)]
struct Found {
    wholes: Vec<Outcome>,
    /// Recipes with what distinguishes those of which one is to be chosen.
    recipes: Vec<(Option<String>, Recipe)>,
    /// Why there is no grading, and no recipe.
    refusals: [Option<Refusal>; 2],
    notes: Vec<Note>,
}

impl Found {
    /// Beside a recipe, a table that is no grading is that of the recipe.
    fn add_gradings(&mut self, (wholes, refusal): (Vec<Outcome>, Option<Refusal>), has_recipe: bool) {
        if let (Some(refusal), false) = (refusal, has_recipe) {
            self.refusals[0].get_or_insert(refusal);
            return;
        }
        for whole in wholes {
            if self.wholes.len() < MAX_WHOLES && !self.wholes.iter().any(|known| known.is_same(&whole)) {
                self.wholes.push(whole);
            }
        }
    }

    fn add_recipes(&mut self, recipes: Recipes) {
        let found: Vec<(Option<String>, Recipe)> = match recipes {
            Recipes::None => Vec::new(),
            Recipes::Read(found) => found.into_iter().map(|recipe| (None, recipe)).collect(),
            Recipes::Ask(found) => found.into_iter().map(|(label, recipe)| (Some(label), recipe)).collect(),
            Recipes::Refused(refusal) => {
                self.refusals[1].get_or_insert(refusal);
                return;
            }
        };
        for recipe in found {
            if !self.recipes.contains(&recipe) {
                self.recipes.push(recipe);
            }
        }
    }

    /// Keeps the curve, the band or the recipe with this name.
    fn choose(&mut self, name: &str) -> Result<(), Refusal> {
        let names = self.names();
        let wanted = fold(name);
        let is_it = |of: &str| fold(of).trim() == wanted.trim();
        let is_recipe = |(label, recipe): &(Option<String>, Recipe)| {
            [label, &recipe.name].into_iter().flatten().any(|of| is_it(of))
        };
        // The curves beside a recipe may be those of its aggregates.
        if self.recipes.iter().any(is_recipe) {
            self.recipes.retain(is_recipe);
            return Ok(());
        }
        self.recipes.clear();
        for whole in &mut self.wholes {
            whole.choose(&is_it);
        }
        self.wholes.retain(|whole| !whole.curves.is_empty() || !whole.bands.is_empty());
        if self.wholes.is_empty() && self.recipes.is_empty() && !names.is_empty() {
            let names = names.join("\", \"");
            return Err(Refusal::new(format!(
                "has no curve and no recipe \"{name}\": must be one of \"{names}\""
            )));
        }
        Ok(())
    }

    /// The names of all curves, bands and recipes.
    fn names(&self) -> Vec<String> {
        let of_curves = self.wholes.iter().flat_map(|whole| whole.curves.iter().flatten()).map(label);
        let of_bands = self.wholes.iter().flat_map(|whole| &whole.bands).filter_map(|band| band.name.clone());
        let of_recipes =
            self.recipes.iter().filter_map(|(label, recipe)| label.clone().or(recipe.name.clone()));
        let mut found: Vec<String> = Vec::new();
        for name in of_curves.chain(of_bands).chain(of_recipes) {
            if !found.contains(&name) {
                found.push(name);
            }
        }
        found
    }

    /// The answer.
    fn answer(mut self) -> Result<MixReading, Refusal> {
        let [no_grading, no_recipe] = std::mem::take(&mut self.refusals);
        if let (true, Some(refusal)) = (self.recipes.is_empty(), no_recipe) {
            return Err(refusal);
        }
        if self.wholes.is_empty() && self.recipes.is_empty() {
            return Err(no_grading.unwrap_or_else(|| {
                Refusal::new(
                    "has no grading and no recipe that is known: a grading is a table with a column of sieves (mm) and \
                     one of passing (%), a recipe has rows of cement, water and aggregates with their masses",
                )
            }));
        }
        let mut reading = MixReading::refused(std::mem::take(&mut self.notes));
        for note in self.wholes.iter().flat_map(|whole| &whole.notes) {
            if !reading.notes.contains(note) {
                reading.notes.push(note.clone());
            }
        }
        reading.bands = self.wholes.first().map(|whole| whole.bands.clone()).unwrap_or_default();
        reading.curves =
            self.wholes.iter().flat_map(|whole| whole.curves.iter().flatten()).cloned().collect();
        if self.recipes.is_empty() {
            self.decide_curve(&mut reading);
        } else {
            self.decide_recipe(&mut reading);
        }
        let of_curves = reading.curves.iter().flat_map(|curve| &curve.notes);
        let of_recipes = reading.recipes.iter().flat_map(|recipe| &recipe.notes);
        let is_warned =
            reading.notes.iter().chain(of_curves).chain(of_recipes).any(|note| note.level == Level::Warning);
        reading.verdict = match (reading.candidates.is_empty(), reading.request.is_some()) {
            (false, _) => Verdict::Ask,
            (true, false) if reading.recipes.is_empty() => {
                return Err(Refusal::new(
                    "has limits alone, which are those of no curve: state a curve, or limits on both sides up to 100 %",
                ));
            }
            (true, _) => {
                if is_warned {
                    Verdict::Warn
                } else {
                    Verdict::Ok
                }
            }
        };
        Ok(reading)
    }

    /// The request of the one curve, or the candidates.
    fn decide_curve(&self, reading: &mut MixReading) {
        match (self.wholes.as_slice(), reading.curves.as_slice()) {
            ([_], [curve]) => reading.request = Some(request_of(&curve.points)),
            (_, []) => reading.candidates = reading.bands.iter().flat_map(of_band).collect(),
            (_, curves) => reading.candidates = curves.iter().map(|curve| candidate(curve, curves)).collect(),
        }
    }

    /// The request of the one recipe, whose aggregates may have curves beside it, or the candidates.
    fn decide_recipe(&mut self, reading: &mut MixReading) {
        for (_, recipe) in &mut self.recipes {
            recipe.notes.extend(recipe::grading_notes(recipe, &reading.curves));
        }
        reading.recipes = self.recipes.iter().map(|(_, recipe)| recipe.clone()).collect();
        match self.recipes.as_slice() {
            [(_, recipe)] => reading.request = recipe::request(recipe, &reading.curves),
            several => {
                let of = |number: usize, (label, recipe): &(Option<String>, Recipe)| Candidate {
                    label: label
                        .clone()
                        .or_else(|| recipe.name.clone())
                        .unwrap_or_else(|| format!("recipe {}", number + 1)),
                    curve: None,
                    recipe: Some(recipe.clone()),
                    request: recipe::request(recipe, &reading.curves).unwrap_or_else(|| json!({"mix": {}})),
                };
                reading.candidates =
                    several.iter().enumerate().map(|(number, recipe)| of(number, recipe)).collect();
            }
        }
    }
}

/// The gradings of tables, for each way to take their units all curves together; and why the first table without a
/// grading has none.
fn gradings(
    tables: &[Table],
    decimal: Decimal,
    unit: Option<Unit>,
    options: &ReadOptions,
) -> (Vec<Outcome>, Option<Refusal>) {
    let mut wholes: Vec<Outcome> = Vec::new();
    let mut refusal = None;
    for table in tables {
        match of_table(table, decimal, unit, options) {
            Ok(of_table) => {
                for ways in of_table {
                    wholes = match wholes.as_slice() {
                        [] => ways,
                        before => {
                            let both =
                                |whole: &Outcome| ways.iter().map(|way| whole.with(way)).collect::<Vec<_>>();
                            before.iter().flat_map(both).take(MAX_WHOLES).collect()
                        }
                    };
                }
            }
            Err(fault) => refusal = refusal.or(fault),
        }
    }
    (wholes, refusal)
}

/// The gradings of a table, each with its readings: as the table stands, else with its rows as columns.
fn of_table(
    table: &Table,
    decimal: Decimal,
    unit: Option<Unit>,
    options: &ReadOptions,
) -> Result<Vec<Vec<Outcome>>, Option<Refusal>> {
    let mut refusal = None;
    let turned = table.transposed();
    // A head of sieves tells how the table stands.
    let is_turned = !has_sieve_head(table, decimal) && has_sieve_head(&turned, decimal);
    let is_told = is_turned || has_sieve_head(table, decimal);
    let ways: &[&Table] = if is_turned {
        &[&turned]
    } else if !is_told && table.rows.len() <= 4 {
        // Without a head few long rows may be a table across.
        &[table, &turned]
    } else {
        &[table]
    };
    let has_words =
        table.rows.iter().flat_map(|row| &row.cells).any(|cell| cell.contains(char::is_alphabetic));
    if !is_told
        && !has_words
        && let Some(read) = by_any_column(table, decimal, unit, options)
    {
        return Ok(read);
    }
    for table in ways {
        let mut found = blocks(table, decimal);
        if let Some(column) = &options.column {
            choose_column(&mut found, column).map_err(Some)?;
        }
        if found.is_empty() {
            continue;
        }
        let read: Result<Vec<Vec<Outcome>>, Refusal> =
            found.iter().map(|block| outcomes(block, unit)).collect();
        match read {
            Ok(read) => return Ok(read),
            Err(fault) => refusal = refusal.or(Some(fault)),
        }
        // Heads of a text without columns can be parted wrongly: the values alone may tell one curve.
        if table.is_spaced {
            found.iter_mut().for_each(Block::forget_heads);
            let read: Result<Vec<Vec<Outcome>>, Refusal> =
                found.iter().map(|block| outcomes(block, unit)).collect();
            if let Ok(read) = read
                && read
                    .iter()
                    .flatten()
                    .all(|outcome| outcome.curves.len() == 1 && outcome.curves[0].len() == 1)
            {
                return Ok(read);
            }
        }
    }
    Err(refusal)
}

/// The readings of a table without a word, whose sieves may be in any column; `None` where they are in the first one
/// that can be, or in none.
fn by_any_column(
    table: &Table,
    decimal: Decimal,
    unit: Option<Unit>,
    options: &ReadOptions,
) -> Option<Vec<Vec<Outcome>>> {
    let columns = possible_sieves(table, decimal);
    let first = *columns.first()?;
    let mut ways: Vec<Outcome> = Vec::new();
    let mut is_other = false;
    for sieves in columns {
        let mut found = blocks_of(table, sieves, decimal);
        if let Some(column) = &options.column {
            choose_column(&mut found, column).ok()?;
        }
        let [block] = found.as_slice() else { continue };
        let Ok(outcomes) = outcomes(block, unit) else { continue };
        is_other |= sieves != first;
        ways.extend(outcomes.into_iter().filter(|way| !way.curves.is_empty()));
    }
    (is_other && !ways.is_empty()).then(|| vec![ways])
}

/// Keeps one column of values: by its head, its letter or its number from 1.
fn choose_column(blocks: &mut Vec<Block>, column: &str) -> Result<(), Refusal> {
    let wanted = fold(column);
    let is_it = |of: &super::block::BlockColumn| {
        fold(&of.head.text).trim() == wanted.trim()
            || column_name(of.index).eq_ignore_ascii_case(column.trim())
            || (of.index + 1).to_string() == column.trim()
            || of.head.name.as_deref().is_some_and(|name| fold(name).trim() == wanted.trim())
    };
    if !blocks.is_empty() && !blocks.iter().flat_map(|block| &block.columns).any(is_it) {
        let heads: Vec<&str> =
            blocks.iter().flat_map(|block| &block.columns).map(|of| of.head.text.as_str()).collect();
        return Err(Refusal::new(format!(
            "has no column \"{column}\": must be one of \"{}\"",
            heads.join("\", \"")
        )));
    }
    for block in blocks.iter_mut() {
        block.columns.retain(|of| is_it(of));
    }
    blocks.retain(|block| !block.columns.is_empty());
    Ok(())
}

fn label(curve: &Curve) -> String {
    curve.name.clone().unwrap_or_else(|| curve.column.clone())
}

/// What distinguishes a curve among others.
fn candidate(curve: &Curve, all: &[Curve]) -> Candidate {
    let name = label(curve);
    let is_alone = all.iter().filter(|other| label(other) == name).count() == 1;
    let label = if is_alone {
        name
    } else {
        let last = curve.points.iter().find(|[_, passing]| *passing >= 1.0).map_or(0.0, |[mm, _]| *mm);
        let [finest, passing] = curve.points[0];
        let passing = super::curve::rounded(100.0 * passing);
        let meaning = curve.meaning.name();
        format!(
            "{name}: {meaning}, sieves in {}, {passing} % below {finest} mm, all below {last} mm",
            curve.unit
        )
    };
    Candidate { label, curve: Some(curve.clone()), recipe: None, request: request_of(&curve.points) }
}

/// The part of a request that a curve is.
pub(super) fn request_of(points: &[[f64; 2]]) -> Value {
    json!({"mix": {"grading": {"type": "sieves", "points": points}}})
}

/// The curves at the limits of a band and in their middle, where they are curves.
fn of_band(band: &Band) -> Vec<Candidate> {
    let curve = |words: &str, of: &dyn Fn(&[f64; 3]) -> f64| {
        let mut points: Vec<[f64; 2]> =
            band.points.iter().map(|point| [point[0], super::curve::rounded(of(point))]).collect();
        let [.., before, [coarsest, last]] = points.as_slice() else { return None };
        let mut completed = Vec::new();
        if *last < LEAST_TOP || !points.windows(2).all(|pair| pair[0][1] <= pair[1][1]) || points[0][1] >= 1.0
        {
            return None;
        }
        if *last < 1.0 {
            let next = next_sieve(before[0], *coarsest);
            points.push([next, 1.0]);
            completed.push(next);
        }
        let name = band.name.as_ref().map_or_else(|| words.to_owned(), |name| format!("{name}, {words}"));
        let curve = Curve {
            name: Some(name.clone()),
            column: words.to_owned(),
            meaning: super::Meaning::Passing,
            unit: Unit::Mm.name().to_owned(),
            points_printed: Vec::new(),
            points: points.clone(),
            completed,
            notes: Vec::new(),
        };
        Some(Candidate { label: name, curve: Some(curve), recipe: None, request: request_of(&points) })
    };
    [
        curve("lower limits", &|point| point[1]),
        curve("middle of the limits", &|point| f64::midpoint(point[1], point[2])),
        curve("upper limits", &|point| point[2]),
    ]
    .into_iter()
    .flatten()
    .collect()
}

impl Outcome {
    /// Both together.
    fn with(&self, other: &Self) -> Self {
        let mut both = self.clone();
        both.curves.extend(other.curves.iter().cloned());
        both.bands.extend(other.bands.iter().cloned());
        both.notes.extend(other.notes.iter().cloned());
        both
    }

    /// Keeps the curves with a name, or the bands where no curve has it.
    fn choose(&mut self, is_it: &dyn Fn(&str) -> bool) {
        self.curves
            .retain(|readings| readings.iter().any(|curve| is_it(&label(curve)) || is_it(&curve.column)));
        if self.curves.is_empty() {
            self.bands.retain(|band| band.name.as_deref().is_some_and(is_it));
        }
    }
}
