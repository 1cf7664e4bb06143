//! Sizes of sieves as people write them: with their unit beside them or above them, and as classes.

use super::number::{Decimal, quantity};
use super::openings::Unit;
use super::words::{fold, has};

/// A number with the unit that stands beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Size {
    pub(super) number: f64,
    pub(super) is_fraction: bool,
    pub(super) unit: Option<Unit>,
}

/// What the first cell of a row is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Label {
    Sieve(Size),
    /// Grains between two sizes.
    Class(Size, Size),
    /// Grains below a size.
    Below(Size),
    /// Grains above a size.
    Above(Size),
    /// What passes the finest sieve.
    Pan,
    /// The sum of all rows.
    Total,
    /// What was washed out.
    Wash,
    /// The mass of the sample before it was sieved.
    Initial,
    /// What was lost on the way.
    Loss,
}

const PAN: &str = "\
    pan|base|bottom|receiver|schale|auffangschale|boden|siebboden|fond|fundo|bandeja|ciega|cazoleta|prato";
const TOTAL: &str = "total|sum|summe|gesamt|somme|suma|soma|totaux";
const WASH: &str = "wash|decant|auswasch|abschlamm|lavage|lavado|lavaggio|laveur|eluv";
/// What was lost: the totals say so too.
const LOSS: &str = "loss|siebverlust|verlust|perdida|perda|perte|perdite|perdita";
const INITIAL: &str = "\
    initial|einwaage|before|dry mass|dry weight|masse seche|masa inicial|peso inicial|massa inicial|masse initiale|\
    trockenmasse|sample mass|dry sample|trockene probe|probenmasse|echantillon|muestra|amostra|campione|\
    sample weight|weight of sample|mass of sample";
/// Words that may stand beside a size.
const BESIDE: &str = "\
    sieve|sieb|mesh|tamis|tamiz|malla|malha|peneira|setaccio|us|bs|astm|din|iso|u.s|u.s.|mm|µm|um|micron|microns|in|\
    in.|inch|inches|no|no.|no:|n.o|nr|nr.|phi|tyler|std|std.|standard|to|x|µ|mic|zoll";

/// What a cell at the beginning of a row is about; `None` where it is about no size.
pub(super) fn label(text: &str, decimal: Decimal) -> Option<Label> {
    let folded = fold(text);
    let folded = folded.trim();
    let has_digit = folded.chars().any(char::is_numeric);
    if has(folded, WASH) {
        return Some(Label::Wash);
    }
    if has(folded, LOSS) {
        return Some(Label::Loss);
    }
    if has(folded, PAN) {
        return Some(Label::Pan);
    }
    if !has_digit {
        // A sign before a size that is left out is not a sum.
        return if has(folded, INITIAL) {
            Some(Label::Initial)
        } else if has(folded, TOTAL) {
            Some(Label::Total)
        } else {
            None
        };
    }
    let sizes = sizes(text, decimal);
    let is_named = folded
        .split(|c: char| !(c.is_alphanumeric() || ".:".contains(c)))
        .filter(|word| word.chars().next().is_some_and(char::is_alphabetic))
        .all(|word| {
            let name = word.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
            BESIDE.split('|').any(|of| of == word || of == name) || is_relation(word)
        });
    if !is_named {
        return None;
    }
    let begins_with = |signs: &[&str]| signs.iter().any(|sign| folded.starts_with(sign));
    let (first, second) = (*sizes.first()?, sizes.get(1).copied());
    let of_unit = |unit: Option<Unit>| sizes.iter().find(|size| size.unit == unit).copied();
    if let Some(second) = second
        && is_class(text, folded, first, second)
    {
        // The unit of one holds for both.
        let unit = first.unit.or(second.unit);
        let (first, second) =
            (Size { unit: first.unit.or(unit), ..first }, Size { unit: second.unit.or(unit), ..second });
        return Some(if first.number <= second.number {
            Label::Class(first, second)
        } else {
            Label::Class(second, first)
        });
    }
    if begins_with(&["<", "under ", "unter ", "below ", "-", "less "])
        && !folded.contains("phi")
        && first.number >= 0.0
    {
        return Some(Label::Below(first));
    }
    if begins_with(&[">", "over ", "uber ", "above ", "+"]) {
        return Some(Label::Above(first));
    }
    // `3/8 in. (9.5 mm)`: the size in mm.
    let size = of_unit(Some(Unit::Mm)).or(of_unit(Some(Unit::Um))).unwrap_or(first);
    let is_one = second.is_none() || sizes.iter().any(|of| of.unit.is_some());
    if size.number == 0.0 && size.unit != Some(Unit::Phi) {
        return Some(Label::Pan);
    }
    is_one.then_some(Label::Sieve(size))
}

