//! What the label of a part states: its name, unit, density, and whether it is dry.

use super::super::number::{Decimal, quantity};
use super::super::words::fold;
use super::ingredients::{Kind, has_density, kind};
use super::units::{Unit, groups, unit, unit_in};

/// What a label states.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Label {
    /// Without units, densities and states.
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) unit: Option<Unit>,
    pub(super) density_kg_m3: Option<f64>,
    /// Whether the aggregate is said to be dry.
    pub(super) is_dry: bool,
}

/// Reads a label.
pub(super) fn label(text: &str, decimal: Decimal) -> Label {
    let mut name = spoken(without_share(text.trim())).replace('=', " ");
    let mut density_kg_m3 = None;
    let mut found = None;
    if let Some((unit, rest)) = unit_in(&name) {
        (found, name) = (Some(unit), rest);
    }
    let mut is_dry = false;
    let mut bag = None;
    for (open, close) in groups(&name).into_iter().rev() {
        let inner = name[open..close].trim_matches(['(', ')', '[', ']', '{', '}']).trim();
        let folded = fold(inner);
        let value = stated_density(inner, decimal);
        // The mass of a bag.
        if let Some(Unit::Mass(factor)) = quantity(inner, decimal).and_then(|of| unit(of.rest)) {
            let kg = quantity(inner, decimal).map(|of| of.value * factor);
            bag = bag.or(Some(Unit::Bags { kg, in_m3: None }));
            name.replace_range(open..close, "");
            continue;
        }
        let is_state = is_state(folded.trim());
        if value.is_some() || is_state {
            is_dry |= is_state && is_dry_word(folded.trim());
            density_kg_m3 = density_kg_m3.or(value);
            name.replace_range(open..close, "");
        }
    }
    // A density after a comma.
    if let (None, Some((before, after))) = (density_kg_m3, name.rsplit_once([',', ';']))
        && let Some(value) = stated_density(after.trim(), decimal)
    {
        density_kg_m3 = Some(value);
        name = before.to_owned();
    }
    while let Some((before, last)) = name.trim_end().rsplit_once([' ', ',']) {
        if !is_state(fold(last).trim()) {
            break;
        }
        is_dry |= is_dry_word(fold(last).trim());
        name = before.trim_end_matches([',', ' ', '-']).to_owned();
    }
    let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
    let name = name.trim_matches(|c: char| c.is_whitespace() || ":=…·*•_,;†‡".contains(c));
    let name = name.trim_end_matches("..").trim_end_matches(['_', ' ']);
    let name = counted_part(name).unwrap_or_else(|| name.to_owned());
    let kind = kind(&name);
    let kind = if kind == Kind::Unknown { self::kind(text) } else { kind };
    let unit = found.or(bag.filter(|_| kind == Kind::Cement));
    Label { name, kind, unit, density_kg_m3, is_dry }
}

/// The part in a sum that stands for a label: `Each bucket of Sand weighs 17 lbs. x 2 buckets`.
fn counted_part(name: &str) -> Option<String> {
    let (before, _) = name.split_once(" x ")?;
    before.contains(|c: char| c.is_ascii_digit()).then_some(())?;
    let mut parts = before.split_whitespace().filter(|word| kind(word).is_part());
    parts.next().filter(|_| parts.next().is_none()).map(ToOwned::to_owned)
}

/// A name of a program, as people write it: `sand_0_4` is `sand 0/4`.
fn spoken(text: &str) -> String {
    if !text.contains('_') || text.contains(' ') {
        return text.to_owned();
    }
    let characters: Vec<char> = text.chars().collect();
    let is_digit = |at: Option<usize>| at.and_then(|at| characters.get(at)).is_some_and(char::is_ascii_digit);
    let replaced = characters.iter().enumerate().map(|(at, &character)| match character {
        '_' if is_digit(at.checked_sub(1)) && is_digit(Some(at + 1)) => '/',
        '_' => ' ',
        other => other,
    });
    replaced.collect()
}

/// A label without the words for a part of a whole: `60 % 20 mm`, `davon 0/2`.
fn without_share(text: &str) -> &str {
    let words = ["davon ", "of which ", "thereof ", "dont ", "di cui ", "de los cuales ", "dos quais "];
    if let Some(rest) = words.iter().find_map(|word| text.strip_prefix(word)) {
        return rest.trim();
    }
    let digits = text.trim_start_matches(|c: char| c.is_ascii_digit() || matches!(c, '.' | ','));
    match digits.trim_start().strip_prefix('%') {
        Some(rest) if digits.len() < text.len() && !rest.trim().is_empty() => rest.trim(),
        _ => text,
    }
}

/// A density in a label: `2,64 kg/dm³`, `SG 2.65`, `ρ = 2650 kg/m³`.
fn stated_density(text: &str, decimal: Decimal) -> Option<f64> {
    let start = text.find(|c: char| c.is_ascii_digit())?;
    let says = has_density(&fold(&text[..start])) || text[..start].contains('ρ');
    let amount = quantity(&text[start..], decimal)?;
    match unit(amount.rest) {
        Some(Unit::Content(factor)) if factor > 10.0 || says => Some(amount.value * factor),
        None if says && amount.rest.is_empty() => Some(density_of(amount.value)),
        _ => None,
    }
    .filter(|density| (300.0..9000.0).contains(density) && (says || start == 0))
}

/// A density in kg/m³ of a number without a unit: a specific gravity where it is small.
pub(super) fn density_of(value: f64) -> f64 {
    if value < 30.0 { 1000.0 * value } else { value }
}

/// Whether words say in which state an aggregate is weighed.
fn is_state(folded: &str) -> bool {
    const STATES: &str =
        "ssd|s.s.a.|s.s.s.|s.s.d.|sss|saturated surface dry|saturated surface-dry|surface dry|wet|moist";
    is_dry_word(folded) || STATES.split('|').any(|state| state == folded)
}

fn is_dry_word(folded: &str) -> bool {
    const DRY: &str = "dry|oven dry|oven-dry|od|air dry|seco|seca|secos|sec|seche|trocken|secco|secca";
    DRY.split('|').any(|word| word == folded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_lose_units_densities_and_states() {
        let of = |text| label(text, Decimal::Comma);
        let sand = of("Sand 0/2 (2,64 kg/dm³) [kg/m³]");
        assert_eq!(
            (sand.name.as_str(), sand.unit, sand.density_kg_m3),
            ("Sand 0/2", Some(Unit::Content(1.0)), Some(2640.0))
        );
        assert_eq!(of("Coarse aggregate No. 57 (SSD)").name, "Coarse aggregate No. 57");
        let dry = of("Agregado fino seco");
        assert_eq!((dry.name.as_str(), dry.is_dry), ("Agregado fino", true));
        assert_eq!(of("Sand (SG 2,65)").density_kg_m3, Some(2650.0));
        assert_eq!(of("Zement CEM I 42,5 R").name, "Zement CEM I 42,5 R");
        assert_eq!(of("Jelly :").name, "Jelly");
    }
}
