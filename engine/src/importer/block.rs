//! Finds gradings in a table: rows that begin with a sieve, below their heads.

use super::head_rows::{joined, parted};
use super::heads::{Head, Role, head};
use super::number::{Decimal, quantity};
use super::openings::Unit;
use super::sieve::{Label, Size, label, phi_label};
use super::table::{Row, Table};
use super::values::{Cell, cell};
use crate::request::MAX_CURVE_POINTS;

/// A grading in a table.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// What stands above its heads.
    pub(super) title: Option<String>,
    /// The line of its heads.
    pub(super) line: Option<u32>,
    /// The head of its sieves.
    pub(super) sieves: Head,
    pub(super) rows: Vec<BlockRow>,
    pub(super) columns: Vec<BlockColumn>,
    /// Rows with values of which the sieve is not known: line, text, and how many rows stand above.
    pub(super) unknown: Vec<(u32, String, usize)>,
}

/// A row of a grading.
#[derive(Clone, Debug)]
pub(super) struct BlockRow {
    pub(super) line: u32,
    pub(super) label: Label,
    /// Its sieve as printed.
    pub(super) printed: String,
    /// The name of the cell of the sieve, in a workbook.
    pub(super) cell: Option<String>,
}

/// A column of values.
#[derive(Clone, Debug)]
pub(super) struct BlockColumn {
    pub(super) head: Head,
    /// Its place in the table, from 0.
    pub(super) index: usize,
    /// A value for each row, as printed and as read, with the name of its cell in a workbook.
    pub(super) values: Vec<(String, Cell, Option<String>)>,
}

/// Whether a label is about a size.
const fn is_size(label: Label) -> bool {
    matches!(label, Label::Sieve(_) | Label::Class(..) | Label::Below(_) | Label::Above(_))
}

/// Whether a table has a column of sieves below a head that says so.
pub(super) fn has_sieve_head(table: &Table, decimal: Decimal) -> bool {
    (0..table.columns()).any(|column| is_headed(table, column) && sizes(table, column, decimal).len() >= 2)
}

/// Whether a column has a head of sieves above its first size.
fn is_headed(table: &Table, column: usize) -> bool {
    let texts = table.rows.iter().map(|row| row.cell(column)).filter(|text| !text.is_empty());
    let mut heads = texts.take_while(|text| label(text, Decimal::Point).is_none_or(|label| !is_size(label)));
    heads.any(|text| text.len() < MAX_HEAD_BYTES && head(text).role == Role::Sieve)
}

/// A longer text is no head.
const MAX_HEAD_BYTES: usize = 80;

/// The rows of a column with a size, with its number.
fn sizes(table: &Table, column: usize, decimal: Decimal) -> Vec<(usize, Size)> {
    let rows = table.rows.iter().enumerate();
    rows.filter_map(|(row, of)| match label(of.cell(column), decimal)? {
        Label::Sieve(size) | Label::Below(size) | Label::Above(size) | Label::Class(size, _) => {
            Some((row, size))
        }
        _ => None,
    })
    .collect()
}

/// The columns of a table without heads that can be its sieves: those whose sizes go in one direction.
pub(super) fn possible_sieves(table: &Table, decimal: Decimal) -> Vec<usize> {
    let is_ordered = |column: &usize| {
        let sizes = sizes(table, *column, decimal);
        let rises = |pair: &[(usize, Size)]| pair[0].1.number < pair[1].1.number;
        let falls = |pair: &[(usize, Size)]| pair[0].1.number > pair[1].1.number;
        sizes.len() >= 2 && (sizes.windows(2).all(rises) || sizes.windows(2).all(falls))
    };
    (0..table.columns()).filter(is_ordered).collect()
}

/// The gradings in a table whose sieves are in this column.
pub(super) fn blocks_of(table: &Table, sieves: usize, decimal: Decimal) -> Vec<Block> {
    let columns: Vec<usize> = (0..table.columns()).filter(|&column| column != sieves).collect();
    of_columns(table, sieves, &columns, decimal)
}

