//! Splits a text into cells. A text that can be split in several ways has several readings.

use super::markup;
use super::number::{Decimal, quantity};
use super::table::{Row, Table};
use super::words::fold;

/// The ways to split a text, the most likely one first; each is a list of tables.
pub(super) fn readings(text: &str) -> Vec<Vec<Table>> {
    let lower = text.to_ascii_lowercase();
    if lower.contains("<td") || lower.contains("<th") {
        return vec![markup::html(text)];
    }
    let is_bar = |line: &str| line.trim() == "|";
    let bars = text.lines().filter(|line| is_bar(line)).count();
    if 4 * bars >= text.lines().count().max(1) {
        // Bars on lines of their own part cells that stand one a line.
        let without: Vec<&str> = text.lines().map(|line| if is_bar(line) { "" } else { line }).collect();
        return readings(&without.join("\n"));
    }
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    let most = |sign: char| 2 * lines.iter().filter(|line| line.contains(sign)).count() >= lines.len();
    if most('|') || lower.contains("{|") {
        let tables = markup::pipes(text);
        let filled = |row: &Row| row.cells.iter().filter(|cell| !cell.is_empty()).count();
        let rows = || tables.iter().flat_map(|table| &table.rows);
        if 2 * rows().filter(|row| filled(row) > 1).count() >= rows().count().max(1) {
            return vec![tables];
        }
        // One cell a line, with bars.
        let bare: String = text.lines().map(|line| line.replace('|', " ") + "\n").collect();
        return one_a_line(&bare).into_iter().map(|table| vec![table]).collect();
    }
    for separator in ['\t', ';'] {
        if most(separator) {
            return vec![vec![separated(text, separator)]];
        }
    }
    let mut found = Vec::new();
    let parted = lines.iter().filter(|line| has_separating_comma(line)).count();
    if parted >= 2 || parted == 1 && lines.iter().all(|line| line.contains(',')) {
        found.push(vec![separated(text, ',')]);
    }
    if lines.len() <= 2 && lines.iter().all(|line| is_list(line)) {
        return vec![vec![listed(text)]];
    }
    found.push(vec![spaced(text)]);
    let listed = one_a_line(text);
    found.extend(listed.into_iter().map(|table| vec![table]));
    found
}

/// Whether a line has several names with a value each, and no ratio such as `1 : 2 : 4`.
fn is_list(line: &str) -> bool {
    let parts = || line.split(';').flat_map(|part| part.split(", "));
    line.matches(':').count() > 1 && line.contains(", ") && parts().all(|part| part.matches(':').count() <= 1)
}

/// A list in a line: `No. 4: 20 g, No. 8: 80 g`.
fn listed(text: &str) -> Table {
    let rows = (1_u32..).zip(text.lines()).flat_map(|(number, line)| {
        let parts = line.trim().trim_end_matches('.').split([';']).flat_map(|part| part.split(", "));
        parts.map(move |part| Row::of(number, part.split(':'))).collect::<Vec<_>>()
    });
    Table { rows: rows.filter(|row| !row.is_empty()).collect(), ..Table::default() }
}

/// Whether a comma can part cells in this line: one that does not stand between two digits, one of several in a word,
/// or one in a line that is a single word of numbers.
fn has_separating_comma(line: &str) -> bool {
    let is_digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
    let parts = |&(at, _): &(usize, &str)| {
        !(is_digit(line[..at].chars().next_back()) && is_digit(line[at + 1..].chars().next()))
    };
    line.match_indices(',').any(|comma| parts(&comma))
        || line.split_whitespace().any(|word| word.matches(',').count() > 1)
        || line.contains(',') && is_digit(line.chars().next()) && !line.trim().contains(char::is_whitespace)
}

/// A text whose cells are parted by one sign, with quotes around cells as in CSV.
fn separated(text: &str, separator: char) -> Table {
    let mut rows = Vec::new();
    let mut cells: Vec<String> = Vec::new();
    let mut cell = String::new();
    let (mut is_quoted, mut line, mut first) = (false, 1_u32, 1_u32);
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if is_quoted && characters.peek() == Some(&'"') => {
                characters.next();
                cell.push('"');
            }
            '"' if is_quoted => is_quoted = false,
            // A quote inside of a cell is an inch.
            '"' if cell.trim().is_empty() => {
                is_quoted = closes(characters.clone(), separator);
                if !is_quoted {
                    cell.push('"');
                }
            }
            '\n' => {
                line += 1;
                if is_quoted {
                    cell.push(' ');
                } else {
                    cells.push(std::mem::take(&mut cell));
                    rows.push(Row::of(first, std::mem::take(&mut cells)));
                    first = line;
                }
            }
            c if c == separator && !is_quoted => cells.push(std::mem::take(&mut cell)),
            c => cell.push(c),
        }
    }
    cells.push(cell);
    rows.push(Row::of(first, cells));
    rows.retain(|row| !row.is_empty());
    Table { rows, ..Table::default() }
}

