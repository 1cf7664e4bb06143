//! Ratios of parts in a text: `1 : 2 : 3 : 0.5`, `cement : sand : water = 1 : 3 : 0.5`, `Mörtel 1:3, w/z 0,5`.

use super::super::number::{Decimal, quantity};
use super::super::table::Table;
use super::super::words::{fold, has};
use super::draft::{Draft, Entry};
use super::ingredients::{Kind, kind};
use super::labels::label;
use super::lines;
use super::titles::says_volume;
use super::units::{Unit, unit};

/// Words of a text that speaks of concrete or mortar.
const SPEAKS: &str = "\
    cement|zement|ciment|cimento|mortar|mortel|mortier|mortero|argamassa|malta|concrete|beton|hormigon|concreto|\
    calcestruzzo|traco|w/c|w/z|e/c|a/c|sand|mix";
/// Largest part of a ratio.
const MOST: f64 = 50.0;

/// Whether a recipe names aggregates with amounts.
pub(super) fn has_aggregates(draft: &Draft) -> bool {
    draft
        .entries
        .iter()
        .any(|entry| matches!(entry.label.kind, Kind::Aggregate | Kind::AllAggregate | Kind::AggregateCement))
}

/// The recipe of the first ratio of the tables; what else they state of cement, water and air is taken from them.
pub(super) fn draft(tables: &[Table], drafts: &[Draft], decimal: Decimal) -> Option<Draft> {
    let rows = || tables.iter().flat_map(|table| &table.rows);
    let texts: Vec<(u32, String)> = rows().map(|row| (row.line, row.text())).collect();
    let speaks = texts.iter().any(|(_, text)| has(&fold(text), SPEAKS));
    let (line, parts, mut before, after) = texts.iter().find_map(|(line, text)| {
        found(text, decimal).map(|(parts, before, after)| (*line, parts, before, after))
    })?;
    if !before.chars().any(char::is_alphabetic) {
        // The names stand in the line above.
        let above = texts.iter().rev().find(|(of, text)| *of < line && text.chars().any(char::is_alphabetic));
        before = above.map_or(before, |(_, text)| text.clone());
    }
    // Four numbers say enough by themselves.
    if !speaks && parts.len() < 4 {
        return None;
    }
    let mut draft = match drafts {
        [one] => one.clone(),
        _ => Draft::default(),
    };
    draft.by_volume = texts.iter().any(|(_, text)| says_volume(text));
    let mut entries = Vec::new();
    let names = names(&before, &after, &parts)?;
    let cement =
        names.iter().zip(&parts).find(|(name, _)| kind(name) == Kind::Cement).map(|(_, value)| *value)?;
    // The content of cement gives all others; numbers in a sentence are taken where no table has them.
    for (line, text) in &texts {
        for pair in lines::pairs(text, decimal) {
            let label = label(&pair.label, decimal);
            let is_taken =
                draft.entries.iter().chain(&entries).any(|entry: &Entry| entry.label.kind == label.kind);
            let counts = matches!(
                label.kind,
                Kind::Cement | Kind::WaterCement | Kind::WaterBinder(_) | Kind::Air | Kind::Water(_)
            );
            let Some(amount) = pair.amounts.first().and_then(|text| quantity(text, decimal)) else {
                continue;
            };
            let own = unit(amount.rest).or(label.unit);
            let is_part = matches!(label.kind, Kind::Cement | Kind::Water(_));
            if counts && !is_taken && (own.is_some() || !is_part) {
                entries.push(Entry::new(label, amount.value, own, *line));
            }
        }
    }
    draft.entries.extend(entries);
    let of_cement = draft.entries.iter().find(|entry| entry.label.kind == Kind::Cement);
    let (factor, unit) = match of_cement.map(|entry| (entry.value, entry.unit)) {
        Some((value, Some(Unit::Content(factor)))) => (value * factor / cement, Some(Unit::Content(1.0))),
        Some((value, Some(unit @ Unit::Mass(_)))) => (value / cement, Some(unit)),
        Some(_) => return None,
        None => (1.0, None),
    };
    for (name, value) in names.iter().zip(&parts) {
        let label = label(name, decimal);
        let is_taken = draft.entries.iter().any(|entry| match (entry.label.kind, label.kind) {
            (Kind::Water(_), Kind::Water(_)) => true,
            (own, other) => own == other && other != Kind::Aggregate,
        });
        if !is_taken {
            draft.entries.push(Entry::new(label, value * factor, unit, line));
        }
    }
    // Water in kilograms and a ratio of its own do not go together with parts by volume.
    draft.by_volume &= unit.is_none();
    Some(draft)
}