/// The gradings in a table.
pub(super) fn blocks(table: &Table, decimal: Decimal) -> Vec<Block> {
    let (chosen, others) = sieve_columns(table, decimal);
    let mut found = Vec::new();
    for (place, &sieves) in chosen.iter().enumerate() {
        // Columns on the left of the first sieves belong to them too; sieves side by side share those on their right.
        let first = if place == 0 { 0 } else { sieves };
        let next = chosen[place..].iter().find(|&&column| !is_beside(&chosen, sieves, column));
        let end = next.copied().unwrap_or_else(|| table.columns());
        let is_value = |column: &usize| !chosen.contains(column) && !others.contains(column);
        let columns: Vec<usize> = (first..end).filter(is_value).collect();
        let mut blocks = of_columns(table, sieves, &columns, decimal);
        if chosen.iter().any(|&other| other != sieves && is_beside(&chosen, sieves, other)) {
            for block in &mut blocks {
                block.title = block.sieves.name.clone().or(block.title.take());
            }
        }
        found.extend(blocks);
    }
    found
}

/// Whether two columns of sieves have only columns of sieves between them.
fn is_beside(chosen: &[usize], a: usize, b: usize) -> bool {
    (a.min(b)..=a.max(b)).all(|column| chosen.contains(&column))
}

/// The columns of sieves: those whose heads say so and that have sizes, else the first one with sizes; and columns that
/// have the same sieves in another unit, of which one is taken, in mm if there is one.
fn sieve_columns(table: &Table, decimal: Decimal) -> (Vec<usize>, Vec<usize>) {
    let columns = table.columns();
    let with_sizes =
        |least: usize| (0..columns).filter(move |&column| sizes(table, column, decimal).len() >= least);
    let headed: Vec<usize> = with_sizes(1).filter(|&column| is_headed(table, column)).collect();
    if headed.is_empty() {
        return (with_sizes(2).next().into_iter().collect(), Vec::new());
    }
    let is_mm = |column: usize| {
        table.rows.iter().any(|row| {
            let head = head(row.cell(column));
            head.role == Role::Sieve && head.unit == Some(Unit::Mm)
                || row.cell(column).to_lowercase().ends_with("mm")
        })
    };
    let (mut chosen, mut others): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    for column in headed {
        let beside = chosen.iter().copied().find(|&known| {
            (known..column).all(|between| chosen.contains(&between) || others.contains(&between))
                && are_alike(table, known, column, decimal)
        });
        match beside {
            Some(known) if !is_mm(known) && is_mm(column) => {
                chosen.retain(|of| *of != known);
                others.push(known);
                chosen.push(column);
            }
            Some(_) => others.push(column),
            None => chosen.push(column),
        }
    }
    (chosen, others)
}

/// Whether two columns can have the same sieves: no two sizes in mm differ by more than a tenth.
fn are_alike(table: &Table, a: usize, b: usize, decimal: Decimal) -> bool {
    let mm = |size: Size, column: usize| {
        let of_head = table.rows.iter().find_map(|row| head(row.cell(column)).unit);
        size.unit
            .or(of_head)
            .or(size.is_fraction.then_some(Unit::Inch))
            .filter(|unit| matches!(unit, Unit::Mm | Unit::Um | Unit::Inch))
            .and_then(|unit| unit.mm(size.number))
    };
    let (first, second) = (sizes(table, a, decimal), sizes(table, b, decimal));
    first.iter().all(|(row, size)| {
        let other = at(&second, *row).and_then(|(_, size)| mm(*size, b));
        match (mm(*size, a), other) {
            (Some(a), Some(b)) => (a / b - 1.0).abs() < 0.1,
            _ => true,
        }
    })
}

/// The size of a row.
fn at(sizes: &[(usize, Size)], row: usize) -> Option<&(usize, Size)> {
    sizes.binary_search_by_key(&row, |(of, _)| *of).ok().map(|at| &sizes[at])
}

