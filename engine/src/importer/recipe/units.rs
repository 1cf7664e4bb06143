//! Units of amounts: masses and volumes of a batch, contents of a cubic metre or of a cubic yard, shares, bags, parts.

use super::super::number::{Decimal, quantity};
use super::super::words::fold;

/// Mass of an international pound, in kg.
pub(super) const POUND_KG: f64 = 0.453_592_37;
/// Volume of a cubic yard, in m³.
pub(super) const CUBIC_YARD_M3: f64 = 0.764_554_857_984;
/// Volume of a cubic foot, in m³.
const CUBIC_FOOT_M3: f64 = 0.028_316_846_592;
/// Volume of a US gallon, in m³.
const GALLON_M3: f64 = 0.003_785_411_784;
/// Volume of a US fluid ounce, in m³.
const FLUID_OUNCE_M3: f64 = GALLON_M3 / 128.0;

/// Of what a percentage is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Of {
    /// Not said.
    Any,
    Volume,
    Mass,
    /// Of the mass of cement or binder.
    Cement,
}

/// What a number counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unit {
    /// So many kilograms, in a batch.
    Mass(f64),
    /// So many kilograms in a cubic metre; densities too.
    Content(f64),
    /// So many cubic metres, in a batch.
    Volume(f64),
    /// So many cubic metres in a cubic metre.
    Share(f64),
    Percent(Of),
    /// Bags of so many kilograms, in so many cubic metres or else in a batch.
    Bags {
        kg: Option<f64>,
        in_m3: Option<f64>,
    },
    /// Parts of a ratio.
    Parts {
        by_volume: bool,
    },
    /// An amount for each amount of cement, such as oz/cwt.
    Dose,
}

impl Unit {
    /// Whether it is a unit of particle densities and not of contents.
    pub(super) fn is_density(self) -> bool {
        matches!(self, Self::Content(factor) if factor > 10.0)
    }
}

/// A text of a unit without spaces and signs: `kg/m3`, `vol%`.
fn normal(text: &str) -> String {
    let mut normal = String::new();
    for word in fold(text).split_whitespace() {
        let word = match word {
            "per" | "pro" | "par" | "por" | "je" | "in" | "al" | "a" | "of" | "de" | "di" | "for" => "/",
            word => word,
        };
        for character in word.chars().filter(|&c| c.is_alphanumeric() || c == '/' || c == '%') {
            if character != '/' || !normal.ends_with('/') {
                normal.push(character);
            }
        }
    }
    normal
}

/// The mass of a unit, in kg.
fn mass(text: &str) -> Option<f64> {
    Some(match text {
        "kg" | "kgs" | "kgf" | "kilogram" | "kilograms" | "kilogramm" | "kilogrammes" => 1.0,
        "g" | "gr" | "gm" | "gms" | "gram" | "grams" | "gramm" | "grammes" | "gramos" | "gramas"
        | "grammi" => 1.0e-3,
        "t" | "to" | "tonne" | "tonnes" | "tonnen" => 1000.0,
        "lb" | "lbs" | "lbm" | "pound" | "pounds" | "libra" | "libras" => POUND_KG,
        _ => return None,
    })
}

/// The volume of a unit, in m³.
fn volume(text: &str) -> Option<f64> {
    let text = text.strip_prefix('1').unwrap_or(text);
    // What is behind it is concrete.
    let is = |names: &[&str]| {
        names.iter().filter_map(|name| text.strip_prefix(name)).any(|rest| {
            rest.len() <= 3 || OF_CONCRETE.iter().any(|word| rest.trim_start_matches('/').starts_with(word))
        })
    };
    if is(&["m3", "cum", "cbm", "cubicmet", "kubikmet", "metrocub", "metrecub", "metroscub", "metricub"]) {
        return Some(1.0);
    }
    if is(&["yd3", "cuyd", "cubicyard", "cubicyd", "cyd", "yard", "cy", "yd"]) {
        return Some(CUBIC_YARD_M3);
    }
    Some(match text {
        "l" | "lit" | "lits" | "lt" | "lts" | "ltr" | "ltrs" | "liter" | "liters" | "litre" | "litres"
        | "litri" | "litro" | "litros" | "dm3" => 1.0e-3,
        "ml" | "cm3" | "cc" | "ccm" => 1.0e-6,
        "gal" | "gals" | "gallon" | "gallons" | "usgal" | "usgallon" | "usgallons" => GALLON_M3,
        "qt" | "qts" | "quart" | "quarts" => GALLON_M3 / 4.0,
        "floz" | "fluidounce" | "fluidounces" => FLUID_OUNCE_M3,
        "ft3" | "cf" | "cft" | "cuft" | "cubicfeet" | "cubicfoot" | "pie3" | "pies3" => CUBIC_FOOT_M3,
        _ => return None,
    })
}

