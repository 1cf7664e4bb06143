//! Cells of a table in which each row is a part of concrete, whichever way the table was printed.

use super::super::number::{Decimal, quantity};
use super::super::table::Table;
use super::ingredients::{Kind, kind};
use super::lines;
use super::units::{groups, unit};

/// Fewest parts in a row for a table that has one recipe a row.
const PARTS_ACROSS: usize = 3;

/// A cell with its place in the input.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Cell {
    pub(super) text: String,
    pub(super) line: u32,
    pub(super) name: Option<String>,
}

/// Rows of cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Grid {
    pub(super) rows: Vec<Vec<Cell>>,
    /// The column of the names of parts.
    pub(super) labels: usize,
    /// Texts above the table.
    pub(super) titles: Vec<String>,
}

impl Grid {
    /// A cell; an empty one where the row is shorter.
    pub(super) fn text(&self, row: usize, column: usize) -> &str {
        self.rows[row].get(column).map_or("", |cell| cell.text.as_str())
    }

    pub(super) fn columns(&self) -> usize {
        self.rows.iter().map(Vec::len).max().unwrap_or(0)
    }
}

/// Whether a cell is a number, with a unit or a footnote at most.
pub(super) fn is_amount(text: &str, decimal: Decimal) -> bool {
    amount(text, decimal).is_some_and(|(_, rest)| rest.is_empty() || unit(&rest).is_some())
}

/// The number of a cell, and what stands behind it without footnotes and remarks in brackets.
pub(super) fn amount(text: &str, decimal: Decimal) -> Option<(f64, String)> {
    let text = text.trim().trim_start_matches(['~', '≈', '≤', '<', '=']).trim_start();
    let joined;
    let text = match spaced_decimals(text) {
        Some(text) => {
            joined = text;
            joined.as_str()
        }
        None => text,
    };
    let quantity = quantity(text, decimal)?;
    let rest = quantity.rest.trim_start_matches(['*', '†', '‡', '¹', '²']).trim();
    // A tolerance.
    let rest = match rest.strip_prefix(['±', '∓']).or_else(|| rest.strip_prefix("+/-")) {
        Some(after) => super::super::number::quantity(after, decimal).map_or(rest, |of| of.rest),
        None => rest,
    };
    let mut rest = rest.to_owned();
    for (open, close) in groups(&rest).into_iter().rev() {
        // The mass of a bag stays.
        if unit(&rest[..open]).is_some() && !matches!(unit(&rest), Some(super::units::Unit::Bags { .. })) {
            rest.replace_range(open..close, "");
        }
    }
    // What is in brackets as a whole is a unit or a footnote.
    if let Some(inner) = rest.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) {
        rest = if unit(inner).is_some() { inner.to_owned() } else { String::new() };
    }
    let rest = rest.trim().trim_end_matches(['*', '.', ',', ';']).trim().to_owned();
    Some((quantity.value, rest))
}

/// A number with a space behind its decimal sign, without the space: `0. 1301`.
fn spaced_decimals(text: &str) -> Option<String> {
    let (before, after) = text.split_once(". ").or_else(|| text.split_once(", "))?;
    let is_digits = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_digit());
    (is_digits(before) && is_digits(after))
        .then(|| format!("{before}{}{after}", &text[before.len()..=before.len()]))
}

fn is_known(text: &str) -> bool {
    text.chars().any(char::is_alphabetic) && kind(text).is_part()
        || matches!(kind(text), Kind::Aggregate) && text.contains("mm")
}

/// The parts of a table in rows; `None` where it names too few.
pub(super) fn grid(table: &Table, decimal: Decimal) -> Option<Grid> {
    let down = down(table, decimal);
    let across = across(table, decimal);
    match (down, across) {
        (Some((down, found)), Some((across, also))) => Some(if found >= also { down } else { across }),
        (Some((grid, _)), None) | (None, Some((grid, _))) => Some(grid),
        (None, None) => None,
    }
}

