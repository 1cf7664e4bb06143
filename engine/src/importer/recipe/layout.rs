//! From the rows of parts to recipes as they are printed: which rows are heads, titles and parts, and where one recipe
//! ends.

use super::super::Refusal;
use super::super::number::Decimal;
use super::super::values::is_blank;
use super::columns::Block;
use super::draft::Draft;
use super::grid::{Grid, is_amount};
use super::ingredients::{Addition, Kind, is_ca, is_fa};
use super::labels::{Label, label};
use super::titles::key;
use super::units::unit_in;

/// Whether the rows of a table name cement, or water and an aggregate.
pub(super) fn has_concrete(grid: &Grid, decimal: Decimal) -> bool {
    let kinds = (0..grid.rows.len()).filter_map(|row| {
        let mut amounts = grid.labels + 1..grid.rows[row].len();
        amounts
            .any(|column| is_amount(grid.text(row, column), decimal))
            .then(|| label(grid.text(row, grid.labels), decimal).kind)
    });
    let kinds: Vec<Kind> = kinds.collect();
    let has = |is: &dyn Fn(&Kind) -> bool| kinds.iter().any(is);
    let water = has(&|kind| matches!(kind, Kind::Water(_)));
    has(&|kind| matches!(kind, Kind::Cement | Kind::Binder))
        || water && has(&|kind| matches!(kind, Kind::Aggregate | Kind::AllAggregate | Kind::Addition(_)))
}

/// The recipes of a table.
pub(super) fn drafts(grid: &Grid, decimal: Decimal) -> Result<Vec<Draft>, Refusal> {
    let labels: Vec<Label> =
        (0..grid.rows.len()).map(|row| label(grid.text(row, grid.labels), decimal)).collect();
    let labels = resolved(labels);
    let has_amount = |row: usize| {
        (grid.labels + 1..grid.rows[row].len()).any(|column| is_amount(grid.text(row, column), decimal))
    };
    let is_data: Vec<bool> = (0..grid.rows.len())
        .map(|row| has_amount(row) && !matches!(labels[row].kind, Kind::Name) && !labels[row].name.is_empty())
        .collect();
    let is_part: Vec<bool> =
        (0..grid.rows.len()).map(|row| is_data[row] && labels[row].kind.is_part()).collect();
    let mut found = Vec::new();
    let blocks = blocks(&labels, &is_data, &is_part);
    let mut heads: Vec<usize> = Vec::new();
    for (from, first, to) in blocks {
        let is_name = |row: usize| labels[row].kind == Kind::Name && !is_data[row];
        let own: Vec<usize> = (from..first)
            .filter(|&row| !is_data[row])
            .chain((first..to).filter(|&row| is_name(row) && grid.rows[row].len() > 1))
            .collect();
        let is_table_head =
            |&row: &usize| grid.rows[row].iter().filter(|cell| !cell.text.is_empty()).count() > 1;
        if own.iter().any(is_table_head) || heads.is_empty() {
            heads = own.iter().copied().filter(is_table_head).collect();
        }
        if heads.is_empty() {
            // Heads that stand last, in a table from the right to the left.
            let is_text = |row: usize| {
                !is_data[row] && matches!(labels[row].kind, Kind::Unknown | Kind::Name) && is_table_head(&row)
            };
            heads = (first..to).rev().take_while(|&row| !is_part[row]).filter(|&row| is_text(row)).collect();
        }
        let mut titles = grid.titles.clone();
        titles.extend(own.iter().filter(|row| !is_table_head(row)).map(|&row| joined(grid, row)));
        // Cement whose amount is a word stands above the first number.
        let is_word = |&&row: &&usize| {
            matches!(labels[row].kind, Kind::Cement | Kind::Water(_))
                && (grid.labels + 1..grid.rows[row].len()).any(|column| {
                    let text = grid.text(row, column);
                    !is_blank(text) && unit_in(text).is_none() && key(text).0.is_some()
                })
        };
        let rows: Vec<usize> = own
            .iter()
            .filter(is_word)
            .copied()
            .chain((first..to).filter(|&row| is_data[row] || is_text_part(grid, row, &labels)))
            .collect();
        let block = Block { grid, labels: &labels, rows, heads: &heads, titles: &titles, decimal };
        found.extend(block.drafts()?);
    }
    Ok(found)
}

/// Whether a row of a table names a part whose amount is a text.
fn is_text_part(grid: &Grid, row: usize, labels: &[Label]) -> bool {
    labels[row].kind.is_part()
        && grid.rows[row].iter().skip(grid.labels + 1).any(|cell| !is_blank(&cell.text))
}

fn joined(grid: &Grid, row: usize) -> String {
    let texts: Vec<&str> = grid.rows[row].iter().map(|cell| cell.text.as_str()).collect();
    texts.join(" ").trim().to_owned()
}

/// `FA` beside `CA` is fine aggregate; slag without another cement is the cement.
fn resolved(mut labels: Vec<Label>) -> Vec<Label> {
    let has_ca = labels.iter().any(|label| is_ca(&label.name));
    let fly_ash = Kind::Addition(Addition::FlyAsh);
    for label in &mut labels {
        if is_fa(&label.name) && !has_ca {
            label.kind = fly_ash;
        }
    }
    labels
}

/// The rows of each recipe, where several stand below one another: from its titles, its first row, and its end.
fn blocks(labels: &[Label], is_data: &[bool], is_part: &[bool]) -> Vec<(usize, usize, usize)> {
    let rows = is_data.len();
    let Some(first) = (0..rows).find(|&row| is_data[row]) else { return Vec::new() };
    let Some(opening) = (0..rows).find(|&row| is_part[row]).map(|row| labels[row].kind) else {
        return vec![(0, first, rows)];
    };
    let mut starts = vec![first];
    let (mut cement, mut water, mut aggregate) = (false, false, false);
    for row in first..rows {
        if !is_part[row] {
            continue;
        }
        if labels[row].kind == opening && cement && aggregate && (water || opening != Kind::Aggregate) {
            let last = starts[starts.len() - 1];
            // What names the recipe and stands between the last part and this one.
            let begin = (last + 1..row).rev().take_while(|&row| !is_part[row]).last().unwrap_or(row);
            if row > last && (begin..row).any(|row| !is_data[row]) || labels[row].kind != Kind::Aggregate {
                starts.push(row);
                (cement, water, aggregate) = (false, false, false);
            }
        }
        cement |= labels[row].kind == Kind::Cement;
        water |= matches!(labels[row].kind, Kind::Water(_));
        aggregate |= matches!(labels[row].kind, Kind::Aggregate | Kind::AllAggregate);
    }
    // Where the second one is not whole, the rows are those of one recipe.
    if !(cement && aggregate) && starts.len() > 1 {
        starts = vec![first];
    }
    let titled = |start: usize| (0..start).rev().take_while(|&row| !is_data[row]).last().unwrap_or(start);
    let ends = starts[1..].iter().map(|&start| titled(start)).chain([rows]);
    starts.iter().zip(ends).map(|(&start, end)| (titled(start), start, end)).collect()
}
