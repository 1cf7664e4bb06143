//! From the values of a column, under one of their meanings, to the share that passes each sieve.
//!
//! A meaning fits where its values are those of a grading: shares that pass rise towards coarser sieves, and all of the
//! mass passes the coarsest one; what stays on the sieves and in the pan is all of it, to 1 %.

use super::sieve::Label;
use super::{Meaning, Note, Refusal};
use crate::request::{LEAST_TOP, next_sieve};

/// Values that should be all of the mass may miss it by this share.
const TOLERANCE: f64 = 0.01;
/// A difference that is mentioned: above what rounding to 0.1 % leaves.
const MENTIONED: f64 = 1.0e-3;

/// What an entry is about, with sizes in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum About {
    Sieve(f64),
    Class(f64, f64),
    Below(f64),
    Above(f64),
    Pan,
    Total,
    Wash,
    Initial,
    Loss,
}

impl About {
    /// What a label is about, where `mm` has the sizes of its unit.
    pub(super) fn of(label: Label, mm: impl Fn(super::sieve::Size) -> Option<f64>) -> Option<Self> {
        Some(match label {
            Label::Sieve(size) => Self::Sieve(mm(size)?),
            Label::Class(low, high) => {
                let (a, b) = (mm(low)?, mm(high)?);
                Self::Class(a.min(b), a.max(b))
            }
            Label::Below(size) => Self::Below(mm(size)?),
            Label::Above(size) => Self::Above(mm(size)?),
            Label::Pan => Self::Pan,
            Label::Total => Self::Total,
            Label::Wash => Self::Wash,
            Label::Initial => Self::Initial,
            Label::Loss => Self::Loss,
        })
    }
}

/// A value of a column.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) line: u32,
    pub(super) cell: Option<String>,
    pub(super) about: About,
    /// `None` where the cell is empty.
    pub(super) value: Option<f64>,
}

impl Entry {
    fn fault(&self, text: impl Into<String>) -> Refusal {
        Refusal::at(self.line, text).in_cell(self.cell.clone())
    }
}

/// A curve that a column has under a meaning.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub(super) meaning: Meaning,
    /// Sieves in mm with the passing, from the finest to the coarsest.
    pub(super) points: Vec<[f64; 2]>,
    pub(super) completed: Vec<f64>,
    pub(super) notes: Vec<Note>,
}

/// The curves that a column has under a meaning: more than one where fractions may stand among percents.
///
/// # Errors
/// [`Refusal`] at the first value that a grading cannot have.
pub(super) fn fits(entries: &[Entry], meaning: Meaning) -> Result<Vec<Fit>, Refusal> {
    check_values(entries)?;
    let is_sum = !matches!(meaning, Meaning::Retained | Meaning::Mass);
    if let (true, Some(entry)) = (is_sum, entries.iter().find(|of| matches!(of.about, About::Class(..)))) {
        return Err(entry.fault("has a class of sizes: a cumulated share needs one sieve"));
    }
    let entries = &with_pan(entries, meaning);
    let mut notes = Vec::new();
    let shares = match meaning {
        Meaning::Passing | Meaning::CumulativeRetained => return of_shares(entries, meaning),
        Meaning::MassPassing | Meaning::CumulativeMass => vec![of_sums(entries, meaning, &mut notes)?],
        Meaning::Retained | Meaning::Mass => vec![of_parts(entries, meaning, &mut notes)?],
    };
    shares.into_iter().map(|points| finished(points, entries, meaning, notes.clone())).collect()
}

/// The same entries, where a row below a sieve that has a row of its own is the pan.
fn with_pan(entries: &[Entry], meaning: Meaning) -> Vec<Entry> {
    let is_sieve = |mm: f64| entries.iter().any(|of| of.about == About::Sieve(mm));
    let stays = matches!(meaning, Meaning::CumulativeRetained | Meaning::CumulativeMass);
    let about = |about: About| match about {
        About::Below(mm) if stays && is_sieve(mm) => About::Pan,
        other => other,
    };
    entries.iter().map(|entry| Entry { about: about(entry.about), ..entry.clone() }).collect()
}

fn check_values(entries: &[Entry]) -> Result<(), Refusal> {
    for entry in entries {
        if let Some(value) = entry.value
            && value < 0.0
        {
            return Err(entry.fault(format!("{value} is negative: must be at least 0")));
        }
    }
    let sizes: Vec<(f64, &Entry)> = entries
        .iter()
        .filter_map(|entry| match entry.about {
            About::Sieve(mm) => Some((mm, entry)),
            About::Class(low, _) => Some((low, entry)),
            _ => None,
        })
        .collect();
    let mut sorted = sizes.clone();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    for pair in sorted.windows(2) {
        if (pair[1].0 / pair[0].0 - 1.0).abs() < 1.0e-6 {
            let (mm, entry) = if pair[0].1.line > pair[1].1.line { pair[0] } else { pair[1] };
            return Err(entry.fault(format!("the sieve {mm} mm stands in two rows: must stand in one")));
        }
    }
    Ok(())
}

