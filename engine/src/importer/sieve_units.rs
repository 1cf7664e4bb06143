//! The unit of the sieves of a grading: that of its head or of its cells, else each under which the sieves have an
//! order and are such as sieves of aggregates are.

use super::block::{Block, BlockRow};
use super::curve::About;
use super::openings::Unit;
use super::sieve::{Label, Size};
use super::{Level, Note, Refusal};
use crate::request::MAX_CURVE_POINTS;

/// Sieves of aggregates have openings between these, in mm; used where a table states no unit.
const PLAUSIBLE_MM: [f64; 2] = [0.0005, 300.0];

/// Words in brackets after a head of sieves that are no unit.
const NO_UNIT: [&str; 14] = [
    "astm", "square", "nominal", "size", "norm", "opening", "module", "round", "aperture", "number", "sieve",
    "standard", "mesh", "wire",
];

/// Refuses rows between sieves that are none, and units of sieves that are unknown.
pub(super) fn check_rows(block: &Block) -> Result<(), Refusal> {
    if block.rows.len() > MAX_CURVE_POINTS {
        let count = block.rows.len();
        let text = format!("has {count} sieves and more: a grading must have at most {MAX_CURVE_POINTS}");
        return Err(Refusal::at(block.rows[MAX_CURVE_POINTS].line, text));
    }
    let is_inside = |above: usize| {
        let (before, after) = block.rows.split_at(above.min(block.rows.len()));
        [before, after]
            .iter()
            .all(|rows| rows.iter().any(|row| matches!(row.label, Label::Sieve(_) | Label::Class(..))))
    };
    if let Some((line, text, _)) = block.unknown.iter().find(|(_, _, above)| is_inside(*above)) {
        return Err(Refusal::at(
            *line,
            format!("\"{text}\" begins with no sieve that is known: correct it, or leave it out"),
        ));
    }
    let bracket =
        block.sieves.text.split_once(['(', '[']).and_then(|(_, after)| after.split([')', ']']).next());
    if let (None, Some(unit)) = (block.sieves.unit, bracket) {
        let is_word = unit.len() > 3 && unit.chars().all(|c| c.is_ascii_lowercase());
        if is_word && !NO_UNIT.contains(&unit) && numbers(block).any(|(_, size)| size.unit.is_none()) {
            let text = format!(
                "\"{unit}\" is no unit of sieves that is known: must be mm, µm, inches, sieve numbers or phi"
            );
            return Err(match block.line {
                Some(line) => Refusal::at(line, text),
                None => Refusal::new(text),
            });
        }
    }
    Ok(())
}

pub(super) fn unknown_sizes(block: &Block) -> Refusal {
    let text = match block.sieves.unit {
        Some(unit) => format!("a sieve is none of {}: correct it, or state its size in mm", unit.words()),
        None => "the sieves have no unit that is known: state their sizes in mm".to_owned(),
    };
    let stated = block.sieves.unit.unwrap_or(Unit::Mm);
    let is_unknown = |row: &&BlockRow| {
        sizes_of(row.label).any(|size| size.unit.unwrap_or(stated).mm(size.number).is_none())
    };
    match block.rows.iter().find(is_unknown).or(block.rows.first()) {
        Some(row) => Refusal::at(row.line, text).in_cell(row.cell.clone()),
        None => Refusal::new(text),
    }
}

/// The sizes of the rows under one unit.
pub(super) struct Sizes {
    pub(super) unit: Unit,
    /// For each row what it is about, with its sizes in mm.
    pub(super) about: Vec<About>,
    pub(super) note: Option<Note>,
}

/// The units that the sieves can have, with the sizes of the rows, the most likely first.
pub(super) fn sizes(block: &Block, chosen: Option<Unit>) -> Vec<Sizes> {
    let in_mm = |_: usize, _: f64| Unit::Mm;
    let mut found = Found { block, list: Vec::new() };
    if let Some(unit) = chosen.or(block.sieves.unit) {
        let numbers = if matches!(unit, Unit::Mm | Unit::Inch) { Unit::UsSieve } else { unit };
        found.add(unit, about(block, unit, numbers, &in_mm), None);
        if chosen.is_some() || !found.list.is_empty() {
            return found.list;
        }
    }
    let bare: Vec<(usize, f64)> = numbers(block)
        .filter(|(_, size)| size.unit.is_none() && !size.is_fraction)
        .map(|(row, size)| (row, size.number))
        .collect();
    if bare.is_empty() {
        // Numbers of sieves are those of ASTM E11, unless one is none of these.
        let us = about(block, Unit::Mm, Unit::UsSieve, &in_mm);
        if us.is_some() {
            found.add(Unit::Mm, us, None);
        } else {
            let text = format!("the sieve numbers are read as {}", Unit::BsMesh.words());
            found.add(Unit::Mm, about(block, Unit::Mm, Unit::BsMesh, &in_mm), Some(text));
        }
        return found.list;
    }
    let fractions: Vec<usize> =
        numbers(block).filter(|(_, size)| size.is_fraction).map(|(row, _)| row).collect();
    if let (Some(&first), Some(&last)) = (fractions.first(), fractions.last()) {
        // Whole numbers among fractions and on their coarse side are inches, those beyond are numbers of sieves.
        let text = "the sieves are read as inches and as US sieve numbers (ASTM E11)";
        for is_inch in [&(|row: usize| row < last) as &dyn Fn(usize) -> bool, &|row| row > first] {
            let own = |row: usize, _: f64| if is_inch(row) { Unit::Inch } else { Unit::UsSieve };
            let about = about(block, Unit::Mm, Unit::UsSieve, &own);
            let about = about.filter(|about| is_monotone(about) && is_plausible(about));
            found.add(Unit::UsSieve, about, Some(text.to_owned()));
        }
        return found.list;
    }
    let largest = bare.iter().map(|(_, number)| *number).fold(0.0, f64::max);
    for unit in [Unit::Mm, Unit::Um, Unit::UsSieve, Unit::BsMesh, Unit::TylerMesh] {
        // Micrometres of an aggregate are hundreds.
        if unit == Unit::Um && largest < 90.0 {
            continue;
        }
        let text = format!("the sieves have no unit: they are read as {}", unit.words());
        let about = about(block, unit, Unit::UsSieve, &in_mm).filter(|about| is_plausible(about));
        found.add(unit, about, (unit != Unit::Mm).then_some(text));
    }
    found.add_broken(&bare);
    found.list
}

