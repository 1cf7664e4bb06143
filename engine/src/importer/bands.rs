//! Limits of gradings: lower and upper ones in two columns, or both in one cell; of what passes or of a residue.

use super::block::{Block, BlockColumn};
use super::curve::{About, rounded};
use super::heads::Role;
use super::sieve_units::Sizes;
use super::values::Cell;
use super::{Band, Meaning, Refusal};

/// Whether a column has limits, by its head or by its cells. One cell alone, such as `< 1`, is a value.
pub(super) fn is_limit(column: &BlockColumn) -> bool {
    let count = |is: &dyn Fn(&Cell) -> bool| column.values.iter().filter(|(_, cell, _)| is(cell)).count();
    let ranges = count(&|cell| matches!(cell, Cell::Range(..)));
    let sided = count(&|cell| matches!(cell, Cell::AtMost(_) | Cell::AtLeast(_)));
    matches!(column.head.role, Role::Low | Role::High | Role::Limits) || ranges > 0 || sided > 1
}

/// The limits of a grading: two columns with lower and upper ones, or one with both.
pub(super) fn bands(block: &Block, columns: &[&BlockColumn], sizes: &Sizes) -> Result<Vec<Band>, Refusal> {
    let mut found = Vec::new();
    let mut used = vec![false; columns.len()];
    for at in 0..columns.len() {
        if used[at] {
            continue;
        }
        used[at] = true;
        let column = columns[at];
        let opposite = match column.head.role {
            Role::Low => Some(Role::High),
            Role::High => Some(Role::Low),
            _ => None,
        };
        let partner = opposite.and_then(|role| {
            (at + 1..columns.len()).find(|&other| {
                !used[other]
                    && columns[other].head.role == role
                    && columns[other].head.name == column.head.name
            })
        });
        if let Some(partner) = partner {
            used[partner] = true;
        }
        found.extend(band(block, column, partner.map(|of| columns[of]), sizes)?);
    }
    Ok(found)
}

/// The limits at a sieve, as printed.
struct Limits {
    mm: f64,
    low: Option<f64>,
    high: Option<f64>,
    line: u32,
    cell: Option<String>,
}

/// One band; `None` where its column has no number.
fn band(
    block: &Block,
    column: &BlockColumn,
    partner: Option<&BlockColumn>,
    sizes: &Sizes,
) -> Result<Option<Band>, Refusal> {
    let mut rows = limits(block, column, partner, sizes)?;
    if rows.is_empty() {
        return Ok(None);
    }
    rows.sort_by(|a, b| a.mm.total_cmp(&b.mm));
    let most = rows.iter().flat_map(|row| [row.low, row.high]).flatten().fold(0.0, f64::max);
    let whole = if most > 1.0 { 100.0 } else { 1.0 };
    for Limits { mm, low, high, line, cell } in &rows {
        let (low, high) = (low.unwrap_or(0.0), high.unwrap_or(whole));
        if low > high || high > whole || low < 0.0 {
            let text = format!(
                "the limits {low} and {high} at {mm} mm: the lower one must not be above the upper one, and both \
                 must be \
                 from 0 to {whole}"
            );
            return Err(Refusal::at(*line, text).in_cell(cell.clone()));
        }
    }
    let sides = |pair: &[Limits]| {
        let both = [(pair[0].low, pair[1].low), (pair[0].high, pair[1].high)];
        both.into_iter().filter_map(|(fine, coarse)| Some((fine?, coarse?)))
    };
    let has = |of: &[Meaning]| column.head.meanings.iter().any(|meaning| of.contains(meaning));
    let stays = match (has(&[Meaning::Passing]), has(&[Meaning::CumulativeRetained, Meaning::Retained])) {
        (true, _) => false,
        (false, true) => true,
        // Without a word, limits that fall towards coarser sieves are those of a residue.
        (false, false) => {
            let pairs = || rows.windows(2).flat_map(sides);
            pairs().all(|(fine, coarse)| coarse <= fine) && pairs().any(|(fine, coarse)| fine != coarse)
        }
    };
    for pair in rows.windows(2) {
        if sides(pair).any(|(fine, coarse)| if stays { coarse > fine } else { coarse < fine }) {
            let later = if pair[0].line > pair[1].line { &pair[0] } else { &pair[1] };
            let text = format!(
                "a limit of the passing must not fall towards coarser sieves, from {} mm to {} mm",
                pair[0].mm, pair[1].mm
            );
            return Err(Refusal::at(later.line, text).in_cell(later.cell.clone()));
        }
    }
    let points = rows.iter().map(|row| {
        let (low, high) = (row.low.unwrap_or(0.0) / whole, row.high.unwrap_or(whole) / whole);
        // The least that stays is the most that passes.
        let (low, high) = if stays { (1.0 - high, 1.0 - low) } else { (low, high) };
        [row.mm, rounded(low), rounded(high)]
    });
    let name = column.head.name.clone().or_else(|| block.title.clone());
    Ok(Some(Band { name, points: points.collect() }))
}

/// The limits at each sieve that has any.
fn limits(
    block: &Block,
    column: &BlockColumn,
    partner: Option<&BlockColumn>,
    sizes: &Sizes,
) -> Result<Vec<Limits>, Refusal> {
    let has_range = column.values.iter().any(|(_, cell, _)| matches!(cell, Cell::Range(..)));
    let role = if has_range { Role::Limits } else { column.head.role };
    let mut rows = Vec::new();
    for (number, (row, about)) in block.rows.iter().zip(&sizes.about).enumerate() {
        let About::Sieve(mm) = *about else { continue };
        let (_, cell, name) = &column.values[number];
        let other = partner.map(|of| &of.values[number].1);
        let mut limits = Limits { mm, low: None, high: None, line: row.line, cell: name.clone() };
        let roles = [(Some(cell), role), (other, partner.map_or(Role::Other, |of| of.head.role))];
        for (cell, role) in roles {
            match (cell, role) {
                (Some(Cell::Range(low, high)), _) => (limits.low, limits.high) = (Some(*low), Some(*high)),
                (Some(Cell::AtMost(high)), _) | (Some(Cell::Number(high)), Role::High) => {
                    limits.high = Some(*high);
                }
                (Some(Cell::AtLeast(low)), _) | (Some(Cell::Number(low)), Role::Low) => {
                    limits.low = Some(*low);
                }
                (Some(Cell::Number(value)), _) => (limits.low, limits.high) = (Some(*value), Some(*value)),
                (Some(Cell::Text(fault)), _) => {
                    return Err(Refusal::at(row.line, fault.clone()).in_cell(name.clone()));
                }
                _ => {}
            }
        }
        if limits.low.is_some() || limits.high.is_some() {
            rows.push(limits);
        }
    }
    Ok(rows)
}
