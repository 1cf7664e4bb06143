//! Sheets of workbooks: Office Open XML (`.xlsx`) and OpenDocument (`.ods`), by the crate `calamine`.
//!
//! A workbook is a zip of XML, which can be made to unpack to any size: what its parts unpack to is counted first, and
//! so is what repeated cells of OpenDocument become.

use std::io::{self, Cursor, Read as _};

use calamine::{Data, DataRef, Ods, Reader as _, Xlsx};
use quick_xml::Reader as XmlReader;
use quick_xml::events::{BytesStart, Event};
use zip::ZipArchive;

use super::table::{MAX_COLUMNS, MAX_ROWS, Row, Table, column_name};
use super::{Note, Refusal};

/// Most bytes of a workbook.
pub const MAX_WORKBOOK_BYTES: usize = 4 << 20;
/// Most bytes that the parts of a workbook unpack to.
pub const MAX_UNPACKED_BYTES: u64 = 32 << 20;
/// Most sheets of a workbook.
pub const MAX_SHEETS: usize = 16;

/// The tables of a workbook, or of its one sheet with this name.
///
/// # Errors
/// [`Refusal`] where it is damaged, protected, above the limits, or has no such sheet.
pub(super) fn tables(bytes: &[u8], sheet: Option<&str>) -> Result<(Vec<Table>, Vec<Note>), Refusal> {
    if bytes.len() > MAX_WORKBOOK_BYTES {
        let bytes = bytes.len();
        return Err(Refusal::new(format!(
            "has {bytes} bytes: a workbook must have at most {MAX_WORKBOOK_BYTES}"
        )));
    }
    let contents = unpacked(bytes)?;
    let mut notes = Vec::new();
    let tables = match contents {
        Some(contents) => {
            check_repeats(&contents)?;
            of_open_document(bytes, sheet, &mut notes)?
        }
        None => of_office(bytes, sheet, &mut notes)?,
    };
    if tables.iter().all(|table| table.rows.is_empty()) {
        return Err(Refusal::new("has no cell with a value: must have a table"));
    }
    Ok((tables, notes))
}

fn damaged(error: impl std::fmt::Display) -> Refusal {
    Refusal::new(format!("is no workbook that can be read (.xlsx, .ods): {error}"))
}

/// Counts what all parts unpack to; the contents of an OpenDocument.
fn unpacked(bytes: &[u8]) -> Result<Option<String>, Refusal> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    let mut left = MAX_UNPACKED_BYTES;
    let mut contents = None;
    let is_open_document = archive.index_for_name("content.xml").is_some();
    for number in 0..archive.len() {
        let part = archive.by_index(number).map_err(damaged)?;
        let is_content = is_open_document && part.name().is_ok_and(|name| name == "content.xml");
        let mut part = part.take(left + 1);
        let bytes = if is_content {
            let mut text = Vec::new();
            part.read_to_end(&mut text).map_err(damaged)?;
            let bytes = text.len() as u64;
            contents = Some(String::from_utf8(text).map_err(damaged)?);
            bytes
        } else {
            io::copy(&mut part, &mut io::sink()).map_err(damaged)?
        };
        left = left.checked_sub(bytes).ok_or_else(|| {
            Refusal::new(format!("unpacks to more than {MAX_UNPACKED_BYTES} bytes, the most of a workbook"))
        })?;
    }
    Ok(contents)
}

/// Refuses an OpenDocument whose repeated cells are more than a table may have.
fn check_repeats(contents: &str) -> Result<(), Refusal> {
    let too_large = || {
        Refusal::new(format!(
            "has a table of more than {MAX_ROWS} rows or {MAX_COLUMNS} columns: cut out the table"
        ))
    };
    let mut reader = XmlReader::from_str(contents);
    reader.config_mut().check_end_names = false;
    let (mut rows, mut repeated, mut columns, mut filled) = (0_usize, 1, 0_usize, 0);
    let mut empty_rows = 0_usize;
    loop {
        let (event, is_open) = match reader.read_event().map_err(damaged)? {
            Event::Eof => return Ok(()),
            Event::Start(event) => (event, true),
            Event::Empty(event) => (event, false),
            Event::End(event) if event.name().as_ref() == "table:table-row" => {
                if filled > MAX_COLUMNS {
                    return Err(too_large());
                }
                if filled == 0 {
                    empty_rows = empty_rows.saturating_add(repeated);
                } else {
                    rows = rows.saturating_add(repeated).saturating_add(std::mem::take(&mut empty_rows));
                }
                if rows > MAX_ROWS {
                    return Err(too_large());
                }
                continue;
            }
            _ => continue,
        };
        match event.name().as_ref() {
            "table:table" => empty_rows = 0,
            "table:table-row" => {
                repeated = repeats(&event, "table:number-rows-repeated");
                (columns, filled) = (0, 0);
            }
            "table:table-cell" | "table:covered-table-cell" => {
                columns = columns.saturating_add(repeats(&event, "table:number-columns-repeated"));
                let has_value = is_open
                    || event.attributes().flatten().any(|of| {
                        let key = of.key.as_ref();
                        key.starts_with("office:") || key == "table:formula"
                    });
                if has_value {
                    filled = columns;
                }
            }
            _ => {}
        }
    }
}

fn repeats(event: &BytesStart<'_>, name: &str) -> usize {
    let value = event.attributes().flatten().find(|of| of.key.as_ref() == name);
    value.and_then(|of| of.value.parse().ok()).unwrap_or(1)
}

