//! Finds the gradings of tables: which unit the sieves have, what each column means, and which columns tell of the same
//! curve.
//!
//! Every unit that the sieves can have is tried, and every meaning that the head of a column allows. Columns of one
//! sample must agree; where they do under one unit and one meaning alone, that is the reading.

use super::bands::{bands, is_limit};
use super::block::{Block, BlockColumn};
use super::curve::{About, Entry, Fit, fits, rounded};
use super::openings::Unit;
use super::sieve::Label;
use super::sieve_units::{Sizes, check_rows, sizes, sizes_of, unknown_sizes};
use super::values::Cell;
use super::{Band, Curve, Meaning, Note, Refusal};

/// Curves of one sample agree within this share of the mass: printed values are rounded.
const AGREE: f64 = 0.011;
/// What one unit of the sieves makes of a grading.
#[derive(Clone, Debug, Default)]
pub(super) struct Outcome {
    /// The curves; each is a list of readings that fit alike.
    pub(super) curves: Vec<Vec<Curve>>,
    pub(super) bands: Vec<Band>,
    pub(super) notes: Vec<Note>,
}

impl Outcome {
    /// Whether another one has the same curves and bands.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.bands == other.bands
            && self.curves.len() == other.curves.len()
            && self.curves.iter().zip(&other.curves).all(|(a, b)| {
                a.len() == b.len() && a.iter().zip(b).all(|(a, b)| agree(&a.points, &b.points, 1.0e-6))
            })
    }
}

/// The readings of a grading, one for each unit that its sieves can have; at least one.
///
/// # Errors
/// The [`Refusal`] of the unit that is most likely, where none fits.
pub(super) fn outcomes(block: &Block, unit: Option<Unit>) -> Result<Vec<Outcome>, Refusal> {
    check_rows(block)?;
    let mut found: Vec<Outcome> = Vec::new();
    let mut refusal = None;
    for sizes in sizes(block, unit) {
        match outcome(block, &sizes) {
            Ok(outcome) if found.iter().any(|known| known.is_same(&outcome)) => {}
            Ok(outcome) => found.push(outcome),
            Err(fault) => {
                refusal.get_or_insert(fault);
            }
        }
    }
    if found.is_empty() {
        return Err(refusal.unwrap_or_else(|| unknown_sizes(block)));
    }
    Ok(found)
}

/// The curves and bands of a grading whose sieves have these sizes.
fn outcome(block: &Block, sizes: &Sizes) -> Result<Outcome, Refusal> {
    let mut outcome = Outcome { notes: sizes.note.clone().into_iter().collect(), ..Outcome::default() };
    let columns = block.columns.iter().filter(|column| !has_sizes(column, sizes));
    let (limits, values): (Vec<&BlockColumn>, Vec<&BlockColumn>) =
        columns.partition(|column| is_limit(column));
    outcome.bands = bands(block, &limits, sizes)?;
    for group in groups(&values) {
        let found = match of_group(block, &group, sizes) {
            // Columns without a word about them may be those of several samples.
            Err(refusal) if group.len() > 1 && group.iter().any(|column| column.head.meanings.is_empty()) => {
                let told: Vec<&BlockColumn> =
                    group.iter().copied().filter(|column| !column.head.meanings.is_empty()).collect();
                let untold = group.iter().copied().filter(|column| column.head.meanings.is_empty());
                let parts =
                    Some(told).filter(|told| !told.is_empty()).into_iter().chain(untold.map(|of| vec![of]));
                let parts: Result<Vec<Group>, Refusal> =
                    parts.map(|part| of_group(block, &part, sizes)).collect();
                parts.map_err(|_| refusal)?
            }
            found => vec![found?],
        };
        for found in found {
            match found {
                Group::Curves(readings) => outcome.curves.push(readings),
                Group::Unread(note) => outcome.notes.push(note),
            }
        }
    }
    merge(&mut outcome.curves);
    if outcome.curves.is_empty() && outcome.bands.is_empty() {
        let line = block.rows.first().map_or(1, |row| row.line);
        return Err(Refusal::at(line, "no column beside the sieves is a grading"));
    }
    Ok(outcome)
}

/// Makes one of curves that agree although they were read from values of different meanings: those of one sample.
fn merge(curves: &mut Vec<Vec<Curve>>) {
    let mut kept: Vec<Vec<Curve>> = Vec::new();
    for readings in std::mem::take(curves) {
        let same = kept.iter_mut().find(|known| match (known.as_slice(), readings.as_slice()) {
            ([a], [b]) => a.meaning != b.meaning && agree(&a.points, &b.points, AGREE),
            _ => false,
        });
        match same {
            None => kept.push(readings),
            Some(known) if order(readings[0].meaning) < order(known[0].meaning) => *known = readings,
            Some(_) => {}
        }
    }
    *curves = kept;
}