/// One part a row, with the number of parts that have an amount.
fn down(table: &Table, decimal: Decimal) -> Option<(Grid, usize)> {
    let mut rows: Vec<Vec<Cell>> = Vec::with_capacity(table.rows.len());
    let mut is_pair: Vec<bool> = Vec::with_capacity(table.rows.len());
    for (number, row) in table.rows.iter().enumerate() {
        let filled = row.cells.iter().filter(|cell| !cell.is_empty()).count();
        let pairs = if table.is_spaced || filled == 1 {
            lines::pairs(&row.text(), decimal)
        } else {
            pairs_of_cells(row, decimal)
        };
        let of = |text: &str| Cell { text: text.to_owned(), line: row.line, name: None };
        if pairs.is_empty() && table.is_spaced {
            rows.push(vec![of(&row.text())]);
        } else if pairs.is_empty() {
            let cells = row.cells.iter().enumerate();
            rows.push(
                cells
                    .map(|(column, text)| Cell { name: table.cell_name(number, column), ..of(text) })
                    .collect(),
            );
        } else {
            is_pair.resize(rows.len(), false);
            let place = row.cells.iter().position(|cell| !cell.is_empty()).unwrap_or(0);
            let named = |text: &str| Cell { name: table.cell_name(number, place), ..of(text) };
            for pair in pairs {
                let amounts = pair.amounts.iter().map(|text| named(text));
                rows.push([named(&pair.label)].into_iter().chain(amounts).collect());
            }
            is_pair.resize(rows.len(), true);
        }
    }
    if table.is_spaced {
        rows = joined_lines(rows, decimal);
    }
    let found = best_column(&rows, decimal);
    // In a table from the right to the left the names stand last.
    let width = rows.iter().map(Vec::len).max().unwrap_or(0);
    let turned: Vec<Vec<Cell>> = rows
        .iter()
        .enumerate()
        .map(|(number, row)| {
            // A pair has its name first.
            if is_pair.get(number) == Some(&true) {
                return row.clone();
            }
            let missing = std::iter::repeat_n(Cell::default(), width - row.len());
            missing.chain(row.iter().rev().cloned()).collect()
        })
        .collect();
    let also = if table.is_spaced { None } else { best_column(&turned, decimal) };
    match (found, also) {
        (Some((_, hits)), Some((labels, more))) if more > hits => {
            Some((Grid { rows: turned, labels, titles: Vec::new() }, more))
        }
        (None, Some((labels, more))) => Some((Grid { rows: turned, labels, titles: Vec::new() }, more)),
        (found, _) => found.map(|(labels, hits)| (Grid { rows, labels, titles: Vec::new() }, hits)),
    }
}

/// The pairs of a row whose cells each have a part with its amount; empty where they are cells of a table.
fn pairs_of_cells(row: &super::super::table::Row, decimal: Decimal) -> Vec<lines::Pair> {
    let has_both = |cell: &&String| {
        cell.contains(|c: char| c.is_ascii_digit())
            && cell.contains(char::is_alphabetic)
            && !is_amount(cell, decimal)
    };
    if row.cells.iter().filter(has_both).count() < PARTS_ACROSS {
        return Vec::new();
    }
    let pairs: Vec<lines::Pair> = row.cells.iter().flat_map(|cell| lines::pairs(cell, decimal)).collect();
    let with_unit = |pair: &&lines::Pair| {
        kind(&pair.label).is_part()
            && pair
                .amounts
                .iter()
                .any(|text| amount(text, decimal).is_some_and(|(_, rest)| unit(&rest).is_some()))
    };
    if pairs.iter().filter(with_unit).count() >= PARTS_ACROSS { pairs } else { Vec::new() }
}

