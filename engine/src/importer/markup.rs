//! Tables of HTML, Markdown and wikis.

use super::table::{MAX_COLUMNS, MAX_ROWS, Row, Table};

/// The tables of a page while it is read.
#[derive(Default)]
struct Page {
    tables: Vec<Table>,
    row: Option<Row>,
    /// The text of the cell that is open, with its columns and rows.
    cell: Option<(String, usize, usize)>,
    /// For each column how many further rows a cell above covers.
    covered: Vec<usize>,
}

impl Page {
    fn begin_table(&mut self) {
        self.end_row();
        self.covered.clear();
        self.tables.push(Table::default());
    }

    fn begin_row(&mut self, line: u32) {
        self.end_row();
        self.row = Some(Row { line, cells: Vec::new() });
    }

    fn end_cell(&mut self) {
        let (Some((text, columns, rows)), Some(row)) = (self.cell.take(), self.row.as_mut()) else { return };
        let text = unescaped(&text);
        for _ in 0..columns {
            cover(row, &mut self.covered);
            // What is wider is refused.
            if row.cells.len() > MAX_COLUMNS {
                return;
            }
            let column = row.cells.len();
            if self.covered.len() <= column {
                self.covered.resize(column + 1, 0);
            }
            self.covered[column] = rows - 1;
            row.cells.push(text.trim().to_owned());
        }
    }

    fn end_row(&mut self) {
        self.end_cell();
        let Some(mut row) = self.row.take() else { return };
        cover(&mut row, &mut self.covered);
        if self.tables.is_empty() {
            self.tables.push(Table::default());
        }
        if let Some(table) = self.tables.last_mut().filter(|table| table.rows.len() <= MAX_ROWS) {
            table.rows.push(Row::of(row.line, row.cells));
        }
    }
}

/// Puts empty cells where cells of the rows above reach into this one.
fn cover(row: &mut Row, covered: &mut [usize]) {
    while let Some(left) = covered.get_mut(row.cells.len()).filter(|left| **left > 0) {
        *left -= 1;
        row.cells.push(String::new());
    }
}

/// The tables of a page of HTML; empty where it has none. Cells over several columns are repeated, and those over
/// several rows stand in the first. Tables in tables are read as further rows.
pub(super) fn html(text: &str) -> Vec<Table> {
    let mut page = Page::default();
    let (mut line, mut rest) = (1_u32, text);
    while let Some(open) = rest.find('<') {
        let (before, after) = rest.split_at(open);
        line = line.saturating_add(lines(before));
        if let Some((text, ..)) = &mut page.cell {
            text.push_str(before);
        }
        let skipped =
            if after.starts_with("<!--") { after.find("-->").map(|at| at + 3) } else { tag_end(after) };
        let Some(end) = skipped else { break };
        let tag = &after[..end];
        line = line.saturating_add(lines(tag));
        rest = &after[end..];
        let name: String =
            tag[1..].trim_start_matches('/').chars().take_while(char::is_ascii_alphanumeric).collect();
        let closes = tag.starts_with("</");
        match (name.to_ascii_lowercase().as_str(), closes) {
            ("table", false) => page.begin_table(),
            ("caption", false) => {
                let close = rest
                    .find("</")
                    .map_or(rest.len(), |at| rest[at..].find("</caption").map_or(at, |to| at + to));
                if let Some(table) = page.tables.last_mut() {
                    table.name = Some(without_tags(&rest[..close]));
                }
                line = line.saturating_add(lines(&rest[..close]));
                rest = &rest[close..];
            }
            ("tr", false) => page.begin_row(line),
            ("tr" | "table", true) => page.end_row(),
            ("td" | "th", false) => {
                page.end_cell();
                page.row.get_or_insert_with(|| Row { line, cells: Vec::new() });
                page.cell = Some((String::new(), span(tag, "colspan"), span(tag, "rowspan")));
            }
            ("td" | "th", true) => page.end_cell(),
            ("br" | "p" | "div", _) => page.cell.iter_mut().for_each(|(text, ..)| text.push(' ')),
            // A superscript is a mark of a footnote, but for the exponent of a unit.
            ("sup", false) if page.cell.as_ref().is_some_and(|(text, ..)| has_mark(text)) => {
                if let Some(close) = rest.find("</sup") {
                    line = line.saturating_add(lines(&rest[..close]));
                    rest = &rest[close..];
                }
            }
            ("script" | "style", false) => {
                let close = rest.find("</").unwrap_or(rest.len());
                line = line.saturating_add(lines(&rest[..close]));
                rest = &rest[close..];
            }
            _ => {}
        }
    }
    page.end_row();
    page.tables.retain(|table| table.rows.iter().any(|row| !row.is_empty()));
    page.tables
}