/// The units that were found to be possible.
struct Found<'a> {
    block: &'a Block,
    list: Vec<Sizes>,
}

impl Found<'_> {
    fn add(&mut self, unit: Unit, about: Option<Vec<About>>, text: Option<String>) {
        if let Some(about) = about.filter(|about| self.list.iter().all(|known| known.about != *about)) {
            let note = text.map(|text| note(self.block, &text));
            self.list.push(Sizes { unit: printed_unit(self.block, unit), about, note });
        }
    }

    /// Adds mm and micrometres in one column, where the order of its numbers breaks: 4.75, 2.36, 1.18, 600, 300, 150.
    fn add_broken(&mut self, bare: &[(usize, f64)]) {
        let falls = |pair: &[(usize, f64)]| pair[1].1 < pair[0].1;
        let Some(is_falling) = bare.get(..2).map(falls) else { return };
        let breaks: Vec<usize> =
            (1..bare.len()).filter(|&at| falls(&bare[at - 1..=at]) != is_falling).collect();
        let [at] = breaks.as_slice() else { return };
        let (before, after) = bare.split_at(*at);
        let (mm, um) = if is_falling { (before, after) } else { (after, before) };
        let own = |row: usize, _: f64| {
            if um.binary_search_by_key(&row, |(of, _)| *of).is_ok() { Unit::Um } else { Unit::Mm }
        };
        let about = about(self.block, Unit::Mm, Unit::UsSieve, &own);
        if let Some(about) = about.filter(|about| is_monotone(about) && is_plausible(about)) {
            // In one unit the sieves would have no order.
            self.list.retain(|known| is_monotone(&known.about));
            let words = |of: &[(usize, f64)]| format!("{} to {}", of[0].1, of[of.len() - 1].1);
            let text = format!(
                "the sieves have no unit: {} are read as mm, {} as micrometres",
                words(mm),
                words(um)
            );
            let note = Note { level: Level::Warning, ..note(self.block, &text) };
            self.list.push(Sizes { unit: Unit::Mm, about, note: Some(note) });
        }
    }
}

/// What the rows are about, where sizes without a unit have this one (mm: the one of `own`, by row and number) and
/// numbers of sieves are those of `numbers`. `None` where one is no sieve of these.
fn about(block: &Block, unit: Unit, numbers: Unit, own: &dyn Fn(usize, f64) -> Unit) -> Option<Vec<About>> {
    let mm = |row: usize, size: Size| match size.unit {
        Some(Unit::UsSieve) => numbers.mm(size.number),
        Some(unit) => unit.mm(size.number),
        None if size.is_fraction => Unit::Inch.mm(size.number),
        None => (if unit == Unit::Mm { own(row, size.number) } else { unit }).mm(size.number),
    };
    block.rows.iter().enumerate().map(|(row, of)| About::of(of.label, |size| mm(row, size))).collect()
}

/// Whether all sizes are such as sieves of aggregates have.
fn is_plausible(about: &[About]) -> bool {
    about.iter().all(|of| match *of {
        About::Sieve(mm) | About::Below(mm) | About::Above(mm) => {
            (PLAUSIBLE_MM[0]..=PLAUSIBLE_MM[1]).contains(&mm)
        }
        About::Class(low, high) => low >= 0.0 && high <= PLAUSIBLE_MM[1],
        _ => true,
    })
}

fn note(block: &Block, text: &str) -> Note {
    let row = block.rows.first();
    Note { cell: row.and_then(|row| row.cell.clone()), ..Note::plain(row.map(|row| row.line), text) }
}

/// The sizes in the labels of a grading, with their rows.
fn numbers(block: &Block) -> impl Iterator<Item = (usize, Size)> {
    block.rows.iter().enumerate().flat_map(|(row, of)| sizes_of(of.label).map(move |size| (row, size)))
}

/// The sizes in a label.
pub(super) fn sizes_of(label: Label) -> impl Iterator<Item = Size> {
    let (first, second) = match label {
        Label::Sieve(size) | Label::Below(size) | Label::Above(size) => (Some(size), None),
        Label::Class(low, high) => (Some(low), Some(high)),
        _ => (None, None),
    };
    first.into_iter().chain(second)
}

/// The unit that most sieves are printed in.
fn printed_unit(block: &Block, other: Unit) -> Unit {
    let units: Vec<Unit> = numbers(block)
        .map(|(_, size)| size.unit.unwrap_or(if size.is_fraction { Unit::Inch } else { other }))
        .collect();
    let count = |unit: &Unit| units.iter().filter(|of| *of == unit).count();
    units.iter().copied().max_by_key(|unit| count(unit)).unwrap_or(other)
}

/// Whether the sieves of a table go in one direction.
fn is_monotone(about: &[About]) -> bool {
    let sizes: Vec<f64> =
        about.iter().filter_map(|of| if let About::Sieve(mm) = of { Some(*mm) } else { None }).collect();
    sizes.windows(2).all(|pair| pair[0] < pair[1]) || sizes.windows(2).all(|pair| pair[0] > pair[1])
}
