//! What the head of a column says about its values, in German, English, French, Spanish, Portuguese and Italian.

use super::Meaning;
use super::openings::Unit;
use super::sieve::unit_of_head;
use super::words::{fold, has, position};

/// What a column is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Sieve,
    Values,
    /// Lower or upper limits, or both in one cell.
    Low,
    High,
    Limits,
    /// Remarks, numbers of samples and the like.
    Other,
}

/// What a head says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Head {
    /// As it is printed.
    pub(super) text: String,
    pub(super) role: Role,
    /// The unit of sieves.
    pub(super) unit: Option<Unit>,
    /// The meanings that its words allow; empty where it has none of these words.
    pub(super) meanings: Vec<Meaning>,
    /// What remains without these words: the name of an aggregate or a sample.
    pub(super) name: Option<String>,
}

const SIEVE: &str = "\
    sieve|sieb|maschenweite|korngrosse|korndurchmesser|kornklasse|korngruppe|kornung|lochweite|opening|aperture|\
    mesh|screen|tamis|maille|ouverture|diametre|tamiz|malla|abertura|luz|peneira|malha|setaccio|staccio|vaglio|\
    maglia|apertura|crivello|diametro|particle size|grain size|size|diameter|phi|d|openning|abmessung";
const PASSING: &str = "\
    pass|durchgang|siebdurchgang|finer|undersize|through|tamisat|tamise|pasa|cernido|smaller|fines|que passa|p d|\
    f d|q3|summenlinie|summenkurve";
const RETAINED: &str = "\
    retain|ruckstand|siebruckstand|refus|retenid|retenu|retid|trattenut|oversize|residu|ruckhalt|coarser|held|ret|\
    ret.";
const CUMULATIVE: &str = "cum|cum.|cumul|kumul|acum|accumul|aufsummiert|summe|summiert|sum|total|gesamt|acom";
const MASS: &str =
    "mass|weight|wt|wt.|gewicht|poids|peso|grams|gramm|gramos|gramas|g|kg|einwaage|gr|gr.|menge";
const PERCENT: &str = "%|percent|per cent|prozent|pourcent|porcentaje|porcentagem|pct|por ciento";
/// Words for shares, where masses stand beside them.
const SHARE: &str = "fraction|anteil|share|part|proportion|teilmenge|proporcion|proporcao|fraccion";
/// Words for classes of sizes, of which a unit makes a head of sieves.
const CLASSES: &str = "fraction|fraktion|class|klasse|clase|range|fraccion|fracao";
const LIMITS: &str = "limit|spec|requirement|envelope|grenz|sollbereich|fuseau|fuso|huso|bereich|band|range";
const LOW: &str = "min|min.|lower|untere|unten|inferieur|inferior|low|mini|untergrenze";
const HIGH: &str = "max|max.|upper|obere|oben|superieur|superior|high|maxi|obergrenze";
const OTHER: &str = "\
    remark|bemerkung|date|datum|fecha|nr|lfd|item|note|observ|comment|modul|sr.no|sr|s.no|sl|sl.no|s.n|code|lab";
/// Words without a meaning of their own.
const FILLING: &str = "\
    in|of|by|the|and|der|die|das|des|du|de|di|la|le|el|en|que|por|par|da|do|dei|is|mm|µm|um|m.-%|m-%|vol.-%|each|\
    teil|partial|parziale|parcial|partiel|no|no.|number|us|astm|a|on|than|individ|einzel|mat|mat.|material|q|gm|gms|\
    simple|on each sieve|total|lb|lbs|m|gew";

/// What a head says; an empty head says nothing.
pub(super) fn head(text: &str) -> Head {
    let folded = fold(text);
    let folded = folded.trim();
    let is = |words: &str| has(folded, words);
    let unit = unit_of_head(text);
    // `Siebdurchgang` begins with a word for sieves, `size passing` has one.
    let (passes, stays) = (is(PASSING), is(RETAINED));
    let (is_low, is_high) = (is(LOW), is(HIGH));
    let is_bare_unit = !folded.is_empty()
        && unit.is_some()
        && only(folded, &["mm", "µm", "um", "in", "inch", "phi", "micron", "microns", "\""]);
    let is_class = is(CLASSES) && unit.is_some();
    let is_value = passes || stays || is("mass %|weight %") || (is(MASS) && is(PERCENT));
    let role = if (!is_value && (is(SIEVE) || is_class)) || is_bare_unit {
        Role::Sieve
    } else if is_low && is_high || (is(LIMITS) && !is_low && !is_high) {
        Role::Limits
    } else if is_low {
        Role::Low
    } else if is_high {
        Role::High
    } else if is(OTHER) && !passes && !stays {
        Role::Other
    } else {
        Role::Values
    };
    let meanings = if role == Role::Sieve { Vec::new() } else { meanings(folded, passes, stays) };
    Head { text: text.to_owned(), role, unit, meanings, name: name(text) }
}

