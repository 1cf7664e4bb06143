//! The values of a grading's cells.

use super::number::{Decimal, quantity};
use super::words::fold;
use super::workbook::WITHOUT_VALUE;

/// What stands in a cell of a column of values.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    Empty,
    Number(f64),
    /// Limits, in one cell.
    Range(f64, f64),
    AtMost(f64),
    AtLeast(f64),
    /// What no number was read from, with the reason.
    Text(String),
}

impl Cell {
    /// Whether it holds one number or more.
    pub(super) const fn is_number(&self) -> bool {
        matches!(self, Self::Number(_) | Self::Range(..) | Self::AtMost(_) | Self::AtLeast(_))
    }
}

/// Reads a cell.
pub(super) fn cell(text: &str, decimal: Decimal) -> Cell {
    let text = without_marks(text);
    if is_blank(text) {
        return Cell::Empty;
    }
    if text == WITHOUT_VALUE {
        return Cell::Text(
            "is a formula without a value: open the workbook in its program, and save it".to_owned(),
        );
    }
    let folded = fold(text);
    let folded = folded.trim();
    let has = |words: &[&str]| words.iter().any(|word| folded.contains(word));
    let at_most = has(&["max", "<", "up to", "bis zu"]);
    let at_least = has(&["min", ">"]);
    let start = folded_start(text);
    let Some(first) = quantity(&text[start..], decimal).filter(|of| !of.is_fraction) else {
        return Cell::Text(not_a_number(text));
    };
    let rest = first.rest.trim_start_matches('%').trim_start();
    for sign in ["-", "–", "—", "−", "to ", "bis ", "à ", "a ", "/", "÷", "...", "…"] {
        if let Some(after) = rest.strip_prefix(sign)
            && let Some(second) = quantity(after.trim_start(), decimal)
            && second.value >= 0.0
            && is_unit(second.rest)
        {
            return Cell::Range(first.value.min(second.value), first.value.max(second.value));
        }
    }
    match (at_most, at_least) {
        (true, false) => Cell::AtMost(first.value),
        (false, true) => Cell::AtLeast(first.value),
        _ if is_unit(first.rest) && text[..start].chars().all(|c| "~≈ ca.".contains(c)) => {
            Cell::Number(first.value)
        }
        _ => Cell::Text(not_a_number(text)),
    }
}

/// Whether a cell has no value: it is empty, or has a sign or a word for nothing.
pub(super) fn is_blank(text: &str) -> bool {
    const NOTHING: &str = "n/a|na|n.a.|nd|n.d.|k.a.|s/d|nil|none|x";
    let text = text.trim();
    text.chars().all(|c| "-–—−./…~*".contains(c))
        || NOTHING.split('|').any(|word| text.eq_ignore_ascii_case(word) || text == format!("{word}."))
}

fn not_a_number(text: &str) -> String {
    format!("\"{text}\" is no number")
}

/// Where the first number of a cell begins, with its sign.
fn folded_start(text: &str) -> usize {
    let digit = text.find(|c: char| c.is_ascii_digit()).unwrap_or(0);
    let before = &text[..digit];
    match before.char_indices().next_back() {
        Some((at, '-' | '−' | '–' | '+' | '.' | ',')) => at,
        _ => digit,
    }
}

/// Whether what follows a number is a unit.
fn is_unit(rest: &str) -> bool {
    matches!(
        fold(rest).trim().trim_matches(|c: char| ".)(".contains(c)),
        "" | "%"
            | "g"
            | "kg"
            | "lb"
            | "lbs"
            | "oz"
            | "gr"
            | "m.-%"
            | "m-%"
            | "% max"
            | "% min"
            | "max"
            | "min"
            | "vol.-%"
    )
}

/// A cell without marks of footnotes: `95*`, `12.5a`, `100 [2]`, `9¹`.
pub(super) fn without_marks(text: &str) -> &str {
    let mut text = text.trim();
    loop {
        let before = text;
        text = text.trim_end_matches(|c: char| c.is_whitespace() || "*†‡§¶¹²³⁴⁵".contains(c));
        if let Some(open) = text.rfind(['[', '('])
            && text.ends_with([']', ')'])
            && open > 0
            && text[open..].chars().count() <= 4
            && text[..open].trim_end().ends_with(|c: char| c.is_ascii_digit() || c == '%')
        {
            text = text[..open].trim_end();
        }
        let mut last = text.chars().rev();
        if let (Some('a'..='f'), Some('0'..='9')) = (last.next(), last.next()) {
            text = &text[..text.len() - 1];
        }
        if text == before {
            return text;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_numbers_limits_or_nothing() {
        for (text, expected) in [
            ("12,5 %", Cell::Number(12.5)),
            ("95*", Cell::Number(95.0)),
            ("95a", Cell::Number(95.0)),
            ("100 [2]", Cell::Number(100.0)),
            ("350 g", Cell::Number(350.0)),
            ("90-100", Cell::Range(90.0, 100.0)),
            ("90 – 100 %", Cell::Range(90.0, 100.0)),
            ("95 to 100", Cell::Range(95.0, 100.0)),
            ("20 bis 40", Cell::Range(20.0, 40.0)),
            ("20/40", Cell::Range(20.0, 40.0)),
            ("90 max", Cell::AtMost(90.0)),
            ("≤ 10", Cell::AtMost(10.0)),
            ("min. 85", Cell::AtLeast(85.0)),
            ("> 85", Cell::AtLeast(85.0)),
            ("–", Cell::Empty),
            ("n/a", Cell::Empty),
            ("", Cell::Empty),
            ("-5", Cell::Number(-5.0)),
        ] {
            assert_eq!(cell(text, Decimal::Point), expected, "{text}");
        }
        for text in ["five", "12 apples", "CEM I 42.5 R"] {
            assert!(matches!(cell(text, Decimal::Point), Cell::Text(_)), "{text}");
        }
    }
}