/// Whether a column has the sizes of the sieves in another unit.
fn is_size_again(table: &Table, sieves: usize, column: usize, decimal: Decimal) -> bool {
    let others = sizes(table, column, decimal);
    let mut pairs = 0;
    let mut equal = 0;
    for (row, size) in sizes(table, sieves, decimal) {
        let Some((_, other)) = at(&others, row) else { continue };
        let units = match size.unit {
            Some(unit) => vec![unit],
            None if size.is_fraction => vec![Unit::Inch],
            None => vec![Unit::UsSieve, Unit::BsMesh, Unit::Inch, Unit::Mm],
        };
        let other = other.unit.unwrap_or(Unit::Mm).mm(other.number);
        let is_equal = |unit: Unit| match (unit.mm(size.number), other) {
            (Some(a), Some(b)) => (a / b - 1.0).abs() < 0.1,
            _ => false,
        };
        pairs += 1;
        equal += usize::from(units.into_iter().any(is_equal));
    }
    pairs >= 2 && 10 * equal >= 8 * pairs
}

/// The gradings of one column of sieves.
fn of_columns(table: &Table, sieves: usize, columns: &[usize], decimal: Decimal) -> Vec<Block> {
    let is_phi = table.rows.iter().any(|row| head(row.cell(sieves)).unit == Some(Unit::Phi));
    let size_of = |text: &str| if is_phi { phi_label(text, decimal) } else { label(text, decimal) };
    // The name of the pan or of a total may stand in another column.
    let label_of = |row: &Row| {
        let is_other = |label: &Label| !is_size(*label);
        let first = Some(row.cell(sieves)).filter(|text| !text.is_empty());
        first.and_then(size_of).or_else(|| {
            let mut words = row.cells.iter().filter(|text| text.chars().any(char::is_alphabetic));
            words.find_map(|text| label(text, decimal).filter(is_other))
        })
    };
    // In a text the row of the pan has no cell where others have the size in a second unit.
    let width = table.columns();
    let again = (0..width).filter(|&of| of != sieves && is_size_again(table, sieves, of, decimal)).count();
    let shift = |row: &Row| {
        let is_named = table.is_spaced && label(row.cell(0), decimal).is_some_and(|label| !is_size(label));
        if is_named { width.saturating_sub(row.cells.len()).min(again.max(sieves)) } else { 0 }
    };
    let text_of = |row: &Row, column: usize| -> String {
        let shift = shift(row);
        let is_moved = shift > 0 && column > sieves;
        (if is_moved { column.checked_sub(shift) } else { Some(column) })
            .map_or_else(String::new, |column| row.cell(column).to_owned())
    };
    let has_value =
        |row: &Row| columns.iter().any(|&column| cell(&text_of(row, column), decimal).is_number());
    let mut found: Vec<Block> = Vec::new();
    let mut heads: Vec<&Row> = Vec::new();
    let mut open = false;
    for (number, row) in table.rows.iter().enumerate() {
        if row.is_empty() || is_rule(row) {
            continue;
        }
        let label = label_of(row);
        let is_data = label.is_some() && has_value(row);
        // A row with a sieve and texts in place of all values has a fault that the column names.
        let has_text =
            label.is_some_and(is_size) && columns.iter().any(|&column| !text_of(row, column).is_empty());
        let (true, Some(label)) = (is_data || (open && has_text), label) else {
            if let (true, true, Some(block)) = (open, has_value(row), found.last_mut()) {
                block.unknown.push((row.line, row.text(), block.rows.len()));
                continue;
            }
            heads.push(row);
            open = false;
            continue;
        };
        let is_repeated =
            !heads.is_empty() && found.last().is_some_and(|block| repeats(block, &heads, sieves, columns));
        let is_note = !heads.is_empty() && heads.iter().all(|row| is_note(row, sieves));
        let goes_on = (is_note || is_repeated) && goes_on(found.last(), label);
        if !open && !goes_on {
            let before = found.pop_if(|block| block.rows.iter().all(|row| !is_size(row.label)));
            let mut block = begun(table, &heads, sieves, columns);
            if let Some(before) = before {
                block.take_rows(before);
            }
            found.push(block);
        }
        heads.clear();
        open = true;
        // One row above the limit is refused.
        if let Some(block) = found.last_mut().filter(|block| block.rows.len() <= MAX_CURVE_POINTS) {
            let printed = row.cell(sieves).to_owned();
            block.rows.push(BlockRow {
                line: row.line,
                label,
                printed,
                cell: table.cell_name(number, sieves),
            });
            for column in &mut block.columns {
                let text = text_of(row, column.index);
                let value = cell(&text, decimal);
                column.values.push((text, value, table.cell_name(number, column.index)));
            }
        }
    }
    for block in &mut found {
        block.columns.retain(|column| column.values.iter().any(|(_, cell, _)| cell.is_number()));
        block.make_classes(decimal);
    }
    found.retain(|block| {
        let least = if block.sieves.text.is_empty() { 2 } else { 1 };
        block.rows.iter().filter(|row| is_size(row.label)).count() >= least && !block.columns.is_empty()
    });
    found
}