fn is_relation(word: &str) -> bool {
    matches!(word, "under" | "unter" | "below" | "less" | "than" | "over" | "uber" | "above" | "bis" | "a")
}

/// Whether two sizes are the bounds of a class: `4-8`, `4/8 mm`, `4 to 8`, `-8 +4`, and not one size in two units.
fn is_class(text: &str, folded: &str, first: Size, second: Size) -> bool {
    if text.contains('(') || (first.unit.is_some() && second.unit.is_some() && first.unit != second.unit) {
        return false;
    }
    let digits = |c: char| c.is_ascii_digit();
    let start = folded.find(digits).unwrap_or(0);
    let after = folded[start..].trim_start_matches(|c: char| c.is_ascii_digit() || ".,".contains(c));
    let between: String = after.trim_start().chars().take_while(|c| !c.is_ascii_digit()).collect();
    let is_joined = ["-", "/", "to", "bis", "a", "x", "+"].iter().any(|sign| {
        let between = between.trim();
        between == *sign
            || between.trim_start_matches(char::is_alphabetic).trim() == *sign
            || between.ends_with(sign)
    });
    is_joined && first.number >= 0.0 && second.number >= 0.0 && first.number != second.number
}

/// What a cell of a column of phi is about: each number, also 0 and those below it, is a size.
pub(super) fn phi_label(text: &str, decimal: Decimal) -> Option<Label> {
    match quantity(text, decimal) {
        Some(of) if of.rest.is_empty() || fold(of.rest).trim() == "phi" => {
            Some(Label::Sieve(Size { number: of.value, is_fraction: false, unit: Some(Unit::Phi) }))
        }
        _ => label(text, decimal).filter(|label| !matches!(label, Label::Sieve(_) | Label::Class(..))),
    }
}

/// The sizes in a text with their units.
pub(super) fn sizes(text: &str, decimal: Decimal) -> Vec<Size> {
    let is_start = |c: char| c.is_ascii_digit() || "½¼¾⅛⅜⅝⅞".contains(c);
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(next) = text[at..].find(is_start) {
        let mut start = at + next;
        let before = &text[at..start];
        if before.ends_with(['.', ',']) && !before.trim_end_matches(['.', ',']).ends_with(char::is_alphabetic)
        {
            start -= 1;
        }
        let before = text[at..start].trim_end();
        let negative = before.ends_with(['-', '−']) && found.is_empty() && fold(text).contains("phi");
        let Some(of) = quantity(&text[start..], decimal) else { break };
        let head = fold(before);
        let head = head.trim_end();
        let is_numbered = ["no.", "no", "#", "n.o", "nr", "nr."].iter().any(|sign| head.ends_with(sign));
        let rest = fold(of.rest);
        let word: String = rest.trim_start().chars().take_while(|c| c.is_alphabetic() || *c == '"').collect();
        let unit = match word.as_str() {
            "mm" => Some(Unit::Mm),
            "µm" | "um" | "micron" | "microns" | "µ" | "mic" => Some(Unit::Um),
            "in" | "inch" | "inches" | "\"" | "zoll" | "pulgadas" | "pouces" => Some(Unit::Inch),
            "phi" => Some(Unit::Phi),
            "mesh" if fold(text).contains("tyler") => Some(Unit::TylerMesh),
            "mesh" if has(&fold(text), "bs") => Some(Unit::BsMesh),
            "mesh" => Some(Unit::UsSieve),
            _ if of.rest.starts_with(['″', '”', '\'', '’', '“', '′']) => Some(Unit::Inch),
            _ if is_numbered && has(&fold(text), "bs") => Some(Unit::BsMesh),
            _ if is_numbered => Some(Unit::UsSieve),
            _ => None,
        };
        let number = if negative { -of.value } else { of.value };
        found.push(Size { number, is_fraction: of.is_fraction, unit });
        at = start + of.end;
    }
    found
}

