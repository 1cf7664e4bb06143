//! Numbers as people write them: decimal comma or point, thousands, fractions of an inch, percent signs, footnote
//! marks.

/// Which sign stands before the decimals where a number alone does not tell, as in `1,250`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Decimal {
    Point,
    Comma,
    /// Each of the two signs, in one table: none parts thousands.
    Either,
}

/// What a number alone says about decimal signs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Evidence {
    /// It has no sign, or one that both readings take alike.
    None,
    Point,
    Comma,
    /// One sign before three digits: decimals, or thousands.
    Open,
}

/// A number at the beginning of a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Quantity<'a> {
    pub(super) value: f64,
    /// Written as a fraction, such as `3/8` or `1 1/2`.
    pub(super) is_fraction: bool,
    /// Where it ends in the text, in bytes.
    pub(super) end: usize,
    /// What follows, without spaces around it.
    pub(super) rest: &'a str,
}

/// Whether this is a sign of digits in groups or of decimals.
fn is_sign(character: char) -> bool {
    matches!(character, '.' | ',' | '\'' | '’' | '\u{a0}' | '\u{202f}' | '\u{2009}')
}

/// The length of the number at the beginning of a text, in bytes: digits with signs among them.
fn literal(text: &str) -> usize {
    let mut end = 0;
    let mut characters = text.char_indices().peekable();
    while let Some((at, character)) = characters.next() {
        let next_is_digit = characters.peek().is_some_and(|(_, next)| next.is_ascii_digit());
        // A number may begin with its decimal sign.
        let is_inside = is_sign(character) && next_is_digit && (end > 0 || ".,".contains(character));
        if character.is_ascii_digit() || is_inside {
            end = at + character.len_utf8();
        } else {
            break;
        }
    }
    end
}

/// What the number `literal` says about decimal signs.
fn evidence_of(literal: &str) -> Evidence {
    let last = literal.char_indices().rev().find(|(_, c)| ".,".contains(*c));
    let Some((at, sign)) = last else { return Evidence::None };
    let (before, after) = (&literal[..at], &literal[at + 1..]);
    let as_decimal = if sign == '.' { Evidence::Point } else { Evidence::Comma };
    let other = if sign == '.' { Evidence::Comma } else { Evidence::Point };
    // After a sign of another kind it is the decimal one: 1.234,5. Twice, it parts thousands: 1,234,567.
    if before.chars().any(|c| is_sign(c) && c != sign) {
        as_decimal
    } else if before.contains(sign) {
        other
    } else if after.len() == 3 && (1..=3).contains(&before.len()) && !before.starts_with('0') {
        Evidence::Open
    } else {
        as_decimal
    }
}

/// The number that a literal is, with a decimal sign where it does not tell.
fn valued(literal: &str, decimal: Decimal) -> Option<f64> {
    let sign = match evidence_of(literal) {
        Evidence::Point => '.',
        Evidence::Comma => ',',
        Evidence::None | Evidence::Open => match decimal {
            Decimal::Comma => ',',
            Decimal::Either if literal.contains(',') => ',',
            Decimal::Point | Decimal::Either => '.',
        },
    };
    let plain: String = literal
        .chars()
        .filter_map(|c| if c == sign { Some('.') } else { c.is_ascii_digit().then_some(c) })
        .collect();
    plain.parse().ok()
}

/// The number at the beginning of a text: `12,5 %`, `1 1/2 in`, `3/8"`, `-0.75`, `1.2e-5`.
pub(super) fn quantity(text: &str, decimal: Decimal) -> Option<Quantity<'_>> {
    let trimmed = text.trim_start();
    let (negative, unsigned) = match trimmed.strip_prefix(['-', '−', '–']) {
        Some(rest) => (true, rest.trim_start()),
        None => (false, trimmed.strip_prefix('+').unwrap_or(trimmed)),
    };
    let end = literal(unsigned);
    let (value, is_fraction, rest) = if end == 0 {
        let (value, rest) = vulgar(unsigned)?;
        (value, true, rest)
    } else {
        let (whole, rest) = (valued(&unsigned[..end], decimal)?, &unsigned[end..]);
        let is_whole = whole.fract() == 0.0;
        if let (true, Some((of, after))) = (is_whole, denominator(rest))
            && whole % 2.0 == 1.0
            && whole < of
        {
            (whole / of, true, after)
        } else if let (true, Some((part, after))) = (is_whole, part_of_one(rest)) {
            (whole + part, true, after)
        } else if let Some((exponent, after)) = exponent(rest) {
            (format!("{whole}e{exponent}").parse().ok()?, false, after)
        } else {
            (whole, false, rest)
        }
    };
    let value = if negative { -value } else { value };
    Some(Quantity { value, is_fraction, end: text.len() - rest.len(), rest: rest.trim() })
}

/// The denominator in `/8`, of a fraction of an inch.
fn denominator(text: &str) -> Option<(f64, &str)> {
    let text = text.strip_prefix(['/', '⁄'])?;
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let of: u32 = text[..end].parse().ok()?;
    matches!(of, 2 | 4 | 8 | 16 | 32 | 64).then(|| (f64::from(of), &text[end..]))
}