/// Words behind a cubic metre.
const OF_CONCRETE: [&str; 10] = [
    "concrete",
    "beton",
    "mix",
    "hormigon",
    "concreto",
    "calcestruzzo",
    "mortar",
    "mortel",
    "mortier",
    "fresh",
];

const BAGS: [&str; 15] = [
    "bag", "bags", "sack", "sacks", "sacke", "sac", "sacs", "saco", "sacos", "sacco", "sacchi", "bolsa",
    "bolsas", "bulto", "bultos",
];

/// Bags, with the mass of one where the text has it: `bags`, `bags (50 kg)`, `50-kg bags`, `94 lb sacks/yd³`.
fn bags(text: &str) -> Option<Unit> {
    let folded = fold(text);
    let is_bag = |word: &str| BAGS.contains(&word);
    let words: Vec<&str> =
        folded.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    words.iter().find(|word| is_bag(word))?;
    let mut kg = None;
    let digits = folded.find(|c: char| c.is_ascii_digit());
    if let Some(amount) = digits.and_then(|at| quantity(&folded[at..], Decimal::Comma)) {
        let end = amount.rest.find(|c: char| !c.is_alphabetic()).unwrap_or(amount.rest.len());
        kg = mass(&amount.rest[..end]).map(|factor| factor * amount.value);
    }
    let below = normal(text);
    let in_m3 = below.rsplit_once('/').and_then(|(_, below)| volume(below));
    Some(Unit::Bags { kg, in_m3 })
}

/// The unit that a text is.
pub(super) fn unit(text: &str) -> Option<Unit> {
    let name = normal(text);
    if name.is_empty() || name.len() > 40 {
        return None;
    }
    if name.contains('%') || matches!(name.as_str(), "percent" | "prozent" | "pct") {
        return percent(&name);
    }
    if let Some(bags) = bags(text) {
        return Some(bags);
    }
    match name.as_str() {
        "pcy" => return Some(Unit::Content(POUND_KG / CUBIC_YARD_M3)),
        "pcf" => return Some(Unit::Content(POUND_KG / CUBIC_FOOT_M3)),
        "kgm3" => return Some(Unit::Content(1.0)),
        "gcm3" | "kgdm3" | "gcc" | "tm3" => return Some(Unit::Content(1000.0)),
        "lm3" | "dm3m3" => return Some(Unit::Share(1.0e-3)),
        "part" | "parts" | "teile" | "teil" | "gt" | "gewichtsteile" | "masseteile" | "partes" | "parti"
        | "parties" | "pbw" | "partsbymass" | "partsbyweight" | "parts/mass" => {
            return Some(Unit::Parts { by_volume: false });
        }
        "rt" | "raumteile" | "raumteil" | "partsbyvolume" | "volumenteile" | "pbv" => {
            return Some(Unit::Parts { by_volume: true });
        }
        "oz/cwt" | "floz/cwt" | "oz" | "ozs" | "ml/100kg" | "l/100kg" | "oz/yd3" => return Some(Unit::Dose),
        _ => {}
    }
    let Some((above, below)) = name.split_once('/') else {
        return mass(&name).map(Unit::Mass).or_else(|| volume(&name).map(Unit::Volume));
    };
    let is_of_cement = below.starts_with("cwt") || below.starts_with("100") || below.contains("cement");
    if is_of_cement && (above == "oz" || mass(above).is_some() || volume(above).is_some()) {
        return Some(Unit::Dose);
    }
    let in_m3 = volume(below);
    // A weight in a cubic metre is in kilograms.
    let above_mass = mass(above).or(match above {
        "wt" | "weight" | "mass" | "masse" | "qty" if in_m3 == Some(1.0) => Some(1.0),
        _ => None,
    });
    let is_batch = ["batch", "mix", "misch", "charge", "gachee", "amasada", "trial"]
        .iter()
        .any(|name| below.starts_with(name));
    match (above_mass, volume(above), in_m3) {
        (Some(kg), _, Some(m3)) => Some(Unit::Content(kg / m3)),
        (_, Some(part), Some(m3)) => Some(Unit::Share(part / m3)),
        (Some(kg), _, None) if is_batch => Some(Unit::Mass(kg)),
        (_, Some(m3), None) if is_batch => Some(Unit::Volume(m3)),
        _ => None,
    }
}

