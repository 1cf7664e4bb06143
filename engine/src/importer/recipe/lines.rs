//! Lines of a text that have a part and its amounts: `Cement CEM I 42,5 R: 350 kg/m³`, `20 mm Jelly 618`,
//! `350 kg cement, 175 l water`. Strength classes, sizes and numbers of sieves are names, not amounts.

use super::super::number::{Decimal, quantity};
use super::super::words::fold;
use super::ingredients::{Kind, kind};
use super::units::{Unit, groups, unit};

/// Longest line that is looked at; what is longer is prose.
const MAX_LINE_BYTES: usize = 400;
/// Most words of a unit, such as `Kg / M 3`.
const UNIT_WORDS: usize = 5;

/// A part and its amounts.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pair {
    pub(super) label: String,
    pub(super) amounts: Vec<String>,
}

/// The pairs of a line; empty where it has none.
pub(super) fn pairs(line: &str, decimal: Decimal) -> Vec<Pair> {
    if line.len() > MAX_LINE_BYTES {
        return Vec::new();
    }
    let line = line.trim().trim_start_matches(['-', '•', '*', '–', '·']).trim_start();
    let segments = segments(line);
    if segments.len() > 1 {
        let found: Vec<Pair> = segments.iter().filter_map(|segment| pair(segment, decimal)).collect();
        let parts = found.iter().filter(|pair| is_known(&pair.label)).count();
        if parts >= 2 {
            return found;
        }
    }
    pair(line, decimal).into_iter().collect()
}

fn is_known(label: &str) -> bool {
    !matches!(kind(label), Kind::Unknown | Kind::Name)
}

/// The parts of a line between signs and words of lists.
fn segments(line: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut start = 0;
    let mut depth = 0_usize;
    for (at, character) in line.char_indices() {
        match character {
            '(' | '[' => depth += 1,
            ')' | ']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > 0 || at < start {
            continue;
        }
        let rest = &line[at..];
        let sign = [", ", "; ", " | ", " and ", " und ", " et ", " y ", " e "]
            .iter()
            .find(|sign| rest.starts_with(**sign));
        if let Some(sign) = sign {
            found.push(line[start..at].trim());
            start = at + sign.len();
        }
    }
    found.push(line[start..].trim());
    found.retain(|segment| !segment.is_empty());
    found
}

/// The one pair of a text. Where amounts end in something else, the next place to look is behind it, so that a line is
/// read once.
fn pair(text: &str, decimal: Decimal) -> Option<Pair> {
    let mut behind = 0;
    for (at, sign) in text.match_indices([':', '=', '…', '\t']) {
        let start = at + sign.len();
        if start < behind {
            continue;
        }
        match amounts(&text[start..], decimal) {
            Ok(amounts) => return with_label(&text[..at], amounts),
            Err(left) => behind = text.len() - left,
        }
        if let Some(pair) = with_density(&text[..at], &text[start..], decimal) {
            return Some(pair);
        }
    }
    let mut before = ' ';
    behind = 1;
    for (at, character) in text.char_indices() {
        // Dots lead to an amount.
        let is_parted = before.is_whitespace() || before == '…' || text[..at].ends_with("..");
        before = character;
        let starts =
            character.is_ascii_digit() || matches!(character, '~' | '<' | '-' | '−' | '½' | '¼' | '¾');
        if at < behind || !starts || !is_parted || is_name(text, at, decimal) {
            continue;
        }
        match amounts(&text[at..], decimal) {
            Ok(amounts) => return with_label(&text[..at], amounts),
            Err(left) => behind = text.len() - left,
        }
    }
    first_amount(text, decimal)
}

fn with_label(label: &str, amounts: Vec<String>) -> Option<Pair> {
    // Dots that lead to an amount are several.
    let label = label.trim_end_matches(|c: char| c.is_whitespace() || ":=…_-".contains(c));
    let dots = label.len() - label.trim_end_matches('.').len();
    let label = if dots > 1 { label.trim_end_matches(['.', '…', ' ']) } else { label };
    label.chars().any(char::is_alphabetic).then(|| Pair { label: label.trim().to_owned(), amounts })
}

/// An amount with more of the name and a density behind it: `= 300 kg/m³ CEM I 42,5 R ρ = 3,1 kg/dm³`.
fn with_density(label: &str, text: &str, decimal: Decimal) -> Option<Pair> {
    let (amount, rest) = amount(text, decimal)?;
    let at = rest.find('ρ')?;
    quantity(&amount, decimal).filter(|of| !of.rest.is_empty())?;
    let label = format!("{} {} ({})", label.trim(), rest[..at].trim(), rest[at..].trim());
    with_label(&label, vec![amount])
}