/// Whether a superscript after this text is a mark: not in an empty cell, and not after a unit of length.
fn has_mark(text: &str) -> bool {
    let text = text.trim_end();
    let is_unit = ["m", "dm", "cm", "mm", "yd", "ft"]
        .iter()
        .any(|unit| text.strip_suffix(unit).is_some_and(|before| !before.ends_with(char::is_alphabetic)));
    !text.is_empty() && !is_unit
}

/// The text of a caption.
fn without_tags(text: &str) -> String {
    let mut plain = String::new();
    let mut is_tag = false;
    for character in text.chars() {
        match character {
            '<' => is_tag = true,
            '>' => is_tag = false,
            c if !is_tag => plain.push(c),
            _ => {}
        }
    }
    unescaped(plain.trim())
}

fn lines(text: &str) -> u32 {
    u32::try_from(text.matches('\n').count()).unwrap_or(u32::MAX)
}

/// The end of a tag, after its `>`; values in quotes may have one.
fn tag_end(text: &str) -> Option<usize> {
    let mut quote = None;
    for (at, character) in text.char_indices() {
        match (quote, character) {
            (None, '>') => return Some(at + 1),
            (None, '"' | '\'') => quote = Some(character),
            (Some(open), close) if open == close => quote = None,
            _ => {}
        }
    }
    // A quote that is not closed.
    text.find('>').map(|at| at + 1)
}

/// Over how many columns or rows a cell goes.
fn span(tag: &str, name: &str) -> usize {
    let tag = tag.to_ascii_lowercase();
    let value = tag.split_once(name).map_or("", |(_, after)| after);
    let digits: String = value
        .trim_start_matches(|c: char| !c.is_ascii_digit())
        .chars()
        .take_while(char::is_ascii_digit)
        .collect();
    digits.parse().unwrap_or(1).clamp(1, MAX_COLUMNS)
}

/// A text without references to characters.
fn unescaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('&') {
        out.push_str(&rest[..at]);
        rest = &rest[at + 1..];
        let end = rest.find(';').filter(|&end| end < 10);
        let Some((name, after)) = end.map(|end| (&rest[..end], &rest[end + 1..])) else {
            out.push('&');
            continue;
        };
        let character = match name {
            "nbsp" | "thinsp" | "ensp" | "emsp" => Some('\u{a0}'),
            "amp" => Some('&'),
            "lt" => Some('<'),
            "gt" => Some('>'),
            "quot" | "Prime" => Some('"'),
            "le" => Some('≤'),
            "ge" => Some('≥'),
            "micro" | "mu" => Some('µ'),
            "ndash" | "mdash" | "minus" => Some('–'),
            "frac12" => Some('½'),
            "frac14" => Some('¼'),
            "frac34" => Some('¾'),
            "auml" => Some('ä'),
            "ouml" => Some('ö'),
            "uuml" => Some('ü'),
            "szlig" => Some('ß'),
            "eacute" => Some('é'),
            "sup3" => Some('³'),
            _ => name.strip_prefix('#').and_then(|number| {
                let hexadecimal = number.strip_prefix(['x', 'X']).map(|hex| u32::from_str_radix(hex, 16));
                char::from_u32(hexadecimal.unwrap_or_else(|| number.parse()).ok()?)
            }),
        };
        if let Some(character) = character {
            out.push(character);
        } else {
            out.push('&');
            out.push_str(name);
            out.push(';');
        }
        rest = after;
    }
    out.push_str(rest);
    out
}