/// The values at sieves, from the finest to the coarsest. A size that a cumulative share is below of, or above of, is a
/// sieve.
fn at_sieves(entries: &[Entry]) -> Vec<(f64, f64, &Entry)> {
    let mut found: Vec<(f64, f64, &Entry)> = entries
        .iter()
        .filter_map(|entry| match entry.about {
            About::Sieve(mm) | About::Below(mm) | About::Above(mm) => Some((mm, entry.value?, entry)),
            _ => None,
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

/// Shares that pass or stay, cumulated: percents or fractions.
fn of_shares(entries: &[Entry], meaning: Meaning) -> Result<Vec<Fit>, Refusal> {
    let rows = at_sieves(entries);
    let Some(&(_, _, first)) = rows.first() else { return Err(Refusal::new("has no value at a sieve")) };
    let most = rows.iter().map(|(_, value, _)| *value).fold(0.0, f64::max);
    if let Some((_, value, entry)) = rows.iter().find(|(_, value, _)| *value > 100.0 * (1.0 + TOLERANCE)) {
        return Err(entry.fault(format!("{value} is out of range: must be at most 100 %")));
    }
    let is_percent = most > 1.0 + MENTIONED;
    let whole = if is_percent { 100.0 } else { 1.0 };
    let pan = entries.iter().find(|entry| entry.about == About::Pan && entry.value.is_some());
    if let Some((pan, value)) = pan.and_then(|pan| Some((pan, pan.value?))) {
        let expected = if meaning == Meaning::Passing { 0.0 } else { whole };
        if (value - expected).abs() > TOLERANCE * whole {
            return Err(pan.fault(format!("{value} stands in the row of the pan: must be {expected}")));
        }
    }
    let passing = |value: f64| {
        let share = (value / whole).min(1.0);
        if meaning == Meaning::Passing { share } else { 1.0 - share }
    };
    let points: Vec<[f64; 2]> = rows.iter().map(|(mm, value, _)| [*mm, rounded(passing(*value))]).collect();
    let words = if meaning == Meaning::Passing { "passing" } else { "cumulative residue" };
    for pair in rows.windows(2) {
        let ((d_before, before, a), (d_after, after, b)) = (pair[0], pair[1]);
        if passing(after) < passing(before) {
            // The later row of the table is the one that breaks the order.
            let entry = if a.line > b.line { a } else { b };
            let direction = if meaning == Meaning::Passing { "fall" } else { "rise" };
            return Err(entry.fault(format!(
                "the {words} must not {direction} towards coarser sieves: it is {before} at {d_before} mm and \
                 {after} at \
                 {d_after} mm"
            )));
        }
    }
    let mut notes = Vec::new();
    if most > whole * (1.0 + MENTIONED) {
        notes.push(Note::warning(
            Some(first.line),
            format!("{most} is above {whole}: it is read as all of the mass"),
        ));
    }
    let mut found = vec![finished(points, entries, meaning, notes.clone())?];
    let few: Vec<&(f64, f64, &Entry)> = rows.iter().filter(|(_, value, _)| *value <= 1.0).collect();
    if is_percent && few.iter().any(|(_, value, _)| *value > 0.0 && *value < 1.0) {
        // What a reader sees who takes the values up to 1 for fractions.
        let mixed = |value: f64| passing(if value <= 1.0 { 100.0 * value } else { value });
        let points: Vec<[f64; 2]> = rows.iter().map(|(mm, value, _)| [*mm, rounded(mixed(*value))]).collect();
        if points.windows(2).all(|pair| pair[0][1] <= pair[1][1]) && points[0][1] < 1.0 {
            let lines = few.iter().map(|(_, _, entry)| entry.line.to_string()).collect::<Vec<_>>().join(", ");
            let text = format!("rows {lines}: the values up to 1 can be fractions among percents");
            found[0]
                .notes
                .push(Note::warning(Some(few[0].2.line), format!("{text}; here they are read as percents")));
            notes
                .push(Note::warning(Some(few[0].2.line), format!("{text}; here they are read as fractions")));
            found.push(finished(points, entries, meaning, notes)?);
        }
    }
    Ok(found)
}

/// The value of a row of its kind.
fn stated(entries: &[Entry], about: About) -> Option<(f64, &Entry)> {
    entries.iter().filter(|entry| entry.about == about).find_map(|entry| Some((entry.value?, entry)))
}

/// Masses that pass or stay, cumulated.
fn of_sums(entries: &[Entry], meaning: Meaning, notes: &mut Vec<Note>) -> Result<Vec<[f64; 2]>, Refusal> {
    let rows = at_sieves(entries);
    let (Some(finest), Some(coarsest)) = (rows.first(), rows.last()) else {
        return Err(Refusal::new("has no value at a sieve"));
    };
    let passes = meaning == Meaning::MassPassing;
    let of_pan = stated(entries, About::Pan).map(|(value, _)| value);
    let printed = stated(entries, About::Total).or_else(|| stated(entries, About::Initial));
    let largest = if passes { coarsest.1 } else { of_pan.unwrap_or(0.0).max(finest.1) };
    let whole = printed.map_or(largest, |(value, _)| value);
    if whole <= 0.0 {
        return Err(coarsest.2.fault("the mass of the sample is 0: must be larger"));
    }
    if let Some((total, entry)) = printed
        && (of_pan.is_some() || passes)
        && (largest - total).abs() > TOLERANCE * total
    {
        return Err(entry.fault(format!(
            "states {total}, and the values reach {largest}: must agree to 1 %; correct the one that is wrong"
        )));
    }
    if printed.is_none() && of_pan.is_none() && !passes {
        notes.push(Note::warning(
            Some(finest.2.line),
            format!(
                "no pan and no total: {whole} is taken for all of the mass, so that nothing passes {} mm",
                finest.0
            ),
        ));
    }
    let passing = |value: f64| if passes { value / whole } else { 1.0 - value / whole };
    for pair in rows.windows(2) {
        if passing(pair[1].1) < passing(pair[0].1) {
            let entry = if pair[0].2.line > pair[1].2.line { pair[0].2 } else { pair[1].2 };
            return Err(entry.fault(format!(
                "the {} must not change its direction: it is {} at {} mm and {} at {} mm",
                meaning.name(),
                pair[0].1,
                pair[0].0,
                pair[1].1,
                pair[1].0
            )));
        }
    }
    Ok(rows.iter().map(|(mm, value, _)| [*mm, rounded(passing(*value).clamp(0.0, 1.0))]).collect())
}

/// What stays on each sieve, or is in each class: percents, fractions or masses.
fn of_parts(entries: &[Entry], meaning: Meaning, notes: &mut Vec<Note>) -> Result<Vec<[f64; 2]>, Refusal> {
    let (sieves, below) = parts(entries)?;
    let parts: f64 = sieves.iter().map(|(_, part)| part).sum();
    let washed: f64 = entries.iter().filter(|of| of.about == About::Wash).filter_map(|of| of.value).sum();
    let sum = parts + below.unwrap_or(0.0) + washed;
    let last = entries.last().ok_or_else(|| Refusal::new("has no rows"))?;
    if sum <= 0.0 {
        return Err(last.fault("the values sum to 0: must be larger"));
    }
    let shown = rounded(sum);
    if let Some((total, entry)) = stated(entries, About::Total) {
        compare(shown, total, entry, "the total", notes)?;
    }
    if meaning == Meaning::Mass {
        if let Some((initial, entry)) = stated(entries, About::Initial) {
            compare(shown, initial, entry, "the sample", notes)?;
        }
        let has_whole = [About::Total, About::Initial].iter().any(|of| stated(entries, *of).is_some());
        if below.is_none() && washed == 0.0 && !has_whole && !has_classes(entries) {
            let (finest, _) = sieves[0];
            notes.push(Note::warning(
                Some(last.line),
                format!("no pan: nothing is taken to pass the finest sieve, {finest} mm; add the pan if there was one"),
            ));
        }
    } else {
        let whole = if sum > 1.5 { 100.0 } else { 1.0 };
        let difference = (sum / whole - 1.0).abs();
        if difference > TOLERANCE {
            let unit = if whole > 1.0 { " %" } else { "" };
            return Err(last.fault(format!(
                "the values sum to {shown}{unit}: must be {whole}{unit}, to 1 %; add what is missing (the pan, a \
                 sieve), \
                 or name the column by what it is (passing, cumulative retained, mass in g)"
            )));
        }
        if difference > MENTIONED {
            notes.push(Note::warning(
                Some(last.line),
                format!("the values sum to {shown}: all are divided by it"),
            ));
        }
    }
    let mut passing = below.unwrap_or(0.0) + washed;
    let points = sieves.iter().map(|(mm, part)| {
        let point = [*mm, rounded(passing / sum)];
        passing += part;
        point
    });
    Ok(points.collect())
}

fn has_classes(entries: &[Entry]) -> bool {
    entries.iter().any(|entry| matches!(entry.about, About::Class(..)))
}

/// Compares a sum with what a row states.
fn compare(sum: f64, whole: f64, entry: &Entry, what: &str, notes: &mut Vec<Note>) -> Result<(), Refusal> {
    let difference = (sum - whole).abs();
    if difference > TOLERANCE * whole.abs() {
        return Err(entry.fault(format!(
            "{what} is {whole}, and the rows sum to {sum}: must agree to 1 %; add the row that is missing (the \
             pan), or \
             correct the wrong value"
        )));
    }
    if difference > MENTIONED * whole.abs() {
        notes.push(Note::warning(
            Some(entry.line),
            format!(
                "{what} is {whole}, and the rows sum to {sum}: the difference is shared out over all rows"
            ),
        ));
    }
    Ok(())
}

/// What stays on each sieve in mm, from the finest to the coarsest, and what is below the finest where a row says so.
type Parts = (Vec<(f64, f64)>, Option<f64>);

/// The parts of the mass. A class stays on its lower bound.
fn parts(entries: &[Entry]) -> Result<Parts, Refusal> {
    let mut sieves: Vec<(f64, f64)> = Vec::new();
    let mut below: Option<f64> = None;
    let mut bounds: Vec<(f64, f64, &Entry)> = Vec::new();
    for entry in entries {
        let value = entry.value.unwrap_or(0.0);
        match entry.about {
            About::Sieve(mm) | About::Above(mm) => sieves.push((mm, value)),
            About::Class(0.0, high) => {
                below = Some(below.unwrap_or(0.0) + value);
                sieves.push((high, 0.0));
            }
            About::Class(low, high) => {
                bounds.push((low, high, entry));
                sieves.push((low, value));
                sieves.push((high, 0.0));
            }
            About::Below(mm) => {
                below = Some(below.unwrap_or(0.0) + value);
                sieves.push((mm, 0.0));
            }
            About::Pan => below = entry.value.map(|value| below.unwrap_or(0.0) + value).or(below),
            About::Total | About::Wash | About::Initial | About::Loss => {}
        }
    }
    sieves.sort_by(|a, b| a.0.total_cmp(&b.0));
    sieves.dedup_by(|later, first| {
        let same = (later.0 / first.0 - 1.0).abs() < 1.0e-3;
        if same {
            first.1 += later.1;
        }
        same
    });
    if sieves.is_empty() {
        return Err(Refusal::new("has no value at a sieve"));
    }
    for (low, high, entry) in bounds {
        let inside = sieves.iter().find(|(mm, _)| *mm > low * 1.001 && *mm < high * 0.999);
        if let Some((mm, _)) = inside {
            return Err(entry.fault(format!(
                "the class from {low} to {high} mm has the bound {mm} mm of another one inside: classes must not \
                 overlap"
            )));
        }
    }
    Ok((sieves, below))
}

/// Numbers typed by hand, without the digits that arithmetic leaves.
pub(super) fn rounded(number: f64) -> f64 {
    (number * 1.0e9).round() / 1.0e9
}

/// The curve of these points, with its coarsest sieve added where nearly all passes the last one.
fn finished(
    mut points: Vec<[f64; 2]>,
    entries: &[Entry],
    meaning: Meaning,
    mut notes: Vec<Note>,
) -> Result<Fit, Refusal> {
    let line_of = |mm: f64| {
        entries.iter().find(|entry| match entry.about {
            About::Sieve(of) | About::Below(of) | About::Above(of) => of == mm,
            About::Class(low, high) => low == mm || high == mm,
            _ => false,
        })
    };
    let at = |mm: f64, text: String| match line_of(mm) {
        Some(entry) => entry.fault(text),
        None => Refusal::new(text),
    };
    if points.len() < 2 {
        return Err(Refusal::new(format!("has values at {} sieve: must have at least 2", points.len())));
    }
    let [finest, first] = points[0];
    if first >= 1.0 {
        return Err(at(
            finest,
            format!("all of the mass passes the finest sieve, {finest} mm: some must stay on it"),
        ));
    }
    let [coarsest, last] = points[points.len() - 1];
    let mut completed = Vec::new();
    if last < 1.0 {
        let next = next_sieve(points[points.len() - 2][0], coarsest);
        if last < LEAST_TOP {
            let percent = rounded(100.0 * last);
            return Err(at(
                coarsest,
                format!(
                    "{percent} % pass the coarsest sieve, {coarsest} mm: all of the mass must; add the coarser \
                     sieves (from \
                 {} % on, the next sieve of the series is added, here {next} mm)",
                    100.0 * LEAST_TOP
                ),
            ));
        }
        points.push([next, 1.0]);
        completed.push(next);
        notes.push(Note::warning(
            line_of(coarsest).map(|entry| entry.line),
            format!(
                "{} % pass the coarsest sieve, {coarsest} mm: the sieve {next} mm was added",
                rounded(100.0 * last)
            ),
        ));
    }
    Ok(Fit { meaning, points, completed, notes })
}