/// Whether a row is a line that is drawn.
fn is_rule(row: &Row) -> bool {
    row.cells.iter().all(|cell| cell.chars().all(|c| "-_=+|* ".contains(c)))
}

impl Block {
    /// Leaves the values without a word about what they are.
    pub(super) fn forget_heads(&mut self) {
        for column in &mut self.columns {
            column.head = head("");
        }
    }

    /// Puts the rows of another block in front: the mass of the sample above the heads.
    fn take_rows(&mut self, before: Self) {
        for column in &mut self.columns {
            let values =
                before.columns.iter().find(|of| of.index == column.index).map(|of| of.values.clone());
            let empty = || (String::new(), Cell::Empty, None);
            column.values = values.unwrap_or_else(|| before.rows.iter().map(|_| empty()).collect());
        }
        self.rows = before.rows;
    }

    /// Where other rows are classes, `1/2` is the class from 1 to 2 mm, not half an inch.
    fn make_classes(&mut self, decimal: Decimal) {
        let classes = |row: &&BlockRow| matches!(row.label, Label::Class(..)) && row.printed.contains('/');
        if self.rows.iter().filter(classes).count() < 2 {
            return;
        }
        for row in &mut self.rows {
            if let Label::Sieve(size) = row.label
                && size.is_fraction
                && let Some((low, high)) = row.printed.split_once('/')
                && let (Some(low), Some(high)) = (quantity(low, decimal), quantity(high, decimal))
            {
                let of = |number: f64| Size { number, is_fraction: false, unit: size.unit };
                row.label = Label::Class(of(low.value), of(high.value));
            }
        }
    }
}

/// Whether a row is a sentence between rows of values, not a head.
fn is_note(row: &Row, sieves: usize) -> bool {
    row.cells.iter().filter(|cell| !cell.is_empty()).count() == 1
        && head(row.cell(sieves)).role != Role::Sieve
}

/// Whether the sieve of a row goes on in the direction of a grading.
fn goes_on(block: Option<&Block>, next: Label) -> bool {
    let number = |label: Label| match label {
        Label::Sieve(size) | Label::Class(size, _) => Some(size.number),
        _ => None,
    };
    let Some(block) = block else { return false };
    let before: Vec<f64> = block.rows.iter().filter_map(|row| number(row.label)).collect();
    match (number(next), before.as_slice()) {
        (Some(next), [.., a, b]) => (b > a) == (next > *b) && next != *b,
        (None, _) => true,
        _ => false,
    }
}

/// Whether heads say again what those of a grading say, as at the top of a page.
fn repeats(block: &Block, heads: &[&Row], sieves: usize, columns: &[usize]) -> bool {
    let filled = |row: &Row| row.cells.iter().filter(|cell| !cell.is_empty()).count();
    let heads: Vec<&Row> = heads.iter().copied().filter(|row| filled(row) > 1).collect();
    let of = |column: usize| joined(&heads, column);
    !heads.is_empty()
        && of(sieves) == block.sieves.text
        && columns.iter().all(|&column| {
            block
                .columns
                .iter()
                .find(|of| of.index == column)
                .is_none_or(|known| known.head.text == of(column))
        })
}