/// The table of lines whose cells stand between `|`, of Markdown, a wiki, or drawn with `+---+`; empty where the text
/// has fewer than two such lines.
pub(super) fn pipes(text: &str) -> Vec<Table> {
    let mut table = Table::default();
    // A wiki may have each cell on a line of its own, and its rows begin with `|-`.
    let is_wiki = text.contains("{|")
        || text.lines().any(|line| line.trim().starts_with("|-") && !line.contains("--|"));
    let mut wiki_row: Option<Row> = None;
    for (number, line) in (1_u32..).zip(text.lines()) {
        let trimmed = line.trim();
        let is_rule = !trimmed.is_empty() && trimmed.chars().all(|c| "|+-=: \t".contains(c));
        if is_wiki && (trimmed.starts_with("|-") || trimmed.starts_with("|}") || trimmed.starts_with("{|")) {
            table.rows.extend(wiki_row.take());
            continue;
        }
        if let (true, Some(caption)) = (is_wiki, trimmed.strip_prefix("|+")) {
            table.name = Some(caption.trim().to_owned());
            continue;
        }
        if is_rule {
            continue;
        }
        if is_wiki && let Some(cells) = trimmed.strip_prefix(['|', '!']) {
            let cells = cells.replace("!!", "||");
            let row = wiki_row.get_or_insert_with(|| Row { line: number, cells: Vec::new() });
            // Attributes of a cell end with one `|`.
            let values =
                cells.split("||").map(|cell| cell.rsplit('|').next().unwrap_or(cell).replace("'''", ""));
            row.cells.extend(Row::of(number, values).cells);
        } else if !is_wiki && trimmed.contains('|') {
            let inner = trimmed.strip_prefix('|').unwrap_or(trimmed);
            let inner = inner.strip_suffix('|').unwrap_or(inner);
            // A wiki of another kind doubles the sign.
            let cells = inner.replace("||", "|").replace("**", "");
            table.rows.push(Row::of(number, cells.split('|')));
        } else if !is_wiki && !trimmed.is_empty() {
            // A title or a footnote.
            table.rows.push(Row::of(number, [trimmed]));
        }
    }
    table.rows.extend(wiki_row);
    let has_table = table.rows.iter().filter(|row| row.cells.len() > 1).count() > 1;
    if has_table { vec![table] } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_a_page_is_read_with_its_lines() {
        let page = "<p>Text</p>\n<table><caption>Sand (m<sup>3</sup>)</caption><tr><th \
            colspan=2>Sieve<br>mm</th><th>Passing<sup>1</sup></th>\n\
                    <tr><td>3/8&quot;<td>9,5</td><td> 97 &ndash; 100</td></tr></table>";
        let tables = html(page);
        assert_eq!(tables.len(), 1);
        assert_eq!(tables[0].name.as_deref(), Some("Sand (m3)"));
        assert_eq!(tables[0].rows[0], Row::of(2, ["Sieve mm", "Sieve mm", "Passing"]));
        assert_eq!(tables[0].rows[1], Row::of(3, ["3/8\"", "9,5", "97 – 100"]));
        let spans =
            "<tr><th rowspan=2>Sieve<th colspan=2>Passing<tr><th>A<th>B<tr><td>4<td>5<td>kg/m<sup>3</sup>";
        assert_eq!(html(spans)[0].rows[1], Row::of(1, ["", "A", "B"]));
        assert_eq!(html(spans)[0].rows[2], Row::of(1, ["4", "5", "kg/m3"]));
    }

    #[test]
    fn tables_of_markdown_and_wikis_are_read() {
        let markdown = "| Sieve | Passing |\n|---|--:|\n| 4 | **5** |\n| 8 | 100 |\n";
        assert_eq!(pipes(markdown)[0].rows[1], Row::of(3, ["4", "5"]));
        let wiki =
            "{| class=\"wikitable\"\n|+ Sand\n! Sieve !! Passing\n|-\n| 4 || 5\n|-\n|8\n|style=\"x\"|100\n|}";
        let table = &pipes(wiki)[0];
        assert_eq!(table.name.as_deref(), Some("Sand"));
        assert_eq!(table.rows[2].cells, ["8", "100"]);
        let grid = "+---+---+\n| a | b |\n+===+===+\n| 4 | 5 |\n+---+---+\n";
        assert_eq!(pipes(grid)[0].rows.len(), 2);
    }

    #[test]
    fn broken_markup_ends() {
        for text in ["<", "<table", "<td>&#x110000;</td>", "<!--", "<tr><td colspan=99999>x", "&;<td>&amp"] {
            html(text);
            pipes(text);
        }
    }
}