fn percent(name: &str) -> Option<Unit> {
    if name.contains(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let rest: String = name.chars().filter(|c| c.is_alphabetic()).collect();
    Some(Unit::Percent(match rest.as_str() {
        "" | "percent" | "prozent" | "pct" => Of::Any,
        "v" | "vol" | "volume" | "volumen" | "byvol" | "byvolume" | "rt" | "envol" | "envolume"
        | "envolumen" | "emvolume" | "involume" | "concrete" | "beton" => Of::Volume,
        "c" | "z" | "vz" | "vc" | "vomz" | "vonz" | "vomzement" | "zement" | "cement" | "bwoc" | "bwc"
        | "bwob" | "binder" | "b" | "dc" | "ciment" | "duciment" | "cemento" | "mc" | "mz"
        | "bywtofcement" | "byweightcement" | "bymasscement" | "byweightofcement" | "bymassofcement"
        | "cementweight" => Of::Cement,
        "m" | "ma" | "mass" | "masse" | "massen" | "gew" | "wt" | "w" | "bymass" | "byweight" | "bywt"
        | "weight" | "peso" | "poids" | "enmasse" | "enpeso" | "empeso" | "inpeso" | "massa" | "masa" => {
            Of::Mass
        }
        _ => return None,
    }))
}

/// The unit in brackets or at the end of a head, and the head without it: `Gehalt [kg/m³]`, `cement_kg_m3`, `Air, %`.
pub(super) fn unit_in(text: &str) -> Option<(Unit, String)> {
    for (open, close) in groups(text).into_iter().rev() {
        let inner = text[open..close].trim_matches(['(', ')', '[', ']', '{', '}']);
        let inner = inner.strip_prefix(['=', '/']).unwrap_or(inner).trim();
        let first = inner.split([',', ';']).next().unwrap_or(inner);
        let begins_with_number = inner.starts_with(|c: char| c.is_ascii_digit());
        if let Some(unit) = unit(inner).or_else(|| unit(first)).filter(|_| !begins_with_number) {
            let rest = format!("{} {}", text[..open].trim_end(), text[close..].trim_start());
            return Some((unit, rest.trim().to_owned()));
        }
    }
    let mut starts: Vec<usize> = Vec::new();
    let mut is_inside = false;
    for (at, character) in text.char_indices() {
        let parts = character.is_whitespace() || matches!(character, '_' | ',' | ';' | ':');
        if !parts && !is_inside {
            starts.push(at);
        }
        is_inside = !parts;
    }
    let tails = starts.len().saturating_sub(5)..starts.len();
    for &start in &starts[tails] {
        let tail = text[start..].replace('_', " ");
        // A capital letter is a name.
        let is_letter =
            tail.trim().chars().count() == 1 && tail.trim().chars().all(|c| c.is_uppercase() && c != 'L');
        let before = fold(text[..start].split_whitespace().next_back().unwrap_or(""));
        // The volume that a head speaks of is no unit; half of a bracket is none either.
        let is_per =
            matches!(before.trim(), "per" | "pro" | "par" | "por" | "je" | "for" | "fur" | "al" | "of" | "1");
        let is_open = tail.contains([')', ']']) && !tail.contains(['(', '[']);
        let skips = is_letter || is_per || is_open || has_number(&tail);
        if let (false, Some(unit)) = (skips, unit(&tail)) {
            let rest = text[..start].trim_end_matches(|c: char| c.is_whitespace() || "_,;:/".contains(c));
            let rest = rest.strip_suffix(" in").or_else(|| rest.strip_suffix(" en")).unwrap_or(rest);
            return Some((unit, rest.to_owned()));
        }
    }
    None
}

/// Whether a text begins with a number that is no exponent.
fn has_number(text: &str) -> bool {
    text.trim_start_matches(['(', '[']).starts_with(|c: char| c.is_ascii_digit())
}

/// The brackets of a text: where each opens, and where it ends.
pub(super) fn groups(text: &str) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut open = None;
    for (at, character) in text.char_indices() {
        match character {
            '(' | '[' | '{' if open.is_none() => open = Some(at),
            ')' | ']' | '}' => {
                if let Some(open) = open.take() {
                    found.push((open, at + 1));
                }
            }
            _ => {}
        }
    }
    found
}