/// Whether a column without a meaning has the sizes of the sieves again.
fn has_sizes(column: &BlockColumn, sizes: &Sizes) -> bool {
    let mut pairs =
        column.values.iter().zip(&sizes.about).filter_map(|((_, cell, _), about)| match (cell, about) {
            (Cell::Number(number), About::Sieve(mm)) => Some((*number, *mm)),
            _ => None,
        });
    column.head.meanings.is_empty()
        && pairs.clone().count() >= 2
        && pairs
            .all(|(number, mm)| (number / mm - 1.0).abs() < 0.1 || (number / mm / 1000.0 - 1.0).abs() < 0.1)
}

/// Columns of one sample: those with one name; without names those whose heads say different meanings, or none.
fn groups<'a>(columns: &[&'a BlockColumn]) -> Vec<Vec<&'a BlockColumn>> {
    let mut found: Vec<Vec<&BlockColumn>> = Vec::new();
    for column in columns {
        let fits = found.iter_mut().rev().find(|group| {
            let last = group[group.len() - 1];
            let told = &column.head.meanings;
            let is_new = told.is_empty() || group.iter().all(|of| of.head.meanings != *told);
            last.head.name == column.head.name && is_new
        });
        match fits {
            Some(group) => group.push(column),
            None => found.push(vec![column]),
        }
    }
    found
}

/// What a column without words can mean; masses only beside columns that say the same.
const EVERY: [Meaning; 6] = [
    Meaning::Passing,
    Meaning::CumulativeRetained,
    Meaning::Retained,
    Meaning::Mass,
    Meaning::CumulativeMass,
    Meaning::MassPassing,
];

enum Group {
    Curves(Vec<Curve>),
    Unread(Note),
}

/// The readings of the columns of one sample.
fn of_group(block: &Block, group: &[&BlockColumn], sizes: &Sizes) -> Result<Group, Refusal> {
    let mut found: Vec<(&BlockColumn, Vec<Fit>)> = Vec::new();
    for column in group {
        let (entries, text) = entries(block, column, sizes);
        if column.head.meanings.is_empty()
            && let Some(refusal) = &text
            && entries.iter().filter(|entry| entry.value.is_some()).count() < 2
        {
            return Ok(Group::Unread(Note { level: super::Level::Note, ..refusal.clone().note() }));
        }
        if let Some(refusal) = text {
            return Err(refusal);
        }
        let is_told = !column.head.meanings.is_empty();
        let meanings = if is_told {
            column.head.meanings.clone()
        } else if group.len() > 1 {
            // What the other columns say decides.
            EVERY.to_vec()
        } else {
            EVERY[..3].to_vec()
        };
        let has_class = entries.iter().any(|entry| matches!(entry.about, About::Class(..)));
        let is_part = |of: &Meaning| !has_class || matches!(of, Meaning::Retained | Meaning::Mass);
        let mut fitting = Vec::new();
        let mut refusal = None;
        for meaning in meanings.into_iter().filter(is_part) {
            match fits(&entries, meaning) {
                Ok(more) => fitting.extend(more),
                Err(fault) => refusal = refusal.or(Some(fault)),
            }
        }
        // A word, not the 0 of a column that may be no sieves.
        let has_end = block.rows.iter().any(|row| {
            matches!(row.label, Label::Pan | Label::Total | Label::Initial)
                && row.printed.chars().all(|c| !c.is_numeric())
        });
        if fitting.is_empty() && !is_told && has_end && group.len() == 1 {
            fitting = fits(&entries, Meaning::Mass)?;
            for fit in &mut fitting {
                fit.notes.push(Note::warning(
                    Some(block.rows[0].line),
                    "the column says no unit: it is read as masses",
                ));
            }
        }
        match refusal {
            Some(refusal) if fitting.is_empty() => return Err(refusal),
            _ => found.push((column, fitting)),
        }
    }
    let mut readings: Vec<(usize, &BlockColumn, &Fit)> = Vec::new();
    for (column, fits) in &found {
        for fit in fits {
            let agrees = |of: &[Fit]| of.iter().any(|other| agree(&fit.points, &other.points, AGREE));
            if found.iter().all(|(_, others)| agrees(others)) {
                readings.push((order(fit.meaning), column, fit));
            }
        }
    }
    if readings.is_empty() {
        let heads: Vec<&str> = group.iter().map(|column| column.head.text.as_str()).collect();
        return Err(contradiction(block, &found, &heads.join("\", \"")));
    }
    readings.sort_by_key(|(order, ..)| *order);
    let mut curves: Vec<Curve> = Vec::new();
    for (_, column, fit) in readings {
        if curves.iter().all(|known| !agree(&known.points, &fit.points, AGREE)) {
            curves.push(curve(block, column, fit, sizes.unit));
        }
    }
    Ok(Group::Curves(curves))
}