/// The meanings that words allow.
fn meanings(folded: &str, passes: bool, stays: bool) -> Vec<Meaning> {
    let cumulative = has(folded, CUMULATIVE);
    let is_percent = has(folded, PERCENT) || folded.contains('%');
    let is_mass = has(folded, MASS) && !is_percent && !has(folded, SHARE);
    match (passes, stays, cumulative, is_mass) {
        (true, false, _, false) => vec![Meaning::Passing],
        (true, false, _, true) => vec![Meaning::MassPassing, Meaning::Passing],
        (false, true, true, false) => vec![Meaning::CumulativeRetained],
        (false, true, true, true) => vec![Meaning::CumulativeMass],
        // A residue may be that of each sieve or of all coarser ones too.
        (false, true, false, false) => vec![Meaning::Retained, Meaning::CumulativeRetained],
        (false, true, false, true) => vec![Meaning::Mass, Meaning::CumulativeMass],
        (false, false, true, false) => vec![Meaning::CumulativeRetained, Meaning::Passing],
        (false, false, true, true) => vec![Meaning::CumulativeMass, Meaning::MassPassing],
        (false, false, false, true) => vec![Meaning::Mass, Meaning::CumulativeMass, Meaning::MassPassing],
        // `passing / retained` and heads without these words.
        _ => Vec::new(),
    }
}

fn words(folded: &str) -> impl Iterator<Item = &str> {
    folded.split(|c: char| !(c.is_alphanumeric() || ".-%\"#/+".contains(c))).filter(|word| !word.is_empty())
}

fn only(folded: &str, known: &[&str]) -> bool {
    words(folded).all(|word| known.contains(&word.trim_end_matches('.')))
}

/// What remains of a head without the words that say what its values are.
fn name(text: &str) -> Option<String> {
    let known = [SIEVE, PASSING, RETAINED, CUMULATIVE, MASS, PERCENT, LIMITS, LOW, HIGH, OTHER, FILLING];
    let left: Vec<&str> = text
        .split(|c: char| c.is_whitespace() || "()[]{},;:|=*†‡".contains(c))
        .filter(|word| {
            let folded = fold(word);
            let folded = folded.trim().trim_matches(|c: char| ".-_/".contains(c));
            let begins = |of: &str| position(folded, of) == Some(0);
            let is_known = known.iter().any(|list| list.split('|').any(begins));
            // `Plant A`, but not the `Q` of `% Q PASA`.
            let is_letter =
                word.len() == 1 && *word != "Q" && word.starts_with(|c: char| c.is_ascii_uppercase());
            !folded.is_empty() && (!is_known || is_letter) && !folded.contains('%')
                || folded.chars().any(|c| c.is_ascii_digit())
        })
        .collect();
    let left = left.join(" ");
    (!left.trim().is_empty()).then(|| left.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_in_six_languages_say_what_values_are() {
        use Meaning::{CumulativeMass, CumulativeRetained, Mass, MassPassing, Passing, Retained};
        for (text, meanings) in [
            ("Siebdurchgang [M.-%]", vec![Passing]),
            ("% passing", vec![Passing]),
            ("Percent finer by weight", vec![Passing]),
            ("Cumulative passing (%)", vec![Passing]),
            ("% que pasa", vec![Passing]),
            ("Tamisat (%)", vec![Passing]),
            ("Passante %", vec![Passing]),
            ("Retained %", vec![Retained, CumulativeRetained]),
            ("Rückstand in %", vec![Retained, CumulativeRetained]),
            ("Refus cumulé (%)", vec![CumulativeRetained]),
            ("Retenido acumulado (%)", vec![CumulativeRetained]),
            ("% retida acumulada", vec![CumulativeRetained]),
            ("Trattenuto cumulato %", vec![CumulativeRetained]),
            ("Cumulative %", vec![CumulativeRetained, Passing]),
            ("Weight retained (g)", vec![Mass, CumulativeMass]),
            ("Peso retenido (g)", vec![Mass, CumulativeMass]),
            ("Mass passing (g)", vec![MassPassing, Passing]),
            ("Masse (g)", vec![Mass, CumulativeMass, MassPassing]),
            ("Sand 0/4", vec![]),
            ("", vec![]),
        ] {
            assert_eq!(head(text).meanings, meanings, "{text}");
            assert_eq!(head(text).role, Role::Values, "{text}");
        }
    }

    #[test]
    fn columns_of_sieves_and_limits_are_known() {
        for text in [
            "Sieve size (mm)",
            "Maschenweite",
            "Tamis (mm)",
            "Tamiz",
            "Peneira",
            "Setaccio",
            "mm",
            "d (mm)",
            "Sieve No.",
        ] {
            assert_eq!(head(text).role, Role::Sieve, "{text}");
        }
        for (text, role) in [
            ("Lower limit", Role::Low),
            ("max", Role::High),
            ("Specification", Role::Limits),
            ("Fuseau min", Role::Low),
        ] {
            assert_eq!(head(text).role, role, "{text}");
        }
    }

    #[test]
    fn what_remains_is_a_name() {
        for (text, name) in [
            ("Sand 0/4 passing (%)", Some("Sand 0/4")),
            ("Passing (%)", None),
            ("A16", Some("A16")),
            ("Siebdurchgang Kies [M.-%]", Some("Kies")),
            ("Cumulative % retained", None),
        ] {
            assert_eq!(head(text).name.as_deref(), name, "{text}");
        }
    }
}