/// Whether a quote is closed in front of a separator, the end of the line or of the text, within the length of a cell.
fn closes(rest: impl Iterator<Item = char>, separator: char) -> bool {
    let mut rest = rest.take(1000).peekable();
    while let Some(character) = rest.next() {
        if character == '"' {
            match rest.peek() {
                None => return true,
                Some('"') => {
                    rest.next();
                }
                Some(&next) => return next == separator || matches!(next, '\n' | '\r'),
            }
        }
    }
    false
}

/// A text whose cells are parted by spaces: by two and more where the lines have them, else where a number begins or
/// ends.
fn spaced(text: &str) -> Table {
    let rows =
        (1_u32..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()).map(|(number, line)| {
            let wide: Vec<&str> = line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect();
            let cells = wide.iter().flat_map(|part| quantities(part)).collect::<Vec<_>>();
            Row::of(number, cells)
        });
    Table { rows: rows.collect(), is_spaced: true, ..Table::default() }
}

/// The parts of a line: quantities with their units and ranges, and the words between them.
fn quantities(line: &str) -> Vec<String> {
    let words: Vec<&str> = line.split(' ').filter(|word| !word.is_empty()).collect();
    let mut cells: Vec<String> = Vec::new();
    let mut at = 0;
    let mut text: Vec<&str> = Vec::new();
    while at < words.len() {
        let length = quantity_length(&words[at..]);
        if length == 0 {
            text.push(words[at]);
            at += 1;
            continue;
        }
        if !text.is_empty() {
            cells.push(std::mem::take(&mut text).join(" "));
        }
        cells.push(words[at..at + length].join(" "));
        at += length;
    }
    if !text.is_empty() {
        cells.push(text.join(" "));
    }
    cells
}

/// How many words from the first on are one quantity: `No. 4`, `1 1/2 in.`, `90 - 100`, `< 0.063 mm`, `95 max`.
fn quantity_length(words: &[&str]) -> usize {
    let is_number = |word: &&str| {
        quantity(word, Decimal::Point).is_some_and(|of| {
            // `4/8`, `90-100`, `3/8"`, `12%`, but not `42,5R` or `2-part`.
            of.rest.chars().all(|c| !c.is_alphabetic()) || is_unit(of.rest)
        })
    };
    let mut length = 0;
    let word = |at: usize| words.get(at).map(|word| fold(word).trim().to_owned()).unwrap_or_default();
    // A dash alone is an empty cell.
    if matches!(words[0], "-" | "–" | "—" | "−" | "n/a" | "…" | "...") {
        return 1;
    }
    if matches!(
        word(0).as_str(),
        "no" | "no." | "n." | "#" | "<" | ">" | "max" | "max." | "min" | "min." | "n.o" | "nr."
    ) {
        length = 1;
    }
    if !words.get(length).is_some_and(is_number) {
        let first = words[0].trim_start_matches(['#', '<', '>', '≤', '≥', '~']);
        let is_signed = first.len() < words[0].len() && is_number(&first);
        let is_numbered = word(0)
            .strip_prefix("no.")
            .is_some_and(|rest| rest.chars().all(|c| c.is_ascii_digit()) && !rest.is_empty());
        if length > 0 || !(is_signed || is_numbered) {
            return 0;
        }
    }
    length += 1;
    // A part of an inch after a whole number.
    if words.get(length).is_some_and(|next| is_fraction(next))
        && words[length - 1].chars().all(|c| c.is_ascii_digit())
    {
        length += 1;
    }
    if matches!(word(length).as_str(), "-" | "to" | "bis" | "a" | "ate" | "/")
        && words.get(length + 1).is_some_and(is_number)
    {
        length += 2;
    }
    if words.get(length).is_some_and(|next| is_unit(next))
        || matches!(word(length).as_str(), "max" | "max." | "min" | "min.")
    {
        length += 1;
    }
    length
}

fn is_fraction(word: &str) -> bool {
    quantity(word, Decimal::Point).is_some_and(|of| of.is_fraction && of.value < 1.0)
}

/// Whether a word is a unit that belongs to the number before it.
fn is_unit(word: &str) -> bool {
    matches!(
        fold(word).trim().trim_end_matches(['.', ',']),
        "mm" | "µm"
            | "um"
            | "micron"
            | "microns"
            | "in"
            | "inch"
            | "inches"
            | "\""
            | "%"
            | "g"
            | "kg"
            | "phi"
            | "mesh"
            | "m.-%"
    )
}

