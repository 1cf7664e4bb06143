//! Sizes in the names of aggregates.

use super::super::number::{Decimal, quantity};
use super::super::openings::Unit;

/// The sizes that a name states, in mm: `0/4`, `8-16 mm`, `4 to 8 mm`, `20 mm`, `3/8 in`. The lower one is `None` where
/// there is one only.
pub(super) fn size_mm(name: &str) -> Option<(Option<f64>, f64)> {
    let mut before = ' ';
    let mut skip = 0;
    for (at, character) in name.char_indices() {
        let starts = character.is_ascii_digit()
            && at >= skip
            && !before.is_alphanumeric()
            && !matches!(before, '.' | ',' | '/');
        before = character;
        if !starts {
            continue;
        }
        let (first, rest) = plain(&name[at..])?;
        skip = name.len() - rest.len();
        let trimmed = rest.trim_start_matches(' ');
        // The unit may stand after both numbers: `5 mm to 10 mm`.
        let joined = trimmed.strip_prefix("mm").map_or(trimmed, |rest| rest.trim_start_matches(' '));
        let separated = joined
            .strip_prefix(['/', '-', '–', '—'])
            .or_else(|| joined.strip_prefix("to "))
            .or_else(|| joined.strip_prefix("bis "))
            .map(str::trim_start);
        if let Some((second, rest)) = separated.and_then(plain) {
            skip = name.len() - rest.len();
            let in_inches = is_inch(rest);
            if in_inches {
                // A part of an inch, such as 3/8".
                if let Some(of) = quantity(&name[at..], Decimal::Point).filter(|of| of.is_fraction) {
                    return Some((None, inches_in_mm(of.value)));
                }
            }
            let (first, second) =
                if in_inches { (inches_in_mm(first), inches_in_mm(second)) } else { (first, second) };
            if first < second && second <= 150.0 && !rest.starts_with(['/', '-']) {
                return Some((Some(first), second));
            }
            continue;
        }
        if trimmed.to_ascii_lowercase().starts_with("mm") && (0.05..=150.0).contains(&first) {
            return Some((None, first));
        }
        if is_inch(rest)
            && let Some(of) = quantity(&name[at..], Decimal::Point)
        {
            return Some((None, inches_in_mm(of.value)));
        }
    }
    None
}

/// Inches in mm: the sieve of ASTM E11 where there is one.
fn inches_in_mm(inches: f64) -> f64 {
    let mm = Unit::Inch.mm(inches).unwrap_or(25.4 * inches);
    // Without the last digits of the product.
    (1.0e6 * mm).round() / 1.0e6
}

fn is_inch(rest: &str) -> bool {
    let rest = rest.trim_start();
    let word: String = rest.chars().take_while(|c| c.is_alphabetic()).collect();
    rest.starts_with(['"', '”', '″'])
        || matches!(word.to_ascii_lowercase().as_str(), "in" | "inch" | "inches")
}

/// A plain number with a decimal sign of either kind, and what follows.
fn plain(text: &str) -> Option<(f64, &str)> {
    let mut end = 0;
    let mut has_sign = false;
    let bytes = text.as_bytes();
    while let Some(&byte) = bytes.get(end) {
        let next_is_digit = bytes.get(end + 1).is_some_and(u8::is_ascii_digit);
        if !(byte.is_ascii_digit() || (!has_sign && end > 0 && next_is_digit && matches!(byte, b'.' | b',')))
        {
            break;
        }
        has_sign |= !byte.is_ascii_digit();
        end += 1;
    }
    let number = text[..end].replace(',', ".").parse().ok()?;
    Some((number, &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_state_sizes() {
        for (name, expected) in [
            ("Sand 0/4", Some((Some(0.0), 4.0))),
            ("Kies 8-16 mm", Some((Some(8.0), 16.0))),
            ("Gravel 5 mm to 10 mm", Some((Some(5.0), 10.0))),
            ("Splitt 5,6/11,2", Some((Some(5.6), 11.2))),
            ("20 mm Jelly", Some((None, 20.0))),
            ("Stone 3/4 in", Some((None, 19.0))),
            ("Gravel 1/2\"", Some((None, 12.5))),
            ("C30/37", None),
            ("Coarse aggregate No. 57", None),
            ("CEM I 42,5 R", None),
        ] {
            assert_eq!(size_mm(name), expected, "{name}");
        }
    }
}