/// The numbers of the ratio in a text, and what stands before and behind it.
fn found(text: &str, decimal: Decimal) -> Option<(Vec<f64>, String, String)> {
    for (at, character) in text.char_indices() {
        let before = text[..at].chars().next_back();
        let continues = before.is_some_and(|c| c.is_alphanumeric() || ".,:/".contains(c));
        if !character.is_ascii_digit() || continues {
            continue;
        }
        let mut parts = Vec::new();
        let mut rest = &text[at..];
        while let Some(amount) = quantity(rest, decimal).filter(|of| (0.0..=MOST).contains(&of.value)) {
            parts.push(amount.value);
            rest = amount.rest;
            match rest.strip_prefix([':', '∶']) {
                Some(after) => rest = after.trim_start(),
                None => break,
            }
        }
        if parts.len() == 1
            && let Some(found) = named(&text[at..], decimal)
        {
            return Some(found);
        }
        let has_one = parts.contains(&1.0);
        if (2..=6).contains(&parts.len()) && has_one && parts.iter().all(|&part| part > 0.0) {
            // A scale and a time of day have two numbers too.
            return Some((parts, text[..at].to_owned(), rest.to_owned()));
        }
    }
    None
}

/// A ratio with a name behind each number: `1 cement : 2 sand : 4 gravel`.
fn named(text: &str, decimal: Decimal) -> Option<(Vec<f64>, String, String)> {
    let mut parts = Vec::new();
    let mut names: Vec<&str> = Vec::new();
    for segment in text.split([':', '∶']).take(6) {
        let amount = quantity(segment, decimal).filter(|of| (0.0..=MOST).contains(&of.value))?;
        let words = amount.rest.find(|c: char| !c.is_alphabetic() && c != ' ').unwrap_or(amount.rest.len());
        let name = amount.rest[..words].trim();
        let name = name.split(" by ").next().unwrap_or(name);
        if !kind(name).is_part() {
            return None;
        }
        parts.push(amount.value);
        names.push(name);
    }
    (parts.len() >= 2).then(|| (parts, names.join(":"), String::new()))
}

/// The names of the parts: those of the text, else by their number and size.
fn names(before: &str, after: &str, parts: &[f64]) -> Option<Vec<String>> {
    for text in [before, after] {
        let text = text.trim().trim_matches(|c: char| "=()[]:,;.".contains(c)).trim();
        let text = text.rsplit_once('(').map_or(text, |(_, inner)| inner);
        for sign in [":", "/", "-", ","] {
            let names: Vec<&str> = text.split(sign).map(str::trim).collect();
            // A sentence may stand before the first and behind the last name.
            let known = names
                .iter()
                .filter(|name| kind(name).is_part() || matches!(kind(name), Kind::Admixture))
                .count();
            if names.len() == parts.len() && known == names.len() {
                let trimmed =
                    names.iter().map(|name| name.trim_matches(|c: char| "=:() ".contains(c)).to_owned());
                return Some(trimmed.collect());
            }
        }
    }
    let is_water = |value: f64| value < 1.0;
    let names: &[&str] = match parts {
        [first, _, ..] if is_water(*first) && parts[1] == 1.0 => match parts.len() {
            3 => &["water", "cement", "sand"],
            4 => &["water", "cement", "sand", "gravel"],
            _ => return None,
        },
        [_, _] => &["cement", "sand"],
        [_, _, last] if is_water(*last) => &["cement", "sand", "water"],
        [_, _, _] => &["cement", "sand", "gravel"],
        [_, _, _, last] if is_water(*last) => &["cement", "sand", "gravel", "water"],
        _ => return None,
    };
    let first_is_one = parts[names.iter().position(|name| *name == "cement")?] == 1.0;
    first_is_one.then(|| names.iter().map(ToString::to_string).collect())
}