/// The fraction in ` 1/2`, `-1/2` or `½` after a whole number.
fn part_of_one(text: &str) -> Option<(f64, &str)> {
    let inner = text.trim_start_matches([' ', '\u{a0}', '-']);
    if let Some(found) = vulgar(inner) {
        return Some(found);
    }
    let end = inner.find(|c: char| !c.is_ascii_digit()).unwrap_or(inner.len());
    let (of, rest) = denominator(&inner[end..])?;
    let above: u32 = inner[..end].parse().ok()?;
    let part = f64::from(above) / of;
    (inner.len() < text.len() && part < 1.0).then_some((part, rest))
}

/// A fraction that is one character.
fn vulgar(text: &str) -> Option<(f64, &str)> {
    let first = text.chars().next()?;
    let value = match first {
        '½' => 0.5,
        '¼' => 0.25,
        '¾' => 0.75,
        '⅛' => 0.125,
        '⅜' => 0.375,
        '⅝' => 0.625,
        '⅞' => 0.875,
        _ => return None,
    };
    Some((value, &text[first.len_utf8()..]))
}

/// The exponent in `e-5` or `E+03`.
fn exponent(text: &str) -> Option<(i32, &str)> {
    let digits = text.strip_prefix(['e', 'E'])?;
    let signed = usize::from(digits.starts_with(['-', '+']));
    let end = digits[signed..].find(|c: char| !c.is_ascii_digit()).map_or(digits.len(), |at| signed + at);
    Some((digits[..end].parse().ok().filter(|e: &i32| e.abs() < 100)?, &digits[end..]))
}

/// Which decimal signs a text can have where its numbers are taken together: one of them, or both where nothing tells.
pub(super) fn decimals<'a>(cells: impl Iterator<Item = &'a str>) -> Vec<Decimal> {
    let (mut point, mut comma, mut open) = (false, false, false);
    for cell in cells {
        for evidence in evidences(cell) {
            match evidence {
                Evidence::None => {}
                Evidence::Point => point = true,
                Evidence::Comma => comma = true,
                Evidence::Open => open = true,
            }
        }
    }
    match (point, comma, open) {
        (false, true, _) => vec![Decimal::Comma],
        (true, false, _) | (_, _, false) => vec![Decimal::Point],
        (true, true, true) => vec![Decimal::Either, Decimal::Point, Decimal::Comma],
        (false, false, true) => vec![Decimal::Point, Decimal::Comma],
    }
}

/// What each number of a cell says about decimal signs.
fn evidences(cell: &str) -> Vec<Evidence> {
    let mut found = Vec::new();
    let mut rest = cell;
    while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
        // `.5` has its sign before the digits.
        let begins = rest[..at].char_indices().next_back().filter(|(_, c)| ".,".contains(*c));
        let at = begins.map_or(at, |(before, _)| before);
        let end = literal(&rest[at..]).max(1);
        found.push(evidence_of(&rest[at..at + end]));
        rest = &rest[at + end..];
    }
    found
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn value(text: &str, decimal: Decimal) -> Option<f64> {
        quantity(text, decimal).map(|of| of.value)
    }

    #[test]
    fn numbers_are_read_with_either_sign() {
        for (text, expected) in [
            ("12,5 %", 12.5),
            ("12.5", 12.5),
            ("0,063", 0.063),
            (".5", 0.5),
            ("1.234,5", 1234.5),
            ("1,234.5", 1234.5),
            ("1,234,567", 1_234_567.0),
            ("1'250.0", 1250.0),
            ("1\u{a0}250,5", 1250.5),
            ("3/8\"", 0.375),
            ("1 1/2 in", 1.5),
            ("1-1/2", 1.5),
            ("1½", 1.5),
            ("¾", 0.75),
            ("−0,75", -0.75),
            ("1.2e-5", 1.2e-5),
        ] {
            for decimal in [Decimal::Point, Decimal::Comma] {
                assert_eq!(value(text, decimal), Some(expected), "{text} {decimal:?}");
            }
        }
        assert_eq!(value("1,250", Decimal::Point), Some(1250.0));
        assert_eq!(value("1,250", Decimal::Comma), Some(1.25));
        assert_eq!(value("CEM I", Decimal::Point), None);
        assert_eq!(quantity("4 mm", Decimal::Point).unwrap().rest, "mm");
        for (text, value) in [("4/11", 4.0), ("4/8", 4.0), ("2/4", 2.0), ("8/16", 8.0)] {
            assert_eq!(
                quantity(text, Decimal::Point).unwrap().value,
                value,
                "a class, not a part of an inch"
            );
        }
    }

    #[test]
    fn the_numbers_of_a_table_tell_its_decimal_sign() {
        let of = |cells: &[&str]| decimals(cells.iter().copied());
        assert_eq!(of(&["0,125", "3"]), [Decimal::Comma]);
        assert_eq!(of(&["0,125", "1,250"]), [Decimal::Comma]);
        assert_eq!(of(&["1,250", "2.5"]), [Decimal::Point]);
        assert_eq!(of(&["1,250", "2,500"]), [Decimal::Point, Decimal::Comma]);
        assert_eq!(of(&["4", "8"]), [Decimal::Point]);
    }
}