/// A pair whose amount stands first: `350 kg/m³ Zement`.
fn first_amount(text: &str, decimal: Decimal) -> Option<Pair> {
    let (amount, rest) = amount(text, decimal)?;
    let rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == ':');
    let rest = rest.strip_prefix("of ").or_else(|| rest.strip_prefix("de ")).unwrap_or(rest).trim();
    let has_unit = quantity(&amount, decimal).is_some_and(|of| !of.rest.is_empty());
    (has_unit && rest.starts_with(char::is_alphabetic) && is_known(rest))
        .then(|| Pair { label: rest.to_owned(), amounts: vec![amount] })
}

/// Whether the number at this place is one of a name: a size, a strength class, the number of a sieve.
fn is_name(text: &str, at: usize, decimal: Decimal) -> bool {
    let word: &str = text[at..].split_whitespace().next().unwrap_or("");
    let digits = |part: &str| part.starts_with(|c: char| c.is_ascii_digit());
    let is_range = word
        .split_once(['/', '–'])
        .or_else(|| word.trim_start_matches('-').split_once('-'))
        .is_some_and(|(_, after)| digits(after));
    let last = fold(text[..at].split_whitespace().next_back().unwrap_or(""));
    let is_numbered =
        matches!(last.trim(), "no." | "no" | "nr." | "nr" | "type" | "typ" | "class" | "grade" | "#");
    let value = quantity(word, decimal).map(|of| of.value);
    let is_strength = value.is_some_and(|value| [22.5, 32.5, 42.5, 52.5].contains(&value))
        && kind(&text[..at]) == Kind::Cement
        && text[at + word.len()..].contains(|c: char| c.is_ascii_digit());
    is_range
        && !word.ends_with(['"', '”'])
        && quantity(word, decimal).is_none_or(|of| !of.is_fraction || at > 0)
        || is_numbered
        || is_strength
}

/// Amounts up to the end of a text; where something else stands among them, the length of the text from there on.
fn amounts(text: &str, decimal: Decimal) -> Result<Vec<String>, usize> {
    let mut rest = text.trim();
    let mut found = Vec::new();
    while !rest.is_empty() {
        let (amount, after) = amount(rest, decimal).ok_or(rest.len())?;
        // What parts of a ratio are parted by belongs to no amount.
        if after.starts_with([':', '/', '-', '–']) {
            return Err(after.len());
        }
        let is_other = found.last().is_some_and(|last: &String| last.ends_with(OTHER));
        match found.last_mut() {
            // The same amount in another unit.
            Some(last) if is_other => {
                *last =
                    if is_heavier(last, &amount) { last.trim_end_matches(OTHER).to_owned() } else { amount };
            }
            _ => found.push(amount),
        }
        let other = ["or ", "oder ", "ou "].iter().find_map(|word| after.strip_prefix(word));
        if let Some(other) = other {
            if let Some(last) = found.last_mut() {
                last.push_str(OTHER);
            }
            rest = other.trim();
            continue;
        }
        rest = after.trim_start_matches([',', ';', '|', '.']).trim();
    }
    if found.is_empty() { Err(0) } else { Ok(found) }
}

/// Marks an amount that is followed by the same one in another unit.
const OTHER: &str = "\u{0}";

/// Whether the first of two ways to say an amount is by mass and the second is not.
fn is_heavier(first: &str, second: &str) -> bool {
    let is_mass = |text: &str| {
        let text = text.trim_end_matches(OTHER);
        let at = text.find(|c: char| c.is_alphabetic()).unwrap_or(text.len());
        matches!(unit(&text[at..]), Some(Unit::Mass(_) | Unit::Content(_)))
    };
    is_mass(first) && !is_mass(second)
}