/// The unit that the head of a column states.
pub(super) fn unit_of_head(head: &str) -> Option<Unit> {
    let folded = fold(head);
    let is = |words: &str| has(&folded, words);
    if is("µm|um|micron|mikrometer|micrometre|micrometer|micras") {
        Some(Unit::Um)
    } else if is("mm|millimet|milimet") {
        Some(Unit::Mm)
    } else if is("phi") {
        Some(Unit::Phi)
    } else if is("inch|in|in.|pulgadas|pouces|zoll|polegadas|pollici") || head.contains("(\")") {
        Some(Unit::Inch)
    } else if is("tyler") {
        Some(Unit::TylerMesh)
    } else if is("bs|b.s|b.s.|british") {
        Some(Unit::BsMesh)
    } else if is(
        "us sieve|u.s. sieve|astm no|u.s. standard|us standard|us mesh|sieve no|sieve number|no.|tamiz no|tamis \
         no|peneira no|malla no",
    ) {
        Some(Unit::UsSieve)
    } else {
        None
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<Label> {
        label(text, Decimal::Point)
    }

    fn mm(text: &str) -> f64 {
        let Some(Label::Sieve(size)) = read(text) else { panic!("{text}: {:?}", read(text)) };
        size.unit.unwrap_or(Unit::Mm).mm(size.number).unwrap()
    }

    #[test]
    fn sizes_are_read_in_every_unit() {
        for (text, expected) in [
            ("4.75", 4.75),
            ("4.75 mm", 4.75),
            ("63 µm", 0.063),
            ("63um", 0.063),
            ("3/8\"", 9.5),
            ("3/8 in.", 9.5),
            ("1 1/2 in", 37.5),
            ("1-1/2\"", 37.5),
            ("No. 4", 4.75),
            ("No.200", 0.075),
            ("#16", 1.18),
            ("N° 40", 0.425),
            ("9.5 mm (3/8 in.)", 9.5),
            ("3/8 in. (9.5 mm)", 9.5),
            ("No. 8 (2.36 mm)", 2.36),
            ("BS No. 52", 0.3),
            ("100 mesh", 0.15),
            ("-2 phi", 4.0),
            ("600 μm (No. 30)", 0.6),
        ] {
            assert_eq!(mm(text), expected, "{text}");
        }
    }

    #[test]
    fn classes_and_other_rows_are_told_apart() {
        let bounds = |text: &str| match read(text) {
            Some(Label::Class(low, high)) => Some((low.number, high.number)),
            _ => None,
        };
        for text in ["4-8", "4/8", "4 – 8 mm", "4 mm - 8 mm", "8-4", "4 to 8 mm", "-8 +4"] {
            assert_eq!(bounds(text), Some((4.0, 8.0)), "{text}");
        }
        assert!(matches!(read("< 0.063"), Some(Label::Below(_))));
        assert!(matches!(read("> 16 mm"), Some(Label::Above(_))));
        for text in ["Pan", "Schale", "0", "Fondo"] {
            assert_eq!(read(text), Some(Label::Pan), "{text}");
        }
        assert_eq!(read("Total"), Some(Label::Total));
        assert_eq!(read("Wash loss"), Some(Label::Wash));
        assert_eq!(read("Initial dry mass"), Some(Label::Initial));
        for text in ["Cement", "CEM I 42.5 R", "Gravel 4/8", "", "A16"] {
            assert_eq!(read(text), None, "{text}");
        }
    }

    #[test]
    fn units_stand_in_heads() {
        for (head, unit) in [
            ("Sieve size (mm)", Some(Unit::Mm)),
            ("Maschenweite [µm]", Some(Unit::Um)),
            ("Sieve No.", Some(Unit::UsSieve)),
            ("Tyler mesh", Some(Unit::TylerMesh)),
            ("BS mesh", Some(Unit::BsMesh)),
            ("B.S. sieve", Some(Unit::BsMesh)),
            ("Sieve", None),
            ("phi", Some(Unit::Phi)),
            ("Abertura (pulgadas)", Some(Unit::Inch)),
        ] {
            assert_eq!(unit_of_head(head), unit, "{head}");
        }
    }
}