/// The names of the sheets to read.
fn chosen(names: Vec<String>, sheet: Option<&str>) -> Result<Vec<String>, Refusal> {
    if let Some(sheet) = sheet {
        if names.iter().any(|name| name == sheet) {
            return Ok(vec![sheet.to_owned()]);
        }
        return Err(Refusal::new(format!("has no sheet \"{sheet}\": must be one of {}", names.join(", "))));
    }
    if names.len() > MAX_SHEETS {
        let count = names.len();
        return Err(Refusal::new(format!(
            "has {count} sheets: name the one to read (sheet), or keep {MAX_SHEETS}"
        )));
    }
    Ok(names)
}

fn of_office(bytes: &[u8], sheet: Option<&str>, notes: &mut Vec<Note>) -> Result<Vec<Table>, Refusal> {
    let mut workbook: Xlsx<_> = Xlsx::new(Cursor::new(bytes)).map_err(damaged)?;
    let mut tables = Vec::new();
    for name in chosen(workbook.sheet_names(), sheet)? {
        let mut table = Table { name: Some(name.clone()), is_sheet: true, ..Table::default() };
        // A sheet of another kind, such as a chart, has no cells.
        let Ok(mut cells) = workbook.worksheet_cells_reader(&name) else { continue };
        while let Some(cell) = cells.next_cell_with_formula().map_err(damaged)? {
            let (row, column) = (cell.pos.0, cell.pos.1 as usize);
            let place = format!("{}{}", column_name(column), row + 1);
            let text = match cell.value {
                DataRef::Empty if cell.formula.is_some() => WITHOUT_VALUE.to_owned(),
                DataRef::Empty => continue,
                DataRef::DateTime(date) => {
                    let (_, month, day, ..) = date.to_ymd_hms_milli();
                    dated(month, day, place, row + 1, notes)
                }
                value => written(&value.into()),
            };
            put(&mut table, row, column, text)?;
        }
        tables.push(table);
    }
    Ok(tables)
}

fn of_open_document(bytes: &[u8], sheet: Option<&str>, notes: &mut Vec<Note>) -> Result<Vec<Table>, Refusal> {
    let mut workbook: Ods<_> = Ods::new(Cursor::new(bytes)).map_err(damaged)?;
    let mut tables = Vec::new();
    for name in chosen(workbook.sheet_names(), sheet)? {
        let mut table = Table { name: Some(name.clone()), is_sheet: true, ..Table::default() };
        let range = workbook.worksheet_range(&name).map_err(damaged)?;
        let formulas = workbook.worksheet_formula(&name).map_err(damaged)?;
        let (first_row, first_column) = range.start().unwrap_or_default();
        for (row, column, value) in range.used_cells() {
            let (row, column) =
                (first_row + u32::try_from(row).unwrap_or(u32::MAX), first_column as usize + column);
            let text = match value {
                Data::DateTimeIso(date) => {
                    let mut parts = date.split(['-', 'T']).skip(1).map(|part| part.parse().unwrap_or(0));
                    let (month, day) = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
                    dated(month, day, format!("{}{}", column_name(column), row + 1), row + 1, notes)
                }
                value => written(value),
            };
            put(&mut table, row, column, text)?;
        }
        let (first_row, first_column) = formulas.start().unwrap_or_default();
        for (row, column, _) in formulas.used_cells() {
            let (row, column) =
                (first_row + u32::try_from(row).unwrap_or(u32::MAX), first_column as usize + column);
            let at = table.rows.partition_point(|of| of.line < row + 1);
            if table.rows.get(at).is_none_or(|of| of.line > row + 1 || of.cell(column).is_empty()) {
                put(&mut table, row, column, WITHOUT_VALUE.to_owned())?;
            }
        }
        tables.push(table);
    }
    Ok(tables)
}

/// What stands in a cell whose formula was never computed.
pub(super) const WITHOUT_VALUE: &str = "(formula without a value)";

/// Puts a text into a cell, in rows that come in their order.
fn put(table: &mut Table, row: u32, column: usize, text: String) -> Result<(), Refusal> {
    if text.trim().is_empty() {
        return Ok(());
    }
    let line = row + 1;
    if column >= MAX_COLUMNS {
        let name = column_name(column);
        return Err(Refusal::at(
            line,
            format!("has a value in column {name}: must have at most {MAX_COLUMNS} columns"),
        ));
    }
    let at = table.rows.partition_point(|row| row.line < line);
    if table.rows.get(at).is_none_or(|row| row.line != line) {
        if table.rows.len() == MAX_ROWS {
            return Err(Refusal::at(line, format!("has more than {MAX_ROWS} rows: cut out the table")));
        }
        table.rows.insert(at, Row { line, cells: Vec::new() });
    }
    let row = &mut table.rows[at];
    if row.cells.len() <= column {
        row.cells.resize(column + 1, String::new());
    }
    row.cells[column] = Row::of(line, [text]).cells.remove(0);
    Ok(())
}

/// A value as a text. Numbers have a decimal point that no reader takes for thousands.
fn written(value: &Data) -> String {
    match value {
        Data::Float(number) => {
            let text = format!("{number}");
            match text.split_once('.') {
                Some((_, decimals)) if decimals.len() == 3 => format!("{text}0"),
                _ => text,
            }
        }
        other => other.to_string(),
    }
}

/// What a date was before a program took it for one: `3/8` of an inch, by the order of month and day that makes a
/// fraction of an inch.
fn dated(month: u8, day: u8, place: String, line: u32, notes: &mut Vec<Note>) -> String {
    let fraction = [(month, day), (day, month)]
        .into_iter()
        .find(|(above, below)| above % 2 == 1 && above < below && matches!(below, 2 | 4 | 8 | 16));
    match fraction {
        Some((above, below)) => {
            let text =
                format!("the date is read as {above}/{below} of an inch, which the workbook took for a date");
            notes.push(Note { cell: Some(place), ..Note::warning(Some(line), text) });
            format!("{above}/{below}\"")
        }
        None => format!("(date of month {month}, day {day})"),
    }
}