/// Which reading of one curve is shown: the shares as printed before those that are computed.
const fn order(meaning: Meaning) -> usize {
    match meaning {
        Meaning::Passing => 0,
        Meaning::CumulativeRetained => 1,
        Meaning::Retained => 2,
        Meaning::Mass | Meaning::CumulativeMass | Meaning::MassPassing => 3,
    }
}

/// Names the row where two columns of one sample differ most.
fn contradiction(block: &Block, found: &[(&BlockColumn, Vec<Fit>)], heads: &str) -> Refusal {
    let text = |mm: f64, a: f64, b: f64| {
        format!(
            "the columns \"{heads}\" contradict each other: by them {} % and {} % pass {mm} mm; correct the wrong \
             one, or \
             choose one by `column`",
            rounded(100.0 * a),
            rounded(100.0 * b)
        )
    };
    let mut worst: Option<(f64, Refusal)> = None;
    for (number, (_, fits)) in found.iter().enumerate() {
        for (_, others) in &found[number + 1..] {
            let (Some(first), Some(second)) = (fits.first(), others.first()) else { continue };
            for [mm, passing] in &first.points {
                let Some([_, other]) = second.points.iter().find(|[of, _]| of == mm) else { continue };
                let difference = (passing - other).abs();
                if worst.as_ref().is_none_or(|(known, _)| difference > *known) {
                    let row = block.rows.iter().find(|row| {
                        sizes_of(row.label)
                            .any(|size| size.unit.unwrap_or(Unit::Mm).mm(size.number) == Some(*mm))
                    });
                    let line = row.or(block.rows.first()).map_or(1, |row| row.line);
                    worst = Some((difference, Refusal::at(line, text(*mm, *passing, *other))));
                }
            }
        }
    }
    worst.map_or_else(
        || Refusal::new(format!("the columns \"{heads}\" contradict each other")),
        |(_, refusal)| refusal,
    )
}

/// Whether two curves have the same passing at the sieves that both have; at least one must be in both.
pub(super) fn agree(a: &[[f64; 2]], b: &[[f64; 2]], tolerance: f64) -> bool {
    let (mut at_a, mut at_b, mut common) = (0, 0, 0);
    while let (Some([mm_a, passing_a]), Some([mm_b, passing_b])) = (a.get(at_a), b.get(at_b)) {
        if (mm_a / mm_b - 1.0).abs() < 1.0e-3 {
            if (passing_a - passing_b).abs() > tolerance {
                return false;
            }
            common += 1;
            at_a += 1;
            at_b += 1;
        } else if mm_a < mm_b {
            at_a += 1;
        } else {
            at_b += 1;
        }
    }
    common > 0
}

/// The values of a column with what they are about; and the first cell that is no number.
fn entries(block: &Block, column: &BlockColumn, sizes: &Sizes) -> (Vec<Entry>, Option<Refusal>) {
    let mut text = None;
    let entries =
        block.rows.iter().zip(&sizes.about).zip(&column.values).map(|((row, about), (_, cell, name))| {
            let value = match cell {
                // `< 1`, below what the laboratory states.
                Cell::Number(value) | Cell::AtMost(value) => Some(*value),
                Cell::Text(fault) => {
                    let refusal = Refusal::at(row.line, fault.clone()).in_cell(name.clone());
                    text.get_or_insert(refusal);
                    None
                }
                _ => None,
            };
            Entry { line: row.line, cell: name.clone(), about: *about, value }
        });
    (entries.collect(), text)
}

/// A curve as the answer has it.
fn curve(block: &Block, column: &BlockColumn, fit: &Fit, unit: Unit) -> Curve {
    let head = column.head.text.trim();
    let printed = block.rows.iter().zip(&column.values).filter(|(_, (text, ..))| !text.is_empty());
    Curve {
        name: column.head.name.clone().or_else(|| block.title.clone()),
        column: if head.is_empty() { (column.index + 1).to_string() } else { head.to_owned() },
        meaning: fit.meaning,
        unit: unit.name().to_owned(),
        points_printed: printed.map(|(row, (text, ..))| [row.printed.clone(), text.clone()]).collect(),
        points: fit.points.clone(),
        completed: fit.completed.clone(),
        notes: fit.notes.clone(),
    }
}