/// A grading without rows.
fn begun(table: &Table, heads: &[&Row], sieves: usize, columns: &[usize]) -> Block {
    let filled = |row: &Row| row.cells.iter().filter(|cell| !cell.is_empty()).count();
    let mut places: Vec<usize> = columns.iter().copied().chain([sieves]).collect();
    places.sort_unstable();
    // The cells of heads and values of a text with spaces need not stand below one another.
    let parts = if table.is_spaced {
        (1..=heads.len().min(3)).find_map(|count| {
            let rows = &heads[heads.len() - count..];
            let line = rows.iter().map(|row| row.text()).collect::<Vec<_>>().join(" ");
            parted(&line, places.len()).map(|parts| (count, parts))
        })
    } else {
        None
    };
    let (texts, titles): (Vec<(usize, String)>, Vec<&Row>) = match parts {
        Some((count, parts)) => {
            (places.iter().copied().zip(parts).collect(), heads[..heads.len() - count].to_vec())
        }
        None if table.is_spaced => (Vec::new(), Vec::new()),
        None => {
            // A row with one cell is a title, where the sieves have a head of their own.
            let has_heads = heads.iter().any(|row| filled(row) > 1);
            let (heads, titles): (Vec<&Row>, Vec<&Row>) = heads
                .iter()
                .copied()
                .partition(|row| filled(row) > 1 || (!has_heads && head(&row.text()).role == Role::Sieve));
            (places.iter().map(|&column| (column, joined(&heads, column))).collect(), titles)
        }
    };
    let title = titles.last().map(|row| row.text().trim().to_owned()).or_else(|| table.name.clone());
    let text =
        |column: usize| texts.iter().find(|(of, _)| *of == column).map_or("", |(_, text)| text.as_str());
    let sieve_head = Head { role: Role::Sieve, ..head(text(sieves)) };
    let columns = columns
        .iter()
        .map(|&index| BlockColumn { head: head(text(index)), index, values: Vec::new() })
        .filter(|column| !matches!(column.head.role, Role::Other | Role::Sieve))
        .collect();
    let line = heads.last().map(|row| row.line);
    Block { title, line, sieves: sieve_head, rows: Vec::new(), columns, unknown: Vec::new() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::importer::split::readings;

    fn found(text: &str) -> Vec<Block> {
        blocks(&readings(text)[0][0], Decimal::Point)
    }

    #[test]
    fn a_grading_has_its_heads_rows_and_columns() {
        let blocks =
            found("Sand 0/4\nSieve mm;Retained g;Passing %\n4;0;100\n2;10;90\nPan;90;\nTotal;100;\n");
        assert_eq!(blocks.len(), 1);
        let block = &blocks[0];
        assert_eq!(block.title.as_deref(), Some("Sand 0/4"));
        assert_eq!(block.rows.len(), 4);
        assert_eq!(block.columns[1].head.text, "Passing %");
        assert_eq!(block.rows[3].label, Label::Total);
    }

    #[test]
    fn two_columns_of_sieves_are_one_scale_only_where_they_agree() {
        let scales = |inches: [&str; 3]| {
            let [a, b, c] = inches;
            found(&format!("Sieve mm;Sieve in;Passing %\n19;{a};100\n9.5;{b};60\n4.75;{c};20\n")).len()
        };
        assert_eq!(scales(["3/4", "3/8", "0.187"]), 1);
        assert_eq!(scales(["1", "1/2", "1/4"]), 2);
    }

    #[test]
    fn gradings_stand_side_by_side_and_below_one_another() {
        let beside = found("Sieve;Passing;Sieve;Passing\n4;100;8;100\n2;50;4;20\n");
        assert_eq!(beside.iter().map(|block| block.columns.len()).collect::<Vec<_>>(), [1, 1]);
        let below = found("Sand\nSieve;Passing\n4;100\n2;50\n\nGravel\nSieve mm;Passing\n8;100\n4;20\n");
        assert_eq!(
            below.iter().map(|block| block.title.clone().unwrap()).collect::<Vec<_>>(),
            ["Sand", "Gravel"]
        );
        let pages = found("Sieve;Passing\n8;100\n4;50\nSieve;Passing\n2;30\n1;20\n");
        assert_eq!(pages.len(), 1, "a head that is repeated");
    }
}
