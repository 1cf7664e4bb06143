//! Tables of cells, as every form of input becomes one, and the limits of what is read.

use super::Refusal;

/// Most rows of an input.
pub const MAX_ROWS: usize = 20_000;
/// Most columns of a table.
pub const MAX_COLUMNS: usize = 64;
/// Longest cell that is looked at, in bytes; what is longer is prose.
const MAX_CELL_BYTES: usize = 400;

/// Rows of cells, from one sheet, one table of a page, or a text.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Table {
    /// The name of its sheet, or its caption.
    pub(super) name: Option<String>,
    /// Whether cells have names, such as `B7`: those of a workbook.
    pub(super) is_sheet: bool,
    /// Whether its cells are parted by spaces, so that those of heads and values need not stand below one another.
    pub(super) is_spaced: bool,
    pub(super) rows: Vec<Row>,
}

/// A row of a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Row {
    /// Its line in a text, or its number in a sheet, from 1.
    pub(super) line: u32,
    /// Its cells, without spaces around them.
    pub(super) cells: Vec<String>,
}

impl Row {
    /// A row of these cells. What is not looked at is cut off.
    pub(super) fn of<S: AsRef<str>>(line: u32, cells: impl IntoIterator<Item = S>) -> Self {
        let cells = cells.into_iter().map(|cell| {
            let cell = cell.as_ref().trim_matches(|c: char| c.is_whitespace() || c == '\u{feff}');
            let end = cell.char_indices().map(|(at, _)| at).find(|&at| at >= MAX_CELL_BYTES);
            cell[..end.unwrap_or(cell.len())].to_owned()
        });
        Self { line, cells: cells.collect() }
    }

    /// A cell; an empty text where the row is shorter.
    pub(super) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).map_or("", String::as_str)
    }

    /// Whether no cell has a text.
    pub(super) fn is_empty(&self) -> bool {
        self.cells.iter().all(String::is_empty)
    }

    /// All cells in one text.
    pub(super) fn text(&self) -> String {
        self.cells.join(" ")
    }
}

impl Table {
    /// The most cells of a row.
    pub(super) fn columns(&self) -> usize {
        self.rows.iter().map(|row| row.cells.len()).max().unwrap_or(0)
    }

    /// The name of a cell of a workbook, such as `B7`.
    pub(super) fn cell_name(&self, row: usize, column: usize) -> Option<String> {
        self.is_sheet.then(|| format!("{}{}", column_name(column), self.rows[row].line))
    }

    /// The same table with its rows as columns. Each row has the line of the first row.
    pub(super) fn transposed(&self) -> Self {
        let line = self.rows.first().map_or(1, |row| row.line);
        let rows = (0..self.columns())
            .map(|column| Row {
                line,
                cells: self.rows.iter().map(|row| row.cell(column).to_owned()).collect(),
            })
            .collect();
        Self { name: self.name.clone(), rows, ..Self::default() }
    }
}

/// The letters of a column of a workbook, from 0.
pub(super) fn column_name(column: usize) -> String {
    let letter = |number: usize| char::from(b'A' + u8::try_from(number % 26).unwrap_or(0));
    if column < 26 {
        letter(column).to_string()
    } else {
        format!("{}{}", column_name(column / 26 - 1), letter(column))
    }
}

/// Refuses tables above the limits.
///
/// # Errors
/// [`Refusal`] with the limit.
pub(super) fn check_limits(tables: &[Table]) -> Result<(), Refusal> {
    let rows: usize = tables.iter().map(|table| table.rows.len()).sum();
    if rows > MAX_ROWS {
        return Err(Refusal::new(format!(
            "has {rows} rows: must have at most {MAX_ROWS}; cut out the table"
        )));
    }
    let wide = tables.iter().flat_map(|table| &table.rows).find(|row| row.cells.len() > MAX_COLUMNS);
    match wide {
        Some(row) => Err(Refusal::at(
            row.line,
            format!("has {} columns: must have at most {MAX_COLUMNS}", row.cells.len()),
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_have_the_letters_of_workbooks() {
        let names = [(0, "A"), (25, "Z"), (26, "AA"), (51, "AZ"), (52, "BA"), (701, "ZZ"), (702, "AAA")];
        for (column, name) in names {
            assert_eq!(column_name(column), name);
        }
    }

    #[test]
    fn a_table_is_turned_with_its_missing_cells_empty() {
        let table = Table { rows: vec![Row::of(1, ["a", "b"]), Row::of(2, ["c"])], ..Table::default() };
        let turned = table.transposed();
        assert_eq!(turned.rows, [Row::of(1, ["a", "c"]), Row::of(1, ["b", ""])]);
    }
}
