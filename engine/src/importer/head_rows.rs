//! Heads of columns that stand in several rows, or in a line without columns.

use super::heads::{Head, Role, head};
use super::table::Row;
use super::words::fold;

/// The heads of a column in one text. In rows of heads above the last, an empty cell belongs to the one on its left.
pub(super) fn joined(heads: &[&Row], column: usize) -> String {
    let mut cells: Vec<&str> = Vec::new();
    for (number, row) in heads.iter().enumerate() {
        let is_last = number + 1 == heads.len();
        let own = row.cell(column);
        let text = if own.is_empty() && !is_last {
            (0..column).rev().map(|left| row.cell(left)).find(|cell| !cell.is_empty()).unwrap_or("")
        } else {
            own
        };
        if !text.is_empty() && !cells.contains(&text) {
            cells.push(text);
        }
    }
    cells.join(" ")
}

/// Whether a head is about sums alone, so that it begins another head after one that says what is summed.
fn is_cumulative(head: &Head) -> bool {
    use super::Meaning::{CumulativeRetained, Passing};
    head.meanings == [CumulativeRetained, Passing]
}

/// The heads of a line without columns, as many as there are columns: a head ends after a bracket or a percent sign,
/// and where words of another kind begin.
pub(super) fn parted(line: &str, columns: usize) -> Option<Vec<String>> {
    let words: Vec<&str> = line.split_whitespace().collect();
    if words.len() == columns {
        return Some(words.iter().map(|&word| word.to_owned()).collect());
    }
    let mut parts: Vec<Vec<&str>> = Vec::new();
    let mut open = false;
    for word in words {
        let joins = open || word.starts_with(['(', '[']);
        let begins = parts.last().is_none_or(|part| {
            let last = part.last().copied().unwrap_or("");
            let so_far = head(&part.join(" "));
            let next = head(word);
            let ends = last.ends_with([')', ']'])
                || (last.ends_with('%') && part.len() > 1 && !is_cumulative(&so_far));
            let is_value = |of: &Head| of.role != Role::Sieve && !of.meanings.is_empty();
            let is_second = next.role == Role::Sieve
                && so_far.role == Role::Sieve
                && matches!(
                    fold(last).trim().trim_end_matches('.'),
                    "no" | "n.o" | "#" | "number" | "mm" | "in"
                );
            let changes = is_second
                || (so_far.role == Role::Sieve && (is_value(&next) || word == "%"))
                || (is_value(&so_far)
                    && (word == "%" && !is_cumulative(&so_far)
                        || (is_cumulative(&next) && !is_cumulative(&so_far))))
                || (is_value(&so_far) && next.role == Role::Sieve);
            ends || changes
        });
        open = (open || word.starts_with(['(', '['])) && !word.ends_with([')', ']']);
        match parts.last_mut() {
            Some(part) if joins || !begins => part.push(word),
            _ => parts.push(vec![word]),
        }
    }
    // Columns on the right may be empty.
    (parts.len() >= columns).then(|| parts.iter().take(columns).map(|part| part.join(" ")).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn heads_of_a_line_without_columns_are_parted() {
        assert_eq!(parted("Sieve size (mm) Passing (%)", 2).unwrap(), ["Sieve size (mm)", "Passing (%)"]);
        assert_eq!(
            parted("Sieve Weight retained (g) % retained Cumulative % retained % passing", 5).unwrap(),
            ["Sieve", "Weight retained (g)", "% retained", "Cumulative % retained", "% passing"]
        );
        assert_eq!(parted("Sieve A16 B16 C16", 4).unwrap(), ["Sieve", "A16", "B16", "C16"]);
    }
}