/// The amount at the beginning of a text with its unit and a remark in brackets, and what follows.
fn amount(text: &str, decimal: Decimal) -> Option<(String, &str)> {
    let text = text.trim();
    let number = text.trim_start_matches(['~', '≈', '<', '>', ' ']);
    if let Some(rest) = ["-", "–", "—"].iter().find_map(|dash| number.strip_prefix(dash))
        && (rest.is_empty()
            || rest.starts_with(' ') && !rest.trim_start().starts_with(|c: char| c.is_ascii_digit()))
    {
        return Some(("-".to_owned(), rest.trim_start()));
    }
    let quantity = quantity(number, decimal)?;
    let start = text.len() - quantity.rest.len();
    // Marks of footnotes.
    let after = text[start..].trim_start_matches(['*', '†', '‡', '¹', '²']);
    let begin = text.len() - after.len();
    let ends: Vec<usize> = word_ends(after);
    let known = ends.iter().take(UNIT_WORDS).rev().find(|&&end| {
        let text = after[..end].trim_end_matches(['.', ',', ';']);
        // The next amount is no part of the unit; the mass of a bag and the 3 of `m 3` are.
        let has_number =
            text.split_whitespace().any(|word| word.starts_with(|c: char| c.is_ascii_digit()) && word != "3");
        if has_number && !text.starts_with(char::is_alphabetic) {
            return false;
        }
        match unit(text) {
            Some(Unit::Bags { .. }) => kind(text) != Kind::Cement,
            Some(_) => !has_number,
            None => false,
        }
    });
    let mut end = begin + known.copied().unwrap_or(0);
    let mut following = text[end..].trim_start();
    if following.starts_with(['(', '[']) {
        let (_, close) = *groups(following).first()?;
        end = text.len() - following.len() + close;
        following = text[end..].trim_start();
    }
    Some((text[..end].trim_end_matches([',', ';', ' ']).to_owned(), following))
}

/// Where the words of a text end.
fn word_ends(text: &str) -> Vec<usize> {
    let mut ends = Vec::new();
    let mut is_inside = false;
    for (at, character) in text.char_indices() {
        if character.is_whitespace() && is_inside {
            ends.push(at);
        }
        is_inside = !character.is_whitespace();
    }
    if is_inside {
        ends.push(text.len());
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Vec<(String, Vec<String>)> {
        let decimal = if line.contains(',') { Decimal::Comma } else { Decimal::Point };
        pairs(line, decimal).into_iter().map(|pair| (pair.label, pair.amounts)).collect()
    }

    #[test]
    fn lines_have_a_part_and_amounts() {
        for (line, label, amounts) in [
            ("Cement CEM I 42,5 R: 350 kg/m³", "Cement CEM I 42,5 R", vec!["350 kg/m³"]),
            ("Cement CEM I 42,5 R 350 kg/m³", "Cement CEM I 42,5 R", vec!["350 kg/m³"]),
            ("Cement CEM I 42,5 350 400", "Cement CEM I 42,5", vec!["350", "400"]),
            ("Cement : 430 Kg/ M 3", "Cement", vec!["430 Kg/ M 3"]),
            ("20 mm Jelly : 618 Kg/ M 3", "20 mm Jelly", vec!["618 Kg/ M 3"]),
            ("Agregado fino seco………....770 kg/m3", "Agregado fino seco", vec!["770 kg/m3"]),
            ("Absorción……………………….. 0.8% 0.6%", "Absorción", vec!["0.8%", "0.6%"]),
            ("Sand 0/4 700 650", "Sand 0/4", vec!["700", "650"]),
            ("Gravel 8-16 mm 1100 kg", "Gravel 8-16 mm", vec!["1100 kg"]),
            ("Coarse aggregate No. 57 1825 lb", "Coarse aggregate No. 57", vec!["1825 lb"]),
            ("350 kg/m³ Zement CEM I 42,5 R", "Zement CEM I 42,5 R", vec!["350 kg/m³"]),
            ("Cement: 6.5 bags (94 lb) per m³", "", vec![]),
            ("Water Cement ratio : 0.43", "Water Cement ratio", vec!["0.43"]),
        ] {
            if !label.is_empty() {
                assert_eq!(
                    read(line),
                    [(label.to_owned(), amounts.iter().map(ToString::to_string).collect())],
                    "{line}"
                );
            }
        }
        for line in ["M40 ( 1 : 1.67 : 2.39)", "Water,282,1.00", "Concrete C25/30", "Material Mix A"] {
            assert_eq!(read(line), [], "{line}");
        }
    }

    #[test]
    fn a_line_can_have_several_parts() {
        let parts = read("Zement 350 kg/m³, Wasser 175 kg/m³, Sand 0/2 700 kg/m³ und Kies 2/16 1100 kg/m³");
        assert_eq!(parts.len(), 4);
        assert_eq!(parts[3], ("Kies 2/16".to_owned(), vec!["1100 kg/m³".to_owned()]));
        let parts = read("350 kg cement, 175 l water, 700 kg sand");
        assert_eq!(parts[1], ("water".to_owned(), vec!["175 l".to_owned()]));
    }
}