/// A text with one cell a line, as pages of PDF are pasted: rows of as many cells as there are heads, or one column
/// after another.
fn one_a_line(text: &str) -> Vec<Table> {
    let lines: Vec<(u32, &str)> = (1_u32..)
        .zip(text.lines())
        .map(|(number, line)| (number, line.trim()))
        .filter(|(_, line)| !line.is_empty())
        .collect();
    let is_value = |line: &str| {
        quantities(line).len() == 1
            && line.chars().any(|c| c.is_ascii_digit())
            && quantity_length(&line.split(' ').collect::<Vec<_>>()) > 0
            || matches!(line, "-" | "–" | "—")
    };
    let heads = lines.iter().take_while(|(_, line)| !is_value(line)).count();
    let values = lines.len() - heads;
    let singles = lines.iter().filter(|(_, line)| is_value(line)).count();
    // Most of what follows the heads is single numbers; rows such as `Pan` have words.
    if heads == 0 || values < 4 || 10 * singles < 7 * values {
        return Vec::new();
    }
    let mut found = Vec::new();
    let cells = &lines[heads..];
    for columns in 2..=heads.min(12) {
        // Each head may take several lines; a title may stand above them.
        let per_head = if heads % columns == 0 { heads / columns } else { 1 };
        let (titles, names) = lines[..heads].split_at(heads - columns * per_head);
        let title = titles.iter().map(|&(number, line)| Row::of(number, [line]));
        let join = |part: &[(u32, &str)]| part.iter().map(|(_, line)| *line).collect::<Vec<_>>().join(" ");
        let head = Row::of(names[0].0, names.chunks(per_head).map(join));
        // A row with words at its beginning, such as that of the pan, may have fewer cells.
        let mut rows: Vec<Row> = Vec::new();
        for (number, line) in cells {
            let begins = rows.last().is_none_or(|row| row.cells.len() == columns)
                || (!is_value(line) && rows.last().is_some_and(|row| row.cells.len() > 1));
            if begins {
                rows.push(Row { line: *number, cells: Vec::new() });
            }
            if let Some(row) = rows.last_mut() {
                row.cells.extend(Row::of(*number, [line]).cells);
            }
        }
        let whole = rows.iter().filter(|row| row.cells.len() == columns).count();
        if rows.len() >= 2 && whole + 2 >= rows.len() {
            let rows = title.clone().chain([head.clone()]).chain(rows).collect();
            found.push(Table { rows, ..Table::default() });
        }
        if values.is_multiple_of(columns) && values / columns >= 2 {
            let length = values / columns;
            let rows = (0..length)
                .map(|row| Row::of(cells[row].0, (0..columns).map(|column| cells[column * length + row].1)));
            found.push(Table { rows: title.chain([head]).chain(rows).collect(), ..Table::default() });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(text: &str) -> Vec<Vec<String>> {
        readings(text)[0][0].rows.iter().map(|row| row.cells.clone()).collect()
    }

    #[test]
    fn cells_of_csv_may_have_quotes_lines_and_inches() {
        let text = "Sieve;Passing\r\n\"3/8\"\" (9,5 mm)\";97\r\n3/4\";100\r\n\"two\nlines\";5\r\n";
        assert_eq!(
            cells(text),
            [["Sieve", "Passing"], ["3/8\" (9,5 mm)", "97"], ["3/4\"", "100"], ["two lines", "5"]]
        );
    }

    #[test]
    fn words_and_quantities_are_cells_of_a_text_with_spaces() {
        assert_eq!(cells("No. 4 95 - 100\n1 1/2 in. 100\n< 0.063 3,5\nPan 0\n")[0], ["No. 4", "95 - 100"]);
        assert_eq!(cells("1 1/2 in. 100\n4 mm 3 %\n")[0], ["1 1/2 in.", "100"]);
        assert_eq!(cells("< 0.063 3.5\nx 1\n")[0], ["< 0.063", "3.5"]);
        assert_eq!(cells("0.063 mm (No. 230)   2.1   –\nx 1\n")[0], ["0.063 mm", "(No. 230)", "2.1", "–"]);
    }

    #[test]
    fn one_cell_a_line_has_rows_as_long_as_its_heads() {
        let found = readings("Sieve\nPassing\n4\n5\n8\n100\n");
        assert!(
            found.iter().any(|tables| tables[0].rows.last() == Some(&Row::of(5, ["8", "100"]))),
            "{found:?}"
        );
    }
}