/// The column that names most parts with amounts behind them, and how many.
fn best_column(rows: &[Vec<Cell>], decimal: Decimal) -> Option<(usize, usize)> {
    let with_amount = |row: &[Cell], column: usize| {
        // A key with its value was parted at a decimal comma.
        let is_cut =
            row[column].text.rsplit_once([':', '=']).is_some_and(|(_, after)| is_amount(after, decimal));
        !is_cut && row[column + 1..].iter().any(|cell| is_amount(&cell.text, decimal))
    };
    let mut hits = vec![0; rows.iter().map(Vec::len).max().unwrap_or(0)];
    for row in rows {
        for (column, cell) in row.iter().enumerate() {
            if is_known(&cell.text) && with_amount(row, column) {
                hits[column] += 1;
            }
        }
    }
    let best = hits.iter().copied().enumerate().rev().max_by_key(|of| of.1)?;
    (best.1 >= 1).then_some(best)
}

/// Joins a line that names a part with the next one, where that is an amount alone.
fn joined_lines(rows: Vec<Vec<Cell>>, decimal: Decimal) -> Vec<Vec<Cell>> {
    let mut joined: Vec<Vec<Cell>> = Vec::with_capacity(rows.len());
    for row in rows {
        let is_value = row.len() == 1 && is_amount(&row[0].text, decimal) && !row[0].text.contains('/');
        let with_unit =
            row.len() == 1 && amount(&row[0].text, decimal).is_some_and(|(_, rest)| unit(&rest).is_some());
        match joined.last_mut() {
            Some(last)
                if last.len() == 1 && (is_value || with_unit) && !is_amount(&last[0].text, decimal) =>
            {
                last.extend(row);
            }
            _ => joined.push(row),
        }
    }
    joined
}

/// One recipe a row, turned, with the number of parts.
fn across(table: &Table, decimal: Decimal) -> Option<(Grid, usize)> {
    let heads = |row: &super::super::table::Row| -> Vec<String> {
        // The names of a ratio.
        if row.text().contains(" : ") {
            return Vec::new();
        }
        let known = row.cells.iter().filter(|cell| is_known(cell)).count();
        let words: Vec<&str> = row.cells.iter().flat_map(|cell| cell.split_whitespace()).collect();
        if table.is_spaced
            && known < PARTS_ACROSS
            && words.iter().filter(|word| is_known(word)).count() > known
        {
            words.into_iter().map(ToOwned::to_owned).collect()
        } else {
            row.cells.clone()
        }
    };
    let parts = |cells: &[String]| {
        if cells.iter().any(|cell| is_amount(cell, decimal)) {
            return 0;
        }
        cells.iter().filter(|cell| is_known(cell)).count()
    };
    let (first, found) = table
        .rows
        .iter()
        .take(super::super::table::MAX_COLUMNS)
        .enumerate()
        .map(|(number, row)| (number, parts(&heads(row))))
        .rev()
        .max_by_key(|of| of.1)?;
    if found < PARTS_ACROSS {
        return None;
    }
    let heads = heads(&table.rows[first]);
    let columns = heads.len();
    let cell = |row: usize, column: usize| Cell {
        text: table.rows[row].cell(column).to_owned(),
        line: table.rows[row].line,
        name: table.cell_name(row, column),
    };
    let mut rows: Vec<Vec<Cell>> = (0..columns)
        .map(|column| vec![Cell { text: heads[column].clone(), ..cell(first, column) }])
        .collect();
    for row in first + 1..table.rows.len() {
        let cells = &table.rows[row].cells;
        let numbers = cells.iter().filter(|text| is_amount(text, decimal)).count();
        let units = cells.iter().filter(|text| unit(text).is_some()).count();
        // Footnotes have neither.
        if numbers + units >= 2 {
            for (column, of) in rows.iter_mut().enumerate() {
                of.push(cell(row, column));
            }
        }
    }
    // Above the heads: a head over several columns names units, a title the table.
    let titles = table.rows[..first].iter().map(super::super::table::Row::text).collect();
    (rows.first().is_some_and(|row| row.len() > 1)).then_some((Grid { rows, labels: 0, titles }, found))
}