/// The volume of a batch that a title names, in m³: `for 30 l`, `pro m³`, `Quantities per cubic yard`.
pub(super) fn batch_m3(text: &str, decimal: Decimal) -> Option<f64> {
    let folded = fold(text);
    let words: Vec<&str> = folded.split_whitespace().collect();
    let is_per = |word: &str| {
        matches!(
            word,
            "per"
                | "pro"
                | "je"
                | "fur"
                | "for"
                | "par"
                | "por"
                | "para"
                | "pour"
                | "per."
                | "of"
                | "de"
                | "di"
                | "1"
        )
    };
    for at in 0..words.len() {
        let (number, from) = match quantity(words[at], decimal) {
            Some(number) if number.rest.is_empty() => (number.value, at + 1),
            Some(number) => match volume(&normal(number.rest)) {
                Some(m3) if number.value > 0.0 => return Some(number.value * m3),
                _ => continue,
            },
            None if is_per(words[at]) => (1.0, at + 1),
            None => continue,
        };
        for length in (1..=2).rev() {
            let found = words.get(from..from + length).and_then(|unit| volume(&normal(&unit.concat())));
            if let Some(m3) = found.filter(|_| number > 0.0) {
                return Some(number * m3);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_they_are_printed() {
        let yard = POUND_KG / CUBIC_YARD_M3;
        for (text, expected) in [
            ("kg/m³", Unit::Content(1.0)),
            ("Kg/ M 3", Unit::Content(1.0)),
            ("kg per cubic metre", Unit::Content(1.0)),
            ("Wt/cum", Unit::Content(1.0)),
            ("kg in a m^3 mixture", Unit::Content(1.0)),
            ("kg·m⁻³", Unit::Content(1.0)),
            ("kg/dm³", Unit::Content(1000.0)),
            ("t/m3", Unit::Content(1000.0)),
            ("lb/yd³", Unit::Content(yard)),
            ("lbs/cu. yd.", Unit::Content(yard)),
            ("pcy", Unit::Content(yard)),
            ("l/m³", Unit::Share(0.001)),
            ("gal", Unit::Volume(GALLON_M3)),
            ("Vol.-%", Unit::Percent(Of::Volume)),
            ("M.-%", Unit::Percent(Of::Mass)),
            ("% v. Z.", Unit::Percent(Of::Cement)),
            ("oz/cwt", Unit::Dose),
            ("bags (50 kg)", Unit::Bags { kg: Some(50.0), in_m3: None }),
            ("bags/m³", Unit::Bags { kg: None, in_m3: Some(1.0) }),
            ("sacos de 42,5 kg", Unit::Bags { kg: Some(42.5), in_m3: None }),
            ("94 lb sacks", Unit::Bags { kg: Some(94.0 * POUND_KG), in_m3: None }),
            ("kg/batch", Unit::Mass(1.0)),
        ] {
            assert_eq!(unit(text), Some(expected), "{text}");
        }
        for text in ["mm", "MPa", "R", "N", "CEM", "", "C25/30", "Type I/II"] {
            assert_eq!(unit(text), None, "{text}");
        }
    }

    #[test]
    fn units_are_found_in_heads() {
        for (text, unit, rest) in [
            ("Gehalt [kg/m³]", Unit::Content(1.0), "Gehalt"),
            ("cement kg", Unit::Mass(1.0), "cement"),
            ("cement_kg_m3", Unit::Content(1.0), "cement"),
            ("Air, %", Unit::Percent(Of::Any), "Air"),
            ("Sand 0/2 (2,64 kg/dm³) [kg/m³]", Unit::Content(1.0), "Sand 0/2 (2,64 kg/dm³)"),
            ("Sand (kg/m³, SSD)", Unit::Content(1.0), "Sand"),
            ("Wasser in l", Unit::Volume(0.001), "Wasser"),
            ("kg/m³", Unit::Content(1.0), ""),
        ] {
            assert_eq!(unit_in(text), Some((unit, rest.to_owned())), "{text}");
        }
        assert_eq!(unit_in("Portland cement, Type I/II"), None);
        assert_eq!(unit_in("Zement CEM I 42,5 R"), None);
    }

    #[test]
    fn titles_name_the_volume_of_a_batch() {
        let of = |text| batch_m3(text, Decimal::Point);
        assert_eq!(of("Quantities for 1 m³ of concrete"), Some(1.0));
        assert_eq!(of("Rezept pro m³"), Some(1.0));
        assert_eq!(of("Batch volume 30 l"), Some(0.03));
        assert_eq!(of("per cubic yard"), Some(CUBIC_YARD_M3));
        assert_eq!(of("C25/30 F3 XC4"), None);
    }
}
